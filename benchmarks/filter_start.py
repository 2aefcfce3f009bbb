"""How soon the filter knows wind and airspeed scale, by what it starts with: results for docs/calibration.md.

    python benchmarks/filter_start.py [--flights 50]

Calibration flights with an airspeed that is wrong by a scale of 10 to 30 % either way and 8 m/s of wind from anywhere.
The filter has the pressures by nominal sensitivities, and the errors of the air data as states or not, started by
nothing, by stage 1 on the first minute, or by the calibration of another flight with the same probe in another wind.
Every flight is one line of benchmarks/results/filter_start.jsonl: a stopped benchmark goes on where it was.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.calibration.calibration_file import FIVE_HOLE, Calibration, calibration_from_dict
from aircraft_sysid_ros.calibration.correction import Correction
from aircraft_sysid_ros.calibration.filter_start import start_by_stage_1, start_of_calibration
from aircraft_sysid_ros.calibration.five_hole_probe import SENSITIVITY
from aircraft_sysid_ros.calibration.report import calibrate_probe
from aircraft_sysid_ros.reconstruction.air_data_errors import StartValues
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.five_hole_probe import ProbeCalibration
from aircraft_sysid_ros.simulation.calibration_flight import InstrumentTruth, calibration_flight, drawn_errors

Array = npt.NDArray[np.float64]

RESULTS = Path(__file__).parent / "results"
RUNS, SUMMARY = RESULTS / "filter_start.jsonl", RESULTS / "filter_start.json"
FIRST = 3000
#: What counts as known: horizontal wind [m/s], airspeed scale; and for how long stage 1 has listened [s].
WIND, SCALE, MINUTE = 0.5, 0.02, 60.0
SPEED = 8.0
CHUNK = 0.5  # [s] between looks at the filter
NOMINAL = calibration_from_dict({FIVE_HOLE: {"alpha_sensitivity": SENSITIVITY, "beta_sensitivity": SENSITIVITY}})


def drawn(seed: int) -> tuple[InstrumentTruth, Array]:
    """Errors of the probe and the wind NED (3,)."""
    rng = np.random.default_rng([seed, 31])
    probe = ProbeCalibration(
        airspeed_scale=float(rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.3)),
        airspeed_offset=float(rng.normal(0.0, 0.3)),
        alpha_scale=float(rng.uniform(-0.1, 0.1)), alpha_offset=float(rng.normal(0.0, 0.026)),
        beta_scale=float(rng.uniform(-0.1, 0.1)), beta_offset=float(rng.normal(0.0, 0.026)),
    )  # fmt: skip
    direction = rng.uniform(-np.pi, np.pi)
    return replace(drawn_errors(seed), probe=probe), SPEED * np.array([np.cos(direction), np.sin(direction), 0.0])


def run(seed: int) -> dict[str, Any]:
    """All starts on one flight."""
    errors, wind = drawn(seed)
    flight = calibration_flight(seed, wind=wind, errors=errors)
    earlier = calibration_flight(seed + 5000, errors=errors)
    report = calibrate_probe(earlier.samples, earlier.aircraft, samples=64, curve="linear", wind="steady")
    calibrated = calibration_from_dict({FIVE_HOLE: report.section})
    samples = flight.samples[flight.samples.kind != Kind.MAGNETIC_FIELD]  # it has errors of its own
    nominal = Correction(NOMINAL).apply(samples)
    by_stage_1, end = start_by_stage_1(nominal, flight.aircraft, MINUTE)
    states, scale = StateOptions(air_data_errors=True), errors.probe.airspeed_scale
    flown = {
        "no states": fly(flight.aircraft, nominal, StateOptions()),
        "from zero": fly(flight.aircraft, nominal, states),
        "from stage 1": fly(flight.aircraft, nominal, states, (by_stage_1, end)),
        "from a calibration": fly(
            flight.aircraft, Correction(calibrated).apply(samples), states,
            (start_of_calibration(calibrated), 0),
        ),
    }  # fmt: skip
    out: dict[str, Any] = {"scale": scale, "starts": {}}
    for name, found in flown.items():
        known = calibrated if name == "from a calibration" else NOMINAL
        out["starts"][name] = judged(found, wind, scale, known)
    out["stage_1"] = {
        "wind": float(np.linalg.norm((by_stage_1.wind - wind)[:2])),
        "scale": float((1.0 + by_stage_1.errors[0]) / (1.0 + scale) - 1.0),
    }
    return out


def fly(aircraft: Any, samples: Samples, options: StateOptions, start: tuple[StartValues, int] | None = None) -> Array:
    """Time [s], wind NED, lambda_V and its standard deviation (n, 6) every CHUNK seconds."""
    estimator, told, rows = StateEstimator(aircraft, options), False, []
    begin = int(samples.stamp.min())
    chunk = ((samples.stamp - begin) * 1e-9 // CHUNK).astype(np.int64)
    for number in np.unique(chunk):
        if start is not None and not told and begin + number * CHUNK * 1e9 >= start[1]:
            estimator.take_start(start[0])
            told = True
        estimator.push(samples[chunk == number])
        if estimator.last_row is not None:
            scale = estimator.air_data_errors.get("lambda_V", {"value": 0.0, "std": np.nan})
            rows.append([(number + 1) * CHUNK, *estimator.last_row[StateField.WIND], scale["value"], scale["std"]])
    return np.array(rows)


def judged(found: Array, wind: Array, scale: float, known: Calibration) -> dict[str, Any]:
    """When wind and scale are near the truth and stay there; None: never. Errors at the end."""
    off_wind = np.linalg.norm(found[:, 1:3] - wind[:2], axis=1)
    total = (1.0 + found[:, 4]) * (1.0 + known.five_hole_probe["lambda_V"])
    off_scale = total / (1.0 + scale) - 1.0
    near_wind, near_scale = off_wind < WIND, np.abs(off_scale) < SCALE
    return {
        "wind": _settled(found[:, 0], near_wind), "scale": _settled(found[:, 0], near_scale),
        "both": _settled(found[:, 0], near_wind & near_scale),
        "wind_error": float(off_wind[-1]), "scale_error": float(off_scale[-1]), "scale_std": float(found[-1, 5]),
    }  # fmt: skip


def _settled(time: Array, near: npt.NDArray[np.bool_]) -> float | None:
    if not near[-1]:
        return None
    far = np.flatnonzero(~near)
    return float(time[0] if not len(far) else time[far[-1] + 1])


def summarise(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """By start: median and 90 % of the times, infinite where it is never, and errors at the end."""
    out: dict[str, Any] = {"flights": len(runs), "starts": {}}
    for name in runs[0]["starts"]:
        each = [run["starts"][name] for run in runs]
        row: dict[str, Any] = {}
        for what in ("wind", "scale", "both"):
            times = np.array([np.inf if e[what] is None else e[what] for e in each])
            late = float(np.sort(times)[max(int(np.ceil(0.9 * len(times))) - 1, 0)])
            half = float(np.sort(times)[(len(times) - 1) // 2])
            row[what] = {"median": half if np.isfinite(half) else None, "late": late if np.isfinite(late) else None,
                         "reached": float(np.mean(np.isfinite(times)))}  # fmt: skip
        row["wind_error"] = float(np.sqrt(np.mean([e["wind_error"] ** 2 for e in each])))
        row["scale_error"] = float(np.sqrt(np.mean([e["scale_error"] ** 2 for e in each])))
        out["starts"][name] = row
    out["stage_1"] = {what: float(np.sqrt(np.mean([run["stage_1"][what] ** 2 for run in runs])))
                      for what in ("wind", "scale")}  # fmt: skip
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=50)
    arguments = parser.parse_args()
    lines = RUNS.read_text(encoding="utf8").splitlines() if RUNS.exists() else []
    runs = [json.loads(line) for line in lines]
    done = {run["seed"] for run in runs}
    for seed in range(FIRST, FIRST + arguments.flights):
        if seed not in done:
            runs.append({"seed": seed, **run(seed)})
            with RUNS.open("a", encoding="utf8") as file:
                file.write(json.dumps(runs[-1]) + "\n")
            print(seed, flush=True)
    SUMMARY.write_text(json.dumps(summarise(runs), indent=1) + "\n", encoding="utf8")
    print(json.dumps(summarise(runs), indent=1))


if __name__ == "__main__":
    main()
