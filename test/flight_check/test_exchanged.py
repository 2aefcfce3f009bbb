"""Two vanes or two surfaces in each other's place: named, and taken out before anything else is judged."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.finding import ERROR
from aircraft_sysid_ros.flight_check.signals import SURFACES, flight_of
from aircraft_sysid_ros.flight_check.triple import Triple
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples


@pytest.fixture(scope="module", params=["none", "moderate"])
def samples(request) -> Samples:
    return simulate_samples(default_aircraft(), 51, 90.0, turbulence=request.param).samples


def errors(samples: Samples) -> dict[str, str]:
    found = check(flight_of(samples, samples.stamp, surface_noise=0.0005)).findings
    return {signal: f.sentence for f in found if f.severity == ERROR for signal in f.signals}


def with_vanes_exchanged(samples: Samples) -> Samples:
    kind = samples.kind.copy()
    kind[samples.kind == Kind.ANGLE_OF_ATTACK] = Kind.SIDESLIP
    kind[samples.kind == Kind.SIDESLIP] = Kind.ANGLE_OF_ATTACK
    return Samples(samples.stamp, kind, samples.values)


@pytest.mark.long
def test_each_in_its_own_place_is_none_exchanged(samples):
    assert errors(samples) == {}


@pytest.mark.long
def test_exchanged_vanes_are_named_and_so_in_flight(samples):
    exchanged = with_vanes_exchanged(samples)
    found = errors(exchanged)
    assert found.keys() == {"angle_of_attack", "sideslip"}
    assert "use this one as sideslip" in found["angle_of_attack"]
    pipeline = Pipeline(default_aircraft())
    pipeline.push(exchanged)
    pipeline.flush()
    assert any("use this one as sideslip" in words for words in pipeline.check.words)
    assert not any(p.status.name == "USE" for p in pipeline.parameters.snapshot().parameters)


@pytest.mark.long
@pytest.mark.parametrize(("one", "other"), [("elevator", "rudder"), ("elevator", "aileron"), ("aileron", "rudder")])
def test_exchanged_surfaces_are_named(samples, one, other):
    values, rows = samples.values.copy(), np.flatnonzero(samples.kind == Kind.CONTROLS)
    i, j = SURFACES.index(one), SURFACES.index(other)
    values[rows, i], values[rows, j] = samples.values[rows, j], samples.values[rows, i]
    found = errors(Samples(samples.stamp, samples.kind, values))
    assert found.keys() == {one, other}
    assert f"use this one as {other}" in found[one] and f"use this one as {one}" in found[other]


def test_rates_that_go_together_are_told_by_what_they_leave():
    """Yaw followed roll with -0.6: p and r that were exchanged were both to be reversed."""
    rng = np.random.default_rng(5)
    roll, pitch, yaw = (np.convolve(rng.standard_normal(4000), np.ones(10) / 10.0, "same") for _ in range(3))
    yaw = 0.8 * yaw - 0.6 * roll
    noisy = [signal + 0.01 * rng.standard_normal(4000) for signal in (roll, pitch, yaw)]
    names = ("p", "q", "r")
    assert Triple(names, noisy, (roll, pitch, yaw), 0.05, "").follows == {}
    assert Triple(names, noisy[::-1], (roll, pitch, yaw), 0.05, "").follows == {0: 2, 2: 0}
