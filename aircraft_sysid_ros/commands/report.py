"""``report``: what the workbench shows of a run or of a calibration, as one HTML file that opens without a network."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aircraft_sysid_ros.commands.folders import check_folder
from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import MissingExtra
from aircraft_sysid_ros.text_file import write_whole

if TYPE_CHECKING:
    from aircraft_sysid_ros.workbench.calibration_view import CalibrationView
    from aircraft_sysid_ros.workbench.run_view import FlightRecord, RunView


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "report", help="the page of a run as one HTML file", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", help="folder written by replay or live, or by calibrate")
    parser.add_argument(
        "--calibration",
        metavar="FOLDER",
        help="folder written by calibrate, to show with the run (default: the last one that the page made from it)",
    )
    parser.add_argument(
        "--out", required=True, metavar="FILE.html", help="file to write; one that is there is replaced"
    )
    parser.add_argument("--truth", metavar="BAG", help="simulated recording of the run, to show the truth too")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Gather and write; returns the file with its size. Raises InputError."""
    out = Path(args.out)
    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {args.out} is not an HTML file: give it a name that ends in .html")
    if not out.parent.is_dir():
        raise InputError(f"--out {args.out}: the folder {out.parent} is not there")
    check_folder(args.run)
    try:
        import jinja2  # noqa: F401
        import plotly  # noqa: F401
    except ImportError:
        raise MissingExtra("reports", "jinja2 and plotly", "workbench") from None
    from aircraft_sysid_ros.workbench.calibration_view import calibration_folder, is_calibration, load_calibration_view
    from aircraft_sysid_ros.workbench.report import calibration_html, report_html
    from aircraft_sysid_ros.workbench.run_view import load_truth_view

    if is_calibration(args.run):
        if args.calibration or args.truth:
            raise InputError(f"{args.run} is a calibration: --calibration and --truth are for a run")
        text, said = calibration_html(load_calibration_view(calibration_folder(args.run))), {}
    else:
        truth = load_truth_view(args.truth)
        calibrated, unread = _calibration(args)
        view, record, notes = _read(args.run)
        notes = [*notes, *unread]
        text = report_html(replace(view, notes=(*view.notes, *notes)), record, truth, calibrated)
        said = {"model": view.current, "notes": notes}
    _write(out, text)
    return {"run": str(args.run), "file": str(out), "bytes": len(text.encode()), "notes": [], **said}


def _calibration(args: argparse.Namespace) -> tuple[CalibrationView | None, list[str]]:
    """The one that is named, or the last that was made from the run, as on the page; why that cannot be read."""
    from aircraft_sysid_ros.workbench.calibration_view import calibration_folder, load_calibration_view, newest_of_run

    if args.calibration:
        return load_calibration_view(calibration_folder(args.calibration)), []
    folder = newest_of_run(args.run)
    try:
        return None if folder is None else load_calibration_view(folder), []
    except InputError as error:  # nobody has asked for it
        return None, [f"without the calibration: {error}"]


def _read(run: str) -> tuple[RunView, FlightRecord | None, list[str]]:
    """The run, what was estimated in flight, and notes."""
    from aircraft_sysid_ros.workbench.run_view import load_flight_record, load_run_view

    with progress_bar() as progress:
        task = progress.add_task("read the run", total=1.0)
        view = load_run_view(run, progress=lambda what, share: progress.update(task, description=what, completed=share))
        try:
            record = load_flight_record(run, view.zero)
            return view, record, list(record.notes)
        except InputError as error:  # the model is worth a file without it
            return view, None, [f"without the state: {error}"]


def _write(out: Path, text: str) -> None:
    """Write beside the place and move there: never half a file."""
    try:
        write_whole(out, text)
    except OSError as error:
        raise InputError(f"cannot write {out}: {error.strerror or error}") from None


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    lines = note_lines(result["notes"])
    model = f", model {result['model']}" if "model" in result else ""
    return "\n".join([*lines, f"{result['file']}, {result['bytes'] / 1e6:.1f} MB{model}"])
