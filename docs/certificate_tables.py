"""Tables of docs/certificate.md from benchmarks/results/certificate.json: header and rows of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from results import Rows

Summary = dict[str, Any]

AIRS = {"none": "calm", "light": "light turbulence"}


def percent(share: float | None, digits: int = 0) -> str:
    return "" if share is None else f"{100 * share:.{digits}f} %"


def seconds(value: float | None, digits: int = 1) -> str:
    return "never" if value is None else f"{value:.{digits}f} s"


def covered(part: dict[str, Any]) -> str:
    """Share with its Monte Carlo standard error."""
    if part["share"] is None:
        return ""
    return f"{100 * part['share']:.1f} ± {100 * part['error']:.1f} %"


def cells(summary: Summary, key: str) -> list[tuple[str, str, Any]]:
    """(air, method, numbers), calm air first."""
    return [(air, m, airs[air]) for air in AIRS for m, airs in summary[key].items() if air in airs]


def coverage(summary: Summary) -> Rows:
    """Coverage of 95 % intervals, errors, cost."""
    rows = []
    for air, method, c in cells(summary, "methods"):
        worst = ", ".join(f"{name} {100 * share:.0f} %" for name, share in list(c["least_covered"].items())[:3])
        rows.append(
            [AIRS[air], method, str(c["flights"]), covered(c["excited"]), f"{c['excited']['rms_z']:.2f}",
             percent(c["use"]["of_all"]), covered(c["use"]), worst,
             f"{percent(c['median_relative_error'], 2)} / {percent(c['p90_relative_error'], 1)}", f"{c['cpu']:.1f}"]
        )  # fmt: skip
    header = ["air", "method", "flights", "95 % intervals that hold the truth", "rms of z", "marked USE", "of those",
              "least covered", "error of main derivatives, median / 90 % of cases below", "processor [s]"]  # fmt: skip
    return header, rows


def same_flights(summary: Summary) -> Rows:
    """Rms errors on the flights that all methods have."""
    rows = []
    for air, group in summary["same_flights"].items():
        for method, c in group["methods"].items():
            better = c["better_than"]
            others = [str(better[m]) if m in better else "–" for m in group["methods"]]
            rows.append(
                [AIRS[air], method, str(group["flights"]), percent(c["median_rms_main"], 2),
                 f"{percent(c['worst_rms_main'], 1)} ({c['worst']})", f"{c['over_rls']:.2f}",
                 covered(c["excited"]), " / ".join(others)]
            )  # fmt: skip
    names = " / ".join(next((list(g["methods"]) for g in summary["same_flights"].values()), []))
    header = ["air", "method", "flights", "rms error of a main derivative, median", "worst", "over that of rls",
              "coverage", f"of 15 better than {names}"]  # fmt: skip
    return header, rows


def corrections(summary: Summary) -> Rows:
    """What other standard errors of recursive least squares would be worth."""
    titles = {
        "white": "as for white residuals, (4.7)",
        "coloured": "corrected for coloured residuals",
        "std": "published: also noise in the regressors and unknown bias",
    }
    rows = [
        [AIRS[air], title, covered(group[key]), f"{group[key]['rms_z']:.2f}", f"{group[key]['ratio']:.1f}"]
        for air, group in summary["corrections"].items()
        for key, title in titles.items()
    ]
    header = ["air", "standard errors of rls", "95 % intervals that hold the truth", "rms of z", "published over it"]
    return header, rows


def bias(summary: Summary) -> Rows:
    """Bias of the main derivatives in per cent, with its Monte Carlo standard error; bold beyond three of these."""
    columns = cells(summary, "methods")
    names = list(columns[0][2]["bias"])
    rows = [[name, *(_bias(c["bias"][name]) for _, _, c in columns)] for name in names]
    return ["bias [%]", *(f"{method}, {AIRS[air].split()[-1]}" for air, method, _ in columns)], rows


def _bias(found: dict[str, float | None]) -> str:
    mean, error = found["mean"], found["error"]
    if mean is None or error is None:
        return ""
    text = f"{100 * mean:+.2f} ± {100 * error:.2f}"
    return f"**{text}**" if abs(mean) > 3.0 * error else text


def close(summary: Summary) -> Rows:
    """Median time until a derivative stays within 10 %, in seconds and cycles, and how often within one cycle."""
    columns = cells(summary, "close")
    rows = []
    for name in columns[0][2]:
        row = [name]
        for _, _, found in columns:
            c = found[name]
            cycles = "" if c["cycles"] is None else f" ({c['cycles']:.1f})"
            one = "" if not c["in_one_cycle"] else f", {percent(c['in_one_cycle'])} in one"
            row.append(seconds(c["median"]) + cycles + one)
        rows.append(row)
    return ["median (cycles)", *(f"{method}, {AIRS[air].split()[-1]}" for air, method, _ in columns)], rows


def loss(summary: Summary) -> Rows:
    """Half of the elevator lost: detection, false alarms, recovery."""
    rows = []
    for air, method, c in cells(summary, "loss"):
        if not c["lost"]:
            continue
        rows.append(
            [AIRS[air], method, str(c["lost"]), _delay(c["alarm"]),
             f"{c['false_alarms']} in {c['minutes']:.0f} min", _seconds(c["wrong_use"]), percent(c["wrong_sign"]),
             _delay(c["in_use"]), _delay(c["close"]), _delay(c["close_after_moves"]),
             "" if c["end"] is None else f"{c['end']:.2f}", percent(c["end_z_within_95"])]
        )  # fmt: skip
    header = ["air", "method", "flights", "alarm", "false alarms", "USE and more than 25 % wrong",
              "USE with wrong sign", "first USE within 10 %", "within 10 % for good",
              "the same, since the elevator moves", "at the end, over the truth", "interval holds it"]  # fmt: skip
    return header, rows


def _delay(found: dict[str, float | None]) -> str:
    """Share of the flights, median and 90 % of cases."""
    if not found["share"]:
        return "never"
    late = "" if found["p90"] is None else f" / {found['p90']:.1f} s"
    return f"{percent(found['share'])}: {seconds(found['median'])}{late}"


def _seconds(found: dict[str, float | None]) -> str:
    """Median and 90 % of cases of a duration that all flights have."""
    late = "" if found["p90"] is None else f" / {found['p90']:.1f} s"
    return f"{seconds(found['median'])}{late}"


#: Words for the values of a cell.
_CELL = {
    "none": "calm", "light": "light turbulence", "moderate": "moderate turbulence", "complete": "complete",
    "shape": "mass, shape, places", "bare": "mass and shape",
}  # fmt: skip


def _cell(name: str) -> list[str]:
    """Air, vanes, IMU and file of a cell or of a part of all, in words."""
    parts = {"air": "all", "vane": "all", "imu": "all", "file": "all"}
    if name.count(","):
        parts = dict(zip(parts, name.split(","), strict=True))
    elif name != "all":
        key, _, value = name.partition(" ")
        parts[key] = value
    units = {"vane": "°", "imu": " Hz"}
    return [v if v == "all" else _CELL.get(v, v + units.get(k, "")) for k, v in parts.items()]


def every_cell(summary: Summary) -> Rows:
    """The default estimator in every cell."""
    return _by_cell(summary, of_cells=True)


def by_dimension(summary: Summary) -> Rows:
    """The default estimator over the values of each dimension."""
    return _by_cell(summary, of_cells=False)


def _by_cell(summary: Summary, of_cells: bool) -> Rows:
    rows = []
    for name, c in summary["cells"].items():
        if ("," in name) != of_cells:
            continue
        worst = ", ".join(f"{parameter} {100 * share:.0f} %" for parameter, share in c["least_covered"])
        rows.append(
            [*_cell(name), str(c["flights"]), covered(c["use"]), "" if c["use"]["rms_z"] is None else
             f"{c['use']['rms_z']:.2f}", f"{percent(c['use_share'])} / {percent(c['main_use_share'])}",
             f"{c['main_wrong']} of {c['main_uses']}", f"{c['sure_wrong']} of {c['uses']}",
             f"{percent(c['main_error'], 2)} / {percent(c['main_error_90'], 1)}", worst]
        )  # fmt: skip
    header = [
        "air", "vanes", "IMU", "aircraft file", "flights", "95 % intervals with USE that hold the truth", "rms of z",
        "marked USE, of all / of main derivatives", "of those main ones more than 25 % off", "of all confidently wrong",
        "error of main ones with USE, median / 90 % below", "least covered",
    ]  # fmt: skip
    return header, rows


TABLES: dict[str, Callable[[Summary], Rows]] = {
    "coverage": coverage,
    "same_flights": same_flights,
    "corrections": corrections,
    "bias": bias,
    "close": close,
    "loss": loss,
}
