"""The way of a flight-test engineer: a bag replayed, the model compared, what it lacks named, added and reported."""

import json
import re

import pytest
from documented_commands import ROOT
from rosbags.highlevel import AnyReader

WAY = {
    "simulate": ("README.md", "aircraft-sysid simulate --out flight --effect sideslip_drag"),
    "replay": ("README.md", "aircraft-sysid replay flight --aircraft"),
    "campaign": ("docs/recordings.md", "aircraft-sysid replay flight --aircraft"),
    "compare": ("README.md", "aircraft-sysid compare runs/flight"),
    "diagnose": ("README.md", "aircraft-sysid diagnose runs/flight"),
    "add": ("README.md", "aircraft-sysid add runs/flight sideslip_drag"),
    "refine": ("README.md", "aircraft-sysid refine runs/flight"),
    "report": ("README.md", "aircraft-sysid report runs/flight --out flight.html"),
    "remove": ("README.md", "aircraft-sysid remove runs/flight sideslip_drag"),
}


def test_from_a_bag_to_a_report(user):
    truth = simulated(user)
    replayed(user, truth)
    campaigned(user)
    before = compared(user)
    diagnosed(user, before)
    version, after = added(user, before)
    refined(user, version)
    reported(user, after)
    removed(user, before)


def read(path):
    return json.loads(path.read_text(encoding="utf8"))


def simulated(user):
    """A bag that hides the drag of sideslip, with the truth beside it."""
    said = user.ask("simulate", "--duration", 40)
    truth = read(user.folder / said["truth"])
    assert [hidden["effect"] for hidden in truth["hidden"]] == ["sideslip_drag"]
    with AnyReader([user.folder / "flight"]) as bag:
        topics = {c.topic for c in bag.connections}
    assert topics >= {"/imu/data", "/gps/fix", "/gps/vel", "/air_data", "/control_surfaces"}
    return truth


def replayed(user, truth):
    """Parameters of the axes that lack nothing, within their standard errors of the truth; estimates in a bag."""
    user.ask("replay")
    run = user.folder / "runs" / "flight"
    parameters = {p["name"]: p for p in read(run / "parameters.json")["parameters"]}
    known = [p for p in parameters.values() if p["status"] == "USE" and not p["name"].startswith("CX")]
    assert len(known) > 15
    for p in known:
        assert abs(p["value"] - truth["coefficients"][p["name"]]) < 4.0 * p["std"], p["name"]
    assert read(run / "state.json")["duration"] == pytest.approx(40.0, abs=2.0)
    with AnyReader([run / "estimates.mcap"]) as estimates:
        assert "/parameter_estimator/parameters" in {c.topic for c in estimates.connections}


def campaigned(user):
    """The segments of the page as one body of data."""
    page = (ROOT / "docs" / "recordings.md").read_text(encoding="utf8")
    (segments,) = re.findall(r"^```yaml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    (user.folder / "segments.yaml").write_text(segments, encoding="utf8")
    said = user.ask("campaign")
    assert [m["name"] for m in said["state"]["manoeuvres"]] == ["elevator", "rudder", "turns"]
    assert said["state"]["duration"] == pytest.approx(30.0, abs=0.5) and not said["notes"]


def compared(user):
    """Errors by axis: that of C_X, which lacks a term, stands out, and is the first of the places where it fails."""
    found = user.ask("compare")
    over_noise = {axis: e["nrmse_held_out"] / e["noise_floor"] for axis, e in found["axes"].items()}
    worst = max(over_noise, key=over_noise.get)
    assert worst == found["worst"][0]["axis"] == "CX" and over_noise[worst] > 5.0
    assert all(over_noise[axis] < 2.0 for axis in over_noise.keys() - {"CX"})
    assert not found["axes"]["CX"]["white"]
    return found


def diagnosed(user, before):
    """The effect by its name, with the error that its addition would leave."""
    found = user.ask("diagnose")
    assert found["verdict"] == "missing"
    first = found["candidates"][0]
    assert (first["effect"], first["axes"]) == ("sideslip_drag", ["CX"])
    assert first["p_value"] < 0.05 and first["error_after"] < 0.5 * first["error_before"]
    assert first["error_before"] <= 1.05 * before["axes"]["CX"]["nrmse_held_out"]


def added(user, before):
    """The held-out error falls; the new version is what is compared from now on, and an aircraft file for replay."""
    version = user.ask("add")
    change = version["axes"]["CX"]
    assert change["error_before"] == pytest.approx(before["axes"]["CX"]["nrmse_held_out"], rel=1e-6)
    assert change["error_after"] < 0.5 * change["error_before"]
    assert change["error_after"] > change["noise_floor"]
    after = user.ask("compare")
    assert after["model"] == version["model"] != before["model"]
    assert after["axes"]["CX"]["nrmse_held_out"] == pytest.approx(change["error_after"], rel=1e-6)
    file = f"runs/flight/models/{version['model']}/aircraft.yaml"
    again = user.ask("replay", **{"config/ultra_stick_25e.yaml": file, "runs/flight": "runs/again"})
    assert again["parameters"]["model"] == version["model"]
    return version, after


def refined(user, version):
    """Maximum likelihood of the version with the term, not of the model of the run."""
    found = user.ask("refine")
    assert found["model"] == version["model"] and found["converged"]
    terms = {p["name"]: p for p in found["parameters"]}
    run = user.folder / "runs" / "flight"
    fitted = {p["name"]: p for p in read(run / "models" / version["model"] / "parameters.json")["parameters"]}
    assert terms.keys() == fitted.keys()
    (new,) = terms.keys() - {p["name"] for p in read(run / "parameters.json")["parameters"]}
    assert terms[new]["status"] == "USE"
    assert abs(terms[new]["value"] - fitted[new]["value"]) < 5.0 * max(terms[new]["std"], fitted[new]["std"])


def reported(user, compared):
    """One file with the numbers of compare."""
    user.run("report")
    page = (user.folder / "flight.html").read_text(encoding="utf8")
    for axis, e in compared["axes"].items():
        for number in (e["nrmse_held_out"], e["noise_floor"]):
            assert f"{100 * number:.1f} %" in page, axis


def removed(user, before):
    """Without the effect everything is as it was."""
    version, errors = user.ask("remove"), before["axes"]["CX"]
    assert version["model"] == before["model"]
    assert version["axes"]["CX"]["error_after"] == pytest.approx(errors["nrmse_held_out"], rel=1e-6)
