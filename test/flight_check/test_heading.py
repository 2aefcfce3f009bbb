"""A heading that is off, by airspeed, GPS and one steady wind."""

from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.finding import WARNING
from aircraft_sysid_ros.flight_check.grid import Grid
from aircraft_sysid_ros.flight_check.laws.turns import findings, heading_offset

STEP = 0.1


def circling(seed, off=0.0, scale=1.0, gusts=1.0, turns=2.0, vanes=True):
    """Circles in a wind with gusts that last for seconds, banked, at an angle of attack and a sideslip."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 240.0, STEP)
    yaw, bank = turns * 2.0 * np.pi * time / 240.0, np.full(len(time), 0.4 if turns else 0.0)
    alpha, beta, pitch = 0.06 + 0.02 * np.sin(time / 3.0), 0.03 * np.sin(time / 7.0), 0.05 * np.ones(len(time))
    speed = 20.0 + np.sin(time / 11.0)
    u, v, w = speed * np.cos(alpha) * np.cos(beta), speed * np.sin(beta), speed * np.sin(alpha) * np.cos(beta)
    ahead = u * np.cos(pitch) + (v * np.sin(bank) + w * np.cos(bank)) * np.sin(pitch)
    right = v * np.cos(bank) - w * np.sin(bank)
    slow = np.array([np.convolve(rng.standard_normal(len(time) + 49), np.ones(50) / 7.0, "valid") for _ in range(2)])
    wind = np.array([[4.0], [-3.0]]) + gusts * slow
    north, east = (
        ahead * np.cos(yaw) - right * np.sin(yaw) + wind[0],
        ahead * np.sin(yaw) + right * np.cos(yaw) + wind[1],
    )
    nothing = np.full(len(time), np.nan)
    return SimpleNamespace(
        grid=Grid(0.0, STEP, len(time)), airspeed=scale * speed, velocity=np.column_stack([north, east, 0.0 * time]),
        euler=np.column_stack([bank, pitch, yaw + off]), angles_at_imu=(alpha, beta) if vanes else (nothing, nothing),
    )  # fmt: skip


@pytest.mark.parametrize("vanes", [True, False])
@pytest.mark.parametrize("off", [-0.2, 0.0, 0.13])
def test_an_offset_is_found_whatever_the_scale_of_the_airspeed(off, vanes):
    for seed in range(5):
        found = heading_offset(circling(seed, off, scale=0.9, vanes=vanes))
        assert found is not None
        assert abs(found.angle - off) < 4.0 * found.std + (0.0 if vanes else 0.05)


def test_straight_flight_does_not_tell_it_and_without_airspeed_nothing_does():
    assert heading_offset(circling(1, 0.2, turns=0.0)) is None
    silent = circling(1, 0.2)
    silent.airspeed = np.full(len(silent.airspeed), np.nan)
    assert heading_offset(silent) is None


@pytest.mark.parametrize("off", [0.0, 3.0, -12.0, 12.0])
def test_a_large_one_is_said_with_its_way(off):
    found = findings(circling(3, np.radians(off)))
    if abs(off) < 5.0:
        assert not found
        return
    (said,) = found
    assert said.severity == WARNING and said.kind == "offset"
    assert ("too small" if off < 0.0 else "too large") in said.sentence
    assert float(said.sentence.split(" it is ")[1].split(" ")[0]) == pytest.approx(abs(off), abs=2.0)
