"""The flight condition from questions that may each know a part of it.

Air data may come in parts: beside a MAVLink bridge a message holds the airspeed, or both angles, and NaN for the rest.
So the last finite value of each part is taken until it is too old.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.consumer.snapshot import Condition
from aircraft_sysid_ros.stamps import NANOSECONDS

Array = npt.NDArray[np.float64]

_WORDS = {"airspeed": "airspeed", "alpha": "angle of attack", "beta": "sideslip"}


class FlownCondition:
    """The newest finite value of airspeed, alpha and beta, each for ``longest`` [s]."""

    def __init__(self, longest: float) -> None:
        self._longest = longest
        self._values = np.full(3, np.nan)
        self._stamps = np.zeros(3, dtype=np.int64)  # [ns]; of what never came of no meaning

    def at(self, now: int, condition: Condition | None) -> Array:
        """What is known (3,) at a time [ns] at which ``condition`` is given; NaN: nothing is."""
        given = np.full(3, np.nan) if condition is None else np.array(Condition(*condition))
        is_new = np.isfinite(given)
        self._values[is_new], self._stamps[is_new] = given[is_new], now
        return np.where(np.abs(self._ages(now)) <= self._longest, self._values, np.nan)

    def lacking(self, now: int) -> str:
        """What is not known at a time [ns], in words; empty: all is."""
        found = []
        for word, value, age in zip(_WORDS.values(), self._values.tolist(), self._ages(now).tolist(), strict=True):
            if np.isnan(value):
                found.append(f"no {word} has come")
            elif abs(age) > self._longest:
                found.append(f"no {word} for {abs(age):.1f} s")
        return ", ".join(found)

    @property
    def never(self) -> npt.NDArray[np.bool_]:
        """Which (3,) have never come."""
        return np.isnan(self._values)

    def _ages(self, now: int) -> Array:
        return np.asarray((now - self._stamps) / NANOSECONDS)


def in_words(which: npt.NDArray[np.bool_]) -> str:
    """Names of parts (3,) of the flight condition."""
    return " and no ".join(word for word, is_one in zip(_WORDS.values(), which.tolist(), strict=True) if is_one)
