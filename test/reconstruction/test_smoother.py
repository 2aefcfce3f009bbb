"""The smoother of the first step: least squares in small, nearer to the truth in flight, and honest about it."""

from __future__ import annotations

import json
import tempfile

import numpy as np
import pytest

from aircraft_sysid_ros.after_flight.replay import BLOCK, smoothed
from aircraft_sysid_ros.aircraft.earth import ned_between
from aircraft_sysid_ros.aircraft.frames import quaternion_conjugate, quaternion_log, quaternion_product, rotation_matrix
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction import smoother_history
from aircraft_sysid_ros.reconstruction.error_state import retract
from aircraft_sysid_ros.reconstruction.process import propagate, transition_matrix
from aircraft_sysid_ros.reconstruction.smoother import difference, smooth_segment, smooth_step
from aircraft_sysid_ros.reconstruction.smoother_history import (
    HAS_ROW,
    STEP_WIDTH,
    WIND_WALK,
    SmootherHistory,
    record_step,
    recorded_covariance,
)
from aircraft_sysid_ros.reconstruction.state import ERROR_SIZE, STATE_SIZE, StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight

ALL_STD = StateField.STANDARD_DEVIATIONS


def recorded(aircraft, samples: Samples, block: int = 5000) -> tuple[StateEstimator, np.ndarray]:
    """A flight through the filter with a tape; the filter's rows."""
    estimator = StateEstimator(aircraft, tape=SmootherHistory())
    rows = [estimator.push(samples[i : i + block]) for i in range(0, len(samples), block)]
    return estimator, np.vstack([*rows, estimator.flush()])


def errors_of(flight, estimator, rows) -> tuple[np.ndarray, np.ndarray]:
    """Time of flight (n,) and truth less estimate (n, 21): 18 as StateField.STANDARD_DEVIATIONS, then air velocity."""
    start = int(flight.biases.stamp[0])
    time = rows[:, StateField.TIME] + (estimator.epoch - start) * 1e-9
    truth = flight.truth.at(time)
    attitude = [
        quaternion_log(quaternion_product(quaternion_conjugate(q), t))
        for q, t in zip(rows[:, StateField.ATTITUDE], truth.quaternion, strict=True)
    ]
    shift = ned_between(rows[0, StateField.ORIGIN], flight.truth.origin)
    biases = np.hstack([flight.biases.accelerometer, flight.biases.gyro])
    bias_time = (flight.biases.stamp - start) * 1e-9
    bias = np.stack([np.interp(time, bias_time, column) for column in biases.T], axis=1)
    parts = [
        truth.velocity - rows[:, StateField.VELOCITY],
        truth.position + shift - rows[:, StateField.POSITION],
        attitude,
        bias - rows[:, StateField.ACCELEROMETER_BIAS.start : StateField.GYRO_BIAS.stop],
        truth.wind - rows[:, StateField.WIND],
        truth.air_velocity - rows[:, StateField.AIR_VELOCITY],
    ]
    return time, np.hstack(parts)


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


@pytest.fixture(scope="module")
def both(flight, aircraft):
    """Estimator, rows of the filter, and the smoothed rows of the shared flight."""
    estimator, rows = recorded(aircraft, flight.samples)
    return estimator, rows, estimator.smooth()


# -- one step -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def setup(both):
    return both[0].tape._segments[0].setup


def a_step(seed: int, setup):
    """A filtered state and covariance, the recorded step from it, and the prediction."""
    random = np.random.default_rng(seed)
    x = random.normal(size=STATE_SIZE)
    x[6:10] /= np.linalg.norm(x[6:10])
    x[16:19] += [17.0, 0.0, 1.0]
    root = 0.02 * random.normal(size=(ERROR_SIZE, ERROR_SIZE))
    p = root @ root.T + 1e-6 * np.eye(ERROR_SIZE)
    density = np.array([9e-6, 4e-6, 2e-5, 4e-8, 3e-8, 5e-8])
    arguments = (np.array([0.5, 0.2, -9.0]), np.array([0.3, -0.2, 0.1]), 0.008, density, 0.7)
    step = np.empty(STEP_WIDTH)
    record_step(step, x, p, *arguments)
    predicted, p_predicted = x.copy(), p.copy()
    propagate(predicted, p_predicted, *arguments, setup)
    return x, p, step, predicted, p_predicted, arguments


def test_difference_is_the_inverse_of_retract():
    random = np.random.default_rng(1)
    for size in (1e-9, 0.1, 2.0):
        x, delta = random.normal(size=STATE_SIZE), size * random.normal(size=ERROR_SIZE) / 3.0
        x[6:10] /= np.linalg.norm(x[6:10])
        np.testing.assert_allclose(difference(retract(x, delta), x), delta, atol=1e-12)


@pytest.mark.long
def test_what_is_recorded_is_read_back_bit_by_bit(setup):
    x, p, step, *_ = a_step(2, setup)
    p = np.tril(p) + np.tril(p, -1).T
    np.testing.assert_array_equal(recorded_covariance(step), p)
    np.testing.assert_array_equal(step[:STATE_SIZE], x)


def test_without_news_a_step_back_is_the_filter(setup):
    """The smoothed next state is its prediction: nothing was measured, so nothing changes."""
    x, p, step, predicted, p_predicted, _ = a_step(3, setup)
    back, p_back = smooth_step(step, predicted, p_predicted, setup)
    np.testing.assert_allclose(difference(back, x), 0.0, atol=1e-12)
    np.testing.assert_allclose(p_back, p, rtol=1e-9, atol=1e-13)


def test_a_step_back_is_2_20_and_2_22_for_small_errors(setup):
    x, p, step, predicted, p_predicted, (force, rate, dt, *_) = a_step(4, setup)
    change = 1e-5 * np.random.default_rng(5).normal(size=ERROR_SIZE)
    known = 0.3 * p_predicted
    back, p_back = smooth_step(step, retract(predicted, change), known, setup)
    c = p @ transition_matrix(x, force, rate, dt, setup.gravity).T @ np.linalg.inv(p_predicted)
    np.testing.assert_allclose(difference(back, x), c @ change, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(p_back, p - c @ (p_predicted - known) @ c.T, atol=2e-5 * np.abs(p).max())


def test_the_end_of_a_segment_that_is_not_finite_is_left_out(both, setup):
    _, rows, _ = both
    _, steps, _ = next(both[0].tape.segments())
    count = int(steps[:400, HAS_ROW].sum())
    steps, few = steps[:400].copy(), rows[:count].copy()
    steps[300:, 0] = np.nan
    smooth_segment(steps, few, np.full(STATE_SIZE, np.nan), np.eye(ERROR_SIZE), setup, True)
    first_lost = int(steps[:299, HAS_ROW].sum())
    assert np.all(np.isfinite(few[:, ALL_STD]))
    np.testing.assert_array_equal(few[first_lost + 1 :], rows[first_lost + 1 : count])
    assert np.any(few[: first_lost - 5, StateField.WIND] != rows[: first_lost - 5, StateField.WIND])


# -- whole flights ------------------------------------------------------------------------------------------


def test_smoothed_states_are_nearer_to_the_truth(flight, both):
    """Wind, attitude, air velocity, and velocity: by a quarter or more, over the whole flight and at its end part."""
    estimator, rows, better = both
    time, filtered = errors_of(flight, estimator, rows)
    _, smooth = errors_of(flight, estimator, better)
    for part in (time > 0.0, (time > 60.0) & (time < 110.0)):
        for name, columns in {"velocity": (0, 3), "attitude": (6, 9), "wind": (15, 18), "air": (18, 21)}.items():
            chosen = slice(*columns)
            assert rms(smooth[part, chosen]) < 0.75 * rms(filtered[part, chosen]), name
    assert np.all(better[:, ALL_STD] <= rows[:, ALL_STD] * 1.01)


def test_errors_of_smoothed_states_are_as_large_as_their_standard_deviations(flight, both):
    estimator, _, better = both
    _, error = errors_of(flight, estimator, better)
    z = error[:, :ERROR_SIZE] / better[:, ALL_STD]
    assert np.abs(z).max() < 6.0  # the largest stands in the first seconds, where heading was linearised while unknown
    assert 0.6 < rms(z) < 1.3  # 18 states whose errors last for minutes, in one flight


@pytest.mark.long
@pytest.mark.parametrize("flights", [3, pytest.param(8, marks=pytest.mark.long)])
def test_nees_of_smoothed_states_over_many_flights(aircraft, flights):
    """Flights of 25 s, at 4 times of each: the whole covariance of the 18 errors at the place of the IMU.

    The errors of one flight are correlated over time, so that its mean counts as one draw: within 4 sigma of 18.
    """
    nees = []
    for seed in range(flights):
        flight = simulate_samples(aircraft, seed, 25.0, wind=(3.0 * np.cos(seed), 3.0 * np.sin(seed), 0.0))
        estimator, rows = recorded(aircraft, flight.samples)
        ((segment, steps, _),) = estimator.tape.segments()
        x, p, end = segment.x, segment.p, len(steps)
        at_row = np.flatnonzero(steps[:, HAS_ROW]) + 1  # steps that begin at the time of a row
        for row in (1800, 1300, 800, 400):
            begin = at_row[row]
            between = rows[row + 1 :][: int(steps[begin:end, HAS_ROW].sum())]
            x, p = smooth_segment(steps[begin:end], between, x, p, segment.setup, True)
            nees.append(nees_of(flight, estimator, rows[row], x, p))
            end = begin
    assert len(nees) == 4 * flights
    assert np.mean(nees) == pytest.approx(ERROR_SIZE, abs=4.0 * np.sqrt(2.0 * ERROR_SIZE / flights))


def nees_of(flight, estimator, row, x, p) -> float:
    """Normalised error squared of the state x (19,) of the filter at the time of a row."""
    start = int(flight.biases.stamp[0])
    time = row[StateField.TIME] + (estimator.epoch - start) * 1e-9
    truth, arm = flight.truth.at([time]), flight.aircraft.imu_position
    turn = np.cross(truth.rates[0], arm)
    c = rotation_matrix(truth.quaternion[0])
    shift = ned_between(row[StateField.ORIGIN], flight.truth.origin)
    nearest = int(np.argmin(np.abs(flight.biases.stamp - start - time * 1e9)))
    true = np.concatenate(
        [
            truth.velocity[0] + c @ turn,
            truth.position[0] + shift + c @ arm,
            truth.quaternion[0],
            flight.biases.accelerometer[nearest],
            flight.biases.gyro[nearest],
            truth.air_velocity[0] + turn,
        ]
    )
    error = difference(true, x)
    return float(error @ np.linalg.solve(p, error))


def test_the_last_smoothed_state_is_the_filtered_one(both):
    estimator, rows, better = both
    np.testing.assert_allclose(better[-1], rows[-1], rtol=1e-12, atol=1e-14)
    summary = estimator.summary()
    assert summary["smoothed"] is True
    assert summary["wind_ned"] == better[-1, StateField.WIND].tolist()
    same = [StateField.TIME, StateField.AIR_DENSITY, *range(StateField.CONSISTENCY, StateField.WIDTH)]
    np.testing.assert_array_equal(better[:, same], rows[:, same])


def test_recording_changes_nothing(flight, aircraft):
    samples = flight.samples[:8000]
    with_tape = recorded(aircraft, samples, 137)[1]
    plain = StateEstimator(aircraft)
    rows = np.vstack([plain.push(samples), plain.flush()])
    np.testing.assert_array_equal(with_tape, rows)
    assert plain.summary()["smoothed"] is False


def test_the_wind_walk_is_the_one_that_each_step_used(both):
    """At the start it is that of gusts, in calm air it falls: the record shows it, in between as at the ends."""
    _, steps, _ = next(both[0].tape.segments())
    walk = steps[:, WIND_WALK]
    assert walk[0] == 1.0 and walk[-1] < 0.2 and len(np.unique(walk)) > 300


@pytest.mark.long
def test_a_break_splits_the_flight(flight, aircraft):
    """IMU silent for 10 s: what follows is as if there had been nothing before, and so is what came before."""
    time = (flight.samples.stamp - flight.biases.stamp[0]) * 1e-9
    gone = (flight.samples.kind == Kind.IMU) & (time > 50.0) & (time < 60.0)
    whole, _ = recorded(aircraft, flight.samples[~gone])
    assert whole.realignments == 1
    better = whole.smooth()
    before, after = (part for _, _, part in whole.tape.segments())
    assert len(before) + len(after) == len(better)
    first, rows = recorded(aircraft, flight.samples[time <= 50.0])
    np.testing.assert_allclose(first.smooth()[-2000], before[-2000 - (len(rows) - len(before)) or None], rtol=1e-6)
    _, error = errors_of(flight, whole, better)
    z = error[:, :ERROR_SIZE] / better[:, ALL_STD]
    assert np.abs(z).max() < 6.0


def test_a_vane_that_is_lost_stays_lost(flight, aircraft):
    time = (flight.samples.stamp - flight.biases.stamp[0]) * 1e-9
    gone = (flight.samples.kind == Kind.ANGLE_OF_ATTACK) & (time > 20.0) & (time < 30.0)
    samples = flight.samples[~gone & (time < 40.0)]
    estimator, rows = recorded(aircraft, samples)
    better = estimator.smooth()
    np.testing.assert_array_equal(np.isnan(better), np.isnan(rows))
    assert np.isnan(better[:, StateField.ANGLE_OF_ATTACK]).any()


def test_a_flight_without_a_start_has_no_rows(aircraft):
    estimator = StateEstimator(aircraft, tape=SmootherHistory())
    estimator.flush()
    assert estimator.smooth().shape == (0, StateField.WIDTH)


def test_what_goes_to_a_file_is_smoothed_as_what_stays_in_memory(flight, aircraft, monkeypatch):
    samples = flight.samples[: len(flight.samples) // 10]
    in_memory = recorded(aircraft, samples)[0].smooth()
    monkeypatch.setattr(smoother_history, "IN_MEMORY", 100_000)
    assert len(in_memory) > 200
    np.testing.assert_array_equal(recorded(aircraft, samples)[0].smooth(), in_memory)


def test_a_full_disk_is_said_in_one_sentence(setup, monkeypatch):
    monkeypatch.setattr(smoother_history, "IN_MEMORY", 1_000)
    monkeypatch.setattr(tempfile, "TemporaryFile", lambda: open("/dev/full", "wb", buffering=0))  # noqa: SIM115
    with SmootherHistory() as tape:
        tape.begin(setup)
        with pytest.raises(InputError, match=r"1 GB per hour.*No space left on device.*TMPDIR"):
            tape.add(np.zeros((1, STEP_WIDTH)), np.zeros((1, StateField.WIDTH)), np.zeros(19), np.eye(18))


# -- replay -------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_parameters_from_smoothed_states_are_right(flight, aircraft):
    pipeline = Pipeline(aircraft)
    pipeline.state.tape = SmootherHistory()
    blocks = [flight.samples[i : i + BLOCK] for i in range(0, len(flight.samples), BLOCK)]
    for _ in smoothed(pipeline, blocks, blocks):
        pass
    parameters = pipeline.parameters.snapshot().parameters
    truth = np.array([aircraft.coefficients[p.name] for p in parameters])
    z = (np.array([p.value for p in parameters]) - truth) / np.array([p.std for p in parameters])
    assert len(z) == 32 and np.abs(z).max() < 4.0
    for p in parameters:
        if p.name in ("CZ_alpha", "Cm_alpha", "Cm_de", "Cl_p", "Cl_da", "Cn_beta", "CY_beta"):
            assert p.value == pytest.approx(aircraft.coefficients[p.name], rel=0.03), p.name


@pytest.mark.long
def test_replay_smooth(aircraft, aircraft_file, tmp_path, capfd):
    write_flight(simulate_samples(aircraft, 3, 30.0), tmp_path / "bag", overwrite=False)
    states = {}
    for name, options in {"plain": [], "smooth": ["--smooth"]}.items():
        command = ["replay", tmp_path / "bag", "--aircraft", aircraft_file, "--out", tmp_path / name, *options]
        assert main([str(word) for word in [*command, "--json"]]) == 0
        states[name] = json.loads(capfd.readouterr().out)["state"]
    plain, smooth = states["plain"], states["smooth"]
    assert plain["smoothed"] is False and smooth["smoothed"] is True
    for key in ("accelerometer_bias", "gyro_bias", "wind_ned", "wind_ned_std", "samples"):
        assert smooth[key] == plain[key]
    points = {name: np.load(tmp_path / name / "points.npz") for name in states}
    np.testing.assert_array_equal(points["plain"]["stamp"], points["smooth"]["stamp"])
    assert np.any(points["plain"]["measured"] != points["smooth"]["measured"])


@pytest.mark.long
def test_states_alone_are_those_with_the_covariance(aircraft):
    """Skipping the covariance changes no state, and leaves the filter's standard deviations."""
    flight = simulate_samples(aircraft, seed=3, duration=30.0, turbulence="light")
    rows = []
    for with_covariance in (True, False):
        estimator = StateEstimator(aircraft, tape=SmootherHistory())
        estimator.push(flight.samples)
        estimator.flush()
        rows.append(np.array(estimator.smooth(with_covariance)))
    spread = StateField.STANDARD_DEVIATIONS
    states = np.r_[StateField.TIME : spread.start, spread.stop : StateField.AIR_VELOCITY_STD]
    np.testing.assert_allclose(rows[1][:, states], rows[0][:, states], rtol=1e-6, atol=1e-7)
    middle = rows[0][len(rows[0]) // 2, spread] / rows[1][len(rows[1]) // 2, spread]
    assert np.all(middle <= 1.0 + 1e-6) and np.any(middle < 0.8)
