"""Serialised ROS messages as numpy structures, so that a whole topic is read or written at once.

CDR puts a message's numbers one after the other, each aligned to its size from the end of a four-byte header,
and a string as its length (with the final zero) and its bytes. When all strings of a batch are equally long,
every message of the batch has the same layout: a numpy structure with gaps. Sequences have no such layout.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

#: Representation identifier and options that every message starts with: plain CDR, little endian.
HEADER = b"\x00\x01\x00\x00"
LENGTH_OF = "length of "
PRIMITIVES = {
    "bool": "u1", "byte": "u1", "char": "u1", "int8": "i1", "uint8": "u1", "int16": "<i2", "uint16": "<u2",
    "int32": "<i4", "uint32": "<u4", "int64": "<i8", "uint64": "<u8", "float32": "<f4", "float64": "<f8",
}  # fmt: skip
#: Type definitions by type name, as rosbags parses them.
Definitions = Mapping[str, Any]


class NoFixedLayout(Exception):
    """The type has a sequence, so that messages have no common layout."""


class _Builder:
    """Walks a type and collects names, formats and offsets of its numbers."""

    def __init__(self, definitions: Definitions, string_size: Callable[[str, int], int]) -> None:
        self.definitions, self.string_size = definitions, string_size
        self.names: list[str] = []
        self.formats: list[Any] = []
        self.offsets: list[int] = []
        self.end = len(HEADER)

    def add(self, name: str, scalar: str, count: int | None = None) -> None:
        """A number, or an array of ``count`` of them."""
        size = np.dtype(scalar).itemsize
        self.end += (len(HEADER) - self.end) % size
        self.names.append(name)
        self.formats.append(scalar if count is None else (scalar, (count,)))
        self.offsets.append(self.end)
        self.end += size * (1 if count is None else count)

    def add_string(self, name: str) -> None:
        """A string: its length, its bytes and a final zero."""
        self.add(LENGTH_OF + name, "<u4")
        size = self.string_size(name, self.offsets[-1])
        if size > 1:
            self.names.append(name)
            self.formats.append(f"S{size - 1}")
            self.offsets.append(self.end)
        self.end += size

    def add_field(self, name: str, description: Any) -> None:
        """A field of any type that has a fixed size."""
        node, content = int(description[0]), description[1]
        if node == _BASE:
            self._add_base(name, content[0])
        elif node == _NAME:
            self._add_message(name, content)
        elif node == _ARRAY and int(content[0][0]) == _BASE and content[0][1][0] in PRIMITIVES:
            self.add(name, PRIMITIVES[content[0][1][0]], content[1])
        else:
            raise NoFixedLayout(name)

    def _add_base(self, name: str, base: str) -> None:
        if base == "string":
            self.add_string(name)
        elif base in PRIMITIVES:
            self.add(name, PRIMITIVES[base])
        else:
            raise NoFixedLayout(name)

    def _add_message(self, name: str, type_name: str) -> None:
        components = vector_components(self.definitions, type_name)
        if components:
            self.add(name, "<f8", len(components))
            return
        for member, description in self.definitions[type_name][1]:
            self.add_field(f"{name}.{member}", description)


_BASE, _NAME, _ARRAY = 1, 2, 3  # rosbags.interfaces.Nodetype


def vector_components(definitions: Definitions, type_name: str) -> tuple[str, ...]:
    """Names of the components when the type is only float64 numbers (Vector3, Quaternion, …), else none."""
    members = definitions[type_name][1]
    if all(int(node) == _BASE and content[0] == "float64" for _, (node, content) in members):
        return tuple(name for name, _ in members)
    return ()


def layout(definitions: Definitions, type_name: str, string_size: Callable[[str, int], int]) -> np.dtype[Any]:
    """Structure of a serialised message and its header: dotted field names, (k,) for vectors and arrays.

    ``string_size(name, offset)`` gives the size of a string with its final zero; the field "length of <name>"
    at the offset holds it. Raises NoFixedLayout for a type with sequences, KeyError for an unknown type.
    """
    builder = _Builder(definitions, string_size)
    for name, description in definitions[type_name][1]:
        builder.add_field(name, description)
    return np.dtype(
        {
            "names": builder.names,
            "formats": builder.formats,
            "offsets": builder.offsets,
            "itemsize": builder.end,
        }
    )


def decode(definitions: Definitions, type_name: str, messages: npt.NDArray[np.uint8]) -> npt.NDArray[Any] | None:
    """Structured view (n,) of n messages of equal length (n, length), or None without a common layout."""
    if len(messages) == 0 or not np.all(messages[:, :2] == np.frombuffer(HEADER[:2], np.uint8)):
        return None
    first = messages[0].tobytes()

    def string_size(name: str, at: int) -> int:
        size = int.from_bytes(first[at : at + 4], "little")
        if size > len(first) - at:  # damaged
            raise NoFixedLayout(name)
        return size

    try:
        structure = layout(definitions, type_name, string_size)
    except (NoFixedLayout, KeyError):
        return None
    if not 0 <= messages.shape[1] - structure.itemsize <= 3:  # writers may pad to four bytes
        return None
    table = np.ndarray(len(messages), structure, messages, strides=(messages.strides[0],))
    lengths = (table[name] for name in structure.names or () if name.startswith(LENGTH_OF))
    return table if all(np.all(length == length[0]) for length in lengths) else None


def encode(
    definitions: Definitions, type_name: str, count: int, fields: Mapping[str, Any], missing: float = 0.0
) -> npt.NDArray[Any]:
    """``count`` serialised messages as a structured array from flat fields; other numbers are ``missing``.

    A field is an array (count,) or (count, k), one value for all, or for a string one text. Raises KeyError
    for a field that the type does not have and NoFixedLayout for a type with sequences.
    """
    texts = {name: value.encode() for name, value in fields.items() if isinstance(value, str)}
    structure = layout(definitions, type_name, lambda name, _: len(texts.get(name, b"")) + 1)
    known = {name.removeprefix(LENGTH_OF) for name in structure.names or ()}
    for name in fields.keys() - known:
        raise KeyError(f"{type_name} has no field {name}")
    table = np.zeros(count, structure)
    table.view(np.uint8).reshape(count, -1)[:, : len(HEADER)] = np.frombuffer(HEADER, np.uint8)
    for name in structure.names or ():
        if name.startswith(LENGTH_OF):
            table[name] = len(texts.get(name.removeprefix(LENGTH_OF), b"")) + 1
        elif name in fields:
            table[name] = texts.get(name, fields[name])
        elif structure[name].base.kind == "f":
            table[name] = missing
    return table
