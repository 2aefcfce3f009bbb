"""Files of parameters, namespaces and remappings with processes: what is in use, and a sentence for what cannot be."""

import subprocess

import pytest
import yaml
from processes import ours
from rcl_interfaces.srv import GetParameters
from test_launch import ROOT
from waiting import LONGEST

WHOLE = yaml.safe_load((ROOT / "config" / "params.yaml").read_text())
PATTERN = "/**/overview"


def node(tmp_path, content, *more):
    """Command of a node, of the one that starts soonest, with a file of parameters."""
    file = tmp_path / "params.yaml"
    file.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return [*ours("nodes.overview"), "--ros-args", "--params-file", str(file), *more]


def ended(command):
    """What a process says that ends by itself."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST, check=False)
    assert "Traceback" not in done.stdout + done.stderr
    return done.returncode, done.stderr


def test_the_file_of_the_repository_with_changed_lines(bench, tmp_path):
    section = WHOLE[PATTERN]["ros__parameters"] | {"patience": 7.0, "patienc": 1.0, "autostart": False}
    command = node(tmp_path, WHOLE | {PATTERN: {"ros__parameters": section}}, "-r", "__ns:=/uav1")
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        service = "/uav1/overview/get_parameters"
        found = bench.call(GetParameters, service, names=["patience", "autostart", "name"]).values
        assert (found[0].double_value, found[1].bool_value, found[2].string_value) == (7.0, False, "")
    finally:
        running.terminate()
        said = running.communicate(timeout=LONGEST)[1]
    assert "active" not in said and "the parameter patienc is not one of this node: did you mean patience?" in said


@pytest.mark.long
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


@pytest.mark.long
@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({PATTERN: {"ros__parameters": {"patience": 500.0}}}, "patience out of range"),
        ({PATTERN: {"ros__parameters": {"patience": "long"}}}, "'patience' to 'long'"),
        ({PATTERN: {"patience": 5.0}}, "params.yaml"),
        ("{", "params.yaml"),
        (None, "params.yaml"),
    ],
)
def test_a_file_that_cannot_be_is_said(tmp_path, content, words):
    command = node(tmp_path, content or "")
    if content is None:
        (tmp_path / "params.yaml").unlink()
    status, said = ended(command)
    assert status == 2 and words in said.strip().splitlines()[-1]
