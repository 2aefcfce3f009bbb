"""The calibration file: what it says moves the right surface the right way, and mistakes are said in one sentence."""

import re

import numpy as np
import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.servo_mapping import MIXING, load_servo_mapping, servo_mapping_from_dict

POINTS = {"us": [1000, 1500, 2000], "deg": [-30, 0, 30]}


def controls(outputs, pulses):
    mapping = servo_mapping_from_dict({"outputs": outputs})
    found = mapping.controls(np.array([pulses], dtype=float))
    return {name: float(value[0]) for name, value in found.items()}


def test_a_table_is_interpolated_held_beyond_its_ends_and_mirrored():
    crooked = {"surface": "elevator", "us": [1000, 1400, 2000], "deg": [-20, 0, 10]}
    for pulse, degrees in ((1000, -20), (1200, -10), (1700, 5), (2300, 10), (600, -20)):
        assert controls({1: crooked}, [pulse])["elevator"] == pytest.approx(np.radians(degrees))
        assert controls({1: {**crooked, "reversed": True}}, [pulse])["elevator"] == pytest.approx(np.radians(-degrees))
    assert np.isnan(controls({1: crooked}, [np.nan])["elevator"])
    assert np.isnan(controls({3: crooked}, [1500, 1500])["elevator"])  # fewer outputs than the file says


def test_a_fraction_is_mirrored_within_its_range():
    """Of an input it went from 0 to -1."""
    points = {"us": [1000, 2000], "fraction": [0, 1], "reversed": True}
    for kind in ({"surface": "throttle"}, {"input": "engine"}):
        mapping = servo_mapping_from_dict({"outputs": {1: {**kind, **points}}})
        found = [float(mapping.outputs[1].value(np.array([pulse]))[0]) for pulse in (1000.0, 1250.0, 2000.0)]
        assert found == [1.0, 0.75, 0.0]


def test_elevons_are_elevator_together_and_aileron_against_each_other():
    """Trailing edges down are positive; a right elevon down and a left one up roll to the left: aileron positive."""
    outputs = {1: {"surface": "left_elevon", **POINTS}, 2: {"surface": "right_elevon", **POINTS}}
    both = controls(outputs, [1600, 1600])
    assert both["elevator"] == pytest.approx(np.radians(6.0)) and both["aileron"] == pytest.approx(0.0)
    against = controls(outputs, [1400, 1600])
    assert against["elevator"] == pytest.approx(0.0) and against["aileron"] == pytest.approx(np.radians(6.0))


def yaw_moment_of_v_tail(left_down, right_down, dihedral):
    """Yaw moment (positive: nose right) of a V-tail: each panel pushes along its normal, trailing edge down is up.

    Panels behind the centre of gravity at -1 m; the right one rises outward by the dihedral (negative: inverted).
    Normals point up and inward: right (y < 0), left (y > 0), for an upright V.
    """
    total = 0.0
    for down, side in ((right_down, 1.0), (left_down, -1.0)):
        normal_y = -side * np.sin(dihedral)
        force_y = down * normal_y
        total += -1.0 * force_y  # N = x Y, x = -1
    return total


@pytest.mark.parametrize(("name", "dihedral"), [("vtail", 0.6), ("inverted_vtail", -0.6)])
def test_a_v_tail_yaws_as_the_rudder_that_it_counts_as(name, dihedral):
    """A rudder with its trailing edge to the left (positive) turns the nose to the left: the moment is negative."""
    outputs = {1: {"surface": f"left_{name}", **POINTS}, 2: {"surface": f"right_{name}", **POINTS}}
    found = controls(outputs, [1600, 1400])  # left down, right up
    moment = yaw_moment_of_v_tail(np.radians(6.0), -np.radians(6.0), dihedral)
    assert np.sign(found["rudder"]) == -np.sign(moment)
    assert abs(found["rudder"]) == pytest.approx(np.radians(6.0)) and found["elevator"] == pytest.approx(0.0)


SPOILER = {"input": "spoiler", "us": [1000, 2000], "deg": [0, 60]}


def test_an_output_can_be_an_input_of_its_own_beside_a_surface_or_in_its_place():
    outputs = {
        1: {"surface": "left_elevon", "input": "elevon_left", **POINTS},
        2: {"surface": "right_elevon", **POINTS},
        4: SPOILER,
        5: {"input": "door", "us": [1000, 2000], "fraction": [0, 1]},
    }
    mapping = servo_mapping_from_dict({"outputs": outputs})
    pulses = np.array([[1600.0, 1400.0, np.nan, 1500.0, 1250.0], [np.nan, 1400.0, 0.0, 2500.0, np.nan]])
    assert mapping.inputs == ("elevon_left", "spoiler", "door")
    right = [[np.radians(6.0), np.radians(30.0), 0.25], [np.nan, np.radians(60.0), np.nan]]
    np.testing.assert_allclose(mapping.input_values(pulses), right)
    np.testing.assert_allclose(mapping.input_values(pulses[:, :2])[:, 1:], np.nan)  # fewer outputs than the file says
    assert set(mapping.controls(pulses)) == {"elevator", "aileron"}
    assert mapping.controls(pulses)["aileron"][0] == pytest.approx(-np.radians(6.0))


def test_halves_share_and_every_mixture_gives_back_what_a_plain_surface_would():
    for name, mixing in MIXING.items():
        side, _, rest = name.partition("_")
        if side == "left":
            other = MIXING[f"right_{rest}"]
            together = {c: mixing.get(c, 0) + other.get(c, 0) for c in {*mixing, *other}}
            against = {c: other.get(c, 0) - mixing.get(c, 0) for c in {*mixing, *other}}
            assert {abs(v) for v in (*together.values(), *against.values())} <= {0.0, 1.0}


def test_the_file_of_the_simulator_is_one(mapping):
    assert set(mapping.outputs) == {1, 2, 3, 4, 5}
    found = mapping.controls(np.array([[1500.0, 1600.0, 1400.0, 1500.0, 1500.0]]))
    assert found["elevator"][0] == pytest.approx(-np.radians(6.0))  # reversed
    assert found["throttle"][0] == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ({"outputs": {1: {"surface": "elevatr", **POINTS}}}, "did you mean elevator"),
        ({"outputs": {0: {"surface": "elevator", **POINTS}}}, "1 to 32, the motors of PX4 101 to 112, not '0'"),
        ({"outputs": {1: {"surface": "left_elevon", **POINTS}}}, "left_elevon needs right_elevon"),
        ({"outputs": {1: {"surface": "elevator", "us": [2000, 1000], "deg": [0, 1]}}}, "us rising"),
        ({"outputs": {1: {"surface": "elevator", "us": [1000, 2000], "deg": [0, 1, 2]}}}, "equally many"),
        ({"outputs": {1: {"surface": "elevator", "us": [1000, 1500, 2000], "rad": [0, 1, 0]}}}, "rise or fall"),
        ({"outputs": {1: {"surface": "elevator", "us": [1000, 2000], "rad": [-30, 30]}}}, "degrees go under deg"),
        ({"outputs": {1: {"surface": "elevator", "us": [-1, 1], "rad": [-0.5, 0.5]}}}, "between 500 and 2500"),
        ({"outputs": {1: {"surface": "throttle", "us": [1000, 2000], "deg": [0, 1]}}}, "as fraction"),
        ({"outputs": {1: {"surface": "throttle", "us": [1000, 2000], "fraction": [0, 100]}}}, "between 0 and 1"),
        ({"outputs": {1: {"surface": "elevator", **POINTS}, 2: {"surface": "elevator", **POINTS}}}, "there twice"),
        ({"outputs": {1: {"surface": "elevator", **POINTS}, 2: {"surface": "left_elevon", **POINTS},
                      3: {"surface": "right_elevon", **POINTS}}}, "elevator comes from"),
        ({"outputs": {1: {"surface": "elevator", **POINTS, "reversed": "yes"}}}, "true or false"),
        ({"outputs": {1: {"surface": "elevator", "command": [-1, 1], "deg": [-30, 30]},
                      2: {"surface": "rudder", **POINTS}}}, "not some of each"),
        ({"outputs": {1: {**SPOILER, "input": "sin"}}}, "the input 'sin' has a name that terms use otherwise"),
        ({"outputs": {1: {**SPOILER, "input": "V"}}}, "the input 'V' has a name that terms use otherwise"),
        ({"outputs": {1: {**SPOILER, "input": "a-b"}}}, "the input 'a-b' cannot be used in a term"),
        ({"outputs": {1: SPOILER, 2: SPOILER}}, "two outputs are the input spoiler"),
        ({"outputs": {1: {**SPOILER, "deg": [0, 600]}}}, "is not a deflection"),
        ({"outputs": {1: {"us": [1000, 2000], "deg": [0, 60]}}}, "unknown surface 'None'"),
        ({"outputs": [1, 2]}, "must be a mapping"),
        ({"output": {}}, "did you mean 'outputs'"),
        ({"airspeed": {"meaning": "calibratd"}}, "must be one of indicated, calibrated"),
        ({"airspeed": {"scale": "big"}}, "must be a number from 0.2 to 5"),
        ({"flow_angles": "yes"}, "ignored or measured"),
        ({"named_values": {"THRUST": "trust"}}, "must be one of thrust"),
        ({"named_values": {"A_VERY_LONG_NAME": "thrust"}}, "1 to 10 characters"),
        ({"rates": {"RAW_IMU": -1}}, "from 0 to 1000"),
        ({"attitude": {"std": 0}}, "from 0.0001 to 1"),
        ([1], "must be a mapping"),
    ],
)  # fmt: skip
def test_mistakes_are_said_in_one_sentence(tmp_path, content, text):
    import yaml

    path = tmp_path / "calibration.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=re.escape(text)) as refused:
        load_servo_mapping(path)
    assert str(path) in str(refused.value) and "\n" not in str(refused.value)


def test_a_file_that_is_none(tmp_path):
    with pytest.raises(InputError, match="cannot read the calibration file"):
        load_servo_mapping(tmp_path / "nowhere.yaml")
    (tmp_path / "bad.yaml").write_text("outputs: {1: [")
    with pytest.raises(InputError, match="not valid YAML at line 1"):
        load_servo_mapping(tmp_path / "bad.yaml")
    (tmp_path / "twice.yaml").write_text("outputs:\n  1: {surface: rudder}\n  1: {surface: elevator}\n")
    with pytest.raises(InputError, match="the key '1' is there twice, at lines 2 and 3: remove one"):
        load_servo_mapping(tmp_path / "twice.yaml")
    (tmp_path / "empty.yaml").write_text("")
    assert not load_servo_mapping(tmp_path / "empty.yaml").outputs


def test_the_meaning_true_is_the_word_that_yaml_takes_for_a_truth(tmp_path):
    (tmp_path / "calibration.yaml").write_text("airspeed: {meaning: true}\n")
    assert load_servo_mapping(tmp_path / "calibration.yaml").airspeed_meaning == "true"
