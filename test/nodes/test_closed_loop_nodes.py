"""The closed loop over ROS 2 topics: aeroplane, controller and both estimators as nodes."""

import itertools
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from aircraft_sysid_msgs.msg import Parameter, Parameters

from aircraft_sysid_ros.consumer import Condition, Origin, ParameterSource, priors_of
from aircraft_sysid_ros.consumer.subscriber import ParameterSubscriber
from aircraft_sysid_ros.nodes.common import start
from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode
from aircraft_sysid_ros.ros_messages.conversion import message_fields, samples_and_rows
from aircraft_sysid_ros.samples import concatenate
from aircraft_sysid_ros.simulation.closed_loop import ATTITUDE_TOPIC, SteppedAeroplane, samples_of_sensed

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "adaptive_controller"
sys.path.insert(0, str(EXAMPLE))

SECONDS = 9.0


@pytest.mark.long  # with processes and an aeroplane that changes: test_drone_developer.py
def test_a_short_flight_over_topics(bench):
    from aeroplane_node import AeroplaneNode
    from controller_node import ControllerNode

    estimators = [bench.node(StateEstimatorNode), bench.node(ParameterEstimatorNode)]
    aeroplane = bench.node(AeroplaneNode, rate=0.0, duration=SECONDS, seed=1)
    controller = bench.node(ControllerNode, parameters="live", seed=1)
    assert all(start(node) for node in estimators)
    bench.spin_until(lambda: not aeroplane.missing())
    aeroplane.fly(lambda timeout: bench.executor.spin_once(timeout_sec=timeout))
    assert np.isnan(aeroplane.lost_at) and len(aeroplane.log) == round(SECONDS / 0.01)
    assert controller.commands >= 0.98 * len(aeroplane.log) and aeroplane.unanswered <= 0.02 * len(aeroplane.log)
    bench.spin_until(lambda: controller.source.taken >= 3)
    assert controller.source.refused == 0
    snapshot = controller.source.newest
    assert len(snapshot.names) == 32 and snapshot.model
    commands = np.array([command for _, _, command in aeroplane.log])
    assert commands[200:, :3].std(axis=0).min() > np.radians(0.3)  # it is the controller that flies


def test_messages_hold_what_the_sensors_show(aircraft):
    from aeroplane_node import message_of

    _, sensed = SteppedAeroplane(aircraft, 4, 1.0).look()
    sensed = [one for one in sensed if one.topic != ATTITUDE_TOPIC]
    direct = samples_of_sensed(sensed)
    batches = [
        part for one in sensed for part, _ in samples_and_rows(one.topic, *message_fields(one.topic, message_of(one)))
    ]
    heard = concatenate(batches)
    assert np.array_equal(direct.kind, heard.kind) and np.array_equal(direct.stamp, heard.stamp)
    assert heard.values[:, :3] == pytest.approx(direct.values[:, :3], rel=1e-12, nan_ok=True)


def test_the_subscriber_feeds_a_source_and_logs_what_it_refuses(bench, aircraft, capfd):
    source = ParameterSource(priors_of(aircraft.coefficients))
    ParameterSubscriber(bench.helper, source)
    publisher = bench.publisher(Parameters, "parameter_estimator/parameters")
    limits = {"airspeed_min": 15.0, "airspeed_max": 19.0, "alpha_max": 0.1, "beta_min": -0.1, "beta_max": 0.1}
    good = Parameters(
        model="m", covariance=[0.01],
        parameters=[Parameter(name="Cm_de", value=-0.5, standard_deviation=0.1, status=Parameter.USE)], **limits,
    )  # fmt: skip
    good.header.stamp.sec = 7
    publisher.publish(good)
    bench.spin_until(lambda: source.taken == 1)
    source.at(7 * 10**9, Condition(17.0, 0.05))
    answer = source.at(60 * 10**9, Condition(17.0, 0.05))["Cm_de"]
    assert answer.value == pytest.approx(-0.5) and answer.origin == Origin.HELD
    bad = Parameters(model="m", covariance=[0.01, 0.02], parameters=good.parameters)
    bad.header.stamp.sec = 8
    publisher.publish(bad)
    bench.spin_until(lambda: source.refused == 1)
    assert "must have 1 numbers, not 2" in capfd.readouterr().err
    assert source.newest.stamp == 7 * 10**9


def test_nodes_say_what_is_wrong_with_their_parameters(bench):
    from aeroplane_node import AeroplaneNode
    from controller_node import ControllerNode

    from aircraft_sysid_ros.errors import InputError

    refused = [
        (AeroplaneNode, {"case": "wing"}, "case must be one of none, elevator"),
        (AeroplaneNode, {"case": 5}, "the parameter case must be a text, not '5'"),
        (AeroplaneNode, {"seed": -1}, "the parameter seed must be from 0 to 4294967295, not -1"),
        (AeroplaneNode, {"duration": -5.0}, "the parameter duration must be 0 or from 1 to 3600, not -5"),
        (AeroplaneNode, {"rate": -1.0}, "the parameter rate must be 0 or from 0.1 to 100, not -1"),
        (AeroplaneNode, {"rate": True}, "the parameter rate must be a number, not 'True'"),
        (AeroplaneNode, {"turbulence": float("nan")}, "the parameter turbulence must be from 0 to 30, not nan"),
        (ControllerNode, {"parameters": "mine"}, "parameters must be one of fixed, live, truth"),
        (ControllerNode, {"seed": -1}, "the parameter seed must be from 0"),
        (ControllerNode, {"seed": "abc"}, "the parameter seed must be a whole number, not 'abc'"),
    ]
    for kind, parameters, text in refused:
        with pytest.raises(InputError, match=text):
            bench.node(kind, **parameters)
    node = bench.node(AeroplaneNode, duration=40, rate=2)  # whole numbers are numbers
    assert node.aeroplane.count == 4000 and node.rate == 2.0


@pytest.mark.parametrize(("argument", "text"), [("seed:=abc", "must be a whole number, not 'abc'"), ("x", "'-p x'")])
def test_bad_arguments_of_a_node_end_with_status_2(monkeypatch, capfd, argument, text):
    from controller_node import ControllerNode, fly_until_stopped
    from node_runner import run_node

    monkeypatch.setattr(sys, "argv", ["controller_node.py", "--ros-args", "-p", argument])
    assert run_node(ControllerNode, fly_until_stopped) == 2
    assert text in capfd.readouterr().err.splitlines()[-1]


def test_silence_is_said_once_and_its_end_too():
    from node_runner import Silence

    said = []
    silence = Silence(said.append, "things", 0.05, "we wait")
    time.sleep(0.06)
    silence.check()
    assert not said  # not waited for yet
    silence.heard()
    silence.check()
    assert not silence.is_silent
    time.sleep(0.06)
    silence.check()
    silence.check()
    assert silence.is_silent and len(said) == 1 and said[0].startswith("no things for 0.")
    silence.heard()
    assert not silence.is_silent and said[1].startswith("things come again after 0.")


@pytest.mark.parametrize("rate", [0.0, 1.0])
def test_an_aeroplane_whose_commands_stop_says_so(bench, monkeypatch, capfd, rate):
    import aeroplane_node
    import node_runner

    monkeypatch.setattr(aeroplane_node, "SILENCE", 0.3)
    monkeypatch.setattr(aeroplane_node, "BRIEF_PATIENCE", 0.01)
    node = bench.node(aeroplane_node.AeroplaneNode, rate=rate, duration=1.0)
    monkeypatch.setattr(node, "missing", list)
    sender = bench.publisher(aeroplane_node.ControlSurfaces, node_runner.COMMANDS)
    sender.publish(aeroplane_node.ControlSurfaces(throttle=0.5))
    bench.spin_until(lambda: node.command[3] == 0.5)
    assert aeroplane_node.fly_when_heard(node, bench.executor, threading.Event()) == 1
    log = capfd.readouterr().err
    assert log.count("no commands for ") == 1
    assert "flown for 1.0 s, without a command for the last" in log and "100 of 100 samples had no answer" in log


def test_an_aeroplane_says_what_it_waits_for(bench, monkeypatch, capfd):
    import aeroplane_node

    monkeypatch.setattr(aeroplane_node, "_WORD", 0.2)
    node, stop = bench.node(aeroplane_node.AeroplaneNode), threading.Event()
    threading.Timer(0.5, stop.set).start()
    assert aeroplane_node.fly_when_heard(node, bench.executor, stop) == 0
    assert "waiting for a sender of commanded_surfaces, a listener to imu/data," in capfd.readouterr().err


@pytest.mark.long
def test_a_controller_says_that_parameters_and_samples_have_stopped(bench, monkeypatch, capfd):
    import controller_node

    monkeypatch.setattr(controller_node, "SILENCE_OF_PARAMETERS", 0.6)
    node = bench.node(controller_node.ControllerNode)
    sender = bench.publisher(controller_node.Imu, "imu/data")
    sent = itertools.count(1)

    def send_until(done):
        message = controller_node.Imu()
        message.header.stamp.sec = next(sent)
        sender.publish(message)
        return done()

    bench.spin_until(lambda: send_until(lambda: node.messages.is_silent))
    assert node.age_of_parameters > 0.6
    log = capfd.readouterr().err
    assert "no parameters for 0." in log and "no IMU samples" not in log
    broken = controller_node.Imu()
    broken.angular_velocity.x = float("nan")
    bench.say_until(lambda: sender.publish(broken), lambda: node._imu.is_silent)  # no number is no sample
    assert "no IMU samples for 1." in capfd.readouterr().err
