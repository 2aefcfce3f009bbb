"""The filter against the textbook update, and its statistics against those of its noise."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.frames import rotation_matrix
from aircraft_sysid_ros.flight_model.bank import bank_step, filter_bank, run_filter, simulation_bank
from aircraft_sysid_ros.flight_model.derivatives import aerodynamics
from aircraft_sysid_ros.flight_model.dynamics import move
from aircraft_sysid_ros.flight_model.filter import filter_step, model_outputs, output_variance
from aircraft_sysid_ros.flight_model.layout import make_theta, process_slice
from aircraft_sysid_ros.flight_model.outputs import output_jacobian

START = np.diag([0.1] * 3 + [1.0] * 3 + [0.02] * 3 + [0.01] * 3 + [0.5] * 3) ** 2


def noisy(record, seed, gps_every=10):
    """Outputs with the noise of the aircraft file, GPS at a tenth of the rate, without attitude."""
    random = np.random.default_rng(seed)
    y = record.outputs + random.normal(size=record.outputs.shape) * record.model.output_std
    y[np.arange(len(y)) % gps_every != 0, 6:12] = np.nan
    y[:, 12:15] = np.nan
    return y


def start_near(record, k, seed):
    x = record.states[k].copy()
    move(x, np.random.default_rng(seed).normal(size=15) * np.sqrt(np.diag(START)))
    return x


def test_one_output_after_the_other_is_the_update_with_all(record):
    """Innovations are those of the vector update, decorrelated: the same state, covariance and likelihood."""
    k = 800
    x, p, inputs = record.states[k].copy(), START.copy(), record.inputs[k]
    y = record.outputs[k] + 0.5 * record.model.output_std
    y[12:15] = [0.01, -0.02, np.nan]
    innovation, variance = np.empty(18), np.empty(18)
    filter_step(x, p, inputs, inputs, 0.0, y, record.theta, record.model, innovation, variance)
    before, c = record.states[k], rotation_matrix(record.states[k, 6:10])
    predicted, h, r = np.empty(18), np.empty((18, 15)), np.empty(18)
    model_outputs(before, inputs, record.theta, record.model, predicted)
    air = aerodynamics(before, c, inputs, record.theta, record.model)
    output_jacobian(before, c, air, predicted[12:15].copy(), record.model, h)
    output_variance(record.theta, record.model, r)
    there = np.isfinite(y)
    h, e = h[there], (y - predicted)[there]
    s = h @ START @ h.T + np.diag(r[there])
    gain = np.linalg.solve(s, h @ START).T
    expected, error = before.copy(), gain @ e
    move(expected, error)
    np.testing.assert_allclose(x, expected, atol=1e-9)
    np.testing.assert_allclose(p, START - gain @ h @ START, atol=1e-10)
    assert np.array_equal(np.isnan(innovation), ~there) and np.array_equal(np.isnan(variance), ~there)
    assert np.nansum(innovation**2 / variance) == pytest.approx(e @ np.linalg.solve(s, e), rel=1e-9)
    assert np.nansum(np.log(variance)) == pytest.approx(np.linalg.slogdet(s)[1], rel=1e-9)


def test_innovations_are_as_large_as_their_variances_and_white(fast_record):
    """With true parameters, over two runs of 5 s; every output within 4 standard errors of one."""
    record = fast_record
    part = slice(500, 1500)
    ratio = []
    for seed in range(2):
        y = noisy(record, seed)[part]
        x, p = start_near(record, 500, seed), START.copy()
        innovation, variance = np.empty((1000, 18)), np.empty((1000, 18))
        theta = record.theta
        run_filter(x, p, record.time[part], record.inputs[part], y, theta, record.model, innovation, variance)
        ratio.append(innovation / np.sqrt(variance))
        np.testing.assert_array_equal(p, p.T)
        assert np.linalg.eigvalsh(p).min() > -1e-15  # without process noise the rates become known
    ratio = np.concatenate(ratio)
    counts = np.sum(np.isfinite(ratio), axis=0)
    measured = counts > 0
    mean_square = np.nanmean(ratio[:, measured] ** 2, axis=0)
    assert np.all(np.abs(mean_square - 1.0) < 4.0 * np.sqrt(2.0 / counts[measured]))
    fast = ratio[:, [0, 1, 2, 3, 4, 5, 15, 16, 17]]
    assert np.all(np.abs(np.mean(fast[1:] * fast[:-1], axis=0)) < 4.0 / np.sqrt(len(fast)))


def test_without_noise_the_filter_is_the_simulation(record):
    part = slice(1000, 1200)
    times, inputs, start = record.time[part], record.inputs[part], record.states[1000]
    simulated = simulation_bank(start[None], times, inputs, record.theta[None], record.model)[0]
    y = record.outputs[part]
    innovation, variance = filter_bank(start, np.zeros((15, 15)), times, inputs, y, record.theta[None], record.model)
    np.testing.assert_allclose(innovation[0], y - simulated, atol=1e-12)
    r = np.empty(18)
    output_variance(record.theta, record.model, r)
    np.testing.assert_allclose(variance[0], np.tile(r, (200, 1)), rtol=1e-12)
    # and stays near the truth over 4 s: the record holds all inputs
    assert np.max(np.abs(simulated[:, :3] - y[:, :3])) < 0.3


def test_gusts_make_the_innovations_less_certain(record):
    theta = record.theta.copy()
    theta[process_slice(record.model)] = np.log([0.5, 0.3, 0.05])
    times, inputs, y = record.time[:200], record.inputs[:200], noisy(record, 1)[:200]
    thetas = np.stack([record.theta, theta])
    _, variance = filter_bank(record.states[0], START, times, inputs, y, thetas, record.model)
    x, p = record.states[0].copy(), START.copy()
    run_filter(x, p, times, inputs, y, theta, record.model, np.empty((200, 18)), np.empty((200, 18)))
    assert np.linalg.eigvalsh(p).min() > 0.0 and np.array_equal(p, p.T)
    there = np.isfinite(variance[0, -1])
    assert np.all(variance[1, -1, there] > variance[0, -1, there])


def test_a_bank_in_steps_is_the_bank_over_a_record(record):
    times, inputs, y = record.time[:100], record.inputs[:100], noisy(record, 1)[:100]
    thetas = np.stack([record.theta, 1.01 * record.theta])
    thetas[:, process_slice(record.model)] = np.log([0.1, 0.1, 0.01])
    innovations, variances = filter_bank(record.states[0], START, times, inputs, y, thetas, record.model)
    states, covariances = np.tile(record.states[0], (2, 1)), np.tile(START, (2, 1, 1))
    e, s = np.empty((2, 18)), np.empty((2, 18))
    for k in range(100):
        before = max(k - 1, 0)
        dt = times[k] - times[before]
        bank_step(states, covariances, inputs[before], inputs[k], dt, y[k], thetas, record.model, e, s)
        np.testing.assert_array_equal(e, innovations[:, k])
        np.testing.assert_array_equal(s, variances[:, k])


def test_theta_has_its_places(record):
    theta = make_theta(record.model, np.arange(32.0), np.arange(6.0), (1.0, 2.0, 0.0), np.full(8, 3.0))
    assert len(theta) == 49 and theta[31] == 31.0 and theta[37] == 5.0
    np.testing.assert_allclose(np.exp(theta[process_slice(record.model)]), [1.0, 2.0, 0.0])
