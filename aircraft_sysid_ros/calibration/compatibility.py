"""Data compatibility: instrument errors that make IMU and air data contradict kinematics.

(B4)-(B8) of the two-stage paper (docs/references.md). Motion from the IMU, (B5), and outputs with errors, (B6):

    y = (1 + lambda_y) y_true + b_y,    y of V, alpha, beta, phi, theta, psi

linear in xi1 = [lambda, b], not in the IMU biases xi2, (B8). Biases are measured minus true here, as in (38) and
everywhere in this program; (B5) adds its b, which are the negative ones. b_psi is not among the unknowns: no equation
tells north, so that a wrong heading at the start and b_psi are the same.

The paper takes the states as known at the start. Here the flight is cut into pieces, and velocity and attitude at the
start of each are unknown too: corrections to the measured ones, of which the outputs are linear functions while they
are small. They are eliminated: measurements, A and b are projected on what no start of their piece can explain. From
the residuals of the answer follow the corrections; the starts are moved by them and the problem is solved once more.
The wind is steady within a piece.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.earth import gravity
from aircraft_sysid_ros.aircraft.frames import (
    euler_from_quaternion,
    quaternion_exp,
    quaternion_from_euler,
    quaternion_from_matrix,
    quaternion_product,
    rotation_matrix,
    velocity_from_air_data,
)
from aircraft_sysid_ros.calibration.kinematics import OUTPUTS, START, integrated_outputs
from aircraft_sysid_ros.calibration.navigation import (
    Grid,
    Navigation,
    common_grid,
    in_span,
    navigate,
    require,
    series,
    slowest,
)
from aircraft_sysid_ros.calibration.procedure import Answer, Task, solve
from aircraft_sysid_ros.calibration.segments import Segments, find_segments
from aircraft_sysid_ros.calibration.standard_errors import FEWEST_PIECES
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.two_stage.conditions import Conditions
from aircraft_sysid_ros.estimation.two_stage.problem import Problem
from aircraft_sysid_ros.estimation.two_stage.residual_sampling import Progress
from aircraft_sysid_ros.estimation.two_stage.sampling import Prior
from aircraft_sysid_ros.reconstruction.filter_setup import sensor_delays
from aircraft_sysid_ros.samples import Kind, Samples

Array = npt.NDArray[np.float64]

OUTPUT_NAMES = ("V", "alpha", "beta", "phi", "theta", "psi")
NAMES1 = (*(f"lambda_{y}" for y in OUTPUT_NAMES), *(f"b_{y}" for y in OUTPUT_NAMES[:-1]))
NAMES2 = ("b_ax", "b_ay", "b_az", "b_p", "b_q", "b_r")
UNITS = {
    "b_V": "m/s", **dict.fromkeys((f"b_{y}" for y in OUTPUT_NAMES[1:]), "rad"),
    **dict.fromkeys(NAMES2[:3], "m/s²"), **dict.fromkeys(NAMES2[3:], "rad/s"),
}  # fmt: skip
_SCALE, _ANGLE = [-0.3, 0.3], [-0.15, 0.15]
BOUNDS1 = np.array([_SCALE] * 6 + [[-5.0, 5.0]] + [_ANGLE] * 4)
BOUNDS2 = np.array([[-0.6, 0.6]] * 3 + [[-0.06, 0.06]] * 3)
#: Length of a piece [s]: noise and wind that are integrated must stay small against the errors that are looked for.
PIECE = 20.0
#: (17) and (18) cannot hold far from the answer: the motion that biases make grows with powers of time.
_ANY = Conditions(np.inf, np.inf, "none")
#: Biases of good sensors: zero is a good start here, as the paper says.
_PRIOR = Prior("normal", np.zeros(6), np.array([0.2] * 3 + [0.01] * 3))
#: One sigma of attitudes and biases that are taken as zero, in the order of NAMES1 and NAMES2: it is in the standard
#: errors of the others. Not of air data: what is found of one of their errors beside a zero holds with that zero.
_USUAL = np.array([0.0] * 3 + [0.02] * 3 + [0.0] * 3 + [0.02] * 2 + [0.2] * 3 + [0.01] * 3)
#: Step of the grid [s]: means of the outputs are outputs, and the noise is what matters.
_STEP = 0.2
#: Samples of stage 1: where it begins hardly matters here.
FEW_SAMPLES = 32
#: Residuals of the air data larger than so many times their noise are the wind's; means of bins have less noise.
STEADY = 1.0
#: Measurements where the IMU was silent for so many of its steps are left out, and bins so far from a measurement.
_HOLE = 3.5
#: Roll and heading, which go round, are left out so near [rad] to where they jump.
_ROUND, _NEAR_JUMP = [OUTPUT_NAMES.index("phi"), OUTPUT_NAMES.index("psi")], 0.35
#: Linearisations about the starts of the pieces.
_TURNS = 3
EXCITED_BY = {
    "lambda_V": "different airspeeds", "b_V": "turns and different airspeeds", "lambda_alpha": "pushover-pullups",
    "b_alpha": "turns to both sides and pushover-pullups", "lambda_beta": "rudder doublets or yaw chirps",
    "b_beta": "turns to both sides", "lambda_phi": "banked turns to both sides", "b_phi": "turns to both sides",
    "lambda_theta": "pushover-pullups", "b_theta": "turns and pushover-pullups", "lambda_psi": "whole turns",
    "b_ax": "turns and pitching", "b_ay": "turns to both sides", "b_az": "turns and pushover-pullups",
    "b_p": "longer pieces of flight", "b_q": "longer pieces of flight", "b_r": "longer pieces of flight",
}  # fmt: skip


@dataclass(frozen=True)
class CompatibilityData:
    """What (B7) needs: outputs in n bins, and the IMU between their first and last."""

    measured: Array  # (n, 6) V, alpha, beta, phi, theta, psi
    scale: Array  # (6,) in which the outputs are counted: their noise, so that stage 1 can add m/s to rad
    there: Array  # (n, 6) 1, or 0 where an output was not measured, or an angle is near where it jumps
    piece: npt.NDArray[np.int64]  # (n,) of the bins
    time: Array  # (k,) of the IMU [s]
    force: Array  # (k, 3) as measured
    rate: Array  # (k, 3)
    bins: npt.NDArray[np.int64]  # (k,)
    weights: Array  # (k, 6) with which the outputs then count in the means of their bin
    velocity0: Array  # (pieces, 3) air-relative at the start of each piece, NED [m/s]
    attitude0: Array  # (pieces, 4)
    arm: Array  # (3,) of the probe from the IMU [m]
    gravity: float
    start_slopes: tuple[Array, ...]  # (6 n_piece, 6) by piece: scaled outputs by the start, at biases that are believed

    @property
    def pieces(self) -> int:
        """Number of pieces."""
        return len(self.velocity0)

    def outputs(self, xi2: Array) -> Array:
        """V, alpha, beta, phi, theta, psi (n, 6) that follow from the IMU without its biases xi2 (6,)."""
        return self._integrated(xi2, False)[0]

    def slopes(self, xi2: Array) -> Array:
        """Derivatives (n, 6, 12) of the outputs by the start of the piece and by xi2."""
        return self._integrated(xi2, True)[1]

    def _integrated(self, xi2: Array, with_slopes: bool) -> tuple[Array, Array]:
        return integrated_outputs(
            self.time, self.force, self.rate, self.piece[self.bins], self.bins, self.weights, len(self.measured),
            self.velocity0, self.attitude0, xi2, self.arm, self.gravity, self.measured, with_slopes,
        )  # fmt: skip

    def model(self, xi2: Array) -> tuple[Array, Array]:
        """A (n, 6, 11) and b (n, 6) of (B7), each output divided by its scale, projected."""
        outputs = self.outputs(xi2) / self.scale
        each = np.arange(OUTPUTS)
        a = np.zeros((len(outputs), OUTPUTS, len(NAMES1)))
        a[:, each, each] = outputs
        a[:, each[:-1], OUTPUTS + each[:-1]] = 1.0 / self.scale[:-1]
        return self.projected(a), self.projected(outputs)

    def gradient(self, xi2: Array) -> tuple[Array, Array]:
        """dA/dxi2 (n, 6, 11, 6) and db/dxi2 (n, 6, 6), projected."""
        by_bias = self.slopes(xi2)[:, :, START:] / self.scale[:, None]
        each = np.arange(OUTPUTS)
        da = np.zeros((len(by_bias), OUTPUTS, len(NAMES1), len(NAMES2)))
        da[:, each, each] = by_bias
        return self.projected(da), self.projected(by_bias)

    def problem(self) -> Problem:
        """Measurement equation (B7) without the starts of the pieces."""
        measured = self.projected(self.measured / self.scale)
        return Problem(measured, self.model, NAMES1, NAMES2, BOUNDS1, BOUNDS2, gradient=self.gradient)

    def projected(self, rows: Array) -> Array:
        """Rows (n, 6, …) less what some start of their piece explains."""
        rows = rows * self.there.reshape(*self.there.shape, *(1,) * (rows.ndim - 2))
        out = np.empty_like(rows)
        for part, basis in zip(self._parts(), self._bases, strict=True):
            flat = rows[part].reshape(len(basis), -1)
            out[part] = (flat - basis @ (basis.T @ flat)).reshape(rows[part].shape)
        return out

    def refined(self, xi: Array | None) -> CompatibilityData:
        """The same with starts as the residuals at xi (17,) ask for, linearised about its biases; at first zero."""
        biases, starts = np.zeros(len(NAMES2)), np.zeros((self.pieces, START))
        if xi is not None:
            biases = xi[len(NAMES1) :]
            shown = self.outputs(biases) * (1.0 + xi[:OUTPUTS]) + np.append(xi[OUTPUTS : len(NAMES1)], 0.0)
            left = self.there * (self.measured - shown) / self.scale
            parts = zip(self._parts(), self.start_slopes, strict=True)
            starts = np.array([np.linalg.lstsq(slopes, left[part].ravel())[0] for part, slopes in parts])
        turned = [quaternion_product(quaternion_exp(e), q) for e, q in zip(starts[:, 3:], self.attitude0, strict=True)]
        moved = replace(self, velocity0=self.velocity0 + starts[:, :3], attitude0=np.array(turned))
        slopes = moved.slopes(biases)[:, :, :START] * (self.there / self.scale)[:, :, None]
        return replace(moved, start_slopes=tuple(slopes[part].reshape(-1, START) for part in self._parts()))

    def _parts(self) -> list[slice]:
        edges = np.searchsorted(self.piece, np.arange(self.pieces + 1))
        return [slice(int(i), int(j)) for i, j in itertools.pairwise(edges)]

    @cached_property
    def _bases(self) -> list[Array]:
        return [np.linalg.qr(slopes)[0] for slopes in self.start_slopes]


@dataclass(frozen=True)
class CompatibilityFlight:
    """The data of a flight for this calibration, its grid and what was flown."""

    data: CompatibilityData
    grid: Grid
    segments: Segments
    navigation: Navigation
    attitude_is_measured: bool

    def solve(
        self, samples: int = FEW_SAMPLES, seed: int = 0, progress: Progress | None = None
    ) -> tuple[Answer, CompatibilityData]:
        """Answer, and the data with the starts that it was found with."""
        data, answer, first = self.data, None, None
        for _ in range(_TURNS):
            data = data.refined(None if answer is None else answer.xi)
            task = Task(data.problem(), data.piece, np.zeros(len(NAMES1) + len(NAMES2)), by_piece=True,
                        conditions=_ANY, prior=_PRIOR, usual=_USUAL)  # fmt: skip
            answer = solve(task, samples if answer is None else answer.xi[None, len(NAMES1) :], seed, progress)
            first = first or answer
        assert answer is not None and first is not None
        alike = np.array_equal(first.determined, answer.determined)
        if alike and first.decision.unique and answer.decision.unique:
            # Later turns begin where the first ended: its samples alone tell whether there is another minimum.
            answer = replace(answer, samples=first.samples, decision=first.decision)
        return answer, data


def compatibility_flight(
    samples: Samples, aircraft: Aircraft, span: tuple[float, float] | None = None
) -> CompatibilityFlight:
    """IMU, air data and attitude on a common grid; without attitudes in the recording those of the navigation.

    Raises InputError where a topic is missing or the flight is too short.
    """
    require(samples, (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP))
    whole = navigate(samples, aircraft)
    air = [
        series(samples, kind, whole.epoch, 1, aircraft.sensors[sensor].delay)
        for kind, sensor in ((Kind.AIRSPEED, "airspeed"), (Kind.ANGLE_OF_ATTACK, "angle_of_attack"),
                             (Kind.SIDESLIP, "sideslip"))
    ]  # fmt: skip
    attitude_time, angles = _attitude(samples, aircraft, whole)
    imu_time, imu = series(samples, Kind.IMU, whole.epoch, 6, float(sensor_delays(aircraft)[Kind.IMU]))
    grid = common_grid(whole.time, imu_time, least=max(_STEP, slowest(*(time for time, _ in air), attitude_time)))
    navigation = whole.at(grid, imu_time)
    shown = [_shown(grid, imu_time, time, values) for time, values in air]
    shown.append(_shown(grid, imu_time, attitude_time, np.unwrap(angles, axis=0)))
    outputs, there = (np.concatenate([part[k] for part in shown], axis=1) for k in (0, 1))
    outputs[:, _ROUND] = (outputs[:, _ROUND] + np.pi) % (2.0 * np.pi) - np.pi
    weights = np.stack([part[2] for part in (*shown, shown[-1], shown[-1])], axis=1)
    flying = (outputs[:, 0] > aircraft.minimum_airspeed) & in_span(samples, navigation, span)
    flying &= np.isfinite(outputs).all(axis=1)
    segments = find_segments(navigation, flying, grid.step)
    used = segments.used
    place = float(gravity(whole.origin[0], whole.origin[2]))
    arm = aircraft.air_data_position - aircraft.imu_position
    noise = [aircraft.sensors[name].noise[0] for name in ("airspeed", "angle_of_attack", "sideslip", "attitude")]
    scale = np.array([*noise, noise[3], noise[3]])
    data = _data(grid[used], scale, outputs[used], there[used], weights, imu_time, imu, arm, place)
    if data.pieces < FEWEST_PIECES:
        raise InputError(f"the flight has {data.pieces} pieces of up to {PIECE:g} s without a gap, and standard errors "
                         f"need {FEWEST_PIECES}: give a longer recording or a wider span")  # fmt: skip
    measured = bool(np.any(samples.kind == Kind.ATTITUDE))
    return CompatibilityFlight(data, grid[used], segments, navigation[used], measured)


def _attitude(samples: Samples, aircraft: Aircraft, whole: Navigation) -> tuple[Array, Array]:
    """Times [s] (k,) and Euler angles (k, 3) of the recording, or else of the navigation."""
    time, quaternions = series(samples, Kind.ATTITUDE, whole.epoch, 4, aircraft.sensors["attitude"].delay)
    if len(time):
        return time, np.array([euler_from_quaternion(q) for q in quaternions])
    return whole.time, np.array([euler_from_quaternion(quaternion_from_matrix(c)) for c in whole.rotation])


def _shown(grid: Grid, imu_time: Array, time: Array, values: Array) -> tuple[Array, Array, Array]:
    """Means (n, m) in the bins of what was measured (k, m) at times (k,), and 1 where something was, else 0 (n, m).

    Between measurements the means are on straight lines, and NaN far from any. Weights (i,) are those of the IMU's
    samples, as the measurements lie among them: what follows from the IMU then has the means of the same instants.
    Straight lines between slow measurements had cut the peaks of doublets, which looked like a scale.
    """
    right = np.clip(np.searchsorted(imu_time, time), 1, len(imu_time) - 1)
    left, step = right - 1, np.diff(imu_time)
    share = (time - imu_time[left]) / np.maximum(step[left], 1e-9)
    near = (share > -1.0) & (share < 2.0) & (step[left] < _HOLE * np.median(step))
    row, inside = grid.place(imu_time)
    share = np.where(row[left] == row[right], np.clip(share, 0.0, 1.0), share > 0.5)
    nearest = np.where(share > 0.5, right, left)
    kept = near & inside[nearest]
    weights = np.zeros(len(imu_time))
    np.add.at(weights, left[kept], 1.0 - share[kept])
    np.add.at(weights, right[kept], share[kept])
    total, count = np.zeros((len(grid.index), values.shape[1])), np.zeros((len(grid.index), 1))
    np.add.at(total, row[nearest[kept]], values[kept])
    np.add.at(count, row[nearest[kept]], 1.0)
    after = np.clip(np.searchsorted(time, grid.time), 1, len(time) - 1)
    apart = np.minimum(np.abs(grid.time - time[after - 1]), np.abs(time[after] - grid.time))
    lines = np.stack([np.interp(grid.time, time, column) for column in values.T], axis=1)
    lines[apart > _HOLE * grid.step] = np.nan
    there = np.where(count > 0.0, np.ones(total.shape), 0.0)
    return np.where(there > 0.0, total / np.maximum(count, 1.0), lines), there, weights


def _data(
    grid: Grid, scale: Array, outputs: Array, measured_there: Array, weights: Array, imu_time: Array, imu: Array,
    arm: Array, place: float,
) -> CompatibilityData:  # fmt: skip
    piece = _pieces(grid)
    at, inside = grid.place(imu_time)
    time, measured, index = imu_time[inside], imu[inside], at[inside]
    first = np.array([np.argmax(piece[index] == number) for number in range(piece[-1] + 1)])
    velocity0, attitude0 = np.empty((len(first), 3)), np.empty((len(first), 4))
    for number, k in enumerate(first):
        speed, alpha, beta, *angles = outputs[index[k]]
        attitude0[number] = quaternion_from_euler(*angles)
        flow = velocity_from_air_data(speed, alpha, beta) - np.cross(measured[k, 3:6], arm)
        velocity0[number] = rotation_matrix(attitude0[number]) @ flow
    there = measured_there.copy()
    there[:, _ROUND] *= np.abs(outputs[:, _ROUND]) < np.pi - _NEAR_JUMP
    return CompatibilityData(
        outputs, scale, there, piece, time, measured[:, :3].copy(), measured[:, 3:6].copy(), index, weights[inside],
        velocity0, attitude0, np.asarray(arm, dtype=np.float64), place, (),
    )  # fmt: skip


def _pieces(grid: Grid) -> npt.NDArray[np.int64]:
    """Number (n,) of the piece of at most PIECE seconds that a bin belongs to, without gaps inside."""
    gap = np.diff(grid.index, prepend=grid.index[:1]) > 1
    block = np.cumsum(gap)
    begin = np.concatenate([[0], np.flatnonzero(gap)])
    within = (grid.index - grid.index[begin[block]]) // round(PIECE / grid.step)
    new = np.diff(block, prepend=block[:1]) + np.diff(within, prepend=within[:1]) != 0
    return np.cumsum(new)
