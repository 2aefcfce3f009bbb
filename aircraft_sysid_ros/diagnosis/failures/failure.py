"""A control or an engine that failed in a flight, in numbers, and what is said of all of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.failures.airspeed_step import AirspeedStep
from aircraft_sysid_ros.diagnosis.failures.axis_relation import ENGINE, Acting
from aircraft_sysid_ros.diagnosis.failures.episode import Episode, times_of
from aircraft_sysid_ros.diagnosis.failures.failure_search import FailureSearch, Judged, columns_of
from aircraft_sysid_ros.diagnosis.failures.force_balance import ForceBalance
from aircraft_sysid_ros.diagnosis.failures.held_out import held_out_errors
from aircraft_sysid_ros.diagnosis.failures.interval_search import FROZEN, HELD, NIL, PART
from aircraft_sysid_ros.diagnosis.failures.unrecorded_change import UnrecordedChange
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS

Array = npt.NDArray[np.float64]

#: Share of the usual thrust below which it is called lost.
THRUST_LEFT = 0.35
#: Or below the first share where what the throttle still does in the forces is surely less than the second: of a
#: propeller in flight thrust is none at a throttle of 0.4 or so, and a line through what was flown above that has 0
#: elsewhere. In eight clean flights of a stranger such an engine seemed to stay at 0.84 of what was asked for at least.
DEAF_LEVEL, DEAF_LEFT = 0.6, 0.35
#: Share of its usual motion that an input must be told to make meanwhile: less may be the noise of its record, which no
#: aeroplane answers. In the quiet hours of a jet at 10 Hz (benchmarks/trimmed_jet.py, seeds 437 and 448, on which this
#: was made) ailerons that moved by an eighth seemed to be stuck.
LEAST_MOTION = 0.25
#: An engine is asked for thrust where its throttle is above this share of what it is at other times, the mean.
HALF = 0.5


@dataclass(frozen=True, kw_only=True)
class Failure(Episode):
    """One input that stopped acting, or that lost part of its effect."""

    name: str  # of the input, or ENGINE
    kind: str
    left: float  # share of its effect that the input keeps
    left_std: float
    level: float  # at which the input seems to stay; of an engine as a share of what was asked for
    asked: float  # what was recorded meanwhile, the mean
    asked_for: float  # [s] of one of its times in which it was told to do more than half of what it does elsewhere
    usual: float  # standard deviation of the input at other times
    moved: float  # and meanwhile
    beyond: float  # of PART: how far beyond its travel it would be what it keeps its share about, over the travel
    recorded: bool = False  # the recorded input says so itself: the throttle was cut
    rivals: tuple[str, ...] = ()  # what explains it nearly as well

    @property
    def is_loss_of_thrust(self) -> bool:
        """The engine makes nothing, as far as the forces tell."""
        return self.name == ENGINE and (self.is_deaf or not self.level > THRUST_LEFT)

    @property
    def is_deaf(self) -> bool:
        """The engine surely no longer follows its throttle, and makes less than it was asked for."""
        follows_no_more = self.left + 2.0 * self.left_std < DEAF_LEFT and self.moved >= LEAST_MOTION * self.usual
        return self.name == ENGINE and self.kind == FROZEN and self.level < DEAF_LEVEL and follows_no_more


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
    #: What the airspeed reads where what is ``unclear`` is: that is told in its place.
    airspeed: AirspeedStep | None = None

    @property
    def says_something(self) -> bool:
        """Whether anything failed or changed."""
        return bool(self.found) or self.changed is not None or self.unexplained is not None

    @property
    def unclear(self) -> Episode | None:
        """What changed without a name: a moment, or what an input does."""
        return self.changed if self.changed is not None else self.unexplained

    @property
    def unexplained(self) -> Failure | None:
        """An input that does something else from one time on to the end of the flight, as what breaks does.

        What is over again is no verdict: of 24 clean flights (JSBSim) four had that, in turns and manoeuvres.
        """
        lasting = [failure for failure in self.unlike if [times.end for times in failure.times] == [None]]
        return next((failure for failure in lasting if failure.size >= THRESHOLDS.unrecorded_size), None)


def described(balance: ForceBalance, search: FailureSearch, judged: Judged) -> Failure:
    """A hypothesis in numbers, those of the axis that it explains most of."""
    hypothesis = judged.hypothesis
    axis = judged.main_axis
    relation, failed = search.relations[axis], hypothesis.share(search.count)
    acting = relation.acting[hypothesis.name]
    at, fitted = list(acting.columns), search.fitted(axis, hypothesis)
    is_part = hypothesis.kind == PART
    still = acting.idle if hypothesis.kind == NIL else acting.frozen
    asked = float(np.sum(failed * acting.values) / np.sum(failed))
    usual, moved = (
        float(np.sqrt(np.cov(acting.values, aweights=np.clip(share, 1e-6, 1.0)))) for share in (1.0 - failed, failed)
    )
    elsewhere = np.average(acting.values, weights=np.clip(1.0 - failed, 1e-6, 1.0))
    is_asked = np.concatenate([[0.0], np.cumsum(acting.values > HALF * elsewhere)])
    spans = [(round(begin), min(round(end), search.count)) for begin, end in hypothesis.spans]
    asked_for = search.step * max(float(is_asked[end] - is_asked[begin]) for begin, end in spans)
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
        left_std=float(with_rest.std[-1]), level=level, asked=asked, asked_for=asked_for, usual=usual, moved=moved,
        beyond=_beyond(acting, failed, fitted.parameters[at], with_rest.parameters[-2:]) if is_part else 0.0,
    )  # fmt: skip


def _beyond(acting: Acting, failed: Array, effect: Array, changed: Array) -> float:
    """How far beyond the travel of an input, over that, lies the place about which it keeps a share of its effect.

    A surface makes a share of what it is told to about its neutral place, and where one of two stands still about that
    place: somewhere in its travel, or at 0. ``effect`` (k,) and ``changed`` (2,): the parameters of its columns, of the
    constant and of the share that change.
    """
    per_unit = float(failed @ acting.per_unit @ effect)
    if per_unit == 0.0 or changed[1] == 0.0:
        return np.inf
    constant = float(changed[0]) * float(failed @ acting.per_unit[:, 0]) / per_unit
    place = acting.mean - constant / float(changed[1])
    low, high = min(float(acting.values.min()), 0.0), max(float(acting.values.max()), 0.0)
    return max(low - place, place - high, 0.0) / (high - low)


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
