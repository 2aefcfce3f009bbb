"""Setups of the filter as in flight, for tests of its measurements."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.reconstruction.state import Setup
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import WIDTH


def setup_of(aircraft: Aircraft) -> Setup:
    """The setup of a flight somewhere, whose IMU carries no variances."""
    estimator = StateEstimator(aircraft)
    estimator._alignment.origin = np.array([0.8, -1.5, 300.0])
    return estimator._new_setup(np.full(WIDTH, np.nan))
