"""Positions and gravity on WGS-84."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aircraft_sysid_ros.aircraft.earth import (
    ECCENTRICITY_SQUARED,
    SEMI_MAJOR_AXIS,
    ecef_from_geodetic,
    geodetic_from_ned,
    gravity,
    ned_axes,
    ned_from_geodetic,
)

LAWS = settings(max_examples=200, deadline=None, derandomize=True)
LATITUDE = st.floats(-1.55, 1.55)
LONGITUDE = st.floats(-np.pi, np.pi)
ARC_MINUTE = np.radians(1.0 / 60.0)


@LAWS
@given(LATITUDE, LONGITUDE, st.floats(-3e4, 3e4), st.floats(-3e4, 3e4), st.floats(-2e3, 2e4))
def test_positions_come_back(latitude, longitude, north, east, altitude):
    origin = np.array([latitude, longitude, 300.0])
    position = np.array([north, east, -altitude])
    geodetic = geodetic_from_ned(position, origin)
    # Earth-centred positions of 6e6 m carry 1e-9 m of rounding; the last pass leaves less than that.
    np.testing.assert_allclose(ned_from_geodetic(*geodetic, origin), position, atol=1e-7)


@LAWS
@given(LATITUDE, LONGITUDE, st.floats(-400.0, 2e4))
def test_geodetic_comes_back_from_far_origins(latitude, longitude, altitude):
    origin = np.array([0.5, 1.0, 0.0])
    back = geodetic_from_ned(ned_from_geodetic(latitude, longitude, altitude, origin), origin)
    assert back[0] == pytest.approx(latitude, abs=1e-13)
    assert np.angle(np.exp(1j * (back[1] - longitude))) == pytest.approx(0.0, abs=1e-13)
    assert back[2] == pytest.approx(altitude, abs=1e-6)


@pytest.mark.parametrize("latitude", [np.pi / 2, -np.pi / 2])
def test_the_pole_is_regular(latitude):
    origin = np.array([latitude, 0.3, 100.0])
    back = geodetic_from_ned(np.zeros(3), origin)
    assert back[0] == pytest.approx(latitude, abs=1e-12) and back[2] == pytest.approx(100.0, abs=1e-6)


def test_the_equator_and_the_pole_are_where_wgs84_says():
    np.testing.assert_allclose(ecef_from_geodetic(0.0, 0.0, 0.0), [6378137.0, 0.0, 0.0])
    assert ecef_from_geodetic(np.pi / 2, 0.0, 0.0)[2] == pytest.approx(6356752.3142, abs=1e-4)


@LAWS
@given(LATITUDE, LONGITUDE)
def test_axes_are_orthonormal_and_down_is_against_the_ellipsoid_normal(latitude, longitude):
    axes = ned_axes(latitude, longitude)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    up = ecef_from_geodetic(latitude, longitude, 1000.0) - ecef_from_geodetic(latitude, longitude, 0.0)
    np.testing.assert_allclose(axes @ up, [0.0, 0.0, -1000.0], atol=1e-8)


@pytest.mark.parametrize("degrees", [0.0, 45.0, 80.0])
def test_an_arc_minute_of_latitude_is_a_nautical_mile(degrees):
    latitude = np.radians(degrees)
    position = ned_from_geodetic(latitude + ARC_MINUTE, 0.2, 0.0, np.array([latitude, 0.2, 0.0]))
    radius = (
        SEMI_MAJOR_AXIS * (1.0 - ECCENTRICITY_SQUARED) / (1.0 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2) ** 1.5
    )
    # The radius of curvature changes by at most 1.5 e^2 per radian along the arc.
    assert position[0] == pytest.approx(radius * ARC_MINUTE, rel=ECCENTRICITY_SQUARED * ARC_MINUTE + ARC_MINUTE**2)
    assert position[0] == pytest.approx(1852.0, abs=11.0)  # 1842.9 m at the equator, 1861.6 m at the pole
    assert position[1] == pytest.approx(0.0, abs=1e-9)
    assert position[2] == pytest.approx(position[0] ** 2 / (2.0 * radius), rel=1e-3)  # the plane rises above


def test_an_arc_minute_of_longitude_shrinks_with_the_parallel():
    for latitude in (0.0, 0.8):
        position = ned_from_geodetic(latitude, ARC_MINUTE, 0.0, np.array([latitude, 0.0, 0.0]))
        normal = SEMI_MAJOR_AXIS / np.sqrt(1.0 - ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
        assert position[1] == pytest.approx(normal * np.cos(latitude) * np.sin(ARC_MINUTE), rel=1e-12)


def test_gravity_is_the_published_one_at_the_equator_and_at_the_pole():
    assert gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-10)
    assert gravity(np.pi / 2, 0.0) == pytest.approx(9.8321849378, abs=1e-9)
    assert gravity(np.radians(45.0), 0.0) == pytest.approx(9.80619777, abs=1e-7)
    assert gravity(-0.7, 0.0) == gravity(0.7, 0.0)


def test_gravity_falls_with_altitude_by_the_free_air_gradient():
    assert gravity(0.8, 0.0) - gravity(0.8, 1000.0) == pytest.approx(3.086e-3, rel=0.01)
