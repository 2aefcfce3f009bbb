"""May a controller use a parameter? USE, HOLD or REJECT, each with the reason in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError

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


@dataclass(frozen=True)
class Evidence:
    """What is known of one parameter."""

    name: str
    value: float
    std: float
    excitation: float
    effect_of_std: float  # one standard error's share of the coefficient, over the coefficient's spread
    samples: int
    missing: str  # what its axis lacks, as the reason says it; empty: nothing
    bounds: tuple[float, float] = (-np.inf, np.inf)  # of the aircraft file


@dataclass(frozen=True)
class Verdict:
    """Status and reason."""

    status: Trust
    reason: str


#: No aeroplane is beyond these, by axis and term: (lowest, highest).
PHYSICAL_BOUNDS: dict[str, tuple[float, float]] = {
    "CZ_alpha": (-15.0, 0.0), "CZ_q": (-60.0, 5.0), "Cm_q": (-200.0, 0.0),
    "Cl_p": (-3.0, 0.0), "Cn_r": (-3.0, 0.0), "CY_beta": (-5.0, 0.0),
    "Cm_alpha": (-20.0, 20.0), "Cn_beta": (-1.0, 2.0), "Cl_beta": (-2.0, 1.0), "CX_Tc": (0.4, 1.6),
}  # fmt: skip
#: The same by term, for axes and terms that are not named above; C_X,Tc is near 1 since T_c is the thrust itself.
_BOUNDS_BY_TERM = {
    "0": 3.0, "alpha": 20.0, "beta": 10.0, "p": 50.0, "q": 300.0, "r": 50.0, "de": 5.0, "da": 5.0, "dr": 5.0,
}  # fmt: skip


def physical_bounds(name: str) -> tuple[float, float]:
    """Lowest and highest value that aeroplanes have; infinite for terms that nobody has bounds for."""
    limit = _BOUNDS_BY_TERM.get(name.partition("_")[2], np.inf)
    return PHYSICAL_BOUNDS.get(name, (-limit, limit))


def check_bounds(bounds: Mapping[str, tuple[float, float]]) -> None:
    """Raises InputError where bounds of the aircraft file leave nothing of what aeroplanes have."""
    for name, (low, high) in bounds.items():
        lowest, highest = physical_bounds(name)
        if low >= highest or high <= lowest:
            have, given = f"{lowest:g} to {highest:g}", f"{low:g} to {high:g}"
            raise InputError(f"parameter_bounds {name} must meet what aeroplanes have, {have}: {given} does not")


def judge(evidence: Evidence, rules: TrustRules) -> Verdict:
    """The verdict on one parameter."""
    e = evidence
    if e.missing:
        return Verdict(Trust.HOLD, e.missing)
    if e.samples < rules.samples or not np.isfinite(e.std):
        return Verdict(Trust.HOLD, "not enough motion yet")
    if e.excitation < rules.excitation:
        moves = f"{e.excitation:.2f} times its noise, {rules.excitation:g} needed"
        return Verdict(Trust.HOLD, f"its term hardly moves on its own: {moves}")
    low, high = physical_bounds(e.name)
    if e.value - 2.0 * e.std > high or e.value + 2.0 * e.std < low:
        bounds = f"({low:g} to {high:g})"
        return Verdict(Trust.REJECT, f"{e.value:.3g} is outside of what aeroplanes have {bounds}")
    lowest, highest = e.bounds
    outside = f"{e.value:.3g} is outside of the bounds of the aircraft file ({lowest:g} to {highest:g})"
    if e.value - 2.0 * e.std > highest or e.value + 2.0 * e.std < lowest:
        return Verdict(Trust.REJECT, outside)
    if e.std > rules.relative_error * abs(e.value) and e.effect_of_std > rules.negligible:
        share = 100 * e.std / max(abs(e.value), 1e-12)
        return Verdict(Trust.HOLD, f"its standard error is {share:.0f} % of its value")
    if not low <= e.value <= high:
        sign = "has the sign that aeroplanes do not have, within its error"
        return Verdict(Trust.HOLD, f"{e.value:.3g} {sign}")
    if not lowest <= e.value <= highest:
        return Verdict(Trust.HOLD, f"{outside}, within its error")
    if e.std > rules.relative_error * abs(e.value):
        small = f"{rules.negligible:.0%}"
        return Verdict(Trust.USE, f"small: its standard error moves the coefficient by less than {small}")
    return Verdict(Trust.USE, "")
