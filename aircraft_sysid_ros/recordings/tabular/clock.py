"""Times of a table as stamps: whole nanoseconds since 1970, in UTC where the MAP says what time 0 is."""

from __future__ import annotations

import re
from datetime import datetime, timezone
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.autopilot_log import NO_DATE, gps_nanoseconds
from aircraft_sysid_ros.recordings.tabular.column_map import GPS, HHMMSS, TEXT_TIMES, UTC, ColumnMap, TimeBase
from aircraft_sysid_ros.recordings.tabular.table import imported, numbers
from aircraft_sysid_ros.recordings.tabular.units import conversion, dimension_fits
from aircraft_sysid_ros.stamps import NANOSECONDS

Stamps = npt.NDArray[np.int64]
#: Stands for a time that is not there.
NO_TIME = np.iinfo(np.int64).min
_IRIG = re.compile(r"\s*(\d{1,3}):(\d{1,2}):(\d{2}):(\d{2}(?:\.\d*)?)\s*")
_ZONE = re.compile(r"\s*(GMT|UTC)$")  # what a text without a zone is
_TIME_OF_DAY = re.compile(r"\s*(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d*)?)\s*")
_SPAN = re.compile(r"\s*([-+]?\d[\d.eE+-]*)\s*([a-zA-Zµ]+)\s*")
_DAY = 86_400
#: A clock of a day that goes back has passed midnight if it then is no later [s] than this after where it was.
_PAUSE_AT_MIDNIGHT = 600


def stamps_of(values: npt.NDArray[Any], base: TimeBase, clock: str | datetime | None, where: str) -> Stamps:
    """Stamps (n,) of a time column (n,), NO_TIME where it is empty. Raises InputError for what is no time."""
    if base.unit in TEXT_TIMES:
        found = _of_hhmmss(values, clock, where) if base.unit == HHMMSS else _of_texts(values, base.unit, clock, where)
        return np.where(found == NO_TIME, NO_TIME, found + round(base.offset * NANOSECONDS))
    if values.dtype.kind in "mM" or _holds_times(values):
        raise InputError(f"{where} holds date-times: write unit: iso")
    ticks, missing = _ticks(values, base, where)
    zero = _zero(clock, ticks[~missing])
    return np.where(missing, NO_TIME, ticks + zero)


def days_later(times: npt.NDArray[Any], before: float, second: int = NANOSECONDS) -> npt.NDArray[np.int64]:
    """What to add to times (n,), of so many ticks in a ``second``, since their clock passed midnight; ``before`` them.

    A clock that shows the time of the day goes back by a day then, but for the time that passed.
    """
    steps, day = np.diff(times, prepend=before), _DAY * second
    passed = (steps < 0) & (steps + day > 0) & (steps + day <= _PAUSE_AT_MIDNIGHT * second)
    return np.asarray(np.cumsum(passed) * day, dtype=np.int64)


def first_of_day(begins: Stamps) -> int:
    """Which of times [ns] (n,) that rise comes after the widest gap between them if they are of one day; else 0."""
    if begins[0] < 0 or begins[-1] >= _DAY * NANOSECONDS:
        return 0
    gaps = np.diff(begins, append=begins[0] + _DAY * NANOSECONDS)
    return (len(gaps) - int(np.argmax(gaps[::-1]))) % len(gaps)


def goes_on_past_midnight(before: int, after: int) -> bool:
    """Whether a clock of a day shows a time [ns] just after another."""
    return (after - before) % (_DAY * NANOSECONDS) <= _PAUSE_AT_MIDNIGHT * NANOSECONDS


def start_note(colmap: ColumnMap) -> list[str]:
    """What is said where a MAP does not say when time 0 was."""
    if colmap.clock is None and any(table.time.unit != "iso" for table in colmap.tables):
        return ["the map has no clock: time 0 is stamped 2000-01-01"]
    return []


def spans(values: npt.NDArray[Any]) -> tuple[npt.NDArray[np.float64], str] | None:
    """Times (n,) that are written with their unit, as MATLAB has ``0.02 sec``, and that unit; None for all others."""
    texts = [str(value) if value is not None and value == value else "" for value in values.tolist()]
    found = [_SPAN.fullmatch(text) for text in texts]
    units = {match.group(2) for match in found if match is not None}
    if len(units) != 1 or any(match is None and text.strip() for match, text in zip(found, texts, strict=True)):
        return None
    unit = units.pop()
    if not dimension_fits(unit, "s"):
        return None
    ticks, bad = numbers(np.array([match.group(1) if match is not None else None for match in found], dtype=object))
    return None if bad else (ticks, unit)


def _ticks(values: npt.NDArray[Any], base: TimeBase, where: str) -> tuple[Stamps, npt.NDArray[np.bool_]]:
    """Times [ns] (n,) since time 0, whole numbers exactly, and where there is none."""
    factor = conversion(base.unit, "s").factor * NANOSECONDS
    offset = round(base.offset * factor)
    if values.dtype.kind in "iu" and factor > 0.999:
        exact = values.astype(np.int64)
        if exact.size and np.abs(exact).max() < 9e18 / factor:
            return exact * round(factor) + offset, np.zeros(len(values), dtype=bool)
    if values.dtype.kind in "OUT" and (written := spans(values)) is not None:
        values = written[0] * conversion(written[1], "s").factor / conversion(base.unit, "s").factor
    found, bad = numbers(values)
    if bad:
        example = next(str(value) for value, number in zip(values, found, strict=True) if np.isnan(number) and value)
        raise InputError(f"{where} holds '{example[:40]}', which is not a number: for times as text write iso or irig")
    missing = ~np.isfinite(found)
    found = np.where(missing, 0.0, found)
    if found.size and float(np.abs(found).max()) * float(factor) > 9e18:
        raise InputError(
            f"{where} goes up to {np.abs(found).max():g} {base.unit}, which no clock shows: check its unit"
        )
    return np.round(found * factor).astype(np.int64) + offset, missing


def _zero(clock: str | datetime | None, ticks: Stamps) -> int:
    """Stamp [ns] of time 0."""
    if isinstance(clock, datetime):
        return round(clock.timestamp() * 1e6) * 1000
    if clock == UTC:
        return 0
    if clock == GPS:
        first = int(ticks[0]) // 1_000_000 if len(ticks) else 0
        return gps_nanoseconds(0, first) - first * 1_000_000
    return NO_DATE * NANOSECONDS


def _holds_times(values: npt.NDArray[Any]) -> bool:
    first = next((value for value in values if value is not None), None) if values.dtype.kind == "O" else None
    return isinstance(first, datetime)


def _of_texts(values: npt.NDArray[Any], unit: str, clock: str | datetime | None, where: str) -> Stamps:
    if values.dtype.kind == "M":
        found = values.astype("datetime64[ns]")
        return np.where(np.isnat(found), NO_TIME, found.astype(np.int64))
    texts = [
        None if value is None or value != value else _ZONE.sub("", str(value).strip()) for value in values.tolist()
    ]
    found = np.full(len(texts), NO_TIME, dtype=np.int64)
    there = [i for i, text in enumerate(texts) if text]
    if not there:
        return found
    pattern = _IRIG if unit == "irig" else _TIME_OF_DAY
    if unit == "irig" or pattern.fullmatch(str(texts[there[0]])):
        day = _date(clock, unit)
        found[there] = [day + _within(str(texts[i]), pattern, where) for i in there]
        return found
    pandas = imported("pandas")
    moments = pandas.to_datetime([texts[i] for i in there], utc=True, format="ISO8601", errors="coerce")
    if moments.isna().any():
        example = next(texts[i] for i, lost in zip(there, moments.isna(), strict=True) if lost)
        raise InputError(
            f"{where} holds '{str(example)[:40]}', which is not a time such as 2024-05-31T14:05:00Z or 14:05:00"
        )
    found[there] = np.asarray(moments.tz_localize(None).to_numpy(), dtype="datetime64[ns]").astype(np.int64)
    return found


def seconds_of_hhmmss(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Seconds since midnight of times (n,) such as 140530.2, NaN for what is none."""
    hours, minutes, seconds = values // 10_000, values // 100 % 100, values % 100
    there = (values >= 0.0) & (hours < 24) & (minutes < 60) & (seconds < 60)
    return np.where(there, 3600.0 * hours + 60.0 * minutes + seconds, np.nan)


def _of_hhmmss(values: npt.NDArray[Any], clock: str | datetime | None, where: str) -> Stamps:
    ticks, bad = numbers(values)
    seconds = seconds_of_hhmmss(ticks)
    missing = np.isnan(seconds)
    if bad or (missing & np.isfinite(ticks)).any():
        raise InputError(f"{where} holds numbers that are no time of day such as 140530.2, which is 14:05:30.2")
    return np.where(
        missing, NO_TIME, _date(clock, HHMMSS) + np.round(np.nan_to_num(seconds) * 1e6).astype(np.int64) * 1000
    )


def _within(text: str, pattern: re.Pattern[str], where: str) -> int:
    """Nanoseconds since midnight, or since the beginning of the year."""
    match = pattern.fullmatch(text)
    if match is None:
        kind = "day:hour:minute:second" if pattern is _IRIG else "hour:minute:second"
        raise InputError(f"{where} holds '{text[:40]}', which is not a time {kind}")
    *days, hours, minutes, seconds = match.groups()
    day = int(days[0]) - 1 if days else 0
    whole = ((day * 24 + int(hours)) * 60 + int(minutes)) * 60
    return whole * NANOSECONDS + round(float(seconds.replace(",", ".")) * NANOSECONDS)


def _date(clock: str | datetime | None, unit: str) -> int:
    """Stamp [ns] of the midnight, or of the beginning of the year, that the MAP names."""
    if not isinstance(clock, datetime):
        return NO_DATE * NANOSECONDS
    moment = clock.astimezone(timezone.utc)
    if unit == "irig":
        return int(datetime(moment.year, 1, 1, tzinfo=timezone.utc).timestamp()) * NANOSECONDS
    return int(moment.timestamp()) // _DAY * _DAY * NANOSECONDS
