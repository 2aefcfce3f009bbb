"""What the laws of sensors rest on, against scipy's own: the scale of the airspeed with a wind, and where it flies."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import binary_erosion, binary_opening
from scipy.optimize import least_squares

from aircraft_sysid_ros.flight_check.laws.airspeed import scale_and_wind
from aircraft_sysid_ros.flight_check.motion import eroded, without_short


@pytest.mark.parametrize("seed", range(12))
def test_scale_and_wind_are_those_of_scipy(seed):
    draws = np.random.default_rng(seed)
    count, airspeed, scale = draws.integers(40, 300), draws.uniform(10.0, 60.0), draws.choice([0.5, 1.0, 1.94])
    course, wind = np.linspace(0.0, 7.0, count), np.array([*draws.normal(0.0, 0.2 * airspeed, 2), 0.0])
    towards = np.column_stack([np.cos(course), np.sin(course), np.zeros(count)])
    ground = airspeed * towards + wind + draws.normal(0.0, 0.3, (count, 3))
    speed = scale * (airspeed + draws.normal(0.0, 0.02 * airspeed, count))
    speed[draws.integers(0, count, count // 10)] *= 2.0
    start = float(np.median(speed) / np.median(np.linalg.norm(ground, axis=1)))
    found = least_squares(
        lambda x: speed - x[0] * np.linalg.norm(ground - [x[1], x[2], 0.0], axis=1),
        [start, 0.0, 0.0], loss="soft_l1", f_scale=0.05 * float(np.median(speed)), xtol=1e-12, ftol=1e-12,
    )  # fmt: skip
    own, own_wind, std = scale_and_wind(speed, ground, start)
    assert own == pytest.approx(found.x[0], abs=1e-3 * std)
    np.testing.assert_allclose(own_wind, found.x[1:], atol=1e-2)
    assert abs(own - scale) < 3.0 * std


@pytest.mark.parametrize("reach", [1, 4, 50])
def test_masks_are_those_of_scipy(reach):
    draws = np.random.default_rng(reach)
    wide = np.ones(2 * reach + 1)
    for share in (0.5, 0.9, 0.99):
        for count in (1, 30, 400):
            mask = draws.random(count) < share
            np.testing.assert_array_equal(eroded(mask, reach, outside=True), binary_erosion(mask, wide, border_value=1))
            np.testing.assert_array_equal(without_short(mask, reach), binary_opening(mask, wide))
