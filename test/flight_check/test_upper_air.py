"""Pressure and density as they are up to 20 km, and on cold days, are no fault of a sensor."""

from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.atmosphere import GAS_CONSTANT, density_at, pressures, temperature_at
from aircraft_sysid_ros.flight_check import explain
from aircraft_sysid_ros.flight_check.grid import Grid
from aircraft_sysid_ros.flight_check.laws import pressure
from aircraft_sysid_ros.flight_check.relation import Fault, scale_faults


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


def climbs(celsius: float, recorded: str, scale: float = 1.0) -> list[str]:
    """Signals whose scale is doubted in a flight up and down on a day of so many degrees at the sea, not 15.

    ``recorded``: of the density, "measured", "standard" as made of the pressure alone, or "none".
    """
    grid, warmth = Grid(0.0, 0.1, 4000), (celsius + 273.15) / 288.15
    draws, turning = np.random.default_rng(1), 2.0 * np.pi * grid.time / 60.0
    height, climb = 300.0 - 200.0 * np.cos(turning), 200.0 * 2.0 * np.pi / 60.0 * np.sin(turning)
    static = pressures(scale * height / warmth)
    measured = static / (GAS_CONSTANT * warmth * temperature_at(static))
    density = {"measured": measured, "standard": density_at(static), "none": np.full(grid.count, np.nan)}[recorded]
    still = np.zeros((2, grid.count))
    motion = SimpleNamespace(
        air=np.column_stack([density, static]), grid=grid, gps_width=1.0,
        position=np.column_stack([*still, -height + draws.normal(0.0, 1.0, grid.count)]),
        velocity=np.column_stack([*still, -climb + draws.normal(0.0, 0.2, grid.count)]),
    )  # fmt: skip
    return [fault.signal for fault in scale_faults(pressure.relations(motion), {})]


@pytest.mark.parametrize("celsius", [-40.0, -20.0, 15.0, 40.0])
@pytest.mark.parametrize("recorded", ["measured", "standard", "none"])
def test_a_cold_day_is_no_fault_of_the_altitude(celsius, recorded):
    """At -20 degrees the altitude was "0.877 times what it should be: calibrate it"."""
    assert climbs(celsius, recorded) == []


@pytest.mark.parametrize(
    ("celsius", "recorded", "scale"),
    [(-20.0, "measured", 1.25), (-20.0, "measured", 0.8), (15.0, "none", 1.4), (15.0, "standard", 0.7)],
)
def test_a_pressure_of_another_scale_is_told(celsius, recorded, scale):
    assert climbs(celsius, recorded, scale)


def test_a_density_of_another_unit_does_not_change_the_climb():
    """Made with K for °C it is half of what it should be, and no air is as warm as that says."""
    assert climbs(2.0 * 288.15 - 273.15, "measured", 2.0) == ["air_density"]
