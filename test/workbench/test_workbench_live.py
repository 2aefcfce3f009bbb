"""The page of a running parameter node over real ROS 2, and what it is made of."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
import pytest
from page_marks import marked

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight
from aircraft_sysid_ros.workbench.live_flight import MISSING
from aircraft_sysid_ros.workbench.live_link import start_link

pytest.importorskip("rclpy")
pytest.importorskip("aircraft_sysid_msgs.msg")

PATIENCE = 90.0
PIECE = 10.0  # [s]
NODE = "/parameter_estimator"


def wait_for_text(page, name: str, text: str) -> None:
    page.wait_for_function(
        "([s, t]) => document.querySelector(s)?.innerText.includes(t)",
        arg=[marked(name), text],
        timeout=1e3 * PATIENCE,
    )


class Player:
    """Messages of a recording onto their topics, as fast as the nodes take them."""

    TOPICS = ("imu/data", "imu/mag", "gps/fix", "gps/vel", "air_data", "control_surfaces")

    def __init__(self, raw) -> None:
        import rclpy
        from aircraft_sysid_msgs.msg import ModelError
        from rclpy.qos import QoSProfile

        from aircraft_sysid_ros.nodes.common import message_class

        rclpy.init()
        self.raw, self.node, self.reached = raw, rclpy.create_node("player"), -1.0  # [s] of flight, of the nodes
        self.node.create_subscription(ModelError, f"{NODE}/model_error", self._hear, 10)
        chosen = {key: c for key, c in raw.channels.items() if c.topic.strip("/") in self.TOPICS}
        self.publishers = {
            key: self.node.create_publisher(message_class(c.type), c.topic.strip("/"), QoSProfile(depth=5000))
            for key, c in chosen.items()
        }

    def play(self, begin: float, end: float) -> None:
        """What was flown between two times of flight [s], no more at once than the queues of the nodes hold."""
        self.until(lambda: all(p.get_subscription_count() for p in self.publishers.values()))
        at = (self.raw.log_time - self.raw.log_time[0]) * 1e-9
        for piece in np.arange(begin, end, PIECE):
            last = min(piece + PIECE, end)
            for n, i in enumerate(np.flatnonzero((at >= piece) & (at < last))):
                if n % 50 == 0:
                    time.sleep(0.02)  # a burst overflows the sockets
                if int(self.raw.channel[i]) in self.publishers:
                    self.publishers[int(self.raw.channel[i])].publish(self.raw[i])
            self.until(lambda: self.reached > last - 4.0 or last < 15.0)  # noqa: B023

    def play_until(self, seen, begin: float, end: float) -> float:
        """Second by second until something is seen: nodes that had to rest search again only while flying."""
        for second in np.arange(begin, end):
            if seen():
                return float(second)
            self.play(second, second + 1.0)
            time.sleep(4.0)
        return end

    def until(self, done) -> None:
        import rclpy

        deadline = time.monotonic() + PATIENCE
        while not done():
            assert time.monotonic() < deadline
            rclpy.spin_once(self.node, timeout_sec=0.05)

    def _hear(self, message) -> None:
        stamp = message.header.stamp
        self.reached = stamp.sec - self.raw.log_time[0] * 1e-9 + stamp.nanosec * 1e-9


@pytest.fixture(scope="module")
def player(aircraft, tmp_path_factory):
    """A flight of two minutes whose aeroplane has an effect that its model lacks."""
    import rclpy

    flight = simulate_samples(aircraft, 11, 122.0, rate=100.0, hidden=[("dihedral_alpha", 1.0)], manoeuvres="standard")
    path = tmp_path_factory.mktemp("live") / "flight"
    write_flight(flight, path)
    player = Player(read_raw(path))
    yield player
    player.node.destroy_node()
    rclpy.try_shutdown()


@contextmanager
def nodes(aircraft_file, tmp_path):
    """`live` until the end of the block."""
    command = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", "live", "--aircraft", str(aircraft_file)]
    with subprocess.Popen([*command, "--reliable"], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as live:
        try:
            yield
        finally:
            live.send_signal(signal.SIGINT)
            try:
                live.wait(60)
            finally:
                live.kill()


def error_of(page, axis: str) -> float:
    return float(page.inner_text(marked(f"held-out-{axis}")).split()[0])


@pytest.mark.long
def test_a_hidden_effect_is_named_and_added_in_flight(player, aircraft_file, tmp_path, served, open_page) -> None:
    with served("--live") as address:
        page = open_page(address)
        wait_for_text(page, "notice", f"No {NODE} yet")
        with nodes(aircraft_file, tmp_path):
            wait_for_text(page, "notice", f"{NODE} is there")  # it connected by itself
            player.play(0.0, 80.0)
            now = player.play_until(page.locator(marked("card-0")).is_visible, 80.0, 100.0)
            page.wait_for_selector(marked("card-0"), timeout=1e3 * PATIENCE)
            assert page.inner_text(marked("verdict")) == "An effect is missing"
            assert "Dihedral effect that depends on lift" in page.inner_text(marked("card-0"))
            first, before = page.inner_text(marked("model")), error_of(page, "Cl")
            page.wait_for_selector(marked("fails-Cl"))
            page.click(marked("card-0") + " .q-item")
            page.click(marked("add-0"))
            wait_for_text(page, "notice", "Added: Cl_alpha*beta")
            player.play(now, now + 15.0)
            page.wait_for_function(
                "([s, e]) => parseFloat(document.querySelector(s).innerText) < e",
                arg=[marked("held-out-Cl"), 0.5 * before], timeout=1e3 * PATIENCE,
            )  # fmt: skip
            assert page.inner_text(marked("model")) != first
            page.click(marked("tab-parameters"))
            wait_for_text(page, "parameters", "Cl_alpha*beta")
            page.click(marked("tab-state"))
            wait_for_text(page, "state", "wind [m/s]")
            page.click(marked("tab-model"))
            page.click(marked("side-add"))
            page.fill(marked("term"), "CZ: __import__('os')")
            wait_for_text(page, "complaint", "is not allowed")
            page.click(marked("undo"))
            wait_for_text(page, "notice", "Removed: Cl_alpha*beta")
            player.play(now + 15.0, now + 20.0)
            wait_for_text(page, "model", first)
        wait_for_text(page, "notice", f"{NODE} is gone")
        assert page.locator(marked("add-term")).is_disabled()
        page.context.close()  # before the server goes


@contextmanager
def speaking(namespace: str):
    """A node that is called as the parameter node, and a function that lets it say one second of flight."""
    import rclpy
    from aircraft_sysid_msgs.msg import AxisError, ModelError, Parameter, Parameters
    from rclpy.context import Context

    from aircraft_sysid_ros.nodes.common import newest_quality

    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node("parameter_estimator", namespace=namespace, context=context)
    errors = node.create_publisher(ModelError, "~/model_error", 10)
    parameters = node.create_publisher(Parameters, "~/parameters", newest_quality())

    def say(second: int, model: str, error: float) -> None:
        listed = [
            AxisError(axis=a, measured=0.1 * second, predicted=0.1, nrmse=error, lag_one_correlation=0.9) for a in AXES
        ]
        message = ModelError(model=model, window=10.0, axes=listed)
        message.header.stamp.sec = 1000 + second
        errors.publish(message)
        known = Parameter(name="Cl_beta", value=-0.1, standard_deviation=0.001, status=Parameter.USE)
        told = Parameters(model=model, parameters=[known])
        told.header.stamp.sec = 1000 + second
        parameters.publish(told)

    try:
        yield say
    finally:
        node.destroy_node()
        context.try_shutdown()


@pytest.mark.long
def test_a_node_in_a_namespace_on_a_tablet_in_the_dark(served, open_page) -> None:
    """Of two nodes the page shows the one whose namespace it was given."""
    with served("--live", "--namespace", "plane") as address:
        page = open_page(address, width=820, height=1180, color_scheme="dark")
        page.wait_for_selector("body.body--dark")
        assert "/plane/parameter_estimator" in page.inner_text(".who")
        with speaking("plane") as say, speaking("") as other:
            wait_for_text(page, "notice", "/plane/parameter_estimator is there")
            for second in range(300):  # the first may be lost: nobody is connected to the topic yet
                say(second, "ours", 0.25)
                other(second, "theirs", 0.75)
                time.sleep(0.05)
                if page.evaluate("document.querySelector('[data-testid=plot-Cl]').calcdata[0].length") > 8:
                    break
            assert page.inner_text(marked("model")) == "ours"
            wait_for_text(page, "held-out-Cl", "25.0 %")
        for tab in ("model", "parameters", "state"):
            page.click(marked(f"tab-{tab}"))
            page.wait_for_function("document.documentElement.scrollWidth <= 820")
        page.click(marked("tab-parameters"))
        wait_for_text(page, "parameters", "Cl_beta")
        page.context.close()


def test_a_page_that_is_opened_later_shows_what_was_found_before() -> None:
    """It said "not looked for yet" until the next search, and for ever of a node that hears no states any more."""
    import rclpy
    from aircraft_sysid_msgs.msg import MissingEffects
    from rclpy.context import Context

    from aircraft_sysid_ros.nodes.common import newest_quality

    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node("parameter_estimator", namespace="late", context=context)
    node.create_publisher(MissingEffects, "~/missing_effects", newest_quality()).publish(MissingEffects(verdict="none"))
    process, pipe = start_link("/late")
    try:
        deadline, heard = time.monotonic() + PATIENCE, {}
        while MISSING not in heard:
            assert time.monotonic() < deadline
            if pipe.poll(0.5):
                kind, content = pipe.recv()
                heard[kind] = content
        assert heard[MISSING]["verdict"] == "none"
    finally:
        process.kill()
        process.join()
        node.destroy_node()
        context.try_shutdown()


def test_a_namespace_that_is_none_is_one_sentence(capsys) -> None:
    assert main(["workbench", "--live", "--namespace", "9 lives", "--no-browser", "--port", "0"]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert "--namespace" in said[-1] and "is not a namespace" in said[-1] and "Traceback" not in str(said), said
