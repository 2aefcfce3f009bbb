"""Least squares of a series with the colour of its residuals, and many small fits at once, compiled.

A search makes thousands of such fits of some hundred points. Columns of regressors stand here as rows: their points
side by side, which is what makes sums fast.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.search.block_sums import dot
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: A direction of the columns that is this small against the largest is not in the data.
SINGULAR = 1e-8


@njit(cache=True, fastmath={"contract"})
def _add(total: Array, factor: float, values: Array) -> None:
    for n in range(len(total)):
        total[n] += factor * values[n]


@njit(cache=True)
def _autoregression(residual: Array, order: int, floor: float) -> Array:
    """Filter (order + 1,) that makes a series (n,) white, by Yule and Walker, solved as Levinson and Durbin do;
    ``floor``: white noise that is in it besides."""
    count = len(residual)
    centred = residual - residual.mean()
    lags = np.empty(order + 1)
    for k in range(order + 1):
        lags[k] = dot(centred[k:], centred[: count - k]) / count
    lags[0] = lags[0] * (1.0 + 1e-4) + floor**2
    found, before, left = np.zeros(order + 1), np.empty(order + 1), lags[0]
    found[0] = 1.0
    for k in range(1, order + 1):
        if left <= 0.0:  # nothing is left that could have a colour
            break
        reflection = lags[k]
        for j in range(1, k):
            reflection += found[j] * lags[k - j]
        reflection /= -left
        before[:k] = found[:k]
        for j in range(1, k):
            found[j] += reflection * before[k - j]
        found[k] = reflection
        left *= 1.0 - reflection**2
    return found


@njit(cache=True)
def whitened_rows(rows: Array, filtering: Array) -> Array:
    """Series (k, n) through the filter, without their beginning."""
    first = len(filtering) - 1
    count = max(rows.shape[1] - first, 0)
    out = np.zeros((len(rows), count))
    for i in range(len(rows)):
        for lag in range(first + 1):
            _add(out[i], filtering[lag], rows[i, first - lag : first - lag + count])
    return out


@njit(cache=True)
def _triangular(rows: Array) -> Array:
    """The triangle R (k, k) of columns that stand as rows (k, n), n >= k, by reflections of Householder."""
    k, work = len(rows), rows.copy()
    out = np.zeros((k, k))
    for i in range(k):
        along = work[i, i:]
        length = np.sqrt(dot(along, along))
        if length == 0.0:
            for j in range(i + 1, k):
                out[i, j] = work[j, i]
            continue
        out[i, i] = -length if along[0] > 0.0 else length
        along[0] -= out[i, i]
        half = -along[0] * out[i, i]  # of the square of the reflection's normal
        for j in range(i + 1, k):
            _add(work[j, i:], -dot(along, work[j, i:]) / half, along)
            out[i, j] = work[j, i]
    return out


@njit(cache=True)
def _is_regular(triangle: Array) -> bool:
    """Whether surely no direction of a triangle (k, k) is singular."""
    k = len(triangle)
    inverse, whole, square = np.zeros((k, k)), 0.0, 0.0
    for j in range(k):
        if triangle[j, j] == 0.0:
            return False
        inverse[j, j] = 1.0 / triangle[j, j]
        for i in range(j - 1, -1, -1):
            rest = 0.0
            for m in range(i + 1, j + 1):
                rest -= triangle[i, m] * inverse[m, j]
            inverse[i, j] = rest / triangle[i, i]
        for i in range(j + 1):
            whole += triangle[i, j] ** 2
            square += inverse[i, j] ** 2
    return whole * square * SINGULAR**2 < 1.0


@njit(cache=True)
def _smallest(columns: Array, response: Array) -> Array:
    """The smallest parameters (k,) of columns (n, k) some directions of which may be singular."""
    return np.linalg.lstsq(columns, response, SINGULAR)[0]  # type: ignore[return-value]


@njit(cache=True)
def _least_squares(rows: Array) -> Array:
    """Parameters (k,) of columns that stand as rows before the response (k + 1, n), the smallest of them."""
    k, count = len(rows) - 1, rows.shape[1]
    if not count:
        return np.zeros(k)
    if count <= k:
        return _smallest(rows[:k].T.copy(), rows[k].copy())
    triangle = _triangular(rows)
    if k and not _is_regular(triangle[:k, :k]):
        return _smallest(triangle[:k, :k].copy(), triangle[:k, k].copy())
    theta = triangle[:k, k].copy()
    for i in range(k - 1, -1, -1):
        for j in range(i + 1, k):
            theta[i] -= triangle[i, j] * theta[j]
        theta[i] /= triangle[i, i]
    return theta


@njit(cache=True)
def _residual(rows: Array, theta: Array) -> Array:
    """What columns before a response (k + 1, n) leave of it (n,)."""
    left = rows[-1].copy()
    for i in range(len(theta)):
        _add(left, -theta[i], rows[i])
    return left


@njit(cache=True)
def coloured_fit(
    columns: Array, response: Array, filtering: Array, order: int, floor: float, rounds: int
) -> tuple[Array, Array, Array, Array, float]:
    """Generalised least squares of columns (n, k): the whitened rows (k + 1, m), the last of which is the response;
    parameters (k,) of columns of size 1; the colour; the sizes (k,); the variance of the innovations.

    With ``rounds`` the colour is sought that suits the residuals best, of that order; without it is ``filtering``.
    """
    count, k = columns.shape
    rows, size = np.empty((k + 1, count)), np.empty(k)
    for i in range(k):
        rows[i] = columns[:, i]
        size[i] = np.sqrt(dot(rows[i], rows[i]) / count)
        if size[i] > 0.0:
            rows[i] /= size[i]
    rows[k] = response
    colour = filtering
    theta = _least_squares(rows) if rounds else np.zeros(k)
    white = rows
    for _ in range(max(rounds, 1)):
        if rounds:
            colour = _autoregression(_residual(rows, theta), order, floor)
        white = whitened_rows(rows, colour)
        theta = _least_squares(white)
    innovations = _residual(white, theta)
    variance = dot(innovations, innovations) / len(innovations) + floor**2 * dot(colour, colour)
    if not np.isfinite(variance):
        raise ValueError("a series that is to be fitted is not finite")
    return white, theta, colour, size, variance


@njit(cache=True)
def running(rows: Array) -> Array:
    """Sums (n + 1, c, c) of products of columns that stand as rows (c, n) up to each point."""
    c, count = rows.shape
    out = np.empty((count + 1, c, c))
    out[0] = 0.0
    for n in range(count):
        for i in range(c):
            for j in range(i + 1):
                out[n + 1, i, j] = out[n, i, j] + rows[i, n] * rows[j, n]
                out[n + 1, j, i] = out[n + 1, i, j]
    return out


@njit(cache=True)
def all_left(
    sums: Array, replaced: Array, is_replaced: bool, first: int, constant: int, begin: Integers, end: Integers
) -> Array:
    """Residual sums of squares (w,) of the columns before the response, the last, for intervals of points.

    ``sums`` (n + 1, c, c) are running sums of products, and ``replaced`` of those that take their place inside of the
    interval, if they do. Columns from ``first`` up to the constant are there once more, inside of the interval only,
    as the constant is; without any of these first = constant.
    """
    again = constant - first
    response = constant + again + 1
    order = np.empty(response + 1, np.int64)
    order[:constant] = np.arange(constant)
    order[constant:] = np.arange(first, constant + 2)
    total, within = sums[-1], replaced if is_replaced else sums
    whole, inside, out = np.empty_like(total), np.empty_like(total), np.empty(len(begin))
    a, scale = np.empty((response, response + 1)), np.empty(response)
    for w in range(len(begin)):
        for i in range(constant + 2):
            for j in range(constant + 2):
                inside[i, j] = within[end[w], i, j] - within[begin[w], i, j]
                whole[i, j] = total[i, j]
                if is_replaced:
                    whole[i, j] += inside[i, j] - (sums[end[w], i, j] - sums[begin[w], i, j])
        for i in range(response):
            for j in range(response + 1):
                everywhere = i < constant and (j < constant or j == response)
                a[i, j] = (whole if everywhere else inside)[order[i], order[j]]
            scale[i] = 1.0 / np.sqrt(max(a[i, i], 1e-30))
        for i in range(response):
            for j in range(response):
                a[i, j] *= scale[i] * scale[j]
            a[i, i] += 1e-9
            a[i, response] *= scale[i]
        out[w] = whole[constant + 1, constant + 1] - _explained(a)
    return out


@njit(cache=True)
def _explained(a: Array) -> float:
    """b' A^-1 b of a symmetric matrix with its right side (k, k + 1), which are worked on in place."""
    k = len(a)
    right = a[:, k].copy()
    for i in range(k):
        pivot = i
        for m in range(i + 1, k):
            if abs(a[m, i]) > abs(a[pivot, i]):
                pivot = m
        if pivot != i:
            for j in range(i, k + 1):
                a[i, j], a[pivot, j] = a[pivot, j], a[i, j]
        for m in range(i + 1, k):
            factor = a[m, i] / a[i, i]
            for j in range(i + 1, k + 1):
                a[m, j] -= factor * a[i, j]
    total = 0.0
    for i in range(k - 1, -1, -1):
        for j in range(i + 1, k):
            a[i, k] -= a[i, j] * a[j, k]
        a[i, k] /= a[i, i]
        total += right[i] * a[i, k]
    return total
