"""Flights of strangers: what does the diagnosis say with an aircraft file that holds mass and shape only?

    python benchmarks/strangers.py [--clean 40] [--hidden 24] [--jobs 2] [--first 9100000] [--placed] [--figure]

Flights of 150 s whose sensors, rates, air and manoeuvres are drawn from the seed and written nowhere: the noise of each
sensor, IMU at 50, 100 or 200 Hz, air data at 20 or 50 Hz, an attitude or none, wind that is steady, walks slowly, or
gusts lightly. No delays; with ``--placed`` sensors are where the aeroplane has them, a probe out on the wing, an IMU
ahead of the centre of gravity and below it, else there are no lever arms. The diagnosis gets the samples and an
aircraft file with mass and shape, and the place of the vane where ``replay`` finds it. Each flight is a line in
results/strangers.jsonl; a run that is stopped goes on where it was. Seeds are drawn before and looked at once.
``--figure`` draws the p-values that were stated of the clean flights into docs/figures.
"""

from __future__ import annotations

import json
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # flights share the cores; before numpy is loaded

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import resumed
from certificate_cells import replayed

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight
from aircraft_sysid_ros.effects.aliases import aliases_of
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.reconstruction.found_noise import with_vane
from aircraft_sysid_ros.samples import Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.hidden_effects import SIMULATED
from aircraft_sysid_ros.simulation.simulated_flight import HIDDEN_RATE, simulate_samples
from aircraft_sysid_ros.simulation.varied_plan import PLANS

RESULTS = Path(__file__).parent / "results" / "strangers.jsonl"
PLACED = RESULTS.with_name("strangers_placed.jsonl")
FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "clean_p_values.png"
AEROPLANES = ("ultra_stick_25e", "ultra_stick_120")
SHAPE = ("name", "mass", "wing_area", "span", "chord", "inertia")
DURATION = 150.0
FIRST = 9_100_000
#: One sigma of the sensors, lowest and highest; drawn evenly in the logarithm.
NOISE = {
    "accelerometer": (0.02, 0.15), "gyro": (0.001, 0.006), "attitude": (0.002, 0.02), "gps_position": (0.5, 3.0),
    "gps_velocity": (0.05, 0.3), "airspeed": (0.1, 0.6), "angle_of_attack": (0.002, 0.008),
    "sideslip": (0.002, 0.008), "static_pressure": (3.0, 30.0), "control_surfaces": (0.0003, 0.002),
}  # fmt: skip
WALKS = {"steady": 0.0, "slow": 0.01, "light": 0.01}  # [m/s per sqrt(s)]


def drawn(seed: int) -> dict[str, Any]:
    """Everything of a flight that its file does not say."""
    rng = np.random.default_rng(seed)
    imu, air_data = int(rng.choice([50, 100, 200])), int(rng.choice([20, 50]))
    noise = {name: float(np.exp(rng.uniform(*np.log(limits)))) for name, limits in NOISE.items()}
    rates = {"accelerometer": imu, "gyro": imu, "attitude": imu, "control_surfaces": 50}
    rates |= dict.fromkeys(("airspeed", "angle_of_attack", "sideslip", "static_pressure"), air_data)
    return {
        "aeroplane": str(rng.choice(AEROPLANES)),
        "air": str(rng.choice(list(WALKS))),
        "manoeuvres": str(rng.choice(PLANS)),
        "attitude": bool(rng.integers(2)),
        "wind": rng.uniform(-4.0, 4.0, 2).round(1).tolist(),
        "sensors": {k: {"noise": v, **({"rate": rates[k]} if k in rates else {})} for k, v in noise.items()},
    }


def centred(known: Aircraft) -> Aircraft:
    """The aeroplane with all sensors at its centre of gravity, where a file that does not place them has them."""
    placed = {key: [0.0, 0.0, 0.0] for key in ("imu_position", "air_data_position", "gps_position")}
    return aircraft_from_dict({**known.source, **placed})


def flown(known: Aircraft, setting: dict[str, Any], placed: bool = False) -> Aircraft:
    """The aeroplane with the sensors of a flight, all of them at its centre of gravity if they are not ``placed``."""
    return aircraft_from_dict({**(known if placed else centred(known)).source, "sensors": setting["sensors"]})


def given(known: Aircraft, samples: Samples) -> Aircraft:
    """What a new user knows of an aeroplane, and what the flight says of the place of its vane, as ``replay``."""
    of_user = users(known)
    right = replayed(of_user, samples).check.vane_place
    return of_user if right is None else with_vane(of_user, right)


def users(known: Aircraft) -> Aircraft:
    """What a new user knows of an aeroplane."""
    return aircraft_from_dict({key: known.source[key] for key in SHAPE})


def fly(job: dict[str, Any]) -> dict[str, Any]:
    """One flight and what is said of it."""
    setting = drawn(job["seed"])
    known = load_aircraft(config_path(setting["aeroplane"] + ".yaml"))
    effect = job["effect"]
    result = {**job, **{k: v for k, v in setting.items() if k != "sensors"}}
    try:
        flight = simulate_samples(
            flown(known, setting, job.get("placed", False)), job["seed"], DURATION, rate=HIDDEN_RATE,
            wind=(*setting["wind"], 0.0), wind_walk=WALKS[setting["air"]],
            turbulence="light" if setting["air"] == "light" else "none",
            hidden=[(effect, 1.0)] if effect else [], manoeuvres=None if effect else setting["manoeuvres"],
            sensors=SensorOptions(attitude=setting["attitude"], height_above_ground=True),
        )  # fmt: skip
        said = diagnose_flight(given(known, flight.samples), flight.samples).json
    except InputError as error:
        return {**result, "failed": str(error)}
    names = [c["label"] for c in said["candidates"] if c["found"]]
    first = next((c for c in said["candidates"] if c["found"]), None)
    stated = {"verdict": said["verdict"], "p_value": said["p_value"]}
    return {**result, **stated, "found": names, "first": first and first["effect"]}


def jobs(clean: int, hidden: int, first: int) -> list[dict[str, Any]]:
    """Clean flights, and flights in which the effects take turns, in an order that mixes them."""
    flights: list[dict[str, Any]] = [{"seed": first + n, "effect": None} for n in range(clean)]
    effects = np.random.default_rng(first).permutation(sorted(SIMULATED)).tolist()
    flights += [{"seed": first + 50_000 + n, "effect": effects[n % len(effects)]} for n in range(hidden)]
    return [flights[i] for i in np.random.default_rng(first).permutation(len(flights))]


def summary(results: list[dict[str, Any]]) -> str:
    """Counts, by what was hidden."""
    done = [r for r in results if "failed" not in r]
    clean = [r for r in done if not r["effect"]]
    false = [r for r in clean if r["verdict"] != "none"]
    hidden = [r for r in done if r["effect"]]
    named = [r for r in hidden if r["first"] and r["effect"] in {r["first"], *aliases_of(r["first"])}]
    lines = [
        f"clean flights: {len(clean)}, given a verdict: {len(false)} {dict(Counter(str(r['found']) for r in false))}",
        f"flights with an effect: {len(hidden)}, named first: {len(named)}, "
        f"said to be none: {sum(r['verdict'] == 'none' for r in hidden)}",
        *(f"  {r['effect']}: {r['verdict']} {r['found']}" for r in hidden if r not in named),
        f"not diagnosed: {len(results) - len(done)}",
    ]
    return "\n".join(lines)


def draw(results: list[dict[str, Any]], path: Path) -> None:
    """Stated p-values of clean flights, in order, beside those of an even distribution with its 95 % band."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from scipy.stats import beta

    stated = np.sort([r["p_value"] for r in results if "failed" not in r and not r["effect"]])
    rank = np.arange(1, len(stated) + 1)
    low, high = (beta.ppf(q, rank, len(stated) - rank + 1) for q in (0.025, 0.975))
    figure, plot = plt.subplots(figsize=(6, 5), layout="constrained")
    expected = rank / (len(stated) + 1)
    plot.fill_between(expected, low, high, color="0.88", label="95 % of even samples")
    plot.plot(expected, expected, "k--", lw=0.8, label="even")
    plot.plot(expected, stated, "o", ms=4, color="#0072B2", label=f"{len(stated)} clean flights")
    plot.set_xscale("log")
    plot.set_yscale("log")
    plot.set_xlabel("p-value of an even distribution")
    plot.set_ylabel("p-value that was stated, whole search")
    plot.legend(fontsize=9)
    figure.savefig(path, dpi=100, metadata={"Software": None})
    plt.close(figure)


def main() -> None:
    """Fly what is not flown yet, and count."""
    parser = resumed.options(__doc__, FIRST, clean=40, hidden=24)
    parser.add_argument("--placed", action="store_true", help="sensors are where the aeroplane has them")
    parser.add_argument("--figure", action="store_true", help="draw the p-values of the flights that are there")
    args = parser.parse_args()
    path = args.results or (PLACED if args.placed else RESULTS)
    if args.figure:
        draw([json.loads(line) for line in path.read_text().splitlines()], FIGURE)
        return
    wanted = [{**job, "placed": args.placed} for job in jobs(args.clean, args.hidden, args.first)]
    print(summary(resumed.flown_aloud(fly, wanted, path, args.jobs, _says)))


def _says(result: dict[str, Any]) -> str:
    return f"{result['effect']} {result.get('found')}"


if __name__ == "__main__":
    main()
