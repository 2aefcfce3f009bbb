"""A model that does not explain a coefficient has no parameter to fly on in that axis, however small its errors."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.estimation.window_average import window_average
from aircraft_sysid_ros.identification.coefficients.body import body_of
from aircraft_sysid_ros.identification.coefficients.evaluation import measured_coefficients
from aircraft_sysid_ros.identification.coefficients.layout import (
    FLYING,
    FORCE,
    LEARNT,
    MEASURED,
    QBAR,
    RATE,
    SIGNAL,
    TIME,
    CoefficientBatch,
    CoefficientSample,
)
from aircraft_sysid_ros.identification.monitoring.coefficient_noise import CoefficientNoise
from aircraft_sysid_ros.identification.monitoring.residuals import (
    FIT_BLOCKS,
    GUARD,
    WINDOW,
    ResidualMonitor,
)
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust, lack_of_fit
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

STEP = 0.04
ALL = np.ones(6, np.bool_)


def samples_of(measured, axis=4):
    """Samples of one axis that learns from each."""
    samples = np.zeros((len(measured), CoefficientSample.TERMS))
    samples[:, CoefficientSample.TIME] = STEP * np.arange(len(measured))
    samples[:, MEASURED + axis], samples[:, LEARNT + axis] = measured, 1.0
    return samples


def predictions(values, axis=4):
    predicted = np.zeros((len(values), 6))
    predicted[:, axis] = values
    return predicted


def flown(aircraft, samples):
    pipeline = Pipeline(aircraft)
    pipeline.push(samples)
    pipeline.flush()
    return pipeline.parameters


def of_axis(found, axis):
    return [p for p in found.parameters if p.name.startswith(f"{axis}_")]


@pytest.mark.parametrize("block", [1, 7, 10_000])
def test_it_is_one_minus_the_share_of_the_variance_that_is_explained(block):
    random, monitor = np.random.default_rng(1), ResidualMonitor(STEP)
    truth = random.normal(-0.3, 0.1, 40 * WINDOW + GUARD)
    predicted = 0.5 * truth
    samples = samples_of(truth)
    for first in range(0, len(truth), block):
        part = slice(first, first + block)
        monitor.add(samples[part], predictions(predicted[part]), ALL)
    used = slice((40 - FIT_BLOCKS) * WINDOW, 40 * WINDOW)  # the newest are left out, the oldest forgotten
    expected = np.mean((truth - predicted)[used] ** 2) / np.var(truth[used])
    assert monitor.unexplained(4) == pytest.approx(expected, rel=1e-9)
    assert np.isnan(monitor.unexplained(0))


def test_a_coefficient_that_hardly_moves_says_nothing_of_a_model_that_explained_its_motion():
    random, monitor = np.random.default_rng(2), ResidualMonitor(STEP)
    moving = np.sin(np.arange(THRESHOLDS.least_blocks * WINDOW + GUARD) * 0.2)
    noise = 0.02 * random.normal(size=200 * WINDOW)
    measured = np.concatenate([moving, noise])
    predicted = np.concatenate([moving + 0.02, np.zeros(len(noise))])  # in cruise all is noise
    monitor.add(samples_of(measured), predictions(predicted), ALL)
    assert monitor.unexplained(4) < 0.01
    wrong = np.concatenate([moving, moving, moving])
    monitor.add(samples_of(wrong), predictions(0.0 * wrong), ALL)
    assert monitor.unexplained(4) > 0.5


@pytest.mark.parametrize("block", [1, 7, 10_000])
def test_the_error_over_its_noise_is_that_of_the_same_blocks_and_nothing_where_noise_is_not_known(block):
    random, monitor = np.random.default_rng(4), ResidualMonitor(STEP)
    truth = random.normal(-0.3, 0.1, 40 * WINDOW + GUARD)
    noise = np.zeros((len(truth), 6))
    noise[:, 4] = random.uniform(1e-4, 4e-4, len(truth))
    noise[: 20 * WINDOW, 4] = np.nan  # the estimator knew nothing
    samples, predicted = samples_of(truth), predictions(truth + 0.04)
    for first in range(0, len(truth), block):
        part = slice(first, first + block)
        monitor.add(samples[part], predicted[part], ALL, noise[part])
    of_blocks = noise[20 * WINDOW : 40 * WINDOW, 4].reshape(20, WINDOW).mean(axis=1)
    assert monitor.over_noise(4) == pytest.approx(np.sqrt(np.mean(0.04**2 / of_blocks)), rel=1e-9)
    assert np.isnan(monitor.over_noise(0))


def test_a_model_that_is_wrong_in_a_part_of_the_motion_is_told_by_a_tenth_of_it():
    random, monitor = np.random.default_rng(6), ResidualMonitor(STEP)
    truth, noise = random.normal(-0.3, 0.1, 40 * WINDOW + GUARD), np.full((40 * WINDOW + GUARD, 6), 0.02**2)
    wrong = random.normal(0.0, 0.02, len(truth))
    wrong[15 * WINDOW : 19 * WINDOW] *= 3.5
    monitor.add(samples_of(truth), predictions(truth + wrong), ALL, noise)
    assert monitor.over_noise(4) < 0.6 * THRESHOLDS.beyond_noise
    assert 3.0 < monitor.worst_over_noise(4) < 4.2 and np.isnan(monitor.worst_over_noise(0))
    words = lack_of_fit("Cm", 0.02, monitor.over_noise(4), monitor.worst_over_noise(4))
    assert words.startswith("the error of Cm is ") and words.endswith("in a tenth of the motion")


def test_what_is_said_of_an_axis():
    assert lack_of_fit("Cm", 0.02, 2.9) == lack_of_fit("Cm", 0.02) == ""
    assert lack_of_fit("Cm", 0.12, 4.2) == "the error of Cm is 4.2 times its noise: the model explains 88.0% of it"
    assert lack_of_fit("Cm", 0.3, 4.2) == lack_of_fit("Cm", 0.3, 0.5) == "the model explains 70% of Cm"


@pytest.mark.parametrize(
    ("rate", "factor"), [(100.0, 1.0), (100.0, 3.0), (200.0, 1.0), (50.0, 0.4), (25.0, 0.5), (10.0, 0.5)]
)
def test_noise_of_the_imu_makes_of_coefficients_what_it_says(aircraft, rate, factor):
    """Windows over white noise: as much as there is of it, whatever the file says."""
    random, count, half_width = np.random.default_rng(5), 6000, 0.08
    force, gyro = (factor * aircraft.sensors[name].noise[0] for name in ("accelerometer", "gyro"))
    rows, history = np.zeros((count, StateField.WIDTH)), np.zeros((count, SIGNAL))
    rows[:, StateField.TIME] = history[:, TIME] = np.arange(count) / rate
    rows[:, StateField.SPECIFIC_FORCE] = force * random.normal(size=(count, 3))
    rows[:, StateField.ANGULAR_VELOCITY] = gyro * random.normal(size=(count, 3))
    history[:, FLYING], history[:, QBAR] = 1.0, 150.0
    history[:, FORCE : FORCE + 3] = aircraft.mass * rows[:, StateField.SPECIFIC_FORCE]
    history[:, RATE : RATE + 3] = rows[:, StateField.ANGULAR_VELOCITY]
    body, none = body_of(aircraft), np.empty((0, 0))
    noise = CoefficientNoise(aircraft, half_width)
    noise.add(CoefficientBatch(rows, history, body, none, none, none, none))
    found, means, slopes = np.empty((400, 6)), np.empty(SIGNAL), np.empty(SIGNAL)
    reach = int(np.ceil(half_width * rate)) + 2
    for k, at in enumerate(np.linspace(reach + 1, count - reach - 2, len(found)).astype(int)):
        center = rows[at, StateField.TIME] + k % 7 / (7.0 * rate)  # anywhere between two samples
        window_average(
            history[:, TIME].copy(), history, at - reach, at + reach, center, half_width, means, slopes, rate < 40.0
        )
        measured_coefficients(means, slopes, body, found[k])
    sample = np.zeros((1, CoefficientSample.TERMS))
    sample[0, CoefficientSample.SIGNALS.start + SIGNAL_INDEX["qbar"]] = 150.0
    np.testing.assert_allclose(found.std(axis=0), np.sqrt(noise.response(sample)[0]), rtol=0.12)


@pytest.mark.long
def test_an_axis_whose_coefficient_the_model_does_not_explain_has_hold_and_says_so(aircraft):
    """Flaps that no term has: lift is not explained for a while, and the values of C_m are those from before."""
    flight = simulate_samples(aircraft, 3, 100.0, hidden=[("flaps", 2.0)], manoeuvres="flaps", rate=200.0)
    samples = flight.samples
    early = flown(aircraft, samples[: int(np.searchsorted(samples.stamp, samples.stamp[0] + 80 * 10**9))])
    found, unexplained = early.snapshot(), early.learning.integrity.errors.monitor.unexplained
    lacking = [axis for i, axis in enumerate(AXES) if unexplained(i) > 0.25]
    assert "CZ" in lacking and "Cl" not in lacking
    for axis in lacking:
        held = of_axis(found, axis)
        assert not any(p.status == Trust.USE for p in held)
        assert any(p.reason.startswith("the model explains") and f"of {axis}" in p.reason for p in held)
    assert all(p.status == Trust.USE for p in of_axis(found, "Cl"))
    identifier = flown(aircraft, samples)
    found, unexplained = identifier.snapshot(), identifier.learning.integrity.errors.monitor.unexplained
    over_noise = identifier.learning.integrity.errors.monitor.over_noise
    assert over_noise(AXES.index("CZ")) > THRESHOLDS.beyond_noise and unexplained(AXES.index("CZ")) < 0.2
    assert not any(p.status == Trust.USE for p in of_axis(found, "CZ"))
    assert any("times its noise: the model explains " in p.reason for p in of_axis(found, "CZ"))
    assert over_noise(AXES.index("Cl")) < 0.6 * THRESHOLDS.beyond_noise
    assert all(p.status == Trust.HOLD for p in of_axis(found, "Cm"))
    known = flown(flight.oracle, flight.samples)
    assert not any("the model explains" in p.reason for p in known.snapshot().parameters)
    assert any(p.status == Trust.USE for p in of_axis(known.snapshot(), "Cm"))


@pytest.mark.long
@pytest.mark.parametrize("turbulence", [pytest.param("light", marks=pytest.mark.long), "moderate"])
def test_gusts_are_no_lack_of_fit(aircraft, turbulence):
    flight = simulate_samples(aircraft, 8, 90.0, turbulence=turbulence, rate=200.0)
    identifier = flown(aircraft, flight.samples)
    assert max(identifier.learning.integrity.errors.monitor.unexplained(i) for i in range(6)) < 0.1
    assert 0.5 < max(identifier.learning.integrity.errors.monitor.over_noise(i) for i in range(6)) < 2.0
    assert not any("the model explains" in p.reason for p in identifier.snapshot().parameters)
