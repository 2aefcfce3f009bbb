"""ArduPilot's DataFlash log as text (.log), as ground stations make it of a .bin: put back into that form."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from aircraft_sysid_ros.errors import InputError

TEXT = b"FMT,"
_HEAD = b"\xa3\x95"
#: Letters of a format: NumPy type and the factor of what is read, as in AP_Logger/LogStructure.h.
LETTERS: dict[str, tuple[str, float | None]] = {
    "b": ("i1", None), "B": ("u1", None), "M": ("u1", None), "h": ("<i2", None), "H": ("<u2", None),
    "i": ("<i4", None), "I": ("<u4", None), "q": ("<i8", None), "Q": ("<u8", None), "f": ("<f4", None),
    "d": ("<f8", None), "g": ("<f2", None), "c": ("<i2", 0.01), "C": ("<u2", 0.01), "e": ("<i4", 0.01),
    "E": ("<u4", 0.01), "L": ("<i4", 1e-7), "n": ("S4", None), "N": ("S16", None), "Z": ("S64", None),
    "a": ("(32,)<i2", None),
}  # fmt: skip
_FORMATS = "FMT", "BBnNZ"
_NO_MODE = 255


class _Format(NamedTuple):
    number: int
    letters: str
    layout: np.dtype[np.void]


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
            except (KeyError, ValueError, OverflowError):
                unread += 1
    if _FORMATS[0] not in formats:
        raise InputError("it is a DataFlash log as text, of which no line says how FMT is laid out")
    return unread


def _format_of(rest: str) -> tuple[str, _Format]:
    """The name of the message that a line of FMT describes, and how it is laid out."""
    number, _, name, letters, _ = (cell.strip() for cell in rest.split(",", 4))
    return name, _Format(int(number), letters, np.dtype([(f"f{i}", LETTERS[x][0]) for i, x in enumerate(letters)]))


def _packed(form: _Format, cells: list[str]) -> bytes:
    """The cells of a line as the numbers that were scaled to them; raises ValueError or OverflowError for others."""
    if len(cells) != len(form.letters):
        raise ValueError("a line of another length")
    return np.array(tuple(map(_value, form.letters, cells)), form.layout).tobytes()


def _value(letter: str, cell: str) -> int | float | bytes:
    kind, factor = LETTERS[letter]
    if letter == "a":
        return 0  # nothing reads arrays
    if letter == "M" and cell[:1].isalpha():
        return _NO_MODE  # Mission Planner writes its name; nothing reads modes
    if kind.startswith("S"):
        return cell.encode()
    if "f" in kind:
        return float(cell)
    if factor is None and cell.lstrip("-").isdigit():
        return int(cell)  # a time of a year in us is more than a float holds
    return round(float(cell) / (factor or 1.0))
