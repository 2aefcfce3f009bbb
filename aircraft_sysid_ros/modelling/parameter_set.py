"""What the recursion has learnt, as parameters with standard errors and verdicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.estimation.lagged_moments import coloured_covariance, residual_autocovariance
from aircraft_sysid_ros.modelling.consistency import disagree
from aircraft_sysid_ros.modelling.learner import AxisEstimate
from aircraft_sysid_ros.modelling.regression import Learning
from aircraft_sysid_ros.modelling.trust import Evidence, Trust, TrustRules, Verdict, judge

Array = npt.NDArray[np.float64]

#: A constant term is compared with this where others are compared with their noise.
_NOISE_OF_ONE = 0.01
#: After a change the variance of the noise from before it counts as so many evaluations.
_PRIOR_WORTH = 50.0
#: Smallest eigenvalue of a correlation matrix that is more than rounding.
_ROUNDING = 1e-14


@dataclass(frozen=True)
class ParameterEstimate:
    """One parameter as published."""

    name: str
    value: float
    std: float
    status: Trust
    reason: str
    age: float
    excitation: float


@dataclass(frozen=True)
class ParameterSet:
    """All parameters at one time [s after the epoch]."""

    time: float
    model: str
    parameters: tuple[ParameterEstimate, ...]
    covariance: Array  # (n, n), corrected for coloured residuals
    airspeed: tuple[float, float]  # learnt between these
    alpha: tuple[float, float]
    beta: tuple[float, float]


def axis_estimates(
    model: AerodynamicModel,
    axis: int,
    learning: Learning,
    now: float,
    missing: str,
    own: AxisEstimate | None = None,
    changed: float = np.nan,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[list[ParameterEstimate], Array]:
    """Parameters of one axis at the time ``now`` [s] and their covariance (n, n).

    ``missing`` says what the axis lacks, empty if nothing; ``own`` is what another learner
    knows of the axis: the parameters are then its, and recursive least squares only says how the terms moved.
    ``changed`` is the time of flight [s] of the newest change of the axis, NaN if it never did; ``bounds`` are those
    of the aircraft file.
    """
    names = model.parameter_names[model.axis_slice(AXES[axis])]
    n, first = len(names), int(model.offsets[axis])
    known, sums = least_squares(model, axis, learning)
    excitation, effect, per_unit = np.zeros(n), np.full(n, np.inf), np.zeros(n)
    estimate = _with_sampling(known if own is None else own, float(learning.sampling[axis]))
    if known.samples > n:
        moments = sums[0] / sums[0, n + 1, n + 1]
        excitation = _excitation(moments, learning.noise_square[first : first + n])
        per_unit = _effect_of_std(moments, np.ones(n))
        effect = per_unit * np.sqrt(np.diag(estimate.covariance))
    if estimate.excitation is not None:
        excitation = estimate.excitation
    std_known, std_own = np.sqrt(np.diag(known.covariance)), np.sqrt(np.diag(estimate.covariance))
    apart = disagree(estimate.theta, known.theta, std_own, std_known, per_unit)
    estimates = []
    for j, name in enumerate(names):
        value, std = float(estimate.theta[j]), float(np.sqrt(estimate.covariance[j, j]))
        excited = float(excitation[j])
        limits = (bounds or {}).get(name, (-np.inf, np.inf))
        evidence = Evidence(name, value, std, excited, float(effect[j]), estimate.samples, missing, limits)
        verdict = judge(evidence, TrustRules())
        if verdict.status == Trust.USE and apart[j]:
            verdict = Verdict(Trust.HOLD, f"recursive least squares says {known.theta[j]:.3g}")
        reason = verdict.reason
        if verdict.status == Trust.HOLD and np.isfinite(changed):
            reason = f"relearning since a change at {changed:.1f} s: {reason}"
        age = float(now - estimate.last_learnt[j])
        estimates.append(ParameterEstimate(name, value, std, verdict.status, reason, age, excited))
    return estimates, estimate.covariance


def _with_sampling(estimate: AxisEstimate, square: float) -> AxisEstimate:
    """The estimate with what sparse samples may have taken of each parameter, ``square`` as in Learning.sampling."""
    if not square > 0.0:
        return estimate
    return estimate._replace(covariance=estimate.covariance + square * np.diag(estimate.theta**2))


def least_squares(model: AerodynamicModel, axis: int, learning: Learning) -> tuple[AxisEstimate, Array]:
    """What recursive least squares knows of one axis, and its lagged sums (lags, n + 2, n + 2)."""
    part = model.axis_slice(AXES[axis])
    n, samples = part.stop - part.start, int(learning.updates[axis])
    sums = np.ascontiguousarray(learning.sums[axis, :, : n + 2, : n + 2])
    theta, covariance = np.full(n, np.nan), np.full((n, n), np.nan)
    if samples > n or learning.prior[axis].any():
        theta = learning.theta[axis, :n].copy()
        covariance = _covariance(model, axis, learning, theta, sums)
    return AxisEstimate(theta, covariance, samples, learning.last_learnt[part]), sums


def _covariance(model: AerodynamicModel, axis: int, learning: Learning, theta: Array, sums: Array) -> Array:
    """Covariance of the recursion, widened by what coloured residuals do to its diagonal.

    Two systematic parts are added: the pull of noise in the terms towards zero, and the bias of the
    accelerometer as far as it is not known, which stands in the constant term.
    """
    n, first = len(theta), int(model.offsets[axis])
    p, prior = learning.p[axis, :n, :n], learning.prior[axis, :n, :n]
    effective = min(int(learning.updates[axis]), sums[0, n + 1, n + 1])
    if prior.any():
        variance, widening = _with_prior(sums, theta, prior, float(learning.prior_variance[axis]))
    else:
        coloured, white, autocovariance = coloured_covariance(sums, theta)
        variance = autocovariance[0] * effective / max(effective - n, 1.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            widening = np.sqrt(np.maximum(np.diag(coloured) / np.diag(white), 1.0))
    covariance = variance * p * np.outer(widening, widening)
    pull = p @ (effective * learning.noise_square[first : first + n] * theta)
    constant = np.array([program.text == "1" for program in model.programs[axis]], dtype=np.float64)
    of_bias = learning.doubt[axis] * np.outer(constant, constant)
    covariance = covariance + np.outer(pull, pull) + of_bias
    return within_prior(covariance, prior / learning.prior_variance[axis]) if prior.any() else np.asarray(covariance)


def within_prior(covariance: Array, information: Array) -> Array:
    """A covariance (n, n) with standard errors that are at most those of the prior: systematic parts know no bound."""
    root = np.linalg.cholesky(information)
    most = np.sqrt(np.sum(np.linalg.solve(root, np.eye(len(root))) ** 2, axis=0))
    factor = np.minimum(most / np.sqrt(np.diag(covariance)), 1.0)
    return np.asarray(covariance * np.outer(factor, factor))


def _with_prior(sums: Array, theta: Array, prior: Array, variance: float) -> tuple[float, Array]:
    """Variance of the noise, and by what coloured residuals widen the standard errors (n,), see ``relearning``.

    The variance is that from before the change until as many evaluations as it is worth say otherwise.
    """
    n = len(theta)
    autocovariance, weight = residual_autocovariance(sums, theta), float(sums[0, n + 1, n + 1])
    variance = (_PRIOR_WORTH * variance + weight * autocovariance[0]) / (_PRIOR_WORTH + weight)
    taper = 0.5 * (1.0 + np.cos(np.pi * np.arange(len(sums)) / len(sums)))
    taper[0] = 0.5
    middle = np.einsum("l,lij->ij", taper * autocovariance, sums[:, :n, :n])
    both = sums[0, :n, :n] + prior
    scale = 1.0 / np.sqrt(np.diag(both))
    half = np.linalg.solve(np.linalg.cholesky(scale[:, None] * both * scale), np.diag(scale))
    white = half.T @ half
    coloured = white @ (middle + middle.T + variance * prior) @ white
    return variance, np.sqrt(np.maximum(np.diag(coloured) / (variance * np.diag(white)), 1.0))


def _excitation(moments: Array, noise_square: Array) -> Array:
    """Rms of each term that the other terms of its axis do not explain, over its noise, shape (n,)."""
    n = len(noise_square)
    scale = np.sqrt(np.diag(moments)[:n])
    if not np.all(scale > 0.0):
        return np.zeros(n)
    alone = scale / np.sqrt(_inflation(moments[:n, :n] / np.outer(scale, scale)))
    noise = np.sqrt(noise_square)
    return np.asarray(alone / np.where(noise > 0.0, noise, _NOISE_OF_ONE))


def _inflation(correlation: Array) -> Array:
    """Diagonal (n,) of the inverse of a correlation matrix (n, n): 1 for a term alone, huge for collinear ones."""
    with np.errstate(all="ignore"):
        try:
            found = np.diag(np.linalg.inv(correlation + _ROUNDING * np.eye(len(correlation))))
        except np.linalg.LinAlgError:
            found = np.zeros(len(correlation))
    if np.all(found > 0.5):  # not so where rounding is all that is left of a term
        return np.asarray(found)
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(vectors**2 @ (1.0 / np.maximum(values, _ROUNDING)))


def _effect_of_std(moments: Array, std: Array) -> Array:
    """What one standard error of each parameter moves the coefficient by, over the coefficient's spread."""
    n = len(std)
    spread = moments[n, n] - moments[n, n + 1] ** 2
    return np.asarray(std * np.sqrt(np.diag(moments)[:n] / max(spread, 1e-300)))
