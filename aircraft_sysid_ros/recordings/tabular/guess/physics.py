"""What unit a column has and which way is positive, by what an aeroplane in the air cannot help doing.

Every test compares a column with a reference in SI that other columns give, by laws that hold for any aeroplane:
gravity, the kinematics of attitude and of the flow angles ((6.20)-(6.24) of docs/references.md), hydrostatics, and that
the ground speed is the airspeed plus a steady wind. Stability is never assumed, but for the sign of a control, which is
by custom the one with which positive deflection gives a negative moment.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import GAS_CONSTANT, STANDARD_GRAVITY, altitude_at, temperature_at
from aircraft_sysid_ros.recordings.tabular.guess.series import Array, Column, Fit, Grid, fit, regress
from aircraft_sysid_ros.recordings.tabular.signals import UNITS
from aircraft_sysid_ros.recordings.tabular.units import conversion

G = STANDARD_GRAVITY
#: Units that are tried where a header says none, by SI unit.
CANDIDATES: dict[str, tuple[str, ...]] = {
    "m/s^2": ("m/s^2", "g", "ft/s^2"),
    "rad/s": ("rad/s", "deg/s"),
    "rad": ("rad", "deg"),
    "m": ("m", "ft", "km"),
    "m/s": ("m/s", "kt", "ft/s", "km/h", "cm/s"),
    "Pa": ("Pa", "hPa", "kPa", "inHg", "psi", "psf", "mmHg"),
    "K": ("K", "degC", "degF"),
    "kg/m^3": ("kg/m^3", "slug/ft^3"),
    "1": ("1", "%"),
}
_CLIMB = ("m/s", "ft/min", "ft/s", "kt")
_GOOD, _FAIR = 0.8, 0.55  # correlations
_SPEEDS = ("true_airspeed", "calibrated_airspeed", "indicated_airspeed")
_RATE_SECONDS, _SLOW_SECONDS = 0.25, 1.0
SLOWEST, FASTEST = 6.0, 340.0  # [m/s] of an aeroplane
#: [s] that manoeuvres and the slower motions of an aeroplane last: rows nearer to each other are not independent.
_BLOCK = 10.0
_ANSWER = 3.0  # [s] of a motion about the centre of gravity after a deflection
_LEFT_OVER = 0.5  # of the largest term of a law, at most, in mean squares
SURE_T = 5.0  # t-values that are believed
_NOISE_T = 2.5  # t-values below it contradict nothing


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

    def rate(self, signal: str, seconds: float = _RATE_SECONDS) -> Array:
        """Derivative of a known signal."""
        return self.grid.rate(self.si(signal), seconds)

    def raw_rate(self, signal: str, seconds: float = _RATE_SECONDS) -> Array:
        """Derivative of a column's own numbers."""
        return self.grid.rate(self._raw[signal], seconds)

    def smooth(self, values: Array, seconds: float = _RATE_SECONDS) -> Array:
        """As the derivatives are."""
        return self.grid.smooth(values, seconds)

    def block(self, seconds: float = _BLOCK) -> int:
        """Rows that are not independent of one another."""
        return max(round(seconds / self.grid.step), 1)

    def fit(self, reference: Array, column: Array) -> Fit | None:
        """How a reference follows a column in the air."""
        return fit(reference, column, self.block(), self.flying())

    def speed(self) -> Array | None:
        """Airspeed [m/s], or the speed over ground in its place."""
        for signal in _SPEEDS:
            if self.known(signal):
                return self.si(signal)
        for signal in _SPEEDS:
            if self.has(signal) and np.isfinite(self.columns[signal].rough):
                return self._raw[signal] * self.columns[signal].rough
        if self.known("velocity.north", "velocity.east"):
            return np.asarray(np.hypot(self.si("velocity.north"), self.si("velocity.east")))
        north, east = _metres(self, 0), _metres(self, 1)
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
        lift = self.smooth(self.si("specific_force.z") + G * _cosines(self), _SLOW_SECONDS)
        found = self.fit(lift, self.smooth(rate.factor * self.raw("angular_velocity.y"), _SLOW_SECONDS))
        if found is None or abs(found.correlation) < _GOOD or not SLOWEST < abs(found.slope) < FASTEST:
            return None
        return np.full(len(lift), abs(found.slope))

    def flying(self) -> npt.NDArray[np.bool_]:
        """Where it is in the air: faster than a third of its usual fast speed."""
        speed = self.speed()
        if speed is None or not np.isfinite(speed).any():
            return np.ones(len(self.grid.time), dtype=bool)
        return np.nan_to_num(speed) > 0.35 * np.nanpercentile(speed, 90)

    # References: what a signal must be, from others.

    def references(self, signal: str) -> list[tuple[str, Array, Array, float]]:
        """Of a signal: the law, the reference in SI, the column in the same form, the tolerance of the slope."""
        found = []
        for law in _LAWS.get(signal, ()):
            result = law(self)
            if result is not None:
                found.append(result)
        return found


Law = Callable[[Flight], "tuple[str, Array, Array, float] | None"]


def _body_rates(f: Flight) -> tuple[Array, Array, Array] | None:
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


def _gyro(axis: int) -> Law:
    def law(f: Flight) -> tuple[str, Array, Array, float] | None:
        signal = f"angular_velocity.{'xyz'[axis]}"
        rates = _body_rates(f)
        if rates is not None:
            return "the derivative of the attitude", rates[axis], f.smooth(f.raw(signal)), 0.3
        angle = ("attitude.roll", "attitude.pitch", "attitude.yaw")[axis]
        if f.known(angle):
            return f"the derivative of {angle}", f.rate(angle), f.smooth(f.raw(signal)), 0.4
        return None

    return law


def _yaw_rate_by_turn(seconds: float) -> Law:
    """r = g sin(phi) / V in a coordinated turn; the longer the mean, the less there is of a Dutch roll."""

    def law(f: Flight) -> tuple[str, Array, Array, float] | None:
        speed = f.pace()
        if speed is None or not f.known("attitude.roll"):
            return None
        with np.errstate(all="ignore"):
            reference = np.where(f.flying(), G * np.sin(f.si("attitude.roll")) / speed, np.nan)
        return "the bank in turns", f.smooth(reference, seconds), f.smooth(f.raw("angular_velocity.z"), seconds), 0.5

    return law


def _pitch_rate_by_kinematics(f: Flight) -> tuple[str, Array, Array, float] | None:
    """q = d alpha/dt - (f_z + g cos(theta) cos(phi)) / V, slow."""
    speed = f.pace()
    if speed is None or not f.known("specific_force.z"):
        return None
    with np.errstate(all="ignore"):
        reference = np.where(f.flying(), -(f.si("specific_force.z") + G * _cosines(f)) / speed, np.nan)
    return (
        "a_z over airspeed",
        f.smooth(reference, _SLOW_SECONDS),
        f.smooth(f.raw("angular_velocity.y"), _SLOW_SECONDS),
        0.5,
    )


def _angle_by_gyro(axis: int) -> Law:
    def law(f: Flight) -> tuple[str, Array, Array, float] | None:
        angle = ("attitude.roll", "attitude.pitch", "attitude.yaw")[axis]
        rate = f"angular_velocity.{'xyz'[axis]}"
        if not f.known(rate):
            return None
        return f"the integral of {rate}", f.smooth(f.si(rate)), f.raw_rate(angle), 0.4

    return law


def _pitch_by_gravity(f: Flight) -> tuple[str, Array, Array, float] | None:
    """g sin(theta) = f_x - dV/dt - (q w - r v), slow."""
    if not f.known("specific_force.x"):
        return None
    force = f.si("specific_force.x")
    speed = f.speed()
    if speed is not None:
        force = force - f.grid.rate(speed, _SLOW_SECONDS)
    law = "gravity along the body: a_x less the acceleration" if speed is not None else "gravity along the body"
    return law, f.smooth(force, _SLOW_SECONDS) / G, f.smooth(f.raw("attitude.pitch"), _SLOW_SECONDS), 0.7


def _pitch_by_climb(f: Flight) -> tuple[str, Array, Array, float] | None:
    """theta = gamma + alpha."""
    speed, climb = f.speed(), _climb(f)
    if speed is None or climb is None:
        return None
    with np.errstate(all="ignore"):
        gamma = np.where(f.flying(), np.arcsin(np.clip(climb[1] / speed, -1.0, 1.0)), np.nan)
    return f"the angle of climb ({climb[0]})", f.smooth(gamma, 2.0), f.smooth(f.raw("attitude.pitch"), 2.0), 0.7


def _force_x_by_gravity(f: Flight) -> tuple[str, Array, Array, float] | None:
    if not f.known("attitude.pitch"):
        return None
    reference = G * np.sin(f.smooth(f.si("attitude.pitch"), _SLOW_SECONDS))
    speed = f.speed()
    if speed is not None:
        reference = reference + f.grid.rate(speed, _SLOW_SECONDS)
    return "gravity along the body", reference, f.smooth(f.raw("specific_force.x"), _SLOW_SECONDS), 0.7


def _track_rate(f: Flight) -> Array | None:
    if not f.known("velocity.north", "velocity.east"):
        return None
    track = np.arctan2(f.si("velocity.east"), f.si("velocity.north"))
    return f.grid.rate(f.grid.unwrapped(track, 2.0 * np.pi), 2.0)


def _yaw_by_track(f: Flight) -> tuple[str, Array, Array, float] | None:
    """Turns alike; courses and headings themselves drift apart in the wind."""
    rate = _track_rate(f)
    if rate is None:
        return None
    return "the rate of turn of the course", rate, f.raw_rate("attitude.yaw", 2.0), 0.5


def _yaw_by_turn(f: Flight) -> tuple[str, Array, Array, float] | None:
    """dpsi/dt = g tan(phi) / V in a coordinated turn."""
    speed = f.speed()
    if not f.known("attitude.roll"):
        return None
    roll = np.tan(f.smooth(f.si("attitude.roll"), 2.0))
    reference = roll if speed is None else G * roll / f.smooth(speed, 2.0)
    return "the bank in turns", reference, f.raw_rate("attitude.yaw", 2.0), np.inf if speed is None else 0.5


def _roll_by_turn(f: Flight) -> tuple[str, Array, Array, float] | None:
    """tan(phi) = V dpsi/dt / g in a coordinated turn."""
    speed = f.speed()
    rate = _track_rate(f)
    name = "the rate of turn of the course"
    if rate is None and f.known("attitude.yaw"):
        rate, name = f.rate("attitude.yaw", 2.0), "the rate of turn of the heading"
    elif rate is None and f.known("angular_velocity.z"):
        rate, name = f.smooth(f.si("angular_velocity.z"), 2.0), "the rate of turn of the gyro"
    if rate is None:
        return None
    reference = np.arctan(rate * f.smooth(speed, 2.0) / G) if speed is not None else rate
    return name, reference, f.smooth(f.raw("attitude.roll"), 2.0), 0.7 if speed is not None else np.inf


def _climb(f: Flight) -> tuple[str, Array] | None:
    """Rate of climb [m/s]."""
    if f.known("velocity.down"):
        return "the vertical speed", -f.si("velocity.down")
    for signal in ("pressure_altitude", "altitude", "height_above_ground"):
        if f.known(signal):
            return f"the rate of {signal}", f.grid.rate(f.si(signal), _SLOW_SECONDS)
    if f.known("position.down"):
        return "the rate of position.down", -f.grid.rate(f.si("position.down"), _SLOW_SECONDS)
    return None


def _alpha_by_climb(f: Flight) -> tuple[str, Array, Array, float] | None:
    """alpha = theta - gamma with level wings."""
    speed, climb = f.speed(), _climb(f)
    if speed is None or climb is None or not f.known("attitude.pitch"):
        return None
    with np.errstate(all="ignore"):
        gamma = np.arcsin(np.clip(climb[1] / speed, -1.0, 1.0))
    reference = f.si("attitude.pitch") - gamma
    if f.known("attitude.roll"):
        reference = np.where(np.abs(f.si("attitude.roll")) < 0.35, reference, np.nan)
    return (
        f"pitch less the angle of climb ({climb[0]})",
        f.smooth(reference, _SLOW_SECONDS),
        f.smooth(f.raw("angle_of_attack"), _SLOW_SECONDS),
        0.9,
    )


def _alpha_by_kinematics(f: Flight) -> tuple[str, Array, Array, float] | None:
    """d alpha/dt = q + (f_z + g cos(theta) cos(phi)) / V."""
    speed = f.pace()
    if speed is None or not f.known("angular_velocity.y", "specific_force.z"):
        return None
    weight = G * _cosines(f)
    with np.errstate(all="ignore"):
        reference = f.si("angular_velocity.y") + (f.si("specific_force.z") + weight) / speed
    return "its kinematics from q and a_z", f.smooth(reference), f.raw_rate("angle_of_attack"), 0.7


def _cosines(f: Flight) -> Array:
    weight = np.ones(len(f.grid.time))
    for name in ("attitude.roll", "attitude.pitch"):
        if f.known(name):
            weight = weight * np.cos(f.si(name))
    return weight


_HEIGHTS = ("altitude", "pressure_altitude", "height_above_ground")


def _height(f: Flight, besides: str = "") -> tuple[str, Array] | None:
    """A height [m], up to a constant."""
    if f.known("static_pressure") and besides != "static_pressure":
        return "the static pressure", np.asarray(altitude_at(f.si("static_pressure")))
    for signal in _HEIGHTS:
        if signal != besides and f.known(signal):
            return signal, f.si(signal)
    if besides != "position.down" and f.known("position.down"):
        return "position.down", -f.si("position.down")
    return None


def _height_by_others(signal: str) -> Law:
    def law(f: Flight) -> tuple[str, Array, Array, float] | None:
        other = _height(f, signal)
        sign = -1.0 if signal == "position.down" else 1.0
        if other is not None:
            return other[0], sign * f.smooth(other[1], _SLOW_SECONDS), f.smooth(f.raw(signal), _SLOW_SECONDS), 0.3
        if f.known("velocity.down"):
            rise = -sign * f.grid.integral(f.si("velocity.down"))
            return "the integral of the vertical speed", rise, f.raw(signal), 0.3
        speed = f.speed()
        if speed is not None and f.known("attitude.pitch"):
            angle = f.si("attitude.pitch") - (f.si("angle_of_attack") if f.known("angle_of_attack") else 0.0)
            climb = sign * f.smooth(speed * np.sin(angle), 2.0)
            return "the climb of pitch and airspeed", climb, f.raw_rate(signal, 2.0), 0.35
        return None

    return law


def _down_by_height(f: Flight) -> tuple[str, Array, Array, float] | None:
    height = _height(f)
    if height is None:
        return None
    return height[0], -f.smooth(height[1], _SLOW_SECONDS), f.grid.integral(f.raw("velocity.down")), 0.15


def _metres(f: Flight, axis: int) -> Array | None:
    """Position [m] to the north or to the east."""
    if f.known("latitude", "longitude"):
        latitude, longitude = f.si("latitude"), f.si("longitude")
        east = (longitude - np.nanmedian(longitude)) * np.cos(np.nanmedian(latitude))
        return np.asarray((latitude, east)[axis] * 6.371e6)
    name = ("position.north", "position.east")[axis]
    return f.si(name) if f.known(name) else None


def _ground_velocity(axis: int) -> Law:
    def law(f: Flight) -> tuple[str, Array, Array, float] | None:
        metres = _metres(f, axis)
        if metres is None:
            return None
        return "the position", metres, f.grid.integral(f.raw(f"velocity.{('north', 'east')[axis]}")), 0.04

    return law


def _position_by_velocity(axis: int) -> Law:
    name = ("north", "east")[axis]

    def law(f: Flight) -> tuple[str, Array, Array, float] | None:
        if not f.known(f"velocity.{name}"):
            return None
        return "the integral of the velocity", f.grid.integral(f.si(f"velocity.{name}")), f.raw(f"position.{name}"), 0.2

    return law


_LAWS: dict[str, tuple[Law, ...]] = {
    "attitude.roll": (_angle_by_gyro(0), _roll_by_turn),
    "attitude.pitch": (_pitch_by_climb, _pitch_by_gravity, _angle_by_gyro(1)),
    "attitude.yaw": (_yaw_by_track, _angle_by_gyro(2), _yaw_by_turn),
    "angular_velocity.x": (_gyro(0),),
    "angular_velocity.y": (_gyro(1), _pitch_rate_by_kinematics),
    "angular_velocity.z": (_gyro(2), _yaw_rate_by_turn(2.0), _yaw_rate_by_turn(5.0)),
    "specific_force.x": (_force_x_by_gravity,),
    "angle_of_attack": (_alpha_by_kinematics, _alpha_by_climb),
    "velocity.north": (_ground_velocity(0),),
    "velocity.east": (_ground_velocity(1),),
    "velocity.down": (_down_by_height,),
    "position.north": (_position_by_velocity(0),),
    "position.east": (_position_by_velocity(1),),
    "position.down": (_height_by_others("position.down"),),
    **{name: (_height_by_others(name),) for name in _HEIGHTS},
}


def unit_of_slope(slope: float, correlation: float, signal: str, tolerance: float) -> str:
    """The unit whose factor the slope [SI per unit] allows; "" where none does, or another is not far enough from it.

    What is not explained may belong to either side: the slope is between slope * correlation and slope / correlation.
    """
    units = _CLIMB if signal == "velocity.down" else CANDIDATES[UNITS[signal]]
    width = tolerance - np.log(max(abs(correlation), 0.05))
    away = {unit: abs(np.log(abs(slope) / conversion(unit, UNITS[signal]).factor)) for unit in units}
    near = [unit for unit in units if away[unit] < 2.0 * width]
    return near[0] if len(near) == 1 and away[near[0]] < width else ""


def is_of_size(slope: float, column: Column, tolerance: float) -> bool:
    """Whether a slope [SI per unit] is that of the unit of a column, to within exp(tolerance)."""
    return bool(abs(np.log(abs(slope) / column.factor)) < tolerance)


Slopes = dict[str, tuple[float, float]]


def _joint(f: Flight, target: Array, parts: dict[str, Array], free: list[Array] | None = None) -> Slopes:
    """Slopes and t-values of columns that together make up a target; nothing where they do not."""
    if not parts:
        return {}
    result = regress(np.where(f.flying(), target, np.nan), list(parts.values()), free or [], f.block())
    if result is None or result[2] > _LEFT_OVER:
        return {}
    return {name: (float(k), float(t)) for name, k, t in zip(parts, result[0], result[1], strict=True)}


def _clearest(law: Callable[[float], Slopes], scales: tuple[float, ...]) -> Slopes:
    """Of a law looked at with several smoothing times [s], for each signal the slope with the largest t-value.

    Nothing of a signal whose slope changes its sign from one of them to another: something else is in it.
    """
    found = [law(seconds) for seconds in scales]
    best: Slopes = {}
    for signal in {signal: None for slopes in found for signal in slopes}:
        told = [slopes[signal] for slopes in found if signal in slopes]
        clearest = max(told, key=lambda slope: abs(slope[1]))
        if all(slope * clearest[0] > 0.0 or abs(t) < _NOISE_T for slope, t in told):
            best[signal] = clearest
    return best


def _in_whole(f: Flight, found: Slopes, large: tuple[str, ...]) -> Slopes:
    """Slopes of a law, only those of its large terms where these do not come out as large as they are.

    A term that is lost in its noise leaves what it should explain to the others, with any sign.
    """
    if all(_is_seen(f.columns[signal], *found[signal]) for signal in large if signal in found):
        return found
    return {signal: slope for signal, slope in found.items() if signal in large}


def _is_seen(column: Column, slope: float, t: float) -> bool:
    """Whether a slope is beyond noise and one that its column can have."""
    if abs(t) < SURE_T or slope * column.sign < 0.0:
        return False
    return is_of_size(slope, column, 0.4) if column.unit else bool(unit_of_slope(slope, 1.0, column.signal, 0.4))


def longitudinal(f: Flight) -> Slopes:
    """f_x = dV/dt + g theta: slopes of the numbers of an airspeed, and of pitch (per g), for a_x as it reads.

    a_x is taken as it reads, but for its unit: where it counts backwards, the airspeed comes out negative. The speed
    over ground ("speed") stands in for an airspeed that is not there, the integral of q ("gravity") for pitch.
    """
    return _clearest(lambda seconds: _longitudinal(f, seconds), (0.7, 1.5, 3.0))


def _longitudinal(f: Flight, seconds: float) -> Slopes:
    force = f.columns.get("specific_force.x")
    if force is None or not force.unit:
        return {}
    speed = next((s for s in _SPEEDS if f.has(s)), "")
    forward = f.speed()
    if speed:
        rate = f.raw_rate(speed, seconds)
    elif forward is not None:
        rate = f.grid.rate(forward, seconds)
    else:
        return {}
    parts = {speed or "speed": rate}
    target = f.smooth(f.raw("specific_force.x") * force.factor, seconds)
    if forward is not None and f.known("angular_velocity.y", "angle_of_attack"):
        turning = f.si("angular_velocity.y") * forward * np.sin(f.si("angle_of_attack"))
        parts["turning"] = f.smooth(turning, seconds)
    if f.has("attitude.pitch"):
        return _joint(f, target, {**parts, "attitude.pitch": G * f.smooth(f.raw("attitude.pitch"), seconds)})
    if not f.known("angular_velocity.y"):
        return {}
    parts["gravity"] = G * f.smooth(f.grid.integral(f.si("angular_velocity.y")), seconds)
    return _joint(f, f.grid.changes(target), {name: f.grid.changes(part) for name, part in parts.items()})


def climb_of_pitch(f: Flight, height: str) -> Fit | None:
    """V sin(theta) against the rate of a height's own numbers; pitch in SI but for its sign, with trim taken out."""
    speed, pitch = f.speed(), f.columns.get("attitude.pitch")
    if speed is None or pitch is None or not pitch.unit or not f.has(height):
        return None
    theta = pitch.factor * f.raw("attitude.pitch")
    reference = np.where(f.flying(), speed * np.sin(theta - np.nanmedian(theta)), np.nan)
    return f.fit(f.smooth(reference, 2.0), f.raw_rate(height, 2.0))


def _turning(f: Flight, axis: int) -> Array | None:
    """p, q or r [rad/s] of the gyro, or of the attitude in its place."""
    signal = f"angular_velocity.{'xyz'[axis]}"
    if f.known(signal):
        return f.si(signal)
    rates = None if f.has(signal) else _body_rates(f)
    return None if rates is None else rates[axis]


def vertical(f: Flight) -> Slopes:
    """(f_z + g cos(theta) cos(phi)) / V = d alpha/dt - q, of which d alpha/dt alone tells nothing: q goes with it."""
    return _clearest(lambda seconds: _vertical(f, seconds), (0.25, 0.8))


def _vertical(f: Flight, seconds: float) -> Slopes:
    speed = f.pace()
    if speed is None or not f.known("specific_force.z"):
        return {}
    with np.errstate(all="ignore"):
        target = f.smooth((f.si("specific_force.z") + G * _cosines(f)) / speed, seconds)
    parts = {}
    if f.has("angular_velocity.y"):
        parts["angular_velocity.y"] = -f.smooth(f.raw("angular_velocity.y"), seconds)
    elif (turning := _turning(f, 1)) is not None:
        target = target + f.smooth(turning, seconds)
    else:
        return {}
    if f.has("angle_of_attack"):
        parts["angle_of_attack"] = f.raw_rate("angle_of_attack", seconds)
    return _in_whole(f, _joint(f, target, parts), ("angular_velocity.y",))


def lateral(f: Flight) -> Slopes:
    """g cos(theta) sin(phi) / V = d beta/dt + r cos(alpha) - p sin(alpha) - f_y / V.

    Without a bank angle its changes are those of the integral of p. All of it must be there: in a slip d beta/dt
    and r are opposite and much larger than f_y / V, so that what is left without one of them tells no sign.
    """
    return _clearest(lambda seconds: _lateral(f, seconds), (0.25, 0.8, 2.0))


def _lateral(f: Flight, seconds: float) -> Slopes:
    speed = f.pace()
    by_roll = f.known("attitude.roll")
    if speed is None or not (by_roll or f.known("angular_velocity.x")) or not f.has("sideslip"):
        return {}
    changes = (lambda values: values) if by_roll else f.grid.changes
    theta = f.si("attitude.pitch") if f.known("attitude.pitch") else np.zeros(len(f.grid.time))
    alpha = f.si("angle_of_attack") if f.known("angle_of_attack") else f.smooth(theta, 5.0)
    rolling = f.si("angular_velocity.x") if f.known("angular_velocity.x") else f.rate("attitude.roll", 0.0)
    with np.errstate(all="ignore"):
        roll = np.sin(f.si("attitude.roll")) if by_roll else changes(f.grid.integral(rolling))
        target = f.smooth(G * np.cos(theta) * roll / speed + rolling * np.sin(alpha), seconds)
        slip = f.raw_rate("sideslip", seconds)
        parts = {"sideslip": slip}
        if f.has("angular_velocity.z"):
            parts["angular_velocity.z"] = f.smooth(f.raw("angular_velocity.z") * np.cos(alpha), seconds)
        elif (turning := _turning(f, 2)) is not None:
            target = target - f.smooth(turning * np.cos(alpha), seconds)
        else:
            return {}
        if f.has("specific_force.y"):
            parts["specific_force.y"] = -f.smooth(f.raw("specific_force.y") / speed, seconds)
    # A bank and a vane that come late, and an angle of attack that is not the one of the flow.
    late = [changes(f.smooth(rolling, seconds)), changes(np.gradient(slip, f.grid.step))]
    found = _joint(f, changes(target), {name: changes(part) for name, part in parts.items()}, late)
    return _in_whole(f, found, ("sideslip", "angular_velocity.z"))


def side_force(f: Flight) -> Slopes:
    """f_y = y axis of the acceleration over ground less gravity."""
    return _clearest(lambda seconds: _side_force(f, seconds), (0.8, 2.0, 4.0))


def _side_force(f: Flight, seconds: float) -> Slopes:
    angles = ("attitude.roll", "attitude.pitch", "attitude.yaw")
    if not f.has("specific_force.y") or not f.known("velocity.north", "velocity.east", *angles):
        return {}
    phi, theta, psi = (f.si(angle) for angle in angles)
    climb = _climb(f)
    down = -f.grid.rate(climb[1], seconds) if climb is not None else np.zeros(len(phi))
    north, east = (f.rate(f"velocity.{way}", seconds) for way in ("north", "east"))
    across = f.smooth(np.sin(phi) * np.sin(theta) * np.cos(psi) - np.cos(phi) * np.sin(psi), seconds)
    along = f.smooth(np.sin(phi) * np.sin(theta) * np.sin(psi) + np.cos(phi) * np.cos(psi), seconds)
    level = f.smooth(np.sin(phi) * np.cos(theta), seconds)
    target = north * across + east * along + (down - G) * level
    late = [f.rate("attitude.roll", seconds)]
    return _joint(f, target, {"specific_force.y": f.smooth(f.raw("specific_force.y"), seconds)}, late)


def wind_triangle(f: Flight, signal: str) -> tuple[float, float] | None:
    """Slope [m/s per unit] of an airspeed whose vector and a steady wind give the velocity over ground; correlation."""
    if not f.known("velocity.north", "velocity.east", "attitude.yaw"):
        return None
    raw, yaw = f.raw(signal), f.si("attitude.yaw")
    if f.known("sideslip"):
        yaw = yaw + f.si("sideslip")
    climb = _climb(f)
    level = np.ones(len(raw))
    if climb is not None:
        speed = np.hypot(f.si("velocity.north"), f.si("velocity.east"))
        with np.errstate(all="ignore"):
            level = np.cos(np.arctan(climb[1] / speed))
    flying = f.flying()
    north = np.where(flying, f.smooth(f.si("velocity.north"), _SLOW_SECONDS), np.nan)
    east = np.where(flying, f.smooth(f.si("velocity.east"), _SLOW_SECONDS), np.nan)
    along = [f.smooth(raw * level * trigonometric(yaw), _SLOW_SECONDS) for trigonometric in (np.cos, np.sin)]
    ones, zeros = np.ones(len(raw)), np.zeros(len(raw))
    matrix = np.stack([np.concatenate(along), np.concatenate([ones, zeros]), np.concatenate([zeros, ones])], axis=1)
    target = np.concatenate([north, east])
    known = np.isfinite(target) & np.isfinite(matrix).all(axis=1)
    if known.sum() < 100 or np.std(np.cos(yaw[np.isfinite(yaw)])) + np.std(np.sin(yaw[np.isfinite(yaw)])) < 0.5:
        return None
    solution, *_ = np.linalg.lstsq(matrix[known], target[known], rcond=None)
    residual = target[known] - matrix[known] @ solution
    return float(solution[0]), float(np.sqrt(max(0.0, 1.0 - np.var(residual) / np.var(target[known]))))


def acceleration_along(f: Flight, signal: str) -> Fit | None:
    """dV/dt = f_x cos(alpha) + f_z sin(alpha) - g sin(theta - alpha) against the rate of an airspeed."""
    if not f.known("specific_force.x", "specific_force.z", "attitude.pitch"):
        return None
    alpha = f.si("angle_of_attack") if f.known("angle_of_attack") else np.zeros(len(f.grid.time))
    theta = f.si("attitude.pitch")
    reference = (
        f.si("specific_force.x") * np.cos(alpha) + f.si("specific_force.z") * np.sin(alpha) - G * np.sin(theta - alpha)
    )
    return fit(f.smooth(reference, 0.5), f.raw_rate(signal, 0.5), f.block())


def speed_of_pressure(f: Flight, signal: str) -> Fit | None:
    """sqrt(2 q / rho) against an airspeed's own numbers."""
    if not f.known("dynamic_pressure"):
        return None
    density = f.si("air_density") if f.known("air_density") else standard_density(f)
    if density is None:
        return None
    reference = np.sqrt(2.0 * np.maximum(f.si("dynamic_pressure"), 0.0) / density)
    return f.fit(f.smooth(reference, 0.5), f.smooth(f.raw(signal), 0.5))


def speed_and_pressure(f: Flight, speed: str) -> tuple[str, str] | None:
    """Units of an airspeed and of a dynamic pressure, neither of which is known, from q = rho V^2 / 2."""
    density = float(np.nanmedian(f.si("air_density"))) if f.known("air_density") else standard_density(f)
    if density is None or not f.has("dynamic_pressure"):
        return None
    flying = np.nan_to_num(f.raw(speed)) > 0.35 * np.nanpercentile(f.raw(speed), 90)
    with np.errstate(all="ignore"):
        ratio = float(np.nanmedian((f.raw("dynamic_pressure") / f.raw(speed) ** 2)[flying]))
    if not ratio > 0.0:
        return None
    rough, fast = f.columns[speed].rough, float(np.nanpercentile(f.raw(speed), 90))
    found = []
    for unit in CANDIDATES["m/s"][:4]:
        factor = conversion(unit, "m/s").factor
        if not 5.0 < fast * factor < 340.0 or (np.isfinite(rough) and abs(np.log(factor / rough)) > 1.0):
            continue
        for of_pressure in CANDIDATES["Pa"]:
            expected = 0.5 * density * factor**2 / conversion(of_pressure, "Pa").factor
            if abs(np.log(ratio / expected)) < 0.12:
                found.append((abs(float(np.log(ratio / expected))), unit, of_pressure))
    return (found[0][1], found[0][2]) if len(found) == 1 and found[0][0] < 0.06 else None


def turn_speed(f: Flight, signal: str) -> float | None:
    """Slope [m/s per unit] of an airspeed from V = g tan(phi) / (dpsi/dt) in turns."""
    if not f.known("attitude.roll", "attitude.yaw"):
        return None
    rate = f.rate("attitude.yaw", 2.0)
    roll = f.smooth(f.si("attitude.roll"), 2.0)
    turning = (np.abs(rate) > 0.08) & (np.abs(roll) > 0.15) & (np.abs(roll) < 1.1) & np.isfinite(f.raw(signal))
    turning &= np.nan_to_num(np.abs(f.grid.rate(f.si("attitude.roll"), 2.0)), nan=9.0) < 0.1
    if turning.sum() < 100:
        return None
    return float(np.median(G * np.tan(roll[turning]) / rate[turning] / f.raw(signal)[turning]))


def control_sign(f: Flight, signal: str) -> Slopes:
    """Angular acceleration per deflection, by its signal."""
    return _clearest(lambda seconds: _control(f, signal, seconds), (0.12, 0.3, 0.6))


def _control(f: Flight, signal: str, seconds: float) -> Slopes:
    axis, others = {
        "aileron": (0, ("sideslip", "specific_force.y", "rudder")),
        "elevator": (1, ("angle_of_attack", "specific_force.z")),
        "rudder": (2, ("sideslip", "specific_force.y", "aileron")),
    }[signal]
    rate = _turning(f, axis)
    if rate is None:
        return {}
    reference = np.where(f.flying(), f.grid.rate(rate, seconds), np.nan)
    columns = [f.smooth(f.raw(signal), seconds), f.smooth(rate, seconds)]
    columns += [f.smooth(f.raw(other), seconds) for other in others if f.has(other)]
    beside = _turning(f, 2 - axis) if axis != 1 else None
    columns += [f.smooth(beside, seconds)] if beside is not None else []
    result = regress(reference, columns, [], f.block(_ANSWER))
    return {} if result is None else {signal: (float(result[0][0]), float(result[1][0]))}


def temperature_of_density(f: Flight) -> float | None:
    """Temperature [K] of the gas law."""
    if not f.known("static_pressure", "air_density"):
        return None
    return float(np.nanmedian(f.si("static_pressure")) / (GAS_CONSTANT * np.nanmedian(f.si("air_density"))))


def standard_temperature(f: Flight) -> float | None:
    """Standard temperature [K] at the height of the flight."""
    if f.known("static_pressure"):
        return float(temperature_at(np.nanmedian(f.si("static_pressure"))))
    for signal in ("pressure_altitude", "altitude"):
        if f.known(signal):
            return float(288.15 - 0.0065 * np.nanmedian(f.si(signal)))
    return None


def standard_density(f: Flight) -> float | None:
    """Density [kg/m^3] of the pressure, if it is known."""
    if f.known("static_pressure"):
        pressure = float(np.nanmedian(f.si("static_pressure")))
        return pressure / (GAS_CONSTANT * float(temperature_at(pressure)))
    return None


good, fair = _GOOD, _FAIR
