"""Slow drifts of the air data that the aircraft file knows of: with them the flight is that of sound sensors."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.diagnosis.flight.reconstruction import log_likelihood
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.reconstruction.drift import Drift
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, joined
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

RATES = {"airspeed": -0.002, "angle_of_attack": 0.002, "sideslip": -0.0015}
KINDS = {"airspeed": Kind.AIRSPEED, "angle_of_attack": Kind.ANGLE_OF_ATTACK, "sideslip": Kind.SIDESLIP}


@pytest.fixture(scope="module")
def knowing(aircraft):
    """The file of one who knows the drifts."""
    for name, rate in RATES.items():
        aircraft = with_setting(aircraft, ("sensors", name, "drift"), rate)
    return aircraft


@pytest.fixture(scope="module")
def sound(aircraft):
    return simulate_samples(aircraft, 8, 40.0, turbulence="light").samples


def first_state(aircraft, samples):
    """Time [s] and stamp [ns] of the first state."""
    estimator = StateEstimator(aircraft)
    rows = np.vstack([estimator.push(samples), estimator.flush()])
    return estimator, rows


def drifted(samples, since):
    """Samples as drifting sensors show them, from a stamp [ns] on."""
    values, time = samples.values.copy(), np.maximum((samples.stamp - since) * 1e-9, 0.0)
    for name, rate in RATES.items():
        chosen = samples.kind == KINDS[name]
        if name == "airspeed":
            values[chosen, 0] *= 1.0 + rate * time[chosen]
        else:
            values[chosen, 0] += rate * time[chosen]
    return replace(samples, values=values)


@pytest.fixture(scope="module")
def flown(aircraft, sound):
    """Rows of the sound flight, and its samples as drifting sensors show them, whose delay is that of the file."""
    estimator, rows = first_state(aircraft, sound)
    delays = {aircraft.sensors[name].delay for name in RATES}
    assert delays == {0.0} or len(delays) == 1
    since = estimator.epoch + round(1e9 * (rows[0, StateField.TIME] + delays.pop()))
    return rows, drifted(sound, since)


@pytest.mark.long
def test_with_the_right_drifts_the_states_are_those_of_sound_sensors(aircraft, knowing, flown):
    rows, samples = flown
    estimator, found = first_state(knowing, samples)
    assert estimator.drift.since == found[0, StateField.TIME]
    np.testing.assert_allclose(found, rows, rtol=1e-6, atol=1e-6, equal_nan=True)
    _, ignorant = first_state(aircraft, samples)
    assert np.abs(ignorant - rows)[-100:, StateField.ANGLE_OF_ATTACK].max() > 0.01


def second_step(aircraft, samples, size):
    """Samples of the coefficients, fed in blocks as a node or replay does."""
    state, parameters, found = StateEstimator(aircraft), Identifier(aircraft), []
    for begin in range(0, len(samples), size):
        block = samples[begin : begin + size]
        rows = state.push(block)
        parameters.push_samples(block, state.epoch)
        found.append(parameters.push_states(rows, state.epoch))
    rows = state.flush()
    return np.vstack([*found, parameters.push_states(rows, state.epoch), parameters.flush()])


@pytest.mark.long
def test_the_second_step_takes_them_off_the_vanes_too(aircraft, knowing, sound, flown):
    """In gusts the angles of the regressors are those of the vanes."""
    whole = second_step(aircraft, sound, len(sound))
    np.testing.assert_allclose(second_step(knowing, flown[1], len(sound)), whole, rtol=1e-5, atol=1e-6, equal_nan=True)
    assert not np.allclose(second_step(aircraft, flown[1], len(sound)), whole, rtol=1e-3, atol=1e-4, equal_nan=True)


@pytest.mark.long
def test_every_block_size_gives_the_same_bits(knowing, flown):
    whole = second_step(knowing, flown[1], len(flown[1]))
    np.testing.assert_array_equal(second_step(knowing, flown[1], 37), whole)


def test_another_flight_begins_without_a_drift_and_a_manoeuvre_of_the_same_one_does_not(knowing, sound):
    part = sound[sound.stamp < sound.stamp.min() + 8 * 10**9]
    for later, kept in ((600, True), (86_400, False)):
        estimator = StateEstimator(knowing)
        body, _ = joined([part, replace(part, stamp=part.stamp + later * 10**9)])
        rows = np.vstack([estimator.push(body), estimator.flush()])
        second = rows[np.argmax(np.diff(rows[:, StateField.TIME])) + 1, StateField.TIME]
        assert estimator.drift.since == (rows[0, StateField.TIME] if kept else second)


def test_a_likelihood_counts_the_numbers_that_a_drift_makes_smaller(aircraft, knowing, flown):
    """Of a density p(V) that of V (1 + d t) is p / (1 + d t): without it a larger scale would always win."""
    rows, samples = flown
    drift = Drift(knowing)
    assert drift.mean_logarithm == 0.0 and drift.since is None
    estimator, _ = first_state(knowing, samples)
    length = rows[-1, StateField.TIME] - rows[0, StateField.TIME]
    mean = np.mean(np.log1p(RATES["airspeed"] * np.linspace(0.0, length, 10_000)))
    assert estimator.drift.mean_logarithm == pytest.approx(mean, rel=0.01)
    better = (
        log_likelihood(knowing, samples).parts[Kind.AIRSPEED] - log_likelihood(aircraft, samples).parts[Kind.AIRSPEED]
    )
    assert better > 0.0


def test_without_a_drift_nothing_is_touched(aircraft, sound):
    drift = Drift(aircraft)
    drift.note_states(np.array([3.0]), -np.inf)
    times = sound.stamp * 1e-9
    assert drift.without(times, sound.kind, sound.values) is sound.values


def test_what_a_file_may_not_say_is_refused(aircraft):
    for sensor, value, words in (("gyro", 1e-4, "has no drift"), ("airspeed", 0.5, "must be between -0.01 and 0.01")):
        source = {**aircraft.source, "sensors": {**aircraft.source["sensors"], sensor: {"drift": value}}}
        with pytest.raises(InputError, match=words):
            aircraft_from_dict(source)
