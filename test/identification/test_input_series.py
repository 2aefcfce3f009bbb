"""Named inputs in the second step: each is a series of its own, however messages are put together."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.aircraft.named_inputs import INPUT_UNITS
from aircraft_sysid_ros.identification.coefficients.controls import INPUT_HELD, ControlHistory
from aircraft_sysid_ros.identification.flight_memory import SampleMemory
from aircraft_sysid_ros.identification.model_change import change_model, with_terms
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.ros_messages.conversion import input_fields, to_samples
from aircraft_sysid_ros.samples import Kind, concatenate
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

SETTLE = 0.2


@pytest.fixture(scope="module")
def named(aircraft):
    return aircraft_from_dict({**aircraft.source, "inputs": {"tab": {"unit": "deg"}, "spoiler": None, "engine": None}})


def history_of(named, batches):
    history = ControlHistory(named, SETTLE)
    history.add(concatenate(batches), 0)
    return history


def at(history, times):
    rows = np.zeros((len(times), StateField.WIDTH))
    rows[:, StateField.TIME] = times
    return history.at(rows, False)[0][:, 7:]


def message(named, time, **values):
    fields = input_fields(tuple(values), np.array([list(values.values())], dtype=float))
    return to_samples("inputs", np.array([round(time * 1e9)]), fields, named.inputs)[0]


def test_units_limits_and_strange_messages(named):
    stamp = np.array([1, 2, 3, 4, 5])
    names, positions = np.empty(5, object), np.empty(5, object)
    names[:] = [["tab", "flag"], ["spoiler"], ["tab", "spoiler"], [], ["tab"]]
    positions[:] = [[90.0, 7.0], [1.7], [1.0], [], [np.nan]]  # too many names for a position; a spoiler beyond 1.6 rad
    (samples,) = to_samples("inputs", stamp, {"name": names, "position": positions}, named.inputs)
    assert samples.stamp.tolist() == [1] and samples.kind.tolist() == [Kind.INPUTS]
    np.testing.assert_allclose(samples.values[0, :3], [np.pi / 2.0, np.nan, np.nan])


@pytest.mark.parametrize("values", [{"flag": 1.0}, {}, {"tab": np.nan}, {"spoiler": 1.7}])
def test_a_message_that_holds_no_input_gives_no_samples(named, values):
    """It gave a batch of none, for which a node ended in flight."""
    fields = input_fields(tuple(values), np.array([list(values.values())], dtype=float).reshape(1, -1))
    assert to_samples("inputs", np.array([1]), fields, named.inputs) == []


def test_many_messages_are_read_as_one_by_one(named):
    values = np.random.default_rng(1).normal(0.0, 0.3, (20, 2))
    stamps = np.arange(20)
    (together,) = to_samples("inputs", stamps, input_fields(("spoiler", "tab"), values), named.inputs)
    alone = [to_samples("inputs", stamps[i : i + 1], input_fields(("spoiler", "tab"), values[i : i + 1]), named.inputs)
             for i in range(20)]  # fmt: skip
    np.testing.assert_array_equal(together.values, concatenate([part for parts in alone for part in parts]).values)


def test_messages_may_hold_some_of_the_inputs_only(named):
    """Three inputs that take turns: each is what it would be alone."""
    times = np.arange(0.0, 6.0, 0.02)
    true = {"tab": np.sin(times) * 20.0, "spoiler": np.cos(2.0 * times), "engine": 0.1 * times}
    turns = [{name: true[name][i]} for i in range(len(times)) for name in [list(true)[i % 3]]]
    mixed = [message(named, t, **values) for t, values in zip(times, turns, strict=True)]
    asked = np.arange(0.5, 5.0, 0.013)
    together = history_of(named, mixed)
    found = []
    for part in np.array_split(asked, 7):  # what has been used is forgotten on the way
        found.append(at(together, part))
        together.forget_before(part[-1])
    for k, name in enumerate(true):
        alone = history_of(named, mixed[k::3])
        np.testing.assert_array_equal(np.vstack(found)[:, k], at(alone, asked)[:, k])
        unit = np.radians(1.0) if name == "tab" else 1.0
        np.testing.assert_allclose(np.vstack(found)[:, k], unit * np.interp(asked, times, true[name]), atol=2e-3)


def test_a_value_holds_for_a_second_and_no_longer(named):
    history = history_of(named, [message(named, 1.0, tab=3.0), message(named, 9.0, tab=5.0)])
    found = at(history, np.array([0.5, 1.0, 1.0 + INPUT_HELD, 1.001 + INPUT_HELD, 8.9, 9.0]))
    np.testing.assert_allclose(np.degrees(found[:, 0]), [np.nan, 3.0, 3.0, np.nan, np.nan, 5.0])
    assert np.isnan(found[:, 1:]).all()


@pytest.mark.parametrize("unit", INPUT_UNITS)
def test_every_unit_comes_back_from_a_simulated_recording(aircraft, unit):
    named = aircraft_from_dict({**aircraft.source, "inputs": {"other": {"unit": unit}}})
    flight = simulate_samples(named, seed=1, duration=20.0)
    samples = flight.samples[flight.samples.kind == Kind.INPUTS]
    seconds = (samples.stamp - flight.streams[0].stamp[0]) * 1e-9 + flight.truth.time[0]
    late = flight.truth.at(seconds - seconds[0] + (flight.truth.time[-1] - (seconds[-1] - seconds[0])))
    noise = named.inputs[0].noise
    assert np.std(samples.values[:, 0]) > 5.0 * noise
    assert np.std(samples.values[:, 0] - late.inputs[:, 0]) < 3.0 * noise


@pytest.mark.long
def test_blocks_of_any_size_give_the_same(aircraft):
    source = {**aircraft.source, "inputs": {"tab": None}}
    flight = simulate_samples(aircraft_from_dict(source), 2, 20.0, effects=[Effect("Cm", "tab", -0.3)])
    model = {"Cm": [*aircraft.model.terms["Cm"], "tab"]}
    knowing = aircraft_from_dict({**source, "model": model})
    results = []
    for block in (7, 1000):
        pipeline = Pipeline(knowing)
        parts = [pipeline.push(flight.samples[i : i + block])[1] for i in range(0, len(flight.samples), block)]
        results.append(np.vstack([*parts, pipeline.flush()[1]]))
    np.testing.assert_array_equal(*results)
    assert np.isfinite(results[0][:, 25:]).any()


@pytest.mark.long
def test_a_term_of_an_input_that_is_added_in_flight_is_known_at_once(aircraft):
    source = {**aircraft.source, "inputs": {"tab": None}}
    flight = simulate_samples(aircraft_from_dict(source), 4, 40.0, effects=[Effect("Cm", "tab", -0.3)])
    pipeline, memory, half = Pipeline(flight.aircraft), SampleMemory(), len(flight.samples) // 2
    memory.add(pipeline.push(flight.samples[:half])[1], np.zeros(3), 0.1)
    estimator = pipeline.parameters
    change_model(estimator, with_terms(estimator.aircraft, {"Cm": ("tab",)}, {}), memory.newest())
    values = []
    for part in (flight.samples[half : half + 1], flight.samples[half + 1 :]):
        pipeline.push(part)
        (found,) = [p for p in estimator.snapshot().parameters if p.name == "Cm_tab"]
        assert abs(found.value + 0.3) < 3.0 * found.std < 0.15
        values.append(found)
    assert values[1].std < values[0].std
