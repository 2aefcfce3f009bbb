"""Written recordings: read back by rosbags and by mcap without our help, complete or not at all."""

import resource

import numpy as np
import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.tables import read_table
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS

START = 1_700_000_000_000_000_000
STATE = "aircraft_sysid_msgs/msg/AircraftState"


def write_all(path):
    stamp = START + np.arange(5) * 20_000_000
    with RecordingWriter(path) as writer:
        writer.write("air_data", TOPICS["air_data"], stamp, {"true_airspeed": np.arange(5.0)}, frame_id="probe")
        writer.write(
            "state_estimator/state",
            STATE,
            stamp + 1,
            {
                "status": np.array([0, 1, 1, 2, 1], np.uint8),
                "status_text": np.array(["waiting", "", "", "without GPS", ""]),
                "attitude": np.tile([1.0, 0, 0, 0], (5, 1)),
                "wind_ned": np.arange(15.0).reshape(5, 3),
                "fused": np.arange(5),
            },
        )
        parameters = [
            {"name": "CZ_alpha", "value": -4.5, "status": 1},
            {"name": "Cm_q", "reason": "no excitation"},
        ]
        message = {
            "header": {"stamp": START + 7},
            "model": "m1",
            "parameters": parameters,
            "covariance": np.eye(2),
        }
        writer.write_message("~/parameters".lstrip("~"), "aircraft_sysid_msgs/msg/Parameters", START + 7, message)
    return path


def test_rosbags_reads_it_without_our_types(tmp_path):
    from rosbags.highlevel import AnyReader

    path = write_all(tmp_path / "bag")
    with AnyReader([path]) as reader:
        found = [(c.topic, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()]
    assert [t for _, t, _ in found] == sorted(t for _, t, _ in found)
    air = [m for topic, _, m in found if topic == "/air_data"]
    assert [m.true_airspeed for m in air] == [0, 1, 2, 3, 4]
    assert all(np.isnan(m.sideslip) for m in air), "what is not given is not measured"
    assert air[1].header.stamp.sec == START // 10**9
    assert air[1].header.stamp.nanosec == 20_000_000
    assert air[1].header.frame_id == "probe"
    states = [m for topic, _, m in found if topic == "/state_estimator/state"]
    assert [m.status_text for m in states] == ["waiting", "", "", "without GPS", ""]
    assert [m.status for m in states] == [0, 1, 1, 2, 1]
    np.testing.assert_array_equal(states[3].wind_ned, [9, 10, 11])
    assert [m.fused for m in states] == [0, 1, 2, 3, 4]
    (parameters,) = [m for topic, _, m in found if topic == "/parameters"]
    assert [p.name for p in parameters.parameters] == ["CZ_alpha", "Cm_q"]
    assert parameters.parameters[0].value == -4.5
    assert np.isnan(parameters.parameters[1].value)
    assert parameters.parameters[1].reason == "no excitation"
    np.testing.assert_array_equal(parameters.covariance, [1, 0, 0, 1])
    assert parameters.header.stamp.nanosec == START % 10**9 + 7


def test_the_mcap_package_reads_it_with_the_definitions_inside(tmp_path):
    from mcap.reader import make_reader

    path = write_all(tmp_path / "bag")
    with next(path.glob("*.mcap")).open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        found = [(schema, channel, message) for schema, channel, message in reader.iter_messages()]
    assert len(found) == 11
    schema = next(s for s, c, _ in found if c.topic == "/air_data")
    assert schema.encoding == "ros2msg"
    assert "float64 true_airspeed" in schema.data.decode()


def test_our_reader_reads_texts_and_sequences(tmp_path):
    path = write_all(tmp_path / "bag")
    state = read_table(path, "/state_estimator/state")
    assert state.fields["status_text"].tolist() == ["waiting", "", "", "without GPS", ""]
    np.testing.assert_array_equal(state.stamp, START + 1 + np.arange(5) * 20_000_000)
    parameters = read_table(path, "parameters")
    assert [p.name for p in parameters.fields["parameters"][0]] == ["CZ_alpha", "Cm_q"]


def test_vectorised_bytes_are_those_of_the_slow_serialiser(tmp_path):
    """Both ways in, the same bytes out, for a type with uneven alignment (uint8, uint16, float64, array)."""
    from aircraft_sysid_ros.recordings.storage import read_raw

    covariance = np.arange(9.0)
    with RecordingWriter(tmp_path / "bag") as writer:
        for frame in ("", "a", "gps", "antenna"):
            flat = {
                "status.status": -1,
                "status.service": 3,
                "latitude": 1.5,
                "position_covariance": covariance,
            }
            writer.write("gps/fix", TOPICS["gps/fix"], [START], flat, frame_id=frame)
            message = {
                "header": {"stamp": START, "frame_id": frame}, "status": {"status": -1, "service": 3},
                "latitude": 1.5, "position_covariance": covariance,
            }  # fmt: skip
            writer.write_message("gps/fix", TOPICS["gps/fix"], START, message)
    raw = read_raw(tmp_path / "bag")
    assert len(raw) == 8
    for i in range(0, 8, 2):
        assert raw[i] == raw[i + 1]


def test_bare_file(tmp_path):
    with RecordingWriter(tmp_path / "run" / "estimates.mcap") as writer:
        writer.write("air_data", TOPICS["air_data"], [START], {})
    assert [p.name for p in (tmp_path / "run").iterdir()] == ["estimates.mcap"]
    assert len(read_table(tmp_path / "run" / "estimates.mcap", "air_data").stamp) == 1


def test_nothing_is_left_after_an_error(tmp_path):
    with pytest.raises(RuntimeError), RecordingWriter(tmp_path / "bag") as writer:
        writer.write("air_data", TOPICS["air_data"], [START], {})
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_keeps_the_old_recording(tmp_path, monkeypatch):
    path = write_all(tmp_path / "bag")
    before = next(path.glob("*.mcap")).read_bytes()

    def disk_full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("aircraft_sysid_ros.recordings.mcap_storage.BagWriter.write_all", disk_full)
    with pytest.raises(InputError, match="No space left"), RecordingWriter(path, overwrite=True) as writer:
        writer.write("air_data", TOPICS["air_data"], [START], {})
    assert [p.name for p in tmp_path.iterdir()] == ["bag"]
    assert next(path.glob("*.mcap")).read_bytes() == before


def test_a_name_that_another_process_took_meanwhile(tmp_path):
    """Both began when it was free: the second says so, and what the first has written stays."""
    taken = pytest.raises(InputError, match="another process has written there meanwhile")
    with taken, RecordingWriter(tmp_path / "bag") as slow:
        slow.write("air_data", TOPICS["air_data"], [START], {})
        write_all(tmp_path / "bag")
        before = snapshot(tmp_path)
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("name", ["bag", "bag.mcap"])
def test_files_of_a_recording_come_with_it_or_not_at_all(tmp_path, name):
    inside = tmp_path / name / "truth.json" if name == "bag" else tmp_path / "bag.truth.json"
    files = {inside: b"{}", tmp_path / "bag.segments.yaml": b"[]"}

    def write(**options):
        with RecordingWriter(tmp_path / name, **options) as writer:
            writer.write("air_data", TOPICS["air_data"], [START], {})
            for path, content in files.items():
                writer.add_file(path, content)

    write()
    assert all(path.read_bytes() == content for path, content in files.items())
    before = snapshot(tmp_path)
    files[tmp_path / "nowhere" / "else.json"] = b"1"  # cannot be put there
    files[tmp_path / "bag.segments.yaml"] = b"[1]"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (600, limits[1]))  # the system says that a file cannot grow: no disk left
    try:
        with pytest.raises(InputError, match="File too large"):
            write(overwrite=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert snapshot(tmp_path) == before


def snapshot(folder):
    return {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_overwriting_only_when_asked(tmp_path):
    path = write_all(tmp_path / "bag")
    with pytest.raises(InputError, match="already there"):
        RecordingWriter(path)
    with RecordingWriter(path, overwrite=True) as writer:
        writer.write("air_data", TOPICS["air_data"], [START], {})
    assert len(read_table(path, "air_data").stamp) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["bag"]


def test_other_folders_are_never_overwritten(tmp_path):
    precious = tmp_path / "thesis"
    precious.mkdir()
    (precious / "chapter1.tex").write_text("…")
    with pytest.raises(InputError, match="not a recording"):
        RecordingWriter(precious, overwrite=True)
    assert (precious / "chapter1.tex").exists()


def test_unknown_fields_are_refused(tmp_path):
    with pytest.raises(KeyError, match="true_airpseed"), RecordingWriter(tmp_path / "bag") as writer:
        writer.write("air_data", TOPICS["air_data"], [START], {"true_airpseed": 1.0})
    with pytest.raises(KeyError, match="speed"), RecordingWriter(tmp_path / "bag") as writer:
        writer.write_message("air_data", TOPICS["air_data"], START, {"speed": 1.0})
