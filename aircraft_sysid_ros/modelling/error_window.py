"""Model against measurement over a sliding window, one figure per axis."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.modelling.regression import Point

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class AxisError:
    """Error of one axis; predictions are made before each sample is learnt from."""

    axis: str
    measured: float
    predicted: float
    nrmse: float
    residual_rms: float
    lag_one_correlation: float
    white: bool  # the lag-one correlation is within what white noise gives in 99 % of windows


class ErrorWindow:
    """Keeps the measured and predicted coefficients of the last ``length`` [s]."""

    def __init__(self, length: float, step: float) -> None:
        self._rows: deque[Array] = deque()
        self.resize(length, step)

    def resize(self, length: float, step: float) -> None:
        """Keep another length [s] of points, which are ``step`` [s] apart."""
        self._rows = deque(self._rows, maxlen=max(round(length / step), 2))

    def add(self, points: Array) -> None:
        """Take points, rows of ``Point``."""
        self._rows.extend(points[:, : Point.LEARNT.stop].copy())

    def clear(self) -> None:
        """Start an empty window."""
        self._rows.clear()

    def forget(self, axes: Sequence[str]) -> None:
        """Leave out what was predicted of some axes: their model is another one now."""
        for row in self._rows:
            for axis in axes:
                row[Point.VALID.start + AXES.index(axis)] = 0.0

    def summary(self) -> list[AxisError]:
        """One entry per axis that was evaluated in the window."""
        if not self._rows:
            return []
        rows = np.array(self._rows)
        errors = []
        for i, axis in enumerate(AXES):
            valid = rows[:, Point.VALID.start + i] > 0.0
            if valid.sum() > 2:
                measured = rows[valid, Point.MEASURED.start + i]
                errors.append(_axis_error(axis, measured, rows[valid, Point.PREDICTED.start + i]))
        return errors


def _axis_error(axis: str, measured: Array, predicted: Array) -> AxisError:
    residual = measured - predicted
    rms, spread = float(np.sqrt(np.mean(residual**2))), float(np.std(measured))
    centred = residual - residual.mean()
    power = float(centred @ centred)
    correlation = float(centred[1:] @ centred[:-1]) / power if power > 0.0 else 0.0
    return AxisError(
        axis,
        float(measured[-1]),
        float(predicted[-1]),
        rms / spread if spread > 0.0 else np.nan,
        rms,
        correlation,
        bool(abs(correlation) < 2.58 / np.sqrt(len(measured))),
    )
