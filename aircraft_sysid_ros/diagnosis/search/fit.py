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
from aircraft_sysid_ros.diagnosis.search.block_sums import (
    Base,
    beside,
    held_out,
    information,
    lengths,
    orthonormal,
    products,
    solved,
    training,
    with_columns,
    with_numbers,
)
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.lagged_moments import coloured_covariance
from aircraft_sysid_ros.identification.conditions import TELL_FLOW, listed

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

#: Time [s] over which residuals may be correlated.
LAG_TIME = 2.0
#: Points per parameter below which nothing is fitted.
LEAST_POINTS = 10


class NotFitted(InputError):
    """An axis that nothing can be fitted to, in a sentence, and ``has``: what it has, or lacks, in a few words."""

    def __init__(self, sentence: str, has: str) -> None:
        super().__init__(sentence)
        self.has = has


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

    @property
    def nrmse_before(self) -> float:
        """Held-out error without the columns."""
        return self.fit.nrmse_held_out

    @property
    def nrmse_after(self) -> float:
        """And with them."""
        return self.fit.nrmse(self.after)


@dataclass(frozen=True)
class Shape:
    """What k shared numbers do to one axis beyond its model: columns z (k, N) orthogonal to its basis.

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
        starts = np.flatnonzero(np.diff(numbers, prepend=-1))
        self.blocks: Integers = numbers[starts]
        self._edges: Integers = np.append(starts, len(numbers))
        self.count: Integers = np.diff(self._edges)
        self._row_fold: Integers = flight.fold[self._places]
        self.fold: Integers = self._row_fold[starts]
        self.spread = float(np.std(self.y))
        self._factor()

    def _check(self, finite: Mask) -> None:
        axis, empty = self.axis, ~finite.any(axis=0)
        if not self.columns.shape[1]:
            raise NotFitted(f"the model has no terms for {axis}: add some", "no terms")
        if not np.isfinite(self.measured).any():
            raise NotFitted(f"{axis} is not measured in this flight", "no measurement")
        if empty.any():
            unknown = [self.names[j] for j in np.flatnonzero(empty)]
            why = self.flight.why_unknown(axis, unknown)
            lacking = self.flight.lacks(self.flight.model.signals_of_axes[AXES.index(axis)])
            raise NotFitted(f"{axis} cannot be fitted: {why}", f"no value of {listed(lacking)}" if lacking else why)
        count, folds = int(self.rows.sum()), np.unique(self.flight.fold[self.rows])
        if count < LEAST_POINTS * self.columns.shape[1]:
            few = f"{count} points, too few for {len(self.names)} terms"
            raise NotFitted(f"{axis} cannot be fitted: it has {few}", few)
        if len(folds) < 2:
            where = "measured together in one part of the flight only"
            raise NotFitted(
                f"{axis} cannot be fitted: its terms are {where}, and nothing "
                "is left to hold out: measure them in the other manoeuvres too, or replay that one by itself",
                f"terms that are {where}",
            )

    # -- factorisation ---------------------------------------------------------------------------------------

    def _factor(self) -> None:
        """Basis of the columns, and the sums over blocks on which all else rests."""
        rows = np.take(self.columns.T, self._places, axis=1)
        size = lengths(rows)
        basis, self._transform, self.determined = orthonormal(rows, size)
        self.basis = basis.T
        projected = basis @ self.y
        residual = self.y - projected @ basis
        of_residual = residual[None]
        gram = products(basis, basis, self._edges)
        moment = products(basis, of_residual, self._edges)[:, :, 0].copy()
        square = products(of_residual, of_residual, self._edges)[:, 0, 0].copy()
        self._base = Base(
            basis, size[:, None] * self._transform, projected, residual, gram, moment, square, self._edges,
            self.fold, training(gram, self.fold, self.flight.folds),
        )  # fmt: skip
        self._fitted = float(np.sum(residual**2))

    # -- judgement -------------------------------------------------------------------------------------------

    @cached_property
    def _judged(self) -> tuple[Array, Array]:
        base = self._base
        return held_out(base.gram, base.moment, base.square, base.projected, base.scaled, base.normal, base.fold)

    @property
    def held_out_sse(self) -> Array:
        """Held-out sum of squares (B,) of every block."""
        return self._judged[0]

    @cached_property
    def nrmse_held_out(self) -> float:
        """Rms of the held-out residuals over the standard deviation of the measured coefficient."""
        return self.nrmse(self.held_out_sse)

    @property
    def held_out_rms(self) -> float:
        """Rms of the held-out residuals, in the unit of the coefficient."""
        return float(np.sqrt(np.sum(self.held_out_sse) / len(self.y)))

    @property
    def nrmse_fit(self) -> float:
        """Rms of the residuals of the fit to all points over the standard deviation of the measured coefficient."""
        return self.nrmse(self.residual**2)

    def nrmse(self, squares: Array) -> float:
        """Root of the mean of all squares, in parts (…,), over the standard deviation of the measured coefficient."""
        return float(np.sqrt(np.sum(squares) / len(self.y)) / self.spread) if self.spread > 0.0 else np.nan

    @property
    def residual(self) -> Array:
        """What the fit to all points leaves of each of them (N,)."""
        return self._base.residual

    @property
    def parameters(self) -> Array:
        """Parameters (k,) that fit best, the smallest of them where the data do not determine all."""
        return np.asarray(self._transform @ self._base.projected)

    # -- results ---------------------------------------------------------------------------------------------

    @cached_property
    def fit(self) -> Fit:
        """The whole result."""
        theta = np.where(self.determined, self.parameters, np.nan)
        held_out = self.residual - np.sum(self.basis * self._judged[1][self._row_fold], axis=1)
        return Fit(
            names=self.names,
            parameters=theta,
            covariance=self._covariance(),
            residual=self._spread_out(self.residual),
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
        coloured, white, _ = coloured_covariance(sums, self._base.projected)
        values, vectors = np.linalg.eigh(0.5 * (coloured + coloured.T))
        least = 1e-3 * float(np.max(np.diag(white)))  # the lag window alone does not keep it positive
        root = self._transform @ vectors * np.sqrt(np.maximum(values, least))
        covariance = root @ root.T
        covariance[~self.determined, :] = covariance[:, ~self.determined] = np.nan
        return np.asarray(covariance)

    # -- more columns ----------------------------------------------------------------------------------------

    def gain(self, extra: Array) -> Gain:
        """What columns ``extra`` (n, m) add, over points where they have values. Raises InputError as above."""
        z = np.take(extra.T, self._places, axis=1)
        if not np.isfinite(z.sum()):
            return self.on(np.all(np.isfinite(extra), axis=1)).gain(extra)
        after, fitted, parameters = with_columns(self._base, z)
        return self._gain(after, fitted, parameters)

    def _gain(self, after: Array, fitted: float, parameters: Array) -> Gain:
        return Gain(
            before=self.held_out_sse,
            after=after,
            count=self.count,
            fitted_before=self._fitted,
            fitted_after=fitted,
            parameters=parameters,
            fit=self,
        )

    # -- numbers that several axes share -----------------------------------------------------------------------

    def shape(self, extra: Array) -> Shape:
        """What columns ``extra`` (n, k) do to the axis, each with a number of its own. Raises InputError as above."""
        z = np.take(extra.T, self._places, axis=1)
        if not np.isfinite(z.sum()):
            return self.on(np.all(np.isfinite(extra), axis=1)).shape(extra)
        return Shape(self, *beside(self._base, z))

    def information(self, shape: Shape) -> tuple[Array, Array, float]:
        """Normal matrices (folds + 1, k, k) and right sides (folds + 1, k) of the numbers of a shape.

        From the training blocks of each fold and, last, from all points: the model's own parameters are eliminated.
        With them the variance of the residual under the numbers that suit this axis best.
        """
        matrices, rights, explained = information(self._base, shape.cross, shape.own, shape.moment)
        return matrices, rights, (self._fitted - explained) / len(self.y)

    def gain_of(self, shape: Shape, numbers: Array, parameters: Array) -> Gain:
        """What a shape explains with given numbers (folds + 1, k): of each fold, and last of all points.

        ``parameters`` are those of the terms, from all points. The model's own follow from the training blocks.
        """
        after, fitted = with_numbers(self._base, shape.z, shape.cross, shape.own, shape.moment, numbers)
        return self._gain(after, fitted, parameters)

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
    rights = (right / scale)[:, :, None]
    found = [solved(*each)[0][:, 0] for each in zip(matrix / (scale[:, None] * scale), rights, strict=True)]
    numbers = np.array(found) / scale
    return {axis: shape.fit.gain_of(shape, numbers, ties[axis] @ numbers[-1]) for axis, shape in shapes.items()}


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


def why_none(flight: FlightData) -> str:
    """Of a flight of which no axis can be fitted, why: of the first axis in whole, of the others by what they lack."""
    groups: dict[str, list[str]] = {}
    sentences: list[str] = []
    for axis in AXES:
        try:
            fit_axis(flight, axis)
        except NotFitted as error:
            groups.setdefault(error.has, []).append(axis)
            sentences.append(str(error))
    of_first, *others = groups.items()
    same = f" (the same for {listed(of_first[1][1:])})" if len(of_first[1]) > 1 else ""
    parts = [f"{sentences[0]}{same}", *(f"{listed(axes)} ha{'ve' if axes[1:] else 's'} {has}" for has, axes in others)]
    if untold := flight.untold:
        parts.append(f"for {listed(untold)} {TELL_FLOW}")
    return "; ".join(parts)
