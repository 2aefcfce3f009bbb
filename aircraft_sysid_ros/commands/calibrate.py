"""``calibrate``: errors of a five-hole probe, a magnetometer, or of IMU and air data together, from a flight.

The two-stage batch estimator runs on the recording; with --out it writes calibration.yaml, which replay and live take
with --calibration, result.json and pictures. docs/calibration.md says what to fly.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.calibration import calibration_file as files
from aircraft_sysid_ros.calibration.calibration_file import Calibration, load_calibration
from aircraft_sysid_ros.calibration.correction import Correction
from aircraft_sysid_ros.calibration.five_hole_probe import SENSITIVITY
from aircraft_sysid_ros.calibration.procedure import SAMPLES
from aircraft_sysid_ros.calibration.report import (
    Report,
    calibrate_compatibility,
    calibrate_magnetometer,
    calibrate_probe,
)
from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.commands.pictures import picture
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.json_text import json_text
from aircraft_sysid_ros.recordings.reader import Recording, read_recording

SECTIONS = {"five-hole": files.FIVE_HOLE, "magnetometer": files.MAGNETOMETER, "compatibility": files.COMPATIBILITY}
NEEDED = {
    "five-hole": ("imu/data", "gps/fix", "gps/vel", "five_hole_probe"),
    "magnetometer": ("imu/data", "gps/fix", "gps/vel", "imu/mag"),
    "compatibility": ("imu/data", "gps/fix", "gps/vel"),
}
CALIBRATION, RESULT = "calibration.yaml", "result.json"


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "calibrate", help="errors of sensors from a flight", description=__doc__
    )
    add = parser.add_argument
    add("what", choices=tuple(SECTIONS), help="which sensor")
    add("bag", metavar="BAG", help="rosbag2 folder, .mcap or .db3 file")
    add("--aircraft", metavar="FILE", help="aircraft file: where the probe is, delays and noise of the sensors "
        f"(needed but for magnetometer; default there: {DEFAULT_AIRCRAFT})")  # fmt: skip
    add("--out", metavar="FOLDER", help="folder for calibration.yaml, result.json and pictures")
    add("--overwrite", action="store_true", help="replace a calibration that is there")
    add("--from", dest="begin", type=float, default=0.0, metavar="S", help="use the flight from S seconds on")
    add("--to", dest="end", type=float, default=np.inf, metavar="S", help="and up to S seconds")
    add("--calibration", metavar="FILE", help="corrections that are applied first, and that the new file holds too")
    add("--samples", type=int, default=None, metavar="N", help=f"samples of stage 1 (default: {SAMPLES}; "
        "compatibility takes fewer)")  # fmt: skip
    add("--seed", type=int, default=0, help="of the samples (default: 0)")
    add("--sensitivity", type=float, nargs=2, default=(SENSITIVITY, SENSITIVITY), metavar=("KA", "KB"),
        help=f"five-hole: nominal K_alpha and K_beta [1/rad] (default: {SENSITIVITY:g})")  # fmt: skip
    add(
        "--curve",
        choices=("auto", "linear", "cubic"),
        default="auto",
        help="five-hole: angles over pressure ratios; auto: what predicts left-out parts of the flight better",
    )
    add("--wind", choices=("auto", "steady", "varying"), default="auto",
        help="five-hole: one wind, or linear between knots a minute apart")  # fmt: skip
    add("--field-strength", type=float, metavar="F", help="magnetometer: strength of the earth's field here, in the "
        "unit of the recording (default: that of a dipole, in tesla)")  # fmt: skip
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Calibrate and write; returns the result. Raises InputError."""
    _check(args)
    aircraft = _aircraft(args)
    before = load_calibration(args.calibration) if args.calibration else None
    started = time.perf_counter()
    recording = read_recording(args.bag)
    recording.require(_needed(args, before))
    with _progress(args.what) as progress:
        report = _report(args, aircraft, recording, before, progress)
    result = {
        "calibration": args.what,
        "recording": str(args.bag),
        "aircraft": aircraft.name,
        **report.json(),
        "elapsed": time.perf_counter() - started,
    }
    result["notes"] = [*recording.notes, *result["notes"]]
    if args.out:
        result["files"] = _write(Path(args.out), args, report, before, result)
    return result


def _check(args: argparse.Namespace) -> None:
    if not 0.0 <= args.begin < np.inf:
        raise InputError(f"--from must be zero or more seconds, not {args.begin:g}")
    if not args.begin < args.end:
        raise InputError(f"--to must be later than --from: {args.end:g} s is not after {args.begin:g} s")
    if args.samples is not None and not 1 <= args.samples <= 100_000:
        raise InputError(f"--samples must be between 1 and 100000, not {args.samples}")
    if args.seed < 0:
        raise InputError(f"--seed must not be negative, not {args.seed}")
    if not all(np.isfinite(k) and k > 0.0 for k in args.sensitivity):
        raise InputError("--sensitivity must be two positive numbers per rad")
    if args.what != "five-hole" and (args.curve, args.wind) != ("auto", "auto"):
        raise InputError("--curve and --wind are of the five-hole probe")
    if args.field_strength is not None and not 0.0 < args.field_strength < np.inf:
        raise InputError(f"--field-strength must be positive, not {args.field_strength:g}")
    if args.out and (Path(args.out) / CALIBRATION).exists() and not args.overwrite:
        raise InputError(f"{args.out} holds a calibration already: give another folder or --overwrite")
    if args.out:
        _check_target(Path(args.out))


def _check_target(folder: Path) -> None:
    """Said before the work, not after it."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file: --out must be a folder")
    parents = [folder] if folder.exists() else []
    parents.append(next(parent for parent in folder.absolute().parents if parent.exists()))
    for parent in parents:
        if not (parent.is_dir() and os.access(parent, os.W_OK | os.X_OK)):
            raise InputError(f"cannot write {folder}: {parent} is no folder that can be written to")


def _aircraft(args: argparse.Namespace) -> Aircraft:
    if args.aircraft:
        return load_aircraft(args.aircraft)
    if args.what == "magnetometer":
        return load_aircraft(config_path(DEFAULT_AIRCRAFT))
    raise InputError(f"calibrate {args.what} needs --aircraft: the place of the probe and the delays are in that file")


def _needed(args: argparse.Namespace, before: Calibration | None) -> tuple[str, ...]:
    if args.what != "compatibility":
        return NEEDED[args.what]
    has_probe = before is not None and bool(before.five_hole_probe)
    return (*NEEDED[args.what], "five_hole_probe" if has_probe else "air_data")


def _report(
    args: argparse.Namespace, aircraft: Aircraft, recording: Recording, before: Calibration | None, progress: Any
) -> Report:
    samples = recording.samples
    if before is not None:
        others = Calibration(
            **{name: getattr(before, name) for name in files.PARAMETERS if name != SECTIONS[args.what]},
            pressure_zeros=before.pressure_zeros,
        )
        samples = Correction(others).apply(samples)
    span = None if args.begin == 0.0 and args.end == np.inf else (args.begin, args.end)
    options: dict[str, Any] = {"seed": args.seed, "progress": progress}
    if args.samples is not None:
        options["samples"] = args.samples
    if args.what == "five-hole":
        options.update(curve=args.curve, wind=args.wind)
        return calibrate_probe(samples, aircraft, span, tuple(args.sensitivity), **options)
    if args.what == "magnetometer":
        return calibrate_magnetometer(samples, aircraft, span, args.field_strength, **options)
    return calibrate_compatibility(samples, aircraft, span, **options)


@contextmanager
def _progress(what: str) -> Iterator[Callable[[str, int, int], None]]:
    with progress_bar() as bar:
        task = bar.add_task(f"{what}: navigation", total=None)
        yield lambda stage, done, of: bar.update(task, description=f"{what}: {stage}", completed=done, total=of or None)


def _write(
    folder: Path, args: argparse.Namespace, report: Report, before: Calibration | None, result: dict[str, Any]
) -> list[str]:
    """All files at once, the calibration last: what is there is complete."""
    from aircraft_sysid_ros.report.calibration_figures import before_after_figure, trace_figure

    found = {} if before is None else before.source
    content = {name: value for name, value in found.items() if name in files.PARAMETERS}
    content[SECTIONS[args.what]] = report.section
    content["source"] = {"recording": str(args.bag), "aircraft": result["aircraft"]}
    files.calibration_from_dict(content)
    figures = {f"{args.what}-trace.png": trace_figure, f"{args.what}-residuals.png": before_after_figure}
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as part:
        drawn = [picture(partial(draw, report, Path(part, name))) for name, draw in figures.items()]
        result["notes"] = [*result["notes"], *dict.fromkeys(note for _, notes in drawn for note in notes)]
        names = [*(name for name, (file, _) in zip(figures, drawn, strict=True) if file), RESULT, CALIBRATION]
        Path(part, RESULT).write_text(json_text(result) + "\n", encoding="utf8")
        Path(part, CALIBRATION).write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf8")
        folder.mkdir(exist_ok=True)
        for name in names:
            os.replace(Path(part, name), folder / name)
    return [str(folder / name) for name in reversed(names)]


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    header = f"{'parameter':<14}{'estimate':>12}{'std. error':>12}{'':>2}{'unit'}"
    lines = [header, "-" * 60]
    for p in result["parameters"]:
        std = f"{p['std']:.3g}" if p["determined"] else "-"
        shown = f"{p['value']:.5g}" if p["determined"] else "-"
        lines.append(f"{p['name']:<14}{shown:>12}{std:>12}  {p['unit']:<6}{p['reason']}".rstrip())
    lines += ["", f"rms of the residuals [{result['residual_unit']}]: uncalibrated, calibrated"]
    for name, rms in result["residuals"].items():
        lines.append(f"  {name:<10}{rms['before']:>10.4g}{rms['after']:>10.4g}")
    if result["models"]:
        lines += ["", "rms of the residuals [m/s] in parts of the flight that were left out, by model"]
    for m in result["models"]:
        lines.append(f"  {m['model']:<30}{m['held_out_rms']:>8.4g}{'  used' if m['used'] else ''}")
    lines += ["", f"stage 1: {result['decision']}"]
    lines.append(f"stage 2: {result['stage_2']}")
    lines += note_lines(result["notes"])
    lines.append(f"{result['seconds_used']:.0f} s of flight used, {result['elapsed']:.1f} s of work")
    lines += [f"file {name}" for name in result.get("files", [])]
    return "\n".join(lines)
