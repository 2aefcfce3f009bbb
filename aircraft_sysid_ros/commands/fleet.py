"""``fleet``: many flights at once, and what changes from flight to flight and differs between airframes."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.after_flight.diagnose import FEWEST, MOST
from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.commands.progress import counting
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import COUNT
from aircraft_sysid_ros.errors import IncompleteError, InputError
from aircraft_sysid_ros.fleet.fleet import Asked, Fleet, fly_fleet
from aircraft_sysid_ros.fleet.flights import Files
from aircraft_sysid_ros.rounding import with_error

#: Flights with a verdict that are listed; all of them are on the page and in the tables.
_MOST_LISTED = 10


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "fleet", help="many flights at once, and what changes between them", description=__doc__
    )
    add = parser.add_argument
    add("sources", nargs="+", metavar="SOURCE",
        help="recordings, logs, folders of them, patterns in quotes, or lists of flights (.yaml, .csv)")  # fmt: skip
    add(
        "--aircraft",
        metavar="FILE",
        help="aircraft file; {airframe} in the name of a file stands for that of each flight",
    )
    add("--out", required=True, metavar="DIR", help="folder of the tables and the page; one that is there is continued")
    add("--scheduler", metavar="ADDRESS", help="Dask scheduler, as tcp://host:8786 (default: one on this machine)")
    add("--workers", type=int, metavar="N", help="flights at a time on this machine (default: its cores)")
    add("--time-limit", type=float, default=1800.0, metavar="S", help="longest time of a flight (default %(default)s)")
    add("--replicas", type=int, default=COUNT, metavar="N", help="as for diagnose (default %(default)s)")
    add("--no-diagnosis", action="store_true",
        help="leave out diagnose, which takes most of the time: what changes is learnt without it")  # fmt: skip
    add("--map", metavar="MAP", help="which column is which signal, as for import: tables are flights, too")
    add("--servos", metavar="FILE", help="what the outputs of an autopilot mean, as for import")
    add("--calm-air", action="store_true",
        help="as for replay: where no airspeed is measured, the speed over ground is used")  # fmt: skip
    add("--runs", action="store_true", help="keep the run of every flight, in DIR/runs")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Fly the fleet; returns counts, changes and files. Raises InputError."""
    _check(args)
    asked = Asked(
        sources=args.sources,
        files=Files(args.aircraft, args.map, args.servos, args.calm_air),
        out=Path(args.out),
        replicas=0 if args.no_diagnosis else args.replicas,
        time_limit=args.time_limit,
        runs=args.runs,
        scheduler=args.scheduler,
        workers=args.workers,
    )
    with counting("look for flights") as tell, _ended_as_by_ctrl_c():
        fleet = fly_fleet(asked, tell, _say)
    result = fleet.json
    if not fleet.ok:
        raise IncompleteError(f"none of {len(fleet.flown)} flights could be used, {_first_reason(fleet)}", result)
    return result


@contextmanager
def _ended_as_by_ctrl_c() -> Iterator[None]:
    """What SIGTERM ends says what is done, and leaves no folders of half a flight behind."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _say(text: str) -> None:
    print(text, file=sys.stderr)


def _first_reason(fleet: Fleet) -> str:
    first = fleet.flown[0]
    return f"such as {first.flight.name}: {first.answer['reason']}"


def _check(args: argparse.Namespace) -> None:
    if not FEWEST <= args.replicas <= MOST:
        raise InputError(f"--replicas must be from {FEWEST} to {MOST}, not {args.replicas}")
    if not 1.0 <= args.time_limit <= 1e6:
        raise InputError(f"--time-limit must be from 1 to 1000000 s, not {args.time_limit:g}")
    if args.workers is not None and args.scheduler:
        raise InputError("--workers is for this machine, and --scheduler has its own: leave one of them out")
    if args.workers is not None and not 1 <= args.workers <= 1000:
        raise InputError(f"--workers must be from 1 to 1000, not {args.workers}")


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    airframes = len(result["airframes"])
    of = f"{airframes} airframe{'s' if airframes != 1 else ''}"
    lines = [f"{result['ok']} of {result['flights']} flights of {of}", ""]
    lines += [f"  {f['flight']}: {f['reason']}" for f in result["failures"]]
    lines += [""] if result["failures"] else []
    lines += [_change_line(change) for change in result["changes"]] or [
        result["too_few"] or "nothing changes between flights"
    ]
    lines += [_difference_line(each) for each in result["differences"]]
    lines += [_effect_line(each) for each in result["effects"]]
    lines += list(_verdict_lines(result["verdicts"]))
    return "\n".join(["", *lines, "", *note_lines(result["notes"]), f"page {result['page']}"][1:])


def _verdict_lines(verdicts: Sequence[dict[str, Any]]) -> Iterator[str]:
    """What `diagnose` found in single flights."""
    if not verdicts:
        return
    yield ""
    yield "diagnose found in single flights, of which some may be false alarms:"
    for each in verdicts[:_MOST_LISTED]:
        yield f"  {each['flight']}: {each['verdict']}{': ' * bool(each['effects'])}{', '.join(each['effects'])}"
    if len(verdicts) > _MOST_LISTED:
        yield f"  and in {len(verdicts) - _MOST_LISTED} more: the page and verdicts.parquet have them"


def _change_line(change: dict[str, Any]) -> str:
    size = "+" * (change["size"] > 0.0) + with_error(change["size"], change["std"])
    what = f"drifts by {size} per flight" if change["kind"] == "drift" else f"jumps by {size}"
    since = f" from {change['flight']}" if change["flight"] else ""
    return f"{change['airframe']}: {change['parameter']} {what}{since}, p {change['p_value']:.1g}"


def _difference_line(each: dict[str, Any]) -> str:
    return (
        f"{each['airframe']}: {each['parameter']} is {with_error(each['value'], each['std'])}, "
        f"of the others {with_error(each['others'], each['others_std'])}, p {each['p_value']:.1g}"
    )


def _effect_line(each: dict[str, Any]) -> str:
    return f"{each['airframe']}: {each['effect']} comes back, in {each['flights']} of {each['of']} flights"
