"""Signals of several axes against what each should be: one agrees with its own, or follows another one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.flight_check.finding import ERROR, Finding
from aircraft_sysid_ros.flight_check.grid import Comparison, compare

Array = npt.NDArray[np.float64]

#: An axis follows another: correlation with that, and share of it that its own has at most, or how many times more of
#: its variance its own leaves: where roll and yaw go together, p and r have much in common.
_FOLLOWS, _OWN, _LEAVES = 0.7, 0.5, 10.0


@dataclass(frozen=True)
class Triple:
    """Signals by ``names`` with what they should be, as many of (n,) on one grid, and what that is in words."""

    names: tuple[str, ...]
    measured: Sequence[Array]
    expected: Sequence[Array]
    step: float
    words: str
    longest_lag: float = 0.5

    @cached_property
    def comparisons(self) -> list[list[Comparison | None]]:
        """Of each signal with each expectation."""
        return [[compare(y, x, self.step, self.longest_lag) for x in self.expected] for y in self.measured]

    def correlation(self, axis: int, other: int) -> float:
        """Of the signal of an axis with what another one should be; 0 where that is not sure."""
        comparison = self.comparisons[axis][other]
        return comparison.correlation if comparison is not None and comparison.is_sure else 0.0

    @cached_property
    def follows(self) -> dict[int, int]:
        """Axes that follow another one."""
        found = {}
        for i, row in enumerate(self.comparisons):
            strength = [abs(c.correlation) if c is not None and c.is_sure else 0.0 for c in row]
            j = int(np.argmax(strength))
            leaves = [1.0 - min(each, 1.0) ** 2 for each in strength]
            is_less = strength[i] < _OWN * strength[j] or leaves[i] > _LEAVES * leaves[j]
            if j != i and strength[j] > _FOLLOWS and is_less:
                found[i] = j
        return found

    @property
    def places(self) -> dict[str, str]:
        """Exchanged signals, each with the name that it should have."""
        return {self.names[i]: self.names[j] for i, j in self.follows.items() if i in self.follows.values()}

    @property
    def findings(self) -> list[Finding]:
        """Of axes that follow another one, those only that are followed by another: exchanged."""
        found = []
        for i, j in self.follows.items():
            comparison = self.comparisons[i][j]
            if comparison is not None and self.names[i] in self.places:
                other = self.names[j]
                way = "minus " if comparison.correlation < 0.0 else ""
                found.append(Finding(
                    (self.names[i],), "sign", ERROR,
                    f"it follows what {other} should be by {self.words} (correlation {comparison.correlation:.2f}) and "
                    f"not its own: the axes are swapped, use this one as {way}{other}",
                ))  # fmt: skip
        return found
