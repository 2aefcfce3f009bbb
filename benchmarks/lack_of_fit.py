"""How far is the error of a coefficient above its noise, where the model is right and where it is not?

    python benchmarks/lack_of_fit.py [--seeds 3] [--data ../shared/data]

Flights of 90 s of the Ultra Stick 25e with vanes of 0.003 and 0.012 rad in turn, in three airs and at four rates of the
IMU, by every estimator; JSBSim's aeroplanes of jsbsim_truth.py with the 32 terms, which lack something there, and with
the terms that they have; and recordings of ``--data``: of another maker's simulator, whose file holds mass and shape
only, and of Thor. Writes results/lack_of_fit.json.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from gusts import with_vanes
from hidden_effects import with_slow_imu
from jsbsim_truth import fly

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.identification.options import EstimatorName, ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust, lack_of_fit
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.recordings.mat_import import import_mat
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.samples import Samples
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

ROOT = Path(__file__).resolve().parents[1]
RESULT = Path(__file__).parent / "results" / "lack_of_fit.json"
FIRST_SEED, DURATION, BLOCK = 97000, 90.0, 500
AIRS = {"none": "calm", "light": "light turbulence", "moderate": "moderate turbulence"}
Flight = tuple[Aircraft, Samples]


def judged(aircraft: Aircraft, samples: Samples, estimator: EstimatorName) -> dict[str, Any]:
    """The largest ratio of error to noise at the end and ever, axes that are held for it, and values with USE.

    The ratio is that of all of the motion, ``tenth`` what a tenth of it exceeds.
    """
    pipeline = Pipeline(aircraft, None, ParameterOptions(estimator=estimator))
    joint = estimator != "rls"  # see monitoring/doubts.py
    monitor, ever = pipeline.parameters.learning.integrity.errors.monitor, np.zeros((len(AXES), 2))

    def ratios() -> np.ndarray:
        return np.nan_to_num(monitor.fits()[:, 1:])

    for first in range(0, len(samples), BLOCK):
        pipeline.push(samples[first : first + BLOCK])
        ever = np.maximum(ever, ratios())
    pipeline.flush()
    held = [
        axis
        for axis, (unexplained, ratio, worst) in zip(AXES, monitor.fits().tolist(), strict=True)
        if lack_of_fit(axis, unexplained, ratio, np.nan if joint else worst) and not lack_of_fit(axis, unexplained)
    ]
    reasons = [p.reason for p in pipeline.parameters.snapshot().parameters]
    used = sum(p.status == Trust.USE for p in pipeline.parameters.snapshot().parameters)
    lost = sum(reason.startswith("the error of") for reason in reasons)
    largest, tenth = ever.max(axis=0).tolist()
    return {
        "end": ratios()[:, 0].tolist(), "ever": largest, "tenth": tenth,
        "held": held, "use": used, "use_without": used + lost,
    }  # fmt: skip


def row(name: str, model: str, estimator: EstimatorName, flights: list[Flight]) -> dict[str, Any]:
    """All flights of a kind."""
    found = [judged(*flight, estimator) for flight in flights]
    end = np.max([each["end"] for each in found], axis=0)
    line = {
        "flights": len(found), "name": name, "model": model, "estimator": estimator,
        "end": float(end.max()), "axis": AXES[int(end.argmax())], "ever": max(each["ever"] for each in found),
        "tenth": max(each["tenth"] for each in found),
        "held": sorted({axis for each in found for axis in each["held"]}),
        "use": sum(each["use"] for each in found), "use_without": sum(each["use_without"] for each in found),
    }  # fmt: skip
    print(json.dumps(line), flush=True)
    return line


def own(seed: int, air: str, rate: float) -> Flight:
    """One flight of the project's own simulator."""
    wind = (seed % 7 - 3.0, 2.0, 0.0)
    aircraft = with_vanes((0.003, 0.012)[seed % 2])
    if rate > 100.0:
        imu = {name: replace(aircraft.sensors[name], rate=rate) for name in ("accelerometer", "gyro")}
        aircraft = replace(aircraft, sensors={**aircraft.sensors, **imu})
    flight = simulate_samples(aircraft, seed, DURATION, wind=wind, turbulence=air)
    flight = with_slow_imu(flight, rate) if rate < 100.0 else flight
    return flight.aircraft, flight.samples


def rows(seeds: int, data: Path, folder: Path) -> Iterator[dict[str, Any]]:
    """All kinds of flights."""
    numbers = range(FIRST_SEED, FIRST_SEED + seeds)
    for air, words in AIRS.items():
        flown = [own(seed, air, 100.0) for seed in numbers]
        for estimator in ("rls", "fourier", "rml"):
            yield row(words, "right", estimator, flown)
    for rate in (400.0, 25.0, 10.0):
        yield row(f"calm, IMU at {rate:g} Hz", "right", "rls", [own(seed, "none", rate) for seed in numbers])
    for name in ("c172p", "J3Cub", "c182"):
        flight = fly(name, 1)
        added = load_aircraft(config_path(f"jsbsim_{name.lower()}.yaml"))
        yield row(f"JSBSim {name}", "right", "rls", [(added, flight.samples)])
        yield row(f"JSBSim {name}", "lacks terms", "rls", [(flight.aircraft, flight.samples)])
    for kind, numbers_of, model in (("clean", (1, 2, 3, 4), "right"), ("effect", (1, 2), "lacks an effect")):
        names = [data / "other_maker" / f"{kind}_{number}" for number in numbers_of]
        flown = [(load_aircraft(name.with_suffix(".yaml")), read_recording(name).samples) for name in names]
        yield row("another maker's simulator", model, "rls", flown)
    import_mat(data / "umn_thor_flight75" / "flight75.mat", folder / "thor")
    thor = load_aircraft(config_path("umn_thor.yaml")), read_recording(folder / "thor").samples
    yield row("Thor, a real flight", "not known", "rls", [thor])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        lines = list(rows(arguments.seeds, arguments.data, Path(folder)))
    content = {"duration": DURATION, "rows": lines}
    RESULT.write_text(json.dumps(content, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
