"""An airspeed in another unit, and one that was turned from a unit that it never had; another scale is none of both."""

import pytest

from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.finding import ERROR
from aircraft_sysid_ros.flight_check.signals import flight_of
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

KNOTS = 1.943844  # in a metre per second


@pytest.mark.parametrize(
    ("factor", "words"),
    [(KNOTS, "it is in knots, divide it by 1.94384"), (1.0 / KNOTS, "read as knots, which it is not"), (0.62, "")],
)
def test_an_airspeed_with_the_factor_of_a_unit(factor, words):
    aircraft = default_aircraft()
    samples = simulate_samples(aircraft, 3, 120.0, manoeuvres="speeds").samples
    values = samples.values.copy()
    values[samples.kind == Kind.AIRSPEED, 0] *= factor
    found = check(flight_of(Samples(samples.stamp, samples.kind, values), samples.stamp), aircraft.model).findings
    told = [f for f in found if f.signals == ("true_airspeed",) and f.kind in ("unit", "scale")]
    units = [f for f in told if f.kind == "unit" and f.severity == ERROR]
    assert [words in f.sentence for f in units] == ([True] if words else []) and told
