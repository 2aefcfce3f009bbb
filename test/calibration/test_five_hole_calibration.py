"""Five-hole probe: the model against its equations, the answer against the truth, and flights that cannot tell."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.frames import quaternion_from_euler, rotation_matrix, velocity_from_air_data
from aircraft_sysid_ros.calibration import five_hole_probe as probe
from aircraft_sysid_ros.calibration.five_hole_probe import NAMES1, NAMES2, ProbeData
from aircraft_sysid_ros.calibration.navigation import Grid, Navigation, in_span
from aircraft_sysid_ros.calibration.procedure import Task, residuals, solve
from aircraft_sysid_ros.calibration.report import _no_answers, calibrate_probe
from aircraft_sysid_ros.calibration.segments import find_segments
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.least_squares import central_differences
from aircraft_sysid_ros.samples import Kind, Samples, joined, samples_of
from aircraft_sysid_ros.sensors.five_hole_probe import ProbeCalibration
from aircraft_sysid_ros.sensors.sensor_models import EPOCH, SensorOptions
from aircraft_sysid_ros.simulation.calibration_flight import calibration_flight
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples


@pytest.fixture
def data():
    """Random flow without noise: what (36), (37) of the two-stage paper say of a wind and errors, and the unknowns."""
    rng, n = np.random.default_rng(0), 40
    xi = np.array([0.2, -1.5, 4.0, -3.0, 0.5, -0.3, 0.03, 0.25, -0.04, 0.15])
    speed, alpha, beta = rng.uniform(15, 25, n), rng.uniform(-0.1, 0.2, n), rng.uniform(-0.15, 0.15, n)
    rotation = np.array([rotation_matrix(quaternion_from_euler(*rng.uniform(-1.0, 1.0, 3))) for _ in range(n)])
    arm = rng.normal(0.0, 0.3, (n, 3))
    truth = ProbeCalibration(
        airspeed_scale=xi[0], airspeed_offset=xi[1], alpha_scale=xi[5], alpha_offset=xi[6], beta_scale=xi[7],
        beta_offset=xi[8], mount_roll=xi[9],
    )  # fmt: skip
    density = rng.uniform(1.0, 1.2, n)
    impact, of_alpha, of_beta = truth.pressures(speed, alpha, beta, density).T
    flow = np.array([velocity_from_air_data(*row) for row in zip(speed, alpha, beta, strict=True)])
    velocity = np.einsum("nij,nj->ni", rotation, flow - arm) + xi[2:5]
    indicated = np.sqrt(2.0 * impact / density)
    return ProbeData(velocity, rotation, arm, indicated, of_alpha / (3.9 * impact), of_beta / (3.9 * impact)), xi


def test_the_model_is_the_wind_triangle(data):
    """Pressures of an independent simulator, V_NED put together by hand: no residual at the truth."""
    made, xi = data
    np.testing.assert_allclose(residuals(made.problem(), xi), 0.0, atol=1e-10)


def test_gradient_and_instruments_are_derivatives(data):
    made, xi = data
    made.problem().check_gradient(xi[5:])
    whole = lambda at: np.einsum("nij,j->ni", made.model(at[5:])[0], at[:5]) + made.model(at[5:])[1]  # noqa: E731
    np.testing.assert_allclose(made.instruments(xi), central_differences(whole, xi), atol=1e-6)


def test_derivative_by_the_attitude(data):
    made, xi = data
    step = 1e-6
    for axis in range(3):
        turn = rotation_matrix(np.array([1.0, *(0.5 * step * np.eye(3)[axis])]))
        moved = replace(made, rotation=made.rotation @ turn)
        change = (residuals(made.problem(), xi) - residuals(moved.problem(), xi)) / step
        np.testing.assert_allclose(made.by_attitude(xi)[:, :, axis], change, atol=1e-3)


def test_the_mount_turns_as_in_equation_38():
    """A probe that is rolled to the right by eps sees flow from below as flow from the right side."""
    turned = probe.mount_matrix(0.1) @ np.array([20.0, 0.0, 1.0])
    np.testing.assert_allclose(turned, [20.0, np.sin(0.1), np.cos(0.1)], atol=1e-12)


@pytest.mark.long
def test_all_ten_parameters_are_found(probe_answer, calibration_flown):
    answer, steady = probe_answer
    truth = {**calibration_flown.calibration["five_hole_probe"], "W_N": 4.0, "W_E": -5.0, "W_D": 0.3}
    errors = np.array([answer.values[name] - truth[name] for name in (*NAMES1, *NAMES2)])
    assert steady and answer.determined.all() and answer.converged
    assert np.all(np.abs(errors) < 4.0 * answer.std), dict(zip(answer.problem.names, errors / answer.std, strict=True))
    assert np.all(np.abs(errors) < [0.01, 0.2, 0.1, 0.1, 0.1, 0.02, 0.005, 0.02, 0.005, 0.01])
    assert np.all(answer.errors.std >= np.sqrt(np.diag(answer.errors.white)))  # coloured residuals know less


@pytest.mark.long
def test_circles_and_pushovers_are_found(probe_made):
    names = [segment.name for segment in probe_made.segments.found]
    assert names.count("wind circle") >= 2 and "pushover-pullup" in names
    assert 0.2 < probe_made.segments.first.sum() / probe_made.segments.used.sum() < 0.9


@pytest.mark.long
def test_instruments_undo_the_shrinking_of_scales(data):
    """Noise in the pressures makes least squares too small in lambda_alpha; the instrumental form is right."""
    made, xi = data
    rng = np.random.default_rng(1)
    many = ProbeData(*(np.repeat(getattr(made, name), 60, axis=0) for name in made.__dataclass_fields__))
    noisy = replace(many, alpha_ratio=many.alpha_ratio + rng.normal(0.0, 0.06, len(many.alpha_ratio)))
    task = Task(noisy.problem(), np.zeros(len(noisy.indicated), int), np.zeros(10))
    shrunk = solve(task, 32).values["lambda_alpha"]
    right = solve(replace(task, instruments=noisy.instruments), 32)
    error = right.values["lambda_alpha"] - xi[5]
    assert shrunk < xi[5] - 0.05
    assert abs(error) < 3.5 * right.std[5] and abs(error) < 0.04


def until(samples, seconds):
    """The recording up to a time [s]."""
    return samples[samples.stamp < samples.stamp.min() + int(seconds * 1e9)]


@pytest.mark.long
def test_straight_flight_says_so(calibration_aircraft):
    """The standard plan turns after a minute: before, wind along the track and airspeed error are one number."""
    sensors = SensorOptions(five_hole_probe=True)
    flight = simulate_samples(calibration_aircraft, 1, 120.0, manoeuvres="standard", wind_walk=0.0, sensors=sensors)
    with pytest.raises(InputError, match="wind and airspeed error cannot be told apart"):
        calibrate_probe(until(flight.samples, 60.0), calibration_aircraft)


def test_flights_of_different_days_have_different_winds(calibration_aircraft):
    """Of a run of two flights the wind found was that between both, and the scales had the rest of it."""
    one = samples_of(Kind.FIVE_HOLE, [EPOCH, EPOCH + 10**9], np.ones((2, 4)))
    both, _ = joined([one, Samples(one.stamp + 86_400 * 10**9, one.kind, one.values)])
    with pytest.raises(InputError, match="these are 2 flights"):
        calibrate_probe(both, calibration_aircraft)
    same, _ = joined([one, Samples(one.stamp + 60 * 10**9, one.kind, one.values)])
    with pytest.raises(InputError, match="no usable IMU samples"):  # manoeuvres of one flight
        calibrate_probe(same, calibration_aircraft)


@pytest.mark.long
def test_gusts_are_noticed(calibration_aircraft):
    """In turbulence the answer rests on averages, says so, and scales are too small but within their errors' reach."""
    wind = np.array([5.0, 2.0, 0.0])
    flight = calibration_flight(6, 150.0, aircraft=calibration_aircraft, wind=wind, turbulence="light")
    report = calibrate_probe(flight.samples, calibration_aircraft, samples=32)
    assert any("the wind was not steady" in note for note in report.notes)
    found = {p["name"]: p for p in report.parameters}
    for name, value in (("W_N", 5.0), ("W_E", 2.0)):
        assert abs(found[name]["value"] - value) < max(4.0 * found[name]["std"], 0.5)


@pytest.mark.long
def test_bad_recordings_are_one_sentence(calibration_flown):
    samples, aircraft = calibration_flown.samples, calibration_flown.aircraft
    with pytest.raises(InputError, match="needs /five_hole_probe"):
        probe.probe_flight(samples[samples.kind != Kind.FIVE_HOLE], aircraft)
    with pytest.raises(InputError, match="gps/vel"):
        probe.probe_flight(samples[samples.kind != Kind.GPS_VELOCITY], aircraft)
    with pytest.raises(InputError, match="only 10 s of flight"):
        probe.probe_flight(samples, aircraft, (50.0, 60.0))
    nothing = samples.values.copy()
    nothing[samples.kind == Kind.FIVE_HOLE] = np.nan
    with pytest.raises(InputError, match="no usable probe pressures"):
        probe.probe_flight(Samples(samples.stamp, samples.kind, nothing), aircraft)


def test_nan_samples_are_left_out(calibration_flown, probe_made):
    samples = until(calibration_flown.samples, 80.0)
    values = samples.values.copy()
    rows = np.flatnonzero(samples.kind == Kind.FIVE_HOLE)[500:600]
    values[rows, 2] = np.nan
    made = probe.probe_flight(Samples(samples.stamp, samples.kind, values), calibration_flown.aircraft)
    assert np.all(np.isfinite(made.data.alpha_ratio))
    assert made.grid.piece[-1] == 1  # two pieces, cut by 2 s without pressures


def test_a_slow_sensor_is_not_silent_between_its_samples():
    """Of a probe with a sample each second every sample was a piece of its own, so that no average had a row."""
    slow = Grid(np.delete(np.arange(40), [7, 20, 21, 22]), 1.0)  # one missed, as by jitter, and a gap
    assert np.flatnonzero(np.diff(slow.piece)).tolist() == [18]
    assert len(probe._blocks(slow.piece, 2)) == (19 // 2) + (17 // 2)


def test_a_wind_may_be_as_fast_as_the_aircraft_was_over_ground(data):
    """Of an aeroplane in 30 m/s of wind, 20 was found, and the rest of it was in the errors of the probe."""
    made, xi = data
    strong = np.array([30.0, -12.0, 0.0])
    blown = replace(made, velocity=made.velocity + strong)
    answer = solve(Task(blown.problem(), np.zeros(len(made.indicated), int), np.zeros(10)), 16)
    np.testing.assert_allclose(answer.xi, xi + np.array([0.0, 0.0, *strong, 0.0, 0.0, 0.0, 0.0, 0.0]), atol=1e-6)


@pytest.mark.parametrize(
    ("at_bound", "refused"),
    [("W_E", {"lambda_V", "b_V", *NAMES2}), ("W_D", {"lambda_alpha", "b_alpha"}), ("b_V", {"lambda_V", "b_V"})],
)
def test_with_a_wind_at_its_bound_what_it_hides_is_no_answer(data, at_bound, refused):
    made, _ = data
    answer = solve(Task(made.problem(), np.zeros(len(made.indicated), int), np.zeros(10)), 16)
    stands = np.array([name == at_bound for name in answer.problem.names])
    assert set(_no_answers(replace(answer, at_bound=stands))) == refused


@pytest.mark.long
def test_pressures_that_are_held_are_those_of_a_slower_probe(calibration_flown):
    """Most samples are as the one before: the noise of the probe was zero, and any wind not steady."""
    samples = until(calibration_flown.samples, 80.0)
    of_probe = np.flatnonzero(samples.kind == Kind.FIVE_HOLE)
    values, every = samples.values.copy(), np.arange(len(of_probe)) // 8 * 8
    values[of_probe] = values[of_probe[every]]
    held = probe.probe_flight(Samples(samples.stamp, samples.kind, values), calibration_flown.aircraft)
    kept = np.ones(len(samples), dtype=bool)
    kept[of_probe[np.arange(len(of_probe)) % 8 != 0]] = False
    slow = probe.probe_flight(samples[kept], calibration_flown.aircraft)
    assert held.angle_noise == slow.angle_noise > 0.0
    np.testing.assert_array_equal(held.data.alpha_ratio, slow.data.alpha_ratio)


def test_zeros_come_from_where_it_stands():
    stamp = (np.arange(1000) * 20_000_000).astype(np.int64)
    speed = np.where(np.arange(1000) < 500, 0.0, 20.0)
    velocity = np.outer(speed, [1.0, 0.0, 0.0])
    samples = samples_of(Kind.GPS_VELOCITY, stamp[::10], velocity[::10])
    pressures = np.column_stack([np.full(1000, 1e5), speed**2 * 0.6 - 20.0, np.full(1000, 3.0), np.full(1000, -2.0)])
    np.testing.assert_allclose(probe.pressure_zeros(samples, 0, stamp * 1e-9, pressures), [-20.0, 3.0, -2.0])


def test_segments_need_flight():
    n = 100
    still = Navigation(0, np.arange(n) * 0.04, np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)),
                       np.zeros(n), np.zeros((n, 3)), np.zeros(3))  # fmt: skip
    with pytest.raises(InputError, match="a calibration needs 30 s"):
        find_segments(still, np.ones(n, dtype=bool), 0.04)


def test_a_stamp_of_zero_does_not_move_the_times_of_a_calibration():
    """They counted from 1970, where nothing was flown."""
    time = np.arange(100) * 0.1
    flown = Navigation(EPOCH, time, *[np.zeros((100, 3))] * 6, np.zeros(3))
    samples = samples_of(Kind.IMU, np.append(0, EPOCH + np.round(time * 1e9).astype(np.int64)), np.zeros((101, 6)))
    assert np.flatnonzero(in_span(samples, flown, (1.95, 4.05))).tolist() == list(range(20, 41))


@pytest.mark.long
def test_a_noise_that_is_stated_too_small_is_found_and_counted_with():
    """With it the navigation lost its way, 4 deg in pitch where it said 1, and standard errors were a third."""
    flight = calibration_flight(11, 150.0, sensors=SensorOptions(noise_scale=3.0))
    made = probe.probe_flight(flight.samples, flight.aircraft)
    named = ("accelerometer", "gyro", "gps_position", "gps_velocity")
    assert all(
        f"sensor {name}, the flight shows" in note for name, note in zip(named, made.navigation.notes, strict=True)
    )
    at = np.searchsorted(flight.truth.time, made.navigation.time + made.navigation.epoch * 1e-9 - EPOCH * 1e-9)
    rows = zip(flight.truth.quaternion[at[::25]], made.navigation.rotation[::25], strict=True)
    turned = np.array([rotation_matrix(true).T @ found for true, found in rows])
    errors = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1)
    ratio = np.sqrt(np.mean(errors**2, axis=0)) / np.sqrt(np.mean(made.navigation.attitude_std**2, axis=0))
    assert np.all(ratio < 2.0) and np.any(ratio > 0.4)


@pytest.mark.long
def test_a_noise_that_is_stated_right_is_left_as_it_is():
    flight = calibration_flight(12, 60.0)
    assert probe.probe_flight(flight.samples, flight.aircraft).navigation.notes == ()
