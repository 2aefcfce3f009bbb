"""``refine`` as users meet it: a run from replay, files, one line for what is wrong."""

import json

import numpy as np
import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.refinement.refine import worse_axes
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight


@pytest.fixture(scope="module")
def run(tmp_path_factory, aircraft, aircraft_file):
    folder = tmp_path_factory.mktemp("refine")
    write_flight(simulate_samples(aircraft, seed=6, duration=25.0), folder / "flight", overwrite=False)
    assert main(["replay", str(folder / "flight"), "--aircraft", str(aircraft_file), "--out", str(folder / "run")]) == 0
    return folder / "run"


def test_a_run_holds_its_samples(run, aircraft):
    from aircraft_sysid_ros.recordings.reader import read_recording

    samples = read_recording(run.parent / "flight").samples
    with np.load(run / "samples.npz") as stored:
        np.testing.assert_array_equal(stored["stamp"], samples.stamp)
        np.testing.assert_array_equal(stored["kind"], samples.kind)
        np.testing.assert_array_equal(stored["values"], samples.values)


def test_refine_writes_file_and_figure(run, capsys):
    capsys.readouterr()
    assert main(["refine", str(run), "--method", "output-error", "--segment", "6", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    stored = json.loads((run / "refined-output-error.json").read_text())
    assert {k: v for k, v in printed.items() if k not in ("file", "figure")} == stored
    assert stored["method"] == "output-error" and len(stored["parameters"]) == 32
    assert (run / "refined-output-error.png").stat().st_size > 10_000
    assert not list(run.glob(".*"))  # no leftovers of writing at once
    from aircraft_sysid_ros.commands import refine

    shown = refine.render(printed)
    assert "CZ_alpha" in shown and printed["file"] in shown and "held out" in shown
    assert printed["worse"] == [] and "WORSE" not in shown
    printed["held_out"]["Cl"]["nrmse"] = 2.0 * printed["held_out"]["Cl"]["nrmse_of_run"]  # a model that lacks something
    printed["worse"] = worse_axes(printed["held_out"])
    assert printed["worse"] == ["Cl"] and "held-out C_l predicted worse" in refine.render(printed)


def says(capsys, *arguments):
    """Status 2 and the one line on standard error."""
    capsys.readouterr()
    assert main(["refine", *map(str, arguments)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    return err


def test_bad_input_is_one_sentence(run, tmp_path, capsys):
    assert "is no run" in says(capsys, tmp_path)
    assert "--segment" in says(capsys, run, "--segment", "0")
    copy = tmp_path / "copy"
    copy.mkdir()
    for name in ("parameters.json", "state.json", "aircraft.yaml", "points.npz"):
        (copy / name).write_bytes((run / name).read_bytes())
    assert "holds no samples" in says(capsys, copy)
    (copy / "samples.npz").write_bytes(b"nothing")
    assert "damaged" in says(capsys, copy)
    assert not list(copy.glob("refined*"))
