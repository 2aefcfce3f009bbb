"""``workbench``: a web page on this machine on which a run is compared, diagnosed and mended with a mouse.

With --live it is the page of a parameter node that runs: what it learns and lacks, and effects added in flight.
"""

from __future__ import annotations

import argparse
import os
import sys
import webbrowser
from collections.abc import Callable
from functools import partial
from typing import Any

from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.errors import InputError

#: Time [s] in which the run must have been read, and in which ROS must have started.
_READ_TIMEOUT, _START_TIMEOUT = 600.0, 120.0


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "workbench", help="a page on which the model is seen to fail, and mended", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", nargs="?", help="folder written by replay or live")
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
    try:
        from aircraft_sysid_ros.workbench.server import serve
    except ImportError as error:
        raise InputError(
            f"the page needs more packages ({error}): pip install 'aircraft_sysid_ros[workbench]'"
        ) from None
    session, make, title = _live(args) if args.live else _of_run(args)
    what, address = session.node if args.live else args.run, ""

    def ready(url: str) -> None:
        nonlocal address
        address = url
        print(f"workbench of {what} on {url} (Ctrl-C ends it)", file=sys.stderr, flush=True)
        if not args.no_browser and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            webbrowser.open(url)

    try:
        with progress_bar() as progress:
            progress.add_task("start ROS 2" if args.live else "read the run", total=None)
            session.wait(_START_TIMEOUT if args.live else _READ_TIMEOUT)
        serve(make, title, args.host, args.port, ready)
    finally:
        session.close()
    return {"run": str(what), "address": address}


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    return f"run {result['run']}"


def _check(args: argparse.Namespace) -> None:
    if not 0 <= args.port <= 65535:
        raise InputError(f"--port must be from 0 to 65535, not {args.port}")
    if args.live and (args.run or args.truth):
        raise InputError("--live shows a running node: give no RUN and no --truth with it")
    if not args.live and not args.run:
        raise InputError("give the folder of a run, or --live for a running node")
    if args.namespace and not args.live:
        raise InputError("--namespace is for --live: a run has none")


def _of_run(args: argparse.Namespace) -> tuple[Any, Callable[[str | None], object], str]:
    """Session, page and title of a run."""
    from aircraft_sysid_ros.workbench.page import Page
    from aircraft_sysid_ros.workbench.run_view import load_truth_view
    from aircraft_sysid_ros.workbench.session import Session

    session = Session(args.run, load_truth_view(args.truth))
    return session, partial(Page, session), session.path.name


def _live(args: argparse.Namespace) -> tuple[Any, Callable[[str | None], object], str]:
    """Session, page and title of a running node."""
    from aircraft_sysid_ros.workbench.live_page import LivePage
    from aircraft_sysid_ros.workbench.live_session import LiveSession

    session = LiveSession(args.namespace)
    return session, partial(LivePage, session), session.node.strip("/")
