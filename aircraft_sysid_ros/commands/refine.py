"""``refine``: maximum likelihood on a run, the whole aircraft model at once, after the flight.

output-error simulates each piece of the flight from its start, for calm air; filter-error runs a Kalman filter with
the model and estimates gusts and sensor noise as well. The model is the current version, with all that was added; the
result is a file and a picture beside its aircraft file.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.commands.options import parameter_table
from aircraft_sysid_ros.commands.pictures import picture, picture_lines
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.diagnosis.model_versions.versions import Version, folder_of, open_run, run_data, version_named
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.refinement.refine import FILTER_ERROR, METHODS, RefineOptions, refine, with_options
from aircraft_sysid_ros.run_writer import write_json


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "refine", help="maximum likelihood on a run", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", help="folder written by replay or live")
    parser.add_argument("--method", choices=METHODS, default=FILTER_ERROR, help="default: %(default)s")
    parser.add_argument("--model", metavar="ID", help="id of the model version to refine (default: the current one)")
    parser.add_argument(
        "--segment", type=float, metavar="S",
        help=f"seconds of flight in one piece (default: {RefineOptions().segment:g})",
    )  # fmt: skip
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Refine and write; returns the content of the file with its path. Raises InputError."""
    options = with_options(RefineOptions(), args.segment)
    opened = open_run(args.run)
    version = opened.current if args.model is None else version_named(opened, args.model)
    data, folder = run_data(opened, version), folder_of(opened, version)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"cannot write to {folder}: change its permissions")
    started = time.perf_counter()
    with progress_bar() as progress:
        task = progress.add_task(args.method, total=options.maximum_iterations)

        def show(iteration: int, cost: float) -> None:
            progress.update(task, completed=iteration, description=f"{args.method}, cost {cost:.1f}")

        result = refine(data, args.method, options, show)
    content = {**_about(version, opened.current), **result.content, "elapsed": time.perf_counter() - started}
    path = folder / f"refined-{args.method}.json"
    title = f"{args.method}: {data.aircraft.name}, model {version.identifier}"
    figure, notes = picture(lambda: _draw(path.with_suffix(".png"), result, title))
    write_json(path, content)
    return {**content, "file": str(path), "figure": figure, "notes": [*opened.notes, *notes]}


def _about(version: Version, current: Version) -> dict[str, Any]:
    """Which model is refined."""
    is_current = version.identifier == current.identifier
    return {"model": version.identifier, "changes": list(version.changes), "is_current": is_current}


def _draw(path: Path, result: Any, title: str) -> Path:
    from aircraft_sysid_ros.report.figures import outputs_figure

    part = path.with_name(f".{path.name}.part.png")
    try:
        outputs_figure(result.time, result.measured, result.modelled, part, title)
        os.replace(part, path)
    except OSError:
        part.unlink(missing_ok=True)
        raise
    return path


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    which = "the current version" if result["is_current"] else "not the current version"
    added = f" with {', '.join(result['changes'])}" if result["changes"] else ""
    lines = [f"refined: model {result['model']}, {which}{added}", "", parameter_table(result["parameters"]), ""]
    lines.append(f"{'bias or level':<46}{'estimate':>12}{'std. error':>12}")
    lines.append("-" * len(lines[-1]))
    for key in ("biases", "process_noise", "output_noise_factors"):
        for item in result.get(key, []):
            if item["std"] is not None:
                title = item["name"] if key == "biases" else f"{key.replace('_', ' ')}: {item['name']}"
                lines.append(f"{title:<46}{item['value']:>12.5f}{item['std']:>12.5f}")
    lines += ["", "error on the pieces that were not fitted, over the spread: refined (parameters that it began with)"]
    for axis, error in result["not_fitted"].items():
        lines.append(f"  {axis}  {100 * error['nrmse']:.1f} % ({100 * error['nrmse_before']:.1f} %)")
    ending = "converged" if result["converged"] else f"NOT CONVERGED: {result['reason']}"
    lines.append(
        f"{ending} after {result['iterations']} iterations, {result['seconds_fitted']:.0f} s of flight fitted in "
        f"{result['elapsed']:.0f} s"
    )
    if result["worse"]:
        axes = " ".join(f"C_{axis[1]}" for axis in result["worse"])
        lines.append(
            f"WORSE THAN BEFORE: where nothing was fitted, {axes} predicted worse than by the parameters that it began "
            "with. The model seems to lack something, see aircraft-sysid diagnose RUN: do not use what was refined"
        )
    return "\n".join([*lines, *picture_lines(result), f"file {result['file']}"])
