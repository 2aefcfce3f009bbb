"""Two columns that are one signal: the left and the right one of surfaces and of engines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.recordings.tabular.column_expression import parse_column_expression, quoted
from aircraft_sysid_ros.recordings.tabular.guess.magnitudes import SURFACES, why_no_angle
from aircraft_sysid_ros.recordings.tabular.guess.names import guess_name, without_side
from aircraft_sysid_ros.recordings.tabular.guess.series import Column
from aircraft_sysid_ros.recordings.tabular.table import numbers

Array = npt.NDArray[np.float64]
#: After any column that is the signal by its name.
_DISTANCE = 900
#: Signals of which each side has its own, and what both make: half of the difference or of the sum, or the sum.
_MAKE = {
    "aileron": "-", "elevator": "+", "rudder": "+", "flaps": "+", "throttle": "+", "propeller_speed": "+",
    "thrust": "sum",
}  # fmt: skip
_ENGINES = ("throttle", "propeller_speed", "thrust")
#: Correlation of two sides from which on they move together, or against each other.
_TOGETHER = 0.7


class _Side(NamedTuple):
    name: str
    unit: str  # "": the name and the header say none
    distance: int
    values: Array


def two_sided_columns(
    table: str, content: Mapping[str, npt.NDArray[np.generic]], units: Mapping[str, str], time: Array
) -> tuple[list[Column], set[str]]:
    """What left and right columns of a table make together, and the names of those; ``time`` (n,) [s].

    Some record each aileron with its trailing edge down as positive, others each as it rolls: what moves against each
    other is subtracted, what moves together is not.
    """
    sides: dict[tuple[str, str], dict[str, _Side]] = {}
    for name, raw in content.items():
        split = without_side(name)
        if split is None or len(raw) != len(time):
            continue
        side, rest = split
        guess = guess_name(rest, units.get(name, ""), table)
        values, bad = numbers(raw)
        if guess is not None and guess.signal in _MAKE and bad <= 0.2 * len(raw):
            found = _Side(name, guess.unit, guess.distance, values)
            sides.setdefault((guess.signal, rest), {}).setdefault(side, found)
    timed, columns, taken = np.isfinite(time), [], set()
    for (signal, _), both in sides.items():
        if len(both) < 2:
            continue
        left, right = both["left"], both["right"]
        text, why, doubt = _made_of(signal, left, right)
        values = parse_column_expression(text).evaluate({each.name: each.values for each in both.values()})
        names = f"{left.name}, {right.name}"
        distance = _DISTANCE + left.distance
        column = Column(table, names, signal, values[timed], time[timed], left.unit, 1.0, distance)
        column.expression, column.doubt = text, doubt or _no_angle(signal, (left, right))
        column.evidence.append(why)
        columns.append(column)
        taken |= {left.name, right.name}
    return columns, taken


def _made_of(signal: str, left: _Side, right: _Side) -> tuple[str, str, str]:
    """The expression of both sides, why it is that, and why it may not be."""
    one, other = quoted(right.name), quoted(left.name)
    unlike = f"{left.name} is in {left.unit or 'no unit'}, {right.name} in {right.unit or 'none'}"
    doubt = unlike if left.unit != right.unit else ""
    if _MAKE[signal] == "sum":
        return f"{one} + {other}", f"the sum of {left.name} and {right.name}", doubt
    there = np.isfinite(left.values) & np.isfinite(right.values)
    move = [bool(there.any() and np.ptp(side.values[there]) > 0.0) for side in (left, right)]
    found = float(np.corrcoef(left.values[there], right.values[there])[0, 1]) if all(move) else np.nan
    is_against = found < -_TOGETHER
    is_told = is_against or found > _TOGETHER
    way = ("-" if is_against else "+") if is_told and signal not in _ENGINES else _MAKE[signal]
    what = f"half of the {'difference' if way == '-' else 'sum'} of {left.name} and {right.name}"
    how = f", which move {'against each other' if is_against else 'together'} (correlation {found:.2f})"
    is_doubted = any(move) and not is_told and signal not in _ENGINES
    if is_doubted and not doubt:
        doubt = f"{left.name} and {right.name} do not move as one"
    return f"({one} {way} {other})/2", what + (how if is_told else ""), doubt


def _no_angle(signal: str, sides: Sequence[_Side]) -> str:
    """That sides without a unit are no angles, as pulses of servos are; their difference may look like one."""
    for side in sides if signal in SURFACES else ():
        if not side.unit and (why := why_no_angle(side.values[np.isfinite(side.values)])):
            return f"{side.name}: {why}"
    return ""
