"""Controls and engines that failed in a flight: found, dated, and told from what else it could be.

Of all inputs and hypotheses the one with most evidence is named when it has enough of it, when the error of an axis
falls by as much as any effect must explain, when freezing the input explains clearly more than another constant does at
its own best times, and when what is left of the input's effect in the interval is next to nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.diagnosis.failures.axis_relation import (
    ENGINE,
    Acting,
    relations_of,
    with_bend,
    with_turns,
    without_engine,
)
from aircraft_sysid_ros.diagnosis.failures.episode import Episode, Times, times_of
from aircraft_sysid_ros.diagnosis.failures.failure_search import BEFORE, FailureSearch, Judged, columns_of
from aircraft_sysid_ros.diagnosis.failures.force_balance import WIDEST, ForceBalance, force_balance
from aircraft_sysid_ros.diagnosis.failures.held_out import held_out_errors
from aircraft_sysid_ros.diagnosis.failures.interval_search import CONSTANT, FROZEN, HELD, NIL, PART
from aircraft_sysid_ros.diagnosis.failures.unrecorded_change import UnrecordedChange, unrecorded_change
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.processes import in_parallel
from aircraft_sysid_ros.samples import Kind, Samples

Array = npt.NDArray[np.float64]

#: Band [Hz] of what an engine does: speed and thrust are slow.
ENGINE_BAND = 1.0
#: Band [Hz] from which a lead of the inputs matters.
QUICK_BAND = 2.0
#: Leads [s] of the recorded inputs that are tried: commands run ahead of what they move.
LEADS = (0.0, 0.06, 0.12, 0.2)
#: Share of its effect that an input may keep, by estimate and with two standard errors, to be called stuck.
MOST_LEFT, MOST_LEFT_AT_ALL = 0.35, 0.7
#: Share of the usual thrust below which it is called lost, and of what the throttle does up to which it is.
THRUST_LEFT, THROTTLE_LEFT = 0.35, 0.5
#: Shortest time [s] without thrust, and without a surface: what is shorter may be a manoeuvre. In a clean flight
#: (failure_flights.py, seed 8700007) an elevator had seemed to be held for the 3 s before it pushed.
ENGINE_TIME, SURFACE_TIME = 8.0, 6.0
#: Moments in which a surface that is told to be far from where it stays is seen for a shorter time all the same, and
#: the evidence of each: in one, an aeroplane that stalls does not answer either.
SHORT_AXES, SHORT_EVIDENCE = 2, 30.0
#: Share of its effect that an input keeps which lost part of it, with two standard errors to either side.
LEAST_PART, MOST_PART = 0.15, 0.75
#: A throttle stands at its lowest within this share of its range; before it was cut it was there so seldom (share).
IDLE, USUALLY_IDLE = 0.02, 0.05
#: Forces that agree with a throttle that was cut: within this time [s], and with this evidence.
CUT_TIME, CUT_EVIDENCE = 3.0, 5.0
#: Or so many of its usual standard deviations away from where it stays an input must have been told to be.
FAR = 3.0
#: Share of its usual motion that an input must be told to make meanwhile: less may be the noise of its record, which no
#: aeroplane answers. In the quiet hours of a jet at 10 Hz (benchmarks/trimmed_jet.py, seeds 437 and 448, on which this
#: was made) ailerons that moved by an eighth seemed to be stuck.
LEAST_MOTION = 0.25
#: ln of the likelihood that the model loses without an input which a flight tells: that of five standard errors.
SHOWN = 12.5
#: Share of the evidence from which the other form of a balance is as telling of a time.
AS_TELLING = 0.5
#: The angle of flow that each moment rests on.
_ANGLES = {"Cl": "beta", "Cm": "alpha", "Cn": "beta"}


@dataclass(frozen=True, kw_only=True)
class Failure(Episode):
    """One input that stopped acting, or that lost part of its effect."""

    name: str  # of the input, or ENGINE
    kind: str
    left: float  # share of its effect that the input keeps
    left_std: float
    level: float  # at which the input seems to stay; of an engine as a share of what was asked for
    asked: float  # what was recorded meanwhile, the mean
    usual: float  # standard deviation of the input at other times
    moved: float  # and meanwhile
    recorded: bool = False  # the recorded input says so itself: the throttle was cut
    rivals: tuple[str, ...] = ()  # what explains it nearly as well

    @property
    def is_loss_of_thrust(self) -> bool:
        """The engine makes nothing."""
        return self.name == ENGINE and not self.level > THRUST_LEFT


@dataclass(frozen=True)
class FailureReport:
    """What the forces of a flight say of its inputs."""

    found: tuple[Failure, ...]  # one at most
    changed: UnrecordedChange | None  # where no input that failed is named
    unlike: tuple[Failure, ...]  # inputs that surely do not do the same throughout, where neither is: how is not told
    tried: tuple[str, ...]  # inputs
    shown: frozenset[str]  # those of them whose effect this flight shows, so that a failure would be seen
    judged: tuple[str, ...]  # axes
    not_judged: dict[str, str]  # axes, and why
    balance: ForceBalance = field(repr=False)

    @property
    def says_something(self) -> bool:
        """Whether anything failed or changed."""
        return bool(self.found) or self.changed is not None or self.unexplained is not None

    @property
    def unexplained(self) -> Failure | None:
        """An input that does something else from one time on to the end of the flight, as what breaks does.

        What is over again is no verdict: of 24 clean flights (JSBSim) four had that, in turns and manoeuvres.
        """
        lasting = [failure for failure in self.unlike if [times.end for times in failure.times] == [None]]
        return next((failure for failure in lasting if failure.size >= THRESHOLDS.unrecorded_size), None)


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
    constant: Judged  # the likeliest other constant of its axes
    failure: Failure | None
    unlike: Failure | None  # where it surely does not do what it did, and that is not told as a failure
    is_shown: bool  # whether the flight shows what the input does


def has_vanes(samples: Samples) -> bool:
    """Whether both angles of flow are measured, or the flight consists of manoeuvres, which are short: inputs of others
    are judged by the forces alone.
    """
    kinds = (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
    measured = [np.isfinite(samples.values[samples.kind == kind, 0]).any() for kind in kinds]
    return all(measured) or bool(np.any(samples.kind == Kind.SEAM))


def by_forces(
    aircraft: Aircraft, samples: Samples, progress: Callable[[float], None] = lambda share: None
) -> FailureReport | None:
    """What forces alone say of the inputs of a flight; None where it has too little for that.

    With vanes the library judges the surfaces. It has no word of an engine whose thrust is not measured.
    """
    try:
        return engine_of(aircraft, samples) if has_vanes(samples) else failures_of(aircraft, samples, progress)
    except InputError:
        return None


def engine_of(aircraft: Aircraft, samples: Samples) -> FailureReport | None:
    """Look for an engine that failed by C_X alone; None where thrust is measured, or the flight consists of manoeuvres.

    Raises InputError where the flight is too short or lacks a sensor.
    """
    if np.any(samples.kind == Kind.SEAM):
        return None
    balance = force_balance(aircraft, samples, ENGINE_BAND)
    relation = relations_of(balance).get("CX")
    stands_for_thrust = np.isfinite(balance.full_thrust).all()  # the throttle does
    if relation is None or ENGINE not in relation.acting or not stands_for_thrust:
        return None
    form = _Form(balance, FailureSearch({"CX": relation}, balance.step), THRESHOLDS.failure_evidence)
    searched = _searched(_Job(form, ENGINE))
    found = () if searched.failure is None else (searched.failure,)
    shown = frozenset({ENGINE} if searched.is_shown else ())
    return FailureReport(found, None, (), (ENGINE,), shown, ("CX",), {}, balance)


def failures_of(
    aircraft: Aircraft, samples: Samples, progress: Callable[[float], None] = lambda share: None
) -> FailureReport:
    """Look for an input that stopped acting, or else for moments that changed without any.

    Raises InputError where the flight is too short or lacks a sensor.
    """
    with_leads = _with_leads(aircraft, samples)
    motion = _best_lead(with_leads, THRESHOLDS.failure_evidence, of_motion=True)
    acceleration = _best_lead(with_leads, THRESHOLDS.acceleration_evidence, of_motion=False)
    slow = force_balance(aircraft, samples, ENGINE_BAND)
    engine = _Form(slow, FailureSearch(relations_of(slow), slow.step), THRESHOLDS.failure_evidence)
    jobs = [_Job(form, name) for name in motion.inputs(of_thrust=False) for form in (motion, acceleration)]
    jobs += [_Job(engine, name) for name in engine.inputs(of_thrust=True)]
    found: list[tuple[_Form, Failure]] = []
    evidence: dict[str, float] = {}  # the most that freezing an input has
    constants: list[tuple[_Form, Judged]] = []
    shown: set[str] = set()
    unlike: list[Failure] = []
    for number, (job, searched) in enumerate(zip(jobs, in_parallel(_searched, jobs), strict=True), 1):
        progress(number / len(jobs))
        evidence[job.name] = max(evidence.get(job.name, -np.inf), searched.frozen)
        constants.append((job.form, searched.constant))
        shown |= {job.name} if searched.is_shown else set()
        if searched.failure is not None:
            found.append((job.form, searched.failure))
        if searched.unlike is not None:
            unlike.append(searched.unlike)
    found.sort(key=lambda item: -item[1].evidence)
    best = [
        _dated(failure, [other for _, other in found[1:]])
        for form, failure in found[:1]
        if failure.recorded or _leads(failure, form, evidence, constants)
    ]
    least = THRESHOLDS.unrecorded_evidence
    sure = [(form, constant) for form, constant in constants if constant.evidence >= least]
    unseen = [(f.search, c) for f, c in sure if _is_unseen(c, motion.balance) and _holds(f, c, least)]
    changed = None if best else unrecorded_change(unseen, float(motion.balance.time[0]))
    judged = tuple(dict.fromkeys(axis for form, name in jobs for axis in form.search.axes_of(name)))
    progress(1.0)
    not_judged = _not_judged(motion.balance, judged)
    unnamed = [] if best or changed is not None else [*unlike, *(f for _, f in found[:1] if f.name != ENGINE)]
    unnamed.sort(key=lambda failure: -failure.evidence)
    return FailureReport(
        tuple(best), changed, tuple(unnamed), tuple(evidence), frozenset(shown), judged, not_judged, motion.balance
    )


def _searched(job: _Job) -> _Searched:
    """What speaks for an input that is frozen or lost part of its effect, and for another constant of its axes."""
    form, name = job
    tried, constant = _frozen(form.search, name), form.search.best(name, CONSTANT)
    part = None if name == ENGINE else _weakened(form, name, max(tried.score, constant.score))
    failure, unlike = part, None
    sure = None if part else _of_input(form, tried)
    if sure is not None:
        described = _described(form.balance, form.search, sure)
        failure = _named(described, sure, constant)
        if failure is None and name != ENGINE and _is_long_enough(described):
            unlike = described
    if failure is None and name == ENGINE:
        failure = _cut(form.balance)
    evidence = tried.evidence if part is None else part.evidence
    return _Searched(evidence, constant, failure, unlike, _is_shown(form.search, name))


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
    failure = _described(form.balance, form.search, best)
    low, high = failure.left - 2.0 * failure.left_std, failure.left + 2.0 * failure.left_std
    told = low > LEAST_PART and high < MOST_PART and failure.moved >= LEAST_MOTION * failure.usual
    return failure if told and failure.size >= THRESHOLDS.size and _is_long_enough(failure) else None


def _holds(form: _Form, judged: Judged, least: float) -> bool:
    """Whether a hypothesis has its evidence between its times, and where the model may be wrong as models are.

    Of 64 clean flights eight had a control that seemed to fail. Three began or ended in a doublet, of which they made
    another time; most of the others were as long as a turn, and steady turns may be unlike quick motion. What kept part
    of its effect may do more to one side, or when it is large: an aileron that deflected twice as far up as down seemed
    to keep half of its effect whenever it was moved the other way (JSBSim, a log of commands).
    """
    hypothesis, search = judged.hypothesis, form.search
    if search.inside(hypothesis) < least:
        return False
    relations = {axis: with_turns(search.relations[axis], form.balance) for axis in search.axes_of(hypothesis.name)}
    if hypothesis.kind == PART:
        relations = {axis: with_bend(r, hypothesis.name, form.balance) for axis, r in relations.items()}
    return FailureSearch(relations, search.step).judged(hypothesis).evidence >= least


def _is_long_enough(failure: Failure) -> bool:
    """Whether it lasts longer than a manoeuvre, or several moments tell that a surface did not follow one."""
    least = ENGINE_TIME if failure.name == ENGINE else SURFACE_TIME
    if any(times.end is None or times.end - times.begin > least for times in failure.times):
        return True
    told = sum(gain > SHORT_EVIDENCE for gain in failure.gains.values())
    return failure.name != ENGINE and _is_far(failure) and told >= SHORT_AXES


def _is_far(failure: Failure) -> bool:
    """Whether an input was told to be far from where it stays."""
    return abs(failure.asked - failure.level) > FAR * failure.usual


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
        constant.evidence <= own
        for form, constant in constants
        if form is not own_form or constant.gains.keys() != failure.gains.keys()
    )


def _dated(failure: Failure, others: Iterable[Failure]) -> Failure:
    """With times whose errors hold what the other form of the balance says of the input, where it is as telling."""
    for other in (o for o in others if o.name == failure.name and o.evidence > AS_TELLING * failure.evidence):
        if len(other.times) == len(failure.times):
            pairs = zip(failure.times, other.times, strict=True)
            failure = replace(failure, times=tuple(_agreeing(times, others) for times, others in pairs))
    return failure


def _agreeing(times: Times, other: Times) -> Times:
    """Times whose errors hold another look at them."""
    times = times._replace(begin_error=max(times.begin_error, abs(other.begin - times.begin)))
    if times.end is None or other.end is None:
        return times
    return times._replace(end_error=max(times.end_error, abs(other.end - times.end)))


def _is_unseen(constant: Judged, balance: ForceBalance) -> bool:
    """Whether it is a moment of an axis whose angle no vane measures: the library has no name there."""
    axis = max(constant.gains, key=lambda a: constant.gains[a])
    return axis in _ANGLES and _ANGLES[axis] not in balance.angles


def _with_leads(aircraft: Aircraft, samples: Samples) -> list[ForceBalance]:
    """The flight with the inputs later by each of LEADS."""
    balances = []
    for lead in LEADS:
        balances.append(force_balance(aircraft, samples, WIDEST, lead))
        if balances[0].band < QUICK_BAND:  # a tenth of a second is nothing there
            break
    return balances


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
    if NIL in tried and tried[NIL].score > best.score - THRESHOLDS.failure_lead:
        best = tried[NIL]  # explains alike, with fewer numbers
    return best


def _of_input(form: _Form, best: Judged) -> Judged | None:
    """That one input is frozen, by the best that this explains, where it is sure."""
    if best.evidence < form.least:
        return None
    best = best if best.hypothesis.name == ENGINE else form.search.held(best)
    return None if best.evidence < form.least or not _holds(form, best, form.least) else best


def _named(failure: Failure, sure: Judged, constant: Judged) -> Failure | None:
    """What is sure of an input, with what else it could be, if it is enough to be named.

    ``constant``: the best that another constant of the same axes explains.
    """
    if failure.size < THRESHOLDS.size or not _is_told(failure, sure.score - constant.score):
        return None
    return replace(failure, rivals=_rivals(failure, sure, constant))


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
    failure = _described(balance, search, best)
    step = float(search.fitted("CX", best.hypothesis).parameters[-1])
    lost = best.evidence > CUT_EVIDENCE and best.hypothesis.lasts(search.count) and step < 0.0
    if not lost or abs(best.hypothesis.begin - begin) * balance.step > CUT_TIME:
        return None
    return replace(failure, level=0.0, left=0.0, left_std=0.0, recorded=True)


def _rivals(failure: Failure, best: Judged, constant: Judged) -> tuple[str, ...]:
    """What explains the flight nearly as well."""
    if constant.score < best.score - THRESHOLDS.failure_lead:
        return ()
    return ("landing_gear", "parameter_change") if failure.name == ENGINE else ("parameter_change",)


def _is_told(failure: Failure, ahead: float) -> bool:
    """Whether it is the input, and not another constant in the same axes that is ``ahead`` in ln of the likelihood."""
    if failure.name == ENGINE:
        lost = failure.is_loss_of_thrust and failure.left < THROTTLE_LEFT and ahead > -THRESHOLDS.failure_lead
        return lost and _is_long_enough(failure)
    if not _is_long_enough(failure):
        return False
    gone = abs(failure.left) < MOST_LEFT and failure.left + 2.0 * failure.left_std < MOST_LEFT_AT_ALL
    shown = failure.moved >= LEAST_MOTION * failure.usual
    is_there = failure.left - 2.0 * failure.left_std > MOST_LEFT  # it acts, and does so surely
    return ((gone and shown) or (_is_far(failure) and not is_there)) and ahead > 0.0


def _described(balance: ForceBalance, search: FailureSearch, judged: Judged) -> Failure:
    """A hypothesis in numbers, those of the axis that it explains most of."""
    hypothesis = judged.hypothesis
    axis = max(judged.gains, key=lambda a: judged.gains[a])
    relation, failed = search.relations[axis], hypothesis.share(search.count)
    acting = relation.acting[hypothesis.name]
    at, fitted = list(acting.columns), search.fitted(axis, hypothesis)
    is_part = hypothesis.kind == PART
    still = acting.idle if hypothesis.kind == NIL else acting.frozen
    asked = float(np.sum(failed * acting.values) / np.sum(failed))
    usual, moved = (
        float(np.sqrt(np.cov(acting.values, aweights=np.clip(share, 1e-6, 1.0)))) for share in (1.0 - failed, failed)
    )
    moving = failed * ((relation.columns[:, at] - still) @ fitted.parameters[at])
    columns = relation.columns if is_part else columns_of(relation, hypothesis)
    constant = [failed * acting.per_unit[:, 0]] if is_part else []
    with_rest = search.fit(axis, np.column_stack([columns, *constant, moving]))
    errors = {a: held_out_errors(search, hypothesis, a) for a in judged.gains}
    before, after = errors[axis]
    level = _level(judged, acting, asked, failed, fitted.parameters)
    return Failure(
        name=hypothesis.name, kind=hypothesis.kind, times=times_of(search, judged, float(balance.time[0])),
        evidence=judged.evidence, gains=dict(judged.gains), main_axis=axis, size=1.0 - after / before,
        errors=errors, left=float(is_part + with_rest.parameters[-1]),
        left_std=float(with_rest.std[-1]), level=level, asked=asked, usual=usual, moved=moved,
    )  # fmt: skip


def _level(judged: Judged, acting: Acting, asked: float, failed: Array, parameters: Array) -> float:
    """Where the input seems to stay; of an engine as a share of what the throttle asked for."""
    if judged.hypothesis.kind == NIL:
        return 0.0
    if judged.hypothesis.kind == HELD:
        return judged.hypothesis.level
    effect = float(failed @ acting.per_unit @ parameters[list(acting.columns)]) if acting.columns else 0.0
    if effect == 0.0 or not asked > 0.0:
        return np.nan
    return (acting.mean + float(parameters[-1]) * float(failed @ acting.per_unit[:, 0]) / effect) / asked


def _not_judged(balance: ForceBalance, judged: tuple[str, ...]) -> dict[str, str]:
    """Axes of which nothing can be said, and why."""
    reasons = {}
    for axis, angle, vane in (("CZ", "alpha", "angle of attack"), ("CY", "beta", "sideslip")):
        if angle not in balance.angles:
            reasons[axis] = f"no vane measures the {vane}: {axis[0]}_{axis[1]} stands for it"
    for axis in ("CX", "Cl", "Cm", "Cn"):
        if axis not in judged:
            engine = "it tells of the engine, and no throttle or thrust that moves is measured"
            reasons[axis] = engine if axis == "CX" else "its terms read no input that moves in this flight"
    return reasons
