"""Unit and sign of every named column: what values alone show, then law after law, as each makes others usable."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np

from aircraft_sysid_ros.recordings.tabular.guess import laws_of_air, laws_of_several
from aircraft_sysid_ros.recordings.tabular.guess.flight_columns import FAIR, GOOD, SLOWEST, SURE_T, Flight, metres_along
from aircraft_sysid_ros.recordings.tabular.guess.laws_of_one import (
    CANDIDATES,
    is_of_size,
    references,
    track_of,
    unit_of_slope,
)
from aircraft_sysid_ros.recordings.tabular.guess.magnitudes import ATTITUDE, RATES, SURFACES, by_values
from aircraft_sysid_ros.recordings.tabular.guess.series import POSITIVE, SPEEDS, Column, Fit
from aircraft_sysid_ros.recordings.tabular.units import conversion

#: Axes whose sign is everywhere the same, to fall back to where no law speaks: first those that then tell others.
_CUSTOM = (
    "velocity.north", "velocity.east", "velocity.down", "position.north", "position.east", "attitude.roll",
    "specific_force.x", "angular_velocity.x",
)  # fmt: skip
#: Laws of several columns, from which slopes are taken that are those of the columns' units.
_JOINT = (
    (laws_of_several.vertical, "a_z turns the path: the kinematics of angle of attack and pitch rate"),
    (laws_of_several.side_force, "the acceleration over ground and gravity"),
    (laws_of_several.lateral, "the kinematics of sideslip, yaw rate, bank and a_y"),
)
_PASSES = 6
#: A course and that of the position: compared over [s], where it turns by less [rad/s], in so much of the flight [s].
_COURSE_SECONDS, _STRAIGHT, _LEAST_STRAIGHT = 3.0, np.radians(3.0), 10.0
_DECLINATION = 3.0  # [deg], from which on a course is taken to be magnetic
_CERTAIN = 0.9  # correlation of a law that is right about a unit
_SIZE = 0.7  # logarithm of what a slope may be off where a sign is taken from it


def resolve(columns: dict[str, Column]) -> Flight:
    """Find unit and sign of columns (by signal) in place; what cannot be told is left without."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)  # of columns that are empty where another is not
        return _resolved(columns)


def _resolved(columns: dict[str, Column]) -> Flight:
    turns = _turns(columns)
    for column in columns.values():
        _take_said(column)
    flight = Flight(columns, turns)
    by_values(flight)
    _by_all_laws(flight)
    _speed_and_pressure(flight)
    _likely_units(flight)
    _by_all_laws(flight)
    while _take_custom(flight):
        _by_all_laws(flight)
    _check_signs(flight)
    _check_course(flight)
    _controls(flight)
    _air(flight)
    _check_said(flight)
    _explain_open(flight)
    return flight


def _by_all_laws(flight: Flight) -> None:
    """Law after law, until no column is told by them any more."""
    for _ in range(_PASSES):
        before = sum(column.is_known for column in flight.columns.values())
        _by_laws(flight)
        _yaw_offset(flight)
        _speeds(flight)
        _joint_laws(flight)
        _climb_of_pitch(flight)
        if sum(column.is_known for column in flight.columns.values()) == before:
            break


def _turns(columns: dict[str, Column]) -> dict[str, float]:
    """A whole turn in the numbers of angles that jump."""
    turns: dict[str, float] = {}
    for signal in ("attitude.yaw", "attitude.roll"):
        if signal in columns:
            values = columns[signal].values
            span = np.nanmax(np.abs(values)) if np.isfinite(values).any() else 0.0
            said = columns[signal].said_unit
            in_degrees = span > 6.5 or (bool(said) and conversion(said, "rad").factor < 1.0)
            turns[signal] = 360.0 if in_degrees else 2.0 * np.pi
    return turns


def _take_said(column: Column) -> None:
    if column.said_unit:
        column.take_unit(column.said_unit, "said by the header or the name")
    if column.signal in POSITIVE and column.unit:
        column.sign = 1.0


def _by_laws(flight: Flight) -> None:
    for signal, column in flight.columns.items():
        if column.is_known or column.doubt:
            continue
        for law, found, tolerance in _followed(flight, signal):
            told = f"{law} follows it, correlation {found.correlation:.2f}, t = {abs(found.t):.0f}"
            if not column.unit:
                column.take_unit(unit_of_slope(found.slope, found.correlation, signal, tolerance), told)
            if column.unit and np.isfinite(tolerance) and not is_of_size(found.slope, column, tolerance + 0.5):
                _other_unit(column, found, tolerance, told)
                continue
            column.take_sign(found.sign, told)
            column.sure = column.sure and abs(found.correlation) > GOOD
            if column.is_known:
                break


def _other_unit(column: Column, found: Fit, tolerance: float, told: str) -> None:
    """The unit that a law gives a column for sure, in place of one that was only likely by its numbers."""
    if column.said_unit or abs(found.correlation) < _CERTAIN:
        return
    unit = unit_of_slope(found.slope, found.correlation, column.signal, tolerance)
    if unit:
        column.unit, column.evidence = "", []
        column.take_unit(unit, told)
        column.take_sign(found.sign, told)


def _followed(flight: Flight, signal: str) -> Iterator[tuple[str, Fit, float]]:
    """Laws of a signal that its column obeys beyond what chance does, and the tolerance of the slope."""
    for law, reference, raw, tolerance in references(flight, signal):
        found = flight.fit(reference, raw)
        least = GOOD if law.startswith("gravity") else FAIR  # thrust and drag are in it, too
        if found is not None and abs(found.correlation) >= least and abs(found.t) > SURE_T:
            yield law, found, tolerance


def _yaw_offset(flight: Flight) -> None:
    """A heading that is counted from the east, to the left."""
    track = track_of(flight)
    if track is None or not flight.known("attitude.yaw"):
        return
    column = flight.columns["attitude.yaw"]
    differences = np.exp(1j * (track - column.si(flight.raw("attitude.yaw"))))
    mean = np.nanmean(np.where(flight.flying(), differences, np.nan))
    quarter = round(float(np.angle(mean)) / (0.5 * np.pi))
    if quarter and abs(mean) > 0.5:
        column.offset += quarter * column.sign * 0.5 * np.pi / column.factor
        column.evidence.append(f"counted from another direction: the course over ground is {90 * quarter} deg off")


def _speeds(flight: Flight) -> None:
    for signal in SPEEDS:
        column = flight.columns.get(signal)
        if column is None or column.unit or column.doubt:
            continue
        stretch = 1.0
        density = laws_of_air.standard_density(flight)
        if signal != "true_airspeed" and density is not None:
            stretch = float(np.sqrt(1.225 / density))
        loose = 0.0 if signal == "true_airspeed" or density is not None else 0.1
        triangle = laws_of_air.wind_triangle(flight, signal)
        if triangle is not None and triangle[1] > 0.9:
            told = f"with a steady wind it gives the velocity over ground, correlation {triangle[1]:.2f}"
            column.take_unit(unit_of_slope(triangle[0] / stretch, 1.0, signal, 0.045 + loose), told)
        pressure = laws_of_air.speed_of_pressure(flight, signal) if not column.unit else None
        if pressure is not None and pressure.correlation > 0.9:
            told = f"the dynamic pressure follows it, correlation {pressure.correlation:.2f}"
            column.take_unit(unit_of_slope(pressure.slope / stretch, pressure.correlation, signal, 0.045 + loose), told)
        along = laws_of_air.acceleration_along(flight, signal) if not column.unit else None
        if along is not None and along.correlation > 0.9:
            told = f"the acceleration along the path follows it, correlation {along.correlation:.2f}"
            column.take_unit(unit_of_slope(along.slope / stretch, along.correlation, signal, 0.05 + loose), told)
        turn = laws_of_air.turn_speed(flight, signal) if not column.unit else None
        if turn is not None and turn > 0.0:
            column.take_unit(unit_of_slope(turn / stretch, 1.0, signal, 0.2), "bank and rate of turn give that speed")
            column.sure = False
            column.rough = turn


def _joint_laws(flight: Flight) -> None:
    """Laws in which several columns of unknown unit and sign make up something known."""
    _forward(flight)
    if any(not column.is_known and not column.doubt for column in flight.columns.values()):
        for law, told in _JOINT:
            for signal, (slope, t) in law(flight).items():
                _take_slope(flight, signal, slope, t, f"{told}, t = {abs(t):.0f}", 0.5)


def _forward(flight: Flight) -> None:
    """a_x, airspeed and pitch."""
    found = laws_of_several.longitudinal(flight)
    force = flight.columns.get("specific_force.x")
    if force is None or not found:
        return
    speed = next((signal for signal in found if signal in (*SPEEDS, "speed")), "")
    for signal, told in (
        (speed, "a_x is the acceleration along the path and gravity"),
        ("gravity", "a_x follows gravity"),
    ):
        slope, t = found.get(signal, (0.0, 0.0))
        column = flight.columns.get(signal)
        factor = 1.0 if column is None else column.factor  # NaN as long as its unit is not known
        if abs(t) > SURE_T and not abs(np.log(abs(slope) / factor)) > _SIZE:
            force.take_sign(float(np.sign(slope)), f"{told}, t = {abs(t):.0f}")
            if column is not None and not column.unit:
                column.rough = abs(slope)
    if force.is_known and "attitude.pitch" in found:
        slope, t = found["attitude.pitch"]
        _take_slope(flight, "attitude.pitch", slope * force.sign, t, f"gravity along the body, t = {abs(t):.0f}", 0.7)


def _climb_of_pitch(flight: Flight) -> None:
    """The unit of a height and the sign of pitch at once: heights count upwards."""
    for height in ("altitude", "pressure_altitude", "height_above_ground"):
        found = laws_of_several.climb_of_pitch(flight, height)
        if found is None or abs(found.correlation) < FAIR or abs(found.t) < SURE_T:
            continue
        told = f"V sin(theta) is the climb, correlation {found.correlation:.2f}"
        column, pitch = flight.columns[height], flight.columns["attitude.pitch"]
        if not column.unit and not column.doubt:
            column.take_unit(unit_of_slope(found.slope, found.correlation, height, 0.25), told)
        if not pitch.doubt:
            pitch.take_sign(found.sign, told)
            pitch.sure = False


def _take_slope(flight: Flight, signal: str, slope: float, t: float, told: str, tolerance: float) -> None:
    """Unit and sign of a column from its slope in a law, where that is sure."""
    column = flight.columns[signal]
    if column.is_known or column.doubt or abs(t) < SURE_T:
        return
    if not column.unit:
        column.take_unit(unit_of_slope(slope, 1.0, signal, tolerance), told)
    if column.unit and is_of_size(slope, column, max(tolerance, _SIZE)):
        column.take_sign(float(np.sign(slope)), told)


def _likely_units(flight: Flight) -> None:
    """Units of those whose relatives are known: a recorder has one for all angles of a kind."""
    for signals, small in (
        (("velocity.north", "velocity.east"), 1e9),
        (ATTITUDE, 0.06),
        (RATES, 0.02),
        (("angle_of_attack", "sideslip"), 0.01),
        (SURFACES, 0.005),
    ):
        there = [s for s in signals if flight.has(s) and not flight.columns[s].doubt]
        units = {flight.columns[s].unit for s in there if flight.columns[s].unit}
        open_ = [s for s in there if not flight.columns[s].unit]
        if not open_ or len(units) > 1:
            continue
        spread = max(float(np.std(flight.columns[s].numbers)) for s in there)
        if units:
            for s in open_:
                flight.columns[s].take_unit(
                    next(iter(units)),
                    f"as its relatives are ({', '.join(x for x in there if x not in open_)})",
                )
                flight.columns[s].sure = False
        elif small < spread < 0.7 and signals is not RATES:
            most = max(float(np.percentile(np.abs(flight.columns[s].numbers), 99.9)) for s in there)
            if signals is SURFACES and most > 0.9:
                continue
            for s in open_:
                flight.columns[s].take_unit(
                    "rad", f"it and its relatives stay below {most:.2g}, too little for degrees"
                )
                flight.columns[s].sure = False
        elif signals is RATES and small < spread < 0.5:
            for s in open_:
                flight.columns[s].take_unit(
                    "rad/s", f"it and its relatives spread by {spread:.2g}, too little for deg/s"
                )
                flight.columns[s].sure = False


def _take_custom(flight: Flight) -> bool:
    """What is everywhere counted the same way, for one column of which nothing says otherwise; False where none is."""
    for signal in (*_CUSTOM, "flaps"):
        column = flight.columns.get(signal)
        if column is None or column.doubt or column.sign or not column.unit or not column.custom:
            continue
        if signal == "flaps":
            values = column.numbers
            column.take_sign(-1.0 if np.mean(values) < -0.01 * (np.ptp(values) + 1e-9) else 1.0, "flaps go down")
        else:
            column.take_sign(column.custom, "by convention: nothing in the data shows it")
            column.sure = False
        return True
    return False


def _controls(flight: Flight) -> None:
    for signal in ("elevator", "aileron", "rudder"):
        column = flight.columns.get(signal)
        if column is None or column.doubt or column.sign:
            continue
        slope, t = laws_of_several.control_sign(flight, signal).get(signal, (0.0, 0.0))
        if abs(t) > SURE_T:
            moment = {"elevator": "pitching", "aileron": "rolling", "rudder": "yawing"}[signal]
            told = f"the {moment} moment follows it with t = {abs(t):.0f}; positive gives a negative one"
            column.take_sign(-float(np.sign(slope)), told)


def _speed_and_pressure(flight: Flight) -> None:
    """An airspeed and a dynamic pressure without units, of which only one pair fits."""
    pressure = flight.columns.get("dynamic_pressure")
    if pressure is None or pressure.unit or pressure.doubt:
        return
    speed = flight.columns.get("true_airspeed")
    if speed is None or speed.unit or speed.doubt:
        return
    found = laws_of_air.speed_and_pressure(flight, "true_airspeed")
    if found is not None:
        for column, unit in zip((speed, pressure), found, strict=True):
            column.take_unit(unit, f"only {found[0]} with {found[1]} fits to the density")


def _air(flight: Flight) -> None:
    """Dynamic pressure and temperature, which others explain."""
    column = flight.columns.get("dynamic_pressure")
    speed = flight.speed()
    if (
        column is not None
        and not column.unit
        and not column.doubt
        and speed is not None
        and flight.known("true_airspeed")
    ):
        density = (
            flight.si("air_density") if flight.known("air_density") else laws_of_air.standard_density(flight) or 1.15
        )
        found = flight.fit(0.5 * density * speed**2, flight.raw("dynamic_pressure"))
        if found is not None and found.correlation > GOOD:
            column.take_unit(
                unit_of_slope(found.slope, found.correlation, "dynamic_pressure", 0.15), "airspeed and density"
            )
    column = flight.columns.get("air_temperature")
    if column is not None and not column.unit and not column.doubt:
        median = float(np.median(flight.columns["air_temperature"].numbers))
        by_law = laws_of_air.temperature_of_density(flight)
        expected = by_law or laws_of_air.standard_temperature(flight) or 285.0
        fitting = []
        for unit in CANDIDATES["K"]:
            convert = conversion(unit, "K")
            if abs(median * convert.factor + convert.shift - expected) < (8.0 if by_law else 32.0):
                fitting.append(unit)
        if len(fitting) == 1:
            told = "density and pressure give" if by_law else "the standard atmosphere has"
            column.take_unit(fitting[0], f"it is {median:.3g}, and {told} {expected:.0f} K")


def _check_said(flight: Flight) -> None:
    """That a unit of the header is the one that the physics has."""
    for signal, column in flight.columns.items():
        if not column.is_known or not column.said_unit:
            continue
        for law, reference, raw, tolerance in references(flight, signal):
            found = flight.fit(reference, raw)
            if found is None or abs(found.correlation) < _CERTAIN or not np.isfinite(tolerance):
                continue
            if not is_of_size(found.slope, column, tolerance + 0.5):
                unit = unit_of_slope(found.slope, found.correlation, signal, tolerance)
                column.doubt = f"its header says {column.said_unit}, but {law} says {unit or 'another unit'}"
            break


def _check_course(flight: Flight) -> None:
    """That a course over ground counts from true north, by that of the position where the aeroplane flies straight."""
    north, east = (flight.columns.get(f"velocity.{way}") for way in ("north", "east"))
    along = [metres_along(flight, axis) for axis in (0, 1)]
    if north is None or east is None or not north.expression or north.name != east.name:
        return
    if along[0] is None or along[1] is None:
        return
    grid = flight.grid
    moved = grid.rate(along[0], _COURSE_SECONDS) + 1j * grid.rate(along[1], _COURSE_SECONDS)
    told = [grid.smooth(flight.raw(f"velocity.{way}"), _COURSE_SECONDS) for way in ("north", "east")]
    off = np.angle(moved * (told[0] - 1j * told[1]))
    turning = np.abs(np.imag(np.gradient(moved, grid.step) / moved))
    straight = np.isfinite(off) & (turning < _STRAIGHT) & (np.abs(moved) > SLOWEST)
    if np.sum(straight) * grid.step < _LEAST_STRAIGHT:
        return
    least, middle, most = np.degrees(np.percentile(off[straight], (25, 50, 75)))
    if abs(middle) > _DECLINATION and least * most > 0.0:
        for column in (north, east):
            column.doubt = f"its course is {abs(middle):.0f} deg off that of the position: from magnetic north?"


def _check_signs(flight: Flight) -> None:
    """That no law has a sign that another has not: then neither is believed."""
    against = {
        signal: law
        for signal, column in flight.columns.items()
        if column.is_known and signal not in POSITIVE
        for law, found, _ in _followed(flight, signal)
        if found.sign != column.sign
    }
    for joint, told in _JOINT:
        for signal, (slope, t) in joint(flight).items():
            if flight.columns[signal].is_known and abs(t) > SURE_T and slope * flight.columns[signal].sign < 0.0:
                against[signal] = told
    for signal, law in against.items():
        flight.columns[signal].doubt = f"{law} says the other way"


def _explain_open(flight: Flight) -> None:
    for column in flight.columns.values():
        if column.doubt or column.is_known:
            continue
        if not column.unit:
            column.doubt = "its unit cannot be found"
        else:
            column.doubt = "the positive direction cannot be found"
