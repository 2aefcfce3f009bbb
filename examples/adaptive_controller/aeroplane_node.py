"""The aeroplane as a ROS 2 node: sensor topics out, commanded surfaces in.

    python examples/adaptive_controller/aeroplane_node.py --ros-args -p aircraft_file:=… -p case:=elevator -p rate:=1.0

It flies by the clock (``rate`` times real time), with the newest command that has come, or with rate 0 in step with the
controller: as soon as the command that answers its newest IMU sample is there. It waits for controller_node,
state_estimator and parameter_estimator to listen. Exit status 1: the commands had stopped when the flight ended.
"""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from aircraft_sysid_msgs.msg import ControlSurfaces
from geometry_msgs.msg import QuaternionStamped
from node_runner import COMMANDS, DEPTH, SILENCE, Silence, Wanted, read_parameters, run_node
from one_process import CASES, is_lost
from rclpy.node import Node
from rclpy.qos import QoSProfile

from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.ros_messages import conversion as ros_conversion
from aircraft_sysid_ros.ros_messages.conversion import TOPICS, USED_FIELDS, nanoseconds_of
from aircraft_sysid_ros.simulation.closed_loop import ATTITUDE_TOPIC, STEP, Sensed, SteppedAeroplane, damage_of
from aircraft_sysid_ros.simulation.closed_loop_faults import fault_of

Array = npt.NDArray[np.float64]

#: Longest [s] that it waits for an answer in step with the controller.
PATIENCE = 2.0
#: The same before the first answer and after the commands have stopped.
BRIEF_PATIENCE = 0.05
#: Time [s] between words on what it waits for.
_WORD = 5.0
PARAMETERS = {
    "aircraft_file": Wanted(""),
    "case": Wanted("none", choices=tuple(CASES)),
    "seed": Wanted(0),
    "turbulence": Wanted(4.0, high=30.0),  # [m/s], as of SteppedAeroplane
    "rate": Wanted(1.0, low=0.1, high=100.0, or_zero=True),
    "duration": Wanted(0.0, low=1.0, high=3600.0, or_zero=True),  # [s]; 0: of the case
}


def message_of(sensed: Sensed) -> Any:
    """The ROS message of a sample, ENU and FLU."""
    if sensed.topic == ATTITUDE_TOPIC:
        x, y, z, w = map(float, ros_conversion.quaternion_enu_flu(sensed.values))
        content = {f"quaternion.{name}": value for name, value in zip("xyzw", (x, y, z, w), strict=True)}
        return common.stamp_of(common.fill(QuaternionStamped(), content), sensed.stamp, "map")
    message = common.message_class(TOPICS[sensed.topic])()
    for name, value in _fields(sensed).items():
        parts = USED_FIELDS[sensed.topic].get(name, "").split()
        flat = np.asarray(value)[0]
        inside = {f"{name}.{part}": float(v) for part, v in zip(parts, flat, strict=True)} if parts else None
        common.fill(message, inside or {name: _plain(flat)})
    return common.stamp_of(message, sensed.stamp, ros_conversion.frame_of(sensed.topic))


def _fields(sensed: Sensed) -> dict[str, Any]:
    """Flat fields (1,) or (1, k) of a sample."""
    v = sensed.values
    if sensed.topic == "imu/data":
        return dict(ros_conversion.imu_fields(v[:3], v[3:]))
    if sensed.topic == "gps/fix":
        return ros_conversion.gps_fix_fields(v[0], v[1], v[2])
    if sensed.topic == "gps/vel":
        return dict(ros_conversion.gps_velocity_fields(v))
    return {name: np.array([value]) for name, value in zip(USED_FIELDS[sensed.topic], v, strict=True)}


def _plain(value: Any) -> Any:
    return value if isinstance(value, np.ndarray) and value.ndim else value.item()


class AeroplaneNode(Node):
    """Owns a SteppedAeroplane; ``fly`` flies it."""

    def __init__(self, **arguments: Any) -> None:
        """Raises InputError for bad parameters."""
        super().__init__("aeroplane", **arguments)
        value = read_parameters(self, PARAMETERS)
        self.case, self.rate = CASES[value["case"]], value["rate"]
        aircraft: Aircraft = load_aircraft(value["aircraft_file"] or config_path(DEFAULT_AIRCRAFT))
        self.aeroplane = SteppedAeroplane(
            aircraft, value["seed"], value["duration"] or self.case.duration, turbulence=value["turbulence"],
            damage=damage_of(aircraft, self.case.damage), change_time=self.case.time,
            fault=fault_of(self.case.fault, self.case.time, value["seed"]),
        )  # fmt: skip
        self.command = self.aeroplane.setup.trim.controls.copy()
        self.answered = 0  # newest stamp [ns] that a command answers
        self.unanswered, self.lost_at, self.log = 0, np.nan, []
        self.commands = Silence(
            self.get_logger().warning, "commands", SILENCE, "the aeroplane flies on with the newest that came"
        )
        quality = QoSProfile(depth=DEPTH)
        topics = ("imu/data", "air_data", "control_surfaces", "gps/fix", "gps/vel")
        kinds = {topic: common.message_class(TOPICS[topic]) for topic in topics} | {ATTITUDE_TOPIC: QuaternionStamped}
        self._made = {topic: self.create_publisher(kind, topic, quality) for topic, kind in kinds.items()}
        self.create_subscription(ControlSurfaces, COMMANDS, self._on_command, quality)

    def missing(self) -> list[str]:
        """What it waits for before it flies: a sender of commands, a listener to each topic."""
        deaf = [f"a listener to {topic}" for topic, p in self._made.items() if not p.get_subscription_count()]
        return deaf if self.count_publishers(COMMANDS) else [f"a sender of {COMMANDS}", *deaf]

    def _on_command(self, message: ControlSurfaces) -> None:
        command = np.array([message.elevator, message.aileron, message.rudder, message.throttle])
        if np.all(np.isfinite(command)):
            self.command = command
            self.commands.heard()
            self.answered = nanoseconds_of(message)

    def fly(self, spin: Any) -> None:
        """Fly to the end, or until it is lost. ``spin(timeout)`` runs callbacks for at most ``timeout`` [s]."""
        began = time.perf_counter()
        self.commands.heard()
        while self.aeroplane.step_number < self.aeroplane.count:
            reading, sensed = self.aeroplane.look()
            for one in sorted(sensed, key=lambda item: item.topic == "imu/data"):  # the controller answers the IMU
                self._made[one.topic].publish(message_of(one))
            self._wait_for_answer(began, sensed[0].stamp, spin)
            self.log.append((self.aeroplane.time, reading.copy(), self.command.copy()))
            if is_lost(reading):
                self.lost_at = self.aeroplane.time
                return
            self.aeroplane.advance(self.command)

    def _wait_for_answer(self, began: float, stamp: int, spin: Any) -> None:
        in_step = self.rate <= 0.0
        step = self.aeroplane.step_number + 1
        patience = PATIENCE if self.answered and not self.commands.is_silent else BRIEF_PATIENCE
        due = time.perf_counter() + patience if in_step else began + STEP * step / self.rate
        spin(0.0)  # also when it is late
        while (left := due - time.perf_counter()) > 0.0 and not (in_step and self.answered >= stamp):
            spin(min(left, 0.05))
        if self.answered < stamp:
            self.unanswered += 1
            self.commands.check()

    def summary(self) -> str:
        """How the flight ended, in one sentence."""
        end = f"lost at {self.lost_at:.1f} s" if np.isfinite(self.lost_at) else f"flown for {self.aeroplane.time:.1f} s"
        silent = f", without a command for the last {self.commands.age:.1f} s" if self.commands.is_silent else ""
        return f"{end}{silent}; {self.unanswered} of {len(self.log)} samples had no answer in time"


class Stopped(Exception):
    """Ctrl-C."""


def stoppable(executor: Any, stop: threading.Event) -> Callable[[float], None]:
    """Runs callbacks for at most some time [s]; raises Stopped between them, not in one, once ``stop`` is set."""

    def spin(timeout: float) -> None:
        executor.spin_once(timeout_sec=timeout)
        if stop.is_set():
            raise Stopped

    return spin


def fly_when_heard(node: AeroplaneNode, executor: Any, stop: threading.Event) -> int:
    """Fly once everybody listens; 1 if the commands had stopped when the flight ended."""
    with contextlib.suppress(Stopped):
        spin, word = stoppable(executor, stop), time.monotonic() + _WORD
        while missing := node.missing():
            if time.monotonic() > word:
                node.get_logger().info(f"waiting for {', '.join(missing)}")
                word += _WORD
            spin(0.1)
        node.fly(spin)
        node.get_logger().info(node.summary())
    return int(node.commands.is_silent)


if __name__ == "__main__":
    sys.exit(run_node(AeroplaneNode, fly_when_heard))
