"""The whole check of a flight: all laws, their contradictions explained, the worst first."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from aircraft_sysid_ros.aircraft.aerodynamic_model import AerodynamicModel, textbook_model
from aircraft_sysid_ros.flight_check.explain import Explanation, delays, scales, signs, units
from aircraft_sysid_ros.flight_check.finding import KINDS, SEVERITIES, Finding, joined
from aircraft_sysid_ros.flight_check.identifiable import Identifiability, identifiable
from aircraft_sysid_ros.flight_check.laws import (
    absence,
    airspeed,
    flow_angles,
    gravity,
    gyro_attitude,
    imu_axes,
    inputs,
    kinematic_force,
    position_velocity,
    pressure,
    sampling,
    surfaces,
    turns,
    values,
)
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation
from aircraft_sysid_ros.flight_check.repair import with_columns, with_yaw, without_stuck
from aircraft_sysid_ros.flight_check.signals import Flight, signal_names

#: Passes over what contradicts itself, at most.
_PASSES = 6
#: Laws between sensors, beside those of the vectors of the IMU and of the GPS.
KINEMATICS = (turns, flow_angles, airspeed, gravity, pressure)
#: Too short for anything but counting [s].
SHORTEST = 5.0


def nothing_wrong(duration: float) -> str:
    """What to say of a recording of so many seconds in which nothing was found."""
    if duration < SHORTEST:
        return f"too short to say whether signals contradict each other: {SHORTEST:g} s are needed"
    return "nothing contradicts itself or looks wrong"


@dataclass(frozen=True)
class Checked:
    """What was found, rates of the signals [Hz], relations between them, the flight without faults, its parameters."""

    findings: tuple[Finding, ...]
    rates: Mapping[str, float]
    relations: tuple[Relation, ...]
    motion: Motion
    parameters: tuple[Identifiability, ...]


def check(
    flight: Flight, model: AerodynamicModel | None = None, progress: Callable[[float], None] = lambda share: None
) -> Checked:
    """All laws over one flight.

    What contradicts itself is explained in passes: the gravest faults first, exchanged axes, then signs and units, then
    times, then other factors; they are taken out and the rest is judged without them, and so is which parameters of
    ``model`` (default: the 32 of the textbook) the flight shows. ``progress`` is told the share done.
    """
    model = model or textbook_model()
    found = absence.findings(flight, model) + sampling.findings(flight) + values.findings(flight)
    found += inputs.findings(flight)
    laws = (*KINEMATICS, surfaces)
    contradicting, relations, motion = contradictions(flight, laws, found, progress, judged=without_stuck)
    parameters = tuple(identifiable(motion, model))
    return Checked(tuple(_ordered(found + contradicting)), _rates(flight), tuple(relations), motion, parameters)


def contradictions(
    flight: Flight,
    laws: Sequence[Any] = KINEMATICS,
    known: Sequence[Finding] = (),
    progress: Callable[[float], None] = lambda share: None,
    judged: Callable[[Flight], Flight] = lambda flight: flight,
) -> tuple[list[Finding], list[Relation], Motion]:
    """Signals that contradict others by kinematics, beside what is ``known``; relations and motion without the faults.

    ``judged``: what of a flight is compared. ``laws``: modules with ``relations``, beside those of vectors.
    """
    found, repaired = list[Finding](), flight
    motion, relations = Motion(flight), list[Relation]()
    cut = {name for f in known if f.kind == "saturated" for name in f.signals}
    for number in range(_PASSES if flight.duration >= SHORTEST else 0):
        progress((number + 1) / (_PASSES + 1))
        motion, compared = Motion(repaired), judged(repaired)
        relations, explained = _explained(motion if compared is repaired else Motion(compared), laws)
        said = {(f.signals, f.kind) for f in (*known, *found)}
        explained = [e for e in explained if (e.finding.signals, e.finding.kind) not in said]
        explained = [e for e in explained if e.finding.kind != "scale" or not cut & set(e.finding.signals)]
        found += [explanation.finding for explanation in explained]
        for explanation in explained:
            repaired = explanation.repair(repaired)
        if not explained:
            break
    return found, relations, motion


def _explained(motion: Motion, laws: Sequence[Any]) -> tuple[list[Relation], list[Explanation]]:
    """Relations of a flight, and the gravest of what they say."""
    triples = [gyro_attitude.triple(motion), position_velocity.triple(motion)]
    triples += [kinematic_force.triple(motion)]
    if (imu := imu_axes.turned(triples[0], triples[2])) is not None:
        return [], [Explanation(imu.finding, imu.taken_out)]
    for triple in (*triples, flow_angles.pair(motion)):
        if triple.places:
            move = partial(with_columns, follows=triple.places)
            rest = [Explanation(finding, _unchanged) for finding in triple.findings[1:]]
            return [], [Explanation(triple.findings[0], move), *rest]
    rates, moved, forces = triples
    relations = gyro_attitude.relations(motion, rates) + position_velocity.relations(motion, moved)
    relations += kinematic_force.relations(motion, forces)
    if surfaces in laws and (exchanged := surfaces.exchanged(motion)):
        move = partial(with_columns, follows={f.signals[0]: other for f, other in exchanged})
        rest = [Explanation(finding, _unchanged) for finding, _ in exchanged[1:]]
        return relations, [Explanation(exchanged[0][0], move), *rest]
    for law in laws:
        relations += law.relations(motion)
    simple = [r for r in relations if not r.is_derived]
    gravest = signs(simple) or units(simple) or signs(relations) or units(relations)
    if not gravest:
        turn = partial(with_yaw, angle=-turns.heading_error(motion))
        gravest = [Explanation(finding, turn) for finding in turns.findings(motion)]
    return relations, gravest or delays(relations, motion.flight) or scales(relations)


def _unchanged(flight: Flight) -> Flight:
    return flight


def _rates(flight: Flight) -> dict[str, float]:
    return {name: s.rate for s in flight.every_stream for name, _ in signal_names(s)}


def _ordered(findings: list[Finding]) -> list[Finding]:
    """The worst first; of two of the same kind on a signal the first."""
    findings = sorted(findings, key=lambda f: (SEVERITIES.index(f.severity), KINDS.index(f.kind)))
    said: set[tuple[str, str]] = set()
    kept = []
    for finding in findings:
        new = tuple(signal for signal in finding.signals if (signal, finding.kind) not in said)
        said |= {(signal, finding.kind) for signal in new}
        if new:
            kept.append(replace(finding, signals=new))
    return joined(kept)
