"""``workbench``: a web page on this machine on which a run is compared, diagnosed and mended with a mouse."""

from __future__ import annotations

import argparse
import os
import sys
import webbrowser
from typing import Any

from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.errors import InputError

#: Time [s] in which the run must have been read.
_READ_TIMEOUT = 600.0


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "workbench", help="a page on which the model is seen to fail, and mended", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", help="folder written by replay or live")
    parser.add_argument("--truth", metavar="BAG", help="simulated recording of the run, to show the truth too")
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to listen on (default: %(default)s, this machine only)"
    )
    parser.add_argument("--port", type=int, default=8350, help="port to listen on, 0 for any (default: %(default)s)")
    parser.add_argument("--no-browser", action="store_true", help="do not open a browser")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Serve until Ctrl-C; returns where. Raises InputError."""
    if not 0 <= args.port <= 65535:
        raise InputError(f"--port must be from 0 to 65535, not {args.port}")
    try:
        from aircraft_sysid_ros.workbench.server import serve
    except ImportError as error:
        raise InputError(
            f"the page needs more packages ({error}): pip install 'aircraft_sysid_ros[workbench]'"
        ) from None
    from aircraft_sysid_ros.workbench.run_view import load_truth_view
    from aircraft_sysid_ros.workbench.session import Session

    truth, address = load_truth_view(args.truth), ""
    session = Session(args.run, truth)

    def ready(url: str) -> None:
        nonlocal address
        address = url
        print(f"workbench of {args.run} on {url} (Ctrl-C ends it)", file=sys.stderr, flush=True)
        if not args.no_browser and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            webbrowser.open(url)

    try:
        with progress_bar() as progress:
            progress.add_task("read the run", total=None)
            session.wait(_READ_TIMEOUT)
        serve(session, args.host, args.port, ready)
    finally:
        session.close()
    return {"run": str(args.run), "address": address}


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    return f"run {result['run']}"
