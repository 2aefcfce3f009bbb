"""A first MAP of a stranger's columns: what is active is right, what cannot be told is commented out."""

from __future__ import annotations

import re
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import strange_layouts as layouts
from scipy.io import loadmat

from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.mat_import import import_mat
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.tables import read_table
from aircraft_sysid_ros.recordings.tabular.column_map import load_column_map, parse_column_map
from aircraft_sysid_ros.recordings.tabular.guess.first_map import guess_map, map_text
from aircraft_sysid_ros.recordings.tabular.guess.names import guess_name
from aircraft_sysid_ros.recordings.tabular.guess.resolve import resolve
from aircraft_sysid_ros.recordings.tabular.guess.series import Column, Grid, fit
from aircraft_sysid_ros.samples import Kind

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import import_guess


@pytest.fixture(scope="module")
def flown(flight):
    return layouts.Flown(flight, seconds=60.0)


def active(path):
    """Signal, unit, sign by column of what a guess would import."""
    parts = guess_map(path).parts
    return {line.signal: (line.column, line.unit, line.sign) for part in parts for line in part.lines if line.active}


@pytest.mark.long
def test_scrambled_layouts_are_never_wrong_and_mostly_right(monkeypatch):
    """A few layouts of benchmarks/import_guess.py, which judges 50 others, of more aeroplanes."""
    monkeypatch.setattr(import_guess, "AEROPLANES", ("ultra_stick_25e",))
    total = Counter()
    for seed in (2, 6, 11):
        verdicts = import_guess.judged(seed)
        assert verdicts["wrong"] == []
        total.update({verdict: len(columns) for verdict, columns in verdicts.items()})
    assert total["right"] >= 0.95 * sum(total.values())


@pytest.mark.long
@pytest.mark.parametrize("seed", [2047, pytest.param(3044, marks=pytest.mark.long)])
def test_a_law_that_lacks_a_part_or_has_lost_it_in_noise_tells_no_sign(seed):
    """a_y came out backwards: without a vane d beta/dt was left out, or noise hid it and a_y took its place."""
    verdicts = import_guess.judged(seed)
    assert verdicts["wrong"] == []
    assert len(verdicts["right"]) >= 20


@pytest.mark.long
def test_a_flight_test_csv_without_units_is_understood_by_its_physics(flown, tmp_path):
    """The columns of the known layout, without what its header says of units; Nz up, elevator up, climb in ft/min."""
    path, _ = layouts.flight_test_csv(flown, tmp_path)
    text = path.read_text()
    header = text.splitlines()[2]
    bare = header.replace("Elev TEU (deg)", "Elevator")
    path.write_text(text.replace(header, re.sub(r" \([^)]*\)", "", bare)))
    found = active(path)
    assert found["specific_force.z"] == ("Nz", "g", -1.0)
    assert found["angular_velocity.y"] == ("Q", "deg/s", 1.0)
    assert found["true_airspeed"] == ("KTAS", "kt", 1.0)
    assert found["velocity.north"] == ("Vn", "ft/s", 1.0)
    assert found["altitude"] == ("Alt", "ft", 1.0)
    assert found["sideslip"] == ("AOS", "deg", 1.0)
    assert found["elevator"] == ("Elevator", "deg", -1.0)
    assert found["static_pressure"] == ("Ps", "inHg", 1.0)
    assert "thrust" not in found  # N or lbf: nothing tells


def lines_with(flight, folder, signs, without=(), late=0.0):
    """What is guessed by column of a flight in SI, some with another sign; the vanes may come late [s]."""
    truth = flight.truth
    time = np.arange(truth.time[0] + 1.0, truth.time[-1], 0.04)
    euler = np.array([euler_from_quaternion(q) for q in truth.quaternion])
    columns = {
        **{f"a{axis}_mps2": truth.specific_force[:, i] for i, axis in enumerate("xyz")},
        **{f"{axis}_rps": truth.rates[:, i] for i, axis in enumerate("pqr")},
        **{f"{name}_rad": np.unwrap(euler[:, i]) for i, name in enumerate(("phi", "theta", "psi"))},
        **{f"v{way}_mps": truth.velocity[:, i] for i, way in enumerate("ned")},
        "alt_m": truth.origin[2] - truth.position[:, 2], "tas_mps": truth.airspeed,
        "alpha_rad": truth.alpha, "beta_rad": truth.beta,
    }  # fmt: skip
    there = {name: signs.get(name, 1.0) * values for name, values in columns.items() if name not in without}
    delays = {"alpha_rad": late, "beta_rad": late}
    rows = [np.interp(time - delays.get(name, 0.0), truth.time, values) for name, values in there.items()]
    layouts.write_rows(folder / "flight.csv", ["time_s", *there], [time, *rows])
    return {line.column: line for part in guess_map(folder / "flight.csv").parts for line in part.lines}


@pytest.mark.long
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_either_law_tells_which_way_a_lateral_acceleration_counts(flight, tmp_path, sign):
    """d beta/dt, r, bank and f_y / V make up a whole; so do the acceleration over ground and gravity."""
    for without in (("vn_mps", "ve_mps"), ("beta_rad",)):
        line = lines_with(flight, tmp_path, {"ay_mps2": sign}, without)["ay_mps2"]
        assert (line.active, line.sign) == (True, sign)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_with_a_part_of_each_law_missing_the_lateral_acceleration_is_left_to_the_user(flight, tmp_path, sign):
    without = ("vn_mps", "ve_mps", "beta_rad")
    line = lines_with(flight, tmp_path, {"ay_mps2": sign}, without)["ay_mps2"]
    assert not line.active
    assert line.evidence.startswith("the positive direction cannot be found")


@pytest.mark.parametrize("late", [0.05, 0.1, 0.2])
def test_a_vane_that_comes_late_turns_no_lateral_acceleration_round(flight, tmp_path, late):
    """Late by tau it adds tau d2 beta/dt2, in a Dutch roll a multiple of f_y / V, in phase with it and against it."""
    line = lines_with(flight, tmp_path, {}, ("vn_mps", "ve_mps"), late)["ay_mps2"]
    assert line.sign > 0.0 or not line.active


def test_without_any_speed_the_rates_of_turn_are_told_by_what_turns_the_path(flight, tmp_path):
    """a_z follows q, and the bank r, by a speed that nobody has measured."""
    without = ("tas_mps", "vn_mps", "ve_mps", "vd_mps", "alt_m")
    signs = {"q_rps": -1.0, "r_rps": -1.0, "theta_rad": -1.0}
    lines = lines_with(flight, tmp_path, signs, without)
    for name in ("q_rps", "r_rps", "theta_rad", "psi_rad", "alpha_rad", "beta_rad"):
        assert (lines[name].active, lines[name].sign) == (True, signs.get(name, 1.0)), name


def elevator_sign(time, speed, elevator, moment):
    """What is said of an elevator in q' = 6 de - 3 q + moment (n,), all known but its sign."""
    rate, step = np.zeros_like(time), time[1] - time[0]
    for i in range(1, len(time)):
        rate[i] = rate[i - 1] + step * (6.0 * elevator[i - 1] - 3.0 * rate[i - 1] + moment[i - 1])
    signals = [("true_airspeed", speed, "m/s", 1.0), ("angular_velocity.y", rate, "rad/s", 1.0)]
    signals.append(("elevator", elevator, "rad", 0.0))
    columns = {s: Column("t", s, s, v, time, unit=u, sign=sign, factor=1.0) for s, v, u, sign in signals}
    resolve(columns)
    return columns["elevator"].sign


@pytest.mark.parametrize("seed", range(3))
def test_a_touchdown_does_not_hide_which_way_the_elevator_counts(seed):
    """When it touches down its wheels pitch it harder than the elevator, against what the pilot holds."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 120.0, 0.04)
    speed = np.interp(time, [0, 90, 105, 120], [20, 16, 6, 0])
    elevator = np.repeat(rng.normal(size=120), 25) * np.where(time < 90, 0.03, 0.15)
    wheels = np.where((time > 90) & (time < 96), -24.0 * elevator, 0.0)
    assert elevator_sign(time, speed, elevator, wheels) == -1.0


@pytest.mark.parametrize("seed", range(3))
def test_a_trim_does_not_hide_which_way_the_elevator_counts(seed):
    """Thrust and flaps turn it slowly, and the elevator holds against them for minutes; six doublets tell."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 600.0, 0.04)
    slow = 0.3 * np.interp(time, np.arange(0, 601, 30), rng.normal(size=21))
    starts = np.arange(80.0, 581.0, 100.0)
    doublets = sum(0.03 * np.sign(np.sin(3.0 * (time - t))) * ((time > t) & (time < t + 4.2)) for t in starts)
    gusts = 0.02 * np.repeat(rng.normal(size=3000), 5)
    assert elevator_sign(time, np.full_like(time, 20.0), doublets - slow / 6.0, slow + gusts) == -1.0


def test_the_t_value_of_a_chance_likeness_of_slow_signals_is_small():
    """Two independent random motions with a memory of 3 s: one in a thousand pairs may pass t = 5, not one in four."""
    rng = np.random.default_rng(7)
    width, count = 75, 2500  # rows of 40 ms: 100 s
    passed = naive = 0
    for _ in range(300):
        y, x = (np.convolve(rng.normal(size=count + width - 1), np.ones(width), "valid") for _ in range(2))
        found = fit(y, x, block=250)
        passed += abs(found.t) > 5.0
        naive += abs(found.correlation) * np.sqrt(count) > 5.0
    assert naive > 75
    assert passed <= 15


def test_a_heading_that_jumps_between_rows_far_apart_is_unwrapped_first():
    """At 2 Hz a turn through north lies between two rows: its mean would be south."""
    time = np.arange(0.0, 60.0, 0.5)
    heading = 3.0 * time
    jumping = Column("t", "psi", "attitude.yaw", np.mod(heading + 180.0, 360.0) - 180.0, time)
    fast = Column("t", "p", "angular_velocity.x", np.zeros(3000), np.arange(3000) * 0.02)
    grid = Grid([jumping, fast, fast])
    found = grid.raw(jumping, 360.0)
    inside = np.isfinite(found)
    np.testing.assert_allclose(found[inside], 3.0 * grid.time[inside], atol=1e-9)


def test_a_remark_above_the_names_with_fewer_cells_is_no_header(tmp_path):
    rows = [f"{0.04 * i:.2f},{0.01 * np.sin(i):.5f},{0.01 * np.cos(i):.5f}" for i in range(100)]
    lines = ["Flight data, recorded by our logger", "time,alpha_vane,beta_vane", "s,rad,rad", *rows]
    (tmp_path / "vanes.csv").write_text("\n".join(lines) + "\n")
    (part,) = guess_map(tmp_path / "vanes.csv").parts
    assert part.time.column == "time"
    assert {line.column for line in part.lines} == {"alpha_vane", "beta_vane"}


@pytest.mark.long
def test_what_is_said_of_each_line_is_in_the_map_and_the_map_is_read_again(flown, tmp_path, capsys):
    path, _ = layouts.flight_test_csv(flown, tmp_path)
    assert main(["import", str(path), "--guess", str(tmp_path / "map.yaml")]) == 0
    said = capsys.readouterr().out
    text = (tmp_path / "map.yaml").read_text()
    for line in text.splitlines():
        if re.match(r" +(# )?[a-z_.]+: {", line):
            assert re.search(r"# (sure|likely|undecided): ", line), line
    assert "undecided" in said
    assert "it reads" in said  # gravity
    assert main(["import", str(path), "--map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "bag")]) == 0
    imu = read_recording(tmp_path / "bag").samples
    imu = imu[imu.kind == Kind.IMU]
    np.testing.assert_allclose(imu.values[:, :3], flown.force, atol=1e-8)


@pytest.mark.parametrize(
    ("taken", "column"), [(0.0, "timestamp"), (None, "timestamp"), (119_000.0, "timestamp_sample")]
)
def test_a_time_of_sampling_that_px4_does_not_fill_in_is_not_the_time(taken, column, tmp_path):
    """It was: of a GPS whose driver leaves it at 0 one fix was left."""
    time = 50_000_000 + 200_000 * np.arange(50)
    sampled = np.full(50, np.nan) if taken is None else np.where(taken, time - taken, 0)
    layouts.write_rows(
        tmp_path / "log_sensor_gps_0.csv",
        ["timestamp", "timestamp_sample", "latitude_deg"],
        [time, sampled, 44.5 + 1e-5 * np.arange(50)],
    )
    layouts.write_rows(tmp_path / "log_airspeed_0.csv", ["timestamp", "true_airspeed_m_s"], [time, np.full(50, 17.0)])
    times = {part.file: part.time.column for part in guess_map(tmp_path).parts}
    assert times == {"log_sensor_gps_0.csv": column, "log_airspeed_0.csv": "timestamp"}


@pytest.mark.parametrize("source", ["airspeed_source", "selected_airspeed_index"])
def test_an_airspeed_of_px4_that_no_sensor_measured_is_none(source, tmp_path):
    """Ground speed less wind was taken as measured."""
    time, speed = 50_000_000 + 100_000 * np.arange(60), np.full(60, 17.0)
    layouts.write_rows(
        tmp_path / "log_airspeed_validated_0.csv",
        ["timestamp", "true_airspeed_m_s", source],
        [time, speed, np.repeat([-1, 0, 1, 2, 3, 4], 10)],
    )
    layouts.write_rows(tmp_path / "log_vehicle_air_data_0.csv", ["timestamp", "baro_pressure_pa"], [time, 5e3 * speed])
    assert main(["import", str(tmp_path), "--out", str(tmp_path / "bag")]) == 0
    air = read_table(tmp_path / "bag", "air_data")
    known = np.isfinite(air.fields["true_airspeed"])
    np.testing.assert_allclose(1e-9 * (air.stamp[known] - air.stamp[0]), np.arange(2.0, 5.0, 0.1), atol=1e-6)


@pytest.mark.parametrize("says_so", [True, False])
def test_a_vane_of_px4_beyond_its_range_says_nothing(says_so, tmp_path):
    """The angle that is marked so in the column beside it was taken as measured."""
    time, angle, valid = 50_000_000 + 100_000 * np.arange(60), np.full(60, 0.1), np.repeat([1, 0, 1], 20)
    names, columns = ["timestamp", "aoa_rad", "valid"], [time, angle, valid]
    layouts.write_rows(tmp_path / "log_airflow_aoa_0.csv", names[: 2 + says_so], columns[: 2 + says_so])
    layouts.write_rows(tmp_path / "log_vehicle_air_data_0.csv", ["timestamp", "baro_pressure_pa"], [time, 9e5 * angle])
    assert main(["import", str(tmp_path), "--out", str(tmp_path / "bag")]) == 0
    air = read_table(tmp_path / "bag", "air_data")
    known = np.isfinite(air.fields["angle_of_attack"])
    assert known.sum() == (40 if says_so else 60)


@pytest.mark.parametrize(
    ("rates", "dead", "read"),
    [
        ({"sensor_gps_0": 1, "vehicle_gps_position_0": 5}, "", "vehicle_gps_position_0"),
        ({"sensor_gps_0": 5, "vehicle_gps_position_0": 5}, "", "sensor_gps_0"),
        ({"sensor_gps_0": 5, "vehicle_gps_position_0": 5}, "sensor_gps_0", "vehicle_gps_position_0"),
        ({"sensor_gps_0": 5, "sensor_gps_1": 5}, "sensor_gps_0", "sensor_gps_1"),
        ({"airspeed_validated_0": 1, "airspeed_0": 10}, "", "airspeed_0"),
    ],
)
def test_of_a_folder_of_ulog2csv_the_denser_gps_and_airspeed_count(rates, dead, read, tmp_path):
    """As of a .ulg: the receiver at 1 Hz was taken, and of several that with the number 0."""
    for name, rate in {**rates, "vehicle_air_data_0": 10}.items():
        time = 50_000_000 + np.arange(0, 20_000_000, 1_000_000 // rate)
        values = {"fix_type": 1 if name == dead else 3, "latitude_deg": 44.5, "true_airspeed_m_s": 17.0}
        constant = [np.full(len(time), value) for value in values.values()]
        layouts.write_rows(tmp_path / f"log_{name}.csv", ["timestamp", *values], [time, *constant])
    first = guess_map(tmp_path)
    (chosen,) = (part.file for part in first.parts for line in part.lines if line.active)
    assert chosen == f"log_{read}.csv"
    assert any("is read: it has more fixes" in note for note in first.notes) is read.endswith("1")


@pytest.mark.long
def test_a_folder_of_ulog2csv_needs_no_correction(flown, tmp_path):
    folder, right = layouts.ulog2csv_folder(flown, tmp_path)
    guessed, mapped = (
        {s.name: (s.column, s.convert, s.sign) for table in parse_column_map(text).tables for s in table.signals}
        for text in (map_text(guess_map(folder), folder), right)
    )
    assert guessed == mapped


def test_a_folder_of_rostopic_needs_one_correction(flown, tmp_path):
    """MAVROS does not say whether an airspeed is indicated or true."""
    folder, right = layouts.rostopic_folder(flown, tmp_path)
    guessed, mapped = (
        {(s.column, s.convert, s.sign, s.name) for table in parse_column_map(text).tables for s in table.signals}
        for text in (map_text(guess_map(folder), folder), right)
    )
    assert {name for *_, name in guessed ^ mapped} == {"indicated_airspeed", "true_airspeed"}


@pytest.mark.long
def test_a_real_flight_of_px4_as_csv_needs_no_correction(shared_data, tmp_path):
    """mit_seaway: the signals of its notes, each with the unit and the axes of its notes."""
    path = tmp_path / "map.yaml"
    assert main(["import", str(shared_data / "mit_seaway"), "--guess", str(path)]) == 0
    tables = {table.file: table for table in load_column_map(path).tables}
    found = {
        s.name: (file.split("flight3_")[1].removesuffix("_0.csv"), s) for file, t in tables.items() for s in t.signals
    }
    from_notes = {
        "angular_velocity": ("vehicle_angular_velocity", "rad/s"),
        "specific_force": ("vehicle_acceleration", "m/s^2"),
        "velocity": ("vehicle_gps_position", "m/s"),
    }
    for name, (topic, unit) in from_notes.items():
        for i, axis in enumerate(("north", "east", "down") if name == "velocity" else "xyz"):
            place, signal = found.pop(f"{name}.{axis}")
            column = f"vel_{'ned'[i]}_m_s" if name == "velocity" else f"xyz[{i}]"
            assert (place, signal.column, signal.unit, signal.sign) == (topic, column, unit, 1.0)
    for name, column, unit in (
        ("latitude", "lat", "1e-7 deg"),
        ("longitude", "lon", "1e-7 deg"),
        ("altitude", "alt", "mm"),
    ):
        assert (found[name][1].column, found.pop(name)[1].unit) == (column, unit)
    assert "true_airspeed_m_s" in found.pop("true_airspeed")[1].expression.text  # where a sensor is behind it
    assert found.pop("static_pressure")[1].unit == "Pa"
    assert found.pop("air_density")[1].column == "rho"
    assert {name for name in found if not name.startswith("inputs.")} == {
        f"attitude.{a}" for a in ("roll", "pitch", "yaw")
    }


@pytest.mark.long
def test_thor_from_a_csv_of_itself(shared_data, tmp_path):
    """The columns of the .mat in a CSV: what is guessed agrees with the import that knows the flight."""
    content = loadmat(shared_data / "umn_thor_flight75" / "flight75.mat", squeeze_me=True, struct_as_record=False)
    data = content["flight_data"]
    names = [
        "time",
        "p",
        "q",
        "r",
        "ax",
        "ay",
        "az",
        "Ps",
        "Pd",
        "ias",
        "aoa",
        "aos",
        "h",
        "lat",
        "lon",
        "alt",
        "vn",
        "ve",
        "vd",
        "GPS_TOW",
        "phi",
        "theta",
        "psi",
        "de",
        "dr",
        "da_l",
        "da_r",
        "dthr",
        "theta_cmd",
        "p_bias",
        "navlat",
        "hx",
    ]
    layouts.write_rows(tmp_path / "thor.csv", names, [getattr(data, name)[::2] for name in names])
    found = active(tmp_path / "thor.csv")
    for signals, unit in (("angular_velocity.", "rad/s"), ("velocity.", "m/s"), ("attitude.", "rad")):
        there = {signal: line for signal, line in found.items() if signal.startswith(signals)}
        assert len(there) == 3
        assert {line[1:] for line in there.values()} == {(unit, 1.0)}
    assert found["specific_force.z"] == ("az", "m/s^2", 1.0)
    assert found["static_pressure"] == ("Ps", "kPa", 1.0)
    assert found["elevator"] == ("de", "rad", 1.0)
    assert "rudder" not in found  # it moves by 0.7 deg: nothing tells
    path = tmp_path / "map.yaml"
    assert main(["import", str(tmp_path / "thor.csv"), "--guess", str(path)]) == 0
    assert main(["import", str(tmp_path / "thor.csv"), "--map", str(path), "--out", str(tmp_path / "csv")]) == 0
    import_mat(shared_data / "umn_thor_flight75" / "flight75.mat", tmp_path / "mat")
    of_csv, of_mat = (read_recording(tmp_path / name).samples for name in ("csv", "mat"))
    velocity, known = (samples[samples.kind == Kind.GPS_VELOCITY] for samples in (of_csv, of_mat))
    aloft = slice(300, 600)  # one fix a second in both
    shared = min(len(velocity), len(known))
    assert abs(len(velocity) - len(known)) < 10
    assert np.median(np.abs(velocity.values[:shared, :3] - known.values[:shared, :3])[aloft]) < 1.0


@pytest.mark.parametrize(
    ("column", "signal", "unit"),
    [
        ("Roll Rate [deg/s]", "angular_velocity.x", "deg/s"),
        ("accel_z_mps2", "specific_force.z", "m/s^2"),
        ("KTAS", "true_airspeed", "kt"),
        ("field.latitude", "latitude", ""),
        ("vane_alpha_deg", "angle_of_attack", "deg"),
        ("Ps_hPa", "static_pressure", "hPa"),
        ("Qc_inHg", "dynamic_pressure", "inHg"),
        ("GyroRoll (deg/s)", "angular_velocity.x", "deg/s"),
        ("AccDown (g)", "specific_force.z", "g"),
        ("AoA vane (deg)", "angle_of_attack", "deg"),
        ("Aileron mean (deg)", "aileron", "deg"),
        ("thrust_kgf", "thrust", "kgf"),
    ],
)
def test_names_say_signal_and_unit(column, signal, unit):
    found = guess_name(column)
    assert (found.signal, found.unit) == (signal, unit)


@pytest.mark.parametrize("column", ["elev_cmd", "p_bias", "hdop", "GS", "pitch_ref", "gyro_temp", "status", "comment"])
def test_names_that_are_no_measurement_of_ours(column):
    assert guess_name(column) is None


@pytest.mark.long
def test_an_acceleration_without_gravity_is_left_to_the_user(flown, tmp_path):
    path, _ = layouts.flight_test_csv(flown, tmp_path)
    lines = path.read_text().splitlines()
    names = lines[2].split(",")
    z = names.index("Nz (g)")

    def moved(line):
        cells = line.split(",")
        cells[z] = str(float(cells[z]) - 1.0) if cells[z] else ""
        return ",".join(cells)

    path.write_text("\n".join([*lines[:3], *(moved(line) for line in lines[3:])]) + "\n")
    assert not {"specific_force.x", "specific_force.y", "specific_force.z"} & active(path).keys()


@pytest.mark.long
def test_a_guess_does_not_overwrite_and_needs_a_table(flown, tmp_path, capsys):
    path, _ = layouts.flight_test_csv(flown, tmp_path)
    (tmp_path / "map.yaml").write_text("mine")
    assert main(["import", str(path), "--guess", str(tmp_path / "map.yaml")]) == 2
    assert "already there" in capsys.readouterr().err
    (tmp_path / "words.csv").write_text("this,is\nno,table\n")
    with pytest.raises(InputError, match="holds no table"):
        guess_map(tmp_path / "words.csv")


def test_what_hinders_a_guess_is_said(tmp_path):
    rows = [f"{0.02 * i:.2f},{i % 7}.5" for i in range(60)]
    (tmp_path / "back.csv").write_text("\n".join(["time,p", *rows[:30], *rows[20:]]) + "\n")
    with pytest.raises(InputError, match="its column 'time' goes back at data row 31"):
        guess_map(tmp_path / "back.csv")
    (tmp_path / "twice.csv").write_text("\n".join(["time,p,p", *(f"{row},1" for row in rows)]) + "\n")
    assert "twice.csv has several columns 'p': rename all but one" in guess_map(tmp_path / "twice.csv").notes


@pytest.mark.parametrize("of_day", [True, False])
def test_a_gap_and_midnight_hide_no_unit(flown, tmp_path, of_day):
    """The integral of the velocity stood still in the gap, in which the position went on."""
    stamp, c = flown.on_one_grid(held=False)
    seconds = (stamp - stamp[0]) * 1e-9
    kept = (seconds < 20.0) | (seconds > 32.0)
    time = np.mod(86_400.0 - 40.0 + seconds, 86_400.0) if of_day else seconds
    columns = {"UTC": time, "VN": c["vn"] / 0.514444, "VE": c["ve"] / 0.514444, "LAT": c["lat"], "LON": c["lon"]}
    layouts.write_rows(tmp_path / "gap.csv", list(columns), [column[kept] for column in columns.values()])
    found = active(tmp_path / "gap.csv")
    assert found["velocity.north"] == ("VN", "kt", 1.0) and found["velocity.east"] == ("VE", "kt", 1.0)


def test_clocks_of_tables_that_do_not_overlap_are_said(flown, tmp_path):
    time = np.arange(0.0, 20.0, 0.1)
    for name, start in (("a", 0.0), ("b", 5000.0)):
        layouts.write_rows(tmp_path / f"{name}.csv", ["time_s", f"x_{name}"], [time + start, np.sin(time)])
    (note,) = guess_map(tmp_path).notes
    assert note.startswith("the clock of b.csv (5000 to 5019.9 s) does not overlap with that of a.csv (0 to 19.9 s): ")
    assert note.endswith("set the offset of one time, -5000 s of b.csv if both began together")


def test_times_of_day_and_counted_times_have_the_clock_that_import_gives_them(flown, tmp_path, capsys):
    """The offset that a guess names puts the tables together at import; seconds of a day need none."""
    source, time = tmp_path / "flight", np.arange(0.0, 20.0, 0.1)
    source.mkdir()
    texts = [f"14:22:{second:06.3f}" for second in time + 10.5]
    (source / "gps.csv").write_text("\n".join(["UTC,lat", *(f"{text},44.7" for text in texts)]) + "\n")
    layouts.write_rows(source / "imu.csv", ["time_s", "p"], [time + 412.0, np.sin(time)])
    (note,) = guess_map(source).notes
    offset, name = re.search(r"set the offset of one time, (\S+) s of (\S+) if both", note).groups()
    assert abs(float(offset)) == 51318.5
    tables = (
        ("gps.csv", "column: UTC, unit: iso", "altitude: {column: lat, unit: m}"),
        ("imu.csv", "column: time_s, unit: s", "angular_velocity.x: {column: p, unit: rad/s}"),
    )
    lines = [
        f"  - {{file: {file}, time: {{{of}{f', offset: {offset}' * (file == name)}}}, signals: {{{signal}}}}}"
        for file, of, signal in tables
    ]
    (tmp_path / "map.yaml").write_text("\n".join(["tables:", *lines]))
    assert main(["import", str(source), "--map", str(tmp_path / "map.yaml"), "--out", str(tmp_path / "bag")]) == 0
    assert f"{time[-1]:.1f} s from" in capsys.readouterr().out  # all of both within the 19.9 s of each
    layouts.write_rows(source / "imu.csv", ["time_s", "p"], [time + 51730.5, np.sin(time)])
    assert guess_map(source).notes == []


def test_where_no_name_says_anything_the_answer_is_what_to_write(tmp_path, capsys):
    """It had been "0 sure, 0 likely, 0 undecided: check it", of a map that import then refused."""
    (tmp_path / "a.csv").write_text("t,a,b\n0,1,2\n0.1,2,3\n0.2,3,4\n")
    assert main(["import", str(tmp_path / "a.csv"), "--guess", str(tmp_path / "a.yaml")]) == 0
    out = capsys.readouterr().out
    assert "no name says what a column is" in out and "0 sure" not in out


def test_days_of_a_spreadsheet_have_its_clock(tmp_path, capsys):
    """Their unit had been sure, and import refused times outside of 1970 to 2038."""
    seconds = np.arange(400) * 0.05
    rows = [f"{45400.4 + t / 86400:.9f},{5.0 * np.sin(t):.3f},{-0.5:.3f}" for t in seconds]
    (tmp_path / "log.csv").write_text("\n".join(["Time(days),P(deg/s),Q(deg/s)", *rows]) + "\n")
    where = [str(tmp_path / name) for name in ("log.csv", "map.yaml", "bag")]
    assert main(["import", where[0], "--guess", where[1]]) == 0
    assert "clock: 1899-12-30T00:00:00Z  # days are counted as spreadsheets do" in Path(where[1]).read_text()
    assert main(["import", where[0], "--map", where[1], "--out", where[2]]) == 0
    stamps = np.sort(read_recording(where[2]).samples.stamp)
    assert stamps[0] / 1e9 == pytest.approx((45400.4 - 25569.0) * 86400.0, abs=1e-3)  # 25569: 1970-01-01
