"""Samples that come before the states of their time: on the ground, where states stop, and by another clock."""

import numpy as np
import pytest

from aircraft_sysid_ros.identification.coefficients.controls import ControlHistory
from aircraft_sysid_ros.identification.identifier import Identifier, level_flight
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.samples import Kind, Samples, concatenate, samples_of
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft

SECOND = 10**9


def mass(at: float, kilograms: float) -> Samples:
    return samples_of(Kind.MASS, [int(at * SECOND)], np.array([kilograms]))


def controls(begin: float, end: float) -> Samples:
    """100 a second, all of them other ones."""
    at = np.arange(begin, end, 0.01)
    return samples_of(Kind.CONTROLS, np.rint(at * SECOND).astype(np.int64), np.tile(0.1 * np.sin(at)[:, None], (1, 7)))


def one_by_one(estimator: Identifier, samples: Samples, epoch: int | None = 0) -> None:
    for i in range(len(samples)):
        estimator.push_samples(samples[i : i + 1], epoch)


def flown(begin: float, seconds: int) -> np.ndarray:
    return np.vstack([level_flight(default_aircraft(), begin + part) for part in range(0, seconds, 2)])


def test_a_mass_that_was_said_once_counts_after_a_long_stand() -> None:
    """On the ground there are no states. A weighing was forgotten after 10 000 other samples, which came in 40 s, and
    `live` gave a CZ_alpha of -4.6 where the replay of the same flight gave -5.9.
    """
    estimator = Identifier(default_aircraft())
    estimator.push_samples(mass(0.5, 2.5), None)
    one_by_one(estimator, concatenate([controls(1.0, 600.0), samples_of(Kind.HEIGHT, [600 * SECOND], [[0.1]])]), None)
    estimator.push_states(flown(600.0, 4), 0)
    estimator.flush()
    assert estimator.stream.controls.body.mass == 2.5
    assert not estimator.stream.controls.mass_in_words


def test_what_waits_for_states_costs_the_same_however_long_they_stop() -> None:
    """Each sample was sorted into all that waited: after ten minutes without states 100 a second took a whole core."""
    estimator = Identifier(default_aircraft(), ParameterOptions(estimator="rml"))
    estimator.push_states(flown(0.0, 4), 0)
    waiting = controls(4.0, 304.0)
    waiting.kind[::2] = Kind.ANGLE_OF_ATTACK
    one_by_one(estimator, waiting)
    series = estimator.stream.controls._series
    for times in (series[Kind.CONTROLS][0], series[Kind.ANGLE_OF_ATTACK][0], estimator.learning.estimator._times):
        assert 100 < len(times) < 1000


@pytest.mark.parametrize("name", ["rls", "rml"])
def test_what_has_waited_is_used_as_what_has_not(name) -> None:
    """States that come half a minute after their controls give what they give with controls that did not wait."""
    options, rows, moved = ParameterOptions(estimator=name), flown(0.0, 30), controls(0.0, 30.0)
    waited, expected = (Identifier(default_aircraft(), options) for _ in range(2))
    found = []
    for estimator in (waited, expected):
        estimator.push_states(rows[:1], 0)
        if estimator is waited:
            one_by_one(estimator, moved)
        else:
            estimator.push_samples(moved, 0)
        parts = [estimator.push_states(part, 0) for part in np.array_split(rows[1:], 300)]
        found.append(np.vstack([*parts, estimator.flush()]))
    assert np.isfinite(found[0]).all(axis=0).sum() > 70
    assert np.array_equal(*found, equal_nan=True)
    assert waited.late == expected.late == 0


def test_what_waits_is_forgotten_where_the_clock_goes_back() -> None:
    """It is of the flight before: in the next one it would come up when the clock gets there."""
    estimator = Identifier(default_aircraft())
    estimator.push_states(flown(1000.0, 4), 0)
    one_by_one(estimator, controls(1004.0, 1100.0))
    estimator.push_states(flown(1000.0, 10), 0)
    estimator.flush()
    assert not len(estimator.stream.controls._series[Kind.CONTROLS][0])


def test_a_mass_of_the_next_flight_does_not_wait_for_the_clock_of_the_last() -> None:
    """Said when the last states of the flight before were used, and the first of the next had not come yet."""
    estimator = Identifier(default_aircraft())
    estimator.push_states(flown(100.0, 10), 0)
    estimator.flush()
    estimator.push_samples(mass(49.0, 3.0), 0)
    estimator.push_samples(mass(52.0, 4.0), 0)
    estimator.push_states(flown(50.0, 2)[:100], 0)
    estimator.flush()
    assert estimator.stream.controls.body.mass == 3.0
    estimator.push_states(flown(52.0, 2), 0)
    estimator.flush()
    assert estimator.stream.controls.body.mass == 4.0


def test_a_mass_by_a_clock_that_is_ahead_is_said(aircraft) -> None:
    """A weighing by the clock of the wall, of a flight by that of a simulation, never counted, and nobody said so."""
    history = ControlHistory(aircraft, 0.2)
    history.add(mass(1.7e9, 2.5), 0)
    assert not history.mass_in_words
    history.forget_before(100.0)
    assert "1.7e+09 s ahead" in history.mass_in_words and "one clock" in history.mass_in_words
    history.add(mass(100.1, 2.5), 0)
    rows = np.zeros((1, StateField.WIDTH))
    rows[:, StateField.TIME] = 100.2
    assert [body.mass for _, body in history.parts_of_one_mass(rows)] == [2.5]
    assert not history.mass_in_words
