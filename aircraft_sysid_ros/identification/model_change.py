"""Another model for a recursive estimator in flight, without losing what it has learnt.

Recursive least squares knows theta_o with covariance P_o of y = x_o' theta_o + e. A term x_n that comes is written as
x_n = G' x_o + z with z orthogonal to x_o over the flight (Frisch and Waugh 1933), so that

    y = x_o' (theta_o + G theta_n) + z' theta_n + e.

What was learnt is therefore phi = theta_o + G theta_n with P_o: it stays as it is. theta_n comes from z alone, with
the prior of the start: S = sum z z' + 1/prior, theta_n = S^-1 sum z y. Back in the terms of the model,

    theta_o = phi - G theta_n,    P = [[P_o + G S^-1 G', -G S^-1], [-S^-1 G', S^-1]],

a congruence, so that P stays positive. Over the same points with the same weights it is what the recursion had found
with the term from the beginning. G, S and the moments come from the newest points (``SampleMemory``), weighted as the
recursion does; without points theta_n starts at zero with the variance of the prior, and G is zero.

A term that goes is set to zero as if measured without error, which is the exact inverse:

    theta_o = theta_o - P_oj P_jj^-1 theta_j,    P = P_oo - P_oj P_jj^-1 P_jo.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.aircraft.postfix import evaluate_programs, evaluate_term_rows
from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT
from aircraft_sysid_ros.aircraft.term_values import link, with_lags
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.lagged_moments import add_sample
from aircraft_sysid_ros.identification.coefficients.evaluation import term_noise, term_shifts
from aircraft_sysid_ros.identification.coefficients.signals import sensor_noise, signal_noise
from aircraft_sysid_ros.identification.estimators.by_name import make_estimator
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import PRIOR_VARIANCE, RlsState
from aircraft_sysid_ros.identification.flight_memory import RememberedSamples
from aircraft_sysid_ros.identification.history import Carry, ParameterCheckpoint
from aircraft_sysid_ros.identification.identifier import Identifier, level_flight
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.parameter_set import ParameterEstimate, ParameterSet
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.state import StateField

Array = npt.NDArray[np.float64]
Terms = Mapping[str, tuple[str, ...]]

#: Points per term below which the past says nothing of a new term.
_LEAST_POINTS = 10
#: A term of which others leave no more than this share is not one of its own.
_SINGULAR = 1e-10
#: Time [s] before now beyond which the motion of a term counts no more.
_MOTION_TIME = 20.0
#: Angle [rad] by which terms are differentiated.
_SMALL_ANGLE = 1e-3
#: Terms that no model has.
_WARMING = ("lag(alpha, 0.1234)", "limited(de, 0.1234)")
_ROW_WIDTH, _AIR_VELOCITY_STD = StateField.WIDTH, StateField.AIR_VELOCITY_STD


@dataclass(frozen=True)
class ModelChange:
    """What a change did."""

    model: str  # id of the version that holds now
    axes: tuple[str, ...]  # whose terms changed
    restarted: bool  # the learner beside recursive least squares starts over


def with_terms(aircraft: Aircraft, added: Terms, removed: Terms) -> Aircraft:
    """The aircraft with terms that come at the end of their axis, and without those that go.

    Raises InputError for a term that is there already, that is not there, or that is the last of its axis.
    """
    terms = {axis: list(texts) for axis, texts in aircraft.model.terms.items()}
    for axis, texts in removed.items():
        for text in texts:
            if text not in terms[axis]:
                raise InputError(f"the model has no term '{text}' in {axis}: it has {' '.join(terms[axis])}")
            terms[axis].remove(text)
        if not terms[axis]:
            raise InputError(f"'{texts[0]}' is the last term of {axis}: add another one first")
    for axis, texts in added.items():
        for text in texts:
            if text in terms[axis]:
                raise InputError(f"the model has the term '{text}' in {axis} already")
            terms[axis].append(text)
    model = {axis: [int(text) if text == "1" else text for text in texts] for axis, texts in terms.items()}
    return aircraft_from_dict({**aircraft.source, "model": model})


def change_model(estimator: Identifier, aircraft: Aircraft, past: RememberedSamples) -> ModelChange:
    """Go on with the model of ``aircraft``, which differs from that of the estimator in its terms only.

    ``past`` are the newest points of the flight (SampleMemory.newest). Axes whose terms stay are not touched, to the
    bit. A learner other than recursive least squares starts over with the new model. Raises InputError, with nothing
    changed, where the new terms cannot be told from those that are there or the learner cannot have the model.
    """
    old, new = estimator.model, aircraft.model
    past = past._replace(signals=with_lags(new.lags, past.time, past.signals, _pause(estimator)))
    changed = tuple(axis for axis in AXES if old.terms[axis] != new.terms[axis])
    published = estimator.learning.estimator
    if changed:
        published = make_estimator(aircraft, estimator.options, estimator.learning.least_squares)
    state = _changed_state(estimator, estimator.learning.least_squares.state, old, new, past)
    restarted = published is not estimator.learning.estimator
    estimator.adopt(aircraft, state, published, _carried(estimator, new))
    estimator.learning.history.forget_predictions([AXES.index(axis) for axis in changed])
    return ModelChange(new.identifier, changed, restarted)


def _pause(estimator: Identifier) -> float:
    """Time [s] between points beyond which one is missing."""
    return 1.5 * estimator.options.step


def _fading(estimator: Identifier, count: int) -> Array:
    """What forgetting has left (count,) of the weights of points, the newest last."""
    return np.asarray(np.exp(np.log(estimator.learning.least_squares.tuning.forgetting) * np.arange(count)[::-1]))


def warm_up(aircraft: Aircraft, options: ParameterOptions) -> None:
    """Compile (or load from the cache) before a flight what a change of its model needs, also for terms with memory.

    With least squares, which alone has those; a model that takes no more terms needs nothing.
    """
    estimator, draws, count = Identifier(aircraft, replace(options, estimator="rls")), np.random.default_rng(0), 400
    estimator.push_states(level_flight(aircraft, 0.0))
    of_vanes = estimator.learning.least_squares.state.vane_covariance
    of_vanes[:] = 1e-6 * np.eye(of_vanes.shape[1])
    time, axes, ones = options.step * np.arange(count, dtype=np.float64), (count, len(AXES)), np.ones(count)
    signals = draws.uniform(0.1, 0.2, (count, SIGNAL_COUNT))
    past = RememberedSamples(
        time, draws.standard_normal(axes), np.ones(axes), signals, np.full((count, 3), 0.1), 0.1 * ones
    )
    with suppress(InputError):
        change_model(estimator, with_terms(aircraft, {"CZ": _WARMING}, {}), past)
        estimator.push_states(level_flight(aircraft, 2.0))
        estimator.flush()


# -- one axis -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Moments:
    """Weighted rows of one axis over its past: those of the recursion, the newest with weight 1."""

    rows: Array  # (k, n + 2) root of the weight times (x, y, 1), in order of time, without forgetting
    fade: Array  # (k,) root of what forgetting has left
    breaks: npt.NDArray[np.bool_]  # (k,) the point before is missing


def _weighted(estimator: Identifier, model: AerodynamicModel, axis: int, past: RememberedSamples) -> _Moments:
    used = (past.learnt[:, axis] > 0.0) & (past.time >= estimator.learning.changes.since[axis])
    time, signals = past.time[used], past.signals[used]
    code, offsets = link(model.programs[axis], model.lags)
    x = np.empty((len(time), len(offsets) - 1))
    evaluate_term_rows(code, offsets, signals, x)
    known = np.isfinite(x).all(axis=1)
    weight = np.ones(len(time))
    if axis < 3:
        noise = estimator.stream.force_noise
        doubt = estimator.stream.controls.body.mass * past.bias_std[used, axis]
        weight = noise**2 / (noise**2 + doubt**2)
    root = np.sqrt(weight[known])
    rows = root[:, None] * np.column_stack([x, past.measured[used, axis], np.ones(len(time))])[known]
    gaps = np.diff(time[known], prepend=-np.inf) > _pause(estimator)
    return _Moments(rows, np.sqrt(_fading(estimator, len(rows))), gaps)


def extended(
    theta: Array, p: Array, old: Array, new: Array, measured: Array, names: tuple[str, ...] = ()
) -> tuple[Array, Array]:
    """theta and P of old and new terms from those (n,), (n, n) of the old, see the module.

    old (k, n), new (k, m) and measured (k,) are past regressors and responses times the roots of their weights.
    ``names`` (m,) of the new terms are for the InputError where the others explain one.
    """
    n, m = old.shape[1], new.shape[1]
    g, s, moment = np.zeros((n, m)), np.zeros((m, m)), np.zeros(m)
    if len(old) >= _LEAST_POINTS * (n + m):
        scale = np.sqrt(np.sum(old**2, axis=0))
        scale[~(scale > 0.0)] = 1.0
        g = np.linalg.lstsq(old / scale, np.column_stack([new, measured]), rcond=1e-12)[0] / scale[:, None]
        z, rest = new - old @ g[:, :m], measured - old @ g[:, m]
        g, s, moment = g[:, :m], z.T @ z, z.T @ rest
        _check_apart(z, new, names)
    root = np.linalg.cholesky(s + np.eye(m) / PRIOR_VARIANCE)
    half = np.linalg.solve(root, np.eye(m))
    own = half.T @ half
    theta_new = half.T @ (half @ moment)
    cross = -g @ own
    joint = np.block([[p + g @ own @ g.T, cross], [cross.T, own]])
    return np.concatenate([theta - g @ theta_new, theta_new]), 0.5 * (joint + joint.T)


def _check_apart(z: Array, new: Array, names: tuple[str, ...]) -> None:
    """Raises InputError where the old terms explain a new one, or the new ones each other."""
    size = np.sqrt(np.sum(new**2, axis=0))
    moving = size > 0.0
    if not moving.any():
        return
    _, r = np.linalg.qr(z[:, moving] / size[moving])
    left = np.abs(np.diag(r))
    if left.min() ** 2 < _SINGULAR:
        name = np.array(names)[moving][int(np.argmin(left))]
        raise InputError(f"the term '{name}' is explained by the other terms of its axis in this flight: leave it out")


def reduced(theta: Array, p: Array, keep: npt.NDArray[np.bool_]) -> tuple[Array, Array]:
    """theta and P of the terms of a mask (n,) where the others are known to be zero, see the module."""
    if keep.all():
        return theta.copy(), p.copy()
    root = np.linalg.cholesky(p[np.ix_(~keep, ~keep)])
    half = np.linalg.solve(root, p[np.ix_(~keep, keep)])
    rest = p[np.ix_(keep, keep)] - half.T @ half
    return theta[keep] - half.T @ np.linalg.solve(root, theta[~keep]), 0.5 * (rest + rest.T)


# -- all that was learnt ------------------------------------------------------------------------------------------


def _carried(estimator: Identifier, new: AerodynamicModel) -> Carry:
    """What makes of a checkpoint one of the new model: terms that stay are as they were, of others nothing is known."""
    old, shapes = estimator.model, ((), (len(AXES),), (len(AXES),), (SIGNAL_COUNT,), (3,), ())
    nothing = RememberedSamples(*(np.empty((0, *shape)) for shape in shapes))
    done: dict[int, ParameterCheckpoint] = {}

    def carry(kept: ParameterCheckpoint) -> ParameterCheckpoint:
        if id(kept) not in done:
            state = _changed_state(estimator, kept.least_squares, old, new, nothing)
            found = _in_terms_of(new, kept.found)
            done[id(kept)] = replace(kept, least_squares=state, estimator=None, carried=found)
        return done[id(kept)]

    return carry


def _in_terms_of(new: AerodynamicModel, found: ParameterSet) -> ParameterSet:
    """What was found, as parameters of another model: those that it has not are not known."""
    known = {p.name: i for i, p in enumerate(found.parameters)}
    place = np.array([known.get(name, -1) for name in new.parameter_names])
    nan = float("nan")
    parameters = tuple(
        found.parameters[i] if i >= 0 else ParameterEstimate(name, nan, nan, Trust.HOLD, "not learnt yet", nan, 0.0)
        for i, name in zip(place.tolist(), new.parameter_names, strict=True)
    )
    covariance = np.full((len(place), len(place)), np.nan)
    there = np.flatnonzero(place >= 0)
    covariance[np.ix_(there, there)] = found.covariance[np.ix_(place[there], place[there])]
    return replace(found, model=new.identifier, parameters=parameters, covariance=covariance)


def _changed_state(
    estimator: Identifier, was: RlsState, old: AerodynamicModel, new: AerodynamicModel, past: RememberedSamples
) -> RlsState:
    """Learning of the new model, where that of the old ``was``."""
    learning = estimator.learning.least_squares.new_state(new)
    for array in ("updates", "last_valid", "bias_variance", "prior_variance", "sampling"):
        getattr(learning, array)[:] = getattr(was, array)
    for i, axis in enumerate(AXES):
        before, after = old.terms[axis], new.terms[axis]
        place = [before.index(text) for text in after if text in before]  # new terms stand after old ones
        n, count = len(place), len(before)
        keep = np.isin(np.arange(count), place)
        theta, p = reduced(was.theta[i, :count], was.p[i, :count, :count], keep)
        rows = [*place, count, count + 1]
        sums, recent = was.sums[i][:, rows][:, :, rows], was.recent[i][:, rows]
        of_vanes = was.vane_covariance[i][np.ix_(place, place)]
        first, source = int(new.offsets[i]), int(old.offsets[i]) + np.array(place, dtype=np.int64)
        for name in ("term_mean", "term_square", "noise_square", "last_learnt"):
            getattr(learning, name)[first : first + n] = getattr(was, name)[source]
        if len(after) > n:
            moments = _weighted(estimator, new, i, past)
            rows_now = moments.rows * moments.fade[:, None]
            x, y = rows_now[:, : len(after)], rows_now[:, len(after)]
            theta, p = extended(theta, p, x[:, :n], x[:, n:], y, after[n:])
            sums, recent = _remade_sums(estimator, sums, recent, moments, n)
            of_vanes = _vane_covariance(estimator, new, i, past, of_vanes)
            _follow_new_terms(estimator, learning, new, i, n, past)
        m = len(after)
        learning.theta[i, :m], learning.p[i, :m, :m] = theta, p
        learning.vane_covariance[i, :m, :m] = of_vanes
        if before == after:
            learning.prior[i, :m, :m] = was.prior[i, :m, :m]
        learning.sums[i, :, : m + 2, : m + 2], learning.recent[i, :, : m + 2] = sums, recent
    return learning


def _remade_sums(estimator: Identifier, sums: Array, recent: Array, moments: _Moments, n: int) -> tuple[Array, Array]:
    """Lagged sums and newest rows with more terms: from the past, or with zeros for them where there is none."""
    m, lags = moments.rows.shape[1] - 2, len(sums)
    out, newest = np.zeros((lags, m + 2, m + 2)), np.full((lags, m + 2), np.nan)
    if len(moments.rows) >= _LEAST_POINTS * m:
        _add_samples(out, newest, moments.rows, moments.breaks, estimator.learning.least_squares.tuning.forgetting)
        return out, newest
    place = [*range(n), m, m + 1]
    out[np.ix_(np.arange(lags), place, place)] = sums
    newest[:, place] = recent
    newest[np.isfinite(recent[:, -1]), n:m] = 0.0
    return out, newest


@njit(cache=True)
def _add_samples(sums: Array, recent: Array, rows: Array, breaks: npt.NDArray[np.bool_], forgetting: float) -> None:
    for i in range(len(rows)):
        if breaks[i]:
            recent[:] = np.nan
        add_sample(sums, recent, rows[i], forgetting)


def _follow_new_terms(
    estimator: Identifier, learning: RlsState, model: AerodynamicModel, axis: int, n: int, past: RememberedSamples
) -> None:
    """How the new terms of an axis have moved lately, and their noise."""
    programs = model.programs[axis][n:]
    code, offsets = link(programs, model.lags)
    part = slice(int(model.offsets[axis]) + n, int(model.offsets[axis + 1]))
    since = past.time > np.max(past.time, initial=0.0) - _MOTION_TIME
    values = np.empty((int(since.sum()), len(programs)))
    evaluate_term_rows(code, offsets, past.signals[since], values)
    weight = (
        estimator.learning.least_squares.tuning.motion_weight
        * (1.0 - estimator.learning.least_squares.tuning.motion_weight) ** np.arange(len(values))[::-1]
    )
    known = np.isfinite(values).all(axis=1)
    if known.any():
        share = weight[known] / weight[known].sum()
        learning.term_mean[part] = share @ values[known]
        learning.term_square[part] = share @ values[known] ** 2
    used = past.learnt[:, axis] > 0.0
    if used.any():
        sensors = sensor_noise(estimator.aircraft)
        geometry, std = estimator.stream.controls.body.geometry, past.air_velocity_std[used]
        variance = _noise_variance(code, offsets, past.signals[used], std, sensors, geometry)
        share = _fading(estimator, int(used.sum()))
        learning.noise_square[part] = share @ variance / share.sum()
        learning.last_learnt[part] = past.time[used][-1]


def _vane_covariance(
    estimator: Identifier, model: AerodynamicModel, axis: int, past: RememberedSamples, known: Array
) -> Array:
    """Covariance (m, m) of the terms of an axis from the noise of the vanes: ``known`` (n, n) that of the old terms.

    That of the new ones follows over the past, from as much noise as the old ones have.
    """
    used, n, m = past.learnt[:, axis] > 0.0, len(known), len(model.terms[AXES[axis]])
    out = np.zeros((m, m))
    if used.any() and known.any():
        signals = np.ascontiguousarray(past.signals[used])
        shifts = _shifts(*link(model.programs[axis], model.lags), signals, np.full(2, _SMALL_ANGLE))
        share = _fading(estimator, len(signals))
        out = np.einsum("k,kvi,kvj->ij", share / share.sum(), shifts, shifts)
        out *= np.trace(known) / np.trace(out[:n, :n])
    out[:n, :n] = known
    return out


@njit(cache=True)
def _shifts(code: Array, offsets: npt.NDArray[np.int64], signals: Array, std: Array) -> Array:
    """By how much one sigma (2,) of each vane moves each term, (k, 2, n), at signals (k, …)."""
    n = len(offsets) - 1
    out, terms = np.zeros((len(signals), 2, n)), np.empty(n)
    for k in range(len(signals)):
        evaluate_programs(code, offsets, signals[k], terms)
        term_shifts(code, offsets, signals[k], std, terms, out[k])
    return out


@njit(cache=True)
def _noise_variance(
    code: Array,
    offsets: npt.NDArray[np.int64],
    signals: Array,
    air_velocity_std: Array,
    sensors: Array,
    geometry: Array,
) -> Array:
    """Variance of each term (k, m) from the noise of the signals (k, …) that it reads, as in ``fill_history``."""
    out, row = np.empty((len(signals), len(offsets) - 1)), np.zeros(_ROW_WIDTH)
    noise, terms = np.empty(signals.shape[1]), np.empty(len(offsets) - 1)
    for k in range(len(signals)):
        row[_AIR_VELOCITY_STD] = air_velocity_std[k]
        signal_noise(signals[k], row, sensors, geometry, noise)
        evaluate_programs(code, offsets, signals[k], terms)
        term_noise(code, offsets, signals[k], noise, terms, out[k])
    return out**2
