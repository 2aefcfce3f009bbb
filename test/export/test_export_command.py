"""``export`` and ``gains`` as users type them, and what they refuse: one sentence, exit status 2, nothing written."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.io import loadmat

from aircraft_sysid_ros.commands.export import check_travel, travel_notes
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.export.exported import loss_line
from aircraft_sysid_ros.export.learnt_model import percent
from aircraft_sysid_ros.export.targets import TARGETS

OUT = {
    "jsbsim": "a.xml", "ardupilot-sitl": "a.json", "gazebo": "a.sdf", "px4": "a.params", "matlab": "a.mat",
    "csv": "a.csv",
}  # fmt: skip


def answer(capsys, *words):
    assert main([*map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys, *words):
    """The sentence."""
    capsys.readouterr()  # what a slow fixture has said
    assert main([*map(str, words)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    return err


@pytest.mark.long
@pytest.mark.parametrize("target", OUT)
def test_every_target_is_written_with_range_and_warning(exported_run, tmp_path, capsys, target):
    out = tmp_path / OUT[target]
    found = answer(capsys, "export", exported_run, "--to", target, "--out", out)
    assert out.stat().st_size > 500 and [f.name for f in tmp_path.iterdir()] == [OUT[target]]
    assert found["file"] == str(out) and found["target"] == target
    assert found["ranges"]["V"][0] > 10.0 and len(found["parameters"]) == 32
    assert {p["status"] for p in found["parameters"]} <= {"USE", "HOLD", "REJECT"}
    assert b"ot known to hold" in out.read_bytes() or b"OT KNOWN TO HOLD" in out.read_bytes()


@pytest.mark.long
def test_people_are_told_the_range_and_what_is_lost(exported_run, tmp_path, capsys):
    assert main(["export", str(exported_run), "--to", "gazebo", "--out", str(tmp_path / "a.sdf")]) == 0
    said = capsys.readouterr().out
    assert "OUTSIDE OF IT THE MODEL IS NOT KNOWN TO HOLD" in said and "lost over the flight's own rows" in said
    assert "Cem0 and Cema" in said
    lost = next(line for line in said.splitlines() if line.startswith("lost over")).partition(": ")[2]
    assert re.fullmatch(r"(C[XYZlmn] \d+(\.\d+)? %(, |$)){6}", lost), "no powers of ten for people"


@pytest.mark.parametrize("share", [0.0, 4.3e-4, 0.0163, 0.58, 0.996, 1.786, 71.39])
def test_a_share_is_said_in_per_cent_without_a_power_of_ten(share):
    number, unit = percent(share).split(" ")
    assert unit == "%" and "e" not in number and float(number) == pytest.approx(100.0 * share, rel=0.06, abs=1e-12)


def test_a_loss_that_is_not_known_is_not_said_to_be_none():
    assert loss_line({"CZ": 0.012, "CY": float("nan"), "Cn": 0.0}).endswith(": CZ 1.2 %, CY not known, Cn 0 %")


@pytest.mark.parametrize("target", [target for target in OUT if target != "csv"])
def test_a_flight_whose_sideslip_is_not_known_is_exported(learnt, target):
    """Without a vane C_Y, C_l and C_n are not learnt, and the sideslip is NaN in all rows."""
    signals = learnt.signals.copy()
    signals[:, learnt.model.signal_names.index("beta")] = np.nan
    lateral = [learnt.model.axis_slice(axis) for axis in ("CY", "Cl", "Cn")]
    unknown = {k for part in lateral for k in range(part.start, part.stop)}
    parameters = tuple(
        replace(p, value=np.nan, std=np.nan, status="HOLD") if k in unknown else p
        for k, p in enumerate(learnt.parameters)
    )
    blind = replace(learnt, signals=signals, parameters=parameters)
    full = np.radians([25.0, 20.0, 30.0])
    found, known = (TARGETS[target].write(each, full, TARGETS[target].versions[0]) for each in (blind, learnt))
    for axis in found.lost.keys() & {"CX", "CZ", "Cm"}:
        assert 0.0 <= found.lost[axis] <= 1.2 * known.lost[axis], axis
    for axis in found.lost.keys() & {"CY", "Cl", "Cn"}:
        assert np.isnan(found.lost[axis]), f"nothing is known of {axis}, and 0 % of it was said to be lost"
    if target == "px4":
        assert "\tFW_W_C_B1\t" not in found.content and "\tFW_W_C_A1\t" in found.content
        assert any("not known, so that FW_W_C_B1 is left out" in note for note in found.notes)
    if isinstance(found.content, str):
        assert not re.search(r"\bnan\b", found.content)


def test_how_far_the_surfaces_go_is_said_where_nobody_gave_it(exported_run, learnt, tmp_path, capsys):
    words = ("export", exported_run, "--to", "jsbsim", "--overwrite", "--out", tmp_path / "a.xml")
    (note,) = (note for note in answer(capsys, *words)["notes"] if "--full-deflection" in note)
    reached = max(map(abs, learnt.ranges["de"]))
    assert f"elevator {np.degrees(reached):.1f}, aileron" in note
    assert not [n for n in answer(capsys, *words, "--full-deflection", "25,20,30")["notes"] if "--full-deflection" in n]


def test_the_table_and_the_mat_hold_the_parameters_as_the_run_has_them(exported_run, learnt, tmp_path, capsys):
    listed = json.loads((exported_run / "parameters.json").read_text())["parameters"]
    for target in ("csv", "matlab"):
        answer(capsys, "export", exported_run, "--to", target, "--out", tmp_path / OUT[target])
    lines = [line for line in (tmp_path / "a.csv").read_text().splitlines() if not line.startswith("#")]
    rows = {row["parameter"]: row for row in csv.DictReader(lines)}
    model = loadmat(tmp_path / "a.mat", simplify_cells=True)["model"]
    for k, p in enumerate(listed):
        assert float(rows[p["name"]]["value"]) == p["value"] == model["value"][k] == model["coefficients"][p["name"]]
        assert float(rows[p["name"]]["standard_error"]) == p["std"] == pytest.approx(model["standard_error"][k])
        assert rows[p["name"]]["status"] == p["status"] == model["status"][k]
    assert float(rows["alpha"]["value"]) == learnt.ranges["alpha"][0] == model["range"]["alpha"][0]
    assert np.sqrt(np.diag(model["covariance"])) == pytest.approx(model["standard_error"])
    assert np.all(np.linalg.eigvalsh(model["covariance"]) > 0.0)


@pytest.mark.long
def test_gains_are_written_for_either_autopilot(exported_run, tmp_path, capsys):
    for target, name, one in (("px4", "a.params", "FW_RR_P"), ("arduplane", "a.param", "RLL_RATE_P")):
        words = ("gains", exported_run, "--to", target, "--full-deflection", "25,20,30", "--out", tmp_path / name)
        found = answer(capsys, *words)
        value = next(g["value"] for g in found["gains"] if g["name"] == one)
        assert f"{value:.6f}" in (tmp_path / name).read_text()
        assert found["loops"]["roll"]["gain_margin_db"] > 9.99 and found["loops"]["pitch"]["stable_share"] > 0.994


def copied(run, tmp_path):
    return shutil.copytree(run, tmp_path / "copy")


def test_a_run_without_use(exported_run, tmp_path, capsys):
    run = copied(exported_run, tmp_path)
    listed = json.loads((run / "parameters.json").read_text())
    for p in listed["parameters"]:
        p["status"], p["reason"] = "HOLD", "the air was taken as calm, and was not"
    listed["parameters"][0]["reason"] = "what holds this one alone"
    (run / "parameters.json").write_text(json.dumps(listed))
    said = refused(capsys, "export", run, "--to", "csv", "--out", tmp_path / "a.csv")
    assert "no parameter with USE (the air was taken as calm, and was not)" in said
    assert not (tmp_path / "a.csv").exists()


@pytest.mark.long
def test_what_rests_on_parameters_that_are_not_to_be_used_is_not_set(exported_run, tmp_path, capsys):
    """A file that is loaded into an autopilot; what does not rest on them is set as before."""
    run = copied(exported_run, tmp_path)
    listed = json.loads((run / "parameters.json").read_text())
    for p in listed["parameters"]:
        if p["name"] == "Cm_de":
            p["status"] = "HOLD"
    (run / "parameters.json").write_text(json.dumps(listed))
    words = ("export", run, "--to", "px4", "--full-deflection", "25,20,30", "--out", tmp_path / "a.params")
    assert any(
        "TRIM_PITCH" in note and "stand in the file as comments" in note for note in answer(capsys, *words)["notes"]
    )
    lines = (tmp_path / "a.params").read_text().splitlines()
    is_set = {line.split("\t")[2]: not line.startswith("#") for line in lines if line.count("\t") == 4}
    assert not is_set["TRIM_PITCH"] and not is_set["FW_DTRIM_P_VMIN"]
    assert is_set["TRIM_ROLL"] and is_set["FW_AIRSPD_TRIM"] and is_set["FW_PSP_OFF"]
    assert [line for line in lines if line.startswith("# TRIM_PITCH") and "rests on Cm_de (HOLD)" in line]


def test_a_file_that_is_there_is_kept_unless_it_shall_be_replaced(exported_run, tmp_path, capsys):
    out = tmp_path / "a.csv"
    out.write_text("mine")
    words = ("export", exported_run, "--to", "csv", "--out", out)
    assert "already there" in refused(capsys, *words) and out.read_text() == "mine"
    answer(capsys, *words, "--overwrite")
    assert out.read_text() != "mine"
    link = tmp_path / "b.csv"
    link.symlink_to("nowhere")
    assert "already there" in refused(capsys, "export", exported_run, "--to", "csv", "--out", link)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--to", "csv", "--out", "a.txt"], "ends in .csv"),
        (["--to", "csv", "--out", "no/where/a.csv"], "no/where is not there: make the folder first"),
        (["--to", "xplane", "--out", "a.acf"], "invalid choice: 'xplane'"),
        (["--to", "px4", "--target-version", "v0.1", "--out", "a.params"], "v0.1 of px4 is not known: it is main or"),
        (["--to", "csv", "--out", "a.csv", "--model", "nope"], "has no model 'nope'"),
        (["--to", "px4", "--out", "a.params", "--full-deflection", "25,20"], "give three degrees"),
        (["--to", "px4", "--out", "a.params", "--full-deflection", "25,0,nan"], "above 0 and at most 90"),
        (["--to", "px4", "--out", "a.params", "--full-deflection", "25,20,300"], "above 0 and at most 90"),
    ],
)
def test_bad_input_is_one_sentence(exported_run, tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    if "xplane" in words:
        with pytest.raises(SystemExit) as stopped:
            main(["export", str(exported_run), *words])
        assert stopped.value.code == 2
        err = capsys.readouterr().err
    else:
        err = refused(capsys, "export", exported_run, *words)
    assert said in err and not list(tmp_path.iterdir())


def test_a_file_is_no_folder(exported_run, tmp_path, capsys):
    (tmp_path / "here").touch()
    err = refused(capsys, "export", exported_run, "--to", "csv", "--out", tmp_path / "here" / "a.csv")
    assert "here is not a folder" in err


def test_a_folder_that_cannot_be_written_to(exported_run, tmp_path, capsys):
    if os.geteuid() == 0:
        out = "/proc/self/a.csv"  # where root may not write either
    else:
        (tmp_path / "locked").mkdir(mode=0o500)
        out = tmp_path / "locked" / "a.csv"
    assert "cannot write" in refused(capsys, "export", exported_run, "--to", "csv", "--out", out)


def test_what_is_no_run_and_a_damaged_one(exported_run, tmp_path, capsys):
    assert "is not a run" in refused(capsys, "export", tmp_path, "--to", "csv", "--out", tmp_path / "a.csv")
    run = copied(exported_run, tmp_path)
    (run / "parameters.json").write_text("{")
    said = refused(capsys, "gains", run, "--to", "px4", "--full-deflection", "25,20,30")
    assert "damaged" in said and "parameters.json" in said


def test_gains_ask_for_the_travel_of_the_surfaces_and_for_an_actuator_that_can_be(exported_run, capsys):
    assert "--full-deflection" in refused(capsys, "gains", exported_run, "--to", "px4")
    words = ("gains", exported_run, "--to", "px4", "--full-deflection", "25,20,30", "--actuator-lag", "nan")
    assert "--actuator-lag" in refused(capsys, *words)


@pytest.mark.parametrize("command", [("gains",), ("export", "--out", "a.params")])
def test_a_travel_in_radians_is_no_full_deflection(exported_run, capsys, tmp_path, monkeypatch, command):
    """Trims of -1.57 and a feed-forward of 20.7 were written without a word."""
    monkeypatch.chdir(tmp_path)
    words = (command[0], exported_run, "--to", "px4", *command[1:], "--full-deflection", "0.436,0.436,0.436")
    said = refused(capsys, *words)
    assert "0.436 deg of elevator" in said and "give degrees" in said and not [*tmp_path.iterdir()]


@pytest.mark.parametrize(("said", "later"), [({"delay": 0.1}, False), ({"delay": -0.1}, True), ({"lag": 0.1}, True)])
def test_only_of_surfaces_that_follow_later_servos_are_told_to_be_late(exported_run, tmp_path, capsys, said, later):
    """Of positions that are recorded late it said to give servos that: to move before they are told."""
    run = copied(exported_run, tmp_path)
    content = yaml.safe_load((run / "aircraft.yaml").read_text())
    content["sensors"] = {**content.get("sensors", {}), "control_surfaces": said}
    (run / "aircraft.yaml").write_text(yaml.safe_dump(content, explicit_end=True))
    notes = answer(capsys, "export", run, "--to", "csv", "--out", tmp_path / "a.csv")["notes"]
    assert any("give the servos of the other program the same" in note for note in notes) is later
    assert not any("earlier" in note for note in notes)


def test_of_a_surface_that_hardly_moved_it_is_not_said_that_it_went_further(learnt):
    """Full command was "the largest deflection that was flown, … rudder 1.0 deg" of one that never moved, and the true
    half a degree of its travel was refused since it had "reached 1 deg"."""

    def flown(**degrees):
        rows, names = learnt.signals.copy(), learnt.model.signal_names
        for name, most in degrees.items():
            rows[:, names.index(name)] *= np.radians(most) / np.abs(learnt.signal(name)).max()
        return replace(learnt, signals=rows)

    def travel(**degrees):
        (note,) = travel_notes(flown(**degrees), None, TARGETS["jsbsim"])
        return note.removeprefix("no --full-deflection: full command is ").removesuffix("; give what is there")

    moved = {"de": 18.2, "da": 5.9}
    both = "the largest deflection that was flown, elevator 18.2, aileron 5.9"
    assert travel(**moved, dr=1.3) == f"{both}, rudder 1.3 deg"
    assert travel(**moved, dr=0.0) == f"{both} deg, and 1 deg for the rudder, which went less far"
    assert travel(de=0.5, da=0.0, dr=0.0) == "1 deg for the elevator, aileron and rudder, which went less far"
    check_travel(flown(dr=0.3), np.radians([25.0, 20.0, 0.5]))
