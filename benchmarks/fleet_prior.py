"""What the prior of a fleet is worth, and that it hides no change: time until parameters are known, with and without.

    python benchmarks/fleet_prior.py [--flights 20] [--tune]

A fleet of 8 flights of 60 s of the Ultra Stick 25e, whose coefficients differ from flight to flight by 2 %, gives its
prior by the functions of `fleet`. Then flights of 120 s, in calm air and in light turbulence, each identified with that
prior and without: the same aeroplane, and one with a derivative changed before the flight. Rules were made with
--tune, on other seeds; those of the table were looked at once.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.fleet.changes import Series
from aircraft_sysid_ros.fleet.priors import priors_of
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, default_aircraft, simulate_samples

RESULT = Path(__file__).parent / "results" / "fleet_prior.json"
PIECES = Path(__file__).resolve().parents[1] / "build" / "fleet" / "prior"
FLEET, SPREAD = 8, 0.02
OF_FLEET, DURATION = 60.0, 120.0  # [s]
TUNE_SEED, FIRST_SEED = 41000, 52000
JUDGED = 30_000  # seeds of judged flights after those of their fleet
AIRS = ("none", "light")
#: What changes before a flight: derivative and factor.
CHANGED = (
    ("Cm_de", 0.5), ("Cm_de", 0.75), ("Cl_da", 0.5), ("Cl_da", 0.75), ("Cn_dr", 0.5), ("CZ_alpha", 0.75),
    ("Cm_alpha", 0.5), ("Cn_beta", 0.6), ("Cl_p", 0.6), ("Cm_q", 0.5),
)  # fmt: skip
FAR = 0.25  # of the truth: a value with USE that is further off is wrong
STEP = 1.0  # [s] between looks


def aeroplane(seed: int, factors: Mapping[str, float] | None = None) -> Aircraft:
    """The aeroplane of one flight: every coefficient off by the spread between flights, and what has changed."""
    aircraft = default_aircraft()
    random = np.random.default_rng([seed, 3])
    own = {name: value * (1.0 + SPREAD * random.normal()) for name, value in aircraft.coefficients.items()}
    for name, factor in (factors or {}).items():
        own[name] *= factor
    return replace(aircraft, coefficients=own, source={**aircraft.source, "coefficients": own})


def fly(seed: int, air: str, factors: Mapping[str, float] | None = None, duration: float = DURATION) -> SimulatedFlight:
    random = np.random.default_rng(1000 + seed)
    speed, direction = random.uniform(0.0, 5.0), random.uniform(-np.pi, np.pi)
    wind = (speed * np.cos(direction), speed * np.sin(direction), 0.0)
    return simulate_samples(aeroplane(seed, factors), seed, duration, wind=wind, turbulence=air)


def states_of(flight: SimulatedFlight) -> tuple[Any, int]:
    estimator = StateEstimator(default_aircraft())
    rows = np.vstack([estimator.push(flight.samples), estimator.flush()])
    assert estimator.epoch is not None
    return rows, estimator.epoch


def watched(flight: SimulatedFlight, rows: Any, epoch: int, prior: Mapping[str, Any] | None) -> list[dict[str, Any]]:
    """Values, standard errors and verdicts every second."""
    file = {key: value for key, value in default_aircraft().source.items() if key != "coefficients"}
    identifier = Identifier(aircraft_from_dict({**file, **({"prior": prior} if prior else {})}))
    identifier.push_samples(flight.samples, epoch)
    time, seen = rows[:, StateField.TIME], []
    edges = np.searchsorted(time, np.arange(time[0], time[-1], STEP))
    for first, last in itertools.pairwise(edges):
        identifier.push_states(rows[first:last], epoch)
        found = identifier.snapshot().parameters
        seen.append({
            "time": float(time[last] - time[0]),
            "value": [p.value for p in found], "std": [p.std for p in found],
            "use": [p.status == Trust.USE for p in found],
            "dropped": [axis is not None and bool(axis.dropped) for axis in identifier.learning.fleet.axes],
            "why": [axis.dropped for axis in identifier.learning.fleet.axes if axis is not None],
        })  # fmt: skip
    return seen


def judged(seen: Sequence[Mapping[str, Any]], truth: Any) -> dict[str, Any]:
    """By parameter: when it is to USE first, when from then on right, how long wrong with USE [s]."""
    value, std, use = (np.array([each[key] for each in seen]) for key in ("value", "std", "use"))
    far = np.abs(value - truth) > FAR * np.abs(truth)
    right = use & ~far
    first, settled = [], []
    for j in range(value.shape[1]):
        first.append(seen[int(np.argmax(use[:, j]))]["time"] if use[:, j].any() else None)
        settled.append(seen[int(np.argmax(right[:, j]))]["time"] if right[:, j].any() else None)
    last = seen[-1]
    return {
        "first": first, "right": settled, "wrong": (use & far).sum(axis=0).tolist(), "used": use.sum(axis=0).tolist(),
        "beyond": (use & (np.abs(value - truth) > 1.96 * std)).sum(axis=0).tolist(),
        "dropped": [next((e["time"] for e in seen if e["dropped"][axis]), None) for axis in range(6)],
        "why": last["why"],
    }  # fmt: skip


def parameters_of(seed: int, air: str) -> dict[str, tuple[float, float]]:
    """What one flight of the fleet leaves: value and standard error of what is to USE at its end."""
    flight = fly(seed, air, duration=OF_FLEET)
    end = watched(flight, *states_of(flight), None)[-1]
    names = default_aircraft().model.parameter_names
    return {
        name: (value, std)
        for name, value, std, use in zip(names, end["value"], end["std"], end["use"], strict=True)
        if use
    }


def prior_of(first_seed: int) -> dict[str, Any]:
    """The prior of a fleet of flights, kept when it is made."""
    path = PIECES / f"prior_{first_seed}.json"
    if not path.exists():
        flights = [parameters_of(first_seed + k, AIRS[k % len(AIRS)]) for k in range(FLEET)]
        series = {}
        for name in default_aircraft().model.parameter_names:
            known = [(k, *flight[name]) for k, flight in enumerate(flights) if name in flight]
            if known:
                number, value, std = (np.array(column) for column in zip(*known, strict=True))
                series["one", name] = Series(number, value, std, np.full(len(number), 20.0))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(priors_of(series, [], {"one": FLEET})["airframes"]["one"]), encoding="utf8")
    return dict(json.loads(path.read_text(encoding="utf8")))


def one(seed: int, air: str, factors: Mapping[str, float], prior: Mapping[str, Any]) -> dict[str, Any]:
    flight = fly(seed, air, factors)
    rows, epoch = states_of(flight)
    names = default_aircraft().model.parameter_names
    truth = np.array([aeroplane(seed, factors).coefficients[name] for name in names])
    found = {key: judged(watched(flight, rows, epoch, p), truth) for key, p in (("without", None), ("with", prior))}
    return {"seed": seed, "air": air, "factors": dict(factors), **found}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=20)
    parser.add_argument("--tune", action="store_true")
    args = parser.parse_args()
    base = TUNE_SEED if args.tune else FIRST_SEED
    prior = prior_of(base)
    base += JUDGED
    jobs = [(base + 100 + k, AIRS[k % 2], {}) for k in range(args.flights)]
    jobs += [(base + 1000 + k, AIRS[k // len(CHANGED) % 2], dict([CHANGED[k % len(CHANGED)]]))
             for k in range(args.flights)]  # fmt: skip
    found = [one(*job, prior) for job in jobs]
    path = PIECES / "tune.json" if args.tune else RESULT
    path.write_text(
        json.dumps({"duration": DURATION, "flights": found, "names": default_aircraft().model.parameter_names}),
        encoding="utf8",
    )


if __name__ == "__main__":
    main()
