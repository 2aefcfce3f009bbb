"""A simulated flight in memory: truth, true biases, and the samples as its recording would give them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.samples import Samples
from aircraft_sysid_ros.sensors.sensor_models import Biases, SensorOptions, Stream, arrived, generator, measure
from aircraft_sysid_ros.sensors.truth import Truth
from aircraft_sysid_ros.simulation.dynamics import Effect, trim_airspeed_of
from aircraft_sysid_ros.simulation.flight import HEIGHT, prepare
from aircraft_sysid_ros.simulation.hidden_effects import Hidden, hidden_effect, plans_of
from aircraft_sysid_ros.simulation.hidden_flight import (
    apparent_coefficients,
    fast_aeroplane,
    fly_hidden,
)
from aircraft_sysid_ros.simulation.jsbsim_flight import DEFAULT_MODEL
from aircraft_sysid_ros.simulation.jsbsim_flight import RATE as JSBSIM_RATE
from aircraft_sysid_ros.simulation.jsbsim_hidden import (
    fly_jsbsim_plan,
    jsbsim_effects,
    prepared,
    projected,
    users_aircraft,
)
from aircraft_sysid_ros.simulation.varied_plan import PLANS, STANDARD, plan_of
from aircraft_sysid_ros.simulation.wind import TURBULENCE_WIND, low_altitude_turbulence, wind_series

#: Rate [Hz] of the textbook simulation.
RATE = 400.0
#: The same for hidden_flight, which is called by the thousand.
HIDDEN_RATE = 200.0
TEXTBOOK = "textbook"
#: Flights in which the file of a JSBSim aeroplane is right: without stall, flaps and ground.
CLEAN_PLANS = ("standard", "varied", "speeds", "sideslips")
SHORTEST, LONGEST = 20.0, 3600.0  # [s]
DEFAULT_WIND = (3.0, -2.0, 0.0)  # [m/s] NED


@dataclass(frozen=True)
class SimulatedFlight:
    """One flight. ``truth`` is at RATE; ``streams`` hold the messages of each topic."""

    aircraft: Aircraft
    seed: int
    effects: tuple[Effect, ...]
    truth: Truth
    biases: Biases
    streams: list[Stream]
    simulator: str = "textbook"
    hidden: tuple[Hidden, ...] = ()
    #: True coefficients of the model without what is hidden, by name; empty where nobody knows.
    coefficients: dict[str, float] = field(default_factory=dict)
    manoeuvres: str = STANDARD
    #: True errors of the instruments by calibration and parameter; empty where they were not drawn.
    calibration: dict[str, dict[str, float]] = field(default_factory=dict)

    @property
    def oracle(self) -> Aircraft:
        """The aircraft file of one who knows what is hidden: its terms in the model, the right settings."""
        coefficients = self.coefficients or projected(self.aircraft, self.truth)
        aircraft = self.aircraft
        for effect in self.hidden:
            aircraft = effect.oracle(aircraft, coefficients)
        return aircraft

    @property
    def apparent_coefficients(self) -> npt.NDArray[np.float64]:
        """C_X … C_n (n, 6) along ``truth`` that a noiseless measurement works out with the user's mass properties."""
        return apparent_coefficients(self.aircraft, self.truth)

    @cached_property
    def samples(self) -> Samples:
        """All samples in order of arrival."""
        return arrived(self.streams, self.aircraft.inputs)


def simulate_samples(
    aircraft: Aircraft,
    seed: int = 0,
    duration: float = 120.0,
    *,
    wind: npt.ArrayLike = DEFAULT_WIND,
    wind_walk: float | None = None,
    turbulence: str = "none",
    effects: Sequence[Effect] = (),
    hidden: Sequence[tuple[str, float]] = (),
    manoeuvres: str | None = None,
    sensors: SensorOptions | None = None,
    rate: float = RATE,
) -> SimulatedFlight:
    """Fly a test flight and measure it; the same arguments give the same bits.

    wind: mean NED [m/s], the direction the air moves to. wind_walk: its random walk [m/s per sqrt(s)], by
    default the process noise of the aircraft file. turbulence: a key of wind.TURBULENCE_WIND. hidden: ids of the
    library with strengths. manoeuvres: one of varied_plan.PLANS, by default one that shows what is hidden, or the
    standard one. rate: steps per second [Hz].
    Raises InputError when the aircraft cannot be simulated or the flight does not stay in the air.
    """
    _check(duration, turbulence)
    there = textbook_effects(aircraft, hidden, seed, duration)
    setup = prepare(aircraft, [*effects, *(term for effect in there for term in effect.terms)])
    time = np.arange(round(duration * rate) + 1) / rate
    walk = aircraft.process_noise["wind"] if wind_walk is None else wind_walk
    air = _wind(seed, len(time), rate, wind, walk, setup.trim.airspeed, turbulence)
    chosen = manoeuvres or chosen_plan([name for name, _ in hidden], seed)
    plan = plan_of(chosen, time, setup.excitation, seed)
    truth = fly_hidden(setup, plan, air, there, aircraft.span)
    options = sensors or SensorOptions()
    streams, biases = measure(*really(aircraft, there, truth, seed, options))
    return SimulatedFlight(
        aircraft, seed, tuple(effects), truth, biases, streams,
        hidden=there, coefficients=dict(aircraft.coefficients), manoeuvres=chosen,
    )  # fmt: skip


def textbook_effects(
    aircraft: Aircraft, hidden: Sequence[tuple[str, float]], seed: int, duration: float
) -> tuple[Hidden, ...]:
    """What is hidden in a flight, drawn from the seed."""
    if not hidden:
        return ()
    level = prepare(aircraft).trim
    trim = (level.alpha, float(level.controls[0]))
    return tuple(
        hidden_effect(name, strength, seed, duration, aircraft, aircraft.coefficients, trim)
        for name, strength in hidden
    )


def chosen_plan(identifiers: Sequence[str], seed: int, avoided: Sequence[str] = ()) -> str:
    """Kind of a flight that shows the first of some effects, not one of those avoided if another does."""
    if not identifiers:
        return STANDARD
    plans = list(plans_of(identifiers[0]))
    return str(generator(seed, "manoeuvres").choice([plan for plan in plans if plan not in avoided] or plans))


def really(
    aircraft: Aircraft, there: Sequence[Hidden], truth: Truth, seed: int, options: SensorOptions
) -> tuple[Aircraft, Truth, int, SensorOptions]:
    """Arguments of ``measure`` for the sensors as they really are."""
    for effect in there:
        aircraft = effect.sensors_of(aircraft)
        options = replace(
            options,
            air_data_lag=options.air_data_lag + effect.air_data_lag,
            command_lag=options.command_lag + effect.command_lag,
            command_dead_time=options.command_dead_time + effect.command_dead_time,
        )
    return aircraft, truth, seed, options


def simulate_jsbsim_samples(
    name: str = DEFAULT_MODEL,
    seed: int = 0,
    duration: float = 120.0,
    *,
    wind: npt.ArrayLike = DEFAULT_WIND,
    wind_walk: float | None = None,
    turbulence: str = "none",
    hidden: Sequence[tuple[str, float]] = (),
    manoeuvres: str | None = None,
    sensors: SensorOptions | None = None,
    fitted: bool = False,
) -> SimulatedFlight:
    """As simulate_samples, with an aeroplane of JSBSim (a key of jsbsim_flight.MODELS) and its physics.

    fitted: its file lists, besides the 32 terms, those that describe it, without those of what is hidden.
    """
    _check(duration, turbulence)
    setup = prepared(name)[0]
    there = jsbsim_effects(name, hidden, seed, duration)
    walk = setup.aircraft.process_noise["wind"] if wind_walk is None else wind_walk
    count = round(duration * JSBSIM_RATE) + 1
    air = _wind(seed, count, JSBSIM_RATE, wind, walk, setup.trim.airspeed, turbulence)
    # at high angles of attack the wing of the aeroplane itself has more than its file says
    chosen = manoeuvres or chosen_plan([identifier for identifier, _ in hidden], seed, avoided=("high_alpha",))
    truth, ground = fly_jsbsim_plan(name, there, chosen, seed, air)
    aircraft = users_aircraft(name, there, plain=not fitted)
    aircraft = aircraft_from_dict({**aircraft.source, "ground_altitude": ground})
    streams, biases = measure(*really(aircraft, there, truth, seed, sensors or SensorOptions()))
    return SimulatedFlight(
        aircraft, seed, (), truth, biases, streams, simulator="jsbsim", hidden=there, manoeuvres=chosen
    )


def hidden_flight(
    simulator: str = TEXTBOOK,
    effect: str | None = None,
    strength: float = 1.0,
    seed: int = 0,
    turbulence: str = "none",
    noise_scale: float = 1.0,
    duration: float = 180.0,
    *,
    manoeuvres: str | None = None,
    aircraft: Aircraft | None = None,
    plain: bool = False,
) -> SimulatedFlight:
    """A flight for the proof of the diagnosis: one hidden effect, or none; all else is drawn from the seed.

    simulator: "textbook", or an aeroplane of JSBSim (jsbsim_flight.MODELS). ``aircraft`` of the result is what the
    user has, ``samples`` what was recorded, ``hidden`` and ``oracle`` the truth. Without ``manoeuvres``
    (varied_plan.PLANS) a kind of flight is drawn that shows the effect; a clean one goes wherever its file is right.
    plain: the file of a JSBSim aeroplane has the 32 terms alone. Raises InputError where the simulator cannot show the
    effect.
    """
    rng = generator(seed, "hidden flight")
    known = (aircraft or default_aircraft()) if simulator == TEXTBOOK else prepared(simulator)[0].aircraft
    if effect == "compressibility" and aircraft is None:
        known = fast_aeroplane(known)
    level, direction = rng.uniform(0.0, 0.25) * trim_airspeed_of(known), rng.uniform(0.0, 2.0 * np.pi)
    if manoeuvres is None and effect is None:
        manoeuvres = str(rng.choice(PLANS if simulator == TEXTBOOK else CLEAN_PLANS))
    common: dict[str, Any] = {
        "wind": (level * np.cos(direction), level * np.sin(direction), 0.0),
        "turbulence": turbulence,
        "hidden": [(effect, strength)] if effect else [],
        "manoeuvres": manoeuvres,
        "sensors": SensorOptions(noise_scale=noise_scale, height_above_ground=True),
    }
    if simulator == TEXTBOOK:
        return simulate_samples(known, seed, duration, **common, rate=HIDDEN_RATE)
    return simulate_jsbsim_samples(simulator, seed, duration, **common, fitted=not plain)


def default_aircraft() -> Aircraft:
    """The aeroplane of simulated flights."""
    return load_aircraft(config_path(DEFAULT_AIRCRAFT))


def _check(duration: float, turbulence: str) -> None:
    if not SHORTEST <= duration <= LONGEST:
        raise InputError(f"a simulated flight lasts {SHORTEST:g} to {LONGEST:g} s, not {duration:g}")
    if turbulence not in TURBULENCE_WIND:
        raise InputError(f"unknown turbulence '{turbulence}': use one of {' '.join(TURBULENCE_WIND)}")


def _wind(
    seed: int, count: int, rate: float, mean: npt.ArrayLike, walk: float, airspeed: float, turbulence: str
) -> npt.NDArray[np.float64]:
    gusts = low_altitude_turbulence(HEIGHT, TURBULENCE_WIND[turbulence]) if turbulence != "none" else None
    return wind_series(generator(seed, "wind"), count, 1.0 / rate, mean, walk, airspeed, gusts)
