"""Terms with a memory in the second step: the same in batches of any size, and learnt, in flight and when they come."""

import numpy as np
import pytest
from test_parameter_estimator import learn, perfect_inputs

from aircraft_sysid_ros.aircraft.signals import FIRST_LAG
from aircraft_sysid_ros.aircraft.term_values import with_lags
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.flight_memory import SampleMemory
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.model_change import change_model, with_terms
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

LAGGED = "lag(alpha,0.3)"


@pytest.fixture(scope="module")
def lagging(aircraft):
    """A flight whose pitching moment follows the angle of attack late."""
    return simulate_samples(aircraft, 3, 60.0, effects=[Effect("Cm", LAGGED, -0.4)])


@pytest.fixture(scope="module")
def inputs(lagging):
    return perfect_inputs(lagging)


def user(lagging):
    return with_terms(lagging.aircraft, {"Cm": (LAGGED,)}, {})


@pytest.mark.long
def test_it_is_learnt_from_perfect_states(lagging, inputs):
    found = {p.name: p.value for p in learn(user(lagging), *inputs, None)[0].snapshot().parameters}
    assert found[f"Cm_{LAGGED}"] == pytest.approx(-0.4, rel=0.05)
    assert found["Cm_alpha"] == pytest.approx(lagging.aircraft.coefficients["Cm_alpha"], rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize("estimator", ["rls", pytest.param("fourier", marks=pytest.mark.long)])
def test_batches_of_any_size_give_the_same_numbers(lagging, inputs, estimator):
    rows, controls = inputs[0][:2500], inputs[1]
    results = [
        learn(user(lagging), rows, controls, ParameterOptions(estimator=estimator), block=block) for block in (7, 1000)
    ]
    (one, points), (other, same) = results
    assert [p.value for p in one.snapshot().parameters] == [p.value for p in other.snapshot().parameters]
    np.testing.assert_array_equal(points, same)


def test_after_a_gap_it_begins_anew(lagging, inputs):
    """In the steady state, as at the beginning of a flight; a point has the lag that its averaged signals say."""
    rows, controls = inputs[0], inputs[1]
    gap = (rows[:, 0] > 20.0) & (rows[:, 0] < 23.0)
    _, points = learn(user(lagging), rows[~gap], controls, None)
    signals, time = points[:, CoefficientSample.SIGNALS], points[:, CoefficientSample.TIME]
    _, alone = learn(user(lagging), rows[rows[:, 0] >= 23.0], controls, None)
    np.testing.assert_array_equal(signals[time > 22.0, FIRST_LAG], alone[:, CoefficientSample.SIGNALS][:, FIRST_LAG])
    again = with_lags(user(lagging).model.lags, time, signals, 0.06)[:, FIRST_LAG]
    settled = (time < 20.0) | (time > 25.0)
    np.testing.assert_allclose(again[settled], signals[settled, FIRST_LAG], atol=1e-3)


def test_a_model_that_gets_it_in_flight_learns_it_from_the_past(lagging, inputs):
    """Its lag begins at the oldest point that is remembered, and goes on with the flight."""
    rows, controls = inputs
    half = int(np.searchsorted(rows[:, 0], 40.0))
    estimator, points = learn(lagging.aircraft, rows[:half], controls, None)
    memory = SampleMemory()
    memory.add(points, np.full(3, 1e-3), 0.05)
    change_model(estimator, user(lagging), memory.newest())
    first = {p.name: p.value for p in estimator.snapshot().parameters}
    estimator.push_states(rows[half:])
    found = {p.name: p.value for p in estimator.snapshot().parameters}
    assert first[f"Cm_{LAGGED}"] == pytest.approx(-0.4, rel=0.15)
    assert found[f"Cm_{LAGGED}"] == pytest.approx(-0.4, rel=0.1)


def test_maximum_likelihood_refuses_it_in_one_sentence(lagging):
    with pytest.raises(InputError, match="stay with least squares"):
        Identifier(user(lagging), ParameterOptions(estimator="rml"))


def test_a_lag_in_one_axis_changes_nothing_of_an_undefined_term_in_another(lagging):
    """The root of an angle that is negative says nothing, and its axis learns on: with a lag in C_Z as without."""
    rows, controls = perfect_inputs(lagging)
    root = {"Cm": ("sqrt(alpha-0.03)",)}
    plain, late = (
        learn(with_terms(lagging.aircraft, terms, {}), rows[:3000], controls)[0]
        for terms in (root, {**root, "CZ": (LAGGED,)})
    )
    axis = 4
    assert plain.learning.least_squares.state.updates[axis] > 100
    np.testing.assert_array_equal(
        late.learning.least_squares.state.updates[axis], plain.learning.least_squares.state.updates[axis]
    )
