"""A run: the folder with everything that was estimated from a flight, live or replayed.

estimates.mcap   states, wind, parameters and model error over the flight
parameters.json  final parameters with standard errors and verdicts
state.json       final biases and wind, noise of the sensors, what became of every sample, notes on the
                 recording, duration, speed; of several manoeuvres where each comes from
points.npz       measured coefficients and regressors, from which models are compared
samples.npz      every sample as it arrived (stamp, kind, values of samples.Samples): the run needs no recording
aircraft.yaml    the aircraft file that was used
"""

from __future__ import annotations

import itertools
import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.postfix import evaluate_term_rows
from aircraft_sysid_ros.aircraft.term_values import with_lags
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_journal import FlightJournal, ObjectsOnDisk, RowsOnDisk
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.model_file import parameters_json
from aircraft_sysid_ros.identification.monitoring.error_window import AxisError
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.json_text import json_text
from aircraft_sysid_ros.reconstruction.absences import absences
from aircraft_sysid_ros.reconstruction.found_noise import noise_json, noise_notes
from aircraft_sysid_ros.reconstruction.ground_speed_wind import contradicted_calm
from aircraft_sysid_ros.reconstruction.state import StateField, status_text
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages import output_messages as out
from aircraft_sysid_ros.run_reader import (
    AIRCRAFT,
    CORRECTED_BY,
    ESTIMATES,
    PARAMETERS,
    POINTS,
    SAMPLES,
    STATE,
    corrected_note,
)
from aircraft_sysid_ros.samples import STRAYS, Kind, Samples, are_sound, concatenate, with_mass_in_flight
from aircraft_sysid_ros.stamps import nanoseconds
from aircraft_sysid_ros.text_file import put_in_place, write_whole

Array = npt.NDArray[np.float64]

#: States written per second of flight: the live topic has them all.
STATE_RATE = 25.0


class RunWriter:
    """Context manager that gathers a run and writes its folder at once at the end, or not at all."""

    def __init__(
        self,
        path: str | Path,
        aircraft: Aircraft,
        *,
        overwrite: bool = False,
        in_progress: Mapping[str, Any] | None = None,
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        """``in_progress``: the options of both steps of a flight that is flown now; its samples go to disk as they come
        (``flight_journal``), and ``say`` is told when that is full. Raises InputError where the run cannot be written.
        """
        self.path = Path(path)
        self._check = partial(_check_target, self.path, overwrite)
        self._check()
        self._aircraft = aircraft
        self._journal = None if in_progress is None else FlightJournal(path, aircraft, in_progress, say)
        self._samples: list[Samples] | FlightJournal = [] if self._journal is None else self._journal
        self._rows: list[Array] | RowsOnDisk = [] if self._journal is None else self._journal.rows
        self._points: list[Array] | RowsOnDisk = [] if self._journal is None else self._journal.points
        #: Parameters and model error, but for the newest.
        self._told: list[tuple[ParameterSet, list[AxisError]]] | ObjectsOnDisk = []
        if self._journal is not None:
            self._told = self._journal.parameters
        self._newest: tuple[ParameterSet, list[AxisError]] | None = None
        self._last_state = -np.inf

    @property
    def kept_aside(self) -> str:
        """What became of a flight of this name that had been cut off, in words; empty: there was none."""
        return "" if self._journal is None else self._journal.kept

    def __enter__(self) -> RunWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._journal is None:
            self._rows, self._samples = [], []
        elif self._journal.is_open and (
            kind is None or (issubclass(kind, InputError) and not self._rows) or not self._journal.holds_a_flight
        ):  # there was no flight
            self._journal.clear()
        elif self._journal.is_open:
            self._journal.end()

    def add_rows(self, rows: Array) -> None:
        """New rows of StateField, in order; STATE_RATE of them are kept per second."""
        if len(rows):
            slot = np.floor(rows[:, StateField.TIME] * STATE_RATE)
            new = np.diff(slot, prepend=self._last_state) != 0.0
            self._last_state = float(slot[-1])
            self._rows.append(rows[new])

    def add_samples(self, samples: Samples) -> None:
        """New samples, in the order of arrival."""
        if len(samples):
            self._samples.append(samples)

    def add_points(self, points: Array) -> None:
        """New rows of CoefficientSample, in order."""
        if len(points):
            self._points.append(points)

    def add_parameters(self, estimates: ParameterSet, errors: list[AxisError]) -> None:
        """Parameters and model error at one time of the flight; what is newer at the same time takes the place."""
        if self._newest is not None and self._newest[0].time != estimates.time:
            self._told.append(self._newest)
            self._newest = None
        if np.isfinite(estimates.time):
            self._newest = (estimates, errors)

    @property
    def state_times(self) -> Array:
        """Times (n,) [s] of the states that are kept."""
        return np.concatenate([rows[:, StateField.TIME] for rows in self._rows] or [np.empty(0)])

    @property
    def point_times(self) -> Array:
        """Times (n,) [s] of the points at which an axis of the model could be evaluated."""
        valid = [points[(points[:, CoefficientSample.VALID] > 0.0).any(axis=1)] for points in self._points]
        return np.concatenate([points[:, CoefficientSample.TIME] for points in valid] or [np.empty(0)])

    def finish(
        self,
        state: StateEstimator,
        parameters: Identifier,
        duration: float,
        started: float,
        notes: Sequence[str] = (),
        manoeuvres: Sequence[dict[str, Any]] = (),
        calibration: str | Path | None = None,
    ) -> dict[str, Any]:
        """Write the folder; returns the content of its JSON files under "state" and "parameters".

        ``duration`` of the flight [s], the reading of time.perf_counter() when the work began, and ``notes`` on what
        could not be read of the recording, where ``manoeuvres`` that were joined come from, and the file of the
        ``calibration`` that corrected the samples. What the flight does without is noted too.
        """
        corrected = [corrected_note(str(calibration))] if calibration else []
        absent = absences(state, [manoeuvre["name"] for manoeuvre in manoeuvres])
        lost = [] if self._journal is None else [*filter(None, (self._journal.kept, self._journal.note))]
        told = [*notes, *corrected, *lost, *absent, *noise_notes(state)]
        result = {"state": {**state_json(state), "notes": told}, "parameters": parameters_json(parameters)}
        self._doubt_calm_air(state, result)
        if manoeuvres:
            result["state"]["manoeuvres"] = list(manoeuvres)
        if calibration:
            result["state"][CORRECTED_BY] = str(calibration)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=self.path.parent, prefix=f".{self.path.name}.") as folder:
                new = Path(folder) / "run"
                new.mkdir()
                self._write_estimates(new / ESTIMATES, state.epoch or 0, parameters)
                self._write_points(new / POINTS, state.epoch or 0, parameters)
                samples = _without_strays(concatenate([*self._samples]))
                np.savez(new / SAMPLES, stamp=samples.stamp, kind=samples.kind.astype(np.int8), values=samples.values)
                aircraft = yaml.safe_dump(parameters.aircraft.source, sort_keys=False, explicit_end=True)
                (new / AIRCRAFT).write_text(aircraft, encoding="utf8")
                write_json(new / PARAMETERS, result["parameters"])
                elapsed = time.perf_counter() - started
                result["state"].update(duration=duration, realtime_factor=duration / elapsed)
                write_json(new / STATE, result["state"])
                put_in_place(new, self.path, Path(folder) / "replaced", self._check)
        except (OSError, InputError) as error:  # the second from the writer of the estimates
            reason = getattr(error, "strerror", None) or str(error).rpartition(": ")[2]
        else:
            if self._journal is not None:
                self._journal.clear()
            return result
        kept = "" if self._journal is None else f"; {self._journal.keep()}"  # now that nothing holds its files
        raise InputError(f"cannot write the run {self.path}: {reason}{kept}")

    def _doubt_calm_air(self, state: StateEstimator, result: dict[str, Any]) -> None:
        """Hold every parameter of a flight whose speed over ground shows a wind that was taken for none."""
        if not state.options.calm_air:
            return
        wind = contradicted_calm(concatenate([*self._samples]), self._aircraft.minimum_airspeed)
        if wind:
            result["state"]["notes"].append(f"the air was not calm: {wind}, so that nothing is to be used")
            listed = result["parameters"]["parameters"]
            result["parameters"]["parameters"] = _held(listed, "the air was taken as calm, and was not")

    def _write_estimates(self, path: Path, epoch: int, parameters: Identifier) -> None:
        with RecordingWriter(path) as writer:
            if self._rows:
                rows = np.vstack([*self._rows])
                stamps = nanoseconds(rows[:, StateField.TIME], epoch)
                said = rows[:, [StateField.STATUS, StateField.CONTRADICTION]].astype(int)
                texts = np.array([status_text(*each) for each in said.tolist()])
                fields = {**out.state_fields(rows), "status_text": texts}
                writer.write(out.STATE_TOPIC, out.STATE_TYPE, stamps, fields, frame_id=out.MAP_NED)
                if (known := out.knows_wind(rows)).any():
                    wind = out.wind_fields(rows[known])
                    writer.write(out.WIND_TOPIC, out.WIND_TYPE, stamps[known], wind, frame_id=out.MAP)
            for estimates, errors in itertools.chain(self._told, [self._newest] if self._newest is not None else []):
                stamp = int(nanoseconds(np.array(estimates.time), epoch))
                header = {"stamp": stamp, "frame_id": out.BASE_FRD}
                content = {"header": header, **out.parameters_content(estimates)}
                writer.write_message(out.PARAMETERS_TOPIC, out.PARAMETERS_TYPE, stamp, content)
                window = parameters.options.error_window
                error = out.model_error_content(estimates.model, window, errors)
                content = {"header": header, **error}
                writer.write_message(out.MODEL_ERROR_TOPIC, out.MODEL_ERROR_TYPE, stamp, content)

    def _write_points(self, path: Path, epoch: int, parameters: Identifier) -> None:
        model = parameters.model
        points, terms = np.empty((0, CoefficientSample.TERMS)), np.empty((0, len(model.parameter_names)))
        if self._points:
            points = np.vstack([part[:, : CoefficientSample.TERMS] for part in self._points])
            same = model.identifier == self._aircraft.model.identifier and all(
                part.shape[1] == CoefficientSample.TERMS + terms.shape[1] for part in self._points
            )
            if same:
                terms = np.vstack([part[:, CoefficientSample.TERMS :] for part in self._points])
            else:  # the model changed in flight: its terms at the averaged signals of every point
                terms = np.empty((len(points), len(model.parameter_names)))
                signals = np.ascontiguousarray(points[:, CoefficientSample.SIGNALS])
                step = parameters.options.step
                signals = with_lags(model.lags, points[:, CoefficientSample.TIME], signals, 1.5 * step)
                evaluate_term_rows(*model.linked, signals, terms)
        response, of_terms = parameters.learning.noise_of(points)
        np.savez(
            path,
            stamp=nanoseconds(points[:, CoefficientSample.TIME], epoch),
            measured=points[:, CoefficientSample.MEASURED],
            predicted=points[:, CoefficientSample.PREDICTED],
            valid=points[:, CoefficientSample.VALID] > 0.0,
            learnt=points[:, CoefficientSample.LEARNT] > 0.0,
            signals=points[:, CoefficientSample.SIGNALS][:, : len(model.signal_names)],
            terms=terms,
            response_variance=response,
            term_variance=of_terms,
            signal_names=np.array(model.signal_names),
            parameter_names=np.array(model.parameter_names),
            axes=np.array(AXES),
        )


def state_json(state: StateEstimator) -> dict[str, Any]:
    """The content of state.json without the timing."""
    counts = {kind: {k: n for k, n in c.items() if n} for kind, c in state.counts().items()}
    return {
        **state.summary(),
        "innovation_consistency": state.innovation_consistency(),
        "sensor_noise": noise_json(state),
        "samples": {kind: c for kind, c in counts.items() if c},
        "realignments": state.realignments,
        "clock_restarts": state.order.counts.restarts,
        "calm_air": bool(state.options.calm_air),
    }


def write_json(path: Path, content: Any) -> None:
    """JSON for people and programs; raises OSError."""
    write_whole(path, json_text(content) + "\n")


def _without_strays(samples: Samples) -> Samples:
    """Samples without a few that are days from all others: the first message of a driver may be of 1970.

    More of them are a clock that was set in flight.
    """
    if np.any(samples.kind == Kind.SEAM):
        return samples
    samples = with_mass_in_flight(samples)
    sound = are_sound(samples.stamp)
    return samples[sound] if np.count_nonzero(~sound) <= STRAYS else samples


def _held(parameters: Sequence[Mapping[str, Any]], why: str) -> list[dict[str, Any]]:
    """Parameters as in parameters.json with HOLD in place of USE, and the reason."""
    return [{**p, "status": "HOLD", "reason": why} if p["status"] == "USE" else dict(p) for p in parameters]


def _check_target(path: Path, overwrite: bool) -> None:
    existing = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
    if existing != path:  # said before a flight, not after it
        if not (existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)):
            raise InputError(f"cannot write the run {path}: {existing} is not a folder that can be written to")
        return
    if not path.is_dir():
        raise InputError(f"{path} is a file: give the name of a folder for the run")
    contents = {item.name for item in path.iterdir()}
    if contents and PARAMETERS not in contents:
        raise InputError(f"{path} is not a run and is not overwritten: give another name")
    if contents and not overwrite:
        raise InputError(f"the run {path} is already there: give another name or --overwrite")
