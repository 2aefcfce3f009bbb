"""The measurement update in flight, iterated: where it ends, and when it stops."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from filter_setups import setup_of
from scipy.optimize import least_squares

from aircraft_sysid_ros.aircraft.frames import (
    quaternion_conjugate,
    quaternion_from_euler,
    quaternion_log,
    quaternion_product,
    right_jacobian,
    rotation_matrix,
)
from aircraft_sysid_ros.reconstruction.error_state import retract
from aircraft_sysid_ros.reconstruction.fusion import fuse
from aircraft_sysid_ros.reconstruction.measurements import residual_and_jacobian
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.state import AIR_VELOCITY, ATTITUDE, ERROR_SIZE, STATE_SIZE, Setup, new_memory
from aircraft_sysid_ros.records import replaced
from aircraft_sysid_ros.samples import WIDTH, Kind

RATE = np.array([0.3, -0.2, 0.5])
NONLINEAR = [Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP, Kind.MAGNETIC_FIELD]


@pytest.fixture(scope="module")
def setup(aircraft) -> Setup:
    """As in flight, with a gate that lets everything through."""
    return replaced(setup_of(aircraft), gate=np.inf)


def prior() -> tuple[np.ndarray, np.ndarray]:
    """A state that is hardly known in attitude and flow, its errors correlated."""
    x = np.zeros(STATE_SIZE)
    x[ATTITUDE] = quaternion_from_euler(0.4, 0.5, -1.0)
    x[AIR_VELOCITY] = [9.0, 2.0, 1.0]
    std = np.repeat([2.0, 10.0, 0.5, 0.2, 0.02, 4.0], 3)
    mixing = np.eye(ERROR_SIZE) + 0.2 * np.random.default_rng(1).normal(size=(ERROR_SIZE, ERROR_SIZE))
    p = np.outer(std, std) * (mixing @ mixing.T)
    return x, 0.5 * (p + p.T)


def measured(kind: Kind, x: np.ndarray) -> np.ndarray:
    values = np.full(WIDTH, np.nan)
    if kind == Kind.MAGNETIC_FIELD:
        values[:3] = rotation_matrix(x[ATTITUDE]).T @ np.array([0.7, 0.5, 0.8])
    else:
        values[0] = {Kind.AIRSPEED: 16.0, Kind.ANGLE_OF_ATTACK: 0.7, Kind.SIDESLIP: -0.5}[kind]
    return values


def updated(kind: Kind, setup: Setup, cap: int, tolerance: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    x, p = prior()
    values = measured(kind, x)
    memory = new_memory(len(Kind), setup.wind_walk)
    fuse(int(kind), values, x, p, RATE, 1.0, replaced(setup, maximum_iterations=cap, tolerance=tolerance), memory)
    assert memory.fused[kind] == 1 and memory.last_fused[kind] == 1.0
    return x, p


def error_from_prior(after: np.ndarray) -> np.ndarray:
    """Error (18,) that takes the prior to ``after``."""
    x = prior()[0]
    turn = quaternion_log(quaternion_product(quaternion_conjugate(x[ATTITUDE]), after[ATTITUDE]))
    return np.concatenate([after[:6] - x[:6], turn, after[10:] - x[10:]])


def most_probable(kind: Kind, setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Error (18,) of least cost of prior and measurement, and its covariance, by another optimiser."""
    x, p = prior()
    values, root = measured(kind, x), np.linalg.cholesky(p)
    residual, h = np.empty(3), np.empty((3, ERROR_SIZE))

    def cost(white: np.ndarray) -> np.ndarray:
        count = residual_and_jacobian(int(kind), values, retract(x, root @ white), RATE, setup, residual, h)
        return np.concatenate([white, residual[:count] / np.sqrt(setup.variance[kind][:count])])

    found = least_squares(cost, np.zeros(ERROR_SIZE), jac="3-point", xtol=1e-14, ftol=1e-14, gtol=1e-12)
    assert found.success
    return root @ found.x, root @ np.linalg.inv(found.jac.T @ found.jac) @ root.T


def in_deviations(error: np.ndarray) -> float:
    return float(np.abs(error / np.sqrt(np.diag(prior()[1]))).max())


@pytest.mark.parametrize("kind", NONLINEAR)
def test_iterated_to_the_end_it_is_the_most_probable_state(kind: Kind, setup: Setup) -> None:
    best, covariance = most_probable(kind, setup)
    x, p = updated(kind, setup, 100)
    is_exact = kind != Kind.MAGNETIC_FIELD  # its Jacobian is that of the predicted field, and not of what was measured
    assert in_deviations(error_from_prior(x) - best) < (1e-6 if is_exact else 2e-3)
    turned = np.eye(ERROR_SIZE)
    turned[6:9, 6:9] = right_jacobian(best[6:9])
    std = np.sqrt(np.diag(p))
    assert np.abs((p - turned @ covariance @ turned.T) / np.outer(std, std)).max() < (1e-4 if is_exact else 1e-2)
    assert in_deviations(error_from_prior(updated(kind, setup, 1)[0]) - best) > 0.05


@pytest.mark.parametrize("kind", NONLINEAR)
def test_with_a_cap_of_one_it_is_the_plain_filter(kind: Kind, setup: Setup) -> None:
    x, p = prior()
    residual, h = np.empty(3), np.empty((3, ERROR_SIZE))
    assert residual_and_jacobian(int(kind), measured(kind, x), x, RATE, setup, residual, h) == 1
    k_gain = p @ h[0] / (h[0] @ p @ h[0] + setup.variance[kind][0])
    assert np.allclose(updated(kind, setup, 1)[0], retract(x, k_gain * residual[0]), rtol=0, atol=1e-12)


def test_it_stops_at_the_cap_of_five(setup: Setup) -> None:
    """The sideslip converges slowly here: the cap comes first."""
    options, best = StateOptions(), most_probable(Kind.SIDESLIP, setup)[0]
    capped = updated(Kind.SIDESLIP, setup, options.maximum_iterations, options.tolerance)[0]
    assert np.array_equal(capped, updated(Kind.SIDESLIP, setup, 5)[0])
    later = updated(Kind.SIDESLIP, setup, 50, options.tolerance)[0]
    assert in_deviations(error_from_prior(later) - best) < 0.5 * in_deviations(error_from_prior(capped) - best)


@pytest.mark.parametrize("kind", NONLINEAR)
def test_it_stops_when_it_moves_by_less_than_the_tolerance(kind: Kind, setup: Setup) -> None:
    tolerance = StateOptions().tolerance
    errors = [np.zeros(ERROR_SIZE), *(error_from_prior(updated(kind, setup, cap)[0]) for cap in range(1, 20))]
    steps = [in_deviations(after - before) for before, after in pairwise(errors)]
    last = 1 + next(i for i, step in enumerate(steps) if step <= tolerance)
    assert 1 < last < 15
    stopped = updated(kind, setup, 50, tolerance)[0]
    assert np.array_equal(stopped, updated(kind, setup, last)[0])
    assert not np.array_equal(stopped, updated(kind, setup, last - 1)[0])
