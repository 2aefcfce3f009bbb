"""One short calibration flight with all instruments wrong, and its truth."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.calibration_flight import CALIBRATION_AIRCRAFT, calibration_flight


@pytest.fixture(scope="session")
def calibration_aircraft():
    """The aeroplane, with IMU biases that do not walk, as (B5) of the two-stage paper has them."""
    source = load_aircraft(config_path(CALIBRATION_AIRCRAFT)).source
    walks = {**source["process_noise"], "accelerometer_bias": 0.0, "gyro_bias": 0.0}
    return aircraft_from_dict({**source, "process_noise": walks})


@pytest.fixture(scope="session")
def calibration_flown(calibration_aircraft):
    """200 s: every manoeuvre somewhat shorter than nominal."""
    wind = np.array([4.0, -5.0, 0.3])
    return calibration_flight(3, 200.0, aircraft=calibration_aircraft, wind=wind, sensors=SensorOptions(attitude=True))


@pytest.fixture(scope="session")
def probe_made(calibration_flown):
    """The flight as data for the probe."""
    from aircraft_sysid_ros.calibration.five_hole_probe import probe_flight

    return probe_flight(calibration_flown.samples, calibration_flown.aircraft)


@pytest.fixture(scope="session")
def probe_answer(probe_made):
    """Its answer, from few samples."""
    return probe_made.solve(64)
