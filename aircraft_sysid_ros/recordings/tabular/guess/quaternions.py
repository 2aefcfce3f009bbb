"""Four columns that are one attitude: (qw, qx, qy, qz), (q[0] … q[3]), (orientation.x … orientation.w), …

Their squares add up to 1, which no other four columns with such names do. Where the scalar stands (first, or last as in
q1 … q4 of some), and whether it turns the body or the earth, is told by gyros: omega = 2 q* dq/dt. Axes of the body and
of the earth are found as those of Euler angles are, by ``resolve``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import continuous
from aircraft_sysid_ros.recordings.tabular.column_expression import parse_column_expression, quoted
from aircraft_sysid_ros.recordings.tabular.guess.names import is_of_another
from aircraft_sysid_ros.recordings.tabular.guess.series import Column
from aircraft_sysid_ros.recordings.tabular.signals import VECTORS
from aircraft_sysid_ros.recordings.tabular.table import numbers

Array = npt.NDArray[np.float64]
#: Places of w, x, y, z among four columns.
Order = tuple[int, int, int, int]
_PART = re.compile(r"^(?P<stem>.*?)[\s_.\[(]*(?P<part>[wxyz0-4])[\])]?$", re.IGNORECASE)
_STEM = re.compile(r"(^|[^a-z])(q|quat|quats|quaternion|orientation|rotation)$|quat$|quaternion$", re.IGNORECASE)
_FIRST: Order = (0, 1, 2, 3)
_LAST: Order = (3, 0, 1, 2)
#: Names of the four parts, and orders that they may have, the usual first.
_ORDERS = {"wxyz": (_FIRST,), "0123": (_FIRST, _LAST), "1234": (_FIRST, _LAST)}
#: |q| is 1 but for this; rows that are so, at least.
_UNIT, _MOST = 0.02, 0.98
#: What gyros leave unexplained of the rates of an order, of their variance at most, and of what any other leaves.
_LEFT, _BETTER = 0.75, 0.7
#: After any column that is an Euler angle by its name.
_DISTANCE = 900
_ANGLES, _GYROS = VECTORS["attitude"], VECTORS["angular_velocity"]


def euler_expressions(w: str, x: str, y: str, z: str) -> tuple[str, str, str]:
    """Euler angles (6.20)-(6.22) [rad] of a quaternion FRD to NED, of which these are the columns."""
    return (
        f"atan2(2*({w}*{x}+{y}*{z}), 1-2*({x}**2+{y}**2))",
        f"asin(max(-1, min(1, 2*({w}*{y}-{x}*{z}))))",
        f"atan2(2*({w}*{z}+{x}*{y}), 1-2*({y}**2+{z}**2))",
    )


def quaternion_columns(
    table: str, content: Mapping[str, npt.NDArray[np.generic]], time: Array, named: Sequence[Column]
) -> tuple[list[Column], set[str]]:
    """Roll, pitch and yaw of four columns of a table, and the names of the four; nothing where there are none.

    ``time`` (n,) [s]; ``named``: the columns of the table whose names say what they are, gyros among them.
    """
    found = []
    for four, orders in _groups(content):
        q = np.column_stack([numbers(content[name])[0] for name in four])
        is_there = np.isfinite(q).all(axis=1)
        if len(q) != len(time) or is_there.sum() < 10:
            continue
        if np.mean(np.abs(np.linalg.norm(q[is_there], axis=1) - 1.0) < _UNIT) >= _MOST:
            found.append((_way(q, orders, time, named), four, q))
    if not found:
        return [], set()
    way, four, q = min(found, key=lambda each: each[0].left)  # what the gyros know best; the first where nothing tells
    return _angles(table, four, way, q, time), set(four)


class _Way(NamedTuple):
    """How four columns count."""

    order: Order
    is_inverse: bool  # it turns the earth to the body
    left: float  # share of its rates that the gyros do not explain
    is_told: bool  # by the gyros


def _groups(content: Mapping[str, npt.NDArray[np.generic]]) -> list[tuple[list[str], tuple[Order, ...]]]:
    """Names of four columns each, and orders that they may have."""
    found: dict[str, dict[str, str]] = {}
    for name in content:
        match = _PART.match(name.strip())
        if match and _STEM.search(match["stem"].strip()) and not is_of_another(match["stem"]):
            found.setdefault(match["stem"].lower(), {})[match["part"].lower()] = name
    return [
        ([parts[letter] for letter in letters], orders)
        for parts in found.values()
        for letters, orders in _ORDERS.items()
        if set(letters) <= parts.keys()
    ]


def _way(q: Array, orders: Sequence[Order], time: Array, named: Sequence[Column]) -> _Way:
    """Which of the orders it has, and which way it turns; as is usual where the gyros do not tell."""
    gyros = {column.signal: column for column in named if column.signal in _GYROS}
    if len(gyros) < len(_GYROS):
        return _Way(orders[0], False, 1.0, False)
    rates = np.column_stack([np.interp(time, gyros[s].time, gyros[s].values) for s in _GYROS])
    ways = [
        _Way(order, is_inverse, _left(_in_order(q, order, is_inverse), time, rates), True)
        for order in orders
        for is_inverse in (False, True)
    ]
    best, second = sorted(ways, key=lambda way: way.left)[:2]
    return best if best.left < min(_LEFT, _BETTER * second.left) else ways[0]._replace(is_told=False)


def _in_order(q: Array, order: Order, is_inverse: bool) -> Array:
    """(n, 4) as (w, x, y, z) of the rotation from the body to the earth."""
    return q[:, order] * (np.array([1.0, -1.0, -1.0, -1.0]) if is_inverse else 1.0)


def _left(q: Array, time: Array, rates: Array) -> float:
    """Share of the variance of 2 q* dq/dt that ``rates`` (n, 3) do not explain, axis by axis, in the mean."""
    rows = np.flatnonzero(np.isfinite(q).all(axis=1) & np.isfinite(rates).all(axis=1) & np.isfinite(time))
    rows = rows[np.concatenate([[True], np.any(np.diff(q[rows], axis=0) != 0.0, axis=1)])] if len(rows) else rows
    if len(rows) < 10:
        return 1.0
    q, time, rates = continuous(q[rows]), time[rows], rates[rows]
    change = (q[2:] - q[:-2]) / np.maximum(time[2:] - time[:-2], 1e-6)[:, None]
    w, v = q[1:-1, :1], q[1:-1, 1:]
    omega = 2.0 * (w * change[:, 1:] - change[:, :1] * v - np.cross(v, change[:, 1:]))
    with np.errstate(all="ignore"):
        each = [np.corrcoef(omega[:, i], rates[1:-1, i])[0, 1] for i in range(3)]
    return float(1.0 - np.mean(np.nan_to_num(each) ** 2))


def _angles(table: str, four: Sequence[str], way: _Way, q: Array, time: Array) -> list[Column]:
    w, x, y, z = (quoted(four[i]) for i in way.order)
    if way.is_inverse:
        w = f"(-{w})"  # -q* is the rotation of q*
    parts = {name: q[:, i] for i, name in enumerate(four)}
    why = f", gyros are {100.0 * (1.0 - way.left):.0f} % of its rates" if way.is_told else ""
    found = []
    timed = np.isfinite(time)
    for signal, text in zip(_ANGLES, euler_expressions(w, x, y, z), strict=True):
        values = parse_column_expression(text).evaluate(parts)
        column = Column(table, ", ".join(four), signal, values[timed], time[timed], "rad", 1.0, _DISTANCE)
        column.expression, column.sure, column.unit, column.factor = text, way.is_told, "rad", 1.0
        column.evidence.append(f"of the quaternion ({', '.join(four)}){why}")
        found.append(column)
    return found
