"""Other programs call `live` in flight: its run is of the whole flight all the same, and says what was called, when."""

import json
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest
from aircraft_sysid_msgs.msg import AircraftState
from aircraft_sysid_msgs.srv import AddEffect, Reset
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from processes import live, play, slowed
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from waiting import LONGEST, finish

from aircraft_sysid_ros.run_reader import journal_path

NODES = ("state_estimator", "parameter_estimator")


class Caller:
    """Calls services of a process, and hears the states."""

    def __init__(self, node, executor):
        self.node, self.executor, self.states = node, executor, []
        node.create_subscription(AircraftState, "/state_estimator/state", self.states.append, 10)

    def spin_until(self, done):
        deadline = time.monotonic() + LONGEST
        while not done():
            assert time.monotonic() < deadline, "nothing came in time"
            self.executor.spin_once(timeout_sec=0.1)

    def spin_until_quiet(self):
        """Until no state has come for two seconds: a process that was behind has used all that it was sent."""
        count = -1
        while count < len(self.states):
            count = len(self.states)
            self.spin_until(partial(_is_over, time.monotonic() + 2.0))

    def client(self, kind, name):
        client = self.node.create_client(kind, name)
        self.spin_until(client.service_is_ready)
        self.spin_until(partial(_is_over, time.monotonic() + 1.0))  # until the server knows the client, too
        return client

    def call(self, kind, name, **request):
        client = self.client(kind, name)
        future = client.call_async(kind.Request(**request))
        self.spin_until(future.done)
        self.node.destroy_client(client)
        return future.result()

    def change(self, name, transition):
        return self.call(ChangeState, f"/{name}/change_state", transition=Transition(id=transition)).success


def _is_over(deadline):
    return time.monotonic() > deadline


@pytest.fixture
def caller(helper):
    return Caller(*helper)


def ended(process):
    """What `live` says of the flight at Ctrl-C, and on its way."""
    process.send_signal(signal.SIGINT)
    output, errors = finish(process)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors and "FATAL" not in errors
    return json.loads(output), errors


@pytest.mark.long
@pytest.mark.parametrize("name", [NODES[0], pytest.param(NODES[1], marks=pytest.mark.long)])
def test_a_node_that_is_to_be_cleaned_up_keeps_the_flight(recording, aircraft_file, tmp_path, caller, name):
    """It was forgotten, and all that was on the disk was deleted at the end."""
    run = tmp_path / "run"
    with live(run, aircraft_file, "--reliable") as process:
        sent = play(recording, 8)
        assert not caller.change(name, Transition.TRANSITION_ACTIVATE)  # it is active, and the client is answered
        assert caller.change(name, Transition.TRANSITION_DEACTIVATE)
        assert not caller.change(name, Transition.TRANSITION_CLEANUP)
        wanted = [Parameter("frame_prefix", value="uav1/").to_parameter_msg()]  # the node would start over
        (answer,) = caller.call(SetParameters, f"/{name}/set_parameters", parameters=wanted).results
        assert "cannot change: live gives the result" in answer.reason
        assert caller.change(name, Transition.TRANSITION_ACTIVATE)
        result, errors = ended(process)
    assert "'activate' is refused: the node is active (possible: deactivate, shutdown)" in errors
    assert "'cleanup' is refused: live gives the result" in errors
    assert result["state"]["duration"] == pytest.approx(sent["duration"], abs=0.02)
    # whether they are to be used is another matter: on a busy machine samples come late, and axes are held for it
    known = [p for p in json.loads((run / "parameters.json").read_text())["parameters"] if p["value"] is not None]
    assert len(known) > 20
    assert not journal_path(run).exists()


@pytest.mark.long
def test_after_a_reset_the_run_is_of_the_whole_flight_and_says_so(recording, aircraft_file, tmp_path, caller):
    """It was of the time since the reset; one just before the end left "no state", and deleted the flight."""
    run = tmp_path / "run"
    with live(run, aircraft_file, "--reliable") as process, ThreadPoolExecutor() as beside:
        playing = beside.submit(play, recording, 1)  # the calls take seconds, and what is left must show a term
        caller.spin_until(lambda: caller.states)
        for name in NODES:
            assert caller.call(Reset, f"/{name}/reset").success
        assert caller.call(AddEffect, "/parameter_estimator/add_effect", expression="CZ: alpha**3").success
        sent = playing.result()
        caller.spin_until_quiet()  # what is behind has no flight yet that a term could be refused for
        for expression, words in (("sqrt(alpha-5)", "is not a number at"), ("max(alpha-2,0)", "has been 0 throughout")):
            answer = caller.call(AddEffect, "/parameter_estimator/add_effect", expression=f"CZ: {expression}")
            assert not answer.success and words in answer.message
        assert caller.call(Reset, "/state_estimator/reset").success
        result, _ = ended(process)
    assert result["state"]["duration"] == pytest.approx(sent["duration"], abs=0.02)
    written = json.loads((run / "state.json").read_text())
    assert written["samples"]["imu"]["received"] == sent["messages"]["/imu/data"]
    airspeeds = written["samples"]["airspeed"]
    assert airspeeds["fused"] > 0.5 * airspeeds["received"]
    for text in ("reset of state_estimator", "reset of parameter_estimator", "add_effect of parameter_estimator"):
        assert any(text in note and " s of flight" in note for note in written["notes"]), written["notes"]
    assert any(f"called at {sent['duration']:.1f} s of flight" in note for note in written["notes"])
    assert set(written["notes"]) <= set(result["notes"])


@pytest.mark.long
def test_a_process_that_cannot_keep_up_answers_and_says_so(recording, aircraft_file, tmp_path, caller):
    """Services and diagnostics came when all messages had been worked off: after the flight."""
    said, answered = [], 0
    caller.node.create_subscription(DiagnosticArray, "/diagnostics", lambda each: said.append(each.status[0]), 100)
    loses = lambda each: each.level == DiagnosticStatus.WARN and "messages were lost on the way" in each.message  # noqa: E731
    with live(tmp_path / "run", aircraft_file) as process, ThreadPoolExecutor() as beside:
        client = caller.client(GetParameters, "/parameter_estimator/get_parameters")
        with slowed(process):
            playing = beside.submit(play, recording, 3)
            while not playing.done():
                future = client.call_async(GetParameters.Request(names=["estimator"]))
                caller.spin_until(future.done)
                answered += any(map(loses, said)) and not playing.done()
            playing.result()
    assert answered >= 2
