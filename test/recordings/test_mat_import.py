"""Imported real flights: checked against the .mat file and against physics, not against our output."""

import argparse
import json
import struct
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.sparse import csc_matrix

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.commands import import_log
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.mat_file import read_mat
from aircraft_sysid_ros.recordings.mat_import import import_mat
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.tables import read_table
from aircraft_sysid_ros.recordings.umn_mat import air_data
from aircraft_sysid_ros.samples import Kind

REPOSITORY = Path(__file__).resolve().parents[2]
DATA = REPOSITORY.parent / "shared" / "data"
THOR = DATA / "umn_thor_flight75" / "flight75.mat"
TESTLOG = DATA / "inertialnav" / "TestLog2.mat"
SWISS = DATA / "inertialnav" / "SwissLog1.mat"
needs_data = pytest.mark.skipif(not THOR.exists() or not TESTLOG.exists(), reason="the real flights are not here")


def imported(path, folder):
    out = folder / path.stem
    report = import_mat(path, out)
    return report, out, read_recording(out)


@pytest.fixture(scope="module")
def thor(tmp_path_factory):
    data = loadmat(THOR, squeeze_me=True, struct_as_record=False)["flight_data"]
    return data, *imported(THOR, tmp_path_factory.mktemp("thor"))


@pytest.fixture(scope="module")
def testlog(tmp_path_factory):
    data = loadmat(TESTLOG, squeeze_me=True)
    return data, *imported(TESTLOG, tmp_path_factory.mktemp("testlog"))


@pytest.fixture(scope="module")
def swiss(tmp_path_factory):
    data = loadmat(SWISS, squeeze_me=True)
    return data, *imported(SWISS, tmp_path_factory.mktemp("swiss"))


def of_kind(recording, kind):
    return recording.samples[recording.samples.kind == kind]


def in_air(data):
    return (data.time > 240.0) & (data.time < 530.0)


@needs_data
class TestThor:
    def test_imu_is_the_recorded_one_in_frd(self, thor):
        data, _, _, recording = thor
        imu = of_kind(recording, Kind.IMU)
        works = data.imuStatus > 0
        names = ("ax", "ay", "az", "p", "q", "r")  # recorded less the onboard estimates of their biases
        given = [getattr(data, name) + getattr(data, f"{name}_bias") for name in names]
        np.testing.assert_array_equal(imu.values[:, :6], np.stack(given, axis=1)[works])
        at_rest = np.median(imu.values[:2000, :3], axis=0)  # nose up on its wheels
        assert np.linalg.norm(at_rest) == pytest.approx(9.81, abs=0.15)
        assert at_rest[2] < -9.0

    def test_the_onboard_attitude_is_no_input(self, thor):
        assert not len(of_kind(thor[3], Kind.ATTITUDE))

    def test_stamps_are_the_time_of_the_recorder_from_the_day_of_the_flight(self, thor):
        data, report, _, recording = thor
        imu = of_kind(recording, Kind.IMU)
        np.testing.assert_allclose(np.diff(imu.stamp) * 1e-9, np.diff(data.time[data.imuStatus > 0]), atol=2e-9)
        assert report["start"].startswith("2012-10-10T16:")  # 11:57 in Minnesota is when the file was written

    def test_stamps_agree_with_gps_time(self, thor):
        """Time of week modulo a day is the time of day, up to 16 leap seconds."""
        data, _, _, recording = thor
        stamp = of_kind(recording, Kind.GPS_POSITION).stamp * 1e-9
        new = np.flatnonzero(np.diff(data.GPS_TOW) != 0) + 1
        difference = (data.GPS_TOW[new] - stamp) % 86400
        assert np.median(difference) == pytest.approx(16.0, abs=0.01)

    def test_only_new_and_valid_fixes(self, thor):
        data, report, _, recording = thor
        fixes = of_kind(recording, Kind.GPS_POSITION)
        assert len(fixes) == len(np.unique(data.GPS_TOW[data.GPS_TOW > 0]))
        np.testing.assert_allclose(np.degrees(fixes.values[:, 0]), 45.33, atol=0.02)
        np.testing.assert_allclose(np.degrees(fixes.values[:, 1]), -93.23, atol=0.02)
        assert report["topics"]["gps/fix"]["rate"] == pytest.approx(1.0, abs=0.01)
        assert len(of_kind(recording, Kind.GPS_VELOCITY)) == len(fixes)

    def test_gps_velocity_is_the_derivative_of_the_position(self, thor):
        recording = thor[3]
        fix, velocity = of_kind(recording, Kind.GPS_POSITION), of_kind(recording, Kind.GPS_VELOCITY)
        time = fix.stamp * 1e-9
        north = np.gradient(fix.values[:, 0] * 6.37e6, time)
        east = np.gradient(fix.values[:, 1] * 6.37e6 * np.cos(np.radians(45.33)), time)
        down = -np.gradient(fix.values[:, 2], time)
        for found, recorded, least in zip((north, east, down), velocity.values.T, (0.97, 0.97, 0.9), strict=False):
            assert np.corrcoef(found, recorded)[0, 1] > least

    def test_airspeed_agrees_with_the_onboard_one(self, thor):
        data, _, out, _ = thor
        air = read_table(out, "air_data").fields
        k = in_air(data)
        equivalent = air["true_airspeed"] * np.sqrt(air["air_density"] / 1.225)
        assert np.abs(equivalent - data.ias)[k].max() < 0.1
        assert np.median(air["true_airspeed"][data.time < 200]) < 1.0, "the zero of Pd alone is 5.9 m/s"
        ratio = air["true_airspeed"][k] / data.ias[k]
        assert 1.01 < np.median(ratio) < 1.03  # 300 m above the sea

    def test_angles_are_those_of_the_firmware_without_its_lever_arms(self, thor):
        """aoa and aos are carried to the centre of gravity with q, p and r over V; ours are at the probe."""
        data, _, out, _ = thor
        air = read_table(out, "air_data").fields
        k = in_air(data) & (data.ias > 12.0)
        speed = np.where(k, data.ias, np.nan)
        carried = air["angle_of_attack"] + (0.18 * data.q - 0.36 * data.p) / speed
        assert np.abs(carried - data.aoa)[k].max() < np.radians(0.3)
        carried = air["sideslip"] - 0.18 * data.r / speed
        assert np.abs(carried - data.aos)[k].max() < np.radians(0.6)
        assert np.abs(air["angle_of_attack"] - data.aoa)[k].max() > np.radians(2.0), "the arms matter"

    def test_angles_without_flow_are_not_measured(self, thor):
        data, _, out, recording = thor
        air = read_table(out, "air_data").fields
        assert np.isnan(air["angle_of_attack"][data.time < 200]).all()
        assert np.isfinite(air["angle_of_attack"][in_air(data)]).all()
        assert len(of_kind(recording, Kind.ANGLE_OF_ATTACK)) < len(of_kind(recording, Kind.AIRSPEED))

    def test_probe_pressures_are_raw_in_pascal(self, thor):
        data, _, _, recording = thor
        probe = of_kind(recording, Kind.FIVE_HOLE).values[:, :4]
        expected = 1000.0 * np.stack([data.Ps, data.Pd, data.Pd_aoa, data.Pd_aos], axis=1).astype(float)
        np.testing.assert_allclose(probe, expected, rtol=1e-12)

    def test_surfaces_are_there_only_under_autopilot(self, thor):
        data, _, _, recording = thor
        controls = of_kind(recording, Kind.CONTROLS).values[:, :7]
        autopilot = data.mode == 2
        assert np.isnan(controls[~autopilot]).all()
        assert np.isfinite(controls[autopilot][:, [0, 1, 2, 4]]).all()
        assert np.isnan(controls[:, [3, 5, 6]]).all()
        np.testing.assert_array_equal(controls[autopilot, 1], data.da_r[autopilot])  # da_l = -da_r

    def test_positive_aileron_rolls_left(self, thor):
        """Clda of the model is negative: where the aileron is most positive, roll accelerates to the left."""
        data, _, _, recording = thor
        aileron = of_kind(recording, Kind.CONTROLS).values[:, 1]
        servo_delay = 3  # rows
        acceleration = np.roll(np.gradient(data.p, data.time), -servo_delay)
        k = in_air(data)
        fit = np.linalg.lstsq(
            np.stack([aileron, data.p, np.ones(len(aileron))], axis=1)[k], acceleration[k], rcond=None
        )
        assert fit[0][0] < 0.0
        elevator = of_kind(recording, Kind.CONTROLS).values[:, 0]
        pitching = np.roll(np.gradient(data.q, data.time), -servo_delay)
        regressors = np.stack([elevator, data.q, data.aoa, np.ones(len(elevator))], axis=1)[k]
        assert np.linalg.lstsq(regressors, pitching[k], rcond=None)[0][0] < 0.0

    def test_magnetic_heading_is_the_onboard_one(self, thor):
        data, _, _, recording = thor
        field = of_kind(recording, Kind.MAGNETIC_FIELD).values[:, :3]
        assert 4e-5 < np.median(np.linalg.norm(field, axis=1)) < 6.5e-5  # tesla
        rows = np.flatnonzero((data.hx != 0) | (data.hy != 0) | (data.hz != 0))
        k = in_air(data)[rows]
        field, roll, pitch, yaw = field[k], data.phi[rows][k], data.theta[rows][k], data.psi[rows][k]
        forward = field[:, 0] * np.cos(pitch) + np.sin(pitch) * (
            field[:, 1] * np.sin(roll) + field[:, 2] * np.cos(roll)
        )
        right = field[:, 1] * np.cos(roll) - field[:, 2] * np.sin(roll)
        difference = np.angle(np.exp(1j * (np.arctan2(-right, forward) - yaw)))
        assert abs(np.median(difference)) < np.radians(5)
        assert difference.std() < np.radians(8)
        assert field[:, 2].mean() > 0.0, "down in the northern hemisphere"

    def test_aircraft_file_fits(self):
        aircraft = load_aircraft(REPOSITORY / "config" / "umn_thor.yaml")
        np.testing.assert_allclose(aircraft.air_data_position, [0.18, 0.36, 0.0], atol=0.005)
        assert aircraft.mass == 1.959


def test_air_data_of_the_standard_atmosphere():
    """15 m/s true at 500 m, no angle: pressures of the standard atmosphere give it back."""
    pressure, density = 95461.0, 1.1673
    q = np.array([0.5 * density * 15.0**2, 1.0])
    found = air_data(np.full(2, pressure), q, np.zeros(2), 0.068 * 2.0 * q)
    assert found["air_density"][0] == pytest.approx(density, rel=1e-4)
    assert found["true_airspeed"][0] == pytest.approx(15.0, rel=1e-4)
    assert np.degrees(found["angle_of_attack"][0]) == pytest.approx(3.5 + 0.5297)
    assert np.degrees(found["sideslip"][0]) == pytest.approx(2.0)
    assert np.isnan(found["angle_of_attack"][1])


@needs_data
class TestInertialNav:
    def test_testlog_time_is_gps_time(self, testlog):
        data, report, _, recording = testlog
        gps = data["GPS"]
        stamp = of_kind(recording, Kind.GPS_POSITION).stamp * 1e-9
        unix = 315_964_800 + 604_800 * gps[:, 3] + gps[:, 2] / 1000 - 16
        settled = stamp > stamp[0] + 60.0
        expected = unix[np.diff(gps[:, 2], prepend=-1) != 0]
        np.testing.assert_allclose(stamp[settled], expected[settled], atol=0.003)
        assert report["start"].startswith("2013-11-29T")

    def test_testlog_has_each_fix_once(self, testlog):
        data, _, _, recording = testlog
        assert len(of_kind(recording, Kind.GPS_POSITION)) == len(np.unique(data["GPS"][:, 2]))

    def test_testlog_velocity_agrees_with_speed_and_altitude(self, testlog):
        recording = testlog[3]
        fix, velocity = of_kind(recording, Kind.GPS_POSITION), of_kind(recording, Kind.GPS_VELOCITY)
        assert np.corrcoef(np.gradient(fix.values[:, 2], fix.stamp * 1e-9), -velocity.values[:, 2])[0, 1] > 0.95
        north = np.gradient(fix.values[:, 0], fix.stamp * 1e-9)
        assert np.corrcoef(north, velocity.values[:, 0])[0, 1] > 0.95

    def test_testlog_airspeed_is_true(self, testlog):
        data, _, _, recording = testlog
        airspeed = of_kind(recording, Kind.AIRSPEED).values[:, 0]
        logged = data["NTUN"][:, 7]
        ratio = airspeed[logged > 5] / logged[logged > 5]
        assert (ratio > 1.0).all()  # 21 degrees Celsius at sea level and up: thinner than standard
        assert (ratio < 1.02).all()

    def test_testlog_magnetic_heading_at_rest(self, testlog):
        """With the declination of the aircraft file it is the autopilot's yaw."""
        data, _, _, recording = testlog
        mag = data["MAG"]
        rest = (mag[:, 1] > 100e3) & (mag[:, 1] < 150e3)
        field = np.median(of_kind(recording, Kind.MAGNETIC_FIELD).values[rest, :3], axis=0)
        declination = load_aircraft(REPOSITORY / "config" / "inertialnav_testlog2.yaml").magnetic_declination
        heading = np.degrees(np.arctan2(-field[1], field[0]) + declination)
        attitude = data["ATT"]
        yaw = np.median(attitude[(attitude[:, 1] > 100e3) & (attitude[:, 1] < 150e3), 4])
        assert abs((heading - yaw + 180) % 360 - 180) < 3.0
        assert field[2] < 0.0, "up in the southern hemisphere"

    def test_testlog_has_a_throttle_and_no_surfaces(self, testlog):
        controls = of_kind(testlog[3], Kind.CONTROLS).values[:, :7]
        assert np.isnan(controls[:, [0, 1, 2, 3, 5, 6]]).all()
        assert controls[:, 4].min() == 0.0
        assert controls[:, 4].max() == 1.0

    def test_swiss_course_is_in_radians(self, swiss):
        recording = swiss[3]
        fix, velocity = of_kind(recording, Kind.GPS_POSITION), of_kind(recording, Kind.GPS_VELOCITY)
        time = fix.stamp * 1e-9
        for axis in (0, 1):
            assert np.corrcoef(np.gradient(fix.values[:, axis], time), velocity.values[:, axis])[0, 1] > 0.98

    def test_swiss_imu_and_airspeed(self, swiss):
        data, _, _, recording = swiss
        imu = of_kind(recording, Kind.IMU).values
        np.testing.assert_array_equal(imu[:, :3], data["accel"])
        np.testing.assert_array_equal(imu[:, 3:6], data["angRate"])
        airspeed = of_kind(recording, Kind.AIRSPEED).values[:, 0]
        flying = data["Veas"] > 5
        np.testing.assert_allclose(airspeed[flying] / data["Veas"][flying], 1.022, atol=0.003)

    @pytest.mark.parametrize("name", ["inertialnav_testlog2", "inertialnav_swisslog"])
    def test_aircraft_files_say_that_the_mass_is_made_up(self, name):
        text = (REPOSITORY / "config" / f"{name}.yaml").read_text()
        assert text.count("placeholder") >= 5
        sensors = load_aircraft(REPOSITORY / "config" / f"{name}.yaml").sensors
        assert sensors["airspeed"].delay == 0.21
        assert sensors["gps_position"].delay == 0.21
        assert sensors["gps_velocity"].delay == pytest.approx(0.23, abs=0.02)


@needs_data
def test_report_is_json_and_readable(thor):
    report = thor[1]
    assert json.loads(json.dumps(report)) == report
    assert report["duration"] == pytest.approx(696.2, abs=0.1)
    text = import_log.render(report)
    for topic, count in thor[3].topics.items():
        assert f"/{topic}" in text
        assert report["topics"][topic]["messages"] == count
    assert "missing" in text


@needs_data
def test_the_command_overwrites_only_when_told(tmp_path):
    def run(*, overwrite):
        return import_log.run(
            argparse.Namespace(
                log=str(SWISS), out=str(tmp_path / "bag"), overwrite=overwrite, map=None, guess=None, servos=None
            )
        )

    assert run(overwrite=False)["topics"]["gps/vel"]["messages"] == 502
    with pytest.raises(InputError, match="already there"):
        run(overwrite=False)
    run(overwrite=True)


@pytest.mark.parametrize("name", ["flight.csv", "flight.log", "flight", "nowhere.mat"])
def test_other_files_are_an_input_error(tmp_path, name):
    if not name.startswith("nowhere"):
        (tmp_path / name).write_bytes(b"ULog")
    with pytest.raises(InputError) as error:
        import_log.run(
            argparse.Namespace(
                log=str(tmp_path / name),
                out=str(tmp_path / "bag"),
                overwrite=False,
                map=None,
                guess=None,
                servos=None,
            )
        )
    assert name in str(error.value)
    if not name.startswith("nowhere"):
        assert ".mat" in str(error.value)
    assert not (tmp_path / "bag").exists()


@pytest.mark.parametrize("content", [b"", b"hello", b"MATLAB 5.0 MAT-file" + bytes(200)])
def test_damaged_mat_files(tmp_path, content):
    file = tmp_path / "damaged.mat"
    file.write_bytes(content)
    with pytest.raises(InputError) as error:
        import_mat(file, tmp_path / "bag")
    assert "\n" not in str(error.value)


def test_other_mat_files_say_what_they_hold(tmp_path):
    savemat(tmp_path / "other.mat", {"banana": np.arange(3)})
    with pytest.raises(InputError, match=r"flight_data.*banana"):
        import_mat(tmp_path / "other.mat", tmp_path / "bag")


@pytest.mark.parametrize(
    "content",
    [
        {"flight_data": {"time": np.arange(3.0)}},
        {"flight_data": 3.0},
        {name: np.arange(3.0) for name in ("angRate", "accel", "IMUtime", "GPStime", "LatDeg", "Veas")},
    ],
)
def test_known_kind_without_its_channels(tmp_path, content):
    savemat(tmp_path / "poor.mat", content)
    with pytest.raises(InputError, match="poor"):
        import_mat(tmp_path / "poor.mat", tmp_path / "bag")


def saved_with_wrong_bit(path, place, bit):
    """A small MAT 5 file in which one bit is the other one."""
    channel = {"data": np.arange(5), "units": "deg"}
    structure = {"a": np.arange(20.0), "b": channel, "c": np.array(["x", "yy"], dtype=object)}
    others = {"m": np.eye(3), "s": "text", "cx": np.array([1 + 2j]), "sp": csc_matrix(np.eye(3))}
    savemat(path, {"flight_data": structure, **others}, do_compression=False)
    content = bytearray(path.read_bytes())
    content[place] ^= bit
    path.write_bytes(content)


@pytest.mark.long
def test_a_wrong_bit_on_which_scipy_crashes_is_a_sentence(tmp_path):
    said = []
    for place, bit in ((817, 64), (760, 16), (1001, 1), (756, 4), (740, 8), (561, 1)):
        saved_with_wrong_bit(tmp_path / "wrong.mat", place, bit)
        with suppress(InputError):
            read_mat(tmp_path / "wrong.mat")
            continue
        with pytest.raises(InputError) as raised:
            import_mat(tmp_path / "wrong.mat", tmp_path / "bag")
        said.append(str(raised.value))
    assert any("scipy, which reads .mat files, crashed on it" in sentence for sentence in said)
    assert all(str(tmp_path) in sentence for sentence in said) and not (tmp_path / "bag").exists()


def test_a_mat_file_that_announces_gigabytes_is_refused(tmp_path):
    """A few kilobytes of zlib that say they are 2 GB of zeros."""
    tag, packer = struct.pack("<II", 14, 2**31 - 8), zlib.compressobj(9)
    packed = b"".join([packer.compress(tag), *(packer.compress(bytes(1 << 20)) for _ in range(5)), packer.flush()])
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<HH", 0x0100, 0x4D49)
    (tmp_path / "bomb.mat").write_bytes(header + struct.pack("<II", 15, len(packed)) + packed)
    with pytest.raises(InputError, match=r"is not a readable \.mat file|crashed on it"):
        import_mat(tmp_path / "bomb.mat", tmp_path / "bag")
