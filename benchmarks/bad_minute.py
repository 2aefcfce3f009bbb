"""One bad minute: sensors that fail for some seconds, a surface that sticks or loses half of its effect, and nothing.

    python benchmarks/bad_minute.py [--seeds 6] [--clean 20]

Simulated flights go through the whole chain. Every half second what is published is compared with what it would be
without the integrity monitor, and with the truth: when the parameters of the failure are held, when they are used
again, and by how much the main derivatives are wrong while their status is USE.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Samples
from aircraft_sysid_ros.sensors.sensor_models import stamps_of
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.sensor_faults import FAULTS, stuck_surface, with_fault
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

Array = npt.NDArray[np.float64]

DURATION, BEGIN, END = 150.0, 60.0, 85.0  # [s]: the multisines begin before the failure
STEP, CLEAN_STEP = 0.5, 2.0  # [s] between looks
AIR = ("none", "light")
MAIN = ("CZ_alpha", "Cm_alpha", "Cm_q", "Cm_de", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr", "CY_beta")
#: A value that is used may be wrong by so much, of itself, before it is called wild.
WILD = 0.3
HALF = f"max(sign(time-{BEGIN:g}),0)*de"
STUCK, HALVED, RECORD = "rudder_stuck", "elevator_halved", "elevator_record"
#: Main derivatives that a failure of the aeroplane touches; those of a sensor touch all.
TOUCHED = {STUCK: ("Cn_beta", "Cn_r", "Cn_dr")} | dict.fromkeys((HALVED, RECORD), ("Cm_alpha", "Cm_q", "Cm_de"))


class Watched:
    """A flight through the chain: (steps, parameters) with the integrity monitor and without it."""

    def __init__(self, aircraft: Aircraft, samples: Samples, estimator: str = "rls", step: float = STEP) -> None:
        pipeline = Pipeline(aircraft, None, ParameterOptions(estimator=estimator))
        self.names = list(aircraft.model.parameter_names)
        self.time = np.arange(step, DURATION, step)
        sets: list[tuple[ParameterSet, ParameterSet]] = []
        edges = [0, *np.searchsorted(samples.stamp, stamps_of(self.time)).tolist()]
        for low, high in pairwise(edges):
            pipeline.push(samples[low:high])
            sets.append((pipeline.parameters.snapshot(), pipeline.parameters.estimates()))
        self.value, self.plain = (np.array([[p.value for p in s[i].parameters] for s in sets]) for i in (0, 1))
        self.use, self.plain_use = (
            np.array([[p.status == Trust.USE for p in s[i].parameters] for s in sets]) for i in (0, 1)
        )
        self.integrity, self.changes = pipeline.parameters.learning.integrity, pipeline.parameters.learning.changes
        self.reasons = [{p.name: p.reason for p in s[0].parameters} for s in sets]

    def worst(self, truth: dict[str, float], since: float, plain: bool = False) -> float:
        """Largest relative error of a main derivative with USE after ``since`` [s]."""
        value, use = (self.plain, self.plain_use) if plain else (self.value, self.use)
        columns = [self.names.index(name) for name in MAIN]
        error = np.abs(value[:, columns] / np.array([truth[name] for name in MAIN]) - 1.0)
        chosen = use[:, columns] & (self.time > since)[:, None]
        return float(error[chosen].max()) if chosen.any() else 0.0

    def held(self, names: Sequence[str], begin: float) -> float | None:
        """Seconds from ``begin`` until none of some parameters has USE."""
        used = self.use[:, [self.names.index(name) for name in names]].any(axis=1)
        first = np.flatnonzero((self.time >= begin) & ~used)
        return float(self.time[first[0]] - begin) if len(first) else None

    def back(self, names: Sequence[str], since: float) -> float | None:
        """Seconds from ``since`` until all of some parameters have USE for good."""
        used = self.use[:, [self.names.index(name) for name in names]].all(axis=1)
        if not used[-1]:
            return None
        last = np.flatnonzero(~used)
        return max(float(self.time[last[-1]] + STEP - since), 0.0) if len(last) else 0.0


def used_before(watched: Watched, begin: float) -> list[str]:
    """Main derivatives that had USE when the failure came."""
    at = int(np.searchsorted(watched.time, begin)) - 1
    return [name for name in MAIN if watched.use[at, watched.names.index(name)]]


def failure(aircraft: Aircraft, name: str, seed: int, air: str) -> dict[str, Any]:
    """One flight with a failure: what became of the parameters."""
    truth, effects = dict(aircraft.coefficients), tuple[Effect, ...]()
    if name == STUCK:
        effects = stuck_surface(truth, "dr", 0.0, BEGIN, END)
    if name == HALVED:
        effects = tuple(Effect(axis, HALF, -0.5 * truth[f"{axis}_de"]) for axis in ("CX", "CZ", "Cm"))
    flight = simulate_samples(aircraft, seed, DURATION, effects=effects, turbulence=air)
    samples = with_fault(flight.samples, name, BEGIN, END) if name in FAULTS else flight.samples
    watched = Watched(aircraft, samples)
    touched = [n for n in used_before(watched, BEGIN) if n in TOUCHED.get(name, MAIN)]
    after = truth | ({"Cm_de": 0.5 * truth["Cm_de"]} if name == HALVED else {})
    ended = BEGIN if name == HALVED else END
    late = BEGIN + (watched.held(touched, BEGIN) or 0.0)  # until then what is published is still the old value
    return {
        "failure": name, "seed": seed, "air": air, "used_before": len(touched),
        "held": watched.held(touched, BEGIN), "back": watched.back(touched, ended),
        "worst": watched.worst(after, late), "worst_plain": watched.worst(after, late, plain=True),
        "reason": watched.reasons[int((late + 5.0) / STEP)].get(touched[-1], ""),
    }  # fmt: skip


def clean(aircraft: Aircraft, seed: int, air: str, estimator: str) -> dict[str, Any]:
    """A flight without any failure: what the integrity monitor costs."""
    samples = simulate_samples(aircraft, seed, DURATION, turbulence=air).samples
    watched = Watched(aircraft, samples, estimator, CLEAN_STEP)
    late = watched.time > 0.4 * DURATION
    return {
        "seed": seed, "air": air, "estimator": estimator, "holds": watched.integrity.count,
        "use": float(watched.use[late].mean()), "use_plain": float(watched.plain_use[late].mean()),
        "disagreeing": float((watched.plain_use & ~watched.use)[late].any(axis=0).sum()),
        "same": bool(np.array_equal(watched.value, watched.plain, equal_nan=True)),
    }  # fmt: skip


def summary(records: list[dict[str, Any]]) -> dict[str, Any]:
    """Delays and errors of one failure."""
    held = [r["held"] for r in records if r["held"] is not None]
    back = [r["back"] for r in records if r["back"] is not None]
    return {
        "flights": len(records), "held": len(held), "back": len(back),
        "held_median": float(np.median(held)) if held else None, "held_worst": max(held, default=None),
        "back_median": float(np.median(back)) if back else None, "back_worst": max(back, default=None),
        "worst": max(r["worst"] for r in records), "worst_plain": max(r["worst_plain"] for r in records),
        "wild": sum(r["worst"] > WILD for r in records), "wild_plain": sum(r["worst_plain"] > WILD for r in records),
        "reason": records[0]["reason"],
    }  # fmt: skip


def of_clean(records: list[dict[str, Any]]) -> dict[str, Any]:
    """What the integrity monitor costs over flights without a failure."""
    return {
        "flights": len(records),
        "with_hold": sum(r["holds"] > 0 for r in records),
        "same": sum(r["same"] for r in records),
        **{key: float(np.mean([r[key] for r in records])) for key in ("use", "use_plain", "disagreeing")},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6, help="flights per failure and air")
    parser.add_argument("--clean", type=int, default=20, help="flights without one, per air")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "bad_minute.json")
    arguments = parser.parse_args()
    aircraft, result = default_aircraft(), dict[str, Any]()
    cases = [
        ("calm air, `rls`", "none", "rls", arguments.clean),
        ("light turbulence, `rls`", "light", "rls", arguments.clean),
        ("calm air, `fourier`", "none", "fourier", arguments.clean // 2),
        ("calm air, `rml`", "none", "rml", arguments.clean // 4),
        ("light turbulence, `rml`", "light", "rml", arguments.clean // 4),
    ]
    result["clean"] = {
        label: of_clean([clean(aircraft, 100 + seed, air, estimator) for seed in range(count)])
        for label, air, estimator, count in cases
    }
    print(result["clean"], flush=True)
    result["failures"] = {air: {} for air in AIR}
    for name in (*FAULTS, STUCK, HALVED):
        for air in AIR:
            records = [failure(aircraft, name, seed, air) for seed in range(arguments.seeds)]
            result["failures"][air][name] = summary(records)
            print(air, name, result["failures"][air][name], flush=True)
    result |= {"duration": DURATION, "begin": BEGIN, "end": END, "wild": WILD, "cores": os.cpu_count()}
    arguments.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
