"""A flight in progress: sliding time plots, errors with their noise, candidates, state, and what the node is doing."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AXIS_WORDS
from aircraft_sysid_ros.diagnosis.compare import FAILS, MORE, NOISE, SHORT
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.stretches import gaps
from aircraft_sysid_ros.workbench.views.candidates import Card
from aircraft_sysid_ros.workbench.views.coefficients import NO_DATA, AxisRow
from aircraft_sysid_ros.workbench.views.figure import (
    TIMED,
    Figure,
    Theme,
    axis,
    beyond,
    broken,
    broken_time,
    figure,
    line,
    upright,
)
from aircraft_sysid_ros.workbench.views.states import StateHistory
from aircraft_sysid_ros.workbench.views.words import symbol

Array = npt.NDArray[np.float64]

#: Flight [s] that the time plots show.
WINDOW = 120.0
TIME_TITLE = "time since first heard [s]"
#: Silence [s] of the node from which the page says so.
SILENCE = 5.0
_RESIDUAL = 0.36
#: Time [s] from the first message on in which little is learnt yet.
_BEGINNING = 5.0
Rows = Sequence[Mapping[str, Any]]


def axis_rows(newest: Mapping[str, Any] | None, failing: Collection[str] = ()) -> list[AxisRow]:
    """Errors of all axes from the newest content of ModelError; ``failing`` are those in which something is missing."""
    axes = newest["axes"] if newest else {}
    return [_row(name, axes.get(name), name in failing) for name in AXES]


def _row(name: str, values: Mapping[str, float] | None, fails: bool) -> AxisRow:
    if values is None or not np.isfinite(values["nrmse"]):
        return AxisRow(name, AXIS_WORDS[name], None, None, None, NO_DATA, "nothing yet")
    over_noise = values["over_noise"]  # as the node judges it, of minutes
    if not over_noise > 0.0:
        return AxisRow(name, AXIS_WORDS[name], values["nrmse"], None, None, FAILS if fails else SHORT)
    state = FAILS if fails else MORE if over_noise > THRESHOLDS.beyond_noise else NOISE
    return AxisRow(name, AXIS_WORDS[name], values["nrmse"], None, values["nrmse"] / over_noise, state)


def failing_axes(missing: Mapping[str, Any] | None) -> set[str]:
    """Axes that the best candidate of the newest search is about."""
    if missing is None or missing["verdict"] == "none" or not missing["candidates"]:
        return set()
    return set(missing["candidates"][0]["axes"])


def coefficient_figure(rows: Rows, name: str, theme: Theme, changes: Sequence[float] = (), height: int = 226) -> Figure:
    """One axis over the newest WINDOW seconds: measured, predicted, the residual, ``changes`` of the model."""
    end = float(rows[-1]["time"]) if rows else WINDOW
    window = [max(end, WINDOW) - WINDOW, max(end, WINDOW)]
    shown = [row for row in rows if row["time"] >= window[0] and name in row["axes"]]
    time = np.array([row["time"] for row in shown])
    measured, predicted = (np.array([row["axes"][name][key] for row in shown]) for key in ("measured", "predicted"))
    settled = time > _BEGINNING if np.any(time > _BEGINNING) else np.isfinite(time)
    limits = [_limits(measured[settled], predicted[settled]), _limits((measured - predicted)[settled])]
    at = gaps(time)
    time, measured, predicted = broken_time(time, at), broken(measured, at), broken(predicted, at)
    residual = measured - predicted
    style = {"mode": "lines+markers", "marker": {"size": 3}}
    data = [
        line(time, measured, theme.ink, "measured", width=2.0, **style),
        line(time, predicted, theme.predicted, "predicted", width=1.1, **style),
        line(time, residual, theme.residual, "residual", yaxis="y2", width=1.0, **style),
        *beyond(time, np.column_stack([measured, predicted]), limits[0], theme),
        *({**marks, "yaxis": "y2"} for marks in beyond(time, residual, limits[1], theme)),
    ]
    upper, lower = ({"range": each, "showticklabels": each is not None} for each in limits)
    shapes = [upright(t, theme.second, 1.5) for t in changes if t >= window[0]]
    return figure(
        theme, data, height,
        xaxis=axis(theme, TIME_TITLE, range=window, anchor="y2", nticks=9, fixedrange=True),
        yaxis=axis(theme, symbol(name) + " [-]", domain=[_RESIDUAL + 0.05, 1.0], fixedrange=True, nticks=5, **upper),
        yaxis2=axis(theme, "residual [-]", domain=[0.0, _RESIDUAL], fixedrange=True, nticks=5, **lower),
        **TIMED, shapes=shapes,
    )  # fmt: skip


def _limits(*lines: Array) -> list[float] | None:
    """Ends of an axis with room around lines; None where there is nothing to show."""
    values = np.concatenate(lines)
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    room = 0.08 * float(np.ptp(values)) or 0.1 * float(np.abs(values).max()) or 1e-3
    return [float(values.min()) - room, float(values.max()) + room]


def cards(missing: Mapping[str, Any] | None) -> list[Card]:
    """The candidates of MissingEffects in plain words, best first."""
    return [_card(candidate) for candidate in (missing or {}).get("candidates", ())]


def _card(candidate: Mapping[str, Any]) -> Card:
    effect, expression = BY_ID.get(candidate["effect"]), candidate["expression"]
    return Card(
        key=candidate["effect"] or expression,
        title=effect.name if effect else f"What no effect of the library has: {expression}",
        label=candidate["effect"] or expression,
        physics=effect.physics if effect else "",
        found=True,
        main_axis=candidate["axes"][0],
        before=candidate["error_before"],
        after=candidate["error_after"],
        p_value=candidate["p_value"],
        where=candidate["where"],
        confounded_with=tuple((i, BY_ID[i].name if i in BY_ID else i) for i in candidate["confounded_with"]),
        manoeuvre=effect.manoeuvre if effect else "",
        refused="",
        numbers=(expression,),
        evidence=None,
    )


def state_history(rows: Rows) -> StateHistory:
    """The contents of AircraftState that are kept, two at least, as the figures of the state take them."""

    time = np.array([row["time"] for row in rows], dtype=np.float64)
    at = gaps(time)

    def column(name: str) -> Array:
        return broken(np.array([row[name] for row in rows]), at)

    sigma = column("standard_deviations")
    return StateHistory(
        time=broken_time(time, at),
        accelerometer_bias=column("accelerometer_bias"),
        accelerometer_bias_std=sigma[:, 9:12],
        gyro_bias=column("gyro_bias"),
        gyro_bias_std=sigma[:, 12:15],
        wind=column("wind_ned"),
        wind_std=sigma[:, 15:18],
        position=column("position_ned"),
        air=np.column_stack([column(name) for name in ("true_airspeed", "angle_of_attack", "sideslip")]),
        consistency=column("innovation_consistency"),
        measured_time={},
        measured={},
        time_title=TIME_TITLE,
    )


def presence_sentence(node: str, is_there: bool, was_there: bool, silent: float | None) -> str:
    """What keeps the page from being up to date, in one sentence; empty where nothing does."""
    if not is_there and not was_there:
        return f"no {node} yet: start `aircraft-sysid live` or the nodes; this page connects by itself"
    if not is_there:
        ago = "" if silent is None else f", of {silent:.0f} s ago"
        return f"{node} is gone: what stands here is the last that it said{ago}; this page connects again by itself"
    if silent is None:
        return f"{node} is there and has said nothing new yet: it waits for states in flight"
    if silent > SILENCE:
        return f"{node} has said nothing for {silent:.0f} s: no new states in flight reach it"
    return ""
