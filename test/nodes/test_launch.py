"""The launch file: read as text everywhere, and made where ROS 2's launch is installed."""

import ast
import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "launch" / "live.launch.py"
ARGUMENTS = {"aircraft_file", "namespace", "autostart", "input_reliability"}


def calls(name):
    tree = ast.parse(FILE.read_text(encoding="utf8"))
    return [n for n in ast.walk(tree) if isinstance(n, ast.Call) and getattr(n.func, "id", None) == name]


def test_it_compiles_and_has_its_arguments():
    compile(FILE.read_text(encoding="utf8"), FILE.name, "exec")
    declared = {call.args[0].value for call in calls("DeclareLaunchArgument")}
    used = {call.args[0].value for call in calls("LaunchConfiguration")}
    assert declared == used == ARGUMENTS
    arguments = {c.args[0].value: {k.arg for k in c.keywords} for c in calls("DeclareLaunchArgument")}
    optional = {name for name, keywords in arguments.items() if "default_value" in keywords}
    assert optional == ARGUMENTS - {"aircraft_file"}


def test_its_nodes_are_executables_of_this_package():
    source = FILE.read_text(encoding="utf8")
    names = ast.literal_eval(source.split("NODES = ")[1].splitlines()[0])
    scripts = (ROOT / "setup.py").read_text(encoding="utf8")
    for name in names:
        assert f'"{name} = aircraft_sysid_ros.nodes.{name}:main"' in scripts
    (node,) = calls("LifecycleNode")
    given = {k.arg for k in node.keywords}
    assert {"package", "executable", "name", "namespace", "parameters"} <= given
    assert {"sigterm_timeout", "sigkill_timeout"} <= given  # a node that is far behind has time to end


def test_its_parameters_are_those_of_the_nodes(bench):
    from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
    from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode

    kinds = {call.args[0].args[0].value: call.keywords[0].value.id for call in calls("ParameterValue")}
    for kind in (StateEstimatorNode, ParameterEstimatorNode):
        node = bench.node(kind)
        for name, type_name in kinds.items():
            assert type(node.get_parameter(name).value).__name__ == type_name


def test_the_description_is_made_where_launch_is_installed():
    pytest.importorskip("launch_ros.actions")
    spec = importlib.util.spec_from_file_location("live_launch", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    entities = module.generate_launch_description().entities
    assert sum(type(entity).__name__ == "LifecycleNode" for entity in entities) == 2
