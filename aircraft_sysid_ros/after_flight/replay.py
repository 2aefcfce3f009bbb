"""The whole pipeline over recordings, as fast as the machine can, with the numbers of live; the result is a run."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from aircraft_sysid_ros.after_flight.progress import FIRST_START, Tell, nobody
from aircraft_sysid_ros.after_flight.replay_notes import manoeuvre_notes, notes, sensor_findings, why_no_start
from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft, with_prior
from aircraft_sysid_ros.calibration.calibration_file import load_calibration
from aircraft_sysid_ros.calibration.correction import Correction
from aircraft_sysid_ros.calibration.filter_start import LONGEST, start_by_stage_1, start_of_calibration
from aircraft_sysid_ros.calibration.segments import SHORTEST
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.physical_bounds import check_bounds
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.air_data_errors import StartValues
from aircraft_sysid_ros.reconstruction.found_noise import completed_file, with_vane
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.smoother_history import SmootherHistory
from aircraft_sysid_ros.reconstruction.state_estimator import warm_up
from aircraft_sysid_ros.recordings.manoeuvres import read_body
from aircraft_sysid_ros.recordings.message_types import known_types
from aircraft_sysid_ros.recordings.reader import Recording
from aircraft_sysid_ros.run_writer import RunWriter
from aircraft_sysid_ros.samples import SAME_FLIGHT, Kind, Samples
from aircraft_sysid_ros.text_file import write_new, write_whole

Array = npt.NDArray[np.float64]

#: Time of flight [s] between parameter sets in the run.
PARAMETERS_PERIOD = 1.0
#: Samples that go through the pipeline at a time; the numbers do not depend on it.
BLOCK = 1000


@dataclass(frozen=True)
class ReplayOptions:
    """What a replay may want different from the defaults, as the options of the command say."""

    state: StateOptions = field(default_factory=StateOptions)
    parameters: ParameterOptions = field(default_factory=ParameterOptions)
    segments: str | None = None  # file with a list of manoeuvres
    overwrite: bool = False
    calibration: str | None = None  # file of `calibrate`
    smooth: bool = False
    stage_1: float | None = None  # [s]
    learn_sensors: str | None = None  # file to write
    prior: str | None = None  # folder of a fleet
    airframe: str | None = None  # of that fleet
    as_live: bool = False  # in one pass, even where the flight shows the place of a vane that the aircraft file omits


def replay(
    bags: Sequence[str],
    aircraft: str | Path | Aircraft,
    out: str | Path,
    options: ReplayOptions | None = None,
    tell: Tell = nobody,
) -> dict[str, Any]:
    """Replay recordings as one body of data and write the run ``out``; returns state, parameters and notes.

    ``aircraft``: an aircraft file, or what is in one. Raises InputError, and then nothing is written.
    """
    options = options or ReplayOptions()
    _check(options, bags)
    aircraft = with_prior(_aircraft(aircraft), options.prior, options.airframe)
    pipeline, result = _flown(bags, aircraft, out, options, tell)
    if result is None:
        right = pipeline.check.vane_place
        assert right is not None
        aircraft = with_vane(aircraft, right)
        pipeline, result = _flown(bags, aircraft, out, replace(options, as_live=True), tell)
        assert result is not None
        position = aircraft.source["air_data_position"]
        result["notes"].insert(0, _taken_there(position, bool(options.learn_sensors)))
    if options.learn_sensors:
        late = pipeline.parameters.learning.late_surfaces
        learnt = completed_file(pipeline.state, late, pipeline.check.vane_place)
        _write_aircraft(Path(options.learn_sensors), learnt, options.overwrite)
    return result


def _flown(
    bags: Sequence[str], aircraft: Aircraft, out: str | Path, options: ReplayOptions, tell: Tell
) -> tuple[Pipeline, dict[str, Any] | None]:
    """The pipeline after the flight, and the result; None, and nothing written: the vane is to be placed first."""
    correction = Correction(load_calibration(options.calibration), aircraft) if options.calibration else None
    pipeline = Pipeline(aircraft, options.state, options.parameters)
    if correction is not None and options.state.air_data_errors:
        pipeline.state.take_start(start_of_calibration(correction.calibration))
    with RunWriter(out, aircraft, overwrite=options.overwrite) as writer, SmootherHistory() as tape:
        tell(FIRST_START, 0.0)
        pipeline.warm_up()
        known_types()  # parsed once per process, as kernels are loaded
        if options.smooth:
            warm_up(aircraft, smoother=True)
            pipeline.state.tape = tape
        started = time.perf_counter()
        body = read_body(bags, options.segments, aircraft.inputs, lambda recording: _prepared(recording, correction))
        recording = body.recording
        begin = None if options.stage_1 is None else start_by_stage_1(recording.samples, aircraft, options.stage_1)
        feed(pipeline, recording.samples, writer, begin, tell)
        pipeline.check.finish(pipeline.state.epoch)
        pipeline.parameters.learning.imu_is_late = pipeline.check.has_late_imu
        if not pipeline.state.has_been_aligned:
            raise InputError(f"nothing is written, since the filter never started: {why_no_start(pipeline.state)}")
        if not options.as_live and pipeline.check.vane_place is not None:
            return pipeline, None
        told, unused = notes(body, pipeline, writer), manoeuvre_notes(body, pipeline, writer)
        result = writer.finish(
            pipeline.state,
            pipeline.parameters,
            pipeline.state.flight_time,
            started,
            (*recording.notes, *unused),
            [manoeuvre.json for manoeuvre in body.manoeuvres],
            options.calibration,
        )
    findings = [record for finding in sensor_findings(pipeline) for record in finding.records]
    reads = pipeline.check.airspeed_reads
    said = {"notes": [*told, *unused], "findings": findings, "airspeed_reads": None if reads is None else [*reads]}
    return pipeline, {"run": str(out), **said, **result}


def _taken_there(position: list[Any], is_written: bool) -> str:
    text = json.dumps(position, ensure_ascii=False)
    live = "and the file that is written holds it" if is_written else f"so write `air_data_position: {text}` there"
    return (
        f"the aircraft file does not say where the angle of attack vane is: it is taken {position[1]} m to the "
        f"right of the centre of gravity, as this flight shows. Live needs that from the start, {live}"
    )


def _prepared(recording: Recording, correction: Correction | None) -> Recording:
    """A recording with what is needed in it, corrected. Raises InputError."""
    require_sensors(recording, correction is not None and correction.uses_probe)
    if correction is None:
        return recording
    return replace(recording, samples=correction.apply(recording.samples))


def _check_new_file(path: Path, overwrite: bool) -> None:
    """Before the flight, not after it, whether the aircraft file can be written."""
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise InputError(f"--learn-sensors {path}: give a file in a folder that exists")
    if path.exists() and not overwrite:
        raise InputError(f"the aircraft file {path} is already there: give another name or --overwrite")


def _write_aircraft(path: Path, content: dict[str, Any], overwrite: bool) -> None:
    """The file at once, or not at all."""
    try:
        (write_whole if overwrite else write_new)(path, yaml.safe_dump(content, sort_keys=False, allow_unicode=True))
    except OSError as error:
        raise InputError(f"cannot write the aircraft file {path}: {error.strerror}") from None


def _aircraft(given: str | Path | Aircraft) -> Aircraft:
    """The aircraft, with bounds that an aeroplane can be in. Raises InputError that names the file."""
    aircraft = given if isinstance(given, Aircraft) else load_aircraft(given)
    try:
        check_bounds(aircraft.parameter_bounds)
    except InputError as error:
        raise InputError(f"aircraft file {aircraft.name if given is aircraft else given}: {error}") from None
    return aircraft


def require_sensors(recording: Recording, uses_probe: bool) -> None:
    """Raises InputError for a recording without the IMU, or with neither GPS nor air data.

    With a calibrated probe its pressures take the place of the air data.
    """
    recording.require(["imu/data", *["five_hole_probe"] * uses_probe])
    if not any(recording.topics.get(topic) for topic in ("gps/fix", "gps/vel", "air_data", "five_hole_probe")):
        raise InputError(
            f"the recording {recording.path} has neither GPS nor air data: besides /imu/data one of /gps/fix, /gps/vel "
            f"and /air_data is needed, and it holds {', '.join('/' + topic for topic in recording.topics)}"
        )


def _check(options: ReplayOptions, bags: Sequence[str]) -> None:
    if options.learn_sensors:
        _check_new_file(Path(options.learn_sensors), options.overwrite)
    if options.state.air_data_errors and options.smooth:
        raise InputError("--smooth cannot estimate the errors of --air-data-errors: leave one of them out")
    if options.stage_1 is not None and not options.state.air_data_errors:
        raise InputError("--stage-1 starts the states of --air-data-errors: give that too")
    if options.stage_1 is not None and (len(bags) > 1 or options.segments):
        raise InputError("--stage-1 is for one flight, and here each manoeuvre starts over: leave it out")
    if options.stage_1 is not None and not SHORTEST <= options.stage_1 <= LONGEST:
        raise InputError(f"--stage-1 must be between {SHORTEST:g} and {LONGEST:g} s, not {options.stage_1:g}")


def feed(
    pipeline: Pipeline,
    samples: Samples,
    writer: RunWriter,
    begin: tuple[StartValues, int] | None = None,
    tell: Tell = nobody,
) -> None:
    """Push samples through the pipeline and keep what comes out; smoothed if the pipeline has a tape.

    ``begin``: what the filter takes as known from a stamp [ns] on.
    """
    due = -np.inf
    writer.add_samples(samples)
    edges = {*range(0, len(samples), BLOCK), len(samples)}
    known_at = len(samples) if begin is None else int(np.searchsorted(np.maximum.accumulate(samples.stamp), begin[1]))
    seams = np.flatnonzero(samples.kind == Kind.SEAM)
    edges |= {*seams.tolist(), *(seams + 1).tolist()}  # a seam is a block of its own
    blocks = [samples[i:j] for i, j in itertools.pairwise(sorted(edges | {known_at}))]
    watched = _watched(blocks, tell)
    if pipeline.state.tape is None:
        results = forward(pipeline, watched, None if begin is None else begin[0], known_at)
    else:
        results = smoothed(pipeline, blocks, watched)
    for rows, points in results:
        writer.add_rows(rows)
        writer.add_points(points)
        if len(points) and points[-1, CoefficientSample.TIME] >= due:
            due = points[-1, CoefficientSample.TIME] + PARAMETERS_PERIOD
            writer.add_parameters(pipeline.parameters.snapshot(), pipeline.parameters.model_error())
    writer.add_parameters(pipeline.parameters.snapshot(), pipeline.parameters.model_error())


def _watched(blocks: list[Samples], tell: Tell) -> Iterator[Samples]:
    for number, block in enumerate(blocks):
        tell("replay", number / len(blocks))
        yield block


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
