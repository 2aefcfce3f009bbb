"""A flight as px4_msgs, with the topics, units and frames of PX4: for a reader in this process, and as an agent.

python px4_agent.py MESSAGES.pickle SPEED PREFIX      # publishes them as the agent of uXRCE-DDS does
"""

from __future__ import annotations

import pickle
import sys
import time
from pathlib import Path

import numpy as np

from aircraft_sysid_ros.samples import Kind

PREFIX = "/fmu/out/"
GAMMA, SEA_LEVEL_PRESSURE, SEA_LEVEL_DENSITY = 1.4, 101325.0, 1.225
TRAVEL = np.radians(30.0)
#: What the outputs of these messages move.
SERVOS = """
outputs:
  1: {surface: left_aileron, command: [-1, 1], deg: [-30, 30]}
  2: {surface: right_aileron, command: [-1, 1], deg: [-30, 30]}
  3: {surface: elevator, command: [-1, 0, 1], deg: [-30, 0, 30]}
  4: {surface: rudder, command: [-1, 1], deg: [30, -30]}
  101: {surface: throttle, command: [0, 1], fraction: [0, 1]}
"""


def calibrated_airspeed(true, pressure, density):
    """Of the impact pressure that both airspeeds have, isentropic."""
    impact = pressure * ((1.0 + 0.5 * (GAMMA - 1.0) * true**2 * density / (GAMMA * pressure)) ** 3.5 - 1.0)
    inner = (impact / SEA_LEVEL_PRESSURE + 1.0) ** (1.0 / 3.5) - 1.0
    return np.sqrt(2.0 / (GAMMA - 1.0) * GAMMA * SEA_LEVEL_PRESSURE / SEA_LEVEL_DENSITY * inner)


def px4_messages(samples, *, start=None):
    """(stamp [ns], topic, type, fields) of samples; ``start`` [us]: time since start of the first, else Unix time."""
    of = {kind: np.flatnonzero(samples.kind == kind) for kind in Kind}
    first = int(samples.stamp.min()) // 1000
    shift = 0 if start is None else start - first
    made = []

    def add(row, name, kind, **fields):
        us = int(samples.stamp[row]) // 1000 + shift
        made.append((int(samples.stamp[row]), PREFIX + name, f"px4_msgs/msg/{kind}", {"timestamp": us, **fields}))
        return us

    for row in of[Kind.IMU]:
        value = samples.values[row].astype(np.float32)
        add(row, "sensor_combined", "SensorCombined", accelerometer_m_s2=value[:3], gyro_rad=value[3:6])
    for row, other in zip(of[Kind.GPS_POSITION], of[Kind.GPS_VELOCITY], strict=True):
        latitude, longitude, altitude = samples.values[row, :3]
        north, east, down = samples.values[other, :3].astype(np.float32)
        place = {
            "latitude_deg": np.degrees(latitude),
            "longitude_deg": np.degrees(longitude),
            "altitude_msl_m": altitude,
        }
        add(row, "vehicle_gps_position", "SensorGps", **place, fix_type=3, eph=0.8, epv=1.2,
            vel_n_m_s=north, vel_e_m_s=east, vel_d_m_s=down, vel_ned_valid=True)  # fmt: skip
    air = samples.values[of[Kind.AIR]]
    for row, (density, pressure) in zip(of[Kind.AIR], air[:, :2], strict=True):
        celsius = pressure / (287.05287 * density) - 273.15
        add(row, "vehicle_air_data", "VehicleAirData", baro_pressure_pa=pressure, ambient_temperature=celsius)
    for row, (density, pressure) in zip(of[Kind.AIRSPEED], air[:, :2], strict=True):
        speed = calibrated_airspeed(samples.values[row, 0], pressure, density)
        add(row, "airspeed_validated_v1", "AirspeedValidated", calibrated_airspeed_m_s=speed, airspeed_source=1)
    for row in of[Kind.CONTROLS]:
        elevator, aileron, rudder, _, throttle = samples.values[row, :5]
        servos = np.full(8, np.nan, np.float32)
        servos[:4] = np.array([-aileron, aileron, elevator, -rudder]) / TRAVEL
        motors = np.full(12, np.nan, np.float32)
        motors[0] = throttle
        add(row, "actuator_motors", "ActuatorMotors", control=motors)
        add(row, "actuator_servos", "ActuatorServos", control=servos)
    return sorted(made, key=lambda message: message[0])


def publish(messages, speed, prefix):
    """Publish them, paced, as soon as somebody hears the IMU; returns when all are out."""
    from importlib import import_module

    import rclpy
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    rclpy.init()
    node = rclpy.create_node("agent")
    quality = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
    kinds = {name: getattr(import_module("px4_msgs.msg"), name.rsplit("/", 1)[-1]) for _, _, name, _ in messages}
    publishers = {}
    for _, topic, kind, _ in messages:
        if topic not in publishers:
            publishers[topic] = node.create_publisher(kinds[kind], topic.replace(PREFIX, prefix), quality)
    while not all(publisher.get_subscription_count() for publisher in publishers.values()):
        time.sleep(0.1)
    time.sleep(2.0)  # a reader that has found a writer is known here at once; the other way only the reader knows
    print("heard", flush=True)
    began, first = time.monotonic(), messages[0][0]
    for stamp, topic, kind, fields in messages:
        time.sleep(max((stamp - first) * 1e-9 / speed - (time.monotonic() - began), 0.0))
        plain = {k: v if np.ndim(v) or isinstance(v, int) else float(v) for k, v in fields.items()}
        publishers[topic].publish(kinds[kind](**plain))
    time.sleep(1.0)
    rclpy.shutdown()


if __name__ == "__main__":
    publish(pickle.loads(Path(sys.argv[1]).read_bytes()), float(sys.argv[2]), sys.argv[3])
