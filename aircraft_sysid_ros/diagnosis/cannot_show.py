"""What a flight could not show if it were there: silence about such an effect says nothing.

An effect is out of reach of a flight that does not get to where it acts, in which a signal that it reads is not
measured, stands still or moves only where nothing is judged, whose model moves with it, or, of errors of the air data
that feign a wind, in gusts. That is known from the flight alone, before anything is tried. An effect that could be seen
and is small is none of these.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from aircraft_sysid_ros.diagnosis.finding import resting_on
from aircraft_sysid_ros.diagnosis.flight.reconstruction import AIR_DATA
from aircraft_sysid_ros.diagnosis.measurement.setting import feigns_wind
from aircraft_sysid_ros.diagnosis.search.candidates import can_act, candidates_of, where_it_acts
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.effects.effect import MEASUREMENT, Effect
from aircraft_sysid_ros.samples import CONTROL_COLUMNS, Kind, Samples

#: Controls that are asked, and the share of their range below which one is not moved in what is judged.
_CONTROLS, _STILL = ("de", "da", "dr", "flaps"), 0.1


@dataclass(frozen=True)
class OutOfReach:
    """An effect that a flight cannot show, and why."""

    effect: Effect
    why: str


def out_of_reach(
    bench: CandidateEvaluator, library: Sequence[Effect], samples: Samples, is_calm: bool, listed: Collection[str] = ()
) -> list[OutOfReach]:
    """Effects of a library that a flight cannot show; what is ``listed`` with evidence it has shown."""
    kinds = set(samples.kind[np.isfinite(samples.values[:, 0])].tolist())
    left_out = _moved_elsewhere(bench, samples)
    reasons = (
        (effect, _of_sensor(effect, kinds, is_calm, bench) if effect.kind == MEASUREMENT else _of_force(effect, bench))
        for effect in library
        if effect.identifier not in listed
    )
    told = ((effect, why or _only(effect.signals & left_out)) for effect, why in reasons)
    return [OutOfReach(effect, why) for effect, why in told if why]


def _moved_elsewhere(bench: CandidateEvaluator, samples: Samples) -> frozenset[str]:
    """Controls that were moved in the recording, and hardly in what is judged of it."""
    recorded, found = samples.values[samples.kind == Kind.CONTROLS], set()
    for name in _CONTROLS:
        values, judged = recorded[:, CONTROL_COLUMNS.index(name)], bench.data.signal(name)
        values, judged = values[np.isfinite(values)], judged[np.isfinite(judged)]
        if len(values) and len(judged) and np.ptp(judged) < _STILL * np.ptp(values):
            found.add(name)
    return frozenset(found)


def _only(names: Collection[str]) -> str:
    return f"{_listed(sorted(names))} moves only in a part of the flight that is left out" if names else ""


def _of_sensor(effect: Effect, kinds: Collection[int], is_calm: bool, bench: CandidateEvaluator) -> str:
    settings = [variant.setting for variant in effect.variants if variant.setting]
    sensors = {setting[1] for setting in settings if setting[0] == "sensors"}
    lacking = [name for name in sorted(sensors & set(AIR_DATA)) if int(AIR_DATA[name]) not in kinds]
    if lacking and len(lacking) == len(sensors):
        return f"{_listed(lacking)} is not measured"
    shown = effect.as_terms is not None and not _of_force(effect.as_terms, bench)  # gusts or none
    if not is_calm and not shown and settings and all(feigns_wind(setting) for setting in settings):
        return "gusts may be stronger in one direction than in another"
    return ""


def _of_force(effect: Effect, bench: CandidateEvaluator) -> str:
    data, needed = bench.data, sorted(effect.signals | ({effect.domain.signal} if effect.domain else set()))
    lacking = data.lacks(needed)
    if lacking == ["height"]:
        return "the height of the ground is not known: set ground_altitude in the aircraft file"
    lacked = [frozenset(data.lacks(signals)) for signals in effect.signals_by_variant]
    if not lacking and all(lacked):  # of each form another one
        return f"{_listed(sorted(frozenset.union(*lacked)), 'nor')} is measured"
    if lacking:
        return f"{_listed(lacking)} is not measured"
    if not can_act(effect, data):
        return where_it_acts(effect, data)
    still = [name for name in needed if np.nanmax(data.signal(name)) == np.nanmin(data.signal(name))]
    if still:
        return f"{_listed(still)} does not move"
    if effect.axes and set(effect.axes) <= resting_on(data.inferred):
        return f"{_listed(data.inferred)} is not measured"
    if not any(_is_told(bench, effect)):
        return "it moves together with what the model has"
    return ""


def _is_told(bench: CandidateEvaluator, effect: Effect) -> Iterator[bool]:
    """Of each candidate, whether the flight determines a number of it."""
    for candidate in candidates_of(effect, bench.data, bench.base):
        trial = bench.trial(candidate)
        yield trial is not None and any(np.isfinite(gain.parameters).any() for gain in trial.gains.values())


def _listed(names: Sequence[str], link: str = "and") -> str:
    words = {"V": "airspeed", "alpha": "the angle of attack", "beta": "sideslip", "Tc": "thrust", "dr": "the rudder"}
    words |= {"de": "the elevator", "da": "the aileron", "angle_of_attack": "the angle of attack"}
    said = f" {link} ".join(words.get(name, name.replace("_", " ")) for name in names)
    return f"neither {said}" if link == "nor" else said
