"""A whole simulated flight in memory: truth, true biases, and the samples as reading its recording would give them."""

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
from aircraft_sysid_ros.simulation.manoeuvres import test_flight
from aircraft_sysid_ros.simulation.sensors import Biases, SensorOptions, Stream, generator, measure
from aircraft_sysid_ros.simulation.truth import Truth
from aircraft_sysid_ros.simulation.wind import TURBULENCE_WIND, low_altitude_turbulence, wind_series

#: Rate [Hz] of the simulation.
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
    """Fly the test flight of manoeuvres.test_flight and measure it; the same arguments give the same bits.

    wind: mean NED [m/s], the direction the air moves to. wind_walk: its random walk [m/s per sqrt(s)], by default the
    process noise of the aircraft file. turbulence: a key of wind.TURBULENCE_WIND.
    Raises InputError when the aircraft cannot be simulated or the flight does not stay in the air.
    """
    if not SHORTEST <= duration <= LONGEST:
        raise InputError(f"a simulated flight lasts {SHORTEST:g} to {LONGEST:g} s, not {duration:g}")
    if turbulence not in TURBULENCE_WIND:
        raise InputError(f"unknown turbulence '{turbulence}': use one of {' '.join(TURBULENCE_WIND)}")
    setup = prepare(aircraft, effects)
    time = np.arange(round(duration * RATE) + 1) / RATE
    gusts = low_altitude_turbulence(HEIGHT, TURBULENCE_WIND[turbulence]) if turbulence != "none" else None
    walk = aircraft.process_noise["wind"] if wind_walk is None else wind_walk
    air = wind_series(generator(seed, "wind"), len(time), 1.0 / RATE, wind, walk, setup.trim.airspeed, gusts)
    truth = fly(setup, test_flight(time, setup.excitation), air)
    streams, biases = measure(aircraft, truth, seed, sensors or SensorOptions())
    return SimulatedFlight(aircraft, seed, tuple(effects), truth, biases, streams)


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
