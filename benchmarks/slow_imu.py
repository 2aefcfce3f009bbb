"""What a slow IMU costs: errors and coverage of the parameters of the same flights at some rates of the IMU.

    python benchmarks/slow_imu.py [--seeds 8]

Flights of 60 s in calm air from the project's own simulator; of the IMU, at 100 Hz, so many samples a second are kept,
and the aircraft file does not know. Controls and air data stay at 50 Hz. Writes results/slow_imu.json.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from hidden_effects import with_slow_imu

from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, default_aircraft, simulate_samples

RESULT = Path(__file__).parent / "results" / "slow_imu.json"
RATES = (100.0, 50.0, 25.0, 12.5, 10.0)
ESTIMATORS = ("rls", "fourier", "rml")
MAIN = ("CZ_alpha", "Cm_alpha", "Cm_q", "Cm_de", "CY_beta", "Cl_beta", "Cl_p", "Cl_da", "Cn_beta", "Cn_r", "Cn_dr")
FIRST_SEED, DURATION = 4200, 60.0


def errors(flight: SimulatedFlight, estimator: str) -> tuple[list[float], list[float]]:
    """Errors over standard errors of the parameters with USE, and relative errors of those of MAIN among them."""
    pipeline = Pipeline(flight.aircraft, None, ParameterOptions(estimator=estimator))
    pipeline.push(flight.samples)
    pipeline.flush()
    used = [p for p in pipeline.parameters.snapshot().parameters if p.status == Trust.USE]
    truth = flight.coefficients
    sigmas = [(p.value - truth[p.name]) / p.std for p in used]
    return sigmas, [abs(p.value / truth[p.name] - 1.0) for p in used if p.name in MAIN]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=8)
    seeds = parser.parse_args().seeds
    flights = [simulate_samples(default_aircraft(), FIRST_SEED + number, DURATION) for number in range(seeds)]
    lines: list[dict[str, Any]] = []
    for rate in RATES:
        slow = [with_slow_imu(flight, rate) for flight in flights]
        for estimator in ESTIMATORS:
            found = [errors(flight, estimator) for flight in slow]
            sigmas, relative = (np.concatenate(parts) for parts in zip(*found, strict=True))
            lines.append(
                {
                    "rate": rate,
                    "estimator": estimator,
                    "used": len(sigmas),
                    "main_used": len(relative),
                    "main": seeds * len(MAIN),
                    "inside": float(np.mean(np.abs(sigmas) < 1.96)),
                    "median": float(np.median(relative)),
                    "most": float(np.quantile(relative, 0.9)),
                }
            )
            print(json.dumps(lines[-1]), flush=True)
    content = {"seeds": seeds, "duration": DURATION, "rates": lines}
    RESULT.write_text(json.dumps(content, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
