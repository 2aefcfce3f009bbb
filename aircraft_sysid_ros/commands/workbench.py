"""``workbench``: a web page on this machine on which a run is compared, diagnosed and corrected with a mouse.

RUN may also be the folder of a calibration; with --calibration both are on one page. Several runs, or a folder that
holds runs, have a list to choose from, and any two are shown side by side. With --live it is the page of a
parameter node that runs: what it learns and lacks, and effects added in flight.
"""

from __future__ import annotations

import argparse
import os
import sys
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from types import ModuleType
from typing import Any

from aircraft_sysid_ros.commands.folders import check_folder, holds_runs
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import MissingExtra
from aircraft_sysid_ros.run_reader import AIRCRAFT

Tell = Callable[[str, float], None]
Make = Callable[[str | None, str | None], object]

#: Time [s] in which the run must have been read, and in which ROS must have started.
_READ_TIMEOUT, _START_TIMEOUT = 600.0, 120.0
OPEN = "with --host {} anybody who can reach this machine can change the run, there is no password"


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "workbench", help="a page that shows where the model fails, and corrects it", description=__doc__
    )
    parser.add_argument(
        "run",
        metavar="RUN",
        nargs="*",
        help="folder written by replay or live, or by calibrate, or one that holds runs",
    )
    parser.add_argument("--calibration", metavar="FOLDER", help="folder written by calibrate, to show with the run")
    parser.add_argument("--truth", metavar="BAG", help="simulated recording of the run, to show the truth too")
    parser.add_argument("--live", action="store_true", help="show a running parameter node instead of a run")
    parser.add_argument("--namespace", default="", metavar="NS", help="namespace of the nodes, with --live")
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to listen on (default: %(default)s, this machine only)"
    )
    parser.add_argument("--port", type=int, default=8350, help="port to listen on, 0 for any (default: %(default)s)")
    parser.add_argument("--no-browser", action="store_true", help="do not open a browser")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Serve until Ctrl-C; returns where. Raises InputError."""
    _check(args)
    what, found = _name(args), ""

    def ready(urls: list[str]) -> None:
        nonlocal found
        found = urls[0]
        _announce(args, what, urls)

    with ExitStack() as stack:
        with _telling() as tell:
            tell(f"reading {_name(args)}" if args.run else "starting", 0.0)
            server = _server()
            listener = stack.enter_context(server.listen(args.host, args.port))  # before the work: it may be in use
            session, make, title = _live(args) if args.live else _of_folder(args)
            stack.callback(session.close)
            session.wait(_START_TIMEOUT if args.live else _READ_TIMEOUT, tell)
        server.serve(make, title, args.host, listener, ready)
    return {"run": str(what), "address": found}


def _name(args: argparse.Namespace) -> str:
    """What the page is of: a folder, or the node that runs."""
    return (
        "/".join(filter(None, ("", args.namespace.strip("/"), "parameter_estimator")))
        if args.live
        else " ".join(args.run)
    )


def _server() -> ModuleType:
    """The module of the server. Raises InputError where its packages are not installed."""
    try:
        from aircraft_sysid_ros.workbench import server
    except ImportError:
        raise MissingExtra("pages", "nicegui and plotly", "workbench") from None
    return server


def _announce(args: argparse.Namespace, what: str, urls: list[str]) -> None:
    """Say where the page is and who can reach it; open it where there is a screen."""
    print(f"workbench of {what} on {' and '.join(urls)} (Ctrl-C ends it)", file=sys.stderr, flush=True)
    if not _server().is_private(args.host):
        print(f"warning: {OPEN.format(args.host)}", file=sys.stderr, flush=True)
    if not args.no_browser and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        webbrowser.open(urls[0])


@contextmanager
def _telling() -> Iterator[Tell]:
    """What is being done, on stderr: a bar on a terminal, elsewhere a line for each step."""
    with progress_bar() as bar:
        task, said = bar.add_task("", total=1.0), ""

        def tell(what: str, share: float) -> None:
            nonlocal said
            bar.update(task, description=what, completed=share)
            if bar.disable and what and what != said:
                print(what, file=sys.stderr, flush=True)
            said = what or said

        yield tell


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    return f"run {result['run']}"


def _check(args: argparse.Namespace) -> None:
    if not 0 <= args.port <= 65535:
        raise InputError(f"--port must be from 0 to 65535, not {args.port}")
    if args.live and (args.run or args.truth or args.calibration):
        raise InputError("--live shows a running node: give no RUN, --truth or --calibration with it")
    if not args.live and not args.run:
        raise InputError("give the folder of a run, or --live for a running node")
    several = len(args.run) > 1
    for path in args.run:
        if not os.path.exists(path):
            raise InputError(f"{path} is not there: give the folder that replay, live or calibrate has written")
        if not holds_runs(path):
            check_folder(path)
        if several and not os.path.exists(os.path.join(path, AIRCRAFT)):
            raise InputError(f"{path} is not a run: with several folders each must be one that replay or live wrote")
    if len({os.path.realpath(path) for path in args.run}) < len(args.run):
        raise InputError("a run is given twice: name each one once")
    if (several or any(map(holds_runs, args.run))) and (args.truth or args.calibration):
        raise InputError("--truth and --calibration are for one run")
    if args.namespace and not args.live:
        raise InputError("--namespace is for --live: a run has none")


def _of_folder(args: argparse.Namespace) -> tuple[Any, Make, str]:
    """Session, page and title of a run, of several, or of a calibration alone."""
    from aircraft_sysid_ros.workbench.calibration_view import CalibrationFolder, is_calibration

    if len(args.run) > 1 or holds_runs(args.run[0]):
        return _of_several(args)
    path = args.run[0]
    if is_calibration(path):
        return _of_calibration(args)
    from aircraft_sysid_ros.workbench.page import Page
    from aircraft_sysid_ros.workbench.run_view import load_truth_view
    from aircraft_sysid_ros.workbench.session import Session

    folder = CalibrationFolder(args.calibration) if args.calibration else None
    session = Session(path, load_truth_view(args.truth), folder)
    return session, lambda theme, name: Page(session, theme), session.name


def _of_several(args: argparse.Namespace) -> tuple[Any, Make, str]:
    from aircraft_sysid_ros.workbench.shelf import Shelf
    from aircraft_sysid_ros.workbench.shelf_page import shelf_page

    shelf = Shelf(args.run)
    return shelf, partial(shelf_page, shelf), shelf.title


def _of_calibration(args: argparse.Namespace) -> tuple[Any, Make, str]:
    from aircraft_sysid_ros.workbench.calibration_panel import CalibrationPage, CalibrationSession
    from aircraft_sysid_ros.workbench.calibration_view import CalibrationFolder

    if args.calibration or args.truth:
        raise InputError(f"{args.run[0]} is a calibration: --calibration and --truth are for a run")
    session = CalibrationSession(CalibrationFolder(args.run[0]))
    return session, lambda theme, name: CalibrationPage(session, theme), session.folder.path.resolve().name


def _live(args: argparse.Namespace) -> tuple[Any, Make, str]:
    """Session, page and title of a running node."""
    from aircraft_sysid_ros.workbench.live_page import LivePage
    from aircraft_sysid_ros.workbench.live_session import LiveSession

    session = LiveSession(args.namespace)
    return session, lambda theme, name: LivePage(session, theme), session.node.strip("/")
