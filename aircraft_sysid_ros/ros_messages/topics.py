"""What the topics and services of the nodes hold: docs/messages.md is made of it, and a test asks the nodes."""

from __future__ import annotations

from dataclasses import dataclass

from aircraft_sysid_ros.ros_messages.conversion import INPUTS_TOPIC, INPUTS_TYPE, TOPICS

_CONTENTS = {
    "imu/data": "body FLU: specific force (+9.8 on z at rest), angular velocity; orientation (ENU) where its "
    "covariance says that it is there",
    "imu/mag": "body FLU, an optional aid to the heading",
    "gps/fix": "position; counts unless its status is -1",
    "gps/vel": "velocity over ground, ENU",
    "air_data": "true airspeed, angle of attack (nose up positive), sideslip (wind from the right positive), density, "
    "static pressure",
    "five_hole_probe": "raw pressures, for [calibration](calibration.md) and with a calibration file",
    "control_surfaces": "deflections, throttle, thrust, propeller speed; the aircraft file says which sign is which",
    "height_above_ground": "optional",
    "mass_properties": "optional: mass, inertia and centre of gravity while they change",
}


@dataclass(frozen=True)
class Topic:
    """A topic, or a service where its type has /srv/: name relative to the namespace, or from the root."""

    name: str
    type: str
    content: str
    is_latched: bool = False  # transient local


INPUTS = (
    *(Topic(name, kind, _CONTENTS[name]) for name, kind in TOPICS.items()),
    Topic(
        INPUTS_TOPIC,
        INPUTS_TYPE,
        "inputs that the aircraft file names ([further inputs](aircraft-file.md#further-inputs))",
    ),
)
_OURS = "aircraft_sysid_msgs"
#: By node.
OUTPUTS: dict[str, tuple[Topic, ...]] = {
    "state_estimator": (
        Topic(
            "state_estimator/state", f"{_OURS}/msg/AircraftState",
            "air-relative velocity, position, attitude, IMU biases, wind, standard deviations",
        ),
        Topic(
            "state_estimator/wind", "geometry_msgs/msg/TwistWithCovarianceStamped",
            "ENU, the direction the air moves towards; not published while it is not estimated",
        ),
        Topic("state_estimator/odometry", "nav_msgs/msg/Odometry", "`map` and `base_link`, with covariances"),
    ),
    "parameter_estimator": (
        Topic(
            "parameter_estimator/parameters", f"{_OURS}/msg/Parameters",
            "values, covariance, and for each USE, HOLD or REJECT with the reason", is_latched=True,
        ),
        Topic("parameter_estimator/model_error", f"{_OURS}/msg/ModelError", "measured against predicted, by axis"),
        Topic(
            "parameter_estimator/missing_effects", f"{_OURS}/msg/MissingEffects",
            "what the model seems to lack ([in flight](live-diagnosis.md))", is_latched=True,
        ),
    ),
    "overview": (
        Topic(
            "/diagnostics_agg", "diagnostic_msgs/msg/DiagnosticArray",
            "the aircraft as one tree, once a second ([overview](nodes.md#the-aeroplane-at-a-glance))",
        ),
        Topic("/diagnostics_toplevel_state", "diagnostic_msgs/msg/DiagnosticStatus", "its root"),
    ),
}  # fmt: skip
#: Of every node but `overview`.
DIAGNOSTICS = Topic(
    "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", "what became of every sample, by sensor; processor time"
)
#: With `publish_tf`.
TRANSFORMS = Topic("/tf", "tf2_msgs/msg/TFMessage", "the pose of the odometry, if `publish_tf` is true")
SERVICES: dict[str, tuple[Topic, ...]] = {
    "state_estimator": (
        Topic("state_estimator/reset", f"{_OURS}/srv/Reset", "realigns the filter; forgets biases and wind"),
    ),
    "parameter_estimator": (
        Topic(
            "parameter_estimator/add_effect", f"{_OURS}/srv/AddEffect", "adds a term or an effect to the model"
        ),
        Topic("parameter_estimator/remove_effect", f"{_OURS}/srv/RemoveEffect", "removes one"),
        Topic(
            "parameter_estimator/save_model", f"{_OURS}/srv/SaveModel",
            "writes the model with what was learnt to a file in `model_folder`",
        ),
        Topic("parameter_estimator/load_model", f"{_OURS}/srv/LoadModel", "loads such a file and continues from it"),
        Topic("parameter_estimator/reset", f"{_OURS}/srv/Reset", "forgets what was learnt"),
    ),
}  # fmt: skip
