"""Setups of the filter as in flight, for tests of its measurements."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.reconstruction.filter_setup import gate_thresholds, new_setup
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.state import Setup
from aircraft_sysid_ros.samples import WIDTH


def setup_of(aircraft: Aircraft) -> Setup:
    """The setup of a flight somewhere, whose IMU carries no variances."""
    options, origin = StateOptions(), np.array([0.8, -1.5, 300.0])
    return new_setup(aircraft, options, gate_thresholds(options.gate), origin, np.full(WIDTH, np.nan))
