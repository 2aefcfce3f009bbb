"""The way of a drone developer: an autopilot's MAVLink onto topics, parameters live, a controller that uses them."""

import json
import socket
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("aircraft_sysid_msgs.msg")

from user import wait_until

from aircraft_sysid_ros.aircraft.configuration import load_aircraft

pytestmark = pytest.mark.xdist_group("nodes")
WAY = {
    "bridge": ("docs/mavlink.md", "aircraft-sysid bridge udp:0.0.0.0:14550 --calibration config/"),
    "live": ("docs/mavlink.md", "aircraft-sysid live --aircraft config/ultra_stick_25e.yaml --out runs/today"),
    "stand_in": ("docs/mavlink.md", "python -m aircraft_sysid_ros.simulation.stand_in.process --simulator textbook"),
    "fly": ("docs/closed-loop.md", "python examples/adaptive_controller/fly.py --case elevator --parameters live"),
}
AIRCRAFT = "config/ultra_stick_25e.yaml"
ENOUGH = 10  # parameters that may be used


def test_from_an_autopilot_to_a_controller(user):
    told = told_in_flight(user)
    truth = load_aircraft(user.folder / AIRCRAFT).coefficients  # what flies, and the fallback of the control loop
    assert {name: (value, origin) for name, (value, _, origin) in told[0].items()} == {
        name: (value, "PRIOR") for name, value in truth.items()
    }
    for values in told:
        assert values.keys() == truth.keys()
        assert all(abs(value - truth[name]) < 5.0 * std for name, (value, std, _) in values.items()), values
    written = json.loads((user.folder / "runs" / "today" / "parameters.json").read_text(encoding="utf8"))
    learnt = {p["name"]: p for p in written["parameters"]}
    for name in live_among(told[-1]):
        value, std, _ = told[-1][name]
        assert abs(value - learnt[name]["value"]) < 3.0 * std, name
    controlled(user)


def live_among(values):
    return [name for name, (_, _, origin) in values.items() if origin == "LIVE"]


def told_in_flight(user):
    """What the control loop was told, from its first question until enough values were live."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    loop = [sys.executable, str(Path(__file__).with_name("control_loop.py")), AIRCRAFT]
    with (
        user.start("bridge", "--json", **{"udp:0.0.0.0:14550": f"udp:127.0.0.1:{port}"}) as bridge,
        user.start("live", "--json") as live,
        user.open_terminal("loop", loop) as control_loop,
    ):
        for running in (bridge, live, control_loop):
            running.wait_for("listening")
        with user.start("stand_in", "--connect", f"udpout:127.0.0.1:{port}") as stand_in:
            said = lambda: [json.loads(line) for line in control_loop.output.splitlines(keepends=True) if "\n" in line]  # noqa: E731
            wait_until(lambda: said() and len(live_among(said()[-1])) >= ENOUGH, "values are live", stand_in)
            run, passed_on = (json.loads(running.interrupt()) for running in (live, bridge))
        control_loop.interrupt()
        told = said()
    assert passed_on["vehicle"] == "ArduPilot 1" and passed_on["bad_data"] == passed_on["reboots"] == 0
    assert run["states"][0] == run["states"][1] > 500
    return told


def controlled(user):
    """The example flies on live parameters."""
    flight = user.ask("fly", "--seconds", 12, "--rate", 0)
    assert flight["case"] == "elevator" and flight["seconds"] == pytest.approx(12.0)
    assert flight["problems"] == [] and flight["lost_at"] is None
    assert flight["messages_of_parameters"] > 0 and flight["refused"] == 0 and flight["parameters_with_use"] > 0
    assert flight["tracking_error_deg_before"] < 5.0
