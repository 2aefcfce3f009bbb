"""``demo``: the main job, from sensor topics to live parameters, on a simulated flight with known truth.

Flies the test flight, sends its sensors through real ROS 2 topics to the live nodes in another process, and
compares what they publish with the truth.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.commands.options import parameter_table, state_table
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.errors import InputError

#: Silence [s] after which the nodes take the flight for ended.
_IDLE = 3.0
_START_TIMEOUT = 300.0


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "demo", help="the main job on a simulated flight, through ROS 2", description=__doc__
    )
    parser.add_argument(
        "--out", default="runs/demo", metavar="FOLDER", help="where results go (default: runs/demo)"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the flight (default: 1)")
    parser.add_argument("--rate", type=float, default=4.0, help="speed of the playback (default: 4)")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Simulate, play through the live nodes, compare; returns what `live` found, and the truth."""
    if not 0.1 <= args.rate <= 50.0:
        raise InputError(f"--rate must be between 0.1 and 50, not {args.rate:g}")
    folder = Path(args.out)
    folder.mkdir(parents=True, exist_ok=True)
    bag, run_folder, aircraft = folder / "flight", folder / "run", config_path(DEFAULT_AIRCRAFT)
    environment = _environment()
    _say("1/4 flying: 3-2-1-1, doublets and multisines on all controls, wind, sensor noise and biases")
    _call(environment, "simulate", "--out", bag, "--seed", args.seed, "--overwrite", "--json")
    _say("2/4 starting the state estimator and the parameter estimator")
    live = _start_live(environment, aircraft, run_folder)
    try:
        _say(f"3/4 playing its sensors onto ROS 2 topics, {args.rate:g} times real time")
        sent = _call(environment, "play", bag, "--rate", args.rate, "--json")
        output = live.communicate(timeout=120.0)[0]
    finally:
        live.kill()
    if live.returncode:
        raise InputError("the live nodes ended early: see the messages above")
    _say("4/4 comparing with the truth")
    truth = json.loads(_truth_path(bag).read_text(encoding="utf8"))
    pictures = _pictures(run_folder, folder, truth["aircraft"])
    return {**json.loads(output), "truth": truth, "pictures": pictures, "sent": sent}


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    truth = result["truth"]
    parameters = result["parameters"]["parameters"]
    known = [p for p in parameters if p["value"] is not None and p["std"]]
    within = sum(abs(p["value"] - truth["coefficients"][p["name"]]) <= 3.0 * p["std"] for p in known)
    return "\n".join(
        [
            "",
            parameter_table(parameters, truth["coefficients"]),
            "",
            state_table(result["state"], truth),
            "",
            f"{within} of {len(parameters)} parameters are within three standard errors of the truth.",
            *(f"picture  {picture}" for picture in result["pictures"]),
            f"run      {result['run']}",
        ]
    )


def _pictures(run_folder: Path, folder: Path, name: str) -> list[str]:
    """Measured against predicted coefficients, and how the error fell while flying."""
    from aircraft_sysid_ros.report.figures import coefficients_figure, learning_figure

    title = f"{name}, simulated flight"
    drawn = (
        coefficients_figure(run_folder, folder / "coefficients.png", title),
        learning_figure(run_folder, folder / "learning.png", f"{title}: the live model learns"),
    )
    return [str(path) for path in drawn]


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _environment() -> dict[str, str]:
    """A domain of its own, on this machine only, unless the user chose one."""
    environment = dict(os.environ)
    environment.setdefault("ROS_DOMAIN_ID", str(50 + os.getpid() % 50))
    environment.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    return environment


def _command(*arguments: Any) -> list[str]:
    return [sys.executable, "-m", "aircraft_sysid_ros.commands.main", *map(str, arguments)]


def _call(environment: dict[str, str], *arguments: Any) -> Any:
    """Run a command of ours, its progress on this terminal; returns its JSON."""
    done = subprocess.run(_command(*arguments), env=environment, stdout=subprocess.PIPE, check=False)
    if done.returncode:
        raise InputError(f"the step '{arguments[0]}' failed: see the message above")
    return json.loads(done.stdout)


def _start_live(environment: dict[str, str], aircraft: Path, run_folder: Path) -> subprocess.Popen[bytes]:
    """The live nodes in a process of their own, ready to listen."""
    marker = run_folder.with_suffix(".ready")
    marker.unlink(missing_ok=True)
    command = _command(
        "live", "--aircraft", aircraft, "--out", run_folder, "--overwrite", "--until-idle", _IDLE,
        "--ready-file", marker, "--json",
    )  # fmt: skip
    live = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE)
    deadline = time.monotonic() + _START_TIMEOUT
    while not marker.exists():
        if live.poll() is not None or time.monotonic() > deadline:
            live.kill()
            raise InputError("the live nodes did not start: see the messages above")
        time.sleep(0.1)
    marker.unlink()
    return live


def _truth_path(bag: Path) -> Path:
    from aircraft_sysid_ros.simulation.truth_files import truth_path

    return truth_path(bag, ".json")
