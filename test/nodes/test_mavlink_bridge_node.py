"""The bridge as a node: an autopilot's UDP in, our topics out, wind and parameters back."""

import socket
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from aircraft_sysid_msgs.msg import AirData, ControlSurfaces, Parameter, Parameters
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped, TwistWithCovarianceStamped
from rcl_interfaces.srv import SetParameters
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter as RosParameter
from sensor_msgs.msg import Imu, JointState

from aircraft_sysid_ros.mavlink.assembler import ALL_TOPICS
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping, load_servo_mapping
from aircraft_sysid_ros.mavlink.transport import Transport, parse_address
from aircraft_sysid_ros.nodes import common, mavlink_bridge
from aircraft_sysid_ros.nodes.mavlink_bridge import MavlinkBridgeNode
from aircraft_sysid_ros.simulation.mavlink_simulator.autopilot import Faults, MavlinkSimulator
from aircraft_sysid_ros.simulation.mavlink_simulator.process import Radio
from aircraft_sysid_ros.simulation.mavlink_simulator.sensors import FlightSensors, pieces
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

CALIBRATION = Path(__file__).resolve().parents[2] / "config" / "mavlink_simulator_servos.yaml"


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Flight:
    """A simulator that speaks in real time from a thread."""

    def __init__(self, aircraft, port):
        flight = simulate_samples(aircraft, seed=6, duration=20.0)
        sensors = FlightSensors(aircraft, 6)
        transport = Transport(parse_address(f"udpout:127.0.0.1:{port}"))
        transport.open()
        self.simulator = MavlinkSimulator(load_servo_mapping(CALIBRATION))
        self.radio = Radio(self.simulator, transport, ())
        self.radio.add([event for piece in pieces(flight.truth) for event in sensors.events(piece)], np.inf)
        self.truth, self.ended = flight.truth, False
        self.thread = threading.Thread(target=self.fly, daemon=True)

    def fly(self):
        self.radio.begin()
        while not self.ended:
            self.radio.run_until(time.monotonic() - self.radio.started + 0.05)

    def end(self):
        self.ended = True
        self.thread.join()
        self.radio.transport.close()


@pytest.fixture
def flying(aircraft):
    port = free_port()
    flight = Flight(aircraft, port)
    yield flight, port
    flight.end()


@pytest.mark.long
def test_an_autopilot_on_our_topics_and_back(bench, flying):
    flight, port = flying
    values = {"connection": f"udp:127.0.0.1:{port}", "servo_file": str(CALIBRATION)}
    node = bench.node(MavlinkBridgeNode, **values, back_parameters=["CZ_alpha", "Cm_alpha"], back_wind_rate=5.0)
    heard = {
        topic: bench.listen(kind, topic)
        for topic, kind in {
            "imu/data": Imu, "gps/vel": TwistStamped, "air_data": AirData, "control_surfaces": ControlSurfaces,
            "/diagnostics": DiagnosticArray,
        }.items()
    }  # fmt: skip
    assert common.start(node)
    flight.thread.start()
    bench.spin_until(lambda: len(heard["imu/data"]) > 200 and len(heard["gps/vel"]) > 5)
    imu = heard["imu/data"][-1]
    stamp = imu.header.stamp.sec * 10**9 + imu.header.stamp.nanosec
    flown = 1e9 * len(heard["imu/data"]) / 100  # [ns] at 100 Hz
    assert flight.radio.wall_start + 0.9 * flown < stamp < node.get_clock().now().nanoseconds + 0.01e9
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in heard["imu/data"][100:]]
    assert np.median(np.diff(stamps)) == pytest.approx(0.01, abs=1e-3)
    assert 5.0 < np.mean([m.linear_acceleration.z for m in heard["imu/data"]]) < 14.0  # FLU: up is positive
    assert imu.orientation_covariance[0] == -1.0 and imu.header.frame_id == "base_link"
    airspeeds = [m.true_airspeed for m in heard["air_data"] if np.isfinite(m.true_airspeed)]
    angles = [m.angle_of_attack for m in heard["air_data"] if np.isfinite(m.angle_of_attack)]
    assert np.mean(airspeeds) == pytest.approx(flight.truth.airspeed.mean(), abs=1.5) and angles
    controls = heard["control_surfaces"][-1]
    assert np.isfinite([controls.elevator, controls.aileron, controls.rudder, controls.thrust]).all()
    assert np.isnan(controls.flaps)  # no output has them

    wind = bench.publisher(TwistWithCovarianceStamped, "state_estimator/wind")
    parameters = bench.publisher(Parameters, "parameter_estimator/parameters")
    message = TwistWithCovarianceStamped()
    message.twist.twist.linear.x, message.twist.twist.linear.y = 2.0, -3.0  # ENU: to the east and south
    message.twist.covariance[0] = message.twist.covariance[7] = 0.04
    parameters.publish(
        Parameters(
            parameters=[
                Parameter(name="CZ_alpha", value=-4.5, standard_deviation=0.1, status=Parameter.USE),
                Parameter(name="Cm_alpha", value=-9.0, standard_deviation=9.0, status=Parameter.HOLD),
            ]
        )
    )
    wind.publish(message)
    bench.spin_until(lambda: len(flight.simulator.heard) >= 2)
    back = {m.get_type(): m for m in flight.simulator.heard}
    assert back["NAMED_VALUE_FLOAT"].value == pytest.approx(-4.5)
    assert (back["WIND_COV"].wind_x, back["WIND_COV"].wind_y) == (-3.0, 2.0)
    assert back["WIND_COV"].horiz_accuracy == pytest.approx(0.2)
    bench.spin_until(lambda: bool(heard["/diagnostics"]))
    status = next(s for m in heard["/diagnostics"] for s in m.status if s.name.endswith("mavlink_bridge"))
    assert "vehicle" in {v.key for v in status.values}


@pytest.mark.long
def test_packets_that_are_lost_on_the_way_are_said_to_be(bench, flying):
    flight, port = flying
    flight.simulator.faults = Faults(loss=0.2)
    node = bench.node(MavlinkBridgeNode, connection=f"udp:127.0.0.1:{port}")
    diagnostics = bench.listen(DiagnosticArray, "/diagnostics")
    assert common.start(node)
    flight.thread.start()

    def told():
        return [s.message for m in diagnostics for s in m.status if "% of the packets" in s.message]

    bench.spin_until(told)
    shares = [float(text.rpartition(" %")[0].rpartition(" ")[2]) for text in told()]
    assert 8.0 < shares[-1] < 60.0 and "are lost on the way" in told()[-1]  # of one second


@pytest.mark.long
def test_parameters_that_cannot_go_back_are_named(bench, flying, monkeypatch, capfd):
    flight, port = flying
    monkeypatch.setattr(mavlink_bridge, "_PATIENCE", 0.5)
    wanted = ["CZ_alpha", "CZ_alfa", "Cm_bar"]
    node = bench.node(MavlinkBridgeNode, connection=f"udp:127.0.0.1:{port}", back_parameters=wanted, back_form="array")
    assert common.start(node)
    said = []

    def has_said(words):
        said.append("".join(capfd.readouterr()))
        return words in "".join(said)

    end = time.monotonic() + 2.0
    bench.spin_until(lambda: time.monotonic() > end)
    assert not has_said("have come")  # nor has a vehicle
    flight.thread.start()
    bench.spin_until(lambda: has_said("no parameters have come on /parameter_estimator/parameters yet"), 60.0)
    publisher = bench.publisher(Parameters, "parameter_estimator/parameters")
    message = Parameters(parameters=[Parameter(name="CZ_alpha"), Parameter(name="CZ_0")])
    words = "the model has no parameter CZ_alfa and no Cm_bar: not sent back; did you mean CZ_alpha?"
    bench.say_until(lambda: publisher.publish(message), lambda: has_said(words))
    end = time.monotonic() + 1.0
    bench.say_until(lambda: publisher.publish(message), lambda: has_said("") and time.monotonic() > end)
    assert "".join(said).count("the model has no parameter") == "".join(said).count("have come") == 1


@pytest.mark.long
def test_named_inputs_are_published_as_terms_read_them(bench, flying, tmp_path):
    flight, port = flying
    content = yaml.safe_load(CALIBRATION.read_text())
    number = next(n for n, output in content["outputs"].items() if output["surface"] == "elevator")
    content["outputs"][number]["input"] = "stabiliser"
    (tmp_path / "servos.yaml").write_text(yaml.safe_dump(content))
    values = {"connection": f"udp:127.0.0.1:{port}", "servo_file": str(tmp_path / "servos.yaml")}
    node = bench.node(MavlinkBridgeNode, **values)
    named, surfaces = bench.listen(JointState, "inputs"), bench.listen(ControlSurfaces, "control_surfaces")
    assert common.start(node)
    flight.thread.start()
    bench.spin_until(lambda: len(named) > 20 and len(surfaces) > 20)
    deflections = {(m.header.stamp.sec, m.header.stamp.nanosec): m.elevator for m in surfaces}
    shared = [m for m in named if (m.header.stamp.sec, m.header.stamp.nanosec) in deflections]
    assert len(shared) > 10
    for message in shared:
        assert list(message.name) == ["stabiliser"]
        assert message.position[0] == deflections[message.header.stamp.sec, message.header.stamp.nanosec]


@pytest.mark.long
def test_topics_can_be_left_to_others(bench, flying):
    _, port = flying
    flying[0].thread.start()
    node = bench.node(MavlinkBridgeNode, connection=f"udp:127.0.0.1:{port}", topics=["air_data"])
    assert common.start(node)
    assert node._topics.names == {"air_data"}


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"connection": "nonsense"}, "not understood"),
        ({"servo_file": "nowhere.yaml"}, "cannot read the calibration file"),
        ({"topics": ["imu"]}, "the parameter topics names imu"),
        ({"back_form": "json", "back_parameters": ["CZ_0"]}, "named or array"),
    ],
)
def test_a_node_that_cannot_be_configured_says_why(bench, capfd, parameters, text):
    values = {"connection": f"udp:127.0.0.1:{free_port()}", **parameters}
    node = bench.node(MavlinkBridgeNode, **values)
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    assert text in capfd.readouterr().err


def test_the_old_name_of_the_servo_file_works_with_a_word_of_warning(bench, capfd):
    """A calibration_file is what `calibrate` writes, to the estimators: one name in one launch meant two files."""
    values = {"connection": f"udp:127.0.0.1:{free_port()}", "calibration_file": str(CALIBRATION)}
    node = bench.node(MavlinkBridgeNode, **values)
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    assert repr(node.link.mapping) == repr(load_servo_mapping(CALIBRATION)) != repr(ServoMapping())
    assert "servo_file" in capfd.readouterr().err


def test_a_link_that_could_not_be_opened_at_first_has_not_failed_later(bench):
    """A lifecycle manager configures again until the autopilot listens: the diagnostics went on to say "failed"."""
    port = free_port()
    node = bench.node(MavlinkBridgeNode, connection=f"tcp:127.0.0.1:{port}")
    diagnostics = bench.listen(DiagnosticArray, "/diagnostics")
    assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as autopilot:
        autopilot.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        autopilot.bind(("127.0.0.1", port))
        autopilot.listen()
        assert common.start(node)
        bench.spin_until(lambda: bool(diagnostics))
        node.trigger_deactivate()
    assert next(s.message for m in diagnostics for s in m.status) == "waiting for the heartbeat of an autopilot"


def test_a_thread_that_hangs_does_not_read_beside_the_next_one(bench, monkeypatch):
    """In an attempt to connect, for one: deactivated and activated again, two threads read one link."""
    node = bench.node(MavlinkBridgeNode, connection=f"udp:127.0.0.1:{free_port()}")
    assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
    hangs, readers = threading.Event(), []

    def step(timeout):
        readers.append(threading.current_thread())
        hangs.wait(10.0)
        time.sleep(0.01)
        return []

    monkeypatch.setattr(node.bridge, "step", step)
    node.trigger_activate()
    node.trigger_deactivate()
    node.trigger_activate()
    hangs.set()
    readers[0].join(timeout=5.0)
    assert not readers[0].is_alive() and node._thread.is_alive()


def test_every_topic_has_a_type_that_is_installed():
    for kind in ALL_TOPICS.values():
        assert common.message_class(kind)


@pytest.mark.long
def test_what_goes_back_changes_in_flight_and_the_link_does_not(bench, flying):
    flight, port = flying
    node = bench.node(MavlinkBridgeNode, connection=f"udp:127.0.0.1:{port}", back_wind_rate=0.0)
    assert common.start(node)
    flight.thread.start()

    def put(**values):
        given = [RosParameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        return bench.call(SetParameters, "/mavlink_bridge/set_parameters", parameters=given).results

    for name, value in (("connection", "udp:127.0.0.1:1"), ("system", 3), ("topics", ["air_data"])):
        refused = put(**{name: value})[0]
        assert not refused.successful and f"{name} cannot change while the node is active" in refused.reason
    for name, value, words in (
        ("back_wind_rate", 90.0, "out of range"),
        ("back_form", "json", "named or array"),
        ("back_parameters", ["Cl_delta_rudder1", "Cl_delta_rudder2"], "two of the parameters"),
    ):
        refused = put(**{name: value})[0]
        assert not refused.successful and words in refused.reason
    assert not node._heard
    accepted = put(back_wind_rate=20.0, back_parameters=["Cm_alpha"], back_parameter_rate=20.0)
    assert all(result.successful for result in accepted)
    wind = bench.publisher(TwistWithCovarianceStamped, "state_estimator/wind")
    parameters = bench.publisher(Parameters, "parameter_estimator/parameters")
    known = Parameter(name="Cm_alpha", value=-0.5, standard_deviation=0.1, status=Parameter.USE)

    def say():
        wind.publish(TwistWithCovarianceStamped())
        parameters.publish(Parameters(parameters=[known]))

    back = {"WIND_COV", "NAMED_VALUE_FLOAT"}
    bench.say_until(say, lambda: back <= {m.get_type() for m in flight.simulator.heard})
    assert all(result.successful for result in put(back_wind_rate=0.0, back_parameters=[""]))
    assert not node._heard
