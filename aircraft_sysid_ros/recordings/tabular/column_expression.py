"""Expressions of columns such as ``sqrt(2*Qc/Rho)``: parsed, checked, evaluated on arrays, never executed as Python.

A column is named as it is where that is a Python name, with dots (``field.twist.linear.x``) or a number in brackets
(``xyz[2]``); any other name stands between backticks: ```Nz [g]` * 9.80665``.
"""

from __future__ import annotations

import ast
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError, echo

Array = npt.NDArray[np.float64]
_FUNCTIONS: dict[str, tuple[Any, int]] = {
    "abs": (np.abs, 1), "sqrt": (np.sqrt, 1), "exp": (np.exp, 1), "log": (np.log, 1), "sign": (np.sign, 1),
    "sin": (np.sin, 1), "cos": (np.cos, 1), "tan": (np.tan, 1), "asin": (np.arcsin, 1), "acos": (np.arccos, 1),
    "atan": (np.arctan, 1), "atan2": (np.arctan2, 2), "radians": (np.radians, 1), "degrees": (np.degrees, 1),
    "min": (np.minimum, 2), "max": (np.maximum, 2),
}  # fmt: skip
_CONSTANTS = {"pi": np.pi}
_OPERATORS: dict[type[ast.operator], Any] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Pow: np.power,
}  # fmt: skip
_QUOTED = re.compile(r"`([^`]*)`")
_STANDS_FOR = "quoted_column_{}_"
_LONGEST = 1000


@dataclass(frozen=True)
class ColumnExpression:
    """A checked expression: its text, the columns that it reads, and its tree."""

    text: str
    columns: tuple[str, ...]
    tree: ast.expr
    quoted: tuple[str, ...]

    def evaluate(self, columns: Mapping[str, Array]) -> Array:
        """Its value (n,) from columns (n,); what is not defined (a root of a negative number) is NaN."""
        with np.errstate(all="ignore"):
            values = _value(self.tree, columns, self.quoted)
        values = np.asarray(values, dtype=np.float64)
        count = max((len(column) for column in columns.values()), default=0)
        return np.where(np.isfinite(values), values, np.nan) + np.zeros(count)


def quoted(column: str) -> str:
    """A column as it stands in an expression: as it is, or between backticks."""
    try:
        is_plain = parse_column_expression(column).columns == (column,)
    except InputError:
        is_plain = False
    return column if is_plain else f"`{column}`"


def parse_column_expression(text: str) -> ColumnExpression:
    """Check an expression; raises InputError that quotes it and says what is allowed."""
    if len(text) > _LONGEST:
        raise InputError(f"the expression '{echo(text)}' is longer than {_LONGEST} characters: shorten it")
    quoted: list[str] = []

    def stand_in(match: re.Match[str]) -> str:
        quoted.append(match.group(1))
        return _STANDS_FOR.format(len(quoted) - 1)

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            tree = ast.parse(_QUOTED.sub(stand_in, text).strip(), mode="eval").body
        names = _columns_of(tree, text, tuple(quoted))
    except (SyntaxError, ValueError, RecursionError, MemoryError, Warning) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"'{echo(text)}' is not an expression: write it like sqrt(2*Qc/Rho), with `…` around other names"
        ) from None
    if not names:
        raise InputError(f"'{echo(text)}' reads no column")
    return ColumnExpression(text, tuple(dict.fromkeys(names)), tree, tuple(quoted))


def _column_name(node: ast.expr, quoted: tuple[str, ...]) -> str | None:
    """The column that a node names, if it names one."""
    if isinstance(node, ast.Name):
        if match := re.fullmatch(r"quoted_column_(\d+)_", node.id):
            return quoted[int(match.group(1))]
        return None if node.id in _CONSTANTS else node.id
    if isinstance(node, ast.Attribute):
        base = _column_name(node.value, quoted)
        return None if base is None else f"{base}.{node.attr}"
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, int):
        base = _column_name(node.value, quoted)
        return None if base is None else f"{base}[{node.slice.value}]"
    return None


def _columns_of(node: ast.expr, text: str, quoted: tuple[str, ...]) -> list[str]:
    """Names of the columns; raises InputError for what is not allowed."""
    name = _column_name(node, quoted)
    if name is not None:
        return [name]
    if isinstance(node, ast.Name):
        return []
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return _checked(node.value, text)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        return _columns_of(node.operand, text, quoted)
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        return _columns_of(node.left, text, quoted) + _columns_of(node.right, text, quoted)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        function = _FUNCTIONS.get(node.func.id)
        if function is None:
            raise InputError(
                f"'{echo(node.func.id)}(…)' in '{echo(text)}' is not allowed: there are {' '.join(_FUNCTIONS)}"
            )
        if len(node.args) != function[1]:
            raise InputError(f"{node.func.id} in '{echo(text)}' takes {function[1]} argument{'s' * (function[1] > 1)}")
        return [name for argument in node.args for name in _columns_of(argument, text, quoted)]
    raise InputError(
        f"'{echo(text)}' has '{echo(ast.unparse(node))}', which is not allowed: use columns, numbers, "
        f"+ - * / ** and {' '.join(_FUNCTIONS)}"
    )


def _checked(value: Any, text: str) -> list[str]:
    if not abs(value) < 1e300:
        raise InputError(f"a number in '{echo(text)}' is not finite")
    return []


def _value(node: ast.expr, columns: Mapping[str, Array], quoted: tuple[str, ...]) -> Any:
    name = _column_name(node, quoted)
    if name is not None:
        return columns[name]
    if isinstance(node, ast.Name):
        return _CONSTANTS[node.id]
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.UnaryOp):
        value = _value(node.operand, columns, quoted)
        return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.BinOp):
        return _OPERATORS[type(node.op)](_value(node.left, columns, quoted), _value(node.right, columns, quoted))
    assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    return _FUNCTIONS[node.func.id][0](*(_value(argument, columns, quoted) for argument in node.args))
