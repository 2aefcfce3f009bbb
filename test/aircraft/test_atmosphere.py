"""The standard atmosphere against the tables of ISO 2533 and the law that makes it."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft import atmosphere

# altitude [m], temperature [K], pressure [Pa], density [kg/m^3], each to the digits of the table
TABLE = [
    (0.0, 288.15, 101325.0, 1.2250),
    (1000.0, 281.65, 89874.6, 1.11164),
    (5000.0, 255.65, 54019.9, 0.73612),
    (11000.0, 216.65, 22632.0, 0.36392),
    (15000.0, 216.65, 12044.6, 0.19367),
    (20000.0, 216.65, 5474.88, 0.08803),
]


@pytest.mark.parametrize(("altitude", "temperature", "pressure", "density"), TABLE)
def test_table_of_iso_2533(altitude, temperature, pressure, density):
    assert atmosphere.temperature(altitude) == pytest.approx(temperature, abs=1e-9)
    assert atmosphere.pressure(altitude) == pytest.approx(pressure, rel=5e-6)
    assert atmosphere.air_density(altitude) == pytest.approx(density, rel=6e-5)


@pytest.mark.parametrize(("altitude", "temperature", "pressure", "density"), TABLE)
def test_the_table_read_from_the_pressure(altitude, temperature, pressure, density):
    assert atmosphere.temperature_at(pressure) == pytest.approx(temperature, abs=2e-3)
    assert atmosphere.density_at(pressure) == pytest.approx(density, rel=6e-5)
    assert atmosphere.altitude_at(pressure) == pytest.approx(altitude, abs=0.1)


def test_pressures_read_at_once_are_those_read_one_by_one():
    pressures = np.array([row[2] for row in TABLE])
    for quantity in (atmosphere.temperature_at, atmosphere.density_at, atmosphere.altitude_at):
        assert quantity(pressures) == pytest.approx([quantity(pressure) for pressure in pressures.tolist()])


def test_speed_of_sound():
    assert atmosphere.speed_of_sound(0.0) == pytest.approx(340.294, abs=1e-3)
    assert atmosphere.speed_of_sound(11000.0) == pytest.approx(295.069, abs=1e-3)


@pytest.mark.parametrize("altitude", [-400.0, 0.0, 300.0, 5000.0, 10990.0, 11010.0, 15000.0, 20000.0])
def test_the_air_carries_its_own_weight(altitude):
    step = 5.0
    slope = (atmosphere.pressure(altitude + step) - atmosphere.pressure(altitude - step)) / (2.0 * step)
    weight = atmosphere.air_density(altitude) * atmosphere.STANDARD_GRAVITY
    # Central difference: step^2/6 of the third derivative, which is about 1/(8 km)^2 of the first.
    assert slope == pytest.approx(-weight, rel=step**2 / 6.0 / 6000.0**2)


def test_the_tropopause_is_continuous():
    below, above = 11000.0 - 1e-6, 11000.0 + 1e-6
    for quantity in (atmosphere.temperature, atmosphere.pressure, atmosphere.air_density):
        assert quantity(below) == pytest.approx(quantity(above), rel=1e-8)


def test_an_altitude_that_is_not_known_gives_nothing():
    for quantity in (
        atmosphere.temperature,
        atmosphere.pressure,
        atmosphere.air_density,
        atmosphere.speed_of_sound,
        atmosphere.temperature_at,
        atmosphere.density_at,
        atmosphere.altitude_at,
    ):
        assert np.isnan(quantity(np.nan))
