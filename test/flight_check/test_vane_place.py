"""Where a vane is by the roll: gusts that roll the aeroplane are no place of it, and what really is out is found."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.aircraft.unsaid_places import roll_that_shows
from aircraft_sysid_ros.flight_check.in_flight import watch_of
from aircraft_sysid_ros.flight_check.laws import vane_place
from aircraft_sysid_ros.flight_check.laws.vane_place import Vane, findings, sideways, taken
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.signals import flight_of
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, concatenate, samples_of
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

STEP, SPEED, SPAN = 0.02, 55.0, 11.0
UNSAID = Vane(0.0, SPAN, False)


def flown(seed: int, right: float = 0.0, aslant: float = 0.0, gusts: float = 1.5, duration: float = 60.0) -> Motion:
    """A light aeroplane whose surfaces are moved by doublets, an autopilot besides, in gusts [m/s] that last 2 s.

    They come from ``aslant`` [rad] of ahead: along the span the vertical wind grows by tan(aslant) of what it does
    along the way, and the wing rolls with it.
    """
    rng, n, fine = np.random.default_rng(seed), round(duration / STEP), 4
    dt, wind, state = STEP / fine, 0.0, np.zeros(5)  # p, q, angle of attack of the motion, roll, aileron of the pilot
    rows = np.zeros((n, 8))
    for i in range(n):
        pilot = 0.05 * ((i * STEP) % 9.0 < 0.7) - 0.05 * (0.7 <= (i * STEP) % 9.0 < 1.4)
        for _ in range(fine):
            p, q, motion, roll, _ = state
            rate = -wind / 2.0 + gusts * rng.normal() / np.sqrt(dt)  # d(wind)/dt
            alpha = motion + wind / SPEED
            aileron = pilot - 0.05 * roll - 0.05 * p
            elevator = 0.03 * ((i * STEP + 4.0) % 9.0 < 0.7) - 0.05 * q
            lift = 1.8 * alpha  # of the acceleration over the speed
            roll_of_wind = np.tan(aslant) * rate / SPEED
            state = state + dt * np.array(
                [-6.0 * (p + roll_of_wind) + 25.0 * aileron, -9.0 * alpha - 4.0 * q + 12.0 * elevator, q - lift, p, 0.0]
            )
            wind += dt * rate
        p, q, motion, _, _ = state
        alpha = motion + wind / SPEED
        rows[i] = p, q, -1.8 * alpha * SPEED - 9.8, alpha + right * p / SPEED, aileron, elevator, 0.0, SPEED
    stamp = np.round(np.arange(n) * STEP * 1e9).astype(np.int64)
    noise = rng.normal(size=(n, 3)) * [0.003, 0.003, 0.05]
    imu = np.zeros((n, 6))
    imu[:, 3], imu[:, 4], imu[:, 2] = (rows[:, :3] + noise).T
    parts = [
        samples_of(Kind.IMU, stamp, imu),
        samples_of(Kind.AIRSPEED, stamp, rows[:, 7:]),
        samples_of(Kind.ANGLE_OF_ATTACK, stamp, rows[:, 3:4] + 0.001 * rng.normal(size=(n, 1))),
        samples_of(Kind.CONTROLS, stamp, np.column_stack([rows[:, 5], rows[:, 4], np.zeros((n, 5))])),
    ]
    samples = concatenate(parts)
    samples = samples[np.argsort(samples.stamp, kind="stable")]
    return Motion(flight_of(samples, samples.stamp))


@pytest.mark.long
def test_gusts_met_aslant_are_no_place_of_the_vane() -> None:
    """By least squares alone it was metres out on the wing, by five and more of its standard errors."""
    apart = []
    for seed in range(6):
        for aslant in (0.8, -0.8):
            found = sideways(flown(seed, aslant=aslant))
            assert found is not None
            apart.append(found[0] / found[1])
            assert taken(found, UNSAID) is None and not findings(found, UNSAID)
    assert np.sqrt(np.mean(np.square(apart))) < 1.5


@pytest.mark.parametrize(("gusts", "right"), [(0.02, 0.2 * SPAN), (0.02, -0.2 * SPAN), (0.7, 0.4 * SPAN)])
def test_what_is_out_on_the_wing_is_found(gusts: float, right: float) -> None:
    for seed in range(3):
        found = sideways(flown(seed, right, gusts=gusts))
        assert found is not None and abs(found[0] - right) < 3.0 * found[1]
        assert taken(found, UNSAID) is not None


@pytest.mark.long
@pytest.mark.parametrize(("turbulence", "duration"), [("none", 35.0), ("light", 125.0)])
def test_four_tenths_of_half_the_span_are_found_in_calm_air_and_in_gusts(turbulence: str, duration: float) -> None:
    known = default_aircraft().source
    right = 0.4 * 0.5 * known["span"]
    there = aircraft_from_dict({**known, "air_data_position": [0.1, right, 0.0]})
    silent = aircraft_from_dict({key: value for key, value in known.items() if key != "air_data_position"})
    samples = simulate_samples(there, 71, duration, turbulence=turbulence).samples
    found = []
    for block in (333, 1000):
        pipeline = Pipeline(silent)
        for first in range(0, len(samples), block):
            pipeline.push(samples[first : first + block])
        pipeline.flush()
        pipeline.check.finish(pipeline.state.epoch)
        found.append(pipeline.check.vane_place)
    assert found[0] == found[1]  # as they come does not matter
    assert found[0] is not None and abs(found[0][0] - right) < 3.0 * found[0][1] < 0.5 * right


def test_gusts_that_come_from_both_sides_by_turns_leave_less_doubt() -> None:
    """Straight on, and there and back."""
    motion, back = flown(2, aslant=0.8), flown(2, aslant=0.8)
    legs = np.where(np.arange(motion.grid.count) < motion.grid.count // 2, 40.0, -40.0)
    still = np.zeros_like(legs)
    motion.__dict__["velocity"] = np.column_stack([np.abs(legs), still, still])
    back.__dict__["velocity"] = np.column_stack([legs, still, still])
    one_way, both_ways, unknown = sideways(motion), sideways(back), sideways(flown(2, aslant=0.8))
    assert one_way is not None and both_ways is not None and one_way == unknown
    assert both_ways[0] == one_way[0] and both_ways[1] < 0.5 * one_way[1]


def test_the_noise_of_the_vane_is_no_gust() -> None:
    calm = sideways(flown(1, gusts=0.0, aslant=0.8))
    assert calm is not None and abs(calm[0]) < 3.0 * calm[1] < 0.1 * SPAN


def test_a_place_off_the_aeroplane_is_none() -> None:
    beside = (-0.6 * SPAN, 0.05 * SPAN)
    assert taken(beside, UNSAID) is None and not findings(beside, UNSAID)
    assert taken((0.52 * SPAN, 0.05 * SPAN), UNSAID) == (0.5 * SPAN, 0.05 * SPAN)  # at the tip
    assert findings((0.45 * SPAN, 0.05 * SPAN), UNSAID)


@pytest.mark.long
def test_a_place_is_looked_at_again_and_taken_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the first look above three standard errors had found was kept for good."""
    known = default_aircraft()
    silent = aircraft_from_dict({key: value for key, value in known.source.items() if key != "air_data_position"})
    span, looks = silent.span, []
    answers = iter([(0.45 * span, 0.08 * span), (0.02 * span, 0.055 * span), (0.4 * span, 0.07 * span)])

    def answer(motion: Motion) -> tuple[float, float]:
        looks.append(next(answers))
        return looks[-1]

    monkeypatch.setattr(vane_place, "sideways", answer)
    samples = simulate_samples(known, 72, 66.0).samples
    pipeline = Pipeline(silent)
    pipeline.check._enough = np.inf  # looks by time alone
    early = samples.stamp < samples.stamp.min() + 45 * 10**9
    pipeline.push(samples[early])
    assert pipeline.check.vane_place == looks[0] and len(looks) == 1
    assert any("moves like one" in words for words in pipeline.check.words)
    pipeline.push(samples[~early])
    pipeline.flush()
    assert len(looks) == 2 and pipeline.check.vane_place is None and not pipeline.check.findings
    pipeline.check.finish(pipeline.state.epoch)  # a look that is less sure than the one before
    assert len(looks) == 3 and pipeline.check.vane_place is None


@pytest.mark.long
def test_a_vane_is_looked_for_again_once_the_wing_has_rolled(monkeypatch: pytest.MonkeyPatch) -> None:
    """After two minutes of quiet flight the next look would have been at four, and what rolled at three was used."""
    known = default_aircraft()
    silent = aircraft_from_dict({key: value for key, value in known.source.items() if key != "air_data_position"})
    answers = {"when": [], "surest": 0.4}

    def answer(motion: Motion) -> tuple[float, float]:
        answers["when"].append(motion.grid.count * motion.grid.step)
        return 0.4 * silent.span, answers["surest"] * silent.span

    monkeypatch.setattr(vane_place, "sideways", answer)
    samples = simulate_samples(known, 72, 58.0).samples

    def flown(block: int) -> tuple[Pipeline, list[float]]:
        answers["when"], pipeline = [], Pipeline(silent)
        for first in range(0, len(samples), block):
            pipeline.push(samples[first : first + block])
        return pipeline, answers["when"]

    pipeline, looks = flown(1000)
    assert pipeline.check._rolled > 2.0 * roll_that_shows(silent.span)
    assert len(looks) >= 3  # one at 30 s, and one each time that it had rolled twice as much
    assert flown(77)[1] == looks
    answers["surest"] = 0.02
    pipeline, looks = flown(1000)
    assert len(looks) == 1 + (looks[0] < 29.0)  # found at once, and not looked for but at 30 s
    assert pipeline.check.vane_place and any("moves like one" in words for words in pipeline.check.words)


@pytest.mark.long
def test_the_check_sees_what_moves_the_surfaces_as_it_comes() -> None:
    """Not the filter, whose numbers must not depend on who else listens."""
    aircraft = default_aircraft()
    samples = simulate_samples(aircraft, 73, 40.0, turbulence="light").samples
    rows = []
    for part in (samples, samples[samples.kind != Kind.CONTROLS]):
        pipeline = Pipeline(aircraft)
        rows.append(pipeline.push(part)[0])
        seen = concatenate(pipeline.check._waiting).kind == Kind.CONTROLS
        assert seen.any() == (Kind.CONTROLS in part.kind)
    assert np.array_equal(rows[0], rows[1], equal_nan=True)
    assert watch_of(aircraft)._inputs == aircraft.inputs
