"""The commands of README.md on its example: the truth is told in full, and every command says the same error."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.workbench.run_view import load_run_view
from aircraft_sysid_ros.workbench.views.candidates import cards
from aircraft_sysid_ros.workbench.views.coefficients import axis_rows
from aircraft_sysid_ros.workbench.views.words import percent

#: Diagnosis does without the covariance of the smoother, which is summed in another order.
SAME = {"rel": 1e-6}


def command(*arguments: object) -> dict[str, Any]:
    """The document that a command prints, in a process of its own."""
    line = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", *map(str, arguments), "--json"]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


@pytest.fixture(scope="module")
def told(tmp_path_factory, aircraft_file) -> dict[str, Any]:
    """What each command of the example says, in order."""
    folder = tmp_path_factory.mktemp("example")
    bag, run = folder / "flight", folder / "run"
    command("simulate", "--out", bag, "--effect", "sideslip_drag")
    command("replay", bag, "--aircraft", aircraft_file, "--out", run)
    return {
        "run": run,
        "truth": json.loads((bag / "truth.json").read_text(encoding="utf8")),
        "compare": command("compare", run),
        "diagnose": command("diagnose", run),
        "add": command("add", run, "sideslip_drag"),
        "compare again": command("compare", run),
        "report": command("report", run, "--out", folder / "flight.html") and folder / "flight.html",
    }


def test_the_truth_of_the_example_is_told_in_full(told) -> None:
    said = told["diagnose"]
    assert [effect["effect"] for effect in told["truth"]["hidden"]] == ["sideslip_drag"]
    assert [c["effect"] for c in said["candidates"] if c["found"]] == ["sideslip_drag"]
    assert said["verdict"] == "missing"
    assert said["advice"] == f"{BY_ID['sideslip_drag'].name} is missing (add sideslip_drag)."
    after = told["compare again"]["axes"]["CX"]
    assert after["nrmse_held_out"] < 1.3 * after["noise_floor"]


def test_every_command_says_the_same_error(told) -> None:
    found, added = told["diagnose"]["candidates"][0], told["add"]["axes"]
    axis = found["main_axis"]
    before, after = (told[name]["axes"][axis]["nrmse_held_out"] for name in ("compare", "compare again"))
    assert list(added) == [axis] == ["CX"]
    assert found["error_before"] == pytest.approx(before, **SAME)
    assert found["error_after"] == pytest.approx(after, **SAME)
    assert (added[axis]["error_before"], added[axis]["error_after"]) == (before, after)
    for other in set(AXES) - {axis}:
        errors = [told[name]["axes"][other]["nrmse_held_out"] for name in ("compare", "compare again")]
        assert errors[0] == errors[1]


def test_the_page_and_the_report_say_it_too(told) -> None:
    run, found = told["run"], told["diagnose"]["candidates"][0]
    view = load_run_view(run)
    first, last = view.versions[0].identifier, told["add"]["model"]
    assert view.current == last
    for version, name in ((first, "compare"), (last, "compare again")):
        for row in axis_rows(view.comparisons[version]):
            assert row.held_out == told[name]["axes"][row.axis]["nrmse_held_out"]
    card = cards(json.loads((run / "diagnosis.json").read_text(encoding="utf8")), view.flight)[0]
    assert (card.before, card.after) == (found["error_before"], found["error_after"])
    html = Path(told["report"]).read_text(encoding="utf8")
    for axis, errors in told["compare again"]["axes"].items():
        assert f'data-testid="error-{axis}">{percent(errors["nrmse_held_out"])} %<' in html
    assert card.gain in html
