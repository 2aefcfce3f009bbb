"""Health watch in flight: what a fault of the aeroplane or its sensors would do to all of its parameters at once.

Of parameters to USE this flight says theta_j ± s_j, and earlier ones m_j ± d_j (``prior``). A fault of size e moves
them along a pattern a, theta = m + e a, known from the equations of the coefficients; by weighted least squares it is

    e = sum a D / v / sum a² / v,    D = theta - m,    v = s² + d²,    gain = e² sum a² / v,

and the gain is chi² of one degree of freedom where nothing has changed. The patterns (C_q, C_p, C_r: rates; d: aft):

| fault | what follows of C = m A / (q̄ S) and its like |
|---|---|
| airspeed shows 1 + e of the truth | every coefficient / (1 + e)², those of rates / (1 + e), C_X,Tc stays |
| mass 1 + e of that of the file | coefficients of force / (1 + e), with C_X,Tc |
| centre of gravity aft by d | C_m += -C_Z d / chord, C_n += C_Y d / span |
| control power 1 + e of a surface | its derivatives in all axes |

A fault is said where its gain is beyond ``health_sigma``² (``thresholds``) and its size beyond what matters, where it
explains most of what is unusual, and better than the others, at ``health_looks`` looks in a row. What two faults do
alike is said of both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AerodynamicModel
from aircraft_sysid_ros.aircraft.fleet_prior import FleetPrior
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.rounding import with_error

Array = npt.NDArray[np.float64]

_RATES = ("p", "q", "r")
_SURFACES = {
    "elevator": ("de", "CX", "CZ", "Cm"),
    "aileron": ("da", "CY", "Cl", "Cn"),
    "rudder": ("dr", "CY", "Cl", "Cn"),
}


@dataclass(frozen=True)
class Fault:
    """What may be wrong: size from which it matters, and the words for it, with the size in per cent."""

    kind: str
    least: float
    more: str
    less: str

    def words(self, size: float, std: float) -> str:
        """As a sentence goes on."""
        return f"{self.more if size > 0.0 else self.less} {with_error(100.0 * abs(size), 100.0 * std)} %"


FAULTS: dict[str, Fault] = {
    "airspeed_scale": Fault(
        "airspeed_scale", THRESHOLDS.health_airspeed, "the airspeed reads too high, by",
        "the airspeed reads too low, by",
    ),
    "mass": Fault(
        "mass", THRESHOLDS.health_mass, "the mass is above that of the file by",
        "the mass is below that of the file by",
    ),
    "centre_of_gravity": Fault(
        "centre_of_gravity", THRESHOLDS.health_gravity, "the centre of gravity is further aft, in chords by",
        "the centre of gravity is further forward, in chords by",
    ),
    **{
        f"{name}_power": Fault(
            f"{name}_power", THRESHOLDS.health_power, f"the {name} has more power, by", f"the {name} has lost power,"
        )
        for name in _SURFACES
    },
}  # fmt: skip


class Found(NamedTuple):
    """A fault that is there just now."""

    kinds: tuple[str, ...]  # the likeliest first; others that this flight cannot tell from it
    size: float
    std: float
    since: float  # [s] of flight, of the first look that found it


def patterns(
    names: Sequence[str], known: Mapping[str, tuple[float, float]], chord_over_span: float
) -> dict[str, Array]:
    """By fault what one unit of it adds to each parameter (n,); NaN where earlier flights do not know enough."""
    mean = np.array([known.get(name, (np.nan, np.nan))[0] for name in names])
    axis, term = zip(*(name.split("_", 1) for name in names), strict=True)
    is_force = np.isin(axis, ("CX", "CY", "CZ"))
    of_airspeed = np.where(np.isin(term, _RATES), -1.0, np.where(np.array(term) == "Tc", 0.0, -2.0))
    found = {"airspeed_scale": of_airspeed * mean, "mass": -mean * is_force, "centre_of_gravity": np.zeros(len(names))}
    for j in range(len(names)):
        for moment, force, factor in (("Cm", "CZ", -1.0), ("Cn", "CY", chord_over_span)):
            partner = f"{force}_{term[j]}"
            if axis[j] == moment and partner in names:
                found["centre_of_gravity"][j] = factor * known.get(partner, (np.nan, np.nan))[0]
    for surface, (signal, *axes) in _SURFACES.items():
        moved = np.isin(axis, axes) & (np.array(term) == signal)
        found[f"{surface}_power"] = np.where(moved, mean, 0.0)
    return found


class HealthWatch:
    """Looks at the parameters of a flight beside what earlier flights expect."""

    def __init__(self, model: AerodynamicModel, prior: FleetPrior | None, chord_over_span: float) -> None:
        self._known = {} if prior is None else prior.parameters
        self._flights, self._shape = "" if prior is None else prior.flights, chord_over_span
        self.now: Found | None = None
        self.history: list[Found] = []  # each as it was last seen
        self._looks, self._first, self._kind = 0, 0.0, ""
        self.adopt(model)

    def adopt(self, model: AerodynamicModel) -> None:
        """Go on with another model."""
        names = self._names = model.parameter_names
        known = [self._known.get(name, (np.nan, np.nan)) for name in names]
        self._mean, self._std = np.array(known).reshape(-1, 2).T
        self._patterns = patterns(names, self._known, self._shape) if self._known else {}

    def look(self, value: Array, std: Array, is_used: npt.NDArray[np.bool_], time: float) -> None:
        """All parameters (n,) by this flight alone, at a time [s] of flight."""
        best = self._best(value, std, is_used)
        kind = best[0][0] if best else ""
        self._looks, self._first = (self._looks + 1, self._first) if kind and kind == self._kind else (1, time)
        self._kind = kind
        if not best or self._looks < THRESHOLDS.health_looks:
            self.now = self.now if best and self.now is not None and self.now.kinds[0] == kind else None
            return
        self.now = Found(best[0], best[1], best[2], self._first)
        if self.history and self.history[-1].kinds[0] == kind and self.history[-1].since == self._first:
            self.history[-1] = self.now
        else:
            self.history.append(self.now)

    def _best(
        self, value: Array, std: Array, is_used: npt.NDArray[np.bool_]
    ) -> tuple[tuple[str, ...], float, float] | None:
        """The likeliest fault with those that are like it, its size and standard error."""
        asked = is_used & np.isfinite(self._mean) & np.isfinite(value) & np.isfinite(std)
        apart, weight = (value - self._mean)[asked], 1.0 / (std**2 + self._std**2)[asked]
        unusual = float(weight @ apart**2)
        found = []
        for kind, pattern in self._patterns.items():
            a = np.nan_to_num(pattern[asked])
            of_a = float(weight @ a**2)
            fewest = 1 if kind.endswith("_power") else THRESHOLDS.health_fewest
            if np.count_nonzero(a) < fewest or of_a <= 0.0:
                continue
            size = float(weight @ (a * apart)) / of_a
            found.append((size**2 * of_a, kind, size, of_a**-0.5))
        if not found:
            return None
        gain, kind, size, of_size = max(found)
        if gain < THRESHOLDS.health_sigma**2 or abs(size) < FAULTS[kind].least:
            return None
        if gain < THRESHOLDS.health_explains * unusual:
            return None
        near = gain - THRESHOLDS.health_alike
        alike = sorted((other for other in found if other[1] != kind and other[0] > near), reverse=True)
        return (kind, *(other[1] for other in alike)), size, of_size

    @property
    def axes(self) -> set[str]:
        """Axes whose parameters what was found just now moves."""
        if self.now is None:
            return set()
        moved = np.flatnonzero(np.nan_to_num(self._patterns[self.now.kinds[0]]))
        return {self._names[j].partition("_")[0] for j in moved}

    def sentence(self, found: Found) -> str:
        """What was found, for people."""
        others = " or ".join(kind.replace("_", " ") for kind in found.kinds[1:])
        alike = f"; this flight cannot tell it from {others}" if others else ""
        words = FAULTS[found.kinds[0]].words(found.size, found.std)
        return f"from {found.since:.0f} s: {words}, compared with {self._flights}{alike}"

    def notes(self) -> list[str]:
        """All that was found in the flight, in words."""
        return [self.sentence(found) for found in self.history]

    @property
    def json(self) -> list[dict[str, object]]:
        """The same for programs."""
        return [
            {
                "kinds": [*found.kinds], "size": found.size, "std": found.std, "since": found.since,
                "now": found is self.now, "sentence": self.sentence(found),
            }
            for found in self.history
        ]  # fmt: skip
