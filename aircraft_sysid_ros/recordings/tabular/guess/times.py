"""The time column of a table, and its unit."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.tabular.clock import NO_TIME, stamps_of
from aircraft_sysid_ros.recordings.tabular.column_map import TimeBase
from aircraft_sysid_ros.recordings.tabular.guess.names import TIME, guess_name
from aircraft_sysid_ros.recordings.tabular.table import Table, numbers
from aircraft_sysid_ros.recordings.tabular.units import conversion

Array = npt.NDArray[np.float64]
_SHORTEST_STEP, _LONGEST_STEP = 0.0015, 1.5  # [s] of a unit without a name
_UNIX = (9e8, 2.14e9)  # [s]


@dataclass(frozen=True)
class TimeGuess:
    """A time column, with the times [s] of all rows, NaN where there is none."""

    column: str
    unit: str
    seconds: Array
    is_unix: bool
    sure: bool
    evidence: list[str] = field(default_factory=list)
    others: tuple[str, ...] = ()  # further columns that could be it
    offset: float = 0.0  # in its unit, to the clock of the other tables


def guess_time(table: Table, columns: dict[str, npt.NDArray[Any]]) -> TimeGuess | None:
    """The time of a table from its columns (n,) by name; None where there is none."""
    named = {
        name: guess
        for name in columns
        if (guess := guess_name(name, table.units.get(name, ""))) and guess.signal == TIME
    }
    found = [
        candidate
        for name in sorted(named, key=lambda name: named[name].distance)
        if (candidate := _candidate(name, columns[name], named[name].unit)) is not None
    ]
    if not found and columns:
        first = next(iter(columns))
        unnamed = _candidate(first, columns[first], "") if first not in named else None
        found = [replace(unnamed, sure=False)] if unnamed is not None and _is_regular(unnamed) else []
    if not found:
        return None
    best = found[0]
    others = tuple(candidate.column for candidate in found[1:])
    return TimeGuess(best.column, best.unit, best.seconds, best.is_unix, best.sure, best.evidence, others)


def _is_regular(candidate: TimeGuess) -> bool:
    """Whether a column without a name of a time rises by equal steps, and is no counter of rows."""
    steps = np.diff(candidate.seconds[np.isfinite(candidate.seconds)])
    usual = float(np.median(steps))
    is_counter = candidate.unit == "s" and bool(np.all(steps == 1.0))
    return not is_counter and bool(np.ptp(np.percentile(steps, (5, 95))) < 0.2 * usual)


def why_no_time(table: Table, columns: dict[str, npt.NDArray[Any]]) -> str:
    """Why guess_time finds nothing, for the user."""
    for name, values in columns.items():
        guess = guess_name(name, table.units.get(name, ""))
        if guess is None or guess.signal != TIME:
            continue
        known = numbers(values)[0]
        known = known[np.isfinite(known)]
        back = np.flatnonzero(np.diff(known) < 0.0)
        if len(back):
            return f"{table.name} is left out: its column '{name}' goes back at data row {back[0] + 2}"
        return f"{table.name} is left out: the unit of its time '{name}' cannot be told, or it stands still"
    return f"{table.name} is left out: no column of it is named as a time (once) and rises"


def _candidate(name: str, values: npt.NDArray[Any], unit: str) -> TimeGuess | None:
    if values.dtype.kind == "M" or (values.dtype.kind in "OUT" and _is_text(values)):
        return _of_texts(name, values)
    ticks, bad = numbers(values)
    known = ticks[np.isfinite(ticks)]
    if bad > 0.1 * len(ticks) or len(known) < 3 or (np.diff(known) < 0.0).any() or known[-1] <= known[0]:
        return None
    step = float(np.median(np.diff(known)[np.diff(known) > 0.0]))
    evidence = []
    if unit:
        evidence.append(f"{unit}: said by the header or the name")
    else:
        units = [
            u for u in ("s", "ms", "us", "ns") if _SHORTEST_STEP <= step * conversion(u, "s").factor < _LONGEST_STEP
        ]
        if len(units) != 1:
            return None
        unit = units[0]
        evidence.append(f"{unit}: it rises by {step:.6g} from row to row")
    seconds = ticks * conversion(unit, "s").factor
    plausible = _SHORTEST_STEP / 10.0 <= step * conversion(unit, "s").factor < 10.0 * _LONGEST_STEP
    return TimeGuess(name, unit, seconds, bool(_UNIX[0] < np.nanmin(seconds) < _UNIX[1]), plausible, evidence)


def _is_text(values: npt.NDArray[Any]) -> bool:
    first = next((value for value in values.tolist() if value is not None and value == value), None)
    return first is not None and not isinstance(first, (int, float))


def _of_texts(name: str, values: npt.NDArray[Any]) -> TimeGuess | None:
    for unit in ("iso", "irig"):
        try:
            stamps = stamps_of(values, TimeBase(name, unit, 0.0, 0), None, name)
        except InputError:
            continue
        seconds = np.where(stamps == NO_TIME, np.nan, stamps * 1e-9)
        known = seconds[np.isfinite(seconds)]
        if len(known) > 2 and not (np.diff(known) < 0.0).any() and known[-1] > known[0]:
            return TimeGuess(name, unit, seconds, True, True, [f"{unit}: texts that are times"])
    return None
