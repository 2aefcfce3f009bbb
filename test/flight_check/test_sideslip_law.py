"""The law of sideslip in rolling flight: gravity along the wing moves with the bank, and is no scale of a sensor."""

from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.grid import Grid
from aircraft_sysid_ros.flight_check.laws import flow_angles
from aircraft_sysid_ros.flight_check.signals import FORCE

G, STEP = 9.81, 0.02


def rolling(seed: int, speed: float, alpha: float, scale: float = 1.0) -> SimpleNamespace:
    """Ninety seconds of banking to and fro by (6.18) alone, with a side force -k beta and a fin."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 90.0, STEP)
    waves = [(rng.uniform(0.1, 0.9), rng.uniform(0.0, 6.3), rng.uniform(0.05, 0.2)) for _ in range(6)]
    bank = sum(a * np.sin(2.0 * np.pi * f * time + at) for f, at, a in waves)
    p = np.gradient(bank, STEP)
    doublets = 0.15 * np.sign(np.sin(2.0 * np.pi * time / 3.1)) * (np.sin(2.0 * np.pi * time / 22.0) > 0.6)
    beta, r, k = np.zeros_like(time), np.zeros_like(time), rng.uniform(8.0, 16.0)
    for i in range(1, len(time)):  # a fin that turns the nose into the flow
        r[i] = r[i - 1] + STEP * (25.0 * beta[i - 1] - 2.5 * r[i - 1] - 0.4 * p[i - 1] + 6.0 * doublets[i - 1])
        rate = (
            p[i - 1] * np.sin(alpha) - r[i - 1] * np.cos(alpha) + (-k * beta[i - 1] + G * np.sin(bank[i - 1])) / speed
        )
        beta[i] = beta[i - 1] + STEP * rate
    noise = lambda sigma: sigma * rng.standard_normal(len(time))  # noqa: E731
    zero = np.zeros_like(time)
    gyro = np.column_stack([p + noise(0.002), noise(0.002), r + noise(0.002)])
    force = np.column_stack([zero, scale * (-k * beta + noise(0.03)), -G + noise(0.03)])
    angles = (alpha + noise(0.002), beta + noise(0.002))
    grid, arm = Grid(0.0, STEP, len(time)), 0.0
    return SimpleNamespace(grid=grid, gyro=gyro, force=force, speed=zero + speed, angles_at_imu=angles, arm_time=arm)


def factor(motion: SimpleNamespace) -> tuple[float, float]:
    """Least and largest factor of the side force that the law allows."""
    (found,) = (r for r in flow_angles.relations(motion) if r.second == FORCE[1])
    assert found.comparison.is_sure
    low, high = found.log_ratio
    return float(np.exp(low)), float(np.exp(high))


@pytest.mark.parametrize("seed", range(6))
def test_banking_to_and_fro_is_no_scale_of_the_side_force(seed):
    low, high = factor(rolling(seed, speed=16.0 + seed, alpha=0.03 * seed))
    assert low < 1.0 < high, f"{low:.2f} to {high:.2f}"


def test_a_scale_is_still_one():
    _, high = factor(rolling(9, speed=18.0, alpha=0.08, scale=3.0))
    assert 1.0 / 3.0 < high < 1.0  # of the derivative that it gives
