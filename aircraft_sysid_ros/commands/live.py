"""``live``: all nodes on ROS 2 topics in one process, and with --out the same run folder as ``replay``.

Ctrl-C or a termination ends it: what has come is used, and then the run is written. Exit status 1: with --reliable
messages were lost all the same; the run is of those that came.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict
from typing import Any

from rich.progress import Progress

from aircraft_sysid_ros.after_flight.delay_notes import delay_notes
from aircraft_sysid_ros.after_flight.replay_notes import (
    air_data_error_notes,
    estimator_notes,
    flight_notes,
    place_notes,
    prior_notes,
    rate_notes,
    why_no_start,
)
from aircraft_sysid_ros.aircraft.configuration import load_aircraft, with_prior
from aircraft_sysid_ros.calibration.calibration_file import load_calibration
from aircraft_sysid_ros.commands.options import add_estimator_options, add_prior_options, estimator_options
from aircraft_sysid_ros.commands.progress import progress_bar, say_ready
from aircraft_sysid_ros.commands.replay import render as render_run
from aircraft_sysid_ros.errors import IncompleteError, InputError
from aircraft_sysid_ros.identification.coefficients.flow_angles import VANES
from aircraft_sysid_ros.identification.coefficients.pace import stamped_behind
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.installation import missing_ros, start_ros, stay_local
from aircraft_sysid_ros.nodes.inputs import drain, lost_in_words
from aircraft_sysid_ros.reconstruction.absences import absences
from aircraft_sysid_ros.reconstruction.found_noise import noise_notes
from aircraft_sysid_ros.reconstruction.options import LONGEST_WAIT, StateOptions
from aircraft_sysid_ros.run_writer import RunWriter, state_json

#: Why a node of ``live`` cannot be cleaned up from outside.
_KEPT = "live gives the result of the flight when Ctrl-C ends it; ~/reset restarts the estimates"


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "live", help="all nodes on ROS 2 topics", description=__doc__
    )
    parser.add_argument("--aircraft", required=True, metavar="FILE", help="aircraft file (YAML)")
    parser.add_argument("--out", metavar="RUN", help="folder to write at the end")
    parser.add_argument("--calibration", metavar="FILE", help="calibration file of `calibrate`: sensors are corrected")
    parser.add_argument("--overwrite", action="store_true", help="replace a run that is there")
    parser.add_argument("--namespace", default="", metavar="NS", help="namespace of the nodes and their topics")
    parser.add_argument("--reliable", action="store_true", help="ask publishers for every sample, as for a playback")
    parser.add_argument(
        "--until-idle",
        type=float,
        metavar="S",
        help="end when no sample came for S seconds after the first (default: run until Ctrl-C)",
    )
    parser.add_argument("--ready-file", metavar="FILE", help="file to create when the nodes listen, for scripts")
    add_estimator_options(parser)
    add_prior_options(parser)
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Run the nodes until Ctrl-C or silence; returns state and parameters. Raises InputError."""
    options = estimator_options(args)
    if args.until_idle is not None and not 0.0 < args.until_idle < 1e6:
        raise InputError(f"--until-idle must be a positive time in s, not {args.until_idle:g}")
    aircraft = with_prior(load_aircraft(args.aircraft), args.prior, args.airframe)
    in_progress: dict[str, Any] = {"state": asdict(options[0]), "parameters": asdict(options[1])}
    if args.calibration:
        given = load_calibration(args.calibration).source
        content = {key: given[key] for key in given if key != "source"}  # which is free text
        in_progress["calibration"] = {"file": str(args.calibration), "content": content}
    writer = None
    if args.out:
        writer = RunWriter(args.out, aircraft, overwrite=args.overwrite, in_progress=in_progress, say=_say)
        if writer.kept_aside:
            _say(writer.kept_aside)
    with writer or nullcontext():
        result = _with_nodes(args, options, writer)
    missing = lost_in_words(result["lost"])
    if args.reliable and missing:
        raise IncompleteError(f"{missing}; the result is from those that came", result)
    return result


def _say(text: str) -> None:
    """A line beside the result, at once."""
    print(f"aircraft-sysid live: {text}", file=sys.stderr, flush=True)


def _with_nodes(
    args: argparse.Namespace, options: tuple[StateOptions, ParameterOptions], writer: RunWriter | None
) -> dict[str, Any]:
    """Start both nodes, fly, and take them down."""
    try:
        import rclpy
        from rclpy.exceptions import NameValidationException

        from aircraft_sysid_ros.nodes.common import start, stop_signals
    except ImportError as error:
        raise missing_ros(error) from None
    arguments = _node_arguments(args, *options)
    said = stay_local()
    start_ros(args.ros_args)  # a signal ends what runs, not ROS under it
    from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
    from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode

    nodes: list[Any] = []
    try:
        nodes.extend(kind(**arguments) for kind in (StateEstimatorNode, ParameterEstimatorNode))
        state, parameters = nodes
        state.on_states, parameters.hears_states = parameters.take_states, False
        if writer is not None:
            state.on_rows, parameters.on_points = writer.add_rows, writer.add_points
            parameters.on_parameters = writer.add_parameters
            state.on_samples = parameters.on_samples = writer.add_samples
        state.must_keep = parameters.must_keep = _KEPT
        state.together = parameters.together = (state, parameters)
        with stop_signals() as stop:  # a signal would tear a compilation apart
            stop.doing = "stopping: a compilation is finished first"
            has_started = start(state) and (stop.is_set() or start(parameters))
        if stop.is_set():
            raise KeyboardInterrupt
        if not has_started:
            raise InputError("the nodes did not start: see the messages above")
        return _fly(args, state, parameters, writer, said)
    except NameValidationException as error:
        raise InputError(f"--namespace {args.namespace} is not a namespace: {error}") from None
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    return render_run(result)


def _node_arguments(args: argparse.Namespace, state: StateOptions, parameters: ParameterOptions) -> dict[str, Any]:
    """What both nodes are made with; a parameter that a node does not declare is not looked at."""
    from rclpy.parameter import Parameter

    values = {
        "aircraft_file": str(args.aircraft),
        "calibration_file": str(args.calibration or ""),
        "prior": str(args.prior or ""),
        "airframe": str(args.airframe or ""),
        "input_reliability": "reliable" if args.reliable else "best_effort",
        **asdict(state),
        **asdict(parameters),
    }
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    namespace = args.namespace.strip("/")
    return {"parameter_overrides": overrides, "namespace": f"/{namespace}" if namespace else None}


def _fly(args: argparse.Namespace, state: Any, parameters: Any, writer: RunWriter | None, said: str) -> dict[str, Any]:
    """Listen until it is to end, use what has come by then, and write the run."""
    from aircraft_sysid_ros.nodes.common import (
        all_have_it,
        make_executor,
        spare_the_collector,
        spin_until,
        stop_signals,
    )

    executor = make_executor([state, parameters])
    spare_the_collector()
    with progress_bar() as progress, stop_signals() as stop:
        print(f"listening{': ' if said else ''}{said}", file=sys.stderr, flush=True)
        say_ready(args.ready_file)
        started = time.perf_counter()
        spin_until(executor, _finished(state, parameters, args.until_idle, stop, progress))
        drain([*state.inputs, *parameters.inputs], stop.left)
        state.end()
        parameters.end()
        stop.doing = "stopping: the run is being written"
        result = _result(args, state, parameters, writer, started)
        all_have_it([*state.publishers_that_matter(), *parameters.publishers_that_matter()], stop)
    return result


def _finished(
    state: Any, parameters: Any, until_idle: float | None, stop: Any, progress: Progress
) -> Callable[[], bool]:
    """Whether to end: after Ctrl-C, silence or the shutdown of a node; shows what has come."""
    last = {"count": 0, "time": time.perf_counter()}
    task = progress.add_task("listening", total=None)

    def finished() -> bool:
        count, now = sum(state.received.values()), time.perf_counter()
        if count != last["count"]:
            last.update(count=count, time=now)
            progress.update(task, description=f"{count} samples, {state.rows_published} states")
        if stop.is_set() or state.is_over or parameters.is_over:
            return True
        return until_idle is not None and count > 0 and now - last["time"] > until_idle

    return finished


def _late(state: Any, parameters: Any) -> dict[str, int]:
    """How many samples of each kind came after their time was used."""
    counts = {kind: c["late"] for kind, c in state.counts().items()}
    counts["controls"] = counts.get("controls", 0) + parameters.late
    of_first_step = sum(counts.get(kind.name.lower(), 0) for kind, _ in VANES)
    counts["vanes, for the parameters"] = max(parameters.late_vanes - of_first_step, 0)
    return {kind: count for kind, count in counts.items() if count}


def _far_behind(state: Any, parameters: Any) -> dict[str, float]:
    """Kinds that came later than either step can wait, and by how much [s] at least."""
    far = {kind.name.lower(): late for kind, late in state.order.counts.far_behind(LONGEST_WAIT).items()}
    if (behind := parameters.stream.controls.pace.behind) > LONGEST_WAIT:
        far["controls"] = behind
    return far


def _late_notes(late: dict[str, int], far: dict[str, float]) -> list[str]:
    """What came too late, and whether waiting would help."""
    notes = [f"{late[kind]} of {kind} came too late, {stamped_behind(far[kind])}" for kind in far if kind in late]
    if near := ", ".join(f"{count} of {kind}" for kind, count in late.items() if kind not in far):
        notes.append(f"samples came too late to be used at their own time ({near}): a longer --horizon waits for them")
    return notes


def _changed_note(changed: dict[str, Any]) -> str:
    listed = ", ".join(f"{name} = {value}" for name, value in changed.items())
    return f"parameters were set in flight ({listed}): a replay, which has one set of options, gives other numbers"


def _why_no_state(state: Any) -> str:
    count = sum(state.received.values())
    if not count:
        return "no message came: the drivers or `bridge` must run with the same ROS_DOMAIN_ID and --namespace"
    return f"no state was estimated from {count} messages: {why_no_start(state.estimator)}"


def _result(args: argparse.Namespace, state: Any, parameters: Any, writer: Any, started: float) -> dict[str, Any]:
    if not state.rows_published:
        raise InputError(_why_no_state(state))
    state.check.finish(state.estimator.epoch)
    parameters.estimator.learning.imu_is_late = state.check.has_late_imu
    flight_time = state.estimator.flight_time
    late, lost = _late(state.estimator, parameters.estimator), dict(state.lost)
    for topic, count in parameters.lost.items():  # with some estimators both hear a topic
        lost[topic] = max(count, lost.get(topic, 0))
    changed = {**state.set_in_flight, **parameters.set_in_flight}
    told = (
        *_late_notes(late, _far_behind(state.estimator, parameters.estimator)),
        lost_in_words(lost),
        _changed_note(changed) if changed else "",
        *state.noted,
        *parameters.noted,
        state.shared_in_words,
        *state.check.words,
        *flight_notes(state.estimator, parameters.estimator),
    )
    result: dict[str, Any] = {
        "received": {**state.received, **parameters.received},
        "states": [state.rows_published, parameters.states_received],
        "late": late,
        "lost": lost,
        "notes": [
            *(note for note in told if note),
            *estimator_notes(parameters.estimator),
            *rate_notes(parameters.estimator.stream),
            *air_data_error_notes(state.estimator),
            *place_notes(parameters.estimator.aircraft, state.estimator.options.air_data_errors),
            *absences(state.estimator),
            *noise_notes(state.estimator),
            *delay_notes(parameters.estimator),
            *prior_notes(parameters.estimator),
        ],
    }
    if writer is None:
        from aircraft_sysid_ros.identification.model_file import parameters_json

        elapsed = time.perf_counter() - started
        timing = {"duration": flight_time, "realtime_factor": flight_time / elapsed}
        return {
            **result,
            "run": None,
            "state": {**state_json(state.estimator), **timing},
            "parameters": parameters_json(parameters.estimator),
        }
    kept = [note for note in told if note]
    written = writer.finish(
        state.estimator, parameters.estimator, flight_time, started, kept, calibration=args.calibration
    )
    return {**result, "run": str(args.out), **written}
