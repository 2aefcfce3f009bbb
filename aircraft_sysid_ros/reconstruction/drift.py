"""Offsets and slow drifts of air data sensors that the aircraft file knows of: a pitot that ices, a vane that bends.

    airspeed:  shown = scale V (1 + d t),        angles:  shown = scale (angle + o + d t),

with t from when the filter starts: from the first state, which the second step sees as well.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]
Kinds = npt.NDArray[np.int64]

SENSORS = {Kind.AIRSPEED: "airspeed", Kind.ANGLE_OF_ATTACK: "angle_of_attack", Kind.SIDESLIP: "sideslip"}


class Drift:
    """What the air data show too much: the offset always, the drift from the first state of a flight on."""

    def __init__(self, aircraft: Aircraft) -> None:
        self._scales = {kind: aircraft.sensors[name].scale for kind, name in SENSORS.items()}
        self._rates = {kind: rate for kind, name in SENSORS.items() if (rate := aircraft.sensors[name].drift)}
        self._offsets = {kind: offset for kind, name in SENSORS.items() if (offset := aircraft.sensors[name].offset)}
        self.since: float | None = None  # time [s] of the first state
        self._logarithms, self._count = 0.0, 0

    def begin_flight(self) -> None:
        """Another flight begins, without a drift."""
        self.since = None

    def note_states(self, times: Array, before: float) -> None:
        """States of times [s] (n,) come after one of the time ``before``, or -inf: the first, or by a new clock."""
        if len(times) and (self.since is None or times[0] <= before):
            self.since = float(times[0])

    def corrected(self, times: Array, kinds: Kinds, values: Array) -> Array:
        """Values (n, …) of samples as they were shown, at times [s] (n,): without scale, offset and drift."""
        values = values.copy()
        for kind, scale in self._scales.items():
            values[kinds == kind, 0] /= scale
        return self.without(times, kinds, values)

    def without(self, times: Array, kinds: Kinds, values: Array) -> Array:
        """Values (n, …) of samples at times [s] (n,), without their scale: without offset and drift, too."""
        if not self._rates and not self._offsets:
            return values
        values = values.copy()
        for kind, offset in self._offsets.items():
            values[kinds == kind, 0] -= offset
        for kind, rate in self._rates.items() if self.since is not None else ():
            chosen = kinds == kind
            grown = rate * np.maximum(times[chosen] - self.since, 0.0)
            if kind == Kind.AIRSPEED:
                values[chosen, 0] /= 1.0 + grown
            else:
                values[chosen, 0] -= grown
        return values

    def count(self, times: Array, kinds: Kinds) -> None:
        """These samples have been used."""
        rate = self._rates.get(Kind.AIRSPEED, 0.0)
        if rate and self.since is not None:
            used = times[kinds == Kind.AIRSPEED]
            self._logarithms += float(np.sum(np.log1p(rate * np.maximum(used - self.since, 0.0))))
            self._count += len(used)

    @property
    def mean_logarithm(self) -> float:
        """Mean of ln(1 + d t) over the samples of the airspeed that have been used: what a likelihood counts."""
        return self._logarithms / max(self._count, 1)
