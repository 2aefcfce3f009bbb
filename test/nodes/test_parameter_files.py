"""Files of parameters, namespaces and remappings with processes: what is in use, and a sentence for what cannot be."""

import subprocess

import pytest
import yaml
from processes import ours
from rcl_interfaces.srv import GetParameters
from test_launch import ROOT
from waiting import LONGEST

WHOLE = yaml.safe_load((ROOT / "config" / "params.yaml").read_text())
PATTERN = "/**/state_estimator"


def node(tmp_path, content, *more):
    """Command of a state estimator with a file of parameters."""
    file = tmp_path / "params.yaml"
    file.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return [*ours("nodes.state_estimator"), "--ros-args", "--params-file", str(file), *more]


def ended(command):
    """What a process says that ends by itself."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST, check=False)
    assert "Traceback" not in done.stdout + done.stderr
    return done.returncode, done.stderr


@pytest.mark.parametrize("namespace", ["", "uav1"])
def test_the_file_of_the_repository_with_changed_lines(bench, aircraft_file, tmp_path, namespace):
    section = WHOLE[PATTERN]["ros__parameters"] | {"gate": 7.0, "horizn": 1.0, "autostart": False}
    command = node(tmp_path, WHOLE | {PATTERN: {"ros__parameters": section}}, "-r", f"__ns:=/{namespace}")
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        service = f"{'/' if namespace else ''}{namespace}/state_estimator/get_parameters"
        found = bench.call(GetParameters, service, names=["gate", "horizon", "calm_air"]).values
        assert [found[0].double_value, found[1].double_value, found[2].bool_value] == [7.0, 0.5, False]
    finally:
        running.terminate()
        said = running.communicate(timeout=LONGEST)[1]
    assert "active" not in said and "the parameter horizn is not one of this node: did you mean horizon?" in said


def test_a_namespace_moves_every_topic_and_a_remapping_one(bench):
    rules = ["-r", "__ns:=/uav1", "-r", "state_estimator/state:=/other/state"]
    running = subprocess.Popen([*ours("nodes.overview"), "--ros-args", *rules], stderr=subprocess.DEVNULL)
    try:
        for topic in ("/other/state", "/uav1/parameter_estimator/parameters", "/diagnostics"):
            bench.spin_until(lambda topic=topic: bench.helper.get_subscriptions_info_by_topic(topic))
        assert not bench.helper.get_subscriptions_info_by_topic("/uav1/state_estimator/state")
    finally:
        running.terminate()
        running.wait(timeout=LONGEST)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({PATTERN: {"ros__parameters": {"gate": 500.0}}}, "gate"),
        ({PATTERN: {"ros__parameters": {"gate": "wide"}}}, "gate"),
        ({PATTERN: {"ros__parameters": {"aircraft_file": "/nowhere.yaml"}}}, "nowhere.yaml"),
        ({PATTERN: {"gate": 5.0}}, "params"),
        ("{", "params"),
        (None, "aircraft_file is empty"),
    ],
)
def test_a_file_that_cannot_be_is_said(tmp_path, content, words):
    command = node(tmp_path, content) if content is not None else ours("nodes.state_estimator")
    status, said = ended(command)
    assert status == 2 and words in said.strip().splitlines()[-1]


def test_a_file_that_is_not_there_is_said(tmp_path):
    status, said = ended([*ours("nodes.overview"), "--ros-args", "--params-file", str(tmp_path / "nowhere.yaml")])
    assert status == 2 and "nowhere.yaml" in said
