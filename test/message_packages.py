"""Message packages of others for tests with real processes: px4_msgs, tf2_msgs, which come with no wheel.

The definitions in ``interfaces/`` have the fields that matter here, as the public ones. They are built against
the wheels into a folder of their own, once for each content; processes see them only with ``environment``.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
DEFINITIONS = HERE / "interfaces"
BUILD = HERE.parent / "build" / "message_packages"
CMAKE = """
cmake_minimum_required(VERSION 3.16)
project({name})
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
file(GLOB definitions RELATIVE "${{CMAKE_CURRENT_SOURCE_DIR}}" msg/*.msg)
rosidl_generate_interfaces({name} ${{definitions}} DEPENDENCIES geometry_msgs)
# As in msg_defs/CMakeLists.txt: an include folder of the machine that built the wheels.
get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
foreach(target IN LISTS targets)
  get_target_property(includes "${{target}}" INTERFACE_INCLUDE_DIRECTORIES)
  if(target MATCHES "__rosidl_generator_py$" AND includes)
    list(FILTER includes EXCLUDE REGEX "^/opt/python/")
    set_target_properties("${{target}}" PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${{includes}}")
  endif()
endforeach()
ament_package()
"""
MANIFEST = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>0.0.0</version>
  <description>Some fields of some messages of {name}, for tests.</description>
  <maintainer email="maintainers@aircraft-sysid-ros.invalid">aircraft_sysid_ros maintainers</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>geometry_msgs</depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""


def environment(name: str) -> dict[str, str]:
    """This environment with a package in it, built if it is not there yet."""
    prefix = _built(name)
    (packages,) = prefix.glob("lib/python3*/site-packages")
    libraries = str(prefix / "lib")
    more = {"PYTHONPATH": str(packages), "LD_LIBRARY_PATH": libraries}
    return os.environ | {key: f"{path}:{os.environ.get(key, '')}".rstrip(":") for key, path in more.items()}


def _built(name: str) -> Path:
    contents = [CMAKE, MANIFEST, sys.version, *(f.name + f.read_text() for f in sorted((DEFINITIONS / name).iterdir()))]
    prefix = BUILD / f"{name}_{hashlib.sha256(''.join(contents).encode()).hexdigest()[:12]}"
    if not prefix.exists():
        source, build, made = (prefix.with_suffix(f".{part}") for part in ("source", "build", "install"))
        for folder in (source, build, made):
            shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(DEFINITIONS / name, source / "msg")
        (source / "CMakeLists.txt").write_text(CMAKE.format(name=name))
        (source / "package.xml").write_text(MANIFEST.format(name=name))
        _build(source, build, made)
        made.rename(prefix)  # whole or not at all
    return prefix


def _build(source: Path, build: Path, made: Path) -> None:
    wheels = sys.prefix
    path = f"{wheels}/bin:{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "AMENT_PREFIX_PATH": wheels, "CMAKE_PREFIX_PATH": wheels}
    where = [f"-DCMAKE_INSTALL_PREFIX={made}", f"-DPython3_EXECUTABLE={wheels}/bin/python"]
    for command in (
        ["cmake", "-S", source, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Debug", "-DBUILD_TESTING=OFF", *where],
        ["cmake", "--build", build, "-j", "2"],
        ["cmake", "--install", build],
    ):
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
