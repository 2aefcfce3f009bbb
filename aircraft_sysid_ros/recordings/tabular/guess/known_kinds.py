"""Folders whose files say what they hold: `ulog2csv` of PX4, and `rostopic echo -p` of MAVROS topics."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aircraft_sysid_ros.mavlink.px4_table import AIRSPEED_SOURCES, TIMES
from aircraft_sysid_ros.mavlink.quantities import FIX_3D, first_of_most
from aircraft_sysid_ros.mavlink.servo_mapping import ServoMapping
from aircraft_sysid_ros.mavlink.sources import ALIKE
from aircraft_sysid_ros.recordings.tabular.column_expression import parse_column_expression
from aircraft_sysid_ros.recordings.tabular.guess.known_line import KnownLine
from aircraft_sysid_ros.recordings.tabular.guess.quaternions import euler_expressions
from aircraft_sysid_ros.recordings.tabular.guess.servo_lines import calibrated, outputs_topic, uncalibrated
from aircraft_sysid_ros.recordings.tabular.signals import VECTORS
from aircraft_sysid_ros.recordings.tabular.source import Source
from aircraft_sysid_ros.recordings.tabular.table import Table, numbers
from aircraft_sysid_ros.recordings.tabular.text_files import MessageTable

_ULOG, _ROSTOPIC, _MESSAGES = "file of ulog2csv", "file of rostopic echo -p", "message of Paparazzi"
#: Names of their tables.
_ULOG_NAME, _ROSTOPIC_NAME, _MESSAGE_NAME = r"(?:^|_)({})_\d+\.csv$", r"(?:^|[-_])({})\.csv$", "^({})$"
_VECTOR = "xyz"
_ROWS = 100_000
#: Messages do not wait longer [ms]: a log in which they seem to has two clocks.
_LONGEST_DELAY = 1000.0
_GPS, _FIX_TYPE = ("sensor_gps", "vehicle_gps_position"), "fix_type"
_NED = ("north", "east", "down")


def _vector(
    signal: str, columns: Sequence[str], unit: str, signs: Sequence[float] = (1.0, 1.0, 1.0)
) -> list[KnownLine]:
    axes = _NED if signal == "velocity" else _VECTOR
    return [KnownLine(f"{signal}.{axis}", c, unit, s) for axis, c, s in zip(axes, columns, signs, strict=True)]


def _attitude(w: str, x: str, y: str, z: str) -> list[KnownLine]:
    """Euler angles of a quaternion FRD to NED."""
    texts = euler_expressions(w, x, y, z)
    return [KnownLine(s, "", "rad", expression=text) for s, text in zip(VECTORS["attitude"], texts, strict=True)]


def _attitude_of_ros() -> list[KnownLine]:
    """The same of a quaternion FLU to ENU: roll the same, pitch the other way, yaw from the north to the right."""
    w, x, y, z = (f"field.orientation.{name}" for name in "wxyz")
    roll, pitch, _ = _attitude(w, x, y, z)
    yaw = f"atan2(1-2*({y}**2+{z}**2), 2*({w}*{z}+{x}*{y}))"
    return [
        roll,
        KnownLine("attitude.pitch", "", "rad", -1.0, expression=pitch.expression),
        KnownLine("attitude.yaw", "", "rad", expression=yaw),
    ]


def _of_a_sensor(source: str) -> KnownLine:
    """True airspeed where the column that says what it is of names a sensor, 1 to 3."""
    masked = f"true_airspeed_m_s+0*sqrt(min({source}-1, 3-{source}))"
    return KnownLine("true_airspeed", "", "m/s", expression=masked, why=f"where {source} is a sensor, 1 to 3")


def _of_a_vane(signal: str, angle: str) -> list[KnownLine]:
    """An angle [rad] where the sensor is within its range, if it says so."""
    masked = f"{angle}+0*sqrt(valid-1)"
    return [KnownLine(signal, "", "rad", expression=masked, why="where it is valid"), KnownLine(signal, angle, "rad")]


_FLU = (1.0, -1.0, -1.0)
_IMU_OF_ROS = [
    *_vector("specific_force", [f"field.linear_acceleration.{a}" for a in _VECTOR], "m/s^2", _FLU),
    *_vector("angular_velocity", [f"field.angular_velocity.{a}" for a in _VECTOR], "rad/s", _FLU),
]
_VELOCITY_OF_ROS = [
    KnownLine("velocity.north", "field.twist.linear.y", "m/s"),
    KnownLine("velocity.east", "field.twist.linear.x", "m/s"),
    KnownLine("velocity.down", "field.twist.linear.z", "m/s", -1.0, unless_zero=True),
]
_COMMANDS = [
    KnownLine(
        f"inputs.command_{name}", f"control[{i}]", "1", why="normalised -1 to 1, no angle: the travel is not known"
    )
    for i, name in enumerate(("roll", "pitch", "yaw"))
]
#: By topic, preferred first where two have a signal.
_PX4: dict[str, list[KnownLine]] = {
    "sensor_combined": [
        *_vector("specific_force", [f"accelerometer_m_s2[{i}]" for i in range(3)], "m/s^2"),
        *_vector("angular_velocity", [f"gyro_rad[{i}]" for i in range(3)], "rad/s"),
    ],
    "vehicle_acceleration": _vector("specific_force", [f"xyz[{i}]" for i in range(3)], "m/s^2"),
    "vehicle_angular_velocity": _vector("angular_velocity", [f"xyz[{i}]" for i in range(3)], "rad/s"),
    "vehicle_attitude": _attitude("q[0]", "q[1]", "q[2]", "q[3]"),
    "sensor_gps": [],
    "vehicle_gps_position": [
        KnownLine("latitude", "latitude_deg", "deg"), KnownLine("longitude", "longitude_deg", "deg"),
        KnownLine("altitude", "altitude_msl_m", "m"),
        KnownLine("latitude", "lat", "1e-7 deg"), KnownLine("longitude", "lon", "1e-7 deg"),
        KnownLine("altitude", "alt", "mm"),
        *_vector("velocity", ["vel_n_m_s", "vel_e_m_s", "vel_d_m_s"], "m/s"),
    ],
    "airspeed_validated": [
        *(_of_a_sensor(source) for source in AIRSPEED_SOURCES), KnownLine("true_airspeed", "true_airspeed_m_s", "m/s"),
    ],
    "airspeed": [KnownLine("true_airspeed", "true_airspeed_m_s", "m/s")],
    "vehicle_air_data": [
        KnownLine("static_pressure", "baro_pressure_pa", "Pa"), KnownLine("air_density", "rho", "kg/m^3"),
    ],
    "airflow_aoa": _of_a_vane("angle_of_attack", "aoa_rad"),
    "airflow_slip": _of_a_vane("sideslip", "slip_rad"),
    "actuator_controls_0": _COMMANDS,
    **{topic: uncalibrated(topic) for topic in ("actuator_servos", "actuator_motors", "actuator_outputs")},
    "battery_status": [
        KnownLine("inputs.electric_power", "", "W", expression="voltage_v*current_a", why="of the battery"),
    ],
}  # fmt: skip
_PX4["sensor_gps"] = _PX4["vehicle_gps_position"]
_MAVROS: dict[str, list[KnownLine]] = {
    "imu-data_raw": _IMU_OF_ROS,
    "imu-data": [*_IMU_OF_ROS, *_attitude_of_ros()],
    "global_position-raw-fix": [
        KnownLine("latitude", "field.latitude", "deg"), KnownLine("longitude", "field.longitude", "deg"),
        KnownLine("altitude", "field.altitude", "m"),
    ],
    "global_position-global": [
        KnownLine("latitude", "field.latitude", "deg"), KnownLine("longitude", "field.longitude", "deg"),
        KnownLine("altitude", "field.altitude", "m"),
    ],
    "global_position-raw-gps_vel": _VELOCITY_OF_ROS,
    "local_position-velocity_local": _VELOCITY_OF_ROS,
    "nav_info-airspeed": [KnownLine("indicated_airspeed", "field.measured", "m/s")],
    "vfr_hud": [
        KnownLine("indicated_airspeed", "field.airspeed", "m/s"),
        KnownLine("throttle", "field.throttle", "1"),
        KnownLine("velocity.down", "field.climb", "m/s", -1.0, why="of the autopilot: GPS has no vertical speed here"),
    ],
    "imu-static_pressure": [KnownLine("static_pressure", "field.fluid_pressure", "Pa")],
    "imu-atm_pressure": [KnownLine("static_pressure", "field.fluid_pressure", "Pa")],
    "imu-diff_pressure": [KnownLine("dynamic_pressure", "field.fluid_pressure", "Pa")],
    "rc-out": uncalibrated("rc-out"),
}  # fmt: skip


#: Messages of Paparazzi's log, whose fields have no names in it; columns are counted after the name of the message.
_PAPARAZZI: dict[str, list[KnownLine]] = {
    "IMU_GYRO": _vector("angular_velocity", "123", "rad/s"),
    "IMU_ACCEL": _vector("specific_force", "123", "m/s^2"),
    "ATTITUDE": [
        KnownLine("attitude.roll", "1", "rad"), KnownLine("attitude.yaw", "2", "rad"),
        KnownLine("attitude.pitch", "3", "rad"),
    ],
    "GPS": [
        KnownLine("position.east", "2", "cm"), KnownLine("position.north", "3", "cm"),
        KnownLine("position.down", "5", "mm", -1.0),
        KnownLine("velocity.north", "", "cm/s", expression="`6`*cos(`4`*pi/1800)"),
        KnownLine("velocity.east", "", "cm/s", expression="`6`*sin(`4`*pi/1800)"),
        KnownLine("velocity.down", "7", "cm/s", -1.0),
    ],
    "ACTUATORS": uncalibrated("ACTUATORS"),
    "COMMANDS": [KnownLine(f"inputs.command_{i}", str(i), "1", why="up to 9600, no angle") for i in range(1, 9)],
}  # fmt: skip


def known_lines(
    source: Source, tables: Sequence[Table], mapping: ServoMapping | None = None
) -> tuple[dict[str, list[KnownLine]], list[str]] | None:
    """Lines by table where the source is of a known kind, and what is lacking for ``mapping``; None where it is not.

    ``mapping``: what the outputs of the autopilot move.
    """
    messages = [table for table in tables if isinstance(table, MessageTable)]
    if messages:
        known, lost = _with_outputs(messages, _PAPARAZZI, _MESSAGE_NAME, mapping)
        return _of_paparazzi({table.name: table for table in messages}, known), lost
    if not source.is_folder:
        return None
    ulog = [table for table in tables if "timestamp" in table.columns and re.search(r"_\d+\.csv$", table.name)]
    if len(ulog) >= 2 and len(ulog) >= 0.8 * len(tables):
        read, notes = _one_instance(ulog)
        known, lost = _with_outputs(read, _PX4, _ULOG_NAME, mapping)
        return _chosen(read, _denser_first(read, known), _ULOG_NAME, _ULOG), notes + lost
    rostopic = [table for table in tables if "%time" in table.columns]
    if rostopic and len(rostopic) >= 0.8 * len(tables):
        known, lost = _with_outputs(rostopic, _MAVROS, _ROSTOPIC_NAME, mapping)
        return _chosen(rostopic, known, _ROSTOPIC_NAME, _ROSTOPIC), lost
    return None


def _one_instance(tables: Sequence[Table]) -> tuple[list[Table], list[str]]:
    """Tables of instance 0, of a lone battery, and of the GPS receiver with clearly more fixes, which is a note."""
    by_topic: dict[str, dict[int, Table]] = {}
    for table in tables:
        topic, number = re.findall(r"^(.*)_(\d+)\.csv$", table.name)[0]
        by_topic.setdefault(topic, {})[int(number)] = table
    read, notes = [], []
    for topic, instances in by_topic.items():
        order = sorted(instances)
        best = order[0] if len(order) == 1 and topic.endswith(("battery_status", *_GPS)) else 0
        if len(order) > 1 and topic.endswith(_GPS):
            best = order[first_of_most([_count(instances[number], _PX4[_GPS[0]]) for number in order])]
            if best != order[0]:
                notes.append(f"{instances[best].name} is read: it has more fixes than {instances[order[0]].name}")
        if best in instances:
            read.append(instances[best])
    return read, notes


def _denser_first(tables: Sequence[Table], known: dict[str, list[KnownLine]]) -> dict[str, list[KnownLine]]:
    """The lines by topic, of two topics alike first those of which the log has clearly more samples."""
    order = list(known)
    for alike in ALIKE:
        of_topic = {
            topic: [table for table in tables if re.search(_ULOG_NAME.format(topic), table.name)]
            for topic in sorted(alike, key=order.index)
        }
        if all(of_topic.values()):
            counts = [sum(_count(table, known[topic]) for table in of) for topic, of in of_topic.items()]
            first, denser = next(iter(of_topic)), list(of_topic)[first_of_most(counts)]
            order.insert(order.index(first), order.pop(order.index(denser)))
    return {topic: known[topic] for topic in order}


def _count(table: Table, lines: Sequence[KnownLine]) -> int:
    """Rows in which the first of the lines that is there is a number, of a GPS receiver those with a fix."""
    line = next((line for line in lines if _has(table, line)), None)
    if line is None:
        return 0
    value = parse_column_expression(line.expression or line.column)
    fix = [_FIX_TYPE] if _FIX_TYPE in table.columns else []
    count = 0
    for piece in table.read([*value.columns, *fix], _ROWS):
        columns = {name: numbers(column)[0] for name, column in piece.items()}
        sound = np.isfinite(value.evaluate(columns)) & (columns.get(_FIX_TYPE, np.array(FIX_3D)) >= FIX_3D)
        count += int(sound.sum())
    return count


def _with_outputs(
    tables: Sequence[Table], known: dict[str, list[KnownLine]], pattern: str, mapping: ServoMapping | None
) -> tuple[dict[str, list[KnownLine]], list[str]]:
    """The outputs of a calibration file before all others, and in place of their pulses; what it lacks."""
    if mapping is None or not mapping.outputs:
        return known, []
    columns_of = {topic: table.columns for table in tables if (topic := outputs_topic(table.name, pattern))}
    lines, lost = calibrated(mapping, columns_of)
    others = {topic: lines_of for topic, lines_of in known.items() if topic not in columns_of}
    return {**lines, **others}, lost


def _of_paparazzi(messages: dict[str, MessageTable], known: dict[str, list[KnownLine]]) -> dict[str, list[KnownLine]]:
    """The lines of a log of Paparazzi.

    A message is logged when it is sent, and that of the GPS holds a solution that is up to one period older: it counts
    by the time of the receiver, on the clock of the log by the least delay. Without a magnetometer the yaw follows the
    course over ground, which no heading does in wind.
    """
    found = _chosen(list(messages.values()), known, _MESSAGE_NAME, _MESSAGES)
    if "GPS" in found and (offset := _delay_of_solutions(messages["GPS"])) is not None:
        told = "the receiver's time of the solution, by the least delay of its messages"
        found["GPS"] = [
            replace(line, time=_TOW, time_unit="ms", time_offset=offset, kind=told) for line in found["GPS"]
        ]
    if "ATTITUDE" in found and not _has_magnetometer(messages):
        doubt = "without a magnetometer its yaw follows the course over ground, which in wind is not the heading"
        found["ATTITUDE"] = [replace(line, doubt=doubt) for line in found["ATTITUDE"]]
    return found


#: Column of the receiver's time of week [ms].
_TOW = "9"


def _delay_of_solutions(gps: MessageTable) -> float | None:
    """Least time [ms] of the log less that of the receiver; None where the latter does not rise with it."""
    if _TOW not in gps.columns:
        return None
    pieces = [np.stack([piece["time"], piece[_TOW]]) for piece in gps.read(["time", _TOW], _ROWS)]
    logged, receiver = np.concatenate(pieces, axis=1) if pieces else np.empty((2, 0))
    delay = 1e3 * logged - receiver
    rises = len(delay) > 1 and np.isfinite(delay).all() and (np.diff(receiver) >= 0.0).all()
    return round(float(delay.min()), 3) if rises and np.ptp(delay) < _LONGEST_DELAY else None


def _has_magnetometer(messages: dict[str, MessageTable]) -> bool:
    field = messages.get("IMU_MAG")
    return field is not None and any(np.any(piece["1"] != 0.0) for piece in field.read(["1"], _ROWS))


def _chosen(
    tables: Sequence[Table], known: dict[str, list[KnownLine]], pattern: str, kind: str
) -> dict[str, list[KnownLine]]:
    """Each signal once, from the first table that has it."""
    found: dict[str, list[KnownLine]] = {}
    taken: set[str] = set()
    for topic, lines in known.items():
        for table in tables:
            if not re.search(pattern.format(re.escape(topic)), table.name):
                continue
            timed = _time(table, kind)
            here = {line.signal: line for line in reversed(lines) if _has(table, line) and line.signal not in taken}
            taken |= here.keys()
            ordered = [line for line in lines if here.get(line.signal) is line]
            found.setdefault(table.name, []).extend(_timed(line, kind, *timed) for line in ordered)
    return found


def _has(table: Table, line: KnownLine) -> bool:
    wanted = parse_column_expression(line.expression).columns if line.expression else [line.column]
    if not all(column in table.columns for column in wanted):
        return False
    if not line.unless_zero:
        return True
    return any(
        np.any(np.nan_to_num(numbers(piece[line.column])[0]) != 0.0) for piece in table.read([line.column], _ROWS)
    )


def _time(table: Table, kind: str) -> tuple[str, str]:
    """The time column of a table and its unit."""
    if kind == _ULOG:
        return (TIMES[0] if _is_filled_in(table) else TIMES[1]), "us"
    if kind == _ROSTOPIC:
        return ("field.header.stamp" if "field.header.stamp" in table.columns else "%time"), "ns"
    return "time", "s"


def _is_filled_in(table: Table) -> bool:
    """Whether PX4 says when samples were taken: just before their messages; some drivers leave it at 0."""
    if TIMES[0] not in table.columns:
        return False
    piece = next(table.read(TIMES, _ROWS), None)
    if piece is None:
        return False
    taken, published = (numbers(piece[column])[0] for column in TIMES)
    delay = 1e-3 * (published - taken)[np.isfinite(taken)]
    return len(delay) > 0 and bool(np.all((delay >= 0.0) & (delay < _LONGEST_DELAY)))


def _timed(line: KnownLine, kind: str, time: str, unit: str) -> KnownLine:
    why = f"{kind}: {line.why}" if line.why else kind
    return replace(line, kind=kind, time=time, time_unit=unit, is_unix=kind == _ROSTOPIC, why=why)
