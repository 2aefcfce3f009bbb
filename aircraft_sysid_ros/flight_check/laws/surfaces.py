"""Surfaces against the angular acceleration that they cause, in a band of the short motions:

    dp/dt / qbar = L_p p/V + L_y f_y + L_da da + ..., and so on for q with de, r with dr.

A positive deflection turns the aeroplane the negative way: C_l,da, C_m,de and C_n,dr are below zero. Two surfaces each
of which turns it about the axis of the other have each other's place in the log.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.flight_check.finding import ERROR, Finding
from aircraft_sysid_ros.flight_check.grid import Comparison
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation
from aircraft_sysid_ros.flight_check.signals import GYRO
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]
_SHORT, _LONG = 0.08, 6.0
#: Longest shift of a surface [s] that is tried; what the law itself gets wrong [s], as a bias beside two samples and as
#: an error: at 10 Hz surfaces that an autopilot moves seemed to be 0.2 s late in a clean flight of JSBSim.
_LONGEST, _LAG_TOLERANCE, _LAG_STD = 0.3, 0.015, 0.012
#: Partial correlation with the turning below which nothing is said.
_LEAST = 0.7
#: Share of it with the other sign that another shift has beyond what the best one leaves to it, from which nothing is
#: said either: a surface that an autopilot moves by what the gyros say follows the turning, and seems to cause it a
#: little later, and the opposite a little earlier. In quiet flights (JSBSim, 10 to 25 Hz, no delay) that was 0.5 to 0.9
#: of surfaces that seemed to be 0.2 s late and more; of surfaces that do turn the aeroplane 0 to 0.44.
_BOTH_WAYS = 0.45
#: Longest time [s] between samples of a surface by which cause and answer are told apart, and longest time [s] that
#: servos need: an autopilot that has lost its rudder answers the turning with it, and its aileron is led by the rolling
#: that it has made before; nothing but when tells either from a surface of the other sign.
_SLOWEST, _SERVO = 0.2, 0.15
#: An exchanged surface does so much less about its own axis.
_OWN = 0.6


@dataclass(frozen=True)
class _Axis:
    surface: str
    column: int
    rate: int
    others: tuple[int, ...]  # surfaces that turn about the same axis


class _Scan(NamedTuple):
    shift: float  # [s] of the surface
    partial: float  # correlation with the turning at it
    is_both_ways: bool  # at another shift it explains about as much of what is left, the other way


_SETUP = (
    _Axis("elevator", 0, 1, ()),
    _Axis("aileron", 1, 0, (2,)),
    _Axis("rudder", 2, 2, (1,)),
)


def relations(motion: Motion) -> list[Relation]:
    """Sign and lag of elevator, aileron and rudder."""
    found = []
    for axis in _SETUP:
        if np.any(np.isfinite(motion.controls[:, axis.column])):
            found += _relation(motion, axis)
    return found


def exchanged(motion: Motion) -> list[tuple[Finding, str]]:
    """Of surfaces that stand in each other's place what is said of them, and whose place that is."""
    there = [axis for axis in _SETUP if _moves(motion.controls[:, axis.column])]
    strength = np.zeros((len(there), len(there)))
    for i, surface in enumerate(there):
        for j, axis in enumerate(there):
            scan = _scan(*_series(motion, surface.column, axis.rate, ()), motion.grid.step)
            strength[i, j] = 0.0 if scan is None else abs(scan.partial)
    found = []
    for i, row in enumerate(strength):
        j = int(np.argmax(row))
        together = min(row[j], strength[j, i])
        if i == j or together < _LEAST or max(row[i], strength[j, j]) > _OWN * together:
            continue
        place = there[j].surface
        said = (
            f"it turns the aircraft as the {place} should, and that one as this (partial correlation {row[j]:.2f}, "
            f"about its own axis {row[i]:.2f}): they are swapped, use this one as {place}"
        )
        found.append((Finding((there[i].surface,), "sign", ERROR, said), place))
    return found


def _relation(motion: Motion, axis: _Axis) -> list[Relation]:
    if not _moves(motion.controls[:, axis.column]):
        return []
    scan = _scan(*_series(motion, axis.column, axis.rate, axis.others), motion.grid.step)
    if scan is None or scan.is_both_ways:
        return []
    sign = -_sign_of(motion, axis.surface) * np.sign(scan.partial)
    if sign < 0.0 and _may_answer(motion, scan.shift):
        return []
    strength = abs(scan.partial) if abs(scan.partial) > _LEAST else 0.0
    seconds = float(np.sum(motion.in_air) * motion.grid.step)
    comparison = Comparison(float(sign * strength), 1.0, 1.0, -scan.shift, _LAG_STD, 1e3, seconds)
    return [
        Relation(
            axis.surface,
            GYRO[axis.rate],
            comparison,
            "the angular acceleration that it causes",
            lag_tolerance=_LAG_TOLERANCE + 2.0 * motion.grid.step,
        )
    ]


def _may_answer(motion: Motion, shift: float) -> bool:
    """Whether a surface with the other sign that is best so much later [s] than recorded may be moved by an autopilot,
    after the turning or before the next one.
    """
    interval = motion.flight.streams[Kind.CONTROLS].interval
    return interval > _SLOWEST or not -3.0 * _LAG_TOLERANCE < shift < _SERVO


def _series(motion: Motion, surface: int, rate: int, others: tuple[int, ...]) -> tuple[Array, Array, Array]:
    """The angular acceleration about an axis, a surface, and what turns the aeroplane beside it, in one band."""
    grid = motion.grid
    short = max(_SHORT, 3.0 * grid.step)

    def band(values: Array) -> Array:
        return grid.band(values, short, _LONG)

    terms = [band(grid.as_slope(v)) for v in motion.gyro.T]
    terms += [band(grid.as_slope(v)) for v in motion.force[:, 1:].T]  # what alpha and beta make, vanes or not
    terms += [band(grid.as_slope(motion.controls[:, c])) for c in others if _moves(motion.controls[:, c])]
    turning = band(grid.slope(motion.gyro[:, rate]))
    return turning, band(grid.as_slope(motion.controls[:, surface])), np.column_stack(terms)


def _scan(turning: Array, surface: Array, terms: Array, step: float) -> _Scan | None:
    """The shift of the surface at which it explains most of the turning that the terms leave.

    Partial correlation, by projection (Frisch and Waugh): what the terms explain is taken out of both.
    """
    most = round(_LONGEST / step)
    good = np.isfinite(turning) & np.isfinite(surface) & np.all(np.isfinite(terms), axis=1)
    rows = np.flatnonzero(good)
    rows = rows[(rows >= most) & (rows < len(turning) - most)]
    if len(rows) < 100:
        return None
    basis, _ = np.linalg.qr(terms[rows] - terms[rows].mean(axis=0))
    y = turning[rows] - turning[rows].mean()
    y = y - basis @ (basis.T @ y)
    shifts = np.arange(-most, most + 1)
    y = y / max(float(np.linalg.norm(y)), 1e-300)
    filled = np.nan_to_num(surface)

    def shifted(shift: int) -> Array:
        """What the terms leave of the surface at a shift, of length 1."""
        x = filled[rows - shift] - filled[rows - shift].mean()
        x = x - basis @ (basis.T @ x)
        return x / max(float(np.linalg.norm(x)), 1e-300)

    partial = np.array([shifted(int(shift)) @ y for shift in shifts])
    best = int(np.argmax(np.abs(partial)))
    if abs(shifts[best]) == most:  # no maximum
        return None
    at_best = shifted(int(shifts[best]))
    # worked out once more: all shifts of a long flight at once take too much room
    shared = np.array([shifted(int(shift)) @ at_best for shift in shifts])
    beyond = partial - partial[best] * shared  # what the best shift leaves to another one
    opposite = float(np.max(-np.sign(partial[best]) * beyond))
    return _Scan(float(shifts[best] * step), float(partial[best]), opposite > _BOTH_WAYS * abs(partial[best]))


def _sign_of(motion: Motion, surface: str) -> float:
    """The sign that the aircraft file gives a surface."""
    return float(motion.flight.surface_signs.get(surface, 1.0))


def _moves(surface: Array) -> bool:
    return bool(np.nanstd(surface) > 1e-6) if np.any(np.isfinite(surface)) else False
