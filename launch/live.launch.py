"""Both nodes on the topics of one aircraft.

ros2 launch aircraft_sysid_ros live.launch.py aircraft_file:=/path/to/aircraft.yaml namespace:=uav1
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterValue

PACKAGE = "aircraft_sysid_ros"
NODES = ("state_estimator", "parameter_estimator")
#: How long [s] a node may use what has come by Ctrl-C, before it is asked to end once more, and then killed.
PATIENCE = "60"


def generate_launch_description() -> LaunchDescription:
    """Arguments, then the nodes; with autostart they configure and activate themselves."""
    arguments = [
        DeclareLaunchArgument("aircraft_file", description="path of the aircraft file (YAML)"),
        DeclareLaunchArgument("namespace", default_value="", description="of the nodes and their topics"),
        DeclareLaunchArgument(
            "autostart",
            default_value="true",
            description="false: a lifecycle manager configures and activates the nodes",
        ),
        DeclareLaunchArgument(
            "input_reliability",
            default_value="best_effort",
            description="reliable asks publishers for every sample, as of a playback",
        ),
    ]
    parameters = {
        "aircraft_file": ParameterValue(LaunchConfiguration("aircraft_file"), value_type=str),
        "autostart": ParameterValue(LaunchConfiguration("autostart"), value_type=bool),
        "input_reliability": ParameterValue(LaunchConfiguration("input_reliability"), value_type=str),
    }
    nodes = [
        LifecycleNode(
            package=PACKAGE,
            executable=name,
            name=name,
            namespace=LaunchConfiguration("namespace"),
            parameters=[parameters],
            output="screen",
            emulate_tty=True,
            sigterm_timeout=PATIENCE,
            sigkill_timeout=PATIENCE,
        )
        for name in NODES
    ]
    return LaunchDescription([*arguments, *nodes])
