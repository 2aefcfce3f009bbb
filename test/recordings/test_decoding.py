"""Decoding messages: all at once says the same as one by one."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.recordings import joint_states, tables
from aircraft_sysid_ros.recordings.cdr_layout import decode
from aircraft_sysid_ros.recordings.message_types import known_types
from aircraft_sysid_ros.recordings.raw_messages import Channel, RawMessages
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.storage import read_raw
from aircraft_sysid_ros.recordings.tables import read_table, table_of
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS
from aircraft_sysid_ros.samples import Kind

TYPES = [*sorted(set(TOPICS.values())), "aircraft_sysid_msgs/msg/AircraftState"]


def random_message(type_name, rng, frame_id):
    """A message with other numbers in every field."""
    types = known_types()

    def value(description):
        node, content = int(description[0]), description[1]
        if node == 2:
            return build(content)
        if node == 3:
            return np.array([value(content[0]) for _ in range(content[1])])
        base = content[0]
        if base == "string":
            return frame_id
        return float(np.float32(rng.normal())) if base.startswith("float") else int(rng.integers(0, 100))

    def build(name):
        return types.types[name](**{field: value(d) for field, d in types.fielddefs[name][1]})

    return build(type_name)


def raw_of(type_name, contents):
    lengths = np.array([len(c) for c in contents])
    n = len(contents)
    data = np.frombuffer(b"".join(contents), np.uint8)
    start = np.cumsum(lengths) - lengths
    return RawMessages(data, np.ones(n, np.int64), np.arange(n), start, lengths, {1: Channel("/x", type_name)})


def assert_same(fast, slow):
    assert fast.fields.keys() == slow.fields.keys()
    np.testing.assert_array_equal(fast.stamp, slow.stamp)
    np.testing.assert_array_equal(fast.rows, slow.rows)
    for name in fast.fields:
        np.testing.assert_array_equal(fast.fields[name], slow.fields[name], err_msg=name)


@pytest.mark.parametrize("size", range(10))
@pytest.mark.parametrize("type_name", TYPES)
def test_decoding_at_once_says_the_same_as_one_by_one(type_name, size):
    rng = np.random.default_rng(size)
    messages = [random_message(type_name, rng, "f" * size) for _ in range(3)]
    raw = raw_of(type_name, [bytes(known_types().serialize_cdr(m, type_name)) for m in messages])
    fast = tables._decoded_at_once(raw, 1, None)
    slow = tables._decoded_one_by_one(raw, 1)
    assert_same(fast, slow)


@pytest.mark.parametrize("padding", [1, 2, 3])
def test_padding_at_the_end_is_allowed(padding):
    type_name = TOPICS["air_data"]
    rng = np.random.default_rng(0)
    contents = [bytes(known_types().serialize_cdr(random_message(type_name, rng, "f"), type_name)) for _ in range(2)]
    raw = raw_of(type_name, [content + bytes(padding) for content in contents])
    assert_same(tables._decoded_at_once(raw, 1, None), tables._decoded_at_once(raw_of(type_name, contents), 1, None))


def test_big_endian_messages_are_decoded_one_by_one():
    type_name = TOPICS["air_data"]
    rng = np.random.default_rng(0)
    messages = [random_message(type_name, rng, "air") for _ in range(3)]
    contents = [bytes(known_types().serialize_cdr(m, type_name, little_endian=False)) for m in messages]
    raw = raw_of(type_name, contents)
    assert tables._decoded_at_once(raw, 1, None) is None
    np.testing.assert_array_equal(
        table_of(raw, 1).fields["true_airspeed"], [message.true_airspeed for message in messages]
    )


def test_frame_ids_of_several_lengths_are_decoded_one_by_one():
    """Equal sizes of the messages do not mean equal layouts: "a" and "ab" are padded to the same length."""
    type_name = TOPICS["air_data"]
    rng = np.random.default_rng(0)
    messages = [random_message(type_name, rng, frame) for frame in ("a", "ab", "a", "abcdefghijk")]
    for chosen in (messages[:2], messages):
        raw = raw_of(type_name, [bytes(known_types().serialize_cdr(m, type_name)) for m in chosen])
        assert tables._decoded_at_once(raw, 1, None) is None
        expected = [message.sideslip for message in chosen]
        np.testing.assert_array_equal(table_of(raw, 1).fields["sideslip"], expected)


def test_a_message_that_cannot_be_decoded_is_skipped_and_counted():
    type_name = TOPICS["air_data"]
    rng = np.random.default_rng(0)
    contents = [bytes(known_types().serialize_cdr(random_message(type_name, rng, "f"), type_name)) for _ in range(3)]
    table = table_of(raw_of(type_name, [contents[0], contents[1][:20], contents[2]]), 1)
    assert table.skipped == 1
    np.testing.assert_array_equal(table.rows, [0, 2])


def test_sequences_have_no_layout():
    block = np.zeros((1, 40), np.uint8)
    block[:, 1] = 1
    assert decode(known_types().fielddefs, "aircraft_sysid_msgs/msg/Parameters", block) is None


def test_inputs_are_written_and_read_at_once_as_one_by_one(tmp_path):
    """Messages that all name the same, and then one that names something else: numbers and stamps stay."""
    stamp = 1_760_000_000_123_456_789 + np.arange(30) * 20_000_001
    values = np.random.default_rng(2).normal(0.0, 0.3, (30, 2))
    named = (NamedInput("tab"), NamedInput("spoiler"))
    for number, others in enumerate(([], [("spoiler",)])):
        path = tmp_path / str(number)
        with RecordingWriter(path) as writer:
            writer.write_inputs(stamp, ("tab", "spoiler"), values, frame_id="base_link")
            for names in others:
                writer.write_inputs(stamp[-1:] + 5, names, values[:1, :1])
        table = read_table(path, "inputs")  # all fields: one by one
        assert table.stamp.tolist()[:30] == stamp.tolist()
        assert [list(names) for names in table.fields["name"][:30]] == [["tab", "spoiler"]] * 30
        assert [list(row) for row in table.fields["position"][:30]] == values.tolist()
        raw = read_raw(path)
        (key,) = raw.channels
        block = raw.block(raw.rows(key))
        assert (block is None or joint_states.decode(block) is None) == bool(others)
        samples = read_recording(path, named).samples
        assert set(samples.kind.tolist()) == {Kind.INPUTS}
        np.testing.assert_array_equal(samples.values[:30, :2], values)
        np.testing.assert_array_equal(samples.stamp[:30], stamp)
        assert len(samples) == 30 + len(others)
