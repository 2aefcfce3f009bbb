"""What may have been meant by a word that nobody knows."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def nearest(word: str, known: Iterable[str], count: int = 1, likeness: float = 0.6) -> list[str]:
    """Known words that look like ``word``, best first, whatever their case.

    Two letters that changed places are the commonest slip, and stand before any other: 'rsl' is rls, and not rml.
    """
    words = {each.lower(): each for each in known}
    wanted = word.lower()
    swapped = [each for each in words if sorted(each) == sorted(wanted)]
    alike = difflib.get_close_matches(wanted, words, count + len(swapped), likeness)
    return [words[each] for each in [*swapped, *(each for each in alike if each not in swapped)][:count]]


def did_you_mean(word: str, known: Iterable[str], count: int = 1, likeness: float = 0.6, quote: str = "") -> str:
    """The question for the end of a sentence; empty where no known word is near."""
    near = [f"{quote}{each}{quote}" for each in nearest(word, known, count, likeness)]
    return f"did you mean {' or '.join(near)}?" if near else ""
