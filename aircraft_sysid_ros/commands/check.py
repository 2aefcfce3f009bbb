"""``check``: a flight as data, before anything is estimated: what its sensors say of themselves and of each other."""

from __future__ import annotations

import argparse
from typing import Any

from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.finding import ERROR, INFO, SEVERITIES, WARNING, Finding, short_names
from aircraft_sysid_ros.flight_check.signals import Flight, flight_of
from aircraft_sysid_ros.recordings.reader import Recording, read_recording
from aircraft_sysid_ros.samples import Kind

#: Sensors of the aircraft file whose delay is known, by kind of sample.
_SENSORS = {
    Kind.IMU: "accelerometer", Kind.ATTITUDE: "attitude", Kind.GPS_POSITION: "gps_position",
    Kind.GPS_VELOCITY: "gps_velocity", Kind.AIRSPEED: "airspeed", Kind.ANGLE_OF_ATTACK: "angle_of_attack",
    Kind.SIDESLIP: "sideslip", Kind.AIR: "static_pressure", Kind.CONTROLS: "control_surfaces",
    Kind.FIVE_HOLE: "five_hole_probe", Kind.MAGNETIC_FIELD: "magnetometer", Kind.HEIGHT: "height_above_ground",
}  # fmt: skip


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "check", help="a flight as data, before anything is estimated", description=__doc__
    )
    parser.add_argument("bag", metavar="BAG", help="rosbag2 folder, .mcap or .db3 file")
    parser.add_argument(
        "--aircraft", metavar="FILE", help="aircraft file (YAML): its delays and signs of surfaces count as known"
    )
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Check; returns findings, rates and what can be identified. Raises InputError."""
    aircraft = load_aircraft(args.aircraft) if args.aircraft else None
    with progress_bar() as progress:
        task = progress.add_task("read the recording", total=1.0)
        recording = read_recording(args.bag)
        flight = flight_of_recording(recording, aircraft)
        if not any(len(stream.time) for stream in flight.streams.values()):
            raise InputError(f"the recording {args.bag} holds no sample with a number in it")
        progress.update(task, description="check")
        checked = check(flight, lambda share: progress.update(task, completed=share))
    return {
        "recording": str(args.bag),
        "duration": flight.duration,
        "findings": [record for finding in checked.findings for record in finding.records],
        "rates": dict(checked.rates),
        "notes": list(recording.notes),
    }


def flight_of_recording(recording: Recording, aircraft: Aircraft | None) -> Flight:
    """The samples of a recording by signal, with what the aircraft file knows of the sensors."""
    delays = {kind: aircraft.sensors[name].delay for kind, name in _SENSORS.items()} if aircraft else {}
    return flight_of(
        recording.samples,
        recording.arrival,
        delays={kind: delay for kind, delay in delays.items() if delay},
        surface_signs=aircraft.surface_signs if aircraft else {},
        skipped=recording.skipped,
    )


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    findings = _joined(result["findings"])
    counts = {severity: sum(f.severity == severity for f in findings) for severity in SEVERITIES}
    lines = [f"{result['recording']}: {result['duration']:.1f} s", ""]
    by_rate: dict[str, list[str]] = {}
    for name, rate in result["rates"].items():
        by_rate.setdefault(f"{rate:.3g} Hz" if rate == rate else "one sample", []).append(name)
    lines += [f"{rate:>12}  {short_names(tuple(names))}" for rate, names in by_rate.items()]
    lines += ["", *(f"{f.severity:<8}{f.kind:<10}{short_names(f.signals)}: {f.sentence}" for f in findings)]
    if not counts[ERROR] + counts[WARNING]:
        lines.append("nothing contradicts itself or looks wrong")
    else:
        lines.append(f"{counts[ERROR]} errors, {counts[WARNING]} warnings, {counts[INFO]} notes")
    return "\n".join([*lines, *note_lines(result["notes"])])


def _joined(records: list[dict[str, str]]) -> list[Finding]:
    """Records of the JSON with the signals that share a sentence together, in order."""
    together: dict[tuple[str, str, str], list[str]] = {}
    for record in records:
        together.setdefault((record["kind"], record["severity"], record["sentence"]), []).append(record["signal"])
    return [Finding(tuple(signals), *said) for said, signals in together.items()]
