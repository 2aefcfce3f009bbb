"""Bytes to MAVLink messages and back, in bounded memory whatever comes; and messages to batches for the tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aircraft_sysid_ros.mavlink import esc_status
from aircraft_sysid_ros.mavlink.quantities import Batch
from aircraft_sysid_ros.mavlink.signing import SigningCodec

esc_status.register()

#: Our place on the vehicle's network: MAV_COMP_ID_ONBOARD_COMPUTER.
OUR_COMPONENT = 191
GROUND_STATION = 255
_BAD = "BAD_DATA"
_BYTES_AT_ONCE = 4096


class _Outbox:
    """Where pymavlink writes what it sends."""

    def __init__(self) -> None:
        self.content = bytearray()

    def write(self, data: bytes) -> None:
        """Keep bytes."""
        self.content += data


class Decoder:
    """pymavlink's codec of the ardupilotmega dialect, which holds common; both versions of the protocol."""

    def __init__(self, key: bytes | None = None) -> None:
        """With a ``key`` (32 bytes) what is not signed with it is no message."""
        self._outbox = _Outbox()
        place = {"srcSystem": GROUND_STATION, "srcComponent": OUR_COMPONENT}
        self._codec = (
            dialect.MAVLink(self._outbox, **place) if key is None else SigningCodec(self._outbox, key, **place)
        )
        self._is_keyed = key is not None
        self._codec.robust_parsing = True
        self.messages = 0
        self.bad = 0  # pieces of bytes that were no message

    @property
    def system(self) -> int:
        """Our own system id."""
        return int(self._codec.srcSystem)

    @system.setter
    def system(self, number: int) -> None:
        self._codec.srcSystem = number

    @property
    def component(self) -> int:
        """Our own component id."""
        return int(self._codec.srcComponent)

    @component.setter
    def component(self, number: int) -> None:
        self._codec.srcComponent = number

    @property
    def refused(self) -> int:
        """Messages that were not signed with the key."""
        return int(self._codec.signing.reject_count)

    def decode(self, data: bytes) -> Iterator[Any]:
        """The messages in the bytes; what is not a message is counted and forgotten."""
        for begin in range(0, len(data), _BYTES_AT_ONCE):
            for message in self._codec.parse_buffer(data[begin : begin + _BYTES_AT_ONCE]) or ():
                is_unchecked = self._is_keyed and isinstance(message, dialect.MAVLink_unknown)  # pymavlink checks none
                if message.get_type() == _BAD or is_unchecked:
                    self.bad += 1
                else:
                    self.messages += 1
                    yield message
            self._compact()

    def encode(self, message: Any) -> bytes:
        """The bytes of a message of ours."""
        self._codec.send(message)
        data = bytes(self._outbox.content)
        self._outbox.content.clear()
        return data

    @property
    def waiting(self) -> int:
        """Bytes of a message that has not come to its end."""
        return int(self._codec.buf_len())

    def forget(self) -> None:
        """Drop what waits: the next bytes are the beginning of something else."""
        self._codec.buf.clear()
        self._codec.buf_index = 0

    def _compact(self) -> None:
        """The codec forgets what it has read only when nothing is left, which with garbage may never be."""
        if self._codec.buf_index:
            del self._codec.buf[: self._codec.buf_index]
            self._codec.buf_index = 0


def fields_of(message: Any) -> dict[str, Any]:
    """Fields of a message by name, as Python has them."""
    return {name: getattr(message, name) for name in message.get_fieldnames()}


def batch_of(name: str, stamp: int, fields: Mapping[str, Any]) -> Batch:
    """One message as a batch (n = 1)."""
    return Batch(name, np.array([stamp], np.int64), {key: _column(value) for key, value in fields.items()})


def _column(value: Any) -> npt.NDArray[Any]:
    return np.array([value])
