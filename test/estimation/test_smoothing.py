"""Smoothing: the least-squares solution of the whole problem, both forms, and covariances that stay sound."""

import numpy as np
import pytest
from test_kalman_filter import at, simulate, spread, system_of

from aircraft_sysid_ros.estimation.kalman_filter import FilterSeries, LinearSystem, filter_series
from aircraft_sysid_ros.estimation.smoothing import (
    smooth_series,
    smooth_single_stage,
    smooth_single_stage_by_residual,
    smoothed_covariance,
    smoother_gain,
)

STEPS = 12


def record(seed, steps=STEPS, changing=False):
    """A system, what is known before, and a record of it with holes."""
    rng = np.random.default_rng(seed)
    system, x0, p0 = system_of(rng, steps if changing else None), rng.normal(size=3), spread(rng, 3)
    u = rng.normal(size=(steps, 2))
    x, y = simulate(system, rng, x0, p0, steps, u)
    y[rng.random(y.shape) < 0.2] = np.nan
    return system, x0, p0, u, x, y


def least_squares(system, x0, p0, u, y):
    """Means and covariance of [x(0), w(0) .. w(N-2)] given all outputs: one weighted least squares by QR.

    Every row is divided by its standard deviation; x(k) is linear in the unknowns.
    """
    n, m, steps = len(x0), system.noise.shape[1], len(y)
    size = n + m * (steps - 1)
    blocks, right = [np.linalg.solve(np.linalg.cholesky(p0), np.eye(n, size))], []
    right.append(np.linalg.solve(np.linalg.cholesky(p0), x0))
    by_unknowns, known, maps = np.eye(n, size), np.zeros(n), []
    for k in range(steps):
        maps.append((by_unknowns.copy(), known.copy()))
        there = np.isfinite(y[k])
        factor = np.linalg.cholesky(at(system.measurement_noise, k)[np.ix_(there, there)])
        c, d = at(system.output, k)[there], at(system.feedthrough, k)[there]
        blocks.append(np.linalg.solve(factor, c @ by_unknowns))
        right.append(np.linalg.solve(factor, y[k][there] - c @ known - d @ u[k]))
        if k < steps - 1:
            place = slice(n + m * k, n + m * (k + 1))
            rows = np.zeros((m, size))
            rows[:, place] = np.eye(m)
            blocks.append(np.linalg.solve(np.linalg.cholesky(at(system.noise, k)), rows))
            right.append(np.zeros(m))
            by_unknowns = at(system.transition, k) @ by_unknowns
            by_unknowns[:, place] += at(system.noise_input, k)
            known = at(system.transition, k) @ known + at(system.input_matrix, k) @ u[k]
    q, r = np.linalg.qr(np.vstack(blocks))
    inverse = np.linalg.solve(r, np.eye(size))
    return np.linalg.solve(r, q.T @ np.concatenate(right)), inverse @ inverse.T, maps


@pytest.mark.parametrize(("seed", "changing"), [(1, False), (2, True), (3, True)])
def test_the_smoother_is_least_squares_over_the_whole_record(seed, changing):
    system, x0, p0, u, _, y = record(seed, changing=changing)
    smoothed = smooth_series(system, filter_series(system, x0, p0, y, u))
    mean, covariance, maps = least_squares(system, x0, p0, u, y)
    for k, (by_unknowns, known) in enumerate(maps):
        np.testing.assert_allclose(smoothed.state[k], by_unknowns @ mean + known, rtol=1e-8, atol=1e-9)
        expected = by_unknowns @ covariance @ by_unknowns.T
        np.testing.assert_allclose(smoothed.covariance[k], expected, rtol=1e-8, atol=1e-9)
    for k in range(STEPS - 1):
        place = slice(3 + 2 * k, 5 + 2 * k)
        np.testing.assert_allclose(smoothed.noise[k], mean[place], rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(smoothed.noise_covariance[k], covariance[place, place], rtol=1e-8, atol=1e-9)


def test_covariances_are_the_printed_differences_and_the_end_is_the_filter():
    system, x0, p0, u, _, y = record(4, changing=True)
    f = filter_series(system, x0, p0, y, u)
    s = smooth_series(system, f)
    np.testing.assert_array_equal(s.state[-1], f.state[-1])
    np.testing.assert_array_equal(s.covariance[-1], f.covariance[-1])
    for k in range(STEPS - 1):
        phi, gamma, q = at(system.transition, k), at(system.noise_input, k), at(system.noise, k)
        less = f.predicted_covariance[k] - s.covariance[k + 1]
        c = f.covariance[k] @ phi.T @ np.linalg.inv(f.predicted_covariance[k])
        b = q @ gamma.T @ np.linalg.inv(f.predicted_covariance[k])
        np.testing.assert_allclose(s.covariance[k], f.covariance[k] - c @ less @ c.T, atol=1e-10)  # (2.22)
        np.testing.assert_allclose(s.noise_covariance[k], q - b @ less @ b.T, atol=1e-10)  # (2.23)
        assert np.linalg.eigvalsh(f.covariance[k] - s.covariance[k]).min() > -1e-12  # never worse than the filter


def test_noise_is_what_the_smoothed_states_leave_over():
    """Gamma w(k|N) = x(k+1|N) - Phi x(k|N) - Psi u(k)."""
    system, x0, p0, u, _, y = record(5, changing=True)
    s = smooth_series(system, filter_series(system, x0, p0, y, u))
    for k in range(STEPS - 1):
        left = s.state[k + 1] - at(system.transition, k) @ s.state[k] - at(system.input_matrix, k) @ u[k]
        np.testing.assert_allclose(at(system.noise_input, k) @ s.noise[k], left, atol=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_both_single_stage_forms_agree_and_the_printed_sign_does_not(seed):
    system, x0, p0, u, _, y = record(seed, steps=2)
    y = np.nan_to_num(y)
    f = filter_series(system, x0, p0, y, u)
    predicted, updated = (f.predicted_state[0], f.predicted_covariance[0]), (f.state[1], f.covariance[1])
    s = smooth_single_stage(system, f.state[0], f.covariance[0], predicted, updated)
    residual = y[1] - system.output[0] @ f.state[1] - system.feedthrough[0] @ u[1]
    x, w = smooth_single_stage_by_residual(system, f.state[0], f.covariance[0], residual)
    np.testing.assert_allclose(s.state, x, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(s.noise, w, rtol=1e-9, atol=1e-11)
    whole = smooth_series(system, f)
    np.testing.assert_allclose(s.covariance, whole.covariance[0], rtol=1e-12)
    np.testing.assert_allclose(s.noise_covariance, whole.noise_covariance[0], rtol=1e-12)
    c0 = f.covariance[0] @ system.transition[0].T @ np.linalg.inv(predicted[1])
    printed = f.state[0] + c0 @ (predicted[0] - updated[0])  # (2.16) with its printed sign
    assert np.linalg.norm(printed - x) > 1e-3


def test_a_state_that_is_known_exactly_needs_the_first_form():
    phi, known = np.array([[1.0, 1.0], [0.0, 1.0]]), np.diag([1.0, 0.0])
    system = LinearSystem(phi, np.array([[1.0, 0.0]]), np.zeros((1, 1)), np.eye(1), np.array([[1.0], [0.0]]))
    f = filter_series(system, np.zeros(2), known, np.array([[1.0], [2.0]]))
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        smooth_series(system, f)
    x, _ = smooth_single_stage_by_residual(system, f.state[0], f.covariance[0], np.array([2.0]) - f.state[1, :1])
    np.testing.assert_allclose(x, [1.0, 0.0])  # three equal weights: the start 0, and 1 and 2 of it


@pytest.mark.long
def test_smoothed_errors_are_smaller_than_filtered_ones_and_as_large_as_said():
    """150 flights of 20 steps: NEES of 3 states and of 2 noises, within 4 sigma; rms of the middle by a fifth less."""
    system, x0, p0, u, *_ = record(6, steps=20)
    rng, nees, noise_nees, rms = np.random.default_rng(60), [], [], []
    for _ in range(150):
        x, y = simulate(system, rng, x0, p0, 20, u)
        f = filter_series(system, x0, p0, y, u)
        s = smooth_series(system, f)
        error = x[10] - s.state[10]
        w, *_ = np.linalg.lstsq(
            system.noise_input[0], x[11] - system.transition[0] @ x[10] - system.input_matrix[0] @ u[10], rcond=None
        )
        nees.append(error @ np.linalg.solve(s.covariance[10], error))
        noise_nees.append((w - s.noise[10]) @ np.linalg.solve(s.noise_covariance[10], w - s.noise[10]))
        rms.append([np.sum(error**2), np.sum((x[10] - f.state[10]) ** 2)])
    assert np.mean(nees) == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / 150))
    assert np.mean(noise_nees) == pytest.approx(2.0, abs=4.0 * np.sqrt(4.0 / 150))
    smoothed, filtered = np.sqrt(np.mean(rms, axis=0))
    assert smoothed < 0.8 * filtered


@pytest.mark.long
def test_a_hundred_thousand_steps_stay_symmetric_and_positive():
    phi = np.array([[1.0, 0.01, 0.0], [0.0, 1.0, 0.01], [0.0, 0.0, 1.0]])
    noise = np.diag([1e-14, 1e-12, 1e-12])
    system = LinearSystem(phi, np.array([[1.0, 0.0, 0.0]]), noise, np.array([[0.04]]))
    y = np.random.default_rng(7).normal(size=(100_000, 1))
    f = filter_series(system, np.zeros(3), np.diag([1e6, 1e4, 1e2]), y)
    s = smooth_series(system, f)
    for matrices in (s.covariance, s.noise_covariance):
        np.testing.assert_array_equal(matrices, np.swapaxes(matrices, 1, 2))
    scale = np.sqrt(np.einsum("kii->ki", s.covariance))
    assert np.linalg.eigvalsh(s.covariance / (scale[:, :, None] * scale[:, None, :])).min() > 0.0
    assert np.all(scale <= np.sqrt(np.einsum("kii->ki", f.covariance)) * (1.0 + 1e-6))


@pytest.mark.parametrize("error", [0.0, 1e-6])
def test_ill_conditioned_covariances_stay_positive_where_the_printed_difference_does_not(error):
    """P from 1e-6 to 1e6 and the next state known to 1e-12, with a gain that is exact and a millionth wrong."""
    rng = np.random.default_rng(8)
    lowest = []
    for _ in range(50):
        q, _ = np.linalg.qr(rng.normal(size=(4, 4)))
        p = q @ np.diag(np.geomspace(1e-6, 1e6, 4)) @ q.T
        p, phi = 0.5 * (p + p.T), np.eye(4) + 0.1 * rng.normal(size=(4, 4))
        rest, known = 1e-6 * np.eye(4), 1e-12 * np.eye(4)
        predicted = phi @ p @ phi.T + rest
        predicted = 0.5 * (predicted + predicted.T)
        gain = smoother_gain(p, phi, predicted) * (1.0 + error)
        smoothed = smoothed_covariance(p, phi, gain, rest, known)
        np.testing.assert_array_equal(smoothed, smoothed.T)
        assert np.linalg.eigvalsh(smoothed).min() > 0.0
        lowest.append(np.linalg.eigvalsh(p - gain @ (predicted - known) @ gain.T).min())
    if error > 0.0:  # the difference takes away more than there is
        assert min(lowest) < -1.0


def test_a_record_of_one_step_has_nothing_to_smooth():
    system, x0, p0, u, _, y = record(9, steps=2)
    f = filter_series(system, x0, p0, y[:1], u[:1])
    s = smooth_series(system, f)
    np.testing.assert_array_equal(s.state, f.state)
    assert s.noise.shape == (0, 2) and s.noise_covariance.shape == (0, 2, 2)
    assert isinstance(f, FilterSeries)
