"""Both nodes on the topics of MAVROS.

    ros2 launch aircraft_sysid_ros mavros.launch.py aircraft_file:=/path/to/aircraft.yaml mavros:=/mavros

IMU and GPS are topics of MAVROS, remapped. Air data, deflections and named inputs are not: MAVROS has no message for
them, so a bridge hears the same MAVLink on the port that MAVROS forwards to, its parameter gcs_url, such as
gcs_url:=udp://@127.0.0.1:14555.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode

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
BRIDGED = ["air_data", "control_surfaces", "inputs"]
#: Arguments: default and description. Those that are parameters go before params_file where they are not empty.
ARGUMENTS = {
    "params_file": ("", "parameters (YAML): config/params.yaml"),
    "aircraft_file": ("", "path of the aircraft file (YAML)"),
    "servo_file": ("", "path of the file that says which output turns which surface (YAML)"),
    "calibration_file": ("", "the old name of servo_file"),
    "namespace": ("", "of the nodes and their topics"),
    "mavros": ("/mavros", "namespace of MAVROS"),
    "connection": ("udp:127.0.0.1:14555", "where MAVROS forwards MAVLink to: its gcs_url"),
    "autostart": ("", "false: a lifecycle manager configures and activates the nodes"),
}
ESTIMATOR, BRIDGE = ("aircraft_file", "autostart"), ("connection", "servo_file", "calibration_file", "autostart")
TRUTH = {"true": True, "false": False}


def generate_launch_description() -> LaunchDescription:
    """Arguments, the bridge, then the nodes; with autostart they configure and activate themselves."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[LifecycleNode]:
    """The bridge and the estimators, with the parameters that were given."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    file = [given["params_file"]] if given["params_file"] else []

    def parameters(names: tuple[str, ...]) -> list[object]:
        values = {name: TRUTH.get(given[name], given[name]) for name in names if given[name]}
        return [*file, *([values] if values else [])]

    remappings = [(ours, f"{given['mavros']}/{theirs}") for ours, theirs in REMAPPED.items()]
    common = {"package": PACKAGE, "namespace": given["namespace"], "output": "screen", "emulate_tty": True}
    common |= {"sigterm_timeout": PATIENCE, "sigkill_timeout": PATIENCE}
    link = LifecycleNode(
        executable="mavlink_bridge",
        name="mavlink_bridge",
        parameters=[*parameters(BRIDGE), {"topics": BRIDGED}],
        **common,
    )
    estimators = [
        LifecycleNode(executable=name, name=name, parameters=parameters(ESTIMATOR), remappings=remappings, **common)
        for name in NODES
    ]
    return [link, *estimators]
