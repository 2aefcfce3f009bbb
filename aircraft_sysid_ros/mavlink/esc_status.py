"""ESC_STATUS (291) of MAVLink's common dialect, which PX4 sends and pymavlink's dialects, ArduPilot's, leave out."""

from __future__ import annotations

import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

NUMBER = 291


class EscStatus(dialect.MAVLink_message):
    """Speeds [rpm], voltages [V] and currents [A] of four motors from number ``index`` on, at a time [us]."""

    id = NUMBER
    msgname = "ESC_STATUS"
    fieldnames = ("index", "time_usec", "rpm", "voltage", "current")
    ordered_fieldnames = ("time_usec", "rpm", "voltage", "current", "index")
    fieldtypes = ("uint8_t", "uint64_t", "int32_t", "float", "float")
    fielddisplays_by_name: dict[str, str] = {}  # noqa: RUF012
    fieldenums_by_name: dict[str, str] = {}  # noqa: RUF012
    fieldunits_by_name = {"time_usec": "us", "rpm": "rpm", "voltage": "V", "current": "A"}  # noqa: RUF012
    native_format = bytearray(b"<QiffB")
    orders = (4, 0, 1, 2, 3)
    lengths = (1, 4, 4, 4, 1)
    array_lengths = (0, 4, 4, 4, 0)
    crc_extra = 10
    unpacker = struct.Struct("<Q4i4f4fB")
    instance_field = "index"
    instance_offset = 56

    def __init__(self, index: int, time_usec: int, rpm: Any, voltage: Any, current: Any) -> None:
        super().__init__(NUMBER, self.msgname)
        self._fieldnames, self._instance_field, self._instance_offset = self.fieldnames, "index", self.instance_offset
        self.index, self.time_usec = index, time_usec
        self.rpm, self.voltage, self.current = rpm, voltage, current

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """The packet."""
        values = self.unpacker.pack(self.time_usec, *self.rpm, *self.voltage, *self.current, self.index)
        return bytes(self._pack(mav, self.crc_extra, values, force_mavlink1=force_mavlink1))


def register() -> None:
    """Let pymavlink decode it, unless a newer pymavlink does by itself."""
    dialect.mavlink_map.setdefault(NUMBER, EscStatus)
    if not hasattr(dialect, "MAVLINK_MSG_ID_ESC_STATUS"):
        dialect.MAVLINK_MSG_ID_ESC_STATUS = NUMBER
