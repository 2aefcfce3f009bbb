"""Campaign of faults: what is used while something fails, how soon it is held, and whether the cause is named.

    python benchmarks/faults.py [--flights 10000] [--healthy 500] [--first 9700000] [--jobs 2]

Each seed draws a fault of benchmarks/fault_kinds.py, its onset, whether it ends, the air, the manoeuvres and the
estimator. Every second what is published is held against the truth. A value is confidently wrong where it has USE, a
standard error below 5 % of itself and is off by more than 25 %; while the surface that failed, or that works again, has
not been moved since, nobody can know, and such seconds are counted by themselves, too. Each flight is a line in
results/faults.jsonl; a run that is stopped goes on where it was. Seeds are drawn before and looked at once.
"""

from __future__ import annotations

import argparse
import json
import os
import zlib

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # flights share the cores; before numpy is loaded

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import resumed
from failure_flights import SHAPE
from fault_kinds import ALL_KINDS_FROM, FIRST_KINDS, KINDS, FaultKind, effects_of

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import CONTRADICTED, StateField, contradiction_text
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions, stamps_of
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples
from aircraft_sysid_ros.simulation.varied_plan import PLANS

RESULTS = Path(__file__).parent / "results" / "faults.jsonl"
DURATION, STEP = 150.0, 1.0  # [s]
AIR = ("none", "light", "moderate")
#: What the aircraft file has: everything, or mass, shape and places of the sensors; and the rate of the IMU [Hz].
FILES, IMU_RATES = ("complete", "shape"), (50.0, 100.0)
#: What is said where it has mass and shape alone ("bare"), and the vane is out on the wing.
PLACE = (contradiction_text(next(code for code, sensor in CONTRADICTED.items() if sensor == "angle of attack")),)
PLACES = ("imu_position", "air_data_position", "gps_position")
ESTIMATORS = ("auto", "rls", "fourier", "rml")
MAIN = ("CZ_alpha", "Cm_alpha", "Cm_q", "Cm_de", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr", "CY_beta")
WRONG, SURE, MATTERS = 0.25, 0.05, 0.10
#: A surface has been moved where its record differs by so much [rad] from that at the onset; columns of the records.
MOVED, RECORDS = 0.0175, {"de": 0, "da": 1, "dr": 2}


def drawn(seed: int) -> dict[str, Any]:
    """Everything of a flight."""
    rng = np.random.default_rng([seed, 0xFA])
    return {
        "fault": str(rng.choice([*KINDS][: None if seed >= ALL_KINDS_FROM else FIRST_KINDS])),
        "begin": float(rng.uniform(50.0, 80.0)),
        "lasts": float(rng.choice([20.0, 40.0, DURATION])),
        "air": str(rng.choice(AIR)),
        "plan": str(rng.choice(PLANS)),
        "estimator": str(rng.choice(ESTIMATORS, p=[0.4, 0.3, 0.15, 0.15])),
        "attitude": bool(rng.random() < 0.5),
        "file": str(rng.choice(FILES)),
        "imu": float(rng.choice(IMU_RATES)),
    }


def fly(want: dict[str, Any]) -> dict[str, Any]:
    """One flight through the chain of replay and live."""
    seed, drawing = want["seed"], drawn(want["seed"])
    if not want["faulty"]:
        drawing |= {"fault": "", "lasts": 0.0, "file": want.get("file", drawing["file"])}
    aircraft, begin = default_aircraft(), drawing["begin"]
    end = min(begin + drawing["lasts"], DURATION)
    truth, effects = dict(aircraft.coefficients), ()
    kind = KINDS.get(drawing["fault"])
    if kind is not None:
        effects = effects_of(kind, truth, begin, end)
    result = {**want, **drawing, "begin": round(begin, 2), "end": round(end, 2)}
    try:
        samples = simulate_samples(
            aircraft, seed, DURATION, effects=effects, turbulence=drawing["air"], manoeuvres=drawing["plan"],
            sensors=SensorOptions(attitude=drawing["attitude"], height_above_ground=True),
        ).samples  # fmt: skip
    except InputError as error:  # an aeroplane with a surface that is stuck may not stay in the air
        return result | {"not_flown": str(error)}
    samples = at_rate(samples, drawing["imu"])
    if kind is not None and kind.change is not None:
        samples = kind.change(samples, begin, end, np.random.default_rng(seed))
    try:
        return result | watched(users_file(aircraft, drawing["file"]), samples, truth, drawing, end)
    except Exception as error:  # what the campaign is for
        return result | {"exception": f"{type(error).__name__}: {error}"}


def at_rate(samples: Samples, rate: float) -> Samples:
    """With an IMU that is so slow [Hz]."""
    imu = np.flatnonzero(samples.kind == Kind.IMU)
    every = max(round(1e9 / float(np.median(np.diff(samples.stamp[imu]))) / rate), 1)
    keep = np.ones(len(samples), np.bool_)
    keep[imu] = np.arange(len(imu)) % every == 0
    return samples[keep]


def users_file(aircraft: Aircraft, what: str) -> Aircraft:
    """The aircraft file of the user, see FILES; "bare": mass and shape alone."""
    keys = {"complete": tuple(aircraft.source), "shape": (*SHAPE, *PLACES), "bare": SHAPE}[what]
    return aircraft_from_dict({key: aircraft.source[key] for key in keys})


def moved_since(samples: Samples, kind: FaultKind | None, since: float) -> float:
    """When [s] a surface of a fault was first moved after a time [s]; that time, where the fault is of none."""
    columns = [RECORDS[name] for name in (kind.names if kind else ()) if name in RECORDS]
    rows = (samples.kind == Kind.CONTROLS) & (samples.stamp >= stamps_of([since])[0])
    record = samples.values[rows][:, columns]
    if not columns or not len(record):
        return since
    moved = np.abs(record - record[0]).max(axis=1) > MOVED
    stamps = samples.stamp[rows]
    return since + float(stamps[np.argmax(moved)] - stamps[0]) * 1e-9 if moved.any() else np.inf


def watched(
    aircraft: Aircraft, samples: Samples, truth: dict[str, float], drawing: dict[str, Any], end: float
) -> dict[str, Any]:
    """What is published, every second, against the truth."""
    pipeline = Pipeline(aircraft, None, ParameterOptions(estimator=drawing["estimator"]))
    kind, begin = KINDS.get(drawing["fault"]), drawing["begin"]
    lost = (
        {f"{axis}_{kind.surface}" for axis in ("CX", "CY", "CZ", "Cl", "Cm", "Cn")} if kind and kind.surface else set()
    )
    times = np.arange(STEP, DURATION + STEP, STEP)
    edges = [0, *np.searchsorted(samples.stamp, stamps_of(times)).tolist()]
    names = list(aircraft.model.parameter_names)
    columns = [names.index(name) for name in MAIN]
    wrong, sure_wrong, plain_wrong, said = [], [], [], set()
    use_before: list[str] = []
    held_at, nonfinite, after = np.full(len(MAIN), np.nan), 0, 0
    for time, (low, high) in zip(times, pairwise(edges), strict=True):
        pipeline.push(samples[low:high])
        published, plain = pipeline.parameters.snapshot().parameters, pipeline.parameters.estimates().parameters
        is_used = np.array([published[i].status is Trust.USE for i in columns])
        nonfinite += sum(p.status is Trust.USE and not np.isfinite([p.value, p.std]).all() for p in published)
        if time <= begin:
            use_before = [name for name, used in zip(MAIN, is_used, strict=True) if used]
            continue
        held_at = np.where(np.isnan(held_at) & ~is_used, time - begin, held_at)
        off = []
        for name, i, used in zip(MAIN, columns, is_used, strict=True):
            left = kind.left if kind and name in lost and time <= end else 1.0
            true = truth[name] * left
            scale = abs(truth[name])
            if plain[i].status is Trust.USE and abs(plain[i].value - true) > MATTERS * scale:
                plain_wrong.append(name)
            if used and abs(published[i].value - true) > WRONG * scale:
                wrong.append((name, float(time)))
                if published[i].std < SURE * abs(published[i].value):
                    off.append((name, float(time)))
        sure_wrong += off
        after += len(off) if time == times[-1] else 0
        said.add(pipeline.parameters.learning.integrity.summary()["held"])
        last = pipeline.state.last_row
        if last is not None and last[StateField.CONTRADICTION]:
            said.add(contradiction_text(int(last[StateField.CONTRADICTION])))
    touched = [name for name in use_before if name in set(plain_wrong)]
    held = [float(held_at[MAIN.index(name)]) for name in touched]
    late = [t for name, t in sure_wrong if t > begin + 5.0]  # until then what is published may still be the old value
    begun, over = moved_since(samples, kind, begin), moved_since(samples, kind, end) if end < DURATION else np.inf
    unmoved = sum(t <= begun + STEP or end < t <= over + STEP for t in late)
    words = " ".join(said)
    return {
        "used_before": len(use_before), "touched": touched,
        "held": max(held) if held and np.isfinite(held).all() else None,
        "wrong": len(wrong), "sure_wrong": len(late), "sure_wrong_at_the_end": after, "nonfinite": nonfinite,
        "sure_wrong_unmoved": unmoved,
        "sure_wrong_names": sorted({name for name, t in sure_wrong if t > begin + 5.0}),
        "holds": int(pipeline.parameters.learning.integrity.count),
        "named": any(word in words for word in (kind.names if kind else PLACE)),
        "use_at_the_end": int(is_used.sum()),
    }  # fmt: skip


def summary(records: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures of docs/trust.md: all, and by fault."""
    records = [r for r in records if "not_flown" not in r]
    faulty, bare = [r for r in records if r["faulty"]], [r for r in records if r.get("file") == "bare"]
    healthy = [r for r in records if not r["faulty"] and r.get("file") != "bare"]
    by_fault = {name: of_faults([r for r in faulty if r["fault"] == name]) for name in KINDS}
    return {
        "all": of_faults(faulty),
        "healthy": {
            "flights": len(healthy),
            "held": sum(r.get("holds", 0) > 0 for r in healthy),
            "sure_wrong": sum(r.get("sure_wrong", 0) > 0 for r in healthy),
            "exceptions": sum("exception" in r for r in healthy),
        },
        "bare": {
            "flights": len(bare),
            "named": sum(r["named"] for r in bare),
            "sure_wrong": sum(r["sure_wrong"] > 0 for r in bare),
        },
        "faults": {name: found for name, found in by_fault.items() if found["flights"]},
    }


def of_faults(records: list[dict[str, Any]]) -> dict[str, Any]:
    """Counts of some faulty flights; delays are of those in which the fault moved a main derivative by a tenth."""
    flown = [r for r in records if "exception" not in r]
    moved = [r for r in flown if r["touched"]]
    delays = [r["held"] for r in moved if r["held"] is not None]
    return {
        "flights": len(records), "exceptions": len(records) - len(flown),
        "nonfinite": sum(r["nonfinite"] > 0 for r in flown),
        "sure_wrong": sum(r["sure_wrong"] > 0 for r in flown),
        "sure_wrong_at_the_end": sum(r["sure_wrong_at_the_end"] > 0 for r in flown),
        "sure_wrong_though_moved": sum(r["sure_wrong"] > r["sure_wrong_unmoved"] for r in flown),
        "moved": len(moved), "held": len(delays),
        "median": float(np.median(delays)) if delays else None,
        "slowest": float(np.percentile(delays, 95)) if delays else None,
        "named": sum(r["named"] for r in moved if r["held"] is not None),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=10_000, help="with a fault")
    parser.add_argument("--healthy", type=int, default=500)
    parser.add_argument("--bare", type=int, default=50, help="healthy, of an aircraft file with mass and shape alone")
    parser.add_argument("--first", type=int, default=9_700_000, help="first seed")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--results", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    wanted = [{"seed": arguments.first + i, "faulty": True} for i in range(arguments.flights)]
    wanted += [{"seed": arguments.first + 50_000 + i, "faulty": False} for i in range(arguments.healthy)]
    bare = range(arguments.first + 80_000, arguments.first + 80_000 + arguments.bare)
    wanted += [{"seed": seed, "faulty": False, "file": "bare"} for seed in bare]
    wanted.sort(key=lambda want: zlib.crc32(str(want["seed"]).encode()))  # both sorts, wherever it is stopped
    records = []
    for record in resumed.flown(fly, wanted, arguments.results, arguments.jobs):
        records.append(record)
        print(json.dumps(record), flush=True)
    found = summary(records)
    print(json.dumps(found["all"], indent=1), json.dumps(found["healthy"], indent=1))
    if arguments.results.parent == RESULTS.parent:
        summed = arguments.results.with_suffix(".json")
        summed.write_text(json.dumps(found, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
