"""How often `import --guess` is right: simulated flights in layouts whose names, units, signs and rates are drawn.

Every column of a layout has a known meaning. A column is right where its line of the MAP is active and gives the SI
value that the flight had, or, for a column that is no signal of ours, where no line uses it. It is undecided where its
line is commented out, missed where it has none, and silently wrong where an active line has another signal, unit or
sign.

    python benchmarks/import_guess.py --seeds 1000 1050 --out build/import_guess.json
"""

from __future__ import annotations

import argparse
import csv
import json
import tempfile
from collections import Counter
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.recordings.tabular.guess.first_map import guess_map
from aircraft_sysid_ros.simulation.simulated_flight import simulate_jsbsim_samples, simulate_samples

ROOT = Path(__file__).resolve().parents[1]
AEROPLANES = ("ultra_stick_25e", "ultra_stick_120", "c172p", "J3Cub")
G, FT, KT = 9.80665, 0.3048, 1852.0 / 3600.0
DEG = np.pi / 180.0
#: Units by quantity: what a header may write, and SI value = scale * number + shift.
UNITS: dict[str, dict[str, tuple[float, float]]] = {
    "acceleration": {"m/s^2": (1.0, 0.0), "g": (G, 0.0), "ft/s^2": (FT, 0.0)},
    "rate": {"rad/s": (1.0, 0.0), "deg/s": (DEG, 0.0)},
    "angle": {"rad": (1.0, 0.0), "deg": (DEG, 0.0)},
    "place": {"deg": (DEG, 0.0), "rad": (1.0, 0.0)},
    "length": {"m": (1.0, 0.0), "ft": (FT, 0.0)},
    "speed": {"m/s": (1.0, 0.0), "kt": (KT, 0.0), "ft/s": (FT, 0.0), "km/h": (1.0 / 3.6, 0.0)},
    "climb": {"m/s": (1.0, 0.0), "ft/min": (FT / 60.0, 0.0), "ft/s": (FT, 0.0)},
    "pressure": {
        "Pa": (1.0, 0.0),
        "hPa": (100.0, 0.0),
        "kPa": (1000.0, 0.0),
        "inHg": (3386.389, 0.0),
        "psi": (6894.757, 0.0),
    },
    "temperature": {"degC": (1.0, 273.15), "K": (1.0, 0.0), "degF": (5.0 / 9.0, 459.67 * 5.0 / 9.0)},
    "density": {"kg/m^3": (1.0, 0.0), "slug/ft^3": (515.3788, 0.0)},
    "share": {"1": (1.0, 0.0), "%": (0.01, 0.0)},
    "turns": {"rpm": (np.pi / 30.0, 0.0)},
}
#: How units are spelt behind a name with "_".
ENDINGS = {
    "m/s^2": "mps2", "g": "g", "ft/s^2": "fps2", "rad/s": "rps", "deg/s": "dps", "rad": "rad", "deg": "deg", "m": "m",
    "ft": "ft", "m/s": "mps", "kt": "kt", "ft/s": "fps", "km/h": "kmh", "ft/min": "fpm", "Pa": "pa",
    "hPa": "hpa", "kPa": "kpa", "inHg": "inhg", "psi": "psi",
    "degC": "degc", "K": "k", "degF": "degf", "kg/m^3": "kgm3",
    "slug/ft^3": "slug_ft3",
    "1": "",
    "%": "pct", "rpm": "rpm",
}  # fmt: skip


@dataclass(frozen=True)
class Quantity:
    """A signal, its kind of unit, the names that people give it, and how often it counts the other way."""

    signal: str
    kind: str
    names: tuple[str, ...]
    flipped: float = 0.0


QUANTITIES = (
    Quantity(
        "specific_force.x",
        "acceleration",
        ("ax", "Ax", "accel_x", "AccX", "Nx", "LongAccel", "imu_ax", "acc[0]", "Acceleration X"),
    ),
    Quantity(
        "specific_force.y",
        "acceleration",
        ("ay", "Ay", "accel_y", "AccY", "Ny", "LatAccel", "imu_ay", "acc[1]", "Acceleration Y"),
        0.3,
    ),
    Quantity(
        "specific_force.z",
        "acceleration",
        ("az", "Az", "accel_z", "AccZ", "Nz", "NormAccel", "imu_az", "acc[2]", "Acceleration Z"),
        0.5,
    ),
    Quantity(
        "angular_velocity.x", "rate", ("p", "P", "gyro_x", "GyrX", "RollRate", "Roll Rate", "imu_p", "wx", "gyro[0]")
    ),
    Quantity(
        "angular_velocity.y",
        "rate",
        ("q", "Q", "gyro_y", "GyrY", "PitchRate", "Pitch Rate", "imu_q", "wy", "gyro[1]"),
        0.2,
    ),
    Quantity(
        "angular_velocity.z", "rate", ("r", "R", "gyro_z", "GyrZ", "YawRate", "Yaw Rate", "imu_r", "wz", "gyro[2]"), 0.2
    ),
    Quantity("attitude.roll", "angle", ("phi", "Phi", "roll", "ROLL", "bank", "ins_roll", "Roll Angle", "Bank_Angle")),
    Quantity(
        "attitude.pitch",
        "angle",
        ("theta", "Theta", "pitch", "PITCH", "the", "ins_pitch", "Pitch Angle", "Pitch_Attitude"),
        0.1,
    ),
    Quantity(
        "attitude.yaw", "angle", ("psi", "Psi", "yaw", "HDG", "heading", "ins_yaw", "True Heading", "Heading"), 0.05
    ),
    Quantity("latitude", "place", ("lat", "Lat", "latitude", "GPS_Lat", "LATITUDE", "gps_latitude")),
    Quantity("longitude", "place", ("lon", "Lon", "longitude", "GPS_Lon", "LONGITUDE", "lng")),
    Quantity("altitude", "length", ("alt", "ALT", "altitude", "GPS_Alt", "alt_msl", "gps_altitude")),
    Quantity("velocity.north", "speed", ("vn", "Vn", "vel_n", "V_North", "gps_vn", "VelNorth")),
    Quantity("velocity.east", "speed", ("ve", "Ve", "vel_e", "V_East", "gps_ve", "VelEast")),
    Quantity("velocity.down", "climb", ("vd", "Vd", "vel_d", "V_Down", "gps_vd", "VelDown")),
    Quantity("pressure_altitude", "length", ("hp", "press_alt", "PressAlt", "baro_alt", "Pressure Altitude", "Hp")),
    Quantity(
        "static_pressure", "pressure", ("Ps", "p_static", "static_pressure", "Pstat", "baro_press", "StaticPress")
    ),
    Quantity("dynamic_pressure", "pressure", ("qbar", "qc", "Qc", "pdyn", "dyn_press", "diff_press")),
    Quantity("air_temperature", "temperature", ("OAT", "oat", "air_temp", "AirTemp", "Outside Air Temp", "temp")),
    Quantity("air_density", "density", ("rho", "Rho", "density", "air_density")),
    Quantity("true_airspeed", "speed", ("TAS", "tas", "Vtas", "true_airspeed", "V", "Vt", "V_true", "True Airspeed")),
    Quantity(
        "angle_of_attack", "angle", ("alpha", "AOA", "aoa", "Alpha", "alpha_vane", "boom_alpha", "Angle of Attack"), 0.1
    ),
    Quantity(
        "sideslip", "angle", ("beta", "AOS", "aos", "Beta", "beta_vane", "boom_beta", "sideslip", "Sideslip Angle"), 0.4
    ),
    Quantity("elevator", "angle", ("de", "elev", "Elevator", "delta_e", "ELEV", "elevator_pos", "DE"), 0.5),
    Quantity("aileron", "angle", ("da", "ail", "Aileron", "delta_a", "AIL", "aileron_pos", "DA"), 0.5),
    Quantity("rudder", "angle", ("dr", "rud", "Rudder", "delta_r", "RUD", "rudder_pos", "DR"), 0.5),
    Quantity("throttle", "share", ("thr", "Throttle", "throttle", "PLA", "dthr", "throttle_pos")),
    Quantity("propeller_speed", "turns", ("rpm", "RPM", "prop_rpm", "EngineRPM", "motor_rpm")),
)
CLIMB_NAMES = ("climb", "ROC", "climb_rate", "vertical_speed", "h_dot", "Vup", "vel_up")
GROUPS = {
    "imu": (
        "specific_force.x",
        "specific_force.y",
        "specific_force.z",
        "angular_velocity.x",
        "angular_velocity.y",
        "angular_velocity.z",
    ),
    "attitude": ("attitude.roll", "attitude.pitch", "attitude.yaw"),
    "gps": ("latitude", "longitude", "altitude", "velocity.north", "velocity.east", "velocity.down"),
    "air": (
        "true_airspeed",
        "pressure_altitude",
        "static_pressure",
        "dynamic_pressure",
        "air_temperature",
        "air_density",
    ),
    "vanes": ("angle_of_attack", "sideslip"),
    "controls": ("elevator", "aileron", "rudder", "throttle", "propeller_speed"),
}
NOISE = {
    "acceleration": 0.05, "rate": 0.004, "angle": 0.003, "place": 1e-7, "length": 0.6, "speed": 0.2, "climb": 0.2,
    "pressure": 8.0, "temperature": 0.1, "density": 1e-4, "share": 0.002, "turns": 1.0,
}  # fmt: skip


@dataclass
class Layout:
    """A written layout: where it is, and SI value = scale * number + shift by (table, column); None is no signal."""

    path: Path
    truth: dict[tuple[str, str], tuple[str, float, float] | None] = field(default_factory=dict)
    times: dict[str, tuple[str, float]] = field(default_factory=dict)  # column and seconds per tick, 0 for a text


def flown(rng: np.random.Generator, seed: int) -> dict[str, np.ndarray]:
    """A flight in SI, FRD and NED at 100 Hz, by signal, and ``time`` [s]."""
    name = AEROPLANES[int(rng.integers(len(AEROPLANES)))]
    wind = (*rng.normal(0.0, 4.0, 2), 0.0)
    plan = str(rng.choice(("standard", "varied", "speeds", "sideslips")))
    duration = float(rng.uniform(60.0, 150.0))
    if name.startswith("ultra"):
        aircraft = load_aircraft(ROOT / "config" / f"{name}.yaml")
        truth = simulate_samples(aircraft, seed=seed, duration=duration, wind=wind, manoeuvres=plan, rate=200.0).truth
    else:
        truth = simulate_jsbsim_samples(name, seed=seed, duration=duration, wind=wind, manoeuvres=plan).truth
    truth = truth[slice(None, None, max(round(0.01 / (truth.time[1] - truth.time[0])), 1))]
    euler = np.array([euler_from_quaternion(q) for q in truth.quaternion])
    latitude, longitude, altitude = truth.origin
    altitude += float(rng.uniform(0.0, 1500.0))
    height = altitude - truth.position[:, 2]
    pressure = 101325.0 * (1.0 - 0.0065 * height / 288.15) ** 5.25588
    warm = float(rng.uniform(-12.0, 12.0))
    temperature = 288.15 - 0.0065 * height + warm
    density = pressure / (287.05287 * temperature)
    columns = {
        "time": truth.time, "altitude": height, "pressure_altitude": height + rng.normal(0.0, 20.0),
        "static_pressure": pressure, "latitude": latitude + truth.position[:, 0] / 6.371e6,
        "longitude": longitude + truth.position[:, 1] / 6.371e6 / np.cos(latitude),
        "air_temperature": temperature, "air_density": density, "dynamic_pressure": 0.5 * density * truth.airspeed**2,
        "true_airspeed": truth.airspeed, "angle_of_attack": truth.alpha, "sideslip": truth.beta,
        **{f"specific_force.{axis}": truth.specific_force[:, i] for i, axis in enumerate("xyz")},
        **{f"angular_velocity.{axis}": truth.rates[:, i] for i, axis in enumerate("xyz")},
        **{f"attitude.{angle}": euler[:, i] for i, angle in enumerate(("roll", "pitch", "yaw"))},
        **{f"velocity.{way}": truth.velocity[:, i] for i, way in enumerate(("north", "east", "down"))},
        **{surface: truth.controls[:, i] for i, surface in enumerate(("elevator", "aileron", "rudder"))},
        "throttle": truth.controls[:, 4], "propeller_speed": truth.controls[:, 6],
    }  # fmt: skip
    if not name.startswith("ultra"):
        columns["aileron"] = -columns[
            "aileron"
        ]  # of JSBSim: positive rolls right; ours: positive gives a negative moment
    return {name: values for name, values in columns.items() if np.isfinite(values).all()}


class Scrambler:
    """Writes one flight in one layout, all of it drawn."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.rng = np.random.default_rng([seed, 0x6E55])
        self.flight = flown(self.rng, seed)
        self.folder = folder
        self.layout = Layout(folder)
        self.style = str(self.rng.choice(("brackets", "parentheses", "ending", "unit row", "none", "none")))
        self.index = int(self.rng.integers(9))  # people keep to one manner of naming
        self.chosen = {kind: str(self.rng.choice(list(units))) for kind, units in UNITS.items()}
        self.flu = self.rng.random() < 0.2
        self.taken: set[str] = set()
        self.manner = str(self.rng.choice(("s", "ms", "us", "unix", "iso")))
        self.begin = float(np.round(self.rng.uniform(0.0, 900.0), 2))

    def write(self) -> Layout:
        """One file, or one for each group."""
        groups = [name for name in GROUPS if name == "imu" or self.rng.random() < 0.85]
        if self.rng.random() < 0.3:
            for name in groups:
                self.taken = set()
                self._file(
                    name,
                    [name],
                    float(
                        self.rng.choice((10.0, 20.0, 25.0, 50.0))
                        if name != "gps"
                        else self.rng.choice((2.0, 5.0, 10.0))
                    ),
                )
        else:
            self._file("flight", groups, float(self.rng.choice((10.0, 20.0, 25.0, 50.0, 100.0))))
            self.layout.path = self.folder / "flight.csv"
        return self.layout

    def _file(self, name: str, groups: list[str], rate: float) -> None:
        time = np.arange(0.0, self.flight["time"][-1], 1.0 / rate)
        table = f"{name}.csv"
        header, units, columns = self._time(table, time)
        slow = float(self.rng.choice((1.0, 5.0, 10.0)))
        held = self.rng.random() < 0.5
        for group in groups:
            for signal in GROUPS[group]:
                if signal in self.flight and self.rng.random() < 0.95:
                    said, unit, values = self._column(table, signal, time)
                    if group == "gps" and len(groups) > 1 and slow < rate:
                        values = _slowed(values, max(round(rate / slow), 1), held)
                    header.append(said)
                    units.append(unit)
                    columns.append(values)
        self._distractors(table, header, units, columns, len(time))
        with (self.folder / table).open("w", newline="") as file:
            if self.rng.random() < 0.3:
                file.write("Flight data, recorded by our logger\n")
            writer = csv.writer(file)
            writer.writerow(header)
            if self.style == "unit row":
                writer.writerow(units)
            writer.writerows(zip(*columns, strict=True))

    def _time(self, table: str, time: np.ndarray) -> tuple[list[str], list[str], list[Any]]:
        manner, begin = self.manner, self.begin
        start = datetime(2024, 5, 31, 14, 5, tzinfo=timezone.utc)
        if manner == "iso":
            self.layout.times[table] = "UTC", 0.0
            return ["UTC"], ["-"], [[(start + timedelta(seconds=float(t))).isoformat() for t in time]]
        name = str(self.rng.choice(("time", "Time", "t", "TIME", "timestamp", "Elapsed")))
        scale = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "unix": 1.0}[manner]
        unit = "s" if manner == "unix" else manner
        values = (start.timestamp() if manner == "unix" else begin) + time
        if manner in ("ms", "us"):
            ticks: list[Any] = [round(v / scale) for v in values]
        else:
            ticks = [f"{v:.4f}" for v in values]
        said = self._said(name, unit, unit)
        self.layout.times[table] = said, scale
        return [said], [unit], [ticks]

    def _said(self, name: str, unit: str, ending: str) -> str:
        if self.style == "brackets":
            return f"{name} [{unit}]"
        if self.style == "parentheses":
            return f"{name} ({unit})"
        if self.style == "ending" and ending:
            return f"{name}_{ending}"
        return name

    def _column(self, table: str, signal: str, time: np.ndarray) -> tuple[str, str, list[str]]:
        quantity = next(q for q in QUANTITIES if q.signal == signal)
        kind, names, sign = quantity.kind, quantity.names, 1.0
        if signal == "velocity.down" and self.rng.random() < 0.5:
            names, sign = CLIMB_NAMES, -1.0
        if (
            self.flu
            and signal.split(".", maxsplit=1)[0] in ("specific_force", "angular_velocity")
            and signal[-1] in "yz"
        ) or (not self.flu and self.rng.random() < quantity.flipped):
            sign = -1.0
        unit = self.chosen[kind]
        if signal == "dynamic_pressure" and unit == "inHg":
            unit = "Pa"
        scale, shift = UNITS[kind][unit]
        noise = self.rng.normal(0.0, NOISE[kind] * (0.2 if signal == "static_pressure" else 1.0), len(time))
        raw = np.interp(time, self.flight["time"], self.flight[signal])
        if signal == "attitude.yaw":
            raw = np.interp(time, self.flight["time"], np.unwrap(self.flight[signal]))
        if signal == "throttle":
            noise = np.clip(raw + noise, 0.0, 1.0) - raw
        values = (sign * (raw + noise) - shift) / scale
        if signal == "attitude.yaw":
            turn = 2.0 * np.pi / scale
            values = np.mod(values, turn) if self.rng.random() < 0.5 else np.mod(values + turn / 2.0, turn) - turn / 2.0
        name = names[self.index % len(names)]
        said = self._said(name, unit, ENDINGS[unit])
        while said in self.taken:
            said += "2"
        self.taken.add(said)
        self.layout.truth[table, said] = signal, sign * scale, sign * shift
        digits = 9 if kind in ("place", "density") else 5
        return said, unit, [f"{v:.{digits}f}" for v in values]

    def _distractors(self, table: str, header: list[str], units: list[str], columns: list[Any], count: int) -> None:
        for name in (
            "hdop",
            "GPS_sats",
            "battery_v",
            "mode",
            "mag_x",
            "elev_cmd",
            "pitch_cmd",
            "ground_speed",
            "cht",
            "event",
            "p_bias",
        ):
            if self.rng.random() < 0.3:
                self.layout.truth[table, name] = None
                header.append(name)
                units.append("-")
                columns.append([f"{v:.3f}" for v in np.cumsum(self.rng.normal(0.0, 0.1, count))])


def _slowed(values: list[str], every: int, held: bool) -> list[str]:
    return [values[i - i % every] if held or i % every == 0 else "" for i in range(len(values))]


def judge(layout: Layout) -> dict[str, list[str]]:
    """Columns by how they were guessed: right, undecided, missed (not named at all), wrong."""
    first = guess_map(layout.path)
    result: dict[str, list[str]] = {"right": [], "undecided": [], "missed": [], "wrong": []}
    lines = {}
    for part in first.parts:
        table = part.file or layout.path.name
        for line in part.lines:
            lines[table, line.column] = line
        column, scale = layout.times[table]
        time_is_right = part.time is not None and part.time.column == column and _same_time(part.time.unit, scale)
        result["right" if time_is_right else "missed" if part.time is None else "wrong"].append(
            f"{table} {column}: time"
        )
    for (table, column), truth in layout.truth.items():
        result[_verdict(lines.get((table, column)), truth)].append(
            _told(table, column, truth, lines.get((table, column)))
        )
    return result


def _same_time(unit: str, scale: float) -> bool:
    return scale == {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "iso": 0.0}[unit]


def _verdict(line: Any, truth: tuple[str, float, float] | None) -> str:
    if line is None or not line.active:
        return "right" if truth is None else "missed" if line is None else "undecided"
    if truth is None or truth[0] != line.signal:
        return "wrong"
    from aircraft_sysid_ros.recordings.tabular.signals import UNITS as SI
    from aircraft_sysid_ros.recordings.tabular.units import conversion

    convert = conversion(line.unit, SI[line.signal])
    scale = line.sign * convert.factor
    shift = line.sign * (convert.factor * line.offset + convert.shift)
    same = abs(scale / truth[1] - 1.0) < 0.01 and abs(shift - truth[2]) < 0.02 * max(1.0, abs(truth[2]))
    return "right" if same else "wrong"


def _told(table: str, column: str, truth: tuple[str, float, float] | None, line: Any) -> str:
    said = (
        "no line" if line is None else f"{line.signal} {line.unit} {line.sign:+.0f} {line.offset:g} ({line.evidence})"
    )
    return f"{table} {column}: {truth} guessed {said}"


def judged(seed: int) -> dict[str, list[str]]:
    """A layout of a seed, written and judged."""
    with tempfile.TemporaryDirectory() as folder:
        return judge(Scrambler(seed, Path(folder)).write())


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1050), metavar=("FIRST", "END"))
    parser.add_argument("--out", type=Path)
    parser.add_argument("--show", action="store_true", help="what was wrong, undecided or missed")
    args = parser.parse_args()
    total: Counter[str] = Counter()
    every = {}
    for seed in range(*args.seeds):
        every[seed] = judged(seed)
        total.update({verdict: len(columns) for verdict, columns in every[seed].items()})
        if args.show:
            for verdict in ("wrong", "undecided", "missed"):
                for text in every[seed][verdict]:
                    print(seed, verdict, text)
    count = sum(total.values())
    summary = {"layouts": len(every), "columns": count, **total, "share_right": total["right"] / count}
    print(json.dumps(summary))
    if args.out:
        args.out.parent.mkdir(parents=True, exist_ok=True)
        args.out.write_text(json.dumps({"seeds": list(args.seeds), **summary}, indent=2))


if __name__ == "__main__":
    main()
