"""What is installed is what the sources say: messages, executables, versions, pins."""

import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from importlib import import_module, metadata
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from setuptools import find_packages
from waiting import finish

import aircraft_sysid_ros
from aircraft_sysid_ros import config_files
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings import message_definitions as definitions

ROOT = Path(__file__).resolve().parents[1]
MESSAGES = sorted(file.stem for file in (ROOT / "msg_defs/msg").glob("*.msg"))
SERVICES = sorted(file.stem for file in (ROOT / "msg_defs/srv").glob("*.srv"))
EXECUTABLES = {"aircraft-sysid", "state_estimator", "parameter_estimator", "mavlink_bridge", "px4_bridge", "overview"}

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
while not heard:
    rclpy.spin_once(node, timeout_sec=0.1)
print(heard[0].true_airspeed, heard[0].header.stamp.nanosec, flush=True)
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
while True:  # a best-effort subscriber may be known before it hears
    publisher.publish(message)
    time.sleep(0.02)
"""


@pytest.mark.long
def test_our_messages_travel_between_two_processes():
    environment = os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with (
        subprocess.Popen(
            [sys.executable, "-c", LISTENER], stdout=subprocess.PIPE, text=True, env=environment
        ) as listener,
        subprocess.Popen([sys.executable, "-c", TALKER], env=environment) as talker,
    ):
        try:
            heard, _ = finish(listener)
        finally:
            talker.kill()
            listener.kill()
    assert heard.split() == ["ready", "23.5", "123"]


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


def said_by_setup_py(name: str) -> str:
    """A text that setup.py tells setuptools."""
    found = re.search(rf'{name}="([^"]*)"', (ROOT / "setup.py").read_text(encoding="utf-8"))
    assert found is not None
    return found[1]


def citation() -> dict:
    return yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def test_versions_agree():
    released = re.search(r"^## (\d+\.\d+\.\d+) \(", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    quality = re.search(r"stable version \| no: (\S+) ", (ROOT / "QUALITY_DECLARATION.md").read_text(encoding="utf-8"))
    versions = {
        "package.xml": package_xml("package.xml").findtext("version"),
        "msg_defs/package.xml": package_xml("msg_defs/package.xml").findtext("version"),
        "setup.py": said_by_setup_py("version"),
        "__version__": aircraft_sysid_ros.__version__,
        "CITATION.cff": str(citation()["version"]),
        "newest of CHANGELOG.md": released and released[1],
        "QUALITY_DECLARATION.md": quality and quality[1],
    }
    assert len(set(versions.values())) == 1, versions


def test_licences_agree():
    licences = {
        "package.xml": package_xml("package.xml").findtext("license"),
        "msg_defs/package.xml": package_xml("msg_defs/package.xml").findtext("license"),
        "setup.py": said_by_setup_py("license"),
        "CITATION.cff": citation()["license"],
    }
    assert set(licences.values()) == {"Apache-2.0"}, licences
    assert "Apache License\n                           Version 2.0" in (ROOT / "LICENSE").read_text(encoding="utf-8")


def test_the_classifiers_name_the_pythons_that_make_env_takes():
    text = (ROOT / "setup.py").read_text(encoding="utf-8")
    minors = [int(minor) for minor in re.findall(r'"Programming Language :: Python :: 3\.(\d+)"', text)]
    check = (ROOT / "tools/check_machine.sh").read_text(encoding="utf-8")
    low, high = map(int, re.search(r"\(3, (\d+)\) <= sys.version_info\[:2\] <= \(3, (\d+)\)", check).groups())
    assert minors == list(range(low, high + 1))
    workflow = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))
    assert workflow["jobs"]["test"]["strategy"]["matrix"]["python"] == [f"3.{minor}" for minor in minors]


def test_workflow_and_image_make_what_the_makefile_makes():
    """Neither runs here: what they call must exist at least."""
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    for file in ("Dockerfile", ".github/workflows/ci.yml"):
        called = re.findall(r"\bmake ([a-z-]+)", (ROOT / file).read_text(encoding="utf-8"))
        assert {"env", "test", "demo"} & set(called) and set(called) <= targets, file


def imported_packages() -> set[str]:
    files = [*(ROOT / "aircraft_sysid_ros").rglob("*.py"), *(ROOT / "launch").glob("*.py")]
    found = (re.findall(r"^\s*(?:from|import) (\w+)", file.read_text(encoding="utf-8"), re.MULTILINE) for file in files)
    return {name for names in found for name in names}


def test_package_xml_names_every_ros_package_that_is_imported():
    interfaces = {name for name in imported_packages() if name.endswith(("_msgs", "_interfaces"))}
    ros = interfaces | (imported_packages() & {"rclpy", "launch", "launch_ros"})
    declared = {element.text for element in package_xml("package.xml").iter("exec_depend")}
    assert ros <= declared


#: Keys of rosdep for what setup.py requires, where they are not python3-NAME.
ROSDEP_KEYS = {
    "PyYAML": "python3-yaml", "lz4": "mcap-ros2-support", "mcap": "mcap-ros2-support",
    "pymavlink": "python3-pymavlink-pip", "pyserial": "python3-serial", "rosbags": "python3-rosbags-pip",
    "zstandard": "mcap-ros2-support",
}  # fmt: skip


def test_package_xml_names_what_nodes_and_recordings_need_of_python():
    """The bridge is a node, so that the extra of pip is no extra for rosdep."""
    requirements = [Requirement(line) for line in metadata.requires("aircraft_sysid_ros")]
    plain = {r.name for r in requirements if r.marker is None or r.marker.evaluate({"extra": "bridge"})}
    keys = {ROSDEP_KEYS.get(name, f"python3-{name}") for name in plain}
    declared = {element.text for element in package_xml("package.xml").iter("exec_depend")}
    assert keys == {key for key in declared if key.startswith("python3-")} | {"mcap-ros2-support"}


@pytest.fixture(scope="module")
def release_tree(tmp_path_factory):
    """Both packages side by side, as `make release-tree` writes them."""
    folder = tmp_path_factory.mktemp("release") / "src"
    subprocess.run([ROOT / "tools/release_tree.sh", sys.executable, folder], check=True)
    return folder


@pytest.mark.long
def test_standard_tools_find_both_packages_in_the_release_tree(release_tree):
    packages = find_release_packages(release_tree)
    assert set(packages) == {"aircraft_sysid_msgs", "aircraft_sysid_ros"}
    assert {package.version for package in packages.values()} == {aircraft_sysid_ros.__version__}
    assert colcon_list(release_tree) == {
        "aircraft_sysid_msgs\taircraft_sysid_msgs\t(ros.ament_cmake)",
        "aircraft_sysid_ros\taircraft_sysid_ros\t(ros.ament_python)",
    }
    licence = (ROOT / "LICENSE").read_bytes()
    assert all((release_tree / package / "LICENSE").read_bytes() == licence for package in packages)


def find_release_packages(folder):
    from catkin_pkg.packages import find_packages

    return find_packages(str(folder))


def colcon_list(folder):
    """What colcon finds without options, of a user who has none of his own."""
    command = [Path(sys.executable).with_name("colcon"), "--log-base", os.devnull, "list"]
    environment = os.environ | {"COLCON_HOME": str(folder / "nowhere")}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines())


@pytest.mark.long
def test_colcon_finds_both_packages_in_the_checkout_without_options():
    assert colcon_list(ROOT) == {
        "aircraft_sysid_msgs\tmsg_defs\t(ros.ament_cmake)",
        "aircraft_sysid_ros\t.\t(ros.ament_python)",
    }


def test_the_release_tree_holds_what_its_package_names(release_tree):
    """rosdoc2 ends at once where the file is not there."""
    (named,) = package_xml("package.xml").iter("rosdoc2")
    assert (release_tree / "aircraft_sysid_ros" / named.text).is_file()


def test_the_release_tree_is_not_written_over_anything(release_tree):
    command = [ROOT / "tools/release_tree.sh", sys.executable, release_tree]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "is already there" in done.stderr


def test_the_release_tree_carries_the_definitions_that_recordings_are_written_with(release_tree):
    folders = (release_tree / "aircraft_sysid_ros/msg_defs/msg", release_tree / "aircraft_sysid_msgs/msg")
    expected = {file.name: file.read_bytes() for file in (ROOT / "msg_defs/msg").iterdir()}
    for folder in folders:
        assert {file.name: file.read_bytes() for file in folder.iterdir()} == expected


INSTALLED = ROOT / "build" / "colcon" / "install"
WHERE = """
import aircraft_sysid_msgs, aircraft_sysid_ros.config_files as files
from aircraft_sysid_ros.recordings.message_definitions import message_definitions
assert message_definitions()
print(files.__file__, aircraft_sysid_msgs.__file__, files.shipped_folder("msg_defs"), files.shipped_folder("config"))
"""


def in_workspace(command, folder):
    """What a command prints in a shell that has sourced the workspace of `make colcon`."""
    prefix = Path(sys.executable).parents[1]
    environment = {"PATH": f"{prefix}/bin:{os.environ['PATH']}", "AMENT_PREFIX_PATH": str(prefix)}
    sourced = ["bash", "-c", '. "$0"/setup.bash; "$@"', INSTALLED, *command]
    done = subprocess.run(sourced, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.skipif(not (INSTALLED.parent / "complete").exists(), reason="make colcon builds the workspace")
def test_what_colcon_installed_finds_its_files_in_itself(tmp_path):
    found = in_workspace(["python", "-c", WHERE], tmp_path).split()
    assert len(found) == 4
    assert all(Path(path).is_relative_to(INSTALLED) for path in found)
    program = INSTALLED / "aircraft_sysid_ros/lib/aircraft_sysid_ros/aircraft-sysid"
    assert "COMMAND" in in_workspace([program, "--help"], tmp_path)


def declared_keys():
    """Keys of rosdep in both package.xml."""
    return {
        element.text
        for path in ("package.xml", "msg_defs/package.xml")
        for element in package_xml(path)
        if element.tag.endswith("depend") and element.text != "aircraft_sysid_msgs"
    }


def test_every_key_is_one_of_rosdep():
    """The part of rosdep's database that our keys are in."""
    assert declared_keys() == set(yaml.safe_load((ROOT / "test" / "rosdep" / "keys.yaml").read_text()))


@pytest.mark.long
@pytest.mark.skipif(shutil.which("dpkg-query") is None, reason="rosdep asks dpkg what is installed")
def test_rosdep_knows_every_key_and_reports_what_is_not_installed(release_tree, tmp_path):
    """With the part of rosdep's database that our keys are in, since the whole of it is on the network."""
    data = ROOT / "test" / "rosdep"
    (tmp_path / "sources").mkdir()
    (tmp_path / "sources" / "20-default.list").write_text(f"yaml file://{data}/keys.yaml\n")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("ROS_")} | {
        "ROSDEP_SOURCE_PATH": str(tmp_path / "sources"),
        "ROSDISTRO_INDEX_URL": f"file://{data}/index-v4.yaml",
        "ROS_HOME": str(tmp_path / "home"),
        "ROS_PYTHON_VERSION": "3",
    }

    def rosdep(*arguments):
        command = [Path(sys.executable).with_name("rosdep"), *arguments]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)

    assert rosdep("update").returncode == 0
    where = ("--from-paths", release_tree, "--ignore-src", "--rosdistro", "jazzy", "--os", "ubuntu:noble")
    checked = rosdep("check", *where)
    assert checked.stderr == ""
    reported = {line.split("\t")[1] for line in checked.stdout.splitlines() if line.startswith("apt\tros-")}
    of_ros = {f"ros-jazzy-{key.replace('_', '-')}" for key in declared_keys() if "-" not in key}
    assert reported == (set() if Path("/opt/ros/jazzy").is_dir() else of_ros)


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
    check = subprocess.run([ROOT / "tools/check_machine.sh", python], capture_output=True, text=True, check=False)
    assert check.returncode == 1
    assert complaint in check.stderr
    assert check.stderr.count("\n") == 1
    assert check.stdout == ""


@pytest.mark.long
def test_tables_of_the_docs_are_those_of_the_results() -> None:
    """No number in README or docs is typed: the committed tables are what the committed results give."""
    done = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "build.py"), "--check"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


def test_every_package_of_the_lock_has_a_hash_and_the_version_of_the_constraints():
    """Written by tools/lock.py from an environment that fits together."""
    lines = [line for line in (ROOT / "requirements.lock").read_text().splitlines() if not line.startswith("#")]
    locked = {}
    for line in lines:
        name, version, digest = re.fullmatch(r"(\S+)==(\S+) --hash=sha256:([0-9a-f]{64})", line).groups()
        locked[canonical(name)] = version
        assert len(set(digest)) > 4, line
    assert len(locked) == len(lines) > 100
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        if line.strip() and not line.startswith("#"):
            requirement = Requirement(line)
            there = locked.get(canonical(requirement.name))
            if there is not None and (requirement.marker is None or requirement.marker.evaluate(LOCKED_FOR)):
                assert requirement.specifier.contains(there), line


def test_the_licence_of_every_package_that_a_user_gets_is_listed():
    """Written by tools/licences.py; what setup.py asks for must be there."""
    rows = (ROOT / "docs" / "licences.md").read_text().splitlines()
    listed = {canonical(row.split("|")[1].strip()): row.split("|")[3].strip() for row in rows if row.startswith("| ")}
    wanted = [Requirement(text) for text in metadata.requires("aircraft_sysid_ros")]
    bench = 'extra == "bench"'
    missing = {canonical(r.name) for r in wanted if bench not in str(r.marker)} - listed.keys()
    assert not missing, f"{missing}: run tools/licences.py and tools/lock.py"
    assert all(listed.values())


#: The machine of requirements.lock.
LOCKED_FOR = {"python_version": "3.11", "python_full_version": "3.11.7"}


def canonical(name):
    return re.sub(r"[-_.]+", "-", name).lower()
