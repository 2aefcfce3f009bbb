"""What is known now, with verdicts, made when it is asked for: a description is work, and seldom needed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT, SIGNAL_INDEX
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.doubtful_constants import DoubtfulConstants, slope_of
from aircraft_sysid_ros.identification.estimators.contract import AxisEstimate
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import RlsState, known_theta
from aircraft_sysid_ros.identification.parameter_set import ParameterEstimate, ParameterSet, axis_estimates
from aircraft_sysid_ros.identification.prior import AxisPrior
from aircraft_sysid_ros.identification.undescribed_sensors import ANGLES, OfSensors, SensorDoubt

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

    def of_sensors(self, axis: int) -> OfSensors | None:
        """What vanes do to an axis; those that are inferred have doubts of their own."""
        if self.sensors is None:
            return None
        own = self.own[axis]
        signals = np.zeros(SIGNAL_COUNT) if self.newest is None else self.newest[CoefficientSample.SIGNALS]
        theta = known_theta(self.model, axis, self.least_squares) if own is None else own.theta
        measured = [angle not in self.constants.angles for angle in ANGLES]
        known, model, name = np.nan_to_num(signals), self.model, AXES[axis]
        bent = [known.copy(), known.copy()]
        bent[0][SIGNAL_INDEX["alpha"]], bent[1][SIGNAL_INDEX["alpha"]] = 0.0, _BEND
        of_alpha = [slope_of(model, name, theta, at, "alpha") if measured[0] else 0.0 for at in bent]
        of_beta = slope_of(model, name, theta, known, "beta") if measured[1] else 0.0
        return self.sensors.of(model, axis, theta, (of_alpha[0], of_beta), (of_alpha[1] - of_alpha[0]) / _BEND)

    def __call__(self) -> ParameterSet:
        """The parameters, with standard errors corrected for coloured residuals and a verdict on each."""
        model, count = self.model, len(self.model.parameter_names)
        covariance = np.full((count, count), np.nan)
        estimates: list[ParameterEstimate] = []
        for axis, name in enumerate(AXES):
            part = model.axis_slice(name)
            of_axis, block = axis_estimates(
                model, axis, self.least_squares, self.time, self.missing[axis], self.own[axis], self.changed[axis],
                self.bounds, self.priors[axis], self.of_sensors(axis),
            )  # fmt: skip
            estimates.extend(of_axis)
            covariance[part, :] = covariance[:, part] = 0.0
            covariance[part, part] = block
        airspeed, alpha, beta = self.ranges
        found = ParameterSet(self.time, model.identifier, tuple(estimates), covariance, airspeed, alpha, beta)
        return self.constants.doubted(found, model, self.newest, np.sqrt(self.least_squares.noise_square))
