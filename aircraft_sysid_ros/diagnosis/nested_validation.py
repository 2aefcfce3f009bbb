"""The error on flight that nothing was chosen on.

A held-out error is one of coefficients that were learnt elsewhere. Which effect it is, and its inner numbers (the onset
of a stall, the moment of a change), were chosen by that error, on all of the flight. So everything is chosen once more
without every fourth block of time (of several runs without every fourth run), and what is chosen then predicts those
blocks: nested validation (Stone 1974).

A change happens once: without the blocks in which it begins or ends its times are not known to better than a block, and
the blocks beside them would be predicted as if it had not happened yet. These blocks are learnt from and not judged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.finding import Finding, NestedValidation
from aircraft_sysid_ros.diagnosis.flight.flight_data import BLOCK, FOLDS, FlightData
from aircraft_sysid_ros.diagnosis.search.candidates import Candidate
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.processes import in_parallel

#: What is chosen on a flight of which a part has no measured coefficients.
Choice = Callable[[CandidateEvaluator], Finding | None]

#: A time of change is known to so much [s]: where a border of a block is nearer, both blocks hold it.
_NEAR = 1.0


def nested_validation(finding: Finding, bench: CandidateEvaluator, choice: Choice) -> NestedValidation:
    """What ``choice`` names in three quarters of a flight in the place of a finding; how that predicts the fourth."""
    judging, axis = bench.judging(finding.trial.candidate), finding.trial.main_axis
    data, held = judging.data, _held_blocks(judging.data, finding.trial.candidate)
    apart = ~np.isin(data.block, held)

    def chosen(part: int) -> Candidate | None:
        hidden = apart & (data.fold % FOLDS == part)
        measured = np.where(hidden[:, None], np.nan, data.measured)
        try:
            found = choice(CandidateEvaluator(replace(data, measured=measured), shapes=judging.shapes))
        except InputError:  # all that tells this axis is in that part
            return None
        return None if found is None else found.trial.candidate

    parts = np.unique(data.fold[apart] % FOLDS).tolist()
    candidates = list(in_parallel(chosen, parts))
    names = tuple("" if each is None else each.family for each in candidates)
    left = _share_left(judging, axis, zip(parts, candidates, strict=True), held)
    return NestedValidation(names, judging.fits[axis].nrmse_held_out * left)


def _held_blocks(data: FlightData, candidate: Candidate) -> npt.NDArray[np.int64]:
    """Blocks in which a change begins, is complete, or ends."""
    times = np.array(candidate.moments) - data.begin
    return np.unique(np.floor((times[:, None] + [-_NEAR, _NEAR]) / BLOCK).astype(np.int64))


def _share_left(
    bench: CandidateEvaluator, axis: str, chosen: Iterable[tuple[int, Candidate | None]], held: npt.NDArray[np.int64]
) -> float:
    """Share of the held-out error of an axis that is left where each part is predicted with what was chosen for it."""
    before = after = 0.0
    for part, candidate in chosen:
        trial = None if candidate is None else bench.trial(candidate)
        gain = None if trial is None else trial.gains.get(axis)
        fit = bench.fits[axis] if gain is None else gain.fit
        inside = (fit.fold % FOLDS == part) & ~np.isin(fit.blocks, held)
        before += float(np.sum(fit.held_out_sse[inside]))
        after += float(np.sum((fit.held_out_sse if gain is None else gain.after)[inside]))
    return float(np.sqrt(after / before)) if before > 0.0 else 1.0
