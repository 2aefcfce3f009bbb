"""Magnetometer: the model against (B1) of the two-stage paper, its derivatives, and the answer against the truth."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.earth_field import FieldAtPlace, earth_field
from aircraft_sysid_ros.aircraft.frames import quaternion_from_euler, rotation_matrix
from aircraft_sysid_ros.calibration import magnetometer
from aircraft_sysid_ros.calibration.magnetometer import MagneticData, MagneticFlight
from aircraft_sysid_ros.calibration.navigation import Grid, Navigation
from aircraft_sysid_ros.calibration.procedure import Task, residuals, solve
from aircraft_sysid_ros.calibration.report import calibrate_magnetometer
from aircraft_sysid_ros.calibration.segments import Segments
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


@pytest.mark.parametrize(
    ("latitude", "longitude", "values"),
    [(80.0, 0.0, (6521.6, 145.9, 54791.5)), (0.0, 120.0, (39677.8, -109.6, -10580.2)),
     (-80.0, 240.0, (6117.5, 15751.9, -52022.5))],
)  # fmt: skip
def test_the_field_is_that_of_the_world_magnetic_model(latitude, longitude, values):
    """Test values of NOAA for WMM2025, north, east and down [nT]; degrees beyond 6 are left out."""
    field = earth_field(np.radians(latitude), np.radians(longitude)).vector()
    assert np.linalg.norm(1e9 * field - values) < 0.03 * np.linalg.norm(values)


@pytest.mark.parametrize("latitude", [-90.0, 90.0])
def test_the_field_at_the_poles_of_the_earth_is_finite(latitude):
    at_pole, near = (earth_field(np.radians(degrees), 0.3) for degrees in (latitude, 0.9999 * latitude))
    np.testing.assert_allclose(at_pole.vector(), near.vector(), rtol=1e-2)


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


def flight_of(data, monkeypatch):
    """A flight whose magnetometer shows ``data``, for ``calibrate_magnetometer``."""
    n = len(data.measured)
    grid = Grid(np.arange(n), 1.0)
    flat, every = np.zeros((n, 3)), np.ones(n, dtype=bool)
    navigation = Navigation(0, grid.time, flat, data.rotation, flat, np.zeros(n), flat, np.zeros(3))
    made = MagneticFlight(data, grid, Segments(every, every, ()), navigation)
    monkeypatch.setattr(magnetometer, "magnetic_flight", lambda *_: made)


def turned_all_ways(rng, matrix, iron, unit=1.0):
    """What a magnetometer of (B1) shows in all attitudes, in a unit of so many strengths of the field."""
    rotation = np.array([rotation_matrix(quaternion_from_euler(*rng.uniform(-1.0, 1.0, 2), yaw))
                         for yaw in np.linspace(0.0, 12.6, 300)])  # fmt: skip
    field = FieldAtPlace(1.0, 1.1, 0.1)
    measured = np.einsum("nji,j->ni", rotation, field.vector()) @ np.asarray(matrix).T + iron
    return MagneticData(unit * (measured + rng.normal(0.0, 0.01, measured.shape)), rotation, field, True)


@pytest.mark.parametrize(("iron", "unit"), [([4.0, 0.0, 0.0], 1.0), ([0.1, 0.0, 0.0], 1e6)])
def test_what_is_beyond_the_bounds_is_no_calibration(aircraft, monkeypatch, iron, unit):
    """Iron of four field strengths, and microtesla that were taken for tesla: neither is written into a file."""
    flight_of(turned_all_ways(np.random.default_rng(5), np.eye(3), iron, unit), monkeypatch)
    with pytest.raises(InputError, match="--field-strength"):
        calibrate_magnetometer(None, aircraft, samples=16)


def test_a_note_lists_what_is_taken_as_it_should_be(aircraft, monkeypatch):
    """Nearly level: the vertical scale is not told, and what is found holds with the one that is taken."""
    rng = np.random.default_rng(6)
    data = turned_all_ways(rng, np.eye(3), [0.1, -0.1, 0.0])
    level = np.array([rotation_matrix(quaternion_from_euler(*rng.normal(0.0, 0.01, 2), yaw))
                      for yaw in np.linspace(0.0, 12.6, 300)])  # fmt: skip
    shown = np.einsum("nji,j->ni", level, data.field.vector()) + rng.normal(0.0, 0.02, (300, 3))
    flight_of(replace(data, measured=shown, rotation=level), monkeypatch)
    with pytest.raises(InputError, match="fly banked turns"):
        calibrate_magnetometer(None, aircraft, samples=1)
    report = calibrate_magnetometer(None, aircraft, samples=64)
    out = [p["name"] for p in report.parameters if not p["determined"]]
    (note,) = [note for note in report.notes if "hold if what this flight does not excite" in note]
    assert out and all(name in note for name in out)


def test_missing_topic(calibration_flown):
    samples = calibration_flown.samples
    with pytest.raises(InputError, match="needs /imu/mag"):
        magnetometer.magnetic_flight(samples[samples.kind != Kind.MAGNETIC_FIELD], calibration_flown.aircraft)
