"""Which effect is missing: candidates ranked by what they explain on held-out flight, and a verdict.

A candidate is significant when it explains more than the same search finds in replicas of the flight in which nothing
is missing (``maximum_statistic``). A verdict needs size as
well: a share of the held-out error of an axis must go, so that what is true but tiny is listed and not called missing.
The effects are found one after another, each with those before it in the model, until none is left. What is found
later must explain that share of the error that there was at first, and more than another shape of what was found
before would. All limits are in ``thresholds``.

When a generic expression, or a change at one moment, explains clearly more than the best effect of the library, the
cause is not in the library: the verdict is "unexplained", with the expression, and that effect is not named first.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.finding import Finding, resting_on, share_of_first
from aircraft_sysid_ros.diagnosis.nested_validation import nested_validation
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator, Score, new_terms, shapes_of
from aircraft_sysid_ros.diagnosis.search.fit import AxisFit
from aircraft_sysid_ros.diagnosis.search_round import SearchRound, left_of, null_of
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import Replica
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import Effect

NONE, MISSING, UNEXPLAINED = "none", "missing", "unexplained"


@dataclass(frozen=True)
class Diagnosis:
    """The verdict with everything that it rests on."""

    verdict: str
    found: tuple[Finding, ...]  # one after another
    candidates: tuple[Finding, ...]  # best first; what is found comes first
    floor: Mapping[str, float]  # held-out NRMSE by axis that the flight would have if nothing were missing
    tried: int
    replicas: int
    bench: CandidateEvaluator = field(repr=False)  # the flight with what was found in the model
    #: How probable it is that a flight in which nothing is missing shows as much as this one, in whatever candidate.
    p_value: float
    #: By axis in which inferred angles allow no name: the error, over that of replicas.
    unknown: Mapping[str, float] = field(default_factory=dict)
    #: By axis of which most is left and nothing explains it: the held-out error, and that over the replicas'.
    left: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def after(self, finding: Finding) -> Diagnosis:
        """The same with what was found before anything was searched for."""
        found, candidates = (finding, *self.found), (finding, *self.candidates)
        p_value = min(self.p_value, finding.p_value)
        return replace(self, verdict=_verdict(found), found=found, candidates=candidates, p_value=p_value)


def diagnose(
    bench: CandidateEvaluator,
    replicas: Sequence[Replica],
    library: Sequence[Effect],
    progress: Callable[[float], None] = lambda share: None,
) -> Diagnosis:
    """Diagnose one flight with replicas of it; ``progress`` hears shares from 0 to 1."""
    empty = [CandidateEvaluator(replica.data) for replica in replicas]
    of_replicas = {a: [other.fits[a].held_out_rms for other in empty if a in other.fits] for a in bench.fits}
    floor = {  # over the spread that the flight has: they repeat a part of a long one, which may be livelier or quieter
        axis: float(np.mean(errors)) / bench.fits[axis].spread
        for axis, errors in of_replicas.items()
        if errors and bench.fits[axis].spread > 0.0
    }
    null = null_of(replicas, library, tuple(bench.fits))
    found: list[Finding] = []
    listed: list[Finding] = []
    resting, tried, p_value = resting_on(bench.data.inferred), 0, 1.0
    one: SearchRound | None = None
    unsure: dict[str, AxisFit] = {}
    first = {axis: fit.nrmse_held_out for axis, fit in bench.fits.items()}
    for number in range(THRESHOLDS.most_effects):
        one = SearchRound(bench, empty, null, library, _part(progress, number), one, first, floor)
        p_value = one.p_value if number == 0 else p_value
        tried = max(tried, len(one.trials))
        significant = one.findings(found)
        known = {f.trial.candidate.family for f in listed}
        listed += [f for f in significant if f.trial.candidate.family not in known]
        named, refused = _named_and_again(one, significant, found, bench, unsure)
        listed = [refused.get(f.trial.candidate.family, f) for f in listed]
        if named is None:
            break
        terms = new_terms(bench.data, named.trial)
        bench = bench.judging(named.trial.candidate).extended(terms)
        shapes = shapes_of(bench, named.trial)
        found.append(replace(named, shape=_sizeable(shapes, bench, first)))
        columns = {
            axis: [text for part in parts for text in part.candidate.terms[axis]] for axis, parts in shapes.items()
        }
        bench = bench.extended({}, columns)
        empty = [other.judging(named.trial.candidate).extended(terms, columns) for other in empty]
    progress(1.0)
    unknown = _unknown(bench, floor, resting, listed)
    names = {f.trial.candidate.family for f in found}
    order = found + [f for f in listed if f.trial.candidate.family not in names]
    left = left_of(bench, floor, resting)
    return Diagnosis(
        _verdict(found), tuple(found), tuple(order), floor, tried, len(replicas), bench, p_value, unknown, left
    )


def _named_and_again(
    one: SearchRound,
    significant: Sequence[Finding],
    before: Sequence[Finding],
    bench: CandidateEvaluator,
    unsure: dict[str, AxisFit],
) -> tuple[Finding | None, dict[str, Finding]]:
    """What a pass names and its nested validation names again; and what it does not, by family.

    What does not come again says nothing of other axes, in which something else may be missing: those are asked next.
    ``unsure`` holds the fits of the axes in which it was so, which are asked again once they have another one.
    """
    refused: dict[str, Finding] = {}
    while True:
        others = [f for f in significant if unsure.get(f.trial.main_axis) is not bench.fits[f.trial.main_axis]]
        best = one.named(others, before, surer=bool(unsure))
        if best is None:
            return None, refused
        axis = best.trial.main_axis
        named = replace(best, nested=nested_validation(best, bench, partial(_named_anew, one, tuple(before), best)))
        if named.comes_again:
            return named, refused
        refused[best.trial.candidate.family], unsure[axis] = named, bench.fits[axis]


def _named_anew(
    one: SearchRound, before: Sequence[Finding], best: Finding, bench: CandidateEvaluator
) -> Finding | None:
    """What the same pass names on a part of the flight in the place of the best of all of it.

    Of several things that are missing any may be the surest one in a part: where that is of another axis, the axis of
    the best is asked, and where it is another effect, what is named after it.
    """
    anew, axis = one.on(bench), best.trial.main_axis
    findings = anew.findings(before)
    named = anew.named(findings, before)
    if named is not None and axis not in named.trial.gains:
        named = anew.named([f for f in findings if axis in f.trial.gains], before)
    if named is None or best.is_again(named.trial.candidate.family):
        return named
    then, found = anew.after(named), (*before, named)
    second = then.named([f for f in then.findings(found) if axis in f.trial.gains], found)
    return named if second is None or not best.is_again(second.trial.candidate.family) else second


def _sizeable(
    shapes: Mapping[str, Sequence[Score]], bench: CandidateEvaluator, first: Mapping[str, float]
) -> dict[str, str]:
    """By axis the term that explains most of what an effect leaves, where that is a share of the first error."""
    best = {axis: parts[0] for axis, parts in shapes.items()}
    sizes = {
        axis: share_of_first(part.gains[axis], bench.fits[axis].nrmse_held_out, first[axis])
        for axis, part in best.items()
    }
    texts = {axis: bench.data.parsed(part.candidate.terms[axis])[0].text for axis, part in best.items()}
    return {axis: text for axis, text in texts.items() if sizes[axis] >= THRESHOLDS.size}


def _unknown(
    bench: CandidateEvaluator, floor: Mapping[str, float], resting: Collection[str], listed: Sequence[Finding]
) -> dict[str, float]:
    """Axes in which something could be named if the angles of flow were measured: their error over that of replicas."""
    axes = {f.trial.main_axis for f in listed if f.matters} & set(resting) & floor.keys()
    return {axis: bench.fits[axis].nrmse_held_out / floor[axis] for axis in sorted(axes, key=AXES.index)}


def _verdict(found: Sequence[Finding]) -> str:
    """What was found first decides."""
    if not found:
        return NONE
    return MISSING if found[0].trial.candidate.effect is not None else UNEXPLAINED


def _part(progress: Callable[[float], None], number: int) -> Callable[[float], None]:
    return lambda share: progress((number + share) / THRESHOLDS.most_effects)
