"""State: biases, wind, air data against reconstruction, consistency of the innovations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.workbench.views.coefficients import TIME_TITLE
from aircraft_sysid_ros.workbench.views.figure import (
    TIMED,
    Figure,
    Theme,
    axis,
    beyond,
    broken,
    broken_time,
    figure,
    gaps_among,
    line,
    thinned,
)
from aircraft_sysid_ros.workbench.views.parameters import INTERVAL

Array = npt.NDArray[np.float64]

DEGREES = 180.0 / np.pi
INNOVATIONS = "Innovations: near one where the filter is as sure as it should be"
#: In the middle of a figure without a curve.
_NOT_ESTIMATED = {"text": "not estimated", "xref": "paper", "yref": "paper", "x": 0.5, "y": 0.5, "showarrow": False}
#: What ``state.json`` calls the sensors, in words.
SENSOR_WORDS = {
    "gps_position": "GPS position",
    "gps_velocity": "GPS velocity",
    "airspeed": "airspeed",
    "angle_of_attack": "angle of attack",
    "sideslip": "sideslip",
    "attitude": "attitude",
    "magnetic_field": "magnetic field",
    "five_hole": "five-hole probe",
    "height": "height",
}


@dataclass(frozen=True)
class StateHistory:
    """What the filter estimated in flight, n rows: time [s]; biases, wind and their sigma (n, 3); track (n, 3) NED."""

    time: Array
    accelerometer_bias: Array
    accelerometer_bias_std: Array
    gyro_bias: Array
    gyro_bias_std: Array
    wind: Array
    wind_std: Array
    position: Array
    air: Array  # (n, 3) airspeed [m/s], angle of attack, sideslip [rad]
    consistency: Array  # (n,)
    measured_time: Mapping[str, Array]  # by "airspeed", "angle_of_attack", "sideslip"
    measured: Mapping[str, Array]
    time_title: str = TIME_TITLE
    is_joined: bool = False  # of several manoeuvres, each with an origin of its own

    @property
    def knows_wind(self) -> bool:
        """Whether the wind is estimated, or taken as calm: else positions drift with the air."""
        return bool(np.isfinite(self.wind).any())


@dataclass(frozen=True)
class Consistency:
    """One sensor: mean normalised innovation squared per degree of freedom, and what became of its samples."""

    sensor: str
    ratio: float | None
    received: int
    fused: int
    rejected: int


def consistencies(state: Mapping[str, Any]) -> list[Consistency]:
    """From the content of state.json."""
    ratios, samples = state.get("innovation_consistency", {}), state.get("samples", {})
    names = [name for name in SENSOR_WORDS if name in ratios or name in samples]
    return [
        Consistency(
            SENSOR_WORDS[name],
            ratios.get(name),
            *(int(samples.get(name, {}).get(key, 0)) for key in ("received", "fused", "rejected")),
        )
        for name in names
    ]


def bias_figure(
    state: StateHistory, which: str, theme: Theme, truth: Sequence[float] | None = None, height: int = 250
) -> Figure:
    """Three components with their 95 % intervals; ``which`` is accelerometer_bias, gyro_bias or wind."""
    words = {
        "accelerometer_bias": ("accelerometer bias [m/s²]", "xyz"),
        "gyro_bias": ("gyro bias [rad/s]", "xyz"),
        "wind": ("wind [m/s]", ("north", "east", "down")),
    }[which]
    values, std = getattr(state, which), getattr(state, f"{which}_std")
    data: list[dict[str, Any]] = []
    at = thinned(state.time, values)
    for k, colour in enumerate((theme.residual, theme.predicted, theme.second)):
        for sign in (-INTERVAL, INTERVAL):
            edge = (values[:, k] + sign * std[:, k])[at]
            style: dict[str, Any] = {"dash": "dot", "width": 0.8, "hoverinfo": "skip", "opacity": 0.7}
            data.append(line(state.time[at], edge, colour, "95 % interval", showlegend=False, **style))
        data.append(line(state.time[at], values[at, k], colour, words[1][k], width=1.6))
    for k, true in enumerate(truth or ()):
        ends = state.time[[0, -1]]
        style = {"dash": "dash", "width": 1.0, "showlegend": k == 0}
        data.append(line(ends, np.full(2, true), theme.ink, "truth, at the end", **style))
    limits = _settled_range(values, std, () if truth is None else truth)
    half = INTERVAL * std
    data += beyond(state.time, np.hstack([values - half, values, values + half]), limits, theme)
    return figure(
        theme, data, height,
        xaxis=axis(theme, state.time_title, range=_ends(state.time)),
        yaxis=axis(theme, words[0], fixedrange=True, range=limits),
        annotations=[_NOT_ESTIMATED] if limits is None else [],
        **TIMED, showlegend=True, margin={"l": 66, "r": 12, "t": 32, "b": 42},
    )  # fmt: skip


def _ends(time: Array) -> list[float]:
    """Marks at the edges would widen the range that plotly finds by itself."""
    return [float(time[0]), float(time[-1])]


def _settled_range(values: Array, std: Array, truth: Sequence[float]) -> list[float] | None:
    """Limits of the last four fifths of a flight, and of the truth: at its start nothing is known.

    None where nothing is known at all: a wind without GPS is not estimated.
    """
    late = slice(len(values) // 5, None)
    shown = np.concatenate([(values - 2.2 * std)[late].ravel(), (values + 2.2 * std)[late].ravel(), truth])
    known = shown[np.isfinite(shown)]
    if not len(known):
        return None
    low, high = known.min(), known.max()
    room = 0.08 * (high - low) + 1e-9
    return [float(low - room), float(high + room)]


def air_figure(state: StateHistory, which: str, theme: Theme, height: int = 250) -> Figure:
    """What a sensor of the air data measured, and what was reconstructed."""
    names = ("airspeed", "angle_of_attack", "sideslip")
    title, factor = {
        "airspeed": ("airspeed [m/s]", 1.0),
        "angle_of_attack": ("angle of attack [deg]", DEGREES),
        "sideslip": ("sideslip [deg]", DEGREES),
    }[which]
    data = []
    values = factor * state.air[:, names.index(which)]
    at = thinned(state.time, values)
    if which in state.measured:
        time, measured = state.measured_time[which], factor * state.measured[which]
        seen = thinned(time, measured)
        at = np.union1d(at, np.clip(np.searchsorted(state.time, time[seen]), 0, len(state.time) - 1))
        seen = np.union1d(seen, np.clip(np.searchsorted(time, state.time[at]), 0, len(time) - 1))
        apart = gaps_among(time, seen)
        shown = broken_time(time[seen], apart), broken(measured[seen], apart)
        data.append(line(*shown, theme.noise, "measured", width=1.0))
    data.append(line(state.time[at], values[at], theme.residual, "reconstructed", width=1.4))
    return figure(
        theme, data, height,
        xaxis=axis(theme, state.time_title), yaxis=axis(theme, title, fixedrange=True),
        **TIMED, showlegend=True, margin={"l": 66, "r": 12, "t": 32, "b": 42},
    )  # fmt: skip


def consistency_figure(state: StateHistory, theme: Theme, height: int = 250) -> Figure:
    """Mean normalised innovation squared over the flight: near one where the filter is honest."""
    at = thinned(state.time, state.consistency)
    data = [
        line(state.time[at], state.consistency[at], theme.residual, "all sensors", width=1.4),
        line(state.time[[0, -1]], np.ones(2), theme.ink, "as expected", dash="dash", width=1.0),
    ]
    known = state.consistency[np.isfinite(state.consistency)]
    limits = [0.0, max(1.3 * float(np.quantile(known, 0.98)), 2.0) if len(known) else 2.0]
    data += beyond(state.time, state.consistency, limits, theme)
    return figure(
        theme, data, height,
        xaxis=axis(theme, state.time_title, range=_ends(state.time)),
        yaxis=axis(theme, "innovations over expected [-]", fixedrange=True, range=limits),
        **TIMED, showlegend=True, margin={"l": 66, "r": 12, "t": 32, "b": 42},
    )  # fmt: skip


def all_figures(state: StateHistory, theme: Theme, truth: Mapping[str, Any]) -> list[tuple[str, Figure]]:
    """Every figure with its title; ``truth`` is the content of truth.json, empty where it is not known."""
    names = {"Wind": "wind", "Accelerometer bias": "accelerometer_bias", "Gyro bias": "gyro_bias"}
    true = {**truth, "wind": truth.get("wind_ned")}
    biases = [
        (f"{title}, dotted: 95 % interval", bias_figure(state, which, theme, true.get(which)))
        for title, which in names.items()
    ]
    air = [
        (title, air_figure(state, which, theme))
        for title, which in (("Airspeed", "airspeed"), ("Angle of attack", "angle_of_attack"), ("Sideslip", "sideslip"))
    ]
    pairs = [figure for both in zip(biases, air, strict=True) for figure in both]
    return [*pairs, (INNOVATIONS, consistency_figure(state, theme))]
