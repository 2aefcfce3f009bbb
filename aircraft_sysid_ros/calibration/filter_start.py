"""What the filter of the first step may start with: a calibration of the air data, or stage 1 on the first minute.

The two-stage paper, section II.C: "one can use the first stage of the proposed algorithm to estimate an initial
condition with a small batch of data for an EKF or Iterated-EKF filter", and xi' = 0 as the time update of what is
constant. Errors of V, alpha and beta are states of the filter with ``StateOptions.air_data_errors``. The paper and its
numbers: docs/references.md.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.calibration.calibration_file import AIR_DATA_ERRORS, COMPATIBILITY, FIVE_HOLE, Calibration
from aircraft_sysid_ros.calibration.five_hole_probe import NAMES1, NAMES2, ProbeData
from aircraft_sysid_ros.calibration.navigation import Grid, Navigation, common_grid, navigate, require, series
from aircraft_sysid_ros.calibration.procedure import SAMPLES, Answer, reduced_problem, residuals
from aircraft_sysid_ros.calibration.segments import LEAST_TURN, SHORTEST, turned_through
from aircraft_sysid_ros.calibration.standard_errors import AttitudeErrors, standard_errors
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.two_stage.conditions import Conditions
from aircraft_sysid_ros.estimation.two_stage.optimisation import residual_noise
from aircraft_sysid_ros.estimation.two_stage.problem import Problem
from aircraft_sysid_ros.estimation.two_stage.residual_sampling import Progress, candidates, sample_residuals
from aircraft_sysid_ros.estimation.two_stage.sampling import Prior
from aircraft_sysid_ros.reconstruction.air_data_errors import UNKNOWN_STD, StartValues
from aircraft_sysid_ros.reconstruction.drift import SENSORS, Drift
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.stamps import NANOSECONDS

Array = npt.NDArray[np.float64]

#: A batch is no longer than this [s].
LONGEST = 600.0


def covariance_of(answer: Answer) -> Array:
    """Covariance (6, 6) of AIR_DATA_ERRORS by a calibration; what was not determined is as of an unknown sensor."""
    at = [answer.problem.names.index(name) for name in AIR_DATA_ERRORS]
    known = answer.determined[at]
    covariance = np.where(np.outer(known, known), answer.errors.coloured[np.ix_(at, at)], 0.0)
    return np.asarray(covariance + np.diag(np.where(known, 0.0, UNKNOWN_STD**2)))


def start_of_calibration(calibration: Calibration) -> StartValues:
    """Errors that a calibrated sensor still has: none, with the covariance that the calibration left.

    What the sensor shows is then y = (1 + lambda) y_raw + b of (36), or y = (y_raw - b) / (1 + lambda) of (B6), and
    small errors of lambda and b are d(lambda) / (1 + lambda) and d(b) - b d(lambda) / (1 + lambda) in y, or minus
    d(lambda) / (1 + lambda) and minus d(b) / (1 + lambda). Wind is another one each day, and so are biases of the IMU.
    """
    start = StartValues()
    covariance = _by_file(calibration)
    if covariance is None:
        return start
    whole = start.covariance.copy()
    whole[3:, 3:] = covariance
    return replace(start, covariance=whole)


def _by_file(calibration: Calibration) -> Array | None:
    probe = calibration.five_hole_probe
    section = probe or calibration.compatibility
    if not section:
        return None
    std = calibration.std.get(FIVE_HOLE if probe else COMPATIBILITY, {})
    variance = np.array([std.get(name, unknown) for name, unknown in zip(AIR_DATA_ERRORS, UNKNOWN_STD, strict=True)])
    covariance = np.diag(variance**2)
    if probe and calibration.probe_covariance is not None:
        covariance = np.array(calibration.probe_covariance)
    moves = np.zeros((6, 6))
    for i in range(0, 6, 2):
        scale, offset = 1.0 + section[AIR_DATA_ERRORS[i]], section[AIR_DATA_ERRORS[i + 1]]
        block = [[1.0 / scale, 0.0], [-offset / scale, 1.0]] if probe else [[-1.0 / scale, 0.0], [0.0, -1.0 / scale]]
        moves[i : i + 2, i : i + 2] = block
    return np.asarray(moves @ covariance @ moves.T)


def start_by_stage_1(
    samples: Samples, aircraft: Aircraft, seconds: float, count: int = SAMPLES, seed: int = 0,
    progress: Progress | None = None,
) -> tuple[StartValues, int]:  # fmt: skip
    """Wind and errors of the air data by stage 1 on so many seconds of flight, and the stamp [ns] where these end.

    The best sample has an error of its own beside that of least squares: how far one Gauss-Newton step would go is
    added to the covariance, as its square. The mount of a probe is taken as known. Raises InputError where this part of
    the flight cannot tell wind from airspeed.
    """
    require(samples, (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP))
    end = _takeoff(samples, aircraft) + int(seconds * NANOSECONDS)
    data, grid, navigation = _batch(samples[samples.stamp <= end], aircraft)
    said = f"the first {seconds:g} s of flight"
    if len(grid.index) * grid.step < SHORTEST:
        raise InputError(f"{said} hold {len(grid.index) * grid.step:.0f} s that can be used and stage 1 needs "
                         f"{SHORTEST:.0f} s: give it a longer part")  # fmt: skip
    if turned_through(navigation, np.ones(len(navigation.time), dtype=bool)) < LEAST_TURN:
        raise InputError(f"{said} are straight, and wind and airspeed error cannot be told apart: give stage 1 a part "
                         "with a full circle, or leave it out")  # fmt: skip
    free = np.array([name != "eps_phi" for name in (*NAMES1, *NAMES2)])
    problem = reduced_problem(data.problem(), np.zeros(len(free)), free)
    drawn = Prior().samples(problem.bounds2, count, seed)
    judged, chosen = candidates(problem, sample_residuals(problem, drawn, progress), Conditions())
    xi = np.concatenate([judged.xi1[chosen[0]], judged.xi2[chosen[0]]])

    def by_attitude(at: Array) -> AttitudeErrors:
        return AttitudeErrors(grid.time, navigation.attitude_std, data.by_attitude(np.append(at, 0.0)))

    order = [problem.names.index(name) for name in (*NAMES1[2:], *AIR_DATA_ERRORS)]
    covariance = _covariance(problem, xi, grid, by_attitude(xi))
    return _with_what_is_usual(xi[order], covariance[np.ix_(order, order)]), end


def _covariance(problem: Problem, xi: Array, grid: Grid, attitude: AttitudeErrors) -> Array:
    xi1, xi2 = np.split(xi, [problem.n1])
    noise = residual_noise(problem, xi1, xi2)
    every = np.ones(len(xi), dtype=bool)
    found = standard_errors(problem, xi1, xi2, noise, grid.piece, every, attitude=attitude)
    a, _ = problem.evaluate(xi2)
    root = np.sqrt(noise)
    rows = (np.concatenate([a, problem.slopes(xi1, xi2)], axis=2) / root[:, None]).reshape(-1, len(xi))
    step = np.linalg.lstsq(rows, (residuals(problem, xi) / root).ravel())[0]
    return np.asarray(found.coloured + np.outer(step, step))


def _with_what_is_usual(values: Array, covariance: Array) -> StartValues:
    """Wind and errors (9,) with their covariance, joined with what is usual: what the flight does not tell stays so."""
    if not np.all(np.isfinite(covariance)):
        raise InputError("stage 1 cannot tell wind and errors of the air data apart in this part of the flight: give "
                         "it a longer one with circles and pitching, or leave it out")  # fmt: skip
    usual = StartValues()
    gain = np.linalg.solve((usual.covariance + covariance).T, usual.covariance.T).T
    joined = gain @ covariance
    mean = gain @ values
    return StartValues(mean[:3], mean[3:], 0.5 * (joined + joined.T))


def _takeoff(samples: Samples, aircraft: Aircraft) -> int:
    """Stamp [ns] at which the aircraft first moves as fast as it flies."""
    velocity = samples[samples.kind == Kind.GPS_VELOCITY]
    fast = np.linalg.norm(velocity.values[:, :3], axis=1) > 0.8 * aircraft.minimum_airspeed
    if not fast.any():
        raise InputError("the aircraft never flies in this recording: there is no part for stage 1")
    return int(velocity.stamp[fast].min())


def _batch(samples: Samples, aircraft: Aircraft) -> tuple[ProbeData, Grid, Navigation]:
    """(40) with V, alpha and beta as shown in the place of what pressures say."""
    whole, drift = navigate(samples, aircraft), Drift(aircraft)
    drift.since = float(whole.time[0])
    shown = []
    for kind, name in SENSORS.items():
        time, values = series(samples, kind, whole.epoch, 1, aircraft.sensors[name].delay)
        shown.append((time, drift.corrected(time, np.full(len(time), kind), values)))
    grid = common_grid(whole.time, *(time for time, _ in shown))
    navigation = whole.at(grid, shown[0][0])
    speed, alpha, beta = (grid.means(time, values)[:, 0] for time, values in shown)
    flies = speed > aircraft.minimum_airspeed
    navigation, grid = navigation[flies], grid[flies]
    arm = np.cross(navigation.rates, aircraft.air_data_position)
    data = ProbeData(navigation.velocity, navigation.rotation, arm, speed[flies], alpha[flies], beta[flies])
    return data, grid, navigation
