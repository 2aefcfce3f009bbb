"""``remove``: what was added to the model of a run, or any of its terms, taken out again as a new version."""

from __future__ import annotations

import argparse
from typing import Any

from aircraft_sysid_ros.commands.add import add_arguments, described, render
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.diagnosis.model_versions.additions import remove

__all__ = ["add_parser", "render", "run"]


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "remove", help="an effect or a term taken out again", description=__doc__
    )
    add_arguments(parser)
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Remove and draw. Raises InputError."""
    with progress_bar() as progress:
        progress.add_task(f"remove {args.what}", total=None)
        outcome = remove(args.run, args.what)
    return {"model": outcome.version.identifier, "removed": outcome.label, **described(args.run, outcome, "without")}
