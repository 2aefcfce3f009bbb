"""What a flight can show: near to what replay then uses, and nothing of what did not move or was not measured."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.identifiable import white_noise
from aircraft_sysid_ros.flight_check.signals import NAMES, Stream, flight_of
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples


@pytest.fixture(scope="module")
def flown():
    return simulate_samples(default_aircraft(), 71, 100.0)


def shown(samples: Samples) -> dict[str, bool]:
    checked = check(flight_of(samples, samples.stamp, surface_noise=0.0005))
    return {p.name: p.is_shown for p in checked.parameters}


def without(samples: Samples, kind: Kind, *names: str) -> Samples:
    values = samples.values.copy()
    for name in names:
        values[samples.kind == kind, NAMES[kind].index(name)] = 0.01
    return Samples(samples.stamp, samples.kind, values)


@pytest.mark.long
def test_it_agrees_with_what_replay_uses_of_a_textbook_flight(flown):
    pipeline = Pipeline(flown.aircraft)
    pipeline.push(flown.samples)
    pipeline.flush()
    used = {p.name: p.status.name == "USE" for p in pipeline.parameters.snapshot().parameters}
    found = shown(flown.samples)
    assert found.keys() == used.keys()
    assert sum(found[name] == used[name] for name in used) >= 28


@pytest.mark.long
def test_a_rudder_that_does_not_move_shows_none_of_its_derivatives(flown):
    found = shown(without(flown.samples, Kind.CONTROLS, "rudder"))
    assert not any(found[name] for name in ("CY_dr", "Cl_dr", "Cn_dr")) and found["Cl_da"] and found["Cm_de"]


@pytest.mark.long
def test_what_is_not_measured_is_not_shown_and_the_reason_names_it(flown):
    samples = flown.samples[flown.samples.kind != Kind.SIDESLIP]
    checked = check(flight_of(samples, samples.stamp))
    missing = {p.name: p.reason for p in checked.parameters if "beta" in p.name}
    assert set(missing) == {"CY_beta", "Cl_beta", "Cn_beta"}
    assert all(reason == "sideslip is not measured" for reason in missing.values())


@pytest.mark.long
def test_an_axis_of_which_a_signal_is_missing_is_not_shown_as_replay_holds_it_whole(flown):
    """Without thrust C_X had been shown but for C_X,Tc, and nothing of it was to use."""
    samples = flown.samples
    values = samples.values.copy()
    values[samples.kind == Kind.CONTROLS, NAMES[Kind.CONTROLS].index("thrust")] = np.nan
    bare = Samples(samples.stamp, samples.kind, values)
    pipeline = Pipeline(flown.aircraft)
    pipeline.push(bare)
    pipeline.flush()
    used = {p.name: p.status.name == "USE" for p in pipeline.parameters.snapshot().parameters}
    checked = check(flight_of(bare, bare.stamp, surface_noise=0.0005))
    found = {p.name: (p.is_shown, p.reason) for p in checked.parameters}
    assert not any(used[name] or found[name][0] for name in used if name.startswith("CX"))
    assert found["CX_Tc"][1] == "thrust is not measured"
    assert found["CX_0"][1] == "replay holds all of C_X, whose model reads it: thrust is not measured"
    assert found["CZ_alpha"][0] and found["Cm_de"][0]
    values[bare.kind == Kind.CONTROLS, NAMES[Kind.CONTROLS].index("rudder")] = np.nan
    checked = check(flight_of(bare, bare.stamp, surface_noise=0.0005))
    roll = {p.name: (p.is_shown, p.is_held) for p in checked.parameters if p.name.startswith("Cl_")}
    assert roll["Cl_p"] == roll["Cl_da"] == (False, True)  # it moved well enough
    assert roll["Cl_dr"] == (False, False)


@pytest.mark.long
def test_surfaces_that_move_as_one_are_collinear(flown):
    """A rudder that is half of the aileron, with nothing of its own: neither can be told from the other."""
    samples = flown.samples
    values, rows = samples.values.copy(), samples.kind == Kind.CONTROLS
    values[rows, 2] = 0.5 * values[rows, 1]
    found = shown(Samples(samples.stamp, samples.kind, values))
    assert not found["Cn_dr"] and not found["Cn_da"] and not found["Cl_da"]


@pytest.mark.parametrize("sigma", [0.01, 0.3])
def test_white_noise_is_measured_under_a_slow_motion(sigma):
    time = np.arange(0.0, 100.0, 0.02)
    values = np.sin(time) + sigma * np.random.default_rng(2).standard_normal(len(time))
    stream = Stream(Kind.AIRSPEED, time, np.zeros(len(time)), values[:, None])
    assert white_noise(stream, 0) == pytest.approx(sigma, rel=0.1)
