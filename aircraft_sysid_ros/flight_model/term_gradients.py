"""Terms of the aerodynamic model together with their derivatives: forward differentiation of expression programs.

Each entry of the stack carries its value and its six derivatives, so that the Jacobian of any model is exact and
costs little more than its value.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.postfix import (
    ABS,
    ADD,
    CONSTANT,
    COS,
    DIVIDE,
    EXP,
    MAX,
    MULTIPLY,
    NEGATE,
    POWER,
    SIGNAL,
    SIN,
    SQRT,
    STACK_SIZE,
    SUBTRACT,
    TANH,
    is_undefined,
)  # fmt: skip
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Directions of differentiation: air-relative velocity u, v, w and rates p, q, r.
DIRECTIONS = 6


@njit(cache=True, error_model="numpy")
def _unary(operation: int, a: float, argument: float) -> tuple[float, float]:
    """Value and derivative of a function of one number; at a kink the derivative from the right, or 0."""
    if operation == NEGATE:
        return -a, -1.0
    if operation == POWER:
        n = int(argument)
        below = 1.0
        for _ in range(n - 1):
            below *= a
        return below * a, n * below
    if operation == ABS:
        return abs(a), 1.0 if a >= 0.0 else -1.0
    if operation == SIN:
        return np.sin(a), np.cos(a)
    if operation == COS:
        return np.cos(a), -np.sin(a)
    if operation == EXP:
        return np.exp(a), np.exp(a)
    if operation == SQRT:
        root = np.sqrt(a) if a >= 0.0 else np.nan
        return root, 0.5 / root if root > 0.0 else 0.0
    if operation == TANH:
        t = np.tanh(a)
        return t, 1.0 - t * t
    return np.sign(a), 0.0


@njit(cache=True, error_model="numpy")
def _binary(operation: int, a: float, b: float) -> tuple[float, float, float]:
    """Value and both derivatives of a function of two numbers; where they are equal, max and min take the first."""
    if operation == ADD:
        return a + b, 1.0, 1.0
    if operation == SUBTRACT:
        return a - b, 1.0, -1.0
    if operation == MULTIPLY:
        return a * b, b, a
    if operation == DIVIDE:
        if b == 0.0:
            return np.nan, np.nan, np.nan
        return a / b, 1.0 / b, -a / (b * b)
    first = a >= b if operation == MAX else a <= b
    value = np.maximum(a, b) if operation == MAX else np.minimum(a, b)  # NaN of either
    return (value, 1.0, 0.0) if first else (value, 0.0, 1.0)


@njit(cache=True, error_model="numpy")
def terms_and_gradients(
    code: Array, offsets: Integers, signals: Array, tangents: Array, values: Array, gradients: Array
) -> None:
    """Terms (n,) into ``values`` and their derivatives (n, 6) into ``gradients``, for one row of SIGNALS.

    ``tangents`` (signals, 6): derivatives of the signals. Values are those of postfix.evaluate_terms.
    """
    stack = np.empty(STACK_SIZE)
    slopes = np.empty((STACK_SIZE, DIRECTIONS))
    for k in range(len(offsets) - 1):
        top = -1
        for i in range(offsets[k], offsets[k + 1]):
            operation = int(code[i, 0])
            if operation == CONSTANT:
                top += 1
                stack[top] = code[i, 1]
                slopes[top] = 0.0
            elif operation == SIGNAL:
                top += 1
                index = int(code[i, 1])
                stack[top] = signals[index]
                slopes[top] = tangents[index]
            elif operation in (ADD, SUBTRACT, MULTIPLY, DIVIDE) or operation >= MAX:
                top -= 1
                value, by_a, by_b = _binary(operation, stack[top], stack[top + 1])
                stack[top] = value
                for d in range(DIRECTIONS):
                    slopes[top, d] = by_a * slopes[top, d] + by_b * slopes[top + 1, d]
            else:
                value, slope = _unary(operation, stack[top], code[i, 1])
                stack[top] = value
                for d in range(DIRECTIONS):
                    slopes[top, d] *= slope
        values[k] = stack[0]
        gradients[k] = slopes[0]
        if is_undefined(values[k], code, offsets[k], offsets[k + 1], signals):
            values[k], gradients[k] = 0.0, 0.0
