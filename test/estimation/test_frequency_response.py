"""Frequency responses of systems that are known: within their standard errors, and coherent as theory has it."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import f as fisher

from aircraft_sysid_ros.estimation.frequency_response import OVERLAP, frequency_response

STEP = 0.04


def system(x, gain, pole):
    """y(k) = pole y(k-1) + gain x(k)."""
    return lfilter([gain], [1.0, -pole], x)


def truth(frequency, gain, pole):
    return gain / (1.0 - pole * np.exp(-2j * np.pi * frequency * STEP))


def test_a_known_system_is_found_within_its_standard_error():
    inside = []
    for seed in range(20):
        random = np.random.default_rng(seed)
        x = random.normal(size=3000)
        y = system(x, 0.2, 0.9) + 0.3 * random.normal(size=3000)
        found = frequency_response([x[:, None]], [y], STEP, 8.0)
        error = np.abs(found.response[:, 0] / truth(found.frequency, 0.2, 0.9) - 1.0)
        low = found.frequency < 4.0
        free = 2.0 * (found.windows / OVERLAP - 1.0)
        limit = np.sqrt(2.0 * fisher.ppf(0.95, 2, free))  # two parts of one error, whose variance is estimated
        inside.append(error[low] < limit * found.std[low, 0])
    assert 0.92 < np.mean(inside) < 0.98


def test_coherence_is_that_of_signal_and_noise():
    random = np.random.default_rng(1)
    x = random.normal(size=60_000)
    y = 2.0 * x + 2.0 * random.normal(size=60_000)
    found = frequency_response([x[:, None]], [y], STEP, 8.0)
    assert np.mean(found.coherence) == pytest.approx(0.5, abs=0.02)


def test_correlated_inputs_are_told_apart():
    random = np.random.default_rng(2)
    first = random.normal(size=20_000)
    second = 0.9 * first + 0.5 * random.normal(size=20_000)  # as a rudder that follows the aileron
    y = system(first, 0.2, 0.9) - system(second, 0.1, 0.8) + 0.05 * random.normal(size=20_000)
    found = frequency_response([np.column_stack([first, second])], [y], STEP, 8.0)
    low = found.frequency < 3.0
    for k, (gain, pole) in enumerate([(0.2, 0.9), (-0.1, 0.8)]):
        ratio = found.response[low, k] / truth(found.frequency[low], gain, pole)
        assert np.median(np.abs(ratio - 1.0)) < 0.05
    alone = frequency_response([first[:, None]], [y], STEP, 8.0)
    assert np.median(np.abs(alone.response[low, 0] / truth(found.frequency[low], 0.2, 0.9) - 1.0)) > 0.3


def test_an_input_without_effect_is_not_coherent_and_one_that_rests_is_none():
    random = np.random.default_rng(3)
    x = np.column_stack([random.normal(size=20_000), random.normal(size=20_000), np.zeros(20_000)])
    found = frequency_response([x], [system(x[:, 0], 0.2, 0.9)], STEP, 8.0)
    assert np.median(found.coherence[:, 0]) > 0.95 and np.median(found.coherence[:, 1]) < 0.05
    assert not np.isfinite(found.response[:, 2]).any()


def test_pieces_are_not_joined_and_too_few_are_none():
    random = np.random.default_rng(4)
    x = random.normal(size=4000)
    y = system(x, 0.2, 0.9)
    pieces = [slice(0, 1500), slice(1700, 1800), slice(2000, 4000)]
    found = frequency_response([x[p, None] for p in pieces], [y[p] for p in pieces], STEP, 8.0)
    assert found.windows == 14 + 0 + 19
    x[1000] = np.nan
    assert frequency_response([x[p, None] for p in pieces], [y[p] for p in pieces], STEP, 8.0).windows == 12 + 0 + 19
    assert frequency_response([x[:300, None]], [y[:300]], STEP, 8.0) is None
    assert frequency_response([], [], STEP, 8.0) is None
