"""ArduPilot's DataFlash log as text (.log), as ground stations make it of a .bin: put back into that form."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import NamedTuple

from aircraft_sysid_ros.errors import InputError

TEXT = b"FMT,"
_HEAD = b"\xa3\x95"
#: Letters of a format: how `struct` packs them, and the factor that a text has applied, as in AP_Logger/LogStructure.h.
_LETTERS = {
    "b": ("b", 1.0), "B": ("B", 1.0), "M": ("B", 1.0), "h": ("h", 1.0), "H": ("H", 1.0), "i": ("i", 1.0),
    "I": ("I", 1.0), "q": ("q", 1.0), "Q": ("Q", 1.0), "f": ("f", 0.0), "d": ("d", 0.0), "g": ("e", 0.0),
    "c": ("h", 0.01), "C": ("H", 0.01), "e": ("i", 0.01), "E": ("I", 0.01), "L": ("i", 1e-7), "n": ("4s", 0.0),
    "N": ("16s", 0.0), "Z": ("64s", 0.0), "a": ("64s", 0.0),
}  # fmt: skip
_FORMATS = "FMT", "BBnNZ"
_NO_MODE = 255


class _Format(NamedTuple):
    number: int
    letters: str
    layout: struct.Struct


def write_as_binary(path: Path, target: Path) -> int:
    """Write a text log as the binary one that it was made from; returns how many of its lines nobody can read.

    Raises InputError where no line says how messages are laid out.
    """
    formats: dict[str, _Format] = {}
    unread = 0
    with path.open(encoding="utf8", errors="replace") as lines, target.open("wb") as out:
        for line in filter(str.strip, lines):
            name, _, rest = line.partition(",")
            try:
                if name == _FORMATS[0]:
                    described, form = _format_of(rest)
                    formats[described] = form
                form = formats[name.strip()]
                cells = [cell.strip() for cell in rest.split(",", len(form.letters) - 1)]
                out.write(_HEAD + bytes([form.number]) + _packed(form, cells))
            except (KeyError, ValueError, OverflowError, struct.error):
                unread += 1
    if _FORMATS[0] not in formats:
        raise InputError("it is a DataFlash log as text, of which no line says how FMT is laid out")
    return unread


def _format_of(rest: str) -> tuple[str, _Format]:
    """The name of the message that a line of FMT describes, and how it is laid out."""
    number, _, name, letters, _ = (cell.strip() for cell in rest.split(",", 4))
    return name, _Format(int(number), letters, struct.Struct("<" + "".join(_LETTERS[x][0] for x in letters)))


def _packed(form: _Format, cells: list[str]) -> bytes:
    """The cells of a line as the numbers that were scaled to them; raises ValueError or struct.error for others."""
    if len(cells) != len(form.letters):
        raise ValueError("a line of another length")
    return form.layout.pack(*map(_value, form.letters, cells))


def _value(letter: str, cell: str) -> int | float | bytes:
    kind, factor = _LETTERS[letter]
    if kind.endswith("s"):
        return cell.encode()
    if letter == "M" and cell[:1].isalpha():
        return _NO_MODE  # Mission Planner writes its name; nothing reads modes
    if not factor:
        return float(cell)
    if factor == 1.0 and cell.lstrip("-").isdigit():
        return int(cell)  # a time of a year in us is more than a float holds
    return round(float(cell) / factor)
