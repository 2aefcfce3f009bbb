"""May a controller use a parameter? USE, HOLD or REJECT, each with the reason in words."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.identification.physical_bounds import physical_bounds
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS

Array = npt.NDArray[np.float64]


class Trust(IntEnum):
    """As in the message Parameter."""

    USE = 0
    HOLD = 1
    REJECT = 2


class Evidence(NamedTuple):
    """What is known of one parameter."""

    name: str
    value: float
    std: float
    excitation: float
    effect_of_std: float  # one standard error's share of the coefficient, over the coefficient's spread
    samples: int
    missing: str  # what its axis lacks, as the reason says it; empty: nothing
    bounds: tuple[float, float] = (-np.inf, np.inf)  # of the aircraft file
    follows: str = ""  # what its term moves with, as the reason says it; empty: nothing


class Verdict(NamedTuple):
    """Status and reason."""

    status: Trust
    reason: str


def disagree(a: Array, b: Array, std_a: Array, std_b: Array, effect: Array) -> npt.NDArray[np.bool_]:
    """Which parameters (n,) two estimators do not agree on; ``effect`` of one unit, over the coefficient's spread."""
    surely = np.abs(a - b) > THRESHOLDS.disagree_sigma * np.hypot(std_a, std_b)
    return np.asarray(surely & are_far(a, b, effect))


def are_far(a: Array, b: Array, effect: Array) -> npt.NDArray[np.bool_]:
    """Which parameters (n,) differ by a size that matters, sure or not."""
    apart = np.abs(a - b)
    large = apart > THRESHOLDS.disagree_share * np.abs(a)
    return np.asarray(large & (apart * effect > THRESHOLDS.disagree_effect))


def lack_of_fit(axis: str, unexplained: float, over_noise: float = np.nan, worst: float = np.nan) -> str:
    """What to say of an axis whose model leaves a share of the variance of its coefficient; empty: it explains it.

    ``over_noise``: the rms error over what noise makes of it, ``worst``: what that ratio exceeds in a tenth of the
    motion; NaN where that is not known.
    """
    explained = max(1.0 - unexplained, 0.0)
    if unexplained > THRESHOLDS.misfit**2:
        return f"the model explains {explained:.0%} of {axis}"
    if over_noise > THRESHOLDS.beyond_noise:
        return f"the error of {axis} is {over_noise:.1f} times its noise: the model explains {explained:.1%} of it"
    if worst > THRESHOLDS.beyond_noise:
        return f"the error of {axis} is {worst:.1f} times its noise or more in a tenth of the motion"
    return ""


def judge(evidence: Evidence) -> Verdict:
    """The verdict on one parameter."""
    e = evidence
    if e.missing:
        return Verdict(Trust.HOLD, e.missing)
    if e.samples < THRESHOLDS.samples or not np.isfinite(e.std):
        return Verdict(Trust.HOLD, "not enough motion yet")
    if e.excitation < THRESHOLDS.excitation:
        moves = f"{e.excitation:.2f} times its noise, {THRESHOLDS.excitation:g} needed"
        return Verdict(Trust.HOLD, f"its term hardly moves on its own: {moves}{e.follows}")
    low, high = physical_bounds(e.name)
    if is_unphysical(e.name, e.value, e.std):
        bounds = f"({low:g} to {high:g})"
        return Verdict(Trust.REJECT, f"{e.value:.3g} is outside of what aeroplanes have {bounds}")
    lowest, highest = e.bounds
    margin = THRESHOLDS.beyond_bounds * e.std
    if e.value - margin > highest or e.value + margin < lowest:
        return Verdict(Trust.REJECT, _outside(e))
    if e.std > THRESHOLDS.relative_error * abs(e.value) and e.effect_of_std > THRESHOLDS.negligible:
        share = 100 * e.std / max(abs(e.value), 1e-12)
        return Verdict(Trust.HOLD, f"its standard error is {share:.0f} % of its value")
    if not low <= e.value <= high:
        sign = "has a sign that aeroplanes do not have, within its error"
        return Verdict(Trust.HOLD, f"{e.value:.3g} {sign}")
    if not lowest <= e.value <= highest:
        return Verdict(Trust.HOLD, f"{_outside(e)}, within its error")
    if e.std > THRESHOLDS.relative_error * abs(e.value):
        small = f"{THRESHOLDS.negligible:.0%}"
        return Verdict(Trust.USE, f"small: its standard error moves the coefficient by less than {small}")
    return Verdict(Trust.USE, "")


def is_unphysical(name: str, value: float, std: float) -> bool:
    """Whether a parameter is surely outside of what aeroplanes have."""
    low, high = physical_bounds(name)
    margin = THRESHOLDS.beyond_bounds * std
    return value - margin > high or value + margin < low


def _outside(evidence: Evidence) -> str:
    lowest, highest = evidence.bounds
    return f"{evidence.value:.3g} is outside of the bounds of the aircraft file ({lowest:g} to {highest:g})"
