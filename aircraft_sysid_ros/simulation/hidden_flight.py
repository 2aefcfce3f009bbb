"""Flying what a recipe cannot say as a term: mass and centre of gravity that change, slow actuators, low passes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.sensors.truth import Truth
from aircraft_sysid_ros.simulation.dynamics import trim_airspeed_of
from aircraft_sysid_ros.simulation.flight import Change, Setup, fly
from aircraft_sysid_ros.simulation.hidden_effects import Hidden
from aircraft_sysid_ros.simulation.manoeuvres import Plan

Array = npt.NDArray[np.float64]

#: Least height [spans] of low passes.
CLEARANCE = 0.2
#: Airspeed [m/s] and size of the aeroplane that shows compressibility.
FAST, _FAST_LENGTH = 190.0, 8.0
#: Share of the error of one attempt at low passes that the next corrects.
_LEARNING = 0.5


def fly_hidden(setup: Setup, plan: Plan, wind: Array, hidden: Sequence[Hidden], span: float) -> Truth:
    """As flight.fly, with everything that is hidden; low passes come as near to the ground as CLEARANCE.

    Raises InputError when the aeroplane does not stay in the air.
    """
    for effect in hidden:
        wind = wind + effect.wind(plan.time)
        if effect.command_lag > 0.0:
            rates = setup.airframe.actuator_rates.copy()
            rates[:3] = 1.0 / effect.command_lag
            setup = replace(setup, airframe=setup.airframe._replace(actuator_rates=rates))
    changes = _changes(setup, hidden)
    return low_passes(plan, span, lambda p, drop: fly(_lowered(setup, drop), p, wind, changes))


def low_passes(plan: Plan, span: float, attempt: Callable[[Plan, float], Truth], attempts: int = 5) -> Truth:
    """The flight of a plan; low passes in it are level and as low as CLEARANCE, as of a pilot who looks at the ground.

    ``attempt`` flies a plan with everything lowered by some [m]; what the height was off in one is taken off the
    reference of the next. Without low passes there is one attempt.
    """
    truth = attempt(plan, 0.0)
    low = plan.height < plan.height.min() + 0.5
    if low.all():
        return truth
    wanted, plan = plan.height, replace(plan, height=plan.height.copy())
    clearance, drop = span, 0.0
    for _ in range(attempts):
        error = truth.height - truth.height[0] - wanted
        plan.height[:] -= np.where(low, _LEARNING * error, 0.0)
        lower = drop + float(truth.height.min()) - clearance
        try:
            truth, drop = attempt(plan, lower), lower
        except InputError:  # into the ground
            clearance += 0.5 * span
            continue
        clearance = max(CLEARANCE * span, 0.5 * clearance)
    return truth


def _lowered(setup: Setup, by: float) -> Setup:
    """The same flight [m] lower."""
    place = setup.place._replace(altitude=setup.place.altitude - by)
    return replace(setup, place=place, origin=setup.origin - [0.0, 0.0, by])


def _changes(setup: Setup, hidden: Sequence[Hidden]) -> list[Change]:
    """Changes of mass and centre of gravity by rising time; each stays when the next one comes."""
    of_mass = [effect for effect in hidden if effect.mass_factor != 1.0 or any(effect.cg_shift)]
    airframe, changes = setup.airframe, []
    for effect in sorted(of_mass, key=lambda effect: effect.inner["t0"]):
        airframe = airframe._replace(
            mass=airframe.mass * effect.mass_factor, reference=airframe.reference - np.array(effect.cg_shift)
        )
        changes.append(Change(effect.inner["t0"], airframe))
    return changes


def fast_aeroplane(aircraft: Aircraft) -> Aircraft:
    """An aeroplane of the same coefficients that flies where compressibility matters.

    Mass is such that it cruises at the same lift coefficient, inertia as of the same distribution of mass.
    """
    length, source = _FAST_LENGTH, aircraft.source
    heavier = length**2 * (FAST / trim_airspeed_of(aircraft)) ** 2
    positions = ("imu_position", "air_data_position", "gps_position", "aerodynamic_reference")
    return aircraft_from_dict(
        {
            **source,
            "name": f"Fast relative of {aircraft.name}",
            "mass": aircraft.mass * heavier,
            "wing_area": aircraft.wing_area * length**2,
            "span": aircraft.span * length,
            "chord": aircraft.chord * length,
            "inertia": {axes: value * heavier * length**2 for axes, value in source["inertia"].items()},
            **{name: (length * getattr(aircraft, name)).tolist() for name in positions},
            "trim_airspeed": FAST,
        }
    )


def apparent_coefficients(aircraft: Aircraft, truth: Truth) -> Array:
    """C_X … C_n (n, 6) that a noiseless measurement works out with the mass properties of an aircraft file.

    (6.14)-(6.19) backwards. They are the true ones while the file is right.
    """
    force = aircraft.mass * truth.specific_force
    momentum = truth.rates @ aircraft.inertia.T
    moment = truth.angular_acceleration @ aircraft.inertia.T + np.cross(truth.rates, momentum)
    moment = moment - np.cross(aircraft.aerodynamic_reference, force)
    scale = (0.5 * truth.density * truth.airspeed**2 * aircraft.wing_area)[:, None]
    lengths = np.array([aircraft.span, aircraft.chord, aircraft.span])
    result: Array = np.hstack([force / scale, moment / (scale * lengths)])
    return result
