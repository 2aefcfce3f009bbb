"""Maximum likelihood from innovations and their covariances, (5.3)-(5.13) of docs/references.md.

A filter with the parameters theta (n,) gives at N times innovations e (q,) with covariances Lambda (q, q). With
derivatives by theta this module has

    V = 1/2 sum (e' Lambda^-1 e + ln det Lambda)                                                            (5.7)
    dV/dtheta_i = sum (e' Lambda^-1 e_i + 1/2 tr(Lambda^-1 Lambda_i) - 1/2 e' Lambda^-1 Lambda_i Lambda^-1 e) (5.10)
    F_ij = sum (e_i' Lambda^-1 e_j + 1/2 tr(Lambda^-1 Lambda_i Lambda^-1 Lambda_j))                          (5.11)

(index i: derivative by theta_i). Two misprints: (5.4) has (2 pi)^q with q called the number of parameters, it is
that of outputs; (5.11) has 1/2 eta eta', which is the Fisher information for one output only. For two outputs with
covariances that depend on different parameters it couples what is independent, and is singular where F is not.

Independent outputs, or those that a filter has decorrelated by fusing one after the other, have variances in the
place of covariances: arrays (N, q), and NaN for what is not measured.

``minimise`` iterates (5.8): Gauss-Newton with F as the matrix, Newton-Raphson (5.9) with the Hessian. The covariance
of the estimate is F^-1 where the model is right; ``sandwich_covariance`` also holds where innovations are coloured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: A direction of which the others explain all but this share of the information is not one of its own.
_SINGULAR = 1e-12


def negative_log_likelihood(innovation: Array, covariance: Array, *, constant: bool = False) -> float:
    """V of (5.7) for innovations (N, q) and covariances (N, q, q) or variances (N, q).

    constant: add N q ln(2 pi) / 2, so that it is the whole -ln p of (5.4).
    Raises numpy.linalg.LinAlgError where a covariance is not positive.
    """
    if covariance.ndim == 2:
        there = np.isfinite(innovation)
        e, s = innovation[there], covariance[there]
        if not np.all(s > 0.0):
            raise np.linalg.LinAlgError("a variance of the innovations is not positive")
        value, count = 0.5 * float(np.sum(e * e / s + np.log(s))), len(e)
    else:
        factor = np.linalg.cholesky(covariance)
        white = np.linalg.solve(factor, innovation[..., None])[..., 0]
        logarithms = np.log(np.diagonal(factor, axis1=1, axis2=2))
        value, count = 0.5 * float(np.sum(white * white)) + float(np.sum(logarithms)), innovation.size
    return value + (0.5 * count * float(np.log(2.0 * np.pi)) if constant else 0.0)


def score(innovation: Array, covariance: Array, by_innovation: Array, by_covariance: Array) -> Array:
    """Gradient (5.10) of each time's term of V, shape (N, n); its sum over N is the gradient of V.

    by_innovation (n, N, q) and by_covariance (n, N, q, q), or (n, N, q) for variances: derivatives.
    """
    if covariance.ndim == 2:
        there = np.isfinite(innovation)
        e, s = np.where(there, innovation, 0.0), np.where(there, covariance, 1.0)
        terms = by_innovation * (e / s) + by_covariance * (0.5 / s - 0.5 * e * e / (s * s))
        return np.asarray(np.sum(np.where(there, terms, 0.0), axis=2).T)
    solved = np.linalg.solve(covariance, innovation[..., None])[..., 0]
    ratio = np.linalg.solve(covariance[None], by_covariance)  # Lambda^-1 Lambda_i
    along = np.einsum("inq,nq->ni", by_innovation, solved)
    trace = np.trace(ratio, axis1=2, axis2=3).T
    square = np.einsum("nq,inqr,nr->ni", solved, by_covariance, solved)
    return np.asarray(along + 0.5 * trace - 0.5 * square)


def fisher_information(covariance: Array, by_innovation: Array, by_covariance: Array) -> Array:
    """F (n, n) of (5.11) as it should be, see above; shapes as in ``score``."""
    n = len(by_innovation)
    if covariance.ndim == 2:
        there = np.isfinite(covariance)
        s = covariance[there]
        mean, spread = by_innovation[:, there] / np.sqrt(s), by_covariance[:, there] / s
        return np.asarray(mean @ mean.T + 0.5 * spread @ spread.T)
    solved = np.linalg.solve(covariance[None], by_innovation[..., None])[..., 0]
    ratio = np.linalg.solve(covariance[None], by_covariance)
    mean_part = by_innovation.reshape(n, -1) @ solved.reshape(n, -1).T
    spread_part = ratio.reshape(n, -1) @ ratio.transpose(0, 1, 3, 2).reshape(n, -1).T
    information = mean_part + 0.5 * spread_part
    return np.asarray(0.5 * (information + information.T))


@dataclass(frozen=True)
class Expansion:
    """V about one theta to second order: gradient (n,) and a matrix (n, n), the Hessian or its expectation F."""

    cost: float
    gradient: Array
    matrix: Array


def newton_expansion(
    cost: Callable[[Array], float], gradient: Callable[[Array], Array], theta: Array, steps: Array
) -> Expansion:
    """Expansion of Newton-Raphson (5.9): the Hessian by central differences of the gradient, ``steps`` (n,)."""
    columns = []
    for i, step in enumerate(steps):
        moved = np.zeros(len(theta))
        moved[i] = step
        columns.append((gradient(theta + moved) - gradient(theta - moved)) / (2.0 * step))
    hessian = np.stack(columns, axis=1)
    return Expansion(cost(theta), gradient(theta), 0.5 * (hessian + hessian.T))


@dataclass(frozen=True)
class Minimum:
    """Where an iteration (5.8) ended, and how."""

    theta: Array
    expansion: Expansion  # at theta
    iterations: int
    converged: bool
    reason: str


def minimise(
    cost: Callable[[Array], float],
    expand: Callable[[Array], Expansion],
    start: Array,
    *,
    tolerance: float = 0.01,
    maximum_iterations: int = 30,
    longest_step: float = np.inf,
    progress: Callable[[int, float], None] | None = None,
) -> Minimum:
    """Minimise V from ``start`` (n,) by (5.8) with a line search.

    Converged: the next step, of length sqrt(g' M^-1 g) in standard errors, is shorter than ``tolerance``. No step is
    longer than ``longest_step``, so that a poor start does not leave the domain of the model; a cost there may be
    NaN or raise numpy.linalg.LinAlgError. ``progress`` is told iteration and cost.
    """
    theta, expansion, iterations = start.copy(), expand(start), 0
    while True:
        step = newton_step(expansion.matrix, expansion.gradient)
        decrement = float(np.sqrt(max(float(-expansion.gradient @ step), 0.0)))
        if decrement <= tolerance:
            return Minimum(theta, expansion, iterations, True, "converged")
        if iterations == maximum_iterations:
            return Minimum(theta, expansion, iterations, False, f"not converged in {iterations} iterations")
        step *= min(1.0, longest_step / decrement)
        alpha = _line_search(cost, theta, step, expansion)
        if alpha == 0.0:
            small = decrement <= 0.2  # the cost is no smoother than its differences there
            reason = "converged to the accuracy of the cost" if small else "no smaller cost along the search direction"
            return Minimum(theta, expansion, iterations, small, reason)
        theta = theta + alpha * step
        expansion = expand(theta)
        iterations += 1
        if progress is not None:
            progress(iterations, expansion.cost)


def newton_step(matrix: Array, gradient: Array) -> Array:
    """-M^-1 g, shape (n,), for a symmetric M (n, n); the matrix is scaled and made positive where it is not.

    A parameter without information, a zero on the diagonal, is not moved.
    """
    step = np.zeros(len(gradient))
    scale = np.sqrt(np.abs(np.diag(matrix)))
    known = scale > 0.0
    if not np.any(known):
        return step
    scaled = matrix[np.ix_(known, known)] / np.outer(scale[known], scale[known])
    ridge = _SINGULAR
    while True:
        try:
            factor = np.linalg.cholesky(scaled + ridge * np.eye(len(scaled)))
            break
        except np.linalg.LinAlgError:
            ridge *= 10.0  # ends where the diagonal, all +-1, dominates
    solved = np.linalg.solve(factor.T, np.linalg.solve(factor, gradient[known] / scale[known]))
    step[known] = -solved / scale[known]
    return step


def _line_search(cost: Callable[[Array], float], theta: Array, step: Array, expansion: Expansion) -> float:
    """alpha of (5.8), halved from 1 until the cost falls by a tenth of what the gradient promises; 0: never."""
    promise, alpha = float(expansion.gradient @ step), 1.0
    for _ in range(12):
        try:
            value = cost(theta + alpha * step)
        except np.linalg.LinAlgError:
            value = np.inf
        if np.isfinite(value) and value <= expansion.cost + 0.1 * alpha * promise:
            return alpha
        alpha *= 0.5
    return 0.0


def covariance_of(information: Array) -> Array:
    """F^-1 (n, n), the Cramér-Rao bound; rows and columns without information are NaN.

    Parameters that only a combination of is known have large variances, limited by rounding.
    """
    n = len(information)
    out = np.full((n, n), np.nan)
    scale = np.sqrt(np.maximum(np.diag(information), 0.0))
    known = scale > 0.0
    if np.any(known):
        outer = np.outer(scale[known], scale[known])
        scaled = information[np.ix_(known, known)] / outer + _SINGULAR * np.eye(int(known.sum()))
        values, vectors = np.linalg.eigh(scaled)
        half = vectors / np.sqrt(np.maximum(values, _SINGULAR))
        out[np.ix_(known, known)] = half @ half.T / outer
    return out


def sandwich_covariance(information: Array, scores: Sequence[Array], lags: int) -> Array:
    """F^-1 [sum_l w_l sum_k s(k) s(k - l)'] F^-1, shape (n, n), for scores (N, n) of records without a gap.

    White at F = E[s s'], larger where residuals are coloured. w_l = 1 - |l| / (lags + 1), which keeps it positive
    (Newey and West, Econometrica 55(3), 1987).
    """
    n = len(information)
    middle = np.zeros((n, n))
    for terms in scores:  # with these weights the sum is that of the squares of sums over lags + 1 steps
        total = np.concatenate([np.zeros((lags + 1, n)), np.cumsum(terms, axis=0)])
        total = np.concatenate([total, np.tile(total[-1], (lags, 1))])
        window = total[lags + 1 :] - total[: -lags - 1]
        middle += window.T @ window / (lags + 1.0)
    covariance = covariance_of(information)
    known = np.isfinite(np.diag(covariance))
    part = np.ix_(known, known)
    covariance[part] = covariance[part] @ middle[part] @ covariance[part]
    return covariance
