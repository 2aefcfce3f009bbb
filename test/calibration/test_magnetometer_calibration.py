"""Magnetometer: the model against (B1) of the two-stage paper, its derivatives, and the answer against the truth."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.frames import quaternion_from_euler, rotation_matrix
from aircraft_sysid_ros.calibration import magnetometer
from aircraft_sysid_ros.calibration.magnetometer import FieldAtPlace, MagneticData, dipole_field
from aircraft_sysid_ros.calibration.procedure import Task, residuals, solve
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.samples import Kind

STRENGTH = float(np.hypot(1.7e-5, 5.1e-5))


@pytest.fixture
def data():
    """(B1) put together by hand at random attitudes, and the unknowns; declination unknown."""
    rng, n = np.random.default_rng(0), 30
    xi = np.array([0.1, -0.05, 0.08, 0.3, -0.2, 0.1, 0.03, -0.02, 0.05, 0.02, -0.04, 0.03, 1.1, 0.1])
    rotation = np.array([rotation_matrix(quaternion_from_euler(*rng.uniform(-1.0, 1.0, 3))) for _ in range(n)])
    field = np.array([np.cos(1.1) * np.cos(0.1), np.cos(1.1) * np.sin(0.1), np.sin(1.1)])
    soft = np.array([[1.0, 0.03, -0.02], [0.03, 1.0, 0.05], [-0.02, 0.05, 1.0]])
    turn = np.array([[1.0, -0.03, -0.04], [0.03, 1.0, -0.02], [0.04, 0.02, 1.0]])
    matrix = soft @ turn @ np.diag(1.0 + xi[:3])
    measured = np.einsum("nji,j->ni", rotation, field) @ matrix.T + xi[3:6]
    return MagneticData(measured, rotation, FieldAtPlace(1.0, 1.0, 0.0), False), xi


def test_the_model_is_b1(data):
    made, xi = data
    np.testing.assert_allclose(residuals(made.problem(), xi), 0.0, atol=1e-12)
    made.problem().check_gradient(xi[6:])


def test_derivative_by_the_attitude(data):
    made, xi = data
    step = 1e-6
    for axis in range(3):
        turn = rotation_matrix(np.array([1.0, *(0.5 * step * np.eye(3)[axis])]))
        moved = MagneticData(made.measured, made.rotation @ turn, made.field, False)
        change = -residuals(moved.problem(), xi) / step
        np.testing.assert_allclose(made.by_attitude(xi)[:, :, axis], change, atol=1e-4)


def test_the_dipole_is_near_the_field():
    """Minneapolis and Sydney, from the International Geomagnetic Reference Field of 2020."""
    for latitude, longitude, strength, inclination in ((44.98, -93.27, 54.5e-6, 71.0), (-33.87, 151.2, 57.1e-6, -64.3)):
        field = dipole_field(np.radians(latitude), np.radians(longitude))
        assert abs(field.strength / strength - 1.0) < 0.25
        assert abs(np.degrees(field.inclination) - inclination) < 12.0


@pytest.mark.long
def test_all_parameters_are_found(calibration_flown):
    made = magnetometer.magnetic_flight(calibration_flown.samples, calibration_flown.aircraft, strength=STRENGTH)
    answer = solve(made.task(), 64)
    truth = {**calibration_flown.calibration["magnetometer"], "inclination": np.arctan2(5.1, 1.7)}
    errors = np.array([answer.values[name] - truth[name] for name in answer.problem.names])
    assert answer.determined.all()
    assert np.all(np.abs(errors) < 4.0 * answer.std)
    assert np.all(np.abs(errors[3:6]) < 0.01 * STRENGTH) and np.all(np.abs(np.delete(errors, [3, 4, 5])) < 0.01)


@pytest.mark.long
def test_level_turns_do_not_tell_everything():
    """Wings level at every heading: vertical scale and vertical hard iron are one number."""
    rng, n = np.random.default_rng(2), 400
    rotation = np.array([rotation_matrix(quaternion_from_euler(*rng.normal(0.0, 0.01, 2), yaw))
                         for yaw in np.linspace(0.0, 6.3, n)])  # fmt: skip
    field = FieldAtPlace(1.0, 1.2, 0.0)
    measured = np.einsum("nji,j->ni", rotation, field.vector()) + [0.1, -0.2, 0.3] + rng.normal(0.0, 0.02, (n, 3))
    made = MagneticData(measured, rotation, field, True)
    nominal = np.concatenate([np.zeros(6), made.nominal2])
    answer = solve(Task(made.problem(), np.zeros(n, dtype=np.int64), nominal), 64)
    told = dict(zip(answer.problem.names, answer.determined, strict=True))
    assert told["n_x"] and told["n_y"] and not (told["n_z"] and told["lambda_z"] and told["inclination"])
    rows = answer.parameters(answer.problem.names, magnetometer.UNITS, magnetometer.EXCITED_BY)
    assert all("not excited" in row["reason"] and np.isinf(row["std"]) for row in rows if not row["determined"])


def test_missing_topic(calibration_flown):
    samples = calibration_flown.samples
    with pytest.raises(InputError, match="needs /imu/mag"):
        magnetometer.magnetic_flight(samples[samples.kind != Kind.MAGNETIC_FIELD], calibration_flown.aircraft)
