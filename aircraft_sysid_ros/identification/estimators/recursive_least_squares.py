"""Recursive least squares per axis, (6.8)-(6.13) by (4.12)-(4.14): the estimator ``rls``.

Of each coefficient sample y = x' theta + e an axis learns where its terms move by more than their noise, with
directional forgetting. Lagged sums beside it correct the standard errors for coloured residuals.

The recursion predicts best with theta as least squares has it; what is published is freed of the pull of the noise of
the vanes (``vane_noise``).

It always runs, also where another estimator is published: it knows an axis first, explains no error by noise, and
therefore says when the aeroplane has changed, how much each term was excited, and what an axis starts over with.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.estimation.lagged_moments import add_sample, coloured_covariance, residual_autocovariance
from aircraft_sysid_ros.estimation.recursive_least_squares import rls_update
from aircraft_sysid_ros.identification.coefficients.layout import (
    FORCE_BIAS_VARIANCE,
    LEARNT,
    MEASURED,
    PREDICTED,
    TERMS_OF_SAMPLE,
    VALID,
    WEIGHT_COLUMNS,
    WHITE_VARIANCE,
    CoefficientBatch,
    CoefficientSample,
)
from aircraft_sysid_ros.identification.coefficients.pace import Pace
from aircraft_sysid_ros.identification.estimators.contract import (
    AxisEstimate,
    AxisReset,
    KnownParameters,
    nothing_known,
)
from aircraft_sysid_ros.identification.estimators.reset_prior import FORGOTTEN, within_prior
from aircraft_sysid_ros.identification.estimators.vane_noise import correction, follow_vane_noise, freed, widened
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.samples import Samples

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Variance of the parameters before any data, over that of the coefficient noise.
PRIOR_VARIANCE = 1e8
#: Forgetting stops where a parameter makes the prediction this uncertain, over the noise variance.
LARGEST_PREDICTION_VARIANCE = 10.0
#: Nor does a variance grow any more from here on.
_LARGEST_VARIANCE = PRIOR_VARIANCE**2
#: Time constant [s] of the running mean that tells motion from rest.
_MOTION_TIME = 2.0
#: After a change the variance of the noise from before it counts as so many evaluations.
_PRIOR_WORTH = 50.0
#: What is added to a matrix of correlations that may be singular, as where a surface stands and its prior is forgotten.
_NEARLY = 1e-12

_TIME = CoefficientSample.TIME
_NOTHING = nothing_known(0)
_FORCES = 3  # axes whose measured coefficient holds the accelerometer bias
_BY_AXIS = ("theta", "p", "sums", "updates", "bias_variance", "prior", "prior_variance", "sampling", "vane_covariance")
_BY_PARAMETER = ("noise_square", "last_learnt")


class RlsState(NamedTuple):
    """Recursive estimates of all axes; rows padded to the longest axis."""

    offsets: Integers  # (7,)
    theta: Array  # (6, n)
    p: Array  # (6, n, n)
    sums: Array  # (6, lags, n + 2, n + 2) of lagged_moments
    recent: Array  # (6, lags, n + 2)
    term_mean: Array  # (parameters,) running mean and square of each term: is it moving now?
    term_square: Array
    noise_square: Array  # (parameters,) running mean of the noise variance of each term, while learning
    updates: Integers  # (6,)
    last_learnt: Array  # (parameters,) time [s]
    last_valid: Array  # (6,) time [s] of the newest sample in the lagged sums
    bias_variance: Array  # (6,) newest variance of the measured coefficient from the accelerometer bias
    prior: Array  # (6, n, n) information of what was known before the axis changed, over the noise; 0: it never did
    prior_variance: Array  # (6,) of the noise before the change
    sampling: Array  # (6,) running mean square of the share of a parameter that sparse samples may take, while learning
    vane_covariance: Array  # (6, n, n) running mean of that of the terms from the noise of the vanes, while learning


class RlsTuning(NamedTuple):
    """Options of the loop."""

    step: float  # [s] between evaluations
    forgetting: float  # per evaluation
    motion_weight: float  # of the running mean that tells motion from rest
    excitation: float  # how many sigma of noise a term must move before the axis learns
    sampling: float  # share of a parameter that sparse samples may take


def new_rls_state(model: AerodynamicModel, lags: int) -> RlsState:
    """Nothing learnt yet of a model; ``lags`` of the sums, in evaluations."""
    counts = np.diff(model.offsets)
    n, total = int(counts.max()), int(counts.sum())
    return RlsState(
        offsets=model.offsets,
        theta=np.zeros((6, n)),
        p=np.tile(PRIOR_VARIANCE * np.eye(n), (6, 1, 1)),
        sums=np.zeros((6, lags, n + 2, n + 2)),
        recent=np.full((6, lags, n + 2), np.nan),
        term_mean=np.full(total, np.nan),
        term_square=np.zeros(total),
        noise_square=np.zeros(total),
        updates=np.zeros(6, np.int64),
        last_learnt=np.full(total, np.nan),
        last_valid=np.full(6, -np.inf),
        bias_variance=np.zeros(6),
        prior=np.zeros((6, n, n)),
        prior_variance=np.zeros(6),
        sampling=np.zeros(6),
        vane_covariance=np.zeros((6, n, n)),
    )


def tuning_of(options: ParameterOptions, pace: Pace) -> RlsTuning:
    """Options as the loop needs them."""
    return RlsTuning(
        step=options.step,
        forgetting=float(np.exp(-options.step / options.forgetting_time)),
        motion_weight=float(1.0 - np.exp(-options.step / _MOTION_TIME)),
        excitation=options.excitation,
        sampling=pace.sampling_error,
    )


class RecursiveLeastSquares:
    """Estimator of all axes, see the module and ``Estimator``."""

    joint = False

    def __init__(self, aircraft: Aircraft, options: ParameterOptions) -> None:
        self.model, self._options = aircraft.model, options
        self.keep_pace(Pace())
        self._lags = max(round(options.lag_time / options.step), 1)
        self.reset()

    def new_state(self, model: AerodynamicModel) -> RlsState:
        """Nothing learnt yet of a model."""
        return new_rls_state(model, self._lags)

    def adopt(self, model: AerodynamicModel, state: RlsState) -> None:
        """Go on with another model and what is known of it."""
        self.model, self.state = model, state

    def change_options(self, options: ParameterOptions) -> None:
        """Learn on with other options."""
        self._options = options
        self.keep_pace(self._pace)

    def keep_pace(self, pace: Pace) -> None:
        """States come at another rate from now on."""
        self._pace, self.tuning = pace, tuning_of(self._options, pace)

    # -- Estimator --------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Forget all that was learnt."""
        self.state = self.new_state(self.model)

    def restart_clock(self) -> None:
        """The clock started over: what was learnt stays."""
        self.state.last_valid[:] = -np.inf

    def move_times(self, by: float) -> None:
        """The clock that has started over shows ``by`` [s] more: what was learnt is as old as it was."""
        self.state.last_learnt[:] += by

    def push_samples(self, samples: Samples, epoch: int) -> None:
        """Raw samples are not needed."""

    def step(self, batch: CoefficientBatch) -> KnownParameters:
        """Predict each sample with what was known before it, learn from it, and mark what was learnt from.

        The predictions stand in the samples: nothing more is to be made of them.
        """
        learn(batch.samples, batch.noise, batch.vane_noise, batch.weights, self.state, self.tuning)
        return _NOTHING

    def estimate(self, axis: int) -> AxisEstimate:
        """Parameters of one axis now, with standard errors corrected for coloured residuals."""
        return least_squares(self.model, axis, self.state)[0]

    def known(self) -> Array:
        """All parameters (parameters,), 0 where nothing is known."""
        return np.concatenate([self.state.theta[i, : len(self.model.terms[name])] for i, name in enumerate(AXES)])

    def reset_axis(self, *resets: AxisReset) -> None:
        """Make what was known of axes a prior, and learn again from the samples since, see ``covariance_reset``."""
        state = self.state
        for reset in resets:
            axis, n = reset.axis, len(reset.theta)
            if reset.is_beside:
                state.p[axis, :n, :n] += reset.covariance
                continue
            state.prior[axis, :n, :n], state.prior_variance[axis] = reset.information, reset.variance
            state.theta[axis, :n], state.p[axis, :n, :n] = reset.theta, reset.covariance
            state.sums[axis], state.recent[axis], state.updates[axis] = 0.0, np.nan, 0
            state.last_valid[axis] = -np.inf
            learn_again(axis, reset.samples, reset.weights, state, self.tuning)

    def needs_reseed(self, axis: int) -> bool:
        """It learns at once."""
        return False

    def reseed(self, axis: int, known: AxisEstimate) -> None:
        """Never asked for."""

    def checkpoint(self) -> RlsState:
        """All that was learnt: a copy that nobody changes."""
        return self.state._replace(**{name: array.copy() for name, array in self.state._asdict().items()})

    def restore(self, checkpoint: RlsState, *axes: int) -> None:
        """Make of axes what they were. What followed in time is no neighbour of what comes."""
        for axis in axes:
            restore_axis(self.state, checkpoint, axis)

    def warm_up(self) -> None:
        """Compile, or load from the cache, what two seconds of level flight do not reach."""
        state = self.checkpoint()
        state.updates[:], state.prior_variance[:] = len(state.theta[0]) + 1, 1.0
        least_squares(self.model, 0, state)
        state.prior[:] = np.eye(len(state.theta[0]))
        least_squares(self.model, 0, state)
        columns = TERMS_OF_SAMPLE + int(self.model.offsets[-1])
        learn_again(0, np.empty((0, columns)), np.empty((0, WEIGHT_COLUMNS)), state, self.tuning)


def restore_axis(state: RlsState, checkpoint: RlsState, axis: int) -> None:
    """Make of an axis what it was at a checkpoint."""
    for name in _BY_AXIS:
        getattr(state, name)[axis] = getattr(checkpoint, name)[axis]
    part = slice(int(state.offsets[axis]), int(state.offsets[axis + 1]))
    for name in _BY_PARAMETER:
        getattr(state, name)[part] = getattr(checkpoint, name)[part]
    state.recent[axis], state.last_valid[axis] = np.nan, -np.inf


# -- the loop -------------------------------------------------------------------------------------------------------


@njit(cache=True)
def _moving_terms(state: RlsState, first: int, last: int, noise: Array, tuning: RlsTuning) -> tuple[int, int]:
    """How many terms of the axis have noise, and how many of those move by more than it just now."""
    noisy, moving = 0, 0
    for j in range(first, last):
        if noise[j] > 0.0:
            noisy += 1
            variance = state.term_square[j] - state.term_mean[j] ** 2
            if variance > (tuning.excitation * noise[j]) ** 2:
                moving += 1
    return noisy, moving


@njit(cache=True)
def _is_well_known(axis: int, first: int, last: int, state: RlsState) -> bool:
    """Every variance is so small that it may grow: the prediction is far better than one sample.

    That of a term which has been zero throughout knows no other end.
    """
    for j in range(last - first):
        if state.p[axis, j, j] > _LARGEST_VARIANCE:
            return False
        if state.p[axis, j, j] * state.term_square[first + j] > LARGEST_PREDICTION_VARIANCE:
            return False
    return True


@njit(cache=True)
def _learn_axis(
    axis: int,
    sample: Array,
    terms: Array,
    noise: Array,
    vane_noise: Array,
    bias_variance: float,
    white_variance: float,
    state: RlsState,
    tuning: RlsTuning,
) -> None:
    """Predict, and update the parameters of one axis if it moves; fills the axis' columns of the sample.

    ``bias_variance`` is that of the measured coefficient from a bias that is not known yet, ``white_variance`` that of
    its white noise: the weight (4.5) of the sample is the latter over the sum.
    """
    first, last = state.offsets[axis], state.offsets[axis + 1]
    n = last - first
    x, y = terms[first:last], sample[MEASURED + axis]
    valid = np.isfinite(y) and n > 0
    for j in range(n):
        valid = valid and np.isfinite(x[j])
    if not valid:
        return
    sample[VALID + axis] = 1.0
    prediction = 0.0
    for j in range(n):
        prediction += x[j] * state.theta[axis, j]
    sample[PREDICTED + axis] = prediction
    noisy, moving = _moving_terms(state, first, last, noise, tuning)
    if noisy > 0 and moving == 0:
        return  # nothing but noise: hold
    sample[LEARNT + axis] = 1.0
    root_weight = np.sqrt(white_variance / (white_variance + bias_variance))
    x, y = root_weight * x, root_weight * y
    p, forgetting = state.p[axis, :n, :n], tuning.forgetting
    if moving == noisy and _is_well_known(axis, first, last, state):
        p /= forgetting  # all is in motion: forget in every direction
        forgetting = 1.0
    rls_update(state.theta[axis, :n], p, x, y, forgetting)
    state.bias_variance[axis] = bias_variance
    accumulate(axis, sample[_TIME], x, y, root_weight, noise, state, tuning)
    share = root_weight**2 / state.sums[axis, 0, n + 1, n + 1]
    follow_vane_noise(vane_noise[:, first:last], share, state.vane_covariance[axis])


@njit(cache=True)
def accumulate(
    axis: int,
    time: float,
    x: Array,
    y: float,
    root_weight: float,
    noise: Array,
    state: RlsState,
    tuning: RlsTuning,
) -> None:
    """Add a weighted sample that was learnt from to the lagged sums and to the noise of its terms."""
    first, last = state.offsets[axis], state.offsets[axis + 1]
    n = last - first
    recent = state.recent[axis]
    if time - state.last_valid[axis] > 1.5 * tuning.step:
        recent[:] = np.nan
    row = np.empty(n + 2)
    row[:n], row[n], row[n + 1] = x, y, root_weight
    sums = state.sums[axis, :, : n + 2, : n + 2]
    add_sample(sums, recent[:, : n + 2], row, tuning.forgetting)
    state.sampling[axis] += root_weight**2 / sums[0, n + 1, n + 1] * (tuning.sampling**2 - state.sampling[axis])
    state.prior[axis] *= tuning.forgetting
    state.last_valid[axis] = time
    state.updates[axis] += 1
    for j in range(first, last):
        share = root_weight**2 / sums[0, n + 1, n + 1]
        state.noise_square[j] += share * (noise[j] ** 2 - state.noise_square[j])
        variance = state.term_square[j] - state.term_mean[j] ** 2
        if noise[j] == 0.0 or variance > (tuning.excitation * noise[j]) ** 2:
            state.last_learnt[j] = time


@njit(cache=True)
def _follow_motion(terms: Array, state: RlsState, tuning: RlsTuning) -> None:
    """Running mean and square of every term."""
    for j in range(len(terms)):
        if np.isfinite(terms[j]):
            if np.isnan(state.term_mean[j]):
                state.term_mean[j], state.term_square[j] = terms[j], terms[j] ** 2
            state.term_mean[j] += tuning.motion_weight * (terms[j] - state.term_mean[j])
            state.term_square[j] += tuning.motion_weight * (terms[j] ** 2 - state.term_square[j])


@njit(cache=True)
def learn(samples: Array, noise: Array, vane_noise: Array, weights: Array, state: RlsState, tuning: RlsTuning) -> None:
    """Predict and learn from samples (m, …) in order of time; fills PREDICTED, VALID and LEARNT of them.

    ``noise`` (m, terms) one sigma of each term, ``vane_noise`` (m, 2, terms) what one sigma of each vane moves it by,
    ``weights`` (m, WEIGHT_COLUMNS).
    """
    for i in range(len(samples)):
        terms = samples[i, TERMS_OF_SAMPLE:]
        _follow_motion(terms, state, tuning)
        for axis in range(6):
            bias_variance = weights[i, FORCE_BIAS_VARIANCE + axis] if axis < _FORCES else 0.0
            white_variance = weights[i, WHITE_VARIANCE]
            _learn_axis(axis, samples[i], terms, noise[i], vane_noise[i], bias_variance, white_variance, state, tuning)


@njit(cache=True)
def learn_again(axis: int, samples: Array, weights: Array, state: RlsState, tuning: RlsTuning) -> None:
    """Learn from remembered samples (m, …) as ``learn`` did, on theta and p as they are now."""
    first, last = state.offsets[axis], state.offsets[axis + 1]
    n, noise = last - first, np.sqrt(state.noise_square)
    for i in range(len(samples)):
        sample = samples[i]
        if sample[LEARNT + axis] > 0.0:
            white_variance = weights[i, WHITE_VARIANCE]
            root_weight = np.sqrt(white_variance / (white_variance + state.bias_variance[axis]))
            x = root_weight * sample[TERMS_OF_SAMPLE + first : TERMS_OF_SAMPLE + last]
            y = root_weight * sample[MEASURED + axis]
            rls_update(state.theta[axis, :n], state.p[axis, :n, :n], x, y, 1.0)
            accumulate(axis, sample[_TIME], x, y, root_weight, noise, state, tuning)


# -- what was learnt ------------------------------------------------------------------------------------------------


def least_squares(model: AerodynamicModel, axis: int, state: RlsState) -> tuple[AxisEstimate, Array]:
    """What recursive least squares knows of one axis, and its lagged sums (lags, n + 2, n + 2)."""
    part, theta = model.axis_slice(AXES[axis]), known_theta(model, axis, state)
    n, samples = len(theta), int(state.updates[axis])
    sums, last_learnt = state.sums[axis, :, : n + 2, : n + 2], state.last_learnt[part]
    if not _is_known(axis, n, state):
        return AxisEstimate(theta, np.full((n, n), np.nan), samples, last_learnt), sums
    if _has_prior(axis, state):
        return AxisEstimate(*_with_prior(axis, theta, state, model.constants[axis]), samples, last_learnt), sums
    return AxisEstimate(*_without_prior(axis, theta, state, model.constants[axis]), samples, last_learnt), sums


@njit(cache=True, error_model="numpy")
def _without_prior(axis: int, theta: Array, state: RlsState, constant: Array) -> tuple[Array, Array]:
    """Parameters (n,) freed of the pull of the vanes, and their covariance (n, n), of an axis that has not changed."""
    n = len(theta)
    p, sums = state.p[axis, :n, :n], state.sums[axis, :, : n + 2, : n + 2]
    matrix, effective, pull = _pull(axis, theta, state)
    coloured, white, autocovariance = coloured_covariance(sums, theta)
    variance, widening = autocovariance[0] * effective / max(effective - n, 1.0), np.empty(n)
    for i in range(n):
        grown = coloured[i, i] / white[i, i]
        widening[i] = np.sqrt(1.0 if grown < 1.0 else grown)
    covariance = _widened(variance, p, widening, pull, state.bias_variance[axis], constant)
    return freed(matrix, theta), widened(matrix, covariance, theta)


def _with_prior(axis: int, theta: Array, state: RlsState, constant: Array) -> tuple[Array, Array]:
    """The same of an axis that has changed, see ``covariance_reset``."""
    n, variance_before = len(theta), float(state.prior_variance[axis])
    p, prior = state.p[axis, :n, :n], state.prior[axis, :n, :n]
    matrix, _, pull = _pull(axis, theta, state)
    sums = np.ascontiguousarray(state.sums[axis, :, : n + 2, : n + 2])
    variance, widening = variance_with_prior(sums, theta, prior, variance_before)
    grown = _widened(variance, p, widening, pull, float(state.bias_variance[axis]), constant)
    covariance = within_prior(grown, prior / variance_before)
    return np.asarray(freed(matrix, theta)), np.asarray(widened(matrix, covariance, theta))


@njit(cache=True)
def _pull(axis: int, theta: Array, state: RlsState) -> tuple[Array, float, Array]:
    """What puts right the pull of the vanes (n, n), the samples that an axis rests on, and the pull that is left (n,).

    Noise in the terms pulls parameters towards zero; that of the vanes is put right as far as it is known.
    """
    n, first = len(theta), state.offsets[axis]
    p, of_vanes = state.p[axis, :n, :n].copy(), state.vane_covariance[axis, :n, :n].copy()
    effective = min(float(state.updates[axis]), state.sums[axis, 0, n + 1, n + 1])
    matrix, share = correction(p, effective, of_vanes)
    pull = np.zeros(n)
    for j in range(n):
        left = max(state.noise_square[first + j] - share * of_vanes[j, j], 0.0)
        for i in range(n):
            pull[i] += p[i, j] * (effective * left * theta[j])
    return matrix, effective, pull


def known_theta(model: AerodynamicModel, axis: int, state: RlsState) -> Array:
    """Parameters of one axis (n,), NaN where there are too few samples."""
    n = int(model.offsets[axis + 1] - model.offsets[axis])
    return state.theta[axis, :n].copy() if _is_known(axis, n, state) else np.full(n, np.nan)


def _is_known(axis: int, n: int, state: RlsState) -> bool:
    return bool(state.updates[axis] > n or _has_prior(axis, state))


def _has_prior(axis: int, state: RlsState) -> bool:
    """Whether an axis has changed, and what was known before it is not forgotten altogether."""
    return bool(np.max(state.prior[axis]) > FORGOTTEN)


@njit(cache=True)
def _widened(variance: float, p: Array, widening: Array, pull: Array, bias_variance: float, constant: Array) -> Array:
    """The covariance (n, n) of the recursion, with standard errors widened by what coloured residuals do to them (n,).

    Two systematic parts are added: the pull (n,) of noise in the terms towards zero, and the bias of the accelerometer
    as far as it is not known, which stands in the constant term.
    """
    covariance = np.empty_like(p)
    for i in range(len(p)):
        for j in range(len(p)):
            of_bias = bias_variance * (constant[i] * constant[j])
            covariance[i, j] = variance * p[i, j] * (widening[i] * widening[j]) + pull[i] * pull[j] + of_bias
    return covariance


def variance_with_prior(sums: Array, theta: Array, prior: Array, variance: float) -> tuple[float, Array]:
    """Variance of the noise, and by what coloured residuals widen the standard errors (n,), see ``covariance_reset``.

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
    half = np.linalg.solve(np.linalg.cholesky(scale[:, None] * both * scale + _NEARLY * np.eye(n)), np.diag(scale))
    white = half.T @ half
    coloured = white @ (middle + middle.T + variance * prior) @ white
    return variance, np.sqrt(np.maximum(np.diag(coloured) / (variance * np.diag(white)), 1.0))
