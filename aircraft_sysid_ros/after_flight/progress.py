"""How long work says how far it is."""

from __future__ import annotations

from collections.abc import Callable

#: Hears what is being done and which share of it is, from 0 to 1.
Tell = Callable[[str, float], None]
#: What is told before kernels are loaded: compiled where no process has run them yet.
FIRST_START = "load numerical kernels (the first start compiles them: minutes)"


def nobody(what: str, share: float) -> None:
    """Nobody wants to know."""


def part_of(tell: Tell, begin: float, end: float) -> Tell:
    """The progress of one part of longer work, which goes from ``begin`` to ``end`` of it."""
    return lambda what, share: tell(what, begin + (end - begin) * share)
