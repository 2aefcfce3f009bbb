"""Between which two moments of a flight a change explains most: all intervals at once, by sums up to each moment.

What the terms x of a change are from t0 to t1 and nought otherwise, freed of the model with its orthonormal basis B, is
a column z of which all products are differences of sums S up to a moment. With what the model leaves of all points, e,

    gain(t0, t1) = b' A^-1 b,    b = S(x e),    A = S(x x') - S(x B) S(x B)',    S(.) = S(., t1) - S(., t0).

It is the gain of the fit to all points, each term with a number of its own; what an interval explains of flight that
was held out is judged afterwards. A change in the middle of a flight need not begin or end near the moment of the best
single step, and where the model can stand for it in steady flight it is told by its two edges alone, to the second.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.search.candidates import SHORTEST_CHANGE, limits
from aircraft_sysid_ros.diagnosis.search.fit import AxisFit
from aircraft_sysid_ros.effects.effect import END, STEP, Variant, fill
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Moments that are tried first as beginning and as end, how many intervals go on, and how far apart they are [moments].
_MOMENTS, _STARTS, _APART = 160, 3, 6
#: Moments to either side of an edge that are tried next, and how often, each time closer.
_NEARBY, _CLOSER = 8, 2
#: A variance below this share of the largest is no direction of the terms.
_SINGULAR = 1e-9
#: Rounds of rotations after which a small matrix is diagonal, and the share of its squares beside that is rounding.
_SWEEPS, _ROUNDING = 20, 1e-30


class _AxisSums:
    """Sums over the points of an axis up to each of them."""

    def __init__(self, data: FlightData, fit: AxisFit, texts: Sequence[str], base: Mapping[str, str]) -> None:
        always = [fill(text.replace(STEP, "1"), base) for text in texts]
        terms = np.nan_to_num(data.columns(data.parsed(always))[fit.rows])
        size = np.sqrt(np.mean(terms**2, axis=0))
        terms = terms / np.where(size > 0.0, size, 1.0)
        (count, self._k), self._whole = terms.shape, float(fit.residual @ fit.residual)
        beside = np.column_stack([terms, fit.basis, fit.residual])
        products = (terms[:, :, None] * beside[:, None, :]).reshape(count, -1)
        self._sums = np.zeros((count + 1, products.shape[1]))
        np.cumsum(products, axis=0, out=self._sums[1:])
        self._time = data.signal("time")[fit.rows]

    def log_ratios(self, begin: Array, end: Array) -> Array:
        """ln(sum of squares without a change / with it) of intervals (w,) [s]."""
        first, last = (np.searchsorted(self._time, edge, side="right") for edge in (begin, end))
        values, along = _directions(self._sums, first, last, self._k)
        there = values > _SINGULAR * max(float(values.max(initial=0.0)), 1e-300)
        explained = np.sum(np.where(there, along**2 / np.where(there, values, 1.0), 0.0), axis=1)
        return np.asarray(-np.log(np.maximum(1.0 - explained / max(self._whole, 1e-300), 1e-12)))


@njit(cache=True)
def _directions(sums: Array, first: Integers, last: Integers, k: int) -> tuple[Array, Array]:
    """Eigenvalues (w, k) of A, and b along its eigenvectors, of w intervals between two rows of sums (N + 1, …)."""
    width = sums.shape[1] // k
    values, along = np.empty((len(first), k)), np.zeros((len(first), k))
    inside, matrix, vectors = np.empty((k, width)), np.empty((k, k)), np.empty((k, k))
    for w in range(len(first)):
        for i in range(k):
            for c in range(width):
                inside[i, c] = sums[last[w], i * width + c] - sums[first[w], i * width + c]
            for j in range(i + 1):
                total = inside[i, j]
                for c in range(k, width - 1):
                    total -= inside[i, c] * inside[j, c]
                matrix[i, j] = matrix[j, i] = total
        _diagonalise(matrix, vectors)
        for i in range(k):
            values[w, i] = matrix[i, i]
            for j in range(k):
                along[w, i] += vectors[j, i] * inside[j, width - 1]
    return values, along


@njit(cache=True)
def _diagonalise(matrix: Array, vectors: Array) -> None:
    """Turn a symmetric matrix (k, k) until its eigenvalues stand in its diagonal, and its eigenvectors in columns.

    By cyclic Jacobi rotations (Golub and Van Loan 2013, algorithm 8.5.2): of two by two one is exact.
    """
    k = len(matrix)
    vectors[:] = 0.0
    for i in range(k):
        vectors[i, i] = 1.0
    for _ in range(_SWEEPS):
        beside, size = 0.0, 0.0
        for i in range(k):
            for j in range(k):
                size += matrix[i, j] ** 2
                beside += matrix[i, j] ** 2 if i != j else 0.0
        if beside <= _ROUNDING * size:
            return
        for p in range(k):
            for q in range(p + 1, k):
                if matrix[p, q] != 0.0:
                    _rotate(matrix, vectors, p, q)


@njit(cache=True)
def _rotate(matrix: Array, vectors: Array, p: int, q: int) -> None:
    """Make the element (p, q) of a symmetric matrix zero."""
    half = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
    tangent = 1.0 / (half + np.sqrt(half**2 + 1.0)) if half >= 0.0 else 1.0 / (half - np.sqrt(half**2 + 1.0))
    cosine = 1.0 / np.sqrt(tangent**2 + 1.0)
    sine = tangent * cosine
    for i in range(len(matrix)):
        at_p, at_q = matrix[i, p], matrix[i, q]
        matrix[i, p], matrix[i, q] = cosine * at_p - sine * at_q, sine * at_p + cosine * at_q
    for i in range(len(matrix)):
        at_p, at_q = matrix[p, i], matrix[q, i]
        matrix[p, i], matrix[q, i] = cosine * at_p - sine * at_q, sine * at_p + cosine * at_q
        at_p, at_q = vectors[i, p], vectors[i, q]
        vectors[i, p], vectors[i, q] = cosine * at_p - sine * at_q, sine * at_p + cosine * at_q


def warm_up() -> None:
    """Compile, or load from the cache."""
    _directions(np.ones((2, 3)), np.zeros(1, np.int64), np.ones(1, np.int64), 1)


def best_intervals(
    data: FlightData, fits: Mapping[str, AxisFit], variant: Variant, base: Mapping[str, str]
) -> Iterator[dict[str, float]]:
    """Times t0 and t1 [s] of the intervals in which a change explains most over its axes, best first."""
    sums = [_AxisSums(data, fits[axis], texts, base) for axis, texts in variant.terms.items() if axis in fits]
    if not sums:
        return
    low, high = limits(END, data)
    moments = np.unique([*np.linspace(low, high, _MOMENTS), *data.seams])
    first, last = np.triu_indices(len(moments), 1)
    long = moments[last] - moments[first] >= SHORTEST_CHANGE
    first, last = first[long], last[long]
    gains = _over_axes(sums, moments[first], moments[last])
    for _ in range(_STARTS):
        if not np.isfinite(gains).any():
            return
        at = int(np.argmax(gains))
        begin, end = _closer(sums, moments[first[at]], moments[last[at]], (high - low) / (_MOMENTS - 1))
        yield {"t0": begin, "t1": end}
        gains[(np.abs(first - first[at]) < _APART) & (np.abs(last - last[at]) < _APART)] = -np.inf


def _over_axes(sums: Sequence[_AxisSums], begin: Array, end: Array) -> Array:
    return np.asarray(np.sum([each.log_ratios(begin, end) for each in sums], axis=0))


def _closer(sums: Sequence[_AxisSums], begin: float, end: float, width: float) -> tuple[float, float]:
    """Both edges moved to where the interval explains most, within a width [s] of where they are."""
    steps = np.linspace(-1.0, 1.0, 2 * _NEARBY + 1)
    for _ in range(_CLOSER):
        starts = np.repeat(begin + width * steps, len(steps))
        ends = np.tile(end + width * steps, len(steps))
        best = int(np.argmax(np.where(ends - starts >= SHORTEST_CHANGE, _over_axes(sums, starts, ends), -np.inf)))
        begin, end, width = float(starts[best]), float(ends[best]), width / _NEARBY
    return begin, end
