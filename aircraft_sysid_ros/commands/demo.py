"""``demo``: a flight with a hidden effect, from sensor topics to the model that has it.

Flies the test flight, sends its sensors through real ROS 2 topics to the live nodes in another process, says where
the live model fails, which effect is missing, adds it, and compares everything with the truth.
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

from aircraft_sysid_ros.commands.options import state_table
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import DISCOVERY, missing_ros
from aircraft_sysid_ros.report.pyplot import pyplot

#: What the flight hides, and the flight that has all manoeuvres in it.
HIDDEN, MANOEUVRES = "dihedral_alpha", "standard"
#: Silence [s] after which the nodes take the flight for ended.
_IDLE = 3.0
_START_TIMEOUT = 300.0


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "demo", help="a flight with a hidden effect, through ROS 2, and how it is found", description=__doc__
    )
    parser.add_argument("--out", default="runs/demo", metavar="FOLDER", help="where results go (default: runs/demo)")
    parser.add_argument("--seed", type=int, default=1, help="of the flight (default: 1)")
    parser.add_argument("--rate", type=float, default=4.0, help="speed of the playback (default: 4)")
    parser.add_argument(
        "--effect", metavar="ID", help="effect to hide, in a flight that shows it (default: one that is not revealed)"
    )
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Simulate, play through the live nodes, find what is missing; returns what `live` found, the story, the truth."""
    if not 0.1 <= args.rate <= 50.0:
        raise InputError(f"--rate must be between 0.1 and 50, not {args.rate:g}")
    _check_installation()
    folder, started = Path(args.out), time.monotonic()
    folder.mkdir(parents=True, exist_ok=True)
    bag, run_folder, aircraft = folder / "flight", folder / "run", config_path(DEFAULT_AIRCRAFT)
    environment = _environment()
    _say("1/4 flying: 3-2-1-1, doublets and multisines on all controls, wind, sensor noise and biases;")
    _say("    the aeroplane does something that its model does not know")
    hidden = ("--effect", args.effect) if args.effect else ("--effect", HIDDEN, "--manoeuvres", MANOEUVRES)
    _call(environment, "simulate", "--out", bag, *hidden, "--seed", args.seed, "--overwrite", "--json")
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
    truth = json.loads(_truth_path(bag).read_text(encoding="utf8"))
    return {**json.loads(output), "truth": truth, "sent": sent, **_tell(folder, run_folder, truth, started)}


def _check_installation() -> None:
    """What is missing, said before the work. Raises InputError."""
    try:
        import aircraft_sysid_msgs  # noqa: F401
        import rclpy  # noqa: F401
    except ImportError as error:
        raise missing_ros(error) from None
    pyplot()


def _tell(folder: Path, run_folder: Path, truth: dict[str, Any], started: float) -> dict[str, Any]:
    """The story of the run, with its pictures; ``started``: reading of time.monotonic() when the demo began."""
    from aircraft_sysid_ros.commands.demo_story import FIGURE, STORY, story_json, tell
    from aircraft_sysid_ros.report.figures import coefficients_figure, learning_figure
    from aircraft_sysid_ros.report.story_figure import story_figure
    from aircraft_sysid_ros.run_writer import write_json

    _say("4/4 what the flight says about the model")
    story = tell(run_folder, lambda text: _say(f"    {text}"))
    told = story_json(story, truth)
    title, missing = f"{truth['aircraft']}, simulated flight", ", ".join(told["found"]) or "nothing"
    words = ("the model as it was", f"with what diagnose named: {missing}")
    pictures = (
        story_figure(story.before, story.after, story.failing_axis, folder / FIGURE, words),
        coefficients_figure(run_folder, folder / "coefficients.png", f"{title}: the live model"),
        learning_figure(run_folder, folder / "learning.png", f"{title}: the live model learns"),
    )
    told["elapsed"] = time.monotonic() - started
    write_json(folder / STORY, told)
    return {"story": told, "pictures": [str(path) for path in pictures]}


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    from aircraft_sysid_ros.commands.demo_story import story_text

    return "\n".join(
        [
            "",
            *story_text(result["story"]),
            f"{result['story']['duration']:.0f} s of flight, flown and explained in {result['story']['elapsed']:.0f} s",
            "",
            state_table(result["state"], result["truth"]),
            "",
            *(f"picture  {picture}" for picture in result["pictures"]),
            f"run      {result['run']}",
            "",
            *_next(result),
        ]
    )


def _next(result: dict[str, Any]) -> list[str]:
    """What to try now."""
    run, command = result["run"], "aircraft-sysid"
    program = Path(sys.executable).parent / command
    here = Path.cwd()
    if program.is_file():
        command = str(program.relative_to(here) if program.is_relative_to(here) else program)
    return [
        "what to try next:",
        f"  {command} compare {run}",
        *(f'  {command} remove {run} "{what}"' for what in result["story"]["found"][-1:]),
        f"  {command} diagnose {run}",
        f'  {command} add {run} "Cl: alpha*da"   # any term of your own',
        f"  {command} refine {run}   # maximum likelihood, some minutes",
        f"  {command} demo --effect control_damage --seed 2 --out runs/damage   # another effect",
    ]


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _environment() -> dict[str, str]:
    """A domain of its own, on this machine only, unless the user chose one."""
    environment = dict(os.environ)
    environment.setdefault("ROS_DOMAIN_ID", str(50 + os.getpid() % 50))
    environment.setdefault(DISCOVERY, "LOCALHOST")
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
        "live", "--aircraft", aircraft, "--out", run_folder, "--overwrite", "--reliable", "--until-idle", _IDLE,
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
