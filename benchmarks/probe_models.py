"""How wrong the paper's model of a probe is where the wind changes or the curve bends: results for docs/calibration.md.

    python benchmarks/probe_models.py [--flights 20] [--data ../shared/data]

Calibration flights with drawn errors in four conditions, each judged with the paper's model and with the one that the
flight is said to support. Every flight is one line of benchmarks/results/probe_models.jsonl: a stopped benchmark goes
on where it was.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from calibration_thor import HALVES

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.calibration.five_hole_probe import NAMES2, ProbeFlight, mount_matrix, probe_flight
from aircraft_sysid_ros.calibration.probe_models import ProbeModel, model_of, solve_probe
from aircraft_sysid_ros.calibration.procedure import Answer
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.recordings.mat_import import import_mat
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.sensors.sensor_models import EPOCH, air_data_at
from aircraft_sysid_ros.simulation.calibration_flight import calibration_flight, drawn_errors
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight

Array = npt.NDArray[np.float64]

RESULTS = Path(__file__).parent / "results"
RUNS, SUMMARY = RESULTS / "probe_models.jsonl", RESULTS / "probe_models.json"
FIRST = 4000
#: kappa [1/rad^2] of both angles, that of the firmware of Thor's probe, and random walk of the wind [m/s per sqrt(s)].
CONDITIONS = {"as the paper has it": (0.0, 0.0), "wind changes": (0.0, 0.1), "curve bends": (1.1, 0.0),
              "both": (1.1, 0.1)}  # fmt: skip
PARAMETERS = ("lambda_V", "b_V", "lambda_alpha", "b_alpha", "lambda_beta", "b_beta", "eps_phi")


def run(condition: str, seed: int) -> dict[str, Any]:
    """One flight with both models."""
    kappa, walk = CONDITIONS[condition]
    errors = drawn_errors(seed)
    errors = replace(errors, probe=replace(errors.probe, alpha_cubic=kappa, beta_cubic=kappa))
    flight = calibration_flight(seed, wind_walk=walk, errors=errors)
    made = probe_flight(flight.samples, flight.aircraft)
    found = solve_probe(made)
    paper = model_of(made, False, False)
    truth = flight.calibration["five_hole_probe"]
    return {
        "model": found.model.words, "steady": found.steady, "judged": found.told(),
        "paper": judged(flight, made, paper, found.paper, truth),
        "used": judged(flight, made, found.model, found.answer, truth),
    }  # fmt: skip


def judged(
    flight: SimulatedFlight, made: ProbeFlight, model: ProbeModel, answer: Answer, truth: dict[str, float]
) -> dict[str, Any]:
    """Error and standard error by parameter, rms of the calibrated flow against the truth."""
    std = dict(zip(answer.problem.names, answer.std, strict=True))
    time = made.navigation.time + (made.navigation.epoch - EPOCH) * 1e-9
    true = air_data_at(flight.truth.at(time), flight.aircraft.air_data_position)
    speed, alpha, beta = flow_of(model, answer)
    return {
        "parameters": {name: [answer.values[name] - truth[name], float(std[name])] for name in PARAMETERS},
        "airspeed": _rms(speed - true[:, 0]),
        "alpha": _rms(np.degrees(alpha - true[:, 1])), "beta": _rms(np.degrees(beta - true[:, 2])),
    }  # fmt: skip


def flow_of(model: ProbeModel, answer: Answer) -> Array:
    """Calibrated V [m/s], alpha, beta [rad] in body axes (3, n)."""
    xi1, xi2 = np.split(answer.xi, [answer.problem.n1])
    data = model.data
    if model.cubic:
        ratios = (r + kappa * r**3 for r, kappa in zip((data.alpha_ratio, data.beta_ratio), xi2[-2:], strict=True))
        data = replace(data, **dict(zip(("alpha_ratio", "beta_ratio"), ratios, strict=True)))
    alpha, beta = data.angles(xi2[: len(NAMES2)])
    flow = np.stack([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)], axis=1)
    u, v, w = (flow @ mount_matrix(float(xi2[4])).T).T
    return np.array([(1.0 + xi1[0]) * data.indicated + xi1[1], np.arctan2(w, u), np.arcsin(v)])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def thor(path: Path) -> list[dict[str, Any]]:
    """What is said of the real probe, by half of the flight."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "thor"
        import_mat(path, bag)
        samples = read_recording(bag).samples
    aircraft = load_aircraft(config_path("umn_thor.yaml"))
    out = []
    for half, span in HALVES.items():
        found = solve_probe(probe_flight(samples, aircraft, span))
        values = {name: [float(value), float(std)] for name, value, std in
                  zip(found.answer.problem.names, found.answer.xi, found.answer.std, strict=True)}  # fmt: skip
        out.append({"half": half, "model": found.model.words, "judged": found.told(), "parameters": values})
    return out


def summarise(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """By condition: which model is used, and how wrong both are."""
    out: dict[str, Any] = {}
    for condition in CONDITIONS:
        chosen = [run for run in runs if run["condition"] == condition]
        if not chosen:
            continue
        words = [run["model"] for run in chosen]
        out[condition] = {
            "flights": len(chosen),
            "models": {word: words.count(word) for word in sorted(set(words))},
            **{which: _errors([run[which] for run in chosen]) for which in ("paper", "used")},
        }
    return out


def _errors(rows: list[dict[str, Any]]) -> dict[str, Any]:
    out: dict[str, Any] = {key: float(np.sqrt(np.mean([row[key] ** 2 for row in rows])))
                           for key in ("airspeed", "alpha", "beta")}  # fmt: skip
    for name in PARAMETERS:
        pairs = np.array([row["parameters"][name] for row in rows])
        known = np.isfinite(pairs[:, 1])
        error, std = pairs[known].T
        out[name] = {"rms_error": _rms(error), "rms_z": _rms(error / std)}
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=20, help="of each condition")
    parser.add_argument("--data", type=Path, default=Path(__file__).resolve().parents[2] / "shared" / "data")
    arguments = parser.parse_args()
    lines = RUNS.read_text(encoding="utf8").splitlines() if RUNS.exists() else []
    runs = [json.loads(line) for line in lines]
    done = {(run["condition"], run["seed"]) for run in runs}
    for seed in range(FIRST, FIRST + arguments.flights):
        for condition in CONDITIONS:
            if (condition, seed) not in done:
                runs.append({"condition": condition, "seed": seed, **run(condition, seed)})
                with RUNS.open("a", encoding="utf8") as file:
                    file.write(json.dumps(runs[-1]) + "\n")
                print(condition, seed, runs[-1]["model"], flush=True)
    before = json.loads(SUMMARY.read_text(encoding="utf8")) if SUMMARY.exists() else {}
    flight = arguments.data / "umn_thor_flight75" / "flight75.mat"
    result = {"conditions": summarise(runs), "thor": thor(flight) if flight.exists() else before.get("thor", [])}
    SUMMARY.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
