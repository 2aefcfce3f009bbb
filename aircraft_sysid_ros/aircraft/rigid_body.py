"""Rigid-body mechanics in body axes (FRD): (6.14)-(6.19) of docs/references.md, and their inverses.

(6.14) and (6.16) call X aerodynamic as printed. With T_c among the terms of C_X it holds the thrust too:
X = m A_x with A_x the specific force at the centre of gravity, which is what an accelerometer there would
read.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import Vector, applied, nine, three
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]


# -- on plain numbers -------------------------------------------------------------------------------------------------


@njit(cache=True)
def crossed(a: Vector, b: Vector) -> Vector:
    """Vector product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def solved(inertia: Array, vector: Vector) -> Vector:
    """x of ``inertia x = vector`` for the matrix of (6.19), whose xy and yz products are zero."""
    determinant = inertia[0, 0] * inertia[2, 2] - inertia[0, 2] * inertia[2, 0]
    return (
        (inertia[2, 2] * vector[0] - inertia[0, 2] * vector[2]) / determinant,
        vector[1] / inertia[1, 1],
        (inertia[0, 0] * vector[2] - inertia[2, 0] * vector[0]) / determinant,
    )


@njit(cache=True)
def euler_equations(moment: Vector, rates: Vector, inertia: Array) -> Vector:
    """d/dt (p, q, r) [rad/s^2] for the moment about the centre of gravity [N m]: (6.19)."""
    kept = crossed(rates, applied(nine(inertia), rates))
    return solved(inertia, (moment[0] - kept[0], moment[1] - kept[1], moment[2] - kept[2]))


@njit(cache=True)
def velocity_equations(specific_force: Vector, rates: Vector, velocity: Vector, gravity_b: Vector) -> Vector:
    """d/dt (u, v, w) [m/s^2] of the inertial velocity in body axes: (6.16)-(6.18), gravity in body axes."""
    turned = crossed(rates, velocity)
    return (
        specific_force[0] + gravity_b[0] - turned[0],
        specific_force[1] + gravity_b[1] - turned[1],
        specific_force[2] + gravity_b[2] - turned[2],
    )


# -- on arrays --------------------------------------------------------------------------------------------------------


@njit(cache=True)
def cross(a: Array, b: Array) -> Array:
    """Vector product a x b, shape (3,)."""
    return np.array(crossed(three(a), three(b)))


@njit(cache=True)
def forces_and_moments(
    coefficients: Array, dynamic_pressure: float, wing_area: float, span: float, chord: float
) -> tuple[Array, Array]:
    """Force [N] and moment [N m], each (3,), of C_X C_Y C_Z C_l C_m C_n, shape (6,): (6.14), (6.15)."""
    scale = dynamic_pressure * wing_area
    force = scale * coefficients[:3]
    moment = scale * coefficients[3:] * np.array([span, chord, span])
    return force, moment


@njit(cache=True)
def coefficients_of(
    force: Array, moment: Array, dynamic_pressure: float, wing_area: float, span: float, chord: float
) -> Array:
    """C_X … C_n, shape (6,): inverse of forces_and_moments; NaN without dynamic pressure."""
    scale = dynamic_pressure * wing_area
    if scale <= 0.0:
        return np.full(6, np.nan)
    out = np.empty(6)
    out[:3] = force / scale
    out[3], out[4], out[5] = (
        moment[0] / (scale * span),
        moment[1] / (scale * chord),
        moment[2] / (scale * span),
    )
    return out


@njit(cache=True)
def solve_inertia(inertia: Array, vector: Array) -> Array:
    """x of ``inertia x = vector`` for the matrix of (6.19), whose xy and yz products are zero; shape (3,)."""
    return np.array(solved(inertia, three(vector)))


@njit(cache=True)
def angular_acceleration(moment: Array, rates: Array, inertia: Array) -> Array:
    """d/dt (p, q, r) [rad/s^2] for the moment about the centre of gravity [N m]: (6.19)."""
    return np.array(euler_equations(three(moment), three(rates), inertia))


@njit(cache=True)
def moment_of_motion(acceleration: Array, rates: Array, inertia: Array) -> Array:
    """Moment about the centre of gravity [N m] of an angular acceleration [rad/s^2]: inverse of (6.19)."""
    return inertia @ acceleration + cross(rates, inertia @ rates)


@njit(cache=True)
def moment_at_centre_of_gravity(moment: Array, force: Array, reference: Array) -> Array:
    """M_cg = M_ref + r x F [N m], r from the centre of gravity to the aerodynamic reference point [m]."""
    return moment + cross(reference, force)


@njit(cache=True)
def moment_at_reference(moment: Array, force: Array, reference: Array) -> Array:
    """M_ref = M_cg - r x F [N m]: inverse of moment_at_centre_of_gravity."""
    return moment - cross(reference, force)


def coefficients_about_gravity(reference: Array, span: float, chord: float) -> Array:
    """(6, 6) that turns C_X … C_n about the aerodynamic reference point into those about the centre of gravity.

    ``reference``: the point from the centre of gravity, FRD [m].
    """
    x, y, z = reference
    turn = np.eye(6)
    turn[3:, :3] = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) / np.array([[span], [chord], [span]])
    return turn


@njit(cache=True)
def body_velocity_derivative(specific_force: Array, rates: Array, velocity: Array, gravity_b: Array) -> Array:
    """d/dt (u, v, w) [m/s^2] of the inertial velocity in body axes: (6.16)-(6.18), gravity in body axes."""
    return np.array(velocity_equations(three(specific_force), three(rates), three(velocity), three(gravity_b)))
