"""A trim that the model does not know does not hide what a few manoeuvres show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.quick_motion import quick_motion
from aircraft_sysid_ros.diagnosis.search.fit import fit_axis

STEP = 0.04
TRUTH = {"alpha": -0.6, "q": -9.0, "de": -1.1}


def flight_of(aircraft, trim: float, seed: int = 2) -> FlightData:
    """Ten minutes in trim, C_m = 0, with 60 s of doublets; ``trim``: C_m of a thrust or a load that moves slowly."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, 600.0, STEP)
    moving = (time % 200.0) < 20.0
    alpha = 0.06 + 0.03 * np.sin(2 * np.pi * time / 170.0) + 0.02 * np.sin(4.0 * time) * moving
    rate = 0.004 * np.cos(4.0 * time) * moving
    pulses = 0.05 * np.sign(np.sin(2.3 * time)) * moving
    slow = trim * np.sin(2 * np.pi * time / 230.0)
    steady = 0.06 + 0.03 * np.sin(2 * np.pi * time / 170.0)
    elevator = -(0.02 + TRUTH["alpha"] * steady + slow) / TRUTH["de"] + pulses
    signals = np.full((len(time), len(SIGNALS)), np.nan)
    for name, values in {"alpha": alpha, "q": rate, "de": elevator, "V": 20.0, "qbar": 240.0}.items():
        signals[:, SIGNAL_INDEX[name]] = values
    measured = np.full((len(time), 6), np.nan)
    of_motion = TRUTH["alpha"] * alpha + TRUTH["q"] * rate + TRUTH["de"] * elevator
    measured[:, AXES.index("Cm")] = 0.02 + of_motion + slow + 0.001 * random.normal(size=len(time))
    return FlightData(aircraft, time, measured, signals, STEP)


def test_quick_motion_has_the_derivatives_that_an_unknown_trim_hides(aircraft):
    fit = fit_axis(flight_of(aircraft, 0.05), "Cm")
    found = quick_motion(fit)
    for name, true in TRUTH.items():
        whole, quick = found.values[f"Cm_{name}"]
        assert quick == pytest.approx(true, rel=0.15), name
        assert abs(quick - true) < 0.3 * abs(whole - true) or abs(whole - true) < 0.15 * abs(true), name
    assert found.left < 0.3 * found.left_by_whole
    assert "Cm_0" not in found.values


def test_a_model_that_has_the_trim_and_noise_alone_say_nothing(aircraft):
    clean = flight_of(aircraft, 0.0)
    assert quick_motion(fit_axis(clean, "Cm")) is None
    noise = clean.measured + 0.2 * np.random.default_rng(0).normal(size=clean.measured.shape)
    assert quick_motion(fit_axis(replace(clean, measured=noise), "Cm")) is None
