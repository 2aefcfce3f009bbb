"""What is not measured, and what that costs."""

from __future__ import annotations

from aircraft_sysid_ros.flight_check.finding import ERROR, INFO, WARNING, Finding
from aircraft_sysid_ros.flight_check.signals import ATTITUDE, FORCE, GEODETIC, GYRO, SURFACES, VELOCITY, Flight
from aircraft_sysid_ros.samples import Kind

#: Signals, the kind of sample that brings them, severity and cost.
_NEEDED: tuple[tuple[tuple[str, ...], tuple[Kind, ...], str, str], ...] = (
    ((*FORCE, *GYRO), (Kind.IMU,), ERROR, "nothing can be estimated without accelerometers and gyros: record them"),
    (VELOCITY, (Kind.GPS_VELOCITY,), WARNING,
     "wind, biases and heading rest on it: record it, or expect those to be uncertain"),
    (GEODETIC, (Kind.GPS_POSITION,), WARNING, "height and place are unknown: record GPS, or the static pressure"),
    (("true_airspeed",), (Kind.AIRSPEED, Kind.FIVE_HOLE), WARNING,
     "dynamic pressure is unknown, which divides every coefficient: record it, or assume calm air"),
    (("angle_of_attack",), (Kind.ANGLE_OF_ATTACK, Kind.FIVE_HOLE), INFO,
     "it must come from attitude and flight path, and gusts count as noise: the derivatives of alpha are less certain"),
    (("sideslip",), (Kind.SIDESLIP, Kind.FIVE_HOLE), INFO,
     "it must come from the lateral force and the flight path: the derivatives of beta are less certain"),
    (ATTITUDE, (Kind.ATTITUDE,), INFO,
     "roll, pitch and yaw come from IMU and GPS; signs and units of the gyros are less well checked"),
    (SURFACES[:3], (Kind.CONTROLS,), WARNING, "no derivatives can be estimated, only motion, biases and wind"),
    (("static_pressure",), (Kind.AIR, Kind.FIVE_HOLE), INFO, "air density is that of the standard day at the altitude"),
)  # fmt: skip


def findings(flight: Flight) -> list[Finding]:
    """Of signals without samples, of controls without some surface, and of messages that could not be decoded."""
    found = [
        Finding(names, "missing", severity, f"not in the recording: {cost}")
        for names, kinds, severity, cost in _NEEDED
        if not any(kind in flight.streams for kind in kinds)
    ]
    if Kind.CONTROLS in flight.streams:
        lacking = tuple(name for name in SURFACES[:3] if flight.column(name) is None)
        if lacking:
            found.append(Finding(lacking, "missing", INFO, "not in the recording: its derivatives cannot be estimated"))
    for topic, count in flight.skipped.items():
        found.append(Finding(
            (topic,), "missing", WARNING, f"{count} messages could not be decoded: the recording is damaged there"
        ))  # fmt: skip
    return found
