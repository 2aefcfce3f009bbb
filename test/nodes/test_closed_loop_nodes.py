"""The closed loop over ROS 2 topics: aeroplane, controller and both estimators as nodes."""

import sys
from pathlib import Path

import numpy as np
import pytest
from aircraft_sysid_msgs.msg import Parameter, Parameters

from aircraft_sysid_ros.consumer import Condition, Origin, ParameterSource, priors_of
from aircraft_sysid_ros.consumer.subscriber import ParameterSubscriber
from aircraft_sysid_ros.nodes.common import start
from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode
from aircraft_sysid_ros.recordings.ros_conversion import message_fields, samples_and_rows
from aircraft_sysid_ros.samples import concatenate
from aircraft_sysid_ros.simulation.closed_loop import ATTITUDE_TOPIC, SteppedAeroplane, samples_of_sensed

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "adaptive_controller"))

SECONDS = 9.0


def test_a_short_flight_over_topics(bench):
    from aeroplane_node import AeroplaneNode
    from controller_node import ControllerNode

    estimators = [bench.node(StateEstimatorNode), bench.node(ParameterEstimatorNode)]
    aeroplane = bench.node(AeroplaneNode, rate=0.0, duration=SECONDS, seed=1)
    controller = bench.node(ControllerNode, parameters="live", seed=1)
    assert all(start(node) for node in estimators)
    bench.spin_until(aeroplane.is_heard)
    aeroplane.fly(lambda timeout: bench.executor.spin_once(timeout_sec=timeout))
    assert np.isnan(aeroplane.lost_at) and len(aeroplane.log) == round(SECONDS / 0.01)
    assert controller.commands >= 0.98 * len(aeroplane.log) and aeroplane.unanswered <= 0.02 * len(aeroplane.log)
    bench.spin_until(lambda: controller.source.taken >= 3, timeout=20.0)
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
        part
        for one in sensed
        for part, _ in samples_and_rows(one.topic, *message_fields(one.topic, message_of(one)))
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
    bench.spin_until(lambda: source.taken == 1, timeout=20.0)
    source.at(7 * 10**9, Condition(17.0, 0.05))
    answer = source.at(60 * 10**9, Condition(17.0, 0.05))["Cm_de"]
    assert answer.value == pytest.approx(-0.5) and answer.origin == Origin.HELD
    bad = Parameters(model="m", covariance=[0.01, 0.02], parameters=good.parameters)
    bad.header.stamp.sec = 8
    publisher.publish(bad)
    bench.spin_until(lambda: source.refused == 1, timeout=20.0)
    assert "must have 1 numbers, not 2" in capfd.readouterr().err
    assert source.newest.stamp == 7 * 10**9


def test_nodes_say_what_is_wrong_with_their_parameters(bench):
    from aeroplane_node import AeroplaneNode
    from controller_node import ControllerNode

    from aircraft_sysid_ros.errors import InputError

    with pytest.raises(InputError, match="case must be one of none, elevator"):
        bench.node(AeroplaneNode, case="wing")
    with pytest.raises(InputError, match="parameters must be one of fixed, live, truth"):
        bench.node(ControllerNode, parameters="mine")
