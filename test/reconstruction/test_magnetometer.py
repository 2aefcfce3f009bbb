"""A magnetometer that nobody has calibrated is at odds with everything: it is rejected, and the rest is learnt from."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.frames import rotation_matrix
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of
from aircraft_sysid_ros.simulation.calibration_flight import calibration_flight


def test_what_an_uncalibrated_magnetometer_says_does_not_stop_the_rest() -> None:
    """Soft iron of a tenth: its own innovations are nine times too large, those of the others as they should be."""
    flight = calibration_flight(5, 60.0)
    aircraft, samples = flight.aircraft, flight.samples
    found, consistency = {}, {}
    for name, kept in (("with", samples), ("without", samples[samples.kind != Kind.MAGNETIC_FIELD])):
        state = StateEstimator(aircraft)
        found[name] = np.vstack([state.push(kept), state.flush()])
        consistency[name] = state.innovation_consistency()
    assert consistency["with"]["magnetic_field"] > 4.0 and "magnetic_field" not in consistency["without"]
    late = [rows[rows[:, StateField.TIME] > rows[0, StateField.TIME] + 30.0] for rows in found.values()]
    assert all(np.percentile(rows[:, StateField.CONSISTENCY], 99.0) < 2.0 for rows in late)
    assert late[0][-1, StateField.REJECTED] < 200 + late[1][-1, StateField.REJECTED]
    # and the bad heading does no harm that the others would not show: gyro biases to 0.06 deg/s
    bias = [rows[-1, StateField.GYRO_BIAS] for rows in late]
    assert np.abs(bias[0] - bias[1]).max() < 1e-3


def standing(force, field):
    """Ten seconds on the ground, 20 Hz: specific force and magnetic field (n, 3), or (3,), and GPS."""
    stamp = np.arange(0, 10 * 10**9, 10**9 // 20)
    ones = np.ones((len(stamp), 1))
    parts = [
        samples_of(Kind.GPS_POSITION, stamp, 0.8 * ones, 0.1 * ones, 100.0 * ones),
        samples_of(Kind.GPS_VELOCITY, stamp, 0.0 * ones * np.ones(3)),
        samples_of(Kind.MAGNETIC_FIELD, stamp, ones * np.asarray(field)),
        samples_of(Kind.IMU, stamp, ones * np.asarray(force), 0.0 * ones * np.ones(3)),
    ]
    samples = concatenate(parts)
    return samples[np.argsort(samples.stamp, kind="stable")]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("field", [(0.0, 0.0, 0.0), (0.0, 0.0, 0.5), (0.0, 0.02, -0.5)])
def test_a_field_without_a_horizontal_part_starts_nothing(field, aircraft) -> None:
    """Zeros of a driver without its sensor: each start had an attitude of no numbers, and the filter was lost again."""
    state = StateEstimator(aircraft)
    rows = np.vstack([state.push(standing((0.0, 0.0, -9.81), field)), state.flush()])
    assert not len(rows) and state.realignments == 0


@pytest.mark.filterwarnings("error")
def test_an_imu_that_gives_zeros_at_first_is_waited_for(aircraft) -> None:
    samples = standing((0.0, 0.0, -9.81), (0.0, -0.2, 0.4))
    asleep = (samples.kind == Kind.IMU) & (samples.stamp < 4 * 10**9)
    samples.values[asleep, :6] = 0.0
    state = StateEstimator(aircraft)
    rows = np.vstack([state.push(samples), state.flush()])
    assert state.realignments == 0
    assert rows[0, StateField.TIME] == pytest.approx(4.0, abs=1.0)
    east = rotation_matrix(rows[-1, StateField.ATTITUDE])[:, 0]
    assert np.degrees(np.arctan2(east[1], east[0])) == pytest.approx(90.0, abs=2.0)
