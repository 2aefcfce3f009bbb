"""May a controller use a parameter? USE, HOLD or REJECT, each with the reason in words."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.identification.physical_bounds import physical_bounds

Array = npt.NDArray[np.float64]


class Trust(IntEnum):
    """As in the message Parameter."""

    USE = 0
    HOLD = 1
    REJECT = 2


@dataclass(frozen=True)
class TrustRules:
    """Limits of trust."""

    #: Least ratio of what only this term moves to its noise; at 3 the noise biases it by 11 %.
    excitation: float = 3.0
    relative_error: float = 0.25  # largest standard error over the value …
    negligible: float = 0.05  # … unless its standard error moves the coefficient by less than this share
    samples: int = 100  # evaluations before anything is trusted


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


#: Two estimates disagree where they differ by more than SIGMA standard errors, a SHARE of the value, and what moves the
#: coefficient by a share NEGLIGIBLE of its spread.
SIGMA, SHARE, NEGLIGIBLE = 6.0, 0.25, 0.05


def disagree(a: Array, b: Array, std_a: Array, std_b: Array, effect: Array) -> npt.NDArray[np.bool_]:
    """Which parameters (n,) two estimators do not agree on; ``effect`` of one unit, over the coefficient's spread."""
    surely = np.abs(a - b) > SIGMA * np.hypot(std_a, std_b)
    return np.asarray(surely & are_far(a, b, effect))


def are_far(a: Array, b: Array, effect: Array) -> npt.NDArray[np.bool_]:
    """Which parameters (n,) differ by a size that matters, sure or not."""
    apart = np.abs(a - b)
    return np.asarray((apart > SHARE * np.abs(a)) & (apart * effect > NEGLIGIBLE))


#: Rms error over the spread of a coefficient from which the model does not explain it.
MISFIT = 0.5
#: Rms error over what noise makes of it from which the model lacks something. With right models it was at most 1.9 at
#: the end of a flight and 2.2 on the way, in any air, at 10 to 400 Hz (benchmarks/results/lack_of_fit.json).
BEYOND_NOISE = 3.0


def lack_of_fit(axis: str, unexplained: float, over_noise: float = np.nan, worst: float = np.nan) -> str:
    """What to say of an axis whose model leaves a share of the variance of its coefficient; empty: it explains it.

    ``over_noise``: the rms error over what noise makes of it, ``worst``: what that ratio exceeds in a tenth of the
    motion; NaN where that is not known.
    """
    explained = max(1.0 - unexplained, 0.0)
    if unexplained > MISFIT**2:
        return f"the model explains {explained:.0%} of {axis}"
    if over_noise > BEYOND_NOISE:
        return f"the error of {axis} is {over_noise:.1f} times its noise: the model explains {explained:.1%} of it"
    if worst > BEYOND_NOISE:
        return f"the error of {axis} is {worst:.1f} times its noise or more in a tenth of the motion"
    return ""


def judge(evidence: Evidence, rules: TrustRules) -> Verdict:
    """The verdict on one parameter."""
    e = evidence
    if e.missing:
        return Verdict(Trust.HOLD, e.missing)
    if e.samples < rules.samples or not np.isfinite(e.std):
        return Verdict(Trust.HOLD, "not enough motion yet")
    if e.excitation < rules.excitation:
        moves = f"{e.excitation:.2f} times its noise, {rules.excitation:g} needed"
        return Verdict(Trust.HOLD, f"its term hardly moves on its own: {moves}{e.follows}")
    low, high = physical_bounds(e.name)
    if is_unphysical(e.name, e.value, e.std):
        bounds = f"({low:g} to {high:g})"
        return Verdict(Trust.REJECT, f"{e.value:.3g} is outside of what aeroplanes have {bounds}")
    lowest, highest = e.bounds
    if e.value - 2.0 * e.std > highest or e.value + 2.0 * e.std < lowest:
        return Verdict(Trust.REJECT, _outside(e))
    if e.std > rules.relative_error * abs(e.value) and e.effect_of_std > rules.negligible:
        share = 100 * e.std / max(abs(e.value), 1e-12)
        return Verdict(Trust.HOLD, f"its standard error is {share:.0f} % of its value")
    if not low <= e.value <= high:
        sign = "has a sign that aeroplanes do not have, within its error"
        return Verdict(Trust.HOLD, f"{e.value:.3g} {sign}")
    if not lowest <= e.value <= highest:
        return Verdict(Trust.HOLD, f"{_outside(e)}, within its error")
    if e.std > rules.relative_error * abs(e.value):
        small = f"{rules.negligible:.0%}"
        return Verdict(Trust.USE, f"small: its standard error moves the coefficient by less than {small}")
    return Verdict(Trust.USE, "")


def is_unphysical(name: str, value: float, std: float) -> bool:
    """Whether a parameter is surely outside of what aeroplanes have."""
    low, high = physical_bounds(name)
    return value - 2.0 * std > high or value + 2.0 * std < low


def _outside(evidence: Evidence) -> str:
    lowest, highest = evidence.bounds
    return f"{evidence.value:.3g} is outside of the bounds of the aircraft file ({lowest:g} to {highest:g})"
