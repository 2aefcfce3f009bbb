"""Estimators by name."""

from __future__ import annotations

from collections.abc import Callable

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.modelling.fourier_learner import FourierLearner
from aircraft_sysid_ros.modelling.learner import Learner, ParameterOptions
from aircraft_sysid_ros.modelling.likelihood_learner import LikelihoodLearner

#: Recursive least squares always runs, since it also measures the coefficients; the parameters that are published come
#: from the learner that is chosen.
LEARNERS: dict[str, Callable[[Aircraft, ParameterOptions], Learner] | None] = {
    "rls": None,
    "fourier": FourierLearner,
    "rml": LikelihoodLearner,
}


def make_learner(aircraft: Aircraft, options: ParameterOptions) -> Learner | None:
    """The learner of ``options.estimator``; None is recursive least squares. Raises InputError for other names."""
    if options.estimator not in LEARNERS:
        raise InputError(f"the estimator must be one of {', '.join(LEARNERS)}, not '{options.estimator}'")
    make = LEARNERS[options.estimator]
    return None if make is None else make(aircraft, options)
