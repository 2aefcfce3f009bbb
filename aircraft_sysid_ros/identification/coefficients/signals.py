"""Signals that the terms of a model read, from reconstructed states and measured controls."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import speed_of_sound
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.frames import rotation_matrix
from aircraft_sysid_ros.aircraft.signals import FIRST_LAG, MOST_INPUTS, SIGNAL_COUNT, SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.flight_model.layout import CONTROL_COUNT
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.state import StateField

Array = npt.NDArray[np.float64]

_ALPHA, _BETA, _P, _Q, _R = (SIGNAL_INDEX[s] for s in ("alpha", "beta", "p", "q", "r"))
_DE, _DA, _DR, _FLAPS = (SIGNAL_INDEX[s] for s in ("de", "da", "dr", "flaps"))
_TC, _THROTTLE, _PROPELLER = (SIGNAL_INDEX[s] for s in ("Tc", "throttle", "propeller_speed"))
_V, _QBAR, _MACH, _HEIGHT = (SIGNAL_INDEX[s] for s in ("V", "qbar", "mach", "height"))
_ALPHA_DOT, _BETA_DOT, _TIME = (SIGNAL_INDEX[s] for s in ("alpha_dot", "beta_dot", "time"))
_INPUTS = len(SIGNALS)
#: How long [s] the newest value of a named input holds: what stands still need not be sent more often.
INPUT_HELD = 1.0
#: A series has lost samples where a step is so many times as long as usual, by so many steps before it.
LOST_STEPS, STEPS_BEFORE = 2.1, 96
#: Share of those that came as they should where most were lost; by two steps, since samples may come in pairs.
_IN_TIME = 0.25
#: By so many times its noise a surface has moved.
_MOVED = 6.0
_POSITION_DOWN = StateField.POSITION.stop - 1
_ORIGIN_ALTITUDE = StateField.ORIGIN.stop - 1


@njit(cache=True)
def flow_angle_rates(row: Array, gravity: float) -> tuple[float, float]:
    """Time derivatives of alpha and beta [rad/s] from kinematics (6.16)-(6.18), without differentiation.

    ``row`` is a row of StateField. Exact for steady wind; specific force at the IMU, whose lever arm is neglected
    here. An angle that the row does not know has no rate; that of the other then has it from the air velocity.
    """
    alpha, beta, speed = row[48], row[49], row[47]
    known_alpha, known_beta = np.isfinite(alpha), np.isfinite(beta)
    if not known_alpha:
        alpha = np.arctan2(row[3], row[1])
    if not known_beta:
        beta = np.arctan2(row[2], np.sqrt(row[1] ** 2 + row[3] ** 2))
    c = rotation_matrix(row[10:14])
    ax = row[41] + gravity * c[2, 0]
    ay = row[42] + gravity * c[2, 1]
    az = row[43] + gravity * c[2, 2]
    p, q, r = row[44], row[45], row[46]
    sa, ca, sb, cb = np.sin(alpha), np.cos(alpha), np.sin(beta), np.cos(beta)
    alpha_dot = q - np.tan(beta) * (p * ca + r * sa) + (az * ca - ax * sa) / (speed * cb)
    beta_dot = p * sa - r * ca + (ay * cb - ax * ca * sb - az * sa * sb) / speed
    return alpha_dot if known_alpha else np.nan, beta_dot if known_beta else np.nan


@njit(cache=True)
def fill_signals(
    row: Array, controls: Array, height: float, start_time: float, geometry: Array, gravity: float, out: Array
) -> None:
    """One row of SIGNALS into ``out``, without lags.

    row: a row of StateField; controls (17,) as in Kind.CONTROLS with the signs of the aircraft file applied, and the
    named inputs; height above ground [m]; geometry = (wing area, span, chord).
    """
    speed, density = row[47], row[50]
    area, span, chord = geometry
    qbar = 0.5 * density * speed * speed
    altitude = row[_ORIGIN_ALTITUDE] - row[_POSITION_DOWN]
    out[_ALPHA], out[_BETA] = row[48], row[49]
    out[_P] = row[44] * span / (2.0 * speed)
    out[_Q] = row[45] * chord / speed
    out[_R] = row[46] * span / (2.0 * speed)
    out[_DE], out[_DA], out[_DR], out[_FLAPS] = controls[0], controls[1], controls[2], controls[3]
    out[_TC] = controls[5] / (qbar * area)
    out[_THROTTLE], out[_PROPELLER] = controls[4], controls[6]
    out[_V], out[_QBAR] = speed, qbar
    out[_MACH] = speed / speed_of_sound(altitude)
    out[_HEIGHT] = height
    alpha_dot, beta_dot = flow_angle_rates(row, gravity)
    out[_ALPHA_DOT] = alpha_dot * chord / speed
    out[_BETA_DOT] = beta_dot * span / (2.0 * speed)
    out[_TIME] = row[0] - start_time
    for k in range(MOST_INPUTS):
        out[_INPUTS + k] = controls[CONTROL_COUNT + k]
    out[FIRST_LAG:] = np.nan


@njit(cache=True)
def signals_of(rows: Array, controls: Array, heights: Array, geometry: Array, gravity: float) -> Array:
    """Signals (n, SIGNAL_COUNT) of rows of StateField, as ``fill_signals`` makes them; time from the first row on."""
    out = np.empty((len(rows), SIGNAL_COUNT))
    for i in range(len(rows)):
        fill_signals(rows[i], controls[i], heights[i], rows[0, 0], geometry, gravity, out[i])
    return out


def sensor_noise(aircraft: Aircraft) -> Array:
    """What ``signal_noise`` needs of the sensors, (2 + MOST_INPUTS,)."""
    noise = [aircraft.sensors[name].noise[0] for name in ("gyro", "control_surfaces")]
    noise += [item.noise for item in aircraft.inputs]
    return np.array(noise + [0.0] * (2 + MOST_INPUTS - len(noise)))


@njit(cache=True)
def signal_noise(signals: Array, row: Array, sensors: Array, geometry: Array, out: Array) -> None:
    """One sigma of the noise in each signal, into ``out``: what a regressor must exceed to say anything.

    ``sensors`` = noise of gyro [rad/s], of surfaces [rad], of the named inputs.
    alpha and beta: from the filter's own covariance.
    """
    _, span, chord = geometry
    speed = signals[_V]
    flow = row[51] / speed
    out[:] = 0.0
    out[_ALPHA] = out[_BETA] = flow
    out[_P] = out[_R] = sensors[0] * span / (2.0 * speed)
    out[_Q] = sensors[0] * chord / speed
    out[_DE] = out[_DA] = out[_DR] = out[_FLAPS] = sensors[1]
    out[_TC] = 0.02 * abs(signals[_TC]) + 0.001
    out[_THROTTLE] = 0.01
    out[_PROPELLER] = 0.01 * abs(signals[_PROPELLER])
    out[_V] = row[51]
    out[_QBAR] = 2.0 * signals[_QBAR] * flow
    out[_MACH] = signals[_MACH] * flow
    out[_HEIGHT] = 0.3
    out[_ALPHA_DOT] = flow * chord / speed
    out[_BETA_DOT] = flow * span / speed
    for k in range(MOST_INPUTS):
        out[_INPUTS + k] = sensors[2 + k]


def interpolate(times: Array, values: Array, at: Array, longest: float, held: float = np.inf) -> Array:
    """Series (n, k) at ascending times ``at`` (m,), linear between samples at most ``longest`` [s] away.

    Where only an earlier sample is near, at most ``held`` [s], it is held; where none is near, NaN.
    """
    times, values, at = (np.ascontiguousarray(array) for array in (times, values, at))  # or it is compiled for each
    return _interpolate(times, values, at, longest, held)


@njit(cache=True)
def _interpolate(times: Array, values: Array, at: Array, longest: float, held: float) -> Array:
    out = np.full((len(at), values.shape[1]), np.nan)
    j = 0
    for i in range(len(at)):
        while j < len(times) and times[j] <= at[i]:
            j += 1
        before, after = j - 1, j
        has_before = before >= 0 and at[i] - times[before] <= longest
        has_after = after < len(times) and times[after] - at[i] <= longest
        if has_before and has_after:
            weight = (at[i] - times[before]) / (times[after] - times[before])
            for k in range(values.shape[1]):
                out[i, k] = values[before, k] + weight * (values[after, k] - values[before, k])
        elif has_before and at[i] - times[before] <= held:
            out[i] = values[before]
    return out


def named_inputs(
    count: int, times: Array, values: Array, at: Array, between: Callable[[Array, Array, Array], Array]
) -> Array:
    """The first ``count`` named inputs of samples (n, …) at times ``at`` (m,), (m, MOST_INPUTS), NaN for the others.

    Each is a series of its own, since a message may hold some of them only: as ``between`` has it, and held where its
    next sample is far.
    """
    out = np.full((len(at), MOST_INPUTS), np.nan)
    for k in range(count):
        known = np.isfinite(values[:, k])
        series = times[known], np.ascontiguousarray(values[known, k : k + 1])
        found = between(*series, at)
        out[:, k] = np.where(np.isfinite(found), found, held(*series, at, INPUT_HELD))[:, 0]
    return out


def moved_unseen(
    times: Array, values: Array, at: Array, noise: Array, shortest: float, ahead: float
) -> npt.NDArray[np.bool_]:
    """Where (m, k) a series (n, k) moved while its samples were lost, at ascending times ``at`` (m,).

    Nobody knows when it did: a straight line gives the begin of a doublet that had not begun, and what is learnt from
    few samples takes the difference for the aeroplane. Samples are lost where a step is longer than ``shortest`` [s]
    and ``LOST_STEPS`` times as long as usual. It counts a usual step longer, since states may have been lost with them.
    Where a machine is too busy most of them are lost, for seconds: what is usual is what a quarter of the steps are.
    ``noise`` (k,): one sigma. No sample is looked at that is later than ``ahead`` [s], and none counts for longer.
    """
    unseen = np.zeros((len(at), values.shape[1]), np.bool_)
    if not len(at):
        return unseen
    steps, moved = np.diff(times), np.abs(np.diff(values, axis=0)) > _MOVED * noise
    near = (times[:-1] < at[-1]) & (times[1:] >= at[0] - ahead)
    for i in np.flatnonzero((steps > shortest) & near & moved.any(axis=1)).tolist():
        before = times[max(i - STEPS_BEFORE, 0) : i + 1]
        usual = 0.5 * float(np.quantile(before[2:] - before[:-2], _IN_TIME)) if len(before) > 2 else 0.0
        if steps[i] > LOST_STEPS * usual:
            after, longer = times[i + 1] - at, min(max(usual, 0.5 * shortest), ahead)
            unseen[(at > times[i]) & (after <= ahead) & (after >= -longer)] |= moved[i]
    return unseen


def held(times: Array, values: Array, at: Array, longest: float) -> Array:
    """Series (n, k) at times ``at`` (m,): the newest value, at most ``longest`` [s] old, else NaN."""
    out = np.full((len(at), values.shape[1]), np.nan)
    newest = np.searchsorted(times, at, side="right") - 1
    there = np.flatnonzero(newest >= 0)
    there = there[at[there] - times[newest[there]] <= longest]
    out[there] = values[newest[there]]
    return out


def cubic(times: Array, values: Array, at: Array, longest: float, ahead: float = np.inf) -> Array:
    """Series (n, k) at times ``at`` (m,), cubic through the two samples before and the two after.

    NaN where four samples are not there, where one step between them is longer than ``longest`` [s], or where the last
    of them is more than ``ahead`` [s] later.
    """
    if len(times) < 4:
        return np.full((len(at), values.shape[1]), np.nan)
    j = np.clip(np.searchsorted(times, at, side="right"), 2, len(times) - 2)
    nodes = np.stack([times[j + k] for k in (-2, -1, 0, 1)])
    steps = np.diff(nodes, axis=0)
    regular = (at >= nodes[1]) & (at <= nodes[2]) & np.all((steps > 0.0) & (steps <= longest), axis=0)
    total = np.zeros((len(at), values.shape[1]))
    for k in range(4):
        weight = np.ones(len(at))
        for other in range(4):
            if other != k:
                with np.errstate(divide="ignore", invalid="ignore"):
                    weight *= (at - nodes[other]) / (nodes[k] - nodes[other])
        total += weight[:, None] * values[j + k - 2]
    total[~(regular & (nodes[3] - at <= ahead))] = np.nan
    return total


def interpolate_sparse(times: Array, values: Array, at: Array, longest: float, ahead: float) -> Array:
    """Series (n, k) at times ``at`` (m,) from samples that are far apart beside the motion.

    Cubic as in ``cubic``; a straight line where that is not possible; NaN where the samples on both sides are more
    than ``longest`` [s] apart, since nobody knows what was between them.
    """
    straight = interpolate(times, values, at, longest)
    j = np.searchsorted(times, at, side="right")
    inside = (j > 0) & (j < len(times))
    apart = np.full(len(at), np.inf)
    apart[inside] = times[j[inside]] - times[j[inside] - 1]
    straight[apart > longest] = np.nan
    curved = cubic(times, values, at, longest, ahead)
    return np.where(np.isfinite(curved), curved, straight)
