"""The file of a run holds what its page shows: the calibration and the refinement of the run, and what is missing."""

from __future__ import annotations

import json
import re
import shutil

import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.refinement.refined_file import METHODS, refined_name
from aircraft_sysid_ros.workbench.calibration_view import RESULT, of_run
from aircraft_sysid_ros.workbench.views.words import percent

ERRORS = (0.2345, 0.1234)


def words_of(file) -> str:
    """Text of a file without its scripts, on one line."""
    text = re.sub(r"<(script|style)\b.*?</\1>", "", file.read_text(encoding="utf8"), flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]*>", " ", text).split())


@pytest.fixture
def worked_on(run, calibration):
    """A run that was refined and calibrated on its page."""
    shutil.copytree(calibration, of_run(run, "five-hole"))
    listed = json.loads((run / "parameters.json").read_text())["parameters"]
    (run / refined_name(METHODS[0])).write_text(
        json.dumps({
            "parameters": listed, "not_fitted": {"Cl": {"nrmse_before": ERRORS[0], "nrmse": ERRORS[1]}},
            "converged": True, "reason": "", "iterations": 7, "seconds_fitted": 40.0, "elapsed": 3.0, "worse": [],
        })
    )  # fmt: skip
    return run


@pytest.mark.long
def test_refinement_and_calibration_of_the_page_are_in_the_file(worked_on, tmp_path) -> None:
    """`report` left out both without a word."""
    out = tmp_path / "file.html"
    assert main(["report", str(worked_on), "--out", str(out)]) == 0
    words = words_of(out)
    assert "One clear minimum" in words and "Converged after 7 iterations" in words
    assert all(f"{percent(error)} %" in words for error in ERRORS)


@pytest.mark.long
def test_what_cannot_be_read_is_said_in_the_file(worked_on, tmp_path, capsys) -> None:
    """A colleague who gets the file saw a run without State and without any word of it."""
    (of_run(worked_on, "five-hole") / RESULT).write_text("{")
    (worked_on / "estimates.mcap").write_bytes(b"")
    out = tmp_path / "file.html"
    assert main(["report", str(worked_on), "--out", str(out)]) == 0
    for words in (words_of(out), " ".join(capsys.readouterr().out.split())):
        assert "without the state: " in words and "without the calibration: " in words
