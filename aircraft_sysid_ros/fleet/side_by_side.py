"""Two airframes of a fleet, or two fleets, side by side: what differs, by how much, and how surely.

Of flights that both fleets have, as under two versions of the program or of an aircraft file, the difference of each
flight counts: what is the same in both, such as the noise of the recording, is in none of them. Of other flights the
means are compared, with the spread between flights (``random_effects``).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.fleet.changes import RATE, Series, difference, mean_of, named
from aircraft_sysid_ros.fleet.folder import FLIGHTS, is_fleet
from aircraft_sysid_ros.fleet.random_effects import two_sided
from aircraft_sysid_ros.fleet.tables import Row, read_table, require_pyarrow

#: Flights that both fleets have, from which their differences are judged.
FEWEST = 3
#: Of a parameter, or of an error of a sensor, value and standard error by flight: its name and when it began.
Values = dict[tuple[str, Any], tuple[float, float]]
ByName = dict[str, dict[str, Values]]  # airframe, then parameter


def airframes_side_by_side(fleet: str | Path, first: str, second: str) -> dict[str, Any]:
    """The JSON of ``compare FLEET --airframes A B``. Raises InputError."""
    values = _read(fleet)
    for name in (first, second):
        if name not in values:
            raise InputError(f"no airframe of {fleet} is called {echo(name)}: it has {', '.join(sorted(values))}")
    rows = [
        _row(f"{first}, {second}", p, values[first][p], values[second][p], False) for p in _both(values, first, second)
    ]
    found = _found([first, second], [row for row in rows if row])
    return {**found, "notes": _changing(fleet, (first, second))}


def fleets_side_by_side(fleet: str | Path, other: str | Path) -> dict[str, Any]:
    """The JSON of ``compare FLEET --with FLEET2``, of the airframes that both have. Raises InputError."""
    a, b = _read(fleet), _read(other)
    airframes = [name for name in a if name in b]
    if not airframes:
        raise InputError(f"{fleet} and {other} have no airframe in common: compare two with --airframes A B")
    rows = []
    for airframe in airframes:
        for parameter in (p for p in a[airframe] if p in b[airframe]):
            of_a, of_b = a[airframe][parameter], b[airframe][parameter]
            rows.append(_row(airframe, parameter, of_a, of_b, len(of_a.keys() & of_b.keys()) >= FEWEST))
    return _found([str(fleet), str(other)], [row for row in rows if row])


def _changing(fleet: str | Path, airframes: Sequence[str]) -> list[str]:
    """What of airframes the fleet has found to change between their flights: its mean is not what it is now."""
    path = Path(fleet) / "changes.parquet"
    changes = [row for row in (read_table(path) if path.is_file() else ()) if row["airframe"] in airframes]
    return [
        f"{row['airframe']}: {row['parameter']} {row['kind']}s between its flights, as the fleet says, and its mean "
        "is not its present value"
        for row in changes
    ]


def _both(values: ByName, first: str, second: str) -> list[str]:
    return [parameter for parameter in values[first] if parameter in values[second]]


def _read(fleet: str | Path) -> ByName:
    require_pyarrow()
    if not is_fleet(fleet):
        raise InputError(f"{fleet} is not the folder of a fleet: {FLIGHTS} is not in it")
    values: ByName = defaultdict(lambda: defaultdict(dict))
    for table, key in (("parameters", "parameter"), ("sensors", "sensor")):
        path = Path(fleet) / f"{table}.parquet"
        for row in read_table(path) if path.is_file() else ():
            value, std = row["value"], row["std"]
            if row["status"] == "USE" and np.isfinite(value) and std > 0.0:
                values[row["airframe"]][row[key]][row["flight"], row["start"]] = (value, std)
    return {airframe: dict(of) for airframe, of in values.items()}


def _row(airframe: str, parameter: str, a: Values, b: Values, paired: bool) -> Row | None:
    """What differs; None where the flights are too few."""
    if paired:
        flights = sorted(a.keys() & b.keys(), key=str)
        a, b = ({flight: of[flight] for flight in flights} for of in (a, b))
    of_a, of_b = mean_of(_series(a)), mean_of(_series(b))
    if of_a is None or of_b is None:
        return None
    if paired:
        by_flight = [b[flight][0] - a[flight][0] for flight in a]
        size, std, p_value = _mean_of_differences(np.array(by_flight))
    else:
        _, _, p_value = difference(of_b, [of_a])
        size, std = of_b.value - of_a.value, float(np.hypot(of_a.std, of_b.std))
    return {
        "airframe": airframe, "parameter": parameter, "value": [of_a.value, of_b.value], "std": [of_a.std, of_b.std],
        "flights": [len(a), len(b)], "paired": paired, "difference": size, "std_difference": std, "p_value": p_value,
    }  # fmt: skip


def _series(values: Values) -> Series:
    value, std = (np.array(column) for column in zip(*values.values(), strict=True))
    return Series(np.arange(len(value)), value, std, np.full(len(value), np.nan))


def _mean_of_differences(each: np.ndarray[Any, np.dtype[np.float64]]) -> tuple[float, float, float]:
    """Mean, its standard error, and the p-value that it is 0."""
    size, std = float(np.mean(each)), float(np.std(each, ddof=1) / np.sqrt(len(each)))
    if std == 0.0:
        return size, std, float(size == 0.0)
    return size, std, two_sided(size / std, len(each) - 1)


def _found(names: Sequence[str], rows: Sequence[Row]) -> dict[str, Any]:
    if not rows:
        raise InputError(f"{names[0]} and {names[1]} share no parameter with USE in two flights each")
    differs = named([row["p_value"] for row in rows])
    parameters: list[Mapping[str, Any]] = [
        {**row, "differs": bool(is_named)} for row, is_named in zip(rows, differs, strict=True)
    ]
    return {"between": list(names), "false_discovery_rate": RATE, "parameters": parameters}
