"""Parameters over flight condition: what was learnt in several of them, interpolated.

The (airspeed, alpha) plane is cut into bins. A parameter that was learnt a moment ago is noted in the bin that is flown
in, with the mean condition of that bin as its place. Between the places z_k, scaled by the size of a bin, the weights
are Shepard's (1968), w_k ~ 1 / |z - z_k|^2, exact at every place, and with the standard errors s_k

    v = sum w_k v_k,    s^2 = (sum w_k s_k)^2 + sum w_k (v_k - v)^2:

values of one estimator err together, and what lies between two places is known only as far as the two agree.

A bin that contradicts what it held before says that the aeroplane has changed: all other bins of that parameter go.
What was learnt nobody knows where has no bin; if it contradicts all of them, they go too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.consumer.snapshot import Condition
from aircraft_sysid_ros.errors import InputError

Array = npt.NDArray[np.float64]

#: Age [s] up to which a parameter was learnt in the condition that is flown in now.
_FRESH = 2.0
#: Standard errors, of both values together, that are a contradiction.
_CONTRADICTION = 4.0
#: A place is remembered as the mean of about so many conditions.
_MEAN_OF = 20.0


@dataclass
class _Bin:
    place: Array  # (2,) airspeed [m/s], alpha [rad]
    values: Array  # (n,) NaN: nothing here
    std: Array  # (n,)


class ConditionTable:
    """Values of n parameters by flight condition."""

    def __init__(self, names: tuple[str, ...], airspeed_bin: float = 3.0, alpha_bin: float = 0.05) -> None:
        """``airspeed_bin`` [m/s] and ``alpha_bin`` [rad]: size of a bin; InputError unless finite and above 0."""
        self.names = names
        self.size = np.array([airspeed_bin, alpha_bin])
        if not np.all(np.isfinite(self.size) & (self.size > 0.0)):
            raise InputError(f"the size of a bin must be above 0, not {airspeed_bin:g} m/s by {alpha_bin:g} rad")
        self._bins: dict[tuple[int, int], _Bin] = {}

    def __len__(self) -> int:
        """How many bins hold something."""
        return len(self._bins)

    def clear(self) -> None:
        """The clock or the model is another one."""
        self._bins.clear()

    def add(self, values: Array, std: Array, age: Array, condition: Condition | None) -> bool:
        """Note good values (n,) and standard errors learnt ``age`` (n,) [s] ago; older ones are passed over.

        False where the condition is not known, and the values have no place.
        """
        learnt = (np.abs(age) <= _FRESH) & np.isfinite(values)
        if condition is None or not np.all(np.isfinite(condition[:2])):
            self._forget_contradicted(values, std, learnt)
            return False
        if learnt.any():
            self._note(values, std, learnt, np.array(condition[:2]))
        return True

    def _forget_contradicted(self, values: Array, std: Array, learnt: npt.NDArray[np.bool_]) -> None:
        agrees = np.zeros(len(self.names), dtype=np.bool_)
        for one in self._bins.values():
            agrees |= np.abs(values - one.values) <= _CONTRADICTION * np.hypot(std, one.std)
        for one in self._bins.values():
            one.values[learnt & ~agrees] = one.std[learnt & ~agrees] = np.nan

    def _note(self, values: Array, std: Array, learnt: npt.NDArray[np.bool_], place: Array) -> None:
        airspeed, alpha = np.floor(place / self.size)
        key = (int(airspeed), int(alpha))
        n = len(self.names)
        here = self._bins.setdefault(key, _Bin(place, np.full(n, np.nan), np.full(n, np.nan)))
        changed = learnt & (np.abs(values - here.values) > _CONTRADICTION * np.hypot(std, here.std))
        for other in self._bins.values():
            other.values[changed] = other.std[changed] = np.nan
        here.place = here.place + (place - here.place) / _MEAN_OF
        here.values[learnt], here.std[learnt] = values[learnt], std[learnt]

    def at(self, condition: Array, values: Array, std: Array) -> tuple[Array, Array]:
        """Values and standard errors (n,) in a condition (2 or more,); ``values`` and ``std`` where no bin knows."""
        if not self._bins or not np.all(np.isfinite(condition[:2])):
            return values, std
        bins = list(self._bins.values())
        distance = (np.array([b.place for b in bins]) - condition[:2]) / self.size
        weight = 1.0 / np.maximum(np.sum(distance**2, axis=1), 1e-12)
        held, errors = np.array([b.values for b in bins]), np.array([b.std for b in bins])
        there = np.isfinite(held)
        weights = there * weight[:, None]
        total = weights.sum(axis=0)
        known = total > 0.0
        weights = weights / np.where(known, total, 1.0)
        mean = np.sum(weights * np.where(there, held, 0.0), axis=0)
        spread = np.sum(weights * np.where(there, held - mean, 0.0) ** 2, axis=0)
        error = np.sum(weights * np.where(there, errors, 0.0), axis=0)
        return np.where(known, mean, values), np.where(known, np.sqrt(error**2 + spread), std)
