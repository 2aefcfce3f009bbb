"""The calibration file of a node: the parameter, and the correction that the node applies to its samples."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import ParameterDescriptor

from aircraft_sysid_ros.calibration.calibration_file import load_calibration
from aircraft_sysid_ros.calibration.correction import Correction

#: Topic that a calibrated probe is heard on.
PROBE_TOPIC = "five_hole_probe"


def declare_calibration(node: Any) -> None:
    """Declare the parameter."""
    text = "Path of a calibration file (YAML) of `aircraft-sysid calibrate`; empty: samples are taken as they are."
    node.declare_parameter("calibration_file", "", ParameterDescriptor(description=text))


def declare_air_data_errors(node: Any) -> None:
    """Declare the parameter of the node that has the filter."""
    text = "Scales and offsets of airspeed, alpha and beta are states of the filter too, begun by calibration_file."
    node.declare_parameter("air_data_errors", False, ParameterDescriptor(description=text))


def configured_correction(node: Any) -> Correction | None:
    """Correction of the parameter ``calibration_file``, compiled; None without one. Raises InputError."""
    path = node.get_parameter("calibration_file").value
    if not path:
        return None
    correction = Correction(load_calibration(path))
    correction.warm_up()
    return correction
