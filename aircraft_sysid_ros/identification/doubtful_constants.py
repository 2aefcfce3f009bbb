"""Constants of an aircraft without vanes or GPS: what an inferred angle or a free bias takes from their trust.

An angle of attack or sideslip inferred from wind and attitude is right in its changes and off by a slow error, as
large as the first step says. The slopes hardly feel it. The constant of an axis does: it takes up

    delta(C_0) = dC/d(angle) * delta(angle)

whatever the number of samples, which no residual shows. Its standard error is widened by that. And it belongs to an
angle of 0, where it is carried by dC/d(angle) from the angles that were flown: where that derivative is not to be used,
and those angles are further from 0 than one sigma of them, nor is the constant.

Nor are the changes right to the last: what an attitude lags or a wind is late by goes together with what the pilot
does. An eighth of dC/d(angle) times one sigma of the angle ends in each other term, in flights of a jet without a
sideslip vane. A parameter has HOLD where that, without the eighth, is above ``inferred_share`` (``thresholds``) of what
it moves the coefficient by on its own: a small one beside a large one, as the yaw of the ailerons.

Without GPS nothing but the attitude, where there is one, tells a bias of the IMU from a constant of an axis, and
standard errors know too little of it: constants have HOLD. So they have where several short manoeuvres each begin with
biases of their own.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.parameter_set import ParameterEstimate, ParameterSet
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.reconstruction.state import INFERRED, WITHOUT_GPS, StateField

Array = npt.NDArray[np.float64]

_NAMES = {"alpha": "angle of attack", "beta": "sideslip"}
_COLUMNS = {"alpha": StateField.ANGLE_OF_ATTACK, "beta": StateField.SIDESLIP}
_INFERRED = [code for code, angles in INFERRED.items() if angles]
_STEP = 1e-4  # [rad] of the derivative


class DoubtfulConstants:
    """What leaves a constant in doubt just now: angles without a vane and how well they are known, and free biases."""

    def __init__(self) -> None:
        self.angles: tuple[str, ...] = ()
        self.std = np.nan  # [rad]
        self._flown = {angle: (0, 0.0) for angle in _NAMES}  # rows in which they were inferred, and their sum [rad]
        self.without_gps, self.of_manoeuvres = False, False

    def note(self, rows: Array) -> None:
        """Take rows (n, StateField.WIDTH) in order of time; the newest counts that rests on air data."""
        row = next((row for row in rows[::-1] if row[StateField.STATUS] in INFERRED), None)
        if row is not None:
            self.without_gps = int(row[StateField.STATUS]) in WITHOUT_GPS
            self.angles = INFERRED[int(row[StateField.STATUS])]
            self.std = float(row[StateField.AIR_VELOCITY_STD] / max(row[StateField.AIRSPEED], 1e-3))
            flying = np.isin(rows[:, StateField.STATUS], _INFERRED)
            for angle, column in _COLUMNS.items():
                known = rows[flying, column]
                known, (count, total) = known[np.isfinite(known)], self._flown[angle]
                self._flown[angle] = count + len(known), total + float(known.sum())

    def _is_extrapolated(self, angle: str) -> bool:
        """Whether the angles that were flown are further from 0, in the mean, than one sigma of them."""
        count, total = self._flown[angle]
        return count > 0 and abs(total / count) > self.std

    @property
    def biases(self) -> str:
        """Why biases of the IMU are not known well enough for a constant; empty: they are."""
        if self.without_gps:
            return "without GPS"
        return "over several manoeuvres" if self.of_manoeuvres else ""

    def doubted(
        self, estimates: ParameterSet, model: AerodynamicModel, point: Array | None, noise: Array
    ) -> ParameterSet:
        """The parameters with what is doubtful of them; the same with GPS where all angles are measured.

        ``noise`` (parameters,): one sigma of each term while it was learnt from.
        """
        if why := self.biases:
            estimates = replace(estimates, parameters=tuple(_held_constant(p, why) for p in estimates.parameters))
        if not self.angles or point is None:
            return estimates
        signals = point[CoefficientSample.SIGNALS]
        parameters, covariance = list(estimates.parameters), estimates.covariance.copy()
        slopes = {angle: slopes_of_terms(model, np.nan_to_num(signals[None]), angle)[0] for angle in self.angles}
        for name in AXES:
            part = model.axis_slice(name)
            constants = [i for i in range(part.start, part.stop) if model.parameter_names[i].endswith("_0")]
            theta = np.array([parameters[i].value for i in range(part.start, part.stop)])
            of_angle = {angle: float(slopes[angle][part] @ theta) * self.std for angle in self.angles}
            extra = float(np.sqrt(sum(v * v for v in of_angle.values())))
            for i in constants if np.isfinite(extra) and extra > 0.0 else []:
                covariance[i, i] += extra**2
                angle = max(of_angle, key=lambda a: abs(of_angle[a]))
                parameters[i] = _judged(parameters[i], float(np.hypot(parameters[i].std, extra)), angle, self.std)
            places = {model.parameter_names[i]: i for i in range(part.start, part.stop)}
            own = {angle: places[label] for angle in self.angles if (label := f"{name}_{angle}") in places}
            for angle, place in own.items():
                parameters[part] = _not_beside(parameters, part, place, noise, angle)
        return self.carried(replace(estimates, parameters=tuple(parameters), covariance=covariance))

    def carried(self, estimates: ParameterSet) -> ParameterSet:
        """The parameters without constants that a derivative which is not to be used carries to an angle of 0."""
        parameters = {p.name: p for p in estimates.parameters}
        for angle, axis in itertools.product(self.angles, AXES):
            constant, slope = parameters.get(f"{axis}_0"), parameters.get(f"{axis}_{angle}")
            if constant is None or slope is None or constant.status != Trust.USE or slope.status == Trust.USE:
                continue
            if self._is_extrapolated(angle):
                why = f"is extrapolated to an {_NAMES[angle]} of 0 with {slope.name}, which is not known"
                parameters[constant.name] = replace(constant, status=Trust.HOLD, reason=why)
        return replace(estimates, parameters=tuple(parameters.values()))


def _held_constant(estimate: ParameterEstimate, why: str) -> ParameterEstimate:
    """A constant that a bias of the IMU may stand in, with HOLD; any other parameter as it is."""
    if not estimate.name.endswith("_0") or estimate.status != Trust.USE:
        return estimate
    return replace(estimate, status=Trust.HOLD, reason=f"{why} it may contain an IMU bias")


def slopes_of_terms(model: AerodynamicModel, rows: Array, angle: str) -> Array:
    """Derivatives (n, parameters) of all terms by an angle [1/rad] at signal rows (n, SIGNAL_COUNT), by central
    differences.
    """
    at, shifted = SIGNAL_INDEX[angle], np.concatenate([rows, rows])
    shifted[: len(rows), at] += _STEP
    shifted[len(rows) :, at] -= _STEP
    terms = model.steady_terms(shifted)
    return np.asarray((terms[: len(rows)] - terms[len(rows) :]) / (2.0 * _STEP))


def _not_beside(
    parameters: list[ParameterEstimate], part: slice, own: int, noise: Array, angle: str
) -> list[ParameterEstimate]:
    """Those of an axis, with HOLD where the error of an angle may stand in them; ``own``: its derivative."""
    excited = parameters[own].excitation
    true = 1.0 - 1.0 / max(excited, 1e-3) ** 2  # noise makes the derivative so much smaller
    whole = max(true, THRESHOLDS.inferred_motion)
    error = abs(parameters[own].value) / whole * noise[own]
    found = []
    for i in range(part.start, part.stop):
        p = parameters[i]
        moves = abs(p.value) * p.excitation * noise[i]
        in_doubt = i != own and p.status == Trust.USE and noise[i] > 0.0 and error > THRESHOLDS.inferred_share * moves
        found.append(replace(p, status=Trust.HOLD, reason=_rests_on(angle, noise[own])) if in_doubt else p)
    return found


def _rests_on(angle: str, std: float) -> str:
    return f"rests on the {_NAMES[angle]}, which no vane measures: inferred to {np.degrees(std):.1f} deg"


def _judged(estimate: ParameterEstimate, std: float, angle: str, angle_std: float) -> ParameterEstimate:
    """A constant with its wider standard error; HOLD where it is no longer known well enough."""
    if estimate.status != Trust.USE or std <= THRESHOLDS.relative_error * abs(estimate.value):
        return replace(estimate, std=std)
    return replace(estimate, std=std, status=Trust.HOLD, reason=_rests_on(angle, angle_std))
