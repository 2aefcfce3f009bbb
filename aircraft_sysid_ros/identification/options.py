"""Options of the second step."""

from __future__ import annotations

from dataclasses import dataclass

from aircraft_sysid_ros.errors import InputError


@dataclass(frozen=True)
class ParameterOptions:
    """Options of the second step; the live node offers them as parameters."""

    half_width: float = 0.08  # [s] delay of the differentiator
    step: float = 0.04  # [s] between evaluations
    forgetting_time: float = 120.0  # [s] of motion that the estimates rest on
    excitation: float = 2.0  # how many sigma of its noise a term must move before its axis learns
    settle: float = 0.2  # [s] how much later than the state a control sample may come
    largest_gap: float = 0.1  # [s] between states inside a window
    lag_time: float = 2.0  # [s] over which residuals may be correlated
    error_window: float = 10.0  # [s] of the sliding model error
    estimator: str = "rls"  # which estimator's parameters are published: a name of ESTIMATORS
    lowest_frequency: float = 0.1  # [Hz] band of the estimator "fourier"
    highest_frequency: float = 2.0  # [Hz]
    relearn: bool = True  # after a sudden change of the aeroplane learn the changed axis anew
    rml_rate: float = 100.0  # [Hz] at which the estimator "rml" takes the IMU; faster samples are averaged


#: Options that an estimator is made of: they cannot change while it learns.
STRUCTURE = ("half_width", "step", "lag_time", "estimator", "lowest_frequency", "highest_frequency", "rml_rate")


def check_change(before: ParameterOptions, after: ParameterOptions) -> None:
    """Raises InputError where an estimator that is learning cannot go on with other options."""
    weighted = ("forgetting_time",) if before.estimator == "fourier" else ()  # the transforms are
    for name in (*STRUCTURE, *weighted):
        if getattr(before, name) != getattr(after, name):
            raise InputError(f"{name} cannot change while the estimator {before.estimator} learns: it is made of it")
