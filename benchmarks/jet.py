"""A business jet at 10 Hz: what does the diagnosis say of flights that neither simulator of this project made?

    python benchmarks/jet.py [--seeds 101 102 …] [--jobs 2]

Equations of motion of its own, with a lag of the downwash, first-order gusts, a pilot, doublets and 3-2-1-1 at several
speeds. Recorded as flight-test systems do: everything at 10 Hz, one vane, an attitude with a constant error, values
rounded, biases. The table is read by ``import``, the aircraft file holds mass and shape. Of every four seeds one flight
is clean and calm, one clean in gusts, in one a passenger walks forward and back, in one the gear goes down and up. Each
flight is a line in results/jet.jsonl; a run that is stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import yaml
from resumed import flown

from aircraft_sysid_ros.aircraft.earth import geodetic_along
from aircraft_sysid_ros.commands.main import main as command

RESULTS = Path(__file__).parent / "results" / "jet.jsonl"
KINDS = ("calm", "gusts", "cg_shift", "landing_gear")
GRAVITY, STEP, DURATION = 9.80665, 0.02, 600.0
WIND = np.array([6.0, -9.0, 0.0])
ORIGIN = np.array([np.radians(52.0), np.radians(4.5), 0.0])
AMPLITUDES = {"elevator": np.radians(1.6), "rudder": np.radians(3.0), "aileron": np.radians(3.0)}
ORDER = ("elevator", "rudder", "aileron", "elevator", "elevator", "aileron", "rudder")
_DEG = "deg"
#: Column of the table, the signal that it is, unit, one sigma, bias and step of rounding, all in that unit.
COLUMNS = {
    "ax": ("specific_force.x", "m/s^2", 0.03, 0.05, 0.0), "ay": ("specific_force.y", "m/s^2", 0.03, -0.04, 0.0),
    "az": ("specific_force.z", "m/s^2", 0.05, 0.06, 0.0), "p": ("angular_velocity.x", "deg/s", 0.05, 0.02, 0.0),
    "q": ("angular_velocity.y", "deg/s", 0.05, -0.03, 0.0), "r": ("angular_velocity.z", "deg/s", 0.05, 0.01, 0.0),
    "roll": ("attitude.roll", _DEG, 0.1, 0.2, 0.02), "pitch": ("attitude.pitch", _DEG, 0.1, -0.15, 0.02),
    "heading": ("attitude.yaw", _DEG, 0.15, 0.5, 0.0), "tas": ("true_airspeed", "m/s", 0.25, 0.0, 0.03),
    "aoa": ("angle_of_attack", _DEG, 0.08, 0.0, 0.0), "alt": ("pressure_altitude", "m", 0.5, 0.0, 0.3),
    "de": ("elevator", _DEG, 0.02, 0.0, 0.0), "da": ("aileron", _DEG, 0.02, 0.0, 0.0),
    "dr": ("rudder", _DEG, 0.02, 0.0, 0.0), "thrust": ("thrust", "N", 30.0, 0.0, 0.0),
    "lat": ("latitude", _DEG, 1.4e-5, 0.0, 0.0), "lon": ("longitude", _DEG, 2.2e-5, 0.0, 0.0),
    "gps_alt": ("altitude", "m", 2.5, 0.0, 0.0), "vn": ("velocity.north", "m/s", 0.08, 0.0, 0.0),
    "ve": ("velocity.east", "m/s", 0.08, 0.0, 0.0), "vd": ("velocity.down", "m/s", 0.1, 0.0, 0.0),
}  # fmt: skip


class Jet:
    """The truth of one flight."""

    name, mass, area, chord, wing_span = "jet", 5900.0, 30.0, 2.0569, 15.911
    #: Share of m b², m c², m b² and m b² of the moments of inertia about x, y, z and of the product xz.
    inertia_of = (0.019, 1.3925, 0.042, 0.002)
    height, speed, density = 2800.0, 100.0, 0.9281
    every, duration, columns = 5, DURATION, COLUMNS
    leg = 45.0  # [s] of one speed and bank

    def __init__(self, kind: str, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.kind = kind
        begin = self.random.uniform(0.5, 0.6) * self.duration
        self.span = (begin, begin + self.random.uniform(0.1, 0.2) * self.duration)
        self.shift = self.random.uniform(0.04, 0.075)  # [m] of the centre of gravity, forward
        self.gusts = self._gusts(0.5 if kind == "gusts" else 0.0 if kind == "calm" else 0.2)
        self.events = []
        time = 25.0
        while time < self.duration - 15.0:
            shape = str(self.random.choice(["doublet", "3211"]))
            self.events.append((time, ORDER[len(self.events) % len(ORDER)], shape))
            time += self.random.uniform(13.0, 22.0)
        count = round(self.duration / self.leg) + 1
        self.banks, self.speeds = (
            self.random.choice([0.0, 0.0, 0.0, 0.3, -0.3], count),
            self.random.choice([85.0, 95.0, 105.0, 115.0], count),
        )
        xx, yy, zz, xz = self.moments()
        self.inertia = np.array([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])
        self.inverse = np.linalg.inv(self.inertia)

    def moments(self) -> np.ndarray:
        """Moments of inertia about x, y and z, and the product xz [kg m^2]."""
        return (
            np.array(self.inertia_of)
            * self.mass
            * np.array([self.wing_span, self.chord, self.wing_span, self.wing_span]) ** 2
        )

    def _gusts(self, sigma: float) -> np.ndarray:
        keep = np.exp(-STEP * self.speed / 500.0)
        gust, rows = np.zeros(3), []
        for _ in range(round(self.duration / STEP)):
            gust = keep * gust + sigma * np.array([1.0, 1.0, 0.8]) * np.sqrt(1.0 - keep**2) * self.random.normal(size=3)
            rows.append(gust)
        return np.array(rows)

    def coefficients(self, time: float, air: tuple[float, ...], rates: np.ndarray, controls: np.ndarray) -> np.ndarray:
        """C_X, C_Y, C_Z, C_l, C_m, C_n."""
        speed, alpha, beta, alpha_dot, tc = air
        p, r = rates[0] * self.wing_span / (2.0 * speed), rates[2] * self.wing_span / (2.0 * speed)
        q, lag = rates[1] * self.chord / speed, alpha_dot * self.chord / speed
        de, da, dr = controls
        c = np.array([
            -0.028 + 0.12 * alpha + 2.0 * alpha**2 - 0.0373 * de + 0.10 * q,
            -0.75 * beta - 0.0304 * p + 0.8495 * r - 0.04 * da + 0.23 * dr,
            -0.20 - 5.2 * alpha - 3.0 * q - 0.696 * de - 0.35 * lag,
            -0.1026 * beta - 0.71 * p + 0.2376 * r - 0.2309 * da + 0.0344 * dr,
            0.03 - 0.5626 * alpha - 8.794 * q - 1.1642 * de + 0.178 * lag - 0.0064 * tc,
            0.1348 * beta - 0.0602 * p - 0.2061 * r - 0.012 * da - 0.0939 * dr,
        ])  # fmt: skip
        if self.span[0] <= time < self.span[1]:
            if self.kind == "cg_shift":
                c[4] += self.shift / self.chord * c[2]
                c[5] -= self.shift / self.wing_span * c[1]
            elif self.kind == "landing_gear":
                c[[0, 4]] -= 0.018, 0.012
        return c

    def advance(self, speed: float, alpha: float, alpha_dot: float) -> None:
        """A state of the flow, of an aeroplane that has one, goes on by one step."""

    def derivative(self, time, x, inputs, wind, alpha_dot):  # type: ignore[no-untyped-def]
        """Of velocity, rates, quaternion and position; specific force; airspeed, alpha, beta."""
        turn = matrix_of(x[6:10])
        u, v, w = x[:3] - turn.T @ wind
        speed = float(np.sqrt(u * u + v * v + w * w))
        alpha, beta, pressure = np.arctan2(w, u), np.arcsin(v / speed), 0.5 * self.density * speed**2 * self.area
        c = self.coefficients(time, (speed, alpha, beta, alpha_dot, inputs[3] / pressure), x[3:6], inputs[:3])
        force = (pressure * c[:3] + np.array([inputs[3], 0.0, 0.0])) / self.mass
        moment = pressure * c[3:] * np.array([self.wing_span, self.chord, self.wing_span])
        rates, (p, q, r) = x[3:6], x[3:6]
        spin = np.array([[0, -p, -q, -r], [p, 0, r, -q], [q, -r, 0, p], [r, q, -p, 0]])
        acceleration = force + turn.T @ np.array([0.0, 0.0, GRAVITY]) - np.cross(rates, x[:3])
        angular = self.inverse @ (moment - np.cross(rates, self.inertia @ rates))
        return np.concatenate([acceleration, angular, 0.5 * spin @ x[6:10], turn @ x[:3]]), force, (speed, alpha, beta)

    def pilot(self, time: float, x: np.ndarray, speed: float, integral: float) -> tuple[np.ndarray, float]:
        """Commanded elevator, aileron, rudder [rad] and thrust [N]; and what is kept of the height."""
        turn = matrix_of(x[6:10])
        bank, pitch = np.arctan2(turn[2, 1], turn[2, 2]), -np.arcsin(turn[2, 0])
        below, climb = self.height + x[12], -(turn @ x[:3])[2]
        wanted = float(np.clip(0.002 * below - 0.012 * climb + integral, -0.2, 0.25))
        integral += STEP * (0.0002 * below - 0.001 * climb)
        number = int(time // self.leg)
        command_of = {
            "elevator": -0.8 * (wanted - pitch) + 1.2 * x[4] - 0.02,
            "aileron": -0.5 * (self.banks[number] - bank) + 0.25 * x[3],
            "rudder": 0.6 * (x[5] - GRAVITY / speed * np.sin(bank)),
        }
        for begin, surface, shape in self.events:
            since = time - begin
            if 0.0 <= since < 6.0:
                held = 0.3 if surface == "elevator" else 1.0
                command_of[surface] = held * command_of[surface] + AMPLITUDES[surface] * input_of(shape, since)
        surfaces = np.clip(list(command_of.values()), -0.3, 0.3)
        return np.append(surfaces, np.clip(5800.0 + 1500.0 * (self.speeds[number] - speed), 300.0, 16000.0)), integral

    def fly(self) -> dict[str, np.ndarray]:
        """What sensors without errors would show, in SI and radians, by column."""
        x = np.zeros(13)
        x[6:10] = np.cos(0.025), 0.0, np.sin(0.025), 0.0
        x[:3] = matrix_of(x[6:10]).T @ (np.array([self.speed, 0.0, 0.0]) + WIND)
        x[12] = -self.height
        inputs, integral, alpha_dot, before, rows = np.array([0.0, 0.0, 0.0, 6000.0]), 0.0, 0.0, None, []
        follow = 1.0 - np.exp(-STEP / np.array([0.05, 0.05, 0.05, 1.5]))
        for k, gust in enumerate(self.gusts):
            time, wind = k * STEP, WIND + gust
            _, force, (speed, alpha, beta) = self.derivative(time, x, inputs, wind, alpha_dot)
            if before is not None:
                alpha_dot = 0.9 * alpha_dot + 0.1 * (alpha - before) / STEP
            before = alpha
            self.advance(speed, alpha, alpha_dot)
            wanted, integral = self.pilot(time, x, speed, integral)
            inputs = inputs + (wanted - inputs) * follow
            if k % self.every == 0:
                rows.append([time, *x, *inputs, speed, alpha, *force, beta])
            slopes = [np.zeros(13)]
            for share in (0.0, 0.5, 0.5, 1.0):
                slopes.append(self.derivative(time, x + share * STEP * slopes[-1], inputs, wind, alpha_dot)[0])
            x = x + STEP / 6.0 * (slopes[1] + 2.0 * slopes[2] + 2.0 * slopes[3] + slopes[4])
            x[6:10] /= np.linalg.norm(x[6:10])
        return columns_of(np.array(rows))


def columns_of(rows: np.ndarray) -> dict[str, np.ndarray]:
    """By column of the table."""
    turns = np.array([matrix_of(q) for q in rows[:, 7:11]])
    places = geodetic_along(rows[:, 11:14], ORIGIN)
    velocity = np.einsum("nij,nj->ni", turns, rows[:, 1:4])
    yaw = np.unwrap(np.arctan2(turns[:, 1, 0], turns[:, 0, 0]))
    return {
        "time": rows[:, 0], **dict(zip(("ax", "ay", "az"), rows[:, 20:23].T, strict=True)),
        **dict(zip(("p", "q", "r"), np.degrees(rows[:, 4:7]).T, strict=True)),
        "roll": np.degrees(np.arctan2(turns[:, 2, 1], turns[:, 2, 2])), "pitch": -np.degrees(np.arcsin(turns[:, 2, 0])),
        "heading": np.degrees(yaw), "tas": rows[:, 18], "aoa": np.degrees(rows[:, 19]), "alt": -rows[:, 13],
        "ssa": np.degrees(rows[:, 23]),
        **dict(zip(("de", "da", "dr"), np.degrees(rows[:, 14:17]).T, strict=True)), "thrust": rows[:, 17],
        "lat": np.degrees(places[:, 0]), "lon": np.degrees(places[:, 1]), "gps_alt": places[:, 2],
        **dict(zip(("vn", "ve", "vd"), velocity.T, strict=True)),
    }  # fmt: skip


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    """Body to NED."""
    a, b, c, d = quaternion
    return np.array([
        [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
        [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
        [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
    ])  # fmt: skip


def input_of(shape: str, since: float) -> float:
    """A doublet of 1 s each way, or a 3-2-1-1 of 0.6 s."""
    if shape == "doublet":
        return 1.0 if since < 1.0 else -1.0 if since < 2.0 else 0.0
    part = int(since // 0.6)
    return (1.0, 1.0, 1.0, -1.0, -1.0, 1.0, -1.0)[part] if part < 7 else 0.0


def write_flight(folder: Path, jet: Jet) -> None:
    """The table of a flight, its map and the aircraft file."""
    flown = jet.fly()
    table = {"time": flown["time"]}
    for name, (_, _, sigma, bias, rounding) in jet.columns.items():
        values = flown[name] + bias + sigma * jet.random.normal(size=len(flown["time"]))
        table[name] = np.round(values / rounding) * rounding if rounding else values
    table["heading"] = np.mod(table["heading"], 360.0)
    with (folder / "flight.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(table)
        writer.writerows([f"{value:.7f}" for value in row] for row in zip(*table.values(), strict=True))
    signals = {signal: {"column": name, "unit": unit} for name, (signal, unit, *_) in jet.columns.items()}
    table_map = {"tables": [{"time": {"column": "time", "unit": "s"}, "signals": signals}]}
    (folder / "map.yaml").write_text(yaml.safe_dump(table_map))
    inertia = dict(zip(("xx", "yy", "zz", "xz"), jet.moments().tolist(), strict=True))
    known = {"name": jet.name, "mass": jet.mass, "wing_area": jet.area, "chord": jet.chord, "span": jet.wing_span}
    (folder / f"{jet.name}.yaml").write_text(yaml.safe_dump({**known, "inertia": inertia}))


def said_of(flight: Jet) -> dict[str, Any]:
    """What the commands say of a flight, as a user gives them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_flight(folder, flight)
        bag, run, file = folder / "bag", folder / "run", folder / f"{flight.name}.yaml"
        for arguments in (
            ["import", folder / "flight.csv", "--map", folder / "map.yaml", "--out", bag],
            ["replay", bag, "--aircraft", file, "--out", run],
            ["diagnose", run],
        ):
            if status := command([str(argument) for argument in arguments]):
                return {"failed": arguments[0], "status": status}
        said = json.loads((run / "diagnosis.json").read_text())
    keys = ("label", "effect", "main_axis", "p_value", "error_before", "error_after", "inner")
    found = [{key: c[key] for key in keys} for c in said["candidates"] if c["found"]]
    return {"verdict": said["verdict"], "found": found}


def judged(seed: int) -> dict[str, Any]:
    """One flight."""
    jet = Jet(KINDS[seed % len(KINDS)], seed)
    return {"seed": seed, "kind": jet.kind, "span": jet.span, **said_of(jet)}


def fly_all(fly: Callable[[int], dict[str, Any]], about: str, results: Path, seeds: range) -> None:
    """The command: fly what is not there yet of the seeds that are asked for, or of ``seeds``."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="*", default=list(seeds))
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    for record in flown(fly, arguments.seeds, results, arguments.jobs):
        print(json.dumps(record))


if __name__ == "__main__":
    fly_all(judged, __doc__, RESULTS, range(100, 108))
