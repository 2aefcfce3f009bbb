"""Writers of autopilot logs for tests: the formats byte by byte as their specifications say, not by our readers."""

from __future__ import annotations

import struct

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

# -- DataFlash: https://ardupilot.org/dev, LogStructure.h ------------------------------------------------------

_STRUCT = {"Q": "Q", "B": "B", "f": "f", "i": "i", "I": "I", "h": "h", "H": "H", "c": "h", "C": "H", "L": "i",
           "e": "i", "E": "I", "d": "d", "N": "16s", "n": "4s", "Z": "64s", "b": "b", "M": "B", "q": "q"}  # fmt: skip
_HEAD = b"\xa3\x95"
_FMT = 128


def dataflash(formats, rows):
    """Bytes of a log: formats {name: (letters, columns)}, rows [(name, values)] in raw integers where letters scale."""
    data, numbers = bytearray(), {}
    known = {"FMT": ("BBnNZ", "Type,Length,Name,Format,Columns"), **formats}
    for number, (name, (letters, columns)) in zip(range(_FMT, 255), known.items(), strict=False):
        numbers[name] = number
        length = 3 + struct.calcsize("<" + "".join(_STRUCT[letter] for letter in letters))
        texts = (name.encode(), letters.encode(), columns.encode())
        data += _HEAD + bytes([_FMT]) + struct.pack("<BB4s16s64s", number, length, *texts)
    for name, values in rows:
        layout = "<" + "".join(_STRUCT[letter] for letter in known[name][0])
        data += _HEAD + bytes([numbers[name]]) + struct.pack(layout, *values)
    return bytes(data)


def dataflash_text(formats, rows):
    """The same log as a ground station writes it as text, with the scales of the letters applied."""
    known = {"FMT": ("BBnNZ", "Type,Length,Name,Format,Columns"), **formats}
    lines = []
    for number, (name, (letters, columns)) in zip(range(_FMT, 255), known.items(), strict=False):
        length = 3 + struct.calcsize("<" + "".join(_STRUCT[letter] for letter in letters))
        lines.append(f"FMT, {number}, {length}, {name}, {letters}, {columns}")
    scales = {"c": 100, "C": 100, "e": 100, "E": 100, "L": 10_000_000}
    for name, values in rows:
        cells = [
            str(value / scales[letter]) if letter in scales else value.decode() if letter in "nNZ" else str(value)
            for letter, value in zip(known[name][0], values, strict=True)
        ]
        lines.append(", ".join([name, *cells]))
    return "\n".join(lines) + "\n"


# -- ULog: https://docs.px4.io/main/en/dev_log/ulog_file_format.html --------------------------------------------


def _message(kind, content):
    return struct.pack("<HB", len(content), ord(kind)) + content


_ULOG_TYPES = {"uint64_t": "Q", "float": "f", "double": "d", "int32_t": "i", "uint32_t": "I", "uint8_t": "B"}


def ulog(topics):
    """Bytes of a ULog: topics {name: (fields, rows)}, fields "float[3] gyro_rad" …, rows of flat numbers.

    A further instance of a topic is name[1].
    """
    data = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000))
    data += _message("B", bytes(40))
    samples = []
    for number, (name, (fields, rows)) in enumerate(topics.items()):
        data += _message("F", f"{name.partition('[')[0]}:{';'.join(fields)};".encode())
        layout = "<"
        for field in fields:
            kind, _, count = field.split(" ")[0].partition("[")
            layout += (count.rstrip("]") or "1") + _ULOG_TYPES[kind]
        samples += [(row[0], number, struct.pack(layout, *row)) for row in rows]
    for number, name in enumerate(topics):
        name, _, instance = name.rstrip("]").partition("[")
        data += _message("A", struct.pack("<BH", int(instance or 0), number) + name.encode())
    for _, number, content in sorted(samples):
        data += _message("D", struct.pack("<H", number) + content)
    return bytes(data)


# -- bags -------------------------------------------------------------------------------------------------------


def write_bag(path, definitions, messages):
    """A bag (MCAP) with types of its own: definitions {type: text}, messages [(log time, topic, type, fields)]."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = {}
    for name, text in definitions.items():
        types.update(get_types_from_msg(text, name))
    store.register(types)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for log_time, topic, kind, fields in sorted(messages, key=lambda m: m[0]):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            message = made(store, kind, fields)
            writer.write(connections[topic], log_time, store.serialize_cdr(message, kind))
    return path


def made(store, kind, fields):
    """A message of a store: missing numbers are 0; a dictionary is a nested message."""
    values = {}
    for name, (node, content) in store.fielddefs[kind][1]:
        value, node = fields.get(name), int(node)
        if node == 2:
            values[name] = made(store, content, value or {})
        elif node in (3, 4):
            inner, count = content
            if int(inner[0]) == 2:
                values[name] = [made(store, inner[1], item) for item in value or [{}] * count]
            else:
                dtype = inner[1][0]
                values[name] = np.asarray(value if value is not None else np.zeros(count), dtype)
        else:
            base = content[0]
            values[name] = value if value is not None else "" if base == "string" else False if base == "bool" else 0
    return store.types[kind](**values)
