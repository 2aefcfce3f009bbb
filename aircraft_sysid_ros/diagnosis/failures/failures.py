"""Controls and engines that failed in a flight: found, dated, and told from what else it could be.

Of all inputs and hypotheses the one with most evidence is named when it has enough of it, when the error of an axis
falls by as much as any effect must explain, when freezing the input explains clearly more than another constant does at
its own best times, and when what is left of the input's effect in the interval is next to nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.diagnosis.failures.airspeed_step import airspeed_step
from aircraft_sysid_ros.diagnosis.failures.axis_relation import (
    ENGINE,
    relations_of,
    with_bend,
    with_power,
    with_turns,
    without_engine,
)
from aircraft_sysid_ros.diagnosis.failures.failure import Failure, FailureReport, described
from aircraft_sysid_ros.diagnosis.failures.failure_search import BEFORE, FailureSearch, Judged
from aircraft_sysid_ros.diagnosis.failures.force_balance import WIDEST, ForceBalance, force_balance
from aircraft_sysid_ros.diagnosis.failures.interval_search import CONSTANT, FROZEN, NIL, PART
from aircraft_sysid_ros.diagnosis.failures.unrecorded_change import unrecorded_change
from aircraft_sysid_ros.diagnosis.failures.verdict import ENGINE_TIME, dated, is_long_enough, keeps_part, named
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.processes import in_parallel
from aircraft_sysid_ros.samples import Kind, Samples

Array = npt.NDArray[np.float64]

#: Band [Hz] of what an engine does: speed and thrust are slow.
ENGINE_BAND = 1.0
#: Band [Hz] from which a lead of the inputs matters.
QUICK_BAND = 2.0
#: Time constants [s] of an engine that follows its throttle: an electric one at once, a piston engine with its
#: propeller in about one second, a turbofan in some.
SPOOLS = (0.0, 0.5, 1.0, 2.0, 4.0)
#: Leads [s] of the recorded inputs that are tried: commands run ahead of what they move.
LEADS = (0.0, 0.06, 0.12, 0.2)
#: A throttle stands at its lowest within this share of its range; before it was cut it was there so seldom (share).
IDLE, USUALLY_IDLE = 0.02, 0.05
#: Share of its evidence by which an engine that stays at some thrust must be ahead of one that makes none: thrust is no
#: straight line in the throttle, and a dead propeller has a drag. A judgement.
NEARLY_NIL = 0.3
#: Forces that agree with a throttle that was cut: within this time [s], and with this evidence.
CUT_TIME, CUT_EVIDENCE = 3.0, 5.0
#: An engine is asked for thrust where its throttle is, in the mean, above this share of what it is at other times.
ASKED = 0.75
#: ln of the likelihood that the model loses without an input which a flight tells: that of five standard errors.
SHOWN = 12.5
#: From which share on what is meant is most of it.
_MOSTLY = 0.5
#: The angle of flow that each moment rests on.
_ANGLES = {"Cl": "beta", "Cm": "alpha", "Cn": "beta"}


class _Form(NamedTuple):
    """The balances of a flight in one form."""

    balance: ForceBalance
    search: FailureSearch
    least: float  # evidence from which an input is named

    def inputs(self, *, of_thrust: bool) -> list[str]:
        """Inputs that the moments tell of, or those that C_X does."""
        return [name for name in self.search.names if (self.search.axes_of(name) == ["CX"]) == of_thrust]


class _Job(NamedTuple):
    """One input, in one form."""

    form: _Form
    name: str


class _Searched(NamedTuple):
    """What was found of a job."""

    frozen: float  # the most evidence that freezing the input has
    score: float  # ln of the likelihood with the input frozen or as it is, less what numbers cost
    constant: Judged  # the likeliest other constant of its axes
    failure: Failure | None
    unlike: tuple[Failure, Judged] | None  # where it surely does not do what it did, and that is not told as a failure
    is_shown: bool  # whether the flight shows what the input does


def has_vanes(samples: Samples) -> bool:
    """Whether both angles of flow are measured, or the flight consists of manoeuvres, which are short: inputs of others
    are judged by the forces alone.
    """
    kinds = (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
    measured = [np.isfinite(samples.values[samples.kind == kind, 0]).any() for kind in kinds]
    return all(measured) or bool(np.any(samples.kind == Kind.SEAM))


def by_forces(
    aircraft: Aircraft,
    samples: Samples,
    progress: Callable[[float], None] = lambda share: None,
    zero: int | None = None,
) -> FailureReport | None:
    """What forces alone say of the inputs of a flight; None where it has too little for that.

    With vanes the library judges the surfaces. It has no word of an engine whose thrust is not measured. ``zero``:
    stamp [ns] from which times count, those of terms too; None: from the first sample of the IMU.
    """
    try:
        if has_vanes(samples):
            return engine_of(aircraft, samples, zero)
        return failures_of(aircraft, samples, progress, zero)
    except InputError:
        return None


def engine_of(aircraft: Aircraft, samples: Samples, zero: int | None = None) -> FailureReport | None:
    """Look for an engine that failed by C_X alone; None where thrust is measured, or the flight consists of manoeuvres.

    Raises InputError where the flight is too short or lacks a sensor.
    """
    if np.any(samples.kind == Kind.SEAM):
        return None
    forms = _with_spools(aircraft, samples, zero)
    stands_for_thrust = np.isfinite(forms[0].balance.full_thrust).all()  # the throttle does
    if forms[0].search.axes_of(ENGINE) != ["CX"] or not stands_for_thrust:
        return None
    jobs = [_Job(form, ENGINE) for form in forms]
    ((job, searched),) = _likeliest([*zip(jobs, in_parallel(_searched, jobs), strict=True)])
    found = () if searched.failure is None else (searched.failure,)
    shown = frozenset({ENGINE} if searched.is_shown else ())
    return FailureReport(found, None, (), (ENGINE,), shown, ("CX",), {}, job.form.balance)


def failures_of(
    aircraft: Aircraft,
    samples: Samples,
    progress: Callable[[float], None] = lambda share: None,
    zero: int | None = None,
) -> FailureReport:
    """Look for an input that stopped acting, or else for moments that changed without any.

    Raises InputError where the flight is too short or lacks a sensor.
    """
    with_leads = _with_leads(aircraft, samples, zero)
    motion = _best_lead(with_leads, THRESHOLDS.failure_evidence, of_motion=True)
    acceleration = _best_lead(with_leads, THRESHOLDS.acceleration_evidence, of_motion=False)
    jobs = [_Job(form, name) for name in motion.inputs(of_thrust=False) for form in (motion, acceleration)]
    count = len(jobs)
    with_spools = _with_spools(aircraft, samples, zero)
    jobs += [_Job(form, name) for form in with_spools for name in form.inputs(of_thrust=True)]
    found: list[tuple[_Form, Failure]] = []
    evidence: dict[str, float] = {}  # the most that freezing an input has
    constants: list[tuple[_Form, Judged]] = []
    shown: set[str] = set()
    unlike: list[Failure] = []
    results: list[tuple[_Job, _Searched]] = []
    for each in zip(jobs, in_parallel(_searched, jobs), strict=True):
        results.append(each)
        progress(len(results) / len(jobs))
    for job, searched in (*results[:count], *_likeliest(results[count:])):
        evidence[job.name] = max(evidence.get(job.name, -np.inf), searched.frozen)
        constants.append((job.form, searched.constant))
        shown |= {job.name} if searched.is_shown else set()
        if searched.failure is not None:
            found.append((job.form, searched.failure))
        if searched.unlike is not None:
            failure, judged_so = searched.unlike
            if not _is_denied(judged_so, job.form, acceleration if job.form is motion else motion):
                unlike.append(failure)
    found.sort(key=lambda item: -item[1].evidence)
    best = [
        dated(failure, [other for _, other in found[1:]])
        for form, failure in found[:1]
        if failure.recorded or _leads(failure, form, evidence, constants)
    ]
    least = THRESHOLDS.unrecorded_evidence
    sure = [(form, constant) for form, constant in constants if constant.evidence >= least]
    unseen = [(f.search, c) for f, c in sure if _is_unseen(c, motion.balance) and _holds(f, c, least, at_power=True)]
    changed = None if best else unrecorded_change(unseen, float(motion.balance.time[0]))
    judged = tuple(dict.fromkeys(axis for form, name in jobs for axis in form.search.axes_of(name)))
    progress(1.0)
    not_judged = _not_judged(motion.balance, judged)
    unnamed = [] if best or changed is not None else [*unlike, *(f for _, f in found[:1] if f.name != ENGINE)]
    unnamed.sort(key=lambda failure: -failure.evidence)
    report = FailureReport(
        tuple(best), changed, tuple(unnamed), tuple(evidence), frozenset(shown), judged, not_judged, motion.balance
    )
    unclear = report.unclear
    return report if unclear is None else replace(report, airspeed=airspeed_step(samples, unclear.times, zero))


def _searched(job: _Job) -> _Searched:
    """What speaks for an input that is frozen or lost part of its effect, and for another constant of its axes."""
    form, name = job
    tried, constant = _frozen(form.search, name), form.search.best(name, CONSTANT)
    part = None if name == ENGINE else _weakened(form, name, max(tried.score, constant.score))
    failure, unlike = part, None
    for judged in () if part else chain((tried,), _deaf(form, tried)):
        if (sure := _of_input(form, judged)) is None:
            continue
        failed = described(form.balance, form.search, sure)
        if (failure := named(failed, sure, constant)) is not None:
            break
        if name != ENGINE and is_long_enough(failed) and _is_of_input(sure, constant):
            unlike = failed, sure
    if failure is None and name == ENGINE:
        failure = _cut(form.balance)
    evidence = tried.evidence if part is None else part.evidence
    base = sum(form.search.base[axis].log_likelihood for axis in form.search.axes_of(name))
    return _Searched(evidence, max(tried.score, base), constant, failure, unlike, _is_shown(form.search, name))


def _deaf(form: _Form, tried: Judged) -> Iterator[Judged]:
    """That an engine no longer follows its throttle, where ``tried`` is that it makes nothing and explains less.

    Times in which it was told to make little are left out: throttled back it does not show whether it follows.
    """
    if tried.hypothesis.name != ENGINE or tried.hypothesis.kind != NIL:
        return
    search = form.search
    best = search.best(ENGINE, FROZEN)
    (axis,) = search.axes_of(ENGINE)
    values = search.relations[axis].acting[ENGINE].values
    share = best.hypothesis.share(search.count)
    least = ASKED * float(np.average(values, weights=np.clip(1.0 - share, 1e-6, 1.0)))
    asked = [span for span in best.hypothesis.spans if np.mean(values[round(span[0]) : round(span[1])]) > least]
    if not asked:
        return
    (begin, end), *again = asked
    best = search.judged(replace(best.hypothesis, begin=begin, end=end, again=tuple(again)))
    if best.score > tried.score:
        yield best


def _is_shown(search: FailureSearch, name: str) -> bool:
    """Whether the flight tells what an input does: the model without it is surely less likely in one of its axes."""
    for axis in search.axes_of(name):
        fit, relation = search.base[axis], search.relations[axis]
        columns = relation.columns[:, list(relation.acting[name].columns)]
        rest = np.delete(relation.columns, relation.acting[name].columns, axis=1)
        if columns.size and fit.log_likelihood - search.fit(axis, rest, fit.filtering).log_likelihood > SHOWN:
            return True
    return False


def _weakened(form: _Form, name: str, others: float) -> Failure | None:
    """An input that kept part of its effect; ``others``: the best score of what else it could be."""
    best = form.search.best(name, PART)
    if best.evidence < THRESHOLDS.part_evidence or best.score < others + THRESHOLDS.failure_lead:
        return None
    if not _holds(form, best, THRESHOLDS.part_evidence):
        return None
    failure = described(form.balance, form.search, best)
    return failure if keeps_part(failure) else None


def _holds(form: _Form, judged: Judged, least: float, *, at_power: bool = False) -> bool:
    """Whether a hypothesis has its evidence between its times, and where the model may be wrong as models are.

    Of 64 clean flights eight had a control that seemed to fail. Three began or ended in a doublet, of which they made
    another time; most of the others were as long as a turn, and steady turns may be unlike quick motion. What kept part
    of its effect may do more to one side, or when it is large: an aileron that deflected twice as far up as down seemed
    to keep half of its effect whenever it was moved the other way (JSBSim, a log of commands). What comes several times
    has more begins and ends: between them it must have all of its evidence, 1.3 to 40 times that where a control failed
    and 0.9 times in a clean flight of JSBSim, whose turns it followed. ``at_power``: and it must not come with the
    throttle, as a rolling moment of JSBSim's F-4 does.
    """
    hypothesis, search = judged.hypothesis, form.search
    if search.inside(hypothesis) < (max(least, judged.evidence) if hypothesis.again else least):
        return False
    relations = {axis: with_turns(search.relations[axis], form.balance) for axis in search.axes_of(hypothesis.name)}
    if at_power:
        relations = {axis: with_power(r, form.balance) for axis, r in relations.items()}
    if hypothesis.kind == PART:
        relations = {axis: with_bend(r, hypothesis.name, form.balance) for axis, r in relations.items()}
    return FailureSearch(relations, search.step).judged(hypothesis).evidence >= least


def _leads(
    failure: Failure, own_form: _Form, evidence: Mapping[str, float], constants: Iterable[tuple[_Form, Judged]]
) -> bool:
    """Whether nothing else happened that is clearly likelier: another input frozen, or another constant of any axes.

    What is clearest and is no input that failed has consequences in other axes, and these would get a name. In its own
    axes and form the input has been found likelier than a constant.
    """
    own = max(failure.evidence, evidence[failure.name]) + THRESHOLDS.failure_lead
    if max((value for name, value in evidence.items() if name != failure.name), default=-np.inf) > own:
        return False
    return all(
        constant.evidence <= own and not _came_with(failure, form, constant)
        for form, constant in constants
        if form is not own_form or constant.gains.keys() != failure.gains.keys()
    )


def _came_with(failure: Failure, form: _Form, constant: Judged) -> bool:
    """Whether a yawing moment came with a failure of the ailerons, which do not make it.

    A rudder that stands aside yaws, and the ailerons that hold the bank against it do nothing that the roll shows: they
    had been stuck (J3 Cub of JSBSim, seeds 10780001 and 10780007 of missions.py). Of ten ailerons that failed there and
    were named none had such a moment.
    """
    axis = constant.main_axis
    if failure.name != "da" or axis != "Cn" or constant.evidence < THRESHOLDS.failure_evidence:
        return False
    if failure.gains.get(axis, 0.0) > _MOSTLY * constant.gains[axis]:
        return False
    time = form.balance.time
    ends = [(times.begin, np.inf if times.end is None else times.end) for times in failure.times]
    failed = np.any([(time >= begin) & (time <= end) for begin, end in ends], axis=0)
    if failed.all() or not failed.any():
        return False
    share = constant.hypothesis.share(form.search.count)
    return float(np.mean(share[failed])) > _MOSTLY > float(np.mean(share[~failed]))


def _is_unseen(constant: Judged, balance: ForceBalance) -> bool:
    """Whether it is a moment of an axis whose angle no vane measures: the library has no name there."""
    axis = constant.main_axis
    return axis in _ANGLES and _ANGLES[axis] not in balance.angles


def _with_leads(aircraft: Aircraft, samples: Samples, zero: int | None) -> list[ForceBalance]:
    """The flight with the inputs later by each of LEADS."""
    balances = []
    for lead in LEADS:
        balances.append(force_balance(aircraft, samples, WIDEST, lead, zero=zero))
        if balances[0].band < QUICK_BAND:  # a tenth of a second is nothing there
            break
    return balances


def _with_spools(aircraft: Aircraft, samples: Samples, zero: int | None) -> list[_Form]:
    """The flight in the band of what an engine does, which follows its throttle as slowly as each of SPOOLS.

    The thrust of a jet came 5 s after the throttle: a lost engine that came back, in a clean flight (JSBSim, a 737).
    """
    forms = []
    for spool in SPOOLS:
        balance = force_balance(aircraft, samples, ENGINE_BAND, spool=spool, zero=zero)
        forms.append(_Form(balance, FailureSearch(relations_of(balance), balance.step), THRESHOLDS.failure_evidence))
        if ENGINE not in forms[0].search.names:
            break
    return forms


def _likeliest(searched: Sequence[tuple[_Job, _Searched]]) -> list[tuple[_Job, _Searched]]:
    """Of the forms of each input that under which the flight is likeliest, with a failure or without one."""
    names = dict.fromkeys(job.name for job, _ in searched)
    return [max((each for each in searched if each[0].name == name), key=lambda each: each[1].score) for name in names]


def _best_lead(balances: Iterable[ForceBalance], least: float, *, of_motion: bool) -> _Form:
    """The flight with the inputs as much later as suits its moments best."""
    tried = []
    for balance in balances:
        relations = relations_of(balance, of_motion=of_motion)
        if not relations:
            raise InputError("no axis of the model reads a signal that this flight has: name its inputs in the model")
        search = FailureSearch(relations, balance.step)
        moments = [axis for axis in search.base if axis in ("Cl", "Cm", "Cn")]
        errors = [np.log(np.std(search.base[a].residual) / np.std(relations[a].response)) for a in moments]
        tried.append((sum(errors), _Form(balance, search, least)))
    return min(tried, key=lambda item: item[0])[1]


def _frozen(search: FailureSearch, name: str) -> Judged:
    """The best that an input that stopped acting explains."""
    kinds = (NIL, FROZEN) if search.axes_of(name) == ["CX"] and name == ENGINE else (FROZEN,)
    tried = {kind: search.best(name, kind) for kind in kinds}
    best = max(tried.values(), key=lambda judged: judged.score)
    near = max(THRESHOLDS.failure_lead, NEARLY_NIL * best.evidence)
    if NIL in tried and tried[NIL].score > best.score - near:
        best = tried[NIL]  # explains alike, with fewer numbers
    return best


def _of_input(form: _Form, best: Judged) -> Judged | None:
    """That one input is frozen, by the best that this explains, where it is sure."""
    if best.evidence < form.least:
        return None
    best = best if best.hypothesis.name == ENGINE else form.search.held(best)
    return None if best.evidence < form.least or not _holds(form, best, form.least) else best


def _is_of_input(sure: Judged, constant: Judged) -> bool:
    """Whether an input that does not do what it did says more of a flight than another constant of the same axes does.

    In 25 minutes of trimmed flight a landing gear that went down and up had the elevator answer no more: it moved to
    hold the trim, and no moment came of it. That it was frozen to the end had an evidence of 1427, the moment of the
    gear 2637, and the right times (seed 2102 of trimmed_jet.py, without thrust and GPS velocity).
    """
    return sure.evidence > constant.evidence


def _is_denied(sure: Judged, form: _Form, other: _Form) -> bool:
    """Whether the other form of the balances has an input act where this one has it that it does not.

    Of a Cessna at 10 Hz that flew straight for 137 s and then turned (JSBSim, seed 11050007 of missions.py) the rolling
    acceleration, which is mostly noise there, had ailerons that no longer act, with an evidence of 89; by the roll rate
    that follows them it was 81 less likely than that they do.
    """
    if other.search.count != form.search.count:
        return False
    return sure.evidence + sum(other.search.judged(sure.hypothesis).gains.values()) < form.least


def _cut(balance: ForceBalance) -> Failure | None:
    """Thrust that is gone for the rest of the flight with the throttle, while the aeroplane would need it.

    Such a throttle stands at its lowest, where it hardly ever was, and the aeroplane is slower than it ever was: who
    flies would not have it so. When it began is told by the forces alone.
    """
    throttle, speed = balance.signal("throttle"), balance.signal("V")
    if not np.isfinite(throttle).all():
        return None
    idle = throttle <= throttle.min() + IDLE * np.ptp(throttle)
    begin = len(idle) - int(np.argmin(idle[::-1])) if not idle.all() else 0
    before, after = slice(0, begin), slice(begin, None)
    if begin < BEFORE * len(idle) or (len(idle) - begin) * balance.step < ENGINE_TIME:
        return None
    slower = float(np.median(speed[after][-(len(idle) - begin) // 2 :])) < float(np.quantile(speed[before], 0.02))
    if not slower or float(np.mean(idle[before])) > USUALLY_IDLE:
        return None
    search = FailureSearch({"CX": without_engine(balance)}, balance.step)
    best = search.best(ENGINE, CONSTANT)
    failure = described(balance, search, best)
    step = float(search.fitted("CX", best.hypothesis).parameters[-1])
    lost = best.evidence > CUT_EVIDENCE and best.hypothesis.lasts(search.count) and step < 0.0
    if not lost or abs(best.hypothesis.begin - begin) * balance.step > CUT_TIME:
        return None
    return replace(failure, level=0.0, left=0.0, left_std=0.0, recorded=True)


def _not_judged(balance: ForceBalance, judged: tuple[str, ...]) -> dict[str, str]:
    """Axes of which nothing can be said, and why."""
    reasons = {}
    for axis, angle, vane in (("CZ", "alpha", "angle of attack"), ("CY", "beta", "sideslip")):
        if angle not in balance.angles:
            reasons[axis] = f"no vane measures the {vane}: {axis[0]}_{axis[1]} is used instead"
    for axis in ("CX", "Cl", "Cm", "Cn"):
        if axis not in judged:
            engine = "it shows the engine, and no throttle or thrust that moves is measured"
            reasons[axis] = engine if axis == "CX" else "its terms read no input that moves in this flight"
    return reasons
