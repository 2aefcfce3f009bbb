"""Parameters: estimate with interval, status with its reason, the truth where it is known, history over the flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.workbench.views.coefficients import TIME_TITLE
from aircraft_sysid_ros.workbench.views.figure import TIMED, Figure, Theme, axis, beyond, encoded, figure, line

Array = npt.NDArray[np.float64]

#: Standard errors on either side of an interval.
INTERVAL = 1.96
_UNITS = "Per radian where a term is of an angle; rates are p b/2V, q c/V and r b/2V."
#: Where the numbers of the first version come from, and those of the others.
IN_FLIGHT = "As the run has learnt them, at the end of the flight. " + _UNITS
OF_ALL = "As replay learns them with the model of this version. " + _UNITS


@dataclass(frozen=True)
class ParameterRow:
    """One parameter for people; None where it is not known."""

    name: str
    value: float | None
    std: float | None
    status: str
    reason: str
    truth: float | None

    @property
    def interval(self) -> tuple[float, float] | None:
        """Within which the true value lies in 19 of 20 cases."""
        if self.value is None or self.std is None:
            return None
        return self.value - INTERVAL * self.std, self.value + INTERVAL * self.std


@dataclass(frozen=True)
class ParameterHistory:
    """Estimates over the flight: time (n,) [s]; value, std and status (n, p) by name."""

    time: Array
    names: tuple[str, ...]
    value: Array
    std: Array
    status: npt.NDArray[np.int64]


def parameter_rows(listed: Sequence[Mapping[str, Any]], truth: Mapping[str, float]) -> list[ParameterRow]:
    """Rows from the content of parameters.json."""
    return [
        ParameterRow(p["name"], _known(p["value"]), _known(p["std"]), p["status"], p["reason"], truth.get(p["name"]))
        for p in listed
    ]


def _known(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)


def history_figure(
    found: ParameterHistory,
    name: str,
    theme: Theme,
    truth: float | None = None,
    fitted: float | None = None,
    height: int = 300,
) -> Figure:
    """One parameter over the flight with its interval; where its status is not USE the line is dotted.

    ``fitted`` is its value in the version that the table shows, where that is not the one that was learnt in flight.
    """
    column = found.names.index(name)
    value, std, status = found.value[:, column], found.std[:, column], found.status[:, column]
    used = status == int(Trust.USE)
    low, high = value - INTERVAL * std, value + INTERVAL * std
    known = np.isfinite(low)
    time = found.time[known]
    band = {
        "type": "scatter", "mode": "lines", "fill": "toself", "hoverinfo": "skip", "line": {"width": 0},
        "fillcolor": theme.pale, "name": "95 % interval",
        "x": encoded(np.concatenate([time, time[::-1]])), "y": encoded(np.concatenate([low[known], high[known][::-1]])),
    }  # fmt: skip
    data = [band, line(found.time, value, theme.residual, "not for use", dash="dot")]
    data.append(line(found.time, np.where(used, value, np.nan), theme.residual, "estimate, status USE", width=2.2))
    ends = found.time[[0, -1]]
    if fitted is not None:
        data.append(line(ends, np.full(2, fitted), theme.second, "this version", width=1.6))
    if truth is not None:
        data.append(line(ends, np.full(2, truth), theme.predicted, "truth", dash="dash", width=1.6))
    settled = known & (found.time >= 0.5 * (found.time[0] + found.time[-1]))
    limits = _limits(low[settled], high[settled], truth)
    data += beyond(found.time, np.column_stack([low, value, high]), limits, theme)
    return figure(
        theme, data, height,
        xaxis=axis(theme, TIME_TITLE, range=ends.tolist()),
        yaxis=axis(theme, f"{name} [-], angles in rad", fixedrange=True, **({"range": limits} if limits else {})),
        **TIMED,
        showlegend=True,
        margin={"l": 70, "r": 12, "t": 34, "b": 42},
    )  # fmt: skip


def _limits(low: Array, high: Array, truth: float | None) -> list[float] | None:
    """Range that shows the settled estimate: at the start intervals are as wide as the world."""
    if not len(low):
        return None
    bottom, top = float(np.quantile(low, 0.03)), float(np.quantile(high, 0.97))
    if truth is not None:
        bottom, top = min(bottom, truth), max(top, truth)
    room = 0.1 * (top - bottom)
    return [bottom - room, top + room] if room > 0.0 else None
