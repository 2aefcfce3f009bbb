"""A magnetometer that nobody has calibrated is at odds with everything: it is rejected, and the rest is learnt from."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind
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
