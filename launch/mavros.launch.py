"""Both nodes on the topics of MAVROS.

    ros2 launch aircraft_sysid_ros mavros.launch.py aircraft_file:=/path/to/aircraft.yaml mavros:=/mavros

IMU and GPS are topics of MAVROS, remapped. Air data and deflections are not: MAVROS has no message for them, so a
bridge hears the same MAVLink on the port that MAVROS forwards to, its parameter gcs_url, such as
gcs_url:=udp://@127.0.0.1:14555.
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
#: Our topic: that of MAVROS. Its raw GPS velocity is horizontal only, so that of the autopilot's filter is taken.
REMAPPED = {
    "imu/data": "imu/data_raw",
    "imu/mag": "imu/mag",
    "gps/fix": "global_position/raw/fix",
    "gps/vel": "local_position/velocity_local",
}
BRIDGED = ["air_data", "control_surfaces"]


def generate_launch_description() -> LaunchDescription:
    """Arguments, the bridge, then the nodes; with autostart they configure and activate themselves."""
    namespace, mavros = LaunchConfiguration("namespace"), LaunchConfiguration("mavros")
    arguments = [
        DeclareLaunchArgument("aircraft_file", description="path of the aircraft file (YAML)"),
        DeclareLaunchArgument("calibration_file", default_value="", description="path of the calibration file (YAML)"),
        DeclareLaunchArgument("namespace", default_value="", description="of the nodes and their topics"),
        DeclareLaunchArgument("mavros", default_value="/mavros", description="namespace of MAVROS"),
        DeclareLaunchArgument(
            "connection",
            default_value="udp:127.0.0.1:14555",
            description="where MAVROS forwards MAVLink to: its gcs_url",
        ),
        DeclareLaunchArgument("autostart", default_value="true", description="false: a lifecycle manager does"),
    ]
    autostart = ParameterValue(LaunchConfiguration("autostart"), value_type=bool)
    estimator = {
        "aircraft_file": ParameterValue(LaunchConfiguration("aircraft_file"), value_type=str),
        "autostart": autostart,
    }
    bridge = {
        "connection": ParameterValue(LaunchConfiguration("connection"), value_type=str),
        "calibration_file": ParameterValue(LaunchConfiguration("calibration_file"), value_type=str),
        "topics": BRIDGED,
        "autostart": autostart,
    }
    remappings = [(ours, [mavros, "/", theirs]) for ours, theirs in REMAPPED.items()]
    common = {"package": PACKAGE, "namespace": namespace, "output": "screen", "emulate_tty": True}
    common |= {"sigterm_timeout": PATIENCE, "sigkill_timeout": PATIENCE}
    nodes = [
        LifecycleNode(executable=name, name=name, parameters=[estimator], remappings=remappings, **common)
        for name in NODES
    ]
    link = LifecycleNode(executable="mavlink_bridge", name="mavlink_bridge", parameters=[bridge], **common)
    return LaunchDescription([*arguments, link, *nodes])
