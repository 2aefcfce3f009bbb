"""The jitted loop of recursive maximum likelihood (5.8), (5.10)-(5.13) over the flight-model filter.

A bank of filters, the first with theta and one more per free parameter with that one moved a little, runs over the
samples in order of time. Innovations and variances of the first, and their differences to the others divided by the
move, are what the recursion needs: the difference of two filters holds all that a parameter did to state, covariance
and gain in the past. After each step all filters go on with the new theta.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.recursive_maximum_likelihood import (
    add_score,
    close_block,
    learn_rows,
    scalar_innovation_rows,
)
from aircraft_sysid_ros.flight_model.bank import bank_step
from aircraft_sysid_ros.flight_model.layout import (
    AIRSPEED,
    ATTITUDE,
    ATTITUDE_VECTOR,
    D_ATTITUDE,
    D_POSITION,
    D_RATES,
    D_VELOCITY,
    D_WIND,
    GPS_POSITION,
    GPS_VELOCITY,
    OUTPUT_SIZE,
    POSITION,
    RATES,
    REFERENCE,
    VELOCITY,
    WIND,
    FlightModel,
)
from aircraft_sysid_ros.identification.coefficients.layout import Body
from aircraft_sysid_ros.identification.estimators.likelihood_start import (
    START_DOUBT,
    all_known,
    learn_start,
    set_theta,
    take_start,
)
from aircraft_sysid_ros.identification.estimators.likelihood_state import (
    ATTITUDE_DUE,
    BEGUN,
    BLOCK_DUE,
    LEARNT,
    RESTARTS,
    RUNNING,
    STARTED,
    STRIKES,
    TIME,
    ImuEpochs,
    Recursion,
    Tuning,
)
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction import state
from aircraft_sysid_ros.reconstruction.state import StateField

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Samples nearer than this [s] are fused in one step.
_SAME_TIME = 1e-4
#: Largest -rho of a noise level, e^2 / s = 15: one wild sample says little of the noise.
_LARGEST_SURPRISE = 10.0
#: A noise level of a sensor this many times what the aircraft file says, or gusts [m/s per sqrt(s)] and rate
#: disturbances [rad/s per sqrt(s)] as large: the parameters do not explain the flight, noise is made to.
_UNEXPLAINED = np.log(5.0)
#: A filter is lost if its velocity over ground or its wind is this far [m/s] from the first step's.
_LOST = 15.0
_STRIKE_TIME = 10.0  # [s]
#: So many losses in about that time, and what was learnt is given up too.
_MOST_STRIKES = 4.0
#: A sample that is further from the state of the first step than this [m, m/s, rad] plus 8 sigma is left out.
_OUTLIER_SIGMA = 8.0
_OUTLIER_SLACK = np.array([np.inf] * 6 + [10.0] * 3 + [3.0] * 3 + [np.inf] * 3 + [3.0, 0.15, 0.15])

# Of the state of the first step; standard deviations in the order of its error, with the wind last.
_VELOCITY, _POSITION, _ATTITUDE = StateField.VELOCITY, StateField.POSITION, StateField.ATTITUDE
_RATES, _WIND = StateField.ANGULAR_VELOCITY, StateField.WIND
_FIRST_POSITION, _FIRST_VELOCITY = _POSITION.start, _VELOCITY.start
_FIRST_WIND, _AIRSPEED = _WIND.start, StateField.AIRSPEED
_VELOCITY_STD = StateField.STANDARD_DEVIATIONS.start + state.D_VELOCITY
_POSITION_STD = StateField.STANDARD_DEVIATIONS.start + state.D_POSITION
_ATTITUDE_STD = StateField.STANDARD_DEVIATIONS.start + state.D_ATTITUDE
_AIR_VELOCITY_STD = StateField.STANDARD_DEVIATIONS.start + state.D_AIR_VELOCITY


# -- filters ------------------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy")
def _begin(time: float, row: Array, inputs: Array, recursion: Recursion, tuning: Tuning) -> None:
    """Start all filters with the state of the first step."""
    x, p = recursion.states, recursion.covariances
    p[:] = 0.0
    for m in range(len(x)):
        x[m, VELOCITY], x[m, POSITION], x[m, ATTITUDE] = row[_VELOCITY], row[_POSITION], row[_ATTITUDE]
        x[m, RATES], x[m, WIND] = row[_RATES], row[_WIND]
        for i in range(3):
            p[m, D_VELOCITY + i, D_VELOCITY + i] = (START_DOUBT * row[_VELOCITY_STD + i]) ** 2
            p[m, D_POSITION + i, D_POSITION + i] = (START_DOUBT * row[_POSITION_STD + i]) ** 2
            p[m, D_ATTITUDE + i, D_ATTITUDE + i] = (START_DOUBT * row[_ATTITUDE_STD + i]) ** 2
            p[m, D_RATES + i, D_RATES + i] = (START_DOUBT * tuning.gyro_std) ** 2
            p[m, D_WIND + i, D_WIND + i] = (START_DOUBT * row[_AIR_VELOCITY_STD + i]) ** 2
    recursion.inputs[:] = inputs
    clock = recursion.clock
    clock[TIME], clock[RUNNING] = time, 1.0
    clock[ATTITUDE_DUE] = np.floor(time / tuning.attitude_step + 1.0) * tuning.attitude_step
    _break_scores(time, recursion, tuning)


@njit(cache=True, error_model="numpy")
def _break_scores(time: float, recursion: Recursion, tuning: Tuning) -> None:
    """What follows is not correlated with what was before."""
    recursion.scores.recent[:] = np.nan
    recursion.scores.block[:] = 0.0
    recursion.clock[BLOCK_DUE] = np.floor(time / tuning.block + 1.0) * tuning.block


@njit(cache=True, error_model="numpy")
def _leave_out_outliers(row: Array, y: Array, model: FlightModel) -> None:
    """Take out of y (18,) what a transmission fault or a dead sensor gave, by the state of the first step."""
    for i in range(GPS_POSITION, OUTPUT_SIZE):
        expected = np.nan
        if i < GPS_POSITION + 3:
            expected = row[_FIRST_POSITION + i - GPS_POSITION]
        elif i < GPS_VELOCITY + 3:
            expected = row[_FIRST_VELOCITY + i - GPS_VELOCITY]
        elif i >= AIRSPEED:
            expected = row[_AIRSPEED + i - AIRSPEED]  # then the two flow angles
        if abs(y[i] - expected) > _OUTLIER_SLACK[i] + _OUTLIER_SIGMA * model.output_std[i]:
            y[i] = np.nan


@njit(cache=True, error_model="numpy")
def _start_anew(recursion: Recursion) -> None:
    """Give up what was learnt."""
    recursion.theta[:], recursion.root[:] = recursion.start, recursion.start_root
    recursion.scores.block[:], recursion.scores.lagged[:] = 0.0, 0.0
    recursion.scores.recent[:], recursion.scores.information[:] = np.nan, 0.0
    recursion.last_learnt[:], recursion.before_time[:] = np.nan, np.nan
    recursion.clock[STARTED] = 0.0
    recursion.clock[BEGUN] = recursion.clock[LEARNT] = recursion.clock[STRIKES] = 0.0
    recursion.clock[RUNNING] = 0.0


@njit(cache=True, error_model="numpy")
def _is_lost(row: Array, recursion: Recursion) -> bool:
    """A filter of the bank has a number that is none, or the first is far from the first step."""
    if not (np.all(np.isfinite(recursion.states)) and np.all(np.isfinite(recursion.covariances))):
        return True
    x = recursion.states[0]
    furthest = 0.0
    for i in range(3):
        off_course = abs(x[VELOCITY.start + i] - row[_FIRST_VELOCITY + i])
        furthest = max(furthest, off_course, abs(x[WIND.start + i] - row[_FIRST_WIND + i]))
    return furthest > _LOST


@njit(cache=True, error_model="numpy")
def _variance_along(row: Array, root: Array) -> float:
    """w' P w of one row (q,)."""
    q = len(row)
    along = np.zeros(q)
    for i in range(q):
        if row[i] != 0.0:
            for j in range(q):
                along[j] += root[i, j] * row[i]
    return float(np.sum(along * along))


@njit(cache=True, error_model="numpy")
def _rows_of_step(recursion: Recursion, rows: Array, residuals: Array) -> int:
    """Rows of regression of all innovations of the newest step; returns how many.

    While parameters are not known their errors make innovations larger, by r = w' P w over the variance: the noise
    levels are compared with s (1 + r), else they would grow to explain what the parameters have yet to explain.
    """
    q, count = len(recursion.free), 0
    e, s = recursion.innovations, recursion.variances
    d_e, d_s = np.empty(q), np.empty(q)
    for i in range(OUTPUT_SIZE):
        if not (np.isfinite(e[0, i]) and s[0, i] > 0.0):
            continue
        for m in range(q):
            d_e[m] = (e[1 + m, i] - e[0, i]) / recursion.moves[m]
            d_s[m] = (s[1 + m, i] - s[0, i]) / recursion.moves[m]
        scalar_innovation_rows(e[0, i], s[0, i], d_e, d_s, rows[count : count + 2], residuals[count : count + 2])
        r = _variance_along(rows[count], recursion.root)
        rows[count + 1] /= 1.0 + r
        surprise = (1.0 - residuals[count] ** 2 / (1.0 + r)) / np.sqrt(2.0)
        residuals[count + 1] = max(surprise, -_LARGEST_SURPRISE)
        count += 2
    return count


@njit(cache=True, error_model="numpy")
def _step(time: float, inputs: Array, y: Array, model: FlightModel, recursion: Recursion, tuning: Tuning) -> None:
    """All filters to ``time`` [s] with the outputs y (18,) there, and one step of the recursion."""
    clock, q = recursion.clock, len(recursion.free)
    dt = time - clock[TIME]
    bank_step(
        recursion.states, recursion.covariances, recursion.inputs, inputs, dt, y,
        recursion.thetas, model, recursion.innovations, recursion.variances,
    )  # fmt: skip
    recursion.inputs[:], clock[TIME] = inputs, time
    clock[LEARNT] += dt
    rows, residuals = np.empty((2 * OUTPUT_SIZE, q)), np.empty(2 * OUTPUT_SIZE)
    count = _rows_of_step(recursion, rows, residuals)
    rows, residuals = rows[:count], residuals[:count]
    if clock[LEARNT] > tuning.score_start:
        add_score(recursion.scores, rows, residuals)
    early = np.exp(-clock[LEARNT] / tuning.early_time)
    forgetting = tuning.forgetting + early * (tuning.early_forgetting - tuning.forgetting)
    _note_learnt(time, rows, forgetting, recursion)
    free_theta = recursion.theta[recursion.free]
    learn_rows(free_theta, recursion.root, rows, residuals, forgetting, recursion.largest_step)
    set_theta(free_theta, recursion)


@njit(cache=True, error_model="numpy")
def _note_learnt(time: float, rows: Array, forgetting: float, recursion: Recursion) -> None:
    """A parameter learns where a row says at least a tenth of what forgetting takes, were it alone."""
    least = 0.1 * (1.0 / forgetting - 1.0)
    for i in range(len(recursion.free)):
        variance, most = 0.0, 0.0
        for j in range(len(recursion.free)):
            variance += recursion.root[i, j] ** 2
        for k in range(len(rows)):
            most = max(most, rows[k, i] ** 2)
        if most * variance >= least:
            recursion.last_learnt[i] = time


# -- the loop -----------------------------------------------------------------------------------------------------


@njit(cache=True, error_model="numpy")
def _interpolate(time: float, end: float, inputs: Array, recursion: Recursion) -> Array:
    """Inputs (INPUT_SIZE,) between those of the newest step and of ``end`` [s], the attitude of the latter."""
    span = end - recursion.clock[TIME]
    weight = (time - recursion.clock[TIME]) / span if span > 0.0 else 1.0
    out = recursion.inputs + weight * (inputs - recursion.inputs)
    out[REFERENCE] = inputs[REFERENCE]
    return out


@njit(cache=True, error_model="numpy")
def _advance(
    k: int,
    knots: ImuEpochs,
    times: Array,
    samples: Array,
    at: int,
    model: FlightModel,
    recursion: Recursion,
    tuning: Tuning,
) -> int:
    """Fuse samples up to one knot, then the knot; returns the index of the next sample."""
    y, clock = np.empty(OUTPUT_SIZE), recursion.clock
    now, inputs = knots.time[k], knots.inputs[k]
    while True:
        y[:] = np.nan
        time = now
        if at < len(times) and times[at] < now - _SAME_TIME:
            time = max(times[at], clock[TIME])
        while at < len(times) and times[at] <= time + _SAME_TIME:
            for i in range(OUTPUT_SIZE):
                if np.isfinite(samples[at, i]):
                    y[i] = samples[at, i]
            at += 1
        if time == now:
            break
        _leave_out_outliers(knots.rows[k], y, model)
        _step(time, _interpolate(time, now, inputs, recursion), y, model, recursion, tuning)
    _leave_out_outliers(knots.rows[k], y, model)
    y[:6] = knots.imu[k]
    if now >= clock[ATTITUDE_DUE]:
        y[ATTITUDE_VECTOR : ATTITUDE_VECTOR + 3] = 0.0
        clock[ATTITUDE_DUE] += tuning.attitude_step
    _step(now, inputs, y, model, recursion, tuning)
    return at


@njit(cache=True, error_model="numpy")
def _pass(times: Array, at: int, time: float) -> int:
    """Index of the first sample after ``time``."""
    while at < len(times) and times[at] <= time + _SAME_TIME:
        at += 1
    return at


@njit(cache=True, error_model="numpy")
def _start_knot(k: int, knots: ImuEpochs, body: Body, offsets: Integers, recursion: Recursion, tuning: Tuning) -> None:
    """One knot of the start; at its end the filters are due."""
    clock, now = recursion.clock, knots.time[k]
    if clock[RUNNING] > 0.0:
        clock[BEGUN] += now - clock[TIME]
    clock[TIME] = now
    learn_start(now, knots.history[k], body, offsets, recursion)
    known = clock[BEGUN] >= tuning.longest_start or all_known(offsets[6], recursion)
    clock[STARTED] = 1.0 if clock[BEGUN] >= tuning.start_time and known else 0.0
    clock[RUNNING] = 1.0 - clock[STARTED]


@njit(cache=True, error_model="numpy")
def _begin_knot(k: int, knots: ImuEpochs, offsets: Integers, recursion: Recursion, tuning: Tuning) -> None:
    """Filters from the first step; at the very first time the recursion from the start."""
    if recursion.clock[LEARNT] == 0.0:
        take_start(knots.rows[k], offsets, recursion)
    _begin(knots.time[k], knots.rows[k], knots.inputs[k], recursion, tuning)


@njit(cache=True, error_model="numpy")
def _explains_nothing(offsets: Integers, recursion: Recursion) -> bool:
    """Some noise level is out of all proportion."""
    return bool(np.any(recursion.theta[offsets[6] + 6 :] > _UNEXPLAINED))


@njit(cache=True, error_model="numpy")
def _lose(recursion: Recursion) -> None:
    """The filters start over at the next knot; after many losses so does all that was learnt."""
    clock = recursion.clock
    clock[RESTARTS] += 1.0
    clock[STRIKES] += 1.0
    clock[RUNNING] = 0.0
    if clock[STRIKES] >= _MOST_STRIKES:
        _start_anew(recursion)


@njit(cache=True, error_model="numpy")
def _end_block(now: float, recursion: Recursion, tuning: Tuning) -> None:
    """Close a block of scores."""
    clock = recursion.clock
    if clock[LEARNT] > tuning.score_start:
        close_block(recursion.scores, tuning.score_forgetting)
    clock[BLOCK_DUE] = np.floor(now / tuning.block + 1.0) * tuning.block
    clock[STRIKES] *= np.exp(-tuning.block / _STRIKE_TIME)


@njit(cache=True, error_model="numpy")
def run(
    knots: ImuEpochs,
    times: Array,
    samples: Array,
    body: Body,
    model: FlightModel,
    offsets: Integers,
    recursion: Recursion,
    tuning: Tuning,
    known_times: Array,
    known: Array,
) -> tuple[int, int]:
    """All knots, in place; returns the number of samples used and that of the entries of ``known``.

    times (m,) ascending, samples (m, 18) with NaN where nothing was measured, offsets (7,) of the axes; known_times
    (n,) and known (n, coefficients) receive the coefficients at the end of each block of scores.
    """
    clock, at, count = recursion.clock, int(np.int64(0)), 0  # a literal 0 would be compiled for itself
    for k in range(len(knots.time)):
        now = knots.time[k]
        if not knots.usable[k] or now - clock[TIME] > tuning.largest_gap:
            clock[RUNNING] = 0.0
            recursion.before_time[:] = np.nan
        if knots.usable[k] and clock[STARTED] > 0.0 and clock[RUNNING] > 0.0:
            at = _advance(k, knots, times, samples, at, model, recursion, tuning)
            if _explains_nothing(offsets, recursion):
                clock[STRIKES] = _MOST_STRIKES
            if clock[STRIKES] >= _MOST_STRIKES or _is_lost(knots.rows[k], recursion):
                _lose(recursion)
        else:
            at = _pass(times, at, now)
            if knots.usable[k] and clock[STARTED] == 0.0:
                _start_knot(k, knots, body, offsets, recursion, tuning)
            elif knots.usable[k]:
                _begin_knot(k, knots, offsets, recursion, tuning)
        if clock[RUNNING] > 0.0 and now >= clock[BLOCK_DUE]:
            _end_block(now, recursion, tuning)
            known_times[count], known[count] = knots.end[k], recursion.theta[: known.shape[1]]
            count += 1
    return at, count
