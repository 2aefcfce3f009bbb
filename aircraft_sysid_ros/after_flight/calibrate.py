"""Errors of sensors from a flight, by the two-stage batch estimator, with the files that are kept of them.

The flight is a recording, or a run, which holds every sample of its recording; with a calibration that was applied to
that, what is left of the errors.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.calibration import calibration_file as files
from aircraft_sysid_ros.calibration.calibration_file import Calibration, load_calibration
from aircraft_sysid_ros.calibration.correction import Correction
from aircraft_sysid_ros.calibration.five_hole_probe import SENSITIVITY
from aircraft_sysid_ros.calibration.report import (
    Report,
    calibrate_compatibility,
    calibrate_magnetometer,
    calibrate_probe,
)
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.json_text import json_text
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.refinement.run_data import load_run
from aircraft_sysid_ros.run_reader import AIRCRAFT, CALIBRATION, RESULT, SAMPLES, corrected_note, correction_of
from aircraft_sysid_ros.samples import Kind, Samples

SECTIONS = {"five-hole": files.FIVE_HOLE, "magnetometer": files.MAGNETOMETER, "compatibility": files.COMPATIBILITY}
#: What each calibration needs beside IMU and GPS; compatibility takes the probe where that is calibrated.
_SENSOR = {"five-hole": "five_hole_probe", "magnetometer": "imu/mag", "compatibility": "air_data"}
_ALWAYS = ("imu/data", "gps/fix", "gps/vel")
#: Topics of a recording, as samples of a run.
_KINDS = {
    "imu/data": Kind.IMU, "gps/fix": Kind.GPS_POSITION, "gps/vel": Kind.GPS_VELOCITY, "imu/mag": Kind.MAGNETIC_FIELD,
    "five_hole_probe": Kind.FIVE_HOLE, "air_data": Kind.AIRSPEED,
}  # fmt: skip

#: Hears the stage of the work, how much of it is done, and of how much, 0 where that is not known.
Progress = Callable[[str, int, int], None]
#: Draws what was calibrated and its report into a folder; returns names of the files, and notes.
Draw = Callable[[str, Report, Path], tuple[list[str], list[str]]]


@dataclass(frozen=True)
class CalibrationOptions:
    """What ``calibrate`` takes."""

    what: str
    source: str  # a recording or a run
    aircraft: str | None = None
    out: str | None = None
    overwrite: bool = False
    begin: float = 0.0
    end: float = np.inf
    calibration: str | None = None
    samples: int | None = None
    seed: int = 0
    sensitivity: tuple[float, float] = (SENSITIVITY, SENSITIVITY)
    curve: str = "auto"
    wind: str = "auto"
    field_strength: float | None = None


def calibrate(options: CalibrationOptions, draw: Draw, progress: Progress) -> dict[str, Any]:
    """Calibrate and write; returns the content of result.json, with the files. Raises InputError."""
    _check(options)
    aircraft = _aircraft(options)
    before = load_calibration(options.calibration) if options.calibration else None
    started = time.perf_counter()
    samples, notes = _flight(options.source, _needed(options, before))
    progress("navigation", 0, 0)
    report = _report(options, aircraft, samples, before, progress)
    result = {
        "calibration": options.what,
        "recording": options.source,
        "aircraft": aircraft.name,
        **report.json(),
        "elapsed": time.perf_counter() - started,
    }
    kept, of_kept = sections_kept(before, options.what)
    result["notes"] = [*notes, *result["notes"], *of_kept]
    if options.out:
        result["files"] = _write(Path(options.out), options, report, kept, result, draw)
    return result


def possible(samples: Samples) -> list[str]:
    """Which calibrations the sensors of a flight allow; whether its manoeuvres do, the calibration says."""
    there = set(np.unique(samples.kind).tolist())
    return [what for what in SECTIONS if all(_KINDS[topic] in there for topic in (*_ALWAYS, _SENSOR[what]))]


def is_run(path: str | Path) -> bool:
    """Whether a folder is that of a run that holds its samples."""
    return (Path(path) / AIRCRAFT).is_file() and (Path(path) / SAMPLES).is_file()


def _flight(source: str, needed: tuple[str, ...]) -> tuple[Samples, list[str]]:
    """The samples of a recording or a run, with notes. Raises InputError where what is needed is not in it."""
    if not is_run(source):
        recording = read_recording(source)
        recording.require(needed)
        return recording.samples, list(recording.notes)
    samples = load_run(Path(source)).samples
    there = set(np.unique(samples.kind).tolist())
    missing = [f"/{topic}" for topic in needed if _KINDS[topic] not in there]
    if missing:
        raise InputError(f"the run {source} holds no samples of {', '.join(missing)}, which this calibration needs")
    correction = correction_of(Path(source))
    return samples, [corrected_note(correction)] if correction else []


def _check(options: CalibrationOptions) -> None:
    if options.what not in SECTIONS:
        raise InputError(f"{echo(options.what)} is not a calibration: there are {', '.join(SECTIONS)}")
    if not 0.0 <= options.begin < np.inf:
        raise InputError(f"--from must be zero or more seconds, not {options.begin:g}")
    if not options.begin < options.end:
        raise InputError(f"--to must be later than --from: {options.end:g} s is not after {options.begin:g} s")
    if options.samples is not None and not 1 <= options.samples <= 100_000:
        raise InputError(f"--samples must be between 1 and 100000, not {options.samples}")
    if options.seed < 0:
        raise InputError(f"--seed must not be negative, not {options.seed}")
    if not all(np.isfinite(k) and k > 0.0 for k in options.sensitivity):
        raise InputError("--sensitivity must be two positive numbers per rad")
    if options.what != "five-hole" and (options.curve, options.wind) != ("auto", "auto"):
        raise InputError("--curve and --wind are for the five-hole probe")
    if options.field_strength is not None and not 0.0 < options.field_strength < np.inf:
        raise InputError(f"--field-strength must be positive, not {options.field_strength:g}")
    if options.out and (Path(options.out) / CALIBRATION).exists() and not options.overwrite:
        raise InputError(f"{options.out} holds a calibration already: give another folder or --overwrite")
    if options.out:
        _check_target(Path(options.out))


def _check_target(folder: Path) -> None:
    """Said before the work, not after it."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file: --out must be a folder")
    parents = [folder] if folder.exists() else []
    parents.append(next(parent for parent in folder.absolute().parents if parent.exists()))
    for parent in parents:
        if not (parent.is_dir() and os.access(parent, os.W_OK | os.X_OK)):
            raise InputError(f"cannot write {folder}: {parent} is not a folder that can be written to")


def _aircraft(options: CalibrationOptions) -> Aircraft:
    if options.aircraft:
        return load_aircraft(options.aircraft)
    if is_run(options.source):
        return load_aircraft(Path(options.source) / AIRCRAFT)
    if options.what == "magnetometer":
        return load_aircraft(config_path(DEFAULT_AIRCRAFT))
    raise InputError(f"calibrate {options.what} needs --aircraft: it holds the position of the probe and the delays")


def _needed(options: CalibrationOptions, before: Calibration | None) -> tuple[str, ...]:
    has_probe = options.what == "compatibility" and before is not None and bool(before.five_hole_probe)
    return (*_ALWAYS, "five_hole_probe" if has_probe else _SENSOR[options.what])


def _report(
    wanted: CalibrationOptions, aircraft: Aircraft, samples: Samples, before: Calibration | None, progress: Progress
) -> Report:
    if before is not None:
        others = Calibration(
            **{name: getattr(before, name) for name in files.PARAMETERS if name != SECTIONS[wanted.what]},
            pressure_zeros=before.pressure_zeros,
        )
        samples = Correction(others, aircraft).apply(samples)
    span = None if wanted.begin == 0.0 and wanted.end == np.inf else (wanted.begin, wanted.end)
    options: dict[str, Any] = {"seed": wanted.seed, "progress": progress}
    if wanted.samples is not None:
        options["samples"] = wanted.samples
    if wanted.what == "five-hole":
        options.update(curve=wanted.curve, wind=wanted.wind)
        return calibrate_probe(samples, aircraft, span, wanted.sensitivity, **options)
    if wanted.what == "magnetometer":
        return calibrate_magnetometer(samples, aircraft, span, wanted.field_strength, **options)
    return calibrate_compatibility(samples, aircraft, span, **options)


def sections_kept(before: Calibration | None, what: str) -> tuple[dict[str, Any], list[str]]:
    """Sections of an earlier calibration that the new file keeps, and notes on what of them it does not."""
    found = {} if before is None else before.source
    kept = {name: value for name, value in found.items() if name in files.PARAMETERS and name != SECTIONS[what]}
    old = kept.get(files.COMPATIBILITY)
    if what != "five-hole" or not old or not any(old.get(name) for name in files.AIR_DATA_ERRORS):
        return kept, []
    std = {**(old.get("std") or {}), **dict.fromkeys(files.AIR_DATA_ERRORS)}
    kept[files.COMPATIBILITY] = {**old, **dict.fromkeys(files.AIR_DATA_ERRORS, 0.0), "std": std}
    return kept, [
        "errors of V, alpha and beta that the earlier file has under compatibility were found without this calibration "
        "of the probe, whose values they would be applied to: the new file has 0 for them: calibrate compatibility "
        "with it anew"
    ]


def _write(
    folder: Path,
    options: CalibrationOptions,
    report: Report,
    kept: dict[str, Any],
    result: dict[str, Any],
    draw: Draw,
) -> list[str]:
    """All files at once, the calibration last: what is there is complete."""
    content = dict(kept)
    content[SECTIONS[options.what]] = report.section
    content["source"] = {"recording": options.source, "aircraft": result["aircraft"]}
    files.calibration_from_dict(content)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as part:
        drawn, notes = draw(options.what, report, Path(part))
        result["notes"] = [*result["notes"], *notes]
        names = [*drawn, RESULT, CALIBRATION]
        Path(part, RESULT).write_text(json_text(result) + "\n", encoding="utf8")
        Path(part, CALIBRATION).write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf8")
        folder.mkdir(exist_ok=True)
        for name in names:
            os.replace(Path(part, name), folder / name)
    return [str(folder / name) for name in reversed(names)]
