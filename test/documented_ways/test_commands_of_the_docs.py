"""What the pages tell a user to type exists, and is run by a way, or it stands here why not."""

from importlib import import_module

import pytest
from documented_commands import ROOT, Told, command_of, shape, told, wrong_with

WAYS = ("test_flight_test_engineer", "test_drone_developer", "test_ros_developer")
#: Words that a command has, and why no way runs it.
_MAKES_THESE = "the tests run in what it makes, or are run by it"
_MEASURES = "minutes to hours of measurements and pictures"
_ORDINARY = "needs an ordinary ROS 2; `make colcon`, which `make test` runs, builds the same workspace"
NOT_RUN = {
    "make env": _MAKES_THESE,
    "make test": _MAKES_THESE,
    "make test-long": _MEASURES,
    "make pytest": _MAKES_THESE,
    "make colcon": _MAKES_THESE,
    "make help": "lists the Makefile, which every `make` of the pages is looked up in",
    "make demo": "test/commands/test_demo_story.py tells its story",
    "make workbench": "test/workbench/test_workbench_page.py opens the same page",
    "make bench": _MEASURES,
    "make certificate": _MEASURES,
    "make faults": _MEASURES,
    "make soak": _MEASURES,
    "make hidden-effects": _MEASURES,
    "make paper": _MEASURES,
    "make calibration": _MEASURES,
    "make closed-loop": _MEASURES,
    "make fuzz": "test/fuzz/test_fuzz.py tries the same inputs for a moment",
    "make fleet": _MEASURES,
    "make site": "test/test_site.py builds it",
    "make docs": "test/test_packaging.py runs it with --check",
    "python benchmarks/": _MEASURES,
    "python docs/": _MEASURES,
    "make release-tree": "test/test_packaging.py looks at the tree, `make colcon` builds it",
    "python3 pip": "test/test_installed_package.py runs what pip installs",
    "rosdep": _ORDINARY,
    "colcon": _ORDINARY,
    "aircraft-sysid check": "test/flight_check runs it, on simulated and on real recordings",
    "aircraft-sysid fleet": "test/fleet/test_whole_fleet.py, with workers that are killed",
    "aircraft-sysid import": "test/recordings/test_autopilot_import.py imports a log of every kind",
    "aircraft-sysid export": "test/export/test_export_command.py writes a file of every target",
    "aircraft-sysid polar": "test/commands/test_polar.py, from a table to the polar",
    "aircraft-sysid gains": "test/export/test_export_command.py, for either autopilot",
    "aircraft-sysid calibrate": "test/commands/test_calibrate.py, from the flight to the corrected replay",
    "aircraft-sysid simulate calibration": "test/commands/test_calibrate.py flies it",
    "aircraft-sysid replay --calibration": "test/commands/test_calibrate.py replays with what it has found",
    "aircraft-sysid recover": "test/nodes/test_killed_in_flight.py kills a flight first",
    "aircraft-sysid explain": "test/commands/test_explain.py explains a recording, and refuses bad ones",
    "aircraft-sysid compare --with": "test/diagnosis/test_several_runs.py, of flights and of versions",
    "aircraft-sysid compare --airframes": "test/fleet/test_side_by_side.py, of fleets and of airframes",
    "aircraft-sysid name": "test/workbench/test_names_of_versions.py names, undoes and refuses",
    "aircraft-sysid workbench": "test/workbench drives the page, of a run, of a calibration and of a node",
    "aircraft-sysid replay --calm-air": "test/test_real_failures.py, and test/commands/test_replay_without_sensors.py",
    "aircraft-sysid replay --prior": "test/nodes/test_live_equals_replay.py, with the prior of a fleet",
    "aircraft-sysid live --prior": "test/nodes/test_live_equals_replay.py, with the prior of a fleet",
    "aircraft-sysid replay rml": "test/identification/test_likelihood_learner.py",
    "aircraft-sysid live rml": "test/nodes/test_likelihood_node.py",
    "aircraft-sysid refine --method": "test/commands/test_refine.py",
    "aircraft-sysid refine --model": "test/commands/test_refine.py",
    "examples/adaptive_controller/controller_node.py": "fly.py starts the same node",
    "examples/adaptive_controller/aeroplane_node.py": "fly.py starts the same node",
    "examples/adaptive_controller/fly.py --rate": "a way flies another case with more options",
    "aircraft_sysid_ros.simulation.mavlink_simulator.process --reboot": "its own test, in test/mavlink",
    "ros2 bag record": "of ROS 2 itself, which is not on PyPI; a way records as it does",
    "px4.launch.py": "test/nodes/test_launch.py makes it; PX4 is not here, and test/nodes/test_px4_live.py stands in",
    "live.launch.py overview": "test/nodes/test_launch.py",
    "live.launch.py params_file": "test/nodes/test_launch.py, and test/nodes/test_parameter_files.py with a process",
    "ros2 run overview": "test/nodes/test_two_aeroplanes.py runs two of it",
    "ros2 run state_estimator": "test/nodes/test_parameter_files.py, with a file of parameters and with a remapping",
    "aircraft-sysid play --clock": "test/recordings/test_playback.py hears it",
    "mavros.launch.py": "test/mavlink/test_mavros_launch.py; MAVROS is not here",
}


def is_among(words: str, of: frozenset[str]) -> bool:
    """Whether a command has all words; a word that ends with / is a folder."""
    has = lambda word: word in of or (word.endswith("/") and any(part.startswith(word) for part in of))  # noqa: E731
    return all(map(has, words.split()))


@pytest.mark.parametrize("one", told(), ids=str)
def test_it_exists(one: Told) -> None:
    assert not wrong_with(one), f"{one}: {'; '.join(wrong_with(one))}"


@pytest.mark.long
def test_every_command_is_run_by_a_way_or_is_listed_with_the_reason() -> None:
    run = [shape(command_of(*step)) for way in WAYS for step in import_module(way).WAY.values()]
    typed = [one for one in told() if one.is_typed]
    missing = [
        str(one)
        for one in typed
        if not any(shape(one) <= more for more in run) and not any(is_among(words, shape(one)) for words in NOT_RUN)
    ]
    assert not missing, "run by no way and not listed:\n" + "\n".join(missing)
    needless = [words for words in NOT_RUN if not any(is_among(words, shape(one)) for one in typed)]
    assert not needless, f"on no page any more: {needless}"


@pytest.mark.parametrize("reason", sorted({text for text in NOT_RUN.values() if text.startswith("test/")}))
def test_what_runs_it_instead_is_there(reason: str) -> None:
    assert (ROOT / reason.split(maxsplit=1)[0].rstrip(",;")).exists()


# -- of the extractor itself -------------------------------------------------------------------------------------

PAGE = """
Type `aircraft-sysid compare RUN --loud`, or `replay
--smoothe` and `--nowhere`:

```sh
make nothing   # or: fly RUN
.venv/bin/aircraft-sysid replay flight \\
    --aircraft a.yaml    # or: import LOG --outt flight
.venv/bin/python benchmarks/no_such_script.py
```

    .venv/bin/aircraft-sysid fly
    aircraft-sysid compare RUN
    z = x + y

```python
make = 1
```

```sh
$ ros2 param set /node step 1.0
Setting parameter failed
$ ros2 param get-all
```
"""


def test_a_command_that_does_not_exist_is_found(tmp_path, monkeypatch) -> None:
    import documented_commands

    page = tmp_path / "page.md"
    page.write_text(PAGE)
    monkeypatch.setattr(documented_commands, "ROOT", tmp_path)
    found = list(documented_commands.told_on(page))
    monkeypatch.undo()
    assert [(one.line, one.text, one.is_typed) for one in found] == [
        (2, "aircraft-sysid compare RUN --loud", True),
        (2, "replay --smoothe", False),
        (2, "--nowhere", False),
        (6, "make nothing   # or: fly RUN", True),
        (7, ".venv/bin/aircraft-sysid replay flight     --aircraft a.yaml    # or: import LOG --outt flight", True),
        (7, "import LOG --outt flight", False),
        (9, ".venv/bin/python benchmarks/no_such_script.py", True),
        (12, ".venv/bin/aircraft-sysid fly", True),
        (13, "aircraft-sysid compare RUN", True),
        (21, "ros2 param set /node step 1.0", True),
        (23, "ros2 param get-all", True),
    ]
    said = [" ".join(wrong_with(one)) for one in found]
    expected = (
        "--loud", "no option --smoothe", "no script of this page, has --nowhere", "makes no nothing", "required: --out",
        "no option --outt", "there is no benchmarks/", "has no command fly", "without .venv/bin/",
        "", "ros2 param get-all is not understood",
    )  # fmt: skip
    assert [text in one for one, text in zip(said, expected, strict=True)] == [True] * len(expected), said
