"""What may have been meant by a word that nobody knows."""

from __future__ import annotations

import pytest

from aircraft_sysid_ros.spelling import did_you_mean, nearest

KNOWN = ("auto", "rls", "fourier", "rml", "Cl_p")


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("rsl", "rls"),
        ("rm", "rml"),
        ("furier", "fourier"),
        ("Auto", "auto"),
        ("cl_p", "Cl_p"),
        ("kalman", None),
        ("", None),
    ],
)
def test_the_nearest_word_whatever_its_case(word, meant):
    assert nearest(word, KNOWN) == ([meant] if meant else [])


def test_letters_that_changed_places_stand_first_and_nothing_twice():
    assert nearest("rsl", KNOWN, 3) == ["rls", "rml"]


def test_the_question_names_all_that_are_near_and_is_empty_where_none_is():
    assert did_you_mean("rsl", KNOWN, 2, quote="'") == "did you mean 'rls' or 'rml'?"
    assert did_you_mean("kalman", KNOWN) == ""


def test_a_last_part_that_all_have_makes_nothing_alike():
    effects = ("ground_effect", "imu_lag", "gps_lag")
    assert nearest("unknown_effect", effects) == [] and nearest("grund_effect", effects) == ["ground_effect"]
    assert nearest("imv_lag", effects) == ["imu_lag"] and nearest("imu_delay", effects) == ["imu_lag"]
