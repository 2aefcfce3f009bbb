"""What magnitudes alone show of the units of columns, and of what they cannot be."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.aircraft.atmosphere import altitude_at
from aircraft_sysid_ros.recordings.tabular.guess.flight_columns import FASTEST, SLOWEST, Flight, G
from aircraft_sysid_ros.recordings.tabular.guess.laws_of_one import CANDIDATES
from aircraft_sysid_ros.recordings.tabular.guess.names import is_time_step
from aircraft_sysid_ros.recordings.tabular.guess.series import SPEEDS, Array, Column
from aircraft_sysid_ros.recordings.tabular.signals import VECTORS
from aircraft_sysid_ros.recordings.tabular.units import conversion
from aircraft_sysid_ros.samples import share_below_zero

AXES, RATES, ATTITUDE = VECTORS["specific_force"], VECTORS["angular_velocity"], VECTORS["attitude"]
SURFACES = ("elevator", "aileron", "rudder", "flaps")
_NO_ANGLE = 400.0
_MOST_POSITIONS = 5  # of a lever for flaps
_AIR = (10_000.0, 106_000.0)  # [Pa] from 16 km down to below the sea
_BELOW_5500_M, _BELOW_2000_M = 50_000.0, 80_000.0  # [Pa]


def by_values(flight: Flight) -> None:
    """What magnitudes alone show."""
    for column in flight.columns.values():
        if not len(column.numbers):
            column.doubt = "it holds no numbers"
    _no_airspeeds(flight)
    _gravity(flight)
    for signal in ("latitude", "longitude"):
        if flight.has(signal):
            _place(flight.columns[signal])
    _same_place(flight)
    _place_in_radians(flight)
    if flight.has("static_pressure"):
        _pressure(flight)
    density = flight.columns.get("air_density")
    if density is not None and not density.unit:
        median = float(np.median(density.numbers))
        if 0.3 < median < 1.5 or 0.0006 < median < 0.0029:
            density.take_unit("kg/m^3" if median > 0.1 else "slug/ft^3", f"it is {median:.3g}")
    if flight.has("throttle"):
        _throttle(flight.columns["throttle"])
    if flight.has("flaps"):
        _flaps(flight.columns["flaps"])
    for signals in (ATTITUDE, ("angle_of_attack", "sideslip"), SURFACES):
        _degrees(flight, signals)
    _degrees_per_second(flight)


def _no_airspeeds(flight: Flight) -> None:
    """A column that is below zero is a component of the velocity, whatever its name."""
    for signal in SPEEDS:
        column = flight.columns.get(signal)
        if column is not None and share_below_zero(column.numbers) > 0.0:
            column.doubt = "it is below zero in part: a component of the velocity?"
            column.unit = ""


def reads_gravity(column: Column) -> bool:
    """Whether a column reads 1 g in trim, in the unit that is said or in any that it may have."""
    units = [column.said_unit] if column.said_unit else CANDIDATES["m/s^2"]
    size = abs(float(np.median(column.numbers))) if len(column.numbers) else 0.0
    return any(_is_gravity(size * conversion(unit, "m/s^2").factor) for unit in units)


def _is_gravity(size: float) -> bool:
    """Whether an acceleration [m/s^2] is that of trim, in turns and climbs too, by an accelerometer out of tune."""
    return 0.6 < size / G < 1.6


def _gravity(flight: Flight) -> None:
    """Specific force at rest or in trim is 1 g, against z."""
    there = [signal for signal in AXES if flight.has(signal) and len(flight.columns[signal].numbers)]
    if not flight.has("specific_force.z") or "specific_force.z" not in there:
        return
    down = flight.columns["specific_force.z"]
    median = float(np.median(down.numbers))
    size = abs(median)
    fitting = [unit for unit in CANDIDATES["m/s^2"] if 0.8 < size * conversion(unit, "m/s^2").factor / G < 1.45]
    for signal in there:
        column = flight.columns[signal]
        if not column.unit and fitting and not down.said_unit:
            column.take_unit(fitting[0], f"a_z reads {median:.3g} in trim, which is gravity")
        elif not column.unit and down.said_unit:
            column.take_unit(down.said_unit, f"as {down.name}")
    if down.unit and _is_gravity(size * down.factor):
        down.take_sign(
            -float(np.sign(median)), f"it reads {median:.3g} {down.unit} in trim, and gravity is {-G:.3g} m/s^2"
        )
    else:
        for signal in there:
            column = flight.columns[signal]
            column.doubt = f"{down.name} reads {median:.3g} in trim, which is not gravity: an acceleration without it?"
            column.unit = ""


def _place(column: Column) -> None:
    if column.unit or column.doubt:
        return
    most = float(np.max(np.abs(column.numbers)))
    limit = 90.0 if column.signal == "latitude" else 180.0
    if 1e6 < most < limit * 1.0001e7:
        column.take_unit("1e-7 deg", f"it is {most:.6g}")
    elif np.pi * (0.5 if limit < 100 else 1.0) < most <= limit:
        column.take_unit("deg", f"it is {most:.5g}")


def _same_place(flight: Flight) -> None:
    """Latitude and longitude of one table have one unit: near 0 degrees are as small as radians."""
    if not flight.has("latitude", "longitude"):
        return
    pair = [flight.columns[signal] for signal in ("latitude", "longitude")]
    for column, other in (pair, pair[::-1]):
        if other.unit and column.table == other.table and not column.doubt:
            column.take_unit(other.unit, f"as {other.name}")


def _place_in_radians(flight: Flight) -> None:
    """Small numbers of latitude and longitude: in radians the aeroplane would fly, or in degrees it would."""
    pair = [flight.columns.get("latitude"), flight.columns.get("longitude")]
    if any(column is None or column.unit or column.doubt for column in pair):
        return
    north, east = (flight.grid.rate(flight.raw(column.signal), 2.0) for column in pair if column is not None)
    east = east * np.cos(np.nanmedian(flight.raw("latitude")))
    speeds = 6.371e6 * np.hypot(north, east)
    if not np.isfinite(speeds).any():
        return
    speed = float(np.nanpercentile(speeds, 75))
    for unit, factor in (("rad", 1.0), ("deg", np.pi / 180.0)):
        if SLOWEST < speed * factor < FASTEST:
            for column in pair:
                if column is not None:
                    column.take_unit(unit, f"the aeroplane then moves at {speed * factor:.3g} m/s")
            return


def _pressure(flight: Flight) -> None:
    """The unit that alone is a pressure of the air, or that alone fits to the altitude, be it in metres or in feet."""
    column = flight.columns["static_pressure"]
    if column.unit or column.doubt:
        return
    median = float(np.median(column.numbers))
    fitting = {u: median * conversion(u, "Pa").factor for u in CANDIDATES["Pa"]}
    fitting = {unit: pascals for unit, pascals in fitting.items() if _AIR[0] < pascals < _AIR[1]}
    if len(fitting) == 1:
        column.take_unit(next(iter(fitting)), f"it is {median:.4g}, and with another no pressure of the air")
        return
    heights = _possible_heights(flight)
    agreeing = [
        unit
        for unit, pascals in fitting.items()
        if any(abs(height - float(altitude_at(pascals))) < 300.0 + 0.1 * abs(height) for height in heights)
    ]
    if len(agreeing) == 1:
        column.take_unit(agreeing[0], f"it is {median:.4g}, and fits to the altitude")
    low = [unit for unit, pascals in fitting.items() if pascals > _BELOW_5500_M]
    if not heights and len(low) == 1 and fitting[low[0]] > _BELOW_2000_M:
        column.take_unit(low[0], f"it is {median:.4g}, the air below 2000 m")
        column.sure = False


def _possible_heights(flight: Flight) -> list[float]:
    """Medians [m] of the altitudes, in metres and in feet where their unit is not known."""
    return [
        float(np.median(column.numbers)) * factor
        for signal in ("altitude", "pressure_altitude")
        if (column := flight.columns.get(signal)) is not None and len(column.numbers)
        for factor in ([column.factor] if column.unit else [1.0, conversion("ft", "m").factor])
    ]


def _throttle(column: Column) -> None:
    if column.unit or column.doubt:
        return
    low, median, high = np.percentile(column.numbers, (5, 50, 95))
    most = float(np.max(column.numbers))
    if is_time_step(column.name) and (most < 0.2 or high - low < 0.2 * median):
        column.doubt = "it may be the time from row to row"
    elif 0.0 < most <= 1.1 or 3.0 < most <= 110.0:
        column.take_unit("1" if most <= 1.1 else "%", f"it goes up to {most:.3g}")


def _flaps(column: Column) -> None:
    """A few whole numbers without a unit are degrees, or the number of a position."""
    if column.unit or column.doubt:
        return
    levels = np.unique(column.numbers)
    if len(levels) <= _MOST_POSITIONS and bool(np.all(levels == np.round(levels))):
        column.doubt = "it may be the positions of a lever, and no angle"


def _degrees(flight: Flight, signals: tuple[str, ...]) -> None:
    """Angles that no radians reach; the others of the same kind are then likely to be degrees, too."""
    limits = {"attitude.yaw": 6.4, "attitude.roll": 3.2, "attitude.pitch": 1.6, "angle_of_attack": 1.6, "sideslip": 1.6}
    for signal in signals:
        if not flight.has(signal) or flight.columns[signal].doubt:
            continue
        column = flight.columns[signal]
        most = float(np.percentile(np.abs(column.numbers), 99.9))
        if signal == "attitude.yaw" and most > limits[signal] and _counts_turns(column):
            continue  # laws tell its unit
        whole = 361.0 if signal == "attitude.yaw" else 181.0 if signal == "attitude.roll" else 95.0
        if limits.get(signal, 1.75) < most <= whole:
            column.take_unit("deg", f"it goes up to {most:.3g}, too far for radians")
        else:
            column.doubt = why_no_angle(column.numbers)


def why_no_angle(numbers: Array) -> str:
    """That numbers (m,) go further than angles do in any unit; empty: they do not."""
    most = float(np.percentile(np.abs(numbers), 99.9)) if len(numbers) else 0.0
    return f"it goes up to {most:.3g}, which is not an angle" if most > _NO_ANGLE else ""


#: Most [rad] that a heading which counts its turns is taken to go: nine turns.
_NINE_TURNS = 60.0


def _counts_turns(yaw: Column) -> bool:
    """Whether a heading goes on through north, in degrees or in radians: it goes beyond a turn, and never jumps."""
    values = yaw.numbers
    spread, most = float(np.ptp(values)), float(np.max(np.abs(values)))
    turn = 361.0 if spread > 361.0 else 6.4
    goes_beyond = spread > turn and (turn > 6.4 or most < _NINE_TURNS)
    return goes_beyond and bool(np.max(np.abs(np.diff(values))) < 0.25 * turn)


def _degrees_per_second(flight: Flight) -> None:
    there = [flight.columns[signal] for signal in RATES if flight.has(signal) and len(flight.columns[signal].numbers)]
    most = max((float(np.percentile(np.abs(column.numbers), 99.0)) for column in there), default=0.0)
    in_thousandths = any(flight.has(signal) and flight.columns[signal].unit == "mg" for signal in AXES)
    if most > 15.0 and not in_thousandths:  # else mrad/s, or deg/s all the same: laws tell
        for column in there:
            column.take_unit("deg/s", f"the rates go up to {most:.3g}, too fast for rad/s")
