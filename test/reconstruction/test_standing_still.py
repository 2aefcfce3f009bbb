"""Air data that repeat one number while the aeroplane moves are no air data."""

import numpy as np
import pytest

from aircraft_sysid_ros.reconstruction.state import StateField, Status
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.reconstruction.stuck_sensors import STILL_TIME, StuckSensors
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

BEGIN, END = 20.0, 30.0  # [s]


@pytest.fixture(scope="module")
def flight():
    return simulate_samples(default_aircraft(), 5, 40.0, turbulence="light").samples


def window(samples: Samples, kind: Kind, begin: float = BEGIN, end: float = END):
    time = (samples.stamp - samples.stamp[0]) * 1e-9
    return np.flatnonzero((samples.kind == kind) & (time >= begin) & (time < end))


def frozen(samples: Samples, kind: Kind) -> Samples:
    at, values = window(samples, kind), samples.values.copy()
    values[at, 0] = values[at[0], 0]
    return Samples(samples.stamp, samples.kind, values)


def filtered(samples: Samples, size: int) -> np.ndarray:
    still = StuckSensors(8.0)
    return np.vstack([still.without(samples[i : i + size]).values for i in range(0, len(samples), size)])


@pytest.mark.long
@pytest.mark.parametrize(
    "kind", [Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, pytest.param(Kind.SIDESLIP, marks=pytest.mark.long)]
)
def test_what_stands_still_is_dropped_after_its_time_until_it_moves(flight, kind) -> None:
    samples = frozen(flight, kind)
    values = filtered(samples, len(samples))
    at = window(samples, kind)
    time = (samples.stamp[at] - samples.stamp[at[0]]) * 1e-9
    assert np.array_equal(np.isnan(values[at, 0]), time > STILL_TIME)
    untouched = np.ones(len(samples), bool)
    untouched[at] = False
    assert np.array_equal(values[untouched], samples.values[untouched], equal_nan=True)
    for size in (1, 77, 5000):
        assert np.array_equal(filtered(samples, size), values, equal_nan=True)


@pytest.mark.parametrize("lost", ["not there", "invalid"])
def test_a_vane_that_stands_still_is_dropped_where_nobody_measures_the_airspeed(flight, lost) -> None:
    """As in a flight with --calm-air, or after the pitot failed: it was believed."""
    samples = frozen(flight, Kind.ANGLE_OF_ATTACK)
    samples.values[samples.kind == Kind.AIRSPEED, 0] = np.nan
    if lost == "not there":
        samples = samples[samples.kind != Kind.AIRSPEED]
    at = window(samples, Kind.ANGLE_OF_ATTACK)
    time = (samples.stamp[at] - samples.stamp[at[0]]) * 1e-9
    assert np.array_equal(np.isnan(filtered(samples, 1000)[at, 0]), time > STILL_TIME)


def test_a_sound_flight_is_left_alone(flight) -> None:
    assert np.array_equal(filtered(flight, 1000), flight.values, equal_nan=True)


def test_without_motion_one_number_may_be_right(flight) -> None:
    samples = frozen(flight, Kind.AIRSPEED)
    values = samples.values.copy()
    imu = samples.kind == Kind.IMU
    values[imu, :3] = [0.0, 0.0, -9.81]
    calm = Samples(samples.stamp, samples.kind, values)
    assert np.array_equal(filtered(calm, 1000), values, equal_nan=True)


def test_on_the_ground_airspeed_may_stand_at_zero(flight) -> None:
    samples, values = flight, flight.values.copy()
    values[samples.kind == Kind.AIRSPEED, 0] = 0.0
    still = Samples(samples.stamp, samples.kind, values)
    assert np.array_equal(filtered(still, 1000), values, equal_nan=True)


def test_the_state_says_that_it_does_without(flight) -> None:
    """Wind explains a frozen airspeed; silence it cannot explain."""
    estimator = StateEstimator(default_aircraft())
    rows = np.vstack([estimator.push(frozen(flight, Kind.AIRSPEED)), estimator.flush()])
    time = rows[:, StateField.TIME] - rows[0, StateField.TIME]
    during = rows[(time > BEGIN + STILL_TIME + 3.0) & (time < END - 1.0), StateField.STATUS]
    after = rows[time > END + 2.0, StateField.STATUS]
    assert np.all(during == Status.NO_AIR_DATA) and np.all(after == Status.OK)
