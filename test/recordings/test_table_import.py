"""Flights in layouts of others give the samples that they were made from."""

from __future__ import annotations

import json
import tracemalloc

import numpy as np
import pytest
import strange_layouts as layouts

from aircraft_sysid_ros.aircraft import earth
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.tables import read_table
from aircraft_sysid_ros.recordings.tabular import streams
from aircraft_sysid_ros.recordings.tabular.column_map import parse_column_map
from aircraft_sysid_ros.recordings.tabular.table_import import import_tables
from aircraft_sysid_ros.samples import Kind


@pytest.fixture(scope="module")
def flown(flight):
    return layouts.Flown(flight)


def expected(flown):
    """Stamps and values by kind, as the flight's own recording has them."""
    place = np.concatenate([np.radians(flown.place[:, :2]), flown.place[:, 2:]], axis=1)
    controls = np.stack(list(flown.controls.values()), axis=1)
    air = np.stack([flown.air["air_density"], flown.air["static_pressure"]], axis=1)
    return {
        Kind.IMU: (flown.stamp["imu/data"], np.concatenate([flown.force, flown.rate], axis=1)),
        Kind.GPS_POSITION: (flown.stamp["gps/fix"], place),
        Kind.GPS_VELOCITY: (flown.stamp["gps/vel"], flown.velocity),
        Kind.AIRSPEED: (flown.stamp["air_data"], flown.air["true_airspeed"][:, None]),
        Kind.ANGLE_OF_ATTACK: (flown.stamp["air_data"], flown.air["angle_of_attack"][:, None]),
        Kind.SIDESLIP: (flown.stamp["air_data"], flown.air["sideslip"][:, None]),
        Kind.AIR: (flown.stamp["air_data"], air),
        Kind.CONTROLS: (flown.stamp["control_surfaces"], controls),
    }


def signals_of(vector, columns):
    """Lines of a MAP for the three axes of an IMU, in SI."""
    unit = "m/s^2" if vector == "specific_force" else "rad/s"
    return [(f"{vector}.{axis}", column, unit) for axis, column in zip("xyz", columns, strict=True)]


def imported(source, text, tmp_path):
    report = import_tables(source, parse_column_map(text), tmp_path / "bag")
    recording = read_recording(tmp_path / "bag")
    return report, recording.samples, recording


BY_GPS = (Kind.IMU, Kind.GPS_POSITION, Kind.GPS_VELOCITY)
#: Layout, kinds that it has, and to what [ns] a stamp is rounded in it.
LAYOUTS = [
    (
        layouts.flight_test_csv,
        (*BY_GPS, Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP, Kind.AIR, Kind.CONTROLS),
        2000,
    ),
    (layouts.ulog2csv_folder, (*BY_GPS, Kind.AIRSPEED), 1000),
    (layouts.rostopic_folder, (*BY_GPS, Kind.AIRSPEED), 0),
    (layouts.mat_7_3, (*BY_GPS, Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK), 2000),
    (layouts.excel_book, (*BY_GPS, Kind.AIRSPEED), 2000),
    (layouts.ascii_columns, BY_GPS, 2000),
]


@pytest.mark.long_after_the_first
@pytest.mark.parametrize(("layout", "kinds", "rounding"), LAYOUTS, ids=[each[0].__name__ for each in LAYOUTS])
def test_a_layout_of_others_gives_the_samples_of_the_flight(flown, tmp_path, layout, kinds, rounding):
    report, samples, _ = imported(*layout(flown, tmp_path), tmp_path)
    for kind in kinds:
        stamp, values = expected(flown)[kind]
        found = samples[samples.kind == kind]
        assert len(found) == len(stamp), f"{kind.name}: {report['notes']}"
        assert np.abs(found.stamp - stamp).max() <= rounding, kind.name
        np.testing.assert_allclose(
            found.values[:, : values.shape[1]], values, rtol=1e-8, atol=6e-4 if kind is Kind.GPS_POSITION else 1e-9
        )
        if kind is Kind.GPS_POSITION:
            np.testing.assert_allclose(found.values[:, :2], values[:, :2], rtol=0.0, atol=2e-9)
    assert set(samples.kind) - {Kind.CONTROLS} <= {*kinds}


def test_a_table_of_every_second_sample_has_those(flown, tmp_path):
    _, samples, _ = imported(*layouts.parquet_table(flown, tmp_path), tmp_path)
    np.testing.assert_array_equal(samples.stamp, flown.stamp["imu/data"][::2])
    np.testing.assert_allclose(
        samples.values[:, :6], np.concatenate([flown.force, flown.rate], axis=1)[::2], rtol=1e-15
    )


@pytest.mark.long
def test_what_has_no_topic_of_its_own_is_carried_by_name(flown, tmp_path):
    report, _, _ = imported(*layouts.excel_book(flown, tmp_path), tmp_path)
    tab = read_table(tmp_path / "bag", "inputs").fields
    assert [list(names) for names in tab["name"][:1]] == [["trim_tab"]]
    found = np.array([values[0] for values in tab["position"]])
    np.testing.assert_allclose(found, 2.0 * flown.controls["elevator"], rtol=1e-9)
    assert report["topics"]["inputs"]["messages"] == len(found)


@pytest.mark.long
def test_slow_columns_that_are_held_give_their_own_samples(flown, tmp_path):
    """A table in which everything stands until it is measured again: GPS of 5 Hz among rows of all sensors."""
    source, text = layouts.excel_book(flown, tmp_path)
    report, samples, _ = imported(source, text, tmp_path)
    assert (samples.kind == Kind.GPS_POSITION).sum() == len(flown.stamp["gps/fix"])
    assert any("only repeat the one before" in note for note in report["notes"])


@pytest.mark.parametrize("slow", [True, False])
def test_a_fast_height_does_not_hide_that_a_gps_is_held(slow, tmp_path):
    """Of a GPS at 5 Hz in rows of 50 Hz every row was a fix, where the altitude or the climb came from elsewhere."""
    time = np.arange(0.0, 40.0, 0.02)
    measured = time // 0.2 * 0.2 if slow else time
    noise = np.random.default_rng(1).normal(size=(6, len(time)))
    columns = {
        **dict(zip(("fx", "fy", "fz", "p", "q", "r"), noise, strict=True)),
        "lat": 44.7 + 1e-4 * measured, "lon": -93.0 + 1e-4 * np.sin(measured), "alt": 300.0 + np.sin(time),
        "vn": 20.0 + np.sin(measured), "ve": np.cos(measured), "vd": -np.cos(time),
    }  # fmt: skip
    layouts.write_rows(tmp_path / "x.csv", ["t", *columns], [time, *columns.values()])
    lines = signals_of("specific_force", ("fx", "fy", "fz")) + signals_of("angular_velocity", ("p", "q", "r"))
    lines += [("latitude", "lat", "deg"), ("longitude", "lon", "deg"), ("altitude", "alt", "m")]
    lines += [(f"velocity.{way}", f"v{way[0]}", "m/s") for way in ("north", "east", "down")]
    mapped = ", ".join(f"{signal}: {{column: {column}, unit: {unit}}}" for signal, column, unit in lines)
    text = "tables: [{time: {column: t, unit: s}, signals: {" + mapped + "}}]"
    report, samples, _ = imported(tmp_path / "x.csv", text, tmp_path)
    count = len(time) // (10 if slow else 1)
    assert [(samples.kind == kind).sum() for kind in (Kind.GPS_POSITION, Kind.GPS_VELOCITY)] == [count, count]
    notes = [note for note in report["notes"] if "only repeat the one before" in note]
    assert [note.split(": ")[0] for note in notes] == ["geodetic", "velocity"] * slow


def test_an_altitude_in_whole_feet_that_stands_still_in_level_flight_keeps_its_rows(tmp_path):
    """Rounding repeats a value for as long as the flight has it, a slow sensor for as many rows each time."""
    time = np.arange(0.0, 200.0, 0.1)
    climb = np.interp(time, [0, 40, 160, 200], [0, 280, 280.6, 560])
    slow = np.repeat(np.random.default_rng(0).normal(17.0, 0.5, len(time) // 5), 5)
    columns = [time, np.round(climb / 0.3048), slow, *np.random.default_rng(1).normal(size=(6, len(time)))]
    names = ["t", "alt", "tas", "fx", "fy", "fz", "p", "q", "r"]
    layouts.write_rows(tmp_path / "x.csv", names, columns)
    vectors = [("specific_force", "fx fy fz", "m/s^2"), ("angular_velocity", "p q r", "rad/s")]
    lines = [
        f"{v}.{a}: {{column: {c}, unit: {u}}}" for v, cs, u in vectors for a, c in zip("xyz", cs.split(), strict=True)
    ]
    lines += ["pressure_altitude: {column: alt, unit: ft}", "true_airspeed: {column: tas, unit: m/s}"]
    text = "tables: [{time: {column: t, unit: s}, signals: {" + ", ".join(lines) + "}}]"
    report, samples, _ = imported(tmp_path / "x.csv", text, tmp_path)
    assert (samples.kind == Kind.AIR).sum() == len(time)
    assert np.ptp(np.diff(samples.stamp[samples.kind == Kind.AIRSPEED])) == 0
    assert (samples.kind == Kind.AIRSPEED).sum() == len(time) // 5
    (note,) = (note for note in report["notes"] if "only repeat the one before" in note)
    assert note.startswith("true_airspeed")


def test_of_a_slow_vane_that_freezes_it_is_said_and_of_a_gap_of_the_log_it_is_not(tmp_path):
    time = np.arange(0.0, 200.0, 0.02)
    kept = (time < 150.0) | (time > 160.0)  # no rows at all
    vane = np.repeat(np.random.default_rng(0).normal(0.05, 0.02, len(time) // 4), 4)
    vane[(time > 60.0) & (time < 90.0)], vane[time > 180.0] = 0.07, 0.03
    columns = [time, vane, *np.random.default_rng(1).normal(size=(6, len(time)))]
    layouts.write_rows(tmp_path / "x.csv", ["t", "aoa", "fx", "fy", "fz", "p", "q", "r"], [c[kept] for c in columns])
    lines = ["angle_of_attack: {column: aoa, unit: rad}"]
    for vector, names, unit in (("specific_force", "fx fy fz", "m/s^2"), ("angular_velocity", "p q r", "rad/s")):
        parts = zip("xyz", names.split(), strict=True)
        lines += [f"{vector}.{axis}: {{column: {column}, unit: {unit}}}" for axis, column in parts]
    text = "tables: [{time: {column: t, unit: s}, signals: {" + ", ".join(lines) + "}}]"
    report, *_ = imported(tmp_path / "x.csv", text, tmp_path)
    notes = [note for note in report["notes"] if "does not change" in note]
    assert notes[0].startswith("angle_of_attack: its value does not change from 60.0 to 90.0 s: it is stuck there, or")
    assert len(notes) == 2 and "from 180.0 to 200.0 s" in notes[1]


@pytest.mark.parametrize("ends", [np.inf, 90.0])
def test_a_temperature_in_tenths_of_a_degree_is_that_of_the_whole_flight(ends, tmp_path):
    """It stands still for minutes, or the thermometer dies: no reason for another air."""
    time = np.arange(0.0, 150.0, 0.05)
    level = np.interp(time, [0, 30, 60, 110, 113, 150], [0, 60, 0, 40, 60, 60])
    warm = np.round(38.0 - 0.0065 * level + 0.02 * np.sin(0.07 * time), 1)
    text_of = [f"{v:.1f}" if t <= ends else "" for t, v in zip(time, warm, strict=True)]
    columns = [
        time,
        np.full(len(time), 200.0),
        np.full(len(time), 9.5e4),
        *np.random.default_rng(1).normal(size=(6, len(time))),
    ]
    names = ["t", "qc", "ps", "fx", "fy", "fz", "p", "q", "r"]
    rows = [
        ",".join([*(f"{x:.9g}" for x in row), word])
        for row, word in zip(np.column_stack(columns), text_of, strict=True)
    ]
    (tmp_path / "x.csv").write_text("\n".join([",".join([*names, "oat"]), *rows]) + "\n")
    vectors = [("specific_force", "fx fy fz", "m/s^2"), ("angular_velocity", "p q r", "rad/s")]
    lines = [
        f"{v}.{a}: {{column: {c}, unit: {u}}}" for v, cs, u in vectors for a, c in zip("xyz", cs.split(), strict=True)
    ]
    lines += [
        "dynamic_pressure: {column: qc, unit: Pa}", "static_pressure: {column: ps, unit: Pa}",
        "air_temperature: {column: oat, unit: degC}",
    ]  # fmt: skip
    text = "tables: [{time: {column: t, unit: s}, signals: {" + ", ".join(lines) + "}}]"
    report, samples, _ = imported(tmp_path / "x.csv", text, tmp_path)
    assert not any("repeat" in note for note in report["notes"])
    speed = samples.values[samples.kind == Kind.AIRSPEED, 0]
    sound = np.sqrt(1.4 * 287.05287 * (273.15 + 37.8))
    right = sound * np.sqrt(5.0 * ((1.0 + 200.0 / 9.5e4) ** (2.0 / 7.0) - 1.0))  # compressible, isentropic
    assert len(speed) == len(time)
    np.testing.assert_allclose(speed, right, rtol=1e-3)


def test_the_attitude_is_carried_once_to_the_stamps_of_the_imu(tmp_path):
    """Roll turns at 0.5 rad/s; 10 Hz of attitude, 3 ms off, among 50 Hz of IMU."""
    imu, at = np.arange(0.0, 4.0, 0.02), np.arange(0.003, 3.9, 0.1)
    constant = [np.full(len(imu), value) for value in (0.0, 0.0, -9.8, 0.5, 0.0, 0.0)]
    layouts.write_rows(tmp_path / "imu.csv", ["t", *"abcdef"], [imu, *constant])
    layouts.write_rows(tmp_path / "att.csv", ["t", *"ghi"], [at, 0.5 * at, 0.0 * at, 3.1 + 0.0 * at])
    time = "{column: t, unit: s}"
    angles = [("yaw", "i"), ("roll", "g"), ("pitch", "h")]  # in any order
    text = layouts.map_of(
        ("imu.csv", time, [*signals_of("specific_force", "abc"), *signals_of("angular_velocity", "def")]),
        ("att.csv", time, [(f"attitude.{name}", column, "rad") for name, column in angles]),
    )
    _, samples, recording = imported(tmp_path, text, tmp_path)
    found = samples[samples.kind == Kind.ATTITUDE]
    roll, _, yaw = np.array([euler_from_quaternion(q) for q in found.values[:, :4]]).T
    time = (found.stamp - recording.start) * 1e-9
    assert len(found) == len(at) - 1  # after the last there is nothing to carry it with
    np.testing.assert_allclose(time, np.ceil(np.round(at[:-1] / 0.02, 6)) * 0.02, atol=1e-9)
    np.testing.assert_allclose(roll, 0.5 * time, atol=1e-6)
    np.testing.assert_allclose(yaw, 3.1, atol=1e-6)


def test_calibrated_airspeed_becomes_true_with_pressure_and_temperature(tmp_path):
    """100 kt calibrated at 3000 m of the standard atmosphere: 70112 Pa, -4.5 degC, 0.9093 kg/m^3 (ISO 2533)."""
    impact = 101325.0 * ((1.0 + 0.2 * (100.0 * layouts.KNOT / 340.294) ** 2) ** 3.5 - 1.0)
    expected_speed = np.sqrt(5.0 * ((impact / 70112.0 + 1.0) ** (2.0 / 7.0) - 1.0)) * 20.0468 * np.sqrt(268.65)
    n = 50
    columns = [np.arange(n) * 0.1, np.full(n, 100.0), np.full(n, 701.12), np.full(n, -4.5)]
    layouts.write_rows(tmp_path / "air.csv", ["t", "cas", "ps", "oat"], columns)
    signals = [("calibrated_airspeed", "cas", "kt"), ("static_pressure", "ps", "hPa"), ("air_temperature", "oat", "°C")]
    report, samples, _ = imported(
        tmp_path / "air.csv", layouts.map_of((None, "{column: t, unit: s}", signals)), tmp_path
    )
    assert samples.values[samples.kind == Kind.AIRSPEED][:, 0] == pytest.approx(expected_speed, rel=1e-4)
    assert samples.values[samples.kind == Kind.AIR][:, 0] == pytest.approx(0.9093, abs=2e-4)
    assert any("calibrated_airspeed" in note for note in report["notes"])


def test_positions_in_metres_keep_their_distances(tmp_path):
    time = np.arange(0.0, 5.0, 0.2)
    north, east, down = 300.0 + 20.0 * time, -500.0 + 5.0 * time, -100.0 - time
    layouts.write_rows(tmp_path / "gps.tsv", ["t", "n", "e", "up"], [time, north, east, -down], delimiter="\t")
    signals = [("position.north", "n", "m"), ("position.east", "e", "m"), ("position.down", "up", "m", -1)]
    report, samples, _ = imported(
        tmp_path / "gps.tsv", layouts.map_of((None, "{column: t, unit: s}", signals)), tmp_path
    )
    place = samples.values[:, :3]
    found = earth.ned_along(place, place[0])
    expected_ned = np.stack([north - north[0], east - east[0], down - down[0]], axis=1)
    np.testing.assert_allclose(found, expected_ned, atol=0.02)  # the plane of the first fix is turned by 1e-4 rad
    assert any("45° north" in note for note in report["notes"])


def test_a_longitude_of_another_clock_goes_over_180_degrees(tmp_path):
    """Between 179.99 and -179.99 degrees east it was somewhere near Greenwich."""
    time = np.arange(0.0, 4.0, 0.2)
    east = 179.999 + 1e-4 * time / 0.2
    layouts.write_rows(tmp_path / "lat.csv", ["t", "lat", "alt"], [time, 0.0 * time + 20.0, 0.0 * time + 300.0])
    layouts.write_rows(tmp_path / "lon.csv", ["t", "lon"], [time + 0.1, np.where(east > 180.0, east - 360.0, east)])
    places = [("latitude", "lat", "deg"), ("altitude", "alt", "m")]
    parts = [
        ("lat.csv", "{column: t, unit: s}", places),
        ("lon.csv", "{column: t, unit: s}", [("longitude", "lon", "deg")]),
    ]
    _, samples, _ = imported(tmp_path, layouts.map_of(*parts), tmp_path)
    found = np.degrees(samples.values[:, 1])
    assert len(found) == len(time) - 1 and np.all(np.abs(found) <= 180.0)
    np.testing.assert_allclose(np.mod(found, 360.0), east[1:] - 5e-5, atol=1e-9)


def test_files_of_one_pattern_continue_each_other(flown, tmp_path):
    stamp, c = flown.on_one_grid(held=False)
    for i, rows in ((2, slice(900, None)), (10, slice(0, 900))):  # their order is that of their times
        columns = [
            (stamp[rows] - stamp[0]) * 1e-9,
            *(c[f"w{a}"][rows] for a in "xyz"),
            *(c[f"f{a}"][rows] for a in "xyz"),
        ]
        layouts.write_rows(tmp_path / f"part_{i}.csv", ["t", *"pqrxyz"], columns)
    signals = [
        *((f"angular_velocity.{a}", n, "rad/s") for a, n in zip("xyz", "pqr", strict=True)),
        *((f"specific_force.{a}", a, "m/s^2") for a in "xyz"),
    ]
    _, samples, _ = imported(tmp_path, layouts.map_of(("part_*.csv", "{column: t, unit: s}", signals)), tmp_path)
    np.testing.assert_allclose(samples.values[:, :3], flown.force, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("unit", ["s", "ms", "iso"])
def test_a_clock_of_the_day_goes_on_past_midnight(tmp_path, monkeypatch, unit):
    """Flights in the evening of America are at midnight in UTC; rows are read in pieces of 30."""
    monkeypatch.setattr(streams, "ROWS", 30)
    seconds = np.round(np.mod(86_390.0 + np.arange(0.0, 20.0, 0.2), 86_400.0), 1)
    hours, rest = np.divmod(seconds, 3600.0)
    texts = [f"{int(h):02d}:{int(r // 60.0):02d}:{r % 60.0:04.1f}" for h, r in zip(hours, rest, strict=True)]
    shown = {"s": seconds, "ms": 1e3 * seconds, "iso": texts}[unit]
    rows = [f"{t},{i},{2 * i},{3 * i}" for i, t in enumerate(shown)]
    (tmp_path / "gps.csv").write_text("\n".join(["t,n,e,d", *rows]) + "\n")
    signals = [(f"velocity.{way}", way[0], "m/s") for way in ("north", "east", "down")]
    text = layouts.map_of((None, f"{{column: t, unit: {unit}}}", signals))
    report, samples, _ = imported(tmp_path / "gps.csv", text, tmp_path)
    assert np.diff(samples.stamp) == pytest.approx(0.2e9) and len(samples) == 100
    assert "gps.csv: its clock passed midnight, and goes on from there" in report["notes"]


@pytest.mark.parametrize("unit", ["s", "iso"])
@pytest.mark.parametrize("begin", [86_380.0, 86_385.0, 40_000.0])
def test_files_of_one_pattern_continue_each_other_past_midnight(tmp_path, unit, begin):
    """The file from after midnight was read first, and the recording was a day long."""
    for i in (1, 2, 3):
        seconds = np.mod(begin + 10.0 * (i - 1) + np.arange(0.0, 10.0, 0.5), 86_400.0)
        texts = [f"{int(t // 3600):02d}:{int(t // 60 % 60):02d}:{t % 60:04.1f}" for t in seconds]
        rows = [f"{t},{i}.{k},{k},{2 * k}" for k, t in enumerate(seconds if unit == "s" else texts)]
        (tmp_path / f"log_{i}.csv").write_text("\n".join(["t,n,e,d", *rows]) + "\n")
    signals = [(f"velocity.{way}", way[0], "m/s") for way in ("north", "east", "down")]
    _, samples, _ = imported(tmp_path, layouts.map_of(("log_*.csv", f"{{column: t, unit: {unit}}}", signals)), tmp_path)
    assert np.diff(samples.stamp) == pytest.approx(0.5e9) and len(samples) == 60
    assert samples.values[::20, 0].astype(int).tolist() == [1, 2, 3]


@pytest.mark.long  # of the whole process, and at larger sizes: test_import_memory.py
def test_the_memory_does_not_grow_with_the_file(tmp_path, monkeypatch):
    """Twice the rows, read in pieces of 500: the peak of what Python and NumPy hold stays where it was."""
    monkeypatch.setattr(streams, "ROWS", 500)
    signals = [*((f"angular_velocity.{a}", a, "rad/s") for a in "xyz"), ("inputs.tab", "tab", "deg")]
    colmap = parse_column_map(layouts.map_of((None, "{column: t, unit: s}", signals)))
    peaks = []
    for rows in (1000, 8_000, 16_000):  # the first warms up
        time = np.arange(rows) * 0.01
        columns = np.stack([time, np.sin(time), np.cos(time), time % 3.0, time % 7.0], axis=1)
        np.savetxt(tmp_path / "long.csv", columns, fmt="%.5f", delimiter=",", header="t,x,y,z,tab", comments="")
        tries = []
        for _ in range(2):  # what other threads of this process allocate meanwhile counts, too
            tracemalloc.start()
            import_tables(tmp_path / "long.csv", colmap, tmp_path / "bag", overwrite=True)
            tries.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        peaks.append(min(tries))
    assert peaks[2] < 1.2 * peaks[1]
    assert read_recording(tmp_path / "bag").ignored == {"/inputs": 16_000}
    assert len(read_recording(tmp_path / "bag").samples) == 16_000


@pytest.mark.parametrize("also", [None, "static_pressure", "pressure_altitude", "place"])
def test_an_altitude_without_a_place_is_a_static_pressure_where_nothing_else_gives_one(tmp_path, also):
    time, height = np.arange(50) * 0.1, np.linspace(900.0, 1100.0, 50)
    header = "t,h,Ps,hp,lat,lon"
    columns = [time, height, np.full(50, 95e3), np.full(50, 500.0), np.full(50, 45.0), np.full(50, 10.0)]
    np.savetxt(tmp_path / "f.csv", np.stack(columns, axis=1), fmt="%.9g", delimiter=",", header=header, comments="")
    signals = [("altitude", "h", "m")]
    more = {
        "static_pressure": [("static_pressure", "Ps", "Pa")],
        "pressure_altitude": [("pressure_altitude", "hp", "m")],
    }
    more["place"] = [("latitude", "lat", "deg"), ("longitude", "lon", "deg")]
    text = layouts.map_of((None, "{column: t, unit: s}", signals + more.get(also, [])))
    report, samples, _ = imported(tmp_path / "f.csv", text, tmp_path)
    pressure = samples.values[samples.kind == Kind.AIR][:, 1]
    if also is None:
        # the standard atmosphere, ICAO Doc 7488: 89874.6 Pa at 1000 m, and 11.1 Pa/m there
        np.testing.assert_allclose(np.interp(1000.0, height, pressure), 89874.6, rtol=2e-4)
        assert np.gradient(pressure, height)[25] == pytest.approx(-10.9, abs=0.2)
        assert "static_pressure is that of the standard atmosphere at altitude" in report["notes"]
        assert "altitude" not in report["missing"]
    elif also == "place":
        assert not len(pressure) and (samples.kind == Kind.GPS_POSITION).sum() == 50
    else:
        assert np.ptp(pressure) == 0.0
        assert report["missing"]["altitude"] == "not carried over: a position needs latitude, longitude and altitude"


class TestRealFlights:
    """Recordings of others, against what their notes say and against physics."""

    def test_alfa_from_its_folder_of_rostopic_csvs(self, shared_data, tmp_path, capsys):
        assert main(["import", str(shared_data / "alfa_engine_failure"), "--out", str(tmp_path / "bag")]) == 0
        assert "field.climb" in capsys.readouterr().out  # GPS has no vertical speed: 0 is not a measurement
        recording = read_recording(tmp_path / "bag")
        samples = recording.samples
        imu = samples[samples.kind == Kind.IMU]
        assert len(imu) == 1324
        assert recording.start == pytest.approx(1531943810.86e9, abs=2e7)
        assert np.median(imu.values[:, 2]) == pytest.approx(-10.0, abs=1.5)
        speed = samples.values[samples.kind == Kind.AIRSPEED][:, 0]
        assert 9.0 < np.percentile(speed, 2) < np.percentile(speed, 98) < 23.0
        fix, velocity = (samples[samples.kind == kind] for kind in (Kind.GPS_POSITION, Kind.GPS_VELOCITY))
        north = np.gradient(fix.values[:, 0] * 6.371e6, fix.stamp * 1e-9)
        assert np.corrcoef(np.interp(velocity.stamp, fix.stamp, north), velocity.values[:, 0])[0, 1] > 0.95
        assert np.std(velocity.values[:, 2]) > 0.3

    def test_paparazzi_from_its_messages(self, shared_data, tmp_path, capsys):
        source = next((shared_data / "paparazzi_fault").glob("*.data"))
        capsys.readouterr()
        assert main(["import", str(source), "--out", str(tmp_path / "bag"), "--json"]) == 0
        (note,) = (n for n in json.loads(capsys.readouterr().out)["notes"] if n.startswith("ATTITUDE is not taken"))
        assert "its yaw follows the course over ground" in note
        recording = read_recording(tmp_path / "bag")
        samples = recording.samples
        assert recording.duration == pytest.approx(100.0, abs=0.5)
        imu, velocity, fix = (
            samples[samples.kind == kind] for kind in (Kind.IMU, Kind.GPS_VELOCITY, Kind.GPS_POSITION)
        )
        assert len(imu) / recording.duration == pytest.approx(60.0, abs=0.5)
        assert not (samples.kind == Kind.AIRSPEED).any()
        assert Kind.ATTITUDE not in samples.kind
        logged = np.loadtxt([" ".join(w.split()[:1]) for w in source.open() if w.split()[2] == "GPS"])
        late = logged[np.searchsorted(logged, velocity.stamp * 1e-9 - 946_684_800 - 1e-4)]  # when it was sent
        delay = late - (velocity.stamp * 1e-9 - 946_684_800)
        assert delay.min() >= -1e-3 and delay.max() < 0.25
        steps = np.diff(velocity.stamp) * 1e-6  # the receiver gives a solution every 200 ms
        assert set(np.round(steps).astype(int)) <= {200, 400}
        place = earth.ned_along(fix.values[:, :3], fix.values[0, :3])
        for axis in range(2):
            travelled = np.cumsum(velocity.values[:, axis]) * 0.2
            assert np.corrcoef(place[:, axis], travelled)[0, 1] > 0.99
        pulses = read_table(tmp_path / "bag", "inputs")
        third = np.array(
            [
                values[list(names).index("pulse_3")]
                for names, values in zip(pulses.fields["name"], pulses.fields["position"], strict=True)
            ]
        )
        time = pulses.stamp * 1e-9 - 946_684_800
        assert set(third[(time > 2813.2) & (time < 2815.0)]) == {1416.0}  # the elevon that is held
