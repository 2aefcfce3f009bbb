"""What benchmarks measured, and how it stands in a table of the docs."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"

#: Header and rows of a table.
Rows = tuple[Sequence[str], Sequence[Sequence[str]]]


def load(name: str) -> dict[str, Any]:
    """Summary of a benchmark."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf8"))


def load_lines(name: str) -> list[dict[str, Any]]:
    """Flights of a benchmark, one each."""
    lines = (RESULTS / f"{name}.jsonl").read_text(encoding="utf8").splitlines()
    return [json.loads(line) for line in lines]


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def percent(share: float) -> str:
    """In per cent, with one decimal."""
    return f"{100 * share:.1f} %"


def from_code(make: Callable[[], Rows]) -> Callable[[], str]:
    """Writes a table of what the code itself says."""
    return lambda: table(*make())


def from_summary(make: Callable[..., Rows], *sources: str) -> Callable[[], str]:
    """Writes a table of the summaries of benchmarks."""
    return _when_measured(make, load, "json", sources)


def from_flights(make: Callable[..., Rows], *sources: str) -> Callable[[], str]:
    """Writes a table of the flights of benchmarks."""
    return _when_measured(make, load_lines, "jsonl", sources)


def _when_measured(
    make: Callable[..., Rows], read: Callable[[str], Any], ending: str, sources: Sequence[str]
) -> Callable[[], str]:
    def made() -> str:
        missing = [source for source in sources if not (RESULTS / f"{source}.{ending}").exists()]
        if missing:
            return f"Not measured yet: benchmarks/results lacks {' and '.join(missing)}.\n"
        return table(*make(*map(read, sources)))

    return made
