"""What is known now, with verdicts, made when it is asked for: a description is work, and seldom needed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT, SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.doubtful_constants import DoubtfulConstants, slopes_of_terms
from aircraft_sysid_ros.identification.estimators.contract import AxisEstimate
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import RlsState, known_theta
from aircraft_sysid_ros.identification.parameter_set import ParameterEstimate, ParameterSet, axis_estimates
from aircraft_sysid_ros.identification.prior import AxisPrior
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.undescribed.doubt import OfSensors, SensorDoubt
from aircraft_sysid_ros.identification.undescribed.vanes import ANGLES

Array = npt.NDArray[np.float64]


#: Angle of attack [rad] by which the derivative by it is asked whether it grows.
_BEND = 0.1


class Description(NamedTuple):
    """All that a ``ParameterSet`` is made of: copies, or what does not change until it is made."""

    model: AerodynamicModel
    time: float  # [s]
    newest: Array | None  # newest sample
    least_squares: RlsState
    own: list[AxisEstimate | None]  # of each axis, where another estimator than least squares is published
    missing: list[str]  # what each axis lacks, in words
    changed: list[float]  # [s] of flight of the newest change of each axis
    constants: DoubtfulConstants
    ranges: list[tuple[float, float]]  # learnt between these V, alpha, beta
    bounds: Mapping[str, tuple[float, float]]  # of the aircraft file
    priors: list[AxisPrior | None]  # what earlier flights say of each axis
    sensors: SensorDoubt | None = None  # of which nobody said how they are

    def values(self) -> Array:
        """The values alone (parameters,), NaN where nothing is known."""
        own = (None if known is None else known.theta for known in self.own)
        return np.concatenate(
            [
                known_theta(self.model, axis, self.least_squares) if theta is None else theta
                for axis, theta in enumerate(own)
            ]
        )

    def of_sensors(self) -> list[OfSensors | None]:
        """What vanes do to each axis; those that are inferred have doubts of their own."""
        if self.sensors is None:
            return [None] * len(AXES)
        model, found = self.model, list[OfSensors | None]()
        signals = np.zeros(SIGNAL_COUNT) if self.newest is None else self.newest[CoefficientSample.SIGNALS]
        known = np.nan_to_num(signals[None])
        bent = np.concatenate([known, known])
        bent[:, SIGNAL_INDEX["alpha"]] = 0.0, _BEND
        rows = {"alpha": bent, "beta": known}
        slopes = {a: slopes_of_terms(model, rows[a], a) for a in ANGLES if a not in self.constants.angles}
        for axis, name in enumerate(AXES):
            own, part = self.own[axis], model.axis_slice(name)
            theta = known_theta(model, axis, self.least_squares) if own is None else own.theta
            straight, steep = (slopes["alpha"][:, part] @ theta).tolist() if "alpha" in slopes else (0.0, 0.0)
            of_beta = float(slopes["beta"][0, part] @ theta) if "beta" in slopes else 0.0
            found.append(self.sensors.of(model, axis, theta, (straight, of_beta), (steep - straight) / _BEND))
        return found

    def std_of_sensors(self, surfaces_as_found: bool) -> Array:
        """One sigma (parameters,) of what sensors that nobody described do to each parameter of who takes vanes as they
        are, and surfaces, too, or ``surfaces_as_found``: as late as the flight shows; 0 where all are described.
        """
        if self.sensors is None:
            return np.zeros(len(self.model.parameter_names))
        left = self.of_sensors()
        moved = self._replace(sensors=self.sensors._replace(late=())).of_sensors() if surfaces_as_found else left
        pairs = [(a, b) for a, b in zip(left, moved, strict=True) if a is not None and b is not None]
        squares = np.concatenate([np.diag(a.covariance) + np.diag(b.found) for a, b in pairs])
        return np.asarray(np.sqrt(np.maximum(squares, 0.0)))

    def shared_variance(self) -> Array:
        """What sensors that nobody described leave in doubt of each parameter at all times of a flight alike
        (parameters,): they do not change in it. Of what they do another motion shows a share anew, as
        ``correction`` of the thresholds says.
        """
        if self.sensors is None or self.sensors.is_new:
            return np.zeros(len(self.model.parameter_names))
        left = (np.zeros(0) if found is None else np.diag(found.covariance) for found in self.of_sensors())
        return (1.0 - THRESHOLDS.correction**2) * np.concatenate([*left])

    def __call__(self) -> ParameterSet:
        """The parameters, with standard errors corrected for coloured residuals and a verdict on each."""
        model, count = self.model, len(self.model.parameter_names)
        covariance = np.full((count, count), np.nan)
        estimates: list[ParameterEstimate] = []
        of_sensors = self.of_sensors()
        for axis, name in enumerate(AXES):
            part = model.axis_slice(name)
            of_axis, block = axis_estimates(
                model, axis, self.least_squares, self.time, self.missing[axis], self.own[axis], self.changed[axis],
                self.bounds, self.priors[axis], of_sensors[axis],
            )  # fmt: skip
            estimates.extend(of_axis)
            covariance[part, :] = covariance[:, part] = 0.0
            covariance[part, part] = block
        airspeed, alpha, beta = self.ranges
        found = ParameterSet(self.time, model.identifier, tuple(estimates), covariance, airspeed, alpha, beta)
        return self.constants.doubted(found, model, self.newest, np.sqrt(self.least_squares.noise_square))
