"""Where a model fails: stretches of time and cells of the flight envelope with more residual than noise.

With z = residual / sigma, sigma the known noise of each point, the mean of z^2 over n points is 1 under a perfect
model. Neighbouring points are correlated, which leaves n / (1 + 2 sum_l rho(l)^2) independent squares (Bartlett 1946),
rho being the correlation of the residuals: the sum of squares is chi-square with so many degrees of freedom. The
probability is multiplied by the number of places tried (Bonferroni). A place must be ``Thresholds.failing`` times as
noisy as the noise as well, since the noise of a real aircraft is not known to the last percent.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincc

from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Probability that a flight with a perfect model has a place in the list, for one axis.
FALSE_ALARM = 0.05
#: Shares of the flight that lie beyond the edges of the cells.
_TAILS = (0.05, 0.1, 0.25)
#: Length [s] of the pieces of which stretches of time are made, and time over which residuals may be correlated.
_PIECE, _LAG_TIME = 0.5, 2.0
#: Stretches of time and cells that are listed per axis.
_MOST_STRETCHES, _MOST_CELLS = 4, 3
#: A stretch is described by signals that are beyond this share of the rest of the flight for half of it.
_UNUSUAL = 0.1
#: Words, unit and factor to it.
_SIGNALS: dict[str, tuple[str, str, float]] = {
    "alpha": ("alpha", " deg", 180.0 / np.pi),
    "beta": ("beta", " deg", 180.0 / np.pi),
    "qbar": ("dynamic pressure", " Pa", 1.0),
    "height": ("height", " m", 1.0),
    "de": ("elevator", " deg", 180.0 / np.pi),
    "da": ("aileron", " deg", 180.0 / np.pi),
    "dr": ("rudder", " deg", 180.0 / np.pi),
    "Tc": ("T_c", "", 1.0),
    "p": ("roll rate p b/2V", "", 1.0),
    "q": ("pitch rate q c/V", "", 1.0),
    "r": ("yaw rate r b/2V", "", 1.0),
}


@dataclass(frozen=True)
class Place:
    """A stretch of time or a cell of the envelope where one axis fails."""

    axis: str
    t_start: float  # [s] of the recording
    t_end: float
    conditions: str  # empty where nothing sets it apart
    nrmse: float  # rms residual there over the standard deviation of the coefficient in the whole flight
    excess: float  # rms residual there over the noise
    p_value: float
    is_cell: bool
    manoeuvre: str = ""  # in brackets, where there are several

    @property
    def text(self) -> str:
        """In words, such as "C_Z, 62 to 71 s, alpha above 11 deg"."""
        digits = 0 if self.t_end - self.t_start >= 2.0 else 1
        time = f"{self.t_start:.{digits}f} to {self.t_end:.{digits}f} s{self.manoeuvre}"
        parts = [f"{self.axis[0]}_{self.axis[1]}", *([self.conditions] if self.is_cell else [time, self.conditions])]
        return ", ".join(part for part in parts if part)


def independent_share(z: Array, step: float) -> float:
    """Independent squares per point of a residual z (n,) on an even grid, NaN where there is none."""
    known = np.isfinite(z)
    filled = np.where(known, z, 0.0)
    power = float(np.sum(filled**2)) / max(int(known.sum()), 1)
    total = 1.0
    for lag in range(1, min(round(_LAG_TIME / step), len(z) - 1) + 1):
        pairs = int(np.sum(known[lag:] & known[:-lag]))
        if pairs and power > 0.0:
            total += 2.0 * (float(np.sum(filled[lag:] * filled[:-lag])) / pairs / power) ** 2
    return 1.0 / total


def failing_places(flight: FlightData, axis: str, residual: Array, std: Array, spread: float) -> list[Place]:
    """Places of one axis, worst first.

    residual (n,): of the prediction, NaN where it is not judged; std (n,): its noise; spread: the standard deviation
    of the measured coefficient.
    """
    z = residual / std
    judged = np.isfinite(z)
    if not judged.any():
        return []
    share = independent_share(z, flight.step)
    stretches, tried = _stretches(flight.time, z, bridged=flight.manoeuvre is None)
    envelope = list(cells(flight, judged))
    tried += len(envelope)
    found: list[tuple[str, Place]] = []  # with the signal of a cell
    for signal, inside, words in [*(("", mask, "") for mask in stretches), *envelope]:
        square = float(np.mean(z[inside] ** 2))
        freedom = max(int(inside.sum()) * share, 1.0)
        p_value = min(1.0, tried * float(gammaincc(0.5 * freedom, 0.5 * freedom * square)))
        if p_value < FALSE_ALARM and square > THRESHOLDS.failing**2:
            begin, end = (float(t) + flight.begin for t in flight.time[inside][[0, -1]])
            nrmse = float(np.sqrt(np.mean(residual[inside] ** 2))) / spread
            words = words or unusual(flight, inside, judged)
            name = "" if signal else flight.at_time(float(flight.time[inside][0]))
            place = Place(axis, begin, end, words, nrmse, np.sqrt(square), p_value, bool(signal), name)
            found.append((signal, place))
    return _listed(found)


def _listed(found: list[tuple[str, Place]]) -> list[Place]:
    """The worst stretches of time and the worst cell of each of the worst signals, worst first."""
    found.sort(key=lambda item: -item[1].nrmse)
    stretches = [place for signal, place in found if not signal]
    by_signal: dict[str, Place] = {}
    for signal, place in found:
        if signal:
            by_signal.setdefault(signal, place)
    listed = [*stretches[:_MOST_STRETCHES], *list(by_signal.values())[:_MOST_CELLS]]
    return sorted(listed, key=lambda place: -place.nrmse)


def _stretches(time: Array, z: Array, bridged: bool) -> tuple[list[Mask], int]:
    """Stretches of time (masks of judged points) that are worse than the flight as a whole, and how many were tried.

    The stretch with the largest sum of what exceeds that is found, then those in what is left before and after it
    (Ruzzo and Tompa 1999). Unless ``bridged``, no stretch reaches over a piece without points.
    """
    piece = np.asarray(np.floor(time / _PIECE), dtype=np.int64)
    judged = np.isfinite(z)
    usual = max(THRESHOLDS.failing**2, float(np.mean(z[judged] ** 2)))
    excess = np.where(judged, z**2 - usual, 0.0)
    score = np.asarray(np.bincount(piece, excess, minlength=int(piece[-1]) + 1), dtype=np.float64)
    if not bridged:
        score[np.bincount(piece, minlength=len(score)) == 0] = -np.inf
    waiting, found = [(0, len(score))], []
    while waiting:
        low, high = waiting.pop()
        total, first, last = _largest_sum(score[low:high])
        if total > 0.0:
            found.append((total, low + first, low + last))
            waiting += [(low, low + first), (low + last, high)]
    found.sort(reverse=True)
    masks = [judged & (piece >= first) & (piece < last) for _, first, last in found[: 2 * _MOST_STRETCHES]]
    return masks, len(score) * (len(score) + 1) // 2


def _largest_sum(score: Array) -> tuple[float, int, int]:
    """Sum, first and end of the run of numbers with the largest sum (Kadane)."""
    best, first, end, start, total = 0.0, 0, 0, 0, 0.0
    for i, value in enumerate(score):
        if total <= 0.0:
            start, total = i, 0.0
        total += value
        if total > best:
            best, first, end = float(total), start, i + 1
    return best, first, end


def cells(flight: FlightData, judged: Mask) -> Iterator[tuple[str, Mask, str]]:
    """Cells of the envelope: what lies beyond a quantile of one signal."""
    for name in _SIGNALS:
        values = flight.signal(name)
        known = judged & np.isfinite(values)
        if known.sum() < 2 or np.ptp(values[known]) == 0.0:
            continue
        for tail in _TAILS:
            low, high = np.quantile(values[known], [tail, 1.0 - tail])
            for inside, words in (
                (known & (values > high), _beyond(name, "above", high)),
                (known & (values < low), _beyond(name, "below", low)),
            ):
                if inside.any():  # nothing lies beyond a stop that the signal stays at
                    yield name, inside, words


def unusual(flight: FlightData, inside: Mask, judged: Mask) -> str:
    """The two conditions that set a stretch of time apart from the rest of the flight."""
    found = []
    for name in _SIGNALS:
        values = flight.signal(name)
        here, rest = values[inside & np.isfinite(values)], values[judged & ~inside & np.isfinite(values)]
        if len(here) < 2 or len(rest) < 2:
            continue
        for side, edge in (("above", np.quantile(rest, 1.0 - _UNUSUAL)), ("below", np.quantile(rest, _UNUSUAL))):
            beyond = np.mean(here > edge if side == "above" else here < edge)
            if beyond >= 0.5:
                found.append((float(beyond), _beyond(name, side, float(edge))))
    found.sort(key=lambda item: -item[0])
    return " and ".join(text for _, text in found[:2])


def _beyond(name: str, side: str, edge: float) -> str:
    words, unit, factor = _SIGNALS[name]
    return f"{words} {side} {edge * factor:.3g}{unit}"
