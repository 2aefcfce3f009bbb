"""What is in USE after flights through stalls, and what looking for two models costs flights in which there is one.

    python benchmarks/stalls_in_flight.py [--seeds 421 422 …] [--sound 320000 320001 …]

Flights of stalls.py, as a user imports them, and of the certificate, in calm and light air with a complete aircraft
file and with one of mass and shape; each with and without ``monitoring.range_agreement``. After a stall a value is
wrong where it has USE and is off by more than a quarter and two standard errors from that of the flow before it
separates. Looked at once. Writes results/stalls_in_flight.json.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from certificate_flights import fly
from faults import users_file
from jet import write_flight
from stalls import KINDS, Transport

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.commands.main import main as command
from aircraft_sysid_ros.identification.monitoring.doubts import Doubts
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.samples import Samples

RESULT = Path(__file__).parent / "results" / "stalls_in_flight.json"
LONGITUDINAL = ("CX_alpha", "CX_alpha2", "CZ_alpha", "CZ_de", "Cm_alpha", "Cm_q", "Cm_de")
WRONG, SIGMAS, DURATION = 0.25, 2.0, 60.0
_LOOK = Doubts._not_one_model


def flown(seed: int) -> tuple[Aircraft, Samples, dict[str, float], str]:
    """A flight as it is imported, and what its model would be if the flow did not separate."""
    flight = Transport(KINDS[seed % len(KINDS)], seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_flight(folder, flight)
        table, bag = folder / "flight.csv", folder / "bag"
        if command(["import", str(table), "--map", str(folder / "map.yaml"), "--out", str(bag)]):
            raise RuntimeError(f"seed {seed} is not imported")
        aircraft = load_aircraft(folder / f"{flight.name}.yaml")
        samples = read_recording(bag).samples
    return aircraft, samples, attached(aircraft.model, Transport(flight.kind, seed)), flight.kind


def attached(model: AerodynamicModel, flight: Transport, speed: float = 90.0) -> dict[str, float]:
    """Least squares of the coefficients of flow that does not separate, at angles of attack below the stall."""
    random, rows, terms = np.random.default_rng(0), [], []
    flight.attached = 1.0
    for _ in range(2000):
        alpha, beta, tc = random.uniform([0.03, -0.05, 0.0], [0.18, 0.05, 0.05])
        rates, controls = random.uniform(-0.1, 0.1, 3), random.uniform(-0.08, 0.08, 3)
        rows.append(flight.coefficients(0.0, (speed, alpha, beta, 0.0, tc), rates, controls))
        terms.append({"1": 1.0, "alpha": alpha, "alpha**2": alpha**2, "q": rates[1] * flight.chord / speed,
                      "de": controls[0], "Tc": 0.0})  # fmt: skip
    truth = {}
    for axis in ("CX", "CZ", "Cm"):
        x = np.array([[row[term] for term in model.terms[axis]] for row in terms])
        theta = np.linalg.lstsq(x, np.array(rows)[:, AXES.index(axis)], rcond=None)[0]
        truth |= dict(zip(model.parameter_names[model.axis_slice(axis)], theta.tolist(), strict=True))
    return truth


def judged(aircraft: Aircraft, samples: Samples, truth: dict[str, float], looks: bool) -> dict[str, Any]:
    """What is published at the end and on the way."""
    Doubts._not_one_model = _LOOK if looks else lambda *_: [""] * len(AXES)  # type: ignore[method-assign]
    pipeline, used, stamps = Pipeline(aircraft), [], samples.stamp
    edges = [*np.searchsorted(stamps, np.arange(stamps.min(), stamps.max(), 10**9)).tolist(), len(samples)]
    for low, high in pairwise(edges):
        pipeline.push(samples[low:high])
        used.append([p.status is Trust.USE for p in pipeline.parameters.snapshot().parameters])
    pipeline.flush()
    found, times = pipeline.parameters.snapshot().parameters, np.array(used)
    in_use = [p for p in found if p.status is Trust.USE]
    known = [p for p in in_use if p.name in truth]
    first = [int(column.argmax()) for column in times.T if column.any()]
    return {
        "use": len(in_use),
        "share": float(times.mean()),
        "until": float(np.median(first)),
        "covered": sum(abs(p.value - truth[p.name]) < 1.96 * p.std for p in known),
        "wrong": [p.name for p in known if p.name in LONGITUDINAL and is_wrong(p.value, p.std, truth[p.name])],
    }


def is_wrong(value: float, std: float, truth: float) -> bool:
    return abs(value - truth) > max(WRONG * abs(truth), SIGMAS * std)


def both(aircraft: Aircraft, samples: Samples, truth: dict[str, float]) -> dict[str, Any]:
    return {name: judged(aircraft, samples, truth, name == "with") for name in ("with", "without")}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="*", default=list(range(421, 433)))
    parser.add_argument("--sound", type=int, nargs="*", default=list(range(320000, 320005)))
    arguments = parser.parse_args()
    stalls, sound = [], []
    for seed in arguments.seeds:
        aircraft, samples, truth, kind = flown(seed)
        stalls.append({"seed": seed, "kind": kind, **both(aircraft, samples, truth)})
        print(json.dumps(stalls[-1]), flush=True)
    for seed in arguments.sound:
        for air in ("none", "light"):
            flight = fly(seed, air, DURATION)
            for file in ("complete", "shape"):
                found = both(users_file(flight.aircraft, file), flight.samples, flight.aircraft.coefficients)
                sound.append({"seed": seed, "air": air, "file": file, **found})
                print(json.dumps(sound[-1]), flush=True)
    RESULT.write_text(json.dumps({"stalls": stalls, "sound": sound}, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
