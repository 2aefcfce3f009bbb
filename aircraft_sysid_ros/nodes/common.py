"""What the nodes share: parameters from options, quality of service, messages from dictionaries, spinning."""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import importlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.logging import get_logger
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.errors import InputError

NANOSECONDS = 1_000_000_000
#: Period [s] of the diagnostics.
DIAGNOSTICS_PERIOD = 1.0
#: Longest a loop waits for the next message [s] before it looks whether it should stop.
SPIN_TIMEOUT = 0.1


@dataclasses.dataclass(frozen=True)
class Option:
    """Description and range of one ROS parameter."""

    text: str
    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class Choice:
    """Description of one ROS parameter that names one of several things."""

    text: str
    choices: tuple[str, ...]


def declare_options(node: LifecycleNode, defaults: Any, described: Mapping[str, Option | Choice]) -> None:
    """Declare a ROS parameter for every described field of the dataclass instance ``defaults``."""
    for name, option in described.items():
        default = getattr(defaults, name)
        descriptor = ParameterDescriptor(description=option.text)
        if isinstance(option, Choice):
            descriptor.additional_constraints = f"one of {', '.join(option.choices)}"
        elif isinstance(default, int):
            low, high = int(option.low), int(option.high)
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
        else:
            span = FloatingPointRange(from_value=option.low, to_value=option.high)
            descriptor.floating_point_range = [span]
        node.declare_parameter(name, default, descriptor)


def read_options(node: LifecycleNode, kind: Callable[..., Any], described: Mapping[str, Option | Choice]) -> Any:
    """Options of the dataclass ``kind`` from the parameters of the node; raises InputError for a wrong choice."""
    values = {name: node.get_parameter(name).value for name in described}
    for name, option in described.items():
        if isinstance(option, Choice) and values[name] not in option.choices:
            listed = ", ".join(option.choices)
            raise InputError(f"the parameter {name} must be one of {listed}, not '{values[name]}'")
    return kind(**values)


def declare_common(node: LifecycleNode) -> None:
    """Parameters that every node has."""
    text = ParameterDescriptor(description="Path of the aircraft file (YAML).")
    node.declare_parameter("aircraft_file", "", text)
    autostart = ParameterDescriptor(description="Configure and activate at the start, without a manager.")
    node.declare_parameter("autostart", True, autostart)
    reliability = ParameterDescriptor(
        description=(
            "best_effort matches every publisher of sensor data; "
            "reliable asks for every sample of a playback."
        )
    )
    node.declare_parameter("input_reliability", "best_effort", reliability)
    depth = ParameterDescriptor(
        description="Samples that may wait per topic: 10 lose some when the machine stalls, 100 lost none.",
        integer_range=[IntegerRange(from_value=1, to_value=100000, step=1)],
    )
    node.declare_parameter("input_depth", 100, depth)


def configured_aircraft(node: LifecycleNode) -> Aircraft:
    """The aircraft of the parameter ``aircraft_file``; raises InputError."""
    path = node.get_parameter("aircraft_file").value
    if not path:
        raise InputError("the parameter aircraft_file is empty: set it to the path of the aircraft file")
    return load_aircraft(path)


def input_quality(node: LifecycleNode) -> QoSProfile:
    """Best effort with a deep queue by default: a reliable subscription does not match MAVROS."""
    wanted = node.get_parameter("input_reliability").value
    if wanted not in ("best_effort", "reliable"):
        raise InputError(f"input_reliability must be best_effort or reliable, not '{wanted}'")
    reliability = ReliabilityPolicy.RELIABLE if wanted == "reliable" else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=node.get_parameter("input_depth").value, reliability=reliability)


def state_quality() -> QoSProfile:
    """Between our own nodes nothing may be lost."""
    return QoSProfile(depth=5000, reliability=ReliabilityPolicy.RELIABLE)


def message_class(type_name: str) -> Any:
    """Class of "package/msg/Name"."""
    package, _, name = type_name.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def fill(message: Any, content: dict[str, Any]) -> Any:
    """Set fields of a ROS message from a dictionary; a dotted name goes into the nested message."""
    for name, value in content.items():
        *path, last = name.split(".")
        target = message
        for part in path:
            target = getattr(target, part)
        setattr(target, last, value)
    return message


def stamp_of(message: Any, nanoseconds: int) -> Any:
    """Set the stamp of a message's header."""
    message.header.stamp.sec = nanoseconds // NANOSECONDS
    message.header.stamp.nanosec = nanoseconds % NANOSECONDS
    return message


def diagnostics(node: LifecycleNode, level: int, text: str, values: dict[str, Any]) -> DiagnosticArray:
    """One status of this node for /diagnostics."""
    status = DiagnosticStatus(
        level=bytes([level]),
        name=node.get_fully_qualified_name().lstrip("/"),
        message=text,
        hardware_id="aircraft_sysid_ros",
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
    return stamp_of(DiagnosticArray(status=[status]), node.get_clock().now().nanoseconds)


def cpu_share(before: tuple[float, float], now: tuple[float, float]) -> float:
    """Share of one core that this process used between two ``process_times``."""
    return (now[1] - before[1]) / max(now[0] - before[0], 1e-9)


def process_times() -> tuple[float, float]:
    """Wall time and processor time of this process [s]."""
    times = os.times()
    return times.elapsed, times.user + times.system


def start(node: LifecycleNode) -> bool:
    """Configure and activate a node; False if it refused, which is logged."""
    for transition in (node.trigger_configure, node.trigger_activate):
        result = transition()
        if result == TransitionCallbackReturn.ERROR:  # rclpy keeps the exception to itself
            node.get_logger().fatal(f"{transition.__name__} failed: this is a fault of the program")
        if result != TransitionCallbackReturn.SUCCESS:
            return False
    return True


def make_executor(nodes: Sequence[LifecycleNode]) -> Any:
    """The events executor where this rclpy has it (under half the processor time), else the ordinary one."""
    try:
        from rclpy.experimental import EventsExecutor

        executor = EventsExecutor()
    except ImportError:
        executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    return executor


def spin_until(executor: Any, finished: Callable[[], bool]) -> None:
    """Run callbacks until ``finished`` or a shutdown. Not executor.spin(): in the wheels it runs none."""
    gc.collect()
    gc.freeze()  # what is there before the first sample stays: the collector must not walk it in flight
    while rclpy.ok() and not finished():
        try:
            executor.spin_once(timeout_sec=SPIN_TIMEOUT)
        except ExternalShutdownException:
            return
        except rclpy_implementation.RCLError as error:
            # A client asked for a transition that the state does not have: rclpy raises; flying goes on.
            get_logger("aircraft_sysid_ros").error(" ".join(str(error).split()))


@contextlib.contextmanager
def stop_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C or a termination sets: no callback is torn apart.

    An exception from a signal inside the events executor would abort the process.
    """
    stop = threading.Event()
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run_node(kind: Callable[[], LifecycleNode], arguments: Sequence[str] | None = None) -> int:
    """Entry point of a node's executable: start and spin until a signal. Exit status 2: it did not start."""
    try:
        own = None if arguments is None else list(arguments)
        rclpy.init(args=own, signal_handler_options=SignalHandlerOptions.NO)
        node = kind()
    except (ParameterException, RuntimeError) as error:  # bad arguments: rclpy has a RuntimeError for each
        print(" ".join(str(error).split()), file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    try:
        if node.get_parameter("autostart").value and not start(node):
            return 2
        with stop_signals() as stop:
            spin_until(make_executor([node]), stop.is_set)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0
