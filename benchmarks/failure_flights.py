"""Missions without test inputs in which a control sticks or the engine fails, as a logger saw them.

The aeroplane is that of ``simulation.closed_loop``. What a stranger's log would hold is kept: mostly no vanes, an
IMU of 10 or 60 Hz, commands in place of deflections at 2.5 or 20 Hz, with airspeed or without. Everything is drawn
from the seed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.aircraft.earth import geodetic_along
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.samples import Kind, Samples, concatenate, samples_of
from aircraft_sysid_ros.sensors.sensor_models import stamps_of
from aircraft_sysid_ros.simulation.closed_loop import STEP, Reading, SteppedAeroplane

Array = npt.NDArray[np.float64]

AEROPLANES = ("ultra_stick_25e", "ultra_stick_120")
SHAPE = ("name", "mass", "wing_area", "span", "chord", "inertia")
DURATION = 130.0  # [s]
#: What fails: a surface that is recorded, one elevon of two, the engine, or nothing.
FAILURES = ("none", "elevon_left", "elevon_right", "elevator", "aileron", "rudder", "engine")
#: Before the name of a control that keeps part of its effect.
PART_OF = "part of "
_ELEVONS = {
    "CX": [1, "alpha", "alpha**2", "Tc"],
    "CY": [1, "beta", "p", "r", "elevon_left - elevon_right"],
    "CZ": [1, "alpha", "q", "elevon_left + elevon_right"],
    "Cl": [1, "beta", "p", "r", "elevon_left - elevon_right"],
    "Cm": [1, "alpha", "q", "elevon_left + elevon_right"],
    "Cn": [1, "beta", "p", "r", "elevon_left - elevon_right"],
}


@dataclass(frozen=True)
class Layout:
    """What a log holds."""

    imu: float  # [Hz]
    controls: float  # [Hz]
    airspeed: float  # [Hz]; 0: none
    elevons: bool  # as named inputs, in place of surfaces
    vanes: bool = False  # beside the airspeed


LAYOUTS = {
    "airspeed, 10 Hz": Layout(10.0, 2.5, 19.0, False),
    "airspeed, 50 Hz": Layout(50.0, 20.0, 10.0, False),
    "no airspeed, 60 Hz": Layout(60.0, 20.0, 0.0, True),
    "no airspeed, 25 Hz": Layout(25.0, 10.0, 0.0, False),
}
#: And one whose surfaces the library judges: of its engine, whose thrust nobody measures, the forces tell.
WITH_VANES = Layout(50.0, 20.0, 10.0, False, vanes=True)


@dataclass(frozen=True)
class FailureFlight:
    """A flight, the file that its user has, and the truth."""

    aircraft: Aircraft
    samples: Samples
    failure: str
    begin: float  # [s]; NaN: nothing fails
    end: float  # [s]; infinite: it does not work again
    share: float  # of its effect that a control keeps which fails in part


class _Pilot:
    """A mission: banks, climbs and speeds that are drawn, held by an autopilot with rate damping."""

    def __init__(self, known: Aircraft, plane: SteppedAeroplane, seed: int, duration: float) -> None:
        rng = np.random.default_rng([seed, 77])
        self._trim, self._delta = plane.setup.trim, bool(known.span < 1.5)
        steps = int(duration / STEP) + 1
        self.bank, self.height, self.speed = np.zeros(steps), np.zeros(steps), np.full(steps, self._trim.airspeed)
        at, circling = 0.0, rng.uniform() < 0.3
        while at < duration:
            length = rng.uniform(6.0, 22.0)
            part = slice(int(at / STEP), int((at + length) / STEP))
            self.bank[part] = (
                rng.uniform(0.3, 0.6) if circling else rng.choice([0.0, 0.0, -1.0, 1.0]) * rng.uniform(0.2, 0.7)
            )
            self.height[part] = rng.choice([0.0, 0.0, 15.0, -15.0]) * rng.uniform(0.3, 1.0)
            self.speed[part] = self._trim.airspeed * rng.uniform(0.95, 1.2)
            at += length
        kernel = np.ones(100) / 100.0
        self.bank = np.convolve(self.bank, kernel, mode="same")
        self.gains = rng.uniform(0.7, 1.3, 5)

    def command(self, k: int, reading: Array, seen: Array) -> Array:
        """Elevator, aileron, rudder [rad] and throttle."""
        roll, pitch, _ = euler_from_quaternion(reading[Reading.QUATERNION])
        p, q, r = reading[Reading.RATES]
        speed, climb = reading[Reading.AIR][0] + seen[0], -reading[Reading.VELOCITY][2]
        height = -reading[Reading.POSITION][2]
        g = self.gains
        slow = max(0.85 * self.speed[k] - speed, 0.0)  # the nose goes down before the wing stalls
        wanted = np.clip(0.03 * g[0] * (self.height[k] - height) - 0.03 * climb, -0.2, 0.2) - 0.05 * slow
        pitch_error = self._trim.alpha / max(np.cos(roll), 0.6) + wanted - pitch
        out = np.array(self._trim.controls, dtype=float)
        out[0] += -0.8 * g[1] * pitch_error + 0.15 * q
        out[1] += -0.5 * g[2] * (self.bank[k] - roll) + 0.08 * p
        out[2] += 0.1 * g[3] * (r - 9.81 * np.sin(roll) / max(speed, 5.0))
        out[3] += 0.05 * g[4] * (self.speed[k] - speed) + 1.5 * wanted
        limits = 0.4
        return np.array([*np.clip(out[:3], -limits, limits), np.clip(out[3], 0.0, 1.0)])


def really(failure: str, commands: Array, held: Array, share: float) -> Array:
    """What moves, of commands (4,), while a failure holds a control where it was, ``held`` (4,).

    A control whose name begins with ``part of`` makes a ``share`` of what it is told to.
    """
    out = commands.copy()
    if failure.startswith(PART_OF):
        failure = failure.removeprefix(PART_OF)
        held = share * commands
    names = {"elevator": 0, "aileron": 1, "rudder": 2}
    if failure in names:
        out[names[failure]] = held[names[failure]]
    elif failure == "engine":
        out[3] = 0.0
    elif failure.startswith("elevon"):
        left, right = commands[0] + commands[1], commands[0] - commands[1]
        stuck = held[0] + held[1] if failure == "elevon_left" else held[0] - held[1]
        left, right = (stuck, right) if failure == "elevon_left" else (left, stuck)
        out[0], out[1] = 0.5 * (left + right), 0.5 * (left - right)
    return out


def _put(failure: str, trim: npt.ArrayLike, seed: int) -> Array:
    """Where a test of failures puts the controls."""
    held = np.array(trim, dtype=float)
    if failure == "rudder":
        held[2] = 0.3 * (-1) ** seed
    return held


def fly(
    seed: int,
    layout: Layout,
    failure: str,
    duration: float = DURATION,
    turbulence: float | None = None,
    *,
    moved: bool = False,
    lasting: float | None = None,
    every: float = np.inf,
    spool: float = 0.0,
) -> FailureFlight:
    """One flight. ``moved``: what fails goes where a test puts it, the rudder to a side and all else to its trim.

    ``lasting`` [s]: how long it fails, else that is drawn; ``every`` [s]: it begins to fail so often. ``spool`` [s]:
    time constant with which the engine follows its command.
    """
    rng = np.random.default_rng([seed, 16])
    known = load_aircraft(config_path(str(rng.choice(AEROPLANES)) + ".yaml"))
    speed = known.trim_airspeed or 15.0
    heading, windy = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 0.35) * speed
    gusts = float(rng.choice([0.0, 2.0, 4.0])) if turbulence is None else turbulence
    wind = (windy * np.cos(heading), windy * np.sin(heading), 0.0)
    plane = SteppedAeroplane(known, seed, duration + 1.0, turbulence=gusts, wind=wind)
    pilot = _Pilot(known, plane, seed, duration + 2.0)
    begin, share = rng.uniform(0.3, 0.75) * duration, float(np.random.default_rng([seed, 5]).uniform(0.3, 0.6))
    end = begin + rng.uniform(8.0, 25.0) if rng.uniform() < 0.5 else np.inf
    end = begin + lasting if lasting is not None else end
    if failure == "none":
        begin = end = np.nan
    elif failure == "engine":
        end = np.inf
    count = int(duration / STEP)
    readings, commands, held = np.empty((count, Reading.WIDTH)), np.empty((count, 4)), np.zeros(4)
    gust = 0.3 * rng.standard_normal(count)
    throttle = float(plane.setup.trim.controls[3])
    for k in range(count):
        readings[k], _ = plane.look()
        commands[k] = pilot.command(k, readings[k], gust[k : k + 1])
        since = k * STEP - begin
        fails = 0.0 <= since % every < end - begin if since >= 0.0 else False
        if not fails:
            held = _put(failure, plane.setup.trim.controls, seed) if moved else commands[k]
        throttle += (commands[k, 3] - throttle) * (min(STEP / spool, 1.0) if spool > 0.0 else 1.0)
        done = np.array([*commands[k, :3], throttle])
        plane.advance(really(failure, done, held, share) if fails else done)
        if -readings[k, Reading.POSITION][2] < -70.0:  # on the ground
            readings, commands = readings[: k + 1], commands[: k + 1]
            break
    return FailureFlight(
        _users(known, layout), logged(plane.setup.origin, layout, readings, commands, rng), failure, begin, end, share
    )


def _users(known: Aircraft, layout: Layout) -> Aircraft:
    """Mass and shape, roughly, and which inputs there are."""
    source = {key: known.source[key] for key in SHAPE}
    if layout.elevons:
        source["inputs"] = {"elevon_left": {"unit": "rad"}, "elevon_right": {"unit": "rad"}}
        source["model"] = _ELEVONS
    return aircraft_from_dict(source)


def logged(
    origin: Array, layout: Layout, readings: Array, commands: Array, rng: np.random.Generator, step: float = STEP
) -> Samples:
    """Samples as a logger has them, of readings (n, Reading.WIDTH) every ``step`` [s] from an origin (3,)."""
    time = np.arange(len(readings)) * step

    def at(rate: float, values: Array, noise: npt.ArrayLike) -> tuple[npt.NDArray[np.int64], Array]:
        stamps = np.arange(rng.uniform(0.0, 1.0 / rate), time[-1], 1.0 / rate)
        shown = np.stack([np.interp(stamps, time, column) for column in values.T], axis=1)
        return stamps_of(stamps), shown + np.asarray(noise) * rng.standard_normal(shown.shape)

    noise = np.exp(rng.uniform(np.log(0.5), np.log(3.0), 4))
    parts = []
    imu = readings[:, :6] + np.array([*(0.15 * rng.standard_normal(3)), *(0.005 * rng.standard_normal(3))])
    stamp, values = at(layout.imu, imu, np.repeat([0.15 * noise[0], 0.008 * noise[1]], 3))
    parts.append(samples_of(Kind.IMU, stamp, values))
    stamp, values = at(min(layout.imu, 10.0), readings[:, Reading.QUATERNION], 0.005)
    parts.append(samples_of(Kind.ATTITUDE, stamp, values / np.linalg.norm(values, axis=1, keepdims=True)))
    stamp, values = at(5.0, readings[:, Reading.POSITION], 0.0)
    places = geodetic_along(values, origin)
    parts.append(samples_of(Kind.GPS_POSITION, stamp, places))
    stamp, values = at(5.0, readings[:, Reading.VELOCITY], 0.15 * noise[2])
    parts.append(samples_of(Kind.GPS_VELOCITY, stamp, values))
    if layout.airspeed:
        stamp, values = at(layout.airspeed, readings[:, Reading.AIR][:, :1], 0.3 * noise[3])
        parts.append(samples_of(Kind.AIRSPEED, stamp, values))
    if layout.vanes:
        stamp, values = at(layout.airspeed, readings[:, Reading.AIR][:, 1:3], np.radians(0.3) * noise[3])
        parts += [samples_of(k, stamp, values[:, j]) for j, k in enumerate((Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP))]
    stamp, values = at(layout.controls, commands, 0.0)
    unknown = np.full(len(stamp), np.nan)
    if layout.elevons:
        elevons = np.column_stack([values[:, 0] + values[:, 1], values[:, 0] - values[:, 1]])
        parts.append(samples_of(Kind.INPUTS, stamp, elevons))
        parts.append(samples_of(Kind.CONTROLS, stamp, *([unknown] * 4), values[:, 3], unknown, unknown))
    else:
        parts.append(samples_of(Kind.CONTROLS, stamp, values[:, :3], unknown, values[:, 3], unknown, unknown))
    joined = concatenate(parts)
    return joined[np.argsort(joined.stamp, kind="stable")]
