"""Signed MAVLink 2: the key, and a codec that takes no message whose signature is not right.

https://mavlink.io/en/guide/message_signing.html: the first 48 bits of SHA-256 over key, message and time stamp. A
message that was heard is not taken again, since stamps of a stream must rise.
"""

from __future__ import annotations

import hashlib
import hmac
import stat
import time
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from aircraft_sysid_ros.errors import InputError

_KEY_LENGTH, _LONGEST = 32, 1000
_SIGNATURE = 6  # bytes
#: Stamps count tens of microseconds from 2015 on.
_SIGNING_EPOCH, _PER_SECOND = 1_420_070_400, 100_000


def load_key(path: str | Path) -> bytes:
    """The key (32 bytes) of a file: 64 hexadecimal digits, or a passphrase, whose SHA-256 it is, as in ground stations.

    Raises InputError; for a file that others can read, too.
    """
    path = Path(path)
    try:
        status = path.stat()
        content = path.read_bytes()[: _LONGEST + 1] if stat.S_ISREG(status.st_mode) else b""
    except OSError as error:
        raise InputError(f"cannot read the signing key {path}: {error.strerror}") from None
    if status.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise InputError(f"others can read the signing key {path}: chmod 600 {path}")
    text = content.strip()
    if not text or len(text) > _LONGEST:
        raise InputError(f"the signing key {path} must be one line: 64 hexadecimal digits, or a passphrase")
    try:
        key = bytes.fromhex(text.decode("ascii"))
    except ValueError:
        key = b""
    return key if len(key) == _KEY_LENGTH else hashlib.sha256(text).digest()


class SigningCodec(dialect.MAVLink):
    """pymavlink's codec with a key: what is sent is signed, what comes must be."""

    def __init__(self, file: Any, key: bytes, **place: int) -> None:
        super().__init__(file, **place)
        self.signing.secret_key, self.signing.sign_outgoing = key, True
        self.signing.timestamp = round((time.time() - _SIGNING_EPOCH) * _PER_SECOND)
        self.signing.allow_unsigned_callback = lambda *_: False  # it counts what is refused

    def check_signature(self, msgbuf: bytearray, srcSystem: int, srcComponent: int) -> bool:
        """Whether a message is signed with the key, and new.

        pymavlink remembers the stamp of a message before it looks at the signature: one forged message with a stamp of
        the far future would silence the vehicle.
        """
        key = self.signing.secret_key
        expected = hashlib.sha256(key + bytes(msgbuf[:-_SIGNATURE])).digest()[:_SIGNATURE]
        right = hmac.compare_digest(expected, bytes(msgbuf[-_SIGNATURE:]))
        return right and bool(super().check_signature(msgbuf, srcSystem, srcComponent))
