"""One place for the misprints that docs/references.md lists: which test would fail for the printed form.

(2.16), (2.17): estimation/test_smoothing; (4.14): estimation/test_recursive_least_squares; (5.11):
estimation/test_maximum_likelihood and test_recursive_maximum_likelihood; (6.9), (6.11):
aircraft/test_aerodynamic_model; (6.16)-(6.18) in changing wind: flight_model/test_flight_dynamics. The rest is here.
"""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.estimation.kalman_filter import LinearSystem, filter_series
from aircraft_sysid_ros.estimation.maximum_likelihood import negative_log_likelihood
from aircraft_sysid_ros.simulation.dynamics import motion
from aircraft_sysid_ros.simulation.flight import prepare


def test_1_2_the_output_is_y_and_not_its_derivative():
    """A state at rest is seen where it is; were C x the derivative of y, it would be seen at 0 in a constant y."""
    system = LinearSystem(np.eye(1), np.eye(1), np.zeros((1, 1)), np.array([[1e-6]]))
    seen = filter_series(system, np.zeros(1), np.array([[1e6]]), np.full((5, 1), 5.0))
    assert seen.state[-1, 0] == pytest.approx(5.0, abs=1e-6)


@pytest.mark.long
def test_5_4_the_exponent_is_the_number_of_outputs():
    """The density integrates to 1 over two outputs, however many parameters there are."""
    covariance = np.array([[1.3, 0.4], [0.4, 0.7]])
    grid = np.linspace(-9.0, 9.0, 181)
    places = [np.array([[a, b]]) for a in grid for b in grid]
    density = [np.exp(-negative_log_likelihood(place, covariance[None], constant=True)) for place in places]
    assert np.sum(density) * (grid[1] - grid[0]) ** 2 == pytest.approx(1.0, abs=1e-6)


def test_6_14_x_holds_the_thrust(aircraft):
    """In level trim the x-force that C_X gives balances gravity: thrust is in C_X,Tc and is not added to X again."""
    setup = prepare(aircraft)
    acting = motion(setup.airframe, setup.place, setup.trim.state, np.zeros(3), 0.0)
    qbar = acting.signals[SIGNAL_INDEX["qbar"]]
    x_force = qbar * aircraft.wing_area * acting.coefficients[0]
    assert x_force == pytest.approx(aircraft.mass * setup.place.gravity * np.sin(setup.trim.alpha), rel=1e-4)
    assert acting.thrust > 0.05 * aircraft.mass * setup.place.gravity
