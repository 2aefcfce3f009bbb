"""Recursive Fourier transforms: the integral, the derivative without differentiating, and honest least squares."""

import numpy as np
import pytest

from aircraft_sysid_ros.estimation.recursive_fourier import (
    Window,
    advance,
    derivative_transform,
    spectral_covariance,
    spectral_least_squares,
    step_factor,
)

FREQUENCIES = 2.0 * np.pi * np.array([0.0, 0.1, 0.45, 0.9, 2.0])
MEMORY = 7.0


def transform(signals, times, frequencies=FREQUENCIES, memory=MEMORY):
    """Recursive transforms (c, m) and boundary terms (c, m) of signals (c, n) over one stretch."""
    out = np.zeros((len(signals), len(frequencies)), complex)
    boundary = -signals[:, :1] * np.ones(len(frequencies), complex)
    factor = np.zeros(len(frequencies), complex)
    columns = np.ascontiguousarray(signals.T)
    for k in range(1, len(times)):
        step = times[k] - times[k - 1]
        step_factor(frequencies, memory, step, factor)
        advance(out, columns[k - 1], columns[k], step, factor)
        boundary *= factor
    return out, boundary


def oscillation(t):
    """A signal, its derivative, and the exact transform of exp((a + jb) t) from which both are made."""
    a, b = -0.02, 2.1
    return (np.exp((a + 1j * b) * t)).real + 0.3, ((a + 1j * b) * np.exp((a + 1j * b) * t)).real


def exact(rate, pole, length):
    """integral_0^T exp(rate (T - t)) exp(pole t) dt."""
    return (np.exp(pole * length) - np.exp(rate * length)) / (pole - rate)


def test_the_recursion_is_the_integral_also_with_uneven_steps():
    rng = np.random.default_rng(0)
    times = np.cumsum(rng.uniform(0.002, 0.018, 1500))
    times -= times[0]
    x, _ = oscillation(times)
    ours, _ = transform(x[None], times)
    rate, pole, length = 1j * FREQUENCIES - 1.0 / MEMORY, -0.02 + 2.1j, times[-1]
    of_real = 0.5 * (exact(rate, pole, length) + exact(rate, np.conj(pole), length))
    np.testing.assert_allclose(ours[0], of_real + 0.3 * exact(rate, 0.0, length), atol=3e-4)


def test_a_derivative_is_transformed_without_differentiating():
    """Against the transform of the exact derivative, finely sampled; the other signs of the rate are far away."""
    times = np.arange(0.0, 15.0, 0.002)
    x, slope = oscillation(times)
    ours, boundary = transform(np.stack([x, slope]), times)
    found = derivative_transform(ours[0], boundary[0], x[-1], FREQUENCIES, MEMORY)
    np.testing.assert_allclose(found, ours[1], atol=1e-4)  # h^2 / 12 of the slope at the end, times w
    for wrong in (1j * FREQUENCIES + 1.0 / MEMORY, -1j * FREQUENCIES - 1.0 / MEMORY):
        assert np.abs(boundary[0] + x[-1] + wrong * ours[0] - ours[1]).max() > 0.1
    assert np.abs(1j * FREQUENCIES * ours[0] - ours[1]).max() > 0.1  # no boundary terms, no memory


def test_stretches_with_a_gap_between_have_two_boundary_terms_each():
    times = np.arange(0.0, 20.0, 0.002)
    x, slope = oscillation(times)
    first, second = slice(0, 4000), slice(7000, 10000)
    total, boundary = transform(np.stack([x, slope])[:, first], times[first])
    boundary[0] += x[first][-1]
    later, later_boundary = transform(np.stack([x, slope])[:, second], times[second])
    factor = np.zeros(len(FREQUENCIES), complex)
    step_factor(FREQUENCIES, MEMORY, times[second][-1] - times[second][0], factor)  # time stood still in the gap
    total, boundary = factor * total + later, factor * boundary + later_boundary
    found = derivative_transform(total[0], boundary[0], x[second][-1], FREQUENCIES, MEMORY)
    np.testing.assert_allclose(found, total[1], atol=2e-4)


def test_a_million_steps_neither_grow_nor_drift():
    times = np.arange(1_000_000) * 0.01
    x = np.ones((1, 1))
    out, factor = np.zeros((1, len(FREQUENCIES)), complex), np.zeros(len(FREQUENCIES), complex)
    step_factor(FREQUENCIES, MEMORY, 0.01, factor)
    for _ in range(len(times) // 10):
        advance(out, x[0], x[0], 0.01, factor)
    rate = 1j * FREQUENCIES - 1.0 / MEMORY
    np.testing.assert_allclose(out[0], -1.0 / rate, rtol=2e-3)
    before = out.copy()
    advance(out, x[0], x[0], 0.01, factor)
    np.testing.assert_allclose(out, before, atol=1e-12)


def test_the_energy_is_the_covariance_of_transforms_of_white_noise():
    window = Window(FREQUENCIES, MEMORY, 11.0)
    t = np.arange(0.0, 11.0, 1e-4) + 5e-5
    for difference in (0.0, 0.3, 5.0):
        numeric = np.sum(np.exp((1j * difference - 2.0 / MEMORY) * t)) * 1e-4
        assert window.energy(difference) == pytest.approx(numeric, abs=1e-4)
    short = Window(FREQUENCIES, 1e6, 20.0)
    assert short.freedom == pytest.approx(2.0 * 1.9 * 20.0, rel=1e-3)  # 2 B T


# -- least squares --------------------------------------------------------------------------------------------

TRUE = np.array([0.3, 2.0, -1.0])
TIMES = np.arange(0.0, 40.0, 0.02)
BAND = np.concatenate([[0.0], 2.0 * np.pi * np.arange(0.1, 2.001, 0.02)])
WINDOW = Window(BAND, 60.0, float(TIMES[-1]))
REGRESSORS = np.stack([np.ones_like(TIMES), np.sin(1.3 * TIMES + 0.08 * TIMES**2), np.cos(3.0 * TIMES + 2.0)])


def test_without_noise_it_is_exact():
    y = TRUE @ REGRESSORS
    x, _ = transform(np.vstack([REGRESSORS, y]), TIMES, BAND, WINDOW.memory)
    fit = spectral_least_squares(x[:3].T.copy(), x[3], WINDOW)
    np.testing.assert_allclose(fit.solution.estimate, TRUE, rtol=1e-10)


@pytest.mark.parametrize("colour", ["white", "differentiated"])
def test_standard_errors_cover_and_neighbouring_frequencies_do_not_count_twice(colour):
    """120 runs; the frequencies are finer than the window resolves: taken for independent they promise too much."""
    rng = np.random.default_rng(1)
    x, _ = transform(REGRESSORS, TIMES, BAND, WINDOW.memory)
    z, naive = [], []
    noise = rng.normal(size=(120, len(TIMES) + 1))
    noise = noise[:, 1:] if colour == "white" else np.diff(noise, axis=1) * 5.0
    of_noise, _ = transform(noise, TIMES, BAND, WINDOW.memory)
    for e in of_noise:
        fit = spectral_least_squares(x.T.copy(), x.T @ TRUE + e, WINDOW)
        covariance = spectral_covariance(fit, x.T.copy(), WINDOW)
        assert np.linalg.eigvalsh(covariance)[0] > 0.0
        z.append((fit.solution.estimate - TRUE) / np.sqrt(np.diag(covariance)))
        scale = WINDOW.energy(0.0).real
        naive.append((fit.solution.estimate - TRUE) / np.sqrt(np.diag(fit.solution.inverse) * scale))
    inside = np.mean(np.abs(np.array(z)[:, 1:]) < 1.96)
    assert abs(inside - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / 240) + 0.01
    if colour == "white":
        assert 0.9 < np.mean(np.abs(np.array(z)[:, 0]) < 1.96) <= 1.0  # the constant, by the zero frequency
        assert np.mean(np.abs(np.array(naive)[:, 1:]) < 1.96) < inside - 0.03


def test_the_spectrum_gives_weights_that_beat_equal_ones_on_differentiated_noise():
    rng = np.random.default_rng(2)
    noise = np.diff(rng.normal(size=(60, len(TIMES) + 1)), axis=1) * 5.0
    x, _ = transform(REGRESSORS, TIMES, BAND, WINDOW.memory)
    of_noise, _ = transform(noise, TIMES, BAND, WINDOW.memory)
    ours, equal = [], []
    for e in of_noise:
        response = x.T @ TRUE + e
        ours.append(spectral_least_squares(x.T.copy(), response, WINDOW).solution.estimate[1:])
        rows = np.concatenate([x.T.real, x.T.imag])
        equal.append(np.linalg.lstsq(rows, np.concatenate([response.real, response.imag]), rcond=None)[0][1:])
    chirp, single_frequency = np.std(ours, axis=0) / np.std(equal, axis=0)
    assert chirp < 0.8 and single_frequency < 1.05


def test_what_is_not_determined_is_said_and_the_rest_holds():
    x, _ = transform(np.vstack([REGRESSORS, -2.0 * REGRESSORS[1]]), TIMES, BAND, WINDOW.memory)
    rng = np.random.default_rng(3)
    e, _ = transform(rng.normal(size=(1, len(TIMES))), TIMES, BAND, WINDOW.memory)
    fit = spectral_least_squares(x.T.copy(), x[:3].T @ TRUE + e[0], WINDOW)
    covariance = spectral_covariance(fit, x.T.copy(), WINDOW)
    np.testing.assert_array_equal(fit.solution.determined, [True, False, True, False])
    assert np.isnan(covariance[1, 1]) and abs(fit.solution.estimate[2] - TRUE[2]) < 5.0 * covariance[2, 2] ** 0.5


def test_without_degrees_of_freedom_there_is_no_covariance():
    window = Window(BAND, 60.0, 0.5)  # 2 B T is 1.9
    x, _ = transform(REGRESSORS[:, :26], TIMES[:26], BAND, 60.0)
    fit = spectral_least_squares(x.T.copy(), x.T @ TRUE, window)
    assert np.isnan(spectral_covariance(fit, x.T.copy(), window)).all()
