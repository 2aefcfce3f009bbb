"""An aeroplane as strips: wing, tailplane and fin, each strip in the air that it meets.

Every strip has its own velocity through the air, u + ω × r less the gust where it is, a section of thin-aerofoil lift
with Kirchhoff's flow separation, profile drag, and the angle that a finite span induces. The tailplane flies in the
downwash that the wing made one tail length earlier. Nothing is a derivative; those that a fit finds come out of this.

Axes are those of the body: x ahead, y right, z down. Reference: E. Pamadi, Performance, Stability, Dynamics and Control
of Airplanes (strip theory); J. Leishman, Principles of Helicopter Aerodynamics (Kirchhoff's separation).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

Array = npt.NDArray[np.float64]

#: Strips of the wing, of the tailplane and of the fin.
WING, TAIL, FIN = 16, 6, 3
#: What may change in flight: part of the elevator and of the aileron that acts, ice (1: all) and flaps [rad], ground (1
#: acts), part of the thrust, shift of the centre of gravity aft [m], wash of the propeller, part of the fin; of the
#: left one of two ailerons the part that follows, and where it stands besides [rad].
ELEVATOR, AILERON, ICE, FLAPS, GROUND, THRUST, CG_AFT, WASH, FIN_PART, LEFT_FOLLOWS, LEFT_AT, CHANGES = range(12)
CLEAN = (1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0)
#: Columns of a strip: place (3), area, normal (3), chord, lift slope of its section, aspect ratio, incidence, zero-lift
#: drag, effect of elevator, aileron (with its sign), rudder and flap, and which surface it is of (0, 1, 2).
_X, _AREA, _NORMAL, _CHORD, _SLOPE, _ASPECT, _INCIDENCE, _DRAG, _DE, _DA, _DR, _DF, _OF, _WIDTH = (
    0, 3, 4, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17,
)  # fmt: skip
STALL, STALL_WIDTH = 0.27, 0.025
SLOPE, ASPECT, INCIDENCE = _SLOPE, _ASPECT, _INCIDENCE


@dataclass(frozen=True)
class Aeroplane:
    """Mass, shape and strips of one aeroplane; ``strips`` (n, _WIDTH)."""

    name: str
    mass: float
    span: float
    area: float
    chord: float
    inertia: Array  # (3, 3)
    strips: Array
    tail_arm: float
    cruise: float  # [m/s]
    altitude: float
    thrust: float  # [N] at rest, full throttle
    thrust_arm: float  # [m] below the centre of gravity


#: Lowest and highest mass [kg], wing loading [kg/m²], aspect ratio, lift coefficient of the cruise, altitude [m].
FAMILIES = {
    "model": ((1.5, 14.0), (5.0, 14.0), (5.5, 10.0), (0.30, 0.5), (80.0, 500.0)),
    "light": ((600.0, 1500.0), (50.0, 90.0), (6.0, 9.0), (0.30, 0.45), (600.0, 2500.0)),
    "sailplane": ((300.0, 750.0), (28.0, 42.0), (14.0, 20.0), (0.40, 0.55), (600.0, 2500.0)),
    "twin": ((2500.0, 6000.0), (110.0, 190.0), (7.0, 10.0), (0.30, 0.45), (1500.0, 4000.0)),
}


def drawn_aeroplane(rng: np.random.Generator, family: str) -> Aeroplane:
    """An aeroplane of a family, stable by 8 to 18 % of its chord."""
    mass, loading, aspect, lift, altitude = (float(rng.uniform(*limits)) for limits in FAMILIES[family])
    area = mass / loading
    span = float(np.sqrt(aspect * area))
    chord, arm = area / span, (0.42 if aspect < 12.0 else 0.3) * span
    dihedral = rng.uniform(0.05, 0.1)
    tail_area, fin_area = rng.uniform(0.5, 0.65) * chord * area / arm, rng.uniform(0.035, 0.05) * span * area / arm
    strips = np.zeros((WING + TAIL + FIN, _WIDTH))
    taper, slope, drag = rng.uniform(0.5, 0.9), rng.uniform(5.6, 6.2), rng.uniform(0.010, 0.014)
    y = span * ((np.arange(WING) + 0.5) / WING - 0.5)
    out = 2.0 * np.abs(y) / span
    local = 2.0 * chord / (1.0 + taper) * (1.0 - (1.0 - taper) * out)
    wing = strips[:WING]
    wing[:, _X + 1], wing[:, _X + 2], wing[:, _AREA] = y, -dihedral * np.abs(y), local * span / WING
    wing[:, _NORMAL + 1], wing[:, _NORMAL + 2] = np.sign(y) * np.sin(dihedral), np.cos(dihedral)
    wing[:, _CHORD], wing[:, _SLOPE], wing[:, _ASPECT], wing[:, _DRAG] = local, slope, aspect, drag
    wing[:, _INCIDENCE] = 0.05 - rng.uniform(0.01, 0.035) * out
    wing[:, _DA] = np.where((out > 0.55) & (out < 0.95), 0.42 * np.sign(y), 0.0)
    wing[:, _DF] = np.where(out < 0.5, 0.4, 0.0)
    tail, tail_span = strips[WING : WING + TAIL], np.sqrt(4.0 * tail_area)
    tail[:, _X], tail[:, _X + 1] = -arm, tail_span * ((np.arange(TAIL) + 0.5) / TAIL - 0.5)
    tail[:, _AREA], tail[:, _NORMAL + 2], tail[:, _CHORD] = tail_area / TAIL, 1.0, tail_area / tail_span
    tail[:, _SLOPE], tail[:, _ASPECT], tail[:, _DRAG], tail[:, _DE], tail[:, _OF] = 5.8, 4.0, 0.011, 0.5, 1.0
    fin, height = strips[WING + TAIL :], np.sqrt(1.4 * fin_area)
    fin[:, _X], fin[:, _X + 2], fin[:, _AREA] = -0.97 * arm, -height * (np.arange(FIN) + 0.5) / FIN, fin_area / FIN
    fin[:, _NORMAL + 1], fin[:, _CHORD], fin[:, _SLOPE], fin[:, _ASPECT] = 1.0, fin_area / height, 5.8, 2.4
    fin[:, _DRAG], fin[:, _DR], fin[:, _OF] = 0.011, -0.5, 2.0
    lift_of_wing = slope / (1.0 + slope / (np.pi * aspect))
    lift_of_tail = 5.8 / (1.0 + 5.8 / (4.0 * np.pi)) * (1.0 - 2.0 * lift_of_wing / (np.pi * aspect)) * 0.95
    volume, margin = tail_area * arm / (area * chord), rng.uniform(0.08, 0.18)
    strips[:WING, _X] = chord * (lift_of_tail * volume / lift_of_wing - margin)  # where the lift of the wing acts
    radii = rng.uniform(0.9, 1.1, 3) * np.array([0.125 * span, 0.36 * arm, 0.0])
    radii[2] = float(np.hypot(radii[0], radii[1])) * rng.uniform(0.95, 0.99)
    inertia = np.diag(mass * radii**2)
    inertia[0, 2] = inertia[2, 0] = -0.02 * inertia[2, 2] * rng.uniform(-1.0, 1.0)
    density = density_at(altitude)
    cruise = float(np.sqrt(2.0 * loading * 9.80665 / (density * lift)))
    thrust, below = mass * 9.80665 * rng.uniform(0.3, 0.45), rng.uniform(-0.03, 0.05) * chord
    return Aeroplane(
        family, mass, span, area, chord, inertia, strips, arm, cruise, altitude, float(thrust), float(below)
    )  # fmt: skip


@njit(cache=True)
def density_at(altitude: float) -> float:
    """Density [kg/m³] of the standard atmosphere in the troposphere."""
    return float(1.225 * (1.0 - 2.25577e-5 * altitude) ** 4.25588)


@njit(cache=True)
def section(slope: float, angle: float, ice: float) -> tuple[float, float]:
    """Lift and separated drag of a section: attached up to the stall, then Kirchhoff's plate."""
    attached = 1.0 / (1.0 + np.exp((abs(angle) - STALL * (1.0 - 0.25 * ice)) / STALL_WIDTH))
    lift = slope * (1.0 - 0.12 * ice) * 0.25 * (1.0 + np.sqrt(attached)) ** 2 * np.sin(angle)
    return lift, (1.0 - attached) * 1.6 * np.sin(angle) ** 2


@njit(cache=True)
def forces_of(
    strips: Array, velocity: Array, rates: Array, gusts: Array, controls: Array, changes: Array, wash: float,
    density: float, height_by_span: float,
) -> tuple[Array, Array, float]:  # fmt: skip
    """Force and moment (3,) about the centre of gravity, and the downwash [rad] that the wing makes now.

    velocity (3,): of the centre of gravity through steady air; gusts (n, 3): air at each strip, in body axes; controls:
    elevator, aileron, rudder [rad]; wash: downwash [rad] at the tail, made a while ago.
    """
    force, moment, at_wing = np.zeros(3), np.zeros(3), 0.0
    near = 1.0
    if changes[GROUND] > 0.0:  # an image of the wing below the ground
        near = (16.0 * height_by_span) ** 2 / (1.0 + (16.0 * height_by_span) ** 2)
    for i in range(len(strips)):
        strip = strips[i]
        r = strip[_X : _X + 3].copy()
        r[0] += changes[CG_AFT]
        air = velocity + np.cross(rates, r) - gusts[i]
        n = strip[_NORMAL : _NORMAL + 3]
        along, across = air[0], float(np.dot(air, n))
        flow = np.arctan2(across, along)
        angle = flow + strip[_INCIDENCE]
        if strip[_OF] == 1.0:
            angle -= wash
        aileron = controls[1] * changes[AILERON]
        if strip[_DA] < 0.0:
            aileron = aileron * changes[LEFT_FOLLOWS] + changes[LEFT_AT]
        angle += strip[_DE] * controls[0] * changes[ELEVATOR] + strip[_DA] * aileron
        angle += strip[_DR] * controls[2] + strip[_DF] * changes[FLAPS]
        ice = changes[ICE] if strip[_OF] == 0.0 else 0.0
        two_dimensional = strip[_SLOPE] * (1.0 - 0.12 * ice)
        effective = angle / (1.0 + two_dimensional * near / (np.pi * strip[_ASPECT]))
        lift, separated = section(strip[_SLOPE], effective, ice)
        drag = strip[_DRAG] + 0.006 * lift * lift + separated + 0.02 * ice + lift * (angle - effective)
        if strip[_OF] == 0.0:
            drag += 0.12 * changes[FLAPS] * strip[_DF]
        pressure = 0.5 * density * (along * along + across * across) * strip[_AREA]
        if strip[_OF] > 0.0:
            pressure *= 1.0 + changes[WASH]
        if strip[_OF] == 2.0:
            pressure *= changes[FIN_PART]
        f = -pressure * (lift * np.cos(flow) + drag * np.sin(flow)) * n
        f[0] += pressure * (lift * np.sin(flow) - drag * np.cos(flow))
        force += f
        moment += np.cross(r, f)
        if strip[_OF] == 0.0:
            camber = -0.03 - 0.2 * changes[FLAPS] * strip[_DF] + 0.02 * ice
            moment[1] += pressure * strip[_CHORD] * camber
            at_wing += 2.0 * lift * near / (np.pi * strip[_ASPECT]) / WING
    return force, moment, at_wing
