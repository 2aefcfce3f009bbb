"""Height above ground: by the aircraft file, by where the aeroplane stood, and else by nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.diagnosis.cannot_show import out_of_reach
from aircraft_sysid_ros.diagnosis.compare import compare
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct, settled_flight
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.identification.coefficients.ground import Ground, altitudes, ground_of
from aircraft_sysid_ros.reconstruction.state import StateField


@pytest.fixture
def unknown(aircraft):
    """An aeroplane whose file does not say where the ground is."""
    return replace(aircraft, ground_altitude=None)


def states(speed, altitude, step=0.1, climb=0.0):
    """States with these airspeeds, which are those over ground, and altitudes."""
    speed, altitude = np.broadcast_arrays(np.asarray(speed, dtype=float), altitude)
    rows = np.zeros((len(speed), StateField.WIDTH))
    rows[:, StateField.TIME] = step * np.arange(len(speed))
    rows[:, StateField.AIRSPEED] = rows[:, StateField.VELOCITY.start] = speed
    rows[:, StateField.VELOCITY.start + 2] = -climb
    rows[:, StateField.ORIGIN.stop - 1], rows[:, StateField.POSITION.stop - 1] = 300.0, 300.0 - altitude
    return rows


def test_a_flight_that_stays_in_the_air_has_no_height(unknown, aircraft):
    rows = states(np.full(600, 20.0), 400.0 + 10.0 * np.sin(np.arange(600) / 50.0))
    np.testing.assert_allclose(altitudes(rows)[0], 400.0)
    assert np.isnan(ground_of(unknown, rows)) and np.isnan(Ground(unknown).below(rows)).all()
    assert ground_of(aircraft, rows) == aircraft.ground_altitude
    top = states(np.abs(np.linspace(-20.0, 20.0, 40)), 430.0)  # slow for 1.2 s at the top of a climb
    assert (top[:, StateField.AIRSPEED] < unknown.minimum_airspeed).any() and np.isnan(ground_of(unknown, top))
    assert np.isnan(ground_of(unknown, states(np.full(100, 1.0), 400.0, climb=-3.0)))  # it sinks


def test_the_ground_is_where_it_stood_however_the_states_come(unknown):
    speed = np.concatenate([np.zeros(50), np.linspace(0.0, 20.0, 50), np.full(200, 20.0), np.zeros(80)])
    altitude = np.concatenate([np.full(50, 350.0), np.linspace(350.0, 400.0, 250), np.full(80, 349.0)])
    rows = states(speed, altitude)
    whole = Ground(unknown).below(rows)
    assert np.isnan(whole[:20]).all() and (whole[21:320] == 350.0).all() and whole[-1] == 349.0
    for size in (1, 7, 64):
        ground = Ground(unknown)
        parts = [ground.below(rows[k : k + size]) for k in range(0, len(rows), size)]
        np.testing.assert_array_equal(np.concatenate(parts), whole)


@pytest.mark.long
def test_nothing_rests_on_a_height_that_nothing_tells(flight, aircraft):
    """A flight 290 m above the ground had failed "below a height of 0.7 m", and ground effect was tried in it."""
    content = {key: value for key, value in aircraft.source.items() if key != "ground_altitude"}
    content["model"] = {**aircraft.model.terms, "CZ": [*aircraft.model.terms["CZ"], "height"]}
    samples = flight.samples[flight.samples.stamp < flight.samples.stamp.min() + 60 * 10**9]
    data = settled_flight(reconstruct(aircraft_from_dict(content), samples, with_covariance=False))
    assert np.isnan(data.signal("height")).all()
    found = compare(data)
    assert "needs height, which is not measured: record it, or give ground_altitude" in found.reasons["CZ"]
    assert set(found.axes) == {"CX", "CY", "Cl", "Cm", "Cn"}
    assert not any("height" in place.conditions for place in found.worst)
    (unseen,) = out_of_reach(CandidateEvaluator(data), [BY_ID["ground_effect"]], samples, True)
    assert unseen.why == "the height of the ground is not known: set ground_altitude in the aircraft file"
