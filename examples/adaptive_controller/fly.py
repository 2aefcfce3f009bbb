"""Fly closed-loop over ROS 2 topics: the aeroplane, the controller, and both estimator nodes in processes of their own.

    python examples/adaptive_controller/fly.py --case elevator --parameters live

Exit status 0: flown; 1: flown or lost while something did not work, which is said; 2: not flown.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import one_process
from one_process import CASES, CONTROLLERS, LARGEST_SEED

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.sensors.sensor_models import stamps_of
from aircraft_sysid_ros.simulation.closed_loop import Reading

#: The first start of the nodes compiles.
PATIENCE = 180.0
ESTIMATORS = ("state_estimator", "parameter_estimator")
#: What happens in each case, which nobody tells the controller.
EVENTS = {
    "none": "nothing happened",
    "elevator": "the elevator lost half of its effect",
    "aileron": "the ailerons lost half of their effect",
    "cg_aft": "the centre of gravity moved aft",
    "airspeed_blocked": "the pitot tube was blocked",
    "alpha_vane_stuck": "the vane of the angle of attack stuck",
    "gps_lost": "GPS was lost",
    "imu_bias_jump": "the biases of the IMU jumped",
}
#: Age [s] from which on parameters are told to be old.
LATE = 5.0
#: Share of samples without a command in time from which it is worth a sentence.
UNANSWERED = 0.02
#: Share of a tracking error by which another one must differ to be called better or worse.
MATTERS = 0.05
_LIBRARY = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1  # of prctl


def _end_with_parent() -> None:
    """In the new process: a termination when the parent ends, however it ends. Linux alone can."""
    if sys.platform == "linux":
        _LIBRARY.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


@contextlib.contextmanager
def estimators(aircraft_file: str) -> Iterator[list[subprocess.Popen]]:
    """Both estimator nodes, which end with the block."""
    options = {"aircraft_file": aircraft_file, "input_reliability": "reliable", "input_depth": 5000}
    parameters = [text for name, value in options.items() for text in ("-p", f"{name}:={value}")]
    started = [
        subprocess.Popen(
            [sys.executable, "-m", f"aircraft_sysid_ros.nodes.{name}", "--ros-args", *parameters],
            preexec_fn=_end_with_parent,  # noqa: PLW1509 (it takes no lock)
        )
        for name in ESTIMATORS
    ]
    try:
        yield started
    finally:
        for process in started:
            process.terminate()
        for process in started:
            try:
                process.wait(timeout=20.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@contextlib.contextmanager
def stop_or_hangup() -> Iterator[threading.Event]:
    """An event that a signal sets, that of a closed terminal too, unless it is ignored as under nohup."""
    from aircraft_sysid_ros.nodes.common import stop_signals

    with stop_signals() as stop:
        if signal.getsignal(signal.SIGHUP) == signal.SIG_DFL:
            signal.signal(signal.SIGHUP, lambda *_: stop.set())
        yield stop


def wait_until_heard(aeroplane: Any, spin: Callable[[float], None], processes: list[subprocess.Popen]) -> None:
    """Run callbacks until every topic has its listener; InputError if a node ended or it takes too long."""
    deadline = time.monotonic() + PATIENCE
    while missing := aeroplane.missing():
        spin(0.1)
        if any(process.poll() is not None for process in processes):
            raise InputError("an estimator node did not start: see its message above")
        if time.monotonic() > deadline:
            raise InputError(f"after {PATIENCE:g} s the aeroplane still waits for {', '.join(missing)}")


def fly(case: str, parameters: str, seed: int, rate: float, seconds: float) -> dict[str, Any]:
    """One flight; what came of it. Raises InputError where there is no ROS."""
    try:
        import rclpy
        from rclpy.parameter import Parameter
        from rclpy.signals import SignalHandlerOptions
    except ImportError as error:
        raise InputError(f"ROS 2 is not in this environment ({error}): use `make env` or source your ROS") from None
    from aeroplane_node import AeroplaneNode, Stopped, stoppable
    from controller_node import ControllerNode

    from aircraft_sysid_ros.nodes.common import make_executor

    path = str(config_path(DEFAULT_AIRCRAFT))
    common = {"aircraft_file": path, "case": case, "seed": seed}
    overrides = lambda **more: [Parameter(n, value=v) for n, v in {**common, **more}.items()]  # noqa: E731
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    nodes: list[Any] = []
    try:
        with stop_or_hangup() as stop, estimators(path) as processes, progress_bar() as progress:
            task = progress.add_task("starting the nodes", total=seconds)
            aeroplane = AeroplaneNode(parameter_overrides=overrides(rate=rate, duration=seconds))
            controller = ControllerNode(parameter_overrides=overrides(parameters=parameters))
            nodes += [aeroplane, controller]
            spin = stoppable(make_executor(nodes), stop)
            wait_until_heard(aeroplane, spin, processes)

            def fly_on(timeout: float) -> None:
                spin(timeout)
                progress.update(task, completed=aeroplane.aeroplane.time, description="flying")

            aeroplane.fly(fly_on)
            found = {**outcome(aeroplane, controller), "problems": problems(aeroplane, controller, processes)}
            if parameters != "live" or found["tracking_error_deg_after"] is None or found["lost_at"] is not None:
                return {**found, "seen": seen(found, parameters, None)}
            progress.update(task, description="the same flight on fixed parameters, in one process")
            fixed = on_fixed_parameters(case, seed, seconds)
            return {**found, "tracking_error_deg_fixed": fixed, "seen": seen(found, parameters, fixed)}
    except Stopped:
        raise InputError("stopped before the end of the flight") from None
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


def outcome(aeroplane: Any, controller: Any) -> dict[str, Any]:
    """Tracking error, and what the controller was told."""
    errors, change = [], aeroplane.case.time
    for flown, reading, _ in aeroplane.log:
        wanted = controller.references.get(int(stamps_of(flown)))
        if wanted is not None:
            bank, pitch, _ = euler_from_quaternion(reading[Reading.QUATERNION])
            errors.append((flown, bank - wanted[0], pitch - wanted[1]))
    table = np.array(errors)
    rms = lambda rows: float(np.degrees(np.sqrt(np.mean(rows[:, 1:] ** 2)))) if len(rows) else None  # noqa: E731
    source = controller.source
    return {
        "case": aeroplane.case.name,
        "seconds": aeroplane.aeroplane.time,
        "lost_at": float(aeroplane.lost_at) if np.isfinite(aeroplane.lost_at) else None,
        "tracking_error_deg_before": rms(table[table[:, 0] < change]),
        "tracking_error_deg_after": rms(table[table[:, 0] >= change]),
        "commands": controller.commands,
        "unanswered": aeroplane.unanswered,
        "messages_of_parameters": source.taken,
        "refused": source.refused,
        "age_of_newest_message": round(controller.age_of_parameters, 2) if source.newest is not None else None,
        "parameters_with_use": int(source.newest.usable.sum()) if source.newest is not None else 0,
    }


def on_fixed_parameters(case: str, seed: int, seconds: float) -> float | None:
    """Tracking error [deg] after the change, of the same flight on the aircraft file's parameters; None: it is lost."""
    chosen = replace(CASES[case], duration=seconds)
    flown = one_process.fly(load_aircraft(config_path(DEFAULT_AIRCRAFT)), chosen, "fixed", seed)
    error = float(np.degrees(flown.tracking_error(chosen.time)))
    return error if np.isfinite(error) and not np.isfinite(flown.lost_at) else None


def seen(result: dict[str, Any], parameters: str, fixed: float | None) -> str:
    """What was seen, and whether learning helped, in a sentence or two."""
    case, after = CASES[result["case"]], result["tracking_error_deg_after"]
    if result["lost_at"] is not None:
        return f"The aeroplane was lost after {result['lost_at']:.1f} s."
    if after is None:
        return f"The flight ended before anything happened: fly for {case.time:g} s and more to see it."
    told = (
        f"After {case.time:g} s {EVENTS[case.name]}; the tracking error was {result['tracking_error_deg_before']:.2f} "
        f"deg before and {after:.2f} deg after, on {parameters} parameters."
    )
    if parameters != "live":
        return told
    unanswered = result.get("unanswered", 0) / max(result.get("unanswered", 0) + result.get("commands", 0), 1)
    if unanswered > UNANSWERED:
        told += (
            f" For {unanswered:.0%} of the samples no command came in time: of these errors a part is the machine's."
        )
    age = result.get("age_of_newest_message") or 0.0
    if age > LATE:
        return (
            f"{told} The estimators did not keep up, the newest parameters are {age:.0f} s old: what learning does "
            "this flight does not tell. Fly more slowly: --rate 0.5 is half of real time, and 0 does not wait for the "
            "estimators."
        )
    if fixed is None:
        return f"{told} On fixed parameters the same flight loses the aeroplane: learning helped."
    share = after / fixed - 1.0
    verdict = (
        "learning helped" if share < -MATTERS else "learning did harm" if share > MATTERS else "it made no difference"
    )
    return f"{told} On fixed parameters it is {fixed:.2f} deg in the same air: {verdict} ({100.0 * share:+.0f} %)."


def lines_of(result: dict[str, Any]) -> list[str]:
    """The result for people: numbers with three digits, a dash for what is not there, and what was seen at the end."""
    shown = {key.replace("_", " "): value for key, value in result.items() if key not in ("problems", "seen")}
    texts = {key: f"{value:.3g}" if isinstance(value, float) else value for key, value in shown.items()}
    return [*(f"{key}: {'-' if text is None else text}" for key, text in texts.items()), result.get("seen", "")]


def problems(aeroplane: Any, controller: Any, processes: list[subprocess.Popen]) -> list[str]:
    """What did not work in flight, a sentence each."""
    controller.look()
    found = [
        f"{name} ended in flight (exit status {process.returncode})"
        for name, process in zip(ESTIMATORS, processes, strict=True)
        if process.poll() is not None
    ]
    if controller.messages.is_silent:
        age = f"{controller.age_of_parameters:.1f} s"
        newest = f"the newest message is {age} old" if controller.source.taken else f"none came in {age} of flight"
        found.append(f"the parameters stopped: {newest}")
    if aeroplane.unanswered > 0.5 * len(aeroplane.log):
        found.append(
            f"{aeroplane.unanswered} of {len(aeroplane.log)} samples had no answer in time: fly with a lower --rate"
        )
    return found


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--case", choices=list(CASES), default="elevator", help="what happens after 30 s")
    parser.add_argument("--parameters", choices=CONTROLLERS, default="live", help="what the controller flies on")
    parser.add_argument("--seed", type=int, default=1, help="of air, sensors and task")
    parser.add_argument(
        "--rate", type=float, default=1.0, help="times real time (0.1 to 100), or 0: in step with the controller"
    )
    parser.add_argument("--seconds", type=float, default=75.0, help="of flight")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    args = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    try:
        if not (args.rate == 0.0 or 0.1 <= args.rate <= 100.0) or not 1.0 <= args.seconds <= 3600.0:
            raise InputError("--rate must be 0 or from 0.1 to 100, and --seconds from 1 to 3600")
        if not 0 <= args.seed <= LARGEST_SEED:
            raise InputError(f"--seed must be from 0 to {LARGEST_SEED}, not {args.seed}")
        result = fly(args.case, args.parameters, args.seed, args.rate, args.seconds)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print(json.dumps(result) if args.json else "\n".join(lines_of(result)))
    for problem in result["problems"]:
        print(problem, file=sys.stderr)
    return 1 if result["problems"] else 0


if __name__ == "__main__":
    sys.exit(main())
