"""What the loop of ``likelihood_recursion`` reads and changes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.recursive_maximum_likelihood import Scores
from aircraft_sysid_ros.flight_model.layout import OUTPUT_GROUPS, PROCESS_GROUPS
from aircraft_sysid_ros.identification.physical_bounds import physical_bounds
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Of a coefficient without physical bounds.
_UNKNOWN_RANGE = 40.0

# Numbers of Recursion.clock: time of the filters [s], 1 while they run, flight spent in the start [s], 1 when it is
# over, flight learnt from [s], when an attitude output and the end of a block of scores are due [s], losses of the
# filters in all and lately.
TIME, RUNNING, BEGUN, STARTED, LEARNT, ATTITUDE_DUE, BLOCK_DUE, RESTARTS, STRIKES = range(9)
CLOCK_SIZE = 9


class ImuEpochs(NamedTuple):
    """n averages of reconstructed states, at most rml_rate of them per second, ascending in time."""

    time: Array  # (n,) [s] mean of the samples in each
    end: Array  # (n,) [s] of its last sample
    usable: npt.NDArray[np.bool_]  # (n,) in flight, first step sound, all that the model reads is there
    imu: Array  # (n, 6) specific force and angular rate as measured
    inputs: Array  # (n, INPUT_SIZE) of flight_model.layout
    rows: Array  # (n, StateField.WIDTH) mean state
    history: Array  # (n, TERM + terms) mean of ``fill_history``


class Recursion(NamedTuple):
    """What the loop changes, besides what it needs to know of the q free parameters."""

    theta: Array  # (parameters,) all of flight_model.layout
    free: Integers  # (q,) which of them are estimated: the coefficients, the six biases of the IMU, the levels
    moves: Array  # (q,) of the finite differences
    start: Array  # (parameters,) theta before any data
    start_root: Array  # (q, q) and root of its covariance
    start_doubt: Array  # (q,) standard errors to add to those of the start
    low: Array  # (q,) no estimate leaves these bounds
    high: Array
    largest_step: Array  # (q,) per innovation
    root: Array  # (q, q) covariance = root root'
    thetas: Array  # (q + 1, parameters) of the bank
    states: Array  # (q + 1, 16)
    covariances: Array  # (q + 1, 15, 15)
    innovations: Array  # (q + 1, 18)
    variances: Array  # (q + 1, 18)
    scores: Scores
    last_learnt: Array  # (q,) [s]
    inputs: Array  # (INPUT_SIZE,) at clock[TIME]
    before: Array  # (2, TERM + terms) history of the newest two knots
    before_time: Array  # (2,)
    clock: Array  # (CLOCK_SIZE,)


class Tuning(NamedTuple):
    """Options of the loop."""

    largest_gap: float  # [s] between knots that is still integrated
    forgetting: float  # per row, after the early phase
    early_forgetting: float  # at the start of it
    early_time: float  # [s] in which the second becomes the first
    start_time: float  # [s] of equation error before the filters, at least
    longest_start: float  # [s] and at most: what has not moved by then is not waited for
    attitude_step: float  # [s] between attitude outputs
    block: float  # [s] of one block of scores
    score_forgetting: float  # per block
    score_start: float  # [s] of learning before scores count
    gyro_std: float  # [rad/s] of one knot


class Prior(NamedTuple):
    """What is known of the q free parameters before any data; see Recursion."""

    low: Array
    high: Array
    std: Array
    move: Array
    largest_step: Array


def prior_of(names: tuple[str, ...]) -> Prior:
    """Coefficients within half their physical range beyond it, IMU biases, logarithms of the noise levels."""
    bounds = np.array([physical_bounds(name) for name in names]).reshape(-1, 2)
    bounds = np.where(np.isfinite(bounds), bounds, [-_UNKNOWN_RANGE, _UNKNOWN_RANGE])
    span = bounds[:, 1] - bounds[:, 0]
    blocks = [np.stack([bounds[:, 0] - 0.5 * span, bounds[:, 1] + 0.5 * span, 0.25 * span, 1e-5 * span, 0.1 * span])]
    accelerometer, gyro = THRESHOLDS.largest_accelerometer_bias, THRESHOLDS.largest_gyro_bias
    for count, column in (
        (3, (-accelerometer, accelerometer, 1.0, 1e-5, 0.1)),
        (3, (-gyro, gyro, 0.1, 1e-6, 0.01)),
        (len(PROCESS_GROUPS), (np.log(0.001), np.log(10.0), 1.0, 1e-4, 0.2)),
        (len(OUTPUT_GROUPS), (np.log(0.2), np.log(10.0), 0.3, 1e-4, 0.2)),
    ):
        blocks.append(np.tile(np.array(column)[:, None], count))
    return Prior(*np.hstack(blocks))
