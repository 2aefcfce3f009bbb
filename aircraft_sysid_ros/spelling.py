"""What may have been meant by a word that nobody knows."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

#: Likeness that the first parts of two words need whose last parts are the same.
_OWN = 0.5


def nearest(word: str, known: Iterable[str], count: int = 1, likeness: float = 0.6) -> list[str]:
    """Known words that look like ``word``, best first, whatever their case.

    Two letters that changed places are the commonest slip, and stand before any other: 'rsl' is rls, not rml. A last
    part that both have makes nothing alike: 'unknown_effect' is not ground_effect.
    """
    words = {each.lower(): each for each in known}
    wanted = word.lower()
    swapped = [each for each in words if sorted(each) == sorted(wanted)]
    close = difflib.get_close_matches(wanted, words, count + len(swapped), likeness)
    alike = [each for each in close if _own_likeness(wanted, each) >= min(likeness, _OWN)]
    return [words[each] for each in [*swapped, *(each for each in alike if each not in swapped)][:count]]


def _own_likeness(word: str, known: str) -> float:
    """How much alike (0 to 1) two words are without a last part, after an underscore, that both have."""
    shared = word.rpartition("_")[2]
    if "_" not in word or not known.endswith(f"_{shared}"):
        return 1.0
    own, other = (each.removesuffix(f"_{shared}") for each in (word, known))
    return difflib.SequenceMatcher(None, other, own).ratio()


def did_you_mean(word: str, known: Iterable[str], count: int = 1, likeness: float = 0.6, quote: str = "") -> str:
    """The question for the end of a sentence; empty where no known word is near."""
    near = [f"{quote}{each}{quote}" for each in nearest(word, known, count, likeness)]
    return f"did you mean {' or '.join(near)}?" if near else ""
