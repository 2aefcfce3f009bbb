"""Tables of docs/export.md: exported aeroplanes in JSBSim, what other targets lose, and gains on drawn aeroplanes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from results import Rows

_AXES = {"CX": "C_X", "CY": "C_Y", "CZ": "C_Z", "Cl": "C_l", "Cm": "C_m", "Cn": "C_n"}


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def states(result: Mapping[str, Any]) -> Rows:
    """Coefficients at the true states of another flight."""
    rows = []
    for name, found in result["aeroplanes"].items():
        for who, words in (("nrmse_model", "identified model"), ("nrmse_jsbsim", "exported file in JSBSim")):
            rows.append([name, words, *(_percent(found["states"][who][axis]) for axis in _AXES)])
    return ["aeroplane", "error on the held-out flight", *_AXES.values()], rows


def pieces(result: Mapping[str, Any]) -> Rows:
    """Free flight."""
    rows = []
    for name, found in result["aeroplanes"].items():
        of = found["pieces"]
        for who, words in (("nrmse_own", "our simulator"), ("nrmse_jsbsim", "JSBSim"), ("apart", "between them")):
            rows.append([name, words, *(_percent(value) for value in of[who].values())])
    names = list(next(iter(result["aeroplanes"].values()))["pieces"]["apart"])
    return ["aeroplane", "2 s of free flight, by", *names], rows


def lost(result: Mapping[str, Any]) -> Rows:
    """What other targets miss of each coefficient."""
    rows = [
        [name, target, *(_percent(share[axis]) for axis in _AXES)]
        for name, found in result["aeroplanes"].items()
        for target, share in found["lost"].items()
    ]
    return ["aeroplane", "lost by", *_AXES.values()], rows


def gains(result: Mapping[str, Any]) -> Rows:
    """Loops closed on aeroplanes from the covariance."""
    rows = []
    for name, found in result["aeroplanes"].items():
        for axis, loop in found["gains"].items():
            if "refused" in loop:
                rows.append([name, axis, *[""] * 5, "refused: " + loop["refused"].split(" (")[0].split(": ", 1)[1]])
                continue
            numbers = [f"{loop[key]:.3f}" for key in ("ff", "p", "i")]
            margins = [f"{loop['gain_margin_db']:.1f} dB", f"{loop['phase_margin_deg']:.0f}°"]
            rows.append([name, axis, *numbers, *margins, f"{loop['stable']} of {loop['draws']}"])
    return ["aeroplane", "loop", "FF [s]", "P [s]", "I [-]", "gain margin", "phase margin", "stable"], rows


def poor(result: Mapping[str, Any]) -> Rows:
    """Short, noisy and gusty flights."""
    loops = result["poor_flights"]
    given = [loop for loop in loops if "refused" not in loop]
    why = {
        "refused: the run has no parameter with USE": "no parameter with USE",
        "refused: a parameter that they rest on is not to be used": "they rest on",
        "refused: a parameter is too uncertain": "too uncertain",
    }
    rows = [
        ["loops asked for", str(len(loops))],
        *([words, str(sum(said in loop.get("refused", "") for loop in loops))] for words, said in why.items()),
        ["given", str(len(given))],
        ["of those stable in 99 or more of 100 draws", str(sum(loop["stable"] >= 99 for loop in given))],
        ["of those stable on the true aeroplane", str(sum(loop["holds_the_true_one"] for loop in given))],
    ]
    return ["flights of 25 and 45 s, noise ×1, ×1.5, ×2.5, calm and moderate turbulence", "loops"], rows


TABLES: dict[str, Callable[[Mapping[str, Any]], Rows]] = {
    "states": states,
    "pieces": pieces,
    "lost": lost,
    "gains": gains,
    "poor": poor,
}
