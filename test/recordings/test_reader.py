"""Reading recordings: names, order, other writers, and what is damaged."""

import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.manoeuvres import Manoeuvre, read_body
from aircraft_sysid_ros.recordings.message_types import known_types
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.recordings.tables import read_table
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS, USED_FIELDS, gps_velocity_fields, imu_fields
from aircraft_sysid_ros.samples import Kind, sound_stamps

START = 1_700_000_000_000_000_000


def write_flight(path, prefix="", n=20, **options):
    """IMU every 10 ms, GPS velocity with every fifth at the same log time."""
    stamp = START + np.arange(n) * 10_000_000
    with RecordingWriter(path, **options) as writer:
        speed = np.arange(n)[:, None] * np.array([1.0, 0.0, 0.0])
        writer.write(prefix + "imu/data", TOPICS["imu/data"], stamp, imu_fields(speed, speed), frame_id="base_link")
        writer.write(prefix + "gps/vel", TOPICS["gps/vel"], stamp[::5], gps_velocity_fields(speed[::5]))
    return path


@pytest.fixture
def flight(tmp_path):
    return write_flight(tmp_path / "flight")


@pytest.mark.parametrize("prefix", ["", "/", "/uav1/", "fleet/uav1/"])
def test_names_with_and_without_namespace(tmp_path, prefix):
    recording = read_recording(write_flight(tmp_path / "flight", prefix))
    assert recording.topics == {"imu/data": 20, "gps/vel": 4}
    assert recording.ignored == {}
    assert recording.duration == pytest.approx(0.19)
    assert recording.start == START


@pytest.mark.parametrize("other", [0, START - 5 * 24 * 3600 * 10**9])
def test_of_two_equally_large_groups_of_stamps_one_is_sound(other):
    """The middle between them was near to none: an error of NumPy."""
    stamps = np.array([other, other, START, START + 1], dtype=np.int64)
    assert sound_stamps(stamps).tolist() == [START, START + 1]


def test_a_stamp_of_zero_moves_no_time_of_the_others(tmp_path):
    """The first message of a driver had one: times counted from 1970, and no segment was long enough."""
    stamp = START + np.arange(1000) * 20_000_000
    stamp[0] = 0
    with RecordingWriter(tmp_path / "flight") as writer:
        fields = imu_fields(np.zeros((1000, 3)), np.zeros((1000, 3)))
        writer.write("imu/data", TOPICS["imu/data"], stamp, fields, log_time=START + np.arange(1000) * 20_000_000)
    (tmp_path / "segments.yaml").write_text("[{start: 2, stop: 12, name: a}]")
    (cut,) = read_body([str(tmp_path / "flight")], str(tmp_path / "segments.yaml")).manoeuvres
    assert cut.duration == pytest.approx(10.0) and cut.samples.stamp[0] == stamp[101]
    recording = read_recording(tmp_path / "flight")
    assert recording.start == stamp[1] and recording.duration == pytest.approx(19.96)
    whole = Manoeuvre(cut.segment, recording.samples)
    assert whole.duration == pytest.approx(19.96)


@pytest.mark.parametrize("before", [3600, 5 * 24 * 3600, START // 10**9])
def test_mass_properties_from_before_the_flight_hold_from_its_begin(tmp_path, before):
    """A latched message made a recording an hour long, with gaps; from days before, the run of a replay lost it."""
    stamp = START + np.arange(200) * 10_000_000
    old = START - before * 10**9 + np.array([0, 1, 0])
    with RecordingWriter(tmp_path / "flight") as writer:
        fields = imu_fields(np.zeros((200, 3)), np.zeros((200, 3)))
        writer.write("imu/data", TOPICS["imu/data"], stamp, fields, log_time=stamp + 1)
        at, mass = np.array([START, START, stamp[-1] + 2]), {"mass": np.array([2.0, 3.0, 4.0])}
        writer.write("mass_properties", TOPICS["mass_properties"], old, mass, log_time=at)
    recording = read_recording(tmp_path / "flight")
    masses = recording.samples[recording.samples.kind == Kind.MASS]
    assert masses.values[:, 0].tolist() == [2.0, 3.0, 4.0]
    assert masses.stamp[0] < masses.stamp[1] < START == pytest.approx(masses.stamp[1], abs=10)
    assert masses.stamp[2] == stamp[-1] - 10**9
    assert recording.duration == pytest.approx(1.99)


def test_only_one_aircraft_is_read(tmp_path):
    with RecordingWriter(tmp_path / "two") as writer:
        for name, count in (("/a/imu/data", 3), ("/b/imu/data", 4), ("/b/gps/vel", 2)):
            stamp = START + np.arange(count)
            fields = imu_fields(np.zeros((count, 3)), np.zeros((count, 3))) if "imu" in name else {}
            writer.write(name, TOPICS[name[3:]], stamp, fields)
    recording = read_recording(tmp_path / "two")
    assert recording.topics == {"imu/data": 4, "gps/vel": 2}
    assert recording.ignored == {"/a/imu/data": 3}
    (note,) = [note for note in recording.notes if "namespaces" in note]
    assert "under /b/ are read" in note and "under /a/ are not" in note


def test_topics_without_messages_are_no_namespace(tmp_path):
    """A sqlite3 recording lists what was only listened to: the aircraft's topics were then not read, and it was said
    that the recording has none of those that it was said to hold.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer

    raw = read_raw(write_flight(tmp_path / "flight"))
    with Writer(tmp_path / "silent", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for channel in raw.channels.values():
            writer.add_connection(channel.topic, channel.type, typestore=known_types())
        connections = {
            key: writer.add_connection(f"/uav1{channel.topic}", channel.type, typestore=known_types())
            for key, channel in raw.channels.items()
        }
        for i in range(len(raw)):
            writer.write(connections[int(raw.channel[i])], int(raw.log_time[i]), raw[i])
    recording = read_recording(tmp_path / "silent")
    assert recording.topics == {"imu/data": 20, "gps/vel": 4}
    assert not any("namespaces" in note for note in recording.notes)


def test_samples_are_in_order_of_arrival(flight):
    samples = read_recording(flight).samples
    assert (np.diff(samples.stamp) >= 0).all()
    first = samples.kind[:3]
    assert first.tolist() == [Kind.IMU, Kind.GPS_VELOCITY, Kind.IMU]
    np.testing.assert_array_equal(samples.values[samples.kind == Kind.IMU, 0], np.arange(20))


def test_order_is_by_log_time_and_the_stamp_is_kept(tmp_path):
    stamp = START + np.array([0, 10, 20])
    with RecordingWriter(tmp_path / "late") as writer:
        writer.write("gps/vel", TOPICS["gps/vel"], stamp[:1], gps_velocity_fields([[0, 0, 0]]), log_time=stamp[:1] + 15)
        fields = imu_fields(np.zeros((3, 3)), np.zeros((3, 3)))
        writer.write("imu/data", TOPICS["imu/data"], stamp, fields, log_time=stamp)
    samples = read_recording(tmp_path / "late").samples
    assert samples.kind.tolist() == [Kind.IMU, Kind.IMU, Kind.GPS_VELOCITY, Kind.IMU]
    assert samples.stamp[2] == START


def test_the_parts_of_a_message_stay_together(tmp_path):
    stamp = START + np.arange(3)
    with RecordingWriter(tmp_path / "air") as writer:
        writer.write("air_data", TOPICS["air_data"], stamp, {"true_airspeed": 15.0, "sideslip": np.arange(3.0)})
    samples = read_recording(tmp_path / "air").samples
    assert samples.kind.tolist() == [Kind.AIRSPEED, Kind.SIDESLIP] * 3
    np.testing.assert_array_equal(samples.values[1::2, 0], np.arange(3))


def test_sqlite3_mcap_and_compression_say_the_same(flight, tmp_path):
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    expected = read_recording(flight)
    raw = read_raw(flight)
    for mode in (
        CompressionMode.NONE,
        CompressionMode.MESSAGE,
        CompressionMode.FILE,
        CompressionMode.STORAGE,
    ):
        for plugin in StoragePlugin:
            if mode == CompressionMode.STORAGE and plugin == StoragePlugin.SQLITE3:
                continue
            path = tmp_path / f"{plugin.name}-{mode.name}"
            writer = Writer(path, version=9, storage_plugin=plugin)
            writer.set_compression(mode, CompressionFormat.ZSTD)
            with writer:
                connections = {
                    key: writer.add_connection(channel.topic, channel.type, typestore=known_types())
                    for key, channel in raw.channels.items()
                }
                for i in range(len(raw)):
                    writer.write(connections[int(raw.channel[i])], int(raw.log_time[i]), raw[i])
            found = read_recording(path)
            assert found.topics == expected.topics
            assert found.samples.values.tobytes() == expected.samples.values.tobytes(), path.name
            np.testing.assert_array_equal(found.samples.stamp, expected.samples.stamp)


def test_bare_files_are_read(flight, tmp_path):
    expected = read_recording(flight).samples.values.tobytes()
    file = next(flight.glob("*.mcap"))
    assert read_recording(file).samples.values.tobytes() == expected
    folder = tmp_path / "died"
    folder.mkdir()
    shutil.copy(file, folder)
    recording = read_recording(folder)
    assert recording.samples.values.tobytes() == expected
    assert "metadata.yaml" in recording.notes[0]


def test_split_recordings_are_joined(tmp_path):
    parts = [write_flight(tmp_path / f"part{i}", n=10) for i in range(2)]
    folder = tmp_path / "split"
    folder.mkdir()
    for i, part in enumerate(parts):
        shutil.copy(next(part.glob("*.mcap")), folder / f"split_{i}.mcap")
    text = (parts[0] / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace("  - part0.mcap\n", "  - split_0.mcap\n  - split_1.mcap\n"))
    recording = read_recording(folder)
    assert recording.topics == {"imu/data": 20, "gps/vel": 4}
    assert (np.diff(recording.samples.stamp) >= 0).all()


def test_other_topics_are_listed_and_other_types_are_noted(tmp_path):
    with RecordingWriter(tmp_path / "mixed") as writer:
        writer.write("imu/data", "geometry_msgs/msg/TwistStamped", START, {})
        writer.write("gps/vel", TOPICS["gps/vel"], START, {})
        writer.write("camera/info", "geometry_msgs/msg/TwistStamped", [START, START], {})
    recording = read_recording(tmp_path / "mixed")
    assert recording.topics == {"gps/vel": 1}
    assert recording.ignored == {"/imu/data": 1, "/camera/info": 2}
    assert any("/imu/data" in note and "TwistStamped" in note for note in recording.notes)


def test_require_names_what_is_missing_and_what_is_there(flight):
    recording = read_recording(flight)
    recording.require(["imu/data", "gps/vel"])
    with pytest.raises(InputError, match=r"lacks /gps/fix, /air_data.*/imu/data, /gps/vel"):
        recording.require(["imu/data", "gps/fix", "air_data"])


def test_a_recording_of_something_else(tmp_path):
    with RecordingWriter(tmp_path / "other") as writer:
        writer.write("camera/info", "geometry_msgs/msg/TwistStamped", START, {})
    with pytest.raises(InputError, match=r"none of the topics /imu/data.*it holds /camera/info"):
        read_recording(tmp_path / "other")


def test_older_message_without_a_field_is_an_input_error(tmp_path):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    name = TOPICS["air_data"]
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("std_msgs/Header header\nfloat64 true_airspeed\n", name))
    header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](1, 0), "air")
    with Writer(tmp_path / "old", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/air_data", name, typestore=store)
        writer.write(connection, START, store.serialize_cdr(store.types[name](header, 15.0), name))
    with pytest.raises(InputError, match="another aircraft_sysid_msgs/msg/AirData on /air_data"):
        read_recording(tmp_path / "old")


def test_definition_of_the_recording_goes_before_ours(tmp_path):
    """A later version with one more field in front is read by its own definition."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    name = TOPICS["five_hole_probe"]
    text = "std_msgs/Header header\nfloat64 extra\n" + "".join(f"float64 {f}\n" for f in USED_FIELDS["five_hole_probe"])
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(text, name))
    header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](1, 0), "air")
    with Writer(tmp_path / "new", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/five_hole_probe", name, typestore=store)
        message = store.types[name](header, -1.0, 1.0, 2.0, 3.0, 4.0)
        writer.write(connection, START, store.serialize_cdr(message, name))
    samples = read_recording(tmp_path / "new").samples
    np.testing.assert_array_equal(samples.values[0, :4], [1.0, 2.0, 3.0, 4.0])


def test_heights_of_a_humble_recording_without_definitions_are_read(tmp_path):
    """Range had no variance then, and sqlite3 no definitions: none of its messages could be decoded."""
    import sqlite3
    from contextlib import closing

    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    name, store, stamp = TOPICS["height_above_ground"], get_typestore(Stores.ROS2_HUMBLE), START // 10**9
    time, header, kind = (
        store.types[t] for t in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header", "sensor_msgs/msg/Range")
    )
    with Writer(tmp_path / "humble", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/height_above_ground", name, typestore=store)
        for k in range(3):
            message = kind(header(time(stamp + k, 0), "base_link"), 1, 0.1, 0.2, 50.0, 10.0 + k)
            writer.write(connection, START + k * 10**9, store.serialize_cdr(message, name))
    with closing(sqlite3.connect(next((tmp_path / "humble").glob("*.db3")))) as database:
        database.execute("DELETE FROM message_definitions")
        database.commit()
    recording = read_recording(tmp_path / "humble")
    assert recording.samples.kind.tolist() == [Kind.HEIGHT] * 3
    np.testing.assert_array_equal(recording.samples.values[:, 0], [10.0, 11.0, 12.0])
    assert recording.skipped == {} and not any("decoded" in note for note in recording.notes)


def velocity_message(second, numbers):
    """A gps/vel message as other writers encode it, without a frame."""
    return struct.pack("<BBBBiIIBxxx6d", 0, 1, 0, 0, second, 0, 1, 0, *numbers)


def truncated(flight: Path, tmp_path: Path, size: int) -> Path:
    file = tmp_path / "cut.mcap"
    file.write_bytes(next(flight.glob("*.mcap")).read_bytes()[:size])
    return file


def test_a_recorder_that_died_leaves_what_it_wrote(tmp_path):
    """Every cut gives a prefix of the flight, and longer files never give less."""
    flight = write_flight(tmp_path / "flight")
    whole = read_recording(flight).samples
    size = next(flight.glob("*.mcap")).stat().st_size
    lengths = []
    for cut in range(0, size, 211):
        try:
            recording = read_recording(truncated(flight, tmp_path, cut))
        except InputError as error:
            assert "\n" not in str(error)
            lengths.append(0)
            continue
        n = len(recording.samples)
        assert recording.samples.values.tobytes() == whole.values[:n].tobytes()
        if n < len(whole):
            assert "breaks off" in recording.notes[0]
        lengths.append(n)
    assert lengths == sorted(lengths)
    assert lengths[0] == 0
    assert len(set(lengths)) > 5, "the chunk that was being written is read as far as it goes"
    assert lengths[-1] == len(whole)


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + bytes(100), bytes(4096)])
@pytest.mark.parametrize("suffix", [".mcap", ".db3", ".txt"])
def test_what_is_no_recording(tmp_path, suffix, content):
    file = tmp_path / f"thing{suffix}"
    file.write_bytes(content)
    with pytest.raises(InputError) as error:
        read_recording(file)
    assert "\n" not in str(error.value)
    assert "thing" in str(error.value)


def test_folders_that_are_no_recording(tmp_path, flight):
    with pytest.raises(InputError, match="there is no recording"):
        read_recording(tmp_path / "nowhere")
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match=r"metadata\.yaml is missing"):
        read_recording(empty)
    (empty / "metadata.yaml").write_text("{: not yaml")
    with pytest.raises(InputError, match="damaged"):
        read_recording(empty)
    next(flight.glob("*.mcap")).unlink()
    with pytest.raises(InputError, match=r"flight\.mcap is missing"):
        read_recording(flight)


def test_a_damaged_chunk_is_left_out_and_noted(tmp_path):
    from mcap.writer import CompressionType, Writer

    file = tmp_path / "damaged.mcap"
    definition = known_types().generate_msgdef(TOPICS["gps/vel"], ros_version=2)[0].encode()
    content = velocity_message(0, np.random.default_rng(0).normal(size=6))
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=1000, compression=CompressionType.NONE)
        writer.start("ros2", "test")
        schema = writer.register_schema(TOPICS["gps/vel"], "ros2msg", definition)
        channel = writer.register_channel("/gps/vel", "cdr", schema)
        for i in range(100):
            writer.add_message(channel, START + i, content, START + i)
        writer.finish()
    data = bytearray(file.read_bytes())
    assert len(read_recording(file).samples) == 100
    at = data.index(content, len(data) // 3) + 40
    data[at] ^= 0xFF
    file.write_bytes(data)
    recording = read_recording(file)
    assert 80 <= len(recording.samples) < 100
    assert "checksum" in recording.notes[0]


@pytest.mark.parametrize("name", ["NONE", "LZ4", "ZSTD"])
def test_chunks_of_other_writers(tmp_path, name):
    from mcap.writer import CompressionType, Writer

    file = tmp_path / "other.mcap"
    type_name = TOPICS["gps/vel"]
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=2000, compression=CompressionType[name])
        writer.start("ros2", "test")
        schema = writer.register_schema(
            type_name, "ros2msg", known_types().generate_msgdef(type_name, ros_version=2)[0].encode()
        )
        channel = writer.register_channel("/gps/vel", "cdr", schema)
        for i in range(50):
            writer.add_message(channel, START + i, velocity_message(i, (i, 0, 0, 0, 0, 0)), START + i)
        writer.finish()
    samples = read_recording(file).samples
    np.testing.assert_array_equal(samples.values[:, 1], np.arange(50))  # east
    np.testing.assert_array_equal(samples.stamp, np.arange(50) * 1_000_000_000)


def test_read_table_gives_every_field(flight):
    table = read_table(flight, "gps/vel")
    assert table.fields["twist.angular"].shape == (4, 3)
    np.testing.assert_array_equal(table.fields["twist.linear"][:, 1], [0, 5, 10, 15])  # north
    with pytest.raises(InputError, match="no messages of nothing"):
        read_table(flight, "nothing")
