"""The noise of the sensors as the flight shows it: laws of the estimate, and flights whose noise is known."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.signal import lfilter

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.aircraft.frames import (
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_product,
)
from aircraft_sysid_ros.aircraft.sensor_settings import DEFAULT_PROCESS_NOISE
from aircraft_sysid_ros.reconstruction.air_data_errors import error_table
from aircraft_sysid_ros.reconstruction.found_noise import (
    DEFAULT,
    FILE,
    FLIGHT,
    MESSAGES,
    completed_file,
    found_noise,
    found_wind_walk,
    noise_json,
    noise_notes,
)
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.sensor_noise import (
    COLOURED,
    SCALE,
    WALK,
    WHITE,
    believed_variance,
    is_held,
    learn,
    learn_imu,
    new_channels,
    new_imu_noise,
    note_left,
    share_tilt,
    weigh_bank,
)
from aircraft_sysid_ros.reconstruction.state import D_ACCELEROMETER_BIAS, D_ATTITUDE, StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

AIR = (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)


def channel_of(signal, step=0.02, base=1.0):
    """A channel that has met a signal (n,) from which the motion was taken, every ``step`` [s]."""
    channel, one, zero = new_channels(1)[0], np.full(3, base), np.zeros(1)
    h, total = np.zeros((1, 18)), np.full((1, 1), base)
    for k, change in enumerate(np.diff(signal, prepend=signal[0])):
        learn(step * (k + 1), np.array([change]), h, total, one, one, np.zeros(18), channel)
        note_left(zero, h, np.zeros(18), channel)
    weigh_bank(channel[0])
    return channel[0]


def level_and_noise(random, count, white, walk, step=0.02):
    """A level that wanders, seen through white noise: one sigma, and per square root of a second."""
    return np.cumsum(walk * np.sqrt(step) * random.standard_normal(count)) + white * random.standard_normal(count)


@pytest.mark.parametrize("white", [0.3, 1.0, 4.0])
@pytest.mark.parametrize("walk", [0.5, 3.0])
def test_white_noise_and_random_walk_are_told_apart(white, walk):
    one = channel_of(level_and_noise(np.random.default_rng(1), 6000, white, walk))
    # Standard errors of the two: 1 to 3 %, and 10 % of what is hidden most by the other.
    assert np.sqrt(one[WHITE]) == pytest.approx(white, rel=0.15)
    assert np.sqrt(one[WALK]) == pytest.approx(walk, rel=0.25)


def test_a_signal_in_another_unit_has_the_same_noise_in_that_unit():
    signal = level_and_noise(np.random.default_rng(2), 3000, 0.7, 0.4)
    plain, scaled = channel_of(signal), channel_of(8.0 * signal, base=64.0)
    assert scaled[WHITE] == pytest.approx(plain[WHITE], rel=1e-9)
    assert scaled[WALK] == pytest.approx(plain[WALK], rel=1e-9)


@pytest.mark.parametrize("step", [0.005, 0.02])
def test_steps_of_a_converter_are_noise_of_a_twelfth_of_their_square(step):
    random, size = np.random.default_rng(3), 1.5
    moved = level_and_noise(random, 4000, 0.5, 2.0, step)
    one = channel_of(size * np.round(moved / size), step)
    assert np.sqrt(one[WHITE]) == pytest.approx(np.hypot(0.5, size / np.sqrt(12.0)), rel=0.2)


@pytest.mark.parametrize("size", [10.0, 100.0])
def test_one_sample_in_twenty_that_is_far_off_does_not_count(size):
    random = np.random.default_rng(4)
    signal = level_and_noise(random, 6000, 1.0, 0.5)
    far = random.random(6000) < 0.05
    signal[far] += size * random.choice([-1.0, 1.0], int(far.sum()))
    one = channel_of(signal)
    assert np.sqrt(one[WHITE]) == pytest.approx(1.0, rel=0.15)
    assert np.sqrt(one[WALK]) < 1.5


def test_a_lasting_step_is_a_new_level_and_no_outlier_for_ever():
    random = np.random.default_rng(5)
    signal = random.standard_normal(3000)
    signal[1500:] += 50.0
    assert np.sqrt(channel_of(signal)[WHITE]) == pytest.approx(1.0, rel=0.1)


def test_a_number_that_repeats_itself_is_held_unless_the_signal_is_coarse():
    fine, coarse = new_channels(1)[0], new_channels(1)[0]
    random = np.random.default_rng(6)
    for value in np.repeat(random.standard_normal(200), 2):
        sample = np.array([value, np.nan, np.nan])
        again = is_held(sample, 1.0, 1, fine)
    assert again
    for value in np.round(random.standard_normal(400)):
        sample = np.array([value, np.nan, np.nan])
        is_held(sample, 1.0, 1, coarse)
    assert not is_held(sample, 1.0, 1, coarse)


@pytest.mark.parametrize("rate", [50.0, 100.0, 400.0])
def test_noise_of_the_imu_is_found_beside_its_motion(rate):
    random, noise = np.random.default_rng(7), new_imu_noise()
    times = np.arange(1, 6000) / rate
    motion = np.sin(2.0 * np.pi * times)[:, None] * [3.0, 3.0, 10.0, 2.0, 1.0, 0.5]
    sigma = np.array([0.05] * 3 + [0.002] * 3)
    values = motion + sigma * random.standard_normal(motion.shape)
    for time, sample in zip(times, values, strict=True):
        learn_imu(time, sample, 0.1**2, 0.005**2, noise)
        learn_imu(time, sample, 0.1**2, 0.005**2, noise)  # a stamp that stands twice
    found = np.sqrt(noise[:6, 5])
    assert found[:3] * 0.1 == pytest.approx(sigma[:3], rel=0.12)
    assert found[3:] * 0.005 == pytest.approx(sigma[3:], rel=0.12)


def test_an_absurd_covariance_of_a_message_is_not_believed():
    assert believed_variance(4.0, 1.0) == 4.0
    assert believed_variance(1e-12, 1.0) == 1e-6
    assert believed_variance(1e12, 1.0) == 1e4


# -- flights ---------------------------------------------------------------------------------------------------------


def bare(aircraft, **more):
    """The aircraft with mass and shape, and places, only."""
    source = {k: v for k, v in aircraft.source.items() if k not in ("sensors", "process_noise", "coefficients")}
    return aircraft_from_dict({**source, **more})


def without_variances(samples):
    """Samples as of messages without covariances."""
    values = samples.values.copy()
    values[samples.kind == Kind.IMU, 6:] = values[samples.kind == Kind.ATTITUDE, 4:] = np.nan
    values[samples.kind == Kind.GPS_POSITION, 3:] = np.nan
    return Samples(samples.stamp, samples.kind, values)


def flown(aircraft, samples, block=1000):
    """Estimator and rows after a flight."""
    state = StateEstimator(aircraft)
    rows = [state.push(samples[i : i + block]) for i in range(0, len(samples), block)]
    return state, np.vstack([*rows, state.flush()])


@pytest.fixture(scope="module")
def flight():
    return simulate_samples(default_aircraft(), 61, 90.0, turbulence="light", sensors=SensorOptions(attitude=True))


@pytest.fixture(scope="module")
def samples(flight):
    return without_variances(flight.samples)


@pytest.mark.long
@pytest.mark.parametrize("scale", [pytest.param(1.0, marks=pytest.mark.long), 4.0])
def test_the_noise_of_all_sensors_is_found_from_a_file_with_mass_and_shape(scale):
    truth = default_aircraft()
    made = simulate_samples(truth, 62, 90.0, sensors=SensorOptions(noise_scale=scale, attitude=True))
    state, _ = flown(bare(truth), without_variances(made.samples))
    for each in found_noise(state):
        expected = scale * np.broadcast_to(truth.sensors[each.name].noise, each.in_use.shape)
        # Of GPS there are 450 samples, and its bound below is a fifth of the default.
        assert each.in_use == pytest.approx(expected, rel=0.3 if each.name.startswith("gps") else 0.12), each.name
        assert each.source == FLIGHT
    walk, source = found_wind_walk(state)
    assert walk < 0.6 * DEFAULT_PROCESS_NOISE["wind"] and source == FLIGHT  # calm air: 0.03 was flown


@pytest.mark.long
def test_at_10_hz_it_is_found_too(flight, samples):
    keep = np.ones(len(samples), np.bool_)
    for kind, part in ((Kind.IMU, 10), (Kind.ATTITUDE, 10), *((kind, 5) for kind in AIR)):
        at = np.flatnonzero(samples.kind == kind)
        keep[at] = np.arange(len(at)) % part == 0
    state, _ = flown(bare(flight.aircraft), samples[keep])
    for each in found_noise(state):
        # What changes between sparse samples of the IMU is motion; of an attitude it is not yet known how slow it is.
        if each.name not in ("accelerometer", "gyro", "attitude"):
            ratio = each.in_use / flight.aircraft.sensors[each.name].noise
            assert np.all((ratio > 0.7) & (ratio < 1.7)), each.name


@pytest.mark.long
def test_gusts_are_found_where_they_are(flight, samples):
    state, _ = flown(bare(flight.aircraft), samples)
    calm = simulate_samples(flight.aircraft, 61, 90.0)
    still, _ = flown(bare(flight.aircraft), without_variances(calm.samples))
    assert found_wind_walk(state)[0] > 3.0 * found_wind_walk(still)[0]


@pytest.mark.long
def test_what_the_file_states_is_used_to_the_bit(flight, samples):
    plain = StateEstimator(flight.aircraft)
    other = StateEstimator(flight.aircraft)
    other.memory.noise[:, :, SCALE] = 7.0
    other.memory.imu_noise[:6, 5] = 7.0
    rows = plain.push(samples)
    np.testing.assert_array_equal(rows, other.push(samples))
    assert all(each.source == FILE for each in found_noise(plain))
    assert found_wind_walk(plain) == (flight.aircraft.process_noise["wind"], FILE)
    assert not noise_notes(plain)
    assert completed_file(plain) == flight.aircraft.source


def test_a_stated_noise_that_the_flight_denies_is_used_and_said(flight, samples):
    state, _ = flown(bare(flight.aircraft, sensors={"airspeed": {"noise": 0.03}}), samples)
    airspeed = next(each for each in found_noise(state) if each.name == "airspeed")
    assert airspeed.in_use == [0.03] and airspeed.shown == pytest.approx(0.15, rel=0.4)
    assert any("airspeed" in note and "0.03" in note for note in noise_notes(state))


@pytest.mark.parametrize("is_stated", [True, False])
def test_of_a_sensor_with_a_scale_the_noise_is_that_of_what_it_shows(flight, samples, is_stated):
    """Of samples and a noise that are twice as large, and say so by a scale, comes the same flight to the bit."""
    kinds = {"airspeed": Kind.AIRSPEED, "angle_of_attack": Kind.ANGLE_OF_ATTACK, "sideslip": Kind.SIDESLIP}
    stated = {name: {"noise": flight.aircraft.sensors[name].noise[0]} if is_stated else {} for name in kinds}
    twice = {name: {key: 2.0 * noise for key, noise in said.items()} | {"scale": 2.0} for name, said in stated.items()}
    shown = samples[:15000].values.copy()
    shown[np.isin(samples.kind[:15000], list(kinds.values())), 0] *= 2.0
    state, rows = flown(bare(flight.aircraft, sensors=stated), samples[:15000])
    other, of_other = flown(
        bare(flight.aircraft, sensors=twice), Samples(samples.stamp[:15000], samples.kind[:15000], shown)
    )
    if is_stated:
        np.testing.assert_array_equal(of_other, rows)
    noise, of_shown = ({each.name: each.in_use for each in found_noise(one)} for one in (state, other))
    for name in noise:
        # What is not stated begins at the default of what the sensor shows, and is then found.
        expected = noise[name] * (2.0 if name in kinds else 1.0)
        assert of_shown[name] == pytest.approx(expected, rel=1e-12 if is_stated else 0.05), name


@pytest.mark.long
def test_in_portions_of_any_size_it_is_the_same_to_the_bit(flight, samples):
    aircraft, part = bare(flight.aircraft), samples[:12000]
    _, whole = flown(aircraft, part, len(part))
    state, single = flown(aircraft, part, 7)
    np.testing.assert_array_equal(whole, single)
    assert {each.source for each in found_noise(state)} == {FLIGHT}


def test_before_the_flight_has_shown_it_noise_is_of_messages_or_default(flight):
    state, _ = flown(bare(flight.aircraft), flight.samples[:600])
    sources = {each.name: each.source for each in found_noise(state)}
    assert sources["airspeed"] == DEFAULT
    assert sources["gps_position"] == MESSAGES  # the simulated receiver sends its covariance
    assert set(noise_json(state)) == {*sources, "wind"}


def drifting(samples, error):
    """Samples whose attitude is turned by error(t) (n, 3) [rad] in body axes."""
    values, at = samples.values.copy(), np.flatnonzero(samples.kind == Kind.ATTITUDE)
    turns = error((samples.stamp[at] - samples.stamp[0]) * 1e-9)
    for index, turn in zip(at, turns, strict=True):
        values[index, :4] = quaternion_product(values[index, :4], quaternion_exp(turn))
    return Samples(samples.stamp, samples.kind, values)


def attitude_error(flight, state, rows):
    """Rms error [rad] (3,) of the attitude after a minute."""
    late = rows[rows[:, 0] > rows[0, 0] + 60.0][::20]
    truth = flight.truth.at(late[:, 0] + (state.epoch - int(flight.biases.stamp[0])) * 1e-9)
    pairs = zip(late[:, StateField.ATTITUDE], truth.quaternion, strict=True)
    turns = [quaternion_log(quaternion_product(quaternion_conjugate(mine), true)) for mine, true in pairs]
    return np.sqrt(np.mean(np.square(turns), axis=0))


def gauss_markov(time, std=3.0, constant=60.0, seed=8):
    """First-order Gauss-Markov errors (n, 3) [rad] of a standard deviation [deg] and a time constant [s]."""
    keep = np.exp(-np.median(np.diff(time)) / constant)
    driven = np.deg2rad(std) * np.sqrt(1.0 - keep**2) * np.random.default_rng(seed).standard_normal((len(time), 3))
    driven[0] = np.deg2rad(std)
    return lfilter([1.0], [1.0, -keep], driven, axis=0)


@pytest.mark.long
def test_an_attitude_that_drifts_counts_for_less_and_is_not_thrown_away():
    flight = simulate_samples(default_aircraft(), 63, 180.0, sensors=SensorOptions(attitude=True))
    samples = drifting(without_variances(flight.samples), gauss_markov)
    state, rows = flown(bare(flight.aircraft), samples)
    stated, believed = flown(bare(flight.aircraft, sensors={"attitude": {"noise": 0.03}}), samples)
    roll, pitch, _ = attitude_error(flight, state, rows)
    roll_believed, pitch_believed, _ = attitude_error(flight, stated, believed)
    assert roll < 0.5 * roll_believed and pitch < 0.5 * pitch_believed
    assert max(roll, pitch) < np.deg2rad(1.5)  # the source: 3 deg
    assert state.memory.rejected[Kind.ATTITUDE] < 0.02 * state.memory.fused[Kind.ATTITUDE]
    assert any("slow error of its own" in note for note in noise_notes(state))


def bias_and_doubt(flight, samples):
    """Errors of the biases of the accelerometer forward and to the right after a flight [m/s^2], and their sigmas."""
    _, rows = flown(bare(flight.aircraft), samples)
    sigma = rows[-1, StateField.STANDARD_DEVIATIONS][D_ACCELEROMETER_BIAS : D_ACCELEROMETER_BIAS + 2]
    return (rows[-1, StateField.ACCELEROMETER_BIAS] - flight.biases.accelerometer[-1])[:2], sigma


@pytest.mark.long
def test_a_bias_is_known_no_better_than_an_attitude_that_drifts_shows_the_tilt():
    """0.4 deg over a minute, as of the filter of an autopilot: biases had been off by seven of their sigmas."""
    errors, sound = [], simulate_samples(default_aircraft(), 90, 120.0, sensors=SensorOptions(attitude=True))
    for seed in range(4):
        flight = simulate_samples(default_aircraft(), 91 + seed, 120.0, sensors=SensorOptions(attitude=True))
        samples = drifting(without_variances(flight.samples), partial(gauss_markov, std=0.4, seed=seed))
        error, sigma = bias_and_doubt(flight, samples)
        errors.append(error / sigma)
        assert np.all(sigma < 9.81 * np.deg2rad(0.6))
    assert np.abs(errors).max() < 3.0 and np.sqrt(np.mean(np.square(errors))) < 1.5
    assert np.all(bias_and_doubt(sound, without_variances(sound.samples))[1] < 0.01)  # where it does not drift


def test_heading_and_wind_are_known_no_better_than_an_attitude_that_drifts_shows_them():
    """1 deg over 40 s: heading and wind had been off by 3 to 14 and by 2 to 6 of their sigmas, rms in a flight."""
    of_heading, of_wind = [], []
    for seed in (31, 34, 36):
        flight = simulate_samples(default_aircraft(), seed, 80.0, sensors=SensorOptions(attitude=True))
        drifts = partial(gauss_markov, std=1.0, constant=40.0, seed=seed)
        state, rows = flown(bare(flight.aircraft), drifting(without_variances(flight.samples), drifts))
        late = rows[rows[:, 0] > rows[0, 0] + 40.0][::20]
        truth = flight.truth.at(late[:, 0] + (state.epoch - int(flight.biases.stamp[0])) * 1e-9)
        pairs = zip(late[:, StateField.ATTITUDE], truth.quaternion, strict=True)
        turns = np.array([quaternion_log(quaternion_product(quaternion_conjugate(mine), q)) for mine, q in pairs])
        of_heading.append(turns[:, 2] / late[:, StateField.STANDARD_DEVIATIONS][:, D_ATTITUDE + 2])
        of_wind.append((truth.wind - late[:, StateField.WIND]) / late[:, StateField.WIND_STD])
        heading = state.attitude_doubt[2]
        assert 0.0 < heading < np.deg2rad(3.0)
        assert late[-1, StateField.STANDARD_DEVIATIONS][D_ATTITUDE + 2] > heading
    assert np.sqrt(np.mean(np.square(of_heading))) < 2.5
    assert np.sqrt(np.mean(np.square(of_wind), axis=(0, 1))).max() < 2.5


@pytest.mark.parametrize("leap", [20.0, 60.0])
def test_after_a_leap_of_a_measured_heading_it_is_in_doubt(leap):
    """As of an inertial system that aligns its heading in flight [deg]: the mean of both was known to half a degree."""
    flight = simulate_samples(default_aircraft(), 31, 80.0, sensors=SensorOptions(attitude=True))
    samples = drifting(without_variances(flight.samples), lambda time: np.outer(time < 10.0, [0, 0, np.deg2rad(leap)]))
    state, rows = flown(bare(flight.aircraft), samples)
    late = rows[rows[:, 0] > rows[0, 0] + 30.0][::20]
    truth = flight.truth.at(late[:, 0] + (state.epoch - int(flight.biases.stamp[0])) * 1e-9)
    pairs = zip(late[:, StateField.ATTITUDE], truth.quaternion, strict=True)
    turns = np.array([quaternion_log(quaternion_product(quaternion_conjugate(mine), q)) for mine, q in pairs])
    assert np.abs(turns[:, 2] / late[:, StateField.STANDARD_DEVIATIONS][:, D_ATTITUDE + 2]).max() < 3.0
    wind = (truth.wind - late[:, StateField.WIND]) / late[:, StateField.WIND_STD]
    assert np.sqrt(np.mean(np.square(wind), axis=0)).max() < 2.5


def askew(samples, seed):
    """Samples of an IMU as one buys it: axes 0.2 deg out of line, scales 0.3 % off."""
    rng, values, imu = np.random.default_rng(seed), samples.values.copy(), samples.kind == Kind.IMU
    for first in (0, 3):
        axes = np.eye(3) * (1.0 + rng.normal(0.0, 0.003)) + rng.normal(0.0, 0.004, (3, 3)) * (1.0 - np.eye(3))
        values[imu, first : first + 3] = values[imu, first : first + 3] @ axes.T
    return Samples(samples.stamp, samples.kind, values)


def test_a_vane_and_the_biases_are_known_no_better_than_the_tilt():
    """An attitude that drifts by 0.7 deg, and an IMU that is not perfect, of which the filter alone knows nothing."""
    alone, said = [], []
    for seed in range(4, 7):
        flight = simulate_samples(default_aircraft(), 91 + seed, 90.0, sensors=SensorOptions(attitude=True))
        state = StateEstimator(bare(flight.aircraft), StateOptions(air_data_errors=True))
        samples = askew(without_variances(flight.samples), seed)
        state.push(drifting(samples, partial(gauss_markov, std=0.7, seed=seed)))
        state.flush()
        of_filter, with_tilt = error_table(*state.slow_states)["b_alpha"], state.air_data_errors["b_alpha"]
        assert np.deg2rad(0.1) < with_tilt["of_attitude"] < state.attitude_doubt[1]
        alone.append(of_filter["value"] / of_filter["std"])  # the vane is sound
        said.append(with_tilt["value"] / with_tilt["std"])
        summary = state.summary()
        of_rows = state.last_row[StateField.STANDARD_DEVIATIONS][D_ACCELEROMETER_BIAS : D_ACCELEROMETER_BIAS + 3]
        np.testing.assert_allclose(summary["accelerometer_bias_std"], of_rows, rtol=1e-6)
    assert np.abs(alone).max() > 3.0 and np.abs(said).max() < 1.5


def test_of_an_attitude_that_is_good_no_slow_error_is_said(flight, samples):
    state, rows = flown(bare(flight.aircraft), samples)
    assert not noise_notes(state)
    assert np.all(attitude_error(flight, state, rows) < np.deg2rad(0.3))


def test_an_attitude_that_is_mounted_askew_is_not_thrown_away(flight, samples):
    askew = drifting(samples, lambda time: np.tile(np.deg2rad([3.0, -2.0, 0.0]), (len(time), 1)))
    state, rows = flown(bare(flight.aircraft), askew)
    assert state.memory.rejected[Kind.ATTITUDE] < 0.02 * state.memory.fused[Kind.ATTITUDE]
    assert np.all(attitude_error(flight, state, rows)[:2] < np.deg2rad(3.1))  # never worse than the source


def test_no_sensor_is_rejected_for_a_third_of_a_flight(flight, samples):
    values, at = samples.values.copy(), np.flatnonzero(samples.kind == Kind.GPS_VELOCITY)
    heavy = np.random.default_rng(9).standard_t(1.0, (len(at), 3))  # white noise with tails that no variance describes
    values[at, :3] += np.clip(heavy, -20.0, 20.0)
    rough = Samples(samples.stamp, samples.kind, values)
    found, _ = flown(bare(flight.aircraft), rough)
    believed, _ = flown(bare(flight.aircraft, sensors={"gps_velocity": {"noise": [0.2, 0.2, 0.4]}}), rough)
    assert believed.memory.rejected[Kind.GPS_VELOCITY] > len(at) / 3
    assert found.memory.rejected[Kind.GPS_VELOCITY] < 0.15 * len(at)


@pytest.mark.parametrize("harm", ["dead", "nan"])
def test_a_sensor_that_fails_does_not_change_what_is_known_of_the_others(flight, samples, harm):
    values, at = samples.values.copy(), np.flatnonzero(samples.kind == Kind.SIDESLIP)
    late = at[len(at) // 2 :]
    values[late, 0] = np.nan if harm == "nan" else values[late[0], 0]
    state, rows = flown(bare(flight.aircraft), Samples(samples.stamp, samples.kind, values))
    assert np.isfinite(rows[-1, StateField.ATTITUDE]).all()
    for each in found_noise(state):
        if each.name not in ("accelerometer", "gyro"):
            expected = np.broadcast_to(flight.aircraft.sensors[each.name].noise, each.in_use.shape)
            assert each.in_use == pytest.approx(expected, rel=0.35), each.name


def test_what_was_found_outlasts_a_new_manoeuvre_and_a_clock_that_restarts(flight, samples):
    state, _ = flown(bare(flight.aircraft), samples)
    before = {each.name: each.in_use for each in found_noise(state)}
    state.begin_anew(100.0)
    later = Samples(samples.stamp - 3 * 10**12, samples.kind, samples.values)
    state.push(later[:9000])
    state.flush()
    assert state.has_been_aligned
    for each in found_noise(state):
        assert each.in_use == pytest.approx(before[each.name], rel=0.25), each.name


def test_the_completed_file_states_what_was_found_and_keeps_the_rest(flight, samples):
    aircraft = bare(flight.aircraft, sensors={"gps": {"delay": 0.1}, "alpha": {"rate": 40}}, ground_altitude=3.0)
    samples = replace(samples, stamp=samples.stamp + np.where(samples.kind == Kind.GPS_VELOCITY, 10**8, 0))
    state, _ = flown(aircraft, samples)
    made = aircraft_from_dict(completed_file(state))
    assert made.sensors["gps_velocity"].delay == 0.1 and made.sensors["angle_of_attack"].rate == 40
    assert made.ground_altitude == 3.0 and made.process_noise["wind"] == pytest.approx(
        found_wind_walk(state)[0], rel=0.01
    )
    for each in found_noise(state):
        sensor = made.sensors[each.name]
        assert sensor.noise_is_given
        assert np.sqrt(np.mean(np.square(sensor.noise))) == pytest.approx(np.sqrt(np.mean(each.in_use**2)), rel=0.01)


@pytest.mark.parametrize("slow", [0, 1])
def test_a_slow_error_of_roll_or_pitch_is_one_of_both(slow):
    """Heading has another source, and keeps its own; without any slow error each keeps its own."""
    attitude = new_channels(len(Kind))[Kind.ATTITUDE]
    attitude[:, SCALE] = 1.0, 2.0, 3.0
    share_tilt(attitude)
    assert attitude[:, SCALE].tolist() == [1.0, 2.0, 3.0] and not attitude[:, COLOURED].any()
    attitude[slow, SCALE], attitude[slow, COLOURED] = 50.0, 1.0
    share_tilt(attitude)
    assert attitude[:, SCALE].tolist() == [50.0, 50.0, 3.0] and attitude[:, COLOURED].tolist() == [1.0, 1.0, 0.0]
