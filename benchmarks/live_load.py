"""The live nodes under load: 400 Hz IMU, 100 Hz air data and controls, 10 Hz GPS from another process.

    python benchmarks/live_load.py [--duration 600] [--breakdown 60]

A simulated flight is published by the wall clock as a sensor driver does (best effort, depth 100); `aircraft-sysid
live` runs both nodes in a process of its own. Measured: samples lost (published against received), latency from the
publication of an IMU sample to the end of the callback that took it (its stamp is the wall clock just before it was
published; the reading at the end is taken in a subclass of the node), processor time of the nodes from /proc. The
breakdown repeats it for some seconds with nodes that do less: that says what the middleware costs.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from array import array
from pathlib import Path
from typing import Any

import numpy as np
import yaml

RATES = {"accelerometer": 400, "gyro": 400, "gps_position": 10, "gps_velocity": 10}
AIR_RATE = 100  # of everything else
#: What the nodes do: all; no state is published, so that the second node has nothing; listen only.
VARIANTS = ("everything", "without publishing states", "listening only")
LEAD = 2.0  # [s] between the first message and the first that counts
ENVIRONMENT = {
    **os.environ,
    "ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID", "173"),
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
}


# --- the process of the nodes --------------------------------------------------------------------------------


def run_nodes(variant: str, folder: Path) -> None:
    """`aircraft-sysid live` with a state estimator that notes when each IMU callback ended."""
    from aircraft_sysid_ros.commands import main as command_line
    from aircraft_sysid_ros.nodes import state_estimator

    ends = array("q")

    class TimedNode(state_estimator.StateEstimatorNode):
        def take(self, topic: str, message: Any) -> None:
            if variant != "listening only":
                super().take(topic, message)
            if topic == "imu/data":
                stamp = message.header.stamp
                ends.append(stamp.sec * 1_000_000_000 + stamp.nanosec)
                ends.append(time.time_ns())

        def _publish(self, rows: Any) -> None:
            if variant == "everything":
                super()._publish(rows)

    state_estimator.StateEstimatorNode = TimedNode
    arguments = ["live", "--aircraft", str(folder / "aircraft.yaml"), "--ready-file", str(folder / "ready"), "--json"]
    try:
        command_line.main(arguments)
    finally:
        np.save(folder / "ends.npy", np.array(ends, dtype=np.int64).reshape(-1, 2))


# --- the process of the sensors ------------------------------------------------------------------------------


def run_sensors(folder: Path, duration: float) -> None:
    """Publish the recording with new stamps, the wall clock; prints the counts by topic."""
    import rclpy
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    from aircraft_sysid_ros.nodes.common import message_class
    from aircraft_sysid_ros.recordings.playback import Schedule
    from aircraft_sysid_ros.recordings.storage import read_raw

    raw = read_raw(folder / "flight")
    rclpy.init()
    node = rclpy.create_node("sensors")
    quality = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
    publishers = {
        key: node.create_publisher(message_class(channel.type), channel.topic, quality)
        for key, channel in raw.channels.items()
    }
    while not all(publisher.get_subscription_count() for publisher in publishers.values()):
        time.sleep(0.05)
    time.sleep(1.0)
    counts = dict.fromkeys(publishers, 0)
    schedule, last = Schedule(1.0), raw.log_time[0] + int(duration * 1e9)
    for row in range(int(np.searchsorted(raw.log_time, last))):
        key, message = int(raw.channel[row]), bytearray(raw[row])
        schedule.wait(int(raw.log_time[row]))
        now = time.time_ns()
        message[4:12] = (now // 1_000_000_000).to_bytes(4, "little") + (now % 1_000_000_000).to_bytes(4, "little")
        publishers[key].publish(bytes(message))
        counts[key] += 1
    time.sleep(1.0)
    print(json.dumps({raw.channels[key].topic.lstrip("/"): count for key, count in counts.items()}))
    rclpy.try_shutdown()


# --- measuring -----------------------------------------------------------------------------------------------


def processor_time(pid: int) -> float:
    """Processor time [s] of all threads of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def start_self(role: str, folder: Path, *arguments: str, **options: Any) -> subprocess.Popen[str]:
    command = [sys.executable, __file__, "--role", role, "--folder", str(folder), *arguments]
    return subprocess.Popen(command, env=ENVIRONMENT, text=True, **options)


def wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    while not path.exists():
        if process.poll() is not None:
            raise SystemExit("the nodes did not start")
        time.sleep(0.1)


def measure(variant: str, folder: Path, duration: float) -> dict[str, Any]:
    """One run; figures of it."""
    (folder / "ready").unlink(missing_ok=True)
    log = (folder / "nodes.log").open("w")
    nodes = start_self("nodes", folder, "--variant", variant, stdout=subprocess.PIPE, stderr=log)
    try:
        wait_for(folder / "ready", nodes)
        load = os.getloadavg()[0]
        sensors = start_self("sensors", folder, "--duration", str(duration + LEAD), stdout=subprocess.PIPE)
        time.sleep(5.0 + LEAD)  # start of Python and discovery
        begin, cpu = time.perf_counter(), processor_time(nodes.pid)
        time.sleep(max(duration - 5.0, 1.0))
        share = (processor_time(nodes.pid) - cpu) / (time.perf_counter() - begin)
        published = json.loads(sensors.communicate()[0])
        nodes.send_signal(signal.SIGINT)
        output = nodes.communicate(timeout=60.0)[0]
    finally:
        nodes.kill()
    ends = np.load(folder / "ends.npy")
    latency = 1e-6 * (ends[:, 1] - ends[:, 0])[ends[:, 0] > ends[0, 0] + int(LEAD * 1e9)]
    p50, p99, p999 = (float(v) for v in np.percentile(latency, [50, 99, 99.9]))
    result: dict[str, Any] = {
        "duration": duration,
        "duration_published": duration + LEAD,
        "published": published,
        "cpu_share": share,
        "latency_ms": {"p50": p50, "p99": p99, "p99.9": p999, "largest": float(latency.max())},
        "load_average_before_and_after": [load, os.getloadavg()[0]],
    }
    if variant == "everything":
        live = json.loads(output)
        result["received"] = {topic: live["received"][topic] for topic in published}
        result["lost"] = sum(published.values()) - sum(result["received"].values())
        result["states_published_and_received"] = live["states"]
        result["fused"] = {kind: counts.get("fused", 0) for kind, counts in live["state"]["samples"].items()}
    else:
        result["lost"] = published["imu/data"] - len(ends)
    return result


def prepare(folder: Path, duration: float) -> None:
    """The aircraft file with the rates of the test, and its flight."""
    from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path

    content = yaml.safe_load(Path(config_path(DEFAULT_AIRCRAFT)).read_text(encoding="utf8"))
    for name, sensor in content["sensors"].items():
        sensor["rate"] = RATES.get(name, AIR_RATE)
    (folder / "aircraft.yaml").write_text(yaml.safe_dump(content), encoding="utf8")
    command = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", "simulate", "--out", folder / "flight"]
    subprocess.run([*command, "--aircraft", folder / "aircraft.yaml", "--duration", str(duration)], check=True,
                   stdout=subprocess.DEVNULL)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=600.0)
    parser.add_argument("--breakdown", type=float, default=60.0, help="seconds of the other variants; 0: none")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "live_load.json")
    parser.add_argument("--role", choices=("nodes", "sensors"), help=argparse.SUPPRESS)
    parser.add_argument("--variant", choices=VARIANTS, default=VARIANTS[0], help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.role == "nodes":
        return run_nodes(arguments.variant, arguments.folder)
    if arguments.role == "sensors":
        return run_sensors(arguments.folder, arguments.duration)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder, max(arguments.duration, arguments.breakdown) + LEAD + 1.0)
        runs = {VARIANTS[0]: measure(VARIANTS[0], folder, arguments.duration)}
        if arguments.breakdown:
            runs.update({variant: measure(variant, folder, arguments.breakdown) for variant in VARIANTS[1:]})
    result = {
        "rates": {"imu/data": 400, "air_data": AIR_RATE, "control_surfaces": AIR_RATE, "gps": 10},
        "runs": runs,
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, "
        f"{platform.python_implementation()} {platform.python_version()}",
    }
    arguments.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")
    print(json.dumps(result, indent=1))
    return None


if __name__ == "__main__":
    main()
