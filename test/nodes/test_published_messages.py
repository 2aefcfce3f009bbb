"""What the nodes publish is what their estimators hold, in the frames that the topics promise."""

from types import SimpleNamespace

import numpy as np
import pytest
from aircraft_sysid_msgs.msg import AircraftState, ModelError, Parameter, Parameters
from aircraft_sysid_msgs.srv import Reset
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from sensor_msgs.msg import Imu

from aircraft_sysid_ros.nodes.common import newest_quality, start
from aircraft_sysid_ros.nodes.parameter_estimator import ParameterEstimatorNode
from aircraft_sysid_ros.nodes.state_estimator import StateEstimatorNode
from aircraft_sysid_ros.reconstruction.state import StateField, Status
from aircraft_sysid_ros.ros_messages.topics import DIAGNOSTICS, OUTPUTS, SERVICES
from aircraft_sysid_ros.stamps import nanoseconds

NAMES = (
    "CX_0 CX_alpha CX_alpha2 CX_q CX_de CX_Tc", "CY_0 CY_beta CY_p CY_r CY_da CY_dr",
    "CZ_0 CZ_alpha CZ_q CZ_de",
    "Cl_0 Cl_beta Cl_p Cl_r Cl_da Cl_dr", "Cm_0 Cm_alpha Cm_q Cm_de", "Cn_0 Cn_beta Cn_p Cn_r Cn_da Cn_dr",
)  # fmt: skip


def stamp(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


@pytest.fixture
def flown(bench, raw):
    """Both nodes after 12 s of flight: what they published, and what their estimators gave."""
    state, parameters = bench.node(StateEstimatorNode), bench.node(ParameterEstimatorNode)
    heard = {
        "state": bench.listen(AircraftState, "state_estimator/state"),
        "wind": bench.listen(TwistWithCovarianceStamped, "state_estimator/wind"),
        "odometry": bench.listen(Odometry, "state_estimator/odometry"),
        "parameters": bench.listen(Parameters, "parameter_estimator/parameters"),
        "model_error": bench.listen(ModelError, "parameter_estimator/model_error"),
    }
    rows, sets = [], []
    state.on_rows = lambda new: rows.extend(new.copy())
    parameters.on_parameters = lambda estimates, errors: sets.append((estimates, errors))
    assert start(state) and start(parameters)
    bench.play(raw, 0.0, 12.0, state)
    state.finish()
    bench.spin_until(lambda: parameters.states_received == state.rows_published)
    parameters.finish()
    bench.spin_until(lambda: len(heard["state"]) == len(rows) and len(heard["model_error"]) == len(sets))
    bench.spin_until(lambda: len(heard["parameters"]) == len(sets) and heard["wind"] and heard["odometry"])
    return state, parameters, heard, np.array(rows), sets


def test_a_place_that_is_no_longer_known_is_none_in_the_map(bench):
    """After GPS was lost and the filter started again, positions count from there: no odometry says that it is home."""
    node, states = bench.node(StateEstimatorNode), bench.listen(AircraftState, "state_estimator/state")
    odometry = bench.listen(Odometry, "state_estimator/odometry")
    assert start(node)
    node.estimator.epoch = 0
    rows = np.zeros((4, StateField.WIDTH))
    rows[:, StateField.TIME], rows[:, StateField.ATTITUDE.start] = np.arange(4.0), 1.0
    rows[2, StateField.ORIGIN.start] = rows[2, StateField.ORIGIN.start + 1] = np.nan
    for row in rows:
        node._publish(row[None])
    bench.spin_until(lambda: len(states) == len(rows) and len(odometry) >= 3)
    assert [message.header.stamp.sec for message in odometry] == [0, 1, 3]


def check_topics(bench):
    """The page's tables of topics and services are those of the nodes, with their durability, and no others."""
    for node in ("state_estimator", "parameter_estimator"):
        listed = (*OUTPUTS[node], DIAGNOSTICS)
        offered = {
            f"/{topic.name.lstrip('/')}": info
            for topic in listed
            for info in bench.helper.get_publishers_info_by_topic(f"/{topic.name.lstrip('/')}")
            if info.node_name == node
        }
        found = bench.helper.get_publisher_names_and_types_by_node(node, "/")
        own = {name: kinds for name, kinds in found if name.startswith((f"/{node}/", "/diagnostics"))}
        own = {name: kinds for name, kinds in own.items() if not name.endswith("transition_event")}
        assert own == {name: [info.topic_type] for name, info in offered.items()}
        for topic in listed:
            info = offered[f"/{topic.name.lstrip('/')}"]
            durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.is_latched else DurabilityPolicy.VOLATILE
            assert (info.topic_type, info.qos_profile.durability) == (topic.type, durability), topic
            assert info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        services = {
            name: kinds[0]
            for name, kinds in bench.helper.get_service_names_and_types_by_node(node, "/")
            if kinds[0].startswith("aircraft_sysid_msgs")
        }
        assert services == {f"/{service.name}": service.type for service in SERVICES[node]}


def test_messages_say_what_the_estimators_say(flown, bench):
    state, parameters, heard, rows, sets = flown
    check_topics(bench)
    check_states(state, heard["state"], rows)
    check_wind(state, heard["wind"], rows)
    check_odometry(state, heard["odometry"], rows)
    check_parameters(heard["parameters"], sets, parameters._epoch)
    check_model_error(heard["model_error"], sets, parameters.estimator.options.error_window)
    assert all(p.status == Parameter.HOLD and p.reason for p in heard["parameters"][0].parameters)


def test_every_status_has_its_constant():
    own = {f"STATUS_{name}": value for name, value in vars(Status).items() if name.isupper()}
    assert len(own) > 5
    assert {name: getattr(AircraftState, name) for name in own} == own


def check_states(node, messages, rows):
    assert len(rows) > 900
    assert [stamp(m) for m in messages] == nanoseconds(rows[:, StateField.TIME], node.estimator.epoch).tolist()
    for name, columns in (
        ("air_velocity_body", StateField.AIR_VELOCITY), ("position_ned", StateField.POSITION),
        ("velocity_ned", StateField.VELOCITY), ("attitude", StateField.ATTITUDE), ("wind_ned", StateField.WIND),
        ("accelerometer_bias", StateField.ACCELEROMETER_BIAS), ("gyro_bias", StateField.GYRO_BIAS),
        ("standard_deviations", StateField.STANDARD_DEVIATIONS), ("angular_velocity", StateField.ANGULAR_VELOCITY),
    ):  # fmt: skip
        assert np.array_equal(np.array([getattr(m, name) for m in messages]), rows[:, columns]), name
    last, row = messages[-1], node.estimator.last_row
    assert (last.status, last.status_text) == (AircraftState.STATUS_OK, "")
    assert last.fused == sum(counts["fused"] for counts in node.estimator.counts().values())
    assert last.true_airspeed == row[StateField.AIRSPEED]
    w, x, y, z = last.attitude
    assert last.euler[0] == pytest.approx(np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))
    assert last.euler[2] == pytest.approx(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    # The wind triangle closes: velocity over ground = attitude (air velocity) + wind, all in NED.
    v = np.array(last.air_velocity_body)
    turned = v + 2 * np.cross([x, y, z], np.cross([x, y, z], v) + w * v)
    assert turned + np.array(last.wind_ned) == pytest.approx(np.array(last.velocity_ned), abs=1e-9)


def check_wind(node, messages, rows):
    by_stamp = dict(zip(nanoseconds(rows[:, StateField.TIME], node.estimator.epoch).tolist(), rows, strict=True))
    for message in messages:
        row = by_stamp[stamp(message)]
        north, east, down = row[StateField.WIND]
        linear, covariance = message.twist.twist.linear, message.twist.covariance
        assert (linear.x, linear.y, linear.z) == (east, north, -down)
        deviations = row[StateField.STANDARD_DEVIATIONS][15:18]
        assert [covariance[0], covariance[7], covariance[14]] == pytest.approx(
            [deviations[i] ** 2 for i in (1, 0, 2)], rel=1e-14
        )
        assert [covariance[i] for i in (21, 28, 35)] == [1e6] * 3  # nobody knows how the air turns
        angular = message.twist.twist.angular
        assert (angular.x, angular.y, angular.z) == (0.0, 0.0, 0.0) and message.header.frame_id == "map"


def check_odometry(node, messages, rows):
    """Forward and up are where the attitude of the state has them, and the velocity over ground closes."""
    by_stamp = dict(zip(nanoseconds(rows[:, StateField.TIME], node.estimator.epoch).tolist(), rows, strict=True))
    assert len(messages) > 5
    for message in messages:
        assert (message.header.frame_id, message.child_frame_id) == ("map", "base_link")
        row, pose, twist = by_stamp[stamp(message)], message.pose.pose, message.twist.twist
        north, east, down = row[StateField.POSITION]
        assert (pose.position.x, pose.position.y, pose.position.z) == (east, north, -down)
        q = np.array([getattr(pose.orientation, name) for name in "xyz"])
        w = pose.orientation.w
        v = np.array([getattr(twist.linear, name) for name in "xyz"])
        turned = v + 2 * np.cross(q, np.cross(q, v) + w * v)
        velocity = row[StateField.VELOCITY]
        assert turned == pytest.approx([velocity[1], velocity[0], -velocity[2]], abs=1e-9)
        p, q_, r = row[StateField.ANGULAR_VELOCITY]
        assert [twist.angular.x, twist.angular.y, twist.angular.z] == [p, -q_, -r]
        deviations = row[StateField.STANDARD_DEVIATIONS]
        pose_variances = np.diag(np.array(message.pose.covariance).reshape(6, 6))
        assert pose_variances[:3] == pytest.approx(deviations[[4, 3, 5]] ** 2, rel=1e-12)
        assert pose_variances[3:].sum() == pytest.approx(np.sum(deviations[6:9] ** 2), rel=1e-9)
        twist_covariance = np.array(message.twist.covariance).reshape(6, 6)
        assert np.trace(twist_covariance[:3, :3]) == pytest.approx(np.sum(deviations[:3] ** 2), rel=1e-9)
        assert np.linalg.eigvalsh(twist_covariance).min() > 0.0


def check_parameters(messages, sets, epoch):
    assert len(messages) > 8
    for message, (estimates, _) in zip(messages, sets, strict=True):
        assert stamp(message) == int(nanoseconds(np.array(estimates.time), epoch))
        assert message.model == estimates.model
        assert [p.name for p in message.parameters] == " ".join(NAMES).split()
        covariance = np.array(message.covariance).reshape(32, 32)
        assert np.array_equal(covariance, estimates.covariance, equal_nan=True)
        for p, e in zip(message.parameters, estimates.parameters, strict=True):
            assert np.array_equal(
                [p.value, p.standard_deviation, p.age, p.excitation],
                [e.value, e.std, e.age, e.excitation],
                equal_nan=True,
            )
            assert (p.status, p.reason) == (int(e.status), e.reason)
            assert p.reason or p.status == Parameter.USE
        airspeed = (message.airspeed_min, message.airspeed_max)
        assert np.array_equal(airspeed, estimates.airspeed, equal_nan=True)
    last = messages[-1]
    deviations = [p.standard_deviation for p in last.parameters]
    assert np.sqrt(np.diag(np.array(last.covariance).reshape(32, 32))) == pytest.approx(deviations)
    assert 10.0 < last.airspeed_min < last.airspeed_max < 30.0
    assert last.alpha_min < last.alpha_max and last.beta_min < last.beta_max


def check_model_error(messages, sets, window):
    for message, (estimates, errors) in zip(messages, sets, strict=True):
        assert (message.window, message.model) == (window, estimates.model)
        for axis, e in zip(message.axes, errors, strict=True):
            assert (axis.axis, axis.measured, axis.predicted) == (e.axis, e.measured, e.predicted)
            assert np.array_equal([axis.nrmse, axis.residual_rms], [e.nrmse, e.residual_rms], equal_nan=True)
            assert (axis.lag_one_correlation, axis.white) == (e.lag_one_correlation, e.white)
    assert [axis.axis for axis in messages[-1].axes] == ["CX", "CY", "CZ", "Cl", "Cm", "Cn"]


def test_a_known_wind_by_hand(bench, aircraft):
    """Air that moves 3 m/s to the north, 2 to the west and half a metre down: x is east, y north, z up."""
    node = bench.node(StateEstimatorNode)
    heard = bench.listen(TwistWithCovarianceStamped, "state_estimator/wind")
    assert start(node)
    bench.spin_until(lambda: node._wind_publisher.get_subscription_count() > 0)
    row = np.zeros((1, StateField.WIDTH))
    row[0, StateField.WIND] = [3.0, -2.0, 0.5]
    row[0, StateField.STANDARD_DEVIATIONS][15:18] = [0.1, 0.2, 0.3]
    row[0, StateField.ATTITUDE.start] = 1.0
    row[0, StateField.TIME] = 1.5
    node.estimator.epoch = 1_000_000_000
    node._publish(row)
    bench.spin_until(lambda: bool(heard))
    linear, covariance = heard[0].twist.twist.linear, heard[0].twist.covariance
    assert (linear.x, linear.y, linear.z) == (-2.0, 3.0, -0.5)
    assert [covariance[0], covariance[7], covariance[14]] == pytest.approx([0.04, 0.01, 0.09])
    assert stamp(heard[0]) == 2_500_000_000


def test_parameters_are_published_once_a_second_also_while_nothing_is_learnt(bench):
    """The time of the estimator is that of the newest point, or of the newest state: it may fall back a little."""
    node = bench.node(ParameterEstimatorNode)
    assert start(node)
    learning = type("Learning", (), {"newest": ()})
    published = []
    clock = type("Clock", (), {"learning": learning, "snapshot": dict, "model_error": list, "time": 0.0})()
    node.estimator, node._epoch = clock, 0
    node._publish_parameters = lambda now, estimates: published.append(now)
    node._publish_model_error = node.model_services.search_if_due = node._log_holds = lambda *_: None
    for clock.time in (10.0, 10.5, 11.1, 12.3, 11.9, 12.9, 13.4, 3.0, 3.5, 4.0):
        node._publish_due()
    assert published == [10.0, 11.1, 12.3, 13.4, 3.0, 4.0]


@pytest.mark.long
def test_who_subscribes_later_gets_the_newest_parameters_at_once(flown, bench):
    heard = flown[2]
    late = bench.listen(Parameters, "parameter_estimator/parameters", newest_quality())
    bench.spin_until(lambda: late and stamp(late[-1]) == stamp(heard["parameters"][-1]))


@pytest.mark.long
def test_who_subscribes_after_a_reset_does_not_get_what_is_forgotten(flown, bench):
    """Until states came it got the parameters of before, to USE."""
    heard = flown[2]
    assert {p.status for p in heard["parameters"][-1].parameters} > {Parameter.USE}
    assert bench.call(Reset, "parameter_estimator/reset").success
    late = bench.listen(Parameters, "parameter_estimator/parameters", newest_quality())
    bench.spin_until(lambda: late and np.isnan([p.value for p in late[-1].parameters]).all(), 20.0)
    assert {p.status for p in late[-1].parameters} == {Parameter.HOLD}


@pytest.mark.long
def test_a_twin_and_an_input_of_another_type_are_named(bench, monkeypatch):
    """Two `live` in one namespace were "ok"; a Twist on gps/vel, which ROS does not deliver, was said of nowhere."""
    node = bench.node(StateEstimatorNode)
    assert start(node)
    heard = bench.listen(DiagnosticArray, "/diagnostics")

    def said():
        return heard[-1].status[0].message if heard else ""

    bench.spin_until(said)
    assert "another program" not in said() and "is published as" not in said()
    bench.helper.create_publisher(AircraftState, "/state_estimator/state", 10)
    twist = SimpleNamespace(topic_type="geometry_msgs/msg/Twist", endpoint_gid=bytes(24))  # of another process
    monkeypatch.setattr(node, "get_publishers_info_by_topic", lambda topic: [twist] * topic.endswith("gps/vel"))
    bench.spin_until(lambda: "another program publishes /state_estimator/state" in said())
    bench.spin_until(lambda: "/gps/vel is published as geometry_msgs/msg/Twist" in said())
    assert said().startswith("another") and ("but heard as geometry_msgs/msg/" in said()), said()


@pytest.mark.long
def test_two_programs_that_publish_the_same_inputs_are_named_while_they_do_and_after_it(bench):
    """Two recordings that were played at once made 2949 s of flight out of a minute, and nothing was said."""
    node = bench.node(StateEstimatorNode)
    assert start(node)
    heard, sent = bench.listen(DiagnosticArray, "/diagnostics"), 0
    senders = [bench.helper.create_publisher(Imu, "imu/data", 100) for _ in range(2)]
    bench.spin_until(lambda: all(sender.get_subscription_count() for sender in senders))
    for sending in (senders, senders[:1]):  # one that was killed is in the graph for some time more, and sends nothing
        before = len(heard)
        for sender in sending * 5:
            sender.publish(Imu())
            sent += 1
            bench.spin_until(lambda now=sent: node.received["imu/data"] == now)
        now = len(heard)
        bench.spin_until(lambda now=now: len(heard) > now)
        said = [status.message for message in heard[before:] for status in message.status]
        assert any("several programs published at once (" in text for text in said) == (len(sending) > 1)
    assert "2 on /imu/data" in node.shared_in_words
