"""The check of a recording, with what an aircraft file knows of its sensors."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.after_flight.progress import Tell, nobody
from aircraft_sysid_ros.after_flight.replay_notes import unnamed_notes
from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_check.check import Checked, check
from aircraft_sysid_ros.flight_check.signals import WILD, Flight, flight_of, vane_arm
from aircraft_sysid_ros.identification.conditions import listed
from aircraft_sysid_ros.recordings.reader import Recording, read_recording
from aircraft_sysid_ros.samples import Kind

#: Sensors of the aircraft file whose delay is known, by kind of sample.
_SENSORS = {
    Kind.IMU: "accelerometer", Kind.ATTITUDE: "attitude", Kind.GPS_POSITION: "gps_position",
    Kind.GPS_VELOCITY: "gps_velocity", Kind.AIRSPEED: "airspeed", Kind.ANGLE_OF_ATTACK: "angle_of_attack",
    Kind.SIDESLIP: "sideslip", Kind.AIR: "static_pressure", Kind.CONTROLS: "control_surfaces",
    Kind.INPUTS: "control_surfaces", Kind.FIVE_HOLE: "five_hole_probe",
    Kind.MAGNETIC_FIELD: "magnetometer", Kind.HEIGHT: "height_above_ground",
}  # fmt: skip


@dataclass(frozen=True)
class CheckedRecording:
    """What was found in a recording of so many seconds, with notes on how it was read."""

    path: str
    duration: float
    checked: Checked
    notes: tuple[str, ...]

    @property
    def json(self) -> dict[str, Any]:
        """What ``check --json`` prints, with more about each parameter."""
        checked = self.checked
        return {
            "recording": self.path,
            "duration": self.duration,
            "findings": [record for finding in checked.findings for record in finding.records],
            "rates": dict(checked.rates),
            "identifiable": {p.name: p.is_shown for p in checked.parameters},
            "parameters": [
                {"name": p.name, "excitation": p.excitation, "relative_error": p.relative_error, "reason": p.reason}
                for p in checked.parameters
            ],
        }


def check_recording(
    path: str | Path, aircraft: str | Path | Aircraft | None = None, tell: Tell = nobody
) -> CheckedRecording:
    """Check a recording; ``aircraft`` is a file or what is in one. Raises InputError."""
    known = load_aircraft(aircraft) if isinstance(aircraft, str | Path) else aircraft
    tell("read the recording", 0.0)
    recording = read_recording(path, unlimited(known.inputs) if known else ())
    flight = flight_of_recording(recording, known)
    if not any(len(stream.time) for stream in flight.streams.values()):
        raise InputError(f"the recording {path} holds no sample with a number in it")
    checked = check(flight, known.model if known else None, lambda share: tell("check", share))
    notes = (*recording.notes, *_wild(recording), *_unnamed(recording, known))
    return CheckedRecording(str(path), flight.duration, checked, notes)


def _wild(recording: Recording) -> list[str]:
    """That there are numbers that nothing has."""
    values = np.abs(recording.samples.values)
    wild = values[np.isfinite(values) & (values > WILD)]
    if not len(wild):
        return []
    return [f"{len(wild)} numbers beyond {WILD:g}, the largest {wild.max():.3g}, are taken as not measured"]


def unlimited(inputs: Iterable[NamedInput]) -> tuple[NamedInput, ...]:
    """Named inputs of which every value is read, so that what is outside the limits can be said."""
    return tuple(replace(item, limits=(-math.inf, math.inf)) for item in inputs)


def _unnamed(recording: Recording, aircraft: Aircraft | None) -> list[str]:
    """Inputs of the recording that are not looked at."""
    if aircraft:
        return unnamed_notes(recording)
    if not recording.unnamed:
        return []
    return [f"the inputs {listed(recording.unnamed)} are checked if an aircraft file names them: give --aircraft"]


def flight_of_recording(recording: Recording, aircraft: Aircraft | None) -> Flight:
    """The samples of a recording by signal, with what the aircraft file knows of the sensors."""
    delays: dict[Kind, float] = {}
    known: dict[str, Any] = {}
    if aircraft:
        sensors = {kind: aircraft.sensors[name] for kind, name in _SENSORS.items()}
        delays = {kind: sensor.delay - sensor.lag for kind, sensor in sensors.items()}  # a lag is late by as much
        noise = aircraft.sensors["control_surfaces"].noise[0]
        known = {"surface_signs": aircraft.surface_signs, "surface_noise": noise, "inputs": aircraft.inputs}
        known["arm"] = vane_arm(aircraft)
    return flight_of(
        recording.samples,
        recording.arrival,
        delays={kind: delay for kind, delay in delays.items() if delay},
        skipped=recording.skipped,
        **known,
    )
