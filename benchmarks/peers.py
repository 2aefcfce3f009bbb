"""The step of the estimators as a user of filterpy and statsmodels would write it, for kernel_speed.py.

filterpy has the extended Kalman filter and asks for the model: here an error-state filter whose nominal state is kept
beside it, with the model functions in plain numpy. It has no iterated update: all iterations but the last need only a
gain, which is written here, and the last one is filterpy's own ``update`` with its Joseph form. The RecursiveLS of
statsmodels takes a whole series, one per axis; it has neither forgetting nor lagged sums, and only its recursion is
timed (its ``fit`` also smooths). The filter gives the numbers of ours: kernel_speed.py compares them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from filterpy.kalman import ExtendedKalmanFilter
from statsmodels.regression.recursive_ls import RecursiveLS

from aircraft_sysid_ros.reconstruction.state import Setup
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]

I3 = np.eye(3)


def skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rotation(q: Array) -> Array:
    w, v = q[0], q[1:]
    return (w * w - v @ v) * I3 + 2.0 * np.outer(v, v) + 2.0 * w * skew(v)


def quaternion_product(a: Array, b: Array) -> Array:
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def quaternion_exp(v: Array) -> Array:
    angle = np.sqrt(v @ v)
    s = np.sin(0.5 * angle) / angle if angle > 1e-5 else 0.5 - angle * angle / 48.0
    return np.array([np.cos(0.5 * angle), *(s * v)])


def right_jacobian(v: Array) -> Array:
    angle2, s = v @ v, skew(v)
    if angle2 < 1e-8:
        return I3 - 0.5 * s + s @ s / 6.0
    angle = np.sqrt(angle2)
    return I3 - (1.0 - np.cos(angle)) / angle2 * s + (angle - np.sin(angle)) / (angle2 * angle) * (s @ s)


class ErrorStateFilter(ExtendedKalmanFilter):
    """filterpy's filter over the error (18,) of a nominal state (19,), laid out as in reconstruction.state."""

    def __init__(self, nominal: Array, covariance: Array, setup: Setup, dt: float, iterations: int) -> None:
        super().__init__(dim_x=18, dim_z=3)
        self.nominal, self.x, self.P = nominal.copy(), np.zeros(18), covariance.copy()
        self.setup, self.dt, self.iterations = setup, dt, iterations

    # -- prediction: filterpy asks to override this for a model that is not linear ---------------------------

    def predict_x(self, u: Any = 0) -> None:
        """Nominal state over dt with the measured (force, rate) ``u``; sets F and Q."""
        x, dt, setup = self.nominal, self.dt, self.setup
        f, omega = u[0] - x[10:13], u[1] - x[13:16]
        gravity = np.array([0.0, 0.0, setup.gravity])
        begin, turn_half = rotation(x[6:10]), rotation(quaternion_exp(0.5 * dt * omega))
        attitude = quaternion_product(x[6:10], quaternion_exp(dt * omega))
        attitude /= np.sqrt(attitude @ attitude)
        half, end, back = begin @ turn_half, rotation(attitude), rotation(quaternion_exp(-dt * omega))
        step = dt * (half @ f + gravity)
        self.F = self._transition(x, f, omega, begin, turn_half, half, back)
        air = end.T @ (begin @ x[16:19] + step)
        self.nominal = np.concatenate([x[:3] + step, x[3:6] + dt * (x[:3] + 0.5 * step), attitude, x[10:16], air])
        self.Q = self._noise(end, air)

    def _transition(
        self, x: Array, f: Array, omega: Array, begin: Array, turn_half: Array, half: Array, back: Array
    ) -> Array:
        dt = self.dt
        turned, to_end, down = half @ skew(f), back @ turn_half, begin[2] * self.setup.gravity
        u_end = back @ (x[16:19] + dt * (turn_half @ f + down))
        by_rate = right_jacobian(dt * omega) * dt
        phi = np.eye(18)
        phi[0:3, 6:9], phi[0:3, 9:12], phi[0:3, 12:15] = -dt * turned @ turn_half.T, -dt * half, 0.5 * dt**2 * turned
        phi[3:6] += 0.5 * dt * phi[0:3]
        phi[3:6, 0:3] = dt * I3
        phi[6:9, 6:9], phi[6:9, 12:15] = back, -by_rate
        phi[15:18, 6:9], phi[15:18, 9:12], phi[15:18, 15:18] = dt * back @ skew(down), -dt * to_end, back
        phi[15:18, 12:15] = 0.5 * dt**2 * to_end @ skew(f) - skew(u_end) @ by_rate
        return phi

    def _noise(self, c: Array, air: Array) -> Array:
        setup, dt, arm = self.setup, self.dt, skew(air)
        force, rate = setup.accelerometer_variance * dt**2, setup.gyro_variance * dt**2
        q = np.zeros((18, 18))
        q[0:3, 0:3], q[6:9, 6:9] = force * I3, rate * I3
        q[9:12, 9:12], q[12:15, 12:15] = setup.accelerometer_walk**2 * dt * I3, setup.gyro_walk**2 * dt * I3
        q[15:18, 15:18] = (force + setup.wind_walk**2 * dt) * I3 + rate * arm @ arm.T
        q[0:3, 15:18], q[15:18, 0:3] = force * c, force * c.T
        q[15:18, 6:9], q[6:9, 15:18] = rate * arm, rate * arm.T
        return q

    # -- measurements ----------------------------------------------------------------------------------------

    def output(self, kind: Kind, x: Array, rate: Array) -> tuple[Array, Array]:
        """h(x) (m,) and H (m, 18) of the error about x."""
        if kind in (Kind.GPS_POSITION, Kind.GPS_VELOCITY):
            return self._gps(kind, x, rate)
        place = self.setup.probe_from_imu
        v = x[16:19] + np.cross(rate - x[13:16], place)
        uw2 = v[0] ** 2 + v[2] ** 2
        v2, uw = uw2 + v[1] ** 2, np.sqrt(uw2)
        if kind == Kind.AIRSPEED:
            value, g = np.sqrt(v2), v / np.sqrt(v2)
        elif kind == Kind.ANGLE_OF_ATTACK:
            value, g = np.arctan2(v[2], v[0]), np.array([-v[2], 0.0, v[0]]) / uw2
        else:
            value, g = np.arctan2(v[1], uw), np.array([-v[0] * v[1] / uw, uw, -v[2] * v[1] / uw]) / v2
        h = np.zeros((1, 18))
        h[0, 15:18], h[0, 12:15] = g, np.cross(g, place)
        return np.array([value]), h

    def _gps(self, kind: Kind, x: Array, rate: Array) -> tuple[Array, Array]:
        c, place, h = rotation(x[6:10]), self.setup.gps_from_imu, np.zeros((3, 18))
        if kind == Kind.GPS_POSITION:
            arm, state, h[:, 3:6] = place, x[3:6], I3
        else:
            arm, state, h[:, 0:3] = np.cross(rate - x[13:16], place), x[0:3], I3
            h[:, 12:15] = c @ skew(place)
        h[:, 6:9] = -c @ skew(arm)
        return state + c @ arm, h

    def retract(self, x: Array, delta: Array) -> Array:
        attitude = quaternion_product(x[6:10], quaternion_exp(delta[6:9]))
        attitude /= np.sqrt(attitude @ attitude)
        return np.concatenate([x[:6] + delta[:6], attitude, x[10:] + delta[9:]])

    def fuse(self, kind: Kind, values: Array, rate: Array) -> None:
        """Iterated update (3.15) with one measurement; the last iteration is filterpy's."""
        y, r = values, np.diag(self.setup.variance[kind][: len(values)])
        delta = np.zeros(18)
        for iteration in range(self.iterations):
            expected, h = self.output(kind, self.retract(self.nominal, delta), rate)
            if iteration:
                h[:, 6:9] = h[:, 6:9] @ right_jacobian(delta[6:9])
            total = y - expected + h @ delta
            if iteration < self.iterations - 1:
                ph = self.P @ h.T
                delta = ph @ np.linalg.solve(h @ ph + r, total)
        self.update(total, HJacobian=lambda _, h=h: h, Hx=lambda _: np.zeros(len(total)), R=r)
        jacobian = right_jacobian(self.x[6:9])
        self.P[6:9] = jacobian @ self.P[6:9]
        self.P[:, 6:9] = self.P[:, 6:9] @ jacobian.T
        self.nominal, self.x = self.retract(self.nominal, self.x), np.zeros(18)


def run_filterpy(
    n: int, every: tuple[int, ...], imu: Array, air: Array, fixes: Array, setup: Setup, x: Array, p: Array, dt: float
) -> tuple[Array, Array]:
    """n IMU samples as ``run`` of step.c; returns state (19,) and covariance (18, 18)."""
    ekf = ErrorStateFilter(x, p, setup, dt, setup.maximum_iterations)
    parts = ((Kind.AIRSPEED, 0), (Kind.ANGLE_OF_ATTACK, 1), (Kind.SIDESLIP, 2))
    for k in range(1, n + 1):
        rate = imu[k, 3:]
        if every[0] and k % every[0] == 0:
            middle = imu[k - 1] + 0.5 * (imu[k] - imu[k - 1])
            ekf.predict((middle[:3], middle[3:]))
        if every[1] and k % every[1] == 0:
            for kind, column in parts:
                ekf.fuse(kind, air[k, column : column + 1], rate)
        if every[2] and k % every[2] == 0:
            ekf.fuse(Kind.GPS_POSITION, fixes[k, :3], rate)
            ekf.fuse(Kind.GPS_VELOCITY, fixes[k, 3:], rate)
    return ekf.nominal, ekf.P


def run_statsmodels(terms: Array, measured: Array, offsets: npt.NDArray[np.int64]) -> list[Array]:
    """Recursive least squares of the six axes over rows of terms (n, parameters) and coefficients (n, 6)."""
    results = []
    for axis in range(6):
        model = RecursiveLS(measured[:, axis], terms[:, offsets[axis] : offsets[axis + 1]])
        results.append(model.filter(return_ssm=True).filtered_state[:, -1])
    return results
