"""The topic into a source: what a node is told."""

from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.consumer import Condition, ConditionTable, ParameterSource, Prior

pytest.importorskip("aircraft_sysid_msgs")
LIMITS = {"airspeed_min": 15.0, "airspeed_max": 19.0, "alpha_min": 0.0, "alpha_max": 0.1}
PRIORS = {"Cm_de": Prior(-1.0, 0.3)}


class Node:
    """As much of a node as a subscriber uses."""

    def __init__(self, publishers=1):
        self.said, self.publishers = [], publishers

    def get_logger(self):
        return SimpleNamespace(warning=lambda text, once=False, **_: self.said.append((text, once)))

    def create_subscription(self, _type, topic, callback, _depth):
        self.send = callback
        return SimpleNamespace(topic_name="/" + topic)

    def count_publishers(self, _topic):
        return self.publishers


def message(seconds, value=-0.85):
    from aircraft_sysid_msgs.msg import Parameter, Parameters

    one = Parameter(name="Cm_de", value=value, standard_deviation=0.1, status=Parameter.USE, age=0.5)
    made = Parameters(model="m", covariance=[0.01], parameters=[one], **LIMITS)
    made.header.stamp.sec = seconds
    return made


def made(source, node, **more):
    from aircraft_sysid_ros.consumer.subscriber import ParameterSubscriber

    return ParameterSubscriber(node, source, **more)


def test_nothing_is_said_of_a_good_message():
    node, source = Node(), ParameterSource(PRIORS)
    made(source, node)
    node.send(message(7))
    assert source.taken == 1 and node.said == []


def test_a_table_without_a_condition_is_said_once_and_with_one_it_is_filled():
    node, source = Node(), ParameterSource(PRIORS, table=ConditionTable(tuple(PRIORS)))
    made(source, node)
    node.send(message(7))
    assert [("table of flight conditions is not used" in text, once) for text, once in node.said] == [(True, True)]
    assert len(source.table) == 0
    node, source = Node(), ParameterSource(PRIORS, table=ConditionTable(tuple(PRIORS)))
    made(source, node, condition=lambda: Condition(17.0, 0.05))
    node.send(message(7))
    assert node.said == [] and len(source.table) == 1


def test_a_part_of_the_flight_condition_that_never_comes_is_said_once():
    node, source = Node(), ParameterSource(PRIORS)
    made(source, node)
    for second in (7, 13):
        node.send(message(second))
        source.at(second * 1_000_000_000, Condition(17.0, np.nan, 0.0))
    node.send(message(14))
    ((text, once),) = node.said
    assert "no angle of attack in any question so far" in text and once


def test_refusals_and_a_second_publisher_are_said():
    node, source = Node(publishers=2), ParameterSource(PRIORS)
    made(source, node)
    node.send(message(7, np.nan))
    assert "parameters refused: Cm_de has USE with the value nan" in node.said[0][0]
    assert "2 nodes publish /parameter_estimator/parameters: give each aircraft a namespace" in node.said[1][0]


def test_air_data_in_parts_are_one_flight_condition():
    """As from a MAVLink bridge, however seldom it is asked; what is too old is not known."""
    from aircraft_sysid_msgs.msg import AirData

    from aircraft_sysid_ros.consumer.subscriber import AirDataSubscriber

    node, second, nan = Node(), 1_000_000_000, float("nan")
    air = AirDataSubscriber(node)
    assert np.isnan(air.condition()).all()
    for seconds, part in ((7, (17.0, nan, nan)), (8, (nan, 0.05, 0.01))):
        sent = AirData(true_airspeed=part[0], angle_of_attack=part[1], sideslip=part[2])
        sent.header.stamp.sec = seconds
        node.send(sent)
    assert air.condition() == air.condition(8 * second) == (17.0, 0.05, 0.01)
    later = air.condition(8 * second + second // 2)
    assert np.isnan(later.airspeed) and later[1:] == (0.05, 0.01)
