"""A clock that starts over in flight: little is lost, and how samples come together changes nothing."""

from itertools import pairwise

import numpy as np
import pytest

from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.estimators.likelihood_state import BEGUN
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.monitoring.hold import Restore
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.ordering import flown_twice
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

DURATION, LEAP = 34.0, 20.0  # [s]


@pytest.fixture(scope="module")
def flight():
    return default_aircraft(), simulate_samples(default_aircraft(), 3, DURATION).samples


def leapt(samples: Samples, back: float) -> Samples:
    """The same samples, by a clock that goes back by ``back`` [s] in flight."""
    later = samples.stamp > samples.stamp[0] + int(LEAP * 1e9)
    return Samples(samples.stamp - later * int(back * 1e9), samples.kind, samples.values)


def blocks(samples: Samples, size: int):
    edges = [*range(0, len(samples), size), len(samples)]
    return [samples[low:high] for low, high in pairwise(edges)]


def replayed(aircraft, samples, size):
    pipeline = Pipeline(aircraft)
    points = [pipeline.push(block)[1] for block in blocks(samples, size)]
    return pipeline, np.vstack([*points, pipeline.flush()[1]])


@pytest.mark.long
@pytest.mark.parametrize("back", [20.0, -3600.0, *(pytest.param(back, marks=pytest.mark.long) for back in (3.0, 1e6))])
def test_blocks_of_any_size_give_the_same(flight, back) -> None:
    aircraft, samples = flight[0], leapt(flight[1], back)
    pipeline, expected = replayed(aircraft, samples, 100)
    assert pipeline.state.order.counts.restarts == 1
    steps = np.diff(expected[:, CoefficientSample.TIME])
    assert sum((steps < 0.0) | (steps > 100.0)) == 1
    for size in (1999, len(samples)):
        assert np.array_equal(replayed(aircraft, samples, size)[1], expected, equal_nan=True)


@pytest.mark.long
def test_all_but_two_seconds_are_learnt_from(flight) -> None:
    """Half a window at the end, the first fixes and half a window at the beginning."""
    aircraft, samples = flight
    without, _ = replayed(aircraft, samples, 500)
    with_leap, points = replayed(aircraft, leapt(samples, 20.0), 500)
    lost = (
        without.parameters.learning.least_squares.state.updates
        - with_leap.parameters.learning.least_squares.state.updates
    )
    assert np.all(lost >= 0) and np.all(lost <= 2.0 / aircraft_step(points))
    assert with_leap.parameters.late == 0


def aircraft_step(points) -> float:
    return float(np.median(np.diff(points[:, CoefficientSample.TIME])))


@pytest.mark.long
@pytest.mark.parametrize("back", [20.0, -3600.0, -1e8])
def test_as_nodes_hear_it(flight, back) -> None:
    """Controls come at once, states when their horizon has passed; nobody tells of the restart but the states.

    A clock that was set forward by years asked for more memory than there is.
    """
    aircraft, samples = flight[0], leapt(flight[1], back)
    expected, _ = replayed(aircraft, samples, 500)
    state, parameters = StateEstimator(aircraft), Identifier(aircraft)
    for block in blocks(samples, 7):
        parameters.push_samples(block, state.epoch)
        for row in state.push(block):
            parameters.push_states(row[None], state.epoch)
    parameters.push_states(state.flush(), state.epoch)
    parameters.flush()
    found, wanted = parameters.snapshot().parameters, expected.parameters.snapshot().parameters
    assert [(p.value, p.std, p.status) for p in found] == [(p.value, p.std, p.status) for p in wanted]


@pytest.mark.parametrize("estimator", ["rls", "fourier", "rml"])
def test_the_age_of_what_was_learnt_goes_on_where_the_clock_goes_back(flight, estimator) -> None:
    """Of what was not learnt again it was that of the old clock, and so negative: minus an hour."""
    aircraft, samples = flight[0], leapt(flight[1], 3600.0)
    pipeline = Pipeline(aircraft, parameter_options=ParameterOptions(estimator=estimator))
    later = samples.stamp < samples.stamp[0]
    pipeline.push(samples[~later])
    pipeline.parameters.change_options(ParameterOptions(estimator=estimator, excitation=100.0))  # nothing moves as much
    pipeline.push(samples[later])
    pipeline.flush()
    age = np.array([p.age for p in pipeline.parameters.snapshot().parameters])
    assert np.all((age > -1.0) & (age < DURATION))
    assert np.max(age) > DURATION - LEAP - 2.0 or estimator == "rml"  # which learns on from less


@pytest.mark.parametrize("estimator", ["rls", "fourier", "rml"])
def test_what_goes_back_to_before_the_clock_did_is_by_the_new_one(flight, estimator) -> None:
    """An axis was held when the clock went back: its age was minus an hour."""
    aircraft, samples = flight[0], leapt(flight[1], 3600.0)
    pipeline = Pipeline(aircraft, parameter_options=ParameterOptions(estimator=estimator))
    later = np.flatnonzero(samples.stamp < samples.stamp[0])
    pipeline.push(samples[: later[0]])
    learning = pipeline.parameters.learning
    good, middle = learning._checkpoint(LEAP, LEAP), int(np.median(later))
    pipeline.push(samples[later[0] : middle])
    learning._restore([Restore(axis, good) for axis in range(6)])
    before, old = learning.estimator.estimate(2).samples, ages(pipeline)
    assert np.all((old > -1.0) & (old < DURATION) | np.isnan(old))
    pipeline.push(samples[middle:])
    pipeline.flush()
    if estimator == "rml":  # which knows nothing yet
        assert learning.estimator.recursion.clock[BEGUN] > 5.0
    else:
        assert learning.estimator.estimate(2).samples > before
    assert np.all((ages(pipeline) > -1.0) & (ages(pipeline) < DURATION)) and np.min(ages(pipeline)) < 2.0


def ages(pipeline):
    return np.array([p.age for p in pipeline.parameters.estimates().parameters])


@pytest.mark.long
def test_a_late_sample_is_no_restart(flight) -> None:
    """One control sample far behind the others is dropped and counted; the rest goes on."""
    aircraft, samples = flight
    stamp = samples.stamp.copy()
    controls = np.flatnonzero(samples.kind == Kind.CONTROLS)
    one = controls[len(controls) // 2]
    stamp[one] -= int(20e9)
    pipeline, _ = replayed(aircraft, Samples(stamp, samples.kind, samples.values), 500)
    without, _ = replayed(aircraft, samples, 500)
    assert (pipeline.state.order.counts.restarts, pipeline.parameters.late) == (0, 1)
    assert np.array_equal(
        pipeline.parameters.learning.least_squares.state.updates,
        without.parameters.learning.least_squares.state.updates,
    )


@pytest.mark.parametrize(("back", "twice"), [(3.0, 3.0), (20.0, DURATION - LEAP), (1000.0, 0.0), (-3600.0, 0.0)])
def test_times_that_two_parts_of_a_flight_have_are_counted(flight, back, twice) -> None:
    """Two flights of one recording that were by the same clock were mixed, and nothing was said."""
    samples = leapt(flight[1], back)
    assert flown_twice(samples) == pytest.approx(twice, abs=0.1)
    stamp = samples.stamp.copy()
    imu = np.flatnonzero(samples.kind == Kind.IMU)
    stamp[imu[[500, 2500]]] += int(1e12)  # wrong stamps are no clock
    assert flown_twice(Samples(stamp, samples.kind, samples.values)) == pytest.approx(twice, abs=0.1)
