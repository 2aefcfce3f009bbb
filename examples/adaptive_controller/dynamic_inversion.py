"""Nonlinear dynamic inversion with whatever aerodynamic parameters it is given; numbers: docs/references.md.

Wanted bank and pitch go through critically damped reference models; attitude errors ask for angular rates, rate errors
for angular accelerations. The model of the aeroplane says which elevator, aileron and rudder give these:

    omega_dot(x, delta) = wanted,  delta = delta_0 + B^-1 (wanted - omega_dot(x, delta_0)),  B = d omega_dot / d delta,

exact where the model is affine in the surfaces. If the parameters are right, what is left is three integrators.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from aircraft_sysid_ros.aircraft import rigid_body
from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.aircraft.postfix import evaluate_programs
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.simulation.dynamics import DEFLECTION_LIMIT
from aircraft_sysid_ros.simulation.flight import prepare
from aircraft_sysid_ros.simulation.trim import derivatives_at

Array = npt.NDArray[np.float64]

_ALPHA, _BETA, _P, _Q, _R = (SIGNAL_INDEX[name] for name in ("alpha", "beta", "p", "q", "r"))
_DE, _V, _QBAR = SIGNAL_INDEX["de"], SIGNAL_INDEX["V"], SIGNAL_INDEX["qbar"]
#: Step [rad] of the differences of the control matrix.
_DIFFERENCE = 0.02
#: Determinant of the control matrix over the product of its columns below which surfaces cannot be told apart.
_SINGULAR = 0.05


class Rig(NamedTuple):
    """Mass properties, geometry and terms of the model, for the compiled part; SI."""

    wing_area: float
    span: float
    chord: float
    inertia: Array  # (3, 3)
    reference: Array  # (3,) aerodynamic reference from the centre of gravity
    code: Array
    term_offsets: npt.NDArray[np.int64]
    axis_offsets: npt.NDArray[np.int64]  # (7,)


def rig_of(aircraft: Aircraft) -> Rig:
    """What an aircraft file says, without the coefficients."""
    code, offsets = aircraft.model.linked
    return Rig(
        aircraft.wing_area, aircraft.span, aircraft.chord, np.ascontiguousarray(aircraft.inertia),
        aircraft.aerodynamic_reference.copy(), code, offsets, aircraft.model.offsets,
    )  # fmt: skip


@njit(cache=True)
def modelled_acceleration(rig, parameters, signals, rates):
    """Angular acceleration [rad/s^2], (3,), that the model with these parameters (n,) sees, (6.8)-(6.15), (6.19)."""
    terms = np.empty(len(parameters))
    evaluate_programs(rig.code, rig.term_offsets, signals, terms)
    coefficients = np.empty(6)
    for axis in range(6):
        a, b = rig.axis_offsets[axis], rig.axis_offsets[axis + 1]
        coefficients[axis] = np.sum(terms[a:b] * parameters[a:b])
    force, moment = rigid_body.forces_and_moments(coefficients, signals[_QBAR], rig.wing_area, rig.span, rig.chord)
    moment = rigid_body.moment_at_centre_of_gravity(moment, force, rig.reference)
    return rigid_body.angular_acceleration(moment, rates, rig.inertia)


@njit(cache=True)
def invert(rig, parameters, signals, rates, wanted):
    """Elevator, aileron and rudder [rad], (3,), for a wanted angular acceleration (3,), from those in ``signals``.

    Where the control matrix is singular, or not finite, the surfaces stay as they are in ``signals``.
    """
    now = signals[_DE : _DE + 3].copy()
    offset = modelled_acceleration(rig, parameters, signals, rates)
    matrix = np.empty((3, 3))
    scale = 1.0
    for k in range(3):
        signals[_DE + k] = now[k] + _DIFFERENCE
        matrix[:, k] = (modelled_acceleration(rig, parameters, signals, rates) - offset) / _DIFFERENCE
        signals[_DE + k] = now[k]
        scale *= np.sqrt(np.sum(matrix[:, k] ** 2))
    missing = wanted - offset
    if not (np.isfinite(scale) and np.all(np.isfinite(missing))):  # LAPACK would raise
        return now
    if np.abs(np.linalg.det(matrix)) <= _SINGULAR * scale:
        return now
    return now + np.linalg.solve(matrix, missing)


class Seen(NamedTuple):
    """What the autopilot measures now: body axes FRD, SI."""

    rates: Array  # (3,) [rad/s]
    attitude: Array  # (4,) quaternion to NED
    airspeed: float  # [m/s] at the centre of gravity, as alpha and beta [rad]
    alpha: float
    beta: float
    density: float  # [kg/m^3]
    height: float  # [m] above that of the beginning


class Reference(NamedTuple):
    """What is to be flown."""

    bank: float  # [rad]
    pitch: float  # [rad] beyond that of level flight
    airspeed: float  # [m/s]


@dataclass(frozen=True)
class Bandwidths:
    """In rad/s; none of them depends on the aeroplane."""

    bank: float = 3.0  # of the reference models
    pitch: float = 2.5
    attitude: float = 3.0  # attitude error to rate
    integral: float = 0.6
    rate: tuple[float, float, float] = (8.0, 8.0, 5.0)  # rate error to acceleration
    sideslip: float = 1.0
    airspeed: float = 0.4
    height: float = 0.08


class Follower:
    """Critically damped reference model of one angle."""

    def __init__(self, bandwidth: float) -> None:
        self.bandwidth, self.angle, self.rate, self.acceleration = bandwidth, 0.0, 0.0, 0.0

    def step(self, wanted: float, dt: float) -> None:
        """Follow the wanted angle [rad] for ``dt`` [s]."""
        w = self.bandwidth
        self.acceleration = w * w * (wanted - self.angle) - 2.0 * w * self.rate
        self.rate += dt * self.acceleration
        self.angle += dt * self.rate


_INTEGRAL_LIMIT = 1.5  # [rad/s]
_HEIGHT_PITCH = 0.05  # [rad] at most for the sake of height
_CLIMB_LIMIT, _BANK_LIMIT = 0.3, 1.2  # [rad] that count for throttle and turn


class AttitudeController:
    """Bank, pitch and airspeed by surfaces and throttle. ``step`` is given the parameters to fly on each time."""

    def __init__(self, aircraft: Aircraft, bandwidths: Bandwidths | None = None) -> None:
        """Trim and throttle are those of the aircraft file; InputError where it has no level flight."""
        setup = prepare(aircraft)
        trim, slopes = setup.trim, derivatives_at(setup.airframe, setup.place, setup.trim)
        self.rig, self.bandwidths = rig_of(aircraft), bandwidths or Bandwidths()
        self.airspeed, self.trim_pitch = trim.airspeed, trim.alpha
        self._slowest = 0.5 * trim.airspeed  # less is no flight, and no measure of the dynamic pressure
        self._trim, self._thrust_rate = trim.controls.copy(), slopes.thrust_rate
        self.bank, self.pitch = Follower(self.bandwidths.bank), Follower(self.bandwidths.pitch)
        self._integral, self._throttle_integral = np.zeros(2), 0.0
        self.surfaces = trim.controls[:3].copy()  # newest, without excitation
        self._parameters = np.empty(0)  # of the step before

    def step(self, seen: Seen, reference: Reference, parameters: Array, excitation: Array, dt: float) -> Array:
        """Elevator, aileron, rudder [rad] and throttle, shape (4,), for the next ``dt`` [s].

        ``parameters`` (n,) in the order of the aircraft's model; ``excitation`` (3,) [rad] is added to the surfaces.
        """
        w = self.bandwidths
        roll, pitch, _ = euler_from_quaternion(seen.attitude)
        held = w.height / self.airspeed * -seen.height
        self.bank.step(reference.bank, dt)
        self.pitch.step(reference.pitch + min(max(held, -_HEIGHT_PITCH), _HEIGHT_PITCH), dt)
        signals = self._signals(seen)
        self._take_over(parameters, signals, seen.rates)
        rates = self._wanted_rates(roll, pitch, seen)
        wanted = np.array(w.rate) * (rates - seen.rates)
        wanted[0] += self.bank.acceleration
        wanted[1] += self.pitch.acceleration * np.cos(roll)
        found = invert(self.rig, parameters, signals, seen.rates, wanted)
        self.surfaces = np.clip(found, -DEFLECTION_LIMIT, DEFLECTION_LIMIT)
        if np.all(np.abs(found) < DEFLECTION_LIMIT):  # else the integrals wait
            error = np.array([self.bank.angle - roll, self.pitch.angle + self.trim_pitch - pitch])
            change = dt * w.integral * w.attitude * error
            self._integral = np.clip(self._integral + change, -_INTEGRAL_LIMIT, _INTEGRAL_LIMIT)
        return np.append(self.surfaces + excitation, self._throttle(seen, reference, dt))

    def _take_over(self, parameters: Array, signals: Array, rates: Array) -> None:
        """What new parameters explain the integrals need not carry any more: they shrink by it, at most to 0.

        Else surfaces that the integrals had found in the end would jump away when the model learns the same.
        """
        if len(self._parameters) and not np.array_equal(parameters, self._parameters):
            new, old = (modelled_acceleration(self.rig, p, signals, rates) for p in (parameters, self._parameters))
            moved = self._integral + (new - old)[:2] / self.bandwidths.rate[:2]
            self._integral = np.clip(moved, np.minimum(self._integral, 0.0), np.maximum(self._integral, 0.0))
        self._parameters = parameters

    def _wanted_rates(self, roll: float, pitch: float, seen: Seen) -> Array:
        """p, q, r [rad/s] for the wanted changes of bank and pitch in a coordinated turn, sideslip taken out."""
        w = self.bandwidths
        bank_rate = self.bank.rate + w.attitude * (self.bank.angle - roll) + self._integral[0]
        error = self.pitch.angle + self.trim_pitch - pitch
        pitch_rate = self.pitch.rate + w.attitude * error + self._integral[1]
        inside = min(max(roll, -_BANK_LIMIT), _BANK_LIMIT)
        turn = STANDARD_GRAVITY * np.tan(inside) / max(seen.airspeed, self._slowest)
        c, s = np.cos(roll), np.sin(roll)
        return np.array(
            [
                bank_rate - turn * np.sin(pitch),
                pitch_rate * c + turn * np.cos(pitch) * s,
                -pitch_rate * s + turn * np.cos(pitch) * c + w.sideslip * seen.beta,
            ]
        )

    def _signals(self, seen: Seen) -> Array:
        """Row of expression.SIGNALS, with the newest surfaces; what the autopilot does not know is 0."""
        out = np.zeros(len(SIGNALS))
        airspeed = max(seen.airspeed, self._slowest)
        p, q, r = seen.rates
        out[_ALPHA], out[_BETA] = seen.alpha, seen.beta
        out[_P], out[_R] = p * self.rig.span / (2.0 * airspeed), r * self.rig.span / (2.0 * airspeed)
        out[_Q] = q * self.rig.chord / airspeed
        out[_DE : _DE + 3] = self.surfaces
        out[_V], out[_QBAR] = airspeed, 0.5 * seen.density * airspeed * airspeed
        return out

    def _throttle(self, seen: Seen, reference: Reference, dt: float) -> float:
        """Proportional and integral on airspeed, and what carries the weight up the slope."""
        w = self.bandwidths.airspeed
        error = reference.airspeed - seen.airspeed
        climb = min(max(self.pitch.angle, -_CLIMB_LIMIT), _CLIMB_LIMIT)
        wanted = w * error + self._throttle_integral + STANDARD_GRAVITY * climb
        throttle = self._trim[3] + wanted / self._thrust_rate
        if 0.0 < throttle < 1.0:
            self._throttle_integral += dt * 0.1 * w * error
        return float(min(max(throttle, 0.0), 1.0))
