"""Airspeeds against the definitions: what a pitot tube shows in the air that it flies in."""

from itertools import pairwise

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.atmosphere import temperature_at
from aircraft_sysid_ros.mavlink.airspeed import (
    MEANINGS,
    standard_pressure,
    true_airspeed,
    true_of_impact_pressure,
)

SEA = (np.array([101325.0]), np.array([288.15]))


def impact_by_integration(speed, pressure, temperature):
    """P_t - P_s of a stream brought to rest without losses: dp = rho V dV backwards along the isentrope."""
    steps = 4000
    v = np.linspace(speed, 0.0, steps)
    p, constant = pressure, pressure / (pressure / (287.05287 * temperature)) ** 1.4
    for a, b in pairwise(v):
        half = p + (p / constant) ** (1 / 1.4) * 0.5 * (a * a - b * b) / 2
        p += (half / constant) ** (1 / 1.4) * 0.5 * (a * a - b * b)
    return p - pressure


FLIGHTS = [(17.0, 97e3, 300.0), (90.0, 60e3, 260.0), (200.0, 3e4, 229.0)]


@pytest.mark.parametrize(("speed", "pressure", "temperature"), FLIGHTS)
def test_impact_pressure_gives_the_speed_that_made_it(speed, pressure, temperature):
    impact = impact_by_integration(speed, pressure, temperature)
    found = true_of_impact_pressure(np.array([impact]), np.array([pressure]), np.array([temperature]))
    assert found[0] == pytest.approx(speed, rel=1e-5)


@pytest.mark.parametrize("meaning", MEANINGS)
def test_at_sea_level_in_standard_air_all_airspeeds_are_one(meaning):
    for speed in (0.0, 10.0, 100.0):
        assert true_airspeed(np.array([speed]), meaning, *SEA)[0] == pytest.approx(speed, abs=1e-9)


def test_calibrated_airspeed_is_the_speed_of_the_same_impact_pressure_at_sea_level():
    pressure, temperature = 50e3, 250.0
    impact = impact_by_integration(120.0, 101325.0, 288.15)
    here = true_of_impact_pressure(np.array([impact]), np.array([pressure]), np.array([temperature]))
    found = true_airspeed(np.array([120.0]), "calibrated", np.array([pressure]), np.array([temperature]))
    assert found[0] == pytest.approx(here[0], rel=1e-5)


def test_equivalent_airspeed_has_the_dynamic_pressure_of_sea_level():
    density = 60e3 / (287.05287 * 270.0)
    found = true_airspeed(np.array([30.0]), "equivalent", np.array([60e3]), np.array([270.0]))[0]
    assert density * found**2 == pytest.approx(1.225 * 30.0**2, rel=1e-4)


def test_the_standard_atmosphere_and_back():
    """ISO 2533 at 1000 m: 898.746 hPa, 281.65 K."""
    assert standard_pressure(np.array([1000.0]))[0] == pytest.approx(89874.6, rel=1e-5)
    assert temperature_at(np.array([89874.6]))[0] == pytest.approx(281.65, abs=1e-3)


def test_calibrated_airspeed_above_the_tropopause():
    """At 15000 m the table of ISO 2533 has 120.446 hPa and 216.65 K: Mach 0.8 there is 236.06 m/s."""
    altitude, mach = np.array([15000.0]), 0.8
    pressure = standard_pressure(altitude)
    impact = pressure * ((1.0 + 0.2 * mach**2) ** 3.5 - 1.0)
    calibrated = true_of_impact_pressure(impact, *SEA)
    found = true_airspeed(calibrated, "calibrated", pressure, temperature_at(pressure))
    assert pressure[0] == pytest.approx(12044.6, rel=1e-5)
    assert found[0] == pytest.approx(mach * 295.069, rel=1e-5)


def behind_a_normal_shock(mach, pressure):
    """P_t - P_s that a pitot tube shows in supersonic flow: what is left of it behind the shock, brought to rest."""
    rise = 1.0 + 2.0 * 1.4 / 2.4 * (mach**2 - 1.0)
    mach2 = (1.0 + 0.2 * mach**2) / (1.4 * mach**2 - 0.2)
    return pressure * (rise * (1.0 + 0.2 * mach2) ** 3.5 - 1.0)


@pytest.mark.parametrize("mach", [1.0, 1.01, 1.3, 2.0, 3.0])
def test_beyond_the_speed_of_sound_there_is_a_shock_before_the_tube(mach):
    """A supersonic airspeed, and a calibrated one that is supersonic at sea level too."""
    pressure, temperature = np.array([20e3]), np.array([217.0])
    sound = np.sqrt(1.4 * 287.05287 * 217.0)
    found = true_of_impact_pressure(behind_a_normal_shock(mach, pressure), pressure, temperature)
    assert found[0] == pytest.approx(mach * sound, rel=1e-6)
    at_sea = np.array([mach * 340.294])
    assert true_airspeed(at_sea, "calibrated", *SEA)[0] == pytest.approx(at_sea[0], rel=1e-5)


def test_less_than_no_impact_pressure_is_noise_at_rest():
    assert true_of_impact_pressure(np.array([-5.0]), *SEA)[0] == 0.0
