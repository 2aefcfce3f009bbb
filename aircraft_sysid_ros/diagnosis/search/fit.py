"""Least squares of one axis, judged on blocks of time, or on manoeuvres, that the fit did not see.

Model: ``C(k) = x(k)' theta + e(k)``, (4.1) with the estimate (4.6); e is coloured, since windows overlap and the
state that the regressors are made of is filtered. Blocks of FlightData take turns at being held out: block b is
predicted by parameters from the blocks of the other folds (b modulo FOLDS). Points near a border of a block are
neither fitted nor judged, or the colour of e would tell the one side of the other. Of a body of manoeuvres each is
held out in turn, whole.

All is done in an orthonormal basis of the regressors (QR of the scaled columns, then singular values): with
W = [w_1 … w_r], W'W = I, the normal matrix of a training set is I - sum over held-out blocks of W_b'W_b, and one
more column costs its products with the basis and no new factorisation of the rest.

Where physics has fewer numbers than terms, in several axes (a mass is wrong by one factor), ``tied_gains`` fits these:
of each axis the model's own parameters are eliminated, and what is left is added up over the axes.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.lagged_moments import coloured_covariance

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

#: A direction of the scaled regressors that is this small against the largest is not in the data.
SINGULAR = 1e-6
#: Nor is a direction of which the training blocks hold no more than this share: it is predicted without.
UNTRAINED = 1e-6
#: Time [s] over which residuals may be correlated.
LAG_TIME = 2.0
#: Points per parameter below which nothing is fitted.
LEAST_POINTS = 10


@dataclass(frozen=True)
class Fit:
    """Parameters of one axis from all of its points, and the residuals (n,), NaN where there is no point.

    ``covariance`` (k, k) allows for coloured residuals; a parameter that the flight does not determine is NaN,
    with its rows and columns, and its name is in ``not_determined``. ``residual`` is measured minus fitted,
    ``held_out`` measured minus predicted from the other folds. Either NRMSE is over the same points.
    """

    names: tuple[str, ...]
    parameters: Array
    covariance: Array
    residual: Array
    held_out: Array
    nrmse_fit: float
    nrmse_held_out: float
    not_determined: tuple[str, ...]

    @property
    def std(self) -> Array:
        """Standard errors (k,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


@dataclass(frozen=True)
class Gain:
    """What m more columns do to the fit of an axis, over the blocks (B,) of that axis."""

    before: Array  # (B,) held-out sum of squares without the columns
    after: Array  # (B,) and with them
    count: Integers  # (B,) points of each block
    fitted_before: float  # sum of squares of the residuals from all points
    fitted_after: float
    parameters: Array  # (m,) NaN where the columns say nothing that the base does not
    fit: AxisFit  # the base on the points where the columns have values
    nrmse_before: float  # held out
    nrmse_after: float


@dataclass(frozen=True)
class Shape:
    """What k shared numbers do to one axis beyond its model: columns z (N, k) orthogonal to its basis.

    By block (B, …): products of the basis with z, of z with z, and of z with the residual of the model.
    """

    fit: AxisFit  # on the points where the columns have values
    z: Array
    cross: Array
    own: Array
    moment: Array


class AxisFit:
    """The fit of one axis on columns (n, k), and quickly on more columns.

    ``measured`` (n,) stands in for the measured coefficient of the axis. Rows with a value that is not finite are
    left out. Raises InputError, with a sentence that names what is missing, where there is nothing to fit.
    """

    def __init__(
        self,
        flight: FlightData,
        axis: str,
        columns: Array,
        names: Sequence[str] = (),
        measured: Array | None = None,
    ) -> None:
        self.flight, self.axis, self.columns = flight, axis, columns
        self.names = tuple(names) or tuple(f"{axis}_{j}" for j in range(columns.shape[1]))
        self.measured = flight.coefficient(axis) if measured is None else measured
        finite = np.isfinite(columns)
        self.rows: Mask = np.isfinite(self.measured) & finite.all(axis=1) & ~flight.guarded
        self._check(finite)
        self._places = np.flatnonzero(self.rows)
        self.y = self.measured[self._places]
        numbers = flight.block[self._places]
        self._starts = np.flatnonzero(np.diff(numbers, prepend=-1))
        self.blocks: Integers = numbers[self._starts]
        self.count: Integers = np.diff(np.append(self._starts, len(numbers)))
        self._row_fold: Integers = flight.fold[self._places]
        self.fold: Integers = self._row_fold[self._starts]
        self.spread = float(np.std(self.y))
        self._factor()

    def _check(self, finite: Mask) -> None:
        axis, empty = self.axis, ~finite.any(axis=0)
        if not self.columns.shape[1]:
            raise InputError(f"the model has no terms for {axis}: add some")
        if not np.isfinite(self.measured).any():
            raise InputError(f"{axis} is not measured in this flight")
        if empty.any():
            unknown = [self.names[j] for j in np.flatnonzero(empty)]
            raise InputError(f"{axis} cannot be fitted: {self.flight.why_unknown(axis, unknown)}")
        count, folds = int(self.rows.sum()), np.unique(self.flight.fold[self.rows])
        if count < LEAST_POINTS * self.columns.shape[1]:
            raise InputError(f"{axis} cannot be fitted: it has {count} points, too few for {len(self.names)} terms")
        if len(folds) < 2:
            raise InputError(
                f"{axis} cannot be fitted: its terms are measured together in one part of the flight only, and nothing "
                "is left to hold out: measure them in the other manoeuvres too, or replay that one by itself"
            )

    # -- factorisation ---------------------------------------------------------------------------------------

    def _factor(self) -> None:
        """Basis of the columns, and the sums over blocks on which all else rests."""
        x = self.columns[self._places]
        size = np.sqrt(np.sum(x**2, axis=0))
        self.basis, self._transform, self.determined = _orthonormal(x, size)
        self._scaled = size[:, None] * self._transform
        self._projected = self.basis.T @ self.y
        self._residual = self.y - self.basis @ self._projected
        self._square = np.add.reduceat(self._residual**2, self._starts)
        self._fitted = float(np.sum(self._residual**2))
        self._rows_of_basis = self.basis.T.copy()
        self._gram = self._sums(self._rows_of_basis, self._rows_of_basis)
        self._moment = self._sums(self._rows_of_basis, self._residual[None])[:, :, 0]

    def _sums(self, a: Array, b: Array) -> Array:
        """Sums of products of rows (k, N) and (m, N) by block, (B, k, m)."""
        sums = np.add.reduceat(a[:, None] * b, self._starts, axis=2)
        return np.ascontiguousarray(np.moveaxis(sums, 2, 0))

    def _by_fold(self, sums: Array) -> Array:
        out = np.zeros((self.flight.folds, *sums.shape[1:]))
        for fold, of_block in zip(self.fold.tolist(), sums, strict=True):
            out[fold] += of_block
        return out

    # -- judgement -------------------------------------------------------------------------------------------

    def _held_out(
        self, gram: Array, moment: Array, square: Array, full: Array, transform: Array
    ) -> tuple[Array, Array]:
        """Held-out sums of squares (B,), and the parameters (folds, r) that predicted minus those from all points.

        gram (B, r, r), moment (B, r) and square (B,) are sums of products of an orthonormal basis and of the
        residuals from all points, whose moments sum to zero; full (r,) are the parameters from all points, and
        transform (k, r) makes those of the scaled columns of them. Of a direction that the training blocks do not hold
        nothing is predicted: the parameters of the columns have no component along it.
        """
        training = np.eye(gram.shape[1]) - self._by_fold(gram)
        right = -self._by_fold(moment)
        values, vectors = np.linalg.eigh(training)
        inverse = np.where(values > UNTRAINED, 1.0 / np.maximum(values, UNTRAINED), 0.0)
        theta = (vectors @ (inverse[:, :, None] * (np.swapaxes(vectors, 1, 2) @ right[:, :, None])))[:, :, 0]
        for fold in np.flatnonzero((values <= UNTRAINED).any(axis=1)):
            unknown = vectors[fold][:, values[fold] <= UNTRAINED]
            along = transform @ unknown
            theta[fold] -= unknown @ np.linalg.lstsq(along, transform @ (full + theta[fold]), rcond=None)[0]
        t = theta[self.fold]
        error = square - 2.0 * np.einsum("bi,bi->b", t, moment) + np.einsum("bi,bij,bj->b", t, gram, t)
        return np.maximum(error, 0.0), theta

    @cached_property
    def _judged(self) -> tuple[Array, Array]:
        return self._held_out(self._gram, self._moment, self._square, self._projected, self._scaled)

    @property
    def held_out_sse(self) -> Array:
        """Held-out sum of squares (B,) of every block."""
        return self._judged[0]

    @cached_property
    def nrmse_held_out(self) -> float:
        """Rms of the held-out residuals over the standard deviation of the measured coefficient."""
        return self._nrmse(self.held_out_sse)

    @property
    def nrmse_fit(self) -> float:
        """The same of the residuals of the fit to all points."""
        return self._nrmse(self._residual**2)

    def _nrmse(self, squares: Array) -> float:
        return float(np.sqrt(np.sum(squares) / len(self.y)) / self.spread) if self.spread > 0.0 else np.nan

    @property
    def parameters(self) -> Array:
        """Parameters (k,) that fit best, the smallest of them where the data do not determine all."""
        return np.asarray(self._transform @ self._projected)

    # -- results ---------------------------------------------------------------------------------------------

    @cached_property
    def fit(self) -> Fit:
        """The whole result."""
        theta = np.where(self.determined, self.parameters, np.nan)
        held_out = self._residual - np.sum(self.basis * self._judged[1][self._row_fold], axis=1)
        return Fit(
            names=self.names,
            parameters=theta,
            covariance=self._covariance(),
            residual=self._spread_out(self._residual),
            held_out=self._spread_out(held_out),
            nrmse_fit=self.nrmse_fit,
            nrmse_held_out=self.nrmse_held_out,
            not_determined=tuple(n for n, known in zip(self.names, self.determined, strict=True) if not known),
        )

    def _spread_out(self, values: Array) -> Array:
        out = np.full(len(self.rows), np.nan)
        out[self.rows] = values
        return out

    def _covariance(self) -> Array:
        """Covariance (k, k) of the parameters, allowing for the colour of the residuals (Morelli and Klein 1997)."""
        step = self.flight.step
        slot = np.asarray(np.rint(self.flight.time[self.rows] / step), dtype=np.int64)
        slot -= slot[0]
        r = self.basis.shape[1]
        table = np.zeros((slot[-1] + 1, r + 2))  # points that are not used are 0: lags bridge them
        table[slot] = np.column_stack([self.basis, self.y, np.ones(len(slot))])
        lags = max(min(round(LAG_TIME / step), len(table) - 1), 1)
        sums = np.stack([table[lag:].T @ table[: len(table) - lag] for lag in range(lags)])
        coloured, white, _ = coloured_covariance(sums, self._projected)
        values, vectors = np.linalg.eigh(0.5 * (coloured + coloured.T))
        least = 1e-3 * float(np.max(np.diag(white)))  # the lag window alone does not keep it positive
        root = self._transform @ vectors * np.sqrt(np.maximum(values, least))
        covariance = root @ root.T
        covariance[~self.determined, :] = covariance[:, ~self.determined] = np.nan
        return np.asarray(covariance)

    # -- more columns ----------------------------------------------------------------------------------------

    def gain(self, extra: Array) -> Gain:
        """What columns ``extra`` (n, m) add, over points where they have values. Raises InputError as above."""
        z = extra[self._places]
        if not np.isfinite(z).all():
            return self.on(np.all(np.isfinite(extra), axis=1)).gain(extra)
        size = np.sqrt(np.sum(z**2, axis=0))
        shared = self.basis.T @ z
        z = z - self.basis @ shared
        z = z - self.basis @ (self.basis.T @ z)  # twice is enough, Parlett (1980)
        new, transform, determined = _orthonormal(z, size)
        move = new.T @ self._residual
        residual = self._residual - new @ move
        squares = residual**2
        gram, moment = self._bordered(new.T.copy(), residual, move)
        base, more = self._scaled.shape[1], transform.shape[1]
        scaled = np.zeros((len(self._scaled) + len(size), base + more))
        scaled[: len(self._scaled), :base] = self._scaled
        scaled[: len(self._scaled), base:] = -self._scaled @ shared @ transform
        scaled[len(self._scaled) :, base:] = size[:, None] * transform
        full = np.concatenate([self._projected, move])
        after, _ = self._held_out(gram, moment, np.add.reduceat(squares, self._starts), full, scaled)
        return Gain(
            before=self.held_out_sse,
            after=after,
            count=self.count,
            fitted_before=self._fitted,
            fitted_after=float(np.sum(squares)),
            parameters=np.where(determined, transform @ move, np.nan),
            fit=self,
            nrmse_before=self.nrmse_held_out,
            nrmse_after=self._nrmse(after),
        )

    def _bordered(self, new: Array, residual: Array, move: Array) -> tuple[Array, Array]:
        """Gram matrices and moments by block of the basis with more rows ``new`` (m, N)."""
        cross, r = self._sums(self._rows_of_basis, new), len(self._rows_of_basis)
        gram = np.empty((len(cross), r + len(new), r + len(new)))
        gram[:, :r, :r], gram[:, :r, r:], gram[:, r:, :r] = self._gram, cross, np.swapaxes(cross, 1, 2)
        gram[:, r:, r:] = self._sums(new, new)
        of_base = self._moment - np.einsum("bij,j->bi", cross, move)
        of_new = self._sums(new, residual[None])[:, :, 0]
        return gram, np.concatenate([of_base, of_new], axis=1)

    # -- numbers that several axes share -----------------------------------------------------------------------

    def shape(self, extra: Array) -> Shape:
        """What columns ``extra`` (n, k) do to the axis, each with a number of its own. Raises InputError as above."""
        z = extra[self._places]
        if not np.isfinite(z).all():
            return self.on(np.all(np.isfinite(extra), axis=1)).shape(extra)
        for _ in range(2):
            z = z - self.basis @ (self.basis.T @ z)
        rows = z.T.copy()
        moment = self._sums(rows, self._residual[None])[:, :, 0]
        return Shape(self, z, self._sums(self._rows_of_basis, rows), self._sums(rows, rows), moment)

    def information(self, shape: Shape) -> tuple[Array, Array, float]:
        """Normal matrices (folds + 1, k, k) and right sides (folds + 1, k) of the numbers of a shape.

        From the training blocks of each fold and, last, from all points: the model's own parameters are eliminated.
        With them the variance of the residual under the numbers that suit this axis best.
        """
        whole, right = shape.own.sum(axis=0), shape.moment.sum(axis=0)
        cross, own = self._by_fold(shape.cross), self._by_fold(shape.own)
        solved = -_known_part(np.eye(len(self._rows_of_basis)) - self._by_fold(self._gram)) @ cross
        matrices = whole - own + np.swapaxes(cross, 1, 2) @ solved
        rights = right - self._by_fold(shape.moment) + np.einsum("frk,fr->fk", solved, self._by_fold(self._moment))
        best = np.linalg.pinv(whole, rcond=SINGULAR**2, hermitian=True) @ right
        variance = (self._fitted - float(best @ right)) / len(self.y)
        return np.concatenate([matrices, whole[None]]), np.concatenate([rights, right[None]]), variance

    def gain_of(self, shape: Shape, numbers: Array, parameters: Array) -> Gain:
        """What a shape explains with given numbers (folds + 1, k): of each fold, and last of all points.

        ``parameters`` are those of the terms, from all points. The model's own follow from the training blocks.
        """
        known, whole = numbers[self.fold], numbers[-1]
        moment = self._moment - np.einsum("brk,bk->br", shape.cross, known)
        square = self._square - 2.0 * np.einsum("bk,bk->b", known, shape.moment)
        square = square + np.einsum("bk,bkl,bl->b", known, shape.own, known)
        after, _ = self._held_out(self._gram, moment, square, self._projected, self._scaled)
        return Gain(
            before=self.held_out_sse,
            after=after,
            count=self.count,
            fitted_before=self._fitted,
            fitted_after=float(np.sum((self._residual - shape.z @ whole) ** 2)),
            parameters=parameters,
            fit=self,
            nrmse_before=self.nrmse_held_out,
            nrmse_after=self._nrmse(after),
        )

    def on(self, keep: Mask) -> AxisFit:
        """The same fit on the points of a mask (n,) only. Raises InputError where none are left."""
        measured = np.where(keep, self.measured, np.nan)
        if not np.isfinite(measured).any():
            raise InputError(f"{self.axis} cannot be fitted: a new term has no value where {self.axis} is measured")
        return AxisFit(self.flight, self.axis, self.columns, self.names, measured)

    def extended(self, extra: Array, names: Sequence[str]) -> AxisFit:
        """The fit with columns ``extra`` (n, m) as well."""
        columns = np.column_stack([self.columns, extra])
        return AxisFit(self.flight, self.axis, columns, (*self.names, *names), self.measured)


def tied_gains(fits: Mapping[str, AxisFit], columns: Mapping[str, Array], ties: Mapping[str, Array]) -> dict[str, Gain]:
    """What terms add whose parameters are fewer numbers: of an axis ``ties[axis]`` (m, k) times the k numbers.

    columns: terms (n, m) by axis. Each axis weighs with the variance of its residual; the k numbers, held out as all
    else, span the axes. Axes without points are left out.
    """
    shapes: dict[str, Shape] = {}
    for axis, terms in columns.items():
        with contextlib.suppress(InputError):
            shapes[axis] = fits[axis].shape(terms @ ties[axis])
    if not shapes:
        return {}
    known = [shape.fit.information(shape) for shape in shapes.values()]
    matrix = np.sum([of / max(variance, 1e-300) for of, _, variance in known], axis=0)
    right = np.sum([of / max(variance, 1e-300) for _, of, variance in known], axis=0)
    scale = np.sqrt(np.diagonal(matrix[-1]))
    scale = np.where(scale > 0.0, scale, 1.0)
    numbers = (_known_part(matrix / (scale[:, None] * scale)) @ (right / scale)[:, :, None])[:, :, 0] / scale
    return {axis: shape.fit.gain_of(shape, numbers, ties[axis] @ numbers[-1]) for axis, shape in shapes.items()}


def _known_part(matrices: Array) -> Array:
    """Inverses of normal matrices (n, k, k) whose whole is 1, without the directions that are not trained."""
    values, vectors = np.linalg.eigh(matrices)
    inverse = np.where(values > UNTRAINED, 1.0 / np.maximum(values, UNTRAINED), 0.0)
    return (vectors * inverse[:, None, :]) @ np.swapaxes(vectors, 1, 2)


def _orthonormal(z: Array, size: Array) -> tuple[Array, Array, Mask]:
    """Orthonormal basis W (N, r) of columns z (N, m) of a size (m,), T (m, r) with parameters T (W'y), and which of
    the parameters are determined.
    """
    scale = np.where(size > 0.0, size, 1.0)
    q, r = np.linalg.qr(z / scale)
    u, s, vt = np.linalg.svd(r)
    rank = int(np.sum(s > SINGULAR * max(s[0], 1.0)))
    transform = vt[:rank].T / s[:rank] / scale[:, None]
    determined = 1.0 - np.sum(vt[:rank] ** 2, axis=0) < SINGULAR
    return q @ u[:, :rank], transform, determined


def held_out_error(flight: FlightData, axis: str) -> float:
    """The held-out error of the model of a flight in one axis [-], the one that every command and page shows.

    Least squares on the terms of the model, no more and no fewer, on three of the four groups of blocks in turn,
    judged on the fourth (of a body of manoeuvres, on all but one, judged on that one); an NRMSE over all points at
    which the coefficient and the terms have values. Raises InputError where it has no data. docs/compare.md says what
    the flight is.
    """
    return fit_axis(flight, axis).nrmse_held_out


def fit_axis(flight: FlightData, axis: str) -> AxisFit:
    """The fit of one axis on the terms of the flight's own model. Raises InputError where it has no data."""
    model = flight.model
    names = model.parameter_names[model.axis_slice(axis)]
    return AxisFit(flight, axis, flight.columns(model.programs[AXES.index(axis)]), names)


def fits_of(flight: FlightData, axes: Collection[str] = AXES) -> tuple[dict[str, AxisFit], dict[str, str]]:
    """The fit of every one of some axes that has data, and of every other one why there is none."""
    fits, reasons = {}, {}
    for axis in axes:
        try:
            fits[axis] = fit_axis(flight, axis)
        except InputError as error:
            reasons[axis] = str(error)
    return fits, reasons
