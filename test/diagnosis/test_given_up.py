"""What the filter itself found to be wrong is no evidence of a missing effect."""

import numpy as np

from aircraft_sysid_ros.diagnosis.flight.reconstruction import given_up
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.reconstruction.state import StateField


def rows_of(time, rejected):
    rows = np.ones((len(time), StateField.WIDTH))
    rows[:, StateField.TIME], rows[:, StateField.REJECTED] = time, rejected
    return rows


TIME = np.concatenate([np.arange(0.0, 40.0, 0.01), np.arange(41.0, 60.0, 0.01)])


def test_a_state_whose_gps_was_rejected_until_it_began_anew_is_left_out_before() -> None:
    rejected = np.where(TIME > 35.0, 10.0 * np.minimum(TIME - 35.0, 5.0), 0.0)
    ((begin, end),) = given_up(rows_of(TIME, rejected))
    assert (begin, end) == (TIME[TIME < 40.5][-1] - THRESHOLDS.wrong_for, TIME[TIME < 40.5][-1])


def test_a_gap_alone_is_not_and_rejections_alone_are_not() -> None:
    assert given_up(rows_of(TIME, np.zeros(len(TIME)))) == []
    whole = np.arange(0.0, 60.0, 0.01)
    assert given_up(rows_of(whole, 10.0 * whole)) == []
    early = np.where(TIME < 20.0, 10.0 * TIME, 200.0)  # long before the gap
    assert given_up(rows_of(TIME, early)) == []


def test_a_clock_that_goes_back_is_no_gap() -> None:
    time = np.concatenate([np.arange(50.0, 60.0, 0.01), np.arange(0.0, 20.0, 0.01)])
    assert given_up(rows_of(time, 100.0 * np.arange(len(time)))) == []
