"""What a controller is given: live, held, or what was known before, moved to without a jump."""

import threading

import numpy as np
import pytest

from aircraft_sysid_ros.consumer import Condition, ConditionTable, Origin, ParameterSource, Prior, Rules, priors_of
from aircraft_sysid_ros.errors import InputError

SECOND = 1_000_000_000
HERE = Condition(17.0, 0.05)
NAMES = ("Cm_0", "Cm_alpha", "Cm_de")
PRIORS = {"Cm_0": Prior(0.0, 0.01), "Cm_alpha": Prior(-1.0, 0.3), "Cm_de": Prior(-1.0, 0.3), "Cm_q": Prior(-8.0, 2.0)}
AT_ONCE = Rules(blend_time=0.0)


@pytest.fixture
def source():
    return ParameterSource(PRIORS, AT_ONCE)


def test_before_any_message_it_answers_with_the_a_priori(source):
    answer = source.at(0, HERE)["Cm_de"]
    assert (answer.value, answer.std, answer.origin) == (-1.0, 0.3, Origin.PRIOR)
    assert answer.reason == "no message came"


def test_a_use_is_live_and_what_the_model_lacks_stays_a_priori(source, content):
    assert source.offer(SECOND, content()) == ""
    values = source.at(2 * SECOND, HERE)
    assert (values["Cm_de"].value, values["Cm_de"].std, values["Cm_de"].origin) == (-0.85, 0.02, Origin.LIVE)
    assert values["Cm_q"].origin == Origin.PRIOR and values["Cm_q"].value == -8.0
    assert values.model == "abc"
    with pytest.raises(KeyError, match="no parameter CX_0"):
        values["CX_0"]


def test_hold_keeps_the_last_good_value_and_reject_falls_back(source, content):
    source.offer(SECOND, content())
    source.offer(2 * SECOND, content(values=(-0.031, -1.1, 3.0), status=(1, 2, 0)))
    values = source.at(2 * SECOND, HERE)
    assert (values["Cm_0"].value, values["Cm_0"].origin, values["Cm_0"].reason) == (-0.03, Origin.HELD, "why")
    assert (values["Cm_alpha"].value, values["Cm_alpha"].origin) == (-1.0, Origin.PRIOR)
    assert values["Cm_alpha"].reason == "rejected: why"
    assert values["Cm_de"].value == 3.0
    nothing = {"values": (np.nan,) * 3, "std": (np.nan,) * 3, "covariance": np.full(9, np.nan)}
    source.offer(3 * SECOND, content(status=(1, 1, 1), **nothing))
    assert source.at(3 * SECOND, HERE)["Cm_alpha"].value == -0.7  # the good value was not forgotten


def test_an_axis_that_does_not_fit_together_is_held(source, content):
    """A stuck vane: C_m,0 with USE has taken over what C_m,alpha explained, which is published near 0 with HOLD."""
    source.offer(SECOND, content())
    stuck = content(values=(-0.08, 0.02, -1.0), std=(0.01, 0.12, 0.1), status=(0, 1, 0))
    source.offer(2 * SECOND, stuck)
    values = source.at(2 * SECOND, HERE)
    assert [values[name].value for name in ("Cm_0", "Cm_alpha", "Cm_de")] == [-0.03, -0.7, -0.85]
    assert {values[name].origin for name in ("Cm_0", "Cm_alpha", "Cm_de")} == {Origin.HELD}
    assert "Cm_alpha is kept at -0.7 and published as 0.02 ± 0.12" in values["Cm_0"].reason
    fitting = content(values=(-0.03, -0.6, -0.42), std=(0.01, 0.12, 0.05), status=(0, 1, 0))
    source.offer(3 * SECOND, fitting)  # an elevator that lost half: what is kept of the axis agrees
    values = source.at(3 * SECOND, HERE)
    assert (values["Cm_de"].value, values["Cm_alpha"].value) == (-0.42, -0.7)
    assert (values["Cm_de"].origin, values["Cm_alpha"].origin) == (Origin.LIVE, Origin.HELD)


def test_an_axis_of_which_a_part_falls_back_to_what_does_not_fit_is_not_live(content):
    """C_m,alpha was learnt at low speed alone, or long ago: what is answered of it is the a-priori value."""
    learnt = {"values": (-0.03, -3.0, -0.85)}  # and a priori -1.0 ± 0.3
    fast = {"airspeed_min": 15.0, "airspeed_max": 30.0}
    source = ParameterSource(PRIORS, AT_ONCE)
    source.offer(SECOND, content(**learnt))
    source.at(2 * SECOND, Condition(28.0, 0.05))
    source.offer(2 * SECOND, content(status=(0, 1, 0), **learnt, **fast))
    values = source.at(2 * SECOND, Condition(28.0, 0.05))
    assert {values[name].origin for name in NAMES} == {Origin.PRIOR}
    source = ParameterSource(PRIORS, Rules(blend_time=0.0, longest_hold=100.0))
    source.offer(SECOND, content(**learnt))
    for second in (60, 150):
        source.at(second * SECOND, HERE)
        source.offer(second * SECOND, content(status=(0, 1, 0), **learnt))
        values = source.at(second * SECOND, HERE)
        assert (values["Cm_0"].origin == Origin.LIVE) == (values["Cm_alpha"].origin == Origin.HELD) == (second == 60)
    assert "Cm_alpha is kept at -1 and published as -3.000 ± 0.020" in values["Cm_0"].reason
    source.offer(151 * SECOND, content(**learnt))
    assert set(source.at(151 * SECOND, HERE).origin[:3]) == {Origin.LIVE}  # known again


def test_another_axis_does_not_matter(content):
    names = ("Cl_p", "Cm_alpha", "Cm_de")
    source = ParameterSource({name: Prior(-0.5, 0.1) for name in names}, AT_ONCE)
    source.offer(SECOND, content(values=(-0.5, -9.0, -0.8), status=(0, 1, 0), names=names))
    values = source.at(SECOND, HERE)
    assert (values["Cl_p"].origin, values["Cm_de"].origin) == (Origin.LIVE, Origin.PRIOR)


def test_never_learnt_says_why(source, content):
    source.offer(SECOND, content(status=(1, 0, 0)))
    assert source.at(SECOND, HERE)["Cm_0"].reason == "never learnt: why"


def test_silence_holds_and_old_age_falls_back(content):
    source = ParameterSource(PRIORS, Rules(silence=3.0, longest_hold=60.0, blend_time=0.0))
    source.offer(0, content())
    origins = [source.at(seconds * SECOND, HERE)["Cm_de"].origin for seconds in (3, 4, 60, 61)]
    assert origins == [Origin.LIVE, Origin.HELD, Origin.HELD, Origin.PRIOR]


def test_outside_of_the_learnt_condition_by_a_margin_it_falls_back(content):
    source = ParameterSource(PRIORS, Rules(airspeed_margin=2.0, angle_margin=0.05, blend_time=0.0))
    source.offer(0, content())  # learnt at 15 to 19 m/s, 0 to 0.12 rad
    far = [Condition(21.5, 0.05), Condition(12.5, 0.05), Condition(17.0, 0.18), Condition(17.0, 0.05, -0.2)]
    near = [Condition(20.5, 0.05), Condition(17.0, 0.16), (17.0, 0.05)]
    assert {source.at(0, c)["Cm_de"].origin for c in far} == {Origin.PRIOR}
    assert "15.0 to 19.0 m/s" in source.at(0, far[0])["Cm_de"].reason
    assert {source.at(0, c)["Cm_de"].origin for c in near} == {Origin.LIVE}


def test_limits_that_are_not_said_limit_nothing(source, content):
    nothing = dict.fromkeys(("airspeed_min", "airspeed_max", "alpha_min", "alpha_max", "beta_min", "beta_max"), np.nan)
    source.offer(0, content(**nothing))
    assert source.at(0, Condition(40.0, 0.3))["Cm_de"].origin == Origin.LIVE


def test_values_move_exponentially_and_what_is_left_counts_into_the_std(content):
    source = ParameterSource(PRIORS, Rules(blend_time=2.0))
    source.at(0, HERE)
    source.offer(0, content())
    for step in range(1, 201):  # however often it is asked
        values = source.at(step * SECOND // 100, HERE)
    expected = -0.85 + (-1.0 + 0.85) * np.exp(-1.0)
    assert values["Cm_de"].value == pytest.approx(expected, rel=1e-9)
    assert values["Cm_de"].std == pytest.approx(np.hypot(0.02, expected + 0.85), rel=1e-9)
    assert source.at(4 * SECOND, HERE)["Cm_de"].value == pytest.approx(-0.85 - 0.15 * np.exp(-2.0), rel=1e-9)


def test_a_refused_message_changes_nothing(source, content):
    source.offer(SECOND, content())
    before = source.at(SECOND, HERE)
    assert "more than once" in source.offer(2 * SECOND, content(names=("Cm_0", "Cm_0", "Cm_de")))
    assert "older than the last" in source.offer(SECOND // 2, content(values=(1.0, 1.0, 1.0)))
    after = source.at(SECOND, HERE)
    assert np.array_equal(before.values, after.values) and np.array_equal(before.origin, after.origin)
    assert (source.taken, source.refused) == (1, 2) and "older" in source.refusal


def test_a_message_that_cannot_be_read_is_refused_not_raised(source, content):
    source.offer(SECOND, content())
    for bad in (None, {}, content(status=("USE", 0, 0)), content(covariance=None)):
        assert source.offer(2 * SECOND, bad) != ""
    assert source.at(SECOND, HERE)["Cm_de"].origin == Origin.LIVE


@pytest.mark.parametrize(
    ("condition", "lacking"),
    [
        (None, "no airspeed has come, no angle of attack has come, no sideslip has come"),
        (Condition(np.nan, 0.05), "no airspeed has come"),
        (Condition(17.0, np.nan), "no angle of attack has come"),
        (Condition(17.0, 0.05, np.nan), "no sideslip has come"),
    ],
)
def test_a_condition_that_is_not_known_is_never_live(source, content, condition, lacking):
    source.offer(SECOND, content())
    answer = source.at(SECOND, condition)["Cm_de"]
    assert (answer.value, answer.origin) == (-0.85, Origin.HELD)
    assert answer.reason == f"the flight condition is not known: {lacking}"
    assert source.at(SECOND, Condition(60.0, np.nan))["Cm_de"].origin == Origin.PRIOR  # what is known is too far
    source.offer(2 * SECOND, content(beta_min=np.nan, beta_max=np.nan))  # learnt without a vane for it
    assert source.at(2 * SECOND, Condition(17.0, 0.05, np.nan))["Cm_de"].origin == Origin.LIVE


def test_air_data_that_come_in_parts_are_put_together(content):
    """As beside a MAVLink bridge: airspeed in one message, both angles in the next; nothing was ever LIVE."""
    table = ConditionTable(tuple(PRIORS))
    source = ParameterSource(PRIORS, AT_ONCE, table)
    source.offer(SECOND, content(), Condition(17.0, np.nan, np.nan))
    assert source.warning
    parts = (Condition(17.0, np.nan, np.nan), Condition(np.nan, 0.05, 0.0))
    origins = [source.at(SECOND + k * SECOND // 50, part)["Cm_de"].origin for k, part in enumerate(parts)]
    assert origins == [Origin.HELD, Origin.LIVE]
    source.offer(2 * SECOND, content(), Condition(17.0, np.nan, np.nan))
    assert not source.warning and len(table) == 1
    answer = source.at(3 * SECOND, Condition(17.0, np.nan, np.nan))["Cm_de"]  # the angles are too old
    assert answer.origin == Origin.HELD
    assert answer.reason == "the flight condition is not known: no angle of attack for 2.0 s, no sideslip for 2.0 s"
    assert source.at(SECOND // 2, None)["Cm_de"].origin == Origin.HELD  # so they are by a clock that started over
    far = source.at(3 * SECOND + SECOND // 2, Condition(np.nan, 0.4, 0.0))["Cm_de"]
    assert far.origin == Origin.PRIOR


def test_what_no_question_ever_has_is_said(source, content):
    source.offer(SECOND, content())
    for second in range(1, 8):
        source.at(second * SECOND, Condition(17.0, 0.05, np.nan))
        assert bool(source.blind) == (second >= 6), second
    assert source.blind.startswith("no sideslip in any question so far")
    source.offer(8 * SECOND, content(beta_min=np.nan, beta_max=np.nan))  # it is not needed
    assert source.blind == ""


def test_what_no_question_has_is_said_though_the_clock_of_the_questions_goes_back(source, content):
    """It was not said until the new clock was past the old one; and at once where the first question had no clock."""
    source.offer(900 * SECOND, content())
    for second in (0, *range(900, 903), *range(10, 14)):
        assert source.blind == "", second
        source.at(second * SECOND, Condition(17.0, 0.05, np.nan))
    assert source.blind.startswith("no sideslip in any question so far")


def test_live_is_near_the_question_before_and_after_it(content):
    source = ParameterSource(PRIORS, Rules(silence=3.0, longest_hold=60.0, blend_time=0.0))
    source.offer(1000 * SECOND, content())
    found = [source.at(seconds * SECOND, HERE)["Cm_de"] for seconds in (997, 996, 940, 939, 5)]
    assert [f.origin for f in found] == [Origin.LIVE, Origin.HELD, Origin.HELD, Origin.PRIOR, Origin.PRIOR]
    assert found[1].reason == "the newest message is 4 s in the future: it is from another clock, or its stamp is wrong"
    with pytest.raises(InputError, match="number of nanoseconds, not nan"):
        source.at(np.nan, HERE)


def test_what_a_new_model_does_not_have_is_dropped_at_once(source, content):
    source.offer(SECOND, content())
    source.offer(
        2 * SECOND, content(values=(-0.03, -0.9), std=(0.002, 0.02), status=(0, 0), names=NAMES[:2], model="d")
    )
    values = source.at(2 * SECOND, HERE)
    assert (values["Cm_alpha"].value, values["Cm_alpha"].origin) == (-0.9, Origin.LIVE)
    assert (values["Cm_de"].value, values["Cm_de"].origin) == (-1.0, Origin.PRIOR)
    assert "the model d does not have it" in values["Cm_de"].reason


@pytest.mark.parametrize("rule", ["silence", "longest_hold", "airspeed_margin", "angle_margin", "blend_time"])
def test_rules_are_numbers_of_at_least_nothing(rule):
    for bad in (np.nan, -1.0):
        with pytest.raises(InputError, match=f"the rule {rule} must be a number of at least 0, not"):
            Rules(**{rule: bad})
    with pytest.raises(InputError, match="blend_time"):
        Rules(blend_time=np.inf)
    assert Rules(longest_hold=np.inf).longest_hold == np.inf


def test_priors_of_an_aircraft_file(aircraft):
    priors = priors_of(aircraft.coefficients)
    assert priors["Cm_de"] == Prior(-0.8488, 0.25 * 0.8488)
    assert priors["Cl_0"] == Prior(0.0005, 0.01)
    with pytest.raises(InputError, match="a-priori value of X must be finite"):
        ParameterSource({"X": Prior(np.nan, 1.0)})


def test_answers_are_of_one_message_whatever_thread_takes_it(content):
    """Every message has all values alike, so that a mixture of two would show."""
    names = ("CX_a", "CX_b", "CX_c")  # nobody has bounds for these
    source = ParameterSource({name: Prior(0.0, 1.0) for name in names}, AT_ONCE)
    source.offer(1, content(values=(1.0,) * 3, names=names))

    def send():
        for k in range(2, 400):
            source.offer(k, content(values=(float(k),) * 3, names=names))

    sender = threading.Thread(target=send)
    sender.start()
    seen = []
    while sender.is_alive():
        seen.append(source.at(1, HERE).values)
    sender.join()
    assert len({tuple(v) for v in seen}) > 1 and source.taken == 399
    assert all(v.min() == v.max() for v in seen)
