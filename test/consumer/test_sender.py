"""Whose messages are followed: one wrong stamp changes nothing, a clock that starts over is believed, two are named."""

import numpy as np
import pytest

from aircraft_sysid_ros.consumer import Condition, Origin, ParameterSource, Prior, Rules
from aircraft_sysid_ros.errors import InputError

SECOND = 1_000_000_000
HERE = Condition(17.0, 0.05)
OLD, NEW = (-0.03, -0.7, -0.85), (-0.03, -0.7, -0.42)


@pytest.fixture
def source():
    names = ("Cm_0", "Cm_alpha", "Cm_de")
    return ParameterSource({name: Prior(-1.0, 0.5) for name in names}, Rules(blend_time=1.0))


def elevator(source, seconds):
    return source.at(round(seconds * SECOND), HERE)["Cm_de"]


def settled(source, content, begin=1000, end=1020):
    """A source that has followed messages for a while; the last one is of ``end``."""
    for k in range(begin, end + 1):
        assert source.offer(k * SECOND, content(values=OLD)) == ""
        elevator(source, k)
    assert elevator(source, end).value == pytest.approx(-0.85, abs=1e-6)
    return source


@pytest.mark.parametrize("stamp", [1000, 1, 4600, 2_000_000_000])
def test_one_wrong_stamp_changes_nothing(source, content, stamp):
    settled(source, content)
    refusal = source.offer(stamp * SECOND, content(values=NEW))
    assert "a new clock is accepted after 3 messages in a row" in refusal
    after = elevator(source, 1020.01)
    assert after.value == pytest.approx(-0.85, abs=1e-6) and after.origin == Origin.LIVE
    assert source.offer(1021 * SECOND, content(values=OLD)) == ""
    assert elevator(source, 1021).origin == Origin.LIVE and source.newest.stamp == 1021 * SECOND


def test_a_clock_that_begins_anew_is_believed_once_confirmed_and_answers_blend(source, content):
    settled(source, content)
    before = elevator(source, 1).value
    assert [bool(source.offer(k * SECOND, content(values=NEW))) for k in (1, 2, 3, 4)] == [True, True, False, False]
    values = [before] + [elevator(source, t).value for t in np.arange(1.0, 8.0, 0.01)]
    assert np.abs(np.diff(values)).max() < 0.02 * abs(OLD[2] - NEW[2])  # v' = (target - v) / 1 s, and no jump
    source.offer(7 * SECOND, content(values=NEW))
    assert elevator(source, 8.0).origin == Origin.LIVE
    assert elevator(source, 30.0).value == pytest.approx(NEW[2], abs=1e-6)


def test_a_clock_that_begins_anew_forgets_what_was_good(source, content):
    settled(source, content)
    for k in (1, 2, 3):
        source.offer(k * SECOND, content(status=(1, 1, 1)))
    assert elevator(source, 3).origin == Origin.PRIOR


def test_what_leaps_must_grow_and_nothing_may_come_between(source, content):
    settled(source, content)
    assert all(source.offer(k * SECOND, content(values=NEW)) for k in (3, 2, 1, 2, 2))  # none follows two that grow
    assert source.offer(1021 * SECOND, content()) == ""
    assert all(source.offer(k * SECOND, content(values=NEW)) for k in (5, 6))
    assert "a message 1 s older" in source.offer(1020 * SECOND, content())  # late, and of the old clock
    assert all(source.offer(k * SECOND, content(values=NEW)) for k in (7, 8))
    assert source.newest.stamp == 1021 * SECOND


def test_after_a_silence_the_next_message_is_followed(source, content):
    settled(source, content)
    elevator(source, 1079.5)
    assert source.offer(1080 * SECOND, content(values=OLD)) == ""
    assert elevator(source, 1080).origin == Origin.LIVE


def test_after_a_silence_in_which_nobody_asked_it_is_confirmed(source, content):
    settled(source, content)
    assert [bool(source.offer(k * SECOND, content())) for k in (1080, 1081, 1082)] == [True, True, False]
    assert elevator(source, 1082).origin == Origin.LIVE  # what was good by the same clock was not forgotten


@pytest.mark.parametrize("apart", [-50, 50])
def test_two_senders_of_two_clocks_are_named_and_one_is_followed(source, content, apart):
    refusals, seen = [], []
    for k in range(100, 130):
        assert source.offer(k * SECOND, content(values=OLD)) == ""
        elevator(source, k)
        refusals.append(source.offer((k + apart) * SECOND, content(values=NEW)))
        seen.append(elevator(source, k + 0.5))
    assert all("two senders in turn: give each aircraft a namespace" in text for text in refusals[1:])
    assert {one.origin for one in seen} == {Origin.LIVE}
    assert seen[-1].value == pytest.approx(OLD[2], abs=1e-6)


def test_two_models_by_turns_are_not_mixed(source, content):
    refusals = []
    for k in range(100, 130):
        refusals.append(source.offer(k * SECOND, content(values=OLD, model="a")))
        source.offer(k * SECOND + SECOND // 2, content(values=NEW, model="b"))
        elevator(source, k + 0.5)
    assert all("two senders in turn, of the models b and a" in text for text in refusals[1:])
    assert source.refused == 29 and elevator(source, 129.6).value == pytest.approx(NEW[2], abs=1e-6)


def test_a_model_that_is_changed_and_changed_back_is_followed(source, content):
    found = [bool(source.offer(k * SECOND, content(model=m))) for k, m in enumerate("aabbaaa", start=1)]
    assert found == [False] * 4 + [True, True, False]
    later = ParameterSource({"Cm_de": Prior(-1.0, 0.5)})
    for k, m in enumerate("a" + 12 * "b" + "a", start=1):
        assert later.offer(k * SECOND, content(model=m)) == ""


def test_taking_a_snapshot_raises(source, content):
    settled(source, content)
    with pytest.raises(InputError, match="older than the last"):
        source.take(source.newest)
