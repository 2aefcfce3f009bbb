"""Least squares by sums over blocks of time, compiled: a search tries thousands of columns on each of many flights.

What the sums are, and what is judged by them, stands in ``fit``. N points lie in B blocks, which take turns in F folds.
Columns of regressors stand here as rows: their points side by side, which is what makes sums fast.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

#: A direction of the scaled regressors that is this small against the largest is not in the data.
SINGULAR = 1e-6
#: Nor is a direction of which the training blocks hold no more than this share: it is predicted without.
UNTRAINED = 1e-6
#: Of a normal matrix without a direction below this share all is trained, and well enough to be factored.
_TRAINED = 1e-4
#: What has kept less than this share of its length is made orthogonal once more.
_HARDLY = 0.1
#: A column of this length beside 1 is rounding.
_NOTHING = 1e-13
#: Points that are worked on before the next ones: they stay in the nearest cache.
_AT_ONCE = 512


class Base(NamedTuple):
    """The fit of one axis, on which more columns are tried."""

    basis: Array  # (r, N) orthonormal
    scaled: Array  # (k, r) parameters of the scaled columns from those of the basis
    projected: Array  # (r,) parameters of the basis from all points
    residual: Array  # (N,) of all points
    gram: Array  # (B, r, r) of the basis
    moment: Array  # (B, r) of the basis with the residual
    square: Array  # (B,) of the residual
    edges: Integers  # (B + 1,) first point of each block, and N
    fold: Integers  # (B,)
    normal: Array  # (F, r, r) of the training blocks


@njit(cache=True, fastmath={"reassoc", "contract", "nsz"})  # several points at a time, added up at the end
def dot(a: Array, b: Array) -> float:
    """Product of two series (n,)."""
    total = 0.0
    for n in range(len(a)):
        total += a[n] * b[n]
    return total


@njit(cache=True)
def products(a: Array, b: Array, edges: Integers) -> Array:
    """Sums of products of (k, N) and (m, N) by block, (B, k, m)."""
    out = np.empty((len(edges) - 1, len(a), len(b)))
    for block in range(len(edges) - 1):
        inside = slice(edges[block], edges[block + 1])
        for i in range(len(a)):
            for j in range(len(b)):
                out[block, i, j] = dot(a[i, inside], b[j, inside])
    return out


@njit(cache=True)
def by_fold(sums: Array, fold: Integers, folds: int) -> Array:
    """Sums over the blocks (B, k, m) of each fold, (F, k, m)."""
    out = np.zeros((folds, sums.shape[1], sums.shape[2]))
    for block in range(len(sums)):
        for i in range(sums.shape[1]):
            for j in range(sums.shape[2]):
                out[fold[block], i, j] += sums[block, i, j]
    return out


@njit(cache=True)
def training(gram: Array, fold: Integers, folds: int) -> Array:
    """Normal matrices (F, r, r) of the training blocks of an orthonormal basis; ``gram`` (B, r, r) are its sums."""
    normal = by_fold(gram, fold, folds)
    for f in range(folds):
        for i in range(normal.shape[1]):
            for j in range(normal.shape[1]):
                normal[f, i, j] = (1.0 if i == j else 0.0) - normal[f, i, j]
    return normal


@njit(cache=True)
def _factored(normal: Array) -> tuple[Array, bool]:
    """Inverse of the Cholesky factor of a normal matrix (r, r), and whether all directions are well trained.

    The smallest eigenvalue is at least one over the trace of the inverse.
    """
    r = len(normal)
    factor, inverse, trace = np.zeros((r, r)), np.zeros((r, r)), 0.0
    for i in range(r):
        for j in range(i + 1):
            rest = normal[i, j]
            for k in range(j):
                rest -= factor[i, k] * factor[j, k]
            if j < i:
                factor[i, j] = rest / factor[j, j]
            elif rest > _TRAINED:
                factor[i, i] = np.sqrt(rest)
            else:
                return inverse, False
        inverse[i, i] = 1.0 / factor[i, i]
        for j in range(i):
            rest = 0.0
            for k in range(j, i):
                rest -= factor[i, k] * inverse[k, j]
            inverse[i, j] = rest * inverse[i, i]
        for j in range(i + 1):
            trace += inverse[i, j] ** 2
    return inverse, trace * _TRAINED < 1.0


@njit(cache=True)
def solved(normal: Array, right: Array) -> tuple[Array, Array]:
    """Solution (r, m) of a normal matrix (r, r) whose whole is 1 for right sides (r, m), and directions (r, c) that are
    not trained, along which the solution is 0.
    """
    (r, m), (inverse, sure) = right.shape, _factored(normal)
    if sure:
        return _times(inverse.T.copy(), _times(inverse, right)), np.empty((r, 0))
    values, vectors = np.linalg.eigh(normal)
    weighted = _times(vectors.T.copy(), right)
    for i in range(r):
        for j in range(m):
            weighted[i, j] = weighted[i, j] / values[i] if values[i] > UNTRAINED else 0.0
    return _times(vectors, weighted), vectors[:, : int(np.sum(values <= UNTRAINED))].copy()  # values ascend


@njit(cache=True)
def _times(a: Array, b: Array) -> Array:
    """Product of small matrices."""
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, k] * b[k, j]
    return out


@njit(cache=True)
def _least(columns: Array, values: Array) -> Array:
    """Parameters (c, 1) with which columns (k, c) come next to values (k, 1), the smallest of them."""
    u, s, vt = np.linalg.svd(columns)
    parameters = np.zeros((columns.shape[1], 1))
    for i in range(len(s)):
        if s[i] > np.finfo(np.float64).eps * max(columns.shape) * s[0]:
            along = 0.0
            for j in range(len(u)):
                along += u[j, i] * values[j, 0] / s[i]
            for j in range(len(parameters)):
                parameters[j, 0] += along * vt[i, j]
    return parameters


@njit(cache=True)
def held_out(
    gram: Array, moment: Array, square: Array, full: Array, transform: Array, normal: Array, fold: Integers
) -> tuple[Array, Array]:
    """Held-out sums of squares (B,), and the parameters (F, r) that predicted minus those from all points.

    gram (B, r, r), moment (B, r) and square (B,) are sums of products of an orthonormal basis and of the residuals from
    all points, whose moments sum to zero; full (r,) are the parameters from all points, and transform (k, r) makes
    those of the scaled columns of them; normal (F, r, r) is that of ``training``. Of a direction that the training
    blocks do not hold nothing is predicted: the parameters of the columns have no component along it.
    """
    folds, r = normal.shape[:2]
    right, theta = np.zeros((folds, r, 1)), np.empty((folds, r))
    for block in range(len(gram)):
        for i in range(r):
            right[fold[block], i, 0] -= moment[block, i]
    for f in range(folds):
        solution, lost = solved(normal[f], right[f])
        theta[f] = solution[:, 0]
        if lost.shape[1]:
            whole = _times(transform, (full + theta[f]).reshape((-1, 1)))
            theta[f] -= _times(lost, _least(_times(transform, lost), whole))[:, 0]
    error = np.empty(len(gram))
    for block in range(len(gram)):
        t, total = theta[fold[block]], square[block]
        for i in range(r):
            row = -2.0 * moment[block, i]
            for j in range(r):
                row += gram[block, i, j] * t[j]
            total += t[i] * row
        error[block] = max(total, 0.0)
    return error, theta


@njit(cache=True)
def projected_on(basis: Array, z: Array) -> Array:
    """Products (r, m) of (r, N) and (m, N)."""
    return products(basis, z, np.array([0, z.shape[1]]))[0]


@njit(cache=True)
def taken_off(z: Array, basis: Array, parts: Array) -> None:
    """Take the basis (r, N) times parts (r, m) off z (m, N), one row after the other."""
    pairs = len(basis) - len(basis) % 2
    for first in range(0, z.shape[1], _AT_ONCE):
        inside = slice(first, min(first + _AT_ONCE, z.shape[1]))
        for j in range(len(z)):
            rest = z[j, inside]
            for i in range(0, pairs, 2):  # two rows while they are at hand
                part, along, other, beside_it = parts[i, j], basis[i, inside], parts[i + 1, j], basis[i + 1, inside]
                for n in range(len(rest)):
                    rest[n] = rest[n] - part * along[n] - other * beside_it[n]
            if pairs < len(basis):
                part, along = parts[pairs, j], basis[pairs, inside]
                for n in range(len(rest)):
                    rest[n] -= part * along[n]


@njit(cache=True)
def lengths(z: Array) -> Array:
    """Square roots (m,) of the sums of squares of z (m, N)."""
    found = np.empty(len(z))
    for j in range(len(z)):
        found[j] = np.sqrt(dot(z[j], z[j]))
    return found


@njit(cache=True)
def freed(z: Array, basis: Array) -> tuple[Array, Array]:
    """z (m, N) made orthogonal to a basis (r, N), and what it had along it (r, m)."""
    z, before, shared = z.copy(), lengths(z), projected_on(basis, z)
    taken_off(z, basis, shared)
    after, hardly = lengths(z), False
    for j in range(len(z)):
        hardly = hardly or after[j] < _HARDLY * before[j]
    if hardly:
        taken_off(z, basis, projected_on(basis, z))  # twice is enough, Parlett (1980)
    return z, shared


@njit(cache=True)
def _triangular(z: Array) -> tuple[Array, Array]:
    """Q (m, N) with orthonormal rows, or rows of 0, and R (m, m) with z = R'Q, by Gram and Schmidt, twice."""
    q, r = z.copy(), np.zeros((len(z), len(z)))
    for j in range(len(q)):
        for _ in range(2):
            along = projected_on(q[:j], q[j : j + 1])
            taken_off(q[j : j + 1], q[:j], along)
            for i in range(j):
                r[i, j] += along[i, 0]
        size = np.sqrt(dot(q[j], q[j]))
        r[j, j] = size if size > _NOTHING else 0.0
        for n in range(q.shape[1]):
            q[j, n] = q[j, n] / size if size > _NOTHING else 0.0
    return q, r


@njit(cache=True)
def orthonormal(z: Array, size: Array) -> tuple[Array, Array, Mask]:
    """Orthonormal basis W (r, N) of z (m, N) of a size (m,), T (m, r) with parameters T (W y), and which of the
    parameters are determined.
    """
    scale, scaled = size.copy(), z.copy()
    for j in range(len(size)):
        scale[j] = size[j] if size[j] > 0.0 else 1.0
        for n in range(z.shape[1]):
            scaled[j, n] /= scale[j]
    q, r = _triangular(scaled)
    u, s, vt = np.linalg.svd(r)
    rank = 0
    while rank < len(s) and s[rank] > SINGULAR * max(s[0], 1.0):
        rank += 1
    transform, determined = np.empty((len(size), rank)), np.ones(len(size), np.bool_)
    for j in range(len(size)):
        known = 0.0
        for i in range(rank):
            transform[j, i] = vt[i, j] / s[i] / scale[j]
            known += vt[i, j] ** 2
        determined[j] = 1.0 - known < SINGULAR
    basis, turned = np.zeros((rank, z.shape[1])), np.empty((len(size), rank))
    for j in range(len(size)):
        for i in range(rank):
            turned[j, i] = -u[j, i]
    taken_off(basis, q, turned)
    return basis, transform, determined


@njit(cache=True)
def _border(base: Base, cross: Array, own: Array, move: Array, of_residual: Array, gram: Array, moment: Array) -> None:
    """Write sums by block of the basis with more rows: of products, and with the residual that they leave."""
    r, more = cross.shape[1], cross.shape[2]
    for b in range(len(cross)):
        for i in range(r):
            moment[b, i] = base.moment[b, i]
            for j in range(r):
                gram[b, i, j] = base.gram[b, i, j]
            for j in range(more):
                gram[b, i, r + j] = gram[b, r + j, i] = cross[b, i, j]
                moment[b, i] -= cross[b, i, j] * move[j, 0]
        for i in range(more):
            moment[b, r + i] = of_residual[b, i, 0]
            for j in range(more):
                gram[b, r + i, r + j] = own[b, i, j]


@njit(cache=True)
def with_columns(base: Base, z: Array) -> tuple[Array, float, Array]:
    """Held-out sums of squares (B,) with more columns z (m, N), that of the fit to all points, and parameters (m,)."""
    m, k, size = len(z), len(base.scaled), lengths(z)
    z, shared = freed(z, base.basis)
    new, transform, determined = orthonormal(z, size)
    r, more = len(base.basis), len(new)
    residual = base.residual.copy().reshape((1, -1))
    move = projected_on(new, residual)
    taken_off(residual, new, move)

    cross, own = products(base.basis, new, base.edges), products(new, new, base.edges)
    of_residual = products(new, residual, base.edges)
    gram, moment = np.empty((len(cross), r + more, r + more)), np.empty((len(cross), r + more))
    _border(base, cross, own, move, of_residual, gram, moment)
    of_shared = _times(base.scaled, _times(shared, transform))
    scaled, parameters, full = np.zeros((k + m, r + more)), np.full(m, np.nan), np.empty(r + more)
    for i in range(k):
        for j in range(r):
            scaled[i, j] = base.scaled[i, j]
        for j in range(more):
            scaled[i, r + j] = -of_shared[i, j]
    found = _times(transform, move)
    for i in range(m):
        parameters[i] = found[i, 0] if determined[i] else np.nan
        for j in range(more):
            scaled[k + i, r + j] = size[i] * transform[i, j]
    for i in range(r):
        full[i] = base.projected[i]
    for i in range(more):
        full[r + i] = move[i, 0]
    squares = products(residual, residual, base.edges)[:, 0, 0].copy()
    normal = training(gram, base.fold, len(base.normal))
    after, _ = held_out(gram, moment, squares, full, scaled, normal, base.fold)
    return after, dot(residual[0], residual[0]), parameters


@njit(cache=True)
def beside(base: Base, z: Array) -> tuple[Array, Array, Array, Array]:
    """Columns z (k, N) made orthogonal to the basis, and their products by block.

    Of the basis with them (B, r, k), of them with themselves (B, k, k), and with the residual (B, k).
    """
    z, _ = freed(z, base.basis)
    moment = products(z, base.residual.copy().reshape((1, -1)), base.edges)[:, :, 0].copy()
    return z, products(base.basis, z, base.edges), products(z, z, base.edges), moment


@njit(cache=True)
def information(base: Base, cross: Array, own: Array, moment: Array) -> tuple[Array, Array, float]:
    """Normal matrices (F + 1, k, k), right sides (F + 1, k) of the numbers of columns, and what they explain at best.

    From the training blocks of each fold and, last, from all points: the parameters of the base are eliminated.
    ``cross``, ``own`` and ``moment`` are those of ``beside``.
    """
    folds, k, r = len(base.normal), own.shape[1], cross.shape[1]
    of_all = np.zeros(len(own), np.int64)
    whole, right = by_fold(own, of_all, 1)[0], by_fold(moment.reshape((-1, k, 1)), of_all, 1)[0]
    of_cross, of_own = by_fold(cross, base.fold, folds), by_fold(own, base.fold, folds)
    of_moment = by_fold(moment.reshape((-1, k, 1)), base.fold, folds)
    of_base = by_fold(base.moment.reshape((-1, r, 1)), base.fold, folds)
    matrices, rights = np.empty((folds + 1, k, k)), np.empty((folds + 1, k))
    for f in range(folds):
        of_fold, _ = solved(base.normal[f], of_cross[f])
        matrix, side = _times(of_cross[f].T.copy(), of_fold), _times(of_fold.T.copy(), of_base[f])
        for i in range(k):
            rights[f, i] = right[i, 0] - of_moment[f, i, 0] - side[i, 0]
            for j in range(k):
                matrices[f, i, j] = whole[i, j] - of_own[f, i, j] - matrix[i, j]
    values, vectors = np.linalg.eigh(whole)
    along, explained, largest = _times(vectors.T.copy(), right), 0.0, max(abs(values[0]), abs(values[-1]))
    for i in range(k):
        rights[folds, i] = right[i, 0]
        for j in range(k):
            matrices[folds, i, j] = whole[i, j]
        if abs(values[i]) > SINGULAR**2 * largest:
            explained += along[i, 0] ** 2 / values[i]
    return matrices, rights, explained


@njit(cache=True)
def with_numbers(base: Base, z: Array, cross: Array, own: Array, moment: Array, numbers: Array) -> tuple[Array, float]:
    """Held-out sums of squares (B,), and that of all points, of columns z (k, N) with given numbers (F + 1, k).

    Those of each fold and, last, of all points. The parameters of the base follow from the training blocks.
    ``cross``, ``own`` and ``moment`` are those of ``beside``.
    """
    changed, squares = base.moment.copy(), base.square.copy()
    for b in range(len(cross)):
        t = numbers[base.fold[b]]
        for j in range(len(t)):
            squares[b] -= 2.0 * t[j] * moment[b, j]
            for i in range(len(t)):
                squares[b] += t[j] * own[b, j, i] * t[i]
            for i in range(changed.shape[1]):
                changed[b, i] -= cross[b, i, j] * t[j]
    after, _ = held_out(base.gram, changed, squares, base.projected, base.scaled, base.normal, base.fold)
    rest = base.residual.copy().reshape((1, -1))
    taken_off(rest, z, np.ascontiguousarray(numbers[-1]).reshape((-1, 1)))
    return after, dot(rest[0], rest[0])
