"""What earlier flights say: it tells terms apart, vouches for nothing, and goes where this flight contradicts it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict, with_prior
from aircraft_sysid_ros.aircraft.fleet_prior import FleetPrior, read_prior
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.prior import AxisPrior, FleetKnowledge, contradiction, helped
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator

SECONDS = 16.0


@pytest.fixture
def regression():
    """Least squares of collinear terms with noise of 1: theta, covariance, and the moments of the data."""
    rng = np.random.default_rng(7)
    x = rng.normal(size=(40, 4))
    x[:, 1] = x[:, 0] + 0.05 * x[:, 1]
    y = x @ np.array([1.0, -2.0, 0.5, 3.0]) + rng.normal(size=40)
    return np.linalg.solve(x.T @ x, x.T @ y), np.linalg.inv(x.T @ x), (x, y)


def test_each_parameter_is_that_of_least_squares_with_the_others_measured_once_more(regression):
    """One more row for every other parameter that earlier flights know, and none for its own."""
    theta, covariance, (x, y) = regression
    mean, std = np.array([1.2, -2.1, 0.0, 2.8]), np.array([0.2, 0.3, np.inf, 0.4])
    found = helped(theta, covariance, AxisPrior(mean, 1.0 / std**2, "flights"))
    for j in range(4):
        others = [k for k in range(4) if k != j and np.isfinite(std[k])]
        rows = np.vstack([x, np.eye(4)[others] / std[others, None]])
        sides = np.concatenate([y, mean[others] / std[others]])
        inverse = np.linalg.inv(rows.T @ rows)
        assert found.theta[j] == pytest.approx((inverse @ rows.T @ sides)[j], rel=1e-6)
        assert found.covariance[j, j] == pytest.approx(inverse[j, j], rel=1e-6)
        assert found.gain[j] == pytest.approx(np.sqrt(covariance[j, j] / inverse[j, j]), rel=1e-6)
    assert np.all(np.linalg.eigvalsh(found.covariance) > 0.0) and found.gain[:2].min() > 3.0


def test_a_prior_never_vouches_for_its_own_parameter(regression):
    theta, covariance, _ = regression
    for value in (3.0, 3.3, 3.6):  # near enough not to contradict
        prior = AxisPrior(np.array([0.0, 0.0, 0.0, value]), np.array([0.0, 0.0, 0.0, 1e6]), "flights")
        assert helped(theta, covariance, prior).theta[3] == pytest.approx(theta[3])
        assert helped(theta, covariance, prior).covariance[3, 3] == pytest.approx(covariance[3, 3])


def test_what_this_flight_does_not_know_is_not_helped(regression):
    theta, covariance, _ = regression
    prior = AxisPrior(np.zeros(4), np.ones(4), "flights")
    assert helped(np.full(4, np.nan), covariance, prior) is None
    assert helped(theta, np.full((4, 4), np.nan), prior) is None
    assert helped(theta, covariance, prior._replace(dropped="contradicted")) is None
    assert helped(theta, covariance, None) is None


def test_what_contradicts_does_not_help_the_others_to_a_wrong_value(regression):
    """Half of an elevator: the pair is known to earlier flights, and the one that stays would pay for the other."""
    theta, covariance, _ = regression
    known = np.array([400.0, 400.0, 0.0, 0.0])
    assert helped(theta, covariance, AxisPrior(np.array([1.0, -2.0, 0.0, 0.0]), known, "flights")) is not None
    assert helped(theta, covariance, AxisPrior(np.array([1.0, -4.0, 0.0, 0.0]), known, "flights")) is None


def test_only_what_is_to_use_can_contradict():
    prior = AxisPrior(np.array([1.0, 2.0]), np.array([100.0, 0.0]), "9 flights of N1")
    value, std, used = np.array([1.6, -5.0]), np.array([0.02, 0.01]), np.array([True, True])
    said = contradiction(["Cl_p", "Cl_da"], value, std, used, prior)
    assert said == "Cl_p is 1.600 ± 0.020, and 9 flights of N1 say 1.00 ± 0.10"
    assert contradiction(["Cl_p", "Cl_da"], value, std, ~used, prior) == ""
    assert contradiction(["Cl_p", "Cl_da"], np.array([1.4, -5.0]), std, used, prior) == ""


def test_a_prior_is_dropped_for_good(aircraft):
    knowledge = FleetKnowledge(aircraft.model, FleetPrior("flights", {"Cm_de": (-0.8, 0.04)}))
    value, std = np.full(4, -0.4), np.full(4, 0.01)
    for found, dropped in (
        (THRESHOLDS.prior_looks - 1, False),
        (0, False),
        (THRESHOLDS.prior_looks - 1, False),
        (1, True),
    ):
        for _ in range(found):
            knowledge.look(4, value, std, np.full(4, True), 12.0)
        if not found:
            knowledge.look(4, value, std, np.full(4, False), 12.0)
        assert bool(knowledge.axes[4].dropped) == dropped
    assert knowledge.json == {"Cm": "dropped at 12.0 s: Cm_de is -0.400 ± 0.010, and flights say -0.800 ± 0.040"}
    assert knowledge.axes[0] is None


@pytest.fixture(scope="module")
def states(aircraft, flight):
    """The first seconds of the shared flight as the first step sees them."""
    samples = flight.samples[flight.samples.stamp < flight.samples.stamp.min() + int(SECONDS * 1e9)]
    estimator = StateEstimator(aircraft)
    rows = np.vstack([estimator.push(samples), estimator.flush()])
    return samples, rows, estimator.epoch


def with_values(aircraft, **wrong):
    """The aeroplane with its true coefficients as a prior, but for those that are given."""
    known = {**aircraft.coefficients, **wrong}
    parameters = {name: [value, 0.05 * abs(value) + 1e-6] for name, value in known.items()}
    return aircraft_from_dict({**aircraft.source, "prior": {"flights": "9 flights", "parameters": parameters}})


def identified(aircraft, states, block=1000):
    samples, rows, epoch = states
    identifier = Identifier(aircraft)
    identifier.push_samples(samples, epoch)
    for i in range(0, len(rows), block):
        identifier.push_states(rows[i : i + block], epoch)
    return identifier


def of_axis(found, axis):
    return [(p.value, p.std, p.status, p.reason) for p in found.parameters if p.name.startswith(axis)]


def test_more_is_known_sooner_and_the_estimators_are_those_without(aircraft, states):
    with_it, without = identified(with_values(aircraft), states), identified(aircraft, states)
    used = [sum(p.status == Trust.USE for p in i.snapshot().parameters) for i in (with_it, without)]
    assert used[0] >= used[1] + 2
    for a, b in zip(with_it.learning.least_squares.state, without.learning.least_squares.state, strict=True):
        assert np.array_equal(a, b, equal_nan=True)
    one_by_one = identified(with_values(aircraft), states, block=7)
    assert repr(one_by_one.snapshot().parameters) == repr(with_it.snapshot().parameters)


def test_an_axis_that_contradicts_it_is_as_it_would_be_without(aircraft, states):
    wrong = identified(with_values(aircraft, Cm_q=0.5 * aircraft.coefficients["Cm_q"]), states)
    without = identified(aircraft, states).snapshot()
    assert "Cm_q is " in wrong.learning.fleet.json["Cm"] and "9 flights say " in wrong.learning.fleet.notes()[-1]
    assert of_axis(wrong.snapshot(), "Cm") == of_axis(without, "Cm")
    assert of_axis(wrong.snapshot(), "Cn") != of_axis(without, "Cn")
    wrong.reset()
    assert wrong.learning.fleet.json["Cm"] == "counts"


def test_a_fault_that_the_watch_sees_takes_the_prior_of_all_axes_that_it_moves(aircraft, states):
    """C_Z, of whose elevator a flight says little, kept the prior of the sound one: C_Z,q was wrong, and to USE."""
    twice = {f"{axis}_de": 2.0 * aircraft.coefficients[f"{axis}_de"] for axis in ("CX", "CZ", "Cm")}
    wrong, without = identified(with_values(aircraft, **twice), states), identified(aircraft, states).snapshot()
    counts = wrong.learning.fleet.json
    assert {axis for axis, said in counts.items() if "the elevator has lost power" in said} == {"CX", "CZ", "Cm"}
    assert all(counts[axis] == "counts" for axis in ("CY", "Cl", "Cn"))
    for axis in ("CX", "CZ", "Cm"):
        assert of_axis(wrong.snapshot(), axis) == of_axis(without, axis)


def test_terms_that_are_other_ones_have_no_prior(aircraft):
    knowledge = FleetKnowledge(aircraft.model, FleetPrior("flights", {"Cm_de": (-0.8, 0.04), "Cn_r": (-0.2, 0.01)}))
    source = {**aircraft.source, "model": {"Cm": [1, "alpha", "q", "de", "alpha**2"]}}
    knowledge.adopt(aircraft_from_dict(source).model)
    assert [*knowledge.json] == ["Cn"]


FILE = {
    "airframes": {n: {"flights": f"of {n}", "parameters": {"Cm_de": [-0.8, 0.04]}} for n in ("N1", "N2")},
    "all": {"flights": "of all", "parameters": {"Cm_de": [-0.8, 0.1]}},
}


@pytest.mark.parametrize(
    ("airframe", "name", "said"),
    [("N1", "N2", "of N1"), (None, "N2", "of N2"), (None, "another", "of all"), ("N3", "N1", "'N3' is not one of its")],
)
def test_which_airframe_flies(airframe, name, said, aircraft, tmp_path):
    (tmp_path / "prior.json").write_text(json.dumps(FILE))
    try:
        found = with_prior(replace(aircraft, name=name), tmp_path, airframe).prior.flights
    except InputError as error:
        found = str(error)
    assert said in found


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "which `aircraft-sysid fleet` writes"), ("{", "is damaged"), ("[]", "is damaged"),
        (json.dumps({"airframes": {}, "all": None}), "name one with --airframe; it knows none"),
        (json.dumps({"airframes": {"N1": 3}, "all": None}), "is damaged|must be a mapping"),
        (json.dumps({"airframes": {"N1": {"flights": "x", "parameters": {"CZ_0": [1]}}}, "all": None}), "two numbers"),
        (json.dumps({"airframes": {"N1": {"flights": "x", "parameters": {"CZ_0": [1, 0]}}}, "all": None}), "positive"),
    ],
)  # fmt: skip
def test_a_prior_that_cannot_be_used_is_one_sentence(content, said, aircraft, tmp_path):
    if content is not None:
        (tmp_path / "prior.json").write_text(content)
    with pytest.raises(InputError, match=said):
        read_prior(tmp_path, None, aircraft.name)
    with pytest.raises(InputError, match="says which one of --prior"):
        with_prior(aircraft, None, "N1")
