"""Data compatibility: kinematics against a simulated flight, derivatives, and the answer against the truth."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.frames import quaternion_exp, quaternion_product, rotation_matrix
from aircraft_sysid_ros.calibration import compatibility
from aircraft_sysid_ros.calibration.calibration_file import AIR_DATA_ERRORS
from aircraft_sysid_ros.calibration.compatibility import NAMES1, NAMES2, compatibility_flight
from aircraft_sysid_ros.calibration.navigation import Navigation
from aircraft_sysid_ros.calibration.procedure import Answer
from aircraft_sysid_ros.calibration.report import _no_answers, calibrate_compatibility
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.two_stage.decision import Decision
from aircraft_sysid_ros.estimation.two_stage.residual_sampling import ResidualSamples
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of
from aircraft_sysid_ros.simulation.calibration_flight import calibration_flight


@pytest.fixture(scope="module")
def made(calibration_flown):
    return compatibility_flight(calibration_flown.samples, calibration_flown.aircraft, (5.0, 105.0))


def true_biases(flight):
    return np.concatenate([flight.biases.accelerometer[0], flight.biases.gyro[0]])


@pytest.mark.long
@pytest.mark.parametrize("known", [True, False])
def test_the_samples_of_the_first_turn_tell_whether_there_is_one_minimum(made, monkeypatch, known):
    """Later turns begin where it ended; the picture of their one start had been called one hollow of the samples."""
    xi, turns = np.zeros(len(NAMES1) + len(NAMES2)), []

    def solved(task, samples, seed, progress):
        count = samples if isinstance(samples, int) else len(samples)
        turns.append(count)
        drawn = ResidualSamples(np.zeros((count, 6)), np.zeros((count, 11)), np.ones(count), np.ones(count))
        free = np.arange(len(xi)) < (len(xi) if known or count == 1 else 13)
        decision = Decision(True, f"from {count}", ())
        return Answer(task, xi, None, free, free, None, drawn, decision, True, True, "converged")

    monkeypatch.setattr(compatibility, "solve", solved)
    answer, _ = made.solve(8)
    assert turns[0] == 8 and set(turns[1:]) == {1}
    assert (len(answer.samples.trace), answer.decision.reason) == ((8, "from 8") if known else (1, "from 1"))


@pytest.mark.long
def test_outputs_follow_the_flight(made, calibration_flown):
    """With the true biases and the answer's starts, V, alpha, beta and angles are those of the simulator."""
    answer, data = made.solve(8)
    assert "the samples have" not in answer.decision.reason or len(answer.samples.trace) > 1
    truth = calibration_flown.calibration["compatibility"]
    values = np.array([truth[name] for name in NAMES1])
    biases = true_biases(calibration_flown)
    refined = data.refined(np.concatenate([values, biases]))
    shown = refined.outputs(biases) * (1.0 + values[:6]) + np.append(values[6:], 0.0)
    left = np.sqrt(np.mean((refined.there * (refined.measured - shown)) ** 2, axis=0))
    assert np.all(left < [0.25, 0.01, 0.01, 0.006, 0.006, 0.006])
    errors = answer.xi - np.concatenate([values, biases])
    assert np.all(np.abs(errors) < 7.0 * answer.std)  # five pieces: few degrees of freedom
    assert np.all(np.abs(errors[len(NAMES1) :]) < [0.06] * 3 + [0.002] * 3)
    assert np.all(answer.std[len(NAMES1) :] < [0.1] * 3 + [0.003] * 3)


@pytest.mark.long
@pytest.mark.parametrize("late", [0.0, 0.13])
def test_slow_air_data_have_the_scale_of_fast_ones(calibration_flown, late):
    """Straight lines between 5 samples a second cut doublets: scales came out 3 to 9 % too small, 4 to 9 sigma."""
    samples, truth = calibration_flown.samples, calibration_flown.calibration["compatibility"]
    air = np.isin(samples.kind, (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP))
    slot = np.floor((samples.stamp - samples.stamp.min()) * 1e-9 / 0.2 - late)
    first = np.ones(len(samples), bool)
    for kind in np.unique(samples.kind[air]):
        of_kind = np.flatnonzero(samples.kind == kind)
        first[of_kind] = np.diff(slot[of_kind], prepend=-9.0) != 0
    made = compatibility_flight(samples[~air | first], calibration_flown.aircraft, (5.0, 105.0))
    answer, _ = made.solve(8)
    for name in ("lambda_alpha", "lambda_beta"):
        at = NAMES1.index(name)
        error = answer.xi[at] - truth[name]
        assert abs(error) < min(0.025, 3.5 * answer.std[at]), f"{name} {error:.4f} +- {answer.std[at]:.4f}"


@pytest.mark.long
def test_derivatives(made, calibration_flown):
    biases = true_biases(calibration_flown)
    data = made.data
    slopes = data.slopes(biases)
    for j, step in enumerate([1e-4] * 3 + [1e-6] * 3):
        move = step * np.eye(6)[j]
        change = (data.outputs(biases + move) - data.outputs(biases - move)) / (2.0 * step)
        assert np.max(np.abs(slopes[:, :, 6 + j] - change)) < 2e-4 * max(np.max(np.abs(change)), 1.0)
    for j in range(6):
        move = 1e-5 * np.eye(6)[j]

        def moved(by):
            turned = np.array([quaternion_product(quaternion_exp(by[3:]), q) for q in data.attitude0])
            return replace(data, velocity0=data.velocity0 + by[:3], attitude0=turned).outputs(biases)

        change = (moved(move) - moved(-move)) / 2e-5
        assert np.max(np.abs(slopes[:, :, j] - change)) < 1e-5 * max(np.max(np.abs(change)), 1.0)


def test_no_start_is_left_in_what_is_projected(made, calibration_flown):
    """A change of the start of a piece changes the projected measurements by second order only."""
    biases = true_biases(calibration_flown)
    data = made.data.refined(None).refined(np.concatenate([np.zeros(len(NAMES1)), biases]))
    moved = replace(data, velocity0=data.velocity0 + 0.05)
    change = (moved.outputs(biases) - data.outputs(biases)) / data.scale
    assert np.linalg.norm(data.projected(change)) < 0.02 * np.linalg.norm(change * data.there)


def test_a_full_roll_leaves_no_turn_in_what_follows(aircraft, monkeypatch):
    """Roll was counted on over the aileron roll, and all that came after it differed by 360 deg from the IMU."""
    time = np.arange(0.0, 100.0, 0.02)
    rate = np.where((time > 30.0) & (time < 34.0), 0.5 * np.pi, 0.0)
    roll = np.clip(time - 30.0, 0.0, 4.0) * 0.5 * np.pi
    turned, zero = quaternions(roll), np.zeros(len(time))
    rotation = np.array([rotation_matrix(q) for q in turned])
    force = -9.80665 * rotation[:, 2]
    stamps = np.round(time * 1e9).astype(np.int64)
    samples = concatenate([
        samples_of(Kind.IMU, stamps, force, np.column_stack([rate, zero, zero])),
        samples_of(Kind.ATTITUDE, stamps, turned), samples_of(Kind.AIRSPEED, stamps, zero + 25.0),
        samples_of(Kind.ANGLE_OF_ATTACK, stamps, zero), samples_of(Kind.SIDESLIP, stamps, zero),
    ])  # fmt: skip
    ahead = np.column_stack([zero + 25.0, zero, zero])
    flown = Navigation(0, time, ahead, rotation, np.column_stack([rate, zero, zero]), zero, 0.0 * ahead, np.zeros(3))
    monkeypatch.setattr(compatibility, "navigate", lambda *_: flown)
    data = compatibility_flight(samples, aircraft).data
    left = data.there * (data.measured - data.outputs(np.zeros(6)))
    assert np.max(np.abs(left[:, 3])) < 0.05 and np.mean(data.there[:, 3]) > 0.95


def quaternions(roll):
    return np.column_stack([np.cos(0.5 * roll), np.sin(0.5 * roll), 0.0 * roll, 0.0 * roll])


@pytest.mark.long
def test_missing_topics(calibration_flown):
    samples, aircraft = calibration_flown.samples, calibration_flown.aircraft
    with pytest.raises(InputError, match="needs /air_data"):
        compatibility_flight(samples[samples.kind != Kind.SIDESLIP], aircraft)
    with pytest.raises(InputError, match="2 pieces of up to 20 s"):
        compatibility_flight(samples, aircraft, (5.0, 45.0))
    without = compatibility_flight(samples[samples.kind != Kind.ATTITUDE], aircraft, (5.0, 90.0))
    assert not without.attitude_is_measured  # those of the navigation take their place


@pytest.mark.long
def test_what_gusts_spoil_is_not_written_into_the_file(calibration_aircraft):
    """It was written with a word of warning on the screen, and replay took it: C_Z,alpha was a quarter too small."""
    wind = np.array([5.0, 2.0, 0.0])
    flight = calibration_flight(6, 150.0, aircraft=calibration_aircraft, wind=wind, turbulence="moderate")
    report = calibrate_compatibility(flight.samples, calibration_aircraft, samples=16)
    refused = report.answer.refused
    assert "in a wind that was not steady" in refused["lambda_V"] and "taken as 0" in refused["lambda_V"]
    for name in refused:
        assert report.section[name] == 0.0 and report.section["std"][name] is None
    assert not any(p["determined"] for p in report.parameters if p["name"] in AIR_DATA_ERRORS)
    assert any("nothing is corrected by them" in note for note in report.notes)
    assert report.section["std"]["b_p"] is not None  # what does not rest on the air
    assert len(report.json()["stage_1"]["names"]) == report.answer.samples.xi2.shape[1]


@pytest.mark.long
def test_what_is_at_its_bound_is_no_answer_and_what_is_beside_it_neither(made):
    answer, _ = made.solve(samples=16)
    names, xi = list(answer.problem.names), answer.xi.copy()
    at = names.index("lambda_beta")
    xi[at] = answer.problem.bounds[at, 1]
    bound = replace(answer, xi=xi, at_bound=np.arange(len(xi)) == at, determined=np.ones(len(xi), bool))
    left = bound.without(_no_answers(bound))
    assert set(left.refused) == {"lambda_beta", "b_beta"}
    assert left.refused["lambda_beta"].startswith("at its bound") and left.refused["b_beta"].startswith("beside")
    assert left.values["lambda_beta"] == left.values["b_beta"] == 0.0 and left.values["b_p"] == bound.values["b_p"]


def test_an_imu_that_is_late_stands_beside_the_air_data(made, calibration_flown):
    """With a file that says how late it is, specific force and rates are those of an IMU that is not."""
    samples, file = calibration_flown.samples, calibration_flown.aircraft
    late = samples.stamp + np.where(samples.kind == Kind.IMU, 50_000_000, 0)
    file = with_setting(file, ("sensors", "imu", "delay"), 0.05)
    order = np.argsort(late, kind="stable")
    found = compatibility_flight(replace(samples, stamp=late)[order], file, (5.0, 105.0))
    inside = slice(10, -10)  # of the borders of bins
    rate = np.column_stack([np.interp(made.data.time, found.data.time, column) for column in found.data.rate.T])
    np.testing.assert_allclose(rate[inside], made.data.rate[inside], atol=1e-6)
