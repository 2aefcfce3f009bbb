"""Two columns that are one velocity: speed and course over ground, as a GPS and most ground stations tell it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.recordings.tabular.column_expression import parse_column_expression, quoted
from aircraft_sysid_ros.recordings.tabular.guess.names import guess_ground_track
from aircraft_sysid_ros.recordings.tabular.guess.series import Column
from aircraft_sysid_ros.recordings.tabular.table import numbers
from aircraft_sysid_ros.recordings.tabular.units import conversion

Array = npt.NDArray[np.float64]
#: After any column that is a velocity to the north or to the east by its name.
_DISTANCE = 900
#: A course beyond this is no angle in radians.
_LARGEST_IN_RADIANS = 6.5


class _Part(NamedTuple):
    name: str
    unit: str  # "": the name and the header say none
    values: Array


def ground_track_columns(
    table: str, content: Mapping[str, npt.NDArray[np.generic]], units: Mapping[str, str], time: Array
) -> tuple[list[Column], set[str]]:
    """Velocity to the north and to the east of a table, and the names of its two columns; nothing without either.

    ``time`` (n,) [s]. The unit of a speed whose name says none is found by ``resolve``, as of any velocity.
    """
    found: dict[str, _Part] = {}
    for name, raw in content.items():
        guess = guess_ground_track(name, units.get(name, ""))
        if guess is None or guess[0] in found or len(raw) != len(time):
            continue
        values, bad = numbers(raw)
        if bad <= 0.2 * len(raw) and np.isfinite(values).any():
            found[guess[0]] = _Part(name, guess[1], values)
    if len(found) < 2:
        return [], set()
    speed, course = found["speed"], found["course"]
    angle = course.unit or ("deg" if np.nanmax(np.abs(course.values)) > _LARGEST_IN_RADIANS else "rad")
    factor = conversion(angle, "rad").factor
    in_radians = "" if factor == 1.0 else "*pi/180" if np.isclose(factor, np.pi / 180.0) else f"*{factor:.12g}"
    parts, timed = {each.name: each.values for each in found.values()}, np.isfinite(time)
    columns = []
    for signal, function in (("velocity.north", "cos"), ("velocity.east", "sin")):
        text = f"{quoted(speed.name)}*{function}({quoted(course.name)}{in_radians})"
        values = parse_column_expression(text).evaluate(parts)
        column = Column(
            table, f"{speed.name}, {course.name}", signal, values[timed], time[timed], speed.unit, 1.0, _DISTANCE
        )
        column.expression = text
        column.evidence.append(f"of speed and course over ground ({speed.name}, {course.name} in {angle})")
        columns.append(column)
    return columns, set(parts)
