"""What a refinement of the same run contradicts is released with HOLD: by export, gains, Python and compare --with."""

from __future__ import annotations

import json
import re
import shutil

import pytest

from aircraft_sysid_ros import api
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run, released_parameters, run_data
from aircraft_sysid_ros.refinement.refined_file import FILTER_ERROR, OUTPUT_ERROR, refined_name, says_otherwise
from aircraft_sysid_ros.run_reader import read_parameters

FULL = ("--full-deflection", "25,20,30")


@pytest.fixture
def run(exported_run, tmp_path):
    """A copy of the run, which has Cl_da and Cm_de in USE."""
    copy = tmp_path / "run"
    shutil.copytree(exported_run, copy)
    known = read_parameters(copy)
    assert known["Cl_da"]["status"] == known["Cm_de"]["status"] == "USE"
    return copy


def refined(run, method, contradicted="", says=None):
    """As ``refine`` writes it: one parameter twice that of the run, the others as they are."""
    parameters = [dict(p) for p in read_parameters(run).values()]
    for p in parameters:
        if p["name"] == contradicted:
            reason = says_otherwise(p["value"] if says is None else says)
            p.update(value=2.0 * p["value"], status="HOLD", reason=reason)
    (run / refined_name(method)).write_text(json.dumps({"method": method, "parameters": parameters}))


def test_what_refine_contradicts_is_not_released_to_use(run, tmp_path, capsys):
    value = read_parameters(run)["Cl_da"]["value"]
    refined(run, FILTER_ERROR, "Cl_da")
    assert main(["export", str(run), "--to", "csv", "--out", str(tmp_path / "a.csv"), "--json"]) == 0
    exported = {p["name"]: p for p in json.loads(capsys.readouterr().out)["parameters"]}
    frame = api.Run(run).parameters
    for found in (exported["Cl_da"], frame.loc["Cl_da"]):
        assert (found["status"], found["value"]) == ("HOLD", value)
        said = re.match(r"filter-error of this flight says (\S+) ± ", found["reason"])
        assert said is not None and float(said[1]) == pytest.approx(2.0 * value, rel=1e-3)
        assert "use neither" in found["reason"]
    assert exported["Cm_de"]["status"] == frame.loc["Cm_de"]["status"] == "USE"
    assert main(["gains", str(run), "--to", "px4", *FULL]) == 2  # a roll loop on an aileron that is in doubt
    assert "Cl_da" in capsys.readouterr().err


def test_the_run_itself_stays_as_it_is_so_that_refine_may_be_asked_again(run):
    refined(run, FILTER_ERROR, "Cl_da")
    opened = open_run(run)
    assert run_data(opened, opened.current).parameters["Cl_da"]["status"] == "USE"


def test_filter_error_has_the_last_word(run):
    """Output error takes gusts for the aeroplane; what filter error has in USE, it does not hold."""
    refined(run, OUTPUT_ERROR, "Cl_da")
    opened = open_run(run)
    assert "output-error" in released_parameters(opened, opened.current)["Cl_da"]["reason"]
    refined(run, FILTER_ERROR)
    assert released_parameters(opened, opened.current)["Cl_da"]["status"] == "USE"
    refined(run, FILTER_ERROR, "Cm_de")
    assert released_parameters(opened, opened.current)["Cl_da"]["status"] == "USE"
    assert "filter-error" in released_parameters(opened, opened.current)["Cm_de"]["reason"]


def test_what_was_said_of_another_value_does_not_count(run):
    """As of a version that was made again from other settings."""
    refined(run, FILTER_ERROR, "Cl_da", says=1.5 * read_parameters(run)["Cl_da"]["value"])
    opened = open_run(run)
    assert released_parameters(opened, opened.current)["Cl_da"]["status"] == "USE"


@pytest.mark.parametrize("text", ["", "{", "[]", '{"parameters": [1]}', '{"parameters": [{"name": "Cl_da"}]}'])
def test_a_file_of_refine_that_is_damaged_is_no_refinement(run, text):
    (run / refined_name(FILTER_ERROR)).write_text(text)
    opened = open_run(run)
    assert released_parameters(opened, opened.current)["Cl_da"]["status"] == "USE"
