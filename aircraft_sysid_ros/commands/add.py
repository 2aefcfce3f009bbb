"""``add``: an effect of the library, or a term such as "CZ: alpha**3", as a new version of the model of a run."""

from __future__ import annotations

import argparse
from pathlib import Path
from textwrap import shorten
from typing import Any

from aircraft_sysid_ros.commands.compare import percent
from aircraft_sysid_ros.commands.pictures import picture, picture_lines
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.diagnosis.flight.flight_data import AIRCRAFT
from aircraft_sysid_ros.diagnosis.model_versions.additions import Outcome, add
from aircraft_sysid_ros.diagnosis.model_versions.versions import MODELS, open_run
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.report.diagnosis_figures import errors_figure
from aircraft_sysid_ros.rounding import with_error

FIGURE = "errors.png"


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "add", help="an effect or a term added to the model, with the error before and after", description=__doc__,
        epilog=f"effects: {' '.join(sorted(BY_ID))}",
    )  # fmt: skip
    add_arguments(parser)
    return parser


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``add`` and ``remove`` take."""
    parser.add_argument("run", metavar="RUN", help="folder written by replay or live")
    parser.add_argument("what", metavar="EFFECT_OR_EXPRESSION", help='an id of the library, or "CZ: alpha**3"')


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Add and draw. Raises InputError."""
    with progress_bar() as progress:
        task = progress.add_task(f"add {args.what}", total=1.0)
        outcome = add(args.run, args.what, lambda share: progress.update(task, completed=share))
    return {"model": outcome.version.identifier, "added": outcome.label, **described(args.run, outcome, "with")}


def described(run: str, outcome: Outcome, word: str) -> dict[str, Any]:
    """What ``add`` and ``remove`` say of an outcome, and its figure in the folder of the version."""
    folder = Path(run) / MODELS / outcome.version.identifier
    label = shorten(outcome.label, 50, placeholder=" …")
    title = f"{word} {label}: {outcome.verdict}"
    figure, notes = picture(lambda: errors_figure(outcome.axes, folder / FIGURE, title))
    settings = [{"key": ".".join(key), "value": value} for key, value in outcome.change.settings]
    return {
        "axes": outcome.axes,
        "parameters": outcome.parameters,
        "settings": settings,
        "improved": outcome.improved,
        "verdict": outcome.verdict,
        "parents": list(outcome.version.parents),
        "aircraft": str(folder / AIRCRAFT),
        "figure": figure,
        "notes": [*open_run(run).notes, *notes],
    }


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    parents = f" from {' '.join(result['parents'])}" if result["parents"] else ", that of the run"
    lines = [f"model {result['model']}{parents}, held-out errors in % of the spread", ""]
    header = f"{'axis':<6}{'before':>8}{'after':>8}{'floor':>8}"
    lines += [header, "-" * len(header)]
    for name, errors in result["axes"].items():
        numbers = (percent(errors[key]) for key in ("error_before", "error_after", "noise_floor"))
        lines.append(f"{name:<6}" + "".join(f"{number:>8}" for number in numbers))
    lines.append("")
    lines += [_of_parameter(**p) for p in result["parameters"]]
    lines += [_of_setting(**setting, gone="removed" in result) for setting in result["settings"]]
    lines += [result["verdict"], f"aircraft file {result['aircraft']}", *picture_lines(result)]
    return "\n".join(lines)


def _of_parameter(name: str, value: float | None, std: float | None, status: str, reason: str, **_more: Any) -> str:
    if value is None or std is None:
        return f"{name} is not known: {reason}"
    return f"{name} = {with_error(value, std)}" + f", {status}: {reason}" * (status != "USE")


def _of_setting(key: str, value: float, gone: bool) -> str:
    if gone:
        return f"{key} is as it was before it was added"
    if "_position." in key:  # a place is moved, by shares of the span
        return f"{key} is {abs(value):.3g} of the span {'less' if value < 0.0 else 'more'} in the aircraft file"
    return f"{key} = {value:.4g} in the aircraft file"
