"""Bags whose topics have other names and types than ours, of ROS 2 and of ROS 1: imported by a MAP of their topics."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from autopilot_log_files import write_bag
from flown_columns import flown_columns
from rosbags.convert.converter import convert
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from aircraft_sysid_ros.after_flight.explanation.explain import ExplainOptions, _recording
from aircraft_sysid_ros.after_flight.log_import import guess_columns, import_log
from aircraft_sysid_ros.aircraft.frames import quaternion_from_euler
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.recordings.tabular import bag_tables
from aircraft_sysid_ros.recordings.tabular.source import open_source
from aircraft_sysid_ros.samples import Kind

START = 1_700_000_000_000_000_000
DEGREES = 180.0 / np.pi
PROBE = "std_msgs/Header header\nfloat64 alpha_deg\nfloat64 beta_deg\n"
VFR_HUD = (
    "std_msgs/Header header\nfloat32 airspeed\nfloat32 groundspeed\nint16 heading\nfloat32 throttle\n"
    "float32 altitude\nfloat32 climb\n"
)


@pytest.fixture(scope="module")
def flown():
    return flown_columns()


def _vector(x, y, z):
    return {"x": float(x), "y": float(y), "z": float(z)}


def _stamped(stamp):
    return {"header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}}


def _messages(flown):
    """What drivers write: an IMU (FLU, ENU), a receiver, a pitot tube without a header, and a probe of its own type."""
    turned = np.array([1.0, -1.0, -1.0])
    for i in range(0, len(flown["time"]), 2):
        stamp = START + round(flown["time"][i] * 1e9)
        force = turned * [flown[f"specific_force.{a}"][i] for a in "xyz"]
        rate = turned * [flown[f"angular_velocity.{a}"][i] for a in "xyz"]
        imu = {"linear_acceleration": _vector(*force), "angular_velocity": _vector(*rate)}
        yield stamp + 300_000, "/vn100/imu", "sensor_msgs/msg/Imu", {**_stamped(stamp), **imu}
        yield stamp + 400_000, "/imu/temperature", "std_msgs/msg/Float32", {"data": 41.0}
        yield stamp, "/pitot/airspeed_mps", "std_msgs/msg/Float32", {"data": float(flown["true_airspeed"][i])}
        angles = {"alpha_deg": DEGREES * flown["angle_of_attack"][i], "beta_deg": DEGREES * flown["sideslip"][i]}
        yield stamp + 500_000, "/boom/angles", "lab_msgs/msg/Probe", {**_stamped(stamp), **angles}
        if i % 20 == 0:
            place = {name: DEGREES * flown[name][i] for name in ("latitude", "longitude")}
            fix = {**_stamped(stamp), **place, "altitude": float(flown["altitude"][i]), "status": {"status": 0}}
            yield stamp + 800_000, "/ublox/fix", "sensor_msgs/msg/NavSatFix", fix


@pytest.fixture(scope="module")
def bag(flown, tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("bags") / "flight", {"lab_msgs/msg/Probe": PROBE}, list(_messages(flown)))


def _in_ros1(bag, path, without=()):
    """The same bag as ROS 1 writes it."""
    convert([bag], path, "", 0, None, "file", None, None, list(without), [], [], [])
    return path


@pytest.mark.parametrize("ros", [1, 2])
def test_topics_of_any_name_are_guessed_and_imported(flown, bag, tmp_path, ros):
    """Only those of MAVROS and px4_msgs could be, and of ROS 1 nothing."""
    log = bag if ros == 2 else _in_ros1(bag, tmp_path / "flight.bag")
    report = guess_columns(log, tmp_path / "map.yaml")
    signals = {line["signal"]: line for table in report["tables"] for line in table["lines"] if line["active"]}
    imu = {f"{kind}.{axis}" for kind in ("specific_force", "angular_velocity") for axis in "xyz"}
    expected = {"angle_of_attack", "sideslip", "latitude", "longitude", "altitude"}
    assert imu - {"specific_force.y"} | expected <= set(signals)
    assert signals["angular_velocity.z"]["sign"] == signals["specific_force.z"]["sign"] == -1.0
    assert "air_temperature" not in signals  # that of the instrument

    text = (tmp_path / "map.yaml").read_text()
    side = next(line for line in text.splitlines() if "specific_force.y" in line)
    text = text.replace(side, '      specific_force.y: {column: "linear_acceleration.y", unit: "m/s^2", sign: -1}')
    speed = next(line for line in text.splitlines() if "pitot/airspeed_mps" in line and "column" in line)
    (tmp_path / "map.yaml").write_text(text.replace(speed, speed.replace("indicated_airspeed", "true_airspeed")))
    import_log(log, tmp_path / "out", columns=tmp_path / "map.yaml")
    samples = read_recording(tmp_path / "out").samples
    of_imu = samples[samples.kind == Kind.IMU]
    assert of_imu.stamp[0] == START  # of the header, and not of the recorder
    np.testing.assert_allclose(of_imu.values[:, 2], flown["specific_force.z"][::2], atol=1e-6)
    np.testing.assert_allclose(of_imu.values[:, 1], flown["specific_force.y"][::2], atol=1e-6)
    np.testing.assert_allclose(of_imu.values[:, 5], flown["angular_velocity.z"][::2], atol=1e-6)
    alpha = samples[samples.kind == Kind.ANGLE_OF_ATTACK].values[:, 0]
    np.testing.assert_allclose(alpha, flown["angle_of_attack"][::2], atol=1e-6)
    np.testing.assert_allclose(
        samples[samples.kind == Kind.AIRSPEED].values[:, 0], flown["true_airspeed"][::2], atol=1e-5
    )


def test_explain_takes_a_map_of_a_bag_that_has_an_imu_by_our_name(flown, tmp_path):
    """It was refused as a recording, and without the map the flight has no air data."""
    messages = [(at, topic.replace("/vn100/imu", "/imu/data"), *rest) for at, topic, *rest in _messages(flown)]
    log = write_bag(tmp_path / "flight", {"lab_msgs/msg/Probe": PROBE}, messages)
    angle = "{column: alpha_deg, unit: deg}"
    imu = "".join(
        f"      {name}.{axis}: {{column: {column}.{axis}, unit: {unit}, sign: {1 if axis == 'x' else -1}}}\n"
        for name, column, unit in (
            ("specific_force", "linear_acceleration", "m/s^2"), ("angular_velocity", "angular_velocity", "rad/s")
        )
        for axis in "xyz"
    )  # fmt: skip
    (tmp_path / "map.yaml").write_text(
        "clock: utc\ntables:\n"
        f"  - file: imu/data\n    time: {{column: stamp, unit: ns}}\n    signals:\n{imu}"
        f"  - file: boom/angles\n    time: {{column: stamp, unit: ns}}\n    signals:\n      angle_of_attack: {angle}\n"
    )
    options = ExplainOptions(columns=str(tmp_path / "map.yaml"))
    recording, _ = _recording(log, tmp_path / "bag", options)
    assert Kind.ANGLE_OF_ATTACK in read_recording(recording).samples.kind


def test_topics_of_cameras_and_of_what_is_asked_for_are_not_the_flight(flown, bag, tmp_path):
    """They were taken where they have more messages than the aeroplane's own, and then hid what all others are."""
    attitude = "std_msgs/Header header\nfloat64 roll\nfloat64 pitch\nfloat64 yaw\n"
    types = {"lab_msgs/msg/Probe": PROBE, "lab_msgs/msg/Attitude": attitude}
    messages, rng = list(_messages(flown)), np.random.default_rng(0)
    for i, time in enumerate(flown["time"]):
        stamp = START + round(time * 1e9)
        imu = {name: _vector(*rng.normal((0.0, 0.0, 9.8), 1.0)) for name in ("linear_acceleration", "angular_velocity")}
        messages.append((stamp, "/camera/imu", "sensor_msgs/msg/Imu", {**_stamped(stamp), **imu}))
        asked = dict(zip(("roll", "pitch", "yaw"), rng.normal(0.0, 0.1, 3), strict=True))
        messages.append((stamp, "/attitude_setpoint", "lab_msgs/msg/Attitude", {**_stamped(stamp), **asked}))
        if i % 4 == 0:
            angles = {name: float(flown[f"attitude.{name}"][i]) for name in asked}
            messages.append((stamp, "/ahrs/euler", "lab_msgs/msg/Attitude", {**_stamped(stamp), **angles}))
    log = write_bag(tmp_path / "flight", types, messages)
    report = guess_columns(log, tmp_path / "map.yaml")
    taken = {line["signal"]: table["file"] for table in report["tables"] for line in table["lines"] if line["active"]}
    of_imu = {f"{kind}.{axis}" for kind in ("specific_force", "angular_velocity") for axis in "xyz"}
    assert {taken[signal] for signal in of_imu} == {"vn100/imu"}
    assert {taken[f"attitude.{name}"] for name in ("roll", "pitch", "yaw")} == {"ahrs/euler"}

    only = [message for message in messages if message[1] not in ("/ahrs/euler", "/vn100/imu")]
    report = guess_columns(write_bag(tmp_path / "without", types, only), tmp_path / "without.yaml")
    lines = [line for table in report["tables"] for line in table["lines"]]
    assert not any(line["active"] for line in lines if line["signal"].startswith(("attitude", *sorted(of_imu))))
    assert {"its topic is called as what is asked for", "its topic is called as that of another body"} <= {
        line["evidence"].split(";")[0] for line in lines
    }


def _times(log, topic):
    """Table of a topic, and its stamps and numbers."""
    (table,) = open_source(log).tables(topic)
    (content,) = table.read(list(table.columns), 1_000_000)
    return table, content.pop(table.time), content


def _speeds(tmp_path, stamps, more=()):
    """A bag of messages (log time, stamp [ns]) with a header on /probe, whose angles count them."""
    messages = [
        (log, "/probe", "lab_msgs/msg/Probe", {**_stamped(stamp), "alpha_deg": float(i)})
        for i, (log, stamp) in enumerate(stamps)
    ]
    return write_bag(tmp_path / "flight", {"lab_msgs/msg/Probe": PROBE}, [*messages, *more])


def test_stamps_that_count_from_the_start_of_a_sensor_stand_beside_those_of_the_recorder(tmp_path):
    """Their rows were of 1970 and all others of today: nothing was compared, and the import refused."""
    delay = np.random.default_rng(0).integers(2_000_000, 20_000_000, 200)
    own = 7 * 10**9 + 10_000_000 * np.arange(200)
    log = START + 10_000_000 * np.arange(200) + delay
    number = [(int(time), "/pitot/airspeed_mps", "std_msgs/msg/Float32", {"data": 20.0}) for time in log]
    bag = _speeds(tmp_path, zip(log.tolist(), own.tolist(), strict=True), number)
    table, times, _ = _times(bag, "probe")
    np.testing.assert_array_equal(times, own + (log - own).min())
    assert "count from another time" in table.said[0]
    assert _times(bag, "pitot/airspeed_mps")[0].said == []

    alone = write_bag(tmp_path / "alone", {"lab_msgs/msg/Probe": PROBE}, [
        (int(log[i]), "/probe", "lab_msgs/msg/Probe", _stamped(int(own[i]))) for i in range(200)
    ])  # fmt: skip
    np.testing.assert_array_equal(_times(alone, "probe")[1], own)


def test_messages_without_a_stamp_among_others_are_left_out_and_late_ones_stand_where_they_belong(tmp_path):
    """One of them sent a topic to 1970, and a topic of which one message is late was left out as a whole."""
    log = [START + 10_000_000 * i for i in range(100)]
    stamps = log.copy()
    stamps[0] = stamps[1] = 0
    stamps[40] -= 55_000_000
    table, times, content = _times(_speeds(tmp_path, zip(log, stamps, strict=True)), "probe")
    np.testing.assert_array_equal(times, sorted(stamps[2:]))
    assert content["alpha_deg"][32:36].tolist() == [34.0, 40.0, 35.0, 36.0]
    assert table.said == [
        "2 messages have no stamp, as others do, and are left out",
        "1 messages came late, and stand where their stamps say",
    ]


def test_a_clock_that_was_set_back_is_no_late_message(tmp_path):
    log = [START + 10_000_000 * i for i in range(100)]
    stamps = [time - 400_000_000 * (i > 50) for i, time in enumerate(log)]
    table, times, _ = _times(_speeds(tmp_path, zip(log, stamps, strict=True)), "probe")
    assert times.tolist() == stamps and table.said == []


def test_what_is_damaged_in_a_bag_or_defined_nowhere_is_said(bag, tmp_path):
    """Nobody was told: a bag that broke off was imported by its map as a whole one."""
    whole = next(bag.glob("*.mcap")).read_bytes()
    (tmp_path / "half.mcap").write_bytes(whole[: len(whole) // 2])
    report = guess_columns(tmp_path / "half.mcap", tmp_path / "map.yaml")
    expected = [note for note in read_raw(tmp_path / "half.mcap").notes if "breaks off" in note]
    assert expected and set(expected) <= set(report["notes"])
    assert set(expected) <= set(
        import_log(tmp_path / "half.mcap", tmp_path / "out", columns=tmp_path / "map.yaml")["notes"]
    )


def test_a_bag_is_read_once(bag, tmp_path, monkeypatch):
    """It was read again for every topic of the map: of ROS 1 that is a conversion of the whole each time."""
    guess_columns(bag, tmp_path / "map.yaml")
    read = []
    monkeypatch.setattr(bag_tables, "read_raw", lambda path: read.append(path) or read_raw(path))
    import_log(bag, tmp_path / "out", columns=tmp_path / "map.yaml")
    assert len(read) == 1


def test_tables_beside_a_file_of_a_bag_are_the_tables_of_their_folder(bag, tmp_path):
    """As exports lie beside what they were made of: the tables were not looked at any more."""
    (tmp_path / "a.mcap").write_bytes(next(bag.glob("*.mcap")).read_bytes())
    assert open_source(tmp_path).is_bag
    (tmp_path / "rates.csv").write_text("time,p,q\n" + "\n".join(f"{0.02 * i},0.1,0.2" for i in range(50)))
    assert [file.name for file in open_source(tmp_path).files] == ["rates.csv"]
    whole = Path(shutil.copytree(bag, tmp_path / "whole"))
    (whole / "notes.txt").write_text("calm")
    assert open_source(whole).is_bag


def test_a_topic_of_two_publishers_is_one_table_and_one_of_two_types_is_two(tmp_path):
    """Two tables had one name, so that neither could be mapped."""
    store = get_typestore(Stores.ROS2_JAZZY)
    kinds = ("std_msgs/msg/Float32", "std_msgs/msg/Float32", "std_msgs/msg/Float64")
    with Writer(tmp_path / "flight", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = ("/speed", "/speee", "/speed")
        each = [writer.add_connection(topic, kind, typestore=store) for topic, kind in zip(topics, kinds, strict=True)]
        for i in range(30):
            message = store.serialize_cdr(store.types[kinds[i % 3]](float(i)), kinds[i % 3])
            writer.write(each[i % 3], START + i, message)
    (file,) = (tmp_path / "flight").glob("*.mcap")
    file.write_bytes(file.read_bytes().replace(b"/speee", b"/speed"))
    tables = {table.name: table for table in open_source(file).tables("*")}
    assert tables.keys() == {"speed", "speed of std_msgs/msg/Float64"}
    assert tables["speed"].arrays[0].tolist() == [float(i) for i in range(30) if i % 3 != 2]


def test_a_time_that_a_message_has_of_its_own_is_not_that_of_its_table(tmp_path):
    own = "std_msgs/Header header\nfloat64 time\nfloat64 stamp\nfloat64 pitch\n"
    messages = [
        (
            START + i * 10**7,
            "/state",
            "lab_msgs/msg/Own",
            {**_stamped(START + i * 10**7), "time": 0.01 * i, "stamp": 3.0},
        )
        for i in range(100)
    ]
    bag = write_bag(tmp_path / "flight", {"lab_msgs/msg/Own": own}, messages)
    report = guess_columns(bag, tmp_path / "map.yaml")
    assert report["tables"][0]["time"]["column"] == "stamp"
    assert _times(bag, "state")[1].tolist() == [message[0] for message in messages]


def test_a_bag_of_ros_1_of_mavros_needs_no_map(flown, tmp_path):
    """As most flights with MAVROS that people share are."""
    messages = []
    for i in range(0, 1000, 2):
        stamp = START + round(flown["time"][i] * 1e9)
        q = quaternion_from_euler(*(flown[f"attitude.{name}"][i] for name in ("roll", "pitch", "yaw")))
        imu = {"orientation": dict(zip("wxyz", map(float, q), strict=True)), "linear_acceleration": _vector(0, 0, 9.8)}
        messages.append((stamp, "/mavros/imu/data", "sensor_msgs/msg/Imu", {**_stamped(stamp), **imu}))
        hud = {"airspeed": float(flown["true_airspeed"][i])}
        messages.append((stamp, "/mavros/vfr_hud", "mavros_msgs/msg/VfrHud", {**_stamped(stamp), **hud}))
    bag = write_bag(tmp_path / "two", {"mavros_msgs/msg/VfrHud": VFR_HUD}, messages)
    report = import_log(_in_ros1(bag, tmp_path / "flight.bag"), tmp_path / "out")
    assert report["format"] == "bag of MAVROS topics" and report["found"]["imu/data"]["messages"] == 500
    samples = read_recording(tmp_path / "out").samples
    assert (samples.kind == Kind.IMU).sum() == 500


def test_what_is_no_bag_of_ros_1_is_said_in_one_sentence(bag, tmp_path):
    for content in (
        b"",
        b"no bag",
        b"#ROSBAG V2.0\n" + bytes(100),
        _in_ros1(bag, tmp_path / "a.bag").read_bytes()[:5000],
    ):
        (tmp_path / "b.bag").write_bytes(content)
        with pytest.raises(InputError, match=r"b\.bag") as refused:
            import_log(tmp_path / "b.bag", tmp_path / "out")
        assert "\n" not in str(refused.value) and not (tmp_path / "out").exists()


def test_a_bag_without_a_map_says_how_one_is_begun(bag, tmp_path):
    with pytest.raises(InputError, match=r"--guess MAP\.yaml` begins: it holds .*/vn100/imu"):
        import_log(bag, tmp_path / "out")
    with pytest.raises(InputError, match=r"it holds .*/vn100/imu; `.* --guess MAP\.yaml` begins a map"):
        read_recording(bag)
