"""A vane that is late or early, and that nobody has described: what it explains of the coefficients.

An angle a that is measured tau late is a(t - tau), so that C(a) is

    C(a measured) + tau a' dC/da

in all axes that read it, with one tau: a vane, its tubes and its logging, and the place of a probe of which nobody has
said it, do that in every flight (``identification.undescribed``). A memory of the flow acts in some axes, and
as its physics has it. What is left of a coefficient is therefore no memory where the same tau, as vanes are late,
explains so much that nothing of size is left of it, and no axis of the angle speaks against it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.sensor_settings import described
from aircraft_sysid_ros.diagnosis.finding import share_of_first
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator, Score
from aircraft_sysid_ros.diagnosis.search.fit import AxisFit
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS as OF_IDENTIFICATION

Array = npt.NDArray[np.float64]

#: By angle its sensor, and the axes that read it.
_ANGLES = {"alpha": ("angle_of_attack", ("CX", "CZ", "Cm")), "beta": ("sideslip", ("CY", "Cl", "Cn"))}
#: So many sigma (``vane_lag`` of the identification) a vane may be late, or early.
_MOST = 2.0


def delay_that_explains(bench: CandidateEvaluator, trial: Score, first: float) -> float:
    """By how much [s] the vane of its main axis may be late, where a trial has no size beside that; else NaN.

    ``first``: error of that axis before anything was found.
    """
    axis, data = trial.main_axis, bench.data
    angle = next(name for name, (_, axes) in _ANGLES.items() if axis in axes)
    sensor, axes = _ANGLES[angle]
    said = described(data.aircraft.source.get("sensors"))
    fit = bench.fits[axis]
    slope = _slope(fit, angle)
    if {sensor, "air_data"} & said or angle in data.inferred or slope is None:
        return np.nan
    rate = _rate(data, angle)
    late = (slope * rate)[:, None]
    try:
        own = fit.gain(late)
        delay = float(own.parameters[0])
        if not abs(delay) <= _MOST * OF_IDENTIFICATION.vane_lag or own.nrmse_after >= own.nrmse_before:
            return np.nan
        beside = fit.extended(late, [f"{axis}_late"]).gain(data.columns(data.parsed(trial.candidate.terms[axis])))
    except InputError:  # the angle moves nowhere where the coefficient is known
        return np.nan
    if share_of_first(beside, beside.nrmse_before, first) >= THRESHOLDS.size:
        return np.nan
    others = (other for other in axes if other != axis and other in bench.fits)
    return np.nan if any(_speaks_against(bench.fits[other], angle, delay * rate) for other in others) else delay


def _rate(data: FlightData, angle: str) -> Array:
    """Rate of an angle (n,) [rad/s] by the motion, or by differences where that needs a sideslip nobody knows."""
    length = data.aircraft.chord if angle == "alpha" else 0.5 * data.aircraft.span
    rate = data.signal(f"{angle}_dot") * data.signal("V") / length
    value, slope = data.signal(angle), np.full(len(rate), np.nan)
    span = data.time[2:] - data.time[:-2]
    slope[1:-1] = np.where(span < 2.5 * data.step, (value[2:] - value[:-2]) / span, np.nan)
    return np.where(np.isfinite(rate), rate, slope)


def _slope(fit: AxisFit, angle: str) -> Array | None:
    """dC/d(angle) (n,) along the flight by the model of an axis; None where the flight does not tell it."""
    known = dict(zip(fit.names, np.where(fit.determined, fit.parameters, np.nan), strict=True))
    slope = known.get(f"{fit.axis}_{angle}", np.nan)
    if angle == "alpha":
        slope = slope + 2.0 * known.get(f"{fit.axis}_alpha2", 0.0) * fit.flight.signal("alpha")
    slope = np.broadcast_to(slope, len(fit.flight.time))
    return slope if np.isfinite(slope).any() else None


def _speaks_against(fit: AxisFit, angle: str, moved: Array) -> bool:
    """Whether the error of an axis grows where its angle is corrected by ``moved`` (n,) [rad]."""
    slope = _slope(fit, angle)
    if slope is None:
        return False
    try:
        corrected = AxisFit(fit.flight, fit.axis, fit.columns, fit.names, fit.measured - slope * moved)
    except InputError:
        return False
    before, after = fit.nrmse_held_out * fit.spread, corrected.nrmse_held_out * corrected.spread
    return bool(after > (1.0 + THRESHOLDS.worse) * before)
