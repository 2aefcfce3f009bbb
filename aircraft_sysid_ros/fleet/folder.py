"""What the folder of a fleet is known by: whoever only asks that needs nothing else of a fleet."""

from __future__ import annotations

from pathlib import Path

FLIGHTS = "flights.parquet"


def is_fleet(folder: str | Path) -> bool:
    """Whether a folder is that of a fleet."""
    return (Path(folder) / FLIGHTS).is_file()
