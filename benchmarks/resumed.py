"""Flights of a benchmark, each a line of a file: what is stopped goes on where it was."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable, Iterable, Iterator
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
