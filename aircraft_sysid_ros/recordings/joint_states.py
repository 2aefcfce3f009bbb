"""Messages sensor_msgs/JointState that all name the same inputs, many at once: CDR, little endian.

After the header and the names follow the positions and two empty sequences, velocity and effort. Where every message
has the names of the first, all have its layout, and only stamps and positions differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.recordings.message_types import known_types, message_from_dict
from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TYPE

Array = npt.NDArray[np.float64]
Bytes = npt.NDArray[np.uint8]

_STAMP = slice(4, 12)  # seconds and nanoseconds behind the header of CDR
_BEHIND = 8  # the lengths of velocity and effort


def encode(stamp: npt.NDArray[np.int64], frame_id: str, names: Sequence[str], positions: Array) -> Bytes:
    """n messages (n, length) from stamps [ns] (n,) and positions (n, k) of k names."""
    header = {"stamp": 0, "frame_id": frame_id}
    first = _serialised({"header": header, "name": list(names), "position": np.zeros(len(names))})
    out = np.tile(first, (len(stamp), 1))
    seconds = np.stack([stamp // 1_000_000_000, stamp % 1_000_000_000], axis=1).astype("<u4")
    out[:, _STAMP] = seconds.view(np.uint8)
    out[:, _positions(first, len(names))] = np.ascontiguousarray(positions, "<f8").view(np.uint8)
    return out


def decode(messages: Bytes) -> dict[str, npt.NDArray[Any]] | None:
    """Flat fields of n messages (n, length): stamps, names (n, k), positions (n, k); None where they are not alike."""
    first = np.ascontiguousarray(messages[0])
    try:
        known: Any = known_types().deserialize_cdr(first.tobytes(), INPUTS_TYPE)
    except Exception:  # damaged bytes raise all kinds: they are decoded, and counted, one by one
        return None
    names, changes = list(known.name), np.zeros(len(first), bool)
    content = {"header": {"stamp": 0, "frame_id": known.header.frame_id}, "name": names, "position": known.position}
    again = _serialised(content)
    changes[_STAMP] = True
    changes[_positions(first, len(names))] = True
    plain = len(known.position) == len(names) and len(again) == len(first) and (again == first)[~changes].all()
    if not plain or not (messages[:, ~changes] == first[~changes]).all():
        return None
    stamp = np.ascontiguousarray(messages[:, _STAMP]).view("<u4")
    positions = np.ascontiguousarray(messages[:, _positions(first, len(names))]).view("<f8")
    return {
        "header.stamp.sec": stamp[:, 0],
        "header.stamp.nanosec": stamp[:, 1],
        "name": np.tile(np.array(names, dtype=object), (len(messages), 1)),
        "position": positions.reshape(len(messages), len(names)),
    }


def _serialised(content: dict[str, Any]) -> Bytes:
    return np.frombuffer(known_types().serialize_cdr(message_from_dict(INPUTS_TYPE, content), INPUTS_TYPE), np.uint8)


def _positions(message: Bytes, count: int) -> slice:
    end = len(message) - _BEHIND
    return slice(end - 8 * count, end)
