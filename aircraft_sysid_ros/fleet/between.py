"""The tables of a fleet between flights: changes, airframes that differ, effects that come back."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aircraft_sysid_ros.fleet.changes import FEWEST, RATE, Change, Mean, Series, change_of, difference, mean_of, named
from aircraft_sysid_ros.fleet.priors import SeriesOf, priors_of
from aircraft_sysid_ros.fleet.tables import Flown, Row

#: An effect comes back where false alarms would be seen as often in less than this share of fleets.
_BY_CHANCE = 0.001
_HOUR = 3600.0


@dataclass(frozen=True)
class Between:
    """What one flight alone cannot tell."""

    changes: Sequence[Row]  # by airframe and parameter
    airframes: Sequence[Row]  # values by airframe and parameter
    effects: Sequence[Row]
    priors: Mapping[str, Any]  # of the next flights, see ``priors``
    longest: int  # flights of the longest series
    rate: float = RATE

    @property
    def differences(self) -> list[Row]:
        """Airframes that are not like the others."""
        return [row for row in self.airframes if row["differs"]]

    @property
    def too_few(self) -> str:
        """Why no change can be named, where there are too few flights for any; else nothing."""
        if self.longest >= FEWEST:
            return ""
        has = f"{self.longest} at most" if self.longest else "none"
        return (
            f"a change can be named from {FEWEST} flights of an airframe on with a value to use: here there are {has}"
        )


def all_series(tables: Mapping[str, Sequence[Row]], flown: Sequence[Flown]) -> tuple[SeriesOf, SeriesOf]:
    """Series of parameters, and of constant errors of sensors; ``flown`` in the order of time."""
    sensors = [{**row, "parameter": row["sensor"], "V": None} for row in tables["sensors"]]
    return series_of(tables["parameters"], flown), series_of(sensors, flown)


def series_of(parameters: Sequence[Row], flown: Sequence[Flown]) -> SeriesOf:
    """Series by airframe and parameter, of values to USE; flights count from 0 in each airframe.

    ``flown`` in the order of time, as ``tables.in_order``.
    """
    numbers = _numbers(flown)
    rows: dict[tuple[str, str], list[tuple[int, float, float, float]]] = defaultdict(list)
    for row in parameters:
        value, std, speed = (np.nan if row[k] is None else float(row[k]) for k in ("value", "std", "V"))
        if row["status"] == "USE" and np.isfinite(value) and std > 0.0:
            rows[row["airframe"], row["parameter"]].append((numbers[row["flight"]], value, std, speed))
    return {key: _series(found) for key, found in sorted(rows.items())}


def _series(rows: Sequence[tuple[int, float, float, float]]) -> Series:
    number, value, std, speed = (np.array(column) for column in zip(*sorted(rows), strict=True))
    return Series(number.astype(np.int64), value, std, speed)


def _numbers(flown: Sequence[Flown]) -> dict[str, int]:
    """Number of each flight that could be used, in its airframe."""
    count: Counter[str] = Counter()
    numbers = {}
    for each in flown:
        if each.answer["ok"]:
            numbers[each.flight.name] = count[each.flight.airframe]
            count[each.flight.airframe] += 1
    return numbers


def between_flights(tables: Mapping[str, Sequence[Row]], flown: Sequence[Flown]) -> Between:
    """All that is found between flights; ``flown`` in the order of time."""
    parameters, sensors = all_series(tables, flown)
    series = {**parameters, **sensors}
    changes = _changes(series, flown)
    count = Counter(each.flight.airframe for each in flown if each.answer["ok"])
    effects, priors = _effects(tables["verdicts"], flown), priors_of(parameters, changes, count)
    return Between(changes, _airframes(series), effects, priors, max(map(len, series.values()), default=0))


def _changes(series: SeriesOf, flown: Sequence[Flown]) -> list[Row]:
    by_airframe: dict[str, list[Flown]] = defaultdict(list)
    for each in flown:
        if each.answer["ok"]:
            by_airframe[each.flight.airframe].append(each)
    found = [(key, change) for key, one in series.items() if (change := change_of(one)) is not None]
    rows = []
    for (key, change), is_named in zip(found, named([change.p_value for _, change in found]), strict=True):
        if is_named:
            rows.append(_change_row(*key, change, by_airframe[key[0]], len(series[key])))
    return rows


def _change_row(airframe: str, parameter: str, change: Change, flown: Sequence[Flown], flights: int) -> Row:
    at = flown[change.number]
    hours = float(np.mean([each.answer["duration"] for each in flown])) / _HOUR
    return {
        "airframe": airframe, "parameter": parameter, "kind": change.kind, "when": at.start, "size": change.size,
        "std": change.std, "p_value": change.p_value, "flight": at.flight.name, "flights": flights,
        "number": change.number, "per_hour": change.size / hours if change.kind == "drift" and hours > 0.0 else None,
    }  # fmt: skip


def _airframes(series: SeriesOf) -> list[Row]:
    means: dict[str, dict[str, Mean]] = defaultdict(dict)
    for (airframe, parameter), one in series.items():
        if (mean := mean_of(one)) is not None:
            means[parameter][airframe] = mean
    rows: list[Row] = []
    for parameter, by_airframe in means.items():
        for airframe, mean in by_airframe.items():
            others = [other for name, other in by_airframe.items() if name != airframe]
            value, std, p_value = difference(mean, others) if others else (None, None, None)
            rows.append({
                "airframe": airframe, "parameter": parameter, "flights": mean.flights, "value": mean.value,
                "std": mean.std, "between_flights": mean.between, "others": value, "others_std": std,
                "p_value": p_value, "differs": False,
            })  # fmt: skip
    compared = [row for row in rows if row["p_value"] is not None]
    for row, is_named in zip(compared, named([row["p_value"] for row in compared]), strict=True):
        row["differs"] = bool(is_named)
    return sorted(rows, key=lambda row: (row["airframe"], row["parameter"]))


def _effects(verdicts: Sequence[Row], flown: Sequence[Flown]) -> list[Row]:
    """Effects that are found in more flights of an airframe than false alarms would be."""
    from scipy.stats import binom  # here: 0.5 s that no other use of a fleet's parts needs

    airframe_of = {each.flight.name: each.flight.airframe for each in flown}
    diagnosed: Counter[str] = Counter(airframe_of[name] for name in {row["flight"] for row in verdicts})
    seen = Counter({(row["airframe"], row["effect"], row["flight"]) for row in verdicts if row.get("effect")})
    flights: Counter[tuple[str, str]] = Counter((airframe, effect) for airframe, effect, _ in seen)
    rates: list[Any] = [e.answer["diagnosis"]["false_alarm_rate"] for e in flown if e.answer.get("diagnosis")]
    rate = max([r for r in rates if r is not None], default=0.0)
    rows = []
    for (airframe, effect), count in sorted(flights.items()):
        chance = float(binom.sf(count - 1, diagnosed[airframe], rate))
        if count > 1 and chance < _BY_CHANCE:
            row = {"airframe": airframe, "effect": effect, "flights": count, "of": diagnosed[airframe]}
            rows.append({**row, "p_value": chance})
    return rows
