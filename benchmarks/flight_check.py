"""How often `check` names a fault that is put into a clean flight, and how often it finds one where there is none.

    python benchmarks/flight_check.py [--first-seed 200] [--flights 5]

Simulated flights, calm to turbulent, 10 to 400 Hz, with an attitude and without, some of JSBSim. Each is judged as it
is, and then with one fault after another. A fault is named when a warning or an error of the right kind stands at the
right signal; other warnings and errors are counted beside it. The rules of the check were made on seeds below 200.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.aircraft.frames import quaternion_from_euler
from aircraft_sysid_ros.flight_check.check import Checked, check
from aircraft_sysid_ros.flight_check.finding import INFO
from aircraft_sysid_ros.flight_check.signals import ATTITUDE, KIND_OF, NAMES, flight_of
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_jsbsim_samples, simulate_samples

Array = npt.NDArray[np.float64]
Fault = Callable[[Samples], Samples]

RATES = (100, 50, 200, 25, 100, 400, 10, 100)
TURBULENCE = ("none", "light", "none", "moderate")
PLANS = ("standard", "varied", "speeds", "sideslips")
JSBSIM = ("c172p", "c182", "J3Cub")


def with_rate(aircraft: Aircraft, rate: float) -> Aircraft:
    """The aircraft with an IMU of ``rate`` [Hz], and with air data and controls of half of that, at most 100 Hz."""
    sensors = {name: dict(sensor) for name, sensor in aircraft.source["sensors"].items()}
    for name in ("accelerometer", "gyro", "attitude"):
        sensors[name]["rate"] = rate
    for name in ("airspeed", "angle_of_attack", "sideslip", "static_pressure", "control_surfaces"):
        sensors[name]["rate"] = min(max(0.5 * rate, 10.0), 100.0)
    return aircraft_from_dict({**aircraft.source, "sensors": sensors})


def flown(seed: int) -> tuple[Samples, dict[str, Any]]:
    """A clean flight drawn from its seed, and what it is like; every sixth is of JSBSim."""
    return flown_by(seed)[:2]


def flown_by(seed: int) -> tuple[Samples, dict[str, Any], Aircraft]:
    """The same, with the aircraft."""
    rng = np.random.default_rng([seed, 0xC4EC])
    direction, wind = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 6.0)
    air, attitude = str(rng.choice(TURBULENCE)), bool(rng.random() < 0.7)
    common: dict[str, Any] = {
        "wind": (wind * np.cos(direction), wind * np.sin(direction), 0.0),
        "turbulence": air,
        "sensors": SensorOptions(attitude=attitude, height_above_ground=bool(rng.random() < 0.5)),
    }
    if seed % 6 == 5:
        name = str(rng.choice(JSBSIM))
        flight = simulate_jsbsim_samples(name, seed, 90.0, **common)
        return flight.samples, {"aircraft": name, "air": air, "attitude": attitude, "rate": 100}, flight.aircraft
    rate, plan = int(rng.choice(RATES)), str(rng.choice(PLANS))
    flight = simulate_samples(with_rate(default_aircraft(), rate), seed, 120.0, **common, manoeuvres=plan)
    what = {"aircraft": "textbook", "air": air, "attitude": attitude, "rate": rate, "plan": plan}
    return flight.samples, what, flight.aircraft


@dataclass(frozen=True)
class Injection:
    """One fault: where it should be seen and as what, and what it does. ``needs``: kinds of samples it needs."""

    name: str
    signals: tuple[str, ...]
    kind: str
    fault: Fault
    needs: tuple[Kind, ...] = ()


def changed(signal: str, change: Callable[[Array], Array]) -> Fault:
    """The values of a signal changed."""
    kind = KIND_OF[signal]
    column = NAMES[kind].index(signal)

    def fault(samples: Samples) -> Samples:
        rows, values = samples.kind == kind, samples.values.copy()
        values[rows, column] = change(values[rows, column])
        return Samples(samples.stamp, samples.kind, values)

    return fault


def scaled(signal: str, factor: float) -> Fault:
    """A signal times a factor."""
    return changed(signal, lambda v: factor * v)


def all_of(*faults: Fault) -> Fault:
    """Several at once."""

    def fault(samples: Samples) -> Samples:
        for one in faults:
            samples = one(samples)
        return samples

    return fault


def swapped(first: str, second: str) -> Fault:
    """Two signals of a stream in each other's place."""
    kind = KIND_OF[first]
    i, j = NAMES[kind].index(first), NAMES[kind].index(second)

    def fault(samples: Samples) -> Samples:
        rows, values = np.flatnonzero(samples.kind == kind), samples.values.copy()
        values[np.ix_(rows, [i, j])] = values[np.ix_(rows, [j, i])]
        return Samples(samples.stamp, samples.kind, values)

    return fault


def late(seconds: float, *kinds: Kind) -> Fault:
    """Streams stamped later than they are."""

    def fault(samples: Samples) -> Samples:
        stamp = samples.stamp + np.isin(samples.kind, kinds) * round(1e9 * seconds)
        return Samples(stamp, samples.kind, samples.values)

    return fault


def held(kind: Kind, columns: slice, every: int = 5) -> Fault:
    """Columns that change with every fifth sample only."""

    def fault(samples: Samples) -> Samples:
        rows, values = np.flatnonzero(samples.kind == kind), samples.values.copy()
        values[rows, columns] = values[rows[np.arange(len(rows)) // every * every], columns]
        return Samples(samples.stamp, samples.kind, values)

    return fault


def clipped(share: float) -> Callable[[Array], Array]:
    """The top of a signal cut off at a share of the way from its mean to its largest value."""
    return lambda v: np.minimum(v, np.mean(v) + share * (np.max(v) - np.mean(v)))


def lost(kind: Kind, begin: float, end: float) -> Fault:
    """No samples of a kind between two shares of the flight."""

    def fault(samples: Samples) -> Samples:
        start, stop = samples.stamp.min(), samples.stamp.max()
        share = (samples.stamp - start) / (stop - start)
        return samples[~((samples.kind == kind) & (share > begin) & (share < end))]

    return fault


def thinned(kind: Kind, share: float) -> Fault:
    """A share of the samples of a kind lost at random."""

    def fault(samples: Samples) -> Samples:
        return samples[~((samples.kind == kind) & (np.random.default_rng(5).random(len(samples)) < share))]

    return fault


def jittered(kind: Kind) -> Fault:
    """Stamps moved at random by up to half of the interval."""

    def fault(samples: Samples) -> Samples:
        rows, stamp = np.flatnonzero(samples.kind == kind), samples.stamp.copy()
        step = float(np.median(np.diff(np.sort(stamp[rows]))))
        stamp[rows] += np.rint(np.random.default_rng(6).uniform(-0.7, 0.7, len(rows)) * step).astype(np.int64)
        return Samples(stamp, samples.kind, samples.values)

    return fault


def spiked(signal: str) -> Fault:
    """One in five hundred values far off."""

    def change(values: Array) -> Array:
        rng, out = np.random.default_rng(7), values.copy()
        at = rng.choice(len(values), max(len(values) // 300, 4), replace=False)
        out[at] += 8.0 * np.ptp(values) * rng.choice([-1.0, 1.0], len(at))
        return out

    return changed(signal, change)


def coarse(signal: str) -> Fault:
    """Steps of half of the spread."""
    return changed(signal, lambda v: np.round(v / (0.6 * np.std(v))) * 0.6 * np.std(v))


def turned(axis: int, change: Callable[[Array], Array]) -> Fault:
    """One Euler angle of the attitude changed."""

    def fault(samples: Samples) -> Samples:
        rows, values = np.flatnonzero(samples.kind == Kind.ATTITUDE), samples.values.copy()
        w, x, y, z = values[rows, :4].T
        euler = [
            np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            np.arcsin(np.clip(2.0 * (w * y - x * z), -1.0, 1.0)),
            np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        ]
        euler[axis] = change(euler[axis])
        values[rows, :4] = [quaternion_from_euler(*angles) for angles in zip(*euler, strict=True)]
        return Samples(samples.stamp, samples.kind, values)

    return fault


def without(*kinds: Kind) -> Fault:
    """A recording without some streams."""
    return lambda samples: samples[~np.isin(samples.kind, kinds)]


def _opposite(v: Array) -> Array:
    return -v


_A, _V, _P, _S = Kind.ATTITUDE, Kind.GPS_VELOCITY, Kind.GPS_POSITION, "angular_velocity"
INJECTIONS: tuple[Injection, ...] = (
    *(Injection(f"{n} reversed", (n,), "sign", scaled(n, -1.0), (_A,)) for n in NAMES[Kind.IMU]),
    *(Injection(f"{n} reversed", (n,), "sign", scaled(n, -1.0)) for n in (
        "velocity.north", "velocity.down", "angle_of_attack", "sideslip", "elevator", "rudder")),
    *(Injection(f"{n} reversed", (n,), "sign", turned(i, _opposite), (_A,)) for i, n in enumerate(ATTITUDE)),
    Injection("yaw from east", ("attitude.yaw",), "offset", turned(2, lambda v: v - 0.5 * np.pi), (_A,)),
    Injection("x and y of the gyros swapped", (f"{_S}.x", f"{_S}.y"), "sign", swapped(f"{_S}.x", f"{_S}.y"), (_A,)),
    Injection("x and z of the forces swapped", ("specific_force.z",), "sign",
              swapped("specific_force.x", "specific_force.z")),
    Injection("north and east swapped", ("velocity.north", "velocity.east"), "sign",
              swapped("velocity.north", "velocity.east")),
    Injection("gyros in deg/s", NAMES[Kind.IMU][3:], "unit",
              all_of(*(scaled(n, 57.29578) for n in NAMES[Kind.IMU][3:])), (_A,)),
    Injection("one gyro in deg/s", (f"{_S}.y",), "unit", scaled(f"{_S}.y", 57.29578)),
    Injection("forces in g", ("specific_force.z",), "unit",
              all_of(*(scaled(n, 1.0 / 9.80665) for n in NAMES[Kind.IMU][:3]))),
    *(Injection(f"{n} in degrees", (n,), "unit", scaled(n, 57.29578)) for n in (
        "angle_of_attack", "sideslip", "elevator", "aileron")),
    Injection("airspeed in knots", ("true_airspeed",), "unit", scaled("true_airspeed", 1.943844)),
    Injection("airspeed in km/h", ("true_airspeed",), "unit", scaled("true_airspeed", 3.6)),
    Injection("GPS velocity in knots", ("velocity.north", "velocity.east"), "unit",
              all_of(*(scaled(n, 1.943844) for n in NAMES[Kind.GPS_VELOCITY]))),
    Injection("altitude in feet", ("altitude",), "unit", scaled("altitude", 3.28084)),
    Injection("pressure in hPa", ("static_pressure",), "unit", scaled("static_pressure", 0.01)),
    Injection("throttle in per cent", ("throttle",), "unit", scaled("throttle", 100.0)),
    *(Injection(f"{n} times 1.1", (n,), "scale", scaled(n, 1.1), (_A,)) for n in NAMES[Kind.IMU][3:]),
    Injection("specific force times 1.1", ("specific_force.z",), "scale",
              all_of(*(scaled(n, 1.1) for n in NAMES[Kind.IMU][:3]))),
    Injection("airspeed times 1.15", ("true_airspeed",), "scale", scaled("true_airspeed", 1.15)),
    Injection("GPS velocity times 1.1", ("velocity.north", "velocity.east"), "scale",
              all_of(*(scaled(n, 1.1) for n in NAMES[Kind.GPS_VELOCITY]))),
    *(Injection(f"attitude {s:g} s late", ATTITUDE, "offset", late(s, _A), (_A,)) for s in (0.05, 0.2)),
    *(Injection(f"GPS velocity {s:g} s late", ("velocity.north",), "offset", late(s, _V)) for s in (0.1, 0.2)),
    Injection("GPS 0.2 s late", ("velocity.north", "latitude"), "offset", late(0.2, _V, _P)),
    *(Injection(f"IMU {s:g} s late", NAMES[Kind.IMU], "offset", late(s, Kind.IMU)) for s in (0.1, 0.15)),
    Injection("angle of attack 0.1 s late", ("angle_of_attack",), "offset", late(0.1, Kind.ANGLE_OF_ATTACK)),
    Injection("sideslip 0.1 s late", ("sideslip",), "offset", late(0.1, Kind.SIDESLIP)),
    Injection("airspeed 0.2 s late", ("true_airspeed",), "offset", late(0.2, Kind.AIRSPEED)),
    Injection("controls 0.1 s late", ("elevator", "aileron", "rudder"), "offset", late(0.1, Kind.CONTROLS)),
    Injection("controls 0.2 s early", ("elevator", "aileron", "rudder"), "offset", late(-0.2, Kind.CONTROLS)),
    Injection("gyros held", NAMES[Kind.IMU][3:], "held", held(Kind.IMU, slice(3, 6))),
    Injection("airspeed held", ("true_airspeed",), "held", held(Kind.AIRSPEED, slice(0, 1))),
    Injection("attitude held", ATTITUDE, "held", held(_A, slice(0, 4)), (_A,)),
    Injection("angle of attack stuck", ("angle_of_attack",), "held",
              changed("angle_of_attack", lambda v: 0.0 * v + 0.05)),
    Injection("gyro saturated", (f"{_S}.x",), "saturated", changed(f"{_S}.x", clipped(0.5))),
    Injection("accelerometer saturated", ("specific_force.z",), "saturated",
              changed("specific_force.z", clipped(0.5))),
    Injection("GPS velocity gap of 8 s", ("velocity.north",), "gap", lost(_V, 0.5, 0.57)),
    Injection("IMU gap of 2 s", (f"{_S}.x",), "gap", lost(Kind.IMU, 0.5, 0.52)),
    Injection("one in ten IMU samples lost", (f"{_S}.x",), "gap", thinned(Kind.IMU, 0.1)),
    Injection("airspeed ends early", ("true_airspeed",), "gap", lost(Kind.AIRSPEED, 0.7, 2.0)),
    Injection("IMU stamps jittered", (f"{_S}.x",), "jitter", jittered(Kind.IMU)),
    Injection("spikes in the airspeed", ("true_airspeed",), "noise", spiked("true_airspeed")),
    Injection("coarse sideslip", ("sideslip",), "noise", coarse("sideslip")),
    Injection("no GPS velocity", ("velocity.north",), "missing", without(_V)),
    Injection("no controls", ("elevator",), "missing", without(Kind.CONTROLS)),
)  # fmt: skip


def checked(samples: Samples) -> Checked:
    """The check of samples, stamped when they arrived."""
    return check(flight_of(samples, samples.stamp))


def serious(result: Checked) -> set[tuple[str, str]]:
    """Signal and kind of every warning and error."""
    return {(signal, f.kind) for f in result.findings if f.severity != INFO for signal in f.signals}


def judge(samples: Samples, injection: Injection, clean: set[tuple[str, str]]) -> dict[str, Any] | None:
    """Whether a fault is named, and how many sentences more there are; None where the flight cannot have it."""
    if not all(np.any(samples.kind == kind) for kind in injection.needs):
        return None
    result = checked(injection.fault(samples))
    found = serious(result)
    wanted = {(signal, injection.kind) for signal in injection.signals}
    kinds = {KIND_OF[s] for s in injection.signals}
    others = [
        f for f in result.findings
        if f.severity != INFO and not any(
            (f.kind == injection.kind and KIND_OF.get(s) in kinds) or (s, f.kind) in clean for s in f.signals
        )
    ]  # fmt: skip
    return {
        "named": wanted <= found,
        "partly": bool(wanted & found),
        "others": [f"{f.kind} {f.signals[0]}" for f in others],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first-seed", type=int, default=200)
    parser.add_argument("--flights", type=int, default=5)
    parser.add_argument("--clean", type=int, default=19, help="more flights that are judged as they are only")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "flight_check.json")
    arguments = parser.parse_args()
    started = time.process_time()
    records: dict[str, list[dict[str, Any]]] = defaultdict(list)
    cleans = []
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.flights + arguments.clean):
        samples, what = flown(seed)
        clean = serious(checked(samples))
        cleans.append({"seed": seed, **what, "found": sorted(f"{kind} {signal}" for signal, kind in clean)})
        if clean:
            print(cleans[-1], flush=True)
        if seed >= arguments.first_seed + arguments.flights:
            continue
        for injection in INJECTIONS[seed % 2 :: 2] if arguments.flights > 4 else INJECTIONS:
            record = judge(samples, injection, clean)
            if record is not None:
                records[injection.name].append({"seed": seed, **record})
                if not record["named"] or record["others"]:
                    print(seed, what, injection.name, record, flush=True)
    table = {
        injection.name: {
            "kind": injection.kind,
            "flights": len(of_it := records[injection.name]),
            "named": sum(r["named"] for r in of_it),
            "partly": sum(r["partly"] for r in of_it),
            "others": sum(len(r["others"]) for r in of_it),
        }
        for injection in INJECTIONS
        if records[injection.name]
    }
    result = {
        "first_seed": arguments.first_seed, "injections": table, "clean_flights": len(cleans),
        "clean_with_finding": sum(bool(c["found"]) for c in cleans), "clean": cleans,
        "cpu_seconds": time.process_time() - started,
    }  # fmt: skip
    total, named = sum(t["flights"] for t in table.values()), sum(t["named"] for t in table.values())
    print(f"named {named} of {total}; clean flights with a finding {result['clean_with_finding']} of {len(cleans)}")
    arguments.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
