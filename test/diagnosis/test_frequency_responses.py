"""Frequency responses of a simulated flight: the roll rate follows the aileron as its roll mode says."""

import numpy as np
import pytest

from aircraft_sysid_ros.commands.compare import _responses
from aircraft_sysid_ros.diagnosis.flight.flight_data import load_flight_data
from aircraft_sysid_ros.diagnosis.frequency_responses import HIGHEST, rate_responses


@pytest.fixture(scope="module")
def flight(hidden_run):
    return load_flight_data(hidden_run)


@pytest.fixture(scope="module")
def responses(flight):
    return {(each.rate, each.control): each for each in rate_responses(flight)}


def test_roll_rate_follows_the_aileron_as_the_roll_mode_does(flight, responses):
    """p / da = L_da / (s - L_p), above the frequencies of the Dutch roll, from the coefficients that flew."""
    aircraft, found = flight.aircraft, responses["p", "da"]
    speed, pressure = np.nanmean(flight.signal("V")), np.nanmean(flight.signal("qbar"))
    truth = aircraft.coefficients
    scale = pressure * aircraft.wing_area * aircraft.span / aircraft.inertia[0, 0]
    damping = scale * truth["Cl_p"] * aircraft.span / (2.0 * speed)
    inside = (found.frequency > 1.2) & (found.frequency < 2.5) & (found.coherence > 0.9)
    assert inside.sum() > 6
    expected = scale * truth["Cl_da"] / (2j * np.pi * found.frequency[inside] - damping)
    ratio = found.response[inside] / expected
    assert abs(np.median(np.abs(ratio)) - 1.0) < 0.15 and abs(np.median(np.angle(ratio))) < 0.25


def test_what_is_said_is_where_it_is_coherent(responses):
    assert set(responses) == {("p", "da"), ("p", "dr"), ("q", "de"), ("r", "da"), ("r", "dr")}
    for each in responses.values():
        assert each.frequency[0] == pytest.approx(0.2) and each.frequency[-1] <= HIGHEST
        if each.band is not None:
            within = (each.frequency >= each.band[0]) & (each.frequency <= each.band[1])
            assert (each.coherence[within] >= 0.6).all()
    low, high = responses["q", "de"].band
    assert low < 1.0 < 1.5 < high
    lines = _responses([each.json for each in responses.values()])
    assert any("q to de: " in line and " ± " in line and "coherence" in line for line in lines)
    assert _responses([]) == []
