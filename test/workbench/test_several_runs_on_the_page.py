"""A folder of runs on one page: the list, the picker, two flights side by side, names, and what is wrong with a run."""

from __future__ import annotations

import http.client
import json
import shutil
import urllib.parse

import pytest
from page_marks import marked, wait_for_text

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.model_versions.additions import add, remove
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run, versions_of
from aircraft_sysid_ros.diagnosis.two_runs import Difference, SideBySide
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.workbench import markup, shelf
from aircraft_sysid_ros.workbench.views.words import percent, rounded

#: Name of the folder of a damaged run: text on the page, whatever it looks like.
HOSTILE = "<script>alert(1)<img src=x onerror=alert(1)>"
NOTE = "<img src=x onerror=alert(1)>\nsecond line"


#: What stands in the cells of each row of a table, each on one line.
CELLS = """(s) => [...document.querySelectorAll(s + " tr")].map((row) => [...row.cells].map(
  (cell) => cell.innerText.replace(/\\s+/g, " ")))"""


@pytest.fixture(scope="module")
def runs(hidden_effect, aircraft_file, tmp_path_factory):
    """Two flights, a run without its state, a flight that was cut off, and a folder that is none of a run."""
    folder = tmp_path_factory.mktemp("several")
    flight = ["--manoeuvres", "standard", "--duration", "40", "--seed", "8"]
    assert main(["simulate", "--out", str(folder / "flight"), "--aircraft", str(aircraft_file), *flight]) == 0
    made = folder / "runs"
    arguments = ["--aircraft", str(aircraft_file), "--out", str(made / "tuesday")]
    assert main(["replay", str(folder / "flight"), *arguments]) == 0
    shutil.copytree(hidden_effect, made / "monday")
    for name in (HOSTILE, "night.flying", "notes"):
        (made / name).mkdir()
    for name in (HOSTILE, "night.flying"):
        shutil.copy(hidden_effect / "aircraft.yaml", made / name)
    (made / "night.flying" / "flight.json").write_text("{}")
    return made


@pytest.mark.long
def test_two_flights_are_listed_compared_and_named(runs, served, open_page, capsys) -> None:
    capsys.readouterr()
    assert main(["compare", str(runs / "monday"), "--with", str(runs / "tuesday"), "--json"]) == 0
    both = json.loads(capsys.readouterr().out)["with"]
    with served(runs) as address:
        page = open_page(address, plots=0)
        listed = page.inner_text(marked("runs"))
        assert "state.json is not there" in listed and HOSTILE in listed and "aircraft-sysid recover night" in listed
        assert page.locator(marked("runs") + " button").count() == 2 and "notes" not in listed
        page.click("button[data-name=monday]")
        page.wait_for_selector(marked("plot-Cn") + " .main-svg")
        stands_beside(page, both)
        is_named(page, runs / "monday")
        page.locator(marked("run-picker")).click()  # the picker
        page.click(".q-menu >> text=tuesday")
        page.wait_for_url("**/?run=tuesday")
        page.wait_for_selector(marked("plot-Cn") + " .main-svg")
        refused_by_address(address)
        page.context.close()


def stands_beside(page, both) -> None:
    """What the page says of two flights is what `compare --with` says."""
    page.click(marked("tab-versions"))
    page.wait_for_selector(marked("differences") + " td")
    rows = [row.split("\t") for row in page.inner_text(marked("beside")).splitlines() if row.count("\t") == 4]
    shown = {row[0].split()[0]: row[1:] for row in rows if row[0].startswith("C")}
    assert shown == {
        axis: [f"{percent(share)} %" for row in table for share in row] for axis, table in both["errors"].items()
    }
    shown = {row[0]: row[1:4] for row in page.evaluate(CELLS, marked("differences")) if len(row) == 5}
    for p in both["parameters"]:
        estimates = [" ± ".join(rounded(value, std)) for value, std in zip(p["value"], p["std"], strict=True)]
        difference = " ± ".join(rounded(p["difference"], p["std_difference"]))
        assert shown[p["name"]] == [*estimates, difference + " ▲" * p["differs"]]
    assert page.locator(marked("differences") + " td.below").first.is_visible()
    assert (
        page.evaluate(
            "(b => b.scrollWidth - b.clientWidth)(document.querySelector('[data-testid=differences] .of-table'))"
        )
        <= 0
    )
    said = page.inner_text(marked("beside-words"))
    assert all(sentence in said for sentence in both["told"])
    assert "cells flown" in page.inner_text(marked("covered-other"))


def is_named(page, run) -> None:
    """A name with markup in its note is text, kept in the run, and taken back."""
    page.click(marked("naming") + " .q-item")
    page.fill(marked("version-name"), "base")
    page.fill(marked("version-note"), NOTE)
    page.click(marked("keep-name"))
    wait_for_text(page, "history", "<img src=x")
    assert not page.query_selector("[onerror]") and "“base”" in page.inner_text(marked("facts"))
    (label,) = (listed[-1] for listed in json.loads((run / "names.json").read_text())["labels"].values())
    assert label == {"name": "base", "note": NOTE}
    page.click(marked("undo-name"))
    page.wait_for_function("(s) => !document.querySelector(s).innerText.includes('base')", arg=marked("history"))


def refused_by_address(address) -> None:
    """A run is one of the list, whatever an address says; and nobody else's page is served."""
    place = urllib.parse.urlparse(address)
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=60)
    for name in (HOSTILE, "../monday", "/etc", "nobody", "<script>alert(1)</script>", "notes"):
        connection.request("GET", "/?" + urllib.parse.urlencode({"run": name}))
        answer = connection.getresponse()
        text = answer.read().decode()
        assert answer.status == 200 and "<script>alert(1)" not in text
        assert ("choose one of the list" in text) == (name != HOSTILE)
    connection.request("GET", "/?run=monday", headers={"Host": "evil.example"})
    assert connection.getresponse().status == 403
    connection.close()


@pytest.mark.long
def test_runs_that_nobody_looks_at_make_room(runs, monkeypatch) -> None:
    class Quiet:
        """A session that does nothing."""

        is_working = False

        def __init__(self, path) -> None:
            self.path, self.is_closed = path, False

        def close(self) -> None:
            self.is_closed = True

    monkeypatch.setattr(shelf, "Session", Quiet)
    monkeypatch.setattr(shelf, "MOST_OPEN", 1)
    found = shelf.Shelf([runs])
    first, release = found.session("monday"), found.hold("monday")
    with pytest.raises(InputError, match="close the page of one of them first"):
        found.session("tuesday")
    release()
    assert found.session("tuesday").path == runs / "tuesday" and first.is_closed
    with pytest.raises(InputError, match="there is no run gone here"):
        found.session("gone")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["monday", "monday"], "a run is given twice"),
        (["monday", "notes"], "is not a run"),
        (["monday", "nowhere"], "is not there"),
        (["."], "--truth and --calibration are for one run"),
    ],
)
def test_what_cannot_be_shown_together_is_one_sentence(runs, monkeypatch, capsys, arguments, said) -> None:
    monkeypatch.chdir(runs)
    more = ["--calibration", "."] if arguments == ["."] else []
    assert main(["workbench", *arguments, *more, "--no-browser", "--port", "0"]) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1


def test_what_only_one_flight_has_stands_there_with_its_value() -> None:
    reason = ("HOLD: it was not excited", "")
    doubtful = [Difference(name, (1.0, 2.0), (0.1, 0.1), 1e-9, reason) for name in ("Cl_beta", "Cl_p", "Cl_da")]
    both = SideBySide(
        ("one", "other"), ("a", "b"), False, tuple(doubtful), ({}, {"Cl_alpha*beta": (-0.5, 0.02)}), {}, ()
    )
    assert "no difference is proven: Cl_beta Cl_p Cl_da; Cl_beta in one is HOLD" in both.told[1]
    row = str(markup.differences(both)).rpartition("<tr>")[2]
    assert (
        "Cl_alpha*beta" in row
        and "−0.500 " in row
        and "± 0.020<" in row
        and row.index('<td class="n"></td>') < row.index("±")
    )


@pytest.mark.long
def test_the_list_counts_the_versions_of_the_history(run) -> None:
    for change in (add, remove, add):  # to take all back writes the first version once more
        change(run, "Cl: alpha*beta")
    assert shelf.look_at("run", run).versions == len(versions_of(open_run(run))[0]) == 2


@pytest.mark.parametrize(("file", "said"), [
    ("samples.npz", "samples.npz is cut off or damaged"), ("points.npz", "points.npz is cut off or damaged"),
    ("parameters.json", "parameters.json cannot be read"), ("state.json", "state.json cannot be read"),
])  # fmt: skip
def test_the_list_says_which_run_is_damaged(run, file, said) -> None:
    """It stood there as a sound one, and was set beside the others by itself."""
    assert not shelf.look_at("run", run).problem
    (run / file).write_bytes((run / file).read_bytes()[:40])
    assert shelf.look_at("run", run).problem == f"{said}: replay the recording again"
