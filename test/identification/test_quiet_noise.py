"""The noise of an IMU as a window over it has it: of any colour, whatever the file says, and beside motion."""

import numpy as np
import pytest

from aircraft_sysid_ros.estimation.window_average import window_average
from aircraft_sysid_ros.identification.monitoring.coefficient_noise import slope_variance
from aircraft_sysid_ros.identification.monitoring.quiet_noise import follow, in_use, new_quiet_noise
from aircraft_sysid_ros.reconstruction.state import StateField

HALF_WIDTH = 0.08


def shown(time, force, rates):
    noise, row = new_quiet_noise()[0], np.zeros(StateField.WIDTH)
    for k in range(len(time)):
        row[StateField.TIME] = time[k]
        row[StateField.SPECIFIC_FORCE], row[StateField.ANGULAR_VELOCITY] = force[k], rates[k]
        follow(row, HALF_WIDTH, noise)
    return np.sqrt(noise.variance)


@pytest.mark.parametrize("rate", [10.0, 25.0, 100.0])
def test_white_noise_is_found_in_a_flight_that_moves_for_a_third_of_the_time(rate):
    random, time = np.random.default_rng(1), np.arange(0.0, 120.0, 1.0 / rate)
    moves = (np.sin(2.0 * np.pi * time / 15.0) > 0.3)[:, None]
    motion = 0.3 * moves * np.sin(2.0 * np.pi * 1.2 * time)[:, None] * np.ones(3)
    force = 0.03 * random.normal(size=(len(time), 3)) + 10.0 * motion
    rates = 0.0009 * random.normal(size=(len(time), 3)) + motion
    found = shown(time, force, rates) / [0.03, 0.0009]
    assert np.all((found > 0.85) & (found < 1.4))  # of the blocks that rest, the quarter of all is not the quietest


def test_nothing_is_said_of_the_first_seconds():
    time = np.arange(0.0, 8.0, 0.01)
    assert np.isnan(shown(time, np.zeros((len(time), 3)), np.zeros((len(time), 3)))).all()


@pytest.mark.parametrize("width", [1, 4])
def test_slopes_of_smoothed_and_of_held_noise_are_as_it_says(width):
    """Of moving averages the differences between samples tell little; of samples that are held, too much."""
    random, rate, count = np.random.default_rng(2), 100.0, 12000
    white = random.normal(size=(count, 3))
    kernel = np.full(12, 1.0 / 12.0)
    smooth = np.column_stack([np.convolve(white[:, i], kernel, "same") for i in range(3)])
    held = white[width * (np.arange(count) // width)]
    time = np.arange(count) / rate
    for values in (smooth, held):
        said = shown(time, values, values)[1] * np.sqrt(slope_variance(1.0 / rate, HALF_WIDTH))
        means, slopes, found = np.empty(3), np.empty(3), []
        for at in range(20, count - 20, 7):
            window_average(time, values, at - 9, at + 9, time[at] + 0.003, HALF_WIDTH, means, slopes, False)
            found.append(slopes.copy())
        assert said == pytest.approx(np.std(found), rel=0.25)


def test_what_is_said_stands_where_the_flight_does_not_deny_it_and_more_where_samples_differ_by_more():
    assert in_use(4.0, 0.0, np.nan) == in_use(4.0, 0.0, 9.0) == 4.0
    assert in_use(4.0, 0.0, 1.0) == 1.0
    assert in_use(4.0, 3.0, 1.0) == 12.0
    assert in_use(4.0, 0.0, 1e-9) == pytest.approx(4.0 * 0.2**2)  # what rounds its values seems to have no noise
