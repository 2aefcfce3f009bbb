"""Options, declared once: default, sentence, unit and range.

    @options
    class StateOptions:
        gate: float = option(5.0, "Innovations beyond this are rejected.", "sigma", 2.0, 100.0)

What nodes tell ROS of their parameters, what the command line says of its options, and the tables of the docs are made
of what ``options_of`` reads there.
"""

from __future__ import annotations

import dataclasses
import functools
import typing
from collections.abc import Sequence
from typing import Any, TypeVar

from annotated_types import Ge, Le
from pydantic import ConfigDict, Field, ValidationError
from pydantic.dataclasses import dataclass
from typing_extensions import dataclass_transform

from aircraft_sysid_ros.errors import InputError, echo

Options = TypeVar("Options")

#: A text is no number, neither is NaN, and a name that is not declared is a mistake.
_STRICT = ConfigDict(strict=True, allow_inf_nan=False, extra="forbid")
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


class OptionError(InputError):
    """An option that cannot be: its name, and what is wrong with it in the rest of a sentence."""

    def __init__(self, name: str, what: str) -> None:
        super().__init__(f"{name} {what}")
        self.name, self.what = name, what


@dataclasses.dataclass(frozen=True)
class Option:
    """One option; its values are numbers from ``low`` to ``high``, or some of ``choices``, or anything.

    ``fixed`` says why it cannot change while what is made with it works; empty: it can.
    """

    default: Any
    sentence: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    fixed: str = ""

    @property
    def text(self) -> str:
        """The sentence with the unit."""
        return f"{self.sentence} Unit: {self.unit}." if self.unit else self.sentence

    @property
    def allowed(self) -> str:
        """What a value must be, in words; empty for anything."""
        if self.choices:
            return f"one of {', '.join(self.choices[:-1])} or {self.choices[-1]}"
        if self.low is None or self.high is None:
            return ""
        return f"between {self.low:g} and {self.high:g}" + (f" {self.unit}" if self.unit else "")

    def accept(self, name: str, value: Any) -> None:
        """Raises OptionError for a number out of range, and for what is none of the choices."""
        is_out = self.low is not None and self.high is not None and not self.low <= value <= self.high
        if is_out or (self.choices and value not in self.choices):
            raise self.refusal(name, value)

    def refusal(self, name: str, value: Any) -> OptionError:
        """The error for a value that cannot be."""
        return OptionError(name, f"must be {self.allowed or _WORDS[type(self.default)]}, not {shown(value)}")


def option(
    default: Any, sentence: str, unit: str = "", low: float | None = None, high: float | None = None, fixed: str = ""
) -> Any:
    """The field of an option in a dataclass of pydantic; choices are those of its type, a Literal."""
    return Field(default, description=sentence, ge=low, le=high, json_schema_extra={"unit": unit, "fixed": fixed})


@dataclass_transform(frozen_default=True)
def options(kind: type[Options]) -> type[Options]:
    """Make a class whose fields are options a frozen dataclass; OptionError where a value cannot be."""
    made: Any = dataclass(kind, frozen=True, config=_STRICT)
    check = made.__init__

    @functools.wraps(check)
    def checked(self: Any, *values: Any, **named: Any) -> None:
        try:
            check(self, *values, **named)
        except ValidationError as error:
            raise _translated(kind, error) from None

    made.__init__ = checked
    found: type[Options] = made
    return found


def options_of(kind: type[Any]) -> dict[str, Option]:
    """The options that a class declares, by name."""
    return {name: _option(field) for name, field in kind.__pydantic_fields__.items()}


def _option(field: Any) -> Option:
    low: Any = next((bound.ge for bound in field.metadata if isinstance(bound, Ge)), None)
    high: Any = next((bound.le for bound in field.metadata if isinstance(bound, Le)), None)
    choices = typing.get_args(field.annotation) if typing.get_origin(field.annotation) is typing.Literal else ()
    extra = field.json_schema_extra
    return Option(field.default, field.description, extra["unit"], low, high, choices, extra["fixed"])


def _translated(kind: type[Any], error: ValidationError) -> InputError:
    """The first thing that is wrong, in our words."""
    found = error.errors(include_url=False)[0]
    cause = found.get("ctx", {}).get("error")
    if isinstance(cause, InputError):  # of a check in the class itself
        return cause
    known, place = options_of(kind), found["loc"][0]
    name = list(known)[place] if isinstance(place, int) else place
    if name not in known:
        return OptionError(name, f"is not an option: known are {', '.join(known)}")
    return known[name].refusal(name, found["input"])


def shown(value: Any) -> str:
    """A value as a message shows it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"{value:g}"
    return (
        f"'{echo(value)}'" if isinstance(value, str) else "a list" if isinstance(value, Sequence) else "something else"
    )
