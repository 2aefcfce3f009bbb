"""Angles of the regressors: on time in gusts, those of the filter in calm air, and freed of the noise of the vanes."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.estimation.window_average import window_average
from aircraft_sysid_ros.identification.coefficients.flow_angles import ANGLES, STD, VANE_STD, VANES, share_in_window
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.coefficients.signals import flow_angle_rates
from aircraft_sysid_ros.identification.estimators.vane_noise import LARGEST_SHARE, compensation
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

SETTLED, DURATION = 25.0, 40.0  # [s]


class Gusts:
    """A flight of 40 s, its states, and the true angles at their times."""

    def __init__(self, aircraft, turbulence, noise=0.003):
        vanes = {name: replace(aircraft.sensors[name], noise=(noise,)) for _, name in VANES}
        aircraft = replace(aircraft, sensors={**aircraft.sensors, **vanes})
        self.flight = simulate_samples(aircraft, 5, DURATION, turbulence=turbulence)
        estimator = StateEstimator(aircraft)
        self.rows = np.vstack([estimator.push(self.flight.samples), estimator.flush()])
        self.epoch = estimator.epoch
        offset = (self.epoch - int(self.flight.biases.stamp[0])) * 1e-9
        truth = self.flight.truth.at(self.rows[:, StateField.TIME] + offset)
        self.truth = np.column_stack([truth.alpha, truth.beta])

    def identifier(self, samples=None, aircraft=None, **options):
        identifier = Identifier(aircraft or self.flight.aircraft, ParameterOptions(**options))
        identifier.push_samples(self.flight.samples if samples is None else samples, self.epoch)
        return identifier

    def angles(self, samples=None, aircraft=None, **options):
        """Of all states but the last, which have no sample after them."""
        identifier = self.identifier(samples, aircraft, **options)
        return identifier.stream._flow_angles(self.rows, len(self.rows) - 100), identifier

    def errors(self, angles):
        """Root mean square error (2,) after SETTLED."""
        late = self.rows[: len(angles), StateField.TIME] > self.rows[0, StateField.TIME] + SETTLED
        return np.sqrt(np.mean((angles[:, ANGLES:STD] - self.truth[: len(angles)])[late] ** 2, axis=0))


@pytest.fixture(scope="module")
def gusty(aircraft):
    return Gusts(aircraft, "light")


def lag_of(angles, truth, rows):
    """How late [s] an angle is: regression of its error on the rate of the truth."""
    rate = np.gradient(truth, rows[: len(truth), StateField.TIME])
    error = angles - truth
    return -float(rate @ error / (rate @ rate))


def test_in_gusts_the_angles_are_on_time_and_their_noise_is_found(gusty):
    measured, identifier = gusty.angles()
    of_filter, _ = gusty.angles(measured_angles=False)
    late = gusty.rows[: len(measured), StateField.TIME] > gusty.rows[0, StateField.TIME] + SETTLED
    rows = gusty.rows[: len(measured)][late]
    for k in range(2):
        truth = gusty.truth[: len(measured), k][late]
        assert abs(lag_of(measured[late, k], truth, rows)) < 0.25 * lag_of(of_filter[late, k], truth, rows)
    # straight lines between two samples leave 2/3 of the variance of their noise
    assert gusty.errors(measured) == pytest.approx(0.003 * np.sqrt(2.0 / 3.0), rel=0.2)
    left = 0.003 * np.sqrt(share_in_window(0.02, identifier.options.half_width))
    assert measured[late, VANE_STD:] == pytest.approx(left, rel=0.2)
    assert measured[late, STD:VANE_STD] == pytest.approx(measured[late, VANE_STD:], rel=1e-12)


def test_a_wrong_noise_in_the_file_is_found_out(aircraft, gusty):
    vanes = {name: replace(aircraft.sensors[name], noise=(0.001,)) for _, name in VANES}
    wrong = replace(aircraft, sensors={**aircraft.sensors, **vanes})
    measured, _ = gusty.angles(aircraft=wrong)
    assert measured[-500:, VANE_STD:].mean() == pytest.approx(0.003 * np.sqrt(share_in_window(0.02, 0.08)), rel=0.25)


def test_delay_scale_and_lever_arm_are_taken_off(aircraft, gusty):
    samples, vane = gusty.flight.samples, gusty.flight.samples.kind == Kind.ANGLE_OF_ATTACK
    stamp, values = samples.stamp.copy(), samples.values.copy()
    stamp[vane] += 30_000_000
    values[vane, 0] *= 1.2
    sensor = replace(aircraft.sensors["angle_of_attack"], delay=0.03, scale=1.2)
    other = replace(aircraft, sensors={**aircraft.sensors, "angle_of_attack": sensor})
    measured = gusty.angles(Samples(stamp, samples.kind, values), other)[0]
    assert measured[:, ANGLES] == pytest.approx(gusty.angles()[0][:, ANGLES], abs=1e-6)


def test_calm_air_stays_with_the_filter(aircraft):
    calm = Gusts(aircraft, "none")
    measured = calm.angles()[0]
    late = calm.rows[: len(measured), StateField.TIME] > calm.rows[0, StateField.TIME] + SETTLED
    assert np.array_equal(measured[late, ANGLES:STD], calm.rows[: len(measured)][late, 48:50])
    assert not measured[late, VANE_STD:].any()


@pytest.mark.parametrize("what", ["lost", "repeated", "slow", "far off"])
def test_without_sound_samples_on_both_sides_it_is_the_filter(what, gusty):
    samples = gusty.flight.samples
    since = samples.stamp[0] + int(30e9)
    bad = np.flatnonzero((samples.kind == Kind.ANGLE_OF_ATTACK) & (samples.stamp > since))
    keep, values = np.ones(len(samples), bool), samples.values.copy()
    if what == "lost":
        keep[bad] = False
    elif what == "slow":
        keep[bad[np.arange(len(bad)) % 8 > 0]] = False
    else:
        values[bad, 0] = 0.1 if what == "repeated" else 0.5
    measured = gusty.angles(Samples(samples.stamp[keep], samples.kind[keep], values[keep]))[0]
    after = gusty.rows[: len(measured), StateField.TIME] > gusty.rows[0, StateField.TIME] + 31.0
    assert np.array_equal(measured[after, ANGLES], gusty.rows[: len(measured)][after, StateField.ANGLE_OF_ATTACK])
    assert not measured[after, VANE_STD].any() and measured[after, VANE_STD + 1].any()


@pytest.mark.long
def test_any_portions_give_the_same_bits(gusty):
    def points(size):
        identifier = gusty.identifier()
        parts = [identifier.push_states(gusty.rows[i : i + size], gusty.epoch) for i in range(0, len(gusty.rows), size)]
        return np.vstack([*parts, identifier.flush()]), identifier.estimates()

    (one, first), (other, second) = points(1), points(10**6)
    assert np.array_equal(one[:, CoefficientSample.SIGNALS], other[:, CoefficientSample.SIGNALS], equal_nan=True)
    assert repr(first.parameters) == repr(second.parameters)


@pytest.mark.parametrize("interval", [0.01, 0.02, 0.04, 0.1])
def test_the_noise_that_a_window_leaves(interval):
    """Sums of squared weights of the samples, over all places of the window between them."""
    times, half_width, found = np.arange(0.0, 1.2, 0.01), 0.08, []
    for phase in np.linspace(0.0, interval, 10, endpoint=False):
        samples = np.arange(-0.2, 1.6, interval) + phase
        weights = np.array([np.interp(times, samples, each) for each in np.eye(len(samples))]).T.copy()
        means, slopes = np.empty(len(samples)), np.empty(len(samples))
        window_average(times, weights, 50, 70, 0.6, half_width, means, slopes, False)
        found.append(np.sum(means**2))
    assert share_in_window(interval, half_width) == pytest.approx(np.mean(found), rel=0.04)


def test_compensated_least_squares_is_true_on_the_average():
    """Two collinear terms of one noisy angle: x and x^2 with the noise of x in both."""
    random, truth, std, count = np.random.default_rng(1), np.array([2.0, -3.0, 1.0]), 0.05, 400
    plain, freed = [], []
    for _ in range(300):
        x = 0.3 + 0.2 * random.standard_normal(count)
        y = np.column_stack([np.ones(count), x, x**2]) @ truth + 0.01 * random.standard_normal(count)
        noisy = x + std * random.standard_normal(count)
        terms = np.column_stack([np.ones(count), noisy, noisy**2])
        inverse = np.linalg.inv(terms.T @ terms)
        slopes = np.column_stack([np.zeros(count), np.ones(count), 2.0 * noisy]) * std
        theta = inverse @ terms.T @ y
        plain.append(theta)
        freed.append(compensation(inverse, float(count), slopes.T @ slopes / count).freed(theta))
    bias, left = (np.abs(np.mean(found, axis=0) - truth) for found in (plain, freed))
    assert np.all(left < 0.25 * bias)


def test_a_correction_has_its_limit_and_its_error():
    inverse, covariance = np.diag([1.0, 4.0]), np.diag([0.0, 10.0])
    put_right = compensation(inverse, 1.0, covariance)  # forty times more noise than signal
    theta = np.array([1.0, 1.0])
    assert put_right.freed(theta) == pytest.approx([1.0, 1.0 / (1.0 - LARGEST_SHARE)])
    assert put_right.widened(np.zeros((2, 2)), theta)[1, 1] > 0.0
    unknown = np.array([1.0, np.nan])
    assert put_right.freed(unknown)[0] == 1.0 and np.isnan(put_right.freed(unknown)[1])


def test_an_angle_that_nobody_knows_takes_nothing_from_the_rate_of_the_other(aircraft):
    """A vane for one angle, in gusts: the kinematics of that one stand on the air velocity, which is always there."""
    rows = Gusts(aircraft, "none").rows
    row = rows[len(rows) // 2].copy()
    alpha_dot, beta_dot = flow_angle_rates(row, 9.8)
    for column, known, place in ((StateField.SIDESLIP, alpha_dot, 0), (StateField.ANGLE_OF_ATTACK, beta_dot, 1)):
        without = row.copy()
        without[column] = np.nan
        rates = flow_angle_rates(without, 9.8)
        assert rates[place] == pytest.approx(known, rel=1e-12) and np.isnan(rates[1 - place])
