"""The output-error method: maximum likelihood where the state equations have no noise; numbers: docs/references.md.

    y(k) = h_g(k; theta, eta_g) + v(k),  v ~ N(0, R),  R diagonal and unknown,

over records g, each with unknown numbers of its own, such as its initial state. V of (5.7) is then

    V = 1/2 sum_i N_i (ln R_i + mean square of residual i / R_i),

least for R_i = mean square (closed form), so that the method alternates: R, then a Gauss-Newton step of theta and all
eta with that R. The normal matrix of a step is an arrow: each eta_g is eliminated by its Schur complement, and the
cost grows with the number of records, not with its cube.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.maximum_likelihood import covariance_of, newton_step, sandwich_covariance

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Linearised:
    """One record at one theta and eta: residuals y - h (N, q), NaN where missing, and derivatives of h."""

    residual: Array
    by_theta: Array  # (n, N, q)
    by_nuisance: Array  # (m, N, q)


class Model(Protocol):
    """What the method asks of a model; nuisances are (G, m), one row per record."""

    def residuals(self, theta: Array, nuisances: Array) -> list[Array]:
        """Residuals (N_g, q) of all records."""

    def linearise(self, theta: Array, nuisances: Array) -> list[Linearised]:
        """Residuals and derivatives of all records."""


@dataclass(frozen=True)
class Fit:
    """Result of the method."""

    theta: Array
    nuisances: Array
    variance: Array  # (q,) of the residuals, R
    variance_std: Array  # (q,)
    covariance: Array  # (n, n) F^-1 of theta with eta eliminated
    coloured_covariance: Array  # (n, n) the sandwich, see maximum_likelihood
    residuals: list[Array]
    cost: float
    iterations: int
    converged: bool
    reason: str


@dataclass(frozen=True)
class _Reduced:
    """Normal equations of theta after the elimination, and what gives the eta back."""

    information: Array
    gradient: Array
    coupling: list[Array]  # C_g^-1 B_g', (m, n)
    offset: list[Array]  # - C_g^-1 b_g, (m,)
    scores: list[Array]  # (N, n) of theta, with the part that eta explains taken out

    def moves(self, step: Array) -> Array:
        """Steps (G, m) of the eta that belong to a step (n,) of theta."""
        return np.stack([o - c @ step for o, c in zip(self.offset, self.coupling, strict=True)])


def residual_variance(residuals: Sequence[Array], floor: Array) -> Array:
    """R (q,): mean squares over all records, at least ``floor``; NaN for outputs that are never there."""
    total = np.sum([np.nansum(r * r, axis=0) for r in residuals], axis=0)
    count = _counts(residuals)
    return np.where(count > 0, np.maximum(total / np.maximum(count, 1), floor), np.nan)


def concentrated_cost(residuals: Sequence[Array], variance: Array) -> float:
    """V (5.7) for residuals and variances R (q,)."""
    total = np.sum([np.nansum(r * r, axis=0) for r in residuals], axis=0)
    count = _counts(residuals)
    there = count > 0
    v = variance[there]
    return 0.5 * float(np.sum(count[there] * np.log(v) + total[there] / v))


def _counts(residuals: Sequence[Array]) -> Array:
    counts = np.stack([np.sum(np.isfinite(r), axis=0) for r in residuals])
    return np.asarray(counts.sum(axis=0), dtype=np.float64)


def estimate(
    model: Model,
    theta: Array,
    nuisances: Array,
    *,
    variance: Array,
    precision: Array,
    floor: Array,
    tolerance: float = 0.01,
    maximum_iterations: int = 30,
    lags: int = 0,
    progress: Callable[[int, float], None] | None = None,
) -> Fit:
    """Estimate theta (n,), nuisances (G, m) and R (q,) from a start.

    variance (q,): the first R. precision (m,): that of the starting nuisances, a weak prior for what a record does
    not tell. floor (q,): least R. lags: of the residuals' correlation. Converged: the next step of theta is shorter
    than ``tolerance`` standard errors and R moves by less than 1 %.
    """
    start, iterations, reason = nuisances, 0, ""
    records = model.linearise(theta, nuisances)
    while True:
        reduced = _reduce(records, variance, precision, (nuisances - start) * precision)
        step = newton_step(reduced.information, reduced.gradient)
        decrement = float(np.sqrt(max(float(-reduced.gradient @ step), 0.0)))
        renewed = residual_variance([record.residual for record in records], floor)
        steady = bool(np.nanmax(np.abs(np.log(renewed / variance)), initial=0.0) < 0.01)
        if (decrement <= tolerance and steady) or reason:
            break
        if iterations == maximum_iterations:
            reason = f"not converged in {iterations} iterations"
            break
        alpha = _line_search(model, theta, nuisances, step, reduced, variance, start, precision, records)
        if alpha > 0.0:
            theta, nuisances = theta + alpha * step, nuisances + alpha * reduced.moves(step)
            records = model.linearise(theta, nuisances)
        elif steady:
            reason = "no smaller cost along the search direction"
        variance = residual_variance([record.residual for record in records], floor)
        iterations += 1
        if progress is not None:
            progress(iterations, concentrated_cost([record.residual for record in records], variance))
    # the cost is no smoother than the differences that stand for its derivatives
    converged = decrement <= (0.2 if reason.startswith("no smaller") else tolerance)
    residuals = [record.residual for record in records]
    return Fit(
        theta, nuisances, variance, variance * np.sqrt(2.0 / np.maximum(_counts(residuals), 1.0)),
        covariance_of(reduced.information),
        sandwich_covariance(reduced.information, reduced.scores, lags),
        residuals, concentrated_cost(residuals, variance), iterations, converged,
        "converged" if converged else reason,
    )  # fmt: skip


def _reduce(records: Sequence[Linearised], variance: Array, precision: Array, prior: Array) -> _Reduced:
    """Weighted normal equations of all records, every eta eliminated."""
    n = len(records[0].by_theta)
    information, gradient = np.zeros((n, n)), np.zeros(n)
    coupling, offset, scores = [], [], []
    weight = np.where(np.isfinite(variance), 1.0 / np.sqrt(variance), 0.0)
    for g, record in enumerate(records):
        there = np.isfinite(record.residual)
        white = np.where(there, record.residual * weight, 0.0)
        a = np.where(there, record.by_theta * weight, 0.0)
        b = np.where(there, record.by_nuisance * weight, 0.0)
        flat_a, flat_b, flat = a.reshape(n, -1), b.reshape(len(b), -1), white.ravel()
        own = flat_b @ flat_b.T + np.diag(precision)
        solved = np.linalg.solve(own, np.column_stack([flat_b @ flat_a.T, flat_b @ flat - prior[g]]))
        coupling.append(solved[:, :n])
        offset.append(solved[:, n])
        cross = flat_a @ flat_b.T
        information += flat_a @ flat_a.T - cross @ solved[:, :n]
        gradient -= flat_a @ flat - cross @ solved[:, n]
        effective = a - np.tensordot(solved[:, :n].T, b, axes=1)
        scores.append(-np.einsum("inq,nq->ni", effective, white))
    return _Reduced(0.5 * (information + information.T), gradient, coupling, offset, scores)


def _line_search(
    model: Model,
    theta: Array,
    nuisances: Array,
    step: Array,
    reduced: _Reduced,
    variance: Array,
    start: Array,
    precision: Array,
    records: Sequence[Linearised],
) -> float:
    """alpha of (5.8), halved from 1 until V with this R falls; 0: never."""

    def cost(found: Sequence[Array], at: Array) -> float:
        return concentrated_cost(found, variance) + 0.5 * float(np.sum(precision * (at - start) ** 2))

    residuals, moves, alpha = [record.residual for record in records], reduced.moves(step), 1.0
    before, counts = cost(residuals, nuisances), _counts(residuals)
    for _ in range(10):
        moved = nuisances + alpha * moves
        found = model.residuals(theta + alpha * step, moved)
        if np.array_equal(_counts(found), counts) and cost(found, moved) < before:  # a diverged model has NaN
            return alpha
        alpha *= 0.5
    return 0.0
