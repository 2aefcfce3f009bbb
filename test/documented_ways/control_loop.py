"""A control loop in a process of its own, which asks the consumer library as docs/closed-loop.md writes it.

    python control_loop.py AIRCRAFT_FILE

One line of JSON for the values before the first message of parameters, and one for each message: value, standard error
and origin of every parameter.
"""

import json
import sys
from typing import Any

import rclpy
from aircraft_sysid_msgs.msg import AirData
from documented_commands import python_blocks
from rclpy.executors import ExternalShutdownException
from rclpy.qos import qos_profile_sensor_data

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.ros_messages.conversion import nanoseconds_of


class ControlLoop:
    """Asks at every sample of the air data, and says what it is told when something new has come."""

    def __init__(self, node: Any, aircraft_file: str) -> None:
        prepare, _, ask = python_blocks("docs/closed-loop.md")[0].partition("...\n")
        self.names: dict[str, Any] = {"node": node, "aircraft": load_aircraft(aircraft_file)}
        exec(prepare, self.names)
        self._ask = compile(ask.splitlines()[0], "docs/closed-loop.md", "exec")
        self._taken = -1
        node.create_subscription(AirData, "air_data", self.on_air_data, qos_profile_sensor_data)

    def on_air_data(self, message: Any) -> None:
        """One turn of the loop."""
        self.names["stamp_ns"] = nanoseconds_of(message)
        exec(self._ask, self.names)
        if self.names["source"].taken != self._taken:
            self._taken = self.names["source"].taken
            told = {name: self.names["values"][name] for name in self.names["priors"]}
            print(json.dumps({name: [a.value, a.std, a.origin.name] for name, a in told.items()}), flush=True)


def main() -> None:
    """Until Ctrl-C."""
    rclpy.init()
    node = rclpy.create_node("control_loop")
    loop = ControlLoop(node, sys.argv[1])
    print("listening", file=sys.stderr, flush=True)
    try:
        rclpy.spin(loop.names["node"])
    except (KeyboardInterrupt, ExternalShutdownException):
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
