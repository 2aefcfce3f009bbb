"""The nodes as a lifecycle manager and other programs meet them: transitions, parameters, services."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from aircraft_sysid_msgs.msg import AircraftState
from aircraft_sysid_msgs.srv import AddEffect, LoadModel, RemoveEffect, Reset, SaveModel
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from waiting import LONGEST

from aircraft_sysid_ros.nodes import parameter_estimator, state_estimator
from aircraft_sysid_ros.nodes.mavlink_bridge import MavlinkBridgeNode
from aircraft_sysid_ros.nodes.overview import OverviewNode
from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode

CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
KINDS = [StateEstimatorNode, ParameterEstimatorNode]


def executable(name, *parameters):
    arguments = [a for parameter in parameters for a in ("-p", parameter)]
    command = [sys.executable, "-m", f"aircraft_sysid_ros.nodes.{name}"]
    return command + (["--ros-args", *arguments] if arguments else [])


def change(bench, name, transition):
    response = bench.call(ChangeState, f"/{name}/change_state", transition=Transition(id=transition))
    return response.success


def label(bench, name):
    return bench.call(GetState, f"/{name}/get_state").current_state.label


# -- starting --------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "parameters", "text"),
    [
        ("state_estimator", [], "aircraft_file is empty"),
        ("parameter_estimator", ["aircraft_file:=nowhere.yaml"], "cannot read the aircraft file nowhere"),
        pytest.param("state_estimator", ["aircraft_file:=BAD"], "mass must be positive", marks=pytest.mark.long),
        pytest.param(
            "state_estimator",
            ["aircraft_file:=GOOD", "input_reliability:=maybe"],
            "not 'maybe'",
            marks=pytest.mark.long,
        ),
        ("state_estimator", ["aircraft_file:=GOOD", "horizon:=9.0"], "out of range"),
        ("parameter_estimator", ["aircraft_file:=GOOD", "step:=quick"], "'quick'"),
    ],
)
def test_an_executable_that_cannot_start_says_why_once(aircraft_file, tmp_path, name, parameters, text):
    bad = tmp_path / "bad.yaml"
    bad.write_text(aircraft_file.read_text().replace("mass: 1.959", "mass: -1.959"))
    given = [p.replace("BAD", str(bad)).replace("GOOD", str(aircraft_file)) for p in parameters]
    done = subprocess.run(executable(name, *given), capture_output=True, text=True, timeout=LONGEST, check=False)
    lines = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    assert done.returncode == 2, lines
    assert len(lines) == 1, lines
    assert text in lines[0]


@pytest.mark.parametrize("name", ["state_estimator", "parameter_estimator"])
def test_an_executable_ends_in_order_at_a_signal(name):
    process = subprocess.Popen(
        executable(name, "autostart:=false"), stderr=subprocess.PIPE, text=True, env={**os.environ}
    )
    time.sleep(1.0)
    for _ in range(100):  # it may come while Python is still importing
        process.send_signal(signal.SIGTERM)
        if process.poll() is not None:
            break
        time.sleep(0.1)
    errors = process.communicate(timeout=LONGEST)[1]
    assert process.returncode in (0, -signal.SIGTERM)
    assert "Traceback" not in errors


@pytest.mark.parametrize("kind", KINDS)
def test_configuring_without_an_aircraft_fails_and_can_be_mended(bench, aircraft_file, kind):
    node = bench.node(kind, aircraft_file="")
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    assert label(bench, node.get_name()) == "unconfigured"
    node.set_parameters([Parameter("aircraft_file", value=str(aircraft_file))])
    assert change(bench, node.get_name(), CONFIGURE)
    assert label(bench, node.get_name()) == "inactive"


# -- transitions -----------------------------------------------------------------------------------------


@pytest.mark.long
def test_activated_again_the_state_goes_on(bench, raw):
    node = bench.node(StateEstimatorNode)
    states = bench.listen(AircraftState, "state_estimator/state")
    assert change(bench, "state_estimator", CONFIGURE)
    assert change(bench, "state_estimator", ACTIVATE)
    bench.play(raw, 0.0, 6.0, node)
    assert change(bench, "state_estimator", DEACTIVATE)
    bench.spin_until(lambda: len(states) == node.rows_published)
    first = len(states)
    assert first > 400
    assert not node.inputs
    assert change(bench, "state_estimator", ACTIVATE)
    bench.play(raw, 6.0, 10.0, node)
    assert change(bench, "state_estimator", DEACTIVATE)
    bench.spin_until(lambda: len(states) == node.rows_published)
    assert len(states) > first + 350
    assert states[-1].status == AircraftState.STATUS_OK
    assert node.estimator.realignments == 0  # it was silent for less than the filter integrates


@pytest.mark.parametrize("kind", KINDS)
def test_cleaned_up_and_configured_again_there_is_one_of_each(bench, kind):
    node = bench.node(kind)
    name = node.get_name()
    for _ in range(2):
        for transition in (CONFIGURE, ACTIVATE, DEACTIVATE, CLEANUP):
            assert change(bench, name, transition)
    bench.spin_until(lambda: node.count_services(f"/{name}/reset") == 0, 10.0)
    assert node.estimator is None
    assert change(bench, name, CONFIGURE)
    bench.spin_until(lambda: node.count_publishers("/diagnostics") == 1, 10.0)
    assert node.count_services(f"/{name}/reset") == 1
    assert bench.call(Reset, f"/{name}/reset").success


@pytest.mark.parametrize("kind", KINDS)
def test_shut_down_while_active_it_listens_no_more(bench, kind):
    node = bench.node(kind)
    for transition in (CONFIGURE, ACTIVATE, Transition.TRANSITION_ACTIVE_SHUTDOWN):
        assert change(bench, node.get_name(), transition)
    assert label(bench, node.get_name()) == "finalized"
    assert not node.inputs


@pytest.mark.parametrize("kind", [*KINDS, MavlinkBridgeNode])
def test_destroyed_it_is_gone_from_the_graph(bench, kind):
    """One that stays, answers nothing, but is found by those who ask: they wait for ever."""
    node = kind(parameter_overrides=[Parameter("aircraft_file", value=bench.aircraft_file)], use_global_arguments=False)
    name = node.get_name()
    bench.spin_until(lambda: name in bench.helper.get_node_names(), 60.0)
    assert bench.helper.count_services(f"/{name}/get_state") == 1
    node.destroy_node()
    bench.spin_until(lambda: name not in bench.helper.get_node_names(), 60.0)
    assert bench.helper.count_services(f"/{name}/get_state") == 0


@pytest.mark.parametrize("kind", [*KINDS, MavlinkBridgeNode, OverviewNode])
def test_a_transition_that_the_state_does_not_have_is_answered(bench, capfd, kind):
    """rclpy raises, prints a trace of it, and never answers."""
    node = bench.node(kind)
    name = node.get_name()
    assert not change(bench, name, ACTIVATE)
    assert not change(bench, name, 77)
    wanted = Transition(id=CONFIGURE, label="fly away")  # a label goes before a number
    assert not bench.call(ChangeState, f"/{name}/change_state", transition=wanted).success
    said = "".join(capfd.readouterr())
    for text in ("'activate' is refused: the node is unconfigured (possible: configure, shutdown)", "'transition 77'"):
        assert text in said
    assert "'fly away' is refused" in said
    assert not any(word in said for word in ("Traceback", "FATAL", "rcl_lifecycle"))
    assert label(bench, name) == "unconfigured"
    assert change(bench, name, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
    assert not change(bench, name, CONFIGURE)
    assert "the node is finalized (it is the last one)" in "".join(capfd.readouterr())


# -- parameters ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("module", [state_estimator, parameter_estimator])
def test_parameters_are_described_and_keep_their_ranges(bench, module):
    kind = StateEstimatorNode if module is state_estimator else ParameterEstimatorNode
    node = bench.node(kind)
    name = node.get_name()
    assert change(bench, name, CONFIGURE)  # what on_configure sets must not hide the parameters
    names = list(bench.call(ListParameters, f"/{name}/list_parameters").result.names)
    common = {"aircraft_file", "autostart", "input_reliability", "input_depth"}
    assert common | set(module.OPTIONS) <= set(names)
    ours = sorted(common | set(module.OPTIONS))
    descriptors = bench.call(DescribeParameters, f"/{name}/describe_parameters", names=ours).descriptors
    for descriptor in descriptors:
        assert len(descriptor.description) > 10, descriptor.name
    values = bench.call(GetParameters, f"/{name}/get_parameters", names=ours).values
    assert values[ours.index("aircraft_file")].string_value == bench.aircraft_file
    for option, limits in module.OPTIONS.items():
        if limits.low is None:
            continue
        default = node.get_parameter(option).value
        assert limits.low <= default <= limits.high
        for wrong in (limits.low - 1, limits.high * 2 + 1):
            parameter = Parameter(option, value=type(default)(wrong)).to_parameter_msg()
            result = bench.call(SetParameters, f"/{name}/set_parameters", parameters=[parameter]).results[0]
            assert not result.successful
            assert "range" in result.reason
        assert node.get_parameter(option).value == default


def test_options_reach_the_estimators(bench):
    state = bench.node(StateEstimatorNode, horizon=0.25, maximum_iterations=3)
    parameters = bench.node(ParameterEstimatorNode, forgetting_time=33.0, relearn=False)
    assert state.trigger_configure() == parameters.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert (state.estimator.options.horizon, state.estimator.options.maximum_iterations) == (0.25, 3)
    assert (parameters.estimator.options.forgetting_time, parameters.estimator.options.relearn) == (33.0, False)


def test_an_estimator_that_does_not_exist_is_refused_at_configure(bench, capfd):
    node = bench.node(ParameterEstimatorNode, estimator="best")
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    assert "must be one of auto, rls, fourier or rml" in capfd.readouterr().err


def test_the_estimator_is_chosen_by_a_parameter_and_hears_what_it_needs(bench):
    node = bench.node(ParameterEstimatorNode, estimator="fourier", highest_frequency=1.5)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert node.estimator.options.estimator == "fourier" and node.estimator.options.highest_frequency == 1.5
    assert "air_data" in node.received and "gps/vel" not in node.received  # vanes are on time in gusts
    for name in ("auto", "rml"):  # auto may come to rml
        other = bench.node(ParameterEstimatorNode, estimator=name)
        assert other.trigger_configure() == TransitionCallbackReturn.SUCCESS
        assert {"air_data", "gps/fix", "gps/vel", "control_surfaces"} <= set(other.received)


# -- diagnostics and services ----------------------------------------------------------------------------


@pytest.fixture
def flown(bench, raw, tmp_path):
    """Both nodes after 15 s of flight, and the diagnostics that came."""
    state = bench.node(StateEstimatorNode)
    parameters = bench.node(ParameterEstimatorNode, model_folder=str(tmp_path / "models"))
    diagnostics = bench.listen(DiagnosticArray, "/diagnostics")
    for name in ("state_estimator", "parameter_estimator"):
        assert change(bench, name, CONFIGURE)
        assert change(bench, name, ACTIVATE)
    bench.play(raw, 0.0, 15.0, state)
    bench.spin_until(lambda: parameters.states_received == state.rows_published)
    return bench, state, parameters, diagnostics


def newest(diagnostics, name):
    found = [s for message in diagnostics for s in message.status if s.name == name]
    return found[-1], {item.key: item.value for item in found[-1].values}


@pytest.mark.long
def test_diagnostics_count_what_arrived(flown):
    bench, state, parameters, diagnostics = flown
    diagnostics.clear()

    def all_told():
        names = {s.name for m in diagnostics for s in m.status}
        return len(names) == 2 and newest(diagnostics, "parameter_estimator")[1]["states_received"] == str(
            parameters.states_received
        )

    bench.spin_until(all_told)  # what was on its way has come
    status, values = newest(diagnostics, "state_estimator")
    assert status.level == b"\x00" and status.message == "ok"
    assert values["imu.received"] == str(state.received["imu/data"])
    assert int(values["airspeed.fused"]) > 500
    assert 0.0 <= float(values["cpu_share"]) < 3.0
    status, values = newest(diagnostics, "parameter_estimator")
    assert status.level == b"\x00"
    assert values["states_received"] == str(parameters.states_received)
    assert values["controls_received"] == str(parameters.received["control_surfaces"])
    assert sum(int(values[name]) for name in ("USE", "HOLD", "REJECT")) == 32
    assert values["missing_effects"] == "not looked for yet: 60 s of settled flight are needed"


@pytest.mark.long
def test_services_reset_save_and_load(flown, tmp_path):
    bench, state, parameters, _ = flown
    learnt = parameters.estimator.learning.least_squares.state.theta.copy()
    assert learnt.any()
    path = tmp_path / "models" / "cruise.json"
    saved = bench.call(SaveModel, "/parameter_estimator/save_model", path="cruise.json")
    assert saved.success and str(path) in saved.message
    assert len(json.loads(path.read_text())["parameters"]) == 32
    assert bench.call(Reset, "/parameter_estimator/reset").success
    assert not parameters.estimator.learning.least_squares.state.theta.any()
    loaded = bench.call(LoadModel, "/parameter_estimator/load_model", path="cruise.json")
    assert loaded.success and loaded.model == parameters.estimator.model.identifier
    assert (parameters.estimator.learning.least_squares.state.theta == learnt).all()
    before = path.read_bytes()
    again = bench.call(SaveModel, "/parameter_estimator/save_model", path="cruise.json")
    assert not again.success and "already there" in again.message and path.read_bytes() == before
    assert bench.call(Reset, "/state_estimator/reset").success
    assert state.estimator.last_row is None


@pytest.mark.long
def test_a_model_is_loaded_where_it_has_the_terms_that_fly(flown):
    """After an effect was added in flight the answer blamed the aircraft file."""
    bench, _, node, _ = flown
    expression = "CZ: alpha**3"
    for name, kind, service in (("plain.json", AddEffect, "add_effect"), ("more.json", RemoveEffect, "remove_effect")):
        assert bench.call(SaveModel, "/parameter_estimator/save_model", path=name).success
        learnt = node.estimator.learning.least_squares.state.theta.copy()
        assert bench.call(kind, f"/parameter_estimator/{service}", expression=expression).success
        refused = bench.call(LoadModel, "/parameter_estimator/load_model", path=name)
        verb = "lacks" if name == "plain.json" else "adds"
        assert not refused.success and f"it {verb} 'CZ: alpha**3'" in refused.message
    assert len(node.model_services.memory.flight().time)
    assert bench.call(Reset, "/parameter_estimator/reset").success
    assert bench.call(AddEffect, "/parameter_estimator/add_effect", expression=expression).success
    loaded = bench.call(LoadModel, "/parameter_estimator/load_model", path="more.json")
    assert loaded.success and (node.estimator.learning.least_squares.state.theta == learnt).all()
    assert not len(node.model_services.memory.flight().time)  # what is known now is not from these samples
    assert [note.split(" of ")[0] for note in node.noted][-3:] == ["reset", "add_effect", "load_model"]


def unchanged(file):
    """What writing to a file changes; when it was read is another matter."""
    told = file.lstat()
    return told.st_ino, told.st_mode, told.st_size, told.st_mtime_ns


def test_bad_paths_are_answered_with_a_sentence(bench, tmp_path, capfd):
    folder, outside = tmp_path / "models", tmp_path / "outside.json"
    node = bench.node(ParameterEstimatorNode, model_folder=str(folder))
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    folder.mkdir()
    (folder / "text.json").write_text("no model")
    (folder / "other.json").write_text('{"format": "something else"}')
    (folder / "damaged.json").write_text('{"format": "aircraft_sysid_ros model 1", "terms": 3}')
    (folder / "bytes.json").write_bytes(b"\xff\xfe\x00")
    (folder / "deep.json").write_text("[" * 100_000)
    (folder / "link.json").symlink_to(outside)
    (folder / "folder.json").mkdir()
    os.mkfifo(folder / "pipe.json")
    bad = ("", ".", "..", "../outside.json", str(outside), str(folder / "model.json"), "~/model.json", ".hidden", "a/b",
           "a\x1b[2Jb", "x" * 101, "\n")  # fmt: skip
    there = (
        "text.json",
        "other.json",
        "damaged.json",
        "bytes.json",
        "deep.json",
        "link.json",
        "folder.json",
        "pipe.json",
    )
    before = {file.name: unchanged(file) for file in folder.iterdir()}
    for kind, name, names in (
        (LoadModel, "load_model", (*bad, *there, "nowhere.json")),
        (SaveModel, "save_model", (*bad, *there)),
    ):
        for path in names:
            answer = bench.call(kind, f"/parameter_estimator/{name}", path=path)
            assert not answer.success, (name, path)
            assert len(answer.message.split()) > 4 and answer.message.isprintable() and len(answer.message) < 400
    assert {file.name: unchanged(file) for file in folder.iterdir()} == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["models"]
    answer = node.set_parameters([Parameter("model_folder", value=str(tmp_path))])[0]
    assert not answer.successful and "read-only" in answer.reason
    assert "Traceback" not in "".join(capfd.readouterr())
