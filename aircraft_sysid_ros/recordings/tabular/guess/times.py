"""The time column of a table, and its unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.tabular.clock import NO_TIME, days_later, spans, stamps_of
from aircraft_sysid_ros.recordings.tabular.column_map import HHMMSS, TEXT_TIMES, TimeBase
from aircraft_sysid_ros.recordings.tabular.guess.names import TIME, guess_name
from aircraft_sysid_ros.recordings.tabular.guess.time_units import fitting_units, is_hhmmss, is_unix_time, is_usual_step
from aircraft_sysid_ros.recordings.tabular.table import Table, numbers
from aircraft_sysid_ros.recordings.tabular.units import conversion
from aircraft_sysid_ros.samples import PAUSE

Array = npt.NDArray[np.float64]
#: A time starts over where it goes back to within this share of a manoeuvre of its first value, for so many rows.
_SAME_BEGIN, _LEAST_ROWS = 0.2, 20
#: Minute, hour, day and week in s, ms and us: where clocks start over by themselves.
_WRAPS = tuple(period * ticks for period in (60.0, 3600.0, 86_400.0, 604_800.0) for ticks in (1.0, 1e3, 1e6))


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
    restarts: int = 0  # how often it starts over; ``seconds`` go on

    def in_its_unit(self, seconds: float) -> str:
        """A span of time as an offset of the MAP has it; those of texts are in seconds."""
        unit = "s" if self.unit in TEXT_TIMES else self.unit
        return f"{round(seconds / conversion(unit, 's').factor, 6):.15g} {unit}"


def guess_time(table: Table, columns: dict[str, npt.NDArray[Any]]) -> TimeGuess | None:
    """The time of a table from its columns (n,) by name; None where there is none."""
    named = {
        name: guess
        for name in columns
        if (guess := guess_name(name, table.units.get(name, ""))) and guess.signal == TIME
    }
    found = [
        candidate
        for name in sorted(named, key=lambda name: (name != table.time, named[name].distance))
        if (candidate := _candidate(name, named[name].unit, table, columns)) is not None
    ]
    if not found and columns:
        first = next(iter(columns))
        unnamed = _candidate(first, "", table, columns) if first not in named else None
        found = [replace(unnamed, sure=False)] if unnamed is not None and _is_regular(unnamed) else []
    if not found:
        return None
    found.sort(key=_stands_still)  # a date to the second beside a time of its own
    return replace(found[0], others=tuple(candidate.column for candidate in found[1:]))


def _stands_still(candidate: TimeGuess) -> bool:
    """Whether more than a few rows have the time of the row before."""
    steps = np.diff(candidate.seconds[np.isfinite(candidate.seconds)])
    return bool(np.mean(steps == 0.0) > 0.1)


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
        if values.dtype.kind in "OUT" and _is_text(values) and spans(values) is None:
            try:
                stamps = stamps_of(values, TimeBase(name, "iso", 0.0, 0), None, f"its time '{name}'")
            except InputError as error:
                return f"{table.name} is left out: {error}"
            known = _past_midnight(np.where(stamps == NO_TIME, np.nan, stamps * 1e-9))
        known = known[np.isfinite(known)]
        back = np.flatnonzero(np.diff(known) < 0.0)
        if len(back):
            return (
                f"{table.name} is left out: its column '{name}' goes back at data row {back[0] + 2}: make it a time "
                "that keeps rising, or map it with restarts: true where every manoeuvre starts over"
            )
        if len(known) > 1 and known[-1] > known[0] and not guess.unit:
            step = _usual_step(known)
            units, _ = fitting_units(numbers(values)[0], step, table, columns)
            if len(units) > 1:
                return (
                    f"{table.name} is left out: its time '{name}' rises by {step:.6g} from row to row, which may be "
                    f"{' or '.join(units)}: write its unit behind its name, as in '{name} [{units[0]}]'"
                )
        return f"{table.name} is left out: the unit of its time '{name}' cannot be found, or it does not rise"
    return f"{table.name} is left out: no column of it is named as a time (once) and rises"


def _candidate(name: str, unit: str, table: Table, columns: dict[str, npt.NDArray[Any]]) -> TimeGuess | None:
    values = columns[name]
    if values.dtype.kind in "OUT" and _is_text(values) and (written := spans(values)) is not None:
        values, unit = written
    elif values.dtype.kind == "M" or (values.dtype.kind in "OUT" and _is_text(values)):
        return _of_texts(name, values)
    ticks, bad = numbers(values)
    if (not unit or conversion(unit, "s").factor == 1.0) and not bad and is_hhmmss(ticks):
        return _of_texts(name, values, [HHMMSS])
    ticks = _past_midnight(ticks)
    known = ticks[np.isfinite(ticks)]
    rising = np.diff(known) > 0.0
    if bad > 0.1 * len(ticks) or len(known) < 3 or not rising.any():
        return None
    restarts = _restarts(known)
    if restarts is None or not (restarts or known[-1] > known[0]):
        return None
    step = _usual_step(known)
    evidence = [f"it starts over {restarts} times, with a manoeuvre each"] if restarts else []
    if unit:
        evidence.append(f"{unit}: said by the header or the name")
    else:
        units, why = fitting_units(ticks, step, table, columns)
        if len(units) != 1:
            return None
        unit = units[0]
        evidence += [f"{unit}: it rises by {step:.6g} from row to row", *([why] if why else [])]
    seconds = _running_on(ticks * conversion(unit, "s").factor)
    plausible = is_usual_step(step * conversion(unit, "s").factor)
    return TimeGuess(name, unit, seconds, is_unix_time(seconds), plausible, evidence, restarts=restarts)


def _usual_step(known: Array) -> float:
    """By how much times (n,) usually rise."""
    steps = np.diff(known)
    return float(np.median(steps[steps > 0.0]))


def _restarts(known: Array) -> int | None:
    """How often times (n,) start over, at nearly the first of them; None where they go back otherwise.

    A clock that shows the second of a minute or of a day, and that of a manoeuvre of one minute, look alike.
    """
    back = np.flatnonzero(np.diff(known) < 0.0) + 1
    if not len(back):
        return 0
    parts = np.split(known, back)
    if min(map(len, parts)) < _LEAST_ROWS:
        return None
    spans = np.array([np.ptp(part) for part in parts])
    step, end = float(np.median(np.diff(parts[0]))), float(np.median([part[-1] for part in parts[:-1]]))
    if any(abs(end + step - wrap) < 1.5 * step for wrap in _WRAPS):
        return None
    near = np.abs(known[np.concatenate([[0], back])] - known[0]) <= _SAME_BEGIN * np.median(spans)
    return len(back) if near.all() else None


def _running_on(seconds: Array) -> Array:
    """Times (n,) [s] that go on after every restart, a pause later."""
    out, rows = seconds.copy(), np.flatnonzero(np.isfinite(seconds))
    steps = np.diff(seconds[rows])
    out[rows[1:]] += np.cumsum(np.where(steps < 0.0, PAUSE - steps, 0.0))
    return out


def _past_midnight(ticks: Array) -> Array:
    """Times (n,) that go on where the clock of a day passed midnight, whatever their unit is."""
    out, rows = ticks.copy(), np.flatnonzero(np.isfinite(ticks))
    for second in (1, 1_000, 1_000_000) if len(rows) else ():
        out[rows] += days_later(out[rows], out[rows[0]], second)
    return out


def _is_text(values: npt.NDArray[Any]) -> bool:
    first = next((value for value in values.tolist() if value is not None and value == value), None)
    return first is not None and not isinstance(first, (int, float))


def _of_texts(name: str, values: npt.NDArray[Any], units: Sequence[str] = ("iso", "irig")) -> TimeGuess | None:
    for unit in units:
        try:
            stamps = stamps_of(values, TimeBase(name, unit, 0.0, 0), None, name)
        except InputError:
            continue
        seconds = _past_midnight(np.where(stamps == NO_TIME, np.nan, stamps * 1e-9))
        known = seconds[np.isfinite(seconds)]
        if len(known) > 2 and not (np.diff(known) < 0.0).any() and known[-1] > known[0]:
            told = "numbers that are hours, minutes and seconds" if unit == HHMMSS else "texts that are times"
            return TimeGuess(name, unit, seconds, True, True, [f"{unit}: {told}"])
    return None
