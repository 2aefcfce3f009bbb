"""Launch files, evaluated without ROS 2's launch, which is not on PyPI.

The few classes that our launch files use are put in its place. What comes out is what launch would start: the
executables with names, namespaces, parameters and remappings as arguments.
"""

from __future__ import annotations

import runpy
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import patch

import yaml


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

    def perform(self, context: Context) -> str:
        """Its value."""
        return context.values[self.name]


@dataclass
class Context:
    """LaunchContext: values of arguments, which an included file shares with the one that includes it."""

    values: dict[str, str]
    namespace: str = ""


@dataclass(frozen=True)
class Function:
    """OpaqueFunction."""

    function: Callable[[Context], list[Any]]


@dataclass(frozen=True)
class Source:
    """PythonLaunchDescriptionSource."""

    path: str


@dataclass(frozen=True)
class Include:
    """IncludeLaunchDescription."""

    source: Source
    launch_arguments: Iterable[tuple[str, str]] = ()


@dataclass(frozen=True)
class Group:
    """GroupAction: what is pushed in it ends with it."""

    actions: list[Any]


@dataclass(frozen=True)
class Push:
    """PushRosNamespace."""

    namespace: str


class Node(SimpleNamespace):
    """LifecycleNode."""


def share_of(package: str) -> str:
    """Folder of a package: where its launch and config are."""
    return str(Path(__file__).resolve().parents[2])


def _modules() -> dict[str, ModuleType]:
    contents: dict[str, dict[str, Any]] = {
        "launch": {"LaunchDescription": list, "LaunchContext": Context},
        "launch.actions": {
            "DeclareLaunchArgument": Argument, "OpaqueFunction": Function, "IncludeLaunchDescription": Include,
            "GroupAction": Group,
        },
        "launch.launch_description_sources": {"PythonLaunchDescriptionSource": Source},
        "launch.substitutions": {"LaunchConfiguration": Configuration},
        "launch_ros": {},
        "ament_index_python": {},
        "ament_index_python.packages": {"get_package_share_directory": share_of},
        "launch_ros.actions": {"LifecycleNode": Node, "PushRosNamespace": Push},
    }  # fmt: skip
    made = {name: ModuleType(name) for name in contents}
    for name, content in contents.items():
        vars(made[name]).update(content)
    return made


def _entities(file: Path) -> list[Any]:
    return list(runpy.run_path(str(file))["generate_launch_description"]())


def launch_arguments(file: Path) -> dict[str, str | None]:
    """Arguments of a launch file with their defaults, of those that it includes too; None: it must be given."""
    with patch.dict(sys.modules, _modules()):
        entities = _entities(file)
        included = [Path(entity.source.path) for entity in entities if isinstance(entity, Include)]
    own = {entity.name: entity.default_value for entity in entities if isinstance(entity, Argument)}
    for path in included:
        own = {**launch_arguments(path), **own}
    return own


def launched(file: Path, **given: str) -> dict[str, list[str]]:
    """Executable and its arguments, of each node that the launch file starts with the arguments given."""
    assert set(given) <= set(launch_arguments(file))
    found = started(file, **given)
    assert len({executable for executable, _ in found}) == len(found)
    return dict(found)


def started(file: Path, **given: str) -> list[tuple[str, list[str]]]:
    """As launched, of a file that may start one executable several times."""
    with patch.dict(sys.modules, _modules()):
        return list(_visited(_entities(file), Context(dict(given))))


def _visited(entities: Iterable[Any], context: Context) -> Iterator[tuple[str, list[str]]]:
    for entity in entities:
        if isinstance(entity, Argument):
            value = context.values.setdefault(entity.name, entity.default_value)  # type: ignore[arg-type]
            assert value is not None, f"{entity.name} must be given"
        elif isinstance(entity, Function):
            yield from _visited(entity.function(context), context)
        elif isinstance(entity, Include):
            context.values.update(entity.launch_arguments)
            yield from _visited(_entities(Path(entity.source.path)), context)
        elif isinstance(entity, Group):
            yield from _visited(entity.actions, Context(dict(context.values), context.namespace))
        elif isinstance(entity, Push):
            context.namespace = f"{context.namespace}/{entity.namespace.strip('/')}"
        else:
            yield entity.executable, _node_arguments(entity, context)


def _node_arguments(node: Node, context: Context) -> list[str]:
    namespace = "/" + f"{context.namespace}/{node.namespace}".strip("/")
    rules = {"__node": node.name, "__ns": namespace, **dict(getattr(node, "remappings", []))}
    words = [word for name, value in rules.items() for word in ("-r", f"{name}:={value}")]
    for each in node.parameters:  # in their order: later ones go before earlier ones
        words += [
            "--params-file",
            each if isinstance(each, str) else _file(f"{namespace.rstrip('/')}/{node.name}", each),
        ]
    return ["--ros-args", *words]


def _file(node: str, values: dict[str, Any]) -> str:
    """Parameters of a node by its whole name, as launch_ros writes them."""
    path = Path(tempfile.mkdtemp(prefix="launch_params_")) / "params.yaml"
    path.write_text(yaml.safe_dump({node: {"ros__parameters": values}}), encoding="utf8")
    return str(path)
