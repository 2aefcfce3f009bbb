"""Flights of a benchmark, each a line of a file: what is stopped goes on where it was."""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

Record = dict[str, Any]


def flown(fly: Callable[[Any], Record], wanted: Iterable[Any], results: Path, jobs: int) -> Iterator[Record]:
    """Results of ``wanted``, seeds or records with a ``seed``: those that are in the file, then the others, flown."""
    by_seed = {want["seed"] if isinstance(want, dict) else want: want for want in wanted}
    lines = results.read_text(encoding="utf8").splitlines() if results.exists() else []
    known = {record["seed"]: record for record in map(json.loads, lines) if record["seed"] in by_seed}
    yield from known.values()
    left = [want for seed, want in by_seed.items() if seed not in known]
    with (
        ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool,
        results.open("a", encoding="utf8") as file,
    ):
        for record in pool.map(fly, left):
            file.write(json.dumps(record) + "\n")
            file.flush()
            yield record


def options(description: str | None, first: int | None = None, **counts: int) -> argparse.ArgumentParser:
    """Options that such benchmarks have: how many flights of each kind, the first seed, processes and the file.

    ``first``: the usual first seed; None: the seeds are listed.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, count in counts.items():
        parser.add_argument(f"--{name}", type=int, default=count, help="number of such flights")
    if first is not None:
        parser.add_argument("--first", type=int, default=first, help="first seed")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="flights at a time")
    parser.add_argument("--results", type=Path, help="file of another name")
    return parser


def flown_aloud(
    fly: Callable[[Any], Record], wanted: Collection[Any], results: Path, jobs: int, says: Callable[[Record], str]
) -> list[Record]:
    """All of ``flown``; each is told when it is there, with what it ``says``."""
    done: list[Record] = []
    for record in flown(fly, wanted, results, jobs):
        done.append(record)
        print(f"{len(done)} of {len(wanted)}: {record['seed']} {says(record)}", flush=True)
    return done
