"""A campaign of short manoeuvres without GPS: how right are the parameters, and do their standard errors cover?

    python benchmarks/campaign.py [--seeds 5] [--first 7100]

Each is 20 manoeuvres of 10 s of two simulated aeroplanes in calm air: IMU, air data and controls at 25 Hz, neither GPS
nor attitude, joined as `replay --segments` joins them. Looked at once. Writes results/campaign.json.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct_as_flown, settled_flight
from aircraft_sysid_ros.diagnosis.search.fit import fit_axis
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, Samples, joined
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

RESULT = Path(__file__).parent / "results" / "campaign.json"
AEROPLANES = ("ultra_stick_25e", "ultra_stick_120")
MAIN = (
    "CZ_alpha", "CY_beta", "Cl_beta", "Cl_p", "Cl_da", "Cm_alpha", "Cm_q", "Cm_de", "Cn_beta", "Cn_r", "Cn_dr",
)  # fmt: skip
COUNT, LENGTH, EVERY, BEGIN = 20, 10.0, 11.0, 6.0  # [s] but the first
RATE = 25.0  # [Hz]
_KINDS = (Kind.IMU, Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP, Kind.AIR, Kind.CONTROLS)
Found = dict[str, tuple[float, float]]  # value and standard error by parameter


def campaign(samples: Samples) -> Samples:
    """The manoeuvres of a flight as one body of data."""
    keep = np.zeros(len(samples), np.bool_)
    for kind in _KINDS:
        rows = np.flatnonzero(samples.kind == kind)
        rows = rows[np.argsort(samples.stamp[rows], kind="stable")]
        every = round(1e9 / float(np.median(np.diff(samples.stamp[rows]))) / RATE)
        keep[rows[::every]] = True
    slow = samples[keep]
    time = (slow.stamp - slow.stamp.min()) * 1e-9 - BEGIN
    parts = [slow[(time >= EVERY * k) & (time < EVERY * k + LENGTH)] for k in range(COUNT)]
    return joined(parts)[0]


def replayed(aircraft: Aircraft, samples: Samples) -> Found:
    """Parameters with USE at the end of replay."""
    pipeline = Pipeline(aircraft)
    pipeline.push(samples)
    pipeline.flush()
    parameters = pipeline.parameters.snapshot().parameters
    return {p.name: (p.value, p.std) for p in parameters if p.status is Trust.USE}


def afterwards(aircraft: Aircraft, samples: Samples) -> Found:
    """Those that compare, diagnose and add fit."""
    flight = settled_flight(reconstruct_as_flown(aircraft, samples)[0])
    fits = [fit_axis(flight, axis).fit for axis in AXES]
    return {n: (v, s) for f in fits for n, v, s in zip(f.names, f.parameters, f.std, strict=True)}


def judged(found: list[Found], truths: list[dict[str, float]]) -> dict[str, Any]:
    """Errors of the main derivatives, and how many of them their standard errors cover."""
    pairs = [
        (each[name][0] / truth[name] - 1.0, (each[name][0] - truth[name]) / each[name][1])
        for each, truth in zip(found, truths, strict=True)
        for name in MAIN
        if name in each
    ]
    relative, sigmas = np.abs(np.array(pairs)).T
    return {
        "main": len(MAIN) * len(found),
        "known": len(pairs),
        "median": float(np.median(relative)),
        "worst": float(np.max(relative)),
        "within_5_percent": int(np.sum(relative < 0.05)),
        "within_3_sigma": int(np.sum(sigmas < 3.0)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=7100)
    arguments = parser.parse_args()
    truths, online, after = [], [], []
    for name in AEROPLANES:
        aircraft = load_aircraft(config_path(f"{name}.yaml"))
        for seed in range(arguments.first, arguments.first + arguments.seeds):
            samples = campaign(simulate_samples(aircraft, seed, BEGIN + EVERY * COUNT + 4.0).samples)
            truths.append(aircraft.coefficients)
            online.append(replayed(aircraft, samples))
            after.append(afterwards(aircraft, samples))
    content = {
        "campaigns": len(truths), "first": arguments.first, "manoeuvres": COUNT, "length": LENGTH, "rate": RATE,
        "replay": judged(online, truths), "afterwards": judged(after, truths),
    }  # fmt: skip
    print(json.dumps(content))
    RESULT.write_text(json.dumps(content, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
