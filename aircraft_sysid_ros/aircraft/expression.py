"""Regressor expressions such as ``alpha**2`` or ``abs(beta)*da``: parsed, checked, never executed as Python.

An expression is compiled once to a short postfix program (``postfix``), so that a model of any terms costs the same in
flight and in replay.

Two functions have a memory: ``lag(x, tau)``, y with tau y' + y = x, a first-order lag, and ``limited(x, rate)``, what
follows x and moves by no more than ``rate`` in a second, as a servo does (``term_values``).
"""

from __future__ import annotations

import ast
import keyword
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.postfix import (
    ABS,
    ADD,
    CONSTANT,
    COS,
    DIVIDE,
    EXP,
    LAG,
    MAX,
    MIN,
    MULTIPLY,
    NEGATE,
    OF_TWO,
    POWER,
    SIGN,
    SIGNAL,
    SIN,
    SQRT,
    STACK_SIZE,
    SUBTRACT,
    TANH,
    evaluate_program,
)  # fmt: skip
from aircraft_sysid_ros.aircraft.signals import SIGNALS
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.spelling import did_you_mean

#: Longest time constant of a lag [s]: beyond it a flight does not know where it began.
LONGEST_LAG = 100.0

_FUNCTIONS = {
    "abs": (ABS, 1), "sin": (SIN, 1), "cos": (COS, 1), "exp": (EXP, 1), "sqrt": (SQRT, 1),
    "tanh": (TANH, 1), "sign": (SIGN, 1), "max": (MAX, 2), "min": (MIN, 2),
}  # fmt: skip
_WITH_MEMORY = ("lag", "limited")
FUNCTION_NAMES = (*_FUNCTIONS, *_WITH_MEMORY)
_OPERATORS: dict[type[ast.operator], int] = {
    ast.Add: ADD, ast.Sub: SUBTRACT, ast.Mult: MULTIPLY, ast.Div: DIVIDE,
}  # fmt: skip
MAXIMUM_POWER = 9
MAXIMUM_LENGTH = 4000  # what a whole axis says can stand within one term: mass_change has {CX}


@dataclass(frozen=True)
class Program:
    """Postfix program of one expression: ``code`` has shape (n, 2), rows of (operation, argument)."""

    source: str  # as it was written
    code: npt.NDArray[np.float64]
    signals: frozenset[str]  # names of those that it reads, in its lags as well
    lags: tuple[Lag, ...] = ()

    @cached_property
    def text(self) -> str:
        """As all write it, without spaces; made where it is read, which a search for what is missing does not."""
        try:
            return ast.unparse(ast.parse(self.source, mode="eval").body).replace(" ", "")
        except RecursionError:
            raise _nested(self.source) from None


@dataclass(frozen=True)
class Lag:
    """A signal with a memory: y of tau y' + y = x that changes by no more than ``rate`` in a second.

    ``program`` gives x, ``tau`` is in s.
    """

    text: str
    program: Program
    tau: float = 0.0
    rate: float = np.inf


def parse_expression(text: str, inputs: tuple[str, ...] = ()) -> Program:
    """Compile an expression over SIGNALS and the named ``inputs`` of an aircraft, which follow them in a signal row.

    Raises InputError that quotes it and says what is allowed.
    """
    return _parsed(" ".join(str(text).split()), inputs)


@lru_cache(maxsize=4096)  # a search tries the same texts on many fits
def _parsed(text: str, inputs: tuple[str, ...]) -> Program:
    if not text.isprintable():
        raise InputError(f"'{echo(text)}' holds characters that do not print: write it like alpha**2")
    if len(text) > MAXIMUM_LENGTH:
        raise InputError(f"the expression '{echo(text)}' is longer than {MAXIMUM_LENGTH} characters: shorten it")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # what Python only warns of is no expression either
            tree = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        is_cut = text.count("(") > text.count(")")
        cut = ", and put one with a comma in quotes in YAML, as 'lag(da, 0.05)'" if is_cut else ""
        raise InputError(f"'{echo(text)}' is not an expression: write it like alpha**2 or beta*dr{cut}") from None
    rows: list[tuple[float, float]] = []
    lags: list[Lag] = []
    try:
        _compile(tree, rows, text, inputs, lags)
    except RecursionError:
        raise _nested(text) from None
    if _stack_depth(rows) > STACK_SIZE:
        raise _nested(text)
    names = (*SIGNALS, *inputs)
    read = frozenset(names[int(argument)] for operation, argument in rows if operation == SIGNAL)
    read = read.union(*(lag.program.signals for lag in lags))
    return Program(text, np.array(rows, dtype=np.float64), read, tuple(lags))


def _nested(text: str) -> InputError:
    return InputError(f"'{echo(text)}' is nested too deeply: simplify it")


def is_name(text: str) -> bool:
    """Whether a term can have it as the name of a signal."""
    return text.isascii() and text.isidentifier() and not is_reserved(text)


def is_reserved(text: str) -> bool:
    """Whether it is a function of expressions, or a word that the parser takes for another thing than a name."""
    return text in FUNCTION_NAMES or keyword.iskeyword(text)


def _compile(
    node: ast.expr, rows: list[tuple[float, float]], text: str, inputs: tuple[str, ...], lags: list[Lag]
) -> None:
    if isinstance(node, ast.Constant):
        _compile_constant(node, rows, text)
    elif isinstance(node, ast.Name):
        places = _places(inputs)
        if node.id not in places:
            hint = did_you_mean(node.id, places) or f"use one of {' '.join(places)}"
            raise InputError(f"'{echo(node.id)}' in '{echo(text)}' is not a signal: {hint}")
        rows.append((SIGNAL, places[node.id]))
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        _compile(node.operand, rows, text, inputs, lags)
        if isinstance(node.op, ast.USub):
            rows.append((NEGATE, 0.0))
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        _compile(node.left, rows, text, inputs, lags)
        rows.append((POWER, _integer_power(node.right, text)))
    elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        _compile(node.left, rows, text, inputs, lags)
        _compile(node.right, rows, text, inputs, lags)
        rows.append((_OPERATORS[type(node.op)], 0.0))
    elif isinstance(node, ast.Call):
        _compile_call(node, rows, text, inputs, lags)
    else:
        raise InputError(
            f"'{echo(text)}' has '{echo(ast.unparse(node))}', which is not allowed: "
            f"use signals, numbers, + - * / ** and {' '.join(FUNCTION_NAMES)}"
        )


@lru_cache(maxsize=16)
def _places(inputs: tuple[str, ...]) -> dict[str, int]:
    """Places of signals in a signal row, by name."""
    return {name: k for k, name in enumerate((*SIGNALS, *inputs))}


def _compile_constant(node: ast.Constant, rows: list[tuple[float, float]], text: str) -> None:
    if isinstance(node.value, bool) or not isinstance(node.value, (int, float)):
        raise InputError(f"'{echo(repr(node.value))}' in '{echo(text)}' is not a number")
    try:
        value = float(node.value)
    except OverflowError:
        value = float("inf")
    if not np.isfinite(value):
        raise InputError(f"a number in '{echo(text)}' is not finite")
    rows.append((CONSTANT, value))


def _compile_call(
    node: ast.Call, rows: list[tuple[float, float]], text: str, inputs: tuple[str, ...], lags: list[Lag]
) -> None:
    name = node.func.id if isinstance(node.func, ast.Name) else echo(ast.unparse(node.func))
    if name not in FUNCTION_NAMES or node.keywords:
        raise InputError(
            f"'{echo(name)}(…)' in '{echo(text)}' is not allowed: the functions are {' '.join(FUNCTION_NAMES)}"
        )
    if name in _WITH_MEMORY:
        lag = _lag_of(node, name, text, inputs)
        if lag.text not in [other.text for other in lags]:
            lags.append(lag)
        rows.append((LAG, float([other.text for other in lags].index(lag.text))))
        return
    operation, count = _FUNCTIONS[name]
    if len(node.args) != count:
        raise InputError(f"{name} in '{echo(text)}' takes {count} argument{'s' * (count > 1)}")
    for argument in node.args:
        _compile(argument, rows, text, inputs, lags)
    rows.append((operation, 0.0))


def _lag_of(node: ast.Call, name: str, text: str, inputs: tuple[str, ...]) -> Lag:
    """``lag(x, tau)`` or ``limited(x, rate)``, whose second argument is a number and whose x has no memory itself."""
    number, example = {"lag": ("time constant in s", "lag(alpha, 0.2)"), "limited": ("rate per s", "limited(de, 0.5)")}[
        name
    ]
    if len(node.args) != 2:
        raise InputError(f"{name} in '{echo(text)}' takes an expression and a {number}: write it like {example}")
    inner = _parsed(ast.unparse(node.args[0]), inputs)
    if inner.lags:
        raise InputError(f"'{echo(text)}' has a lag within a lag: write two terms instead")
    given = _parsed(ast.unparse(node.args[1]), inputs)
    stack = np.full((STACK_SIZE, 1), np.nan)
    if not (given.signals or given.lags):
        evaluate_program(given.code, 0, len(given.code), np.empty((1, 0)), stack)
    value, whole = float(stack[0, 0]), ast.unparse(node).replace(" ", "")
    if name == "limited":
        if not 0.0 < value < np.inf:
            raise InputError(f"the rate of limited in '{echo(text)}' must be a number above 0, in x per second")
        return Lag(whole, inner, rate=value)
    if not 0.0 <= value <= LONGEST_LAG:
        raise InputError(f"the time constant of lag in '{echo(text)}' must be a number from 0 to {LONGEST_LAG:g} s")
    return Lag(whole, inner, value)


def _integer_power(node: ast.expr, text: str) -> float:
    value = node.value if isinstance(node, ast.Constant) else None
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= MAXIMUM_POWER:
        raise InputError(f"a power in '{echo(text)}' must be a whole number from 1 to {MAXIMUM_POWER}")
    return float(value)


def _stack_depth(rows: Sequence[tuple[float, float]]) -> int:
    depth = deepest = 0
    for operation, _ in rows:
        if operation in (CONSTANT, SIGNAL, LAG):
            depth += 1
        elif operation in OF_TWO:
            depth -= 1
        deepest = max(deepest, depth)
    return deepest
