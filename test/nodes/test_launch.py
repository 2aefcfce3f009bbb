"""The launch files: what they start, read without ROS 2's launch, and made where it is installed."""

import importlib.util
import re
import sys
from pathlib import Path

import pytest
import yaml

sys.path.append(str(Path(__file__).resolve().parents[1] / "documented_ways"))
from launch_files import launch_arguments, launched, started

ROOT = Path(__file__).resolve().parents[2]
LAUNCH = ROOT / "launch"
ESTIMATORS = ["state_estimator", "parameter_estimator"]
#: What a file starts with the fewest arguments.
STARTS = {
    "live.launch.py": ESTIMATORS,
    "mavros.launch.py": ["mavlink_bridge", *ESTIMATORS],
    "px4.launch.py": ["px4_bridge", *ESTIMATORS],
}


def parameters(words):
    """Parameters of a node in the order in which they are given, of files that are written for it and others."""
    files = [words[i + 1] for i, word in enumerate(words) if word == "--params-file"]
    return [yaml.safe_load(Path(file).read_text()) for file in files]


def given(words):
    """What the last of its files says."""
    ((_, content),) = parameters(words)[-1].items()
    return content["ros__parameters"]


@pytest.mark.parametrize("name", STARTS)
def test_it_starts_executables_of_this_package(name):
    found = launched(LAUNCH / name)
    assert list(found) == STARTS[name]
    scripts = (ROOT / "setup.py").read_text(encoding="utf8")
    for executable in found:
        assert f'"{executable} = aircraft_sysid_ros.nodes.{executable}:main"' in scripts


@pytest.mark.parametrize("name", STARTS)
def test_nothing_but_a_file_of_parameters_is_needed_and_the_line_goes_before_it(name, tmp_path):
    assert None not in launch_arguments(LAUNCH / name).values()
    file = tmp_path / "params.yaml"
    file.write_text("{}")
    for executable, words in launched(LAUNCH / name, params_file=str(file), aircraft_file="a.yaml").items():
        assert words[words.index("--params-file") + 1] == str(file)
        if executable in ESTIMATORS:
            assert given(words)["aircraft_file"] == "a.yaml" and "autostart" not in given(words)


def test_values_have_the_types_of_the_parameters(bench):
    from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
    from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode

    texts = {"autostart": "false", "use_sim_time": "true", "publish_tf": "true", "input_reliability": "reliable"}
    found = launched(LAUNCH / "live.launch.py", aircraft_file="a.yaml", frame_prefix="uav1/", **texts)
    for kind, executable in zip((StateEstimatorNode, ParameterEstimatorNode), ESTIMATORS, strict=True):
        node = bench.node(kind)
        for name, value in given(found[executable]).items():
            assert type(node.get_parameter(name).value) is type(value), name


def test_the_overview_is_started_where_it_is_asked_for():
    found = launched(LAUNCH / "live.launch.py", overview="true", namespace="uav1", autostart="false")
    assert list(found) == [*ESTIMATORS, "overview"] and given(found["overview"]) == {"autostart": False}
    assert "overview" in launched(LAUNCH / "live.launch.py", overview="True")
    with pytest.raises(ValueError, match="overview:=maybe is neither true nor false"):
        launched(LAUNCH / "live.launch.py", overview="maybe")
    assert all("__ns:=/uav1" in words for words in found.values())


def test_the_file_of_parameters_holds_the_defaults_of_the_nodes():
    from importlib import import_module

    content = yaml.safe_load((ROOT / "config" / "params.yaml").read_text())
    names = [pattern.removeprefix("/**/") for pattern in content]
    assert names == [*ESTIMATORS, "mavlink_bridge", "px4_bridge", "overview"]
    for pattern, each in content.items():
        module = import_module(f"aircraft_sysid_ros.nodes.{pattern.removeprefix('/**/')}")
        defaults = {name: option.default for name, option in declared(module).items()}
        assert each["ros__parameters"] == defaults
        assert [type(value) for value in each["ros__parameters"].values()] == [type(v) for v in defaults.values()]


def declared(module):
    from aircraft_sysid_ros.nodes.estimator_node import COMMON

    return {**(COMMON if module.__name__.endswith("estimator") else {}), **module.OPTIONS}


#: The page's example of a launch file of one's own, written beside ours.
EXAMPLE = re.compile(r"```python\n((?:(?!```).)*PushRosNamespace.*?)```", re.DOTALL)


def test_the_example_of_two_aeroplanes_includes_ours_in_two_namespaces(tmp_path):
    file = tmp_path / "two.launch.py"
    file.write_text(EXAMPLE.search((ROOT / "docs" / "ros.md").read_text(encoding="utf8"))[1])
    found = started(file)
    assert [(executable, words[words.index("-r", 2) + 1]) for executable, words in found] == [
        (executable, f"__ns:=/{name}") for name in ("uav1", "uav2") for executable in ESTIMATORS
    ]
    for (_, words), name in zip(found, ["uav1"] * 2 + ["uav2"] * 2, strict=True):
        assert given(words)["frame_prefix"] == f"{name}/" and given(words)["aircraft_file"].endswith(f"{name}.yaml")


@pytest.mark.parametrize("name", STARTS)
def test_the_description_is_made_where_launch_is_installed(name):
    pytest.importorskip("launch_ros.actions")
    spec = importlib.util.spec_from_file_location("launch_file", LAUNCH / name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.generate_launch_description().entities
