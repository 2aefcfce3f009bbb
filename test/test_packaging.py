"""What is installed is what the sources say: messages, executables, versions, pins."""

import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from importlib import import_module, metadata
from pathlib import Path

import pytest
from setuptools import find_packages

import aircraft_sysid_ros
from aircraft_sysid_ros import config_files
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings import message_definitions as definitions

ROOT = Path(__file__).resolve().parents[1]
MESSAGES = sorted(file.stem for file in (ROOT / "msg_defs/msg").glob("*.msg"))
SERVICES = sorted(file.stem for file in (ROOT / "msg_defs/srv").glob("*.srv"))
EXECUTABLES = {"aircraft-sysid", "state_estimator", "parameter_estimator", "mavlink_bridge"}

# The topics and services that other programs rely on: type, fields, in this order.
INTERFACE = {
    "AirData": ["header", "true_airspeed", "angle_of_attack", "sideslip", "air_density", "static_pressure"],
    "FiveHoleProbe": ["header", "static_pressure", "dynamic_pressure", "alpha_pressure", "beta_pressure"],
    "ControlSurfaces": [
        "header", "elevator", "aileron", "rudder", "flaps", "throttle", "thrust", "propeller_speed",
    ],
    "MassProperties": ["header", "mass", "ixx", "iyy", "izz", "ixz", "center_of_gravity"],
}  # fmt: skip


@pytest.mark.parametrize("name", MESSAGES)
def test_every_message_is_compiled_from_the_definition_in_the_source_tree(name):
    compiled = getattr(import_module("aircraft_sysid_msgs.msg"), name)
    text = (ROOT / f"msg_defs/msg/{name}.msg").read_text(encoding="utf-8")
    fields = re.findall(r"^[\w/]+(?:\[\d*\])? (\w+)\s*(?:#.*)?$", text, re.MULTILINE)
    assert list(compiled.get_fields_and_field_types()) == fields


@pytest.mark.parametrize("name", SERVICES)
def test_every_service_is_compiled(name):
    service = getattr(import_module("aircraft_sysid_msgs.srv"), name)
    assert {"success", "message"} <= set(service.Response.get_fields_and_field_types())


@pytest.mark.parametrize("name", INTERFACE)
def test_input_messages_have_the_published_fields(name):
    compiled = getattr(import_module("aircraft_sysid_msgs.msg"), name)
    assert list(compiled.get_fields_and_field_types()) == INTERFACE[name]


def test_the_services_of_the_nodes_have_types():
    assert {"AddEffect", "RemoveEffect", "SaveModel", "LoadModel", "Reset"} <= set(SERVICES)


def test_message_definitions_hold_every_message_unchanged():
    texts = definitions.message_definitions()
    assert set(texts) == {f"aircraft_sysid_msgs/msg/{name}" for name in MESSAGES}
    for name in MESSAGES:
        assert texts[f"aircraft_sysid_msgs/msg/{name}"] == (ROOT / f"msg_defs/msg/{name}.msg").read_text(
            encoding="utf-8"
        )


def test_what_is_not_shipped_is_said_with_the_folder(monkeypatch, tmp_path):
    monkeypatch.setattr(config_files, "_PACKAGE", tmp_path / "aircraft_sysid_ros")
    with pytest.raises(InputError, match=rf"{tmp_path}/config/nowhere\.yaml is missing: reinstall"):
        config_files.config_path("nowhere.yaml")
    definitions.message_definitions.cache_clear()
    with pytest.raises(InputError, match=f"not in {tmp_path}/msg_defs/msg: reinstall"):
        definitions.message_definitions()


LISTENER = """
import rclpy
from rclpy.qos import qos_profile_sensor_data
from aircraft_sysid_msgs.msg import AirData
rclpy.init()
node = rclpy.create_node("listener")
heard = []
node.create_subscription(AirData, "air_data", heard.append, qos_profile_sensor_data)
print("ready", flush=True)
for _ in range(100):
    rclpy.spin_once(node, timeout_sec=0.1)
    if heard:
        print(heard[0].true_airspeed, heard[0].header.stamp.nanosec, flush=True)
        break
rclpy.shutdown()
"""

TALKER = """
import time, rclpy
from rclpy.qos import qos_profile_sensor_data
from aircraft_sysid_msgs.msg import AirData
rclpy.init()
node = rclpy.create_node("talker")
publisher = node.create_publisher(AirData, "air_data", qos_profile_sensor_data)
message = AirData(true_airspeed=23.5)
message.header.stamp.nanosec = 123
for _ in range(100):
    if publisher.get_subscription_count():
        break
    time.sleep(0.1)
for _ in range(20):
    publisher.publish(message)
    time.sleep(0.02)
rclpy.shutdown()
"""


def test_our_messages_travel_between_two_processes():
    environment = os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    environment.setdefault("ROS_DOMAIN_ID", "59")
    with subprocess.Popen(
        [sys.executable, "-c", LISTENER], stdout=subprocess.PIPE, text=True, env=environment
    ) as listener:
        try:
            assert listener.stdout.readline() == "ready\n"
            subprocess.run([sys.executable, "-c", TALKER], env=environment, check=True, timeout=20)
            heard, _ = listener.communicate(timeout=20)
        finally:
            listener.kill()
    assert heard.split() == ["23.5", "123"]


def test_executables_are_declared_and_each_leads_to_a_function():
    scripts = {
        entry.name: entry
        for entry in metadata.distribution("aircraft_sysid_ros").entry_points
        if entry.group == "console_scripts"
    }
    assert set(scripts) == EXECUTABLES
    for name, entry in scripts.items():
        assert callable(entry.load()), name


def test_every_folder_with_modules_is_a_package():
    folders = {file.parent for file in (ROOT / "aircraft_sysid_ros").rglob("*.py")}
    names = {".".join(folder.relative_to(ROOT).parts) for folder in folders}
    assert names == set(find_packages(ROOT, include=["aircraft_sysid_ros", "aircraft_sysid_ros.*"]))


def package_xml(path: str) -> ElementTree.Element:
    return ElementTree.parse(ROOT / path).getroot()


def test_versions_agree():
    setup_py = re.search(r'version="([\d.]+)"', (ROOT / "setup.py").read_text(encoding="utf-8"))
    assert setup_py is not None
    versions = {
        "package.xml": package_xml("package.xml").findtext("version"),
        "msg_defs/package.xml": package_xml("msg_defs/package.xml").findtext("version"),
        "setup.py": setup_py[1],
        "__version__": aircraft_sysid_ros.__version__,
    }
    assert len(set(versions.values())) == 1, versions


def imported_packages() -> set[str]:
    files = [*(ROOT / "aircraft_sysid_ros").rglob("*.py"), *(ROOT / "launch").glob("*.py")]
    found = (
        re.findall(r"^\s*(?:from|import) (\w+)", file.read_text(encoding="utf-8"), re.MULTILINE)
        for file in files
    )
    return {name for names in found for name in names}


def test_package_xml_names_every_ros_package_that_is_imported():
    interfaces = {name for name in imported_packages() if name.endswith(("_msgs", "_interfaces"))}
    ros = interfaces | (imported_packages() & {"rclpy", "launch", "launch_ros"})
    declared = {element.text for element in package_xml("package.xml").iter("exec_depend")}
    assert ros <= declared


def test_ros_wheels_are_the_set_that_fits_together():
    pins = dict(re.findall(r"^(ros-[\w-]+)==(\S+)$", (ROOT / "constraints.txt").read_text(), re.MULTILINE))
    installed = {
        distribution.metadata["Name"]: distribution.version
        for distribution in metadata.distributions()
        if distribution.metadata["Name"].startswith("ros-")
    }
    if not installed:
        pytest.skip("an ordinary ROS 2, not the wheels")
    assert {name: pins.get(name) for name in installed} == installed


@pytest.mark.parametrize(
    ("answer", "complaint"),
    [
        ("echo Python 3.8.1; exit 1", "is Python 3.8.1"),
        ('case "$2" in *version_info*) exit 0;; esac; exit 1', "cannot make virtual environments"),
        ('case "$2" in *Python.h*) exit 1;; esac; exit 0', "has no Python.h"),
    ],
)
def test_an_unsuitable_machine_is_named_in_one_line(tmp_path, answer, complaint):
    python = tmp_path / "python3"
    python.write_text(f"#!/bin/sh\n{answer}\n")
    python.chmod(0o755)
    check = subprocess.run(
        [ROOT / "tools/check_machine.sh", python], capture_output=True, text=True, check=False
    )
    assert check.returncode == 1
    assert complaint in check.stderr
    assert check.stderr.count("\n") == 1
    assert check.stdout == ""


def test_tables_of_the_docs_are_those_of_the_results() -> None:
    """No number in README or docs is typed: the committed tables are what the committed results give."""
    done = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "build.py"), "--check"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
