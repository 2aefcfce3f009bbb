"""The flight model against the simulator, which shares no code with it, and its Jacobians against differences."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import model_from_terms
from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.aircraft.frames import quaternion_conjugate, quaternion_log, quaternion_product, rotation_matrix
from aircraft_sysid_ros.aircraft.postfix import evaluate_programs
from aircraft_sysid_ros.aircraft.signals import SIGNALS
from aircraft_sysid_ros.aircraft.term_values import link
from aircraft_sysid_ros.flight_model.derivatives import aerodynamics, error_dynamics, transition
from aircraft_sysid_ros.flight_model.dynamics import derivative, move, propagate_mean
from aircraft_sysid_ros.flight_model.filter import model_outputs
from aircraft_sysid_ros.flight_model.layout import ERROR_SIZE, flight_model_of, make_theta
from aircraft_sysid_ros.flight_model.outputs import output_jacobian
from aircraft_sysid_ros.flight_model.term_gradients import terms_and_gradients

STEPS = np.array([1e-3] * 3 + [1e-2] * 3 + [1e-4] * 3 + [1e-4] * 3 + [1e-3] * 3)


def difference(x1, x0):
    """Error (15,) between two states."""
    turn = quaternion_log(quaternion_product(quaternion_conjugate(x0[6:10]), x1[6:10]))
    return np.concatenate([x1[0:6] - x0[0:6], turn, x1[10:16] - x0[10:16]])


def moved(x, j, step):
    error, out = np.zeros(ERROR_SIZE), x.copy()
    error[j] = step
    move(out, error)
    return out


def jacobian_by_differences(function, x, rows):
    columns = [
        (function(moved(x, j, STEPS[j])) - function(moved(x, j, -STEPS[j]))) / (2.0 * STEPS[j])
        for j in range(ERROR_SIZE)
    ]
    out = np.stack(columns, axis=1)
    assert out.shape == (rows, ERROR_SIZE)
    return out


def test_the_model_reproduces_the_simulator(record):
    """Outputs at true states are true, and so is the motion over a step of 0.02 s (gusts: none)."""
    got, ahead, predicted = np.empty(18), [], []
    for k in range(0, len(record.time) - 1, 25):
        model_outputs(record.states[k], record.inputs[k], record.theta, record.model, got)
        np.testing.assert_allclose(got, record.outputs[k], atol=1e-7)
        x = record.states[k].copy()
        propagate_mean(x, record.inputs[k], record.inputs[k + 1], 0.02, record.theta, record.model)
        ahead.append(difference(x, record.states[k + 1]))
        predicted.append(difference(record.states[k + 1], record.states[k]))
    # what is left is the actuators between the ends of a step
    assert np.all(np.std(ahead, axis=0)[:12] < 0.02 * np.std(predicted, axis=0)[:12])


def test_the_velocity_over_ground_as_state_is_right_in_any_wind(aircraft, record):
    """(6.16)-(6.18) as printed for air-relative u, v, w would move the aeroplane along with a change of the wind."""
    x = record.states[100].copy()
    out, gusty = np.empty(16), np.empty(16)
    derivative(x, record.inputs[100], record.theta, record.model, out)
    c = rotation_matrix(x[6:10])
    x[0:3] += [5.0, -3.0, 1.0]
    x[13:16] += [5.0, -3.0, 1.0]  # the same flow: only the ground track differs
    derivative(x, record.inputs[100], record.theta, record.model, gusty)
    np.testing.assert_allclose(gusty[[0, 1, 2, 10, 11, 12]], out[[0, 1, 2, 10, 11, 12]], atol=1e-10)
    np.testing.assert_allclose(c @ c.T, np.eye(3), atol=1e-12)


def flow_rate_model(aircraft):
    terms = {axis: list(listed) for axis, listed in aircraft.model.terms.items()}
    terms["Cm"].append("alpha_dot")
    terms["CZ"].append("alpha_dot")
    terms["Cn"].append("beta_dot")
    coefficients = {**aircraft.coefficients, "Cm_alpha_dot": -3.0, "CZ_alpha_dot": -1.0, "Cn_beta_dot": 0.02}
    return replace(aircraft, model=model_from_terms(terms), coefficients=coefficients)


@pytest.mark.parametrize("with_flow_rates", [False, True])
def test_error_dynamics_and_output_jacobian(aircraft, record, with_flow_rates):
    model, theta = record.model, record.theta
    if with_flow_rates:
        other = flow_rate_model(aircraft)
        model = flight_model_of(other, model.gravity)
        theta = make_theta(model, np.array([other.coefficients[n] for n in other.model.parameter_names]))
    model = model._replace(reference=(0.02, -0.01, 0.03))
    k = 1700
    x, inputs = record.states[k], record.inputs[k].copy()
    inputs[11:15] = record.states[k - 10, 6:10]  # an attitude output that is not near zero
    c = rotation_matrix(x[6:10])
    air = aerodynamics(x, c, inputs, theta, model)
    h, a, h_out = np.empty((18, 15)), np.empty((15, 15)), np.empty(18)
    error_dynamics(x, c, air, a)
    model_outputs(x, inputs, theta, model, h_out)
    output_jacobian(x, c, air, h_out[12:15].copy(), model, h)

    def rate_of(state):
        """(15,) in error coordinates of x: d/dt of the error at t = 0."""
        short, end, begin = 1e-4, state.copy(), state.copy()
        nominal = x.copy()
        for s, way in ((end, short), (begin, -short)):
            propagate_mean(s, inputs, inputs, way, theta, model)
        after, before = nominal.copy(), nominal.copy()
        for s, way in ((after, short), (before, -short)):
            propagate_mean(s, inputs, inputs, way, theta, model)
        return (difference(end, after) - difference(begin, before)) / (2.0 * short)

    def outputs_of(state):
        out = np.empty(18)
        model_outputs(state, inputs, theta, model, out)
        return out

    # with flow rates the derivative by the direction of gravity is left out, and five passes leave a rest
    tolerance = 1e-3 if with_flow_rates else 2e-5
    part = [0, 1, 2, 3, 4, 5, 9, 10, 11, 12, 13, 14] if with_flow_rates else list(range(15))
    for ours, expected in (
        (a, jacobian_by_differences(rate_of, x, 15)),
        (h, jacobian_by_differences(outputs_of, x, 18)),
    ):
        np.testing.assert_allclose(ours[:, part], expected[:, part], atol=tolerance * 10.0, rtol=tolerance)
        assert np.linalg.norm(ours - expected) < 0.03 * np.linalg.norm(expected)


def test_transition_is_the_derivative_of_the_step(record):
    k, dt = 1000, 0.02
    x, inputs = record.states[k], record.inputs[k]
    end = x.copy()
    propagate_mean(end, inputs, inputs, dt, record.theta, record.model)

    def after(state):
        out = state.copy()
        propagate_mean(out, inputs, inputs, dt, record.theta, record.model)
        return difference(out, end)

    c = rotation_matrix(end[6:10])
    a, phi = np.empty((15, 15)), np.empty((15, 15))
    error_dynamics(end, c, aerodynamics(end, c, inputs, record.theta, record.model), a)
    transition(a, dt, phi)
    exact = jacobian_by_differences(after, x, 15)
    # the derivative at the end of the step stands for that all along it: an error of second order
    assert np.linalg.norm(phi - exact) < 0.05 * np.linalg.norm(exact - np.eye(15))


EXPRESSIONS = (
    "1", "alpha**3", "-beta", "abs(beta)*da", "alpha/V", "sin(alpha)*cos(p)", "exp(-q)", "sqrt(V)", "tanh(r)",
    "sign(beta)*qbar", "max(alpha,beta)", "min(alpha,0.1)*mach", "alpha-beta*Tc+p", "sqrt(alpha*alpha)",
)  # fmt: skip


@pytest.mark.parametrize("expression", EXPRESSIONS)
def test_gradients_of_terms(expression):
    random = np.random.default_rng(3)
    signals, tangents = random.uniform(0.1, 0.5, len(SIGNALS)), random.normal(size=(len(SIGNALS), 6))
    code, offsets = link([parse_expression(expression)])
    value, slope, plain = np.empty(1), np.empty((1, 6)), np.empty(1)
    terms_and_gradients(code, offsets, signals, tangents, value, slope)
    evaluate_programs(code, offsets, signals, plain)
    assert value[0] == plain[0]
    for d in range(6):
        both = []
        for way in (1e-6, -1e-6):
            evaluate_programs(code, offsets, signals + way * tangents[:, d], plain)
            both.append(plain[0])
        assert slope[0, d] == pytest.approx((both[0] - both[1]) / 2e-6, rel=1e-6, abs=1e-8)


def test_no_airspeed_is_no_singular_point(record):
    """A simulation that stands still in the air has finite derivatives."""
    x = record.states[0].copy()
    x[0:3] = x[13:16]
    out = np.empty(16)
    derivative(x, record.inputs[0], record.theta, record.model, out)
    c = rotation_matrix(x[6:10])
    air = aerodynamics(x, c, record.inputs[0], record.theta, record.model)
    h = np.empty((18, 15))
    output_jacobian(x, c, air, np.zeros(3), record.model, h)
    assert np.all(np.isfinite(out)) and np.all(np.isfinite(h)) and np.all(np.isfinite(air.force_slopes))
