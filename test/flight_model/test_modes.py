"""Modes of motion against the simulator, which shares no code with the flight model, and against the textbook."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_model.layout import (
    DENSITY,
    HEIGHT,
    INPUT_SIZE,
    SPEED_OF_SOUND,
    flight_model_of,
    make_theta,
)
from aircraft_sysid_ros.flight_model.modes import (
    DUTCH_ROLL,
    PHUGOID,
    ROLL,
    SHORT_PERIOD,
    SPIRAL,
    linearised,
    modes_of,
    steady_flight,
)
from aircraft_sysid_ros.simulation.dynamics import CONTROLS, RATES, VELOCITY, state_derivative
from aircraft_sysid_ros.simulation.flight import prepare

SPEED = 17.0


@pytest.fixture(scope="module")
def symmetric(aircraft):
    """The aeroplane of simulated flights without what tilts it: level flight with neutral ailerons and rudder."""
    level = dict.fromkeys(("CY_0", "Cl_0", "Cn_0"), 0.0)
    return replace(aircraft, coefficients={**aircraft.coefficients, **level})


def inputs_at(setup):
    from aircraft_sysid_ros.aircraft.atmosphere import air_density, speed_of_sound

    inputs = np.zeros(INPUT_SIZE)
    inputs[DENSITY], inputs[SPEED_OF_SOUND] = air_density(setup.place.altitude), speed_of_sound(setup.place.altitude)
    inputs[HEIGHT] = 100.0
    return inputs


def found_modes(aircraft, setup, **changed):
    model = flight_model_of(aircraft, setup.place.gravity)
    values = {**aircraft.coefficients, **changed}
    theta = make_theta(model, np.array([values[name] for name in aircraft.model.parameter_names]))
    flight = steady_flight(model, theta, SPEED, inputs_at(setup))
    matrices = linearised(model, theta, flight)
    return flight, matrices, {mode.name: mode for mode in modes_of(*matrices)}


@pytest.mark.long
def test_modes_are_those_of_the_simulators_free_motion(symmetric):
    """Eigenvalues of the simulator's whole state by differences of its own equations, thrust held."""
    setup = prepare(symmetric)
    airframe = setup.airframe._replace(
        pitch_speed=1e12, static_thrust=setup.airframe.static_thrust * (1.0 - SPEED / setup.airframe.pitch_speed)
    )
    start, command, calm = setup.trim.state, setup.trim.controls, np.zeros(3)
    assert np.max(np.abs(state_derivative(airframe, setup.place, start, command, calm, 0.0)[VELOCITY:CONTROLS])) < 1e-5
    flight, _, modes = found_modes(symmetric, setup)
    assert flight.alpha == pytest.approx(setup.trim.alpha, abs=1e-6)
    assert flight.inputs[0] == pytest.approx(setup.trim.controls[0], abs=1e-6)
    moving = slice(VELOCITY, CONTROLS)  # velocity, quaternion, rates
    columns = []
    for place in range(VELOCITY, CONTROLS):
        pair = []
        for sign in (1.0, -1.0):
            state = start.copy()
            state[place] += sign * 1e-5
            pair.append(state_derivative(airframe, setup.place, state, command, calm, 0.0)[moving])
        columns.append((pair[0] - pair[1]) / 2e-5)
    simulated = np.linalg.eigvals(np.stack(columns, axis=1))
    assert RATES - VELOCITY == 7
    for mode in modes.values():
        for value in mode.eigenvalues:
            nearest = simulated[np.argmin(np.abs(simulated - value))]
            assert abs(nearest - value) < 0.005 * abs(value) + 2e-4, (mode.name, value, nearest)


def test_short_period_and_roll_are_those_of_the_textbooks_approximations(symmetric):
    """Etkin and Reid: omega^2 = Z_w M_q - u M_w, 2 zeta omega = -(M_q + Z_w); the roll mode is L_p."""
    setup = prepare(symmetric)
    flight, _, modes = found_modes(symmetric, setup)
    c, a = symmetric.coefficients, symmetric
    qbar = 0.5 * flight.inputs[DENSITY] * SPEED**2
    force, moment = qbar * a.wing_area / a.mass, qbar * a.wing_area * a.chord / a.inertia[1, 1]
    z_w, z_q = force * c["CZ_alpha"] / SPEED, force * c["CZ_q"] * a.chord / SPEED
    m_w, m_q = moment * c["Cm_alpha"] / SPEED, moment * c["Cm_q"] * a.chord / SPEED
    omega = np.sqrt(z_w * m_q - (SPEED + z_q) * m_w)
    assert modes[SHORT_PERIOD].frequency == pytest.approx(omega, rel=0.03)
    assert modes[SHORT_PERIOD].damping == pytest.approx(-(m_q + z_w) / (2.0 * omega), rel=0.03)
    inertia = (a.inertia[0, 0] * a.inertia[2, 2] - a.inertia[0, 2] ** 2) / a.inertia[2, 2]
    l_p = qbar * a.wing_area * a.span**2 / (2.0 * SPEED * inertia) * c["Cl_p"]
    assert modes[ROLL].eigenvalues[0].real == pytest.approx(l_p, rel=0.15)
    assert modes[PHUGOID].frequency == pytest.approx(np.sqrt(2.0) * setup.place.gravity / SPEED, rel=0.35)


def test_an_unstable_aeroplane_has_a_motion_that_grows(symmetric):
    setup = prepare(symmetric)
    _, _, stable = found_modes(symmetric, setup)
    _, _, unstable = found_modes(symmetric, setup, Cm_alpha=0.4)
    assert all(mode.growth < 0.0 for name, mode in stable.items() if name != SPIRAL)
    assert max(unstable[name].growth for name in (SHORT_PERIOD, PHUGOID)) > 0.1
    apart = next(mode for mode in unstable.values() if mode.growth > 0.1)
    assert not any(value.imag for value in apart.eigenvalues), "one root grows and the other dies away"
    assert np.isnan(apart.frequency) and np.isnan(apart.damping), "nothing swings, and no damping of 0.9 holds it"
    _, _, loose = found_modes(symmetric, setup, Cn_beta=-0.07)
    assert max(mode.growth for mode in loose.values()) > 0.5
    assert {DUTCH_ROLL, ROLL} <= set(loose)


def test_without_lift_there_is_no_steady_flight(symmetric):
    setup = prepare(symmetric)
    with pytest.raises(InputError, match="no steady straight flight at 17 m/s"):
        found_modes(symmetric, setup, CZ_alpha=-0.05, CZ_0=0.0)
