"""Telemetry logs (.tlog) of ground stations: MAVLink packets, each after the time of its arrival, read with pymavlink.

Stamps are the autopilot's own times: since start, plus the least (arrival - time since start), so that the delays of
the radio do not enter. A restart of the autopilot starts over.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import MissingExtra
from aircraft_sysid_ros.mavlink.clock import BootTime
from aircraft_sysid_ros.mavlink.mavlink_table import MAVLINK
from aircraft_sysid_ros.mavlink.quantities import NAMED_VALUES, Batch
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
from aircraft_sysid_ros.recordings.autopilot_log import LogContent, import_content
from aircraft_sysid_ros.recordings.imported_log import ImportedLog

_TIME = 8  # bytes
_V1, _V2 = 254, 253
_SIGNED = 1
_SIGNATURE = 13
#: Arrival times [us] that a log can have: 2000 to 2100.
_EARLIEST, _LATEST = 946_684_800_000_000, 4_102_444_800_000_000


@dataclass
class _Messages:
    """Messages of one name: arrival [ns], number of the start, time since it [ns], fields."""

    segment: list[int] = field(default_factory=list)
    boot: list[int] = field(default_factory=list)
    fields: list[dict[str, Any]] = field(default_factory=list)


def import_tlog(path: Path, mapping: ServoMapping | None = None) -> ImportedLog:
    """A telemetry log as our topics; raises InputError for what is not one."""
    return import_content(read_tlog(path), MAVLINK, mapping)


def read_tlog(path: Path) -> LogContent:
    """All messages of the first autopilot in the log, stamped in the clock of the ground station."""
    try:
        from aircraft_sysid_ros.mavlink.decoder import Decoder, fields_of
        from aircraft_sysid_ros.mavlink.session import is_vehicle
    except ImportError:
        raise MissingExtra("telemetry logs", "pymavlink", "logs") from None
    packets, lost = _packets(path.read_bytes(), Decoder())
    heartbeat = next((m for _, m in packets if m.get_type() == "HEARTBEAT" and is_vehicle(m)), None)
    if heartbeat is None:
        raise InputError("it is not a telemetry log with an autopilot in it: there is no heartbeat of one")
    sender = (heartbeat.get_srcSystem(), heartbeat.get_srcComponent())
    heard = _Heard(BootTime())
    for arrival, message in packets:
        if (message.get_srcSystem(), message.get_srcComponent()) == sender:
            heard.take(message.get_type(), fields_of(message), arrival)
    starts = heard.boot_time.reboots
    notes = [f"the autopilot restarted {starts} times"] if starts else []
    notes += [f"{lost} bytes are not messages"] if lost else []
    batches = [_batch(name, kept, heard.offsets) for name, kept in heard.by_name.items()]
    return LogContent("MAVLink telemetry", batches, heard.found, notes)


@dataclass
class _Heard:
    """The messages of one autopilot by name, and by start of it the least of arrival minus its time [ns]."""

    boot_time: BootTime
    by_name: dict[str, _Messages] = field(default_factory=dict)
    offsets: dict[int, int] = field(default_factory=dict)
    found: dict[str, int] = field(default_factory=dict)
    _unsure: list[tuple[str, dict[str, Any], int]] = field(default_factory=list)  # of a start that is not yet believed

    def take(self, name: str, fields: dict[str, Any], arrival: int) -> None:
        """The next message. Once a start is believed those that said so are kept, too."""
        self.found[name] = self.found.get(name, 0) + 1
        starts = self.boot_time.reboots
        boot = self.boot_time.of(name, fields, arrival)
        if self.boot_time.reboots != starts:
            for each in self._unsure:
                self._keep(*each, self.boot_time.of(*each))
        if self.boot_time.reboots != starts or not self.boot_time.is_in_doubt:
            self._unsure.clear()
        if boot is None:
            self._unsure.append((name, fields, arrival))
        self._keep(name, fields, arrival, boot)

    def _keep(self, name: str, fields: dict[str, Any], arrival: int, boot: int | None) -> None:
        if boot is None:
            return
        segment = self.boot_time.reboots
        if "time_boot_ms" in fields:
            self.offsets[segment] = min(self.offsets.get(segment, arrival - boot), arrival - boot)
        if (name in MAVLINK or name == NAMED_VALUES) and not self.boot_time.is_repeated(name, boot):
            kept = self.by_name.setdefault(name, _Messages())
            kept.segment.append(segment)
            kept.boot.append(boot)
            kept.fields.append(fields)


def _packets(data: bytes, decoder: Any) -> tuple[list[tuple[int, Any]], int]:
    """Arrival [ns] and message of every packet, and how many bytes were none."""
    packets: list[tuple[int, Any]] = []
    at, lost, end = 0, 0, len(data)
    while at + _TIME + 8 <= end:
        length = _length(data, at + _TIME)
        time = int.from_bytes(data[at : at + _TIME], "big")
        packet = data[at + _TIME : at + _TIME + length]
        messages = list(decoder.decode(packet)) if length and _EARLIEST < time < _LATEST else []
        if decoder.waiting:
            decoder.forget()
        if not messages:
            at, lost = at + 1, lost + 1
            continue
        packets += [(time * 1000, message) for message in messages]
        at += _TIME + length
    return packets, lost


def _length(data: bytes, at: int) -> int:
    """Bytes of the packet that begins there; 0: none does."""
    if data[at] == _V1:
        return data[at + 1] + 8
    if data[at] == _V2:
        return data[at + 1] + 12 + (_SIGNATURE if data[at + 2] & _SIGNED else 0)
    return 0


def _batch(name: str, kept: _Messages, offsets: dict[int, int]) -> Batch:
    known = [i for i, segment in enumerate(kept.segment) if segment in offsets]
    stamp = np.array([kept.boot[i] + offsets[kept.segment[i]] for i in known], dtype=np.int64)
    columns: dict[str, npt.NDArray[Any]] = {
        key: np.array([kept.fields[i][key] for i in known]) for key in (kept.fields[0] if known else ())
    }
    return Batch(name, stamp, columns)
