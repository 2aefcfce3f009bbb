"""A recording of a simulated flight: readable by anybody, the same as in memory, the truth beside it."""

import json

import numpy as np
import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.hidden_effects import hidden_effect
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import load_truth, true_values, truth_document, truth_path, write_flight


@pytest.fixture(scope="module")
def flown(aircraft):
    options = SensorOptions(attitude=True, magnetometer=True, five_hole_probe=True, height_above_ground=True)
    return simulate_samples(aircraft, 7, 20.0, sensors=options)


@pytest.fixture(scope="module")
def bag(flown, tmp_path_factory):
    path = tmp_path_factory.mktemp("flight") / "bag"
    write_flight(flown, path)
    return path


def test_reading_the_recording_gives_the_samples_of_memory(flown, bag):
    read = read_recording(bag).samples
    np.testing.assert_array_equal(read.stamp, flown.samples.stamp)
    np.testing.assert_array_equal(read.kind, flown.samples.kind)
    np.testing.assert_allclose(read.values, flown.samples.values, rtol=1e-6, atol=1e-12)  # Range holds float32


def test_others_read_the_recording_with_the_truth_in_its_folder(flown, bag):
    from rosbags.highlevel import AnyReader

    with AnyReader([bag]) as reader:
        assert reader.message_count == sum(len(stream.stamp) for stream in flown.streams)
        times = [time for _, time, _ in reader.messages()]
    arrivals = np.sort(np.concatenate([stream.arrival for stream in flown.streams]))
    np.testing.assert_array_equal(times, arrivals)


def test_truth_is_beside_the_recording(flown, bag, aircraft):
    document, series = load_truth(bag)
    assert document["coefficients"] == aircraft.coefficients
    assert document["accelerometer_bias"] == flown.biases.accelerometer[-1].tolist()
    assert document["wind_ned"] == flown.truth.wind[-1].tolist()
    assert document["seed"] == 7
    truth = flown.truth.at((series["stamp"] - series["stamp"][0]) / 1e9)
    np.testing.assert_allclose(series["velocity"], truth.velocity, atol=1e-6)
    np.testing.assert_allclose(np.diff(series["time"]), 0.02, atol=1e-9)
    assert series["gyro_bias"].shape == series["position"].shape
    assert min(stream.stamp[0] for stream in flown.streams) == series["stamp"][0]


def test_the_truth_states_terms_that_were_asked_for(aircraft):
    more = (Effect("CZ", "alpha", -1.0), Effect("CZ", "alpha ** 3", -5.0))
    values = true_values(truth_document(simulate_samples(aircraft, 7, 20.0, effects=more, rate=100.0)))
    assert values["CZ_alpha"] == aircraft.coefficients["CZ_alpha"] - 1.0
    assert values["CZ_alpha3"] == -5.0
    assert values["CZ_q"] == aircraft.coefficients["CZ_q"]


@pytest.mark.parametrize("name", ["mass_change", "cg_shift", "wind_change", "air_data_lag", "actuator_lag"])
def test_the_truth_states_the_size_of_what_is_no_term(aircraft, name):
    effect = hidden_effect(name, 1.0, 3, 100.0, aircraft, aircraft.coefficients)
    stated = json.loads(json.dumps(effect.document()))
    assert stated["mass_factor"] == effect.mass_factor
    assert (*stated["cg_shift"], *stated["gust"]) == (*effect.cg_shift, *effect.gust)
    lags = ("air_data_lag", "command_lag", "command_dead_time")
    assert [stated[lag] for lag in lags] == [getattr(effect, lag) for lag in lags]


def test_truth_of_a_bare_file_is_beside_it(flown, tmp_path):
    path = tmp_path / "flight.mcap"
    write_flight(flown, path)
    assert json.loads((tmp_path / "flight.truth.json").read_text())["seed"] == 7
    assert load_truth(path)[1]["time"][0] == 0.0


def test_a_recording_without_truth_says_so(tmp_path):
    with pytest.raises(InputError, match="no truth beside it"):
        load_truth(tmp_path)


def test_a_recording_is_not_overwritten_unless_asked(flown, bag):
    with pytest.raises(InputError, match="already there"):
        write_flight(flown, bag)
    write_flight(flown, bag, overwrite=True)
    assert truth_path(bag, ".npz").exists()
