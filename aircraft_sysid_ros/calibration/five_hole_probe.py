"""Calibration of a five-hole probe in flight: (35)-(42) of the two-stage paper (docs/references.md).

Airspeed and angles of the probe, with q_c total minus static pressure and D the differences of opposite holes, (36):

    V = (1 + lambda_V) sqrt(2 q_c / rho) + b_V
    alpha = (1 + lambda_alpha) D_alpha / (K_alpha q_c) + b_alpha
    beta = (1 + lambda_beta) D_beta / (K_beta q_c) + b_beta

The wind triangle at the centre of gravity, (37), with V_5h = V (cos alpha cos beta, sin beta, sin alpha cos beta), the
mount C(eps_phi) of (38) about the longitudinal axis and the lever arm r of the probe:

    V_NED = C_b^n [ C(eps_phi) V_5h - omega x r ] + W

It is linear in xi1 = [lambda_V, b_V, W_N, W_E, W_D] and not in xi2 = [lambda_alpha, b_alpha, lambda_beta, b_beta,
eps_phi], (42). SI units and radians, FRD and NED. The zero of each differential pressure is taken from the recording
while the aircraft stands, if it does: (36) has none, and b_V can stand for it at one airspeed only.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import density_at
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.calibration.navigation import (
    Grid,
    Navigation,
    common_grid,
    in_span,
    navigate,
    require,
    series,
)
from aircraft_sysid_ros.calibration.procedure import SAMPLES, Answer, Task, refined, solve
from aircraft_sysid_ros.calibration.segments import Segments, find_segments
from aircraft_sysid_ros.calibration.standard_errors import AttitudeErrors
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.two_stage.conditions import Conditions
from aircraft_sysid_ros.estimation.two_stage.problem import Problem
from aircraft_sysid_ros.estimation.two_stage.residual_sampling import Progress
from aircraft_sysid_ros.samples import Kind, Samples

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Integers = npt.NDArray[np.int64]

NAMES1 = ("lambda_V", "b_V", "W_N", "W_E", "W_D")
NAMES2 = ("lambda_alpha", "b_alpha", "lambda_beta", "b_beta", "eps_phi")
UNITS = {"b_V": "m/s", "W_N": "m/s", "W_E": "m/s", "W_D": "m/s", "b_alpha": "rad", "b_beta": "rad", "eps_phi": "rad"}
#: Constraints of Table 6; those of the wind, which the paper refined after its first stage, are what may be flown in,
#: and for faster aircraft ``bounds1_of``.
BOUNDS1 = np.array([[-0.5, 0.5], [-5.0, 5.0], [-20.0, 20.0], [-20.0, 20.0], [-3.0, 3.0]])
BOUNDS2 = np.array([[-0.5, 0.5], [-0.0873, 0.0873], [-0.5, 0.5], [-0.0873, 0.0873], [-0.2618, 0.2618]])
#: Sensitivity [1/rad] of a usual probe head, 0.07 per degree: lambda_alpha and lambda_beta are relative to it.
SENSITIVITY = 3.9
#: What must be flown so that a parameter can be found.
EXCITED_BY = {
    "lambda_V": "wind circles and different airspeeds",
    "b_V": "different airspeeds, such as a slow and a fast wind circle or a pushover-pullup",
    "W_N": "wind circles",
    "W_E": "wind circles",
    "W_D": "a pushover-pullup and different airspeeds",
    "lambda_alpha": "a pushover-pullup or pitch chirps",
    "b_alpha": "turns to both sides and a pushover-pullup",
    "lambda_beta": "yaw chirps or rudder doublets",
    "b_beta": "wind circles",
    "eps_phi": "a pushover-pullup or pitch chirps, with sideslip",
}
#: The aircraft stands where it moves slower [m/s], and its zeros count from so many seconds of it on.
STANDING_SPEED, SHORTEST_STANDING = 1.0, 5.0
#: Residuals larger than so many times what the noise of the probe makes are the wind's.
STEADY = 4.0
#: What is averaged where the wind is not steady [s]: turns last longer, most gusts do not.
AVERAGE = 2.0
#: Median of the square of a standard normal variable.
_MEDIAN_SQUARE = 0.4549
#: A wind is never taken as nominal.
_WIND = ("W_N", "W_E")
#: Beyond this [rad] the linear law of (36) describes no probe.
LARGEST_ANGLE = 1.0


class Model(Protocol):
    """(40), or a richer model of the same data."""

    def problem(self) -> Problem:
        """Measurement equation."""

    def model(self, xi2: Array) -> tuple[Array, Array]:
        """A (n, 3, n1) and b (n, 3)."""

    def gradient(self, xi2: Array) -> tuple[Array, Array]:
        """dA/dxi2 (n, 3, n1, n2) and db/dxi2 (n, 3, n2)."""

    def instruments(self, xi: Array) -> Array:
        """d(A xi1 + b)/dxi (n, 3, n1 + n2) at pressures without noise."""

    def by_attitude(self, xi: Array) -> Array:
        """d(A xi1 + b)/de (n, 3, 3) by a small rotation e of the attitude in body axes."""


@dataclass(frozen=True)
class ProbeData:
    """What (40) needs at n instants: navigation at the centre of gravity and pressures of the probe."""

    velocity: Array  # (n, 3) V_NED [m/s]
    rotation: Array  # (n, 3, 3) C_b^n
    arm: Array  # (n, 3) omega x r [m/s], body axes
    indicated: Array  # (n,) sqrt(2 q_c / rho) [m/s]
    alpha_ratio: Array  # (n,) D_alpha / (K_alpha q_c) [rad]
    beta_ratio: Array  # (n,) [rad]

    def __getitem__(self, keep: Mask | slice) -> ProbeData:
        columns = (self.velocity, self.rotation, self.arm, self.indicated, self.alpha_ratio, self.beta_ratio)
        return ProbeData(*(column[keep] for column in columns))

    def angles(self, xi2: Array) -> tuple[Array, Array]:
        """alpha and beta (n,) [rad] of (36), in axes of the probe."""
        alpha = (1.0 + xi2[0]) * self.alpha_ratio + xi2[1]
        return alpha, (1.0 + xi2[2]) * self.beta_ratio + xi2[3]

    def model(self, xi2: Array) -> tuple[Array, Array]:
        """A (n, 3, 5) and b (n, 3) of (40)."""
        direction = self._turned(_direction(*self.angles(xi2)), xi2[4])
        indicated = self.indicated[:, None]
        wind = np.broadcast_to(np.eye(3), self.rotation.shape)
        a = np.concatenate([(direction * indicated)[:, :, None], direction[:, :, None], wind], axis=2)
        return a, direction * indicated - np.einsum("nij,nj->ni", self.rotation, self.arm)

    def gradient(self, xi2: Array) -> tuple[Array, Array]:
        """dA/dxi2 (n, 3, 5, 5) and db/dxi2 (n, 3, 5): only F of (41) depends on xi2."""
        alpha, beta = self.angles(xi2)
        by_alpha, by_beta = _direction_gradient(alpha, beta)
        columns = [
            self._turned(by_alpha * self.alpha_ratio[:, None], xi2[4]),
            self._turned(by_alpha, xi2[4]),
            self._turned(by_beta * self.beta_ratio[:, None], xi2[4]),
            self._turned(by_beta, xi2[4]),
            np.einsum("nij,jk,nk->ni", self.rotation, mount_gradient(xi2[4]), _direction(alpha, beta)),
        ]
        by_xi2 = np.stack(columns, axis=2)
        da = np.zeros((len(alpha), 3, len(NAMES1), len(NAMES2)))
        da[:, :, 0] = by_xi2 * self.indicated[:, None, None]
        da[:, :, 1] = by_xi2
        return da, by_xi2 * self.indicated[:, None, None]

    def predicted(self, xi1: Array, xi2: Array) -> ProbeData:
        """The data with what the probe would show without noise in the flow that (37) predicts: (36) turned round."""
        flow = np.einsum("nji,nj->ni", self.rotation, self.velocity - xi1[2:]) + self.arm
        u, v, w = (flow @ mount_matrix(xi2[4])).T
        speed = np.sqrt(u * u + v * v + w * w)
        return replace(
            self,
            indicated=(speed - xi1[1]) / (1.0 + xi1[0]),
            alpha_ratio=(np.arctan2(w, u) - xi2[1]) / (1.0 + xi2[0]),
            beta_ratio=(np.arcsin(v / speed) - xi2[3]) / (1.0 + xi2[2]),
        )

    def instruments(self, xi: Array) -> Array:
        """d(A xi1 + b)/dxi (n, 3, 10) at pressures without noise, for ``procedure.refined``."""
        xi1, xi2 = xi[: len(NAMES1)], xi[len(NAMES1) :]
        exact = self.predicted(xi1, xi2)
        a, _ = exact.model(xi2)
        da, db = exact.gradient(xi2)
        return np.concatenate([a, np.einsum("nmij,i->nmj", da, xi1) + db], axis=2)

    def by_attitude(self, xi: Array) -> Array:
        """d(A xi1 + b)/de (n, 3, 3) by a small rotation e of the attitude in body axes."""
        flow = np.einsum("nji,nj->ni", self.rotation, self._over_air(xi))
        return -np.stack([np.einsum("nij,nj->ni", self.rotation, np.cross(flow, axis)) for axis in np.eye(3)], axis=2)

    def _over_air(self, xi: Array) -> Array:
        a, b = self.model(xi[len(NAMES1) :])
        return np.asarray(a[:, :, :2] @ xi[:2] + b)

    def problem(self) -> Problem:
        """Measurement equation (40) with the bounds of Table 6."""
        return Problem(
            self.velocity, self.model, NAMES1, NAMES2, bounds1_of(self.velocity), BOUNDS2, gradient=self.gradient
        )

    def _turned(self, vectors: Array, mount: float) -> Array:
        """Vectors (n, 3) in axes of the probe to NED."""
        return np.asarray(np.einsum("nij,jk,nk->ni", self.rotation, mount_matrix(mount), vectors))


def bounds1_of(velocity: Array) -> Array:
    """BOUNDS1 with a wind that may be as fast as the aircraft ever was over ground, at velocities NED (n, 3) [m/s]."""
    fastest = float(np.max(np.hypot(velocity[:, 0], velocity[:, 1])))
    out = BOUNDS1.copy()
    out[2:4] = np.array([-1.0, 1.0]) * max(BOUNDS1[2, 1], fastest)
    return out


def mount_matrix(angle: float) -> Array:
    """C(eps_phi) of (38), (3, 3), from axes of the probe to body axes."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])


def mount_gradient(angle: float) -> Array:
    """dC/d eps_phi, (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[0.0, 0.0, 0.0], [0.0, -s, c], [0.0, -c, -s]])


def _direction(alpha: Array, beta: Array) -> Array:
    return np.stack([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)], axis=1)


def _direction_gradient(alpha: Array, beta: Array) -> tuple[Array, Array]:
    zero = np.zeros_like(alpha)
    by_alpha = np.stack([-np.sin(alpha) * np.cos(beta), zero, np.cos(alpha) * np.cos(beta)], axis=1)
    by_beta = np.stack([-np.cos(alpha) * np.sin(beta), np.cos(beta), -np.sin(alpha) * np.sin(beta)], axis=1)
    return by_alpha, by_beta


@dataclass(frozen=True)
class ProbeFlight:
    """The data of a flight for this calibration, its grid, what was flown, and the zeros (3,) [Pa] of the pressures."""

    data: ProbeData
    grid: Grid
    segments: Segments
    navigation: Navigation
    zeros: Array
    angle_noise: float  # [rad] of the angles in a bin, from what changes from sample to sample

    @property
    def probe_noise(self) -> float:
        """What the noise of the pressures makes of a velocity in a bin [m/s]."""
        return float(self.angle_noise * np.sqrt(np.mean(self.data.indicated**2)))

    def task(self, model: Model | None = None) -> Task:
        """Everything for ``procedure.solve`` in a steady wind, with instruments; ``model``: of the data, or (40)."""
        made = model or self.data
        return self._task(
            made.problem(), self.grid.piece, self._first, instruments=made.instruments,
            attitude=lambda xi: AttitudeErrors(self.grid.time, self.navigation.attitude_std, made.by_attitude(xi)),
        )  # fmt: skip

    def gusty_task(self, model: Model | None = None) -> Task:
        """The same where the wind is not steady: (40) averaged over AVERAGE seconds, by plain least squares.

        A gust is in the pressures and, as residual, in the wind triangle. That makes scales of angles too small, and
        instruments, which hold it too, make them too large. Averages of A, b and z keep manoeuvres and lose gusts.
        """
        made = model or self.data
        mean = _Averages(made, _blocks(self.grid.piece, max(round(AVERAGE / self.grid.step), 1)))
        problem = replace(
            made.problem(), measured=mean.of(self.data.velocity), model=mean.model, gradient=mean.gradient
        )
        first = np.asarray(np.all(self._first[mean.rows], axis=1))
        std, time = mean.of(self.navigation.attitude_std), mean.of(self.grid.time)

        def attitude(xi: Array) -> AttitudeErrors:
            return AttitudeErrors(time, std, mean.of(made.by_attitude(xi)))

        return self._task(problem, self.grid.piece[mean.rows[:, 0]], first, attitude=attitude)

    def _task(self, problem: Problem, piece: Integers, first: Mask, **more: Any) -> Task:
        kept = tuple(name for name in problem.names if name.startswith(_WIND))
        return Task(problem, piece, np.zeros(len(problem.names)), first, keep=kept, **more)

    @property
    def _first(self) -> Mask:
        return self.segments.first[self.segments.used]

    def solve(
        self, samples: int | Array = SAMPLES, seed: int = 0, progress: Progress | None = None, *,
        model: Model | None = None, conditions: Conditions | None = None,
    ) -> tuple[Answer, bool]:  # fmt: skip
        """The answer, and whether the wind was steady: residuals no larger than the probe's noise explains."""
        steady, gusty = (
            replace(task, conditions=conditions or Conditions()) for task in (self.task(model), self.gusty_task(model))
        )
        answer = solve(replace(steady, instruments=None), samples, seed, progress)
        if np.sqrt(np.mean(answer.noise)) <= STEADY * self.probe_noise:
            return refined(replace(answer, task=steady)), True
        return solve(gusty, samples, seed, progress), False


@dataclass(frozen=True)
class _Averages:
    """Equation (40) averaged over blocks of rows (blocks, width)."""

    data: Model
    rows: Integers

    def of(self, values: Array) -> Array:
        """Means (blocks, …)."""
        return np.asarray(values[self.rows].mean(axis=1))

    def model(self, xi2: Array) -> tuple[Array, Array]:
        """Means of A and b."""
        a, b = self.data.model(xi2)
        return self.of(a), self.of(b)

    def gradient(self, xi2: Array) -> tuple[Array, Array]:
        """Means of their derivatives."""
        da, db = self.data.gradient(xi2)
        return self.of(da), self.of(db)


def _blocks(piece: Integers, width: int) -> Integers:
    """Rows (blocks, width) of whole blocks within pieces."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(piece)) + 1, [len(piece)]])
    starts = [np.arange(i, j - width + 1, width) for i, j in itertools.pairwise(edges)]
    return np.asarray(np.concatenate(starts)[:, None] + np.arange(width))


def probe_flight(
    samples: Samples,
    aircraft: Aircraft,
    span: tuple[float, float] | None = None,
    sensitivity: tuple[float, float] = (SENSITIVITY, SENSITIVITY),
    zeros: Array | None = None,
) -> ProbeFlight:
    """Pressures and navigation on a common grid, where the aircraft flies.

    ``span``: seconds from the first sample of the recording; ``sensitivity``: K_alpha, K_beta [1/rad]; ``zeros`` (3,)
    [Pa] if known, else from where it stands. Raises InputError where a topic is missing or the flight is too short.
    """
    require(samples, (Kind.FIVE_HOLE,))
    whole = navigate(samples, aircraft)
    time, pressures = series(samples, Kind.FIVE_HOLE, whole.epoch, 4, aircraft.sensors["five_hole_probe"].delay)
    complete = np.all(np.isfinite(pressures), axis=1)
    if not complete.any():
        raise InputError("no sample of /five_hole_probe has all four pressures: this calibration needs them")
    time, pressures = time[complete], pressures[complete]
    zeros = pressure_zeros(samples, whole.epoch, time, pressures) if zeros is None else zeros
    new = np.append(True, np.any(np.diff(pressures, axis=0) != 0.0, axis=1))  # not held from the sample before
    time, pressures = time[new], pressures[new]
    grid = common_grid(whole.time, time)
    pressure = grid.means(time, pressures)
    pressure[:, 1:] -= zeros
    navigation = whole.at(grid, time)
    data = probe_data(navigation, pressure, aircraft.air_data_position, sensitivity)
    flying = is_flying(navigation, data, aircraft) & in_span(samples, navigation, span)
    segments = find_segments(navigation, flying, grid.step)
    used = segments.used
    noise = angle_noise(time, pressures, zeros, aircraft, sensitivity, grid.step)
    return ProbeFlight(data[used], grid[used], segments, navigation[used], zeros, noise)


def angle_noise(
    time: Array, pressures: Array, zeros: Array, aircraft: Aircraft, sensitivity: tuple[float, float], step: float
) -> float:
    """One sigma [rad] of the angles in a bin, the larger of both, from third differences of their samples in flight."""
    lowest = 0.5 * density_at(101325.0) * (0.5 * aircraft.minimum_airspeed) ** 2
    flow = pressures[:, 1] - zeros[0] > lowest
    impact = pressures[flow, 1] - zeros[0]
    angles = [(pressures[flow, 2 + i] - zeros[1 + i]) / (sensitivity[i] * impact) for i in (0, 1)]
    squares = [np.median(np.diff(angle, 3) ** 2) / (20.0 * _MEDIAN_SQUARE) for angle in angles]
    per_bin = max(step / float(np.median(np.diff(time))), 1.0)
    return float(np.sqrt(max(squares) / per_bin))


def is_flying(navigation: Navigation, data: ProbeData, aircraft: Aircraft) -> npt.NDArray[np.bool_]:
    """Where the flow is enough for angles (n,): half the least airspeed, since the scale is not known yet."""
    moving = np.linalg.norm(navigation.velocity, axis=1) > STANDING_SPEED
    attached = (np.abs(data.alpha_ratio) < LARGEST_ANGLE) & (np.abs(data.beta_ratio) < LARGEST_ANGLE)
    return np.asarray(moving & attached & (data.indicated > 0.5 * aircraft.minimum_airspeed))


def probe_data(navigation: Navigation, pressure: Array, arm: Array, sensitivity: tuple[float, float]) -> ProbeData:
    """Data of (40) from pressures (n, 4) [Pa], static and the three differences without their zeros."""
    density = density_at(np.where(pressure[:, 0] > 0.0, pressure[:, 0], np.nan))
    impact = np.where(pressure[:, 1] > 0.0, pressure[:, 1], np.nan)
    return ProbeData(
        navigation.velocity,
        navigation.rotation,
        np.cross(navigation.rates, arm),
        np.sqrt(2.0 * impact / density),
        pressure[:, 2] / (sensitivity[0] * impact),
        pressure[:, 3] / (sensitivity[1] * impact),
    )


def pressure_zeros(samples: Samples, epoch: int, time: Array, pressures: Array) -> Array:
    """Zeros (3,) [Pa] of dynamic, alpha and beta pressure: medians while the aircraft stands; 0 if it never does."""
    at, velocity = series(samples, Kind.GPS_VELOCITY, epoch, 3)
    slow = np.linalg.norm(velocity, axis=1) < STANDING_SPEED
    stands = np.interp(time, at, slow.astype(np.float64), left=0.0, right=0.0) == 1.0
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if stands.sum() * step < SHORTEST_STANDING:
        return np.zeros(3)
    return np.asarray(np.median(pressures[stands, 1:4], axis=0))
