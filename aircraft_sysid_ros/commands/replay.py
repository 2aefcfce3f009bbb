"""``replay``: the whole pipeline over recordings, as fast as the machine can, with the numbers of live."""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.calibration.calibration_file import load_calibration
from aircraft_sysid_ros.calibration.correction import Correction
from aircraft_sysid_ros.calibration.filter_start import LONGEST, start_by_stage_1, start_of_calibration
from aircraft_sysid_ros.calibration.segments import SHORTEST
from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.commands.options import (
    add_estimator_options,
    estimator_options,
    parameter_table,
    state_table,
)
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.coefficients.pace import (
    CHANGE,
    LOWEST_RATE,
    SPARSEST_CONTROLS,
    too_slow,
    why_airspeed_too_slow,
)
from aircraft_sysid_ros.identification.coefficients.stream import CoefficientStream
from aircraft_sysid_ros.identification.physical_bounds import check_bounds
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.absences import absences
from aircraft_sysid_ros.reconstruction.air_data_errors import StartValues
from aircraft_sysid_ros.reconstruction.alignment import LARGEST_GAP
from aircraft_sysid_ros.reconstruction.smoother_history import SmootherHistory
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator, nanoseconds, warm_up
from aircraft_sysid_ros.recordings.manoeuvres import Body, read_body
from aircraft_sysid_ros.recordings.message_types import known_types
from aircraft_sysid_ros.recordings.reader import Recording
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC, NANOSECONDS
from aircraft_sysid_ros.run_writer import RunWriter
from aircraft_sysid_ros.samples import SAME_FLIGHT, Kind, Samples, manoeuvre_at, manoeuvres

Array = npt.NDArray[np.float64]

#: What the filter can start with beside the IMU, by kind of sample: name, topic, and what is wrong with samples that
#: are invalid.
_START_WITH = {
    "gps_position": ("GPS position", "gps/fix", "no fix (status -1, or latitude and longitude 0) or no usable numbers"),
    "gps_velocity": ("GPS velocity", "gps/vel", "no usable numbers"),
    "airspeed": ("airspeed", "air_data", "no usable numbers or stand still"),
}
#: Time of flight [s] between parameter sets in the run.
PARAMETERS_PERIOD = 1.0
#: A silence [s] of a sensor that is worth a note.
LONGEST_SILENCE = 2.0
#: Samples that go through the pipeline at a time; the numbers do not depend on it.
BLOCK = 1000


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "replay", help="the whole pipeline over recordings", description=__doc__
    )
    parser.add_argument(
        "bags", nargs="+", metavar="BAG", help="rosbag2 folder, .mcap or .db3 file; several make one body of data"
    )
    parser.add_argument(
        "--segments",
        metavar="FILE",
        help="YAML list of {recording, start, stop, name}, in seconds: only these manoeuvres",
    )
    parser.add_argument("--aircraft", required=True, metavar="FILE", help="aircraft file (YAML)")
    parser.add_argument("--out", required=True, metavar="RUN", help="folder to write")
    parser.add_argument("--overwrite", action="store_true", help="replace a run that is there")
    parser.add_argument("--calibration", metavar="FILE", help="calibration file of `calibrate`: sensors are corrected")
    parser.add_argument(
        "--smooth",
        action="store_true",
        help="estimate every state from later measurements too, which live cannot, and learn from those states",
    )
    parser.add_argument(
        "--stage-1",
        type=float,
        metavar="S",
        help="with --air-data-errors: stage 1 of the two-stage estimator on the first S seconds of flight starts wind "
        "and errors; what live cannot",
    )
    add_estimator_options(parser)
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Replay and write; returns state, parameters and notes. Raises InputError."""
    options = estimator_options(args)
    _check(args)
    aircraft = _aircraft(args.aircraft)
    correction = Correction(load_calibration(args.calibration)) if args.calibration else None
    pipeline = Pipeline(aircraft, *options)
    if correction is not None and args.air_data_errors:
        pipeline.state.take_start(start_of_calibration(correction.calibration))
    with RunWriter(args.out, aircraft, overwrite=args.overwrite) as writer, SmootherHistory() as tape:
        pipeline.warm_up()
        known_types()  # parsed once per process, as kernels are loaded
        if args.smooth:
            warm_up(aircraft, smoother=True)
            pipeline.state.tape = tape
        started = time.perf_counter()
        body = read_body(args.bags, args.segments, aircraft.inputs, lambda recording: _prepared(recording, correction))
        recording = body.recording
        begin = None if args.stage_1 is None else start_by_stage_1(recording.samples, aircraft, args.stage_1)
        feed(pipeline, recording, writer, begin)
        if not pipeline.state.has_been_aligned:
            raise InputError(f"nothing is written, since the filter never started: {why_no_start(pipeline.state)}")
        unused = manoeuvre_notes(body, pipeline, writer)
        result = writer.finish(
            pipeline.state,
            pipeline.parameters,
            pipeline.state.flight_time,
            started,
            (*recording.notes, *unused),
            [manoeuvre.json for manoeuvre in body.manoeuvres],
        )
    return {"run": str(args.out), "notes": [*notes(recording, pipeline), *unused], **result}


def _prepared(recording: Recording, correction: Correction | None) -> Recording:
    """A recording with what is needed in it, corrected. Raises InputError."""
    require_sensors(recording, correction is not None and correction.uses_probe)
    if correction is None:
        return recording
    return replace(recording, samples=correction.apply(recording.samples))


def _aircraft(path: str) -> Aircraft:
    """The aircraft file, with bounds that an aeroplane can be in. Raises InputError that names the file."""
    aircraft = load_aircraft(path)
    try:
        check_bounds(aircraft.parameter_bounds)
    except InputError as error:
        raise InputError(f"aircraft file {path}: {error}") from None
    return aircraft


def require_sensors(recording: Recording, uses_probe: bool) -> None:
    """Raises InputError for a recording without the IMU, or with neither GPS nor air data.

    With a calibrated probe its pressures take the place of the air data.
    """
    recording.require(["imu/data", *["five_hole_probe"] * uses_probe])
    if not any(recording.topics.get(topic) for topic in ("gps/fix", "gps/vel", "air_data", "five_hole_probe")):
        raise InputError(
            f"the recording {recording.path} has neither GPS nor air data: beside /imu/data one of /gps/fix, /gps/vel "
            f"and /air_data is needed, and it holds {', '.join('/' + topic for topic in recording.topics)}"
        )


def _check(args: argparse.Namespace) -> None:
    if args.air_data_errors and args.smooth:
        raise InputError("--smooth has no place for the errors of --air-data-errors: leave one of them out")
    if args.stage_1 is not None and not args.air_data_errors:
        raise InputError("--stage-1 starts the states of --air-data-errors: give that too")
    if args.stage_1 is not None and (len(args.bags) > 1 or args.segments):
        raise InputError("--stage-1 starts one flight, and each manoeuvre begins anew: leave it out")
    if args.stage_1 is not None and not SHORTEST <= args.stage_1 <= LONGEST:
        raise InputError(f"--stage-1 must be between {SHORTEST:g} and {LONGEST:g} s, not {args.stage_1:g}")


def feed(
    pipeline: Pipeline, recording: Recording, writer: RunWriter, begin: tuple[StartValues, int] | None = None
) -> None:
    """Push a recording through the pipeline and keep what comes out; smoothed if the pipeline has a tape.

    ``begin``: what the filter takes as known from a stamp [ns] on.
    """
    samples, due = recording.samples, -np.inf
    writer.add_samples(samples)
    edges = {*range(0, len(samples), BLOCK), len(samples)}
    known_at = len(samples) if begin is None else int(np.searchsorted(np.maximum.accumulate(samples.stamp), begin[1]))
    seams = np.flatnonzero(samples.kind == Kind.SEAM)
    edges |= {*seams.tolist(), *(seams + 1).tolist()}  # a seam is a block of its own
    blocks = [samples[i:j] for i, j in itertools.pairwise(sorted(edges | {known_at}))]
    with progress_bar() as progress:
        if pipeline.state.tape is None:
            watched = progress.track(blocks, description="replay")
            results = forward(pipeline, watched, None if begin is None else begin[0], known_at)
        else:
            results = smoothed(pipeline, blocks, progress.track(blocks, description="replay"))
        for rows, points in results:
            writer.add_rows(rows)
            writer.add_points(points)
            if len(points) and points[-1, CoefficientSample.TIME] >= due:
                due = points[-1, CoefficientSample.TIME] + PARAMETERS_PERIOD
                writer.add_parameters(pipeline.parameters.snapshot(), pipeline.parameters.model_error())
    writer.add_parameters(pipeline.parameters.snapshot(), pipeline.parameters.model_error())


def forward(
    pipeline: Pipeline, blocks: Iterable[Samples], start: StartValues | None = None, known_at: int = 0
) -> Iterator[tuple[Array, Array]]:
    """New rows and points, as live has them; before sample ``known_at`` the filter is told ``start``."""
    pushed = 0
    for block in blocks:
        if start is not None and pushed == known_at:
            pipeline.state.take_start(start)
        pushed += len(block)
        yield pipeline.push(block)
    yield pipeline.flush()


def smoothed(pipeline: Pipeline, blocks: list[Samples], watched: Iterable[Samples]) -> Iterator[tuple[Array, Array]]:
    """New rows and points, where the second step follows on the first over the whole flight, there and back.

    It meets samples and states in the same portions as in ``forward``. ``watched``: the blocks for the first step.
    """
    state, parameters, portions = pipeline.state, pipeline.parameters, []
    for block in watched:
        portions.append((len(state.push(block)), state.epoch))
    state.flush()
    rows, at = state.smooth(), 0
    for block, (count, epoch) in zip(blocks, portions, strict=True):
        new, at = rows[at : at + count], at + count
        if len(block) and block.kind[0] == Kind.SEAM:
            points = [parameters.push_states(new, epoch), parameters.begin_anew(block.values[0, 0] <= SAME_FLIGHT)]
            yield new, np.vstack(points)
        else:
            parameters.push_samples(block, epoch)
            yield new, parameters.push_states(new, epoch)
    yield rows[at:], np.vstack([parameters.push_states(rows[at:], state.epoch), parameters.flush()])


def notes(recording: Recording, pipeline: Pipeline) -> list[str]:
    """What a user should know about the recording and what became of it."""
    found = list(recording.notes)
    aircraft = pipeline.parameters.aircraft
    found += input_notes(recording, aircraft)
    if not {"control_surfaces", *([INPUTS_TOPIC] if aircraft.inputs else [])} & recording.topics.keys():
        found.append("no /control_surfaces: state, biases and wind only, no parameters")
    else:
        found += length_notes(pipeline) + rate_notes(pipeline.parameters.stream)
        found += filter(None, [why_airspeed_too_slow(recording.samples)])
    found += bound_notes(pipeline.parameters.aircraft)
    found += absences(pipeline.state)
    found += gap_notes(recording.samples) + air_data_notes(recording) + control_notes(recording.samples)
    for kind, counts in pipeline.state.counts().items():
        for what in ("rejected", "late", "invalid", "wrong_stamp"):
            share = counts[what] / max(counts["received"], 1)
            if share > 0.01:
                found.append(f"{100 * share:.0f} % of the {kind} samples were {what.replace('_', ' ')}")
    if pipeline.state.order.counts.restarts:
        found.append(f"the clock of the recording leapt {pipeline.state.order.counts.restarts} times")
    for axis, when, count in pipeline.parameters.learning.changes.alarms():
        again = f" ({count} times)" * (count > 1)
        found.append(f"{axis} changed at {when:.1f} s of flight and was learnt anew{again}")
    holds = pipeline.parameters.learning.integrity.summary()
    if times := holds["holds"]:
        newest = f"; at the end {holds['held']}" if holds["held"] else ""
        found.append(f"parameters of an axis were held {times} time{'s' * (times > 1)}, see docs/trust.md{newest}")
    if pipeline.state.realignments:
        times = pipeline.state.realignments
        found.append(f"the filter aligned anew {times} times after gaps or contradictions")
    return found


def manoeuvre_notes(body: Body, pipeline: Pipeline, writer: RunWriter) -> list[str]:
    """Manoeuvres of which nothing could be used, each with the reason."""
    epoch, found = pipeline.state.epoch, []
    if epoch is None:
        return []
    states = manoeuvre_at(body.recording.samples, nanoseconds(writer.state_times, epoch))
    points = manoeuvre_at(body.recording.samples, nanoseconds(writer.point_times, epoch))
    for number, manoeuvre in enumerate(body.manoeuvres):
        unused = f"the manoeuvre '{manoeuvre.segment.name}' gives nothing:"
        if not np.any(states == number):
            alone = StateEstimator(pipeline.state.aircraft, pipeline.state.options)
            alone.push(manoeuvre.samples)
            alone.flush()
            found.append(f"{unused} {why_no_start(alone)}")
        elif "control_surfaces" in body.recording.topics and not np.any(points == number):
            speed, width = pipeline.state.aircraft.minimum_airspeed, 2.0 * pipeline.parameters.options.half_width
            needed = f"no {width:g} s in it have states, controls and an airspeed above {speed:.1f} m/s"
            found.append(f"{unused} {needed}")
    seams = body.recording.samples.values[body.recording.samples.kind == Kind.SEAM, 0]
    if apart := int(np.sum(~(seams <= SAME_FLIGHT))):
        found.append(
            f"{apart} of {len(body.manoeuvres)} manoeuvres begin without the IMU biases that the one before has found, "
            f"since their stamps overlap or are more than {SAME_FLIGHT / 3600.0:g} h apart: "
            "forces are known worse for it"
        )
    return found


def input_notes(recording: Recording, aircraft: Aircraft) -> list[str]:
    """Inputs that the aircraft file names and the recording does not hold, which terms then cannot read."""
    values = recording.samples.values[recording.samples.kind == Kind.INPUTS, : len(aircraft.inputs)]
    lacking = [item.name for k, item in enumerate(aircraft.inputs) if not np.isfinite(values[:, k]).any()]
    if not lacking:
        return []
    names = ", ".join(lacking)
    return [f"/{INPUTS_TOPIC} holds no value of {names} inside its limits: terms that read it say nothing"]


def length_notes(pipeline: Pipeline) -> list[str]:
    """Said of a flight of which no parameter can be known because it ends too early."""
    estimates, seconds = pipeline.parameters.snapshot(), pipeline.state.flight_time
    if seconds >= THRESHOLDS.shortest or any(p.status is Trust.USE for p in estimates.parameters):
        return []
    return [
        f"{seconds:.0f} s are too short for parameters, none of them is to be used: record at least "
        f"{THRESHOLDS.shortest:g} s of flight with motion about every axis"
    ]


def rate_notes(stream: CoefficientStream) -> list[str]:
    """Said of an IMU and of controls that are slow beside the motion of an aeroplane, at the end of a flight."""
    pace, controls = stream.pace, stream.controls.pace
    if pace.is_too_slow:
        return [f"{too_slow(pace.rate)}, and no parameter is learnt"]
    found = []
    if pace.is_sparse:
        least = f"standard errors are at least {pace.sampling_error:.1%} of a value for it (docs/parameters.md)"
        unknown = "what happens between its samples is not known"
        found.append(f"the IMU comes at {pace.rate:.2g} Hz: {unknown}, and {least}")
    if controls.interval > CHANGE * pace.interval:
        needed = f"at least {LOWEST_RATE:g} Hz are needed"
        unknown = "what happens between their samples is not known, and no standard error counts it"
        too_few = controls.interval > SPARSEST_CONTROLS
        found.append(f"the controls come at {controls.rate:.2g} Hz: {needed if too_few else unknown}")
    return found


def bound_notes(aircraft: Aircraft) -> list[str]:
    """Bounds of the aircraft file that its own coefficients are outside of."""
    found = []
    for name, (low, high) in aircraft.parameter_bounds.items():
        value = aircraft.coefficients.get(name)
        if value is not None and not low <= value <= high:
            outside = f"the {value:g} that it is given in the same aircraft file is outside: mend one of them"
            found.append(f"parameter_bounds {name} go from {low:g} to {high:g}, and {outside}")
    return found


def gap_notes(samples: Samples) -> list[str]:
    """Silences by kind of sample."""
    found = []
    for kind in Kind:
        stamps = [np.sort(part.stamp[part.kind == kind]) for part in manoeuvres(samples)]
        interval = np.concatenate([np.diff(one) for one in stamps]) / NANOSECONDS
        if len(interval):
            gaps = interval[interval > max(LONGEST_SILENCE, 10.0 * float(np.median(interval)))]
            if len(gaps):
                name, longest = kind.name.lower(), gaps.max()
                found.append(f"the {name} samples have {len(gaps)} gaps of up to {longest:.1f} s")
    return found


def air_data_notes(recording: Recording) -> list[str]:
    """Parts of the air data that are not measured, always or at times."""
    probe = Kind.FIVE_HOLE not in recording.samples.kind and recording.topics.get("five_hole_probe", 0)
    messages, found = probe or recording.topics.get("air_data", 0), []
    for kind in (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP):
        missing = 1.0 - np.sum(recording.samples.kind == kind) / max(messages, 1)
        if 0.01 < missing < 1.0:  # what is not there at all costs more: ``absences``
            found.append(f"{100 * missing:.0f} % of the air data have no {kind.name.lower()}")
    return found


def control_notes(samples: Samples) -> list[str]:
    """Controls that are measured at times only."""
    missing = np.isnan(samples.values[samples.kind == Kind.CONTROLS])
    share = float(np.mean(np.any(missing[:, ~np.all(missing, axis=0)], axis=1))) if len(missing) else 0.0
    text = f"{100 * share:.0f} % of the control samples lack values that others have"
    return [text] if share > 0.01 else []


def why_no_start(state: StateEstimator) -> str:
    """What the filter lacks to start with: sensors of which nothing can be used, and why; else time or motion."""
    counts = state.counts()
    if reason := _why_useless(counts["imu"], "IMU", "imu/data", "no usable numbers"):
        return reason
    useless = {kind: _why_useless(counts[kind], *words) for kind, words in _START_WITH.items()}
    told = [reason for kind, reason in useless.items() if counts[kind]["received"] or all(useless.values())]
    if any(told):
        return "; ".join(reason for reason in told if reason)
    intervals, seconds = counts["imu"]["received"] - 1, state.flight_time
    if seconds > LARGEST_GAP * intervals:
        rate = f"the IMU comes at {intervals / seconds:.2g} Hz"
        return f"{rate}: it needs samples that are at most {LARGEST_GAP:g} s apart"
    speed = state.aircraft.minimum_airspeed
    return (
        "it needs a second of IMU and GPS together, and then an attitude, a magnetometer, or motion of more than "
        f"{0.8 * speed:.1f} m/s (from minimum_airspeed, or from mass and wing_area of the aircraft file); without all "
        "of the GPS, such motion"
    )


def _why_useless(count: dict[str, int], name: str, topic: str, invalid: str) -> str:
    """Why nothing of a sensor can be used, by what became of its samples; empty where something can."""
    received, misfits = count["received"], count["late"] + count["wrong_stamp"]
    if not received:
        return f"no {name} came on {topic}"
    if received > count["invalid"] + misfits:
        return ""
    reasons = ((count["invalid"], invalid), (misfits, "a stamp that does not fit the IMU"))
    return f"of {received} samples of the {name} " + " and ".join(f"{n} have {why}" for n, why in reasons if n)


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    state = result["state"]
    lines = [parameter_table(result["parameters"]["parameters"]), "", state_table(state), ""]
    lines += note_lines(result["notes"])
    lines.append(f"{state['duration']:.1f} s of flight, {state['realtime_factor']:.0f} times real time")
    lines.append(f"run {result['run']}")
    return "\n".join(lines)
