"""What could not be read of a recording is said by every command that reads one: one wrong bit."""

import json
import struct
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.after_flight.replay_notes import air_data_notes, flight_notes, place_notes
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.recordings import mcap_records
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import gps_velocity_fields
from aircraft_sysid_ros.samples import WIDTH, Kind, Samples


def command(*arguments):
    line = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, timeout=600, check=False)


def chunks_of(data):
    """Start and length of the content of each chunk of a whole MCAP file, by its lengths alone."""
    at, found = 8, []
    while data[at] != mcap_records.DATA_END:
        length = struct.unpack_from("<Q", data, at + 1)[0]
        if data[at] == mcap_records.CHUNK:
            found.append((at + 9, length))
        at += 9 + length
    return found


@pytest.fixture(scope="module")
def damaged(tmp_path_factory):
    """A simulated flight with one wrong bit in the length of the last message of its middle chunk."""
    bag = tmp_path_factory.mktemp("damaged") / "flight"
    done = command("simulate", "--out", bag, "--duration", 100, "--json")
    messages = json.loads(done.stdout)["messages"]
    file = bag / "flight.mcap"
    data = bytearray(file.read_bytes())
    chunks = chunks_of(data)
    start, length = chunks[len(chunks) // 2]
    at, end = start + 40, start + length
    while (after := at + 9 + struct.unpack_from("<Q", data, at + 1)[0]) != end:
        at = after
    data[at + 1] ^= 1
    file.write_bytes(data)
    return bag, messages


def check_notes(notes, messages):
    place, counts = notes[:2]
    assert place.startswith("the chunk at byte ") and "has a wrong checksum: messages may be missing from " in place
    assert f" of the {sum(messages.values())} messages that its summary counts could not be read: /imu/data " in counts


@pytest.mark.long
def test_replay_says_it_in_text_in_json_and_in_the_run(damaged, aircraft_file, tmp_path, capsys):
    bag, messages = damaged
    done = command("replay", bag, "--aircraft", aircraft_file, "--out", tmp_path / "run", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    notes = json.loads(done.stdout)["notes"]
    check_notes(notes, messages)
    assert json.loads((tmp_path / "run" / "state.json").read_text())["notes"] == notes[:2]
    assert main(["replay", str(bag), "--aircraft", str(aircraft_file), "--out", str(tmp_path / "text")]) == 0
    said = capsys.readouterr().out
    assert all(f"\nnote: {note}\n" in said for note in notes)


@pytest.mark.long
def test_import_says_it(damaged, tmp_path, capsys):
    bag, messages = damaged
    assert main(["import", str(bag), "--out", str(tmp_path / "bag"), "--json"]) == 0
    check_notes(json.loads(capsys.readouterr().out)["notes"], messages)
    assert read_raw(tmp_path / "bag").notes == ()


@pytest.mark.long
def test_calibrate_says_it(damaged, aircraft_file):
    bag, messages = damaged
    options = ["--aircraft", aircraft_file, "--samples", 8]
    done = command("calibrate", "compatibility", bag, *options, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    notes = json.loads(done.stdout)["notes"]
    check_notes(notes, messages)
    assert len(notes) > 2, "those of the calibration itself"


@pytest.mark.long
def test_play_says_it(damaged):
    pytest.importorskip("rclpy")
    bag, messages = damaged
    done = command("play", bag, "--rate", 0, "--wait", 0.1, "--best-effort", "--json")
    result = json.loads(done.stdout)
    check_notes(result["notes"], messages)
    assert 0 < sum(messages.values()) - sum(result["messages"].values()) < 1000


def test_a_recording_of_which_nothing_can_be_read_is_refused_in_a_sentence(aircraft_file, tmp_path, capsys):
    bag = tmp_path / "bag"
    with RecordingWriter(bag) as writer:
        writer.write("gps/vel", "geometry_msgs/msg/TwistStamped", [1, 2], gps_velocity_fields([[1, 2, 3], [4, 5, 6]]))
    data = bytearray((bag / "bag.mcap").read_bytes())
    ((start, length),) = chunks_of(data)
    data[start + length - 5] ^= 1
    (bag / "bag.mcap").write_bytes(data)
    assert main(["replay", str(bag), "--aircraft", str(aircraft_file), "--out", str(tmp_path / "run"), "--json"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == (
        f"aircraft-sysid replay: the recording {bag} holds no messages that can be read: the chunk at byte {start} of "
        "the file has a wrong checksum; 2 of the 2 messages that its summary counts could not be read: /gps/vel 2\n"
    )
    assert not (tmp_path / "run").exists()


def test_places_that_the_aircraft_file_does_not_say_are_told(aircraft):
    shape = {key: value for key, value in aircraft.source.items() if not key.endswith("_position")}
    (note,) = place_notes(aircraft_from_dict(shape))
    assert "imu_position and air_data_position" in note
    (note,) = place_notes(aircraft_from_dict({**shape, "imu_position": [0.1, 0.0, 0.0]}))
    assert "air_data_position" in note and "imu_position" not in note
    _, note = place_notes(aircraft_from_dict(shape), has_error_states=True)
    assert "false scales and offsets" in note
    assert not place_notes(aircraft) and not place_notes(aircraft, has_error_states=True)


@pytest.mark.parametrize(
    "held", ["", "CY Cn: sensors contradict each other: innovations of the sideslip are too large"]
)
@pytest.mark.parametrize("says_where", [True, False])
def test_a_vane_that_contradicts_the_rest_may_sit_where_no_file_says(aircraft, says_where, held):
    """Of a boom of a sixth of the span all axes were held 30 times, and the place of the vane was not suspected."""
    shape = {key: value for key, value in aircraft.source.items() if says_where or key != "air_data_position"}
    counts = SimpleNamespace(gps_in_words="", ahead_in_words="", repeated_in_words="", restarts=0)
    state = SimpleNamespace(
        aircraft=aircraft_from_dict(shape), counts=dict, order=SimpleNamespace(counts=counts), realignments=0
    )
    integrity = SimpleNamespace(summary=lambda: {"holds": 30 if held else 0, "held": held})
    changes = SimpleNamespace(alarms=list)
    stream = SimpleNamespace(controls=SimpleNamespace(mass_in_words=""))
    learning = SimpleNamespace(changes=changes, integrity=integrity)
    notes = flight_notes(state, SimpleNamespace(learning=learning, stream=stream))
    assert any("set air_data_position" in note for note in notes) is bool(held and not says_where)
    assert len(notes) == bool(held) + bool(held and not says_where)


def notes_of_air_data(vane_rows, rows=6000, rate=100.0):
    """Of a recording whose air data have an airspeed in each row, and an angle of attack in some."""
    stamp = (np.arange(rows) * 1e9 / rate).astype(np.int64)
    parts = [(stamp, Kind.IMU), (stamp, Kind.AIRSPEED), (stamp[vane_rows], Kind.ANGLE_OF_ATTACK)]
    count = sum(len(part) for part, _ in parts)
    kind = np.concatenate([np.full(len(part), each) for part, each in parts])
    samples = Samples(np.concatenate([part for part, _ in parts]), kind, np.ones((count, WIDTH)))
    return air_data_notes(SimpleNamespace(samples=samples, topics={"air_data": rows}))


def test_a_sensor_that_is_slower_and_jitters_lacks_nothing_and_one_that_loses_samples_does():
    rng = np.random.default_rng(3)
    jitters = 2 * np.arange(3000) + rng.integers(-1, 2, 3000).cumsum() % 2  # 10, 20 or 30 ms apart
    assert notes_of_air_data(jitters) == []
    loses = np.flatnonzero(rng.random(6000) > 0.4)
    assert notes_of_air_data(loses) == [f"{100 - len(loses) / 60:.0f} % of the air data have no angle of attack"]
