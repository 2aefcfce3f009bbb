"""What columns of a flight are, as far as it is known, and what they say of motion, speed and height together."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY, altitude_at
from aircraft_sysid_ros.recordings.tabular.guess.series import SPEEDS, Array, Column, Fit, Grid, fit

G = STANDARD_GRAVITY
HEIGHTS = ("altitude", "pressure_altitude", "height_above_ground")
GOOD, FAIR = 0.8, 0.55  # correlations
SURE_T = 5.0  # t-values that are believed
RATE_SECONDS, SLOW_SECONDS = 0.25, 1.0
_ROLL_SECONDS = 20.0  # that an aeroplane rolls faster than a third of its speed in flight
SLOWEST, FASTEST = 6.0, 340.0  # [m/s] of an aeroplane
#: [s] that manoeuvres and the slower motions of an aeroplane last: rows nearer to each other are not independent.
BLOCK = 10.0


class Flight:
    """The chosen column of every signal, and what their physics says of those that are not known yet."""

    def __init__(self, columns: dict[str, Column], turns: dict[str, float]) -> None:
        self.columns = columns
        self.grid = Grid(list(columns.values()))
        self._raw = {name: self.grid.raw(column, turns.get(name)) for name, column in columns.items()}

    def raw(self, signal: str) -> Array:
        """A column's own numbers on the grid."""
        return self._raw[signal]

    def known(self, *signals: str) -> bool:
        """Whether columns are there with unit and sign."""
        return all(s in self.columns and self.columns[s].is_known for s in signals)

    def has(self, *signals: str) -> bool:
        """Whether columns are there."""
        return all(s in self.columns for s in signals)

    def si(self, signal: str) -> Array:
        """A known signal in SI."""
        values = self.columns[signal].si(self._raw[signal])
        return self.grid.unwrapped(values, 2.0 * np.pi) if signal in ("attitude.yaw", "attitude.roll") else values

    def rate(self, signal: str, seconds: float = RATE_SECONDS) -> Array:
        """Derivative of a known signal."""
        return self.grid.rate(self.si(signal), seconds)

    def raw_rate(self, signal: str, seconds: float = RATE_SECONDS) -> Array:
        """Derivative of a column's own numbers."""
        return self.grid.rate(self._raw[signal], seconds)

    def smooth(self, values: Array, seconds: float = RATE_SECONDS) -> Array:
        """As the derivatives are."""
        return self.grid.smooth(values, seconds)

    def block(self, seconds: float = BLOCK) -> int:
        """Rows that are not independent of one another."""
        return max(round(seconds / self.grid.step), 1)

    def fit(self, reference: Array, column: Array) -> Fit | None:
        """How a reference follows a column in the air."""
        return fit(reference, column, self.block(), self.flying())

    def speed(self) -> Array | None:
        """Airspeed [m/s], or the speed over ground in its place."""
        for signal in SPEEDS:
            if self.known(signal):
                return self.si(signal)
        for signal in SPEEDS:
            if self.has(signal) and np.isfinite(self.columns[signal].rough):
                return self._raw[signal] * self.columns[signal].rough
        if self.known("velocity.north", "velocity.east"):
            return np.asarray(np.hypot(self.si("velocity.north"), self.si("velocity.east")))
        north, east = metres_along(self, 0), metres_along(self, 1)
        if north is None or east is None:
            return None
        return np.asarray(np.hypot(self.grid.rate(north, 2.0), self.grid.rate(east, 2.0)))

    def pace(self) -> Array | None:
        """Airspeed [m/s] for laws that need little of it: the mean that a_z and q have in common, where none is there.

        All slopes of such a law are then wrong by the same share.
        """
        speed, rate = self.speed(), self.columns.get("angular_velocity.y")
        if speed is not None or rate is None or not rate.unit or not self.known("specific_force.z"):
            return speed
        lift = self.smooth(self.si("specific_force.z") + G * cosines(self), SLOW_SECONDS)
        found = self.fit(lift, self.smooth(rate.factor * self.raw("angular_velocity.y"), SLOW_SECONDS))
        if found is None or abs(found.correlation) < GOOD or not SLOWEST < abs(found.slope) < FASTEST:
            return None
        return np.full(len(lift), abs(found.slope))

    def flying(self) -> npt.NDArray[np.bool_]:
        """Where it is in the air: faster than a third of its usual fast speed."""
        speed = self.speed()
        if speed is None or not np.isfinite(speed).any():
            return np.ones(len(self.grid.time), dtype=bool)
        return np.nan_to_num(speed) > 0.35 * np.nanpercentile(speed, 90)

    def airborne(self) -> npt.NDArray[np.bool_]:
        """Where the air alone turns it: flying, and not just before or after it rolls, when wheels push it, too."""
        flying = self.flying()
        rolls = max(int(_ROLL_SECONDS / self.grid.step), 1)
        away = ~binary_dilation(~flying, iterations=rolls)
        return away if 2 * away.sum() > flying.sum() else flying


def body_rates(f: Flight) -> tuple[Array, Array, Array] | None:
    """p, q, r of the attitude, (6.22)."""
    if not f.known("attitude.roll", "attitude.pitch", "attitude.yaw"):
        return None
    phi, theta = f.smooth(f.si("attitude.roll")), f.smooth(f.si("attitude.pitch"))
    dphi, dtheta, dpsi = (f.rate(f"attitude.{name}") for name in ("roll", "pitch", "yaw"))
    return (
        dphi - dpsi * np.sin(theta),
        dtheta * np.cos(phi) + dpsi * np.sin(phi) * np.cos(theta),
        dpsi * np.cos(theta) * np.cos(phi) - dtheta * np.sin(phi),
    )


def turn_rate(f: Flight, axis: int) -> Array | None:
    """p, q or r [rad/s] of the gyro, or of the attitude in its place."""
    signal = f"angular_velocity.{'xyz'[axis]}"
    if f.known(signal):
        return f.si(signal)
    rates = None if f.has(signal) else body_rates(f)
    return None if rates is None else rates[axis]


def climb_of(f: Flight) -> tuple[str, Array] | None:
    """Rate of climb [m/s]."""
    if f.known("velocity.down"):
        return "the vertical speed", -f.si("velocity.down")
    for signal in ("pressure_altitude", "altitude", "height_above_ground"):
        if f.known(signal):
            return f"the rate of {signal}", f.grid.rate(f.si(signal), SLOW_SECONDS)
    if f.known("position.down"):
        return "the rate of position.down", -f.grid.rate(f.si("position.down"), SLOW_SECONDS)
    return None


def cosines(f: Flight) -> Array:
    weight = np.ones(len(f.grid.time))
    for name in ("attitude.roll", "attitude.pitch"):
        if f.known(name):
            weight = weight * np.cos(f.si(name))
    return weight


def height_of(f: Flight, besides: str = "") -> tuple[str, Array] | None:
    """A height [m], up to a constant."""
    if f.known("static_pressure") and besides != "static_pressure":
        return "the static pressure", np.asarray(altitude_at(f.si("static_pressure")))
    for signal in HEIGHTS:
        if signal != besides and f.known(signal):
            return signal, f.si(signal)
    if besides != "position.down" and f.known("position.down"):
        return "position.down", -f.si("position.down")
    return None


def metres_along(f: Flight, axis: int) -> Array | None:
    """Position [m] to the north or to the east."""
    if f.known("latitude", "longitude"):
        latitude, longitude = f.si("latitude"), f.si("longitude")
        east = (longitude - np.nanmedian(longitude)) * np.cos(np.nanmedian(latitude))
        return np.asarray((latitude, east)[axis] * 6.371e6)
    name = ("position.north", "position.east")[axis]
    return f.si(name) if f.known(name) else None
