"""The estimators on the topics of one aircraft, and with `overview:=true` the node that sums them up.

ros2 launch aircraft_sysid_ros live.launch.py aircraft_file:=/path/to/aircraft.yaml namespace:=uav1
ros2 launch aircraft_sysid_ros live.launch.py params_file:=/path/to/params.yaml

What is given on the line goes before what the file of parameters says.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode

PACKAGE = "aircraft_sysid_ros"
NODES = ("state_estimator", "parameter_estimator")
#: Arguments that are parameters of the nodes; empty: what params_file says, or the default.
PARAMETERS = {
    "aircraft_file": "path of the aircraft file (YAML)",
    "calibration_file": "path of a calibration file of `aircraft-sysid calibrate` (YAML)",
    "input_reliability": "best_effort, or reliable: asks publishers for every sample, as for a playback",
    "autostart": "false: a lifecycle manager configures and activates the nodes",
    "use_sim_time": "true: the clock is that of /clock, as for a playback",
    "frame_prefix": "put before every frame that is named, such as uav1/",
    "publish_tf": "true: /tf too",
}
TRUTH = {"true": True, "false": False}
#: Only these nodes have it; the others have all.
OF = {"publish_tf": ("state_estimator",)}
#: How long [s] a node may use what has come by Ctrl-C, before it is asked to end once more, and then killed.
PATIENCE = "60"


def generate_launch_description() -> LaunchDescription:
    """Arguments, then the nodes; with autostart they configure and activate themselves."""
    arguments = [
        DeclareLaunchArgument("params_file", default_value="", description="parameters (YAML): config/params.yaml"),
        DeclareLaunchArgument("namespace", default_value="", description="of the nodes and their topics"),
        DeclareLaunchArgument("overview", default_value="false", description="true: sums up for rqt and Foxglove"),
        *(DeclareLaunchArgument(name, default_value="", description=text) for name, text in PARAMETERS.items()),
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[LifecycleNode]:
    """The nodes, with the parameters that were given."""
    file, namespace, overview = (
        LaunchConfiguration(name).perform(context) for name in ("params_file", "namespace", "overview")
    )
    given = {name: LaunchConfiguration(name).perform(context) for name in PARAMETERS}
    if overview.lower() not in TRUTH:
        raise ValueError(f"overview:={overview} is neither true nor false")
    started = []
    for name in (*NODES, *(["overview"] if TRUTH[overview.lower()] else [])):
        known = ("autostart", "use_sim_time") if name == "overview" else PARAMETERS
        values = {
            key: TRUTH.get(text.lower(), text)
            for key, text in given.items()
            if text and key in known and name in OF.get(key, (name,))
        }
        started.append(
            LifecycleNode(
                package=PACKAGE,
                executable=name,
                name=name,
                namespace=namespace,
                parameters=[*([file] if file else []), *([values] if values else [])],
                output="screen",
                emulate_tty=True,
                sigterm_timeout=PATIENCE,
                sigkill_timeout=PATIENCE,
            )
        )
    return started
