"""Estimators by name."""

from __future__ import annotations

from collections.abc import Callable

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.estimators.contract import Estimator
from aircraft_sysid_ros.identification.estimators.fourier import FourierEstimator
from aircraft_sysid_ros.identification.estimators.maximum_likelihood import MaximumLikelihoodEstimator
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import RecursiveLeastSquares
from aircraft_sysid_ros.identification.options import EstimatorName, ParameterOptions

#: Whose parameters are published, ``auto`` as it begins (``choice``).
ESTIMATORS: dict[EstimatorName, Callable[[Aircraft, ParameterOptions], Estimator]] = {
    "auto": RecursiveLeastSquares,
    "rls": RecursiveLeastSquares,
    "fourier": FourierEstimator,
    "rml": MaximumLikelihoodEstimator,
}


def make_estimator(
    aircraft: Aircraft, options: ParameterOptions, least_squares: RecursiveLeastSquares | None = None
) -> Estimator:
    """The estimator of ``options.estimator``; that of ``least_squares``, which always runs, is not made twice."""
    make = ESTIMATORS[options.estimator]
    return least_squares if least_squares is not None and make is RecursiveLeastSquares else make(aircraft, options)
