"""The aeroplane at a glance: levels and words of what came, and the tree that rqt and Foxglove read."""

from types import SimpleNamespace as Said

import numpy as np
import pytest
from aircraft_sysid_msgs.msg import (
    AircraftState,
    AxisError,
    EffectCandidate,
    MissingEffects,
    ModelError,
    Parameter,
    Parameters,
)
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.parameter import Parameter as RosParameter

from aircraft_sysid_ros.nodes.common import newest_quality, start
from aircraft_sysid_ros.nodes.overview import AGGREGATED, TOP_LEVEL, OverviewNode
from aircraft_sysid_ros.nodes.overview_content import (
    ERROR,
    OK,
    STALE,
    WARN,
    Leaf,
    missing_leaf,
    parameter_leaves,
    sensor_leaves,
    state_leaf,
    tree,
)


def state(**fields):
    told = {"status": AircraftState.STATUS_OK, "true_airspeed": 17.0, "angle_of_attack": np.radians(3.0)}
    return AircraftState(**told, euler=[0.0, 0.0, np.radians(-90.0)]) if not fields else AircraftState(**fields)


def test_a_state_is_as_good_as_its_status():
    leaf = state_leaf(state())
    assert (leaf.level, leaf.message) == (OK, "ok")
    assert leaf.values["true_airspeed [m/s]"] == "17.00" and leaf.values["angle_of_attack [deg]"] == "3.00"
    assert leaf.values["roll, pitch, yaw [deg]"].endswith(" 270.0")
    waiting = state_leaf(state(status=AircraftState.STATUS_WAITING, status_text="waiting", true_airspeed=float("nan")))
    assert (waiting.level, waiting.message) == (WARN, "waiting") and "true_airspeed [m/s]" not in waiting.values
    lying = state_leaf(state(status=AircraftState.STATUS_OK + 6 * AircraftState.STATUS_CONTRADICTED))
    assert lying.level == ERROR


@pytest.mark.parametrize(
    ("before", "now", "level", "words"),
    [
        ({}, {"imu.received": "500", "imu.fused": "500"}, OK, "ok"),
        ({"imu.received": "500"}, {"imu.received": "500"}, STALE, "nothing comes"),
        ({"imu.received": "0"}, {"imu.received": "10", "imu.rejected": "4"}, OK, "ok"),
        ({"imu.received": "0"}, {"imu.received": "10", "imu.rejected": "8"}, WARN, "of 10 samples: 8 rejected"),
        ({"imu.late": "7", "imu.received": "7"}, {"imu.received": "9", "imu.late": "9"}, WARN, "2 late"),
    ],
)
def test_a_sensor_is_judged_by_its_newest_samples(before, now, level, words):
    (leaf,) = sensor_leaves(now, before)
    assert (leaf.path, leaf.level) == ("sensors/imu", level) and words in leaf.message


def test_an_imu_that_never_comes_is_there_as_one_that_is_missing():
    values = {"gps_position.received": "50", "gps_position.fused": "50", "gps_position.rate": "5"}
    imu, gps = sensor_leaves(values, {})
    assert (imu.path, imu.level) == ("sensors/imu", STALE) and "nothing has come" in imu.message
    assert gps.level == OK and gps.values == {"received": "50", "fused": "50", "rate": "5"}


def test_parameters_say_what_may_be_used():
    listed = [
        Said(name="CZ_alpha", value=-4.5, standard_deviation=0.1, status=Parameter.USE, reason=""),
        Said(name="Cm_q", value=float("nan"), standard_deviation=1.0, status=Parameter.HOLD, reason="not excited"),
        Said(name="Cn_p", value=9.0, standard_deviation=1.0, status=Parameter.REJECT, reason="beyond physics"),
    ]
    branch, *leaves = parameter_leaves(Said(model="m", parameters=listed))
    assert (branch.level, branch.message) == (OK, "1 USE, 1 HOLD, 1 REJECT")
    assert [leaf.level for leaf in leaves] == [OK, WARN, ERROR]
    assert [leaf.message for leaf in leaves] == [
        "USE -4.50 ± 0.10", "HOLD never learnt: not excited", "REJECT 9.0 ± 1.0: beyond physics",
    ]  # fmt: skip
    assert parameter_leaves(Said(model="m", parameters=listed[1:]))[0].level == WARN


def test_what_is_missing_is_named():
    found = EffectCandidate(effect="stall", error_before=0.3, error_after=0.1)
    assert missing_leaf(MissingEffects(verdict="missing", candidates=[found])).message == "missing: stall"
    assert missing_leaf(MissingEffects(verdict="none")).level == OK
    unknown = missing_leaf(MissingEffects(verdict=""))
    assert (unknown.level, unknown.message) == (OK, "not looked for yet")


def test_the_tree_is_as_bad_as_its_worst_branch_but_a_parameter_grounds_nobody():
    leaves = [Leaf("state", OK, "ok"), Leaf("sensors/imu", OK, "ok"), Leaf("sensors/airspeed", STALE, "nothing comes")]
    statuses = tree(leaves, "uav1")
    found = {leaf.path: (leaf.level, leaf.message) for leaf in statuses}
    assert list(found) == ["/uav1", "/uav1/sensors", "/uav1/sensors/airspeed", "/uav1/sensors/imu", "/uav1/state"]
    assert found["/uav1/sensors"] == (STALE, "airspeed: nothing comes")
    assert found["/uav1"] == (STALE, "sensors: airspeed: nothing comes")
    rejected = [Leaf("state", OK, "ok"), Leaf("parameters", OK, "1 USE"), Leaf("parameters/Cn_p", ERROR, "REJECT")]
    assert tree(rejected, "uav1")[0].level == OK
    assert tree([], "uav1") == [Leaf("/uav1", STALE, "nothing comes")]


def test_what_was_found_counts_until_the_node_says_otherwise(bench):
    """Of a model that has the effect now, and of a node that was started again, it said "missing: stall" on."""
    node = OverviewNode()
    bench.nodes.append(node)
    trees = []
    assert start(node)
    node._aggregated = Said(publish=lambda tree: trees.append({s.name: s for s in tree.status}))

    def summed_up(verdict):
        value = KeyValue(key="missing_effects", value=verdict)
        node._on_diagnostics(DiagnosticArray(status=[DiagnosticStatus(name="parameter_estimator", values=[value])]))
        node.sum_up()
        leaf = trees[-1]["/aeroplane/missing effects"]
        return leaf.level[0], leaf.message

    assert summed_up("the first search runs") == (OK, "the first search runs")
    keep = node._keeper("parameter_estimator/missing_effects", node._on_finding)
    keep(MissingEffects(verdict="missing", candidates=[EffectCandidate(effect="stall")]))
    assert summed_up("missing") == (WARN, "missing: stall")
    assert summed_up("not looked for yet") == (OK, "not looked for yet")
    assert summed_up("missing") == (WARN, "missing: stall")


@pytest.mark.long
def test_the_node_sums_up_its_own_namespace_alone(bench):
    node = OverviewNode(namespace="/uav1", parameter_overrides=[RosParameter("patience", value=60.0)])
    bench.nodes.append(node)
    bench.executor.add_node(node)
    trees, lamps = bench.listen(DiagnosticArray, AGGREGATED), bench.listen(DiagnosticStatus, TOP_LEVEL)
    assert start(node)
    bench.spin_until(lambda: bool(trees))
    assert [(s.name, s.level) for s in trees[0].status] == [("/uav1", DiagnosticStatus.STALE)]

    latched = newest_quality()
    parameters = bench.helper.create_publisher(Parameters, "/uav1/parameter_estimator/parameters", latched)
    sent = {
        "/uav1/state_estimator/state": state(),
        "/uav1/parameter_estimator/model_error": ModelError(axes=[AxisError(axis="CZ", nrmse=0.12)]),
        "/diagnostics": DiagnosticArray(
            status=[
                DiagnosticStatus(
                    name=f"{space}/state_estimator",
                    message=space,
                    values=[KeyValue(key="imu.received", value="5"), KeyValue(key="missing_effects", value="not yet")],
                )
                for space in ("uav1", "uav2")
            ]
        ),
    }
    publishers = {topic: bench.publisher(type(message), topic) for topic, message in sent.items()}
    parameters.publish(Parameters(parameters=[Parameter(name="CZ_alpha", value=-4.5, status=Parameter.USE)]))

    def say():
        for topic, message in sent.items():
            publishers[topic].publish(message)

    wanted = {"/uav1/state", "/uav1/sensors/imu", "/uav1/parameters/CZ_alpha", "/uav1/model/CZ"}
    bench.say_until(say, lambda: wanted <= {s.name for s in trees[-1].status})
    found = {s.name: s.message for s in trees[-1].status}
    node.set_parameters([RosParameter("patience", value=0.5)])
    bench.say_until(say, lambda: "/uav1/nodes/parameter_estimator" in {s.name for s in trees[-1].status})
    absent = next(s for s in trees[-1].status if s.name == "/uav1/nodes/parameter_estimator")
    assert absent.level == DiagnosticStatus.STALE and "it is not heard" in absent.message
    assert found["/uav1/missing effects"] == "not yet"
    assert found["/uav1/nodes/state_estimator"] == "uav1" and not any("uav2" in name for name in found)
    assert lamps[-1].name == "/uav1" and len(trees[-1].status[0].level) == 1
