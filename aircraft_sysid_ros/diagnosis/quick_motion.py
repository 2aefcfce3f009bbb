"""What the terms of an axis say of quick motion alone, where a trim that the model does not know spoils the whole.

In steady flight the moments are nought whatever the angle of attack is: elevator, thrust, flaps, gear and centre of
gravity balance each other. Of these a model has the elevator. In a flight of many steady minutes the others then make
angle of attack and elevator look as if they did nothing, and a few seconds of manoeuvres do not outweigh that. The mean
over some seconds taken off both sides of the regression leaves what is quick, as the missing parts of the trim are not.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.search.fit import AxisFit

Array = npt.NDArray[np.float64]

WINDOW = 10.0  # [s] whose mean is taken off: a short period and a Dutch roll are quicker
#: The whole flight explains a moment badly, and quick motion clearly better: both shares of the rms. A judgement.
_BAD, _BETTER = 0.5, 0.75
_GAP = 1.5  # steps
_LEAST = 200  # points


@dataclass(frozen=True)
class QuickMotion:
    """An axis whose derivatives are others in quick motion."""

    axis: str
    left: float  # of the rms of quick motion, fitted to it
    left_by_whole: float  # and by the fit to the whole flight
    values: dict[str, tuple[float, float]]  # by parameter: of the whole flight, of quick motion

    @property
    def words(self) -> str:
        """A sentence for people."""
        values = ", ".join(f"{name} {whole:.3g} ({quick:.3g})" for name, (whole, quick) in self.values.items())
        return (
            f"{self.axis}: slow trim changes (thrust, flaps, gear, fuel, the centre of gravity) are not in the model "
            f"and hide the quick motion. Of motion quicker than {WINDOW:g} s the fit to the whole flight leaves "
            f"{self.left_by_whole:.0%}, one to that motion alone {self.left:.0%}, with {values} (in brackets: from "
            "quick motion). Cut the manoeuvres out with replay --segments, or add terms for the trim changes"
        )


def quick_motion(fit: AxisFit) -> QuickMotion | None:
    """What quick motion alone says of an axis; None where the fit to the whole flight does as well."""
    if not fit.fit.nrmse_held_out > _BAD:
        return None
    rows = quick_rows(fit.flight, np.column_stack([fit.measured, fit.columns]))
    rows = rows[np.isfinite(rows[:, 0])]
    if len(rows) < _LEAST:
        return None
    y, columns = rows[:, 0], rows[:, 1:]
    moving = moved_by(columns, fit.columns[fit.rows])
    if not moving.any() or not y.any():
        return None
    scale = np.std(columns[:, moving], axis=0)
    found = np.linalg.lstsq(columns[:, moving] / scale, y, rcond=None)[0] / scale
    whole = np.nan_to_num(fit.fit.parameters)[moving]
    size = np.sqrt(np.mean(y**2))
    left, left_by_whole = (
        float(np.sqrt(np.mean((y - columns[:, moving] @ theta) ** 2)) / size) for theta in (found, whole)
    )
    if not (left < _BETTER and left < _BETTER * left_by_whole):
        return None
    names = [name for name, moves in zip(fit.names, moving, strict=True) if moves]
    values = {n: (float(a), float(b)) for n, a, b in zip(names, whole, found, strict=True)}
    return QuickMotion(fit.axis, left, left_by_whole, values)


def moved_by(quick: Array, whole: Array) -> npt.NDArray[np.bool_]:
    """Columns (k,) that quick motion (n, k) moves at all, beside the whole (m, k) of them."""
    return np.asarray(np.std(quick, axis=0) > 1e-9 * (np.abs(whole).max(axis=0) + 1e-12))


def quick_rows(flight: FlightData, rows: Array) -> Array:
    """Rows (n, k) of a flight less their means over WINDOW; NaN in stretches without a gap that are no longer."""
    size, out = max(round(WINDOW / flight.step), 1), np.full(rows.shape, np.nan)
    known = np.flatnonzero(np.isfinite(rows).all(axis=1))
    ends = np.diff(flight.time[known]) > _GAP * flight.step
    if flight.manoeuvre is not None:
        ends |= np.diff(flight.manoeuvre[known]) != 0
    for begin, end in pairwise([0, *(np.flatnonzero(ends) + 1).tolist(), len(known)]):
        if end - begin > size:
            piece = rows[known[begin:end]]
            out[known[begin:end]] = piece - uniform_filter1d(piece, size, axis=0, mode="nearest")
    return out
