"""A slow error of an attitude leaves tilt, heading, wind and bias of the accelerometer in doubt, smoothed or not."""

import numpy as np
from aircraft_files import of_shape

from aircraft_sysid_ros.aircraft.frames import quaternion_exp, quaternion_product
from aircraft_sysid_ros.reconstruction.smoother_history import SmootherHistory
from aircraft_sysid_ros.reconstruction.state import D_ACCELEROMETER_BIAS, D_AIR_VELOCITY, D_ATTITUDE, StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

SLOW = 0.02  # [rad]
D_WIND = D_AIR_VELOCITY  # of standard deviations in a row


def with_slow_error(samples: Samples) -> Samples:
    values, time = samples.values.copy(), (samples.stamp - samples.stamp[0]) * 1e-9
    for i in np.flatnonzero(samples.kind == Kind.ATTITUDE):
        error = SLOW * np.array([np.sin(time[i] / 6.0), np.sin(time[i] / 5.0 + 1.0), np.sin(time[i] / 4.0 + 2.0)])
        values[i, :4] = quaternion_product(values[i, :4], quaternion_exp(error))
    return Samples(samples.stamp, samples.kind, values)


def test_smoothing_does_not_take_away_the_doubt_of_a_drifting_attitude(aircraft) -> None:
    """With ``--smooth`` the bias of the accelerometer was known ten times too well, and so were C_X,0 and C_Y,0."""
    flight = simulate_samples(aircraft, 3, 30.0, sensors=SensorOptions(attitude=True))
    with SmootherHistory() as tape:
        estimator = StateEstimator(of_shape(aircraft), None, tape)
        estimator.push(with_slow_error(flight.samples))
        estimator.flush()
        roll, pitch, _ = estimator.attitude_doubt
        std = estimator.smooth()[:, StateField.STANDARD_DEVIATIONS]
        assert min(roll, pitch) > 0.1 * SLOW
        assert (std[:, D_ATTITUDE] > roll).all() and (std[:, D_ATTITUDE + 1] > pitch).all()
        assert (std[:, D_ACCELEROMETER_BIAS] > 9.8 * pitch).all()
        assert (std[:, D_ACCELEROMETER_BIAS + 1] > 9.8 * roll).all()
        assert (std[:, D_ACCELEROMETER_BIAS + 2] < 9.8 * min(roll, pitch)).any()
        rows, heading = estimator.tape.rows, estimator.attitude_doubt[2]
        assert heading > 0.1 * SLOW and (std[:, D_ATTITUDE + 2] > heading).all()
        assert (np.hypot(std[:, D_WIND], std[:, D_WIND + 1]) > 0.9 * heading * rows[:, StateField.AIRSPEED]).all()
        assert (std[:, D_WIND + 2] > 0.5 * pitch * rows[:, StateField.AIRSPEED]).all()


def test_the_doubt_is_that_of_each_flight(aircraft) -> None:
    """Of flights that are smoothed together the first one lost it where the last one had no attitude."""
    flight = simulate_samples(aircraft, 3, 20.0, sensors=SensorOptions(attitude=True))
    without = flight.samples[flight.samples.kind != Kind.ATTITUDE]
    with SmootherHistory() as tape:
        estimator = StateEstimator(of_shape(aircraft), None, tape)
        count = len(estimator.push(with_slow_error(flight.samples)))
        roll, pitch, _ = estimator.attitude_doubt
        count += len(estimator.begin_anew(np.nan))
        estimator.push(without[without.stamp < without.stamp[0] + 8 * 10**9])
        estimator.flush()
        std = estimator.smooth()[:, StateField.STANDARD_DEVIATIONS]
        assert (std[:count, D_ATTITUDE + 1] > pitch).all() and (std[:count, D_ACCELEROMETER_BIAS] > 9.8 * pitch).all()
        assert (std[:count, D_ATTITUDE] > roll).all() and (std[:count, D_ACCELEROMETER_BIAS + 1] > 9.8 * roll).all()
