"""What both nodes share: topic of the commands, checked parameters, noticing silence, how a node is made and ended."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import rclpy
from one_process import LARGEST_SEED
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.nodes import common

COMMANDS, DEPTH = "commanded_surfaces", 5000
#: Silence [s] after which samples, or commands, are said to have stopped: at the slowest rate one comes each 0.1 s.
SILENCE = 1.0
_KINDS = {str: "a text", int: "a whole number", float: "a number"}


@dataclass(frozen=True)
class Wanted:
    """A parameter: its default, whose type it must have, and what it may be."""

    default: str | int | float
    choices: tuple[str, ...] = ()  # of a text; empty: any
    low: float = 0.0
    high: float = LARGEST_SEED
    or_zero: bool = False  # 0 lies below ``low`` but has a meaning

    def checked(self, name: str, value: Any) -> Any:
        """The value, a whole number also for a number; InputError if it is of another type or not allowed."""
        kind = type(self.default)
        if kind is float and type(value) is int:
            value = float(value)
        if type(value) is not kind:
            raise InputError(f"the parameter {name} must be {_KINDS[kind]}, not '{value}'")
        if isinstance(value, str):
            if self.choices and value not in self.choices:
                raise InputError(f"the parameter {name} must be one of {', '.join(self.choices)}, not '{value}'")
        elif not (self.low <= value <= self.high or (self.or_zero and value == 0.0)):
            zero = "0 or " if self.or_zero else ""
            span = f"{zero}from {self.low:.10g} to {self.high:.10g}"
            raise InputError(f"the parameter {name} must be {span}, not {value:.10g}")
        return value


def read_parameters(node: Node, wanted: Mapping[str, Wanted]) -> dict[str, Any]:
    """Declare parameters and return their values; raises InputError."""
    any_type = ParameterDescriptor(dynamic_typing=True)  # what has the wrong type is refused here, in one sentence
    return {
        name: one.checked(name, node.declare_parameter(name, one.default, any_type).value)
        for name, one in wanted.items()
    }


class Silence:
    """Says once when what has come so far stops coming, and when it comes again; by the wall clock."""

    def __init__(self, say: Callable[[str], Any], what: str, limit: float, so: str) -> None:
        """``say`` logs; ``what`` comes no more after ``limit`` [s], ``so`` this is done now."""
        self._say, self._what, self._limit, self._so = say, what, limit, so
        self._newest: float | None = None
        self.is_silent = False

    def heard(self) -> None:
        """It has come, or begins to be waited for."""
        if self.is_silent:
            self._say(f"{self._what} come again after {self.age:.1f} s")
        self._newest, self.is_silent = time.monotonic(), False

    @property
    def age(self) -> float:
        """Time [s] since it came; 0 before the first."""
        return 0.0 if self._newest is None else time.monotonic() - self._newest

    def check(self) -> None:
        """Look whether it has stopped."""
        if not self.is_silent and self.age > self._limit:
            self.is_silent = True
            self._say(f"no {self._what} for {self.age:.1f} s: {self._so}")


def run_node(kind: Callable[[], Any], work: Callable[[Any, Any, threading.Event], int]) -> int:
    """Make a node and let it ``work(node, executor, stop)``: its exit status; 2, and a sentence, for bad arguments."""
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node = kind()
    except (InputError, ParameterException, RuntimeError) as error:  # rclpy: a RuntimeError for each bad argument
        print(" ".join(str(error).split()), file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    try:
        with common.stop_signals() as stop:
            return work(node, common.make_executor([node]), stop)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
