"""The Monte Carlo certificate: are the estimators without bias, and are their standard errors true?

    python benchmarks/certificate.py [--only flights|refined|loss|summary] [--methods rls rml] [--seeds 100] [--jobs 2]

Seeds 0, 1, … each fly once in calm air and once in light turbulence (certificate_flights). Every result is a line in
benchmarks/results/certificate_*.jsonl as soon as both flights of the seed are done, so that a method always has as
many flights in either air; what is there is not flown again, unless --again says so. The summary and the figures are
made of all lines at the end.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np
from certificate_flights import (
    AIRS,
    LOSS_DURATION,
    Record,
    fly,
    live_record,
    loss_effects,
    loss_record,
    loss_time,
    refined_record,
    run_data,
)

from aircraft_sysid_ros.errors import InputError

RESULTS = Path(__file__).parent / "results"
LIVE = ("rls", "fourier", "rml")
REFINED = ("output-error", "filter-error")
RESET = "+reset"  # forget all when the loss is noticed
KEEP = "+keep"  # without relearning
LOSS = (*LIVE, f"rls{KEEP}", f"rls{RESET}")
METHODS = {"flights": LIVE, "loss": LOSS, "refined": REFINED}
SEEDS = {"flights": 100, "loss": 20, "refined": 100}


def file_of(part: str) -> Path:
    return RESULTS / f"certificate_{part}.jsonl"


def records_of(part: str) -> list[Record]:
    """What has been flown so far; a line that was cut short is passed over."""
    path, found = file_of(part), []
    for line in path.read_text(encoding="utf8").splitlines() if path.exists() else []:
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    return found


def work(part: str, seed: int, methods: tuple[str, ...]) -> list[Record]:
    """The records of one seed: every method in either air."""
    if part == "loss":
        sound = tuple(m for m in methods if not m.endswith(RESET))
        wanted = [(air, lost) for air in AIRS for lost in (True, False)]
        return [record for air, lost in wanted for record in _loss(seed, air, methods if lost else sound, lost)]
    records = []
    for air in AIRS:
        flight = fly(seed, air)
        if part == "flights":
            records += [live_record(flight, air, method)[0] for method in methods]
        else:
            run, live = run_data(flight)
            records += [refined_record(run, live, air, method) for method in methods]
    return records


def _loss(seed: int, air: str, methods: tuple[str, ...], lost: bool) -> list[Record]:
    at = loss_time(seed)
    try:
        flight = fly(seed, air, LOSS_DURATION, loss_effects(at) if lost else ())
    except InputError as error:
        return [{"seed": seed, "air": air, "method": m, "lost": lost, "failed": str(error)} for m in methods]
    return [loss_record(flight, air, method, at, lost) for method in methods]


def line_of(record: Record) -> str:
    """One line of JSON, numbers to five digits, NaN as null."""

    def short(value: Any) -> Any:
        if isinstance(value, float):
            return float(f"{value:.5g}") if np.isfinite(value) else None
        if isinstance(value, dict):
            return {key: short(item) for key, item in value.items()}
        return [short(item) for item in value] if isinstance(value, list) else value

    return json.dumps(short(record), separators=(",", ":"), allow_nan=False) + "\n"


def jobs_of(parts: list[str], chosen: list[str] | None, seeds: int | None) -> list[tuple[str, int, tuple[str, ...]]]:
    """What is still to fly, (part, seed, methods), so that all parts grow by the same share of what they shall be."""
    found = []
    for part in parts:
        done = {(r["seed"], r["method"]) for r in records_of(part)}
        count = SEEDS[part] if seeds is None else seeds
        for seed in range(count):
            methods = tuple(m for m in METHODS[part] if (not chosen or m in chosen) and (seed, m) not in done)
            if methods:
                found.append((seed / count, (part, seed, methods)))
    return [job for _, job in sorted(found, key=lambda item: item[0])]


def forget(parts: list[str], methods: list[str] | None) -> None:
    """Take the records of some methods out of the files."""
    for part in parts:
        kept = [r for r in records_of(part) if methods and r["method"] not in methods]
        file_of(part).write_text("".join(line_of(r) for r in kept), encoding="utf8")


def append(part: str, records: list[Record]) -> None:
    """Add lines to the file, behind whatever a killed run has left of its last one."""
    path = file_of(part)
    cut = path.exists() and path.stat().st_size > 0 and not path.read_bytes().endswith(b"\n")
    with path.open("a", encoding="utf8") as file:
        file.write("\n" * cut + "".join(line_of(record) for record in records))


def run(jobs: list[tuple[str, int, tuple[str, ...]]], processes: int) -> None:
    RESULTS.mkdir(parents=True, exist_ok=True)
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # read when numpy is imported: in new processes
        os.environ.setdefault(variable, "1")
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        waiting = {pool.submit(work, *job): job for job in jobs}
        for count, future in enumerate(as_completed(waiting), 1):
            part, seed, methods = waiting[future]
            append(part, future.result())
            print(f"{count}/{len(jobs)} {part} seed {seed}: {' '.join(methods)}", file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=[*METHODS, "summary"], help="default: all")
    parser.add_argument("--methods", nargs="+", choices=sorted({m for all in METHODS.values() for m in all}))
    parser.add_argument("--seeds", type=int, help=f"flights in either air (default: {SEEDS})")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: %(default)s)")
    parser.add_argument("--again", action="store_true", help="forget the earlier results of the chosen methods")
    arguments = parser.parse_args()
    parts = [part for part in METHODS if arguments.only is None or part in arguments.only]
    if arguments.again:
        forget(parts, arguments.methods)
    jobs = jobs_of(parts, arguments.methods, arguments.seeds)
    if jobs:
        run(jobs, arguments.jobs)
    from certificate_figures import draw
    from certificate_summary import summarise

    records = {part: records_of(part) for part in METHODS}
    summary = summarise(records)
    (RESULTS / "certificate.json").write_text(json.dumps(summary, indent=1) + "\n", encoding="utf8")
    draw(summary, records, Path(__file__).resolve().parents[1] / "docs" / "figures")


if __name__ == "__main__":
    main()
