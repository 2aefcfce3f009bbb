"""How every command shows its notes to people."""

from __future__ import annotations

from collections.abc import Iterable


def note_lines(notes: Iterable[str]) -> list[str]:
    """The notes of a result, one line each."""
    return [f"note: {note}" for note in notes]
