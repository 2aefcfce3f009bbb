"""When an input stops acting, and when it acts again: all pairs of times at once.

Between t1 and t2 the part of an input in an axis is a constant: the columns that read it are frozen there, and one more
column is 1 there. That costs one number more than the model has, as much as a constant alone, which is its rival: what
the freezing explains beyond a change of trim is what tells it. Sums over all intervals come from running sums of
products, so that a pass over thousands of intervals is some thousand small solves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.failures.coloured_fit import all_left, running

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: The hypotheses of an interval: another constant; the input frozen, with a constant of each axis; at one level that is
#: the same in all axes; at 0; with part of its effect, and a constant of each axis.
CONSTANT, FROZEN, HELD, NIL, PART = "constant", "frozen", "held", "nil", "part"


@dataclass(frozen=True)
class Whitened:
    """Whitened columns of one axis for one input, and the response."""

    rest: Array  # (n, k) those that do not read the input
    acting: Array  # (n, m) those that do
    frozen: Array  # (n, m) the same with the input at its mean
    constant: Array  # (n,) what a unit of the input does
    response: Array  # (n,)

    @cached_property
    def of_acting(self) -> Array:
        """Running sums of products of all columns with those that read the input."""
        return self._running(self.acting)

    @cached_property
    def of_frozen(self) -> Array:
        """The same with those at its mean."""
        return self._running(self.frozen)

    def _running(self, moving: Array) -> Array:
        columns = np.column_stack([self.rest, moving, self.constant, self.response])
        return running(np.ascontiguousarray(columns.T))


def intervals(count: int, shortest: int, every: int) -> tuple[Integers, Integers]:
    """First and last index (exclusive) of intervals of n points; those that go on to the end have last = n."""
    edges = np.arange(every, count - shortest // 2, every)
    begin, end = np.meshgrid(edges, np.append(edges[edges < count - shortest], count), indexing="ij")
    keep = end - begin >= shortest
    return begin[keep], end[keep]


def sums_of_squares(series: Whitened, kind: str, begin: Integers, end: Integers) -> Array:
    """Residual sums of squares (w,) of CONSTANT, FROZEN or PART for each interval."""
    first, constant = series.rest.shape[1], series.rest.shape[1] + series.acting.shape[1]
    replaced = series.of_frozen if kind == FROZEN else series.of_acting
    again = first if kind == PART else constant
    return all_left(series.of_acting, replaced, kind == FROZEN, again, constant, begin, end)
