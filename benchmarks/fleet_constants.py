"""What a fleet costs beside its flights: bytes hashed, answers kept and read, tables in memory, series compared.

    python benchmarks/fleet_constants.py

Answers of the size of real ones are made, not flown, for two numbers of flights; what one flight more costs is the
difference. Processor time and memory of processes of their own.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.fleet.between import between_flights
from aircraft_sysid_ros.fleet.changes import Series, change_of
from aircraft_sysid_ros.fleet.flight_task import Job, Options, content_key
from aircraft_sysid_ros.fleet.flights import Flight
from aircraft_sysid_ros.fleet.results import Results
from aircraft_sysid_ros.fleet.tables import Flown, require_pyarrow, tables_of, write_tables
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft

RESULT = Path(__file__).parent / "results" / "fleet_constants.json"
FEW, MANY, OF_ONE = 500, 2500, 50  # flights, and flights of each airframe
LONG_SERIES = 1000
MEGABYTES = 100
COEFFICIENTS = default_aircraft().coefficients


def answer(number: int) -> dict[str, Any]:
    """As large as that of a flight, with values that do not change."""
    rng = np.random.default_rng(number)
    parameters = [
        {
            "name": name,
            "value": value + 0.01 * float(rng.normal()),
            "std": 0.01,
            "status": "USE",
            "V": 20.0,
            "alpha": 0.05,
        }
        for name, value in COEFFICIENTS.items()
    ]
    errors = {"nrmse_fit": 0.1, "nrmse_held_out": 0.1, "noise_floor": 0.1, "white": True}
    finding = {"signal": "airspeed", "kind": "gap", "severity": "info", "sentence": "a gap of some seconds, " * 5}
    return {
        "ok": True, "reason": "", "duration": 60.0, "start": number * 10**12, "parameters": parameters,
        "axes": dict.fromkeys(("CX", "CY", "CZ", "Cl", "Cm", "Cn"), errors), "findings": [finding] * 4,
        "diagnosis": {"verdict": "none", "advice": "", "false_alarm_rate": 0.05, "candidates": []}, "cpu": 14.6,
    }  # fmt: skip


def spent() -> float:
    return sum(resource.getrusage(resource.RUSAGE_SELF)[:2])


def memory() -> float:
    """Largest memory of this process [bytes]."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def of_flights(count: int, found: Any) -> None:
    """Processor time [s] and memory [bytes] of everything but the flights, for a number of them."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "fleet"
        require_pyarrow()
        results, kept = Results(out), 0.0
        jobs = [Job(f"{k:040x}", Path(), False, Path(), Options(2), "") for k in range(count)]
        for k, job in enumerate(jobs):
            one, at = answer(k), spent()
            results.keep(job.key, one)
            kept += spent() - at
        made, at = memory(), spent()
        answers = [results.known(job, 60.0) for job in jobs]
        read = spent() - at
        flown = [
            Flown(Flight(f"N{k // OF_ONE}/{k}", f"N{k // OF_ONE}", Path(f"{k}.mcap"), Path("a.yaml")), a or {})
            for k, a in enumerate(answers)
        ]
        at = spent()
        tables = tables_of(flown)
        tabled, at = spent() - at, spent()
        between = between_flights(tables, flown)
        compared, at = spent() - at, spent()
        write_tables(out, {**tables, "changes": between.changes, "airframes": between.airframes})
        written = spent() - at
        size = sum(path.stat().st_size for path in out.glob("*.parquet"))
        found.send({
            "keep": kept, "read": read, "tables": tabled, "between": compared, "write": written,
            "memory": memory() - made, "parquet": size,
        })  # fmt: skip


def apart(work: Callable[..., None], *arguments: Any) -> dict[str, float]:
    """In a process of its own."""
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("fork").Process(target=work, args=(*arguments, there))
    process.start()
    answered: dict[str, float] = here.recv()
    process.join()
    return answered


def hashed() -> float:
    """Processor time [s] for a megabyte of a recording."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight.mcap"
        path.write_bytes(os.urandom(MEGABYTES << 20))
        at = spent()
        content_key((path,))
        return (spent() - at) / MEGABYTES


def long_series() -> float:
    """Processor time [s] of one parameter of one airframe over many flights."""
    rng = np.random.default_rng(1)
    number = np.arange(LONG_SERIES)
    series = Series(number, rng.normal(size=LONG_SERIES), np.ones(LONG_SERIES), np.full(LONG_SERIES, 20.0))
    at = time.process_time()
    change_of(series)
    return time.process_time() - at


def main() -> None:
    few, many = (apart(of_flights, count) for count in (FEW, MANY))
    each = {name: (many[name] - few[name]) / (MANY - FEW) for name in few}
    result = {"each": each, "of_one": OF_ONE, "megabyte": hashed(), "series": long_series(), "long": LONG_SERIES}
    RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
