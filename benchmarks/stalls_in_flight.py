"""What is in USE after flights through stalls, and what looking for two models costs flights in which there is one.

    python benchmarks/stalls_in_flight.py [--seeds 433 434 …] [--sound 321000 321001 …] [--jsbsim 61 62 …]

Flights of stalls.py, as a user imports them; of the certificate, in calm and light air with a complete aircraft file
and with one of mass and shape; and of JSBSim's c182, whose tables bend where the terms that it is given do not. Each
without ``monitoring.range_agreement``, with whole axes in HOLD for it, and as it is, which spares what holds in either
range. A value is wrong where it has USE and is off by more than a quarter and two standard errors: after a stall from
that of the flow before it separates, of the c182 from the projection of JSBSim's own coefficients on its terms. Looked
at once: rules were made on seeds below 421, and of JSBSim below 9. Writes results/stalls_in_flight.json.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import tempfile
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from certificate_flights import fly
from faults import users_file
from jet import write_flight
from jsbsim_truth import MAIN_DERIVATIVES
from jsbsim_truth import fly as fly_jsbsim
from stalls import KINDS, Transport

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.commands.main import main as command
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.identification.monitoring.doubts import Doubts
from aircraft_sysid_ros.identification.monitoring.range_agreement import RangeAgreement
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.samples import Samples
from aircraft_sysid_ros.simulation.jsbsim_derivatives import flight_projection

RESULT = Path(__file__).parent / "results" / "stalls_in_flight.json"
LONGITUDINAL = ("CX_alpha", "CX_alpha2", "CZ_alpha", "CZ_de", "Cm_alpha", "Cm_q", "Cm_de")
WRONG, SIGMAS, DURATION = 0.25, 2.0, 60.0
_LOOK, _SPARED = Doubts._not_one_model, RangeAgreement.spared
WAYS = ("without", "whole axes", "with")


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


def judged(
    aircraft: Aircraft, samples: Samples, truth: dict[str, float], way: str, asked: Sequence[str]
) -> dict[str, Any]:
    """What is published at the end and on the way; values ``asked`` for may be wrong."""
    whole = way == "whole axes"
    Doubts._not_one_model = (lambda *_: [""] * len(AXES)) if way == "without" else _LOOK  # type: ignore[method-assign]
    RangeAgreement.spared = (lambda _, __, v: np.zeros(len(v), bool)) if whole else _SPARED  # type: ignore[method-assign]
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
        "wrong": [p.name for p in known if p.name in asked and is_wrong(p.value, p.std, truth[p.name])],
        "names": [p.name for p in in_use],
    }


def is_wrong(value: float, std: float, truth: float) -> bool:
    return abs(value - truth) > max(WRONG * abs(truth), SIGMAS * std)


def all_ways(
    aircraft: Aircraft, samples: Samples, truth: dict[str, float], asked: Sequence[str] = LONGITUDINAL
) -> dict[str, Any]:
    found = {way: judged(aircraft, samples, truth, way, asked) for way in WAYS}
    whole = found["whole axes"].pop("names")
    spared = [name for name in found["with"].pop("names") if name not in whole]
    del found["without"]["names"]
    return {**found, "spared": spared}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="*", default=list(range(433, 445)))
    parser.add_argument("--sound", type=int, nargs="*", default=list(range(321000, 321006)))
    parser.add_argument("--jsbsim", type=int, nargs="*", default=list(range(61, 69)))
    arguments = parser.parse_args()
    stalls, sound, bent = [], [], []
    for seed in arguments.seeds:
        aircraft, samples, truth, kind = flown(seed)
        stalls.append({"seed": seed, "kind": kind, **all_ways(aircraft, samples, truth)})
        print(json.dumps(stalls[-1]), flush=True)
    for seed in arguments.sound:
        for air in ("none", "light"):
            flight = fly(seed, air, DURATION)
            for file in ("complete", "shape"):
                found = all_ways(users_file(flight.aircraft, file), flight.samples, flight.aircraft.coefficients)
                sound.append({"seed": seed, "air": air, "file": file, **found})
                print(json.dumps(sound[-1]), flush=True)
    aircraft = load_aircraft(config_path("jsbsim_c182.yaml"))
    for seed in arguments.jsbsim:
        jsbsim = fly_jsbsim("c182", seed)
        truth, _ = flight_projection(aircraft.model, aircraft, jsbsim.truth)
        bent.append({"seed": seed, **all_ways(aircraft, jsbsim.samples, truth, MAIN_DERIVATIVES)})
        print(json.dumps(bent[-1]), flush=True)
    content = {"stalls": stalls, "sound": sound, "bent": bent}
    RESULT.write_text(json.dumps(content, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
