"""What the imports of autopilot logs share: batches of messages through the tables of ``mavlink``, and the report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from typing import Any

import numpy as np

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.assembler import ATTITUDE_TOPIC, COMPUTED_ANGLES, Assembler, Output, merged
from aircraft_sysid_ros.mavlink.quantities import Batch, Quantity, Reading, Table, readings_of, with_receiver
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
from aircraft_sysid_ros.recordings.imported_log import ImportedLog, ImportedTopic
from aircraft_sysid_ros.recordings.segment_list import Span
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC, TOPICS
from aircraft_sysid_ros.stamps import NANOSECONDS

#: Where a log without a date begins: 2000-01-01, Unix time [s].
NO_DATE = 946_684_800
_GPS_EPOCH, _WEEK = 315_964_800, 604_800
#: Leap seconds of GPS time from a date on, newest first.
_LEAPS = (
    (datetime(2017, 1, 1), 18), (datetime(2015, 7, 1), 17), (datetime(2012, 7, 1), 16), (datetime(2009, 1, 1), 15),
)  # fmt: skip
_NOT_HEALTHY = ", or none of a sensor that its autopilot calls healthy"
_INPUTS = {
    "imu/data": "an IMU" + _NOT_HEALTHY, "imu/mag": "a magnetometer" + _NOT_HEALTHY, "gps/fix": "a GPS position",
    "gps/vel": "a GPS velocity",
}  # fmt: skip
NO_SURFACES = "outputs are recorded, but not what they move: give a calibration file (--servos)"


@dataclass(frozen=True)
class LogContent:
    """All messages of a log by name, their number (also of those that no table has), and notes on reading it."""

    format: str
    batches: list[Batch]
    found: Mapping[str, int]
    notes: list[str] = field(default_factory=list)
    manoeuvres: list[Span] = field(default_factory=list)  # that the log names by itself


def gps_nanoseconds(week: int, milliseconds: int) -> int:
    """Unix time [ns] of GPS week and milliseconds in it."""
    seconds = _GPS_EPOCH + week * _WEEK + milliseconds // 1000
    date = datetime.fromtimestamp(seconds, timezone.utc).replace(tzinfo=None)
    leap = next((count for since, count in _LEAPS if date >= since), 14)
    return (seconds - leap) * NANOSECONDS + (milliseconds % 1000) * 1_000_000


def import_content(content: LogContent, table: Table, mapping: ServoMapping | None) -> ImportedLog:
    """A log through a table; raises InputError where nothing of it can be used."""
    mapping = mapping or ServoMapping()
    said, heard = (reading for batch in content.batches for reading in readings_of(table, batch)), set[str]()
    readings = [reading for each in said if (reading := with_receiver(each, heard)) is not None]
    outputs, assembler = assembled(readings, table, mapping)
    topics = topics_of(outputs)
    if not any(topic.topic in TOPICS for topic in topics):
        held = ", ".join(content.found) or "nothing"
        raise InputError(f"nothing in it can be used: it holds {held[:300]}")
    missing = what_is_missing(topics, readings, assembler, mapping)
    used = {_source_name(output.source) for output in outputs} | _beside_others(assembler, topics)
    found = _found(content.found, table, readings, used, missing.get("control_surfaces", "").startswith(NO_SURFACES))
    notes = [*content.notes, *_attitude_note(topics, missing, mapping)]
    return ImportedLog(content.format, topics, missing, notes, found, content.manoeuvres)


def _beside_others(assembler: Assembler, topics: Sequence[ImportedTopic]) -> set[str]:
    """Sources of what goes along with messages of others: the pressure with an airspeed, a propeller with surfaces."""
    there = {topic.topic: topic.fields for topic in topics}
    along = {
        Quantity.PRESSURE: ("air_data", "static_pressure"), Quantity.PROPELLER: ("control_surfaces", "propeller_speed"),
        Quantity.DESCENT: ("gps/vel", ""), Quantity.MOTORS: ("control_surfaces", "throttle"),
    }  # fmt: skip
    found = set[str]()
    for quantity, (topic, name) in along.items():
        fields, source = there.get(topic, {}), assembler.sources.source(quantity)
        values = np.asarray(fields.get(name, 0.0) if fields else np.nan, dtype=np.float64)
        if source is not None and np.isfinite(values).any():
            found.add(_source_name(source))
    return found


def _attitude_note(topics: Sequence[ImportedTopic], missing: Mapping[str, str], mapping: ServoMapping) -> list[str]:
    """That the autopilot's attitude is not used, where no vane is there and angles of flow rest on it."""
    has_attitude = any(topic.topic == ATTITUDE_TOPIC for topic in topics)
    if not has_attitude or mapping.attitude_std is not None or "angle_of_attack" not in missing:
        return []
    return [
        "the autopilot's attitude is a reference and not used; without vanes it helps to find the flow angles: "
        "`attitude: {std: 0.05}` [rad] in the calibration file (--servos) gives it to the filter"
    ]


def assembled(readings: Sequence[Reading], table: Table, mapping: ServoMapping) -> tuple[list[Output], Assembler]:
    """Messages of our topics from all readings of a log."""
    assembler = Assembler(table, mapping)
    assembler.choose(readings)
    counted = [reading for reading in readings if assembler.note(reading)]
    return merged([output for reading in counted for output in assembler.assemble(reading)]), assembler


def topics_of(outputs: Iterable[Output]) -> list[ImportedTopic]:
    """Outputs joined by topic, in order of stamps; where two share a stamp, both stay."""
    by_topic: dict[str, list[Output]] = {}
    for output in outputs:
        by_topic.setdefault(output.topic, []).append(output)
    return [_joined(parts) for parts in by_topic.values()]


def _joined(parts: list[Output]) -> ImportedTopic:
    stamp = np.concatenate([part.stamp for part in parts])
    order = np.argsort(stamp, kind="stable")
    names = list(dict.fromkeys(name for part in parts for name in part.fields))
    fields = {name: np.concatenate([_column(part, name) for part in parts])[order] for name in names}
    source = ", ".join(dict.fromkeys(part.source for part in parts))
    first = parts[0]
    return ImportedTopic(first.topic, stamp[order], fields, source, first.frame_id, first.type_name)


def _column(part: Output, name: str) -> Any:
    return part.fields.get(name, np.full(len(part.stamp), np.nan))


def _source_name(source: str) -> str:
    return source.split(" ", maxsplit=1)[0].rstrip(",")


def _moves(reading: Reading) -> bool:
    return reading.quantity in (Quantity.PULSES, Quantity.COMMANDS)


def _found(
    found: Mapping[str, int], table: Table, readings: Sequence[Reading], used: set[str], outputs_wait: bool
) -> dict[str, dict[str, Any]]:
    """By message: how many, and whether it was mapped or why not. ``outputs_wait``: for a calibration file."""
    read = {_source_name(reading.source) for reading in readings}
    waiting = {_source_name(reading.source) for reading in readings if outputs_wait and _moves(reading)}

    def state(name: str) -> str:
        if name in used:
            return "mapped"
        topic, instance, _ = name.partition("[")
        if instance and topic in table:
            return "not read: another instance is"
        if name not in table:
            return "unused"
        if name in waiting:
            return "needs a calibration file, which says what its outputs move"
        return "not needed: another source has priority" if name in read else "nothing in it that is known"

    return {name: {"messages": count, "state": state(name)} for name, count in found.items()}


def what_is_missing(
    topics: list[ImportedTopic], readings: Sequence[Reading], assembler: Assembler, mapping: ServoMapping
) -> dict[str, str]:
    """Inputs that the recording does not have, and why."""
    there = {topic.topic: topic for topic in topics}
    quantities = {reading.quantity for reading in readings}
    sources = {reading.source for reading in readings}
    missing: dict[str, str] = {}
    for topic, what in _INPUTS.items():
        if topic not in there:
            missing[topic] = f"the log has no message with {what}"
    if "gps/vel" in missing and Quantity.VELOCITY in quantities:
        missing["gps/vel"] = "the GPS velocity in the log is horizontal, and nothing says the vertical one often enough"
        if any(r.quantity is Quantity.VELOCITY and np.isfinite(r.values).all(axis=1).any() for r in readings):
            missing["gps/vel"] = "the velocity in the log is that of its autopilot without a GPS fix: dead reckoning"
    air = there.get("air_data")
    for name in ("true_airspeed", "angle_of_attack", "sideslip"):
        if air is None or not np.any(np.isfinite(air.fields[name])):
            missing[name] = _why_no_flow(name, quantities, sources, mapping)
    surfaces = there.get("control_surfaces")
    if surfaces is None:
        has_outputs = any(map(_moves, readings))
        given = assembler.outputs_condition.replace("no control surfaces: ", "; ")
        missing["control_surfaces"] = NO_SURFACES + given if has_outputs else "the log has no servo outputs"
        if INPUTS_TOPIC in there:
            missing["control_surfaces"] = "the calibration file names inputs alone, which are on /inputs"
    else:
        for name in ("elevator", "aileron", "rudder", "flaps", "throttle", "thrust", "propeller_speed"):
            if not np.any(np.isfinite(np.asarray(surfaces.fields.get(name, np.nan)))):
                missing[name] = "not measured, or not in the calibration file: NaN"
    return missing


def _why_no_flow(name: str, quantities: set[Quantity], sources: set[str], mapping: ServoMapping) -> str:
    if name == "true_airspeed":
        if Quantity.AIRSPEED in quantities:
            return (
                "the autopilot says that it has no airspeed sensor, or none that is healthy, or the log lacks the "
                "source of the calibration"
            )
        return "the log has no airspeed" + _NOT_HEALTHY
    if sources & set(COMPUTED_ANGLES) and not mapping.measured_angles:
        return "the autopilot's angles are its own estimates; if vanes feed them, say so: flow_angles: measured"
    return "not measured: the filter works it out from wind and attitude, see docs/mavlink.md"
