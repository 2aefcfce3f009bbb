"""Missions of JSBSim's aeroplanes, without vanes and test inputs, in which a control sticks or the engine stops.

The same as failure_flights.py by another maker: the aerodynamics is tables that no model of ours has, an autopilot
holds bank, height and speed and damps the rates, and a logger keeps commands. Everything is drawn from the seed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from failure_flights import SHAPE, FailureFlight, Layout, logged, really

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.sensors.truth import Truth
from aircraft_sysid_ros.simulation.closed_loop import Reading
from aircraft_sysid_ros.simulation.jsbsim_flight import (
    MODELS,
    RATE,
    JsbsimSetup,
    OutOfControlError,
    fly_jsbsim,
    prepare_jsbsim,
)
from aircraft_sysid_ros.simulation.manoeuvres import Plan, level_plan
from aircraft_sysid_ros.simulation.wind import low_altitude_turbulence, wind_series

Array = npt.NDArray[np.float64]

DURATION = 150.0  # [s]
#: What a mission does: it holds one bank, or it turns, climbs and changes its speed now and then, or goes straight.
MISSIONS = ("circling", "legs", "straight")
#: Other aeroplanes of the JSBSim package that trim and fly, with the calibrated airspeed [kt] of the flight: none of
#: them is flown anywhere else in this project. Those that rules were made on, and those that judge.
KNOWN = {"pa28": 95.0, "DHC6": 130.0, "T37": 220.0, "737": 250.0, "F80C": 250.0, "Boeing314": 120.0}
STRANGERS = {
    "c172r": 95.0, "Camel": 70.0, "t6texan2": 180.0, "OV10": 170.0, "A320": 250.0, "B747": 280.0, "F4N": 300.0,
}  # fmt: skip
#: Where the IMU is, at most, from the centre of gravity [m], which the user does not say.
IMU_PLACE = 0.4
#: Share of its travel to which a test puts the rudder.
RUDDER_PUT = 0.5
#: Wind at 20 ft [m/s] of gusts that are none, light and more than light.
GUSTS = (0.0, 3.0, 6.0)
_RATES = tuple(f"velocities/{axis}-rad_sec" for axis in "pqr")
_MOST_LOST = 1.0  # [s] before an aeroplane is out of control its flight ends


def _mission(setup: JsbsimSetup, rng: np.random.Generator, time: Array) -> Plan:
    """References of the autopilot, all of them drawn."""
    plan, kind, at = level_plan(time, setup.trim.airspeed), str(rng.choice(MISSIONS)), 0.0
    side = rng.choice([-1.0, 1.0])
    while at < time[-1]:
        length = rng.uniform(8.0, 28.0)
        part = slice(int(at * RATE), int((at + length) * RATE))
        at += length
        if kind == "circling":
            plan.bank[part] = side * rng.uniform(0.2, 0.5)
        elif kind == "legs":
            plan.bank[part] = rng.choice([0.0, 0.0, -1.0, 1.0]) * rng.uniform(0.15, 0.6)
        plan.height[part] = rng.choice([0.0, 0.0, 1.0, -1.0]) * rng.uniform(8.0, 40.0)
        plan.airspeed[part] *= rng.choice([1.0, 1.0, rng.uniform(0.92, 1.12)])
    smooth = np.ones(int(RATE)) / RATE
    for values in (plan.bank, plan.height, plan.airspeed):
        values[:] = np.convolve(np.pad(values, len(smooth), mode="edge"), smooth, mode="same")[len(smooth) :][
            : len(time)
        ]
    return plan


class _Broken:
    """Hands the commands on to the aeroplane, with the rates fed back, until what fails holds one of them."""

    def __init__(
        self,
        per: Array,
        gains: Array,
        failure: str,
        times: tuple[float, float],
        share: float,
        count: int,
        put: Array | None = None,
    ) -> None:
        """``per`` (4,): what a whole command moves; ``gains`` (3,): answers to q, p and r [rad per rad/s].

        ``put`` (4,): the commands at which it is held, None: those of the moment.
        """
        self._per, self._gains, self._failure, self._times, self._share = per, gains, failure, times, share
        self._put, self._held = put, np.zeros(4)
        self.commands = np.zeros((count, 4))

    def __call__(self, executive: Any, i: int, wanted: Array) -> Array:
        """The commands (4,) of JSBSim that are set at step i."""
        p, q, r = (executive[name] for name in _RATES)
        wanted = wanted.copy()
        wanted[:3] += self._gains * np.array([q, p, r]) / self._per[:3]
        wanted = np.clip(wanted, [-1.0, -1.0, -1.0, 0.0], 1.0)
        self.commands[i] = wanted
        failed = self._times[0] <= i / RATE < self._times[1]
        if not failed:
            self._held = wanted if self._put is None else self._put
        return really(self._failure, wanted, self._held, self._share) if failed else wanted


def _readings(truth: Truth, imu: Array) -> Array:
    """Rows of Reading (n, WIDTH) of a flight, the IMU at a place (3,) [m] from the centre of gravity."""
    out = np.zeros((len(truth.time), Reading.WIDTH))
    turning = np.cross(truth.angular_acceleration, imu) + np.cross(truth.rates, np.cross(truth.rates, imu))
    out[:, Reading.FORCE], out[:, Reading.RATES] = truth.specific_force + turning, truth.rates
    out[:, Reading.AIR][:, :3] = np.column_stack([truth.airspeed, truth.alpha, truth.beta])
    out[:, Reading.POSITION], out[:, Reading.VELOCITY] = truth.position, truth.velocity
    out[:, Reading.QUATERNION] = truth.quaternion
    return out


def fly(
    seed: int, layout: Layout, failure: str, aeroplanes: Mapping[str, float] = MODELS, *, moved: bool = False
) -> FailureFlight:
    """One flight of an aeroplane of JSBSim, with the file of its user. Ends where it is lost.

    ``moved``: what fails goes where a test puts it, the rudder to a side and all else to its trim.
    """
    rng = np.random.default_rng([seed, 61])
    name = str(rng.choice(sorted(aeroplanes)))
    setup = prepare_jsbsim(name, aeroplanes[name])
    time = np.arange(int(DURATION * RATE)) / RATE
    plan = _mission(setup, rng, time)
    heading, windy = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 0.25) * setup.trim.airspeed
    gusts = rng.choice(GUSTS)
    mean = np.array([windy * np.cos(heading), windy * np.sin(heading), 0.0])
    turbulence = low_altitude_turbulence(250.0, gusts) if gusts else None
    wind = wind_series(rng, len(time), 1.0 / RATE, mean, 0.01, setup.trim.airspeed, turbulence)
    begin, share = rng.uniform(0.3, 0.75) * DURATION, rng.uniform(0.3, 0.6)
    lasting = rng.uniform(10.0, 25.0) if rng.random() < 0.4 and failure != "engine" else np.inf
    end = begin + lasting
    if failure == "none":
        begin = end = np.nan
    gains, imu = rng.uniform(0.0, 0.25, 3) * [1.0, 0.6, 1.0], rng.uniform(-IMU_PLACE, IMU_PLACE, 3)
    signs = -np.sign([setup.slopes.pitch_control, setup.slopes.roll_control, setup.slopes.yaw_control])
    per = setup.control_per_command
    put = setup.trim_commands + RUDDER_PUT * rng.choice([-1.0, 1.0]) * np.array([0.0, 0.0, failure == "rudder", 0.0])
    broken = _Broken(per, gains * signs, failure, (begin, end), share, len(time), put if moved else None)
    truth = _flown(setup, wind, plan, broken)
    commands = setup.trim.controls + (broken.commands[: len(truth.time)] - setup.trim_commands) * per
    users = aircraft_from_dict({key: setup.aircraft.source[key] for key in SHAPE})
    samples = logged(truth.origin, layout, _readings(truth, imu), commands, rng, 1.0 / RATE)
    return FailureFlight(users, samples, failure, begin, end, share)


def _flown(setup: JsbsimSetup, wind: Array, plan: Plan, broken: _Broken) -> Truth:
    """The flight, as long as it is one."""
    try:
        return fly_jsbsim(setup, wind, plan, adjust=broken)
    except OutOfControlError as error:
        lasts = round(error.time, 1) - _MOST_LOST
    return fly_jsbsim(setup, wind[: int(lasts * RATE)], plan, adjust=broken)
