"""One model below and above an angle of attack: by draws in which it is one, and in which it is not."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.monitoring.range_agreement import (
    EVERY,
    RangeAgreement,
    agreeing,
    said_by_either,
)
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS

CM, PART, THETA = 4, slice(22, 26), np.array([0.02, -0.7, -7.0, -0.85])
ONLY_CM = np.arange(6) == CM
NOISE = np.zeros(4)
MINUTE, NOISE_OF_CM = 1500, 0.02
ALPHA = SIGNAL_INDEX["alpha"]


@pytest.fixture(scope="module")
def model():
    return load_aircraft(config_path("ultra_stick_25e.yaml")).model


def motion(rng, bend=0.0, colour=0.0, count=3 * MINUTE):
    """Samples of C_m: the angle of attack goes up and down, with faster motion on it; ``bend`` above 0.12 rad."""
    time = 0.04 * np.arange(count)
    alpha = 0.1 + 0.06 * np.sin(2.0 * np.pi * time / 23.0) + 0.01 * rng.standard_normal(count)
    x = np.column_stack([np.ones(count), alpha, *(rng.standard_normal((2, count)) * [[0.004], [0.03]])])
    error = NOISE_OF_CM * rng.standard_normal(count)
    for i in range(1, count if colour else 0):
        error[i] = colour * error[i - 1] + np.sqrt(1.0 - colour**2) * error[i]
    points = np.zeros((count, CoefficientSample.TERMS + 32))
    points[:, CoefficientSample.TIME] = time
    points[:, CoefficientSample.TERMS + PART.start : CoefficientSample.TERMS + PART.stop] = x
    points[:, CoefficientSample.SIGNALS.start + SIGNAL_INDEX["alpha"]] = alpha
    points[:, CoefficientSample.MEASURED.start + CM] = x @ THETA + bend * np.maximum(alpha - 0.12, 0.0) + error
    points[:, CoefficientSample.LEARNT] = 1.0
    return points


def said(model, points, noise=NOISE):
    ranges = RangeAgreement(model)
    for part in np.split(points, len(points) // 25):
        ranges.add(ONLY_CM, part)
    return ranges.disagreement(CM, noise)


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_one_model_is_one_in_white_noise_and_in_coloured(model, colour):
    rng = np.random.default_rng(3)
    assert [said(model, motion(rng, colour=colour)) for _ in range(20)] == [""] * 20


def test_what_bends_is_named_with_both_values_though_its_error_is_that_of_the_noise(model):
    points = motion(np.random.default_rng(4), bend=0.6)
    x = points[:, CoefficientSample.TERMS + PART.start : CoefficientSample.TERMS + PART.stop]
    y = points[:, CoefficientSample.MEASURED.start + CM]
    error = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    assert np.std(error) < 1.1 * NOISE_OF_CM
    words = said(model, points)
    assert words.startswith("no single model fits Cm: below an angle of attack of ") and "Cm_alpha" in words
    assert said(model, points, np.array([0.0, 1e-3, 0.0, 0.0])) == ""  # a vane with noise of 1.8° may bend it


def test_too_little_motion_says_nothing_and_an_axis_begins_anew(model):
    points = motion(np.random.default_rng(5), bend=5.0)
    assert said(model, points[: 25 * (2 * THRESHOLDS.range_blocks - 1)]) == ""
    ranges = RangeAgreement(model)
    ranges.add(ONLY_CM, points)
    assert ranges.disagreement(CM, NOISE)
    ranges.forget(CM)
    assert ranges.disagreement(CM, NOISE) == ""
    ranges.add(ONLY_CM, points[: 25 * EVERY])
    assert ranges.disagreement(CM, NOISE) == ""


def test_blocks_of_any_size_say_the_same(model):
    points = motion(np.random.default_rng(6), bend=0.6)
    ranges = RangeAgreement(model)
    for point in np.split(points, [7, 8, 1000, 1013, 4000]):
        ranges.add(ONLY_CM, point)
    assert ranges.disagreement(CM, NOISE) == said(model, points) != ""


def test_what_agrees_is_all_but_what_carries_the_difference_and_is_spared_where_either_part_says_so():
    low, high = np.array([1.0, 2.0, -3.0, 0.5]), np.array([1.01, 2.02, -3.02, 0.9])
    square = np.diag(np.square([0.02, 0.03, 0.04, 0.02]))
    theta, covariance = np.array([low, high]), np.array([square, square])
    assert agreeing(theta, covariance) == [0, 1, 2]
    assert agreeing(np.array([low, low]), covariance) == [0, 1, 2, 3]
    least, most = said_by_either(theta, covariance)
    assert np.all(least[:3] < low[:3] - 2.9 * np.sqrt(np.diag(square)[:3])) and np.isinf([least[3], most[3]]).all()


def test_a_part_is_surer_by_what_the_other_parameters_say_if_these_are_the_same_in_both():
    rng = np.random.default_rng(8)
    root = rng.standard_normal((2, 3, 3))
    covariance = root @ root.transpose(0, 2, 1) * 1e-4
    d = 0.3 * np.linalg.cholesky(covariance.sum(axis=0)) @ rng.standard_normal(3)
    theta = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0] + d])
    assert agreeing(theta, covariance) == [0, 1, 2]
    least, most = said_by_either(theta, covariance)
    for j in range(3):  # by generalised least squares over both parts, in which all but j are one parameter
        rest = [i for i in range(3) if i != j]
        x = np.zeros((6, 4))
        x[0 + j, 0] = x[3 + j, 1] = 1.0
        for column, i in enumerate(rest):
            x[i, 2 + column] = x[3 + i, 2 + column] = 1.0
        weight = np.zeros((6, 6))
        weight[:3, :3], weight[3:, 3:] = np.linalg.inv(covariance[0]), np.linalg.inv(covariance[1])
        inverse = np.linalg.inv(x.T @ weight @ x)
        value, std = (inverse @ x.T @ weight @ theta.ravel())[:2], np.sqrt(np.diag(inverse)[:2])
        assert least[j] == pytest.approx(np.min(value - THRESHOLDS.range_sigma * std))
        assert most[j] == pytest.approx(np.max(value + THRESHOLDS.range_sigma * std))


def test_what_bends_not_is_spared_unless_one_part_does_not_know_it(model):
    points = motion(np.random.default_rng(5), bend=0.6)
    ranges = RangeAgreement(model)
    ranges.add(ONLY_CM, points)
    assert ranges.disagreement(CM, NOISE)
    assert ranges.spared(CM, THETA).tolist() == [False, False, True, True]
    assert not ranges.spared(CM, 1.4 * THETA).any() and not ranges.spared(CM, 0.0 * THETA).any()
    of_q, slow = CoefficientSample.TERMS + PART.start + 2, points[:, CoefficientSample.SIGNALS][:, ALPHA] > 0.11
    points[slow, CoefficientSample.MEASURED.start + CM] -= 0.9 * THETA[2] * points[slow, of_q]
    points[slow, of_q] *= 0.1
    ranges = RangeAgreement(model)
    ranges.add(ONLY_CM, points)
    assert ranges.disagreement(CM, NOISE)
    assert ranges.spared(CM, THETA).tolist() == [False, False, False, True]
