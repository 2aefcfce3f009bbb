"""What the nodes share: quality of service, messages from dictionaries, spinning, and the end of a process."""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.logging import get_logger
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from aircraft_sysid_ros.stamps import NANOSECONDS

#: Period [s] of the diagnostics.
DIAGNOSTICS_PERIOD = 1.0
#: Longest a loop waits for the next message [s] before it looks whether it should stop.
SPIN_TIMEOUT = 0.1


def state_quality() -> QoSProfile:
    """Between our own nodes nothing may be lost. Fast DDS takes 5000 at once; what is more waits at the publisher."""
    return QoSProfile(depth=50_000, reliability=ReliabilityPolicy.RELIABLE)


def newest_quality() -> QoSProfile:
    """For what comes seldom: who subscribes later, transient local too, gets the newest at once."""
    return QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


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


def stamp_of(message: Any, nanoseconds: int, frame: str = "") -> Any:
    """Set the stamp of a message's header, and its frame where one is given."""
    message.header.frame_id = frame or message.header.frame_id
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
    return time.monotonic(), time.process_time()


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


def spare_the_collector() -> None:
    """What is there before the first sample stays to the end of the process: it is not walked through in flight."""
    gc.collect()
    gc.freeze()


def spin_until(executor: Any, finished: Callable[[], bool]) -> None:
    """Run callbacks until ``finished`` or a shutdown. Not executor.spin(): in the wheels it runs none."""
    while rclpy.ok() and not finished():
        try:
            executor.spin_once(timeout_sec=SPIN_TIMEOUT)
        except ExternalShutdownException:
            return
        except rclpy_implementation.RCLError as error:
            # A client that does not take its answer, for one: flying goes on.
            get_logger("aircraft_sysid_ros").error(" ".join(str(error).split()))


def steady_timer(node: LifecycleNode, period: float, callback: Callable[[], None]) -> Any:
    """A timer of a node that goes by no clock of a simulation: what it is for is as due where that stands still."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def serve(node: LifecycleNode) -> None:
    """Answer what has been asked of a node's services, and run its timers that are due, without the executor."""
    with contextlib.suppress(InvalidHandle):  # an answer can take the others away
        for service in list(node.services):
            with service.handle:
                request, header = service.handle.service_take_request(service.srv_type.Request)
            if header is not None:
                service.send_response(service.callback(request, service.srv_type.Response()), header)
        for timer in list(node.timers):
            with timer.handle:
                is_due = timer.handle.is_timer_ready()
                if is_due:
                    timer.handle.call_timer()
            if is_due:
                timer.callback()


class Stop:
    """Whether a signal asked the process to end. Further ones tear nothing apart: they are told what is still done."""

    def __init__(self) -> None:
        self.count = 0  # of signals
        self.doing = "stopping"

    def is_set(self) -> bool:
        """Whether to stop."""
        return self.count > 0

    def set(self, *_: Any) -> None:
        """Ask to stop; a signal handler."""
        self.count += 1
        if self.count > 1:
            with contextlib.suppress(OSError):
                os.write(2, f"{self.doing}\n".encode())  # a print could meet itself

    def left(self, messages: int) -> None:
        """So many messages have come and are not used yet."""
        self.doing = f"stopping: {messages} messages that have come are used first"


@contextlib.contextmanager
def stop_signals() -> Iterator[Stop]:
    """What Ctrl-C or a termination sets: no callback is torn apart. After one the process ends, and hears no more.

    An exception from a signal inside the events executor would abort the process.
    """
    stop = Stop()
    before = {number: signal.signal(number, stop.set) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if stop.is_set() else handler)


def all_have_it(publishers: Sequence[Any], stop: Stop) -> bool:
    """Wait until every reliable subscriber has what was published: one that is gone is given up by the middleware.

    False if another signal came before that.
    """
    asked = stop.count
    for publisher in publishers:
        while not publisher.wait_for_all_acked(Duration(seconds=SPIN_TIMEOUT)):
            if stop.count > asked:
                return False
    return True


def run_node(kind: Callable[[], Any], arguments: Sequence[str] | None = None) -> int:
    """Entry point of a node's executable: start, spin until a signal, use what has come, and end.

    Exit status 1: something did not come or did not arrive, which is said; 2: it did not start.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # until it runs there is nothing to lose
    try:
        own = None if arguments is None else list(arguments)
        rclpy.init(args=own, signal_handler_options=SignalHandlerOptions.NO)
        node = kind()
    except (ParameterException, RuntimeError) as error:  # bad arguments: rclpy has a RuntimeError for each
        print(" ".join(str(error).split()), file=sys.stderr)
        rclpy.try_shutdown()
        return 2
    except KeyboardInterrupt:
        return 0
    try:
        for sentence in getattr(node, "unknown_parameters", list)():
            node.get_logger().warning(sentence)
        if node.get_parameter("autostart").value and not start(node):
            return 2
        spare_the_collector()
        with stop_signals() as stop:
            spin_until(make_executor([node]), stop.is_set)
            return _end(node, stop)
    except KeyboardInterrupt:
        return 0
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _end(node: Any, stop: Stop) -> int:
    """Exit status of a node that was asked to stop."""
    node.end(stop.left)
    stop.doing = "stopping: the last messages are on their way"
    problems = [node.unfinished()]
    if not all_have_it(node.publishers_that_matter(), stop):
        problems.append("the last messages may not have arrived everywhere")
    for problem in filter(None, problems):
        node.get_logger().error(problem)
    return 1 if any(problems) else 0
