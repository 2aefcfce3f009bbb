"""The change at one moment that explains most of a flight, whatever its cause: the rival of every named change.

From a time t0 on, or up to a time t1, each axis may have other multiples of the constant, of the motion and controls
that the flight has and moves, and of the terms of its model. Whatever breaks, drops, sticks or shifts in flight is of
that form, in several axes at one time; an effect of the library that explains clearly less than this is not its cause.
Terms are chosen one by one, so that what is left is short enough to be read: "from 73 s on CX: 1; Cm: 1".
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import partial

import numpy as np

from aircraft_sysid_ros.aircraft.expression import MAXIMUM_LENGTH
from aircraft_sysid_ros.diagnosis.flight.flight_data import BLOCK
from aircraft_sysid_ros.diagnosis.search.candidates import Candidate, grid, lasts, limits, spans
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator, Score, at_seam, moves, refined
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import BEGIN, END, PULSE, STEP, fill

_SIGNALS = ("alpha", "beta", "p", "q", "r", "de", "da", "dr")
#: Characters of a term that can still be written with a pulse before it.
_LONGEST = MAXIMUM_LENGTH - 80
#: Terms of one axis, and moments at which terms are chosen.
_MOST_TERMS, _MOST_MOMENTS = 4, 4
#: Error with a term that was always there, over that with the term of the change, up to which it explains as much.
_AS_MUCH = 1.02


def sudden_change(bench: CandidateEvaluator) -> Score | None:
    """The best change at one moment; None where none gains anything, or the best is there nearly from the beginning."""
    times = [{"t0": float(t)} for t in grid(BEGIN, bench.data) if np.isfinite(t)]
    whole = [(t, trial) for t in times if (trial := bench.trial(_candidate(bench, t, _everything(bench)))) is not None]
    whole.sort(key=lambda item: -_gain(item[1]))
    chosen = [_chosen(bench, t, trial) for t, trial in whole[:_MOST_MOMENTS]]
    best = max((trial for trial in chosen if trial is not None), key=_gain, default=None)
    if best is None:
        return None
    passing = [
        bench.trial(_candidate(bench, values, best.candidate.changed))
        for values in spans(best.candidate.moment, bench.data)
    ]
    other = max((trial for trial in passing if trial is not None), key=_gain, default=None)
    found = [_refined(bench, trial) for trial in (best, other) if trial is not None]
    likeliest = max(found, key=lambda trial: _gain(trial) - trial.price)
    return likeliest if _begins(likeliest, bench) else None


def without_axes(bench: CandidateEvaluator, change: Score, axes: Collection[str]) -> Score | None:
    """The same change where it is nothing in some axes; None where it is nothing in any other."""
    left = {axis: terms for axis, terms in (change.candidate.changed or {}).items() if axis not in axes}
    return bench.trial(_candidate(bench, dict(change.candidate.inner), left)) if left else None


def without_lasting_terms(bench: CandidateEvaluator, change: Score) -> Score:
    """The same change without terms that explain as much where they were always there."""
    times, kept = dict(change.candidate.inner), {axis: list(terms) for axis, terms in change.candidate.changed.items()}
    for axis, terms in change.candidate.changed.items():
        for term in terms:
            others = [each for each in kept[axis] if each != term]
            if term == "1" or not others or term in bench.data.model.terms[axis]:
                continue
            lasting = bench.extended({axis: (term,)}).trial(_candidate(bench, times, {axis: others}))
            if lasting is not None and lasting.gains[axis].nrmse_after <= _AS_MUCH * change.gains[axis].nrmse_after:
                kept[axis] = others
    if kept == {axis: list(terms) for axis, terms in change.candidate.changed.items()}:
        return change
    return bench.trial(_candidate(bench, times, kept)) or change


def _begins(trial: Score, bench: CandidateEvaluator) -> bool:
    """Whether it has a moment, or an end: what is best at the earliest time that is tried was always there."""
    times, (earliest, _) = dict(trial.candidate.inner), limits(BEGIN, bench.data)
    return "t1" in times or times["t0"] > earliest + BLOCK


def _refined(bench: CandidateEvaluator, trial: Score) -> Score:
    """Its times moved to where it explains most."""

    def at(best: Score, value: float, name: str) -> Score | None:
        """The same change at another time."""
        values = {**dict(best.candidate.inner), name: value}
        return bench.trial(_candidate(bench, values, best.candidate.changed)) if lasts(values) else None

    for name, number in zip(dict(trial.candidate.inner), (BEGIN, END), strict=False):
        move = partial(at, name=name)
        trial = at_seam(refined(trial, number, bench.data, move, _gain), name, bench.data, move, _gain)
    return trial


def _everything(bench: CandidateEvaluator) -> dict[str, list[str]]:
    """All terms that may change, by axis."""
    moving = [name for name in (*_SIGNALS, *bench.data.model.inputs) if moves(bench.data.signal(name))]
    terms = {axis: dict.fromkeys(["1", *moving, *bench.data.model.terms[axis]]) for axis in bench.fits}
    return {axis: [term for term in listed if len(term) < _LONGEST] for axis, listed in terms.items()}


def _candidate(bench: CandidateEvaluator, times: Mapping[str, float], terms: Mapping[str, Sequence[str]]) -> Candidate:
    step = fill(PULSE if "t1" in times else STEP, times)
    texts = {}
    for axis, names in terms.items():
        parsed = bench.data.parsed(step if n == "1" else f"{step}*({n})" for n in names)
        texts[axis] = tuple(program.text for program in parsed)
    return Candidate(None, "", tuple(times.items()), texts, changed=terms)


def _gain(trial: Score) -> float:
    return sum(value for value in trial.log_ratios.values() if value >= THRESHOLDS.change_gain)


def _chosen(bench: CandidateEvaluator, times: Mapping[str, float], whole: Score) -> Score | None:
    """The few terms that make most of the change at one moment."""
    few: dict[str, list[str]] = {}
    for axis, terms in _everything(bench).items():
        if whole.log_ratios.get(axis, 0.0) < THRESHOLDS.change_gain:
            continue
        kept: list[str] = []
        gained = 0.0
        while len(kept) < _MOST_TERMS:
            trials = {t: bench.trial(_candidate(bench, times, {axis: [*kept, t]})) for t in terms if t not in kept}
            gains = {term: trial.log_ratios[axis] for term, trial in trials.items() if trial is not None}
            best = max(gains, key=lambda term: gains[term], default=None)
            if best is None or gains[best] < gained + THRESHOLDS.change_gain:
                break
            gained = gains[best]
            kept.append(best)
        if kept:
            few[axis] = kept
    return bench.trial(_candidate(bench, times, few)) if few else None
