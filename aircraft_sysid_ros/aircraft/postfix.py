"""Postfix programs of regressor expressions, evaluated by one small compiled loop.

A program is rows of (operation, argument). Sample by sample or many rows at once, in flight or in replay, each row
meets the same operations, and the bits are the same.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.kernels import njit

CONSTANT, SIGNAL, ADD, SUBTRACT, MULTIPLY, DIVIDE, NEGATE, POWER = range(8)
ABS, SIN, COS, EXP, SQRT, TANH, SIGN, MAX, MIN = range(8, 17)
LAG = 17  # argument: number among the lags of its own program
#: Operations that take two values from the stack.
OF_TWO = (ADD, SUBTRACT, MULTIPLY, DIVIDE, MAX, MIN)
STACK_SIZE = 16
#: Rows that an operation is done on before the next one: their signals stay in the nearest cache.
_SIDE_BY_SIDE = 64


@njit(cache=True)
def _of_two(operation: int, a: npt.NDArray[np.float64], b: npt.NDArray[np.float64], count: int) -> None:
    """An operation on the first ``count`` values of a and b, into a."""
    if operation == ADD:
        for n in range(count):
            a[n] += b[n]
    elif operation == SUBTRACT:
        for n in range(count):
            a[n] -= b[n]
    elif operation == MULTIPLY:
        for n in range(count):
            a[n] *= b[n]
    elif operation == DIVIDE:
        for n in range(count):
            a[n] = a[n] / b[n] if b[n] != 0.0 else np.nan
    elif operation == MAX:
        for n in range(count):
            a[n] = np.maximum(a[n], b[n])  # NaN of either
    else:
        for n in range(count):
            a[n] = np.minimum(a[n], b[n])


@njit(cache=True)
def _of_one(  # noqa: C901  one flat switch is the plainest form
    operation: int, argument: float, a: npt.NDArray[np.float64], count: int
) -> None:
    """An operation on the first ``count`` values of a, in place."""
    if operation == NEGATE:
        for n in range(count):
            a[n] = -a[n]
    elif operation == POWER:
        for n in range(count):
            base, value = a[n], a[n]
            for _ in range(int(argument) - 1):
                value *= base
            a[n] = value
    elif operation == ABS:
        for n in range(count):
            a[n] = abs(a[n])
    elif operation == SIN:
        for n in range(count):
            a[n] = np.sin(a[n])
    elif operation == COS:
        for n in range(count):
            a[n] = np.cos(a[n])
    elif operation == EXP:
        for n in range(count):
            a[n] = np.exp(a[n])
    elif operation == SQRT:
        for n in range(count):
            a[n] = np.sqrt(a[n]) if a[n] >= 0.0 else np.nan
    elif operation == TANH:
        for n in range(count):
            a[n] = np.tanh(a[n])
    else:
        for n in range(count):
            a[n] = np.sign(a[n])


@njit(cache=True)
def evaluate_program(
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
        if operation == CONSTANT:
            top += 1
            stack[top, :count] = code[i, 1]
        elif operation == SIGNAL:
            top += 1
            signal = int(code[i, 1])
            for n in range(count):
                stack[top, n] = rows[n, signal]
        elif operation in OF_TWO:
            top -= 1
            _of_two(operation, stack[top], stack[top + 1], count)
        else:
            _of_one(operation, code[i, 1], stack[top], count)


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
def is_undefined(
    value: float, code: npt.NDArray[np.float64], first: int, last: int, signals: npt.NDArray[np.float64]
) -> bool:
    """Whether a program has no finite value although all signals that it reads are known: sqrt of what is negative."""
    undefined = not np.isfinite(value)
    for i in range(first, last):
        if undefined and int(code[i, 0]) == SIGNAL and not np.isfinite(signals[int(code[i, 1])]):
            undefined = False
    return undefined


@njit(cache=True)
def _zero_undefined(
    code: npt.NDArray[np.float64],
    offsets: npt.NDArray[np.int64],
    signals: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
) -> None:
    for k in range(len(out)):
        if not np.isfinite(out[k]) and is_undefined(out[k], code, offsets[k], offsets[k + 1], signals):
            out[k] = 0.0


@njit(cache=True)
def evaluate_terms(
    code: npt.NDArray[np.float64],
    offsets: npt.NDArray[np.int64],
    signals: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
) -> None:
    """``evaluate_programs`` for the terms of a model: one that is undefined says nothing, and counts as zero.

    As NaN it would keep its whole axis from learning for as long as it lasts.
    """
    evaluate_programs(code, offsets, signals, out)
    _zero_undefined(code, offsets, signals, out)


@njit(cache=True)
def reads_signal(code: npt.NDArray[np.float64], first: int, last: int, signal: int) -> bool:
    """Whether the program in the rows ``first`` to ``last`` of linked code reads a signal."""
    found = False
    for i in range(first, last):
        found = found or (int(code[i, 0]) == SIGNAL and int(code[i, 1]) == signal)
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
def evaluate_term_rows(
    code: npt.NDArray[np.float64],
    offsets: npt.NDArray[np.int64],
    rows: npt.NDArray[np.float64],
    out: npt.NDArray[np.float64],
) -> None:
    """``evaluate_terms`` on signal rows, shape (n, SIGNAL_COUNT), into ``out`` (n, len(offsets) - 1)."""
    evaluate_rows(code, offsets, rows, out)
    for i in range(len(rows)):
        _zero_undefined(code, offsets, rows[i], out[i])
