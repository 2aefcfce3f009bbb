"""``check``: a flight as data, before anything is estimated: what its sensors say of themselves and of each other."""

from __future__ import annotations

import argparse
import math
import textwrap
from collections.abc import Iterable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.aircraft.configuration import Aircraft, NamedInput, load_aircraft
from aircraft_sysid_ros.commands.pictures import picture, picture_lines
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.commands.replay_notes import unnamed_notes
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_check.check import Checked, check
from aircraft_sysid_ros.flight_check.finding import ERROR, INFO, SEVERITIES, WARNING, Finding, joined, short_names
from aircraft_sysid_ros.flight_check.signals import Flight, flight_of
from aircraft_sysid_ros.identification.conditions import listed
from aircraft_sysid_ros.recordings.reader import Recording, read_recording
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.text_file import write_whole

_PAGES = (".html", ".htm")
#: Sensors of the aircraft file whose delay is known, by kind of sample.
_SENSORS = {
    Kind.IMU: "accelerometer", Kind.ATTITUDE: "attitude", Kind.GPS_POSITION: "gps_position",
    Kind.GPS_VELOCITY: "gps_velocity", Kind.AIRSPEED: "airspeed", Kind.ANGLE_OF_ATTACK: "angle_of_attack",
    Kind.SIDESLIP: "sideslip", Kind.AIR: "static_pressure", Kind.CONTROLS: "control_surfaces",
    Kind.INPUTS: "control_surfaces", Kind.FIVE_HOLE: "five_hole_probe",
    Kind.MAGNETIC_FIELD: "magnetometer", Kind.HEIGHT: "height_above_ground",
}  # fmt: skip


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "check", help="a flight as data, before anything is estimated", description=__doc__
    )
    parser.add_argument("bag", metavar="BAG", help="rosbag2 folder, .mcap or .db3 file")
    parser.add_argument(
        "--aircraft",
        metavar="FILE",
        help="aircraft file (YAML): its delays and signs of surfaces count as known, its named inputs are looked at, "
        "and the terms of its model are asked for (default: the textbook's 32)",
    )
    parser.add_argument(
        "--out", metavar="FILE", help="picture to write, .png, or a page with it, .html; one that is there is replaced"
    )
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Check and draw; returns findings, rates and what can be identified. Raises InputError."""
    _check_out(args.out)
    aircraft = load_aircraft(args.aircraft) if args.aircraft else None
    with progress_bar() as progress:
        task = progress.add_task("read the recording", total=1.0)
        recording = read_recording(args.bag, unlimited(aircraft.inputs) if aircraft else ())
        flight = flight_of_recording(recording, aircraft)
        if not any(len(stream.time) for stream in flight.streams.values()):
            raise InputError(f"the recording {args.bag} holds no sample with a number in it")
        progress.update(task, description="check")
        model = aircraft.model if aircraft else None
        checked = check(flight, model, lambda share: progress.update(task, completed=share))
        title = f"{args.bag}, {flight.duration:.1f} s"
        figure, notes = picture(lambda: _draw(checked, args.out, title)) if args.out else (None, [])
    return {
        "recording": str(args.bag),
        "duration": flight.duration,
        "findings": [record for finding in checked.findings for record in finding.records],
        "rates": dict(checked.rates),
        "identifiable": {p.name: p.is_shown for p in checked.parameters},
        "parameters": [
            {"name": p.name, "excitation": p.excitation, "relative_error": p.relative_error, "reason": p.reason}
            for p in checked.parameters
        ],
        "figure": figure,
        "notes": [*recording.notes, *_unnamed(recording, aircraft), *notes],
    }


def _check_out(out: str | None) -> None:
    """Raises InputError where the picture cannot be written, before the work."""
    if out is None:
        return
    path = Path(out)
    if path.suffix.lower() not in (".png", *_PAGES):
        raise InputError(f"--out {out} is neither a picture nor a page: give it a name that ends in .png or .html")
    if not path.parent.is_dir():
        raise InputError(f"--out {out}: the folder {path.parent} is not there")


def _draw(checked: Checked, out: str, title: str) -> Path:
    """The picture, or the page with it; the file."""
    from aircraft_sysid_ros.report.check_figure import check_figure
    from aircraft_sysid_ros.report.check_page import check_page

    path = Path(out)
    content = BytesIO()
    check_figure(checked, content, title)
    if path.suffix.lower() in _PAGES:
        write_whole(path, check_page(checked, content.getvalue(), title))
    else:
        write_whole(path, content.getvalue())
    return path


def unlimited(inputs: Iterable[NamedInput]) -> tuple[NamedInput, ...]:
    """Named inputs of which every value is read, so that what is outside the limits can be said."""
    return tuple(replace(item, limits=(-math.inf, math.inf)) for item in inputs)


def _unnamed(recording: Recording, aircraft: Aircraft | None) -> list[str]:
    """Inputs of the recording that are not looked at."""
    if aircraft:
        return unnamed_notes(recording)
    if not recording.unnamed:
        return []
    return [f"the inputs {listed(recording.unnamed)} are looked at where an aircraft file names them: give --aircraft"]


def flight_of_recording(recording: Recording, aircraft: Aircraft | None) -> Flight:
    """The samples of a recording by signal, with what the aircraft file knows of the sensors."""
    delays = {kind: aircraft.sensors[name].delay for kind, name in _SENSORS.items()} if aircraft else {}
    known: dict[str, Any] = {}
    if aircraft:
        noise = aircraft.sensors["control_surfaces"].noise[0]
        known = {"surface_signs": aircraft.surface_signs, "surface_noise": noise, "inputs": aircraft.inputs}
    return flight_of(
        recording.samples,
        recording.arrival,
        delays={kind: delay for kind, delay in delays.items() if delay},
        skipped=recording.skipped,
        **known,
    )


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    findings = joined(Finding((f["signal"],), f["kind"], f["severity"], f["sentence"]) for f in result["findings"])
    counts = {severity: sum(f.severity == severity for f in findings) for severity in SEVERITIES}
    lines = [f"{result['recording']}: {result['duration']:.1f} s", ""]
    by_rate: dict[str, list[str]] = {}
    for name, rate in result["rates"].items():
        by_rate.setdefault(f"{rate:.3g} Hz" if rate == rate else "one sample", []).append(name)
    lines += [f"{rate:>12}  {short_names(tuple(names))}" for rate, names in by_rate.items()]
    lines += ["", *_parameter_lines(result)]
    lines += ["", *(f"{f.severity:<8}{f.kind:<10}{short_names(f.signals)}: {f.sentence}" for f in findings)]
    if not counts[ERROR] + counts[WARNING]:
        lines.append("nothing contradicts itself or looks wrong")
    else:
        lines.append(f"{counts[ERROR]} errors, {counts[WARNING]} warnings, {counts[INFO]} notes")
    return "\n".join([*lines, *picture_lines(result)])


def _parameter_lines(result: dict[str, Any]) -> list[str]:
    """Those that the flight shows by name, the others with the reason; one line for those that share it."""
    shown = [name for name, is_shown in result["identifiable"].items() if is_shown]
    lines = [f"shown by this flight: {len(shown)} of {len(result['identifiable'])} parameters"]
    lines += textwrap.wrap(" ".join(shown), 112, initial_indent="  ", subsequent_indent="  ")
    reasons: dict[str, list[str]] = {}
    for parameter in result["parameters"]:
        if not result["identifiable"][parameter["name"]]:
            reasons.setdefault(parameter["reason"], []).append(parameter["name"])
    return lines + [f"not shown: {' '.join(names)}: {reason}" for reason, names in reasons.items()]
