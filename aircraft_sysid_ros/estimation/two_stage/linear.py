"""The linear half of the two-stage paper (docs/references.md): xi1 at a fixed xi2, by orthogonal factors.

The rows are divided by the root of R and compressed by QR, block by block, to a triangle of the number of columns:
all that follows works on that triangle. The printed solution (A'A)^-1 A'(Z - B) of (19) squares A and is not used.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.least_squares import solve_factor

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Rows of a block: it stays in the cache while it is factored.
_BLOCK = 384


class LinearStage(NamedTuple):
    """xi1 at one xi2."""

    xi1: Array  # (n1,)
    squares: float  # sum of the squares of the whitened residuals
    determined: Mask  # (n1,) whether the rows tell them


def triangle(columns: list[Array], noise: Array) -> Array:
    """R factor (c, c) of the columns, parts (K, m, c_i) side by side, whitened with the diagonal noise (m,) of R."""
    side_by_side = np.concatenate(columns, axis=2)
    side_by_side /= np.sqrt(noise)[:, None]
    rows = side_by_side.reshape(-1, side_by_side.shape[2])
    whole = len(rows) // _BLOCK * _BLOCK
    if whole > _BLOCK:
        blocks = np.linalg.qr(rows[:whole].reshape(-1, _BLOCK, rows.shape[1]), mode="r")
        rows = np.concatenate([np.asarray(blocks).reshape(-1, rows.shape[1]), rows[whole:]])
    return np.asarray(np.linalg.qr(rows, mode="r"))


def linear_stage(a: Array, offset: Array, noise: Array) -> LinearStage:
    """xi1 of (27): least squares of offset = z - b (K, m) on A (K, m, n1); with noise of ones (23) and (19)."""
    root = triangle([a, offset[:, :, None]], noise)
    n = a.shape[2]
    solution = solve_factor(root[:n, :n], root[:n, n])
    left = root[:n, n] - root[:n, :n] @ solution.estimate  # not zero where A is rank deficient
    return LinearStage(solution.estimate, float(left @ left + root[n, n] ** 2), solution.determined)
