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


def intervals(count: int, shortest: int, every: int) -> tuple[Integers, Integers]:
    """First and last index (exclusive) of intervals of n points; those that go on to the end have last = n."""
    edges = np.arange(every, count - shortest // 2, every)
    begin, end = np.meshgrid(edges, np.append(edges[edges < count - shortest], count), indexing="ij")
    keep = end - begin >= shortest
    return begin[keep], end[keep]


def sums_of_squares(series: Whitened, kind: str, begin: Integers, end: Integers) -> Array:
    """Residual sums of squares (w,) of CONSTANT, FROZEN or PART for each interval."""
    constant = series.rest.shape[1] + series.acting.shape[1]
    ends = [series.constant[:, None], series.response[:, None]]
    of_acting = _running(np.column_stack([series.rest, series.acting, *ends]))
    total, inside = of_acting[-1], of_acting[end] - of_acting[begin]  # (w, c, c)
    if kind == FROZEN:
        of_frozen = _running(np.column_stack([series.rest, series.frozen, *ends]))
        held = of_frozen[end] - of_frozen[begin]
        total, inside = total - inside + held, held
    if kind == PART:
        return _all_left(*_with_part(total, inside, series.rest.shape[1], constant))
    return _all_left(_with_constant(total, inside, constant), constant + 1)


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


def _with_part(sums: Array, inside: Array, first: int, constant: int) -> tuple[Array, int]:
    """Sums of products with the columns from ``first`` up to the constant once more, there inside of the interval only.

    Returns them and the place of the response.
    """
    whole = [*range(constant)]
    only_inside = [*range(first, constant + 1)]
    order = np.array([*whole, *only_inside, constant + 1])
    out = inside[:, order[:, None], order[None, :]]
    everywhere = np.array([*whole, len(order) - 1])
    out[:, everywhere[:, None], everywhere[None, :]] = sums[order[everywhere][:, None], order[everywhere][None, :]]
    return out, len(order) - 1


def _all_left(sums: Array, response: int) -> Array:
    """Residual sums of squares of all columns before the response."""
    a, b = sums[:, :response, :response], sums[:, :response, response]
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("wii->wi", a), 1e-30))
    a = a * scale[:, :, None] * scale[:, None, :] + 1e-9 * np.eye(response)
    b = b * scale
    return np.asarray(
        sums[:, response, response] - np.einsum("wi,wi->w", b, np.linalg.solve(a, b[:, :, None])[:, :, 0])
    )
