"""Surfaces where servos have taken them, from what is recorded of them: commands, most often."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import SURFACES, Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS
from aircraft_sysid_ros.aircraft.signals import MOST_INPUTS
from aircraft_sysid_ros.aircraft.term_values import lagged
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.samples import Kind, Samples, is_absurd

Array = npt.NDArray[np.float64]

#: Columns of the kinds that servos move; a throttle is none.
_MOVED = {Kind.CONTROLS: len(SURFACES), Kind.INPUTS: MOST_INPUTS}
#: A stamp [ns] so much before the newest one is of a clock that started over.
_RESTART = 10**9


class ServoLag:
    """Follows surfaces and named inputs, in order of arrival, with the ``lag`` of the aircraft file.

    With y the surface and u what is recorded, straight from sample to sample, lag y' + y = u, exactly. Blocks may be as
    large as they like: the result is the same to the bit.
    """

    def __init__(self, lag: float) -> None:
        """``lag`` [s]: time constant; 0: surfaces are as they are recorded."""
        self._lag = lag * 1e9
        self._newest = {kind: _unknown(width) for kind, width in _MOVED.items()}

    def follow(self, samples: Samples) -> Samples:
        """The same samples with surfaces in the place of commands. Other kinds, and absurd values, stay as they are."""
        if self._lag <= 0.0 or not np.isin(samples.kind, [*_MOVED]).any():
            return samples
        values = samples.values.copy()
        for kind, width in _MOVED.items():
            rows = np.flatnonzero(samples.kind == kind)
            if len(rows):
                absurd = is_absurd(samples[rows])[:, :width]
                commands = np.where(absurd, np.nan, values[rows, :width])
                _follow(samples.stamp[rows], commands, self._lag, *self._newest[kind])
                values[rows, :width] = np.where(absurd, values[rows, :width], commands)
        return Samples(samples.stamp, samples.kind, values)


def servo_lag(aircraft: Aircraft) -> ServoLag:
    """The servos of an aircraft file."""
    return ServoLag(aircraft.sensors[CONTROLS].lag)


def _unknown(width: int) -> tuple[npt.NDArray[np.int64], Array]:
    """By column the newest stamp [ns]; command and surface (2, width), NaN before there is one."""
    return np.zeros(width, np.int64), np.full((2, width), np.nan)


@njit(cache=True)
def _follow(
    stamp: npt.NDArray[np.int64], values: Array, lag: float, newest: npt.NDArray[np.int64], known: Array
) -> None:  # fmt: skip
    """Commands (n, k) at stamps (n,) [ns] become surfaces; NaN stays. ``lag`` [ns]."""
    for i in range(len(stamp)):
        for k in range(values.shape[1]):
            command = values[i, k]
            if np.isnan(command):
                continue
            before, surface, step = known[0, k], known[1, k], stamp[i] - newest[k]
            if np.isnan(surface) or step < -_RESTART:
                surface = command
            elif step <= 0:  # late, or sent twice: as far behind as the newest one
                values[i, k] = command + surface - before
                continue
            else:
                surface = lagged(surface, before, command, step, lag)
            values[i, k] = surface
            newest[k], known[0, k], known[1, k] = stamp[i], command, surface
