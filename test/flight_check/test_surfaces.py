"""What a surface does to the turning, and what the turning does to a surface that an autopilot moves."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.laws import surfaces
from aircraft_sysid_ros.flight_check.signals import SURFACES, flight_of
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
import failure_flights as flights

STEP, COUNT, FINE, LATE = 0.1, 1500, 10, 8  # [s], points, steps of the motion in one, and of those an actuator's delay


def flown(seed, *, by_autopilot):
    """Angular acceleration (n,), a surface (n,) and rate and angle (n, 2) of a weathercock in gusts, at 10 Hz."""
    rng, h = np.random.default_rng(seed), STEP / FINE
    rate, surface, angle, gust = np.zeros(COUNT * FINE), np.zeros(COUNT * FINE), 0.0, 0.0
    pulses = np.repeat(rng.choice([-0.3, 0.3], COUNT), FINE * 4)
    for i in range(LATE, COUNT * FINE):
        gust += -gust / 0.5 * h + np.sqrt(2.0 * h / 0.5) * rng.normal()
        surface[i] = 0.4 * rate[i - LATE] if by_autopilot else pulses[i]
        turning = -2.0 * rate[i - 1] - 4.0 * angle - 6.0 * surface[i - LATE] + 0.8 * gust
        rate[i] = rate[i - 1] + turning * h
        angle += rate[i] * h
    measured = rate[::FINE] + 0.002 * rng.normal(size=COUNT)
    recorded = surface[::FINE] + 0.001 * rng.normal(size=COUNT)
    terms = np.column_stack([measured, np.cumsum(measured) * STEP])
    return np.gradient(measured, STEP), recorded, terms


@pytest.mark.parametrize("seed", range(3))
def test_what_follows_the_gyros_is_neither_late_nor_reversed(seed):
    scan = surfaces._scan(*flown(seed, by_autopilot=True), STEP)
    assert scan.is_both_ways or (scan.partial < 0.0 and scan.shift == pytest.approx(0.0, abs=STEP))


@pytest.mark.parametrize("seed", range(3))
def test_what_turns_the_aeroplane_does_so_one_way(seed):
    scan = surfaces._scan(*flown(seed, by_autopilot=False), STEP)
    assert not scan.is_both_ways and scan.partial < -0.5
    assert scan.shift == pytest.approx(LATE * STEP / FINE, abs=STEP)


@pytest.mark.parametrize("pulse", [0.2, 0.4, 0.6])
def test_a_doublet_is_no_autopilot(pulse):
    """What turns back after a while turns the other way at another shift: of all elevators nothing had been said."""
    rng, time = np.random.default_rng(3), np.arange(COUNT) * STEP / 2.0
    starts = np.arange(5.0, time[-1], 8.0)
    surface = sum(
        0.2 * np.sign(np.sin(np.pi * (time - t) / pulse)) * ((time >= t) & (time < t + 4 * pulse)) for t in starts
    )
    turning = -6.0 * surface + 0.3 * rng.normal(size=COUNT)
    scan = surfaces._scan(turning, surface, rng.normal(size=(COUNT, 1)), STEP / 2.0)
    assert not scan.is_both_ways and scan.partial < -0.7 and scan.shift == 0.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "layout", "failure"),
    [
        (6101084, "airspeed, 10 Hz", "rudder"),  # hard over: its command answers the turning
        (6100021, "airspeed, 50 Hz", "rudder"),
        (6102023, "no airspeed, 25 Hz", "none"),  # the aileron leads the turning that it has been moved for
    ],
)
def test_what_an_autopilot_moves_has_neither_the_other_sign_nor_another_time(seed, layout, failure):
    flown = flights.fly(seed, flights.LAYOUTS[layout], failure, moved=True)
    flight = flight_of(flown.samples, flown.samples.stamp, surface_signs=flown.aircraft.surface_signs)
    told = [f for f in check(flight, flown.aircraft.model).findings if f.kind in ("sign", "offset")]
    assert told == []


@pytest.mark.long
@pytest.mark.parametrize("column", range(3))
def test_a_surface_of_the_other_sign_is_told_however_an_autopilot_moves_it(column, aircraft):
    samples = simulate_samples(aircraft, 33, 60.0, turbulence="light", manoeuvres="varied").samples
    samples.values[samples.kind == Kind.CONTROLS, column] *= -1.0
    found = [f for f in check(flight_of(samples, samples.stamp), aircraft.model).findings if f.kind == "sign"]
    assert [f.signals for f in found] == [(SURFACES[column],)]
