"""Telemetry logs (.tlog) of ground stations: MAVLink packets, each after the time of its arrival, read with pymavlink.

Stamps are the autopilot's own times: since start, plus the least (arrival - time since start), so that the delays of
the radio do not enter. A restart of the autopilot starts over.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

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

if TYPE_CHECKING:
    from aircraft_sysid_ros.mavlink.decoder import Decoder

_TIME = 8  # bytes
_V1, _V2 = 254, 253
_SIGNED = 1
_SIGNATURE = 13
#: Arrival times [us] that a log can have: 2000 to 2100.
_EARLIEST, _LATEST = 946_684_800_000_000, 4_102_444_800_000_000


#: Messages of one name that are kept as such: an array holds a tenth of their memory.
_PIECE = 1000


@dataclass
class _Messages:
    """Messages of one name: number of the start, time since it [ns], and fields."""

    _newest: list[tuple[int, int, dict[str, Any]]] = field(default_factory=list)
    _pieces: list[tuple[npt.NDArray[np.int64], dict[str, npt.NDArray[Any]]]] = field(default_factory=list)

    def add(self, segment: int, boot: int, fields: dict[str, Any]) -> None:
        """One more."""
        self._newest.append((segment, boot, fields))
        if len(self._newest) == _PIECE:
            self._pack()

    def _pack(self) -> None:
        if self._newest:
            times = np.array([(segment, boot) for segment, boot, _ in self._newest], dtype=np.int64)
            columns = {key: np.array([row[2][key] for row in self._newest]) for key in self._newest[0][2]}
            self._pieces.append((times, columns))
            self._newest.clear()

    def columns(self) -> tuple[npt.NDArray[np.int64], dict[str, npt.NDArray[Any]]]:
        """Numbers of the start and times since it [ns] (n, 2), and fields by name (n,) or (n, k)."""
        self._pack()
        fields = {key: np.concatenate([columns[key] for _, columns in self._pieces]) for key in self._pieces[0][1]}
        return np.concatenate([times for times, _ in self._pieces]), fields


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
    data = path.read_bytes()
    first = (message for _, message in _Packets(data, Decoder()))
    heartbeat = next((m for m in first if m.get_type() == "HEARTBEAT" and is_vehicle(m)), None)
    if heartbeat is None:
        raise InputError("it is not a telemetry log with an autopilot in it: there is no heartbeat of one")
    sender = (heartbeat.get_srcSystem(), heartbeat.get_srcComponent())
    heard, packets = _Heard(BootTime()), _Packets(data, Decoder())
    for arrival, message in packets:
        if (message.get_srcSystem(), message.get_srcComponent()) == sender:
            heard.take(message.get_type(), fields_of(message), arrival)
    starts = heard.boot_time.reboots
    notes = [f"the autopilot restarted {starts} times"] if starts else []
    notes += [f"{packets.lost} bytes are not messages"] if packets.lost else []
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
            self.by_name.setdefault(name, _Messages()).add(segment, boot, fields)


@dataclass
class _Packets:
    """Arrival [ns] and message of every packet of a log, one after the other, and how many bytes were none so far."""

    data: bytes
    decoder: Decoder
    lost: int = 0

    def __iter__(self) -> Iterator[tuple[int, Any]]:
        at, data, decoder = 0, self.data, self.decoder
        while at + _TIME + 8 <= len(data):
            length = _length(data, at + _TIME)
            time = int.from_bytes(data[at : at + _TIME], "big")
            packet = data[at + _TIME : at + _TIME + length]
            messages = list(decoder.decode(packet)) if length and _EARLIEST < time < _LATEST else []
            if decoder.waiting:
                decoder.forget()
            if not messages:
                at, self.lost = at + 1, self.lost + 1
                continue
            for message in messages:
                yield time * 1000, message
            at += _TIME + length


def _length(data: bytes, at: int) -> int:
    """Bytes of the packet that begins there; 0: none does."""
    if data[at] == _V1:
        return data[at + 1] + 8
    if data[at] == _V2:
        return data[at + 1] + 12 + (_SIGNATURE if data[at + 2] & _SIGNED else 0)
    return 0


def _batch(name: str, kept: _Messages, offsets: dict[int, int]) -> Batch:
    times, fields = kept.columns()
    known = np.isin(times[:, 0], list(offsets))
    start = np.array([offsets[segment] for segment in times[known, 0].tolist()], dtype=np.int64)
    return Batch(name, times[known, 1] + start, {key: column[known] for key, column in fields.items()})
