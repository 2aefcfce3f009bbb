"""Flights of the strips: gusts as a field in space, a pilot, and six degrees of freedom (Runge and Kutta).

Gusts are frozen waves, each perpendicular to its wave vector as in an incompressible flow, with von Kármán's energy;
wing tips, tail and nose meet different air. Earth is flat and does not rotate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from .aeroplane import Aeroplane, density_at, forces_of

Array = npt.NDArray[np.float64]

RATE, G, WAVES = 200.0, 9.80665, 60
#: Places of the state: velocity over ground in body axes, rates, quaternion, position (north, east, down), downwash.
_V, _W, _Q, _P, _E, _STATES = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13), 13, 14


@dataclass(frozen=True)
class Motion:
    """What happened, at ``time`` (n,)."""

    time: Array
    states: Array  # (n, 14)
    controls: Array  # (n, 4) elevator, aileron, rudder [rad], thrust as set [N]
    force: Array  # (n, 3) [m/s²] that an accelerometer at the centre of gravity feels
    turning: Array  # (n, 3) [rad/s²]
    wind: Array  # (n, 3) [m/s] north, east, down, at the centre of gravity

    def columns(self, part: slice) -> Array:
        """Columns of the states."""
        return self.states[:, part]


@njit(cache=True)
def rotation(q: Array) -> Array:
    """From body axes to north, east, down."""
    a, b, c, d = q[0], q[1], q[2], q[3]
    return np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
        ]
    )


def gust_field(rng: np.random.Generator, sigma: float, scale: float) -> Array:
    """Waves (WAVES, 7): wave vector, velocity [m/s], phase; of rms ``sigma`` [m/s] and length ``scale`` [m]."""
    k = np.exp(np.linspace(np.log(0.3 / scale), np.log(60.0 / scale + 3.0), WAVES)) * rng.uniform(0.95, 1.05, WAVES)
    energy = (1.339 * k * scale) ** 4 / (1.0 + (1.339 * k * scale) ** 2) ** (17.0 / 6.0) * k
    ways = rng.normal(size=(WAVES, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    across = np.cross(ways, rng.normal(size=(WAVES, 3)))
    across /= np.linalg.norm(across, axis=1)[:, None]
    size = sigma * np.sqrt(6.0 * energy / np.sum(energy))
    return np.column_stack([ways * k[:, None], across * size[:, None], rng.uniform(0.0, 2.0 * np.pi, WAVES)])


@njit(cache=True)
def _gusts_at(field: Array, place: Array, to_ned: Array, strips: Array, out: Array) -> None:
    """Gusts at the strips, in body axes."""
    out[:] = 0.0
    for k in range(len(field)):
        phase = field[k, 0] * place[0] + field[k, 1] * place[1] + field[k, 2] * place[2] + field[k, 6]
        body_wave, body_gust = to_ned.T @ field[k, 0:3], to_ned.T @ field[k, 3:6]
        for i in range(len(strips)):
            here = phase + body_wave[0] * strips[i, 0] + body_wave[1] * strips[i, 1] + body_wave[2] * strips[i, 2]
            out[i] += body_gust * np.cos(here)


@njit(cache=True)
def rates_of_change(
    x: Array, controls: Array, strips: Array, body: Array, inertia: Array, gusts: Array, wind: Array, change: Array
) -> tuple[Array, Array, Array]:
    """d/dt of the state (14,), specific force and angular acceleration. body: mass, area, chord, span, tail arm, thrust
    arm, airspeed at which a propeller pulls nothing, and height of the ground.
    """
    to_ned = rotation(x[6:10])
    air, rates = x[0:3] - to_ned.T @ wind, x[3:6]
    density = density_at(-x[12])
    pull, change = controls[3] * change[5], change.copy()
    change[7] *= pull / (0.5 * density * np.dot(air, air) * body[1])
    height = max(-x[12] - body[7], 0.5) / body[3]
    force, moment, made = forces_of(strips, air, rates, gusts, controls, change, x[13], density, height)
    mean = air.copy()
    for i in range(16):
        mean -= gusts[i] / 16.0
    speed = np.sqrt(np.dot(mean, mean))
    pressure = 0.5 * density * speed * speed * body[1]
    alpha, beta = np.arctan2(mean[2], mean[0]), np.arctan2(mean[1], mean[0])
    force[0] -= 0.010 * pressure
    force[1] -= 0.15 * beta * pressure
    moment[1] += 0.15 * body[2] * alpha * pressure
    moment[2] -= 0.01 * body[3] * beta * pressure
    moment += np.cross(np.array([change[6], 0.0, 0.0]), np.array([-0.01, -0.15 * beta, 0.0]) * pressure)
    force[0] += pull
    moment[1] += pull * body[5]
    felt = force / body[0]
    turning = np.linalg.solve(inertia, moment - np.cross(rates, inertia @ rates))
    d = np.empty(14)
    d[0:3] = felt + to_ned.T @ np.array([0.0, 0.0, G]) - np.cross(rates, x[0:3])
    d[3:6] = turning
    p, q, r = rates
    a, b, c, e = x[6], x[7], x[8], x[9]
    d[6:10] = 0.5 * np.array(
        [-p * b - q * c - r * e, p * a + r * c - q * e, q * a - r * b + p * e, r * a + q * b - p * c]
    )
    d[10:13] = to_ned @ x[0:3]
    d[13] = (made - x[13]) * max(speed, 1.0) / body[4]
    return d, felt, turning


@njit(cache=True)
def _fly(
    x: Array, plan: Array, changes: Array, stuck: Array, field: Array, wind: Array, strips: Array, body: Array,
    inertia: Array, trim: Array, full: float, cruise: float, lag: float, climb_gain: float,
) -> tuple[Array, Array, Array, Array, Array]:  # fmt: skip
    """plan (n, 7): bank, airspeed, height, additions to elevator, aileron, rudder, and whether the pilot lets go."""
    n, dt = len(plan), 1.0 / RATE
    states, used = np.empty((n, 14)), np.empty((n, 4))
    felt, turned, air = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    u, gusts = trim[:4].copy(), np.zeros((len(strips), 3))
    sum_pitch, sum_speed, sum_bank, held = 0.0, 0.0, 0.0, np.zeros(3)
    for k in range(n):
        to_ned = rotation(x[6:10])
        here = x[10:13] - wind * (k * dt)
        _gusts_at(field, here, to_ned, strips, gusts)
        d, felt[k], turned[k] = rates_of_change(x, u, strips, body, inertia, gusts, wind, changes[k])
        mean = np.zeros(3)
        for i in range(16):
            mean += gusts[i] / 16.0
        states[k], used[k], air[k] = x, u, wind + to_ned @ mean
        flow = x[0:3] - to_ned.T @ air[k]
        speed = np.sqrt(np.dot(flow, flow))
        bank, pitch = np.arctan2(to_ned[2, 1], to_ned[2, 2]), -np.arcsin(to_ned[2, 0])
        climb = -d[12]
        wanted = min(max((plan[k, 2] + x[12]) * climb_gain, -0.07 * cruise), 0.07 * cruise)
        nose = min(max(trim[4] + 1.2 * (wanted - climb) / cruise + sum_pitch, -0.25), 0.3)
        sum_pitch = min(max(sum_pitch + dt * 0.15 * (wanted - climb) / cruise, -0.25), 0.25)
        softer = min((cruise / speed) ** 2, 2.0)
        hold = (1.0 - 0.8 * plan[k, 6]) * softer
        sum_bank = min(max(sum_bank + dt * 0.15 * (plan[k, 0] - bank), -0.1), 0.1)
        slip = x[5] * np.cos(bank) - G / speed * np.sin(bank)
        beat = 2.0 * cruise / body[3]
        pull = trim[0] - hold * (nose - pitch - 0.35 * x[4] + 0.1 * bank * bank)
        u[0] += (min(max(pull + plan[k, 3], -0.4), 0.4) - u[0]) * lag
        turn = -hold * (0.5 * (plan[k, 0] - bank) + sum_bank - 1.6 * x[3] / beat)
        u[1] += (min(max(turn + plan[k, 4], -0.35), 0.35) - u[1]) * lag
        wash = hold * 3.0 * slip / beat
        if stuck[k, 1]:  # the rudder turns the aeroplane when the ailerons do not
            wash -= 0.6 * hold * (plan[k, 0] * 0.3 - bank - 1.5 * x[3] / beat)
        u[2] += (min(max(wash + plan[k, 5], -0.4), 0.4) - u[2]) * lag
        sum_speed = min(max(sum_speed + dt * 0.08 * (plan[k, 1] - speed) / cruise, -0.4), 0.6)
        throttle = trim[3] / full + 1.2 * (plan[k, 1] - speed) / cruise + sum_speed
        most = full * max(1.0 - 0.5 * speed / body[6], 0.1)
        u[3] += (min(max(throttle * full, 0.0), most) - u[3]) * dt / 0.4
        acting = u.copy()
        for j in range(3):  # a surface that sticks stays where it is; what is recorded is where it should be
            held[j] = held[j] if stuck[k, j] else u[j]
            acting[j] = held[j]
        k1 = rates_of_change(x, acting, strips, body, inertia, gusts, wind, changes[k])
        k2 = rates_of_change(x + 0.5 * dt * k1[0], acting, strips, body, inertia, gusts, wind, changes[k])[0]
        k3 = rates_of_change(x + 0.5 * dt * k2, acting, strips, body, inertia, gusts, wind, changes[k])[0]
        k4 = rates_of_change(x + dt * k3, acting, strips, body, inertia, gusts, wind, changes[k])[0]
        felt[k], turned[k] = k1[1], k1[2]
        x = x + dt / 6.0 * (k1[0] + 2.0 * k2 + 2.0 * k3 + k4)
        x[6:10] /= np.sqrt(np.dot(x[6:10], x[6:10]))
    return states, used, felt, turned, air


def body_of(plane: Aeroplane, ground: float) -> Array:
    """Numbers of the aeroplane that the equations of motion read."""
    fastest = 2.6 * plane.cruise
    return np.array(
        [plane.mass, plane.area, plane.chord, plane.span, plane.tail_arm, plane.thrust_arm, fastest, ground]
    )  # fmt: skip


def trimmed(plane: Aeroplane, body: Array, change: Array) -> tuple[Array, Array]:
    """State (14,) of straight and level flight in still air, and elevator, 0, 0, thrust, pitch."""
    from scipy.optimize import fsolve

    still, gusts = np.zeros(3), np.zeros((len(plane.strips), 3))

    def state(alpha: float, downwash: float) -> Array:
        x = np.zeros(_STATES)
        x[0], x[2] = plane.cruise * np.cos(alpha), plane.cruise * np.sin(alpha)
        x[6], x[8], x[12], x[13] = np.cos(alpha / 2), np.sin(alpha / 2), -plane.altitude, downwash
        return x

    def left(y: Array) -> Array:
        controls = np.array([y[1], 0.0, 0.0, y[2] * plane.thrust])
        d = rates_of_change(state(y[0], y[3]), controls, plane.strips, body, plane.inertia, gusts, still, change)[0]
        return np.array([d[0], d[2], d[4], d[13]])

    y, _, good, why = fsolve(left, [0.03, 0.0, 0.2, 0.03], full_output=True)
    if good != 1:
        raise ValueError(f"no trim: {why}")
    return state(y[0], y[3]), np.array([y[1], 0.0, 0.0, y[2] * plane.thrust, y[0]])


def smoothed(series: Array, time_constant: float) -> Array:
    """A series at RATE through a first-order lag."""
    from scipy.signal import lfilter

    if time_constant <= 0.0:
        return series
    k = 1.0 - np.exp(-1.0 / RATE / time_constant)
    start = (1.0 - k) * series[:1]
    return np.asarray(lfilter([k], [1.0, k - 1.0], series, axis=0, zi=start)[0])


def drawn_plan(rng: np.random.Generator, plane: Aeroplane, seconds: float, style: str, low: float) -> Array:
    """Bank, airspeed and height that the pilot wants, test inputs, and when he lets go: (n, 7). ``low``: height [m]."""
    n = int(seconds * RATE)
    time, plan = np.arange(n) / RATE, np.zeros((n, 7))
    plan[:, 1], plan[:, 2] = plane.cruise, plane.altitude
    begin = rng.uniform(4.0, 10.0)
    while begin < seconds:
        leg = rng.uniform(10.0, 30.0)
        at = (time >= begin) & (time < begin + leg)
        if rng.random() < (0.25 if style == "level" else 0.55):
            plan[at, 0] = rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.7)
        plan[at, 1] = plane.cruise * (1.0 if style == "level" else rng.choice([0.9, 0.95, 1.0, 1.0, 1.1, 1.2]))
        plan[at, 2] += plane.cruise * (0.0 if style == "level" else rng.choice([0.0, 0.0, 1.2, -1.2]))
        if low > 0.0:
            plan[at, 2] = plane.altitude - (low if rng.random() < 0.5 else 0.0)
        begin += leg
    plan[:, 0] = smoothed(plan[:, 0], 0.7)
    plan[:, 1:3] = smoothed(plan[:, 1:3], 5.0 if low > 0.0 else 2.5)
    unit = 0.12 * np.sqrt(plane.span) + 0.25
    shapes: Mapping[str, list[list[int]]] = {
        "level": [[1, -1], [1, 1, -1, -1]], "speeds": [[1, -1], [1, 1, 1, -1, -1, 1, -1]], "mission": [],
    }  # fmt: skip
    begin, number = 15.0, int(rng.integers(3))
    while shapes[style] and begin < seconds - 12.0:
        shape = shapes[style][int(rng.integers(len(shapes[style])))]
        size = rng.uniform(0.6, 1.1) * (0.06, 0.09, 0.11)[number % 3]
        for k, sign in enumerate(shape):
            plan[(time >= begin + k * unit) & (time < begin + (k + 1) * unit), 3 + number % 3] = sign * size
        plan[(time >= begin) & (time < begin + len(shape) * unit + 1.5), 6] = 1.0
        begin += len(shape) * unit + rng.uniform(4.0, 8.0)
        number += 1
    return plan


def flown(
    rng: np.random.Generator, plane: Aeroplane, setting: Mapping[str, Any], changes: Array, stuck: npt.NDArray[np.bool_]
) -> Motion:
    """A flight of ``setting``: seconds, style, gusts [m/s], wind. By sample: changes, and what sticks (n, 3)."""
    n, ground = len(changes), plane.altitude - setting["above_ground"]
    body, wind = body_of(plane, ground), np.array([*setting["wind"], 0.0])
    x, trim = trimmed(plane, body, changes[0])
    x[0:3] += rotation(x[6:10]).T @ wind
    field = gust_field(rng, setting["gusts"], max(30.0, min(plane.altitude, 300.0)))
    plan = drawn_plan(rng, plane, setting["seconds"], setting["style"], setting["low"])
    lag = 1.0 - np.exp(-1.0 / RATE / (0.04 if plane.span < 5.0 else 0.07))
    arrays = _fly(
        x, plan, changes, stuck, field, wind, plane.strips, body, plane.inertia, trim, plane.thrust, plane.cruise,
        float(lag), 0.25 if plane.span < 5.0 else 0.12,
    )  # fmt: skip
    if not np.all(np.isfinite(arrays[0])) or np.max(np.abs(arrays[0][:, _W])) > 6.0:
        raise ValueError("the aeroplane was lost")
    return Motion(np.arange(n) / RATE, *arrays)
