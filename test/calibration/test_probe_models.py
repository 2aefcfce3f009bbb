"""Richer models of the probe: equations by hand, and which model a flight is said to support."""

from dataclasses import replace

import numpy as np
import pytest
from test_five_hole_calibration import data  # noqa: F401

from aircraft_sysid_ros.aircraft.frames import rotation_matrix
from aircraft_sysid_ros.calibration.five_hole_probe import probe_flight
from aircraft_sysid_ros.calibration.probe_models import CURVE, ProbeModel, solve_probe, unbent
from aircraft_sysid_ros.calibration.procedure import residuals
from aircraft_sysid_ros.estimation.least_squares import central_differences
from aircraft_sysid_ros.sensors.five_hole_probe import bent
from aircraft_sysid_ros.sensors.sensor_models import EPOCH
from aircraft_sysid_ros.simulation.calibration_flight import calibration_flight, drawn_errors

KAPPA = (1.1, 2.0)


@pytest.fixture
def rich(data):  # noqa: F811
    """The data with a bent curve in a wind that changes at two knots, and the unknowns."""
    made, xi = data
    time = np.linspace(0.0, 100.0, len(made.indicated))
    knots = np.array([0.0, 40.0, 100.0])
    winds = np.array([[4.0, -3.0, 0.5], [5.0, -1.0, 0.2], [3.0, -2.0, 0.0]])
    moved = np.stack([np.interp(time, knots, column) for column in winds.T], axis=1)
    changed = replace(
        made, velocity=made.velocity - xi[2:5] + moved,
        alpha_ratio=bent(made.alpha_ratio, KAPPA[0]), beta_ratio=bent(made.beta_ratio, KAPPA[1]),
    )  # fmt: skip
    return ProbeModel(changed, time, True, knots), np.concatenate([xi[:2], winds.ravel(), xi[5:], KAPPA])


def test_no_residual_at_the_truth(rich):
    model, xi = rich
    np.testing.assert_allclose(residuals(model.problem(), xi), 0.0, atol=1e-9)
    assert model.problem().names[-2:] == CURVE and model.problem().names[2] == "W_N_0"
    assert set(model.problem().names) <= set(model.excited_by()) and model.units()["W_E_2"] == "m/s"


def test_derivatives_are_derivatives(rich):
    model, xi = rich
    model.problem().check_gradient(xi[11:])
    whole = lambda at: np.einsum("nij,j->ni", model.model(at[11:])[0], at[:11]) + model.model(at[11:])[1]  # noqa: E731
    np.testing.assert_allclose(model.instruments(xi), central_differences(whole, xi), atol=1e-6)
    step = 1e-6
    turn = rotation_matrix(np.array([1.0, *(0.5 * step * np.eye(3)[1])]))
    moved = replace(model, data=replace(model.data, rotation=model.data.rotation @ turn))
    change = (residuals(model.problem(), xi) - residuals(moved.problem(), xi)) / step
    np.testing.assert_allclose(model.by_attitude(xi)[:, :, 1], change, atol=1e-3)


def test_without_either_it_is_the_paper_s(data):  # noqa: F811
    made, xi = data
    plain = ProbeModel(made, np.zeros(len(made.indicated)), False, None)
    assert plain.words == "linear curve, steady wind"
    for mine, theirs in zip(plain.model(xi[5:]), made.model(xi[5:]), strict=True):
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_allclose(plain.instruments(xi), made.instruments(xi), atol=1e-12)


@pytest.mark.parametrize("kappa", [-2.0, 0.0, 1.1, 4.0])
def test_unbent_turns_the_curve_round(kappa):
    r = np.linspace(-0.35, 0.35, 41)
    np.testing.assert_allclose(unbent(r + kappa * r**3, kappa), r, atol=1e-9)
    np.testing.assert_allclose(bent(r + max(kappa, 0.0) * r**3, max(kappa, 0.0)), r, atol=1e-12)
    assert np.all(np.isfinite(unbent(np.array([-5.0, 5.0]), kappa)))


@pytest.mark.long
def test_a_steady_flight_with_a_straight_curve_supports_the_paper_s(probe_made, probe_answer):
    found = solve_probe(probe_made, 64)
    assert found.model.words == "linear curve, steady wind"
    np.testing.assert_array_equal(found.answer.xi, probe_answer[0].xi)
    told = found.told()
    assert len(told) == 3 and [model["used"] for model in told] == [True, False, False]
    forced = solve_probe(probe_made, 32, curve="cubic", wind="steady")
    assert forced.model.words == "cubic curve, steady wind" and len(forced.told()) == 1
    at = [forced.answer.problem.names.index(name) for name in CURVE]
    assert np.all(np.abs(forced.answer.xi[at]) < 4.0 * forced.answer.std[at])  # there is none


@pytest.mark.long
def test_a_bent_curve_is_noticed_and_found(calibration_aircraft):
    """The answer covers the truth, from which the paper's model is far off."""
    errors = drawn_errors(11)
    errors = replace(errors, probe=replace(errors.probe, alpha_cubic=3.0, beta_cubic=3.0))
    flight = calibration_flight(11, aircraft=calibration_aircraft, errors=errors)
    found = solve_probe(probe_flight(flight.samples, flight.aircraft), 48)
    assert found.model.words == "cubic curve, steady wind"
    truth = flight.calibration["five_hole_probe"]
    for name in ("kappa_alpha", "lambda_alpha", "lambda_V"):
        at = found.answer.problem.names.index(name)
        assert abs(found.answer.xi[at] - truth[name]) < 5.0 * found.answer.std[at], name
    assert abs(found.answer.values["lambda_alpha"] - truth["lambda_alpha"]) < 0.5 * abs(
        found.paper.values["lambda_alpha"] - truth["lambda_alpha"]
    )
    assert found.answer.samples.xi2.shape == (48, int(found.answer.determined[found.answer.problem.n1 :].sum()))
    assert np.all(found.answer.samples.xi2[:, -1] == 0.0)  # stage 1 had straight curves


@pytest.mark.long
def test_a_wind_that_changes_is_noticed_and_followed(calibration_aircraft):
    flight = calibration_flight(12, 150.0, aircraft=calibration_aircraft, wind_walk=0.1)
    made = probe_flight(flight.samples, flight.aircraft)
    found = solve_probe(made, 24)
    assert found.model.words == "linear curve, varying wind"
    truth = flight.truth.at(made.navigation.time + (made.navigation.epoch - EPOCH) * 1e-9).wind
    of = lambda model, answer: model.wind(answer.xi[: answer.problem.n1]) - truth  # noqa: E731
    steady = ProbeModel(made.data, made.grid.time, False, None)
    rms = [np.sqrt(np.mean(of(*pair)[:, :2] ** 2)) for pair in ((found.model, found.answer), (steady, found.paper))]
    assert rms[0] < 0.7 * rms[1]
