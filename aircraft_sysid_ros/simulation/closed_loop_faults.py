"""Sensors that fail in flight, for closed_loop: what they show from then on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError

Array = npt.NDArray[np.float64]

#: A blocked probe that leaks: the share of the airspeed that it shows in the end, and the time [s] until then.
LEAKED, LEAK_TIME = 0.7, 5.0
#: Jump of an IMU: accelerometers [m/s^2] and gyros [rad/s], per axis.
ACCELEROMETER_JUMP, GYRO_JUMP = 0.5, 0.03

FAULTS = ("airspeed_blocked", "alpha_vane_stuck", "gps_lost", "imu_bias_jump")
_AIRSPEED, _ALPHA = 0, 1


class Fault:
    """No fault, and the base of those that are."""

    def __init__(self, time: float = np.inf) -> None:
        """``time`` [s] of flight from which on the sensor fails."""
        self.time = time
        self._last: Array | None = None  # the newest good sample of what freezes

    def shown(self, topic: str, time: float, values: Array) -> Array | None:
        """What a sensor shows instead of ``values``; None: nothing is sent. Called in order of time."""
        return values


class _Frozen(Fault):
    """One quantity of the air data stays as it was, without noise; or leaks from there to a share of the truth."""

    def __init__(self, time: float, column: int, leaks: bool = False) -> None:
        super().__init__(time)
        self._column, self._leaks = column, leaks

    def shown(self, topic: str, time: float, values: Array) -> Array | None:
        if topic != "air_data":
            return values
        if time < self.time or self._last is None:
            self._last = values.copy()
            return values
        shown, at = values.copy(), self._column
        shown[at] = self._last[at]
        if self._leaks:
            shown[at] *= 1.0 - (1.0 - LEAKED) * min((time - self.time) / LEAK_TIME, 1.0)
        return shown


class _Silent(Fault):
    """No GPS any more."""

    def shown(self, topic: str, time: float, values: Array) -> Array | None:
        return None if topic.startswith("gps/") and time >= self.time else values


class _Jump(Fault):
    """The biases of the IMU are others from then on."""

    def __init__(self, time: float, jump: Array) -> None:
        super().__init__(time)
        self._jump = jump

    def shown(self, topic: str, time: float, values: Array) -> Array | None:
        return values + self._jump if topic == "imu/data" and time >= self.time else values


def fault_of(name: str, time: float, seed: int) -> Fault:
    """One of FAULTS, or "none", from ``time`` [s] on; InputError for another name.

    With an even seed a blocked probe keeps its pressure, with an odd one it leaks. Signs of the jump are drawn.
    """
    signs = np.random.default_rng([seed, 11]).choice([-1.0, 1.0], 6)
    made: dict[str, Callable[[], Fault]] = {
        "none": Fault,
        "airspeed_blocked": lambda: _Frozen(time, _AIRSPEED, leaks=seed % 2 == 1),
        "alpha_vane_stuck": lambda: _Frozen(time, _ALPHA),
        "gps_lost": lambda: _Silent(time),
        "imu_bias_jump": lambda: _Jump(time, signs * np.repeat([ACCELEROMETER_JUMP, GYRO_JUMP], 3)),
    }
    if name not in made:
        raise InputError(f"unknown fault '{name}': use one of {' '.join(made)}")
    return made[name]()
