"""What an estimator has learnt, as parameters with standard errors and verdicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.signals import CONTROL_WORDS
from aircraft_sysid_ros.identification.estimators.contract import AxisEstimate
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import RlsState, least_squares
from aircraft_sysid_ros.identification.prior import AxisPrior, helped
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Evidence, Trust, disagree, judge
from aircraft_sysid_ros.identification.undescribed.doubt import OfSensors
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

#: What is added to a correlation matrix that may be singular, where digits do not matter.
_NEARLY = 1e-9
#: Axes that gusts move by what they do across the wing and along the fuselage.
_TURNED_BY_GUSTS = ("Cl", "Cn")
#: What moves an axis.
_INPUT_OF_AXIS = dict(zip(AXES, ("elevator", "rudder", "elevator", "aileron", "elevator", "rudder"), strict=True))
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
    state: RlsState,
    now: float,
    missing: str,
    own: AxisEstimate | None = None,
    changed: float = np.nan,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    prior: AxisPrior | None = None,
    sensors: OfSensors | None = None,
) -> tuple[list[ParameterEstimate], Array]:
    """Parameters of one axis at the time ``now`` [s] and their covariance (n, n).

    ``missing`` says what the axis lacks, empty if nothing; ``own`` is what another estimator
    knows of the axis: the parameters are then its, and recursive least squares only says how the terms moved.
    ``changed`` is the time of flight [s] of the newest change of the axis, NaN if it never did; ``bounds`` are those
    of the aircraft file; ``prior`` is what earlier flights say of the axis; ``sensors`` is what those do to the axis
    that nobody described: least squares is freed of it, another estimator knows less by it.
    """
    names = model.parameter_names[model.axis_slice(AXES[axis])]
    n, first = len(names), int(model.offsets[axis])
    known, sums = least_squares(model, axis, state)
    excitation, effect, per_unit, correlation = np.zeros(n), np.full(n, np.inf), np.zeros(n), np.eye(n)
    estimate = _with_sampling(known if own is None else own, float(state.sampling[axis]))
    if sensors is not None:
        estimate = _with_sensors(estimate, sensors, own is not None)
    if known.samples > n:
        excitation, correlation, per_unit = motion_of_terms(sums[0], state.noise_square[first : first + n])
        effect = per_unit * np.sqrt(np.diag(estimate.covariance))
    if estimate.excitation is not None:
        excitation = estimate.excitation
    apart = [False] * n if own is None else _apart(estimate, known, per_unit)
    with_help = helped(estimate.theta, estimate.covariance, prior)
    if with_help is not None:
        estimate = estimate._replace(theta=with_help.theta, covariance=with_help.covariance)
        excitation, effect = excitation * with_help.gain, effect / with_help.gain
    values, stds = estimate.theta.tolist(), np.sqrt(np.diag(estimate.covariance)).tolist()
    effects, ages = effect.tolist(), (now - estimate.last_learnt).tolist()
    anywhere, by_gusts = (-np.inf, np.inf), _by_gusts(AXES[axis], names, excitation)
    estimates = []
    for j, (name, excited) in enumerate(zip(names, excitation.tolist(), strict=True)):
        limits = bounds.get(name, anywhere) if bounds else anywhere
        unexcited = not missing and excited < THRESHOLDS.excitation
        follows = told_apart(AXES[axis], names, correlation, j) if unexcited else ""
        evidence = Evidence(name, values[j], stds[j], excited, effects[j], estimate.samples, missing, limits, follows)
        status, reason = judge(evidence)
        if status == Trust.USE and apart[j]:
            status, reason = Trust.HOLD, f"recursive least squares says {known.theta[j]:.3g}"
        if status == Trust.USE and by_gusts and not name.endswith("_0"):
            status, reason = Trust.HOLD, by_gusts
        if status == Trust.HOLD and np.isfinite(changed):
            reason = f"relearning since a change at {changed:.1f} s: {reason}"
        estimates.append(ParameterEstimate(name, values[j], stds[j], status, reason, ages[j], excited))
    return estimates, estimate.covariance


def _by_gusts(axis: str, names: Sequence[str], excitation: Array) -> str:
    """That no surface has moved an axis yet about which gusts turn an aeroplane by themselves; empty: one has.

    A gust that differs from tip to tip, or along the fuselage, is a rate of rotation that no gyro shows: what answers
    it comes out too small.
    """
    of_surfaces = [j for j, name in enumerate(names) if name.partition("_")[2] in ("da", "dr")]
    if axis not in _TURNED_BY_GUSTS or not of_surfaces or np.any(excitation[of_surfaces] >= THRESHOLDS.excitation):
        return ""
    return f"so far only gusts move {axis}: move the {_INPUT_OF_AXIS[axis]}"


def _apart(estimate: AxisEstimate, known: AxisEstimate, per_unit: Array) -> list[bool]:
    """Which parameters another estimator and least squares do not agree on; ``per_unit`` effect of one unit."""
    std, std_known = np.sqrt(np.diag(estimate.covariance)), np.sqrt(np.diag(known.covariance))
    return disagree(estimate.theta, known.theta, std, std_known, per_unit).tolist()


def _with_sampling(estimate: AxisEstimate, square: float) -> AxisEstimate:
    """The estimate with what sparse samples may have taken of each parameter, ``square`` as in RlsState.sampling."""
    if not square > 0.0:
        return estimate
    return estimate._replace(covariance=estimate.covariance + square * np.diag(estimate.theta**2))


def _with_sensors(estimate: AxisEstimate, sensors: OfSensors, of_another: bool) -> AxisEstimate:
    """The estimate freed of what sensors do to it; that ``of_another`` estimator than least squares is only widened."""
    if of_another:
        return estimate._replace(covariance=estimate.covariance + sensors.covariance + sensors.found)
    covariance = estimate.covariance + sensors.covariance + THRESHOLDS.correction**2 * sensors.found
    return estimate._replace(theta=estimate.theta + sensors.shift, covariance=covariance)


def told_apart(axis: str, names: Sequence[str], correlation: Array, j: int) -> str:
    """Which term of its axis a term follows, in closed loop or by the pilot's habit, and what tells them apart.

    ``correlation`` (n, n) is that of the terms. Empty where it follows none.
    """
    if not np.all(np.isfinite(correlation)):
        return ""
    with np.errstate(all="ignore"):
        inverse = np.linalg.inv(correlation + _NEARLY * np.eye(len(correlation)))
        share = np.nan_to_num(-inverse[j] / inverse[j, j] * correlation[j])  # of its square, of each other term
    share[j] = 0.0
    k = int(np.argmax(share))
    if np.sum(share) < THRESHOLDS.follows:
        return ""
    term, other = (names[i].partition("_")[2] for i in (j, k))
    told = f"; it follows {'the constant' if other == '0' else other}"
    is_alike = other == "0" or term.rstrip("0123456789") == other.rstrip("0123456789")
    if is_alike and term not in CONTROL_WORDS:
        return f"{told}: fly it over a wider range"
    return f"{told}: move the {CONTROL_WORDS.get(term) or CONTROL_WORDS.get(other) or _INPUT_OF_AXIS[axis]} by itself"


def motion_of_terms(sums: Array, noise_square: Array) -> tuple[Array, Array, Array]:
    """How the terms of an axis have moved, by their sums of products (n + 2, n + 2) and the noise of each (n,).

    Rms of each that others of its axis do not explain, over its noise (n,); correlations of all (n, n); what a unit of
    each parameter moves the coefficient by, over the coefficient's spread (n,). A term that was zero throughout, as a
    flap that has not moved, says nothing, and the others are told without it.
    """
    scale, correlation, per_unit = _moments(sums)
    there = scale > 0.0
    if not there.all():
        return (*_motion_of_some(sums, noise_square, there), per_unit)
    noise = np.sqrt(noise_square)
    alone = scale / np.sqrt(_inflation(correlation))
    return np.asarray(alone / np.where(noise > 0.0, noise, THRESHOLDS.constant_noise)), correlation, per_unit


def _motion_of_some(sums: Array, noise_square: Array, there: npt.NDArray[np.bool_]) -> tuple[Array, Array]:
    """Excitation (n,) and correlations (n, n) where those of a mask (n,) alone have moved."""
    excitation, correlation = np.zeros(len(there)), np.eye(len(there))
    if there.any():
        both = np.append(there, [True, True])
        found = motion_of_terms(np.ascontiguousarray(sums[np.ix_(both, both)]), noise_square[there])
        excitation[there], correlation[np.ix_(there, there)] = found[:2]
    return excitation, correlation


@njit(cache=True, error_model="numpy")
def _moments(sums: Array) -> tuple[Array, Array, Array]:
    """Rms of each term (n,), correlations (n, n), and effects (n,) as in ``motion_of_terms``."""
    n = len(sums) - 2
    moments = sums / sums[n + 1, n + 1]
    scale, correlation, effect = np.empty(n), np.empty((n, n)), np.empty(n)
    spread = max(moments[n, n] - moments[n, n + 1] ** 2, 1e-300)
    for i in range(n):
        scale[i], effect[i] = np.sqrt(moments[i, i]), np.sqrt(moments[i, i] / spread)
    for i in range(n):
        for j in range(n):
            correlation[i, j] = moments[i, j] / (scale[i] * scale[j])
    return scale, correlation, effect


def _inflation(correlation: Array) -> Array:
    """Diagonal (n,) of the inverse of a correlation matrix (n, n): 1 for a term alone, huge for collinear ones."""
    try:
        found = np.diag(np.linalg.inv(correlation + _ROUNDING * np.eye(len(correlation))))
    except np.linalg.LinAlgError:
        found = np.zeros(len(correlation))
    if (found > 0.5).all():  # not so where rounding is all that is left of a term
        return np.asarray(found)
    values, vectors = np.linalg.eigh(correlation)
    return np.asarray(vectors**2 @ (1.0 / np.maximum(values, _ROUNDING)))
