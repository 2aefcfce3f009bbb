"""Everything beside PX4 without MAVLink: the bridge from the uXRCE-DDS agent's topics, and live.launch.py.

    ros2 launch aircraft_sysid_ros px4.launch.py aircraft_file:=/path/to/aircraft.yaml servo_file:=/path/to/servos.yaml

px4_msgs must be in the workspace, in the release of the firmware. Arguments of live.launch.py are taken too.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode

ARGUMENTS = {
    "servo_file": (
        "",
        "path of the file that says which output turns which surface (YAML); without it no control surfaces",
    ),
    "prefix": ("", "where the agent publishes, relative to the namespace; by default fmu/out"),
    "params_file": ("", "parameters (YAML): config/params.yaml"),
    "namespace": ("", "of the nodes and their topics"),
    "autostart": ("", "false: a lifecycle manager configures and activates the nodes"),
}
#: Arguments that are parameters of the bridge.
GIVEN = ("servo_file", "prefix", "autostart")
TRUTH = {"true": True, "false": False}
PATIENCE = "60"


def generate_launch_description() -> LaunchDescription:
    """Arguments, the bridge, then the estimators."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    live = IncludeLaunchDescription(PythonLaunchDescriptionSource(str(Path(__file__).with_name("live.launch.py"))))
    return LaunchDescription([*arguments, OpaqueFunction(function=bridge), live])


def bridge(context: LaunchContext) -> list[LifecycleNode]:
    """The bridge, with the parameters that were given."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    values = {name: TRUTH.get(given[name], given[name]) for name in GIVEN if given[name]}
    return [
        LifecycleNode(
            package="aircraft_sysid_ros",
            executable="px4_bridge",
            name="px4_bridge",
            namespace=given["namespace"],
            parameters=[*([given["params_file"]] if given["params_file"] else []), *([values] if values else [])],
            output="screen",
            emulate_tty=True,
            sigterm_timeout=PATIENCE,
            sigkill_timeout=PATIENCE,
        )
    ]
