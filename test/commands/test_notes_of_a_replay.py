"""What `replay` says of a recording that an aircraft file of mass and shape does not fit."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.after_flight import replay_notes
from aircraft_sysid_ros.after_flight.replay_notes import late_control_notes, length_notes, mass_notes, thrust_notes
from aircraft_sysid_ros.aircraft.aerodynamic_model import model_from_terms
from aircraft_sysid_ros.samples import Kind, samples_of


def controls(throttle, thrust):
    columns = np.full((50, 7), np.nan)
    columns[:, 4], columns[:, 5] = throttle, thrust
    return samples_of(Kind.CONTROLS, np.arange(50), columns)


def test_the_throttle_is_offered_where_a_thrust_is_read_and_not_measured(aircraft):
    (note,) = thrust_notes(controls(0.6, np.nan), aircraft)
    text = note.split("of the aircraft file ")[1].split(" uses the throttle")[0]
    axis, terms = text.split(": ")
    model = model_from_terms({**aircraft.model.terms, axis: terms.strip("[]").split(", ")})
    assert {"CX_throttle/qbar", "CX_throttle/V"} <= {*model.parameter_names} and "CX_Tc" not in model.parameter_names


def test_a_recorded_mass_that_is_not_the_file_s_is_told_with_the_inertia_that_stays(aircraft):
    """Moments were 10 % too large with standard errors of 1 %, and pounds for kilograms were taken without a word."""
    masses = np.full((50, 8), np.nan)
    masses[:, 0] = 0.9 * aircraft.mass
    (note,) = mass_notes(samples_of(Kind.MASS, np.arange(50), masses), aircraft)
    assert f"{0.9 * aircraft.mass:.4g} kg" in note and "inertia of the file" in note
    masses[:, 1:5] = 0.1, 0.1, 0.1, 0.0
    (note,) = mass_notes(samples_of(Kind.MASS, np.arange(50), masses), aircraft)
    assert "inertia" not in note
    masses[:, 0] = 1.01 * aircraft.mass
    assert mass_notes(samples_of(Kind.MASS, np.arange(50), masses), aircraft) == []


def test_controls_that_were_late_are_told():
    """A replay lost a fifth of them without a word."""
    samples = samples_of(Kind.CONTROLS, np.arange(50), np.zeros((50, 7)))
    (note,) = late_control_notes(samples, SimpleNamespace(late=10))
    assert "20 %" in note and "late" in note
    assert late_control_notes(samples, SimpleNamespace(late=0)) == []


@pytest.mark.parametrize(("throttle", "thrust"), [(0.6, 4.0), (np.nan, np.nan), (0.0, np.nan)])
def test_nothing_is_offered_where_thrust_is_measured_or_nothing_stands_for_it(throttle, thrust, aircraft):
    assert thrust_notes(controls(throttle, thrust), aircraft) == []


@pytest.mark.parametrize(("noise", "shakes"), [(0.1, False), (1.65, True)])
def test_an_imu_that_vibrates_is_named_where_angles_of_flow_are_not_told(noise, shakes, monkeypatch):
    """It hid them as gusts do in a stranger's calm flight, and calmer air was advised."""
    found = [
        SimpleNamespace(name="gyro", in_use=np.array([3.0])),
        SimpleNamespace(name="accelerometer", in_use=[noise]),
    ]
    monkeypatch.setattr(replay_notes, "found_noise", lambda state: found)
    sensors = [SimpleNamespace(usable=frozenset({Kind.AIRSPEED, Kind.GPS_VELOCITY}))]
    pipeline = SimpleNamespace(state=SimpleNamespace(flight_time=300.0, sensors=sensors))
    (note,) = length_notes(pipeline, SimpleNamespace(point_times=np.arange(0.0, 9.0, 0.1)))
    assert note.startswith("wind and attitude give the flow angles for only 9 s of this flight")
    assert ("vibrates by 1.7 m/s^2" in note or "vibrates by 1.6 m/s^2" in note) is shakes
