"""Frequency responses of a simulated flight: the roll rate follows the aileron as its roll mode says."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT, SIGNAL_INDEX
from aircraft_sysid_ros.commands.compare import _responses
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.frequency_responses import HIGHEST, rate_responses

EVERY = 16  # of the truth, at 400 Hz
#: Noise of the rates [rad/s], and of the deflections [rad].
NOISE = 0.01, 0.002


@pytest.fixture(scope="module")
def flown(aircraft, flight):
    """What a run would hold of the rates and the deflections of a flight of 120 s."""
    truth, random = flight.truth[::EVERY], np.random.default_rng(1)
    signals = np.full((len(truth), SIGNAL_COUNT), np.nan)
    lengths = np.array([aircraft.span / 2.0, aircraft.chord, aircraft.span / 2.0])
    rates = truth.rates + NOISE[0] * random.normal(size=truth.rates.shape)
    moved = truth.controls[:, :3] + NOISE[1] * random.normal(size=(len(truth), 3))
    columns = {"V": truth.airspeed, "qbar": 0.5 * truth.density * truth.airspeed**2, "time": truth.time}
    columns |= dict(zip("pqr", (rates * lengths / truth.airspeed[:, None]).T, strict=True))
    columns |= dict(zip(("de", "da", "dr"), moved.T, strict=True))
    for name, values in columns.items():
        signals[:, SIGNAL_INDEX[name]] = values
    return FlightData(aircraft, truth.time, truth.coefficients, signals, 0.04)


@pytest.fixture(scope="module")
def responses(flown):
    return {(each.rate, each.control): each for each in rate_responses(flown)}


@pytest.mark.long
def test_roll_rate_follows_the_aileron_as_the_roll_mode_does(flight, flown, responses):
    """p / da = L_da / (s - L_p), above the frequencies of the Dutch roll, from the coefficients that flew."""
    aircraft, found = flown.aircraft, responses["p", "da"]
    speed, pressure = np.mean(flown.signal("V")), np.mean(flown.signal("qbar"))
    truth = flight.coefficients
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
