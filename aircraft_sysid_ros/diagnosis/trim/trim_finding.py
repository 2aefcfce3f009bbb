"""A change of trim as a finding like any other: its name, the terms that it adds, and what else it could be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aircraft_sysid_ros.diagnosis.finding import Finding
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.search.candidates import Candidate, with_inner
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.diagnosis.trim.trim_change import WINDOW, TrimChange, trim_change
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import PULSE, STEP, fill
from aircraft_sysid_ros.rounding import with_error

_CG, _GEAR, _FLAPS = "cg_shift", "landing_gear", "unrecorded_flaps"
_ALONG = "along the fuselage"


def trim_finding(data: FlightData) -> Finding | None:
    """The change of trim of a flight, where it is beyond chance and explains most of what is left of the trim."""
    change = trim_change(data)
    if change is None or change.p_value >= THRESHOLDS.verdict or change.before < THRESHOLDS.trim_left:
        return None
    size = 1.0 - change.after / change.before
    if size < THRESHOLDS.trim_size:
        return None
    bench = CandidateEvaluator(data)
    candidate = _candidate(bench, change)
    trial = bench.trial(candidate)
    if trial is None or "Cm" not in trial.gains:
        return None
    return Finding(
        replace(trial, told_in="Cm"), data, trial.score, change.evidence, change.p_value, size, np.inf,
        _rivals(candidate, change),
        told_by=_words(candidate, change, data),
    )  # fmt: skip


def _times(change: TrimChange) -> dict[str, float]:
    return {"t0": change.begin} | ({} if change.end is None else {"t1": change.end})


def _candidate(bench: CandidateEvaluator, change: TrimChange) -> Candidate:
    """What the change is called: by the axes that changed with it, and by whether it follows lift."""
    with_lift = change.prefers_lift > -THRESHOLDS.trim_told
    if not change.company and with_lift:
        return _named(bench, change, _CG, _ALONG)
    if set(change.company) == {"CX"} or (not change.company and "CX" in change.unknown):
        return _named(bench, change, _GEAR, "")
    if "CZ" in change.company and set(change.company) <= {"CX", "CZ"}:
        return _named(bench, change, _FLAPS, "")
    term = fill(STEP if change.end is None else PULSE, _times(change))
    axes = ("Cm", *change.company)
    (text,) = (program.text for program in bench.data.parsed([term]))
    changed = {axis: ["1"] for axis in axes}
    return Candidate(None, "", tuple(_times(change).items()), dict.fromkeys(axes, (text,)), changed)


def _named(bench: CandidateEvaluator, change: TrimChange, identifier: str, variant: str) -> Candidate:
    effect = BY_ID[identifier]
    found = next(each for each in effect.variants if each.name == variant)
    return with_inner(effect, found if change.end is None else found.passing or found, _times(change), bench.base)


def _rivals(candidate: Candidate, change: TrimChange) -> tuple[str, ...]:
    """Effects that this flight cannot tell from it: drag is hidden where nobody knows the thrust."""
    unsure = abs(change.prefers_lift) < THRESHOLDS.trim_told
    if candidate.family == _CG:
        return (_GEAR,) if unsure and "CX" in change.unknown else ()
    if candidate.family == _GEAR:
        return ("parameter_change",) if "CX" in change.unknown else ()
    return ()


def _words(candidate: Candidate, change: TrimChange, data: FlightData) -> str:
    """What the evidence is, for people."""
    said = (
        f"dated to {change.within:.0f} s by the elevator in steady flight: of its moment, means over {WINDOW:g} s "
        f"leave {change.before:.0%} unexplained, and {change.after:.0%} with this"
    )
    if candidate.family != _CG:
        return said
    where, chord = "forward" if change.with_lift > 0.0 else "aft", data.aircraft.chord
    # a slow IMU sees the elevator as too weak in manoeuvres: by a sixth at 10 Hz
    more = ", or up to a fifth more, since the IMU is slow" if data.sparse_interval > 0.0 else ""
    moved, std = abs(change.with_lift) * chord, change.std_with_lift * chord
    return f"{said}; the centre of gravity is {with_error(moved, std)} m further {where}{more}"
