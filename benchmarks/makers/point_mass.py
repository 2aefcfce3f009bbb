"""Flights of a point mass with a known drag polar, as CSV: what ``polar`` is judged on.

Equations of its own: speed, climb and course follow from lift, drag, bank and a propulsion whose efficiency is
constant; up- and downdraughts come and go, steady wind carries. Sensors as a small autopilot logs them: IMU, attitude,
GPS, airspeed, static pressure, the power of a battery; neither vanes nor surfaces.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import yaml

GRAVITY, STEP = 9.80665, 0.02
#: Of the air in which it flies, at the height [m] where it begins: kg/m^3 and Pa, a summer's day.
HEIGHT, DENSITY, PRESSURE = 1500.0, 1.03, 84_556.0
LATITUDE, LONGITUDE, METRES = 48.0, 11.0, 111_319.5
#: Rates [Hz] of what is logged apart from the IMU.
RATES = {"attitude": 20.0, "gps": 5.0, "air": 5.0, "battery": 5.0}


def make(seed: int, folder: Path) -> dict[str, Any]:
    """Write one flight with its map and its aircraft file of mass and shape; what is true of it."""
    random = np.random.default_rng(seed)
    area = float(random.uniform(0.3, 2.0))
    loading = float(random.uniform(40.0, 120.0))  # [N/m^2]
    ratio = float(random.uniform(7.0, 14.0))
    truth = {
        "CD0": float(random.uniform(0.02, 0.07)), "k": float(1.0 / (np.pi * ratio * random.uniform(0.6, 0.95))),
        "efficiency": float(random.uniform(0.4, 0.75)), "idle": float(random.uniform(2.0, 10.0)),
        "gusts": float(random.uniform(0.05, 0.5)), "driven": bool(random.random() < 0.7),
    }  # fmt: skip
    mass = loading * area / GRAVITY
    flown = _flown(random, truth, mass, area, float(random.uniform(200.0, 420.0)))
    folder.mkdir(parents=True)
    _write(folder, random, flown, float(random.choice([20.0, 25.0, 50.0])))
    span = float(np.sqrt(ratio * area))
    plane = {
        "name": "point mass", "mass": round(mass, 3), "wing_area": round(area, 4), "span": round(span, 3),
        "chord": round(area / span, 4), "inertia": {"xx": 1.0, "yy": 1.0, "zz": 2.0},
        "inputs": {"electric_power": {"unit": "W"}},
    }  # fmt: skip
    (folder / "plane.yaml").write_text(yaml.safe_dump(plane), encoding="utf8")
    return truth


def _coloured(random: np.random.Generator, count: int, sigma: float, time: float) -> np.ndarray:
    """A first-order Gauss-Markov series."""
    keep = np.exp(-STEP / time)
    noise = random.normal(0.0, sigma * np.sqrt(1.0 - keep**2), count)
    out = np.empty(count)
    value = random.normal(0.0, sigma)
    for i in range(count):
        value = keep * value + noise[i]
        out[i] = value
    return out


def _flown(
    random: np.random.Generator, truth: dict[str, Any], mass: float, area: float, duration: float
) -> dict[str, np.ndarray]:
    """States at every step: the pilot asks for speeds, banks and power in turns."""
    count = round(duration / STEP)
    density = DENSITY
    stall = np.sqrt(2.0 * mass * GRAVITY / (density * area * 1.6))
    best = np.sqrt(2.0 * mass * GRAVITY / (density * area) * np.sqrt(truth["k"] / truth["CD0"]))
    legs = int(duration / 20.0) + 1
    wanted = np.repeat(random.uniform(1.15 * stall, 1.2 * stall + 1.1 * best, legs), round(20.0 / STEP))[:count]
    banks = np.repeat(np.where(random.random(legs) < 0.5, 0.0, random.uniform(-0.6, 0.6, legs)), round(20.0 / STEP))
    level = density * area * (truth["CD0"] + truth["k"]) * best**3 / truth["efficiency"]
    asked = random.choice([0.0, 0.5, 1.0, 1.8], legs) if truth["driven"] else np.zeros(legs)
    powers = np.repeat(asked * level, round(20.0 / STEP))[:count]
    updraught = _coloured(random, count, truth["gusts"], 3.0)
    names = ("V", "climb", "course", "bank", "alpha", "height", "north", "east", "normal", "along", "power")
    out = {name: np.empty(count) for name in names}
    speed, climb, course, bank, height, north, east = 1.5 * stall, 0.0, random.uniform(0, 6.2), 0.0, HEIGHT, 0.0, 0.0
    wind = random.normal(0.0, 2.5, 2)
    shaft, n = 0.0, 1.0
    for i in range(count):
        bank += STEP * np.clip(banks[i] - bank, -0.3, 0.3) / 0.5
        # the nose follows the speed that is wanted, by the energy that is there
        slope = np.clip(0.04 * (speed - wanted[i]), -0.18, 0.18)
        n += STEP / 0.4 * (np.clip((np.cos(climb) + 1.2 * (slope - climb)) / np.cos(bank), 0.4, 2.0) - n)
        dynamic = 0.5 * density * speed**2 * area
        lift = np.clip(n * mass * GRAVITY / dynamic, 0.02, 1.6)
        drag = dynamic * (truth["CD0"] + truth["k"] * lift**2)
        shaft += STEP / 0.5 * (powers[i] - shaft)
        thrust = truth["efficiency"] * shaft / speed
        along, normal = (thrust - drag) / mass, lift * dynamic / mass
        values = (speed, climb, course, bank, 0.02 + (lift - 0.4) / 5.0, height, north, east, normal, along,
                  shaft + truth["idle"])  # fmt: skip
        for name, value in zip(names, values, strict=True):
            out[name][i] = value
        speed += STEP * (along - GRAVITY * np.sin(climb))
        climb += STEP * (normal * np.cos(bank) - GRAVITY * np.cos(climb)) / speed
        course += STEP * normal * np.sin(bank) / (speed * np.cos(climb))
        height += STEP * (speed * np.sin(climb) + updraught[i])
        north += STEP * (speed * np.cos(climb) * np.cos(course) + wind[0])
        east += STEP * (speed * np.cos(climb) * np.sin(course) + wind[1])
    return {**out, "updraught": updraught, "wind_north": np.full(count, wind[0]), "wind_east": np.full(count, wind[1])}


def _write(folder: Path, random: np.random.Generator, f: dict[str, np.ndarray], rate: float) -> None:
    """CSV files of the sensors, and the map of their columns."""
    count = len(f["V"])
    pitch, roll, yaw = f["climb"] + f["alpha"], f["bank"], np.unwrap(f["course"])
    rates = [np.gradient(series, STEP) for series in (roll, pitch, yaw)]
    p = rates[0] - rates[2] * np.sin(pitch)
    q = rates[1] * np.cos(roll) + rates[2] * np.sin(roll) * np.cos(pitch)
    r = -rates[1] * np.sin(roll) + rates[2] * np.cos(roll) * np.cos(pitch)
    ax = f["along"] * np.cos(f["alpha"]) + f["normal"] * np.sin(f["alpha"])
    az = f["along"] * np.sin(f["alpha"]) - f["normal"] * np.cos(f["alpha"])
    noise = {name: random.normal(0.0, 1.0, count) for name in "abcdefghijklmnopq"}
    biases = random.normal(0.0, 1.0, 6)
    tables: dict[str, tuple[float, dict[str, np.ndarray]]] = {
        "imu": (rate, {
            "ax": ax + 0.1 * noise["a"] + 0.03 * biases[0], "ay": 0.1 * noise["b"] + 0.03 * biases[1],
            "az": az + 0.1 * noise["c"] + 0.03 * biases[2], "p": p + 0.005 * noise["d"] + 0.002 * biases[3],
            "q": q + 0.005 * noise["e"] + 0.002 * biases[4], "r": r + 0.005 * noise["f"] + 0.002 * biases[5],
        }),
        "attitude": (RATES["attitude"], {
            "roll": roll + 0.01 * noise["g"], "pitch": pitch + 0.01 * noise["h"], "yaw": yaw + 0.02 * noise["i"],
        }),
        "gps": (RATES["gps"], {
            "lat": LATITUDE + (f["north"] + 0.8 * noise["j"]) / METRES,
            "lon": LONGITUDE + (f["east"] + 0.8 * noise["k"]) / METRES / np.cos(np.radians(LATITUDE)),
            "alt": f["height"] + 1.5 * noise["l"],
            "vn": f["V"] * np.cos(f["climb"]) * np.cos(yaw) + f["wind_north"] + 0.1 * noise["m"],
            "ve": f["V"] * np.cos(f["climb"]) * np.sin(yaw) + f["wind_east"] + 0.1 * noise["n"],
            "vd": -f["V"] * np.sin(f["climb"]) - f["updraught"] + 0.15 * noise["o"],
        }),
        "air": (RATES["air"], {
            "tas": f["V"] + 0.3 * noise["p"], "rho": np.full(count, DENSITY),
            "pressure": PRESSURE - DENSITY * GRAVITY * (f["height"] - HEIGHT) + 3.0 * noise["q"],
        }),
        "battery": (RATES["battery"], {"watts": f["power"]}),
    }  # fmt: skip
    time = np.arange(count) * STEP
    for name, (hertz, columns) in tables.items():
        every = max(1, round(1.0 / (hertz * STEP)))
        with (folder / f"{name}.csv").open("w", encoding="utf8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["t", *columns])
            for i in range(0, count, every):
                writer.writerow([f"{time[i]:.3f}", *(f"{series[i]:.8f}" for series in columns.values())])
    (folder / "map.yaml").write_text(MAP, encoding="utf8")


MAP = """
tables:
  - file: imu.csv
    time: {column: t, unit: s}
    signals:
      specific_force.x: {column: ax, unit: m/s^2}
      specific_force.y: {column: ay, unit: m/s^2}
      specific_force.z: {column: az, unit: m/s^2}
      angular_velocity.x: {column: p, unit: rad/s}
      angular_velocity.y: {column: q, unit: rad/s}
      angular_velocity.z: {column: r, unit: rad/s}
  - file: attitude.csv
    time: {column: t, unit: s}
    signals:
      attitude.roll: {column: roll, unit: rad}
      attitude.pitch: {column: pitch, unit: rad}
      attitude.yaw: {column: yaw, unit: rad}
  - file: gps.csv
    time: {column: t, unit: s}
    signals:
      latitude: {column: lat, unit: deg}
      longitude: {column: lon, unit: deg}
      altitude: {column: alt, unit: m}
      velocity.north: {column: vn, unit: m/s}
      velocity.east: {column: ve, unit: m/s}
      velocity.down: {column: vd, unit: m/s}
  - file: air.csv
    time: {column: t, unit: s}
    signals:
      true_airspeed: {column: tas, unit: m/s}
      air_density: {column: rho, unit: kg/m^3}
      static_pressure: {column: pressure, unit: Pa}
  - file: battery.csv
    time: {column: t, unit: s}
    signals:
      inputs.electric_power: {column: watts, unit: W}
"""
