"""What a flight does without, and what each of that costs: one sentence each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.state_estimator import Sensors, StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples

#: Manoeuvres that a sentence names.
_MOST_NAMES = 3


def absences(state: StateEstimator, names: Sequence[str] = ()) -> list[str]:
    """What is said after a flight of the sensors that were not there; nothing of those that it can do without.

    Of manoeuvres that were joined, of which there are ``names``, with those that it is true of.
    """
    return of_manoeuvres([_of_one(sensors, state) for sensors in state.sensors], names)


def of_manoeuvres(said: Sequence[Sequence[str]], names: Sequence[str] = ()) -> list[str]:
    """Sentences on each manoeuvre, each of them once: with the manoeuvres that it is true of where it is not all."""
    found = []
    for sentence in dict.fromkeys(text for of_one in said for text in of_one):
        true_of = [number for number, of_one in enumerate(said) if sentence in of_one]
        if len(true_of) < len(said):
            named = [names[k] if k < len(names) else str(k + 1) for k in true_of[:_MOST_NAMES]]
            more = ", …" if len(true_of) > _MOST_NAMES else ""
            sentence = f"in {len(true_of)} of {len(said)} manoeuvres ({', '.join(named)}{more}): {sentence}"
        found.append(sentence)
    return found


class NoAirspeedError(InputError):
    """A flight without airspeed, of which nobody has said that its air was calm: ``why``, and what to do of one."""

    why = "this flight has no airspeed, and nothing can be said about its model without one"

    def __init__(self) -> None:
        super().__init__(
            f"{self.why}: replay it with --calm-air, which uses the speed over ground instead, and compare, diagnose, "
            "add and refine follow it"
        )


def _of_one(sensors: Sensors, state: StateEstimator) -> list[str]:
    ground, calm_air = state.aircraft.ground_altitude, state.options.calm_air
    return [*_of_gps(sensors), *_of_height(sensors, ground), *_of_air_data(sensors, calm_air)]


def has_airspeed(samples: Samples) -> bool:
    """Whether a flight has measured its airspeed."""
    return bool(np.isfinite(samples.values[samples.kind == Kind.AIRSPEED, 0]).any())


def options_after_flight(samples: Samples, calm_air: bool) -> StateOptions:
    """Options with which a flight is reconstructed once more, ``calm_air`` as when it was replayed.

    Raises NoAirspeedError for a flight that no parameter can be learnt from.
    """
    if not has_airspeed(samples) and not calm_air:
        raise NoAirspeedError
    return StateOptions(calm_air=calm_air)


def assumed_calm(samples: Samples, calm_air: bool) -> list[str]:
    """What every answer says of a flight whose wind was taken for none; empty where its airspeed was measured."""
    if has_airspeed(samples) or not calm_air:
        return []
    return ["no airspeed was measured: the air was taken as calm, and any wind that there was is in every number"]


def _of_gps(sensors: Sensors) -> list[str]:
    if not sensors.gps:
        found = [
            "no GPS: wind is not estimated, velocities are relative to the air and positions drift with it, and the "
            "constants of the model are held"
        ]
        if Kind.ATTITUDE not in sensors.usable:
            heading = "" if Kind.MAGNETIC_FIELD in sensors.usable else "the heading is counted from the start, and "
            found.append(
                f"neither GPS nor attitude: {heading}tilt and biases are less certain than their "
                "standard errors say, most of all in gusts"
            )
        return found
    if Kind.GPS_VELOCITY not in sensors.gps:
        return ["no GPS velocity: it follows from the positions, and wind and heading are less certain"]
    if Kind.GPS_POSITION not in sensors.gps:
        return ["no GPS position: the place is not known, and positions are counted from the start"]
    return []


def _of_height(sensors: Sensors, ground: float | None) -> list[str]:
    if {Kind.GPS_POSITION, Kind.AIR} & sensors.usable:
        return []
    where = "sea level (or the ground_altitude of the aircraft file)" if ground is None else f"{ground:g} m"
    return [
        f"neither GPS position nor static pressure: the air density is the standard one at {where}, and each per cent "
        "that it is off by is one in every coefficient"
    ]


def _of_air_data(sensors: Sensors, calm_air: bool) -> list[str]:
    if Kind.AIRSPEED not in sensors.usable:
        if calm_air:
            return [
                "no airspeed: the air is taken as calm, and each per cent by which wind changed the airspeed is two "
                "in every coefficient, which no standard error includes"
            ]
        return ["no airspeed: no parameter is learnt; calm_air (--calm-air) uses the speed over ground instead"]
    angles = (("angle of attack", Kind.ANGLE_OF_ATTACK), ("sideslip", Kind.SIDESLIP))
    lacking = " and no ".join(name for name, kind in angles if kind not in sensors.usable)
    if not lacking:
        return []
    if not sensors.gps and Kind.ATTITUDE not in sensors.usable:
        return [f"no {lacking}: without GPS and attitude nothing is learnt where it counts, and tilt is a rough guess"]
    return [f"no {lacking} is measured: inferred from wind and attitude, which costs certainty (docs/mavlink.md)"]
