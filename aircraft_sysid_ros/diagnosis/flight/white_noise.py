"""How noisy IMU and surfaces were in a recording, where the window of the coefficients looks: for the floor of compare.

As ``identification.monitoring.quiet_noise`` has it in flight, of the whole recording: means over 1.5 half-widths, whose
fifth differences are noise and the motion that is left; of blocks of them, signal by signal, the quietest quarter
tells. So samples may be sparse, may have been smoothed and may repeat themselves. What was taken for the noise before
is the most that is believed: in gusts that never rest the quietest quarter is motion.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.coefficients.pace import interval_of
from aircraft_sysid_ros.identification.monitoring.quiet_noise import (
    BLOCK,
    LEAST,
    QUARTER,
    SUM_OF_SQUARES,
    WEIGHTS,
    WIDTH,
)
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.samples import Kind, Samples, is_absurd

Array = npt.NDArray[np.float64]

#: Least noise over what was taken for it before: what is beyond that is no finding but a signal that stands still.
LEAST_SHARE = 0.1
#: Columns of samples that share a noise, by the name of the sensor.
_COLUMNS = {
    "accelerometer": (Kind.IMU, slice(0, 3)), "gyro": (Kind.IMU, slice(3, 6)),
    "control_surfaces": (Kind.CONTROLS, slice(0, 3)),
}  # fmt: skip


def white_noise_of(aircraft: Aircraft, samples: Samples) -> Mapping[str, float]:
    """One sigma per sample by sensor, of those that the recording tells."""
    sound = ~is_absurd(samples).any(axis=1)
    found = {}
    for name, (kind, columns) in _COLUMNS.items():
        values = samples.values[(samples.kind == kind) & sound][:, columns]
        most, interval = aircraft.sensors[name].noise[0], interval_of(samples, kind)
        shown = _quietest(values[np.isfinite(values).all(axis=1)], interval) if interval > 0.0 else np.nan
        if np.isfinite(shown):
            found[name] = float(np.clip(shown, LEAST_SHARE * most, most))
    return found


def _quietest(values: Array, interval: float) -> float:
    """The noise of samples (n, k), the median of k; NaN where too few were recorded."""
    size = max(round(WIDTH * ParameterOptions().half_width / interval), 1)
    means = values[: len(values) // size * size].reshape(-1, size, values.shape[1]).mean(axis=1)
    if len(means) < len(WEIGHTS) + LEAST * BLOCK:
        return np.nan
    squares = np.array([np.convolve(each, WEIGHTS, mode="valid") for each in means.T]) ** 2
    blocks = squares[:, : squares.shape[1] // BLOCK * BLOCK].reshape(len(squares), -1, BLOCK).mean(axis=2)
    quiet = np.quantile(blocks, 0.25, axis=1) / (SUM_OF_SQUARES * QUARTER)
    return float(np.sqrt(size * np.median(quiet)))
