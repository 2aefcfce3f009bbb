"""A simulated fleet with stated truth through `aircraft-sysid fleet`, and what the fleet costs beside its flights.

    python benchmarks/fleet.py [--small] [--costs N] [--flights N] [--diagnosed] [--workers N] [--place FOLDER]

The whole fleet has 400 flights of 60 s of 8 airframes, 50 of each (--flights): an elevator that wears by 0.5 % per
flight, a new propeller, an aileron bent on a date, one 10 % heavier than its file says, two in light turbulence,
two healthy; ten damaged files and one that hangs. It is flown without diagnosis, which takes most of the time and says
nothing of what changes; --diagnosed flies it with. The small one has 2 airframes and 20 flights, with twice the wear
and the bent aileron, all diagnosed. Flights that are there are not simulated again, nor flown again.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.fleet.apart import Limits
from aircraft_sysid_ros.fleet.cluster import Work, cluster, fly_all
from aircraft_sysid_ros.fleet.flight_task import Job, Options
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"
PROGRAM = [sys.executable, "-m", "aircraft_sysid_ros.commands.main"]
BEGIN = datetime(2026, 3, 1, 10, tzinfo=timezone.utc)
DAMAGED, LIMIT = 10, 300.0
DURATION, REPLICAS = 60.0, 2


@dataclass(frozen=True)
class Airframe:
    """The truth of one airframe: factors on coefficients by flight, the mass over that of its file, the air."""

    name: str
    drift: dict[str, float] = field(default_factory=dict)  # share per flight
    jump: dict[str, float] = field(default_factory=dict)  # factor from ``at`` on
    at: int = 0
    mass: float = 1.0
    air: str = "none"

    def coefficients(self, known: dict[str, float], flight: int) -> dict[str, float]:
        """True coefficients of a flight."""
        found = dict(known)
        for name, share in self.drift.items():
            found[name] *= 1.0 + share * flight
        for name, factor in self.jump.items():
            found[name] *= factor if flight >= self.at else 1.0
        return found


BENT = {"Cl_da": 0.85, "Cn_da": 0.85}
WHOLE = (
    Airframe("worn", drift={"Cm_de": -0.005, "CZ_de": -0.005}), Airframe("propeller", jump={"CX_Tc": 1.15}, at=10),
    Airframe("bent", jump=BENT, at=16), Airframe("heavy", mass=1.1), Airframe("gusty-1", air="light"),
    Airframe("gusty-2", air="light"), Airframe("sound-1"), Airframe("sound-2"),
)  # fmt: skip
SMALL = (Airframe("worn", drift={"Cm_de": -0.01, "CZ_de": -0.01}), Airframe("bent", jump=BENT, at=6))


def simulate(airframe: Airframe, flight: int, seed: int, place: Path) -> dict[str, Any]:
    """One flight on disk, where it is not there yet; its entry of the list."""
    source = yaml.safe_load((ROOT / "config" / "ultra_stick_25e.yaml").read_text(encoding="utf8"))
    true = {**source, "mass": airframe.mass * source["mass"]}
    true["coefficients"] = airframe.coefficients(source["coefficients"], flight)
    bag = place / airframe.name / f"{flight:03d}.mcap"
    if not bag.exists():
        flown = simulate_samples(aircraft_from_dict(true), seed, DURATION, turbulence=airframe.air)
        write_flight(flown, bag)
    start = (BEGIN + timedelta(days=flight)).isoformat()
    return {"recording": str(bag), "airframe": airframe.name, "name": f"{airframe.name}/{flight:03d}", "start": start}


def damage(entries: list[dict[str, Any]], place: Path) -> list[dict[str, Any]]:
    """Files that end in the middle, are empty or something else, no two alike, and a pipe in which nothing comes."""
    (place / "damaged").mkdir(exist_ok=True)
    found = []
    for number in range(DAMAGED):
        path = place / "damaged" / f"{number:03d}.mcap"
        sound = Path(entries[number]["recording"]).read_bytes()
        path.write_bytes((bytes(number), b"no recording" * (100 + number), sound[: 40 + 10 * number])[number % 3])
        found.append({"recording": str(path), "airframe": "damaged"})
    pipe = place / "damaged" / "hangs.mcap"
    if not pipe.exists():
        os.mkfifo(pipe)
    return [*found, {"recording": str(pipe), "airframe": "damaged", "name": "damaged/hangs"}]


def fly(source: Path, out: Path, *more: str) -> tuple[dict[str, Any], float]:
    """The answer of the command, and its wall-clock time [s]."""
    aircraft = str(ROOT / "config" / "ultra_stick_25e.yaml")
    command = [*PROGRAM, "fleet", str(source), "--aircraft", aircraft, "--out", str(out), "--json", *more]
    began = time.perf_counter()
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout), time.perf_counter() - began


def costs(out: Path) -> list[float]:
    """Processor time [s] of each flight that was flown."""
    answers = [json.loads(path.read_text(encoding="utf8")) for path in sorted((out / "results").glob("*/*.json"))]
    return [answer["cpu"] for answer in answers if answer["ok"]]


def plain(entries: list[dict[str, Any]], place: Path, replicas: int) -> list[float]:
    """Processor time [s] of the same work in one process, one flight after the other, without a fleet."""
    code = (
        "import json, os, sys; from pathlib import Path; os.environ['AIRCRAFT_SYSID_CORES'] = '1'\n"
        "import aircraft_sysid_ros.fleet.warm\n"
        "from aircraft_sysid_ros.fleet.flight_task import Job, Options, answer_of, program_key\n"
        "place, aircraft, replicas, *bags = sys.argv[1:]; found = []\n"
        "for number, bag in enumerate([bags[0], *bags]):  # the first loads what is still missing\n"
        "    folder = Path(place, str(number)); folder.mkdir(parents=True)\n"
        "    job = Job('', Path(bag), False, Path(aircraft), Options(int(replicas)), program_key())\n"
        "    found.append(answer_of(job, folder)['cpu'])\n"
        "print(json.dumps(found[1:]))"
    )
    bags = [entry["recording"] for entry in entries]
    aircraft = str(ROOT / "config" / "ultra_stick_25e.yaml")
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", code, str(place), aircraft, str(replicas), *bags]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=environment)
    return list(json.loads(done.stdout))


def found_of(fleet: tuple[Airframe, ...], answer: dict[str, Any], out: Path) -> dict[str, Any]:
    """What was named, beside the truth."""
    flights = pd.read_parquet(out / "flights.parquet")
    used = pd.read_parquet(out / "parameters.parquet").query("status == 'USE'")
    known = yaml.safe_load((ROOT / "config" / "ultra_stick_25e.yaml").read_text(encoding="utf8"))["coefficients"]
    truth = []
    for airframe in fleet:
        truth += [(airframe.name, p, "drift", share * known[p], 0) for p, share in airframe.drift.items()]
        truth += [(airframe.name, p, "jump", (f - 1) * known[p], airframe.at) for p, f in airframe.jump.items()]
    changes = {(c["airframe"], c["parameter"]): c for c in answer["changes"]}
    rows = []
    for airframe, parameter, kind, size, at in truth:
        row: dict[str, Any] = {
            "airframe": airframe, "parameter": parameter, "kind": kind, "size": size, "flight": at, "found": None,
            "std_of_a_flight": float(used[(used.airframe == airframe) & (used.parameter == parameter)]["std"].median()),
        }  # fmt: skip
        if (change := changes.pop((airframe, parameter), None)) is not None:
            row["found"] = {key: change[key] for key in ("kind", "size", "std", "flight", "p_value")}
        rows.append(row)
    bad = flights[flights.airframe == "damaged"]
    return {
        "flights": len(flights), "ok": int(flights.ok.sum()), "truth": rows, "damaged": len(bad),
        "damaged_named": int((~bad.ok & (bad.reason != "")).sum()), "other_changes": list(changes.values()),
        "other_failures": [f for f in answer["failures"] if not f["flight"].startswith("damaged/")],
        "differences": [{k: d[k] for k in ("airframe", "parameter")} for d in answer["differences"]],
        "effects": answer["effects"],
    }  # fmt: skip


def nothing(job: Job, folder: Path) -> dict[str, Any]:
    """A flight of no length: what is left is the fleet's own."""
    return {"key": job.key, "folder": str(folder)}


def of_the_fleet(count: int = 200) -> float:
    """Processor time [s] of scheduler, client and worker for each flight, without that of the flights."""
    jobs = [Job(str(k), Path(), False, Path(), Options(2), "") for k in range(count + 1)]
    work = Work(nothing, (), ("aircraft_sysid_ros.fleet.warm",))
    with cluster(None, workers=1) as client:
        fly_all(client, jobs[:1], work, Limits(LIMIT), lambda job, outcome: None)
        spent = [time.process_time(), *client.run(time.process_time).values()]
        fly_all(client, jobs[1:], work, Limits(LIMIT), lambda job, outcome: None)
        return (sum([time.process_time(), *client.run(time.process_time).values()]) - sum(spent)) / count


def costs_of(entries: list[dict[str, Any]], place: Path, replicas: int, words: list[str]) -> dict[str, Any]:
    """A few flights by one worker, by two, and without a fleet: processor time [s], each kept when it is measured.

    On a machine that others use wall-clock time says nothing; what two workers cost more than one in processor time is
    what they wait for each other's memory and caches.
    """
    few, kept, stamp = place / "few.yaml", place / "costs.json", time.time_ns()
    few.write_text(yaml.safe_dump(entries), encoding="utf8")
    result: dict[str, Any] = json.loads(kept.read_text(encoding="utf8")) if kept.exists() else {}

    def by(workers: int) -> dict[str, float]:
        out = place / f"few-{workers}-{stamp}"
        answer, wall = fly(few, out, *words, "--workers", str(workers))
        assert answer["ok"] == len(entries)
        return {"wall": wall, "flights_cpu": sum(costs(out)), "load": os.getloadavg()[0]}

    pieces = {
        "own": of_the_fleet,
        "workers_1": lambda: by(1),
        "workers_2": lambda: by(2),
        "plain_cpu": lambda: sum(plain(entries, place / f"plain-{stamp}", replicas)),
    }
    for name, measure in pieces.items():
        if name not in result:
            result[name] = measure()
            kept.write_text(json.dumps(result), encoding="utf8")
    return {"flights": len(entries), **result}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true")
    parser.add_argument("--place", type=Path, default=ROOT / "build" / "fleet")
    parser.add_argument("--flights", type=int, metavar="N", help="of each airframe (default 50, small 10)")
    parser.add_argument("--diagnosed", action="store_true")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)), metavar="N")
    parser.add_argument("--costs", type=int, default=0, metavar="N", help="times of N flights in place of the fleet")
    args = parser.parse_args()
    fleet, count = (SMALL, 10) if args.small else (WHOLE, 50)
    place = args.place / ("small" if args.small else "whole")
    jobs = [
        (frame, flight, 1000 * k + flight) for k, frame in enumerate(fleet) for flight in range(args.flights or count)
    ]
    with ProcessPoolExecutor(args.workers) as pool:
        made = [pool.submit(simulate, *job, place) for job in jobs[: args.costs or None]]
        entries = [each.result() for each in made]
    words = ["--replicas", str(REPLICAS), "--time-limit", str(LIMIT)]
    if args.costs:
        name, result = "fleet_costs", costs_of(entries, place, REPLICAS, words)
    else:
        listed = place / "list.yaml"
        listed.write_text(yaml.safe_dump([*entries, *damage(entries, place)]), encoding="utf8")
        is_diagnosed = args.small or args.diagnosed
        out = place / ("out" if is_diagnosed else "out-not-diagnosed")
        words += [] if is_diagnosed else ["--no-diagnosis"]
        answer, _ = fly(listed, out, *words, "--workers", str(args.workers))
        each = costs(out)
        name = "fleet_small" if args.small else "fleet"
        result = found_of(fleet, answer, out)
        result |= {"cpu_per_flight": sum(each) / len(each), "bytes_per_answer": _bytes_of(out) / len(each)}
        result["diagnosed"] = is_diagnosed
    result |= {"duration": DURATION, "replicas": REPLICAS}
    (RESULTS / f"{name}.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")


def _bytes_of(out: Path) -> int:
    return sum(path.stat().st_size for path in (out / "results").glob("*/*.json"))


if __name__ == "__main__":
    main()
