"""Calibration files and what they do to samples: the inverse of what the simulator does, one sample or many."""

import numpy as np
import pytest
import yaml

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion, quaternion_from_euler
from aircraft_sysid_ros.calibration import compatibility, magnetometer
from aircraft_sysid_ros.calibration.calibration_file import calibration_from_dict, load_calibration
from aircraft_sysid_ros.calibration.correction import Correction
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.reconstruction.filter_setup import stamp_delays
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of
from aircraft_sysid_ros.sensors.sensor_models import EPOCH, air_data_at

FIELD = dict.fromkeys((*magnetometer.NAMES1, *magnetometer.NAMES2), 0.0)
PROBE = {
    "alpha_sensitivity": 3.9, "beta_sensitivity": 3.9, "lambda_V": 0.1, "b_V": -2.0, "lambda_alpha": 0.0,
    "b_alpha": 0.03, "lambda_beta": 0.0, "b_beta": 0.0, "eps_phi": 0.0,
}  # fmt: skip


def content_of(flight):
    """A calibration file that knows the truth."""
    truth = flight.calibration
    return {
        "five_hole_probe": {"alpha_sensitivity": 3.9, "beta_sensitivity": 3.9, **truth["five_hole_probe"]},
        "magnetometer": truth["magnetometer"],
    }


@pytest.mark.long
def test_true_calibration_gives_the_true_flow(calibration_flown):
    samples = calibration_flown.samples
    corrected = Correction(calibration_from_dict(content_of(calibration_flown))).apply(samples)
    place = calibration_flown.aircraft.air_data_position
    for column, kind, most in ((0, Kind.AIRSPEED, 0.5), (1, Kind.ANGLE_OF_ATTACK, 0.03), (2, Kind.SIDESLIP, 0.03)):
        mine = corrected[corrected.kind == kind]
        true = air_data_at(calibration_flown.truth.at((mine.stamp - EPOCH) * 1e-9), place)[:, column]
        error = mine.values[:, 0] - true
        assert np.sqrt(np.mean(error**2)) < most and abs(np.mean(error)) < 0.05 * most
    assert not np.any(corrected.kind == Kind.FIVE_HOLE)
    field = corrected.values[corrected.kind == Kind.MAGNETIC_FIELD, :3]
    spread = np.linalg.norm(field, axis=1)
    assert np.std(spread) / np.mean(spread) < 0.02


@pytest.mark.long
def test_compatibility_takes_out_what_was_put_in(calibration_flown):
    truth = calibration_flown.calibration["compatibility"]
    biases = np.concatenate([calibration_flown.biases.accelerometer[0], calibration_flown.biases.gyro[0]])
    section = {**truth, **dict(zip(("b_ax", "b_ay", "b_az", "b_p", "b_q", "b_r"), map(float, biases), strict=True))}
    samples = calibration_flown.samples
    corrected = Correction(calibration_from_dict({"compatibility": section})).apply(samples)
    seen = calibration_flown.truth.at((samples.stamp - EPOCH) * 1e-9)
    imu = samples.kind == Kind.IMU
    np.testing.assert_allclose(np.mean(corrected.values[imu, 3:6] - seen.rates[imu], axis=0), 0.0, atol=2e-4)
    angles = samples.kind == Kind.ATTITUDE
    along = np.abs(np.sum(corrected.values[angles, :4] * seen.quaternion[angles], axis=1))
    assert np.median(2.0 * np.arccos(np.minimum(along, 1.0))) < 0.03


def test_what_comes_of_the_probe_is_as_late_as_the_probe(aircraft):
    """It had the delay that the aircraft file states for the vanes and the pitot whose place it takes."""
    delays = {
        "five_hole_probe": 0.1,
        "airspeed": 0.25,
        "angle_of_attack": 0.05,
        "sideslip": 0.0,
        "static_pressure": 0.02,
    }
    sensors = {name: {"delay": delay} for name, delay in delays.items()}
    file = aircraft_from_dict({**aircraft.source, "sensors": sensors})
    stamps = np.arange(5) * 20_000_000 + 10**9
    pressures = samples_of(Kind.FIVE_HOLE, stamps, np.tile([1e5, 250.0, 20.0, 10.0], (5, 1)))
    found = Correction(calibration_from_dict({"five_hole_probe": PROBE}), file).apply(pressures)
    measured = found.stamp - stamp_delays(file)[found.kind]
    assert len(found) == 4 * len(stamps)
    np.testing.assert_array_equal(measured.reshape(-1, 4), np.tile(stamps[:, None] - 100_000_000, 4))


@pytest.mark.parametrize("scale", [0.1, -0.1])
@pytest.mark.parametrize("angle", ["phi", "psi"])
def test_an_angle_that_goes_round_is_right_or_nothing(angle, scale):
    """Of a compass that turns a tenth too far 173 deg to the left may be 157 to the left, or 170 to the right."""
    section = {**dict.fromkeys((*compatibility.NAMES1, *compatibility.NAMES2), 0.0), f"lambda_{angle}": scale}
    true, column = np.radians(np.arange(-179.0, 180.0, 7.0)), {"phi": 0, "psi": 2}[angle]
    angles = np.tile([0.0, 0.1, 0.0], (len(true), 1))
    angles[:, column] = (1.0 + scale) * true
    samples = samples_of(Kind.ATTITUDE, np.arange(len(true)), np.array([quaternion_from_euler(*row) for row in angles]))
    found = Correction(calibration_from_dict({"compatibility": section})).apply(samples).values[:, :4]
    known = np.isfinite(found).all(axis=1)
    shown = np.array([euler_from_quaternion(q)[column] for q in found[known]])
    np.testing.assert_allclose(shown, true[known], atol=1e-9)
    assert known[np.abs(true) < np.radians(145.0)].all() and (known.all() or scale > 0.0)


def test_one_by_one_gives_the_same_bits(calibration_flown):
    """A live node has one sample at a time."""
    outputs = {**dict.fromkeys(compatibility.NAMES2, 0.0), **calibration_flown.calibration["compatibility"]}
    content = {**content_of(calibration_flown), "compatibility": outputs}
    correction = Correction(calibration_from_dict(content))
    some = calibration_flown.samples[5000:6500]
    together = correction.apply(some)
    single = concatenate([correction.apply(some[i : i + 1]) for i in range(len(some))])
    np.testing.assert_array_equal(single.stamp, together.stamp)
    np.testing.assert_array_equal(single.kind, together.kind)
    np.testing.assert_array_equal(single.values, together.values)


def test_no_flow_gives_no_angles(calibration_flown):
    correction = Correction(calibration_from_dict(content_of(calibration_flown)))
    pressures = calibration_flown.samples[calibration_flown.samples.kind == Kind.FIVE_HOLE][:3]
    pressures.values[0, 1], pressures.values[1, 0], pressures.values[2, 2] = -4.0, np.nan, 1e5
    kinds = correction.apply(pressures).kind.tolist()
    assert kinds == [Kind.AIR, Kind.AIRSPEED, Kind.AIR, Kind.AIR, Kind.AIRSPEED]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[1, 2]", "mapping with one of"),
        ("magnetometer: {lamda_x: 0.1}", "did you mean 'lambda_x'"),
        ("magnetometer: {lambda_x: .nan}", "lambda_x must be a finite number"),
        ("magnetometer: {lambda_x: yes}", "lambda_x must be a finite number"),
        ("magnetometer: 3", "must be a mapping"),
        ("compatibility: {lambda_V: -1.2}", "more than -0.9"),
        ("compatibility: {lambda_V: 50}", "at most 9, not 50"),
        ("compatibility: {b_alpha: 60}", "within 1 rad"),
        ("five_hole_probe: {lambda_V: 0.1}", "needs alpha_sensitivity"),
        ("five_hole_probe: {alpha_sensitivity: -1, beta_sensitivity: 3}", "must be positive"),
        ("five_hole_probe: {alpha_sensitivity: 3, beta_sensitivity: 3, pressure_zeros: 1}", "three numbers"),
        (yaml.safe_dump({"magnetometer": {**FIELD, "alpha_xy": 1.0}}), "cannot be corrected"),
        (yaml.safe_dump({"magnetometer": FIELD}).replace("n_y", "n_q"), "did you mean 'n_"),
        ("magnetometer: {n_x: 0, n_y: 0, n_z: 0, lambda_x: 0}", "lacks lambda_y and lambda_z and alpha_xy"),
        ("compatibility: {lambda_V: 0.1}", "compatibility lacks lambda_alpha and"),
        (yaml.safe_dump({"five_hole_probe": {**PROBE, "kappa_alpha": 0.1}}), "five_hole_probe lacks kappa_beta:"),
        ("five_hole_probe: {alpha_sensitivity: 3, beta_sensitivity: 3, lambda_V: 0.1}", "lacks b_V and lambda_alpha"),
        ("probe: {}", "mapping with one of"),
        ("{magnetometer: {}, probe: {}}", "unknown section 'probe'"),
        ("magnetometer:\n  n_x: 1\n n_y: [", "not valid YAML at line 3"),
        ("magnetometer:\n  n_x: 1\n  n_x: 2\n", "the key 'n_x' is there twice, at lines 2 and 3: remove one"),
    ],
)
def test_bad_files_are_one_sentence(tmp_path, content, message):
    path = tmp_path / "calibration.yaml"
    path.write_text(content)
    with pytest.raises(InputError, match=r"calibration file .*calibration.yaml") as error:
        load_calibration(path)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_a_missing_file(tmp_path):
    with pytest.raises(InputError, match="cannot read the calibration file"):
        load_calibration(tmp_path / "none.yaml")


def test_a_section_without_parameters_is_a_nominal_sensor(tmp_path):
    path = tmp_path / "calibration.yaml"
    content = {"magnetometer": {"std": {"n_x": None}}, "source": {"recording": "a"}}
    path.write_text(yaml.safe_dump(content))
    calibration = load_calibration(path)
    assert calibration.magnetometer["lambda_x"] == 0.0 and not calibration.five_hole_probe


def test_a_curve_that_is_straight_may_be_left_out():
    probe = calibration_from_dict({"five_hole_probe": PROBE}).five_hole_probe
    assert probe["kappa_alpha"] == probe["kappa_beta"] == 0.0 and probe["b_V"] == PROBE["b_V"]
