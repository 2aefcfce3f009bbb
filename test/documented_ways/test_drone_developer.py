"""The way of a drone developer: an autopilot's MAVLink onto topics, parameters live, a controller that uses them."""

import json
import socket
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

pytest.importorskip("rclpy")
pytest.importorskip("aircraft_sysid_msgs.msg")

from diagnostic_msgs.msg import DiagnosticArray
from documented_commands import python_blocks
from sensor_msgs.msg import NavSatFix
from user import PATIENCE

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.consumer import Origin
from aircraft_sysid_ros.identification.monitoring.sensor_faults import WORDS
from aircraft_sysid_ros.mavlink.assembler import ALL_TOPICS
from aircraft_sysid_ros.ros_messages.conversion import FIX, UNKNOWN_FIX

ARDUPILOT, CONTROLLER = "docs/tutorials/beside-ardupilot.md", "docs/tutorials/feed-a-controller.md"
WAY = {
    "bridge": (ARDUPILOT, "aircraft-sysid bridge udp:0.0.0.0:14550 --servos config/"),
    "live": (
        ARDUPILOT,
        "aircraft-sysid live --aircraft config/ultra_stick_25e.yaml --out runs/today",
    ),
    "mavlink_simulator": (
        ARDUPILOT,
        "python -m aircraft_sysid_ros.simulation.mavlink_simulator.process --simulator textbook",
    ),
    "fly": (
        CONTROLLER,
        "python examples/adaptive_controller/fly.py --case elevator --parameters live",
    ),
}
AIRCRAFT, CALIBRATION = "config/ultra_stick_25e.yaml", "config/mavlink_simulator_servos.yaml"
KEPT = "the values are those from before it"  # of a parameter that is held
ENOUGH = 10  # parameters that may be used
LONGEST = 900  # [s] of flight at the most: it goes by the clock, and a busy machine is behind


def test_from_an_autopilot_to_a_controller(user, bench):
    told = told_in_flight(user, bench)
    truth = load_aircraft(user.folder / AIRCRAFT).coefficients  # what flies, and the fallback of the control loop
    assert {name: (value, origin) for name, (value, _, origin) in told[0].items()} == {
        name: (value, "PRIOR") for name, value in truth.items()
    }
    for values in told:
        assert values.keys() == truth.keys()
        wrong = {
            name: (value, std, origin, truth[name])
            for name, (value, std, origin) in values.items()
            if not abs(value - truth[name]) < 5.0 * std
        }
        assert not wrong
    same_as_written(told[-1], user.folder / "runs" / "today", truth)
    controlled(user)


def live_among(values):
    return [name for name, (_, _, origin) in values.items() if origin == "LIVE"]


def told_in_flight(user, bench):
    """What the control loop was told, from its first question until enough values were live."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    loop = [sys.executable, str(Path(__file__).with_name("control_loop.py")), AIRCRAFT]
    diagnostics, fixes = bench.listen(DiagnosticArray, "/diagnostics"), bench.listen(NavSatFix, "gps/fix")
    instead = {"udp:0.0.0.0:14550": f"udp:127.0.0.1:{port}", CALIBRATION: slower(user.folder)}
    with (
        user.start("bridge", "--json", **instead) as bridge,
        user.start("live", "--json") as live,
        user.open_terminal("loop", loop) as control_loop,
    ):
        for running in (bridge, live, control_loop):
            running.wait_for("listening")

        def told():
            lines = control_loop.output.splitlines(keepends=True)
            return [json.loads(line) for line in lines if line.endswith("\n")]

        def is_told_enough():
            assert simulator.process.poll() is None, what_was_said(told(), diagnostics, live, bridge, control_loop)
            return bool(told()) and len(live_among(told()[-1])) >= ENOUGH

        more = ["--duration", LONGEST, "--connect", f"udpout:127.0.0.1:{port}"]
        with user.start("mavlink_simulator", *more) as simulator:
            bench.spin_until(is_told_enough, LONGEST + PATIENCE)
            bench.spin_until(lambda: "published.gps/fix" in newest(diagnostics, "mavlink_bridge"))
            run, passed_on = (json.loads(running.interrupt()) for running in (live, bridge))
        control_loop.interrupt()
    check_diagnosed(newest(diagnostics, "state_estimator"), fixes)
    check_passed_on(passed_on)
    assert run["states"][0] == run["states"][1] > 500
    return told()


def what_was_said(told, diagnostics, *processes):
    """Why the flight ended before enough values were live."""
    newest_of = {s.name: s for message in diagnostics for s in message.status}
    said = [f"told {len(told)} times, live at the end: {live_among(told[-1]) if told else 'nothing'}"]
    for s in newest_of.values():
        values = {item.key: item.value for item in s.values}
        said.append(f"{s.name}: {s.message} {values}")
    return "\n".join(said + [running.errors for running in processes])


def slower(folder):
    """The calibration of the page with half of the rates: other tests fly beside this one on the same cores."""
    content = yaml.safe_load((folder / CALIBRATION).read_text(encoding="utf8"))
    content["rates"] |= dict.fromkeys(["HIGHRES_IMU", "SERVO_OUTPUT_RAW"], 50)
    content["rates"] |= dict.fromkeys(["VFR_HUD", "AOA_SSA", "GLOBAL_POSITION_INT", "NAMED_VALUE_FLOAT"], 25)
    content["rates"] |= dict.fromkeys(["RPM", "SCALED_PRESSURE", "ATTITUDE_QUATERNION", "GPS_RAW_INT"], 5)
    path = folder / "slower.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf8")
    return path


def newest(diagnostics, name):
    """Newest values of a node's diagnostics."""
    found = [s for message in diagnostics for s in message.status if s.name.endswith(name)]
    return {item.key: item.value for item in found[-1].values} if found else {}


def check_diagnosed(values, fixes):
    """Every sensor came, and all of it is of use."""
    for kind in ("imu", "gps_position", "gps_velocity", "airspeed", "angle_of_attack", "sideslip"):
        assert int(values[f"{kind}.received"]) > 0 and f"{kind}.invalid" not in values, values
    assert {fix.status.status for fix in fixes} <= {FIX, UNKNOWN_FIX}  # the filter's, until the receiver's comes
    assert fixes[-1].status.status == FIX


def check_passed_on(result):
    """What the bridge says when it is stopped."""
    assert result["vehicle"] == "ArduPilot 1" and result["bad_data"] == result["reboots"] == 0
    assert result["published"].keys() == ALL_TOPICS.keys()
    assert result["clock"]["std"] < 0.05  # less than 0.001 where no other work delays the answers


def same_as_written(values, run, truth):
    """The run has what the control loop was told last, and is right where it says USE."""
    written = {p["name"]: p for p in json.loads((run / "parameters.json").read_text(encoding="utf8"))["parameters"]}
    for name in live_among(values):
        value, std, _ = values[name]
        assert abs(value - written[name]["value"]) < 3.0 * std, name
    used = [p for p in written.values() if p["status"] == "USE"]
    # a machine that was too busy at the end has lost sensors: what was known goes on, held
    held = [p for p in written.values() if p["reason"].startswith(WORDS) and KEPT in p["reason"]]
    reasons = {name: (p["status"], p["reason"]) for name, p in written.items()}
    assert len(used) >= ENOUGH / 2 or len(held) >= ENOUGH / 2, reasons
    assert all(abs(p["value"] - truth[p["name"]]) < 5.0 * p["std"] for p in used), used
    assert json.loads((run / "state.json").read_text(encoding="utf8"))["duration"] > 10.0
    assert (run / "estimates.mcap").stat().st_size > 0


def controlled(user):
    """The example flies in step, long enough that the estimators, who are behind, have sent their parameters."""
    flight = user.ask("fly", "--seconds", 40, "--rate", 0)
    assert flight["case"] == "elevator" and flight["seconds"] == pytest.approx(40.0)
    assert flight["problems"] == [] and flight["lost_at"] is None
    assert flight["messages_of_parameters"] > 0 and flight["refused"] == 0
    assert flight["tracking_error_deg_before"] < 5.0


def test_values_by_flight_condition_as_the_page_asks_for_them(aircraft):
    def subscribed(_type, topic, *_):
        return SimpleNamespace(topic_name=topic)

    node = SimpleNamespace(create_subscription=subscribed, get_logger=lambda: None)
    plain, by_condition = python_blocks("docs/closed-loop.md")
    names = {"aircraft": aircraft, "node": node, "stamp_ns": 1, "airspeed": 17.0, "alpha": 0.05, "beta": 0.0}
    exec(plain.partition("...\n")[0], names)
    exec(by_condition, names)
    elevator = names["values"]["Cm_de"]
    assert (elevator.value, elevator.origin) == (aircraft.coefficients["Cm_de"], Origin.PRIOR)
