"""The way of a flight-test engineer: a bag replayed, the model compared, what it lacks named, added and reported.

It is the tutorial of the missing effect and the example of README.md: its truth is told in full, and all commands, the
page and the report say one error.
"""

import json
import re

import pytest
from documented_commands import ROOT
from rosbags.highlevel import AnyReader

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.commands.diagnose import render
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.workbench.run_view import load_run_view
from aircraft_sysid_ros.workbench.views.candidates import cards
from aircraft_sysid_ros.workbench.views.coefficients import axis_rows
from aircraft_sysid_ros.workbench.views.words import percent

MISSING, PX4 = "docs/tutorials/find-a-missing-effect.md", "docs/tutorials/beside-px4.md"
WAY = {
    "simulate": (
        MISSING,
        "aircraft-sysid simulate --out flight --effect sideslip_drag",
    ),
    "replay": (MISSING, "aircraft-sysid replay flight --aircraft"),
    "campaign": ("docs/recordings.md", "aircraft-sysid replay flight --aircraft"),
    "compare": (MISSING, "aircraft-sysid compare runs/flight"),
    "diagnose": (MISSING, "aircraft-sysid diagnose runs/flight"),
    "add": (MISSING, "aircraft-sysid add runs/flight sideslip_drag"),
    "refine": ("README.md", "aircraft-sysid refine runs/flight"),
    "report": ("docs/tutorials/first-flight.md", "aircraft-sysid report runs/flight --out flight.html"),
    "gains": (PX4, "aircraft-sysid gains runs/today"),
    "export": (PX4, "aircraft-sysid export runs/today"),
    "remove": (MISSING, "aircraft-sysid remove runs/flight sideslip_drag"),
}
SECONDS = 45  # of flight
#: Diagnosis does without the covariance of the smoother, which is summed in another order.
SAME = {"rel": 1e-6}


def test_from_a_bag_to_a_report(user):
    truth = simulated(user)
    replayed(user, truth)
    campaigned(user)
    before = compared(user)
    found = diagnosed(user, before)
    version, after = added(user, before, found)
    refined(user, version)
    card = shown(user.folder / "runs" / "flight", found, {before["model"]: before, version["model"]: after})
    reported(user, after, card)
    taken_to_px4(user)
    removed(user, before)


def read(path):
    return json.loads(path.read_text(encoding="utf8"))


def simulated(user):
    """A bag that hides the drag of sideslip, with the truth beside it."""
    said = user.ask("simulate", "--duration", SECONDS)
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
    assert read(run / "state.json")["duration"] == pytest.approx(SECONDS, abs=2.0)
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
    """The effect by its name and no other, with the error that its addition would leave."""
    said = user.ask("diagnose", "--replicas", 2)
    assert said == read(user.folder / "runs" / "flight" / "diagnosis.json")
    assert [c["effect"] for c in said["candidates"] if c["found"]] == ["sideslip_drag"]
    assert said["verdict"] == "missing"
    assert said["advice"] == f"{BY_ID['sideslip_drag'].name} is missing (add sideslip_drag)."
    found = said["candidates"][0]
    assert found["axes"] == ["CX"] and found["p_value"] < 0.05
    assert found["error_before"] == pytest.approx(before["axes"]["CX"]["nrmse_held_out"], **SAME)
    nested = found["nested"]
    assert nested["same"] == nested["parts"] == 4
    assert nested["error_after"] == pytest.approx(found["error_after"], rel=0.2)
    assert "    to add: aircraft-sysid add runs/flight sideslip_drag\n" in render(said)
    return found


def added(user, before, found):
    """The error falls as was said; the new version is compared from now on, and an aircraft file for replay."""
    version = user.ask("add")
    assert list(version["axes"]) == ["CX"]
    change = version["axes"]["CX"]
    after = user.ask("compare")
    assert after["model"] == version["model"] != before["model"]
    errors = [{axis: e["nrmse_held_out"] for axis, e in compared["axes"].items()} for compared in (before, after)]
    assert [change["error_before"], change["error_after"]] == [each.pop("CX") for each in errors]
    assert errors[0] == errors[1] and errors[0].keys() == set(AXES) - {"CX"}
    assert found["error_after"] == pytest.approx(change["error_after"], **SAME)
    assert change["noise_floor"] < change["error_after"] < 0.5 * change["error_before"]
    assert after["axes"]["CX"]["nrmse_held_out"] < 1.3 * after["axes"]["CX"]["noise_floor"]
    file = f"runs/flight/models/{version['model']}/aircraft.yaml"
    again = user.ask("replay", **{"config/ultra_stick_25e.yaml": file, "runs/flight": "runs/again"})
    assert again["parameters"]["model"] == version["model"]
    return version, after


def refined(user, version):
    """Maximum likelihood of the version with the term, not of the model of the run."""
    found = user.ask("refine")
    assert found["model"] == version["model"] and found["converged"]
    terms = {p["name"]: p for p in found["parameters"]}
    assert sum(p["status"] == "USE" and name.startswith("CX") for name, p in terms.items()) > 2
    run = user.folder / "runs" / "flight"
    fitted = {p["name"]: p for p in read(run / "models" / version["model"] / "parameters.json")["parameters"]}
    assert terms.keys() == fitted.keys()
    (new,) = terms.keys() - {p["name"] for p in read(run / "parameters.json")["parameters"]}
    assert terms[new]["status"] == "USE"
    assert abs(terms[new]["value"] - fitted[new]["value"]) < 5.0 * max(terms[new]["std"], fitted[new]["std"])


def shown(run, found, compared):
    """The page has the numbers of compare by version, and those of diagnose on its card."""
    view = load_run_view(run)
    assert (view.versions[0].identifier, view.current) == tuple(compared)
    for version, said in compared.items():
        for row in axis_rows(view.comparisons[version]):
            assert row.held_out == said["axes"][row.axis]["nrmse_held_out"]
    card = cards(read(run / "diagnosis.json"), view.flight)[0]
    assert (card.before, card.after) == (found["error_before"], found["error_after"])
    return card


def reported(user, compared, card):
    """One file with the numbers of compare."""
    user.run("report")
    page = (user.folder / "flight.html").read_text(encoding="utf8")
    for axis, e in compared["axes"].items():
        assert f'data-testid="error-{axis}">{percent(e["nrmse_held_out"])} %<' in page
        assert f"{100 * e['noise_floor']:.1f} %" in page, axis
    assert card.gain in page


def taken_to_px4(user):
    """Gains and parameters for QGroundControl: tab-separated lines of system, component, name, value and type."""
    for step, file, name in (("gains", "first.params", "FW_PR_FF"), ("export", "model.params", "FW_AIRSPD_STALL")):
        user.run(step, **{"runs/today": "runs/flight"})
        lines = [line.split("\t") for line in (user.folder / file).read_text(encoding="utf8").splitlines()]
        values = {words[2]: float(words[3]) for words in lines if not words[0].startswith("#")}
        assert values[name] > 0.0


def removed(user, before):
    """Without the effect everything is as it was."""
    version, errors = user.ask("remove"), before["axes"]["CX"]
    assert version["model"] == before["model"]
    assert version["axes"]["CX"]["error_after"] == pytest.approx(errors["nrmse_held_out"], rel=1e-6)
