"""Expressions: the values that Python gives, and one clear line for everything that is not an expression."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aircraft_sysid_ros.aircraft.expression import MAXIMUM_LENGTH, parse_expression
from aircraft_sysid_ros.aircraft.postfix import STACK_SIZE, evaluate_programs
from aircraft_sysid_ros.aircraft.signals import SIGNALS
from aircraft_sysid_ros.aircraft.term_values import evaluate, link
from aircraft_sysid_ros.errors import InputError

LAWS = settings(max_examples=300, deadline=None, derandomize=True)
VALUES = {name: 0.3 * (i + 1) * (-1.0) ** i for i, name in enumerate(SIGNALS)}
PYTHON = {
    "abs": abs, "sin": math.sin, "cos": math.cos, "exp": math.exp, "tanh": math.tanh, "max": max, "min": min,
    "sqrt": lambda x: math.sqrt(x) if x >= 0.0 else math.nan,
    "sign": lambda x: float(x > 0) - float(x < 0) if not math.isnan(x) else math.nan,
}  # fmt: skip


def value_of(text, **signals):
    columns = {name: np.array([value]) for name, value in signals.items()}
    return float(evaluate([parse_expression(text)], columns)[0, 0])


def expressions(inner):
    return st.one_of(
        st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda a: f"({a[0]}{a[1]}{a[2]})"),
        st.tuples(inner, st.integers(1, 9)).map(lambda a: f"({a[0]})**{a[1]}"),
        st.tuples(st.sampled_from(["abs", "sin", "cos", "tanh", "sign"]), inner).map(lambda a: f"{a[0]}({a[1]})"),
        st.tuples(st.sampled_from(["max", "min"]), inner, inner).map(lambda a: f"{a[0]}({a[1]},{a[2]})"),
        inner.map(lambda a: f"-{a}"),
    )


LEAVES = st.one_of(
    st.sampled_from(SIGNALS), st.integers(0, 20).map(str), st.floats(0.01, 9.0).map(lambda x: f"{x:.3g}")
)
EXPRESSION = st.recursive(LEAVES, expressions, max_leaves=8).filter(lambda text: len(text) <= MAXIMUM_LENGTH)


@pytest.mark.long
@LAWS
@given(EXPRESSION)
def test_values_are_those_of_python(text):
    try:
        expected = float(eval(text, {"__builtins__": {}}, {**VALUES, **PYTHON}))
    except (ZeroDivisionError, OverflowError):
        return  # these are tested below
    got = value_of(text, **VALUES)
    # Powers are products here: a few roundings more.
    assert got == pytest.approx(expected, rel=1e-9, abs=1e-9) or (math.isinf(expected) and got == expected)


@pytest.mark.long
@LAWS
@given(EXPRESSION)
def test_the_canonical_text_parses_to_the_same_program(text):
    program = parse_expression(text)
    again = parse_expression(program.text)
    assert again.text == program.text
    np.testing.assert_array_equal(again.code, program.code)


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("alpha ** 2", "alpha**2"),
        (" (alpha) ", "alpha"),
        ("max( alpha , 0 )", "max(alpha,0)"),
        ("(alpha\n  * da)", "alpha*da"),
        ("1", "1"),
        ("alpha*(beta+1)", "alpha*(beta+1)"),
        ("+alpha", "+alpha"),
    ],
)
def test_canonical_text(text, canonical):
    assert parse_expression(text).text == canonical


BAD = {
    "attribute": "alpha.real",
    "attribute of a number": "(1).__class__",
    "import": "__import__('os').system('true')",
    "unknown function": "log(alpha)",
    "eval": "eval('1')",
    "method": "alpha.conjugate()",
    "call of a call": "abs(alpha)(1)",
    "keyword": "abs(x=alpha)",
    "star": "abs(*alpha)",
    "too many arguments": "abs(alpha, beta)",
    "too few arguments": "max(alpha)",
    "unknown name": "gamma",
    "function without call": "sin",
    "string": "'alpha'",
    "bytes": "b'a'",
    "formatted string": "f'a\\nb'",
    "formatted string called": "f'a\\nb'(1)",
    "bad escape": "'\\d'",
    "none": "None",
    "ellipsis": "...",
    "complex": "1j",
    "lambda": "lambda: 1",
    "walrus": "(x := alpha)",
    "list": "[alpha]",
    "tuple": "alpha, beta",
    "dictionary": "{}",
    "subscript": "alpha[0]",
    "comprehension": "[a for a in alpha]",
    "conditional": "alpha if beta else 1",
    "comparison": "alpha > 0",
    "boolean": "True",
    "boolean operation": "alpha and beta",
    "not": "not alpha",
    "invert": "~alpha",
    "modulo": "alpha % 2",
    "floor division": "alpha // 2",
    "matrix product": "alpha @ beta",
    "shift": "1 << 2",
    "assignment": "alpha = 1",
    "statement": "import os",
    "two statements": "alpha; beta",
    "number run into a word": "1if alpha else 2",
    "zero power": "alpha**0",
    "large power": "alpha**10",
    "huge power": "9**9**9",
    "negative power": "alpha**-1",
    "broken power": "alpha**0.5",
    "power of a signal": "alpha**beta",
    "boolean power": "alpha**True",
    "infinite number": "1e999",
    "not a number": "nan",
    "empty": "",
    "blank": "  \n ",
    "unfinished": "alpha +",
    "unbalanced": "(alpha",
    "null byte": "alpha\0",
    "escape code": "alpha + \x1b[31m",
    "surrogate": "\ud800",
    "line break": "alpha\nbeta",
    "line separator": "alpha\u2028gamma",
    "too long": "alpha+" * (MAXIMUM_LENGTH // 6) + "alpha",
    "nesting bomb": "1+(" * 50 + "1" + ")" * 50,
    "parentheses": "(" * 150 + "1",
    "negations": "not " * 49 + "1",
    "deep calls": "max(1," * 28 + "1" + ")" * 28,
}


@pytest.mark.parametrize("text", BAD.values(), ids=BAD.keys())
def test_what_is_no_expression_is_one_clear_line(text):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError) as raised:
            parse_expression(text)
    message = str(raised.value)
    assert len(message.splitlines()) == 1 and message.isprintable() and len(message) < 600


def test_an_unknown_name_is_quoted_with_what_was_meant_or_the_names_that_there_are():
    with pytest.raises(InputError, match=r"'wing' in 'wing\*\*2' is not a signal: use one of alpha beta"):
        parse_expression("wing**2")
    with pytest.raises(InputError, match=r"'alfa' in 'alfa\*\*2' is not a signal: did you mean alpha\?"):
        parse_expression("alfa**2")


def test_a_chain_of_signs_is_nested_too_deeply_or_right_but_never_a_crash():
    def parse_below(depth):
        return parse_below(depth - 1) if depth else parse_expression("-" * 198 + "1")

    for depth in range(0, 900, 30):
        try:
            assert parse_below(depth).text == "-" * 198 + "1"
        except InputError as error:
            assert "nested too deeply" in str(error)


def test_the_stack_is_used_to_its_last_place_and_no_further():
    fits = "1+(" * (STACK_SIZE - 1) + "alpha" + ")" * (STACK_SIZE - 1)
    assert value_of(fits, alpha=2.0) == STACK_SIZE + 1.0
    with pytest.raises(InputError, match="nested too deeply"):
        parse_expression("1+(" * STACK_SIZE + "alpha" + ")" * STACK_SIZE)


@pytest.mark.parametrize("text", ["1/0", "alpha/beta", "alpha/(beta*0)", "sqrt(-1)", "sqrt(alpha-1)", "0/0"])
def test_what_has_no_value_is_nan(text):
    assert math.isnan(value_of(text, alpha=0.5, beta=0.0))


@pytest.mark.parametrize(
    "text",
    [
        "alpha", "-alpha", "alpha**2", "alpha*0", "beta/alpha", "abs(alpha)", "sign(alpha)", "sqrt(alpha)",
        "exp(alpha)", "tanh(alpha)", "max(alpha,0)", "max(0,alpha)", "min(alpha,0)", "min(0,alpha)",
        "max(beta,alpha)", "min(beta,alpha)",
    ],
)  # fmt: skip
def test_a_signal_that_is_not_measured_makes_its_term_nan(text):
    assert math.isnan(value_of(text, alpha=math.nan, beta=1.0))
    assert math.isnan(value_of(text, beta=1.0))  # nor is one that nobody gave


def test_many_terms_are_evaluated_row_by_row_and_as_linked_code():
    rng = np.random.default_rng(0)
    signals = {name: rng.normal(size=7) for name in SIGNALS}
    programs = [parse_expression(text) for text in ("1", "alpha**3", "abs(beta)*da", "max(q,0)-min(de,0.1)")]
    got = evaluate(programs, signals)
    alpha, beta, da = signals["alpha"], signals["beta"], signals["da"]
    expected = [
        np.ones(7), alpha**3, np.abs(beta) * da, np.maximum(signals["q"], 0) - np.minimum(signals["de"], 0.1),
    ]  # fmt: skip
    np.testing.assert_allclose(got, np.transpose(expected), rtol=1e-14)
    code, offsets = link(programs)
    assert offsets.tolist() == [0, *np.cumsum([len(program.code) for program in programs])]
    out = np.empty(4)
    evaluate_programs(code, offsets, np.array([signals[name][3] for name in SIGNALS]), out)
    np.testing.assert_array_equal(out, got[3])


def test_no_programs_are_no_columns():
    code, offsets = link([])
    assert code.shape == (0, 2) and offsets.tolist() == [0]
    assert evaluate([], {"alpha": np.zeros(3)}).shape == (3, 0)
