"""A throttle in the place of a thrust that nobody measures: what it does not tell is named, and no gear or tow line."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight
from aircraft_sysid_ros.diagnosis.search.fit import fits_of
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.identification.conditions import throttle_instead
from aircraft_sysid_ros.samples import CONTROL_COLUMNS, Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

SOME = [BY_ID[name] for name in ("propeller_thrust", "landing_gear", "tow_line", "unrecorded_flaps", "sideslip_drag")]


@pytest.fixture(scope="module")
def flown(aircraft):
    """Samples at several speeds, without the thrust."""
    samples = simulate_samples(aircraft, 31, 100.0, manoeuvres="speeds", turbulence="light").samples
    samples.values[samples.kind == Kind.CONTROLS, CONTROL_COLUMNS.index("Tc")] = np.nan
    return samples


def with_drag(aircraft, *terms):
    source = deepcopy(aircraft.source)
    del source["coefficients"]
    source["model"] = {"CX": [1, "alpha", "alpha**2", "q", "de", *terms]}
    return aircraft_from_dict(source)


MOMENTS = [
    BY_ID[name] for name in ("thrust_offset", "propeller_torque", "alpha_dot", "parameter_change", "control_damage")
]


def without_thrust(aircraft, seed, hidden):
    samples = simulate_samples(aircraft, seed, 100.0, manoeuvres="speeds", turbulence="light", hidden=hidden).samples
    samples.values[samples.kind == Kind.CONTROLS, CONTROL_COLUMNS.index("Tc")] = np.nan
    return samples


@pytest.mark.parametrize(
    ("seed", "effect", "axis"),
    [(41, "thrust_offset", "Cm"), pytest.param(43, "propeller_torque", "Cl", marks=pytest.mark.long)],
)
def test_a_moment_of_the_thrust_is_named_by_the_throttle_alone(aircraft, seed, effect, axis):
    found = diagnose_flight(aircraft, without_thrust(aircraft, seed, [(effect, 1.0)]), MOMENTS, replicas=4).json
    (named,) = [c for c in found["candidates"] if c["found"]]
    assert named["label"].startswith(f"{effect} (by ") and named["main_axis"] == axis
    assert named["error_after"] < 0.3 * named["error_before"]


@pytest.mark.long
def test_without_such_a_moment_none_is_named(aircraft):
    found = diagnose_flight(aircraft, without_thrust(aircraft, 42, []), MOMENTS, replicas=4).json
    assert found["verdict"] == "none" and not found["cannot_show"]


@pytest.mark.long
def test_thrust_that_falls_with_speed_is_named_and_lowers_the_error_to_the_noise(aircraft, flown):
    found = diagnose_flight(with_drag(aircraft, "throttle"), flown, SOME, replicas=4)
    assert found.json["verdict"] == "missing"
    (named,) = [c for c in found.json["candidates"] if c["found"]]
    assert named["effect"] == "propeller_thrust"
    added = found.flight.under(with_drag(aircraft, "throttle", "throttle/qbar", "throttle/V"))
    before, after = (fits_of(flight)[0]["CX"].nrmse_held_out for flight in (found.flight, added))
    assert after < 1.5 * found.diagnosis.floor["CX"] and after < 0.2 * before


@pytest.mark.long
def test_with_the_terms_that_replay_advises_nothing_is_missing(aircraft, flown):
    terms = throttle_instead({"CX": ["Tc"], "CZ": ["alpha"]})
    assert terms == "CX: [throttle/qbar, throttle/V]"
    found = diagnose_flight(with_drag(aircraft, "throttle/qbar", "throttle/V"), flown, SOME, replicas=4)
    assert found.json["verdict"] == "none", found.json["advice"]
