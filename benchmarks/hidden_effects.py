"""Hidden effects: does the diagnosis name what is missing, and say "none" when nothing is?

    python benchmarks/hidden_effects.py [--seeds 4] [--clean 60] [--jobs 2] [--set tuned|fresh] [--only EFFECT ...]
    python benchmarks/hidden_effects.py --set fresh --imu-rate 10 --duration 90 --clean 20    # a slow IMU

Flights of 120 s from the project's own simulator and from JSBSim, with one effect of the library hidden, or none. Air
(calm, light turbulence), noise (1 and 2 times the aircraft file's), strength (full and half), wind and manoeuvres are
drawn from the seed, so that a few seeds per effect cover all of them. The diagnosis gets the samples and the aircraft
file, nothing else; other methods (other_methods) get the same flight, reconstructed, of every third seed. Each flight
is a line in results/hidden_effects_SET.jsonl: a run that is stopped goes on where it was. Seeds of the set "fresh" are
flown once, and nothing is changed afterwards; then they join "tuned". With --imu-rate flights are clean ones only, of
whose IMU so many samples a second are kept, and the aircraft file does not know; their results have files of their own.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # flights share the cores; before numpy is loaded

import json
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import other_methods
from hidden_effects_figure import draw

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.diagnosis.diagnose import diagnose
from aircraft_sysid_ros.diagnosis.flight.reconstruction import fit_sensor_noise, reconstruct, settled_flight
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.words import FlightDiagnosis
from aircraft_sysid_ros.effects import BY_ID, LIBRARY
from aircraft_sysid_ros.effects.aliases import aliases_of
from aircraft_sysid_ros.effects.effect import MEASUREMENT
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.simulation.hidden_effects import SIMULATED
from aircraft_sysid_ros.simulation.jsbsim_hidden import IMPOSSIBLE
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, hidden_flight

RESULTS = Path(__file__).parent / "results"
FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "hidden_effects.png"
DURATION, REPLICAS = 120.0, 4
METHODS_EVERY = 3  # seeds
#: First seed of each set; "tuned" also holds earlier fresh flights, which were looked at later (their seeds differ).
FIRST_SEED = {"tuned": 1000, "fresh": 7_310_000}
SIMULATORS = ("textbook", "c172p", "J3Cub")
AXES = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")


def conditions(seed: int) -> dict[str, Any]:
    """Air, noise and strength of a seed: all eight combinations in turn."""
    return {
        "turbulence": "light" if seed % 2 else "none",
        "noise_scale": 2.0 if seed // 2 % 2 else 1.0,
        "strength": 0.5 if seed // 4 % 2 else 1.0,
    }


def jobs(which: str, seeds: int, clean: int) -> list[dict[str, Any]]:
    """Every flight of a set, shuffled, so that a run that is stopped has some of all."""
    first, flights = FIRST_SEED[which], []
    for number in range(seeds):
        for place, simulator in enumerate(SIMULATORS):
            effects = sorted(set(SIMULATED) - set(IMPOSSIBLE.get(simulator, ())))
            if place == 0 or number % 2 == place - 1:  # the aeroplanes of JSBSim take turns
                flights += [
                    {"simulator": simulator, "effect": effect, "seed": first + 11 * i + number}
                    for i, effect in enumerate(effects)
                ]
    for number in range(clean):
        simulator = SIMULATORS[1 + number // 2 % 2] if number % 2 else SIMULATORS[0]
        seed = first + 5000 + number // 2 + 4096 * (number % 2)  # either simulator in all conditions
        flights.append({"simulator": simulator, "effect": None, "seed": seed})
    return [flights[i] for i in np.random.default_rng(first).permutation(len(flights))]


def fly(job: dict[str, Any], duration: float | None = None, imu_rate: float | None = None) -> dict[str, Any]:
    """One flight and its diagnosis; durations [s] other than DURATION, and rates of the IMU [Hz], where given."""
    _one_core()
    setting = conditions(job["seed"])
    result = {**job, **setting}
    try:
        flight = hidden_flight(
            job["simulator"], job["effect"], seed=job["seed"], duration=duration or DURATION, **setting
        )
        flight = with_slow_imu(flight, imu_rate) if imu_rate else flight
        started = _seconds()
        found = diagnose_flight(flight.aircraft, flight.samples, replicas=REPLICAS)
        result["seconds"] = _seconds() - started
    except InputError as error:
        return {**result, "failed": str(error)}
    base = _bench(flight.aircraft, flight)
    result |= {"manoeuvres": flight.manoeuvres, **verdict_of(found), **errors_of(flight, found, base)}
    if job["seed"] % METHODS_EVERY == 0 and not imu_rate:
        result["methods"] = other_methods.answers(base)
    if job["effect"] and BY_ID[job["effect"]].kind != MEASUREMENT:
        library = [e for e in LIBRARY if e.kind != MEASUREMENT and e.identifier != job["effect"]]
        without = diagnose(CandidateEvaluator(found.flight), found.replicas, library)
        best = without.candidates[0].trial if without.candidates else None
        result["without"] = {
            "verdict": without.verdict,
            "first": best.candidate.label if best else None,
            "axis": best.main_axis if best else None,
            "axes": sorted(best.gains) if best else [],
            "effect": best.candidate.effect.identifier if best and best.candidate.effect else None,
        }
    return result


def with_slow_imu(flight: SimulatedFlight, rate: float) -> SimulatedFlight:
    """The flight with the first IMU sample of every 1 / rate [s] alone."""
    streams = []
    for stream in flight.streams:
        if stream.topic == "imu/data":
            slot = np.floor((stream.stamp - stream.stamp[0]) * 1e-9 * rate + 1e-6)
            kept = np.diff(slot, prepend=-1.0) > 0.0
            fields = {name: values[kept] for name, values in stream.fields.items()}
            stream = replace(stream, stamp=stream.stamp[kept], arrival=stream.arrival[kept], fields=fields)
        streams.append(stream)
    return replace(flight, streams=streams)


def _seconds() -> float:
    """Processor time of this process and of those that it has waited for."""
    return sum(os.times()[:4])


def verdict_of(found: FlightDiagnosis) -> dict[str, Any]:
    """What was said, in short."""
    said = found.json
    return {
        "verdict": said["verdict"],
        "candidates": [
            {key: c[key] for key in ("effect", "label", "main_axis", "p_value", "found", "confounded_with")}
            for c in said["candidates"][:6]
        ],
        "largest_size": max((f.size for f in found.diagnosis.candidates), default=0.0),
    }


def errors_of(flight: SimulatedFlight, found: FlightDiagnosis, base: CandidateEvaluator) -> dict[str, Any]:
    """Held-out NRMSE by axis: base model, after the diagnosis, after the truth was added, and the floor."""
    oracle = base
    if flight.hidden:
        oracle = _bench(flight.oracle, flight)
    benches = {"base": base, "diagnosed": found.diagnosis.bench, "oracle": oracle}
    errors = {name: {a: fit.nrmse_held_out for a, fit in bench.fits.items()} for name, bench in benches.items()}
    shared = [a for a in AXES if all(a in e for e in errors.values())]
    gains = {a: 1.0 - errors["oracle"][a] / errors["base"][a] for a in shared}
    axis = max(gains, key=lambda a: gains[a])
    return {"errors": errors, "floor": dict(found.diagnosis.floor), "axis": axis, "oracle_gain": gains[axis]}


def _bench(aircraft: Aircraft, flight: SimulatedFlight) -> CandidateEvaluator:
    seen = fit_sensor_noise(aircraft, flight.samples)
    return CandidateEvaluator(settled_flight(reconstruct(seen, flight.samples, with_covariance=False)))


def _one_core() -> None:
    """This process, and those that it starts, share one core: other flights have the others."""
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) > 1:
        identity = multiprocessing.current_process()._identity
        os.sched_setaffinity(0, {cores[(identity[0] if identity else 0) % len(cores)]})


def summary(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """Rates over flights, and by effect."""
    flown = [line for line in lines if "failed" not in line]
    clean = [line for line in flown if not line["effect"]]
    hidden = [line for line in flown if line["effect"]]
    relevant = [line for line in hidden if line["oracle_gain"] >= 0.2]
    named = {line["effect"] for line in hidden}
    return {
        "flights": len(flown),
        "failed": len(lines) - len(flown),
        "clean": len(clean),
        "false_verdicts": share([line["verdict"] != "none" for line in clean]),
        "clean_by": {
            key: share([line["verdict"] != "none" for line in clean if condition(line)])
            for key, condition in (
                ("textbook, calm", lambda x: x["simulator"] == "textbook" and x["turbulence"] == "none"),
                ("textbook, light", lambda x: x["simulator"] == "textbook" and x["turbulence"] == "light"),
                ("JSBSim, calm", lambda x: x["simulator"] != "textbook" and x["turbulence"] == "none"),
                ("JSBSim, light", lambda x: x["simulator"] != "textbook" and x["turbulence"] == "light"),
            )
        },
        "hidden": len(hidden),
        "relevant": rates(relevant),
        "relevant_textbook": rates([x for x in relevant if x["simulator"] == "textbook"]),
        "relevant_jsbsim": rates([x for x in relevant if x["simulator"] != "textbook"]),
        "relevant_calm": rates([x for x in relevant if x["turbulence"] == "none"]),
        "relevant_light": rates([x for x in relevant if x["turbulence"] == "light"]),
        "small": rates([x for x in hidden if x["oracle_gain"] < 0.2]),
        "without": without([x for x in relevant if "without" in x]),
        "methods": methods(clean, relevant),
        "flown": {name: sum(line["effect"] == name for line in hidden) for name in sorted(named)},
        "by_effect": {name: rates([x for x in relevant if x["effect"] == name]) for name in sorted(named)},
        "seconds_median": float(np.median([x["seconds"] for x in flown])) if flown else None,
    }


def share(hits: list[bool]) -> dict[str, Any]:
    """Share, with the number of flights."""
    return {"share": float(np.mean(hits)) if hits else None, "flights": len(hits)}


def rates(flights: list[dict[str, Any]]) -> dict[str, Any]:
    """How often the right effect was named, and what became of the error."""
    if not flights:
        return {"flights": 0}

    def place(flight: dict[str, Any]) -> int:
        names = [c["effect"] for c in flight["candidates"]]
        return names.index(flight["effect"]) if flight["effect"] in names else 99

    def named(flight: dict[str, Any]) -> bool:
        best = flight["candidates"][0] if flight["candidates"] else None
        return best is not None and flight["effect"] in (best["effect"], *best["confounded_with"])

    def alias(flight: dict[str, Any]) -> bool:
        best = flight["candidates"][0] if flight["candidates"] else None
        return best is not None and best["effect"] in {flight["effect"], *aliases_of(flight["effect"])}

    ratio = [f["errors"]["diagnosed"][f["axis"]] / f["errors"]["oracle"][f["axis"]] for f in flights]
    return {
        "flights": len(flights),
        "detected": float(np.mean([f["verdict"] != "none" for f in flights])),
        "right_first": float(np.mean([f["verdict"] == "missing" and place(f) == 0 for f in flights])),
        "right_or_alias": float(np.mean([f["verdict"] == "missing" and alias(f) for f in flights])),
        "in_first_three": float(np.mean([f["verdict"] != "none" and place(f) < 3 for f in flights])),
        "within_confounded": float(np.mean([f["verdict"] == "missing" and named(f) for f in flights])),
        "base": float(np.median([f["errors"]["base"][f["axis"]] for f in flights])),
        "diagnosed": float(np.median([f["errors"]["diagnosed"][f["axis"]] for f in flights])),
        "oracle": float(np.median([f["errors"]["oracle"][f["axis"]] for f in flights])),
        "floor": float(np.median([f["floor"].get(f["axis"], np.nan) for f in flights])),
        "to_oracle_median": float(np.median(ratio)),
        "to_oracle_90": float(np.quantile(ratio, 0.9)),
        "within_ten_percent": float(np.mean(np.array(ratio) <= 1.1)),
    }


def without(flights: list[dict[str, Any]]) -> dict[str, Any]:
    """What is said when the true effect is not in the library."""
    said = [f["without"] for f in flights]
    both = list(zip(said, flights, strict=True))
    alias = [s["verdict"] == "missing" and s["effect"] in aliases_of(f["effect"]) for s, f in both]
    return {
        "flights": len(flights),
        "unexplained_right_axis": share(
            [s["verdict"] == "unexplained" and f["axis"] in s.get("axes", [s["axis"]]) for s, f in both]
        )["share"],
        "unexplained": share([s["verdict"] == "unexplained" for s in said])["share"],
        "alias": share(alias)["share"],
        "wrong_name": share([s["verdict"] == "missing" and not a for s, a in zip(said, alias, strict=True)])["share"],
        "none": share([s["verdict"] == "none" for s in said])["share"],
    }


def methods(clean: list[dict[str, Any]], relevant: list[dict[str, Any]]) -> dict[str, Any]:
    """``diagnose`` beside the methods of other_methods, where the truth is in the forces and moments."""
    clean = [f for f in clean if "methods" in f]
    hidden = [f for f in relevant if "methods" in f and BY_ID[f["effect"]].kind != MEASUREMENT]
    if not clean or not hidden:
        return {}
    return {name: method_rates(name, clean, hidden) for name in ("diagnose", *other_methods.METHODS)}


def method_rates(name: str, clean: list[dict[str, Any]], hidden: list[dict[str, Any]]) -> dict[str, Any]:
    """Rates of one method."""
    said = [_said(name, f) for f in hidden]
    both = list(zip(said, hidden, strict=True))
    error = [s["errors"].get(f["axis"], f["errors"]["base"][f["axis"]]) for s, f in both]
    ratio = [e / f["errors"]["oracle"][f["axis"]] for e, f in zip(error, hidden, strict=True)]
    right = [[s["verdict"] == "missing" and f["effect"] == e for e in s["effects"]] for s, f in both]
    names = [{f["effect"], *aliases_of(f["effect"])} for f in hidden]
    alias = [s["verdict"] == "missing" and bool(set(s["effects"][:1]) & n) for s, n in zip(said, names, strict=True)]
    return {
        "hidden": len(hidden),
        "clean": len(clean),
        "right_first": share([any(r[:1]) for r in right])["share"],
        "right_or_alias": share(alias)["share"],
        "in_first_three": share([any(r[:3]) for r in right])["share"],
        "false_verdicts": share([_said(name, f)["verdict"] != "none" for f in clean])["share"],
        "to_oracle_median": float(np.median(ratio)),
        "to_oracle_90": float(np.quantile(ratio, 0.9)),
        "seconds_median": float(np.median([_said(name, f)["seconds"] for f in (*clean, *hidden)])),
    }


def _said(name: str, flight: dict[str, Any]) -> dict[str, Any]:
    """Verdict, effects in order, errors by axis and seconds of one method."""
    if name != "diagnose":
        return flight["methods"][name]
    effects = [c["effect"] for c in flight["candidates"]]
    said = {key: flight[key] for key in ("verdict", "seconds")}
    return {**said, "effects": effects, "errors": flight["errors"]["diagnosed"]}


def lines_path(which: str) -> Path:
    """Where the flights of a set are."""
    return RESULTS / f"hidden_effects_{which}.jsonl"


def lines_of(which: str) -> list[dict[str, Any]]:
    """Flights of a set that have been flown."""
    path = lines_path(which)
    return [json.loads(text) for text in path.read_text(encoding="utf8").splitlines()] if path.exists() else []


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", choices=sorted(FIRST_SEED), default="tuned")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--clean", type=int, default=60)
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--only", nargs="+", metavar="EFFECT", help="these effects alone")
    parser.add_argument("--summary", action="store_true", help="no flights, only the summary of those that are there")
    parser.add_argument("--duration", type=float, default=DURATION, metavar="S", help="of each flight (%(default)s)")
    parser.add_argument("--imu-rate", type=float, metavar="HZ", help="clean flights alone, with a slow IMU")
    arguments = parser.parse_args()
    slow = arguments.imu_rate is not None
    name = f"{arguments.set}_imu_{arguments.imu_rate:g}_hz" if slow else arguments.set
    path = lines_path(name)
    lines = lines_of(name)
    done = {(line["simulator"], line["effect"], line["seed"]) for line in lines}
    flights = jobs(arguments.set, 0 if slow else arguments.seeds, arguments.clean)
    todo = [j for j in flights if (*j.values(),) not in done]
    todo = [j for j in todo if not arguments.only or j["effect"] in arguments.only]
    if not arguments.summary and todo:
        context = multiprocessing.get_context("fork")
        with ProcessPoolExecutor(arguments.jobs, mp_context=context) as pool, path.open("a", encoding="utf8") as file:
            flown = pool.map(partial(fly, duration=arguments.duration, imu_rate=arguments.imu_rate), todo)
            for number, line in enumerate(flown, 1):
                lines.append(line)
                file.write(json.dumps(line) + "\n")
                file.flush()
                print(f"{number}/{len(todo)} {line['simulator']} {line['effect']}: {line.get('verdict')}", flush=True)
    result = summary(lines)
    (RESULTS / f"hidden_effects_{name}.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    if not slow:
        sets = {name: lines_of(name) for name in FIRST_SEED if lines_path(name).exists()}
        draw(sets, {name: summary(found) for name, found in sets.items()}, FIGURE)
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
