"""With default parameters a node matches every publisher of sensor data, and has room for what comes at once."""

import pytest
import yaml
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from aircraft_sysid_ros.nodes import parameter_estimator, state_estimator
from aircraft_sysid_ros.nodes.common import message_class, start
from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode
from aircraft_sysid_ros.ros_messages.conversion import TOPICS

PARAMETERS = (*parameter_estimator.INPUTS, parameter_estimator.VANES_TOPIC)
PROBE = {"five_hole_probe": {"alpha_sensitivity": 3.9, "beta_sensitivity": 3.9}}


@pytest.fixture
def default_node(bench, tmp_path):
    """Makes a node as one gets it who says no more than where the files are; active."""
    (tmp_path / "probe.yaml").write_text(yaml.safe_dump(PROBE))

    def make(kind, **parameters):
        values = {"aircraft_file": bench.aircraft_file, **parameters}
        if "calibration_file" in values:
            values["calibration_file"] = str(tmp_path / "probe.yaml")
        node = kind(parameter_overrides=[Parameter(name, value=value) for name, value in values.items()])
        bench.nodes.append(node)
        bench.executor.add_node(node)
        assert start(node)
        return node

    return make


@pytest.mark.parametrize(
    ("kind", "parameters", "inputs"),
    [
        (StateEstimatorNode, {}, state_estimator.INPUTS),
        (StateEstimatorNode, {"calibration_file": "probe"}, (*state_estimator.INPUTS, "five_hole_probe")),
        (ParameterEstimatorNode, {}, PARAMETERS),
        (ParameterEstimatorNode, {"estimator": "rml"}, (*PARAMETERS, *parameter_estimator.MORE_INPUTS["rml"])),
    ],
)
def test_every_input_is_heard_with_best_effort_and_a_depth_of_100(bench, default_node, kind, parameters, inputs):
    node = default_node(kind, **parameters)
    wanted = {f"/{topic}" for topic in inputs}
    heard = [each.subscription for each in node.inputs]
    volatile = [s for s in heard if s.qos_profile.durability == DurabilityPolicy.VOLATILE]
    profiles = {s.topic_name: s.qos_profile for s in volatile if s.topic_name in wanted}
    assert profiles.keys() == wanted
    for topic, profile in profiles.items():
        assert (profile.reliability, profile.depth) == (ReliabilityPolicy.BEST_EFFORT, 100), topic
        bench.spin_until(lambda topic=topic: bench.helper.get_subscriptions_info_by_topic(topic), 10.0)
        offered = [info.qos_profile for info in bench.helper.get_subscriptions_info_by_topic(topic)]
        offered = [quality for quality in offered if quality.durability == DurabilityPolicy.VOLATILE]
        assert [quality.reliability for quality in offered] == [ReliabilityPolicy.BEST_EFFORT], topic


def test_publishers_of_both_kinds_are_heard(bench, default_node):
    """A reliable subscription would not match those of sensor data."""
    node = default_node(StateEstimatorNode)
    for topic in state_estimator.INPUTS:
        for reliability in (ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE):
            kind = message_class(TOPICS[topic])
            publisher = bench.helper.create_publisher(kind, topic, QoSProfile(depth=10, reliability=reliability))
            bench.spin_until(lambda publisher=publisher: publisher.get_subscription_count() == 1, 20.0)
            before = node.received[topic]
            bench.say_until(
                lambda publisher=publisher, kind=kind: publisher.publish(kind()),
                lambda topic=topic, before=before: node.received[topic] > before,
            )
            assert node.received[topic] > before, topic
            bench.helper.destroy_publisher(publisher)


def test_a_mass_that_was_published_once_before_the_node_started_is_heard_once(bench, default_node, capfd):
    """As a weighing before the flight is: latched, with an hour on the ground after it. What follows counts once.

    Of a mass that is not latched ROS would say that no messages will be received, and they are.
    """
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    kind = message_class(TOPICS["mass_properties"])
    publisher = bench.helper.create_publisher(kind, "mass_properties", latched)
    publisher.publish(kind(mass=4.5))
    node = default_node(ParameterEstimatorNode)
    bench.spin_until(lambda: node.received["mass_properties"] == 1, 20.0)
    bench.spin_until(lambda: publisher.get_subscription_count() == 2, 20.0)
    masses = []
    node.on_samples = lambda samples: masses.append(float(samples.values[0, 0]))
    for count, mass in ((2, 4.25), (3, 4.5)):  # without stamps the last reads as the first
        publisher.publish(kind(mass=mass))
        bench.spin_until(lambda count=count: node.received["mass_properties"] == count, 20.0)
    other = bench.helper.create_publisher(kind, "mass_properties", QoSProfile(depth=1))
    bench.spin_until(lambda: other.get_subscription_count() == 1, 20.0)
    bench.say_until(lambda: other.publish(kind(mass=4.0)), lambda: 4.0 in masses)
    assert masses[:3] == [4.25, 4.5, 4.0]
    said = [""]
    bench.spin_until(lambda: said.append(capfd.readouterr().err) or "No messages will be sent" in "".join(said), 20.0)
    assert "No messages will be received" not in "".join(said)
