"""When an input of which something is sure is said to have failed, and when something else is as likely."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from aircraft_sysid_ros.diagnosis.failures.axis_relation import ENGINE
from aircraft_sysid_ros.diagnosis.failures.episode import Times
from aircraft_sysid_ros.diagnosis.failures.failure import LEAST_MOTION, Failure
from aircraft_sysid_ros.diagnosis.failures.failure_search import Judged
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS

#: Share of its effect that an input may keep, by estimate and with two standard errors, to be called stuck.
MOST_LEFT, MOST_LEFT_AT_ALL = 0.35, 0.7
#: Shortest time [s] without thrust, and without a surface: what is shorter may be a manoeuvre. In a clean flight
#: (failure_flights.py, seed 8700007) an elevator had seemed to be held for the 3 s before it pushed.
ENGINE_TIME, SURFACE_TIME = 8.0, 6.0
#: Moments in which a surface that is told to be far from where it stays is seen for a shorter time all the same, and
#: the evidence of each: in one, an aeroplane that stalls does not answer either.
SHORT_AXES, SHORT_EVIDENCE = 2, 30.0
#: Share of its effect that an input keeps which lost part of it, with two standard errors to either side.
LEAST_PART, MOST_PART = 0.15, 0.75
#: Beyond its travel, as a share of that, the place about which it keeps that part may seem to lie. A rudder that stands
#: hard over is a moment, and what is regressed on it beside that had called it a rudder that keeps a third (seeds
#: 9977029 and 9977031 of failures.py, by 0.6 and 1.1; of 13 that keep a part none is beyond by more than 0.01).
MOST_BEYOND = 0.25
#: Or so many of its usual standard deviations away from where it stays an input must have been told to be.
FAR = 3.0
#: Share of the evidence from which the other form of a balance is as telling of a time.
AS_TELLING = 0.5
#: Share of what the throttle does beyond which, by more than its standard error, an engine follows and is not dead.
THROTTLE_LEFT = 0.5


def named(failure: Failure, sure: Judged, constant: Judged) -> Failure | None:
    """What is sure of an input, with what else it could be, if it is enough to be named.

    ``constant``: the best that another constant of the same axes explains.
    """
    if failure.size < THRESHOLDS.size or not _is_told(failure, sure.score - constant.score):
        return None
    if not _is_of_its_axis(failure):
        return None
    return replace(failure, rivals=_rivals(failure, sure, constant))


def _is_of_its_axis(failure: Failure) -> bool:
    """Whether ailerons are told by the rolling moment, which they are for.

    What yaws is another thing, against which they are held: a rudder that stands aside had been an aileron that sticks,
    told by C_n alone (a J3 Cub of JSBSim, seed 10031006 of missions.py; of 13 ailerons of that benchmark that were
    named rightly C_l told most).
    """
    return failure.name != "da" or failure.main_axis == "Cl"


def keeps_part(failure: Failure) -> bool:
    """Whether an input that lost part of its effect surely keeps part of it."""
    low, high = failure.left - 2.0 * failure.left_std, failure.left + 2.0 * failure.left_std
    told = low > LEAST_PART and high < MOST_PART and failure.moved >= LEAST_MOTION * failure.usual
    told = told and failure.beyond <= MOST_BEYOND and _is_of_its_axis(failure)
    return told and failure.size >= THRESHOLDS.size and is_long_enough(failure)


def _is_told(failure: Failure, ahead: float) -> bool:
    """Whether it is the input, and not another constant in the same axes that is ``ahead`` in ln of the likelihood."""
    if failure.name == ENGINE:
        follows = failure.left - failure.left_std > THROTTLE_LEFT
        lost = failure.is_loss_of_thrust and not follows and ahead > -THRESHOLDS.failure_lead
        return lost and is_long_enough(failure)
    if not is_long_enough(failure):
        return False
    gone = abs(failure.left) < MOST_LEFT and failure.left + 2.0 * failure.left_std < MOST_LEFT_AT_ALL
    shown = failure.moved >= LEAST_MOTION * failure.usual
    is_there = failure.left - 2.0 * failure.left_std > MOST_LEFT  # it acts, and does so surely
    return ((gone and shown) or (_is_far(failure) and not is_there)) and ahead > 0.0


def is_long_enough(failure: Failure) -> bool:
    """Whether it lasts longer than a manoeuvre, or several moments tell that a surface did not follow one."""
    if failure.name == ENGINE and not failure.recorded and failure.asked_for < ENGINE_TIME:
        return False  # an engine that is throttled back makes none, and a jet takes seconds to come again
    least = ENGINE_TIME if failure.name == ENGINE else SURFACE_TIME
    if any(times.end is None or times.end - times.begin > least for times in failure.times):
        return True
    told = sum(gain > SHORT_EVIDENCE for gain in failure.gains.values())
    return failure.name != ENGINE and _is_far(failure) and told >= SHORT_AXES


def _is_far(failure: Failure) -> bool:
    """Whether an input was told to be far from where it stays."""
    return abs(failure.asked - failure.level) > FAR * failure.usual


def _rivals(failure: Failure, best: Judged, constant: Judged) -> tuple[str, ...]:
    """What explains the flight nearly as well."""
    if constant.score < best.score - THRESHOLDS.failure_lead:
        return ()
    return ("landing_gear", "parameter_change") if failure.name == ENGINE else ("parameter_change",)


def dated(failure: Failure, others: Iterable[Failure]) -> Failure:
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
