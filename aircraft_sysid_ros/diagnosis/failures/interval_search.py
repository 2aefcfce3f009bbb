"""When an input stops acting, and when it acts again: all pairs of times at once.

Between t1 and t2 the part of an input in an axis is a constant: the columns that read it are frozen there, and one more
column is 1 there. That costs one number more than the model has, as much as a constant alone, which is its rival: what
the freezing explains beyond a change of trim is what tells it. Sums over all intervals come from running sums of
products, so that a pass over thousands of intervals is some thousand small solves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: The hypotheses of an interval: nothing; another constant; the input frozen, with a constant of each axis; at one
#: level that is the same in all axes; at 0.
BASE, CONSTANT, FROZEN, HELD, NIL = "base", "constant", "frozen", "held", "nil"


@dataclass(frozen=True)
class Whitened:
    """Whitened columns of one axis for one input, and the response."""

    rest: Array  # (n, k) those that do not read the input
    acting: Array  # (n, m) those that do
    frozen: Array  # (n, m) the same with the input at its mean
    constant: Array  # (n,) what a unit of the input does
    response: Array  # (n,)


def intervals(count: int, shortest: int, every: int) -> tuple[Integers, Integers]:
    """First and last index (exclusive) of intervals of n points; those that go on to the end have last = n."""
    edges = np.arange(every, count - shortest // 2, every)
    begin, end = np.meshgrid(edges, np.append(edges[edges < count - shortest], count), indexing="ij")
    keep = end - begin >= shortest
    return begin[keep], end[keep]


def sums_of_squares(series: Whitened, begin: Integers, end: Integers) -> dict[str, Array]:
    """Residual sums of squares (w,) of CONSTANT and FROZEN for each interval, and of BASE."""
    k, m = series.rest.shape[1], series.acting.shape[1]
    parts = [series.rest, series.acting, series.constant[:, None], series.response[:, None]]
    acting = np.column_stack(parts)
    frozen = np.column_stack([parts[0], series.frozen, *parts[2:]])
    of_acting, of_frozen = _running(acting), _running(frozen)
    constant, response = k + m, k + m + 1
    total = of_acting[-1]
    found = {BASE: np.full(len(begin), _left(total, [*range(k + m)], response))}
    inside = of_acting[end] - of_acting[begin]  # (w, c, c)
    found[CONSTANT] = _all_left(_with_constant(total, inside, constant), response)
    held = of_frozen[end] - of_frozen[begin]
    found[FROZEN] = _all_left(_with_constant(total - inside + held, held, constant), response)
    return found


def _running(columns: Array) -> Array:
    """Sums (n + 1, c, c) of products of columns (n, c) up to each point."""
    products = columns[:, :, None] * columns[:, None, :]
    return np.concatenate([np.zeros((1, *products.shape[1:])), np.cumsum(products, axis=0)])


def _with_constant(sums: Array, inside: Array, constant: int) -> Array:
    """Sums of products (w, c, c) in which the constant is there inside of the interval only."""
    out = np.broadcast_to(sums, inside.shape).copy()
    out[:, constant, :] = inside[:, constant, :]
    out[:, :, constant] = inside[:, :, constant]
    return out


def _left(total: Array, columns: list[int], response: int) -> float:
    a, b = total[np.ix_(columns, columns)], total[columns, response]
    return float(total[response, response] - b @ np.linalg.lstsq(a, b, rcond=1e-10)[0])


def _all_left(sums: Array, response: int) -> Array:
    """Residual sums of squares of all columns before the response."""
    a, b = sums[:, :response, :response], sums[:, :response, response]
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("wii->wi", a), 1e-30))
    a = a * scale[:, :, None] * scale[:, None, :] + 1e-9 * np.eye(response)
    b = b * scale
    return np.asarray(
        sums[:, response, response] - np.einsum("wi,wi->w", b, np.linalg.solve(a, b[:, :, None])[:, :, 0])
    )
