"""What a flight does without, and what each of that costs: one sentence each."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.reconstruction.alignment import GPS
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples


def absences(state: StateEstimator) -> list[str]:
    """What is said after a flight of the sensors that were not there; nothing of those that it can do without."""
    return [*_of_gps(state), *_of_height(state), *_of_air_data(state)]


def require_airspeed(samples: Samples) -> None:
    """Raises InputError for a flight that no parameter can be learnt from afterwards."""
    if not np.isfinite(samples.values[samples.kind == Kind.AIRSPEED, 0]).any():
        raise InputError(
            "this flight has no airspeed, and nothing can be said of its model without one: replay and live take the "
            "speed over ground for it with --calm-air, what comes after a flight does not"
        )


def _has(state: StateEstimator, kind: Kind) -> bool:
    """Whether there were samples of a kind that could be used."""
    counts = state.order.counts
    return bool(counts.received[kind] > counts.invalid[kind])


def _of_gps(state: StateEstimator) -> list[str]:
    gps = GPS if state.gps is None else state.gps
    if not gps:
        found = [
            "no GPS: wind is not estimated, velocities are relative to the air and positions drift with it, and the "
            "constants of the model are held"
        ]
        if not _has(state, Kind.ATTITUDE):
            heading = "" if _has(state, Kind.MAGNETIC_FIELD) else "the heading is counted from the start, and "
            found.append(
                f"neither GPS nor attitude: {heading}tilt and biases are less certain than their "
                "standard errors say, most of all in gusts"
            )
        return found
    if Kind.GPS_VELOCITY not in gps:
        return ["no GPS velocity: it follows from the positions, and wind and heading are less certain"]
    if Kind.GPS_POSITION not in gps:
        return ["no GPS position: the place is not known, and positions are counted from the start"]
    return []


def _of_height(state: StateEstimator) -> list[str]:
    if _has(state, Kind.GPS_POSITION) or _has(state, Kind.AIR):
        return []
    ground = state.aircraft.ground_altitude
    where = "sea level (or the ground_altitude of the aircraft file)" if ground is None else f"{ground:g} m"
    return [
        f"neither GPS position nor static pressure: the air density is the standard one at {where}, and a per cent "
        "that it is off by is one in every coefficient"
    ]


def _of_air_data(state: StateEstimator) -> list[str]:
    if not _has(state, Kind.AIRSPEED):
        if state.options.calm_air:
            return [
                "no airspeed: the air is taken as calm, and a per cent by which a wind changed the airspeed is two in "
                "every coefficient, which no standard error counts"
            ]
        return ["no airspeed: no parameter is learnt; calm_air (--calm-air) takes the speed over ground for it"]
    angles = (("angle of attack", Kind.ANGLE_OF_ATTACK), ("sideslip", Kind.SIDESLIP))
    lacking = " and no ".join(name for name, kind in angles if not _has(state, kind))
    if not lacking:
        return []
    if state.gps == frozenset() and not _has(state, Kind.ATTITUDE):
        return [f"no {lacking}: without GPS and attitude nothing is learnt where it counts, and tilt is a rough guess"]
    return [f"no {lacking} is measured: inferred from wind and attitude, which costs certainty (docs/mavlink.md)"]
