"""Runs with numbers that cannot be, damaged files, folders that are no run: one line that names the file."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.refinement.run_data import load_run
from aircraft_sysid_ros.run_reader import damaged_files
from aircraft_sysid_ros.samples import Kind


@pytest.fixture
def run(run_with_hidden_effect, tmp_path, capsys) -> Path:
    shutil.copytree(run_with_hidden_effect, tmp_path / "run")
    capsys.readouterr()
    return tmp_path / "run"


def refused(capsys, *arguments) -> str:
    """Status 2 and the one line on standard error, without the name of the command."""
    capsys.readouterr()
    assert main([*map(str, arguments)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and "Traceback" not in err
    return err.partition(": ")[2]


def in_arrays(path: Path, **changes) -> None:
    """Arrays of an npz file replaced by what a function makes of them all."""
    with np.load(path) as stored:
        arrays = {name: stored[name] for name in stored.files}
    np.savez(path, **{**arrays, **{name: change(arrays) for name, change in changes.items()}})


def in_parameters(run: Path, **change) -> None:
    content = json.loads((run / "parameters.json").read_text())
    next(p for p in content["parameters"] if p["name"] == "CZ_alpha").update(change)
    (run / "parameters.json").write_text(json.dumps(content))


def in_state(run: Path, **change) -> None:
    content = json.loads((run / "state.json").read_text())
    (run / "state.json").write_text(json.dumps({**content, **change}))


def with_(array, index, value):
    changed = array.astype(float)
    changed[index] = value
    return changed


def swapped(stamp):
    changed = stamp.copy()
    changed[[10, 11]] = changed[[11, 10]]
    return changed


def of_imu(arrays, rows):
    """Values with NaN in these rows of the IMU."""
    values = arrays["values"].copy()
    values[np.flatnonzero(arrays["kind"] == Kind.IMU)[rows], :6] = np.nan
    return values


NO_NUMBER = "holds CZ_alpha to USE without a finite value and standard error"
IMPOSSIBLE = {
    "times of points": (
        lambda run: in_arrays(run / "points.npz", stamp=lambda a: with_(a["stamp"], 5, np.nan)),
        "points.npz holds times that are not finite",
    ),
    "points that go back": (
        lambda run: in_arrays(run / "points.npz", stamp=lambda a: swapped(a["stamp"])),
        "points.npz holds times that do not rise",
    ),
    "points twice at a time": (
        lambda run: in_arrays(run / "points.npz", stamp=lambda a: np.repeat(a["stamp"][::2], 2)[: len(a["stamp"])]),
        "points.npz holds times that do not rise",
    ),
    "infinite coefficients": (
        lambda run: in_arrays(run / "points.npz", measured=lambda a: with_(a["measured"], (7, 2), np.inf)),
        "points.npz holds measured coefficients that are not finite",
    ),
    "valid without a number": (
        lambda run: in_arrays(run / "points.npz", measured=lambda a: with_(a["measured"], slice(None), np.nan)),
        "points.npz holds measured coefficients that are not finite",
    ),
    "times of samples": (
        lambda run: in_arrays(run / "samples.npz", stamp=lambda a: with_(a["stamp"], 5, -np.inf)),
        "samples.npz holds times that are not finite",
    ),
    "no IMU": (
        lambda run: in_arrays(run / "samples.npz", values=lambda a: of_imu(a, slice(None))),
        "samples.npz holds no IMU sample with finite numbers",
    ),
    "USE of NaN": (lambda run: in_parameters(run, status="USE", value=np.nan), f"parameters.json {NO_NUMBER}"),
    "USE of nothing": (lambda run: in_parameters(run, status="USE", value=None), f"parameters.json {NO_NUMBER}"),
    "USE without std": (lambda run: in_parameters(run, status="USE", std=np.inf), f"parameters.json {NO_NUMBER}"),
    "a status of nobody": (
        lambda run: in_parameters(run, status="GOOD"),
        "parameters.json holds CZ_alpha with a status that is not one of USE, HOLD, REJECT",
    ),
    "biases": (
        lambda run: in_state(run, gyro_bias=[0.0, np.nan, 0.0]), "state.json holds biases that are not finite",
    ),
    "cut off": (lambda run: (run / "samples.npz").write_bytes(b"not a zip"), "samples.npz is damaged"),
}  # fmt: skip


@pytest.mark.parametrize(("damage", "words"), IMPOSSIBLE.values(), ids=IMPOSSIBLE.keys())
def test_what_cannot_be_in_a_run_is_refused(run, damage, words, capsys) -> None:
    assert damaged_files(run) == []
    damage(run)
    said = refused(capsys, "compare", run)
    assert said.startswith(f"the run {run} is damaged, {words}: replay the recording again")


def test_every_command_says_the_same(run, tmp_path, capsys) -> None:
    in_parameters(run, status="USE", value=None)
    before = sorted(path.name for path in run.iterdir())
    out = tmp_path / "run.html"
    commands = (
        ["diagnose", run], ["add", run, "stall"], ["remove", run, "CZ: de"], ["refine", run],
        ["report", run, "--out", out],
    )  # fmt: skip
    said = {refused(capsys, *command) for command in (["compare", run], *commands)}
    assert len(said) == 1 and "parameters.json holds CZ_alpha" in said.pop()
    assert sorted(path.name for path in run.iterdir()) == before and not out.exists()


def test_without_samples_the_points_are_read_as_strictly(run, capsys) -> None:
    (run / "samples.npz").unlink()
    in_arrays(run / "points.npz", stamp=lambda a: swapped(a["stamp"]))
    assert "points.npz holds times that do not rise" in refused(capsys, "compare", run)


def test_what_may_be_unknown_is_no_damage(run) -> None:
    """Parameters that HOLD, sensors that are not there, samples without numbers, a clock that was set back."""
    in_parameters(run, status="HOLD", value=None, std=None)
    in_state(run, accelerometer_bias=[None, 0.1, 0.2], clock_restarts=1)
    in_arrays(
        run / "points.npz",
        stamp=lambda a: swapped(a["stamp"]),
        signals=lambda a: np.full_like(a["signals"], np.nan),
        terms=lambda a: np.full_like(a["terms"], np.nan),
        predicted=lambda a: np.full_like(a["predicted"], np.nan),
        valid=lambda a: np.zeros_like(a["valid"]),
        measured=lambda a: with_(a["measured"], (3, 1), np.nan),
    )
    in_arrays(
        run / "samples.npz",
        stamp=lambda a: swapped(a["stamp"]),
        values=lambda a: of_imu(a, slice(0, -1)),
    )
    assert damaged_files(run) == []
    assert load_run(run).biases[0] == 0.0


def test_a_sample_that_is_kept_twice_is_read_once(run) -> None:
    """Of topics that were recorded twice the diagnosis saw sensors of an infinite rate and half of their noise."""
    count = len(load_run(run).samples)
    in_arrays(
        run / "samples.npz",
        **{name: lambda a, name=name: np.repeat(a[name], 2, axis=0) for name in ("stamp", "kind", "values")},
    )
    assert len(load_run(run).samples) == count


# -- folders that are something else ------------------------------------------------------------------------


def test_a_calibration_is_no_run_and_is_shown_whole_only(tmp_path, capsys) -> None:
    (tmp_path / "calibration.yaml").write_text("five_hole_probe:\n")
    assert "is a calibration and not a run" in refused(capsys, "compare", tmp_path)
    for command in (["report", tmp_path, "--out", tmp_path / "x.html"], ["workbench", tmp_path]):
        said = refused(capsys, *command)
        assert "is a calibration without result.json" in said and "calibrate again" in said and "replay" not in said


@pytest.mark.long
def test_the_page_of_nothing_is_refused_before_it_is_imported(tmp_path) -> None:
    code = "import sys; from aircraft_sysid_ros.commands.main import main; status = main(sys.argv[1:]); "
    code += "print(status, [name for name in ('nicegui', 'plotly', 'numba') if name in sys.modules])"
    command = [sys.executable, "-c", code, "workbench", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    assert done.stdout.strip() == "2 []" and "is not a run: make one with" in done.stderr


def test_an_effect_that_nobody_knows(run, capsys) -> None:
    assert "is not an effect, did you mean ground_effect" in refused(capsys, "add", run, "grund_effect")
    for word in ("xyzzy", "unknown_effect"):
        said = refused(capsys, "add", run, word)
        assert "`aircraft-sysid add --help` lists them" in said and len(said) < 160
    with pytest.raises(SystemExit):
        main(["add", "--help"])
    assert "ground_effect" in capsys.readouterr().out
