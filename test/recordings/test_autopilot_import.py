"""Logs of autopilots, written byte by byte with one known motion, come back as that motion in our units and frames."""

import argparse
import json
import shutil
import subprocess
import sys

import numpy as np
import pytest
from autopilot_log_files import dataflash, dataflash_text, ulog, write_bag

from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.commands import import_log
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.autopilot_bag_import import is_autopilot_bag
from aircraft_sysid_ros.recordings.autopilot_log import gps_nanoseconds
from aircraft_sysid_ros.recordings.dataflash_text import write_as_binary
from aircraft_sysid_ros.recordings.imported_log import ImportedLog, ImportedTopic, write_log
from aircraft_sysid_ros.recordings.injections import injections
from aircraft_sysid_ros.recordings.manoeuvres import read_segments
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.segment_list import Span
from aircraft_sysid_ros.recordings.tables import read_table
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS, imu_fields
from aircraft_sysid_ros.samples import Kind

RATE, DURATION, BOOT = 50, 4.0, 77.5  # [Hz], [s], [s] time since start at the first sample
COUNT = int(RATE * DURATION)
TIME = np.arange(COUNT) / RATE
UNIX = 1_760_000_000  # [s] at the first sample: 2025-10-09
# One motion, in FRD and NED.
FORCE = np.stack([0.5 + 0.1 * TIME, -0.3 + 0 * TIME, -9.8 + 0.2 * np.sin(TIME)], axis=1)
RATES = np.stack([0.1 * np.sin(TIME), 0.2 * np.cos(TIME), -0.05 + 0 * TIME], axis=1)
LATITUDE, LONGITUDE, ALTITUDE = 44.5 + 1e-5 * TIME, -93.25 + 2e-5 * TIME, 310.0 + TIME
NORTH, EAST, DOWN = 12.0 + 0 * TIME, -9.0 + 0 * TIME, -1.5 + 0 * TIME
PRESSURE, AIRSPEED = 97_000.0, 17.0
CALIBRATION = """
outputs:
  1: {surface: aileron, us: [1000, 1500, 2000], deg: [30, 0, -30]}
  2: {surface: elevator, us: [1000, 1500, 2000], rad: [-0.5, 0, 0.5]}
  3: {surface: throttle, us: [1000, 2000], fraction: [0, 1]}
"""
PULSES = (1250, 1600, 1400)  # 15 deg, 0.1 rad, 0.4
NAMED = """
  4: {input: spoiler, us: [1000, 2000], deg: [0, 60]}
  5: {surface: flaps, input: left_flap, us: [1100, 1500, 1900], deg: [-20, 0, 30]}
"""


def outputs(k):
    """Pulses of a sample: the spoiler opens all the time, the flaps stand at 15 deg."""
    return (*PULSES, 1000 + 5 * k, 1700)


@pytest.fixture
def calibration(tmp_path):
    path = tmp_path / "calibration.yaml"
    path.write_text(CALIBRATION)
    return path


def run_import(log, out, calibration=None):
    args = argparse.Namespace(
        log=str(log), out=str(out), overwrite=False, map=None, guess=None, servos=calibration and str(calibration)
    )
    report = import_log.run(args)
    json.dumps(report)
    assert import_log.render(report)
    return report, read_recording(out)


def of_kind(recording, kind):
    return recording.samples[recording.samples.kind == kind]


def check_motion(recording, start, *, force=2e-3, rate=1e-6, place=1.2e-7, height=2e-3, speed=2e-2, stamp=2e-6):
    """The motion above, tolerances for what the format rounds; ``start``: Unix time [s] of the first sample."""
    imu = of_kind(recording, Kind.IMU)
    assert len(imu) == COUNT
    np.testing.assert_allclose((imu.stamp - start * 10**9) * 1e-9, TIME, atol=stamp)
    np.testing.assert_allclose(imu.values[:, :3], FORCE, atol=force)
    np.testing.assert_allclose(imu.values[:, 3:6], RATES, atol=rate)
    fix = of_kind(recording, Kind.GPS_POSITION)
    row = np.rint((fix.stamp - start * 10**9) * 1e-9 * RATE).astype(int)
    np.testing.assert_allclose(np.degrees(fix.values[:, 0]), LATITUDE[row], atol=place)
    np.testing.assert_allclose(np.degrees(fix.values[:, 1]), LONGITUDE[row], atol=place)
    np.testing.assert_allclose(fix.values[:, 2], ALTITUDE[row], atol=height)
    velocity = of_kind(recording, Kind.GPS_VELOCITY)
    assert len(velocity)
    np.testing.assert_allclose(velocity.values[:, :3], [[12.0, -9.0, -1.5]] * len(velocity), atol=speed)


def check_surfaces(recording):
    controls = of_kind(recording, Kind.CONTROLS).values
    np.testing.assert_allclose(controls[:, 0], 0.1, atol=1e-9)  # elevator
    np.testing.assert_allclose(controls[:, 1], np.radians(15.0), atol=1e-9)  # aileron
    assert np.all(np.isnan(controls[:, 2]))  # rudder: not in the calibration
    np.testing.assert_allclose(controls[:, 4], 0.4, atol=1e-9)


def expected_true(indicated):
    """TAS of a low IAS: V sqrt(rho_0 / rho), rho at the standard temperature of the pressure altitude."""
    temperature = 288.15 * (PRESSURE / 101325.0) ** (287.05287 * 0.0065 / 9.80665)
    return indicated * np.sqrt(1.225 / (PRESSURE / (287.05287 * temperature)))


# -- DataFlash --------------------------------------------------------------------------------------------------

FORMATS = {
    "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "GPS": ("QBBIHBcLLefff", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ"),
    "BARO": ("QBffc", "TimeUS,I,Alt,Press,Temp"),
    "ARSP": ("QBffcf", "TimeUS,I,Airspeed,DiffPress,Temp,RawPress"),
    "AOA": ("Qff", "TimeUS,AOA,SSA"),
    "RCOU": ("Q" + "H" * 14, "TimeUS," + ",".join(f"C{i}" for i in range(1, 15))),
    "ATT": ("Qccccff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "RPM": ("Qff", "TimeUS,rpm1,rpm2"),
    "PARM": ("QNff", "TimeUS,Name,Value,Default"),
    "MODE": ("QMBB", "TimeUS,Mode,ModeNum,Rsn"),
}


def gps_week(unix):
    seconds = unix + 18 - 315_964_800
    return int(seconds // 604_800), round(seconds % 604_800 * 1000)


def dataflash_rows():
    rows = [("PARM", (1000, b"SERVO2_FUNCTION", 19.0, 0.0)), ("PARM", (1000, b"SERVO2_TRIM", 1500.0, 0.0)),
            ("PARM", (1000, b"SERVO2_MIN", 1100.0, 0.0)), ("PARM", (1000, b"SERVO2_MAX", 1900.0, 0.0)),
            ("PARM", (1000, b"SERVO2_REVERSED", 1.0, 0.0)), ("MODE", (1000, 10, 10, 1))]  # fmt: skip
    course = float(np.degrees(np.arctan2(-9.0, 12.0)) % 360.0)
    for k in range(COUNT):
        us = round((BOOT + TIME[k]) * 1e6)
        rows.append(("IMU", (us, 0, *RATES[k], *FORCE[k])))
        rows.append(("IMU", (us, 1, *(RATES[k] + 9.0), *(FORCE[k] + 9.0))))  # another IMU: not mixed in
        if k % 10 == 0:
            week, ms = gps_week(UNIX + TIME[k])
            place = (round(LATITUDE[k] * 1e7), round(LONGITUDE[k] * 1e7), round(ALTITUDE[k] * 100))
            rows.append(("GPS", (us, 0, 3, ms, week, 12, 80, *place, 15.0, course, -1.5)))
            rows.append(("BARO", (us, 0, 0.0, PRESSURE, 3500)))
        if k % 5 == 0:
            rows.append(("ARSP", (us, 0, AIRSPEED, 180.0, 3000, 180.0)))
            rows.append(("AOA", (us, 3.0, -2.0)))
            rows.append(("RCOU", (us, *outputs(k), *[0] * 9)))
            rows.append(("RPM", (us, 6000.0, -1.0)))
            rows.append(("ATT", (us, 0, 1000, 0, 500, 9000.0, 90.0)))
    return rows


def test_outputs_that_nobody_explains_wait_for_a_calibration(tmp_path):
    log = tmp_path / "flight.bin"
    log.write_bytes(dataflash(FORMATS, dataflash_rows()))
    report, _ = run_import(log, tmp_path / "bag", None)
    assert report["missing"]["control_surfaces"].endswith("give a calibration file (--servos)")
    assert report["found"]["RCOU"]["state"].startswith("needs a calibration file")
    assert any("attitude: {std: 0.05}" in note for note in report["notes"])


def test_a_calibration_in_the_other_unit_is_told_so_and_not_asked_for_again(tmp_path):
    log, servos = tmp_path / "flight.bin", tmp_path / "servos.yaml"
    log.write_bytes(dataflash(FORMATS, dataflash_rows()))
    servos.write_text("outputs: {1: {surface: elevator, command: [-1, 1], deg: [-25, 25]}}")
    report, _ = run_import(log, tmp_path / "bag", servos)
    assert "RCOU has pulses in us: give us in place of command" in report["missing"]["control_surfaces"]
    assert report["found"]["RCOU"]["state"].startswith("needs a calibration file")


def test_a_message_with_other_fields_is_not_one_that_another_goes_before(tmp_path):
    formats = {**FORMATS, "GPS": (FORMATS["GPS"][0], FORMATS["GPS"][1].replace("Lat", "La").replace("VZ", "V"))}
    log = tmp_path / "flight.bin"
    log.write_bytes(dataflash(formats, dataflash_rows()))
    report, _ = run_import(log, tmp_path / "bag", None)
    assert report["found"]["GPS"]["state"] == "nothing in it that is known"
    assert report["missing"]["gps/fix"] == "the log has no message with a GPS position"


def test_dataflash(tmp_path, calibration):
    log = tmp_path / "flight.bin"
    log.write_bytes(dataflash(FORMATS, dataflash_rows()))
    report, recording = run_import(log, tmp_path / "bag", calibration)
    check_motion(recording, UNIX, height=1e-2)
    check_surfaces(recording)
    speed = of_kind(recording, Kind.AIRSPEED).values[:, 0]
    np.testing.assert_allclose(speed[3:], expected_true(AIRSPEED), rtol=2e-4)  # indicated, by default for ARSP
    np.testing.assert_allclose(of_kind(recording, Kind.CONTROLS).values[:, 6], 6000.0 * 2 * np.pi / 60, rtol=1e-6)
    assert not len(of_kind(recording, Kind.ANGLE_OF_ATTACK))
    assert "flow_angles: measured" in report["missing"]["angle_of_attack"]
    assert report["found"]["IMU"] == {"messages": 2 * COUNT, "state": "mapped"}
    assert report["found"]["BARO"]["state"] == report["found"]["RPM"]["state"] == "mapped"  # with what others say
    assert report["found"]["MODE"]["state"] == "unused"
    assert any("2 elevator 1100/1500/1900 us reversed" in note for note in report["notes"])
    attitude = read_table(tmp_path / "bag", "autopilot/attitude").fields["quaternion"]
    # nose east, pitched up 5 deg, rolled right 10 deg; ENU: yaw of the x axis from east is 0
    x, y, z, w = attitude[0]
    forward = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    np.testing.assert_allclose(forward, (np.cos(np.radians(5.0)), 0.0, np.sin(np.radians(5.0))), atol=1e-6)


def test_a_mode_that_is_written_by_its_name_is_no_damaged_line(tmp_path):
    """As Mission Planner writes it: of a whole log it was said that lines could not be read."""
    text = dataflash_text({"MODE": ("QMBB", "TimeUS,Mode,ModeNum,Rsn")}, [("MODE", (1000, 10, 10, 1))])
    (tmp_path / "a.log").write_text(text.replace("MODE, 1000, 10,", "MODE, 1000, Auto,"))
    assert "Auto" in (tmp_path / "a.log").read_text()
    assert write_as_binary(tmp_path / "a.log", tmp_path / "a.bin") == 0


def test_dataflash_as_text_is_the_log_that_it_was_made_from(tmp_path, calibration):
    """It was refused. Damaged lines are counted, and those around them are read."""
    log, text = tmp_path / "flight.bin", tmp_path / "flight.log"
    rows = [row for row in dataflash_rows() if not any(value != value for value in row[1] if isinstance(value, float))]
    log.write_bytes(dataflash(FORMATS, rows))
    lines = dataflash_text(FORMATS, rows).splitlines()
    lines[400:400] = ["IMU, 12", "?\x00\xff", "UNKNOWN, 1, 2", "", "IMU, soon, 0, 0, 0, 0, 0, 0"]
    text.write_text("\n".join(lines) + "\n")
    report, recording = run_import(text, tmp_path / "of text", calibration)
    expected, original = run_import(log, tmp_path / "of binary", calibration)
    assert report["found"] == expected["found"] and report["missing"] == expected["missing"]
    assert report["notes"] == ["4 lines of the text could not be read", *expected["notes"]]
    for name in ("stamp", "kind", "values"):
        np.testing.assert_array_equal(getattr(recording.samples, name), getattr(original.samples, name))


OLD_FORMATS = {
    "IMU": ("Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "GPS": ("BIHBcLLeeEefI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T"),
    "RCOU": ("I" + "h" * 12, "TimeMS," + ",".join(f"Ch{i}" for i in range(1, 13))),
}


def test_dataflash_of_the_years_up_to_2014(tmp_path, calibration):
    """Its GPS has the time in the week where all else has that since the start, its outputs have other names."""
    rows, course = [], round(np.degrees(np.arctan2(-9.0, 12.0)) % 360.0 * 100)
    for k in range(COUNT):
        ms = round((BOOT + TIME[k]) * 1e3)
        rows.append(("IMU", (ms, *RATES[k], *FORCE[k])))
        if k % 10 == 0:
            week, of_week = gps_week(UNIX + TIME[k])
            place = (round(LATITUDE[k] * 1e7), round(LONGITUDE[k] * 1e7), 0, round(ALTITUDE[k] * 100))
            rows.append(("GPS", (3, of_week, week, 12, 80, *place, 1500, course, -1.5, ms)))
            rows.append(("RCOU", (ms, *outputs(k), *[0] * 7)))
    log = tmp_path / "flight.bin"
    log.write_bytes(dataflash(OLD_FORMATS, rows))
    report, recording = run_import(log, tmp_path / "bag", calibration)
    check_motion(recording, UNIX, height=1e-2)
    check_surfaces(recording)
    assert report["duration"] == pytest.approx(TIME[-1])


HEALTH = {
    "IMU": ("QBffffffBB", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,GH,AH"),
    "BARO": ("QBffcB", "TimeUS,I,Alt,Press,Temp,Health"),
    "ARSP": ("QBffcfB", "TimeUS,I,Airspeed,DiffPress,Temp,RawPress,H"),
}


def test_what_a_sensor_shows_that_is_not_healthy_is_no_measurement(tmp_path):
    """A pitot that does not answer shows the airspeed of its offset; that and IMUs that stand still were measured."""
    rows, dead = [], COUNT // 2
    for name, values in dataflash_rows():
        k = round((values[0] * 1e-6 - BOOT) * RATE) if name in HEALTH else 0
        if name == "IMU":
            rows.append((name, (*values, 1, int(k < dead)) if values[1] == 0 else (*values, 1, 0)))
        elif name == "BARO":
            rows.append((name, (*values[:3], *((PRESSURE, 3500, 1) if k < dead else (1000.0, 0, 0)))))
        elif name == "ARSP":
            rows.append((name, (*values[:2], *((AIRSPEED, *values[3:], 1) if k < dead else (7.7, *values[3:], 0)))))
        else:
            rows.append((name, values))
    log = tmp_path / "flight.bin"
    log.write_bytes(dataflash({**FORMATS, **HEALTH}, rows))
    _, recording = run_import(log, tmp_path / "bag")
    imu, speed = of_kind(recording, Kind.IMU), of_kind(recording, Kind.AIRSPEED)
    np.testing.assert_allclose(imu.values[:, :3], FORCE[:dead], atol=2e-3)
    assert 0 < len(speed) <= dead // 5
    np.testing.assert_allclose(speed.values[3:, 0], expected_true(AIRSPEED), rtol=2e-4)


def test_of_two_pitots_that_is_read_which_is_healthy(tmp_path):
    rows = []
    for name, values in dataflash_rows():
        rows += [(name, (*values, 0)), (name, (values[0], 1, *values[2:], 1))] if name == "ARSP" else [(name, values)]
    log = tmp_path / "flight.bin"
    log.write_bytes(dataflash({**FORMATS, "ARSP": HEALTH["ARSP"]}, rows))
    report, recording = run_import(log, tmp_path / "bag")
    assert len(of_kind(recording, Kind.AIRSPEED)) == len(range(0, COUNT, 5))
    assert any(note.startswith("ARSP 1 is read") for note in report["notes"])
    log.write_bytes(dataflash({**FORMATS, "ARSP": HEALTH["ARSP"]}, [r for r in rows if r[0] != "ARSP" or not r[1][1]]))
    report, recording = run_import(log, tmp_path / "none")
    assert not len(of_kind(recording, Kind.AIRSPEED)) and "healthy" in report["missing"]["true_airspeed"]


@pytest.mark.parametrize("name", ["IMU", "MAG"])
def test_of_a_sensor_that_is_never_healthy_it_is_not_said_that_the_log_has_none(tmp_path, name):
    formats = {**FORMATS, **HEALTH, "MAG": ("QBfffB", "TimeUS,I,MagX,MagY,MagZ,Health")}
    rows = [(n, (*v, 1, 1) if n == "IMU" else (*v, 1) if n in HEALTH else v) for n, v in dataflash_rows()]
    rows += [("MAG", (v[0], 0, 200.0, 0.0, 400.0, 1)) for n, v in rows if n == "BARO"]
    flags = 2 if name == "IMU" else 1
    log = tmp_path / "flight.bin"
    log.write_bytes(dataflash(formats, [(n, (*v[:-flags], *[0] * flags) if n == name else v) for n, v in rows]))
    report, _ = run_import(log, tmp_path / "bag")
    assert "healthy" in report["missing"][{"IMU": "imu/data", "MAG": "imu/mag"}[name]]


def test_an_engine_sensor_without_a_signal_says_nothing(tmp_path):
    """ArduPilot writes -1, which was a speed of -0.1 rad/s."""
    rows = [(name, (values[0], -1.0, -1.0)) if name == "RPM" else (name, values) for name, values in dataflash_rows()]
    log, servos = tmp_path / "flight.bin", tmp_path / "servos.yaml"
    servos.write_text(CALIBRATION)
    log.write_bytes(dataflash(FORMATS, rows))
    _, recording = run_import(log, tmp_path / "bag", servos)
    assert np.isnan(of_kind(recording, Kind.CONTROLS).values[:, 6]).all()


SWEEPS = {
    "SIDS": ("QBfffffff", "TimeUS,Ax,Mag,FSt,FSp,TFin,TC,TR,TFout"),
    "SIDD": ("Qfffffffff", "TimeUS,Time,Targ,F,Gx,Gy,Gz,Ax,Ay,Az"),
}


def sweep(axis, begin, end, length=70.0, rate=50.0):
    """What System ID writes of one sweep, times [s] since the first sample: it may be ended before its length."""
    rows = [("SIDS", (round((BOOT + begin) * 1e6), axis, 5.0, 0.5, 15.0, 5.0, 4.0, length, 1.0))]
    times = np.arange(begin, end + 1e-9, 1.0 / rate) if rate else ()
    return rows + [("SIDD", (round((BOOT + t) * 1e6), t - begin, 0.1, 1.0, *[0.0] * 6)) for t in times]


def cut(log, out):
    """Name, start and stop of each manoeuvre, by the file that the import leaves beside the recording."""
    report, _ = run_import(log, out)
    file = out.with_name(f"{out.name}.segments.yaml")
    if not file.exists():
        assert not any("System ID" in note for note in report["notes"])
        return []
    assert any(note.startswith("System ID flew") and str(file) in note for note in report["notes"])
    return [(segment.name, segment.start, segment.stop) for segment in read_segments(str(file), [out])]


def test_sweeps_of_system_id_are_manoeuvres(tmp_path):
    """Each with what is around it; one is stopped by hand, one kept no samples."""
    end, log = float(TIME[-1]), tmp_path / "flight.bin"
    first, second = sweep(8, 0.3 * end, 0.4 * end), sweep(10, 0.6 * end, 0.0, 0.1 * end, rate=0.0)
    log.write_bytes(dataflash({**FORMATS, **SWEEPS}, [*dataflash_rows(), *second, *first]))
    (one, two) = cut(log, tmp_path / "bag")
    assert (one[0], two[0]) == ("sweep 1 rate pitch", "sweep 2 mixer roll")
    assert one[1:] == pytest.approx((0.0, 0.5 * end), abs=0.03)  # there is a moment between them
    assert two[1:] == pytest.approx((0.5 * end, end), abs=0.03)
    log.write_bytes(dataflash({**FORMATS, **SWEEPS}, [*dataflash_rows(), *sweep(8, 2.0 * end, 2.1 * end)]))
    assert cut(log, tmp_path / "after the flight") == []
    log.write_bytes(dataflash(FORMATS, dataflash_rows()))
    assert cut(log, tmp_path / "without") == []


def test_dataflash_with_vanes_and_without_calibration(tmp_path):
    log = tmp_path / "flight.bin"
    log.write_bytes(dataflash(FORMATS, dataflash_rows()))
    report, recording = run_import(log, tmp_path / "bare")
    assert "control_surfaces" not in recording.topics
    assert "--servos" in report["missing"]["control_surfaces"]
    vanes = tmp_path / "vanes.yaml"
    vanes.write_text("flow_angles: measured\nairspeed: {meaning: 'true', scale: 1.1}\n")
    _, recording = run_import(log, tmp_path / "vanes", vanes)
    angles = [of_kind(recording, kind).values[:, 0] for kind in (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)]
    np.testing.assert_allclose(angles[0], np.radians(3.0), atol=1e-7)
    np.testing.assert_allclose(angles[1], np.radians(-2.0), atol=1e-7)
    np.testing.assert_allclose(of_kind(recording, Kind.AIRSPEED).values[:, 0], 1.1 * AIRSPEED, rtol=1e-6)


@pytest.mark.parametrize(("cut", "filled", "breaks_off"), [(0, 0, False), (0, 300, False), (5, 0, True), (1, 0, True)])
def test_a_dataflash_log_that_breaks_off_says_so(tmp_path, cut, filled, breaks_off):
    log, whole = tmp_path / "flight.bin", dataflash(FORMATS, dataflash_rows())
    log.write_bytes(whole[: len(whole) - cut] + bytes(filled))
    report, _ = run_import(log, tmp_path / "bag")
    assert any("breaks off in the middle of a message" in note for note in report["notes"]) is breaks_off


def test_a_damaged_dataflash_gives_what_can_be_read(tmp_path):
    data = bytearray(dataflash(FORMATS, dataflash_rows()))
    at = len(data) // 2
    data[at : at + 2000] = np.random.default_rng(1).integers(0, 256, 2000, np.uint8).tobytes()
    log = tmp_path / "damaged.bin"
    log.write_bytes(data)
    report, recording = run_import(log, tmp_path / "bag")
    assert any("damaged" in note for note in report["notes"])
    assert 0.8 * COUNT < len(of_kind(recording, Kind.IMU)) <= COUNT


def test_a_ulog_whose_names_are_damaged_is_read_without_that_message(tmp_path):
    """One wrong bit in the name of a field: a message without a time ended import with a traceback."""
    content = ulog(ulog_topics())
    log = tmp_path / "flight.ulg"
    log.write_bytes(content.replace(b"uint64_t timestamp;uint32_t noutputs", b"uint64_t timestanp;uint32_t noutputs"))
    report, recording = run_import(log, tmp_path / "bag")
    assert "the file is damaged in places: what could be read was" in report["notes"]
    assert "actuator_outputs" not in report["found"] and len(of_kind(recording, Kind.IMU)) > 0


@pytest.mark.parametrize("week", [65535, 0])
def test_times_that_no_stamp_can_hold_are_left_out_and_said(tmp_path, week):
    """One wrong bit in the week of the GPS, or in the time of one message; a recording cannot hold such stamps."""
    rows = [(name, (*values[:4], week, *values[5:]) if name == "GPS" else values) for name, values in dataflash_rows()]
    log = tmp_path / "flight.bin"
    log.write_bytes(dataflash(FORMATS, rows if week else [*dataflash_rows(), ("IMU", (5 * 10**14, *([0] * 7)))]))
    if week:
        report, recording = run_import(log, tmp_path / "bag")
        assert "no GPS fix in the log: it is stamped from 2000-01-01" in report["notes"]
    else:
        report, recording = run_import(log, tmp_path / "bag")
        assert "1 messages with times outside of 1970 to 2038 left out" in report["notes"]
    assert len(of_kind(recording, Kind.IMU)) == COUNT


def test_gps_time_has_the_leap_seconds_of_its_date():
    assert gps_nanoseconds(*gps_week(UNIX)) == UNIX * 10**9
    assert gps_nanoseconds(1700, 0) == (315_964_800 + 1700 * 604_800 - 16) * 10**9  # 2012-08-05
    assert gps_nanoseconds(1600, 500) == (315_964_800 + 1600 * 604_800 - 15) * 10**9 + 500_000_000  # 2010-09-05


# -- ULog -------------------------------------------------------------------------------------------------------


def ulog_topics(*, new_gps=True, late=0):
    """``late`` [us]: by which samples are published after they are taken."""
    us = [round((BOOT + t) * 1e6) for t in TIME]
    gps = [
        (us[k], round((UNIX + TIME[k]) * 1e6), 12.0, -9.0, -1.5, 0.8, 1.2,
         *((LATITUDE[k], LONGITUDE[k], ALTITUDE[k]) if new_gps else
           (round(LATITUDE[k] * 1e7), round(LONGITUDE[k] * 1e7), round(ALTITUDE[k] * 1e3))), 3)
        for k in range(0, COUNT, 10)
    ]  # fmt: skip
    place = ["double latitude_deg", "double longitude_deg", "double altitude_msl_m"] if new_gps else [
        "int32_t lat", "int32_t lon", "int32_t alt"]  # fmt: skip
    head = ["uint64_t timestamp", "uint64_t time_utc_usec", "float vel_n_m_s", "float vel_e_m_s", "float vel_d_m_s"]
    return {
        "sensor_combined": (
            ["uint64_t timestamp", "float[3] gyro_rad", "float[3] accelerometer_m_s2"],
            [(us[k], *RATES[k], *FORCE[k]) for k in range(COUNT)],
        ),
        "vehicle_gps_position": ([*head, "float eph", "float epv", *place, "uint8_t fix_type"], gps),
        "airspeed": (
            ["uint64_t timestamp", "uint64_t timestamp_sample", "float indicated_airspeed_m_s"],
            [(us[k] + late, us[k], AIRSPEED) for k in range(0, COUNT, 5)],
        ),
        "vehicle_air_data": (
            ["uint64_t timestamp", "float baro_pressure_pa", "float baro_temp_celcius"],
            [(us[k], PRESSURE, 35.0) for k in range(0, COUNT, 5)],
        ),
        "actuator_outputs": (
            ["uint64_t timestamp", "uint32_t noutputs", "float[16] output"],
            [(us[k], 5, *outputs(k), *[0.0] * 11) for k in range(0, COUNT, 5)],
        ),
        "vehicle_status": (["uint64_t timestamp", "uint8_t nav_state"], [(us[0], 3)]),
    }


@pytest.mark.parametrize("new_gps", [True, False])
def test_ulog(tmp_path, calibration, new_gps):
    log = tmp_path / "flight.ulg"
    log.write_bytes(ulog(ulog_topics(new_gps=new_gps, late=8000)))
    report, recording = run_import(log, tmp_path / "bag", calibration)
    check_motion(recording, UNIX)
    check_surfaces(recording)
    speed = of_kind(recording, Kind.AIRSPEED)
    np.testing.assert_allclose(speed.values[3:, 0], expected_true(AIRSPEED), rtol=2e-4)
    # stamped when the sample was taken and not 8 ms later when it was published
    np.testing.assert_allclose((speed.stamp - UNIX * 10**9) * 1e-9, TIME[::5], atol=2e-6)
    variance = of_kind(recording, Kind.GPS_POSITION).values[:, 3:6]
    np.testing.assert_allclose(variance, [[0.32, 0.32, 1.44]] * len(variance), rtol=1e-5)  # eph is a radius
    assert report["found"]["vehicle_status"]["state"] == "unused"
    assert report["topics"]["air_data"]["source"] == "airspeed (indicated)"


@pytest.mark.parametrize("dead", ["vehicle_gps_position", "vehicle_gps_position[1]"])
def test_of_a_ulog_the_receiver_with_fixes_is_read_and_other_instances_are_named(tmp_path, dead):
    """The first instance counted, also where it was dead, and of the others nothing was said."""
    topics = ulog_topics()
    fields, rows = topics.pop("vehicle_gps_position")
    topics |= {"vehicle_gps_position": (fields, rows), "vehicle_gps_position[1]": (fields, rows)}
    topics[dead] = (fields, [(*row[:-1], 1) for row in rows[:7]])
    topics["actuator_outputs[1]"] = topics["actuator_outputs"]
    log = tmp_path / "flight.ulg"
    log.write_bytes(ulog(topics))
    report, recording = run_import(log, tmp_path / "bag")
    check_motion(recording, UNIX)
    assert report["found"]["vehicle_gps_position"] == {"messages": len(rows), "state": "mapped"}
    left_out = "vehicle_gps_position[1]" if "[" in dead else "vehicle_gps_position[0]"
    assert report["found"][left_out] == {"messages": 7, "state": "not read: another instance is"}
    note = "vehicle_gps_position[1] is read: it has more fixes than vehicle_gps_position[0]"
    assert (note in report["notes"]) is (dead == "vehicle_gps_position")
    assert report["found"]["actuator_outputs[1]"] == {"messages": 40, "state": "not read: another instance is"}


def test_one_fix_more_is_no_reason_to_leave_the_first_receiver(tmp_path):
    """The other one was read, and no note said so."""
    log = tmp_path / "flight.bin"
    rows = dataflash_rows()
    fixes = [(name, values) for name, values in rows if name == "GPS"]
    for count, instance in ((len(fixes) - 1, 0), (len(fixes) // 2, 1)):
        first = [(name, (*values[:2], 3 if i < count else 1, *values[3:])) for i, (name, values) in enumerate(fixes)]
        second = [(name, (values[0], 1, *values[2:9], 99_900, *values[10:])) for name, values in fixes]
        log.write_bytes(dataflash(FORMATS, [*(row for row in rows if row[0] != "GPS"), *first, *second]))
        report, recording = run_import(log, tmp_path / f"bag{instance}")
        assert of_kind(recording, Kind.GPS_POSITION).values[0, 2] == (999.0 if instance else 310.0)
        assert ("GPS receiver 1 is read: it has more fixes than receiver 0" in report["notes"]) is bool(instance)


@pytest.mark.parametrize("cut", [0, 5])
def test_a_ulog_that_breaks_off_says_so(tmp_path, cut):
    log, whole = tmp_path / "flight.ulg", ulog(ulog_topics())
    log.write_bytes(whole[: len(whole) - cut])
    report, _ = run_import(log, tmp_path / "bag")
    assert any("breaks off in the middle of a message" in note for note in report["notes"]) is bool(cut)


def test_a_ulog_without_gps_time_says_so(tmp_path):
    topics = {name: content for name, content in ulog_topics().items() if "gps" not in name}
    log = tmp_path / "flight.ulg"
    log.write_bytes(ulog(topics))
    report, recording = run_import(log, tmp_path / "bag")
    assert report["start"].startswith("2000-01-01") and any("no GPS time" in note for note in report["notes"])
    assert report["missing"]["gps/fix"]
    assert len(of_kind(recording, Kind.IMU)) == COUNT


@pytest.mark.long
@pytest.mark.parametrize("kind", ["ulog", "dataflash"])
def test_inputs_that_the_calibration_names_come_out_of_a_log_by_their_names(tmp_path, kind):
    """With a process of its own, as a user does it; `check` then finds them."""
    log, file = tmp_path / f"flight.{'ulg' if kind == 'ulog' else 'bin'}", tmp_path / "calibration.yaml"
    log.write_bytes(ulog(ulog_topics()) if kind == "ulog" else dataflash(FORMATS, dataflash_rows()))
    file.write_text(CALIBRATION.rstrip() + NAMED)
    report = processed("import", log, "--out", tmp_path / "bag", "--servos", file)
    count = len(range(0, COUNT, 5))
    assert report["topics"]["inputs"]["messages"] == report["topics"]["control_surfaces"]["messages"] == count
    recording = read_recording(tmp_path / "bag", [NamedInput("left_flap"), NamedInput("spoiler")])
    named = of_kind(recording, Kind.INPUTS)
    np.testing.assert_allclose((named.stamp - UNIX * 10**9) * 1e-9, TIME[::5], atol=2e-6)
    np.testing.assert_allclose(named.values[:, 0], np.radians(15.0), atol=1e-9)
    np.testing.assert_allclose(named.values[:, 1], np.radians(0.3 * np.arange(0, COUNT, 5)), atol=1e-9)
    controls = of_kind(recording, Kind.CONTROLS).values
    np.testing.assert_allclose(controls[:, 3], np.radians(15.0), atol=1e-9)  # flaps as well
    check_surfaces(recording)
    (tmp_path / "plane.yaml").write_text(PLANE)
    checked = processed("check", tmp_path / "bag", "--aircraft", tmp_path / "plane.yaml")
    assert checked["rates"]["inputs.spoiler"] == pytest.approx(RATE / 5, rel=0.01)
    assert {f["signal"]: f["kind"] for f in checked["findings"] if "inputs" in f["signal"]} == {
        "inputs.left_flap": "held"
    }


PLANE = """\
{name: wing, mass: 2, wing_area: 0.5, span: 2, chord: 0.25, inertia: {xx: 0.1, yy: 0.1, zz: 0.2},
 inputs: {left_flap: , spoiler: }}
"""


def processed(*words):
    """The answer of a command that was started as a user starts it."""
    command = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", *map(str, words), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return json.loads(done.stdout)


# -- bags -------------------------------------------------------------------------------------------------------

PX4_TYPES = {
    "px4_msgs/msg/SensorCombined": (
        "uint64 timestamp\nfloat32[3] gyro_rad\nuint32 gyro_integral_dt\nfloat32[3] accelerometer_m_s2"
    ),
    "px4_msgs/msg/SensorGps": (
        "uint64 timestamp\nuint64 timestamp_sample\n"
        "float64 latitude_deg\nfloat64 longitude_deg\nfloat64 altitude_msl_m\n"
        "float32 eph\nfloat32 epv\nfloat32 vel_n_m_s\nfloat32 vel_e_m_s\nfloat32 vel_d_m_s\nuint8 fix_type"
    ),
    "px4_msgs/msg/Airspeed": "uint64 timestamp\nuint64 timestamp_sample\nfloat32 indicated_airspeed_m_s",
    "px4_msgs/msg/VehicleAirData": "uint64 timestamp\nfloat32 baro_pressure_pa\nfloat32 baro_temp_celcius",
    "px4_msgs/msg/ActuatorOutputs": "uint64 timestamp\nuint32 noutputs\nfloat32[16] output",
    "px4_msgs/msg/EscReport": "uint64 timestamp\nint32 esc_rpm",
    "px4_msgs/msg/EscStatus": "uint64 timestamp\nuint8 esc_count\npx4_msgs/EscReport[8] esc",
}


def px4_messages(*, boot, delay=3_000_000):
    """``boot``: times count from the start [s] at the first sample; else Unix time, as uXRCE-DDS makes of them."""
    zero = UNIX * 10**9
    messages = []
    for k in range(COUNT):
        us = round(((BOOT if boot else UNIX) + TIME[k]) * 1e6)
        at = zero + round(TIME[k] * 1e9) + delay + (k % 7) * 1_000_000

        def add(name, fields, us=us, at=at):
            topic = "/fmu/out/" + name.lower()
            messages.append((at, topic, f"px4_msgs/msg/{name}", {"timestamp": us, **fields}))

        add("SensorCombined", {"gyro_rad": RATES[k], "accelerometer_m_s2": FORCE[k]})
        if k % 10 == 0:
            add("SensorGps", {"timestamp_sample": us, "latitude_deg": LATITUDE[k], "longitude_deg": LONGITUDE[k],
                              "altitude_msl_m": ALTITUDE[k], "eph": 0.8, "epv": 1.2, "vel_n_m_s": 12.0,
                              "vel_e_m_s": -9.0, "vel_d_m_s": -1.5, "fix_type": 3})  # fmt: skip
            add("VehicleAirData", {"baro_pressure_pa": PRESSURE, "baro_temp_celcius": 30.0})
        if k % 5 == 0:
            add("Airspeed", {"timestamp_sample": us, "indicated_airspeed_m_s": AIRSPEED})
            add("ActuatorOutputs", {"noutputs": 3, "output": [*PULSES, *[0.0] * 13]})
            add("EscStatus", {"esc_count": 1, "esc": [{"esc_rpm": 6000}] + [{}] * 7})
    return messages


@pytest.mark.parametrize("boot", [False, True])
def test_a_bag_of_px4_msgs_is_decoded_by_its_own_definitions(tmp_path, calibration, boot):
    bag = write_bag(tmp_path / "px4", PX4_TYPES, px4_messages(boot=boot))
    report, recording = run_import(bag, tmp_path / "bag", calibration)
    # of times since the start nobody knows more than the least delay to the recorder
    start = UNIX + (0.003 if boot else 0.0)
    check_motion(recording, start, stamp=1e-5)
    check_surfaces(recording)
    np.testing.assert_allclose(of_kind(recording, Kind.CONTROLS).values[:, 6], 6000 * 2 * np.pi / 60, rtol=1e-6)
    assert report["format"] == "bag of px4_msgs"
    assert report["found"]["sensor_combined"] == {"messages": COUNT, "state": "mapped"}


def test_a_bag_of_px4_msgs_goes_on_after_a_restart(tmp_path):
    """Two boots a minute apart were made one, whose samples alternated between them; a message of the first is late."""
    (at, *late), *others = first = px4_messages(boot=True)
    again = [(at + 60 * 10**9, *rest) for at, *rest in first]
    bag = write_bag(tmp_path / "px4", PX4_TYPES, [(at + 2 * 10**9, *late), *others, *again])
    report, recording = run_import(bag, tmp_path / "bag")
    imu = of_kind(recording, Kind.IMU)
    np.testing.assert_allclose((imu.stamp[[0, COUNT, -1]] - UNIX * 10**9) * 1e-9, [0.003, 60.003, 63.983], atol=1e-5)
    assert len(imu) == 2 * COUNT and np.all(np.diff(imu.stamp) > 0)
    assert "the autopilot restarted 1 times" in report["notes"]


@pytest.mark.parametrize("end", [[], [60.0]])
def test_a_late_message_is_no_restart_of_px4(tmp_path, end):
    """As the last one of a bag, or of a boot, it counted as one."""
    first = px4_messages(boot=True)
    (at, *late) = first[-200]
    again = [(at + round(later * 1e9), *rest) for later in end for at, *rest in first]
    bag = write_bag(tmp_path / "px4", PX4_TYPES, [*first, (at + 5 * 10**9, *late), *again])
    report, _ = run_import(bag, tmp_path / "bag")
    assert [note for note in report["notes"] if "restarted" in note] == ["the autopilot restarted 1 times" for _ in end]


def test_a_restart_of_px4_shows_also_where_its_time_is_near_that_of_the_boot_before(tmp_path):
    """Of less than a second nothing was noted, and both boots had the delay of one."""
    messages = px4_messages(boot=True)
    half = len(messages) // 2
    again = [(at + 58 * 10**9, *rest) for at, *rest in messages[half - 90 :]]
    report, recording = run_import(write_bag(tmp_path / "px4", PX4_TYPES, [*messages[:half], *again]), tmp_path / "bag")
    assert "the autopilot restarted 1 times" in report["notes"]
    imu = of_kind(recording, Kind.IMU)
    assert (imu.stamp[-1] - UNIX * 10**9) * 1e-9 == pytest.approx(58.003 + TIME[-1], abs=1e-5)


def test_a_recorder_whose_clock_leaps_is_no_restart_of_px4(tmp_path):
    messages = px4_messages(boot=True)
    half = len(messages) // 2
    late = [(at + 60 * 10**9, *rest) for at, *rest in messages[half:]]
    report, _ = run_import(write_bag(tmp_path / "px4", PX4_TYPES, [*messages[:half], *late]), tmp_path / "bag")
    assert not any("restarted" in note for note in report["notes"])


def test_a_bag_of_px4_msgs_whose_clocks_synchronise_midway(tmp_path):
    """Its first samples were in 1970, or the later ones twice as far from it."""
    since_boot, synchronised = px4_messages(boot=True), px4_messages(boot=False)
    messages = [*since_boot[: len(since_boot) // 2], *synchronised[len(since_boot) // 2 :]]
    report, recording = run_import(write_bag(tmp_path / "px4", PX4_TYPES, messages), tmp_path / "bag")
    check_motion(recording, UNIX, stamp=4e-3)
    assert not any("restarted" in note for note in report["notes"])


def test_a_bag_of_several_files_is_read_to_its_end(tmp_path):
    """Each file has channels of its own, of which those of the first alone counted."""
    messages = px4_messages(boot=False)
    for name, part in (("a", messages[:180]), ("b", messages[180:])):
        write_bag(tmp_path / name, PX4_TYPES, part).joinpath(f"{name}.mcap").rename(tmp_path / f"{name}.mcap")
        shutil.rmtree(tmp_path / name)
    report, recording = run_import(tmp_path, tmp_path / "bag")
    check_motion(recording, UNIX, stamp=1e-5)
    assert report["found"]["sensor_combined"] == {"messages": COUNT, "state": "mapped"}
    assert len(read_table(tmp_path, "/fmu/out/sensorcombined").stamp) == COUNT


MAVROS_TYPES = {
    "mavros_msgs/msg/VfrHud": (
        "std_msgs/Header header\nfloat32 airspeed\nfloat32 groundspeed\nint16 heading\nfloat32 throttle\n"
        "float32 altitude\nfloat32 climb"
    ),
    "mavros_msgs/msg/RCOut": "std_msgs/Header header\nuint16[] channels",
}


def mavros_messages(namespace):
    messages = []
    for k in range(COUNT):
        stamp = UNIX * 10**9 + round(TIME[k] * 1e9)
        header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}

        def add(topic, kind, fields, stamp=stamp, header=header):
            messages.append((stamp + 4_000_000, f"{namespace}/mavros/{topic}", kind, {"header": header, **fields}))

        def vector(values):
            return dict(zip("xyz", map(float, values), strict=True))

        flu = np.array([1.0, -1.0, -1.0])
        add("imu/data_raw", "sensor_msgs/msg/Imu", {
            "linear_acceleration": vector(FORCE[k] * flu), "angular_velocity": vector(RATES[k] * flu)})  # fmt: skip
        if k % 10 == 0:
            add("global_position/raw/fix", "sensor_msgs/msg/NavSatFix", {
                "latitude": LATITUDE[k], "longitude": LONGITUDE[k], "altitude": ALTITUDE[k]})  # fmt: skip
            add("global_position/raw/gps_vel", "geometry_msgs/msg/TwistStamped", {
                "twist": {"linear": vector((-9.0, 12.0, 0.0))}})  # fmt: skip
            add("imu/static_pressure", "sensor_msgs/msg/FluidPressure", {"fluid_pressure": PRESSURE})
        if k % 5 == 0:
            add("local_position/velocity_local", "geometry_msgs/msg/TwistStamped", {
                "twist": {"linear": vector((-9.1, 12.1, 1.5))}})  # fmt: skip
            add("vfr_hud", "mavros_msgs/msg/VfrHud", {"airspeed": AIRSPEED, "climb": 1.4})
            add("rc/out", "mavros_msgs/msg/RCOut", {"channels": [*PULSES, 0, 65535]})
    return messages


@pytest.mark.parametrize("namespace", ["", "/uav1"])
def test_a_bag_of_mavros_topics(tmp_path, calibration, namespace):
    bag = write_bag(tmp_path / "mavros", MAVROS_TYPES, mavros_messages(namespace))
    report, recording = run_import(bag, tmp_path / "bag", calibration)
    check_motion(recording, UNIX)  # the vertical velocity is that of local_position: MAVROS leaves it out of gps_vel
    check_surfaces(recording)
    np.testing.assert_allclose(of_kind(recording, Kind.AIRSPEED).values[3:, 0], expected_true(AIRSPEED), rtol=2e-4)
    assert report["topics"]["gps/vel"]["source"].startswith("global_position/raw/gps_vel, vertical of local_position")


@pytest.mark.parametrize(("types", "topic"), [(MAVROS_TYPES, "imu/data_raw"), (PX4_TYPES, "sensorcombined")])
def test_of_a_bag_of_two_vehicles_one_is_read(tmp_path, types, topic):
    """The IMU of one was mixed with the GPS of the other; here the first has no GPS."""
    of_one = mavros_messages("") if types is MAVROS_TYPES else px4_messages(boot=False)
    first, second = ([(at, f"/uav{i}{name}", *rest) for at, name, *rest in of_one] for i in (1, 2))
    without_gps = [message for message in first if "NavSatFix" not in message[2] and "Gps" not in message[2]]
    bag = write_bag(tmp_path / "two", types, [*without_gps, *second])
    report, _ = run_import(bag, tmp_path / "bag")
    assert "topics of several vehicles: those under /uav2/ are read, those under /uav1/ are not" in report["notes"]
    (of_first,) = (name for name in report["found"] if name.startswith("/uav1/") and name.endswith(topic))
    assert report["found"][of_first] == {"messages": COUNT, "state": "unused"}
    assert report["topics"]["imu/data"]["messages"] == COUNT


@pytest.mark.parametrize("drones", [["/drone"], ["/fleet/a", "/fleet/b"]])
def test_topics_of_px4_in_folders_of_their_own_are_of_one_vehicle(tmp_path, drones):
    """Each folder was a vehicle, so that the GPS was lost."""
    messages = [
        (at, f"{drone}/{'imu' if 'sensorc' in name else 'rest'}{name.removeprefix('/fmu/out')}", *rest)
        for drone in drones
        for at, name, *rest in px4_messages(boot=False)
    ]
    report, recording = run_import(write_bag(tmp_path / "px4", PX4_TYPES, messages), tmp_path / "bag")
    check_motion(recording, UNIX, stamp=1e-5)
    note = "topics of several vehicles: those under /fleet/a/ are read, those under /fleet/b/ are not"
    assert (note in report["notes"]) is (len(drones) > 1)


def test_what_px4_says_goes_before_what_it_is_told(tmp_path):
    messages = px4_messages(boot=False)
    told = [(at - 10**7, name.replace("/out/", "/in/"), *rest) for at, name, *rest in messages[:9]]
    report, _ = run_import(write_bag(tmp_path / "px4", PX4_TYPES, [*told, *messages]), tmp_path / "bag")
    assert report["topics"]["imu/data"]["messages"] == COUNT
    assert report["found"]["/fmu/in/sensorcombined"]["state"] == "unused"


def test_a_bag_of_mavros_topics_is_a_log_also_where_mavros_has_our_names(tmp_path):
    """``mavros/imu/data`` alone would be read as a recording without GPS, air data and surfaces."""
    messages = [
        (stamp, topic.replace("data_raw", "data"), kind, fields) for stamp, topic, kind, fields in mavros_messages("")
    ]
    assert is_autopilot_bag(write_bag(tmp_path / "mavros", MAVROS_TYPES, messages))
    ours = [(stamp, topic.replace("/mavros/", "/"), kind, fields) for stamp, topic, kind, fields in messages]
    assert not is_autopilot_bag(write_bag(tmp_path / "ours", MAVROS_TYPES, ours))


@pytest.mark.parametrize(("source", "is_known"), [("VFR_HUD", True), ("vfr_hud", True), ("ARSP", False)])
def test_a_source_of_airspeed_that_this_kind_of_log_has_not_is_refused(tmp_path, calibration, source, is_known):
    bag = write_bag(tmp_path / "mavros", MAVROS_TYPES, mavros_messages(""))
    calibration.write_text(f"{calibration.read_text()}airspeed: {{source: {source}}}\n")
    if is_known:
        _, recording = run_import(bag, tmp_path / "bag", calibration)
        assert len(of_kind(recording, Kind.AIRSPEED))
        return
    with pytest.raises(InputError, match=r"source: ARSP of airspeed .* which may have vfr_hud"):
        run_import(bag, tmp_path / "bag", calibration)


# -- what cannot be imported ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("a.bin", b"no log at all", "does not begin with A3 95"),
        ("a.ulg", b"no log at all", "not a readable ULog"),
        ("a.tlog", bytes(500), "no heartbeat"),
        ("a.tlog", b"", "no heartbeat"),
        ("a.bin", b"", "does not begin"),
        ("a.ulg", b"", "not a readable ULog"),
        ("a.csv", b"1,2", "cannot be imported: supported are .mat"),
        ("a.log", b"FMT, 128, 89, FMT, BBnNZ, Type", "nothing in it can be used"),
        ("a.log", b"FMT, 129, 89, MODE, QMBB, TimeUS,Mode,ModeNum,Rsn", "no line says how FMT is laid out"),
        ("a.log", b"FMT, what is this", "no line says how FMT is laid out"),
        ("a.log", dataflash({"MODE": FORMATS["MODE"]}, [("MODE", (1, 2, 3, 4))]), "nothing in it can be used"),
        ("a.bin", dataflash({"MODE": FORMATS["MODE"]}, [("MODE", (1, 2, 3, 4))]), "nothing in it can be used"),
    ],
)
def test_what_is_no_log_is_refused_in_one_sentence(tmp_path, name, content, text):
    log = tmp_path / name
    log.write_bytes(content)
    with pytest.raises(InputError) as refused:
        run_import(log, tmp_path / "bag")
    assert text in str(refused.value) and "\n" not in str(refused.value)
    assert not (tmp_path / "bag").exists()


def test_a_bag_of_something_else_is_refused(tmp_path):
    bag = write_bag(tmp_path / "other", {}, [(1, "/chatter", "std_msgs/msg/String", {"data": "x"})])
    with pytest.raises(
        InputError, match=r"neither topics of MAVROS nor px4_msgs, and needs --map .*: it holds /chatter"
    ):
        run_import(bag, tmp_path / "bag")


def test_a_recording_of_ours_is_not_made_poorer_without_a_word(tmp_path):
    """Its IMU and GPS have names that MAVROS has, too: vanes and surfaces are left out."""
    stamp = UNIX * 10**9 + np.arange(100) * 10**7
    with RecordingWriter(tmp_path / "flight") as writer:
        writer.write("imu/data", TOPICS["imu/data"], stamp, {})
        writer.write("control_surfaces", TOPICS["control_surfaces"], stamp, {"elevator": np.zeros(100)})
    report, _ = run_import(tmp_path / "flight", tmp_path / "bag")
    assert any("a recording with our topics: check, replay and explain take it as it is" in n for n in report["notes"])


def test_the_recording_does_not_go_onto_the_log(tmp_path):
    bag = write_bag(tmp_path / "px4", PX4_TYPES, px4_messages(boot=False)[:50])
    with pytest.raises(InputError, match="must not be the log itself"):
        run_import(bag, bag)
    mat = tmp_path / "flight.mat"
    mat.write_bytes(b"x")
    with pytest.raises(InputError, match="needs none"):
        run_import(mat, tmp_path / "bag", tmp_path / "c.yaml")


def test_a_stamp_of_zero_moves_neither_the_begin_of_a_log_nor_its_sweeps(tmp_path):
    """It began in 1970, and the segments 56 years after it."""
    stamp = UNIX * 10**9 + np.round(TIME * 1e9).astype(np.int64)
    stamp[0] = 0
    imu = ImportedTopic("imu/data", stamp, imu_fields(FORCE, RATES), "IMU")
    sweeps = [Span("roll", int(stamp[51]), int(stamp[101]))]
    report = write_log(ImportedLog("a log", [imu], {}, manoeuvres=sweeps), "flight.bin", tmp_path / "bag")
    assert report["start"].startswith("2025-10-09") and report["duration"] == pytest.approx(TIME[-1] - TIME[1])
    assert report["topics"]["imu/data"]["rate"] == pytest.approx(RATE, rel=0.01)
    (segment,) = read_segments(str(tmp_path / "bag.segments.yaml"), [tmp_path / "bag"])
    assert (segment.start, segment.stop) == (1.0, 2.0)


def test_a_sweep_has_three_seconds_around_it():
    """Of a length of 70 s one was stopped after 20 s; a sample from after a pause belongs to no sweep."""
    second = 1_000_000
    settings = {"TimeUS": np.array([100, 300]) * second, "Ax": np.array([8, 99]), "TR": np.array([70.0, np.nan])}
    times = {"TimeUS": np.append(np.arange(100 * second, 120 * second + 1, 20_000), 200 * second)}
    one, two = injections({"SIDS": settings, "SIDD": times}, start=10**18)
    assert (one.name, two.name) == ("sweep 1 rate pitch", "sweep 2 axis 99")
    assert [(s.begin - 10**18) / 1e9 for s in (one, two)] == [97.0, 297.0]
    assert [(s.end - 10**18) / 1e9 for s in (one, two)] == [123.0, 303.0]
    assert injections({"SIDD": times}, 0) == []
