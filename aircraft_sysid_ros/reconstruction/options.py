"""Options of the first step."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StateOptions:
    """Options of the first step; the live node offers them as parameters."""

    horizon: float = 0.5  # [s] how late a sample may come and still be fused at its own time
    gate: float = 5.0  # [sigma] of a scalar innovation; more outputs at the same probability
    maximum_iterations: int = 5
    tolerance: float = 1e-3  # of (3.16), in standard deviations
    maximum_gap: float = 0.5  # [s] between IMU samples; longer, and the filter aligns anew
    divergence_time: float = 5.0  # [s] of GPS position and velocity rejected without a break: align anew
    air_data_errors: bool = False  # scales and offsets of V, alpha and beta are states too
