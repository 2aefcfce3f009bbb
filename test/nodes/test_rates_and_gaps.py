"""Rates and gaps of the diagnostics, by the stamps of the samples."""

import numpy as np

from aircraft_sysid_ros.nodes.sample_rates import SampleRates
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of

MILLISECOND = 1_000_000


def heard(rates, *stamps, kind=Kind.IMU):
    for stamp in stamps:
        rates.add([samples_of(kind, np.array([stamp * MILLISECOND]), np.zeros((1, 1)))])


def test_rate_and_gap_are_those_since_the_last_reading():
    rates = SampleRates()
    heard(rates, *range(1000, 2001, 10))
    heard(rates, *range(1000, 2001, 200), kind=Kind.GPS_POSITION)
    assert rates.read() == {
        "imu.rate": "100", "imu.largest_gap": "0.01", "gps_position.rate": "5", "gps_position.largest_gap": "0.2",
    }  # fmt: skip
    heard(rates, 2010, 2510, 2520)
    assert rates.read() == {"imu.rate": f"{3 / 0.52:.4g}", "imu.largest_gap": "0.5", "gps_position.rate": "0"}


def test_a_late_sample_counts_and_is_no_gap():
    rates = SampleRates()
    heard(rates, 1000, 1010, 1030, 1020, 1040)
    assert rates.read() == {"imu.rate": "100", "imu.largest_gap": "0.02"}


def test_samples_of_several_kinds_come_together():
    rates = SampleRates()
    for stamp in (1000, 1100, 1200):
        both = [
            samples_of(kind, np.array([stamp * MILLISECOND]), np.zeros((1, 1))) for kind in (Kind.AIR, Kind.AIRSPEED)
        ]
        rates.add([concatenate(both)])
    found = rates.read()
    assert (found["air.rate"], found["airspeed.rate"]) == ("10", "10")


def test_a_clock_that_begins_anew_is_no_gap():
    rates = SampleRates()
    heard(rates, 5000, 5010, 100, 110, 120)
    assert rates.read() == {"imu.rate": "100", "imu.largest_gap": "0.01"}
    assert rates.read() == {"imu.rate": "0"}
