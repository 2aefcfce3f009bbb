"""Parameters that depend on the flight condition: interpolated between the places where they were learnt."""

import numpy as np
import pytest

from aircraft_sysid_ros.consumer import Condition, ConditionTable, Origin, ParameterSource, Prior, Rules
from aircraft_sysid_ros.errors import InputError

NAMES = ("Cm_alpha", "Cm_de")
FRESH = np.zeros(2)
STD = np.array([0.01, 0.02])


def filled(places, law):
    """A table that was told the truth at some airspeeds."""
    table = ConditionTable(NAMES, airspeed_bin=3.0)
    for v in places:
        for _ in range(200):
            table.add(law(v), STD, FRESH, Condition(v, 0.05))
    return table


def law(v):
    """Linear in airspeed."""
    return np.array([-0.5 - 0.02 * v, -0.8 + 0.01 * v])


def ask(table, v, alpha=0.05):
    return table.at(np.array([v, alpha, 0.0]), np.full(2, 99.0), np.full(2, 9.0))


def test_it_is_exact_where_it_was_learnt():
    table = filled((14.0, 20.0), law)
    for v in (14.0, 20.0):
        value, std = ask(table, v)
        assert value == pytest.approx(law(v), abs=1e-6) and std == pytest.approx(STD, abs=1e-4)


def test_between_two_places_it_lies_between_and_its_std_covers_both():
    value, std = ask(filled((14.0, 20.0), law), 17.0)
    assert value == pytest.approx(law(17.0), abs=1e-9)
    assert np.all(std >= np.abs(law(20.0) - law(14.0)) / 2)


def test_it_beats_one_value_for_all_conditions():
    table = filled((13.0, 16.0, 19.0, 22.0), law)
    errors = [np.abs(ask(table, v)[0] - law(v)).max() for v in np.linspace(13.0, 22.0, 30)]
    assert max(errors) < 0.5 * np.abs(law(22.0) - law(17.5)).max()


def test_nothing_known_is_passed_through_and_nan_is_no_place():
    table = ConditionTable(NAMES)
    assert ask(table, 17.0)[0].tolist() == [99.0, 99.0]
    table.add(law(17.0), STD, FRESH, Condition(np.nan, 0.05))
    table.add(law(17.0), STD, np.full(2, 10.0), Condition(17.0, 0.05))  # learnt too long ago
    assert len(table) == 0
    table.add(law(17.0), STD, np.array([0.0, 10.0]), Condition(17.0, 0.05))
    assert ask(table, 17.0)[0] == pytest.approx([law(17.0)[0], 99.0])
    assert ask(table, np.nan)[0].tolist() == [99.0, 99.0]


def test_a_bin_that_contradicts_itself_empties_the_others_of_that_parameter():
    table = filled((14.0, 20.0), law)
    damaged = law(20.0) * [1.0, 0.5]
    table.add(damaged, STD, FRESH, Condition(20.0, 0.05))
    value, _ = ask(table, 14.0)
    assert value[0] == pytest.approx(law(14.0)[0], abs=1e-6)  # not contradicted
    assert value[1] == pytest.approx(damaged[1])  # what was known at 14 m/s was of another aeroplane


def test_a_source_interpolates(content):
    priors = {name: Prior(-1.0, 0.5) for name in NAMES}
    source = ParameterSource(priors, Rules(blend_time=0.0, airspeed_margin=9.0), ConditionTable(NAMES))
    for k, v in enumerate((14.0, 20.0)):
        source.offer(k + 1, content(values=(0.0, *law(v))), Condition(v, 0.05))
    middle = source.at(2, Condition(17.0, 0.05))["Cm_alpha"]
    assert middle.value == pytest.approx(law(17.0)[0]) and middle.origin == Origin.LIVE
    assert middle.std > 0.02
    with pytest.raises(InputError, match="size of a bin must be above 0, not 0 m/s"):
        ConditionTable(NAMES, airspeed_bin=0.0)
    with pytest.raises(InputError, match="made for the names"):
        ParameterSource(priors, table=ConditionTable(("CX_0",)))


@pytest.mark.parametrize("condition", [None, Condition(np.nan, 0.05), Condition(17.0, np.nan)])
def test_without_a_condition_the_newest_value_is_the_answer_and_it_is_said(content, condition):
    """What the table held is of before; and it is of another aeroplane, where the newest contradicts it."""
    here = Condition(17.0, 0.05)
    table = ConditionTable(NAMES)
    source = ParameterSource({name: Prior(-1.0, 0.5) for name in NAMES}, Rules(blend_time=0.0), table)
    source.offer(1, content(values=(0.0, -0.5, -0.85)), here)
    assert source.at(1, here)["Cm_de"].value == -0.85 and source.warning == ""
    later = 2_000_000_000  # [ns] what was known of the condition is too old
    source.offer(later, content(values=(0.0, -0.5, -0.42)), condition)
    answer = source.at(later, here)["Cm_de"]
    assert (answer.value, answer.origin) == (-0.42, Origin.LIVE)
    assert "table of flight conditions is not used" in source.warning
    held = content(values=(0.0, -0.5, -0.42), status=(0, 1, 1))
    source.offer(later + 1, held, here)  # nothing new of Cm_de: its bin is still empty, that of Cm_alpha agreed
    assert source.at(later + 1, here)["Cm_de"].value == -0.42 and source.warning == ""
    assert ask(table, 17.0)[0].tolist() == [-0.5, 99.0]


def test_neither_another_clock_nor_another_model_finds_the_table_filled(content):
    here, priors = Condition(17.0, 0.05), {name: Prior(-1.0, 0.5) for name in NAMES}
    for stamps, model in (((1, 2, 3), "abc"), ((101 * 10**9,), "other")):
        table = ConditionTable(NAMES)
        source = ParameterSource(priors, Rules(blend_time=0.0), table)
        source.offer(100 * 10**9, content(), here)
        assert len(table) == 1
        for stamp in stamps:
            source.offer(stamp, content(model=model, status=(1, 1, 1)), here)
        assert len(table) == 0
