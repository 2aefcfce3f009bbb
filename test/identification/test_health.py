"""The health watch: a fault has the size that the equations give it, is told from others; noise is none."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.fleet_prior import FleetPrior
from aircraft_sysid_ros.identification.health import FAULTS, HealthWatch, patterns
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS

SHARE = 0.05  # standard deviation of what earlier flights expect, of the value


@pytest.fixture
def watch(aircraft):
    known = {name: (value, SHARE * abs(value) + 1e-4) for name, value in aircraft.coefficients.items()}
    return HealthWatch(aircraft.model, FleetPrior("9 flights of N1", known), aircraft.chord / aircraft.span)


def faulty(aircraft, kind, size):
    """All parameters of an aeroplane with one fault, by the physics that the module states, without its patterns."""
    c, ratio = aircraft.coefficients, aircraft.chord / aircraft.span
    surface = {"elevator_power": "de", "aileron_power": "da", "rudder_power": "dr"}.get(kind)
    found = []
    for name in aircraft.model.parameter_names:
        axis, term = name.split("_", 1)
        value = c[name]
        if kind == "airspeed_scale" and term != "Tc":
            value /= (1.0 + size) ** (1 if term in "pqr" else 2)
        if kind == "mass" and axis in ("CX", "CY", "CZ"):
            value /= 1.0 + size
        if kind == "centre_of_gravity" and axis == "Cm":
            value -= size * c.get(f"CZ_{term}", 0.0)
        if kind == "centre_of_gravity" and axis == "Cn":
            value += size * ratio * c.get(f"CY_{term}", 0.0)
        if term == surface:
            value *= 1.0 + size
        found.append(value)
    return np.array(found)


CASES = [
    ("airspeed_scale", -0.1), ("airspeed_scale", 0.08), ("mass", 0.2), ("centre_of_gravity", 0.1),
    ("elevator_power", -0.5), ("aileron_power", -0.4), ("rudder_power", -0.6),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "size"), CASES)
def test_a_fault_is_found_with_its_size(kind, size, watch, aircraft):
    value = faulty(aircraft, kind, size)
    std, used = 0.01 * np.abs(value) + 1e-4, np.ones(len(value), dtype=bool)
    for look in range(THRESHOLDS.health_looks + 2):
        watch.look(value, std, used, 30.0 + look)
        assert (watch.now is not None) == (look >= THRESHOLDS.health_looks - 1)
    assert watch.now.kinds[0] == kind and watch.now.since == 30.0
    assert watch.now.size == pytest.approx(size, abs=0.25 * abs(size))  # patterns are of first order
    (sentence,) = watch.notes()
    assert sentence.startswith("from 30 s: ") and "compared with 9 flights of N1" in sentence
    assert [found["kinds"][0] for found in watch.json] == [kind] and watch.json[0]["now"]
    for look in range(THRESHOLDS.health_looks):
        watch.look(faulty(aircraft, "", 0.0), std, used, 40.0 + look)
    assert watch.now is None and not watch.json[0]["now"]


def test_noise_is_no_fault(watch, aircraft):
    """A thousand looks at an aeroplane that is as earlier flights expect, within their spread."""
    rng = np.random.default_rng(3)
    mean, said = faulty(aircraft, "", 0.0), 0
    std, used = 0.02 * np.abs(mean) + 1e-4, np.ones(len(mean), dtype=bool)
    spread = np.hypot(std, SHARE * np.abs(mean) + 1e-4)
    for _ in range(1000):
        said += watch._best(mean + spread * rng.normal(size=len(mean)), std, used) is not None
    assert said == 0


def test_what_is_not_to_use_says_nothing(watch, aircraft):
    value = faulty(aircraft, "elevator_power", -0.5)
    for look in range(THRESHOLDS.health_looks + 1):
        watch.look(value, 0.01 * np.abs(value) + 1e-4, np.zeros(len(value), dtype=bool), float(look))
    assert watch.now is None and watch.json == []


def test_without_earlier_flights_there_is_no_watch(aircraft):
    alone = HealthWatch(aircraft.model, None, 0.2)
    for look in range(THRESHOLDS.health_looks + 1):
        value = faulty(aircraft, "mass", 0.3)
        alone.look(value, 0.01 * np.abs(value), np.ones(len(value), dtype=bool), float(look))
    assert alone.notes() == [] and set(FAULTS) == set(patterns(["CZ_alpha", "Cm_alpha"], {}, 0.2))
