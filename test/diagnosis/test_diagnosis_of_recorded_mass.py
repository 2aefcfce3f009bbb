"""Mass properties that a recording has and its aircraft file has not: a diagnosis is as with a file that has them."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct, repeated_rows, settled_flight
from aircraft_sysid_ros.diagnosis.search.fit import fits_of
from aircraft_sysid_ros.diagnosis.significance.bootstrap_flight import world_of
from aircraft_sysid_ros.diagnosis.significance.noise_floor import noise_floor
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import fitted_parameters
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

LOADED = 1.5


def diagnosed(aircraft, samples):
    """What a diagnosis rests on: noise floors of the flight, errors of its replica, and the excess of that."""
    made = reconstruct(aircraft, samples, with_covariance=False)
    data = settled_flight(made)
    fits, _ = fits_of(data)
    floors = [noise_floor(data, axis, fit.fit).nrmse for axis, fit in fits.items()]
    world = world_of(made, repeated_rows(made, 300.0), fitted_parameters(data), seed=0)
    again = reconstruct(world.aircraft, world.samples(0), with_covariance=False)
    return floors, settled_flight(again).measured, world.excess


def test_noise_floor_and_replicas_have_the_recorded_mass(aircraft):
    """Forces of replicas had two thirds of their noise where the recorded mass was 1.5 times that of the file."""
    flown = simulate_samples(aircraft, 1, 25.0).samples
    tensor = aircraft.inertia
    inertia = {"xx": tensor[0, 0], "yy": tensor[1, 1], "zz": tensor[2, 2], "xz": -tensor[0, 2]}
    smaller = {"mass": aircraft.mass / LOADED, "inertia": {key: value / LOADED for key, value in inertia.items()}}
    light = aircraft_from_dict({**aircraft.source, **smaller})
    mass = samples_of(Kind.MASS, [int(flown.stamp.min())], [[aircraft.mass, *inertia.values()]])
    for found, expected in zip(diagnosed(light, concatenate([mass, flown])), diagnosed(aircraft, flown), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
