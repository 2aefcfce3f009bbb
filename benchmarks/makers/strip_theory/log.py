"""What the sensors of such a flight record, as CSV with a map, and the aircraft file that a new user writes.

Each logger has its own clock, sensors that smooth and round, an IMU away from the centre of gravity, a boom for the air
data, a GPS that is late, and an attitude with a slow error of its own, or none. Sideslip is not always measured.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from .aeroplane import Aeroplane
from .flight import RATE, Motion, rotation, smoothed

Array = npt.NDArray[np.float64]

RADIUS, FLATTENING = 6378137.0, 6.694379990e-3
#: Columns of the logs by table: signal of the map, unit, step of rounding.
COLUMNS = {
    "imu": [
        *((f"specific_force.{axis}", "m/s^2", 0.01) for axis in "xyz"),
        *((f"angular_velocity.{axis}", "deg/s", 0.03) for axis in "xyz"),
        *((f"attitude.{angle}", "deg", 0.05) for angle in ("roll", "pitch", "yaw")),
    ],
    "controls": [*((name, "deg", 0.05) for name in ("elevator", "aileron", "rudder", "flaps")), ("thrust", "N", 0.01)],
    "air": [
        ("true_airspeed", "m/s", 0.05), ("angle_of_attack", "deg", 0.05), ("sideslip", "deg", 0.05),
        ("pressure_altitude", "m", 0.3),
    ],
    "gps": [
        ("latitude", "deg", 0.0), ("longitude", "deg", 0.0), ("altitude", "m", 0.01),
        *((f"velocity.{way}", "m/s", 0.01) for way in ("north", "east", "down")),
    ],
}  # fmt: skip


def recorded(
    rng: np.random.Generator, folder: Path, plane: Aeroplane, motion: Motion, setting: Mapping[str, Any],
    sensors: Mapping[str, float], flaps: Array,
) -> None:  # fmt: skip
    """Write NAME.csv, map.yaml and plane.yaml. ``sensors``: what is wrong with them (``hidden.SENSORS``)."""
    folder.mkdir(parents=True, exist_ok=True)
    tables = {
        "imu": _imu(rng, plane, motion, setting, sensors),
        "controls": _controls(rng, motion, setting, flaps),
        "air": _air(rng, plane, motion, setting, sensors),
        "gps": _gps(rng, motion, setting),
    }
    described = []
    for name, (time, columns) in tables.items():
        listed = [column for column in COLUMNS[name] if column[0] in columns]
        steps = {signal: step for signal, _, step in listed}
        shown = [np.round(columns[s] / steps[s]) * steps[s] if steps[s] else columns[s] for s, _, _ in listed]
        with (folder / f"{name}.csv").open("w", newline="", encoding="utf8") as file:
            writer = csv.writer(file)
            writer.writerow(["time", *(signal for signal, _, _ in listed)])
            writer.writerows([f"{value:.9g}" for value in row] for row in zip(time, *shown, strict=True))
        signals = {signal: {"column": signal, "unit": unit} for signal, unit, _ in listed}
        described.append({"file": f"{name}.csv", "time": {"column": "time", "unit": "s"}, "signals": signals})
    (folder / "map.yaml").write_text(yaml.safe_dump({"tables": described}), encoding="utf8")
    shape: dict[str, Any] = {"name": f"stranger, {plane.name}"}
    numbers = {"mass": plane.mass * sensors["mass"], "wing_area": plane.area, "span": plane.span, "chord": plane.chord}
    inertia = {"xx": plane.inertia[0, 0], "yy": plane.inertia[1, 1], "zz": plane.inertia[2, 2]}
    inertia["xz"] = -plane.inertia[0, 2]
    shape |= {key: float(value) for key, value in numbers.items()}
    shape["inertia"] = {key: float(value) for key, value in inertia.items()}
    (folder / "plane.yaml").write_text(yaml.safe_dump(shape), encoding="utf8")


def _ticks(rng: np.random.Generator, end: float, rate: float) -> Array:
    """Times [s] of a clock with its own start and some jitter."""
    time = np.arange(rng.uniform(0.0, 1.0 / rate), end - 0.5, 1.0 / rate)
    return time + rng.uniform(0.0, 0.04 / rate, len(time))


def _at(motion: Motion, series: Array, time: Array) -> Array:
    return np.stack([np.interp(time, motion.time, column) for column in series.T], axis=1)


def _named(names: str, series: Array) -> dict[str, Array]:
    return dict(zip(names.split(), series.T, strict=True))


def _imu(
    rng: np.random.Generator, plane: Aeroplane, motion: Motion, setting: Mapping[str, Any], sensors: Mapping[str, float]
) -> tuple[Array, dict[str, Array]]:
    rates, n = motion.columns(slice(3, 6)), len(motion.time)
    arm = np.array(setting["imu_place"]) * plane.span
    force = motion.force + np.cross(motion.turning, arm) + np.cross(rates, np.cross(rates, arm))
    size = np.exp(rng.uniform(*np.log([[0.02, 0.0008], [0.12, 0.004]])))
    quick = np.sqrt(RATE / 100.0)
    smoothing = setting["smoothing"] + 0.3 / setting["rate"]
    force = smoothed(force + quick * size[0] * rng.normal(size=(n, 3)), smoothing) + 0.05 * rng.normal(size=3)
    rates = smoothed(rates + quick * size[1] * rng.normal(size=(n, 3)), smoothing) + 0.003 * rng.normal(size=3)
    time = _ticks(rng, motion.time[-1], setting["rate"])
    when = time - sensors["imu_delay"]
    columns = _named("specific_force.x specific_force.y specific_force.z", _at(motion, force, when))
    columns |= _named(
        "angular_velocity.x angular_velocity.y angular_velocity.z", np.degrees(_at(motion, rates, when))
    )  # fmt: skip
    if setting["attitude"]:
        turns = [rotation(q) for q in motion.columns(slice(6, 10))]
        roll = [np.arctan2(r[2, 1], r[2, 2]) for r in turns]
        yaw = np.unwrap([np.arctan2(r[1, 0], r[0, 0]) for r in turns])
        euler = np.degrees(np.stack([roll, [-np.arcsin(r[2, 0]) for r in turns], yaw], axis=1))
        waves = np.sin(2.0 * np.pi * motion.time[:, None] / rng.uniform(50.0, 150.0, 3) + rng.uniform(0.0, 6.0, 3))
        euler += rng.normal(size=3) * (0.2, 0.2, 0.6) + waves * rng.uniform(0.05, 0.4, 3)
        euler = _at(motion, euler, time)
        euler[:, 2] = np.mod(euler[:, 2], 360.0)
        columns |= _named("attitude.roll attitude.pitch attitude.yaw", euler)
    return time, columns


def _controls(
    rng: np.random.Generator, motion: Motion, setting: Mapping[str, Any], flaps: Array
) -> tuple[Array, dict[str, Array]]:
    time = _ticks(rng, motion.time[-1], setting["rate"])
    shown = np.degrees(np.column_stack([motion.controls[:, :3], flaps]))
    columns = _named("elevator aileron rudder flaps", _at(motion, shown, time) + 0.03 * rng.normal(size=(len(time), 4)))
    if not np.any(flaps):
        columns.pop("flaps")
    thrust = np.interp(time, motion.time, motion.controls[:, 3])
    return time, {**columns, "thrust": thrust * (rng.uniform(0.97, 1.03) + 0.004 * rng.normal(size=len(time)))}


def _air(
    rng: np.random.Generator, plane: Aeroplane, motion: Motion, setting: Mapping[str, Any], sensors: Mapping[str, float]
) -> tuple[Array, dict[str, Array]]:
    rates, boom = motion.columns(slice(3, 6)), np.array([setting["boom"] * plane.span, 0.0, 0.0])
    to_ned = np.array([rotation(q) for q in motion.columns(slice(6, 10))])
    air = motion.columns(slice(0, 3)) - np.einsum("nij,ni->nj", to_ned, motion.wind) + np.cross(rates, boom)
    flow = np.stack(
        [np.linalg.norm(air, axis=1), np.arctan2(air[:, 2], air[:, 0]), np.arctan2(air[:, 1], air[:, 0])], 1
    )
    time = _ticks(rng, motion.time[-1], min(setting["rate"], 25.0))
    late = time - sensors["air_delay"]
    seen = _at(motion, smoothed(flow, 0.2 / setting["rate"]), late)
    n, noise = len(time), np.exp(rng.uniform(np.log(0.0015), np.log(0.006)))
    elapsed = time / motion.time[-1]
    speed = seen[:, 0] * sensors["airspeed_scale"] + rng.uniform(0.006, 0.012) * plane.cruise * rng.normal(size=n)
    alpha = seen[:, 1] * sensors["alpha_scale"] + sensors["alpha_offset"] + sensors["alpha_drift"] * elapsed
    columns = {"true_airspeed": speed, "angle_of_attack": np.degrees(alpha + noise * rng.normal(size=n))}
    if setting["beta"]:
        columns["sideslip"] = np.degrees(seen[:, 2] + sensors["beta_offset"] + noise * rng.normal(size=n))
    height = -np.interp(time, motion.time, motion.states[:, 12])
    return time, {**columns, "pressure_altitude": height + 0.5 * rng.normal(size=n)}


def _gps(rng: np.random.Generator, motion: Motion, setting: Mapping[str, Any]) -> tuple[Array, dict[str, Array]]:
    to_ned = np.array([rotation(q) for q in motion.columns(slice(6, 10))])
    velocity = np.einsum("nij,nj->ni", to_ned, motion.columns(slice(0, 3)))
    time = _ticks(rng, motion.time[-1], 5.0)[1:]
    place = _at(motion, motion.columns(slice(10, 13)), time - setting["gps_delay"])
    velocity = _at(motion, velocity, time - setting["gps_delay"]) + 0.05 * rng.normal(size=(len(time), 3))
    place += np.cumsum(rng.normal(size=(len(time), 3)), axis=0) * 0.02 + 0.7 * rng.normal(size=(len(time), 3))
    sine = np.sin(np.radians(47.0))
    curved = 1.0 - FLATTENING * sine * sine
    north, east = RADIUS * (1.0 - FLATTENING) / curved**1.5 - place[:, 2], RADIUS / curved**0.5 - place[:, 2]
    columns = {
        "latitude": 47.0 + np.degrees(place[:, 0] / north),
        "longitude": 9.0 + np.degrees(place[:, 1] / (east * np.cos(np.radians(47.0)))),
        "altitude": -place[:, 2],
    }
    return time, {**columns, **_named("velocity.north velocity.east velocity.down", velocity)}
