"""The way of a ROS developer: the colcon workspace, launched; lifecycle, parameters, services and bags from outside."""

import json
import shutil
import socket
from contextlib import ExitStack, suppress
from importlib import import_module

import pytest
import yaml
from documented_commands import ROOT, answer_to
from launch_files import launched

pytest.importorskip("rclpy")
pytest.importorskip("aircraft_sysid_msgs.msg")

from aircraft_sysid_msgs.msg import MissingEffects, Parameter, Parameters
from aircraft_sysid_msgs.srv import LoadModel, RemoveEffect, Reset, SaveModel
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.parameter import Parameter as RosParameter
from recorder import Recorder
from user import PATIENCE

from aircraft_sysid_ros.ros_messages.conversion import TOPICS

WAY = {
    "simulate": ("README.md", "aircraft-sysid simulate --out flight"),
    "launch": ("README.md", "ros2 launch aircraft_sysid_ros live.launch.py"),
    "set": ("docs/nodes.md", "ros2 param set /state_estimator"),
    "refused": ("docs/nodes.md", "ros2 param set /parameter_estimator"),
    "echo": ("docs/live-diagnosis.md", "ros2 topic echo /parameter_estimator/missing_effects"),
    "play": ("README.md", "play flight --rate 2"),
    "replay": ("README.md", "aircraft-sysid replay flight --aircraft"),
    "call": ("docs/live-diagnosis.md", "ros2 service call /parameter_estimator/add_effect"),
    "bridge": ("docs/mavlink.md", "ros2 run aircraft_sysid_ros mavlink_bridge"),
}
SECONDS = 90  # of flight: missing effects are looked for from 80 s on
HORIZON = 4.0  # [s] by which samples may be late: the flight is played fast
UAV = "/uav1"
NODES = ("state_estimator", "parameter_estimator")
INSTALL = ROOT / "build" / "colcon" / "install"
PREFIX = INSTALL / "aircraft_sysid_ros"
EXECUTABLES = PREFIX / "lib" / "aircraft_sysid_ros"
STATUS = {Parameter.USE: "USE", Parameter.HOLD: "HOLD", Parameter.REJECT: "REJECT"}


@pytest.fixture
def built():
    """The workspace that `make colcon` builds."""
    if not (INSTALL / "setup.bash").exists():
        pytest.skip("no workspace: make colcon builds it, which make test does before the tests")
    lend_kernels()


@pytest.fixture
def workspace(built, user):
    """A user whose terminals have sourced it."""
    user.source(INSTALL / "setup.bash")
    user.environment["PATH"] = f"{EXECUTABLES}:{user.environment['PATH']}"
    return user


def lend_kernels():
    """Compiled kernels of this environment for the same sources in the workspace: to compile them takes minutes."""
    (package,) = PREFIX.glob("lib/python*/site-packages/aircraft_sysid_ros")
    for kernel in (ROOT / "aircraft_sysid_ros").rglob("*.nb[ic]"):
        target = package / kernel.relative_to(ROOT / "aircraft_sysid_ros")
        if not target.exists() or target.stat().st_mtime_ns < kernel.stat().st_mtime_ns:
            target.parent.mkdir(exist_ok=True)
            shutil.copy2(kernel, target)


def test_from_a_workspace_to_a_bag(workspace, bench, tmp_path):
    user = workspace
    user.run("simulate", "--duration", SECONDS)
    user.environment["HOME"] = str(tmp_path)  # models are there, where nothing else is said
    with ExitStack() as terminals:
        processes = [terminals.enter_context(terminal) for terminal in launch(user)]
        configured(user, bench)
        sets = bench.listen(Parameters, f"{UAV}/parameter_estimator/parameters")
        flown(user, bench)
        recorded(user)
        same_as_replayed(user, bench, sets)
        extended(user, bench, tmp_path / ".ros/aircraft_sysid_ros/models/model.json")
        for node in NODES:
            transit(bench, node, Transition.TRANSITION_CLEANUP, "unconfigured")
        for running in processes:
            running.interrupt()
    bridged(user, bench)


def launch(user):
    """Terminals of what the installed launch file starts: executables of the workspace, with their arguments."""
    _, package, file = user.told("launch").words[1:4]
    given = {"aircraft_file": f"{PREFIX}/share/{package}/config/ultra_stick_25e.yaml", "namespace": UAV.strip("/")}
    given |= {"autostart": "false", "input_reliability": "reliable"}
    nodes = launched(PREFIX / "share" / package / "launch" / file, **given)
    assert tuple(nodes) == NODES
    return [user.open_terminal(name, [str(EXECUTABLES / name), *words]) for name, words in nodes.items()]


def service(node, name):
    return f"{UAV}/{node}/{name}"


def transit(bench, node, transition, label):
    """One transition of a lifecycle node, and the state that it leads to."""
    request = Transition(id=transition)
    assert bench.call(ChangeState, service(node, "change_state"), transition=request).success
    assert bench.call(GetState, service(node, "get_state")).current_state.label == label


def put(bench, node, name, value):
    """Set one parameter; the result."""
    parameter = RosParameter(name, value=value).to_parameter_msg()
    return bench.call(SetParameters, service(node, "set_parameters"), parameters=[parameter]).results[0]


def configured(user, bench):
    """Parameters read, described and set, refused where they make no sense; configured and active; set once more."""
    for node in NODES:
        assert bench.call(GetState, service(node, "get_state")).current_state.label == "unconfigured"
        names = ["aircraft_file", "input_reliability"]
        file, reliability = bench.call(GetParameters, service(node, "get_parameters"), names=names).values
        assert file.string_value.startswith(str(PREFIX)) and reliability.string_value == "reliable"
        for descriptor in bench.call(DescribeParameters, service(node, "describe_parameters"), names=names).descriptors:
            assert descriptor.description
    refused = put(bench, "state_estimator", "horizon", 9.0)
    assert not refused.successful and "range" in refused.reason
    assert put(bench, "parameter_estimator", "diagnosis_period", 10.0).successful
    for node in NODES:
        transit(bench, node, Transition.TRANSITION_CONFIGURE, "inactive")
        transit(bench, node, Transition.TRANSITION_ACTIVATE, "active")
    for step in ("set", "refused"):
        node, name, value = user.told(step).words[3:]
        result = put(bench, node.strip("/"), name, float(value))
        answer = "Set parameter successful" if result.successful else f"Setting parameter failed: {result.reason}"
        assert answer == answer_to(user.told(step))
    assert put(bench, "state_estimator", "horizon", HORIZON).successful


def flown(user, bench):
    """The flight played to the nodes, which find what it hides meanwhile."""
    found = bench.listen(MissingEffects, UAV + user.told("echo").words[3])
    user.run("play", "--topic-prefix", UAV, "--wait", 60, **{"2": 10})
    bench.spin_until(lambda: bool(found))
    assert (found[0].verdict, found[0].candidates[0].effect) == ("missing", "sideslip_drag")
    for node in NODES:
        transit(bench, node, Transition.TRANSITION_DEACTIVATE, "inactive")


def recorded(user):
    """The flight played once more, to a recorder."""
    topics = ("imu/data", "gps/fix", "gps/vel", "air_data", "control_surfaces")
    with (
        Recorder({f"{UAV}/{topic}": TOPICS[topic] for topic in topics}) as recorder,
        user.start("play", "--topic-prefix", UAV, "--wait", 60, "--json", **{"2": 20}) as playing,
    ):
        recorder.spin_until(lambda: playing.process.poll() is not None, PATIENCE)
        sent = json.loads(playing.end())["messages"]
        recorder.spin_until(lambda: recorder.counts == sent, PATIENCE)
        recorder.write(user.folder / "recorded")


def same_as_replayed(user, bench, sets):
    """What the nodes published last is what a replay of the bag that was recorded gives."""
    replayed = user.ask("replay", "--horizon", HORIZON, **{"flight": "recorded", "runs/flight": "runs/recorded"})
    expected = {p["name"]: (p["value"], p["std"], p["status"]) for p in replayed["parameters"]["parameters"]}

    def newest():
        return {p.name: (p.value, p.standard_deviation, STATUS[p.status]) for p in sets[-1].parameters}

    with suppress(AssertionError):  # the last message may come after the answer of the service that made it
        bench.spin_until(lambda: newest() == expected, 60.0)
    assert newest() == expected
    assert sets[-1].model == replayed["parameters"]["model"]


def extended(user, bench, path):
    """An effect added by the call of the page and removed, the model saved, forgotten and loaded."""
    called, kind, request = user.told("call").words[3:]
    package, _, name = kind.split("/")
    added = bench.call(getattr(import_module(f"{package}.srv"), name), UAV + called, **yaml.safe_load(request))
    assert added.success, added.message
    call = lambda kind, name, **fields: bench.call(kind, service("parameter_estimator", name), **fields)  # noqa: E731
    refused = call(RemoveEffect, "remove_effect", effect="no_such_effect")
    assert not refused.success and "no_such_effect" in refused.message
    removed = call(RemoveEffect, "remove_effect", **yaml.safe_load(request))
    assert removed.success and removed.model != added.model
    saved = call(SaveModel, "save_model", path=path.name)
    assert saved.success, saved.message
    assert call(Reset, "reset").success
    loaded = call(LoadModel, "load_model", path=path.name)
    assert loaded.success and loaded.model == removed.model
    again = path.with_name("again.json")
    assert call(SaveModel, "save_model", path=again.name).success
    before, after = (json.loads(file.read_text(encoding="utf8")) for file in (path, again))
    assert before["model"] == after["model"] == removed.model and before["learnt"] == after["learnt"]


def bridged(user, bench):
    """The bridge as a node of its own, with the parameters of the page."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        connection = f"udp:127.0.0.1:{probe.getsockname()[1]}"
    given = {"connection": connection, "servo_file": "config/mavlink_simulator_servos.yaml"}
    _, _, executable, *words = user.told("bridge").words[1:]
    words = [f"{name}:={given[name]}" if colon else name for name, colon, _ in (w.partition(":=") for w in words)]
    with user.open_terminal("bridge", [str(EXECUTABLES / executable), *words]) as running:
        state = f"/{executable}/get_state"
        bench.spin_until(lambda: bench.call(GetState, state).current_state.label == "active")
        values = bench.call(GetParameters, f"/{executable}/get_parameters", names=list(given)).values
        assert [value.string_value for value in values] == list(given.values())
        running.interrupt()
