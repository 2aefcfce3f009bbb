"""Servo outputs in the tables of an autopilot: deflections by its calibration file, as its own logs are read."""

from __future__ import annotations

import json

import numpy as np
import pytest
from strange_layouts import write_rows

from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.tabular.guess.first_map import guess_map
from aircraft_sysid_ros.samples import Kind

PULSES = """outputs:
  1: {surface: left_elevon, input: elevon_left, us: [1100, 1500, 1900], deg: [-20, 0, 25]}
  2: {surface: right_elevon, us: [1100, 1400, 1900], deg: [-25, 0, 20], reversed: true}
  3: {surface: throttle, us: [1000, 2000], fraction: [0, 1]}
"""
COMMANDS = PULSES.replace("us: [1100, 1500, 1900]", "command: [-1, 0, 1]").replace(
    "us: [1100, 1400, 1900]", "command: [-1, -0.25, 1]"
).replace("3: {surface: throttle, us: [1000, 2000]", "101: {surface: throttle, command: [0, 1]")  # fmt: skip


@pytest.fixture
def outputs():
    """Outputs (n, 3) beyond the ends of their tables, at 20 Hz."""
    rng = np.random.default_rng(4)
    return np.round(rng.uniform((1000, 1000, 950), (2000, 2000, 2050), (400, 3)))


def rostopic(folder, pulses):
    stamp = 1_650_000_000_000_000_000 + np.arange(len(pulses)) * 50_000_000
    head = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    first = [stamp, np.arange(len(stamp)), stamp, ["base_link"] * len(stamp)]
    channels = [*pulses.T, np.zeros(len(stamp))]
    write_rows(folder / "x-mavros-rc-out.csv", [*head, *(f"field.channels{i}" for i in range(4))], [*first, *channels])
    axes = [f"field.{name}.{axis}" for name in ("linear_acceleration", "angular_velocity") for axis in "xyz"]
    values = [np.full(len(stamp), 9.8 if i == 2 else 0.0) for i in range(6)]
    write_rows(folder / "x-mavros-imu-data_raw.csv", [*head, *axes], [*first, *values])
    return folder


def paparazzi(folder, pulses):
    lines = []
    for i, row in enumerate(pulses):
        lines.append(f"{20 + 0.05 * i:.4f} 3 IMU_GYRO 0.0 0.0 0.0")
        lines.append(f"{20 + 0.05 * i:.4f} 3 IMU_ACCEL 0.0 0.0 -9.8")
        lines.append(f"{20 + 0.05 * i:.4f} 3 ACTUATORS {','.join(f'{value:.0f}' for value in row)}")
    (folder / "x.data").write_text("\n".join(lines) + "\n")
    return folder / "x.data"


def ulog2csv(folder, commands):
    stamp = 7_000_000 + np.arange(len(commands)) * 50_000
    empty = [[""] * len(stamp)]
    names = ["timestamp", "control[0]", "control[1]", "control[2]"]
    write_rows(folder / "x_actuator_servos_0.csv", names, [stamp, *commands[:, :2].T, *empty])
    write_rows(folder / "x_actuator_motors_0.csv", names[:3], [stamp, commands[:, 2], *empty])
    names = ["timestamp", *(f"gyro_rad[{i}]" for i in range(3)), *(f"accelerometer_m_s2[{i}]" for i in range(3))]
    values = [np.full(len(stamp), -9.8 if i == 5 else 0.0) for i in range(6)]
    write_rows(folder / "x_sensor_combined_0.csv", names, [stamp, *values])
    return folder


@pytest.mark.parametrize("kind", [rostopic, paparazzi, ulog2csv])
def test_outputs_of_tables_become_what_the_calibration_says(kind, outputs, tmp_path):
    """The controls are those that the mapping itself works out, which the logs of autopilots go through."""
    (tmp_path / "log").mkdir()
    (tmp_path / "servos.yaml").write_text(COMMANDS if kind is ulog2csv else PULSES)
    shown = outputs
    if kind is ulog2csv:
        shown = (outputs - 1500.0) / 400.0 * [1, 1, 0.5] + [0, 0, 0.5]
    source = kind(tmp_path / "log", shown)
    calibration = ["--servos", str(tmp_path / "servos.yaml")]
    assert main(["import", str(source), *calibration, "--out", str(tmp_path / "bag")]) == 0
    samples = read_recording(tmp_path / "bag", [NamedInput("elevon_left")]).samples
    mapping = load_servo_mapping(tmp_path / "servos.yaml")
    columns = np.full((len(shown), 103), np.nan)
    columns[:, :2], columns[:, 100 if kind is ulog2csv else 2] = shown[:, :2], shown[:, 2]
    wanted = mapping.controls(columns)
    found = samples.values[samples.kind == Kind.CONTROLS]
    for place, name in ((0, "elevator"), (1, "aileron"), (4, "throttle")):
        np.testing.assert_allclose(found[:, place], wanted[name], atol=1e-6, err_msg=name)
    assert np.isnan(found[:, 2]).all()  # no rudder
    inputs = samples.values[samples.kind == Kind.INPUTS][:, 0]
    np.testing.assert_allclose(inputs, mapping.input_values(columns)[:, 0], atol=1e-6)


def test_of_a_log_of_paparazzi_with_several_aircraft_one_is_read(tmp_path, capsys):
    """A ground station logs all that it hears: the messages of two were one flight."""
    lines = []
    for i in range(400):
        lines.append(f"{20 + 0.05 * i:.4f} 3 IMU_GYRO 0.1 0.1 0.1")
        lines.append(f"{20 + 0.05 * i:.4f} 3 IMU_ACCEL 0.0 0.0 -9.8")
        lines += [f"{20.02 + 0.05 * i:.4f} 7 IMU_GYRO 0.7 0.7 0.7"] * (i % 2)
        lines += [f"{20.02 + 0.05 * i:.4f} 7 ATTITUDE 0.7 0.7 0.7"] * (i % 2)
    (tmp_path / "x.data").write_text("\n".join(lines) + "\n")
    told = "the messages of aircraft 3 are read, and those of 7 are left out"
    assert told in guess_map(tmp_path / "x.data").notes
    bag = str(tmp_path / "bag")
    assert main(["import", str(tmp_path / "x.data"), "--out", bag, "--json"]) == 0
    assert f"IMU_GYRO: {told}" in json.loads(capsys.readouterr().out)["notes"]
    samples = read_recording(bag).samples
    imu = samples.values[samples.kind == Kind.IMU]
    np.testing.assert_allclose(imu[:, 3:6], 0.1, atol=1e-9)


def test_a_map_of_a_folder_reads_the_one_file_of_it(outputs, tmp_path):
    """`import LOG.data --map paparazzi_commands.yaml` of docs/real-flights.md, whose tables are `*/GPS` and so on."""
    (tmp_path / "log").mkdir()
    source = paparazzi(tmp_path / "log", outputs)
    vectors = [("IMU_GYRO", "angular_velocity", "rad/s"), ("IMU_ACCEL", "specific_force", "m/s^2")]
    tables = [
        f'- file: "*/{name}"\n  time: {{column: time, unit: s}}\n  signals: {{'
        + ", ".join(f'{vector}.{axis}: {{column: "{i}", unit: {unit}}}' for i, axis in enumerate("xyz", 1))
        + "}\n"
        for name, vector, unit in vectors
    ]
    (tmp_path / "map.yaml").write_text("tables:\n" + "".join(tables))
    found = []
    for name, log in (("file", source), ("folder", source.parent)):
        assert main(["import", str(log), "--map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / name)]) == 0
        found.append(read_recording(tmp_path / name).samples)
    np.testing.assert_array_equal(found[0].values, found[1].values)


def test_without_a_calibration_pulses_are_inputs_and_those_that_nothing_is_at_are_not(outputs, tmp_path, capsys):
    assert main(["import", str(rostopic(tmp_path, outputs)), "--guess", str(tmp_path / "map.yaml"), "--json"]) == 0
    tables = {table["file"]: table for table in json.loads(capsys.readouterr().out)["tables"]}
    lines = {line["signal"]: line["column"] for line in tables["x-mavros-rc-out.csv"]["lines"]}
    assert lines == {f"inputs.pulse_{i + 1}": f"field.channels{i}" for i in range(3)}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PULSES.replace("  3:", "  9:"), "output 9 (throttle) has no column"),
        (PULSES + "airspeed: {meaning: true}\n", "for tables only 'outputs' is read"),
    ],
)
def test_what_a_calibration_says_beyond_the_tables_is_told(text, words, outputs, tmp_path, capsys):
    (tmp_path / "log").mkdir()
    (tmp_path / "servos.yaml").write_text(text)
    source = rostopic(tmp_path / "log", outputs)
    calibration = ["--servos", str(tmp_path / "servos.yaml")]
    status = main(["import", str(source), *calibration, "--out", str(tmp_path / "bag")])
    shown = capsys.readouterr()
    assert words in shown.out + shown.err
    assert status == (0 if "has no column" in words else 2)
    assert (tmp_path / "bag").exists() == (status == 0)


def test_a_calibration_does_not_help_with_tables_of_no_autopilot(outputs, tmp_path, capsys):
    (tmp_path / "servos.yaml").write_text(PULSES)
    write_rows(tmp_path / "x.csv", ["time", "p"], [np.arange(100.0), np.zeros(100)])
    calibration = ["--servos", str(tmp_path / "servos.yaml")]
    assert main(["import", str(tmp_path / "x.csv"), "--guess", str(tmp_path / "map.yaml"), *calibration]) == 2
    assert "is not one that is known" in capsys.readouterr().err
