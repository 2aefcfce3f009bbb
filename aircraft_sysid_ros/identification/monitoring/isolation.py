"""What one thing explains, in all axes at once, that coefficients are no more what was known of them?

With theta what was known, y = x' theta + e should leave noise. Where an input of the model is recorded with the scale
1 / (1 + k), or a surface has 1 + k of its effect, e is k times the part of x' theta that this input does, in every
axis that has it; airspeed and density scale the whole; and what is late by tau leaves tau times the rate of its part.
A centre of gravity that moves aft by k chords adds -k C_Z to C_m and k c/b C_Y to C_n. One number for all axes: with w
the inverse of the usual mean square error of each axis and g what a unit of k does, both without their means,

    k = sum w g e / sum w g^2,    J = sum w (e - k g)^2,

over the newest samples. Another change of one axis, or of several terms, is explained by none of them. Analytic
redundancy, as the parity space has it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX, SURFACE_WORDS
from aircraft_sysid_ros.identification.coefficients.layout import LEARNT, MEASURED, CoefficientSample
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.reconstruction.state import SUSPECTED

Array = npt.NDArray[np.float64]

#: Samples further apart [s] have no rate between them.
_STEP = 0.1
_FLOW = ("alpha", "beta")
_TIME = CoefficientSample.TIME
#: By the name of a vane in SUSPECTED: the axis of the force that it makes, and those of the moments.
_OF_VANES = {
    "angle of attack": (AXES.index("CZ"), [AXES.index("Cm")]),
    "sideslip": (AXES.index("CY"), [AXES.index("Cn"), AXES.index("Cl")]),
}
INPUTS = {"alpha": "angle of attack", "beta": "sideslip"} | {
    signal: f"record of the {surface}" for signal, surface in SURFACE_WORDS.items()
}
_AIRSPEED, _CONTROLS, _AIR_DATA, _IMU = "airspeed", "controls", "air data", "IMU"
_LATE = (_CONTROLS, _AIR_DATA, _IMU)
_GRAVITY = "centre of gravity"
_CY, _CZ = MEASURED + AXES.index("CY"), MEASURED + AXES.index("CZ")


class Explanation(NamedTuple):
    """One thing that may be wrong."""

    what: str  # a signal of the model, or one of those above
    size: float  # k; of what is late the delay [s]
    before: float  # J without an explanation, over the number of errors: 1 is usual
    left: float  # share of J that is left with it

    @property
    def is_sure(self) -> bool:
        """Whether it explains most, and is more than what parameters are known to."""
        of_time, of_chord = self.what in _LATE, self.what == _GRAVITY
        matters = THRESHOLDS.late if of_time else THRESHOLDS.moved if of_chord else THRESHOLDS.scale
        return self.left < THRESHOLDS.unexplained and abs(self.size) > matters

    @property
    def is_aeroplane(self) -> bool:
        """Whether it explains all, and a surface has lost effect or the centre of gravity has moved."""
        lost = self.what in SURFACE_WORDS and -1.0 <= self.size < 0.0
        moved = self.what == _GRAVITY and abs(self.size) < THRESHOLDS.farthest
        return self.is_sure and (lost or moved) and self.left * self.before < THRESHOLDS.unexplained_of_aeroplane

    def touches(self, axis: int, label: str) -> bool:
        """Whether it changes a parameter of an axis, by its label such as "de"."""
        return AXES[axis] in ("Cm", "Cn") if self.what == _GRAVITY else label == self.what

    @property
    def words(self) -> str:
        """What is wrong, for people."""
        if self.what in _LATE:
            verb = "is" if self.what == _IMU else "are"
            return f"the {self.what} {verb} {abs(self.size):.2f} s {'late' if self.size > 0.0 else 'early'}"
        if self.what == _GRAVITY:
            where = "aft" if self.size > 0.0 else "forward"
            return f"the centre of gravity moved {where} by {abs(self.size):.0%} of the chord"
        if self.is_aeroplane:
            return f"the {SURFACE_WORDS[self.what]} lost {-self.size:.0%} of its effect, or its record is wrong"
        if self.what == _AIRSPEED:
            return "airspeed or density is wrong, or the aeroplane has changed"
        return f"the {INPUTS[self.what]} needs the factor {1.0 + self.size:.2g}, or the aeroplane has changed"


def explanations(
    model: AerodynamicModel,
    samples: Array,
    known: Sequence[Array | None],
    is_known: npt.NDArray[np.bool_],
    usual: Array,
    chord_over_span: float,
) -> list[Explanation]:
    """What may explain the errors of samples (n, …), the best first.

    ``known`` all parameters, as they are best known for each axis, ``is_known`` those that surely
    are, ``usual`` (6,) mean square error of each.
    """
    total, count = 0.0, 0
    sums: dict[str, Array] = {}
    for axis, name in enumerate(AXES):
        theta, part = known[axis], model.axis_slice(name)
        learnt = samples[:, LEARNT + axis] > 0.0
        if theta is None or not np.isfinite(usual[axis]) or not learnt.any():
            continue
        x = samples[:, CoefficientSample.TERMS + part.start : CoefficientSample.TERMS + part.stop]
        error = _without_mean((samples[:, MEASURED + axis] - x @ theta[part])[learnt])
        total, count = total + float(error @ error) / usual[axis], count + len(error)
        effects = _effects(samples[:, _TIME], x * theta[part] * is_known[part], model.terms[name])
        if name in ("Cm", "Cn"):
            effects[_GRAVITY] = -samples[:, _CZ] if name == "Cm" else chord_over_span * samples[:, _CY]
        for what, effect in effects.items():
            g = _without_mean(np.nan_to_num(effect[learnt]))
            sums[what] = sums.get(what, np.zeros(2)) + np.array([g @ error, g @ g]) / usual[axis]
    found = [
        Explanation(what, float(ge / gg), total / count, float(1.0 - ge * ge / (gg * total)))
        for what, (ge, gg) in sums.items()
        if gg > 0.0 and total > 0.0
    ]
    return sorted(found, key=lambda e: e.left)


def _effects(time: Array, each: Array, terms: Sequence[str]) -> dict[str, Array]:
    """What a unit of each explanation does to a coefficient of which the terms do ``each`` (n, terms)."""
    of = [term.partition("**")[0] for term in terms]

    def part(*names: str) -> Array:
        return np.asarray(each[:, [name in names for name in of]].sum(axis=1))

    found = {name: part(name) for name in (*_FLOW, *SURFACE_WORDS) if name in of}
    controls, flow = _rate(time, part(*SURFACE_WORDS)), _rate(time, part(*_FLOW))
    return found | {
        _AIRSPEED: each.sum(axis=1), _CONTROLS: controls, _AIR_DATA: flow, _IMU: -controls - flow
    }  # fmt: skip


def wrong_gyros(suspect: int, over_usual: Array) -> str:
    """That the gyros are wrong, in words: what they predict of a vane fails, and the force that goes with it does not.

    ``suspect``: number in SUSPECTED of the sensor whose innovations are too large; ``over_usual`` (6,) rms errors over
    the usual. A vane that is wrong spoils the force that depends on it; a gyro that is wrong spoils the moments, as
    damping does.
    """
    if SUSPECTED.get(suspect) not in _OF_VANES:
        return ""
    force, moments = _OF_VANES[SUSPECTED[suspect]]
    if over_usual[force] < THRESHOLDS.first_sign[0] and (over_usual[moments] > THRESHOLDS.alarm[0]).any():
        return "the gyros are wrong: they contradict the vanes, and the forces agree with these"
    return ""


def noisy_records(model: AerodynamicModel, samples: Array, since: float) -> str:
    """Which records of surfaces are noise since a time [s], by samples (n, …), in words; nothing where none is."""
    time, first = samples[:, _TIME], CoefficientSample.SIGNALS.start
    moved = {term for terms in model.terms.values() for term in terms}
    found = [
        surface
        for signal, surface in SURFACE_WORDS.items()
        if signal in moved and _is_noisy(time, samples[:, first + SIGNAL_INDEX[signal]], since)
    ]
    if len(found) == 1:
        return f"the record of the {found[0]} is noisy"
    return f"the records of the controls are noisy: {', '.join(found)}" if found else ""


def _is_noisy(time: Array, record: Array, since: float) -> bool:
    """Whether a record (n,) [rad] is noise since a time [s], and was not before.

    By the median of its third differences: no motion that is steered has them, and a step has few.
    """
    if len(record) < 2 * THRESHOLDS.rough_samples:
        return False
    rough, middle = np.abs(np.diff(record, 3)), time[1:-2]
    lately, before = middle > max(since, middle[-1] - THRESHOLDS.rough_time), middle < since
    if min(lately.sum(), before.sum()) < THRESHOLDS.rough_samples:
        return False
    now, smooth = np.median(rough[lately]), np.median(np.abs(np.diff(record))[1:-1][lately])
    was = np.median(rough[before])
    return bool(now > max(THRESHOLDS.rough, THRESHOLDS.rougher * was, THRESHOLDS.rough_white * smooth))


def _without_mean(values: Array) -> Array:
    return np.asarray(values - values.mean())


def _rate(time: Array, values: Array) -> Array:
    """Time derivative by central differences, 0 beside a gap."""
    rate = np.zeros(len(values))
    step = time[2:] - time[:-2]
    rate[1:-1] = np.where((step > 0.0) & (step < 2.0 * _STEP), (values[2:] - values[:-2]) / np.maximum(step, 1e-3), 0.0)
    return rate
