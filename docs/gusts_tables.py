"""Tables of docs/trust.md from benchmarks/results/gusts.json: header and rows of each."""

from __future__ import annotations

from typing import Any

from results import Rows

Result = dict[str, Any]

AIR = {"none": "calm", "light": "light", "moderate": "moderate"}
#: Parameters that angles which are late bend first.
BENT = ("CZ_0", "CZ_q", "Cm_0", "Cm_q", "Cm_de")


def share(value: float | None) -> str:
    """A share in per cent."""
    return "-" if value is None else f"{100 * value:.0f} %"


def causes(result: Result) -> Rows:
    """Coverage and bias by what stands in the regression."""
    rows = [
        [case, share(part["inside"]), share(part["constants"]), f"{part['rms_z']:.2f}"]
        + [f"{100 * part['bias'][name]:+.1f} %" for name in BENT]
        for case, part in result["causes"].items()
    ]
    header = ["in the regression", "95 % intervals that hold the truth", "of constants", "rms of z"]
    return [*header, *(f"bias of {name}" for name in BENT)], rows


def proof(result: Result) -> Rows:
    """Coverage by axis, bias and wrong values with USE in every cell."""
    rows = []
    for cell in result["cells"]:
        for case, part in cell["runs"].items():
            estimator, regressors = case.split()
            worst, z = max(part["bias_over_std"].items(), key=lambda item: abs(item[1]))
            beyond = sum(abs(bias) >= 0.5 for bias in part["bias_over_std"].values())
            rows.append(
                [AIR[cell["air"]], f"{cell['noise']:g} rad", f"`{estimator}`", regressors, share(part["inside"]),
                 " ".join(f"{100 * inside:.0f}" for inside in part["by_axis"].values() if inside is not None),
                 share(part["constants"]), f"{beyond} of {len(part['bias_over_std'])}, {worst} {z:+.1f}",
                 f"{100 * part['error']:.2f} %", str(part["use"]), f"{part['far']} of {part['use_main']}"]
            )  # fmt: skip
    header = ["turbulence", "noise of the vanes", "estimator", "angles of", "95 % intervals that hold the truth",
              "by axis, X Y Z l m n", "constants", "biased by half a standard error or more, worst", "error", "USE",
              "of main ones off by > 25 %"]  # fmt: skip
    return header, rows


TABLES = {"causes": causes, "proof": proof}
