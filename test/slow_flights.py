"""Flights whose sensors are slow, for tests of several folders: one simulation at 200 Hz, of which samples are kept."""

from __future__ import annotations

from functools import cache

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, simulate_samples

FAST = 200.0  # [Hz]
_AIR = (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP, Kind.AIR)


@cache
def fast_flight(seed: int, duration: float = 120.0) -> SimulatedFlight:
    """All sensors but GPS at 200 Hz; the aircraft file of the estimators says 100 and 50."""
    source = load_aircraft(config_path(DEFAULT_AIRCRAFT)).source
    gps = ("gps_position", "gps_velocity")
    sensors = {n: s if n in gps else {**s, "rate": FAST} for n, s in source["sensors"].items()}
    return simulate_samples(aircraft_from_dict({**source, "sensors": sensors}), seed, duration)


def thinned(
    samples: Samples, rate: float, air: float = 50.0, controls: float = 50.0, jitter: float = 0.0, lost: float = 0.0
) -> Samples:
    """What sensors at these rates [Hz] send; ``jitter`` and ``lost`` are shares of the interval and of the samples."""
    random, keep = np.random.default_rng(17), np.ones(len(samples), np.bool_)
    for kinds, each in (((Kind.IMU,), rate), (_AIR, air), ((Kind.CONTROLS,), controls)):
        at = np.flatnonzero(np.isin(samples.kind, kinds))
        stamps, which = np.unique(samples.stamp[at], return_inverse=True)
        wanted = np.arange(int((stamps[-1] - stamps[0]) * 1e-9 * each)) / each
        wanted = wanted + random.uniform(-jitter, jitter, len(wanted)) / each
        wanted = wanted[random.uniform(size=len(wanted)) >= lost]
        chosen = np.zeros(len(stamps), np.bool_)
        chosen[np.clip(np.rint(wanted * FAST).astype(int), 0, len(stamps) - 1)] = True
        keep[at] = chosen[which]
    return samples[keep]


def all_thinned(samples: Samples, rate: float, jitter: float = 0.0, lost: float = 0.0) -> Samples:
    """All sensors but GPS at one rate [Hz]."""
    return thinned(samples, rate, rate, rate, jitter, lost)


def file_of_users() -> Aircraft:
    """The aircraft file as it is, with other rates than those of the flight."""
    return load_aircraft(config_path(DEFAULT_AIRCRAFT))
