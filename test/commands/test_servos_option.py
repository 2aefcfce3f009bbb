"""``--servos`` says what the outputs of an autopilot mean, ``--calibration`` what ``calibrate`` found: two files."""

import pytest

from aircraft_sysid_ros.calibration.calibration_file import load_calibration
from aircraft_sysid_ros.commands.main import build_parser
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.servo_mapping import load_servo_mapping

WORDS = {
    "import": ["import", "flight.bin", "--out", "flight"],
    "explain": ["explain", "flight.bin", "--out", "page"],
    "bridge": ["bridge"],
}
SERVOS = config_path("mavlink_simulator_servos.yaml")


@pytest.mark.parametrize("command", WORDS)
def test_the_name_of_before_still_means_the_servos_with_a_word_of_warning(command, capsys):
    parser = build_parser(command)
    assert parser.parse_args([*WORDS[command], "--servos", "a.yaml"]).servos == "a.yaml"
    assert capsys.readouterr().err == ""
    assert parser.parse_args([*WORDS[command], "--calibration", "b.yaml"]).servos == "b.yaml"
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    assert f"aircraft-sysid {command}: " in err and "--calibration" in err and "use --servos" in err
    assert parser.parse_args(WORDS[command]).servos is None


def test_where_one_is_given_for_the_other_it_is_said(tmp_path):
    with pytest.raises(InputError, match=r"what the outputs of an autopilot mean.*--servos of import"):
        load_calibration(SERVOS)
    found = tmp_path / "calibration.yaml"
    found.write_text("magnetometer: {}\nsource: {}\n", encoding="utf8")
    with pytest.raises(InputError, match=r"what `calibrate` found.*--calibration of replay and live"):
        load_servo_mapping(found)
