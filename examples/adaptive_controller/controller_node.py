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
from autopilot import AIR_DATA, Instruments
from dynamic_inversion import AttitudeController
from geometry_msgs.msg import QuaternionStamped
from node_runner import COMMANDS, DEPTH, SILENCE, Silence, Wanted, read_parameters, run_node
from one_process import ASK, CASES, CONTROLLERS, pilot_of
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu
from task import Multisine, Task

from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.consumer import Condition, ParameterSource, priors_of
from aircraft_sysid_ros.consumer.subscriber import ParameterSubscriber
from aircraft_sysid_ros.nodes import common
from aircraft_sysid_ros.ros_messages.conversion import frd_from_flu, nanoseconds_of, quaternion_ned_frd
from aircraft_sysid_ros.sensors.sensor_models import stamps_of
from aircraft_sysid_ros.simulation.closed_loop import ATTITUDE_TOPIC, STEP

#: Age [s], in flight and by the clock, at which live parameters are said to have stopped; the estimator sends each 1 s.
SILENCE_OF_PARAMETERS = 5.0
#: Time of flight [s] after which air data that have not come are said.
_PATIENCE = 3.0
#: Time [s] between looks whether samples and parameters still come.
_LOOK = 0.25
PARAMETERS = {
    "aircraft_file": Wanted(""),
    "parameters": Wanted("live", choices=CONTROLLERS),
    "case": Wanted("none", choices=tuple(CASES)),
    "seed": Wanted(0),
}


class ControllerNode(Node):
    """Bank and pitch steps of a Task by dynamic inversion."""

    def __init__(self, **arguments: Any) -> None:
        """Raises InputError for bad parameters."""
        super().__init__("adaptive_controller", **arguments)
        value = read_parameters(self, PARAMETERS)
        kind, case = value["parameters"], CASES[value["case"]]
        aircraft = load_aircraft(value["aircraft_file"] or config_path(DEFAULT_AIRCRAFT))
        self.controller, self.instruments = AttitudeController(aircraft), Instruments(aircraft)
        self.source = ParameterSource(priors_of(aircraft.coefficients))
        self._known = None if kind == "live" else pilot_of(kind, aircraft, case)
        self._task = Task(value["seed"], case.duration, self.controller.airspeed)
        self._multisine, self._parameters = Multisine(STEP), np.empty(0)
        self._rehearse(aircraft)
        self.commands = 0
        self.references: dict[int, tuple[float, float]] = {}  # by stamp: bank and pitch of the reference models
        quality = QoSProfile(depth=DEPTH)
        self._publisher = self.create_publisher(ControlSurfaces, COMMANDS, quality)
        self.create_subscription(QuaternionStamped, ATTITUDE_TOPIC, self._on_attitude, quality)
        self.create_subscription(AirData, "air_data", self._on_air_data, quality)
        self.create_subscription(Imu, "imu/data", self._on_imu, quality)
        self._subscriber = ParameterSubscriber(self, self.source, condition=self._condition)
        say = self.get_logger().warning
        self._imu = Silence(say, "IMU samples", SILENCE, "no commands are sent")
        self.messages = Silence(
            say, "parameters", SILENCE_OF_PARAMETERS, "the controller flies on with what it has learnt"
        )
        self._taken = 0  # messages of parameters at the newest look
        self._first_stamp = self._newest_stamp = 0  # of IMU samples [ns]
        self.create_timer(_LOOK, self.look)

    def _rehearse(self, aircraft: Aircraft) -> None:
        """Answer two samples before anybody listens: the first answer compiles, and so do the first new parameters."""
        instruments, controller = Instruments(aircraft), AttitudeController(aircraft)
        instruments.take_imu(frd_from_flu([0.0, 0.0, 0.0]))
        instruments.take_attitude(quaternion_ned_frd([0.0, 0.0, 0.0, 1.0]))
        instruments.take_air_data(np.array([controller.airspeed, 0.0, 0.0, 1.225, 101_325.0]), 1)
        seen, priors = instruments.seen, np.array([*aircraft.coefficients.values()])
        assert seen is not None  # everything has come once
        for parameters in (priors, 0.9 * priors):
            controller.step(seen, self._task.reference(0.0), parameters, self._multisine.at(0), STEP)

    @property
    def age_of_parameters(self) -> float:
        """Time of flight [s] from the stamp of the newest message, or from the first sample if none came.

        Before it too, where the clock started over: what has come is by another one.
        """
        since = self._first_stamp if self.source.newest is None else self.source.newest.stamp
        return 1e-9 * abs(self._newest_stamp - since)

    def look(self) -> None:
        """Say what has stopped."""
        self._imu.check()
        if self.source.taken > self._taken:
            self._taken = self.source.taken
            self.messages.heard()
        lacking = self.instruments.lacking
        if lacking and abs(self._newest_stamp - self._first_stamp) > 1e9 * _PATIENCE:
            text = f"air_data has had no {' and no '.join(lacking)} so far: no commands are sent without"
            self.get_logger().warning(text, throttle_duration_sec=10.0)
        if self._known is None and self.age_of_parameters > SILENCE_OF_PARAMETERS:
            self.messages.check()

    def _on_attitude(self, message: QuaternionStamped) -> None:
        q = message.quaternion
        self.instruments.take_attitude(quaternion_ned_frd([q.x, q.y, q.z, q.w]))

    def _on_air_data(self, message: AirData) -> None:
        values = np.array([getattr(message, name) for name in AIR_DATA])
        self.instruments.take_air_data(values, nanoseconds_of(message))

    def _on_imu(self, message: Imu) -> None:
        rate, stamp = message.angular_velocity, nanoseconds_of(message)
        rates = frd_from_flu([rate.x, rate.y, rate.z])
        if not np.isfinite(rates).all():  # commands from it would be no numbers for ever
            return
        if not self._first_stamp:
            self._first_stamp = stamp
            self.messages.heard()  # from now on they are waited for
        self._newest_stamp = stamp
        self._imu.heard()
        self.instruments.take_imu(rates)
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
        return self.source.at(stamp, self.instruments.condition(stamp)).values

    def _condition(self) -> Condition | None:
        """Where it flies, by the clock of the stamps."""
        return self.instruments.condition(self._newest_stamp)


def fly_until_stopped(_node: ControllerNode, executor: Any, stop: threading.Event) -> int:
    """Answer until a signal."""
    common.spare_the_collector()
    common.spin_until(executor, stop.is_set)
    return 0


if __name__ == "__main__":
    sys.exit(run_node(ControllerNode, fly_until_stopped))
