"""Positions and gravity on WGS-84."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aircraft_sysid_ros.aircraft.earth import (
    ECCENTRICITY_SQUARED,
    SEMI_MAJOR_AXIS,
    geodetic_along,
    gravity,
    moved,
    ned_along,
    ned_between,
)

LAWS = settings(max_examples=200, deadline=None, derandomize=True)
LATITUDE = st.floats(-1.5, 1.5)
LONGITUDE = st.floats(-np.pi, np.pi)
ARC_MINUTE = np.radians(1.0 / 60.0)


def earth_centred(place):
    """Position (3,) [m] on the ellipsoid, from its definition."""
    latitude, longitude, altitude = place
    s, c = np.sin(latitude), np.cos(latitude)
    n = SEMI_MAJOR_AXIS / np.sqrt(1.0 - ECCENTRICITY_SQUARED * s * s)
    flat = (n + altitude) * c
    return np.array(
        [flat * np.cos(longitude), flat * np.sin(longitude), (n * (1.0 - ECCENTRICITY_SQUARED) + altitude) * s]
    )


def level(place):
    """Matrix (3, 3) that turns earth-centred vectors into north, east, down."""
    latitude, longitude, _ = place
    sa, ca, so, co = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    return np.array([[-sa * co, -sa * so, ca], [-so, co, 0.0], [-ca * co, -ca * so, -sa]])


@pytest.mark.long
@LAWS
@given(LATITUDE, LONGITUDE, st.floats(-3e4, 3e4), st.floats(-3e4, 3e4), st.floats(-2e3, 2e4))
def test_places_come_back(latitude, longitude, north, east, up):
    begin, way = np.array([latitude, longitude, 300.0]), np.array([north, east, -up])
    np.testing.assert_allclose(ned_between(begin, moved(begin, way)), way, atol=1e-6)


@LAWS
@given(LATITUDE, LONGITUDE, st.floats(-100.0, 100.0), st.floats(-100.0, 100.0), st.floats(-20.0, 20.0))
def test_a_short_way_is_that_of_the_earth_centred_positions(latitude, longitude, north, east, up):
    begin = np.array([latitude, longitude, 1500.0])
    end = moved(begin, np.array([north, east, -up]))
    straight = level(begin) @ (earth_centred(end) - earth_centred(begin))
    # Over 141 m the earth falls away by 2 mm, and the meridians meet by 0.02 m at 86 degrees.
    np.testing.assert_allclose(straight, [north, east, -up], atol=0.03)


@pytest.mark.parametrize("heading", [0.0, 40.0, 90.0, 230.0])
def test_positions_are_what_velocities_add_up_to_at_any_distance(heading):
    """Flown with earth-centred steps along the velocity of the local level: 400 km."""
    place, position = np.array([0.84, 0.2, 3000.0]), np.zeros(3)
    places = [place]
    way = 20.0 * np.array([np.cos(np.radians(heading)), np.sin(np.radians(heading)), 0.0])
    for _ in range(20_000):
        s = np.sin(place[0])
        root = np.sqrt(1.0 - ECCENTRICITY_SQUARED * s * s)
        meridian = SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / root**3 + place[2]
        parallel = (SEMI_MAJOR_AXIS / root + place[2]) * np.cos(place[0])
        place = place + np.array([way[0] / meridian, way[1] / parallel, 0.0])
        places.append(place)
        position = position + way
    found = ned_along(np.array(places[::10]), places[0])
    np.testing.assert_allclose(found[-1], position, atol=1.0)
    np.testing.assert_allclose(geodetic_along(found, places[0])[-1], place, atol=1e-10)


def test_a_wrong_place_leaves_nothing_behind():
    """Of one fix among those of 5 Hz at 30 m/s."""
    way = np.array([[0.8, 0.1, 100.0], [0.800001, 0.1, 100.0], [0.9, -0.4, 9000.0], [0.800002, 0.1, 100.0]])
    spoofed, sound = ned_along(way, way[0]), ned_along(way[[0, 1, 3]], way[0])
    assert np.linalg.norm(spoofed[2]) > 4e5
    np.testing.assert_allclose(spoofed[3], sound[2], atol=2.0)


def test_over_the_date_line():
    near = ned_between(np.array([0.1, np.pi - 1e-5, 0.0]), np.array([0.1, -np.pi + 1e-5, 0.0]))
    assert near[1] == pytest.approx(2e-5 * SEMI_MAJOR_AXIS * np.cos(0.1), rel=0.01)


@pytest.mark.parametrize("degrees", [0.0, 45.0, 80.0])
def test_an_arc_minute_of_latitude_is_a_nautical_mile(degrees):
    latitude = np.radians(degrees)
    position = ned_between(np.array([latitude, 0.2, 0.0]), np.array([latitude + ARC_MINUTE, 0.2, 0.0]))
    middle = latitude + 0.5 * ARC_MINUTE
    radius = SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / (1.0 - ECCENTRICITY_SQUARED * np.sin(middle) ** 2) ** 1.5
    assert position[0] == pytest.approx(radius * ARC_MINUTE, rel=1e-9)
    assert position[0] == pytest.approx(1852.0, abs=11.0)  # 1842.9 m at the equator, 1861.6 m at the pole
    assert position[1] == position[2] == 0.0


def test_an_arc_minute_of_longitude_shrinks_with_the_parallel():
    for latitude in (0.0, 0.8):
        position = ned_between(np.array([latitude, 0.0, 0.0]), np.array([latitude, ARC_MINUTE, 0.0]))
        normal = SEMI_MAJOR_AXIS / np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
        assert position[1] == pytest.approx(normal * np.cos(latitude) * ARC_MINUTE, rel=1e-12)


def test_gravity_is_the_published_one_at_the_equator_and_at_the_pole():
    assert gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-10)
    assert gravity(np.pi / 2, 0.0) == pytest.approx(9.8321849378, abs=1e-9)
    assert gravity(np.radians(45.0), 0.0) == pytest.approx(9.80619777, abs=1e-7)
    assert gravity(-0.7, 0.0) == gravity(0.7, 0.0)


def test_gravity_falls_with_altitude_by_the_free_air_gradient():
    assert gravity(0.8, 0.0) - gravity(0.8, 1000.0) == pytest.approx(3.086e-3, rel=0.01)
