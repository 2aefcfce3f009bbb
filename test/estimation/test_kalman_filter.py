"""The Kalman filter: equal to its definition, to exact arithmetic and to least squares over the whole record."""

from fractions import Fraction

import numpy as np
import pytest
from numba import njit

from aircraft_sysid_ros.estimation.iterated_ekf import iterated_update
from aircraft_sysid_ros.estimation.kalman_filter import (
    LinearSystem,
    filter_series,
    predict,
    predict_ahead,
    update,
)

DT = 0.1
PHI = np.array([[1.0, DT, 0.0], [0.0, 1.0, DT], [0.0, 0.0, 0.9]])


def spread(rng, n, low=0.2, high=2.0):
    """A random covariance with eigenvalues between low and high."""
    q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    return q @ np.diag(np.geomspace(low, high, n)) @ q.T


def system_of(rng, steps=None):
    """3 states, 2 outputs with correlated noise, 2 inputs, 2 noises; with ``steps`` all change with k."""
    shape = () if steps is None else (steps,)
    many = (lambda make: make()) if steps is None else (lambda make: np.stack([make() for _ in range(steps)]))
    return LinearSystem(
        transition=PHI + 0.1 * rng.normal(size=(*shape, 3, 3)),
        output=rng.normal(size=(*shape, 2, 3)),
        noise=many(lambda: spread(rng, 2, 0.1, 0.5)),
        measurement_noise=many(lambda: spread(rng, 2)),
        noise_input=rng.normal(size=(*shape, 3, 2)),
        input_matrix=rng.normal(size=(*shape, 3, 2)),
        feedthrough=rng.normal(size=(*shape, 2, 2)),
    )


def at(series, k):
    return series[min(k, len(series) - 1)]


def simulate(system, rng, x0, p0, steps, inputs):
    """A record of (2.1), (2.2): states (steps, n), outputs (steps, p)."""
    x, xs, ys = rng.multivariate_normal(x0, p0), [], []
    for k in range(steps):
        noise = rng.multivariate_normal(np.zeros(system.output.shape[1]), at(system.measurement_noise, k))
        xs.append(x)
        ys.append(at(system.output, k) @ x + at(system.feedthrough, k) @ inputs[k] + noise)
        w = rng.multivariate_normal(np.zeros(system.noise.shape[1]), at(system.noise, k))
        x = at(system.transition, k) @ x + at(system.input_matrix, k) @ inputs[k] + at(system.noise_input, k) @ w
    return np.array(xs), np.array(ys)


@pytest.mark.parametrize("steps", [None, 20])
def test_the_filter_is_2_7_to_2_11_as_printed(steps):
    rng = np.random.default_rng(1)
    system, u, p0 = system_of(rng, steps), rng.normal(size=(20, 2)), spread(rng, 3)
    _, y = simulate(system, rng, np.zeros(3), p0, 20, u)
    series = filter_series(system, np.zeros(3), p0, y, u)
    x, p = np.zeros(3), p0
    for k in range(20):
        c, r, phi = at(system.output, k), at(system.measurement_noise, k), at(system.transition, k)
        gamma = at(system.noise_input, k)
        k_gain = p @ c.T @ np.linalg.inv(c @ p @ c.T + r)  # (2.11)
        x = x + k_gain @ (y[k] - at(system.feedthrough, k) @ u[k] - c @ x)  # (2.9)
        p = (np.eye(3) - k_gain @ c) @ p  # (2.10)
        np.testing.assert_allclose(series.state[k], x, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(series.covariance[k], p, rtol=1e-9, atol=1e-11)
        x = phi @ x + at(system.input_matrix, k) @ u[k]  # (2.7)
        p = phi @ p @ phi.T + gamma @ at(system.noise, k) @ gamma.T  # (2.8)
        np.testing.assert_allclose(series.predicted_state[k], x, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(series.predicted_covariance[k], p, rtol=1e-9, atol=1e-11)


def test_an_update_is_one_iteration_of_the_ekf_on_a_linear_system():
    rng = np.random.default_rng(2)
    x, p, c, y, r = rng.normal(size=3), spread(rng, 3), rng.normal(size=(2, 3)), rng.normal(size=2), [0.3, 0.7]
    ekf = iterated_update(x, p, y, lambda s: c @ s, lambda s: c, np.array(r), maximum_iterations=1)
    state, covariance = update(x, p, y, c, np.diag(r))
    np.testing.assert_allclose(state, ekf.state, rtol=1e-12)
    np.testing.assert_allclose(covariance, ekf.covariance, rtol=1e-11, atol=1e-14)


def test_a_missing_output_is_left_out_element_by_element():
    rng = np.random.default_rng(3)
    x, p, c, r = rng.normal(size=3), spread(rng, 3), rng.normal(size=(3, 3)), spread(rng, 3)
    y = np.array([0.3, np.nan, -0.4])
    rows = [0, 2]
    expected = update(x, p, y[rows], c[rows], r[np.ix_(rows, rows)])
    for got, want in zip(update(x, p, y, c, r), expected, strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-13)
    nothing = update(x, p, np.full(3, np.nan), c, r)
    np.testing.assert_array_equal(nothing[0], x)
    np.testing.assert_array_equal(nothing[1], p)


def test_prediction_is_the_filter_without_measurements_and_grows():
    rng = np.random.default_rng(4)
    system, u, x, p = system_of(rng, 30), rng.normal(size=(30, 2)), rng.normal(size=3), spread(rng, 3)
    series = filter_series(system, x, p, np.full((30, 2), np.nan), u)
    states, covariances = predict_ahead(system, x, p, 30, u)
    np.testing.assert_allclose(states, series.predicted_state, rtol=1e-12)
    np.testing.assert_allclose(covariances, series.predicted_covariance, rtol=1e-12)
    later = predict_ahead(system, states[9], covariances[9], 20, u[10:], start=10)
    np.testing.assert_allclose(later[0], states[10:], rtol=1e-12)
    steady = LinearSystem(np.eye(2), np.eye(2), 0.1 * np.eye(2), np.eye(2))
    _, grown = predict_ahead(steady, np.zeros(2), np.eye(2), 5)
    np.testing.assert_allclose(grown[:, 0, 0], 1.0 + 0.1 * np.arange(1, 6))


def test_a_future_input_that_is_not_known_is_held():
    rng = np.random.default_rng(5)
    system, u = system_of(rng), np.array([0.5, -1.0])
    held = predict_ahead(system, np.zeros(3), np.eye(3), 6, u)
    given = predict_ahead(system, np.zeros(3), np.eye(3), 6, np.tile(u, (6, 1)))
    np.testing.assert_array_equal(held[0], given[0])


@pytest.mark.long
def test_errors_are_as_large_as_the_covariance_says():
    """200 flights of 40 steps: mean NEES of 3 states within 4 sigma of 3."""
    rng = np.random.default_rng(6)
    system, p0, u = system_of(rng), spread(rng, 3), rng.normal(size=(40, 2))
    nees = []
    for _ in range(200):
        x, y = simulate(system, rng, np.zeros(3), p0, 40, u)
        y[rng.random(y.shape) < 0.2] = np.nan
        series = filter_series(system, np.zeros(3), p0, y, u)
        error = x[-1] - series.state[-1]
        nees.append(error @ np.linalg.solve(series.covariance[-1], error))
    assert np.mean(nees) == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / 200))


@njit(cache=True)
def many_steps(count, x, p, y, phi, w, c, r):
    """The smallest diagonal element, and the largest asymmetry, over ``count`` steps; p is left at the end."""
    smallest, asymmetry, zero = np.inf, 0.0, np.zeros(len(x))
    for _ in range(count):
        x, updated = update(x, p, y, c, r)
        x, p[:] = predict(x, updated, phi, zero, w)
        for i in range(len(x)):
            smallest = min(smallest, updated[i, i])
            for j in range(i):
                asymmetry = max(asymmetry, abs(p[i, j] - p[j, i]), abs(updated[i, j] - updated[j, i]))
    return smallest, asymmetry


@pytest.mark.long
def test_a_million_steps_leave_the_covariance_symmetric_and_positive():
    phi = np.array([[1.0, 0.01, 0.0], [0.0, 1.0, 0.01], [0.0, 0.0, 1.0]])
    w, c, r = np.diag([0.0, 1e-12, 1e-12]), np.array([[1.0, 0.0, 0.0]]), np.array([[0.04]])
    p = np.diag([1e6, 1e4, 1e2])
    smallest, asymmetry = many_steps(1_000_000, np.zeros(3), p, np.zeros(1), phi, w, c, r)
    assert smallest > 0.0 and asymmetry == 0.0
    assert np.linalg.eigvalsh(p).min() > 0.0
    again = phi @ update(np.zeros(3), p, np.zeros(1), c, r)[1] @ phi.T + w
    np.testing.assert_allclose(again, p, rtol=1e-9)  # the steady state of the Riccati equation


def exact_update(p, c, r):
    """(2.10), (2.11) in rational numbers: no rounding at all."""
    p = [[Fraction(float(v)) for v in row] for row in p]
    c, r, n = [Fraction(float(v)) for v in c], Fraction(r), len(p)
    pc = [sum(p[i][k] * c[k] for k in range(n)) for i in range(n)]
    s = sum(c[k] * pc[k] for k in range(n)) + r
    return np.array([[float(p[i][j] - pc[i] * pc[j] / s) for j in range(n)] for i in range(n)])


@pytest.mark.parametrize("seed", range(10))
def test_a_spread_of_1e12_with_a_variance_of_1e_12(seed):
    """Against exact arithmetic; each number compared in the standard deviations of its states."""
    rng = np.random.default_rng(seed)
    p = np.diag(np.geomspace(1e6, 1e-6, 4))
    c, r = rng.choice([-1.0, 1.0], 4) * np.geomspace(1e-3, 1e3, 4), 1e-12
    _, updated = update(np.zeros(4), p, np.zeros(1), c[None, :], np.array([[r]]))
    exact = exact_update(p, c, r)
    scale = np.sqrt(np.diag(exact))
    np.testing.assert_array_equal(updated, updated.T)
    assert np.diag(updated).min() > 0.0
    assert np.linalg.eigvalsh(updated / np.outer(scale, scale)).min() > -1e-12
    np.testing.assert_allclose(updated / np.outer(scale, scale), exact / np.outer(scale, scale), atol=1e-9)


def test_what_cannot_be_filtered_is_an_error():
    good = LinearSystem(np.eye(2), np.eye(2), np.eye(2), np.eye(2))
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        bad = LinearSystem(np.eye(2), np.eye(2), np.eye(2), -np.eye(2))
        filter_series(bad, np.zeros(2), np.eye(2), np.zeros((3, 2)))
    with pytest.raises(ValueError, match=r"outputs must have the shape \(N, 2\)"):
        filter_series(good, np.zeros(2), np.eye(2), np.zeros((3, 1)))
    with pytest.raises(ValueError, match="state and covariance"):
        filter_series(good, np.zeros(3), np.eye(2), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="output must have the shape"):
        LinearSystem(np.eye(2), np.ones((1, 3)), np.eye(2), np.eye(1))
    driven = LinearSystem(np.eye(2), np.eye(2), np.eye(2), np.eye(2), input_matrix=np.ones((2, 1)))
    with pytest.raises(ValueError, match="inputs must have the shape"):
        predict_ahead(driven, np.zeros(2), np.eye(2), 4)
    with pytest.raises(ValueError, match="given for 3 steps and 4 are asked for"):
        predict_ahead(LinearSystem(np.ones((3, 1, 1)), np.eye(1), np.eye(1), np.eye(1)), np.zeros(1), np.eye(1), 4)


def test_a_feedthrough_alone_and_inputs_that_are_not_written_to():
    system = LinearSystem(np.eye(1), np.eye(1), np.eye(1), np.eye(1), feedthrough=np.array([[2.0]]))
    x, p, y, u = np.zeros(1), np.eye(1), np.array([[5.0]]), np.array([[2.0]])
    series = filter_series(system, x, p, y, u)
    assert series.state[0, 0] == pytest.approx(0.5)  # halfway between 0 and y - D u = 1
    assert (x[0], p[0, 0], y[0, 0], u[0, 0]) == (0.0, 1.0, 5.0, 2.0)
