"""Terms of a model as functions of JSBSim, element by element.

JSBSim has no tanh, sign or square root in all of its versions: they are written with exp, comparisons and pow.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from xml.etree.ElementTree import Element

_SAME = {"abs": "abs", "sin": "sin", "cos": "cos", "exp": "exp", "max": "max", "min": "min"}
_WITH_MEMORY = ("lag", "limited")
_OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "sum", ast.Sub: "difference", ast.Mult: "product", ast.Div: "quotient",
}  # fmt: skip


def number(value: float) -> Element:
    """A constant, to the last digit."""
    element = Element("value")
    element.text = repr(float(value))
    return element


def prop(name: str) -> Element:
    """A property."""
    element = Element("property")
    element.text = name
    return element


def node(operation: str, *arguments: Element) -> Element:
    """An operation on its arguments."""
    element = Element(operation)
    element.extend(arguments)
    return element


def function_of(text: str, properties: Mapping[str, str], lags: Mapping[str, str]) -> Element:
    """A term (canonical text of ``expression.Program``) with the property of each signal and of each lag.

    It is 0 where a root in it is one of a negative number or something is divided by 0, as it is learnt.
    """
    tree = ast.parse(text, mode="eval").body
    guards = [node(what, _element(part, properties, lags), number(0.0)) for what, part in _conditions(tree)]
    term = _element(tree, properties, lags)
    return node("product", *guards, term) if guards else term


def _conditions(tree: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """How what roots are taken of, and what is divided by, must be to 0; but within lags, elements of their own."""
    name = ast.unparse(tree.func) if isinstance(tree, ast.Call) else ""
    if isinstance(tree, ast.Call) and name == "sqrt":
        yield "ge", tree.args[0]
    if isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Div) and not isinstance(tree.right, ast.Constant):
        yield "nq", tree.right
    if name not in _WITH_MEMORY:
        for child in ast.iter_child_nodes(tree):
            yield from _conditions(child)


def _element(tree: ast.expr, properties: Mapping[str, str], lags: Mapping[str, str]) -> Element:
    def of(part: ast.expr) -> Element:
        return _element(part, properties, lags)

    if isinstance(tree, ast.Constant):
        return number(float(tree.value))  # type: ignore[arg-type]
    if isinstance(tree, ast.Name):
        return prop(properties[tree.id])
    if isinstance(tree, ast.UnaryOp):
        inner = of(tree.operand)
        return node("product", number(-1.0), inner) if isinstance(tree.op, ast.USub) else inner
    if isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Pow):
        return node("pow", of(tree.left), of(tree.right))
    if isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Div) and not isinstance(tree.right, ast.Constant):
        is_zero = node("eq", of(tree.right), number(0.0))
        return node("quotient", of(tree.left), node("sum", of(tree.right), is_zero))
    if isinstance(tree, ast.BinOp):
        return node(_OPERATORS[type(tree.op)], of(tree.left), of(tree.right))
    assert isinstance(tree, ast.Call) and isinstance(tree.func, ast.Name)
    if tree.func.id in _WITH_MEMORY:
        return prop(lags[ast.unparse(tree).replace(" ", "")])
    return _call(tree.func.id, [of(argument) for argument in tree.args])


def _call(name: str, arguments: list[Element]) -> Element:
    if name in _SAME:
        return node(_SAME[name], *arguments)
    (x,) = arguments
    if name == "sqrt":
        return node("pow", node("max", x, number(0.0)), number(0.5))
    if name == "sign":
        return node("difference", node("gt", x, number(0.0)), node("lt", x, number(0.0)))
    # tanh x = 1 - 2 / (exp 2x + 1)
    growing = node("sum", node("exp", node("product", number(2.0), x)), number(1.0))
    return node("difference", number(1.0), node("quotient", number(2.0), growing))
