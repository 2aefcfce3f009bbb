"""What wheels do just after and just before standing is no evidence of anything in the air."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.after_flight.replay_notes import landing_notes
from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.flight.wheels import off_wheels
from aircraft_sysid_ros.diagnosis.search.fit import fit_axis
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.recordings.manoeuvres import Body
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of

STEP = 0.04


def flown(aircraft, knots, slow=()):
    """C_m of alpha, q and de; ``knots``: times and airspeeds over the least one; ``slow`` spans have no points."""
    time = np.arange(0.0, knots[-1][0], STEP)
    speed = aircraft.minimum_airspeed * np.interp(time, *zip(*knots, strict=True))
    keep = np.all([(time < a) | (time > b) for a, b in slow], axis=0) if slow else np.ones(len(time), bool)
    time, speed = time[keep], speed[keep]
    random = np.random.default_rng(3)
    signals = np.full((len(time), len(SIGNALS)), np.nan)
    for name, size in {"alpha": 0.05, "q": 0.004, "de": 0.1}.items():
        signals[:, SIGNAL_INDEX[name]] = size * random.normal(size=len(time))
    signals[:, SIGNAL_INDEX["V"]] = speed
    signals[:, SIGNAL_INDEX["qbar"]] = 0.6 * speed**2
    measured = np.full((len(time), 6), np.nan)
    terms = [signals[:, SIGNAL_INDEX[name]] for name in ("alpha", "q", "de")]
    noise = 0.001 * random.normal(size=len(time))
    measured[:, AXES.index("Cm")] = 0.02 - 0.6 * terms[0] - 9.0 * terms[1] - 1.1 * terms[2] + noise
    return FlightData(aircraft, time - time[0], measured, signals, STEP)


def without(flight, keep):
    return replace(
        flight, time=flight.time[keep], measured=flight.measured[keep], signals=flight.signals[keep], rolled=1.0
    )


def test_a_touchdown_is_left_out_and_the_flight_is_not(aircraft):
    """A landing in which wheels turn it a hundred times as hard as the air: derivatives come out right without it."""
    flight = flown(aircraft, [(0, 2.5), (150, 1.9), (160, 1.0)])
    rolling = flight.time > 151.0
    flight.measured[rolling, AXES.index("Cm")] += np.random.default_rng(1).normal(size=rolling.sum())
    keep = off_wheels(flight)
    assert not keep[rolling].any()
    assert keep[flight.time < flight.time[-1] - THRESHOLDS.rolling].all()
    fit = fit_axis(without(flight, keep), "Cm")
    assert fit.fit.parameters == pytest.approx([0.02, -0.6, -9.0, -1.1], rel=0.05)
    assert fit_axis(flight, "Cm").nrmse_fit > 5.0 * fit.nrmse_fit
    assert without(flight, keep).notes and not flight.notes


@pytest.mark.parametrize(
    ("knots", "slow"),
    [
        ([(0, 2.5), (160, 1.8)], ()),  # it begins and ends in the air
        ([(0, 2.5), (70, 1.0), (75, 1.0), (160, 2.5)], ((71.0, 74.0),)),  # a stall slower than the least airspeed
        ([(0, 1.05), (30, 1.1)], ()),  # a flight that would have nothing left
    ],
)
def test_what_begins_and_ends_in_the_air_loses_nothing(aircraft, knots, slow):
    assert off_wheels(flown(aircraft, knots, slow)).all()


def test_both_sides_of_a_landing_between_two_flights_are_left_out(aircraft):
    flight = flown(aircraft, [(0, 2.5), (100, 1.9), (110, 1.0), (150, 1.0), (160, 2.0), (260, 2.5)], ((110.0, 150.0),))
    left = flight.time[~off_wheels(flight)]
    assert left.min() == pytest.approx(110.0 - THRESHOLDS.rolling, abs=0.1)
    assert left.max() == pytest.approx(150.0 + THRESHOLDS.rolling, abs=0.1)


def recorded(aircraft, speed_over_least):
    """Airspeed at 10 Hz and one sample of the IMU at the start, as a body of data."""
    speed = np.asarray(speed_over_least) * aircraft.minimum_airspeed
    imu = samples_of(Kind.IMU, 0, np.zeros((1, 6)))
    airspeed = samples_of(Kind.AIRSPEED, np.arange(len(speed)) * 100_000_000, speed)
    return Body(SimpleNamespace(samples=concatenate([imu, airspeed])))


def test_replay_says_which_part_of_a_recording_was_in_the_air(aircraft):
    stands, flies = np.zeros(100), np.full(2000, 2.0)
    (note,) = landing_notes(recorded(aircraft, np.concatenate([stands, flies, stands])), aircraft)
    assert "start: 30, stop: 190" in note
    (note,) = landing_notes(recorded(aircraft, np.concatenate([flies, stands])), aircraft)
    assert "start: 0, stop: 180" in note
    assert not landing_notes(recorded(aircraft, np.concatenate([stands, flies])), aircraft)
