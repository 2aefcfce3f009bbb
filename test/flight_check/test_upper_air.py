"""Pressure and density as they are up to 20 km are no fault of a sensor."""

from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.atmosphere import GAS_CONSTANT
from aircraft_sysid_ros.flight_check import explain
from aircraft_sysid_ros.flight_check.laws import pressure
from aircraft_sysid_ros.flight_check.relation import Fault


def contradicted(static: float, temperature: float) -> list[str]:
    """Signals that the laws of a constant doubt; below the troposphere's top the height is asked, too."""
    air = np.tile([static / (GAS_CONSTANT * temperature), static], (200, 1))
    ranges = [(r.first, *r.log_ratio) for r in pressure.relations(SimpleNamespace(air=air)) if not r.has_lag]
    return [name for name, low, high in ranges if low > 0.0 or high < 0.0]


@pytest.mark.parametrize(("static", "temperature"), [(17.9e3, 216.65), (11e3, 200.0), (6e3, 216.65)])
def test_the_stratosphere_is_no_fault(static, temperature):
    """A standard day at 12.5 km was told to divide its pressure by 0.766, and one at 10.5 km its density by 1.303."""
    assert contradicted(static, temperature) == []


def test_units_are_still_told():
    assert contradicted(179.0, 216.65) == ["static_pressure"]  # hPa
    assert contradicted(17.9e3, 216.65 / 1.94) == ["air_density"]


@pytest.mark.parametrize("celsius", [-45.0, 15.0, 35.0])
def test_kelvin_taken_for_celsius_is_said(celsius):
    """A temperature that somebody gives in K makes half of the density, and it is not the density to look at."""
    static = 17.9e3
    air = np.tile([static / (GAS_CONSTANT * (celsius + 2.0 * 273.15)), static], (200, 1))
    (relation,) = [r for r in pressure.relations(SimpleNamespace(air=air)) if r.first == "air_density"]
    finding, _ = explain._ratio(Fault("air_density", float(np.mean(relation.log_ratio)), (relation,)))
    assert "give the air temperature in °C, if it is in K" in finding.sentence
