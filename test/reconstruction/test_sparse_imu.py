"""The input of the filter between samples of a slow IMU: parabolas are exact, sines nearly, and the error is stated."""

from itertools import pairwise

import numpy as np
import pytest
from slow_flights import FAST, all_thinned, fast_flight, file_of_users, thinned

from aircraft_sysid_ros.aircraft.frames import rotation_matrices
from aircraft_sysid_ros.reconstruction.sparse_imu import (
    held_motion,
    hidden_motion,
    is_sparse,
    mean_beyond_line,
    missed_by_line,
    missed_by_parabola,
    note_motion,
    second_difference,
)
from aircraft_sysid_ros.reconstruction.state import StateField, new_memory
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples, samples_of
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples


def integral(times: np.ndarray, values: np.ndarray) -> float:
    """Of samples by line and bend, from the second sample on."""
    memory, bend, total = new_memory(len(Kind), 0.1), np.empty(6), 0.0
    sample = np.zeros(6)
    for k in range(2, len(times)):
        memory.imu_before[:2], memory.imu[:2] = (times[k - 2], values[k - 2]), (times[k - 1], values[k - 1])
        sample[0], interval = values[k], times[k] - times[k - 1]
        second_difference(times[k], sample, 0.5, memory, bend)
        line = 0.5 * (values[k] + values[k - 1])
        total += interval * (line + bend[0] * mean_beyond_line(0.0, 1.0, interval))
    return total


def test_parabolas_are_integrated_exactly_on_uneven_samples() -> None:
    times = np.array([0.0, 0.1, 0.21, 0.3, 0.52, 0.6, 0.7])
    exact = np.polynomial.Polynomial([0.3, -2.0, 5.0]).integ()
    assert integral(times, 0.3 - 2.0 * times + 5.0 * times**2) == pytest.approx(exact(0.7) - exact(0.1), rel=1e-12)


def test_parts_of_an_interval_add_up_to_the_whole() -> None:
    edges, interval = np.array([0.0, 0.2, 0.35, 0.9, 1.0]), 0.1
    parts = [(b - a) * mean_beyond_line(a, b, interval) for a, b in pairwise(edges)]
    assert sum(parts) == pytest.approx(mean_beyond_line(0.0, 1.0, interval), rel=1e-12)
    assert mean_beyond_line(0.0, 1.0, interval) == pytest.approx(-(interval**2) / 6.0)


@pytest.mark.parametrize("frequency, line_error", [(1.0, 0.033), (2.0, 0.14)])
def test_a_sine_at_ten_hertz_loses_little_of_its_size(frequency: float, line_error: float) -> None:
    """Against the projection of the exact integral: the straight line loses ``line_error``, see the module."""
    omega, times = 2.0 * np.pi * frequency, 0.1 * np.arange(600)
    values = np.cos(omega * times)
    curved, straight = np.zeros(len(times)), np.zeros(len(times))
    for k in range(2, len(times)):
        curved[k] = curved[k - 1] + integral(times[k - 2 : k + 1], values[k - 2 : k + 1])
        straight[k] = straight[k - 1] + 0.05 * (values[k] + values[k - 1])
    exact = np.sin(omega * times) / omega
    columns = np.column_stack([exact, np.cos(omega * times), np.ones(len(times))])[2:]

    def size(series: np.ndarray) -> float:
        return float(np.linalg.lstsq(columns, series[2:], rcond=None)[0][0])

    assert size(straight) == pytest.approx(1.0 - line_error, abs=0.01)
    assert abs(size(curved) - 1.0) < 0.3 * line_error


def test_no_bend_across_a_gap_or_a_stamp_that_stands_twice() -> None:
    memory, bend, sample = new_memory(len(Kind), 0.1), np.empty(6), np.ones(6)
    memory.imu[0] = 10.0
    second_difference(10.1, sample, 0.5, memory, bend)  # nothing before it
    assert not bend.any()
    memory.imu_before[:] = 0.0
    memory.imu_before[0] = 9.0
    second_difference(10.1, sample, 0.5, memory, bend)
    assert not bend.any()
    memory.imu_before[0] = 9.9
    second_difference(10.0, sample, 0.5, memory, bend)
    assert not bend.any()
    second_difference(10.1, sample, 0.5, memory, bend)
    assert bend.all()


def test_sparse_is_what_most_intervals_say() -> None:
    random, memory = np.random.default_rng(0), new_memory(len(Kind), 0.1)
    assert not any(is_sparse(t, memory) for t in 0.02 * random.choice([1.0, 2.0, 3.0], 5000, p=[0.9, 0.08, 0.02]))
    verdicts = [is_sparse(0.1, memory) for _ in range(30)]
    assert not verdicts[0] and all(verdicts[13:])
    verdicts = [is_sparse(0.01, memory) for _ in range(30)]
    assert verdicts[0] and not any(verdicts[13:])


@pytest.mark.parametrize(
    "shown",
    [
        lambda samples: thinned(samples, 25.0),
        lambda samples: thinned(samples, 10.0),
        lambda samples: all_thinned(samples, 10.0),
        lambda samples: all_thinned(samples, 10.0, jitter=0.2, lost=0.1),
    ],
)
def test_states_of_a_slow_imu_are_as_near_as_the_filter_says(shown) -> None:
    """In manoeuvres: squared errors over their variance, of the flow across and of the velocity over ground."""
    flight = fast_flight(7)
    estimator = StateEstimator(file_of_users())
    rows = np.vstack([estimator.push(shown(flight.samples)), estimator.flush()])
    assert estimator.epoch is not None and estimator.realignments == 0
    time = rows[:, StateField.TIME] + (estimator.epoch - int(flight.biases.stamp[0])) * 1e-9
    truth, late = flight.truth.at(time), time > 20.0
    across = (truth.air_velocity - rows[:, StateField.AIR_VELOCITY])[:, 1:] / rows[:, [StateField.AIR_VELOCITY_STD]]
    ground = (truth.velocity - rows[:, StateField.VELOCITY]) / rows[:, StateField.STANDARD_DEVIATIONS][:, :3]
    assert 0.5 < np.mean(across[late] ** 2) < 1.3
    assert 0.4 < np.mean(ground[late] ** 2) < 1.8
    assert all(0.6 < value < 1.2 for value in estimator.innovation_consistency().values())


@pytest.mark.parametrize(("hole", "every"), [(0.1, 1.0), (0.2, 2.0), (0.45, 10.0)])
def test_a_hole_in_a_dense_imu_leaves_in_doubt_what_it_hides(hole: float, every: float) -> None:
    """As of a logger that waits, or a link that loses packets: the straight line across it was believed, and the filter
    lost.
    """
    flight = fast_flight(7)
    samples = flight.samples
    time = (samples.stamp - samples.stamp[0]) * 1e-9
    estimator = StateEstimator(file_of_users())
    lost = (samples.kind == Kind.IMU) & (time % every < hole) & (time > every)
    rows = np.vstack([estimator.push(samples[~lost]), estimator.flush()])
    assert estimator.epoch is not None and estimator.realignments == 0
    time = rows[:, StateField.TIME] + (estimator.epoch - int(flight.biases.stamp[0])) * 1e-9
    truth, late, std = flight.truth.at(time), time > 20.0, rows[:, StateField.STANDARD_DEVIATIONS]
    ground = (truth.velocity - rows[:, StateField.VELOCITY]) / std[:, :3]
    wind = (truth.wind - rows[:, StateField.WIND]) / rows[:, StateField.WIND_STD]
    bias = (flight.biases.gyro[-1] - rows[-1, StateField.GYRO_BIAS]) / std[-1, 12:15]
    assert np.mean(ground[late] ** 2) < 2.0 and np.mean(wind[late] ** 2) < 3.0 and np.abs(bias).max() < 4.0


@pytest.mark.parametrize(("held", "every", "lost"), [(0.05, 0.05, 0), (0.1, 0.1, 0), (0.3, 5.0, 0), (0.3, 2.0, 6)])
def test_an_imu_that_repeats_a_sample_leaves_in_doubt_what_it_hides(held: float, every: float, lost: int) -> None:
    """As of a recorder that writes the newest sample at each step, whether it is new or not: it was believed.

    And so it was where the last of the repeated samples are lost, before a new one shows how far off they were.
    """
    flight = fast_flight(7)
    values, at = flight.samples.values.copy(), np.flatnonzero(flight.samples.kind == Kind.IMU)
    steps, period = round(held * FAST), round(every * FAST)
    number = np.arange(len(at))
    shown = np.where(number % period < steps, number - number % period, number)
    values[at, :6] = values[at[shown], :6]
    kept = np.ones(len(values), np.bool_)
    kept[at[(number % period < steps) & (number % period >= steps - lost)]] = False
    estimator = StateEstimator(file_of_users())
    samples = Samples(flight.samples.stamp, flight.samples.kind, values)[kept]
    rows = np.vstack([estimator.push(samples), estimator.flush()])
    assert estimator.epoch is not None and estimator.realignments == 0
    time = rows[:, StateField.TIME] + (estimator.epoch - int(flight.biases.stamp[0])) * 1e-9
    truth, late, std = flight.truth.at(time), time > 20.0, rows[:, StateField.STANDARD_DEVIATIONS]
    ground = (truth.velocity - rows[:, StateField.VELOCITY]) / std[:, :3]
    wind = (truth.wind - rows[:, StateField.WIND]) / rows[:, StateField.WIND_STD]
    assert np.mean(ground[late] ** 2) < 4.0 and np.mean(wind[late] ** 2) < 4.0


def test_in_steady_flight_a_hole_hides_nothing_and_in_motion_a_share_of_it() -> None:
    """A sine of 1 Hz: what is said is what the line across a hole misses, or somewhat more where it is wide."""
    memory, dt = new_memory(len(Kind), 0.1), 0.01
    for _ in range(3000):
        note_motion(dt, np.ones(6), memory)
    memory.imu[1:7] = 1.0
    assert max(hidden_motion(0.4, np.ones(6), memory)) == pytest.approx(0.0, abs=1e-6)
    omega = 2.0 * np.pi
    for hole in (0.05, 0.1, 0.2, 0.4):
        missed, said = [], []
        for k in range(1, 3000):
            now, until = k * dt, k * dt + hole
            note_motion(dt, np.full(6, np.sin(omega * now)), memory)
            if k > 1000:
                memory.imu[1:7] = np.sin(omega * now)
                exact = (np.cos(omega * now) - np.cos(omega * until)) / (omega * hole)
                missed.append(exact - 0.5 * (np.sin(omega * now) + np.sin(omega * until)))
                said.append(hidden_motion(hole, np.full(6, np.sin(omega * until)), memory)[1])
        assert 0.9 < np.mean(said) / np.mean(np.square(missed)) < 2.0


def test_an_imu_without_noise_that_stands_is_right() -> None:
    """As of a simulator on the ground: nothing is in doubt, and no more than a second of the first step after it."""
    memory, standing = new_memory(len(Kind), 0.1), np.array([0.0, 0.0, -9.8, 0.0, 0.0, 0.0])
    memory.imu[1:7], memory.shown_since[0] = standing, 0.0
    for k in range(1, 6000):
        note_motion(0.01, standing, memory)
        if k > 3000:
            assert max(held_motion(0.01, 0.01 * k, standing, memory)) == pytest.approx(0.0, abs=1e-6)
        memory.imu[0] = 0.01 * k
    force, rate = held_motion(0.01, 60.0, standing + np.array([0.2, 0.0, 0.0, 0.1, 0.0, 0.0]), memory)
    assert 0.01 * np.sqrt([force, rate]) == pytest.approx([0.1, 0.05])  # [m/s], [rad]


def test_the_weight_of_an_imu_that_stands_from_the_start_is_no_motion() -> None:
    """As of a simulator without noise: its velocity was in doubt by 3 m/s for the first seconds."""
    seconds, noise = 8, 1e-6 * np.random.default_rng(1).normal(size=(800, 6))
    often, seldom = (np.arange(0, seconds * 10**9, 10**9 // rate) for rate in (100, 5))
    level = np.tile([0.0, 0.0, -9.8066, 0.0, 0.0, 0.0], (len(often), 1))
    fly = np.tile([20.0, 0.0, 0.0], (len(seldom), 1))
    north = 1e-9 * seldom * 20.0 / 6.37e6

    def velocity_std(imu: np.ndarray) -> np.ndarray:
        estimator = StateEstimator(file_of_users())
        estimator.push(samples_of(Kind.GPS_POSITION, seldom, 0.8 + north, 0.0 * north, 100.0 + 0.0 * north))
        estimator.push(samples_of(Kind.GPS_VELOCITY, seldom, fly))
        rows = np.vstack([estimator.push(samples_of(Kind.IMU, often, imu)), estimator.flush()])
        return rows[:, StateField.STANDARD_DEVIATIONS][:, :3]

    np.testing.assert_allclose(velocity_std(level), velocity_std(level + noise), rtol=0.02)


def missed(values: np.ndarray, noise: float, times: np.ndarray | None = None, *, sparse: bool = False) -> float:
    """Variance that the line before the last of the samples of one axis is said to miss; without times at 100 Hz."""
    memory, out = new_memory(len(Kind), 0.1), np.zeros(6)
    times = 0.01 * np.arange(len(values)) if times is None else times
    for k, (time, value) in enumerate(zip(times, values, strict=True)):
        sample = np.full(6, value)
        if k > 1 and sparse:
            missed_by_parabola(time - memory.imu[0], 0.5, sample, (noise**2, noise**2), memory, out)
        elif k > 1:
            missed_by_line(time - memory.imu[0], sample, (noise**2, noise**2), memory, out)
        memory.imu_first[:] = memory.imu_before if k > 1 else -np.inf
        memory.imu_before[:] = memory.imu
        memory.imu[0], memory.imu[1:] = time, sample
    assert (out == out[0]).all()
    return float(out[0])


def test_what_a_line_misses_of_a_force_that_wanders_is_as_large_as_it_is() -> None:
    """Against the force itself at a hundred times the rate; of what is only noise, and of slow motion, nothing."""
    random, finer, step = np.random.default_rng(4), 100, 0.7
    fine = np.cumsum(step / np.sqrt(finer) * random.normal(size=finer * 20000))
    coarse = fine[::finer]
    means = np.array([fine[k : k + finer].mean() for k in range(0, len(fine) - finer, finer)])
    true = np.var(means - 0.5 * (coarse[1:] + coarse[:-1]))
    assert true == pytest.approx(step**2 / 12.0, rel=0.05)
    said = [missed(coarse[k : k + 500] + 0.1 * random.normal(size=500), 0.1) for k in range(0, 20000, 500)]
    assert np.mean(said) == pytest.approx(true, rel=0.15)  # of 40 means over about a hundred second differences each
    assert np.mean([missed(0.1 * random.normal(size=500), 0.1) for _ in range(40)]) < 0.1 * 0.1**2
    assert missed(3.0 * np.sin(2.0 * np.pi * 0.01 * np.arange(500)), 0.0) < 1e-4


def test_what_a_line_misses_goes_with_the_length_of_its_interval() -> None:
    """Stamps that are uneven are no gusts, nor is white noise under them; the line across a hole misses more."""
    random, said, noisy, slow = np.random.default_rng(5), [], [], []
    for _ in range(60):
        times = np.cumsum(random.choice([0.001, 0.007, 0.022], size=600))
        walk = np.cumsum(np.sqrt(np.diff(times, prepend=0.0)) * random.normal(size=600))
        white = random.normal(size=600)
        said.append(missed(np.append(walk, 0.0), 0.0, np.append(times, times[-1] + 0.06)))
        noisy.append(missed(white, 1.0, times))
        slow.append(missed(3.0 * np.sin(2.0 * np.pi * times), 0.0, times))
    assert np.mean(said) == pytest.approx(0.06 / 12.0, rel=0.15)
    assert abs(np.mean(noisy)) < 0.1 and np.max(slow) < 1e-3


def test_of_sparse_samples_motion_is_told_from_what_wanders() -> None:
    """At 10 Hz, and with uneven stamps: 1 Hz is motion, which is less than the error that the parabola has of it."""
    random, said, noisy = np.random.default_rng(6), [], []
    for k in range(200):
        times = 0.1 * np.arange(200) if k % 2 else np.cumsum(random.choice([0.03, 0.1, 0.2], size=200))
        times = np.append(times, times[-1] + 0.1)
        walk = np.cumsum(np.sqrt(np.diff(times, prepend=0.0)) * random.normal(size=201))
        said.append(missed(walk, 0.0, times, sparse=True))
        noisy.append(missed(random.normal(size=201), 1.0, times, sparse=True))
    assert np.mean(said[::2]) == pytest.approx(0.1 / 12.0, rel=0.2) and np.mean(noisy) < 0.1
    assert np.mean(said[1::2]) == pytest.approx(0.1 / 12.0, rel=0.2)  # a hundred means over ten differences each
    own = np.mean((0.1**2 / 6.0 * 0.5 * (2.0 * np.pi) ** 2 * np.sin(2.0 * np.pi * 0.1 * np.arange(200))) ** 2)
    assert missed(np.sin(2.0 * np.pi * 0.1 * np.arange(200)), 0.0, 0.1 * np.arange(200), sparse=True) < own


@pytest.mark.parametrize(
    ("turbulence", "rate", "lost"),
    [("light", 100, 0.0), ("moderate", 100, 0.0), ("moderate", 50, 0.2), ("moderate", 20, 0.0), ("none", 20, 0.0)],
)
def test_in_gusts_the_vertical_velocity_is_as_sure_as_it_is_right(
    aircraft, turbulence: str, rate: int, lost: float
) -> None:
    """Samples of the IMU are of an instant: its errors were 1.3 and twice their standard deviations.

    And 1.5 times where samples were lost: the line across a hole misses of gusts what its length says. At 20 Hz, where
    second differences are of the motion, three times.
    """
    squares = []
    for seed in range(4):
        flight = simulate_samples(aircraft, 40 + seed, 60.0, turbulence=turbulence)
        at = np.flatnonzero(flight.samples.kind == Kind.IMU)
        kept = np.ones(len(flight.samples), np.bool_)
        kept[at] = (np.arange(len(at)) % (100 // rate) == 0) & (np.random.default_rng(seed).random(len(at)) >= lost)
        estimator = StateEstimator(flight.aircraft)
        rows = np.concatenate([estimator.push(flight.samples[kept]), estimator.flush()])
        begin = (estimator.epoch - flight.biases.stamp[0]) * 1e-9
        rows = rows[rows[:, StateField.TIME] > 20.0]
        truth = flight.truth.at(rows[:, StateField.TIME] + begin)
        turning = np.cross(truth.rates, aircraft.imu_position)
        at_imu = truth.velocity + np.einsum("nij,nj->ni", rotation_matrices(truth.quaternion), turning)
        std = rows[:, StateField.STANDARD_DEVIATIONS][:, :3]
        squares.append(np.mean(((rows[:, StateField.VELOCITY] - at_imu) / std) ** 2, axis=0))
    assert (np.mean(squares, axis=0) < 1.4).all()  # of 4 flights, 100 independent fixes each: 0.2 is two sigma
    assert (np.mean(squares, axis=0) > 0.6).all()
