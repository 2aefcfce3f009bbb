"""What is not measured, and what that costs."""

from __future__ import annotations

from aircraft_sysid_ros.aircraft.aerodynamic_model import AerodynamicModel
from aircraft_sysid_ros.flight_check.finding import ABSENT, ERROR, INFO, WARNING, Finding
from aircraft_sysid_ros.flight_check.signals import (
    ATTITUDE,
    FORCE,
    GEODETIC,
    GYRO,
    INPUTS,
    SURFACES,
    VELOCITY,
    Flight,
)
from aircraft_sysid_ros.samples import Kind

_NO_IMU = "nothing can be estimated without accelerometers and gyros: record them"
#: Signals, the kind of sample that brings them, severity and cost.
_NEEDED: tuple[tuple[tuple[str, ...], tuple[Kind, ...], str, str], ...] = (
    ((*FORCE, *GYRO), (Kind.IMU,), ERROR, _NO_IMU),
    (VELOCITY, (Kind.GPS_VELOCITY,), WARNING,
     "wind, biases and heading rest on it: record it, or expect those to be uncertain"),
    (GEODETIC, (Kind.GPS_POSITION,), WARNING, "height and place are unknown: record GPS, or the static pressure"),
    (("true_airspeed",), (Kind.AIRSPEED, Kind.FIVE_HOLE), WARNING,
     "dynamic pressure is unknown, which divides every coefficient: record it, or assume calm air (--calm-air)"),
    (("angle_of_attack",), (Kind.ANGLE_OF_ATTACK, Kind.FIVE_HOLE), INFO,
     "it must come from attitude and flight path, and gusts count as noise: the derivatives of alpha are less certain"),
    (("sideslip",), (Kind.SIDESLIP, Kind.FIVE_HOLE), INFO,
     "it must come from the lateral force and the flight path: the derivatives of beta are less certain"),
    (ATTITUDE, (Kind.ATTITUDE,), INFO,
     "roll, pitch and yaw come from IMU and GPS; signs and units of the gyros are less well checked"),
    (("static_pressure",), (Kind.AIR, Kind.FIVE_HOLE), INFO, "air density is that of the standard day at the altitude"),
)  # fmt: skip
_NO_CONTROLS = f"{ABSENT}: no derivatives can be estimated, only motion, biases and wind"
_UNREAD = "no term reads it, take it out of the aircraft file or record it"
_PLACE = Finding(GEODETIC, "missing", INFO, f"{ABSENT}: height is that of the static pressure, place unknown")
#: Surfaces by their signal in terms.
_SURFACES = dict(zip(("de", "da", "dr"), SURFACES, strict=False))


def findings(flight: Flight, model: AerodynamicModel) -> list[Finding]:
    """Of signals without samples, of surfaces and inputs that terms of a model read, and of messages that could not be
    decoded.
    """
    found = [
        Finding(names, "missing", severity, f"{ABSENT}: {cost}")
        for names, kinds, severity, cost in _NEEDED
        if not any(kind in flight.streams for kind in kinds)
    ]
    # An import of an attitude alone has messages of the IMU, and none of the values.
    empty = tuple(name for name in (*FORCE, *GYRO) if flight.column(name) is None)
    if empty and Kind.IMU in flight.streams:
        found.append(Finding(empty, "missing", ERROR, f"{ABSENT}: {_NO_IMU}"))
    if flight.column("static_pressure") is not None:
        found = [_PLACE if finding.signals == GEODETIC else finding for finding in found]
    controls = {name: signal for signal, name in _SURFACES.items() if signal in model.signals_used}
    controls |= {INPUTS + item.name: item.name for item in flight.inputs}
    lacking = tuple(name for name in controls if flight.column(name) is None)
    of_terms = {name for name in controls if controls[name] in model.signals_used}
    if lacking and {*lacking} >= (of_terms or {*controls}):  # an input that no term reads makes up for nothing
        found.append(Finding(lacking, "missing", WARNING, _NO_CONTROLS))
    elif lacking:
        read = of_terms & {*lacking}
        for names, cost in ((read, "its derivatives cannot be estimated"), ({*lacking} - read, _UNREAD)):
            if names:
                found.append(Finding(tuple(sorted(names)), "missing", INFO, f"{ABSENT}: {cost}"))
    for topic, count in flight.skipped.items():
        found.append(Finding(
            (topic,), "missing", WARNING, f"{count} messages could not be decoded: the recording is damaged there"
        ))  # fmt: skip
    return found
