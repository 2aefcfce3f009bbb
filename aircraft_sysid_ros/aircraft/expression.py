"""Regressor expressions such as ``alpha**2`` or ``abs(beta)*da``: parsed, checked, never executed as Python.

An expression is compiled once to a short postfix program, which one small numba loop evaluates sample by
sample, so that a model of any terms costs the same in flight and in replay and gives the same bits in both.

Two functions have a memory: ``lag(x, tau)``, y with tau y' + y = x, a first-order lag, and ``limited(x, rate)``, what
follows x and moves by no more than ``rate`` in a second, as a servo does. They are signals that the model makes:
``Memory`` writes them into the signal row, sample by sample, and the program of the term reads them there.
"""

from __future__ import annotations

import ast
import keyword
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.spelling import did_you_mean

#: Signals that a term may read, in the order of a signal row. Rates are normalised: p b/2V, q c/V, r b/2V.
SIGNALS: tuple[str, ...] = (
    "alpha", "beta", "p", "q", "r", "de", "da", "dr", "flaps", "Tc", "throttle", "propeller_speed",
    "V", "qbar", "mach", "height", "alpha_dot", "beta_dot", "time",
)  # fmt: skip
SIGNAL_INDEX = {name: i for i, name in enumerate(SIGNALS)}
#: What a pilot moves, in words.
CONTROL_WORDS = {
    "de": "elevator", "da": "aileron", "dr": "rudder", "flaps": "flaps", "Tc": "thrust", "throttle": "throttle",
    "propeller_speed": "propeller speed",
}  # fmt: skip
SURFACE_WORDS = {name: CONTROL_WORDS[name] for name in ("de", "da", "dr", "flaps")}
#: Signals that an aircraft file may name besides (``inputs:``); they follow SIGNALS in a signal row, in its order.
MOST_INPUTS = 10
#: And so many different ``lag(…)`` and ``limited(…)`` that the terms of a model read; they follow the inputs.
MOST_LAGS = 4
FIRST_LAG = len(SIGNALS) + MOST_INPUTS
SIGNAL_COUNT = FIRST_LAG + MOST_LAGS
#: Longest time constant of a lag [s]: beyond it a flight does not know where it began.
LONGEST_LAG = 100.0

_CONSTANT, _SIGNAL, _ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _NEGATE, _POWER = range(8)
_ABS, _SIN, _COS, _EXP, _SQRT, _TANH, _SIGN, _MAX, _MIN = range(8, 17)
_FUNCTIONS = {
    "abs": (_ABS, 1), "sin": (_SIN, 1), "cos": (_COS, 1), "exp": (_EXP, 1), "sqrt": (_SQRT, 1),
    "tanh": (_TANH, 1), "sign": (_SIGN, 1), "max": (_MAX, 2), "min": (_MIN, 2),
}  # fmt: skip
_LAG = 17  # argument: number among the lags of its own program
_WITH_MEMORY = ("lag", "limited")
FUNCTION_NAMES = (*_FUNCTIONS, *_WITH_MEMORY)
_OPERATORS: dict[type[ast.operator], int] = {
    ast.Add: _ADD, ast.Sub: _SUBTRACT, ast.Mult: _MULTIPLY, ast.Div: _DIVIDE,
}  # fmt: skip
STACK_SIZE = 16
#: Rows that an operation is done on before the next one: their signals stay in the nearest cache.
_SIDE_BY_SIDE = 64
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
        raise InputError(f"'{echo(text)}' is not an expression: write it like alpha**2 or beta*dr") from None
    rows: list[tuple[float, float]] = []
    lags: list[Lag] = []
    try:
        _compile(tree, rows, text, inputs, lags)
    except RecursionError:
        raise _nested(text) from None
    if _stack_depth(rows) > STACK_SIZE:
        raise _nested(text)
    names = (*SIGNALS, *inputs)
    read = frozenset(names[int(argument)] for operation, argument in rows if operation == _SIGNAL)
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
            raise InputError(f"'{echo(node.id)}' in '{echo(text)}' is no signal: {hint}")
        rows.append((_SIGNAL, places[node.id]))
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        _compile(node.operand, rows, text, inputs, lags)
        if isinstance(node.op, ast.USub):
            rows.append((_NEGATE, 0.0))
    elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        _compile(node.left, rows, text, inputs, lags)
        rows.append((_POWER, _integer_power(node.right, text)))
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
    rows.append((_CONSTANT, value))


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
        rows.append((_LAG, float([other.text for other in lags].index(lag.text))))
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
            raise InputError(f"the rate of limited in '{echo(text)}' must be a number above 0, of x in a second")
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
        if operation in (_CONSTANT, _SIGNAL, _LAG):
            depth += 1
        elif operation in (_ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _MAX, _MIN):
            depth -= 1
        deepest = max(deepest, depth)
    return deepest


def lags_of(programs: Sequence[Program]) -> tuple[Lag, ...]:
    """The different lags that programs read, in the order of their signals. Raises InputError beyond MOST_LAGS."""
    found = {lag.text: lag for program in programs for lag in program.lags}
    if len(found) > MOST_LAGS:
        raise InputError(f"the model has {len(found)} different lags: at most {MOST_LAGS} can be followed, remove some")
    return tuple(found.values())


def link(
    programs: Sequence[Program], lags: Sequence[Lag] | None = None
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Join programs for evaluate_programs: code of shape (n, 2) and the offsets (len(programs) + 1,).

    ``lags``: those that the signal rows hold, where they are not those of these programs alone.
    """
    if len(programs) == 1 and not programs[0].lags:
        return programs[0].code, np.array([0, len(programs[0].code)])
    places = {lag.text: FIRST_LAG + k for k, lag in enumerate(lags_of(programs) if lags is None else lags)}
    offsets = np.cumsum([0, *(len(program.code) for program in programs)]).astype(np.int64)
    code = np.vstack([program.code for program in programs]) if programs else np.empty((0, 2))
    for program, first in zip(programs, offsets, strict=False):
        for k, lag in enumerate(program.lags):
            own = code[first : first + len(program.code)]
            own[(own[:, 0] == _LAG) & (own[:, 1] == k)] = (_SIGNAL, places[lag.text])
    return code, offsets


@njit(cache=True)
def evaluate_program(  # noqa: C901  one flat switch is the plainest form
    code: npt.NDArray[np.float64],
    first: int,
    last: int,
    rows: npt.NDArray[np.float64],
    stack: npt.NDArray[np.float64],
) -> None:
    """Values of the program in the rows ``first`` to ``last`` of linked code, on some rows of SIGNALS side by side.

    ``stack`` (STACK_SIZE, at least len(rows)) is working memory; its first row is the result. However many rows there
    are, each meets the same operations.
    """
    count, top = len(rows), -1
    for i in range(first, last):
        operation = int(code[i, 0])
        if operation == _CONSTANT:
            top += 1
            stack[top, :count] = code[i, 1]
            continue
        if operation == _SIGNAL:
            top += 1
            signal = int(code[i, 1])
            for n in range(count):
                stack[top, n] = rows[n, signal]
            continue
        if operation in (_ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _MAX, _MIN):
            top -= 1
        a, b = stack[top], stack[top + 1 if top + 1 < len(stack) else top]
        if operation == _ADD:
            for n in range(count):
                a[n] += b[n]
        elif operation == _SUBTRACT:
            for n in range(count):
                a[n] -= b[n]
        elif operation == _MULTIPLY:
            for n in range(count):
                a[n] *= b[n]
        elif operation == _DIVIDE:
            for n in range(count):
                a[n] = a[n] / b[n] if b[n] != 0.0 else np.nan
        elif operation == _NEGATE:
            for n in range(count):
                a[n] = -a[n]
        elif operation == _POWER:
            for n in range(count):
                base, value = a[n], a[n]
                for _ in range(int(code[i, 1]) - 1):
                    value *= base
                a[n] = value
        elif operation == _ABS:
            for n in range(count):
                a[n] = abs(a[n])
        elif operation == _SIN:
            for n in range(count):
                a[n] = np.sin(a[n])
        elif operation == _COS:
            for n in range(count):
                a[n] = np.cos(a[n])
        elif operation == _EXP:
            for n in range(count):
                a[n] = np.exp(a[n])
        elif operation == _SQRT:
            for n in range(count):
                a[n] = np.sqrt(a[n]) if a[n] >= 0.0 else np.nan
        elif operation == _TANH:
            for n in range(count):
                a[n] = np.tanh(a[n])
        elif operation == _SIGN:
            for n in range(count):
                a[n] = np.sign(a[n])
        elif operation == _MAX:
            for n in range(count):
                a[n] = np.maximum(a[n], b[n])  # NaN of either
        else:
            for n in range(count):
                a[n] = np.minimum(a[n], b[n])


@njit(cache=True)
def evaluate_programs(
    code: npt.NDArray[np.float64],
    offsets: npt.NDArray[np.int64],
    signals: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
) -> None:
    """Evaluate linked programs on one row of SIGNALS, into ``out`` of shape (len(offsets) - 1,)."""
    stack, row = np.empty((STACK_SIZE, 1)), np.expand_dims(signals, 0)
    for k in range(len(offsets) - 1):
        evaluate_program(code, offsets[k], offsets[k + 1], row, stack)
        out[k] = stack[0, 0]


@njit(cache=True)
def reads_signal(code: npt.NDArray[np.float64], first: int, last: int, signal: int) -> bool:
    """Whether the program in the rows ``first`` to ``last`` of linked code reads a signal."""
    found = False
    for i in range(first, last):
        found = found or (int(code[i, 0]) == _SIGNAL and int(code[i, 1]) == signal)
    return found


@njit(cache=True)
def evaluate_rows(
    code: npt.NDArray[np.float64],
    offsets: npt.NDArray[np.int64],
    rows: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
) -> None:
    """``evaluate_programs`` on signal rows, shape (n, SIGNAL_COUNT), into ``out`` (n, len(offsets) - 1)."""
    stack = np.empty((STACK_SIZE, min(_SIDE_BY_SIDE, len(rows))))
    for begin in range(0, len(rows), _SIDE_BY_SIDE):
        part = rows[begin : begin + _SIDE_BY_SIDE]
        for k in range(len(offsets) - 1):
            evaluate_program(code, offsets[k], offsets[k + 1], part, stack)
            for n in range(len(part)):
                out[begin + n, k] = stack[0, n]


@njit(cache=True)
def _moved(place: float, wanted: float, most: float) -> float:
    """A place after it has moved towards the one that is wanted, by so much at most."""
    return wanted if np.isinf(most) or np.isnan(wanted) else min(max(wanted, place - most), place + most)


@njit(cache=True)
def rate_limited(values: npt.NDArray[np.float64], rate: float, step: float) -> npt.NDArray[np.float64]:
    """What follows values (n,) that are ``step`` [s] apart and moves by no more than ``rate`` in a second."""
    out = values.copy()
    for i in range(1, len(values)):
        out[i] = _moved(out[i - 1], values[i], rate * step)
    return out


@njit(cache=True)
def follow_lags(
    code: npt.NDArray[np.float64],
    offsets: npt.NDArray[np.int64],
    taus: npt.NDArray[np.float64],
    rates: npt.NDArray[np.float64],
    times: npt.NDArray[np.float64],
    rows: npt.NDArray[np.float64],
    longest: float,
    memory: npt.NDArray[np.float64],
) -> None:
    """Write the lags into signal rows (n, SIGNAL_COUNT) at ``times`` (n,) [s], going on from ``memory`` (k, 3).

    The exact solution of tau y' + y = x for an x that is linear between rows, and no faster than the rates [1/s].
    ``memory`` holds time, x and y of each lag; what does not follow on within ``longest`` [s], or was NaN, begins in
    the steady state y = x.
    """
    stack = np.empty((STACK_SIZE, 1))
    for i in range(len(rows)):
        for k in range(len(taus)):
            evaluate_program(code, offsets[k], offsets[k + 1], rows[i : i + 1], stack)
            x, (past, x0, y) = stack[0, 0], memory[k]
            step = times[i] - past
            follows_on, most = 0.0 < step <= longest and np.isfinite(y), rates[k] * step
            if not follows_on:
                y = x
            elif taus[k] <= 0.0:
                y = _moved(y, x, most)
            else:
                kept = np.exp(-step / taus[k])
                mean = (1.0 - kept) * taus[k] / step  # of exp(-t / tau) over the step
                y = kept * y + (mean - kept) * x0 + (1.0 - mean) * x
            memory[k, 0], memory[k, 1], memory[k, 2] = times[i], x, y
            rows[i, FIRST_LAG + k] = y


class Memory:
    """What the lags of a model remember of one stretch of flight, row by row, in batches of any size."""

    def __init__(self, lags: Sequence[Lag]) -> None:
        self._code, self._offsets = link([lag.program for lag in lags])
        self._taus = np.array([lag.tau for lag in lags])
        self._rates = np.array([lag.rate for lag in lags])
        self.forget()

    def forget(self) -> None:
        """The next row begins in the steady state."""
        self._state = np.full((len(self._taus), 3), np.nan)

    def write(self, times: npt.NDArray[np.float64], rows: npt.NDArray[np.float64], longest: float) -> None:
        """Lags into signal rows, which follow those before: ``follow_lags``."""
        follow_lags(self._code, self._offsets, self._taus, self._rates, times, rows, longest, self._state)


def with_lags(
    lags: Sequence[Lag], times: npt.NDArray[np.float64], rows: npt.NDArray[np.float64], longest: float
) -> npt.NDArray[np.float64]:
    """Signal rows (n, SIGNAL_COUNT) of a flight in order of time [s] with lags; the rows themselves without any.

    A pause longer than ``longest`` [s] begins anew.
    """
    if not lags:
        return rows
    out = np.array(rows)
    Memory(lags).write(np.ascontiguousarray(times), out, longest)
    return out


def evaluate_signals(
    programs: Sequence[Program], times: npt.NDArray[np.float64], rows: npt.NDArray[np.float64], longest: float
) -> npt.NDArray[np.float64]:
    """Values (n, len(programs)) on the signal rows of a flight in order of time, with lags as ``with_lags``."""
    return values_on(programs, with_lags(lags_of(programs), times, rows, longest))


def values_on(programs: Sequence[Program], rows: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Values (n, len(programs)) on signal rows that hold the lags of these programs."""
    out = np.empty((len(rows), len(programs)))
    evaluate_rows(*link(programs), rows, out)
    return out


def evaluate(
    programs: Sequence[Program], signals: Mapping[str, npt.ArrayLike], inputs: tuple[str, ...] = ()
) -> npt.NDArray[np.float64]:
    """Evaluate programs on arrays of signals: result of shape (n, len(programs)); a missing signal is NaN.

    ``inputs``: names of the aircraft's own, with which the programs were parsed. Lags follow the signal ``time``;
    without it every row is in the steady state.
    """
    size = max((np.size(value) for value in signals.values()), default=1)
    rows = np.full((size, SIGNAL_COUNT), np.nan)
    for name, value in signals.items():
        rows[:, (*SIGNALS, *inputs).index(name)] = value
    return evaluate_signals(programs, rows[:, SIGNAL_INDEX["time"]], rows, np.inf)
