"""Aeroplanes of JSBSim that no rule of the library was made on: what does the diagnosis say of their flights?

    python benchmarks/other_aeroplanes.py [--clean 20] [--hidden 10] [--first 8800000] [--jobs 2] [--summary]

Light aeroplanes, transports and fighters, with tables for aerodynamics and engines of their own, fly doublets and
3-2-1-1 of a drawn plan. Everything that no file says is drawn from the seed: noise, rates, delays and places of the
sensors, an attitude or none, wind and gusts. The user has mass and shape. What is hidden is one effect of the library.

These aeroplanes have physics of their own that a file of mass and shape leaves out, so that a clean flight is one in
which nothing was hidden: a name is true there if it is a setting of a sensor that was really so, or if its terms,
fitted to the true coefficients of the flight without noise, lower what the 32 terms leave of them, in the axis that
it was named for, by TRUE_SHARE or more. Each flight is a line in results/other_aeroplanes.jsonl; a run that is stopped
goes on where it was. Seeds are drawn before and looked at once.
"""

from __future__ import annotations

import json
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # flights share the cores; before numpy is loaded

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import resumed
import strangers
from jsbsim_missions import KNOWN
from jsbsim_missions import STRANGERS as OTHERS

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, TEXTBOOK_TERMS, textbook_model
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.aliases import aliases_of
from aircraft_sysid_ros.effects.effect import MEASUREMENT
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions, arrived, measure
from aircraft_sysid_ros.sensors.truth import Truth
from aircraft_sysid_ros.simulation.hidden_effects import SIMULATED, Hidden, hidden_effect
from aircraft_sysid_ros.simulation.jsbsim_effects import fly_jsbsim_hidden
from aircraft_sysid_ros.simulation.jsbsim_flight import (
    GROUND,
    RATE,
    JsbsimSetup,
    excitation_of,
    fly_jsbsim,
    prepare_jsbsim,
    projection,
    signals_of,
)
from aircraft_sysid_ros.simulation.simulated_flight import really
from aircraft_sysid_ros.simulation.varied_plan import plan_of
from aircraft_sysid_ros.simulation.wind import low_altitude_turbulence, wind_series

Array = npt.NDArray[np.float64]

RESULTS = Path(__file__).parent / "results" / "other_aeroplanes.jsonl"
#: Calibrated airspeed [kt] of each.
AEROPLANES = {**KNOWN, **OTHERS, "f15": 350.0}
DURATION = 120.0
FIRST = 8_800_000
PLANS = ("standard", "varied", "speeds", "sideslips")
#: Wind at 20 ft [m/s] of gusts.
GUSTS = (0.0, 0.0, 3.0)
#: What the terms of a name take, at least, off the true coefficients that the 32 terms leave, where it is true.
TRUE_SHARE = 0.1
#: Names that only what was really so of the sensors makes true, and where the setting of a flight says it.
_LATE = {"air_data_lag": ("air_data",), "imu_lag": ("imu",), "gps_lag": ("gps",)}
_LATE_FROM = 0.015  # [s]
#: Effects that JSBSim cannot be given from outside, or that these aeroplanes cannot show.
_NOT_HIDDEN = ("compressibility", "dynamic_stall", "flaps", "ground_effect", "stall", "propeller_gyroscopic",
               "propeller_torque", "propwash")  # fmt: skip


def drawn(seed: int, name: str, span: float) -> dict[str, Any]:
    """Everything of a flight that its file does not say."""
    setting = strangers.drawn(seed)
    rng = np.random.default_rng([seed, 83])
    delays = {"air_data": float(rng.choice([0.0, 0.03, 0.06])), "gps": float(rng.choice([0.0, 0.1, 0.2]))}
    boom = float(rng.choice([0.0, 0.1, 0.3])) * span
    return {
        "aeroplane": name, "plan": str(rng.choice(PLANS)), "gusts": float(rng.choice(GUSTS)),
        "attitude": setting["attitude"], "wind": (rng.uniform(-0.1, 0.1, 2)).tolist(), "delays": delays,
        "imu_place": (rng.uniform(-0.02, 0.02, 3) * span).tolist(), "boom": boom, "sensors": setting["sensors"],
    }  # fmt: skip


def with_sensors(aircraft: Aircraft, setting: Mapping[str, Any]) -> Aircraft:
    """The aeroplane as it is, with its sensors; scaled where they depend on how fast and large it is."""
    sensors = {name: dict(of) for name, of in setting["sensors"].items()}
    fast = (aircraft.trim_airspeed or 20.0) / 20.0
    sensors["airspeed"]["noise"] *= max(1.0, 0.3 * fast)
    for group, names in (
        ("air_data", ("airspeed", "angle_of_attack", "sideslip")), ("gps", ("gps_position", "gps_velocity")),
    ):  # fmt: skip
        for name in names:
            sensors[name]["delay"] = setting["delays"][group]
    places = {
        "imu_position": setting["imu_place"], "air_data_position": [setting["boom"], 0.0, 0.0],
        "gps_position": [0.0, 0.0, 0.0],
    }  # fmt: skip
    return aircraft_from_dict({**aircraft.source, **places, "sensors": sensors})


def fly(job: dict[str, Any]) -> dict[str, Any]:
    """One flight, and what is said of it."""
    seed, effect = job["seed"], job["effect"]
    try:
        setup = prepare_jsbsim(job["aeroplane"], AEROPLANES[job["aeroplane"]])
        setting = drawn(seed, job["aeroplane"], setup.aircraft.span)
        result = {**job, **{key: value for key, value in setting.items() if key != "sensors"}}
        truth, aircraft, there = flown(setup, setting, seed, effect)
        streams, _ = measure(
            *really(aircraft, there, truth, seed, SensorOptions(attitude=setting["attitude"], height_above_ground=True))
        )
        samples = arrived(streams, aircraft.inputs)
        diagnosis = diagnose_flight(strangers.given(setup.aircraft, samples), samples)
    except InputError as error:
        return {**job, "failed": str(error)}
    said = diagnosis.json
    found = [
        {"label": c["label"], "effect": c["effect"], "main_axis": c["main_axis"], "inner": c["inner"],
         "terms": c.get("terms"), "before": c["error_before"], "after": c["error_after"],
         "taken": share_taken(setup.aircraft, truth, c),
         "confounded_with": c["confounded_with"]}
        for c in said["candidates"] if c["found"]
    ]  # fmt: skip
    return {**result, "verdict": said["verdict"], "p_value": said["p_value"], "found": found}


def flown(
    setup: JsbsimSetup, setting: Mapping[str, Any], seed: int, effect: str | None
) -> tuple[Truth, Aircraft, tuple[Hidden, ...]]:
    """The truth, the aeroplane with its sensors, and what is hidden."""
    count = int(DURATION * RATE) + 1
    time = np.arange(count) / RATE
    rng = np.random.default_rng([seed, 84])
    mean = np.append(np.array(setting["wind"]) * setup.trim.airspeed, 0.0)
    turbulence = low_altitude_turbulence(250.0, setting["gusts"]) if setting["gusts"] else None
    wind = wind_series(rng, count, 1.0 / RATE, mean, 0.01, setup.trim.airspeed, turbulence)
    plan = plan_of(setting["plan"], time, excitation_of(setup), seed)
    aircraft = with_sensors(setup.aircraft, setting)
    if effect is None:
        return fly_jsbsim(setup, wind, plan), aircraft, ()
    still = fly_jsbsim(setup, np.zeros((int(60 * RATE) + 1, 3)))[::8]
    coefficients = projection(textbook_model(), signals_of(setup.aircraft, still), still.coefficients)
    trim = (setup.trim.alpha, float(setup.trim.controls[0]))
    there = (hidden_effect(effect, 1.0, seed, DURATION, setup.aircraft, coefficients, trim),)
    return fly_jsbsim_hidden(setup, wind, plan, there, GROUND), aircraft, there


def share_taken(aircraft: Aircraft, truth: Truth, candidate: Mapping[str, Any]) -> float | None:
    """What a name's terms take off the rms of what 32 terms leave of the true coefficients, in its main axis.

    None: it has no terms, or some that the truth cannot be asked for.
    """
    axis, terms = candidate["main_axis"], candidate.get("terms") or {}
    if axis not in terms:
        return None
    true = truth.coefficients[:, AXES.index(axis)]
    signals = signals_of(aircraft, truth)
    rms = []
    for more in ((), terms[axis]):
        model = {a: [*TEXTBOOK_TERMS[a], *(more if a == axis else ())] for a in AXES}
        try:
            columns = aircraft_from_dict({**aircraft.source, "model": model}).model.regressors(axis, signals)
        except (KeyError, InputError):
            return None
        left = true - columns @ np.linalg.lstsq(columns, true, rcond=None)[0]
        rms.append(float(np.sqrt(np.mean(left**2))))
    return 1.0 - rms[1] / rms[0]


def is_true(result: Mapping[str, Any], found: Mapping[str, Any]) -> bool:
    """Whether a name is true of a flight, besides what was hidden."""
    name = found["effect"]
    if name in _LATE:
        return any(result["delays"].get(sensor, 0.0) >= _LATE_FROM for sensor in _LATE[name])
    if name == "probe_offset":
        return bool(result["boom"])
    if name == "imu_offset":
        return any(result["imu_place"])
    if name in BY_ID and (BY_ID[name].kind == MEASUREMENT or "t0" in found["inner"]):
        return False
    return found["taken"] is not None and found["taken"] >= TRUE_SHARE


def false_of(result: Mapping[str, Any]) -> list[str]:
    """Names that are neither true nor what was hidden."""
    hidden = {result["effect"], *(aliases_of(result["effect"]) if result["effect"] else ())}
    return [f["label"] for f in result["found"] if f["effect"] not in hidden and not is_true(result, f)]


def summary(results: Sequence[dict[str, Any]]) -> str:
    """Counts, and each flight whose answer was not right."""
    done = [r for r in results if "failed" not in r]
    clean, hidden = [r for r in done if not r["effect"]], [r for r in done if r["effect"]]
    false = [r for r in clean if false_of(r)]

    def place(result: Mapping[str, Any]) -> int:
        right = {result["effect"], *aliases_of(result["effect"])}
        return next((i for i, f in enumerate(result["found"]) if f["effect"] in right), -1)

    lines = [
        f"clean: {len(clean)}, with a name that is not true: {len(false)}",
        f"hidden: {len(hidden)}, named: {sum(place(r) >= 0 for r in hidden)}, "
        f"first: {sum(place(r) == 0 for r in hidden)}, none said: {sum(not r['found'] for r in hidden)}",
        *(f"  {r['seed']} {r['aeroplane']} {r['effect']}: false {false_of(r)}, of "
          f"{[(f['label'], f['main_axis'], f['taken'] and round(f['taken'], 2)) for f in r['found']]}"
          for r in (*false, *hidden)),
        *(f"  {r['seed']} {r['aeroplane']} {r['effect']}: {r['failed']}" for r in results if "failed" in r),
    ]  # fmt: skip
    return "\n".join(lines)


def jobs(clean: int, hidden: int, first: int) -> list[dict[str, Any]]:
    """Clean flights and such with an effect, in an order that mixes them; aeroplanes and effects take turns."""
    names = sorted(AEROPLANES)
    effects = np.random.default_rng(first).permutation(sorted(set(SIMULATED) - set(_NOT_HIDDEN))).tolist()
    flights = [{"seed": first + n, "aeroplane": names[n % len(names)], "effect": None} for n in range(clean)]
    flights += [
        {"seed": first + 50_000 + n, "aeroplane": names[n % len(names)], "effect": effects[n % len(effects)]}
        for n in range(hidden)
    ]
    return [flights[i] for i in np.random.default_rng(first).permutation(len(flights))]


def main() -> None:
    """Fly what is not flown yet, and count."""
    parser = resumed.options(__doc__, FIRST, clean=20, hidden=10)
    parser.add_argument("--summary", action="store_true", help="no flights, only the count of those that are there")
    args = parser.parse_args()
    path = args.results or RESULTS
    if args.summary:
        print(summary([json.loads(line) for line in path.read_text(encoding="utf8").splitlines()]))
        return
    wanted = jobs(args.clean, args.hidden, args.first)
    print(summary(resumed.flown_aloud(fly, wanted, path, args.jobs, _says)))


def _says(result: dict[str, Any]) -> str:
    return f"{result['aeroplane']} {result['effect']} {[f['label'] for f in result.get('found', [])]}"


if __name__ == "__main__":
    main()
