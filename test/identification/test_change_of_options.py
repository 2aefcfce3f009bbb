"""Options that change in flight: from then on, whatever the blocks, and only where an estimator can go on."""

from dataclasses import fields, replace

import numpy as np
import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.layout import WEIGHT_COLUMNS, CoefficientSample
from aircraft_sysid_ros.identification.estimators.by_name import ESTIMATORS
from aircraft_sysid_ros.identification.options import STRUCTURE, ParameterOptions
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

CHANGED = {"excitation": 100.0, "settle": 0.3, "largest_gap": 0.005, "error_window": 5.0}


@pytest.fixture(scope="module")
def short(aircraft):
    return simulate_samples(aircraft, seed=2, duration=28.0)


def flown(flight, name, changed, block=500, at=0.5, lost=0.0):
    """Parameters after a flight in which options changed at a share ``at`` of its samples.

    lost: how long [s] the IMU was silent, later.
    """
    options = ParameterOptions(estimator=name)
    seconds = 1e-9 * (flight.samples.stamp - flight.samples.stamp.min())
    kept = (flight.samples.kind != Kind.IMU) | (np.abs(seconds - 0.7 * seconds.max()) >= 0.5 * lost)
    samples, half = flight.samples[kept], int(at * len(flight.samples))
    pipeline = Pipeline(flight.aircraft, None, options)
    for part in (samples[:half], samples[half:]):
        for i in range(0, len(part), block):
            pipeline.push(part[i : i + block])
        pipeline.parameters.change_options(replace(options, **changed))
    pipeline.flush()
    found = pipeline.parameters.estimates().parameters
    return np.array([[p.value, p.std] for p in found])


@pytest.mark.long
@pytest.mark.parametrize("name", ["rls", "fourier", pytest.param("rml", marks=pytest.mark.long)])
def test_blocks_of_any_size_give_the_same_and_not_what_was_without_the_change(short, aircraft, name):
    if name == "rml":  # gives its first values after half a minute
        short = simulate_samples(aircraft, seed=2, duration=44.0)
    changed, lost = CHANGED | {"forgetting_time": 4.0}, 0.0
    if name == "fourier":  # these surfaces move by more than 100 sigma, and it goes on over 0.1 s in any case
        changed, lost = CHANGED | {"largest_gap": 1.0}, 0.2
    expected = flown(short, name, changed, lost=lost)
    assert np.array_equal(flown(short, name, changed, block=37, lost=lost), expected, equal_nan=True)
    without = flown(short, name, {}, lost=lost)
    assert not np.array_equal(without, expected, equal_nan=True) and np.isfinite(expected).any()


@pytest.mark.long
def test_a_shorter_memory_is_less_sure(short):
    std = {seconds: flown(short, "rls", {"forgetting_time": seconds})[:, 1] for seconds in (120.0, 4.0)}
    assert np.median(std[4.0] / std[120.0]) > 1.2


@pytest.mark.parametrize("name", ESTIMATORS)
def test_what_an_estimator_is_made_of_cannot_change(short, name):
    options = ParameterOptions(estimator=name)
    parameters = Pipeline(short.aircraft, None, options).parameters
    fixed = STRUCTURE + (("forgetting_time",) if name == "fourier" else ())
    for field in fields(ParameterOptions):
        value = getattr(options, field.name)
        if field.name == "estimator":
            other = "rml" if name == "rls" else "rls"
        else:
            other = (not value) if isinstance(value, bool) else 1.5 * value
        wanted = replace(options, **{field.name: other})
        if field.name in fixed:
            with pytest.raises(InputError, match=f"{field.name} cannot change"):
                parameters.change_options(wanted)
            assert parameters.options == options
        else:
            parameters.change_options(wanted)
            assert parameters.options == wanted
            parameters.change_options(options)


def test_the_error_window_keeps_what_it_has_and_grows(short):
    parameters = Pipeline(short.aircraft).parameters
    history, step = parameters.learning.history, parameters.options.step

    def add(first, last):
        samples = np.zeros((last - first, parameters.learning.columns))
        samples[:, CoefficientSample.TIME] = step * np.arange(first, last)
        history.add(samples, np.zeros((len(samples), WEIGHT_COLUMNS)), np.zeros((len(samples), 6)))

    add(0, 400)
    parameters.change_options(replace(parameters.options, error_window=4.0))
    assert history.newest()[:, CoefficientSample.TIME] == pytest.approx(step * np.arange(300, 400))
    parameters.change_options(replace(parameters.options, error_window=8.0))
    add(400, 550)
    assert history.newest()[:, CoefficientSample.TIME] == pytest.approx(step * np.arange(350, 550))


@pytest.mark.long
def test_a_gate_that_opens_in_flight_lets_pass_what_was_rejected(short):
    def rejected(gate):
        pipeline = Pipeline(short.aircraft, StateOptions(gate=2.0))
        half = len(short.samples) // 2
        pipeline.push(short.samples[:half])
        pipeline.state.change_options(StateOptions(gate=gate))
        pipeline.push(short.samples[half:])
        return sum(counts["rejected"] for counts in pipeline.state.counts().values())

    assert rejected(100.0) < 0.7 * rejected(2.0)


def test_errors_of_the_air_data_cannot_become_states_in_flight(short):
    with pytest.raises(ValueError, match="air_data_errors and calm_air"):
        Pipeline(short.aircraft).state.change_options(StateOptions(air_data_errors=True))
