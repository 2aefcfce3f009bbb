"""Controls that were lost while a surface moved: a straight line between those that came is no deflection."""

from __future__ import annotations

import numpy as np
import pytest

from aircraft_sysid_ros.identification.coefficients.controls import ControlHistory
from aircraft_sysid_ros.identification.coefficients.signals import moved_unseen
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.samples import Kind, samples_of
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

SETTLE, STEP, SECOND = 0.2, 0.02, 1_000_000_000
ELEVATOR, AILERON = 0, 1
MOVES_AT = 25  # sample at which the elevator begins to move


def elevator_and_aileron(aircraft, lost=(), step=STEP, moves_by=0.1):
    """Both at the time of each state, where some samples of the controls did not come."""
    numbers = np.array([i for i in range(50) if i not in lost])
    values = np.zeros((len(numbers), 7))
    values[:, ELEVATOR] = np.where(numbers < MOVES_AT, 0.0, moves_by)
    history = ControlHistory(aircraft, SETTLE)
    history.add(samples_of(Kind.CONTROLS, np.rint(numbers * step * SECOND), values), 0)
    rows = np.zeros((98, StateField.WIDTH))
    rows[:, StateField.TIME] = step * (0.25 + 0.5 * np.arange(98))
    return rows[:, StateField.TIME], history.at(rows, False)[0][:, :2]


@pytest.mark.parametrize(
    ("lost", "moves_by", "unseen"),
    [
        ((), 0.1, False),
        ((24,), 0.1, False),
        ((24, 25), 0.1, True),
        ((23, 24, 25), 0.1, True),
        ((23, 24, 25), 0.001, False),  # it stands still within its noise
        ((10, 11, 12), 0.1, False),  # nothing moved then
    ],
)
def test_nobody_knows_when_a_surface_moved(aircraft, lost, moves_by, unseen):
    times, found = elevator_and_aileron(aircraft, lost, moves_by=moves_by)
    known = np.isfinite(found)
    assert known[:, AILERON].all()
    if not unseen:
        assert known[:, ELEVATOR].all()
        return
    begin, end = STEP * (min(lost) - 1), STEP * (max(lost) + 1)
    assert not known[(times > begin) & (times <= end), ELEVATOR].any()
    assert known[(times <= begin) | (times > end + 0.025), ELEVATOR].all()
    assert not known[np.searchsorted(times, end), ELEVATOR]  # states may have been lost with the controls


def test_controls_that_always_come_slowly_are_not_lost(aircraft):
    assert np.isfinite(elevator_and_aileron(aircraft, step=0.06)[1]).all()


def unseen_steps(steps):
    """Of steps [s] in each of which a surface moves, in which of them nobody knows when."""
    times = np.concatenate([[0.0], np.cumsum(steps)])
    middles = times[:-1] + 0.5 * np.diff(times)
    return moved_unseen(times, np.arange(float(len(times)))[:, None], middles, np.array([0.001]), 0.05, SETTLE)[:, 0]


def test_most_of_the_controls_may_be_lost_for_seconds():
    """Beside a busy machine: half of the steps before had been long, so that no step was, and Cm_de came 22 % short."""
    steps = np.array([0.02] * 60 + [0.12, 0.12, 0.2, 0.12, 0.12, 0.06] * 4)
    assert np.array_equal(unseen_steps(steps), steps > 0.05)


def test_controls_that_come_slowly_in_pairs_are_not_lost():
    assert not unseen_steps(np.array([0.001, 0.099] * 40))[4:].any()  # before two have come nobody knows the rate


def test_what_was_lost_does_not_depend_on_the_portions(aircraft):
    """Most of the controls are lost for seconds, and one step decides what is usual."""
    steps = np.array([0.02] * 60 + [0.12] * 72 + [0.2] + [0.02] * 30)
    times, values = np.concatenate([[0.0], np.cumsum(steps)]), np.zeros((len(steps) + 1, 7))
    values[:, ELEVATOR] = 0.3 * np.sin(np.arange(len(values)))
    rows = np.zeros((int(times[-1] / 0.0049) - 62, StateField.WIDTH))
    rows[:, StateField.TIME] = 0.3 + 0.0049 * np.arange(len(rows))

    def controls(parts):
        history, found = ControlHistory(aircraft, SETTLE), []
        history.add(samples_of(Kind.CONTROLS, np.rint(times * SECOND), values), 0)
        for part in np.array_split(rows, parts):
            found.append(history.at(part, False)[0])
            history.forget_before(float(part[-1, StateField.TIME]))
        return np.vstack(found)

    whole = controls(1)
    assert np.isnan(whole[:, ELEVATOR]).any()
    for parts in (7, len(rows)):
        np.testing.assert_array_equal(controls(parts), whole)


def begins_lost(samples):
    """The flight without the samples of the controls with which a surface begins to move."""
    controls = np.flatnonzero(samples.kind == Kind.CONTROLS)
    moves = np.flatnonzero((np.abs(np.diff(samples.values[controls, :3], axis=0)) > 0.01).any(axis=1))
    begins = moves[np.diff(moves, prepend=-9) > 2]
    assert len(begins) > 5
    lost = controls[np.concatenate([begins - 1, begins, begins + 1])]
    return samples[np.setdiff1d(np.arange(len(samples)), lost)]


@pytest.fixture(scope="module")
def flight(aircraft):
    samples = simulate_samples(aircraft, seed=3).samples
    return begins_lost(samples[samples.stamp < samples.stamp[0] + 18 * SECOND])


@pytest.mark.long
def test_what_may_be_used_is_right(aircraft, flight):
    """With straight lines across what was lost Cl_da was 28 standard errors from the truth, and said USE."""
    pipeline, used = Pipeline(aircraft), 0
    for part in np.array_split(np.arange(len(flight)), 90):
        pipeline.push(flight[part])
        for p in pipeline.parameters.snapshot().parameters:
            if p.status == Trust.USE:
                used += 1
                assert abs(p.value - aircraft.coefficients[p.name]) < 5.0 * p.std, p
    assert used > 50


@pytest.mark.long
def test_blocks_of_any_size_give_the_same(aircraft, flight):
    few = flight[: len(flight) // 2]

    def points(size):
        pipeline = Pipeline(aircraft)
        return np.vstack([pipeline.push(few[at : at + size])[1] for at in range(0, len(few), size)])

    whole = points(len(few))
    for size in (1, 61, 1000):
        np.testing.assert_array_equal(points(size), whole)


@pytest.mark.parametrize(("used", "due"), [(8.0, None), (3.0, 8.2)])
def test_a_mass_that_comes_late_counts_from_then_on(aircraft, used, due):
    """By its own stamp it had changed states that were used already, where samples come in large portions."""
    controls = ControlHistory(aircraft, SETTLE)
    controls.forget_before(used)
    mass = samples_of(Kind.MASS, [5 * SECOND], np.array([0.9 * aircraft.mass]))
    controls.add(mass, 0, None if due is None else np.array([int(due * SECOND)]))
    rows = np.zeros((4, StateField.WIDTH))
    rows[:, StateField.TIME] = [6.0, 7.9, 12.0, 13.0]
    parts = controls.parts_of_one_mass(rows)
    assert [(len(part), body.mass / aircraft.mass) for part, body in parts] == [(2, 1.0), (2, pytest.approx(0.9))]
