"""Epochs put in between those that are far apart."""

import numpy as np
import pytest

from aircraft_sysid_ros.flight_model.layout import INPUT_SIZE, REFERENCE
from aircraft_sysid_ros.identification.estimators.dense_epochs import STEP, DenseEpochs
from aircraft_sysid_ros.identification.estimators.likelihood_state import ImuEpochs
from aircraft_sysid_ros.reconstruction.state import StateField


def test_epochs_close_together_among_sparse_ones_stay_as_they_are():
    """Of an IMU that loses half of its samples now and then two come at once."""
    time = np.array([0.0, 0.1, 0.2, 0.2 + 0.3 * STEP, 0.3, 0.4, 0.5])
    count = len(time)
    inputs, rows = np.zeros((count, INPUT_SIZE)), np.zeros((count, StateField.WIDTH))
    inputs[:, REFERENCE], rows[:, StateField.ATTITUDE] = [1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    history = time[:, None].copy()
    epochs = ImuEpochs(time, time, np.ones(count, np.bool_), np.zeros((count, 6)), inputs, rows, history)
    found = DenseEpochs().add(epochs, 0.2)
    assert set(time[:-1]) <= set(found.time)  # the last waits for the next
    assert np.all(np.diff(found.time) > 0.0) and np.diff(found.time).max() < 1.5 * STEP
    assert found.history[:, 0] == pytest.approx(found.time)
