"""A simulated flight in memory: truth, true biases, and the samples as its recording would give them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.ros_conversion import samples_and_rows
from aircraft_sysid_ros.samples import Samples, concatenate
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.flight import HEIGHT, fly, prepare
from aircraft_sysid_ros.simulation.jsbsim_flight import DEFAULT_MODEL, fly_jsbsim, prepare_jsbsim
from aircraft_sysid_ros.simulation.jsbsim_flight import RATE as JSBSIM_RATE
from aircraft_sysid_ros.simulation.manoeuvres import flight_plan
from aircraft_sysid_ros.simulation.sensors import Biases, SensorOptions, Stream, generator, measure
from aircraft_sysid_ros.simulation.truth import Truth
from aircraft_sysid_ros.simulation.wind import TURBULENCE_WIND, low_altitude_turbulence, wind_series

#: Rate [Hz] of the textbook simulation.
RATE = 400.0
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

    @cached_property
    def samples(self) -> Samples:
        """All samples in order of arrival."""
        return arrived(self.streams)


def simulate_samples(
    aircraft: Aircraft,
    seed: int = 0,
    duration: float = 120.0,
    *,
    wind: npt.ArrayLike = DEFAULT_WIND,
    wind_walk: float | None = None,
    turbulence: str = "none",
    effects: Sequence[Effect] = (),
    sensors: SensorOptions | None = None,
) -> SimulatedFlight:
    """Fly the test flight of manoeuvres.flight_plan and measure it; the same arguments give the same bits.

    wind: mean NED [m/s], the direction the air moves to. wind_walk: its random walk [m/s per sqrt(s)], by
    default the process noise of the aircraft file. turbulence: a key of wind.TURBULENCE_WIND.
    Raises InputError when the aircraft cannot be simulated or the flight does not stay in the air.
    """
    _check(duration, turbulence)
    setup = prepare(aircraft, effects)
    time = np.arange(round(duration * RATE) + 1) / RATE
    walk = aircraft.process_noise["wind"] if wind_walk is None else wind_walk
    air = _wind(seed, len(time), RATE, wind, walk, setup.trim.airspeed, turbulence)
    truth = fly(setup, flight_plan(time, setup.excitation), air)
    streams, biases = measure(aircraft, truth, seed, sensors or SensorOptions())
    return SimulatedFlight(aircraft, seed, tuple(effects), truth, biases, streams)


def simulate_jsbsim_samples(
    name: str = DEFAULT_MODEL,
    seed: int = 0,
    duration: float = 120.0,
    *,
    wind: npt.ArrayLike = DEFAULT_WIND,
    wind_walk: float | None = None,
    turbulence: str = "none",
    sensors: SensorOptions | None = None,
) -> SimulatedFlight:
    """As simulate_samples, with an aeroplane of JSBSim (a key of jsbsim_flight.MODELS) and its physics."""
    _check(duration, turbulence)
    setup = prepare_jsbsim(name)
    walk = setup.aircraft.process_noise["wind"] if wind_walk is None else wind_walk
    count = round(duration * JSBSIM_RATE) + 1
    air = _wind(seed, count, JSBSIM_RATE, wind, walk, setup.trim.airspeed, turbulence)
    truth = fly_jsbsim(setup, air)
    streams, biases = measure(setup.aircraft, truth, seed, sensors or SensorOptions())
    return SimulatedFlight(setup.aircraft, seed, (), truth, biases, streams, simulator="jsbsim")


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


def arrived(streams: Sequence[Stream]) -> Samples:
    """Samples of all streams in order of arrival; those of one message stay together."""
    batches: list[Samples] = []
    keys: list[npt.NDArray[np.int64]] = []
    for number, stream in enumerate(streams):
        for part, (samples, rows) in enumerate(samples_and_rows(stream.topic, stream.stamp, stream.fields)):
            batches.append(samples)
            same = np.ones(len(rows), dtype=np.int64)
            keys.append(np.stack([part * same, rows, number * same, stream.arrival[rows]]))
    return concatenate(batches)[np.lexsort(np.concatenate(keys, axis=1))]
