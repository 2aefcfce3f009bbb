"""``report``: what the workbench shows of a run, as one HTML file that opens without a network."""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.errors import InputError


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "report", help="the page of a run as one HTML file", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", help="folder written by replay or live")
    parser.add_argument(
        "--out", required=True, metavar="FILE.html", help="file to write; one that is there is replaced"
    )
    parser.add_argument("--truth", metavar="BAG", help="simulated recording of the run, to show the truth too")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Gather and write; returns the file with its size. Raises InputError."""
    out = Path(args.out)
    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out {args.out} is no HTML file: give it a name that ends in .html")
    if not out.parent.is_dir():
        raise InputError(f"--out {args.out}: the folder {out.parent} is not there")
    try:
        import plotly  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"the file needs more packages ({error}): pip install 'aircraft_sysid_ros[workbench]'"
        ) from None
    from aircraft_sysid_ros.workbench.report import report_html
    from aircraft_sysid_ros.workbench.run_view import load_flight_record, load_run_view, load_truth_view

    truth, notes, record = load_truth_view(args.truth), [], None
    with progress_bar() as progress:
        task = progress.add_task("read the run", total=1.0)
        view = load_run_view(
            args.run, progress=lambda what, share: progress.update(task, description=what, completed=0.9 * share)
        )
        try:
            record = load_flight_record(args.run, view.zero)
        except InputError as error:  # the model is worth a file without it
            notes.append(f"without the state: {error}")
        text = report_html(view, record, truth)
    _write(out, text)
    return {"run": str(args.run), "model": view.current, "file": str(out), "bytes": len(text.encode()), "notes": notes}


def _write(out: Path, text: str) -> None:
    """Write beside the place and move there: never half a file."""
    try:
        with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as folder:
            new = Path(folder) / out.name
            new.write_text(text, encoding="utf8")
            os.replace(new, out)
    except OSError as error:
        raise InputError(f"cannot write {out}: {error.strerror or error}") from None


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    lines = [f"note: {note}" for note in result["notes"]]
    return "\n".join([*lines, f"{result['file']}, {result['bytes'] / 1e6:.1f} MB, model {result['model']}"])
