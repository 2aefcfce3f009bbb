"""Aircraft without vanes: what is assumed, that it is honest about it, and that vanes lose nothing by it."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.frames import quaternion_exp, quaternion_from_euler
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.error_state import retract
from aircraft_sysid_ros.reconstruction.pseudo_measurements import (
    LARGEST_STD,
    SIDESLIP_STD,
    VERTICAL_STD,
    assumption,
    update_by,
)
from aircraft_sysid_ros.reconstruction.state import ERROR_SIZE, STATE_SIZE, StateField, Status
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

ALPHA, BETA = int(Kind.ANGLE_OF_ATTACK), int(Kind.SIDESLIP)
INFERRED = (Status.INFERRED_ALPHA, Status.INFERRED_BETA, Status.INFERRED_ANGLES)


def a_state():
    x = np.zeros(STATE_SIZE)
    x[0:3] = 15.0, -4.0, 1.2
    x[6:10] = quaternion_from_euler(0.3, -0.1, 0.7)
    x[16:19] = 16.0, 1.5, 0.9
    return x


@pytest.mark.parametrize(("kind", "std"), [(ALPHA, VERTICAL_STD), (BETA, SIDESLIP_STD)])
def test_the_row_of_a_pseudo_measurement_is_its_derivative(kind, std):
    """Residual of 0 = h(x): h moves by h_row times the error, in the error's own coordinates."""
    x, h = a_state(), np.empty((1, ERROR_SIZE))
    residual, variance = assumption(kind, x, h)
    assert variance == pytest.approx(std**2)
    other = np.empty((1, ERROR_SIZE))
    for i in range(ERROR_SIZE):
        delta = np.zeros(ERROR_SIZE)
        delta[i] = 1e-6
        plus = assumption(kind, retract(x, delta), other)[0]
        minus = assumption(kind, retract(x, -delta), other)[0]
        assert (plus - minus) / 2e-6 == pytest.approx(-h[0, i], abs=1e-7)
    assert quaternion_exp(np.zeros(3))[0] == 1.0
    assert residual != 0.0


@pytest.mark.parametrize("kind", [ALPHA, BETA])
def test_an_update_is_that_of_the_kalman_filter(kind):
    """Against P - P h' (h P h' + R)^-1 h P, worked out plainly."""
    rng = np.random.default_rng(3)
    root = rng.standard_normal((ERROR_SIZE, ERROR_SIZE))
    p = root @ root.T
    x, h = a_state(), np.empty((1, ERROR_SIZE))
    residual, variance = assumption(kind, x, h)
    gain = p @ h[0] / (h[0] @ p @ h[0] + variance)
    expected = p - np.outer(gain, h[0] @ p)
    delta = update_by(kind, x, p)
    np.testing.assert_allclose(delta, gain * residual, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(p, expected, rtol=1e-7, atol=1e-9)
    assert np.array_equal(p, p.T) and np.linalg.eigvalsh(p).min() > 0.0


def bare(samples, kinds=(Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)):
    return samples[~np.isin(samples.kind, kinds)]


@pytest.fixture(scope="module")
def vaneless(aircraft, flight):
    """The shared flight of 120 s without vanes: pipeline and rows."""
    pipeline = Pipeline(aircraft)
    rows, _ = pipeline.push(bare(flight.samples))
    return pipeline, np.vstack([rows, pipeline.flush()[0]])


def truth_at(flight, estimator, rows):
    time = (rows[:, StateField.TIME] * 1e9 + estimator.epoch - 1_760_000_000e9) * 1e-9
    return flight.truth.at(time), time


@pytest.mark.long
def test_angles_are_inferred_as_well_as_the_filter_says(vaneless, flight):
    pipeline, rows = vaneless
    truth, time = truth_at(flight, pipeline.state, rows)
    assert set(rows[time > 5.0, StateField.STATUS]) == {Status.INFERRED_ANGLES}
    given = np.isfinite(rows[:, StateField.ANGLE_OF_ATTACK]) & np.isfinite(rows[:, StateField.SIDESLIP]) & (time > 3.0)
    assert given[time > 60.0].all()  # after a minute of manoeuvres
    std = rows[given, StateField.AIR_VELOCITY_STD] / rows[given, StateField.AIRSPEED]
    assert std.max() < 1.5 * LARGEST_STD  # either angle is known to LARGEST_STD
    for column, true in ((StateField.ANGLE_OF_ATTACK, truth.alpha), (StateField.SIDESLIP, truth.beta)):
        error = rows[given, column] - true[given]
        assert np.abs(error / std).max() < 4.0
        assert np.sqrt(np.mean((error / std) ** 2)) < 1.6


@pytest.mark.long
def test_parameters_without_vanes_are_right_or_held(vaneless, aircraft):
    """USE within 3.5 standard errors of the truth; constants of sideslip cannot be told and say why."""
    found = {p.name: p for p in vaneless[0].parameters.snapshot().parameters}
    used = [p for p in found.values() if p.status == Trust.USE]
    assert len(used) >= 8
    for p in used:
        assert abs(p.value - aircraft.coefficients[p.name]) < 3.5 * p.std, p
    for name in ("Cn_beta", "Cl_p", "Cn_r", "CY_beta", "CX_Tc"):
        assert abs(found[name].value / aircraft.coefficients[name] - 1.0) < 0.25
    for name in ("CY_0", "Cl_0", "Cn_0"):
        assert found[name].status == Trust.HOLD and "sideslip, which no vane measures" in found[name].reason


@pytest.mark.long
def test_in_gusts_nothing_is_learnt_from_angles_that_nobody_measures(aircraft):
    """Light turbulence moves alpha by 2 deg, unseen: parameters from it would be wrong by 10 standard errors."""
    flight = simulate_samples(aircraft, seed=2, duration=60.0, turbulence="light")
    pipeline = Pipeline(aircraft)
    pipeline.push(bare(flight.samples))
    pipeline.flush()
    assert pipeline.parameters.learning.newest is not None
    statuses = {p.status for p in pipeline.parameters.snapshot().parameters}
    assert Trust.USE not in statuses


def test_one_vane_is_enough_for_its_own_angle(aircraft, flight):
    estimator = StateEstimator(aircraft)
    samples = bare(flight.samples, (Kind.SIDESLIP,))
    rows = estimator.push(samples[: len(samples) // 4])
    truth, time = truth_at(flight, estimator, rows)
    late = time > 5.0
    assert set(rows[late, StateField.STATUS]) == {Status.INFERRED_BETA}
    assert np.abs(rows[late, StateField.ANGLE_OF_ATTACK] - truth.alpha[late]).max() < 0.02


def test_with_vanes_nothing_is_assumed(aircraft, flight):
    estimator = StateEstimator(aircraft)
    rows = estimator.push(flight.samples[:8000])
    assert not np.isin(rows[200:, StateField.STATUS], INFERRED).any()
    assert np.all(np.isneginf(estimator.memory.assumed))


def test_without_gps_or_airspeed_nothing_is_inferred(aircraft, flight):
    """The wind is all that the angles rest on."""
    time = (flight.samples.stamp - 1_760_000_000 * 10**9) * 1e-9
    for lost in ((Kind.GPS_POSITION, Kind.GPS_VELOCITY), (Kind.AIRSPEED,)):
        samples = bare(flight.samples)
        at = time[~np.isin(flight.samples.kind, (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP))]
        samples = samples[~(np.isin(samples.kind, lost) & (at > 70.0)) & (at < 80.0)]
        estimator = StateEstimator(aircraft)
        rows = np.vstack([estimator.push(samples), estimator.flush()])
        _, seconds = truth_at(flight, estimator, rows)
        assert np.all(np.isfinite(rows[(seconds > 65) & (seconds < 70), StateField.SIDESLIP]))
        assert np.all(np.isnan(rows[seconds > 73.0, StateField.ANGLE_OF_ATTACK]))
