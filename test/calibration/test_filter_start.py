"""What the filter may start with: calibrations, and stage 1 on a part of the flight."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.calibration import compatibility
from aircraft_sysid_ros.calibration.calibration_file import AIR_DATA_ERRORS, calibration_from_dict
from aircraft_sysid_ros.calibration.filter_start import _batch, start_by_stage_1, start_of_calibration
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.reconstruction.air_data_errors import UNKNOWN_STD
from aircraft_sysid_ros.samples import Kind

PROBE = {"alpha_sensitivity": 3.9, "beta_sensitivity": 3.9, "lambda_V": 0.2, "b_V": -2.0, "lambda_alpha": -0.1,
         "b_alpha": 0.03, "lambda_beta": 0.0, "b_beta": 0.0, "eps_phi": 0.0}  # fmt: skip


def left(raw, true, believed):
    """lambda and b that are left when a sensor with true (lambda, b) is corrected with others, from two readings."""
    shown, really = ((1.0 + np.array(pair)[0]) * raw + np.array(pair)[1] for pair in (believed, true))
    slope = (really[1] - really[0]) / (shown[1] - shown[0])
    return np.array([slope - 1.0, really[0] - slope * shown[0]])


def test_what_a_probe_calibration_leaves():
    """Covariance of what is left, from readings of sensors drawn from the covariance of the calibration."""
    rng = np.random.default_rng(0)
    small = np.array([[4e-6, -6e-5], [-6e-5, 1.6e-3]])
    covariance = np.zeros((6, 6))
    covariance[:2, :2], covariance[2:, 2:] = small, 1e-6 * np.eye(4)
    section = {**PROBE, "covariance": covariance.tolist()}
    start = start_of_calibration(calibration_from_dict({"five_hole_probe": section}))
    drawn = rng.multivariate_normal([0.2, -2.0], small, 4000)
    found = np.array([left(np.array([10.0, 30.0]), pair, (0.2, -2.0)) for pair in drawn])
    np.testing.assert_allclose(start.covariance[3:5, 3:5], np.cov(found.T), rtol=0.1)
    assert np.all(start.wind == 0.0) and np.all(start.errors == 0.0)
    np.testing.assert_allclose(start.wind_std, [6.0, 6.0, 1.0])


def test_standard_errors_stand_for_a_covariance_and_what_is_not_told_is_unknown():
    section = {**PROBE, "lambda_V": 0.0, "b_V": 0.0, "std": {"lambda_V": 0.01, "b_V": 0.2, "lambda_beta": None}}
    std = np.sqrt(np.diag(start_of_calibration(calibration_from_dict({"five_hole_probe": section})).covariance)[3:])
    np.testing.assert_allclose(std[:2], [0.01, 0.2])
    assert std[4] == pytest.approx(UNKNOWN_STD[4])


def test_compatibility_turns_round():
    """y = (1 + lambda) true + b: a lambda known to 0.01 leaves a scale known to 0.01 / (1 + lambda)."""
    zero = dict.fromkeys((*compatibility.NAMES1, *compatibility.NAMES2), 0.0)
    section = {**zero, "lambda_V": 0.25, "std": {name: 0.01 for name in AIR_DATA_ERRORS}}
    std = np.sqrt(np.diag(start_of_calibration(calibration_from_dict({"compatibility": section})).covariance)[3:])
    np.testing.assert_allclose(std, [0.008, 0.008, 0.01, 0.01, 0.01, 0.01])
    nothing = start_of_calibration(calibration_from_dict({"magnetometer": {}}))
    np.testing.assert_allclose(np.sqrt(np.diag(nothing.covariance)[3:]), UNKNOWN_STD)


@pytest.mark.parametrize(
    ("covariance", "message"),
    [([[1.0]], "6 rows of 6"), (np.diag([1.0, 1, 1, 1, 1, -1]).tolist(), "symmetric and positive"),
     ([["a"] * 6] * 6, "finite number")],
)  # fmt: skip
def test_a_covariance_that_is_none(covariance, message):
    with pytest.raises(InputError, match=message):
        calibration_from_dict({"five_hole_probe": {**PROBE, "covariance": covariance}})
    with pytest.raises(InputError, match="must not be negative"):
        calibration_from_dict({"five_hole_probe": {**PROBE, "std": {"b_V": -1.0}}})


@pytest.mark.long
def test_stage_1_finds_wind_and_errors(calibration_flown):
    """Outputs with errors, (B6) of the two-stage paper, in a wind of (4, -5, 0.3): the first minute has two circles."""
    start, end = start_by_stage_1(calibration_flown.samples, calibration_flown.aircraft, 60.0)
    errors = calibration_flown.calibration["compatibility"]
    truth = [4.0, -5.0, 0.3]
    for name in ("V", "alpha", "beta"):
        scale = 1.0 + errors[f"lambda_{name}"]
        truth += [1.0 / scale - 1.0, -errors[f"b_{name}"] / scale]
    z = (np.concatenate([start.wind, start.errors]) - truth) / np.sqrt(np.diag(start.covariance))
    assert np.all(np.abs(z) < 4.0), z
    assert np.linalg.norm(start.wind[:2] - truth[:2]) < 1.0 and start.wind_std[0] < 1.5
    begin = calibration_flown.samples.stamp.min()
    assert 59.0 < (end - begin) * 1e-9 < 75.0
    assert np.linalg.eigvalsh(start.covariance)[0] > 0.0


def test_parts_that_cannot_tell(calibration_flown):
    samples, aircraft = calibration_flown.samples, calibration_flown.aircraft
    with pytest.raises(InputError, match="stage 1 needs 30 s"):
        start_by_stage_1(samples, aircraft, 20.0)
    with pytest.raises(InputError, match="never flies"):
        start_by_stage_1(samples, _fast(aircraft), 60.0)
    with pytest.raises(InputError, match="angles of attack"):
        start_by_stage_1(samples[samples.kind != Kind.ANGLE_OF_ATTACK], aircraft, 60.0)


def _fast(aircraft):
    """An aeroplane that stands at the speeds of the flight."""
    from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict

    return aircraft_from_dict({**aircraft.source, "minimum_airspeed": 90.0})


def test_stage_1_begins_with_what_the_file_leaves_of_the_errors(calibration_flown):
    """An offset and a drift that the aircraft file states are no error that is left to find."""
    flown, file = calibration_flown, calibration_flown.aircraft
    samples, values = flown.samples, flown.samples.values.copy()
    right = _batch(samples, file)[0]
    vane, speed = samples.kind == Kind.ANGLE_OF_ATTACK, samples.kind == Kind.AIRSPEED
    values[vane, 0] = 0.9 * (values[vane, 0] + 0.02)
    values[speed, 0] *= 1.1
    stated = {("angle_of_attack", "scale"): 0.9, ("angle_of_attack", "offset"): 0.02, ("airspeed", "scale"): 1.1}
    for key, value in stated.items():
        file = with_setting(file, ("sensors", *key), value)
    found = _batch(replace(samples, values=values), file)[0]
    for name in ("alpha_ratio", "indicated"):
        np.testing.assert_allclose(getattr(found, name), getattr(right, name), rtol=1e-9, atol=1e-12)
