"""Words of ROS at the end of a line: remaps of `live`, `play` and `bridge`; other commands know none."""

import pytest

from aircraft_sysid_ros.commands import live
from aircraft_sysid_ros.commands.main import main


def test_words_that_are_none_of_ros_are_one_sentence(aircraft_file, capfd):
    assert main(["live", "--aircraft", str(aircraft_file), "--ros-args", "-r", "imu/data="]) == 2
    said = capfd.readouterr().err.strip().splitlines()[-1]
    assert "--ros-args -r imu/data=: Couldn't parse remap rule" in said and "Traceback" not in said


def test_words_of_ros_end_where_ros_says_so(monkeypatch):
    """What stands behind ``--`` is ours again."""
    seen = []
    monkeypatch.setattr(
        live, "run", lambda args: seen.append((args.ros_args, args.json, args.reliable)) or {"said": ""}
    )
    monkeypatch.setattr(live, "render", lambda _: "")
    main(["live", "--aircraft", "a.yaml", "--ros-args", "-r", "a:=b", "--", "--reliable"])
    main(["live", "--aircraft", "a.yaml", "--json", "--ros-args", "-r", "a:=b"])
    assert seen == [(["--ros-args", "-r", "a:=b"], False, True), (["--ros-args", "-r", "a:=b"], True, False)]


def test_a_command_without_nodes_knows_none(capfd):
    with pytest.raises(SystemExit) as ended:
        main(["check", "nowhere", "--ros-args", "-r", "a:=b"])
    assert ended.value.code == 2 and "--ros-args" in capfd.readouterr().err
