"""Are values true in gusts, and if not, where does it come from?

    python benchmarks/gusts.py [--causes 10] [--flights 20]

Flights of 60 s of the Ultra Stick 25e, whose file is complete and right, in calm air, light and moderate Dryden
turbulence. Part one, in light turbulence: least squares with the regressors of the filter, of the smoother, of the
vanes, or with the truth in place of one thing after another. Its seeds were looked at while the second step was made.
Part two: the live estimators with the angles of the filter and with ``measured_angles``, with the noise of the vanes as
in the file and with four times as much. Its seeds were looked at once. Writes results/gusts.json.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from accuracy import MAIN_DERIVATIVES

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.coefficients.layout import Body, CoefficientBatch, CoefficientSample
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.options import EstimatorName, ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.reconstruction.smoother_history import SmootherHistory
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, default_aircraft, simulate_samples

Array = npt.NDArray[np.float64]
Run = dict[str, Any]

RESULT = Path(__file__).parent / "results" / "gusts.json"
DURATION, BLOCK = 60.0, 1000
CAUSE_SEED, FIRST_SEED = 7000, 88000
AIRS, VANE_NOISE = ("none", "light", "moderate"), (0.003, 0.012)  # [rad]
ESTIMATORS: tuple[EstimatorName, ...] = ("rls", "fourier")
EXCITED, NORMAL_95, FAR = 3.0, 1.96, 0.25
_FLOW = (StateField.AIRSPEED, StateField.ANGLE_OF_ATTACK, StateField.SIDESLIP)


def with_vanes(noise: float) -> Aircraft:
    """The aeroplane with vanes of a noise [rad], which its file states."""
    aircraft = default_aircraft()
    vanes = {name: replace(aircraft.sensors[name], noise=(noise,)) for name in ("angle_of_attack", "sideslip")}
    return replace(aircraft, sensors={**aircraft.sensors, **vanes})


def fly(seed: int, air: str, noise: float) -> SimulatedFlight:
    """The flight of one seed: wind of up to 6 m/s from any side, as in accuracy.py."""
    random = np.random.default_rng(1000 + seed)
    speed, direction = random.uniform(0.0, 6.0), random.uniform(-np.pi, np.pi)
    wind = (speed * np.cos(direction), speed * np.sin(direction), 0.0)
    return simulate_samples(with_vanes(noise), seed, DURATION, wind=wind, turbulence=air)


def states_of(flight: SimulatedFlight, tape: SmootherHistory | None = None) -> tuple[Array, StateEstimator]:
    """States of the filter, and the filter."""
    estimator, samples = StateEstimator(flight.aircraft, None, tape), flight.samples
    parts = [estimator.push(samples[i : i + BLOCK]) for i in range(0, len(samples), BLOCK)]
    return np.vstack([*parts, estimator.flush()]), estimator


def identified(flight: SimulatedFlight, rows: Array, epoch: int, identifier: Identifier) -> Run:
    """What an identifier knows at the end of states."""
    identifier.push_samples(flight.samples, epoch)
    for i in range(0, len(rows), BLOCK):
        identifier.push_states(rows[i : i + BLOCK], epoch)
    identifier.flush()
    found = identifier.snapshot().parameters
    return {
        "value": [p.value for p in found],
        "std": [p.std for p in found],
        "excited": [p.excitation >= EXCITED for p in found],
        "use": [p.status == Trust.USE for p in found],
    }


# -- where it comes from ---------------------------------------------------------------------------------------------


def with_true_coefficients(identifier: Identifier, flight: SimulatedFlight, offset: float) -> Identifier:
    """The measured coefficients replaced by the window means of the true ones; ``offset`` [s] of the clock."""
    stream, half_width = identifier.stream, identifier.options.half_width
    made, places = stream.batch, np.linspace(-1.0, 1.0, 33)

    def batch(rows: Array, history: Array, body: Body) -> CoefficientBatch:
        new = made(rows, history, body)
        for sample in new.samples:
            truth = flight.truth.at(sample[CoefficientSample.TIME] + offset + half_width * places)
            weight = (1.0 - places**2) * truth.density * truth.airspeed**2
            sample[CoefficientSample.MEASURED] = weight @ truth.coefficients / weight.sum()
        return new

    stream.batch = batch  # type: ignore[method-assign]
    return identifier


def causes_of(seed: int) -> dict[str, Run]:
    """One flight in light turbulence, by what stands in the regression."""
    flight = fly(seed, "light", VANE_NOISE[0])
    rows, estimator = states_of(flight, SmootherHistory())
    epoch = estimator.epoch
    assert epoch is not None
    offset = (epoch - int(flight.biases.stamp[0])) * 1e-9
    truth = flight.truth.at(rows[:, StateField.TIME] + offset)
    true = dict(zip(_FLOW, (truth.airspeed, truth.alpha, truth.beta), strict=True))

    def replaced(*columns: int) -> Array:
        new = rows.copy()
        for column in columns:
            new[:, column] = true[column]
        return new

    def by_filter() -> Identifier:
        return Identifier(flight.aircraft, ParameterOptions(measured_angles=False))

    def with_truth() -> Identifier:
        return with_true_coefficients(by_filter(), flight, offset)

    cases = {
        "filter": (rows, by_filter()),
        "true airspeed": (replaced(_FLOW[0]), by_filter()),
        "true angles": (replaced(*_FLOW[1:]), by_filter()),
        "true coefficients": (rows, with_truth()),
        "true angles, airspeed and coefficients": (replaced(*_FLOW), with_truth()),
        "smoother": (estimator.smooth(), by_filter()),
        "vanes, freed of their noise": (rows, Identifier(flight.aircraft)),
    }
    return {name: identified(flight, states, epoch, identifier) for name, (states, identifier) in cases.items()}


# -- whether it is true ----------------------------------------------------------------------------------------------


def proof_of(job: tuple[str, float, int]) -> dict[str, Run]:
    """One flight by estimator and regressors."""
    air, noise, seed = job
    flight = fly(seed, air, noise)
    rows, estimator = states_of(flight)
    assert estimator.epoch is not None
    runs = {}
    for name in ESTIMATORS:
        for regressors, measured in (("filter", False), ("vanes", True)):
            options = ParameterOptions(estimator=name, measured_angles=measured)
            identifier = Identifier(flight.aircraft, options)
            runs[f"{name} {regressors}"] = identified(flight, rows, estimator.epoch, identifier)
    return runs


def summarised(runs: list[Run]) -> Run:
    """Coverage by axis, bias over standard error, and values with USE that are far off."""
    aircraft = default_aircraft()
    names = aircraft.model.parameter_names
    truth = np.array([aircraft.coefficients[name] for name in names])
    value, std, excited, use = (np.array([run[key] for run in runs]) for key in ("value", "std", "excited", "use"))
    z = (value - truth) / std
    seen = excited & np.isfinite(z)
    inside = np.abs(z) < NORMAL_95

    def share(of: list[int]) -> float | None:
        return float(inside[:, of][seen[:, of]].mean()) if seen[:, of].any() else None

    def mean_z(name: str) -> float:
        return float(np.nanmean(z[:, names.index(name)]))

    constants = [i for i, name in enumerate(names) if name.endswith("_0")]
    off = np.abs(value / truth - 1.0) > FAR
    main = [names.index(name) for name in MAIN_DERIVATIVES]
    return {
        "pairs": int(seen.sum()),
        "inside": share([*range(len(names))]),
        "by_axis": {axis: share([i for i, name in enumerate(names) if name[:2] == axis]) for axis in AXES},
        "constants": share(constants),
        "rms_z": float(np.sqrt(np.mean(z[seen] ** 2))),
        "bias_over_std": {name: mean_z(name) for name in MAIN_DERIVATIVES},
        "bias": {
            name: float(np.nanmean(value[:, i] / truth[i]) - 1.0) for name, i in zip(names, range(99), strict=False)
        },
        "error": float(np.nanmedian(np.abs(value[:, main] / truth[main] - 1.0))),
        "use": int(use.sum()),
        "use_main": int(use[:, main].sum()),
        "far": int((off & use)[:, main].sum()),
    }


def joined(found: Iterable[dict[str, Run]]) -> dict[str, Any]:
    """Runs of flights by case, summarised."""
    runs = list(found)
    return {case: summarised([run[case] for run in runs]) for case in runs[0]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--causes", type=int, default=10)
    parser.add_argument("--flights", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    cells = [(air, noise) for air in AIRS for noise in VANE_NOISE]
    with ProcessPoolExecutor(arguments.workers) as pool:
        causes = joined(pool.map(causes_of, range(CAUSE_SEED, CAUSE_SEED + arguments.causes)))
        seeds = range(FIRST_SEED, FIRST_SEED + arguments.flights)
        proof = [
            {"air": air, "noise": noise, "runs": joined(pool.map(proof_of, [(air, noise, seed) for seed in seeds]))}
            for air, noise in cells
        ]
    result = {"duration": DURATION, "flights": arguments.flights, "causes_flights": arguments.causes}
    RESULT.write_text(json.dumps({**result, "causes": causes, "cells": proof}, indent=1) + "\n", encoding="utf8")
    for case, part in causes.items():
        print(f"{case:40s} {part['inside']:.1%}  rms z {part['rms_z']:.2f}")
    for cell in proof:
        for case, part in cell["runs"].items():
            worst = max(part["bias_over_std"].items(), key=lambda item: abs(item[1]))
            print(f"{cell['air']:9s} {cell['noise']} {case:16s} {part['inside']:.1%} worst bias {worst}")


if __name__ == "__main__":
    main()
