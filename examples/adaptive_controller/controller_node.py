"""The controller as a ROS 2 node: IMU, attitude, air data and ``~/parameters`` in, commanded surfaces out.

    python examples/adaptive_controller/controller_node.py --ros-args -p aircraft_file:=… -p parameters:=live

Every IMU sample is answered by a command with its stamp. ``parameters``: fixed (those of the aircraft file), live (the
consumer library on the messages of parameter_estimator), or truth (of the simulated ``case``).
"""

from __future__ import annotations

import sys
import threading
from typing import Any

import numpy as np
from aircraft_sysid_msgs.msg import AirData, ControlSurfaces
from autopilot import Instruments
from dynamic_inversion import AttitudeController
from geometry_msgs.msg import QuaternionStamped
from node_runner import COMMANDS, DEPTH, run_node
from one_process import ASK, CASES, CONTROLLERS, pilot_of
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu
from task import Multisine, Task

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.consumer import ParameterSource, priors_of
from aircraft_sysid_ros.consumer.subscriber import ParameterSubscriber
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.recordings.ros_conversion import frd_from_flu, quaternion_ned_frd
from aircraft_sysid_ros.simulation.closed_loop import ATTITUDE_TOPIC, STEP
from aircraft_sysid_ros.simulation.sensors import stamps_of


class ControllerNode(Node):
    """Bank and pitch steps of a Task by dynamic inversion."""

    def __init__(self, **arguments: Any) -> None:
        """Raises InputError for bad parameters."""
        super().__init__("adaptive_controller", **arguments)
        for name, default in {"aircraft_file": "", "parameters": "live", "case": "none", "seed": 0}.items():
            self.declare_parameter(name, default)
        kind, seed = self.get_parameter("parameters").value, self.get_parameter("seed").value
        case = self.get_parameter("case").value
        if kind not in CONTROLLERS or case not in CASES:
            raise InputError(f"parameters must be one of {', '.join(CONTROLLERS)}, and case one of {', '.join(CASES)}")
        aircraft = load_aircraft(self.get_parameter("aircraft_file").value or config_path(DEFAULT_AIRCRAFT))
        self.controller, self.instruments = AttitudeController(aircraft), Instruments(aircraft)
        self.source = ParameterSource(priors_of(aircraft.coefficients))
        self._known = None if kind == "live" else pilot_of(kind, aircraft, CASES[case])
        self._task = Task(seed, CASES[case].duration, self.controller.airspeed)
        self._multisine, self._parameters = Multisine(STEP), np.empty(0)
        self.commands = 0
        self.references: dict[int, tuple[float, float]] = {}  # by stamp: bank and pitch of the reference models
        quality = QoSProfile(depth=DEPTH)
        self._publisher = self.create_publisher(ControlSurfaces, COMMANDS, quality)
        self.create_subscription(QuaternionStamped, ATTITUDE_TOPIC, self._on_attitude, quality)
        self.create_subscription(AirData, "air_data", self._on_air_data, quality)
        self.create_subscription(Imu, "imu/data", self._on_imu, quality)
        self._subscriber = ParameterSubscriber(self, self.source, condition=lambda: self.instruments.condition)

    def _on_attitude(self, message: QuaternionStamped) -> None:
        q = message.quaternion
        self.instruments.take_attitude(quaternion_ned_frd([q.x, q.y, q.z, q.w]))

    def _on_air_data(self, message: AirData) -> None:
        values = (message.true_airspeed, message.angle_of_attack, message.sideslip, message.air_density)
        self.instruments.take_air_data(np.array([*values, message.static_pressure]), common.nanoseconds_of(message))

    def _on_imu(self, message: Imu) -> None:
        rate, stamp = message.angular_velocity, common.nanoseconds_of(message)
        self.instruments.take_imu(frd_from_flu([rate.x, rate.y, rate.z]))
        seen = self.instruments.seen
        if seen is None:  # the aeroplane keeps its trim until everything has come once
            return
        if self.commands % ASK == 0:
            self._parameters = self._ask(stamp)
        time = 1e-9 * (stamp - int(stamps_of(0.0)))
        number = round(time / STEP)
        reference, excitation = self._task.reference(max(time, 0.0)), self._multisine.at(number)
        elevator, aileron, rudder, throttle = map(
            float, self.controller.step(seen, reference, self._parameters, excitation, STEP)
        )
        answer = ControlSurfaces(elevator=elevator, aileron=aileron, rudder=rudder, throttle=throttle)
        self._publisher.publish(common.stamp_of(answer, stamp))
        self.commands += 1
        c = self.controller
        self.references[stamp] = (c.bank.angle, c.pitch.angle + c.trim_pitch)

    def _ask(self, stamp: int) -> Any:
        """Parameters to fly on now."""
        if self._known is not None:
            return self._known.parameters(stamp, self.instruments)
        condition = self.instruments.condition
        assert condition is not None
        return self.source.at(stamp, condition).values


def fly_until_stopped(_node: ControllerNode, executor: Any, stop: threading.Event) -> None:
    """Answer until a signal."""
    common.spin_until(executor, stop.is_set)


if __name__ == "__main__":
    sys.exit(run_node(ControllerNode, fly_until_stopped))
