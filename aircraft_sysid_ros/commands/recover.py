"""``recover``: the run of a flight of ``live`` that a crash or a power cut ended, from what was on disk.

What was on disk goes through the same estimators with the same options, and the run is written as ``live`` would have.
Parameters that were set and services that were called in flight are not repeated.
"""

from __future__ import annotations

import argparse
import shutil
import time
from typing import Any

from aircraft_sysid_ros.after_flight.progress import FIRST_START
from aircraft_sysid_ros.after_flight.replay import feed
from aircraft_sysid_ros.after_flight.replay_notes import estimator_notes, rate_notes, why_no_start
from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.calibration.calibration_file import calibration_from_dict
from aircraft_sysid_ros.calibration.filter_start import start_of_calibration
from aircraft_sysid_ros.commands.progress import telling
from aircraft_sysid_ros.commands.replay import render as render_run
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_journal import recovered
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.run_reader import journal_path
from aircraft_sysid_ros.run_writer import RunWriter
from aircraft_sysid_ros.samples import first_and_last


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "recover", help="the run of a flight that was cut off", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", help="folder that was given to live --out")
    parser.add_argument("--overwrite", action="store_true", help="replace a run that is there")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Estimate what was on disk and write the run; returns state, parameters and notes. Raises InputError."""
    content, file, samples = recovered(args.run)
    aircraft = load_aircraft(file)
    try:
        options = StateOptions(**content["state"]), ParameterOptions(**content["parameters"])
    except (KeyError, TypeError):
        raise InputError(
            f"{journal_path(args.run)} has options of another version of the program: recover it with the version "
            "that flew"
        ) from None
    pipeline = Pipeline(aircraft, *options)
    correction = content.get("calibration")  # of samples that are on disk as corrected
    if correction and pipeline.state.options.air_data_errors:
        pipeline.state.take_start(start_of_calibration(calibration_from_dict(correction["content"])))
    first, last = first_and_last(samples.stamp)
    told = [
        f"the flight was cut off, or its run could not be written: recovered from the {len(samples)} samples of "
        f"{(last - first) * 1e-9:.1f} s that were on disk; what came after them, if anything, is lost"
    ]
    with RunWriter(args.run, aircraft, overwrite=args.overwrite) as writer:
        with telling() as tell:
            tell(FIRST_START, 0.0)
            pipeline.warm_up()
            started = time.perf_counter()
            feed(pipeline, samples, writer, tell=tell)
        if not pipeline.state.has_been_aligned:
            raise InputError(f"nothing is written, since the filter never started: {why_no_start(pipeline.state)}")
        told += rate_notes(pipeline.parameters.stream) + estimator_notes(pipeline.parameters)
        result = writer.finish(
            pipeline.state, pipeline.parameters, pipeline.state.flight_time, started, told,
            calibration=correction and correction["file"],
        )  # fmt: skip
    shutil.rmtree(journal_path(args.run), ignore_errors=True)
    return {"run": str(args.run), "notes": result["state"]["notes"], **result}


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    return render_run(result)
