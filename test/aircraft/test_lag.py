"""``lag(x, tau)`` and ``limited(x, rate)`` in terms: the first-order lag of textbooks, and what moves no faster than it
can; the same in batches of any size, started over at gaps.
"""

import numpy as np
import pytest
from scipy.signal import lsim

from aircraft_sysid_ros.aircraft.aerodynamic_model import model_from_terms
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.aircraft.signals import FIRST_LAG, MOST_LAGS, SIGNAL_COUNT, SIGNAL_INDEX
from aircraft_sysid_ros.aircraft.term_values import Memory, evaluate, with_lags
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_model.layout import flight_model_of
from aircraft_sysid_ros.simulation.flight import prepare

TIME = np.arange(0.0, 6.0, 0.02)
ALPHA = 0.1 * np.sin(2.0 * TIME) * np.exp(-0.2 * TIME) + 0.05


def column(text, **signals):
    return evaluate([parse_expression(text)], {"time": TIME, "alpha": ALPHA, **signals})[:, 0]


def rows_of(time, alpha):
    rows = np.full((len(time), SIGNAL_COUNT), np.nan)
    rows[:, SIGNAL_INDEX["time"]], rows[:, SIGNAL_INDEX["alpha"]] = time, alpha
    return rows


@pytest.mark.parametrize("tau", [0.03, 0.4, 5.0])
def test_it_is_the_linear_system_of_scipy(tau):
    """tau y' + y = x from the steady state, for x linear between samples."""
    _, wanted, _ = lsim(([1.0], [tau, 1.0]), ALPHA - ALPHA[0], TIME)
    np.testing.assert_allclose(column(f"lag(alpha,{tau})"), wanted + ALPHA[0], atol=1e-9)


def test_without_time_it_follows_at_once_and_without_motion_it_stays():
    np.testing.assert_array_equal(column("lag(alpha,0)"), ALPHA)
    np.testing.assert_allclose(column("lag(alpha,1e-9)"), ALPHA, atol=1e-8)
    np.testing.assert_allclose(column("lag(alpha*0+0.3,0.5)"), 0.3, rtol=1e-14)


def test_it_stays_between_what_it_follows():
    """A share of something lagged is a share: roots of it exist."""
    share = column("lag(0.5-0.5*tanh((alpha-0.08)/0.001),0.2)")
    assert share.min() >= 0.0 and share.max() <= 1.0


def test_terms_are_made_of_it():
    twice = column("lag(alpha,0.4)*alpha+2*lag(alpha,0.1)")
    np.testing.assert_allclose(twice, column("lag(alpha,0.4)") * ALPHA + 2.0 * column("lag(alpha,0.1)"), rtol=1e-14)
    program = parse_expression("lag( alpha , 0.4 )*beta")
    assert program.text == "lag(alpha,0.4)*beta" and program.signals == {"alpha", "beta"}


def test_a_limited_signal_follows_what_is_slow_and_is_a_ramp_behind_what_is_quick():
    np.testing.assert_array_equal(column("limited(alpha,9)"), ALPHA)  # it never moves so fast
    step = np.where(TIME < 1.0, 0.1, -0.2)
    begun = TIME[np.argmax(TIME >= 1.0) - 1]
    ramp = np.maximum(0.1 - 0.25 * np.maximum(TIME - begun, 0.0), -0.2)
    np.testing.assert_allclose(column("limited(alpha,0.25)", alpha=step), ramp, atol=1e-12)
    np.testing.assert_allclose(column("limited(-alpha,0.25)", alpha=step), -ramp, atol=1e-12)


def test_a_limited_signal_moves_no_faster_and_turns_only_where_it_meets_what_it_follows():
    quick = 0.3 * np.sin(7.0 * TIME) * np.sin(0.9 * TIME)
    moved = column("limited(alpha,0.6)", alpha=quick)
    steps = np.diff(moved) / 0.02
    assert np.max(np.abs(steps)) <= 0.6 * (1.0 + 1e-9)
    behind = np.abs(moved - quick)[1:] > 1e-12
    assert 0.2 < behind.mean() < 0.98
    np.testing.assert_allclose(steps[behind], 0.6 * np.sign(quick - moved)[1:][behind], rtol=1e-9)


def test_batches_of_any_size_give_the_same_bits():
    lags = parse_expression("lag(alpha,0.4)+lag(alpha**2,1)+limited(alpha,0.05)").lags
    whole = with_lags(lags, TIME, rows_of(TIME, ALPHA), 0.1)
    memory, parts = Memory(lags), rows_of(TIME, ALPHA)
    for part in np.split(np.arange(len(TIME)), [1, 2, 50, 51, 200]):
        rows = parts[part]
        memory.write(TIME[part], rows, 0.1)
        parts[part] = rows
    np.testing.assert_array_equal(parts, whole)


def test_after_a_gap_and_after_what_is_not_known_it_begins_anew():
    lags, gap = parse_expression("lag(alpha,0.4)").lags, np.where(TIME > 3.0, TIME + 1.0, TIME)
    after = TIME > 3.0
    both = with_lags(lags, gap, rows_of(gap, ALPHA), 0.1)[:, FIRST_LAG]
    alone = with_lags(lags, gap[after], rows_of(gap[after], ALPHA[after]), 0.1)[:, FIRST_LAG]
    np.testing.assert_array_equal(both[after], alone)
    assert both[after][0] == ALPHA[after][0]
    unknown = np.where(np.abs(TIME - 3.0) < 0.05, np.nan, ALPHA)
    column = with_lags(lags, TIME, rows_of(TIME, unknown), 0.1)[:, FIRST_LAG]
    np.testing.assert_array_equal(np.isnan(column), np.isnan(unknown))
    first = int(np.flatnonzero(np.isnan(unknown))[-1]) + 1
    assert column[first] == unknown[first]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("lag(alpha)", "takes an expression and a time constant"),
        ("lag(alpha,1,2)", "takes an expression and a time constant"),
        ("lag(lag(alpha,1),1)", "a lag within a lag"),
        ("lag(alpha,beta)", "must be a number from 0 to 100 s"),
        ("lag(alpha,-1)", "must be a number from 0 to 100 s"),
        ("lag(alpha,0/0)", "must be a number from 0 to 100 s"),
        ("limited(alpha)", "takes an expression and a rate per s"),
        ("limited(alpha,0)", "must be a number above 0"),
        ("limited(alpha,-0.1)", "must be a number above 0"),
        ("limited(alpha,1/0)", "must be a number above 0"),
        ("limited(alpha,q)", "must be a number above 0"),
        ("limited(lag(alpha,1),1)", "a lag within a lag"),
        ("lag", "is not a signal"),
        ("lag(gamma,1)", "is not a signal"),
    ],
)
def test_what_is_no_lag_is_refused_in_one_sentence(text, why):
    with pytest.raises(InputError, match=why) as raised:
        parse_expression(text)
    assert "\n" not in str(raised.value)


def test_a_model_holds_some_lags():
    texts = [f"lag(alpha,{k + 1})" for k in range(MOST_LAGS)]
    assert [lag.text for lag in model_from_terms({"CZ": texts, "Cm": texts[::-1]}).lags] == texts
    with pytest.raises(InputError, match=f"at most {MOST_LAGS} can be followed"):
        model_from_terms({"CZ": texts, "Cm": ["lag(beta,1)"]})


def test_equations_of_motion_without_its_state_refuse_it(aircraft):
    """Output error, filter error and recursive maximum likelihood say so; the simulator has the state."""
    model = {axis: list(texts) for axis, texts in aircraft.model.terms.items()}
    model["Cm"].append("lag(alpha,0.2)")
    known = {**aircraft.source["coefficients"], "Cm_lag(alpha,0.2)": -0.1}
    lagging = aircraft_from_dict({**aircraft.source, "model": model, "coefficients": known})
    with pytest.raises(InputError, match=r"'lag\(alpha,0.2\)' is a state that"):
        flight_model_of(lagging, 9.81)
    trim = prepare(lagging).trim
    assert trim.state[-1] == pytest.approx(trim.alpha, rel=1e-12) and len(trim.state) == 18
