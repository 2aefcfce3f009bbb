"""Where MAVLink comes from: UDP, TCP or a serial port, opened again whenever it breaks.

udp:0.0.0.0:14550 (or udpin:)   listen; whoever sent the vehicle's first heartbeat is heard and answered, nobody else
udpout:192.168.1.10:14550       speak first
tcp:127.0.0.1:5760              connect
serial:/dev/ttyACM0:921600      or /dev/ttyACM0,921600; default 57600 baud
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
import time
from dataclasses import dataclass
from typing import Any

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import MissingExtra

DEFAULT_BAUD = 57600
FIRST_PAUSE, LONGEST_PAUSE = 0.5, 5.0  # [s] between tries to open again
_AT_ONCE = 65536
#: Bytes that may wait in the system while this process waits for its turn, or as many as it allows: its own default
#: holds a quarter of a second of an autopilot's messages.
_WAITING = 1_048_576
_MOST_FOREIGN = 1000  # packets of others that are passed over at a time
_WHAT_TO_DO = {
    errno.EADDRINUSE: "another program has this port, perhaps a ground station; end that or take another port",
    errno.ECONNREFUSED: "nobody listens there; start the autopilot or its simulator first",
    errno.ENOENT: "is it plugged in, and is this its name?",
    errno.EACCES: "you must be a member of its group, usually dialout",
}
_KINDS = ("udp", "udpin", "udpout", "tcp", "serial")


@dataclass(frozen=True)
class Address:
    """What a connection text says."""

    kind: str  # udpin, udpout, tcp, serial
    place: str
    number: int  # port or baud

    def __str__(self) -> str:
        return f"{self.kind}:{self.place}:{self.number}"


def parse_address(text: str) -> Address:
    """Address from a connection text; raises InputError."""
    if text.startswith("/dev/") or text.upper().startswith("COM"):
        text = f"serial:{text.replace(',', ':')}"
    kind, _, rest = text.partition(":")
    place, _, number = rest.rpartition(":")
    if kind == "serial" and not number.isdigit():
        place, number = rest, str(DEFAULT_BAUD)
    if kind not in _KINDS or not place or not number.isdigit() or not 0 < int(number) < 10_000_000:
        raise InputError(
            f"the connection '{text}' is not understood: write udp:0.0.0.0:14550, udpout:HOST:PORT, tcp:HOST:PORT "
            "or serial:/dev/ttyACM0:57600; 'bridge dds:' hears PX4's own topics"
        )
    if kind != "serial" and int(number) > 65535:
        raise InputError(f"the connection '{text}' has no port: ports are 1 to 65535, not {number}")
    return Address("udpin" if kind == "udp" else kind, place, int(number))


class Transport:
    """Bytes to and from an address. ``read`` waits; a broken connection is opened again, later each time."""

    def __init__(self, address: Address, host: str = "") -> None:
        """``host``: the only one that is heard and answered; empty: any, until ``hold``."""
        self.address = address
        self.openings = 0
        self.foreign = 0  # packets of others than the peer
        self._host, self._only = host, ""
        self._device: Any = None
        self._peer: tuple[Any, ...] | None = None  # who is answered
        self._spoke: tuple[Any, ...] | None = None  # last
        self._held = False
        self._try_at, self._pause = 0.0, FIRST_PAUSE

    def open(self) -> None:
        """First opening; raises InputError when it fails, since then the address is likely wrong."""
        try:
            self._open()
        except (OSError, ValueError) as error:
            number = getattr(error, "errno", None)
            reason = os.strerror(number) if number in _WHAT_TO_DO else getattr(error, "strerror", None) or error
            hint = f": {_WHAT_TO_DO[number]}" if number in _WHAT_TO_DO else ""
            raise InputError(f"cannot open {self.address}: {reason}{hint}") from None

    def read(self, timeout: float) -> bytes:
        """What has come, after at most ``timeout`` [s]; empty when nothing has."""
        if not self._is_open(timeout):
            return b""
        try:
            return self._serial_read(timeout) if self.address.kind == "serial" else self._socket_read(timeout)
        except (OSError, ValueError, TypeError):  # pyserial raises the others for a device that is gone
            self.close()
            return b""

    def write(self, data: bytes) -> None:
        """Send; what cannot be sent is lost, as on any link."""
        if self._device is None or not data:
            return
        try:
            if self.address.kind == "serial":
                self._device.write(data)
            elif self.address.kind == "tcp":
                self._device.sendall(data)
            elif (peer := self._peer or self._spoke) is not None:
                self._device.sendto(data, peer)
        except (BlockingIOError, ConnectionRefusedError):
            pass  # nobody listens yet
        except (OSError, ValueError):
            if not self.address.kind.startswith("udp"):  # there a way that is gone for a while breaks nothing
                self.close()

    def hold(self) -> None:
        """Hear and answer nobody but who spoke last."""
        if self.address.kind == "udpin" and not self._held and self._spoke is not None:
            self._peer, self._held = self._spoke, True

    def release(self) -> None:
        """Hear others again: the peer is silent, and may come back from another port. It alone is still answered."""
        self._held = False

    def close(self) -> None:
        """Let go of the device."""
        if self._device is not None:
            with contextlib.suppress(OSError):
                self._device.close()
        self._device = None
        if self.address.kind == "udpin":
            self._peer = self._spoke = None
            self._held = False

    def _is_open(self, timeout: float) -> bool:
        if self._device is not None:
            return True
        wait = self._try_at - time.monotonic()
        if wait > 0.0:
            time.sleep(min(wait, timeout))
            return False
        try:
            self._open()
        except (OSError, ValueError):
            self._try_at = time.monotonic() + self._pause
            self._pause = min(2.0 * self._pause, LONGEST_PAUSE)
            return False
        return True

    def _open(self) -> None:
        kind, target = self.address.kind, (self.address.place, self.address.number)
        if kind == "serial":
            self._device = _open_serial(*target)
        elif kind == "tcp":
            self._device = socket.create_connection(target, timeout=3.0)
            self._device.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        else:
            device = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            device.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _WAITING)
            try:
                if kind == "udpin":
                    self._only = socket.gethostbyname(self._host) if self._host else ""
                    device.bind(target)
                else:
                    self._peer = (socket.gethostbyname(target[0]), target[1])
            except OSError:
                device.close()
                raise
            device.setblocking(False)
            self._device = device
        self.openings += 1
        self._pause = FIRST_PAUSE

    def _socket_read(self, timeout: float) -> bytes:
        ready, _, _ = select.select([self._device], [], [], timeout)
        if not ready:
            return b""
        if self.address.kind == "tcp":
            data = bytes(self._device.recv(_AT_ONCE))
            if not data:  # the other end has hung up
                self.close()
            return data
        for _ in range(_MOST_FOREIGN):
            try:
                data, sender = self._device.recvfrom(_AT_ONCE)
            except (BlockingIOError, ConnectionRefusedError):
                return b""
            if self._is_peer(sender):
                self._spoke = sender
                return bytes(data)
            self.foreign += 1
        return b""

    def _is_peer(self, sender: tuple[Any, ...]) -> bool:
        if self._only and sender[0] != self._only:
            return False
        is_open = self.address.kind == "udpin" and not self._held
        return is_open or sender == self._peer

    def _serial_read(self, timeout: float) -> bytes:
        self._device.timeout = timeout
        first = bytes(self._device.read(1))
        return first + bytes(self._device.read(self._device.in_waiting)) if first else b""


def _open_serial(device: str, baud: int) -> Any:
    try:
        import serial
    except ImportError:
        raise MissingExtra("serial ports", "pyserial", "bridge") from None
    return serial.Serial(device, baud, timeout=0, write_timeout=0.5)
