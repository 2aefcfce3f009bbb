"""``compare`` as a user calls it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.commands.main import main


@pytest.mark.long
def test_json_is_one_document_with_what_the_interface_promises(run_with_hidden_effect, pictures, capsys) -> None:
    capsys.readouterr()
    assert main(["compare", str(run_with_hidden_effect), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert list(result["axes"]) == list(AXES)
    errors = result["axes"]["CZ"]
    assert errors["nrmse_held_out"] > 3.0 * errors["noise_floor"] and errors["white"] is False
    assert result["worst"][0]["axis"] == "CZ"
    assert Path(result["figure"]).read_bytes().startswith(b"\x89PNG")


@pytest.mark.long
def test_people_get_a_table_and_where_it_fails(run_with_hidden_effect, capsys) -> None:
    capsys.readouterr()
    assert main(["compare", str(run_with_hidden_effect)]) == 0
    text = capsys.readouterr().out
    assert "C_Z, alpha above" in text and "compare.png" in text
    (row,) = [line for line in text.splitlines() if line.startswith("CZ ")]
    assert row.endswith("  fails")  # and no other word beside the places that are listed


@pytest.mark.long
def test_a_run_without_samples_is_compared_as_the_filter_saw_it(run_with_hidden_effect, tmp_path, capsys) -> None:
    run = tmp_path / "run"
    shutil.copytree(run_with_hidden_effect, run)
    (run / "samples.npz").unlink()
    capsys.readouterr()
    assert main(["compare", str(run), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["axes"]["CZ"]["nrmse_held_out"] > 0.05


WORDS = {
    "short": "20 s are needed", "nothing": "is not a run", "empty": "is not a run", "aircraft": "is cut off",
    "folder": "remove model.json",
}  # fmt: skip


@pytest.mark.parametrize("damage", ["nothing", "empty", "points", "samples", "short", "aircraft", "folder"])
def test_bad_runs_are_one_line_and_exit_2(damage: str, run_with_hidden_effect, tmp_path, capsys) -> None:
    run = tmp_path / "run"
    if damage != "nothing":
        shutil.copytree(run_with_hidden_effect, run)
    if damage == "empty":
        for path in run.iterdir():
            path.unlink()
    elif damage == "points":
        (run / "samples.npz").unlink()
        (run / "points.npz").write_bytes(b"")
    elif damage == "samples":
        (run / "samples.npz").write_bytes(b"not a zip")
    elif damage == "aircraft":  # cut after the first half: what is left is a valid aircraft file
        text = (run / "aircraft.yaml").read_text()
        (run / "aircraft.yaml").write_text(text[: text.index("sensors:")])
    elif damage == "folder":
        (run / "model.json").mkdir()
    elif damage == "short":
        import numpy as np

        with np.load(run / "samples.npz") as stored:
            arrays = {name: stored[name] for name in stored.files}
        early = arrays["stamp"] < arrays["stamp"].min() + 15 * 10**9
        np.savez(run / "samples.npz", **{name: values[early] for name, values in arrays.items()})
    capsys.readouterr()
    assert main(["compare", str(run)]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and len(captured.err.splitlines()) == 1
    assert WORDS.get(damage, "") in captured.err
