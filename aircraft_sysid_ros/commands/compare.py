"""``compare``: how good the model of a run is on flight that it was not fitted to, and where it fails."""

from __future__ import annotations

import argparse
import math
from typing import Any

from aircraft_sysid_ros.commands.pictures import picture, picture_lines
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.diagnosis.compare import compare
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.report.diagnosis_figures import comparison_figure

FIGURE = "compare.png"


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "compare", help="how good the model is, and where it fails", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", help="folder written by replay or live")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Compare and draw; returns the JSON of INTERFACE.md with the model and the figure. Raises InputError."""
    opened = open_run(args.run)
    with progress_bar() as progress:
        task = progress.add_task("reconstruct the flight", total=None)
        flight = opened.flight()
        progress.update(task, description="compare")
        comparison = compare(flight)
    title = f"{flight.aircraft.name}, model {opened.current.identifier}"
    result = {"model": opened.current.identifier, **comparison.json}
    if opened.samples is None:
        note = "the run holds no samples: errors are those of the filter, with its settling; replay the recording again"
        result["notes"] = [*result["notes"], note]
    result["figure"], notes = picture(lambda: comparison_figure(comparison, opened.path / FIGURE, title))
    result["notes"] = [*opened.notes, *result["notes"], *notes]
    return result


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    lines = [f"model {result['model']}, errors in % of the spread of each coefficient", ""]
    header = f"{'axis':<6}{'fit':>8}{'held out':>10}{'floor':>8}  residual"
    lines += [header, "-" * (len(header) + 12)]
    for name, axis in result["axes"].items():
        if axis["nrmse_held_out"] is None:
            lines.append(f"{name:<6}{axis['reason']}")
            continue
        white = {True: "only noise", False: "more than noise", None: "too short to tell"}[axis["white"]]
        fit, held_out, floor = (percent(axis[key]) for key in ("nrmse_fit", "nrmse_held_out", "noise_floor"))
        lines.append(f"{name:<6}{fit:>8}{held_out:>10}{floor:>8}  {white}")
    lines.append("")
    if result["worst"]:
        lines.append("where it fails, worst first (error there, times the noise):")
        lines += [f"  {w['text']}: {percent(w['nrmse'])} %, {w['times_noise']:.1f} times" for w in result["worst"]]
    else:
        lines.append("no stretch of time and no part of the flight envelope is worse than noise")
    return "\n".join([*lines, *picture_lines(result)])


def percent(value: float) -> str:
    """A share as a number of %; a dash where it is not known."""
    return "-" if math.isnan(value) else f"{100.0 * value:.1f}"
