"""Four columns of a table that are an attitude: whatever they are called and whichever way they count."""

import numpy as np
import pytest
import strange_layouts as layouts

from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.recordings.tabular.column_expression import parse_column_expression
from aircraft_sysid_ros.recordings.tabular.guess.first_map import guess_map, map_text
from aircraft_sysid_ros.ros_messages.conversion import quaternion_enu_flu

ANGLES = ("attitude.roll", "attitude.pitch", "attitude.yaw")
#: Names of the columns; what they are of (w, x, y, z) FRD to NED.
WAYS = {
    "w first": (["qw", "qx", "qy", "qz"], lambda q: q),
    "in brackets": (["q[0]", "q[1]", "q[2]", "q[3]"], lambda q: q),
    "of ROS": ([f"pose.orientation.{part}" for part in "xyzw"], quaternion_enu_flu),
    "ROS, numbers": (["Quat 1", "Quat 2", "Quat 3", "Quat 4"], quaternion_enu_flu),
    "scalar last": (["q1", "q2", "q3", "q4"], lambda q: q[:, [1, 2, 3, 0]]),
    "earth to body": (["quat_w", "quat_x", "quat_y", "quat_z"], lambda q: q * [1.0, -1.0, -1.0, -1.0]),
    "either sign": (["q0", "q1", "q2", "q3"], lambda q: q * np.where(np.arange(len(q)) % 7 < 3, 1.0, -1.0)[:, None]),
}


def table(flight, folder, names, quaternion, gyros=True, with_roll=False, first=None):
    """A table of a flight in SI; returns its path, the times and the quaternions that are in it."""
    truth = flight.truth
    rows = np.arange(100, len(truth.time) // 2, max(1, round(0.04 / np.median(np.diff(truth.time)))))
    columns = {
        **(first(truth.quaternion[rows]) if first else {}),
        **{f"a{axis}_mps2": truth.specific_force[rows, i] for i, axis in enumerate("xyz")},
        **{f"{axis}_rps": truth.rates[rows, i] for i, axis in enumerate("pqr") if gyros},
        **{f"v{way}_mps": truth.velocity[rows, i] for i, way in enumerate("ned")},
        "alt_m": truth.origin[2] - truth.position[rows, 2], "tas_mps": truth.airspeed[rows],
        **dict(zip(names, quaternion(truth.quaternion[rows]).T, strict=True)),
    }  # fmt: skip
    if with_roll:
        columns["roll_rad"] = np.array([euler_from_quaternion(q)[0] for q in truth.quaternion[rows]])
    path = folder / "flight.csv"
    layouts.write_rows(path, ["time_s", *columns], [truth.time[rows], *columns.values()])
    return path, {name: np.asarray(values) for name, values in columns.items()}, truth.quaternion[rows]


def lines_of(path):
    (part,) = guess_map(path).parts
    return {line.signal: line for line in part.lines}, part


@pytest.mark.parametrize("way", WAYS)
def test_an_attitude_is_that_of_the_flight_whichever_way_it_counts(flight, tmp_path, way):
    names, quaternion = WAYS[way]
    path, columns, truth = table(flight, tmp_path, names, quaternion)
    lines, part = lines_of(path)
    assert not set(names) & set(part.unmapped)
    euler = np.array([euler_from_quaternion(q) for q in truth])
    for i, signal in enumerate(ANGLES):
        line = lines[signal]
        assert line.active, line.evidence
        value = line.sign * (parse_column_expression(line.expression).evaluate(columns) + line.offset)
        assert np.max(np.abs(np.angle(np.exp(1j * (value - euler[:, i]))))) < 2e-3
    assert "expression: " in map_text(guess_map(path), path)


def test_angles_that_have_names_go_before(flight, tmp_path):
    path, *_ = table(flight, tmp_path, *WAYS["w first"], with_roll=True)
    lines = [line for line in guess_map(path).parts[0].lines if line.signal == "attitude.roll"]
    assert [(line.column, line.active) for line in lines] == [("roll_rad", True), ("qw, qx, qy, qz", False)]


def test_of_two_attitudes_the_one_that_the_gyros_know_is_taken_and_no_demand(flight, tmp_path):
    """A demand by its name, and an attitude of something else, such as of a gimbal, stand before it in the table."""

    def others(q):
        still = np.tile([1.0, 0.0, 0.0, 0.0], (len(q), 1)) + 1e-4 * np.sin(np.arange(4 * len(q)).reshape(-1, 4))
        each = {"setpoint_q": q, "gimbal_q": still}
        return {f"{name}{i}": values[:, i] for name, values in each.items() for i in range(4)}

    names, quaternion = WAYS["w first"]
    lines, _ = lines_of(table(flight, tmp_path, names, quaternion, first=others)[0])
    assert all(lines[signal].column == "qw, qx, qy, qz" for signal in ANGLES)
    lines, _ = lines_of(table(flight, tmp_path, names, lambda q: 0.7 * q, gyros=False, first=lambda q: {
        name: values for name, values in others(q).items() if name.startswith("setpoint")})[0])  # fmt: skip
    assert not set(ANGLES) & lines.keys()


def test_what_is_of_no_length_one_is_no_attitude(flight, tmp_path):
    names, _ = WAYS["w first"]
    lines, part = lines_of(table(flight, tmp_path, names, lambda q: 0.7 * q)[0])
    assert not {*ANGLES} & lines.keys() and set(names) <= set(part.unmapped)


def test_without_gyros_it_is_taken_as_is_usual_and_is_not_sure(flight, tmp_path):
    lines, _ = lines_of(table(flight, tmp_path, *WAYS["w first"], gyros=False)[0])
    assert {lines[signal].certainty for signal in ANGLES} == {"likely"}
