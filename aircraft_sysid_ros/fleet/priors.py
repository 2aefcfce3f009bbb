"""What a fleet expects of the next flight: the random-effects model of each parameter, one flight ahead.

Of a series without a named change the next flight has the mean of the series; after a jump that since the jump; in a
drift the line, one flight on. Its variance is that of this forecast and the spread between flights together,

    d = (x' Cov(b) x + tau²) (t_0.975(n - p) / 1.96)²,

widened for few flights, and at least ``LEAST`` of the value, and the standard error of a whole flight: a fleet never
weighs more than one flight, and no fleet shows that the next flight is no other. Of an airframe that the fleet does not
know, the means of the others and their own spread count in the same way.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit

from aircraft_sysid_ros.aircraft.fleet_prior import FILE
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet.changes import DRIFT, Mean, Series, mean_of
from aircraft_sysid_ros.fleet.random_effects import fit
from aircraft_sysid_ros.fleet.tables import Row
from aircraft_sysid_ros.json_text import json_text
from aircraft_sysid_ros.text_file import write_whole

Array = npt.NDArray[np.float64]

#: Flights with a parameter to USE, and airframes, from which something is expected of the next one.
FEWEST, FEWEST_AIRFRAMES = 3, 3
#: Least standard deviation of the next flight as a share of the value.
LEAST = 0.05
_NORMAL = 1.96
SeriesOf = dict[tuple[str, str], Series]  # by airframe and parameter


def priors_of(series: SeriesOf, changes: Sequence[Row], flown: Mapping[str, int]) -> dict[str, Any]:
    """The content of the file: of each airframe the key ``prior`` of an aircraft file, and of one that is not known.

    ``flown``: flights of each airframe that could be used.
    """
    changed = {(row["airframe"], row["parameter"]): row for row in changes}
    airframes: dict[str, dict[str, list[float]]] = defaultdict(dict)
    means: dict[str, list[Mean]] = defaultdict(list)
    flights: dict[str, int] = defaultdict(int)
    for (airframe, parameter), one in series.items():
        if (expected := expected_of(one, changed.get((airframe, parameter)), flown[airframe])) is not None:
            airframes[airframe][parameter] = [*expected]
            flights[airframe] = max(flights[airframe], len(one))
        if (mean := mean_of(one)) is not None:
            means[parameter].append(mean)
    common = {name: [*expected] for name, of in means.items() if (expected := _expected_of_another(of)) is not None}
    return {
        "airframes": {
            name: _prior(f"{flights[name]} flights of {name}", found) for name, found in sorted(airframes.items())
        },
        "all": _prior(f"flights of {len(airframes)} other airframes", common) if common else None,
    }


def _prior(flights: str, parameters: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    return {"flights": flights, "parameters": {name: [*pair] for name, pair in parameters.items()}}


def expected_of(series: Series, change: Row | None, flown: int) -> tuple[float, float] | None:
    """Value and standard deviation of flight number ``flown``, the next; None where the flights are too few.

    ``change``: the row of ``changes`` that is named for the series, with ``number`` of its first flight.
    """
    ahead = series.number - float(flown)
    if change is None:
        columns = np.ones((len(series), 1))
    elif change["kind"] == DRIFT:
        columns = np.column_stack([np.ones(len(series)), ahead])
    else:
        columns = np.column_stack([np.ones(len(series)), series.number < change["number"]])
    if len(series) < FEWEST + columns.shape[1] - 1:
        return None
    return _ahead(series.value, series.std, columns)


def _expected_of_another(means: Sequence[Mean]) -> tuple[float, float] | None:
    if len(means) < FEWEST_AIRFRAMES:
        return None
    value, std = (np.array([getattr(mean, name) for mean in means]) for name in ("value", "std"))
    expected, between_airframes = _ahead(value, std, np.ones((len(means), 1)))
    return expected, float(np.hypot(between_airframes, np.sqrt(np.mean([mean.between**2 for mean in means]))))


def _ahead(value: Array, std: Array, columns: Array) -> tuple[float, float]:
    """What the first column stands for, and its standard deviation in one more flight."""
    fitted = fit(value, std, columns)
    few = float(stdtrit(fitted.freedom, 0.975)) / _NORMAL
    spread = few * float(np.hypot(fitted.std[0], fitted.between))
    expected = float(fitted.value[0])
    return expected, max(spread, LEAST * abs(expected), float(np.median(std)))


def write_priors(out: Path, priors: Mapping[str, Any]) -> None:
    """Write the file into the folder of a fleet, whole. Raises InputError."""
    try:
        write_whole(out / FILE, json_text(priors) + "\n")
    except OSError as error:
        raise InputError(f"cannot write {out / FILE}: {error.strerror or error}") from None
