"""What stands between the sensors and the controller: the newest samples, made into what is seen."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dynamic_inversion import Seen

from aircraft_sysid_ros.aircraft.atmosphere import altitude_at
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.frames import air_data_from_velocity, velocity_from_air_data
from aircraft_sysid_ros.aircraft.rigid_body import cross
from aircraft_sysid_ros.consumer import Condition

Array = npt.NDArray[np.float64]

AIR_DATA = ("true_airspeed", "angle_of_attack", "sideslip", "air_density", "static_pressure")
#: Time [s] for which the last value of each stays.
LONGEST_GAP = 1.0
#: Low passes [s] of the airspeed, whose noise would move all surfaces, and of the height.
_AIRSPEED_LAG, _HEIGHT_LAG = 0.2, 0.5


class Instruments:
    """Newest samples of IMU, attitude and air data; ``seen`` is None until each has come."""

    def __init__(self, aircraft: Aircraft) -> None:
        self._probe = aircraft.air_data_position.copy()
        self._rates: Array | None = None
        self._attitude: Array | None = None
        self._air = np.full(len(AIR_DATA), np.nan)  # newest finite values at the probe
        self._air_stamps = np.zeros(len(AIR_DATA), np.int64)
        self._flow: Array | None = None  # airspeed, alpha, beta at the centre of gravity
        self._density = self._height = self._ground = np.nan
        self._stamp = 0

    def take_imu(self, rates: Array) -> None:
        """Angular rates FRD (3,) [rad/s]; what is no number is not used."""
        self._rates = rates if np.isfinite(rates).all() else self._rates

    def take_attitude(self, quaternion: Array) -> None:
        """Attitude of the autopilot (4,), body to NED; what is no number is not used."""
        self._attitude = quaternion if np.isfinite(quaternion).all() else self._attitude

    def take_air_data(self, values: Array, stamp: int) -> None:
        """Airspeed, alpha, beta at the probe, density, static pressure (5,) at a stamp [ns].

        They may come in parts, as from a MAVLink bridge: for NaN the last value stays, for ``LONGEST_GAP``.
        """
        is_new = np.isfinite(values)
        self._air[is_new], self._air_stamps[is_new] = values[is_new], stamp
        is_old = np.abs(stamp - self._air_stamps) > 1e9 * LONGEST_GAP
        if self._rates is None or np.any(is_old | np.isnan(self._air)):
            return
        values = self._air
        at_probe = velocity_from_air_data(values[0], values[1], values[2])
        flow = np.array(air_data_from_velocity(at_probe - cross(self._rates, self._probe)))
        altitude = altitude_at(float(values[4]))
        if self._flow is None:
            self._flow, self._ground, self._height = flow, altitude, 0.0
        elapsed = 1e-9 * abs(stamp - self._stamp) if self._stamp else 0.0  # back where the clock started over
        self._stamp = stamp
        share = -np.expm1(-elapsed / np.array([_AIRSPEED_LAG, _HEIGHT_LAG]))
        flow[0] = self._flow[0] + share[0] * (flow[0] - self._flow[0])
        self._height += share[1] * (altitude - self._ground - self._height)
        self._flow, self._density = flow, float(values[3])

    @property
    def lacking(self) -> list[str]:
        """Air data that have never come."""
        return [name for name, value in zip(AIR_DATA, self._air, strict=True) if np.isnan(value)]

    @property
    def seen(self) -> Seen | None:
        """What the controller sees."""
        if self._rates is None or self._attitude is None or self._flow is None:
            return None
        airspeed, alpha, beta = self._flow
        return Seen(self._rates, self._attitude, airspeed, alpha, beta, self._density, self._height)

    def condition(self, stamp: int) -> Condition | None:
        """Flight condition for the consumer library at a stamp [ns]; None while air data are older than LONGEST_GAP."""
        if self._flow is None or abs(stamp - self._stamp) > 1e9 * LONGEST_GAP:
            return None
        return Condition(*map(float, self._flow))
