"""A surface that has changed acts in more than one axis, and in the others it may not be enough for an alarm."""

from __future__ import annotations

import pytest

from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.simulation.dynamics import Effect as Term
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

MOMENT = 60.0
STEP = f"max(sign(time-{MOMENT}),0)"


@pytest.mark.long
@pytest.mark.parametrize("seed", [301, 302])
def test_what_half_an_elevator_does_to_the_lift_is_not_taken_from_before(aircraft, seed):
    """C_m shows it at once. C_Z does not: it had USE, three to five of its standard errors from what it was then."""
    c = aircraft.coefficients
    lost = [Term(axis, f"{STEP}*de", -0.5 * c[f"{axis}_de"]) for axis in ("Cm", "CZ")]
    flight = simulate_samples(aircraft, seed, 120.0, effects=lost, manoeuvres="varied")
    pipeline = Pipeline(aircraft, None, ParameterOptions(estimator="rls"))
    pipeline.push(flight.samples)
    pipeline.flush()
    found = {p.name: p for p in pipeline.parameters.snapshot().parameters}
    assert found["Cm_de"].reason.startswith("changed") and found["Cm_de"].status is Trust.USE
    for name in ("Cm_de", "CZ_de"):
        assert abs(found[name].value - 0.5 * c[name]) < 3.0 * found[name].std
    assert abs(found["CZ_alpha"].value - c["CZ_alpha"]) < 4.0 * found["CZ_alpha"].std  # the rest of it is as it was
