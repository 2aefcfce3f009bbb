"""``refine``: maximum likelihood on a run, the whole aircraft model at once, after the flight.

output-error simulates each piece of the flight from its start, for calm air; filter-error runs a Kalman filter with
the model and estimates gusts and sensor noise as well. The model is the current version, with all that was added; the
result is a file and a picture beside its aircraft file.
"""

from __future__ import annotations

import argparse
from typing import Any

from aircraft_sysid_ros.after_flight.refine import refine_run, refined_sentences
from aircraft_sysid_ros.commands.options import parameter_table
from aircraft_sysid_ros.commands.pictures import picture_lines
from aircraft_sysid_ros.commands.progress import telling
from aircraft_sysid_ros.refinement.refine import RefineOptions
from aircraft_sysid_ros.refinement.refined_file import FILTER_ERROR, METHODS
from aircraft_sysid_ros.report.refined_figure import draw_refined
from aircraft_sysid_ros.rounding import rounded_to_error

#: By how names of biases and levels begin; a factor has none.
_UNITS = {"accelerometer_bias": "m/s²", "gyro_bias": "rad/s", "gusts": "m/s per √s", "rates": "rad/s per √s"}


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "refine", help="maximum likelihood on a run", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", help="folder written by replay or live")
    parser.add_argument("--method", choices=METHODS, default=FILTER_ERROR, help="default: %(default)s")
    parser.add_argument("--model", metavar="ID", help="id or name of the version to refine (default: the current one)")
    parser.add_argument(
        "--segment", type=float, metavar="S",
        help=f"seconds of flight in one piece (default: {RefineOptions().segment:g})",
    )  # fmt: skip
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Refine and write; returns the content of the file with its path. Raises InputError."""
    with telling(args.method) as tell:
        return refine_run(args.run, draw_refined, args.method, args.model, args.segment, tell)


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
                title += next((f" [{unit}]" for name, unit in _UNITS.items() if item["name"].startswith(name)), "")
                value, std = rounded_to_error(item["value"], item["std"])
                lines.append(f"{title:<46}{value:>12}{std:>12}")
    lines += ["", "error on the pieces that were not fitted, over the spread: refined (parameters that it began with)"]
    for axis, error in result["not_fitted"].items():
        lines.append(f"  {axis}  {100 * error['nrmse']:.1f} % ({100 * error['nrmse_before']:.1f} %)")
    lines += refined_sentences(result)
    return "\n".join([*lines, *picture_lines(result), f"file {result['file']}"])
