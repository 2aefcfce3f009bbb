"""What really happened in a simulated flight, whichever simulator flew it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Columns of ``Truth.controls``, as in samples.Kind.CONTROLS.
ELEVATOR, AILERON, RUDDER, FLAPS, THROTTLE, THRUST, PROPELLER_SPEED = range(7)


@dataclass(frozen=True)
class Truth:
    """n instants of a flight: body axes FRD at the centre of gravity, NED from ``origin``, SI, radians."""

    time: Array  # (n,) [s]
    position: Array  # (n, 3) [m] NED
    velocity: Array  # (n, 3) [m/s] NED, over ground
    quaternion: Array  # (n, 4) body to NED
    rates: Array  # (n, 3) [rad/s]
    angular_acceleration: Array  # (n, 3) [rad/s^2]
    specific_force: Array  # (n, 3) [m/s^2]
    air_velocity: Array  # (n, 3) [m/s] relative to the air, body axes
    airspeed: Array  # (n,) [m/s]
    alpha: Array  # (n,) [rad]
    beta: Array  # (n,) [rad]
    density: Array  # (n,) [kg/m^3]
    static_pressure: Array  # (n,) [Pa]
    height: Array  # (n,) [m] above the ground
    controls: Array  # (n, 7) actual elevator, aileron, rudder, flaps, throttle, thrust, propeller speed
    inputs: Array  # (n, k) those that the aircraft file names, in its order, SI
    wind: Array  # (n, 3) [m/s] NED, the direction the air moves to
    coefficients: Array  # (n, 6) C_X C_Y C_Z C_l C_m C_n, moments about the aerodynamic reference point
    origin: Array  # (3,) latitude, longitude [rad], altitude [m]

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, index: slice | npt.NDArray[np.int64] | npt.NDArray[np.bool_]) -> Truth:
        return replace(self, **{name: getattr(self, name)[index] for name in SERIES})

    def at(self, time: npt.ArrayLike) -> Truth:
        """Truth at other times [s], linear between samples, held beyond both ends."""
        t = np.clip(np.asarray(time, dtype=np.float64), self.time[0], self.time[-1])
        left = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self) - 2)
        weight = (t - self.time[left]) / (self.time[left + 1] - self.time[left])
        values = {name: _between(getattr(self, name), left, weight) for name in SERIES}
        values["quaternion"] /= np.linalg.norm(values["quaternion"], axis=1, keepdims=True)
        return replace(self, **values)


#: Names of the fields that are time series.
SERIES = tuple(f.name for f in fields(Truth) if f.name != "origin")


def _between(series: Array, left: npt.NDArray[np.int64], weight: Array) -> Array:
    w = weight if series.ndim == 1 else weight[:, None]
    result: Array = (1.0 - w) * series[left] + w * series[left + 1]
    return result
