"""Every value with USE against the truth, on flights of strangers by three makers.

    python benchmarks/use_audit.py [--first 5200000] [--flights 48] [--jobs 1] [--results FILE] [--only SEED …]

Each seed draws a maker (the project's simulator, JSBSim with four aeroplanes, strip theory, whose IMU filters), the
rate of the IMU, the air, vanes that are good, poor (0.7° of noise, a lag, a scale) or absent, surfaces that are
recorded as they move or, in half of the flights, up to 0.1 s before, from SERVOS on in half of the flights commands,
which servos follow with a lag of 0.02 to 0.12 s, an attitude or none, and in a quarter of the flights a sensor that
fails. The aircraft file holds mass and shape, in three of four flights the places of the sensors too. The flight goes
through the chain of replay and live with its default estimator, and each second all that is published is held against
the truth: the aircraft file of the own simulator, and elsewhere least squares of the maker's own forces along the
flight on the terms of the model.

A value is confidently wrong where it has USE, is off by more than a quarter and has a standard error below 5 % of
itself; it misses where it is off by more than 3.5 standard errors. Lost are values without USE at the end of a flight
without a fault that are within a tenth of the truth, with a standard error below a tenth. Rules are made on seeds below
JUDGED, and judged on those from there on, looked at once. Each flight is a line; a run that is stopped goes on.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded

import argparse
import json
import sys
import tempfile
from collections import Counter
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import resumed
from failure_flights import SHAPE
from fault_kinds import KINDS
from faults import PLACES, SURE, WRONG
from walked import walked

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.monitoring.doubts import Doubts
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.identification.undescribed.sensors import UndescribedSensors
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import EPOCH, SensorOptions, first_order_lag, stamps_of
from aircraft_sysid_ros.simulation import jsbsim_flight
from aircraft_sysid_ros.simulation.jsbsim_derivatives import flight_projection
from aircraft_sysid_ros.simulation.jsbsim_flight import projection
from aircraft_sysid_ros.simulation.simulated_flight import simulate_jsbsim_samples, simulate_samples

sys.path.insert(0, str(Path(__file__).parent / "makers"))

from strip_theory.aeroplane import CLEAN, Aeroplane, density_at
from strip_theory.flight import Motion, body_of, rates_of_change, rotation
from strip_theory.hidden import made

Array = npt.NDArray[np.float64]

RESULTS = Path(__file__).parent / "results" / "use_audit.jsonl"
#: First seed of those that judge.
JUDGED = 5_200_000
#: And of those in which servos have a lag.
SERVOS = 5_210_000
DURATION, STEP, MISSES, LATE = 120.0, 1.0, 3.5, 5.0
MAKERS = ("own", "jsbsim", "strips")
OWN = ("ultra_stick_25e", "ultra_stick_120")
#: Aeroplanes of JSBSim beside those that the project flies, with a calibrated airspeed [kt].
FURTHER = {"pa28": 95.0}
AEROPLANES = (*jsbsim_flight.MODELS, *FURTHER)
PLANS = ("standard", "varied", "speeds", "sideslips")
AIRS, RATES, VANES, FILES = ("none", "light", "moderate"), (10.0, 50.0, 100.0), ("good", "poor", "none"), 4
FAULTS = (
    "airspeed x 0.8", "airspeed x 1.2", "alpha x 0.7", "beta x 0.7", "alpha stuck, noisy", "alpha, 0.1 deg/s",
    "alpha + 3 deg", "controls 100 ms late", "air data 150 ms late", "IMU 60 ms late", "elevator record halved",
    "controls, noise 1 deg", "density x 0.75", "gyro q x 0.8",
)  # fmt: skip
#: Without what is in doubt of sensors that no file describes, and of rolling gusts, and as it is.
WAYS = ("without", "with")
_DOUBT, _BESIDE_ROLL = UndescribedSensors.doubt, Doubts._doubt_beside_roll
_VANES = (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
_FAST = (Kind.IMU, Kind.ATTITUDE, Kind.AIRSPEED, *_VANES, Kind.AIR, Kind.CONTROLS)


def drawn(seed: int) -> dict[str, Any]:
    """Everything of a flight."""
    rng = np.random.default_rng([seed, 0xD17])
    maker = str(rng.choice(MAKERS, p=[0.4, 0.35, 0.25]))
    drawing = {
        "maker": maker,
        "aeroplane": str(rng.choice(OWN if maker == "own" else AEROPLANES)),
        "rate": float(rng.choice(RATES)),
        "air": str(rng.choice(AIRS)),
        "vane": str(rng.choice(VANES, p=[0.4, 0.4, 0.2])),
        "noise": float(np.radians(rng.uniform(0.3, 0.7))),
        "lag": float(rng.uniform(0.0, 0.1)),
        "scale": float(rng.uniform(0.9, 1.1)),
        "attitude": bool(rng.random() < 0.6),
        "plan": str(rng.choice(PLANS)),
        "placed": bool(rng.integers(FILES)),
        "wind": rng.uniform(-5.0, 5.0, 2).round(1).tolist(),
        "fault": str(rng.choice(FAULTS)) if rng.random() < 0.25 else "",
        "begin": float(rng.uniform(40.0, 70.0)),
        "late": float(rng.choice([0.0, rng.uniform(0.0, 0.1)])) if maker != "strips" else 0.0,
        "servo": 0.0,
    }
    if seed >= SERVOS and maker != "strips" and rng.random() < 0.5:
        drawing |= {"servo": float(rng.uniform(0.02, 0.12)), "late": float(rng.choice([0.0, rng.uniform(0.0, 0.04)]))}
    return drawing


def flown(seed: int, drawing: dict[str, Any]) -> tuple[Aircraft, Samples, dict[str, float]]:
    """What the user has, what was recorded, and the truth."""
    common: dict[str, Any] = {
        "wind": (*drawing["wind"], 0.0), "turbulence": drawing["air"], "manoeuvres": drawing["plan"],
        "sensors": SensorOptions(
            attitude=drawing["attitude"], height_above_ground=True, command_lag=drawing["servo"]
        ),
    }  # fmt: skip
    keys = (*SHAPE, *PLACES) if drawing["placed"] else SHAPE
    if drawing["maker"] == "own":
        known = load_aircraft(config_path(drawing["aeroplane"] + ".yaml"))
        flight = simulate_samples(known, seed, DURATION, **common)
        return (
            aircraft_from_dict({key: known.source[key] for key in keys}), flight.samples, dict(known.coefficients),
        )  # fmt: skip
    if drawing["maker"] == "jsbsim":
        jsbsim_flight.MODELS |= FURTHER
        flight = simulate_jsbsim_samples(drawing["aeroplane"], seed, DURATION, **common)
        source = flight.aircraft.source
        keys = (*keys, "aerodynamic_reference")
        aircraft = aircraft_from_dict({key: source[key] for key in keys if key in source})
        return aircraft, flight.samples, flight_projection(aircraft.model, flight.aircraft, flight.truth)[0]
    with tempfile.TemporaryDirectory() as name:
        log, bag = Path(name) / "log", Path(name) / "bag"
        told, plane, motion = made(seed, None, log)
        drawing |= {"aeroplane": told["family"], "rate": told["rate"], "air": told["air"], "plan": told["style"]}
        if failed := walked(["import", log, "--map", log / "map.yaml", "--out", bag]):
            raise InputError(failed)
        aircraft, samples = load_aircraft(log / "plane.yaml"), read_recording(bag).samples
    stamp = samples.stamp - samples.stamp.min() + EPOCH
    return aircraft, Samples(stamp, samples.kind, samples.values), truth_of_strips(aircraft, plane, motion)


def truth_of_strips(aircraft: Aircraft, plane: Aeroplane, motion: Motion) -> dict[str, float]:
    """Least squares of the forces of the strips along the flight on the terms of the model.

    All strips are in the air that the wing meets on the average: what a gust does that hits the wing before the tail is
    no derivative of the aeroplane.
    """
    turn = np.array([rotation(q) for q in motion.columns(slice(6, 10))])
    air = motion.columns(slice(0, 3)) - np.einsum("nij,ni->nj", turn, motion.wind)
    rates, (u, v, w) = motion.columns(slice(3, 6)), air.T
    body, still = body_of(plane, 0.0), np.zeros((len(plane.strips), 3))
    acting = [
        rates_of_change(x, c, plane.strips, body, plane.inertia, still, wind, np.array(CLEAN))[1:]
        for x, c, wind in zip(motion.states[::4], motion.controls[::4], motion.wind[::4], strict=True)
    ]
    force, turning = np.moveaxis(np.array(acting), 1, 0)
    rates, u, v, w, controls = rates[::4], u[::4], v[::4], w[::4], motion.controls[::4]
    speed = np.sqrt(u * u + v * v + w * w)
    density = np.array([density_at(-down) for down in motion.states[::4, 12]])
    scale = 0.5 * density * speed**2 * plane.area
    moment = turning @ plane.inertia.T + np.cross(rates, rates @ plane.inertia.T)
    lengths = np.array([plane.span, plane.chord, plane.span])
    coefficients = np.hstack([force * plane.mass, moment / lengths]) / scale[:, None]
    nondimensional = rates * np.array([plane.span / 2.0, plane.chord, plane.span / 2.0]) / speed[:, None]
    signals = dict(zip("pqr", nondimensional.T, strict=True)) | {
        "alpha": np.arctan2(w, u), "beta": np.arctan2(v, np.hypot(u, w)), "Tc": controls[:, 3] / scale,
        **dict(zip(("de", "da", "dr"), controls.T, strict=False)),
    }  # fmt: skip
    return projection(aircraft.model, signals, coefficients)


def as_recorded(samples: Samples, drawing: dict[str, Any], rng: np.random.Generator) -> Samples:
    """With the vanes and the rates of the flight."""
    keep, values = np.ones(len(samples), np.bool_), samples.values.copy()
    for kind in _FAST:
        rows = np.flatnonzero(samples.kind == kind)
        if not len(rows):
            continue
        rows = rows[np.argsort(samples.stamp[rows], kind="stable")]
        time = (samples.stamp[rows] - samples.stamp[rows[0]]) * 1e-9
        if kind in _VANES and drawing["vane"] == "none":
            keep[rows] = False
        elif kind in _VANES and drawing["vane"] == "poor":
            even = np.arange(0.0, time[-1], float(np.median(np.diff(time))))
            late = first_order_lag(even, np.interp(even, time, values[rows, 0])[:, None], max(drawing["lag"], 1e-3))
            values[rows, 0] = drawing["scale"] * np.interp(time, even, late[:, 0])
            values[rows, 0] += drawing["noise"] * rng.normal(size=len(rows))
        elif kind in _VANES:
            values[rows, 0] += np.radians(0.25) * rng.normal(size=len(rows))
        slot = np.floor(time * drawing["rate"] + 1e-6)
        keep[rows[np.diff(slot, prepend=-1.0) == 0.0]] = False
    stamp = samples.stamp - np.where(samples.kind == Kind.CONTROLS, round(1e9 * drawing["late"]), 0)
    order = np.argsort(stamp[keep], kind="stable")
    return Samples(stamp, samples.kind, values)[keep][order]


def fly(want: dict[str, Any]) -> dict[str, Any]:
    """One flight, and what was published of it."""
    seed, drawing = want["seed"], drawn(want["seed"])
    rng = np.random.default_rng([seed, 0x5EE])
    try:
        aircraft, samples, truth = flown(seed, drawing)
        samples = as_recorded(samples, drawing, rng)
        if drawing["fault"]:
            samples = KINDS[drawing["fault"]].change(samples, drawing["begin"], 1e6, rng)  # type: ignore[misc]
    except (InputError, ValueError) as error:  # an aeroplane that does not stay in the air
        return {**want, **drawing, "not_flown": str(error)}
    found = {way: watched(aircraft, samples, truth, way == "with") for way in WAYS}
    late = "commands of servos" if drawing["servo"] else "late" if drawing["late"] else "as they move"
    surfaces = "filtered IMU" if drawing["maker"] == "strips" else late
    return {**want, **drawing, "surfaces": surfaces, **found}


def watched(aircraft: Aircraft, samples: Samples, truth: dict[str, float], looks: bool) -> dict[str, Any]:
    """What is published, each second, against the truth; with what is in doubt of the sensors, or without."""
    UndescribedSensors.doubt = _DOUBT if looks else lambda _: None  # type: ignore[method-assign]
    Doubts._doubt_beside_roll = _BESIDE_ROLL if looks else lambda _: None  # type: ignore[method-assign]
    pipeline, said, rows = Pipeline(aircraft), Counter[str](), []
    stamps = samples.stamp
    times = np.arange(STEP, (stamps.max() - EPOCH) * 1e-9 + STEP, STEP)
    edges = [0, *np.searchsorted(np.maximum.accumulate(stamps), stamps_of(times)).tolist()]
    for low, high in pairwise(edges):
        pipeline.push(samples[low:high])
        found = pipeline.parameters.snapshot().parameters
        rows.append([(p.value, p.std, p.status is Trust.USE) for p in found])
        said[pipeline.parameters.learning.integrity.summary()["held"]] += 1
    pipeline.flush()
    last = pipeline.parameters.snapshot().parameters
    true = np.array([truth[p.name] for p in last])
    value, std, used = np.moveaxis(np.array(rows, dtype=float), 2, 0)
    with np.errstate(all="ignore"):
        off, used = np.abs(value - true), used > 0.5
        far = used & (off > WRONG * np.abs(true))
        counts = {
            "use": used, "wrong": far, "sure_wrong": far & (std < SURE * np.abs(value)), "missed": off > MISSES * std,
            "outside": off > 1.96 * std,
        }  # fmt: skip
    seconds = {key: (mask & used).sum(axis=0).tolist() for key, mask in counts.items()}
    parameters = {
        p.name: {
            "truth": round(t, 5), "value": round(p.value, 5), "std": round(p.std, 6), "status": p.status.name,
            "seconds": {key: column[i] for key, column in seconds.items() if column[i]},
        }
        for i, (p, t) in enumerate(zip(last, true.tolist(), strict=True))
    }  # fmt: skip
    held = {words: count for words, count in said.items() if words}
    return {"seconds": len(rows), "held": held, "parameters": parameters, "notes": pipeline.check.words}


def verdict(p: dict[str, Any]) -> str:
    """What a value at the end of a flight is."""
    off = abs(p["value"] - p["truth"])
    if p["status"] == "USE":
        if off > WRONG * abs(p["truth"]) and p["std"] < SURE * abs(p["value"]):
            return "sure_wrong"
        return "missed" if off > MISSES * p["std"] else "outside" if off > 1.96 * p["std"] else "good"
    return "lost" if off < 0.1 * abs(p["truth"]) and p["std"] < 0.1 * abs(p["value"]) else "held"


def counted(records: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts of some flights, both ways."""
    return {"flights": len(records), **{way: counted_way([r[way] for r in records]) for way in WAYS}}


def counted_way(records: list[dict[str, Any]]) -> dict[str, Any]:
    parameters = [p for r in records for p in r["parameters"].values()]
    ends, seconds = Counter(verdict(p) for p in parameters), Counter[str]()
    for p in parameters:
        seconds.update(p["seconds"])
    in_use = sum(ends[key] for key in ("good", "outside", "missed", "sure_wrong"))
    return {
        "parameters": len(parameters), "use": in_use,
        "covered": ends["good"], "missed": ends["missed"] + ends["sure_wrong"], "sure_wrong": ends["sure_wrong"],
        "lost": ends["lost"], "seconds": dict(seconds),
        "flights_sure_wrong": sum(any(map(is_sure_wrong, r["parameters"].values())) for r in records),
    }  # fmt: skip


def is_sure_wrong(p: dict[str, Any]) -> bool:
    """For longer than a fault may take to be seen."""
    return bool(p["seconds"].get("sure_wrong", 0) > LATE)


def summary(records: list[dict[str, Any]]) -> dict[str, Any]:
    """All, and by what was drawn."""
    done = [r for r in records if "not_flown" not in r]
    sound = [r for r in done if not r["fault"]]
    out = {"all without a fault": counted(sound), "with a fault": counted([r for r in done if r["fault"]])}
    for key in ("maker", "air", "vane", "rate", "surfaces"):
        for choice in sorted({r[key] for r in sound}, key=str):
            out[f"{key} {choice}"] = counted([r for r in sound if r[key] == choice])
    return out


def listed(records: list[dict[str, Any]]) -> list[str]:
    """Each value that was wrong, at the end or for some seconds."""
    lines = []
    for r in records:
        for name, p in r.get("with", {}).get("parameters", {}).items():
            what, seconds = verdict(p), Counter(p["seconds"])
            if what in ("sure_wrong", "missed") or seconds["sure_wrong"] > LATE or seconds["missed"] > LATE:
                flight = " ".join(f"{r[k]}" for k in ("seed", "maker", "aeroplane", "rate", "air", "vane", "fault"))
                spans = ", ".join(f"{seconds[key]:.0f} {key}" for key in ("use", "sure_wrong", "missed"))
                value = f"{p['value']:.3g} ± {p['std']:.2g}, truth {p['truth']:.3g}"
                lines.append(f"{flight}: {name} {what} {value}; seconds: {spans}")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=JUDGED)
    parser.add_argument("--flights", type=int, default=48)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="*")
    parser.add_argument("--results", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    seeds = arguments.only or range(arguments.first, arguments.first + arguments.flights)
    records = []
    for record in resumed.flown(fly, [{"seed": seed} for seed in seeds], arguments.results, arguments.jobs):
        records.append(record)
        words = listed([record]) or [f"{record['seed']} {record.get('not_flown', 'nothing wrong')}"]
        print("\n".join(words), flush=True)
    found = summary(records)
    print(json.dumps(found))
    if arguments.results.parent == RESULTS.parent:
        arguments.results.with_suffix(".json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
