"""``add`` and ``remove`` as a user calls them; the new aircraft file flies."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from aircraft_sysid_ros.commands.add import render
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.commands.options import parameter_table


@pytest.fixture
def run(run_with_hidden_effect, tmp_path, capsys) -> Path:
    shutil.copytree(run_with_hidden_effect, tmp_path / "run")
    capsys.readouterr()
    return tmp_path / "run"


def call(capsys, *arguments) -> dict:
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_add_compare_remove(run, pictures, capsys) -> None:
    before = call(capsys, "compare", run)
    added = call(capsys, "add", run, "CZ: alpha**3")
    errors = added["axes"]["CZ"]
    assert added["added"] == "CZ: alpha**3" and added["improved"]
    assert errors["error_before"] == pytest.approx(before["axes"]["CZ"]["nrmse_held_out"], rel=1e-9)
    assert errors["error_after"] < 1.25 * errors["noise_floor"] < errors["error_before"]
    assert Path(added["figure"]).read_bytes().startswith(b"\x89PNG")
    after = call(capsys, "compare", run)
    assert after["model"] == added["model"] != before["model"]
    assert after["axes"]["CZ"]["nrmse_held_out"] == pytest.approx(errors["error_after"], rel=1e-9)
    removed = call(capsys, "remove", run, "CZ: alpha**3")
    assert removed["model"] == before["model"] and removed["removed"] == "CZ: alpha**3"


@pytest.mark.long
def test_the_aircraft_file_of_a_version_replays(run, run_with_hidden_effect, capsys) -> None:
    added = call(capsys, "add", run, "CZ: alpha**3")
    bag = run_with_hidden_effect.parent / "flight"
    replayed = call(capsys, "replay", bag, "--aircraft", added["aircraft"], "--out", run.parent / "again")
    values = {p["name"]: p["value"] for p in replayed["parameters"]["parameters"]}
    assert replayed["parameters"]["model"] == added["model"]
    assert values["CZ_alpha3"] == pytest.approx(60.0, rel=0.2)


@pytest.mark.long
def test_people_read_what_changed(run, capsys) -> None:
    assert main(["add", str(run), "CZ: alpha**3"]) == 0
    text = capsys.readouterr().out
    assert "CZ_alpha3 = " in text and "the held-out error falls" in text
    assert main(["add", str(run), "Cn: alpha*beta"]) == 0
    assert "does not lower the held-out error" in capsys.readouterr().out
    assert main(["remove", str(run), "Cn: alpha*beta"]) == 0
    assert "without 'Cn: alpha*beta'" in capsys.readouterr().out


@pytest.mark.parametrize("what", ["stal", "CZ: alpha", "CQ: beta", "CZ: import os", "", "CZ: flap"])
def test_bad_requests_are_one_line_and_exit_2(what: str, run, capsys) -> None:
    assert main(["add", str(run), what]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and len(captured.err.splitlines()) == 1 and "Error" not in captured.err
    assert not (run / "model.json").exists() and not (run / "models").exists()


def test_a_long_name_of_an_added_term_keeps_the_columns_in_line() -> None:
    names = ("CX_0", "CX_0.0666667*(sqrt(1+(beta/0.0666667)**2)-1)", "CZ_alpha")
    rows = [{"name": name, "value": -0.1, "std": 0.01, "status": "USE", "reason": ""} for name in names]
    head, _, *lines = parameter_table(rows).splitlines()
    assert {line.index("USE") for line in lines} == {head.index("status")}


def test_a_term_of_which_nothing_is_known_is_told_with_its_reason():
    """After the version was written, add ended with a traceback."""
    parameter = {"name": "CZ_flaps", "value": None, "std": None, "status": "HOLD", "reason": "not enough motion yet"}
    result = {
        "model": "1", "parents": [], "axes": {}, "parameters": [parameter], "settings": [], "verdict": "better",
        "aircraft": "a.yaml", "figure": None, "notes": [],
    }  # fmt: skip
    assert "CZ_flaps is not known: not enough motion yet" in render(result)
    parameter |= {"value": -16.0, "std": 2e4, "reason": "its standard error is 125000 % of its value"}
    assert "CZ_flaps = 0 ± 20000, HOLD: its standard error is 125000 % of its value" in render(result)
