"""Launch files, evaluated without ROS 2's launch, which is not on PyPI.

The few classes that our launch files use are put in its place. What comes out is what launch would start: the
executables with names, namespaces, parameters and remappings as arguments.
"""

from __future__ import annotations

import runpy
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import patch


@dataclass(frozen=True)
class Argument:
    """DeclareLaunchArgument."""

    name: str
    default_value: str | None = None
    description: str = ""


@dataclass(frozen=True)
class Configuration:
    """LaunchConfiguration."""

    name: str


@dataclass(frozen=True)
class Value:
    """ParameterValue."""

    value: Any
    value_type: type = str


class Node(SimpleNamespace):
    """LifecycleNode."""


def _modules() -> dict[str, ModuleType]:
    contents: dict[str, dict[str, Any]] = {
        "launch": {"LaunchDescription": list},
        "launch.actions": {"DeclareLaunchArgument": Argument},
        "launch.substitutions": {"LaunchConfiguration": Configuration},
        "launch_ros": {},
        "launch_ros.actions": {"LifecycleNode": Node},
        "launch_ros.parameter_descriptions": {"ParameterValue": Value},
    }
    made = {name: ModuleType(name) for name in contents}
    for name, content in contents.items():
        vars(made[name]).update(content)
    return made


def _entities(file: Path) -> list[Any]:
    with patch.dict(sys.modules, _modules()):
        return list(runpy.run_path(str(file))["generate_launch_description"]())


def launch_arguments(file: Path) -> dict[str, str | None]:
    """Arguments of a launch file with their defaults; None: it must be given."""
    return {entity.name: entity.default_value for entity in _entities(file) if isinstance(entity, Argument)}


def launched(file: Path, **given: str) -> dict[str, list[str]]:
    """Executable and its arguments, of each node that the launch file starts with the arguments given."""
    entities = _entities(file)
    values = {e.name: given.get(e.name, e.default_value) for e in entities if isinstance(e, Argument)}
    assert set(given) <= set(values) and None not in values.values()
    return {e.executable: _node_arguments(e, values) for e in entities if isinstance(e, Node)}


def _node_arguments(node: Node, values: Mapping[str, str | None]) -> list[str]:
    rules = {"__node": node.name, "__ns": "/" + _resolved(node.namespace, values).strip("/")}
    rules |= {ours: _resolved(theirs, values) for ours, theirs in getattr(node, "remappings", [])}
    parameters = {name: _resolved(value, values) for each in node.parameters for name, value in each.items()}
    listed = [("-r", f"{name}:={value}") for name, value in rules.items()]
    listed += [("-p", f"{name}:={value}") for name, value in parameters.items() if value != ""]
    return ["--ros-args", *(word for pair in listed for word in pair)]


def _resolved(value: Any, values: Mapping[str, str | None]) -> str:
    if isinstance(value, Configuration):
        return str(values[value.name])
    if isinstance(value, Value):
        return _resolved(value.value, values)
    if isinstance(value, list):
        return "".join(_resolved(part, values) for part in value)
    return str(value)
