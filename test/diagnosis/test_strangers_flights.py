"""Flights of which the aircraft file knows mass and shape only: what is not in it must not become a fault."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.aircraft.signals import SIGNALS
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.flight.reconstruction import (
    as_flown,
    fit_sensor_noise,
    log_likelihood,
    reconstruct_as_flown,
    settled_flight,
)
from aircraft_sysid_ros.diagnosis.measurement.faults import jobs_of, try_setting
from aircraft_sysid_ros.diagnosis.measurement.imu_place import sideways_of_forces
from aircraft_sysid_ros.diagnosis.search.candidates import can_act
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import strangers

SCALES = [BY_ID["airspeed_scale"]]


@pytest.fixture(scope="module")
def centred(aircraft):
    return strangers.centred(aircraft)


def scale_of_airspeed(flight):
    """The scale of the airspeed that a reconstructed flight asks for."""
    (job,) = jobs_of(flight, SCALES, calm=True)
    return try_setting(job)


def walk_of(aircraft, samples):
    flown, calm = as_flown(aircraft, samples)
    assert calm
    return flown.process_noise["wind"]


@pytest.fixture(scope="module")
def other_maker(shared_data):
    """An aircraft file of mass and shape, and two minutes of a flight in steady wind of another maker."""
    folder = shared_data / "other_maker"
    samples = read_recording(folder / "clean_1").samples
    return load_aircraft(folder / "clean_1.yaml"), samples[samples.stamp < samples.stamp[0] + 120 * 10**9]


@pytest.mark.long
def test_in_steady_wind_no_scale_of_the_airspeed_is_a_calmer_atmosphere(other_maker):
    flight, calm = reconstruct_as_flown(*other_maker, with_covariance=False)
    assert calm
    assert scale_of_airspeed(flight).evidence < 1.0


@pytest.mark.long
def test_a_scale_that_is_there_is_still_found(other_maker):
    aircraft, samples = other_maker
    values = samples.values.copy()
    airspeed = samples.kind == Kind.AIRSPEED
    values[airspeed, 0] *= 0.9
    flight, _ = reconstruct_as_flown(aircraft, replace(samples, values=values), with_covariance=False)
    found = scale_of_airspeed(flight)
    assert found.evidence > 1.0
    assert found.value == pytest.approx(0.9, abs=0.02)


@pytest.mark.long
@pytest.mark.parametrize("walk", [0.0, 0.03])
def test_the_walk_of_the_wind_is_the_likeliest_below_that_of_the_file(centred, walk):
    samples = simulate_samples(centred, 3, 60.0, wind_walk=walk, manoeuvres="standard").samples
    file = strangers.users(centred)
    found, given = walk_of(file, samples), file.process_noise["wind"]
    assert found < 0.03 if walk == 0.0 else 0.01 < found < 0.1
    noisy = fit_sensor_noise(file, samples)
    walks = (found, given, found / 4.0)  # in a steady wind all small ones are nearly alike
    likelihoods = [log_likelihood(with_setting(noisy, ("process_noise", "wind"), w), samples) for w in walks]
    assert max(other.over(likelihoods[0]) for other in likelihoods) < 3.0
    assert likelihoods[0].over(likelihoods[1]) > 20.0


@pytest.mark.long
def test_a_file_that_knows_its_wind_is_left_alone(aircraft):
    samples = simulate_samples(aircraft, 4, 60.0, manoeuvres="standard").samples
    assert walk_of(aircraft, samples) == aircraft.process_noise["wind"]


@pytest.mark.parametrize(
    ("effect", "signal", "far", "near"),
    [("compressibility", "mach", 0.15, 0.5), ("ground_effect", "height", 60.0, 0.8)],
)
def test_an_effect_is_looked_for_where_it_can_act(aircraft, effect, signal, far, near):
    signals = np.ones((100, len(SIGNALS)))
    flight = FlightData(aircraft, np.arange(100.0), np.zeros((100, len(AXES))), signals, 0.04)
    for value, possible in ((far, False), (near, True), (np.nan, False)):
        signals[:, SIGNALS.index(signal)] = value
        assert can_act(BY_ID[effect], flight) is possible
    assert can_act(BY_ID["stall"], flight)


@pytest.mark.long
@pytest.mark.parametrize("effect", [None, "adverse_yaw", "p_factor", "stuck_control", "asymmetric_thrust"])
def test_gusts_put_no_imu_aside(effect):
    """All sensors are at the centre of gravity; errors of the angles of flow had looked like an IMU above it."""
    setting = strangers.drawn(770_000)
    known = load_aircraft(config_path(setting["aeroplane"] + ".yaml"))
    flown = strangers.flown(known, setting)
    hidden = [(effect, 1.0)] if effect else []
    samples = simulate_samples(flown, 770_000, 75.0, wind_walk=0.01, turbulence="light", hidden=hidden).samples
    flight, calm = reconstruct_as_flown(strangers.users(known), samples, with_covariance=False)
    assert not calm and sideways_of_forces(settled_flight(flight)) is None
