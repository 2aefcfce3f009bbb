"""A fleet from its sources to its tables and its page, with flights whose answers are known."""

from __future__ import annotations

import contextlib
import json
import os

import numpy as np
import pandas as pd
import pytest

from aircraft_sysid_ros.commands import fleet as command
from aircraft_sysid_ros.commands.fleet import render
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet import fleet as module
from aircraft_sysid_ros.fleet.apart import Failed
from aircraft_sysid_ros.fleet.changes import Series
from aircraft_sysid_ros.fleet.fleet import Asked, fly_fleet
from aircraft_sysid_ros.fleet.flight_task import Options
from aircraft_sysid_ros.fleet.flights import Files
from aircraft_sysid_ros.fleet.page import _change, _nothing_said, _Scale, _scatter
from aircraft_sysid_ros.fleet.results import Results

DAY = 86_400 * 10**9
BEGIN = 20_000 * DAY
HOSTILE = "<script>alert(1)</script>"
COLUMNS = {
    "flights": ["flight", "airframe", "start", "ok", "reason"],
    "parameters": ["flight", "airframe", "start", "parameter", "value", "std", "status", "V", "alpha"],
    "verdicts": ["flight", "verdict", "effect", "axes", "p_value", "error_before", "error_after"],
    "changes": ["airframe", "parameter", "kind", "when", "size", "std", "p_value"],
    "errors": ["flight", "airframe", "start", "axis"],
    "sensors": ["flight", "airframe", "start", "sensor", "value", "std", "status"],
}


def answer(recording):
    """What a recording holds in these tests: number, airframe, true Cm_de (~ where it is held), scale of a sensor."""
    number, airframe, value, *scale = recording.read_text().split()
    rng = np.random.default_rng([int(number), ord(airframe)])
    parameters = [
        {
            "name": "Cm_de",
            "value": float(value.strip("~")) + 0.01 * rng.normal(),
            "std": 0.01,
            "status": "HOLD" if "~" in value else "USE",
        },
        {"name": "Cm_q", "value": 1e9, "std": None, "status": "HOLD"},
    ]
    sensors = [{"name": "airspeed.scale", "value": float(s) + 0.004 * rng.normal(), "std": 0.004} for s in scale]
    found = {"effect": "stall", "label": HOSTILE, "axes": ["CZ", "Cm"], "p_value": 0.001}
    return {
        "ok": True, "reason": "", "duration": 1800.0, "start": BEGIN + int(number) * DAY,
        "parameters": [{**p, "V": 20.0, "alpha": 0.05} for p in parameters],
        "sensors": [{**s, "status": "USE"} for s in sensors],
        "axes": {"Cm": {"nrmse_fit": 0.1, "nrmse_held_out": 0.2, "noise_floor": 0.1, "white": None}},
        "findings": [{"signal": "airspeed", "kind": "gap", "severity": "warning", "sentence": "a gap"}],
        "diagnosis": {
            "verdict": "missing" if airframe == "B" else "none", "advice": "", "false_alarm_rate": 0.05,
            "candidates": [found] if airframe == "B" else [],
        },
    }  # fmt: skip


@pytest.fixture
def flown(monkeypatch):
    """Jobs that were flown, in place of a cluster; a recording may hold the failure that it ends with."""
    names = []

    def fly_all(client, jobs, work, limits, done):
        for job in reversed(jobs):  # as they come
            names.append(job.recording.stem)
            text = job.recording.read_text()
            done(job, eval(text) if text.startswith("Failed(") else answer(job.recording))

    monkeypatch.setattr(module, "cluster", lambda *args: contextlib.nullcontext())
    monkeypatch.setattr(module, "has_dashboard", lambda: False)
    monkeypatch.setattr(module, "fly_all", fly_all)
    return names


@pytest.fixture
def place(tmp_path):
    """Ten flights of A, which loses a tenth of its elevator with the seventh, and of B, which does not."""
    for airframe in "AB":
        (tmp_path / "flights" / airframe).mkdir(parents=True)
        for number in range(10):
            value = -1.0 if airframe == "B" or number < 6 else -0.9
            (tmp_path / "flights" / airframe / f"{number}.mcap").write_text(f"{number} {airframe} {value}")
    (tmp_path / "aircraft.yaml").write_text("name: x")
    return tmp_path


def fly(place, time_limit=60.0, **more):
    out = place / "out"
    asked = Asked([str(place / "flights")], Files(str(place / "aircraft.yaml")), out, 2, time_limit, **more)
    return fly_fleet(asked, lambda *said: None, print), out


def test_what_changes_is_found_and_shown(place, flown):
    (place / "flights" / "B" / "x.mcap").write_text(f"Failed('{HOSTILE} is damaged')")
    fleet, out = fly(place)
    tables = {name: pd.read_parquet(out / f"{name}.parquet") for name in COLUMNS}
    assert all(list(tables[name].columns[: len(columns)]) == columns for name, columns in COLUMNS.items())
    (change,) = tables["changes"].to_dict("records")
    assert (change["airframe"], change["parameter"], change["kind"], change["flight"]) == ("A", "Cm_de", "jump", "A/6")
    assert change["when"] == pd.Timestamp(BEGIN + 6 * DAY, tz="UTC")
    assert change["size"] == pytest.approx(0.1, abs=3.0 * change["std"]) and change["std"] < 0.01
    assert tables["flights"].query("not ok").reason.tolist() == [f"{HOSTILE} is damaged"]
    assert (tables["verdicts"].query("airframe == 'B'").effect == "stall").all()
    assert tables["parameters"].query("parameter == 'Cm_q'")["std"].isna().all()
    (effect,) = fleet.json["effects"]
    assert (effect["airframe"], effect["effect"], effect["flights"], effect["of"]) == ("B", "stall", 10, 10)
    (place / "flights" / "B" / "z.mcap").write_text("12 B -1.0")
    again = fly(place)[0].json
    assert {each["flight"] for each in again["verdicts"]} == {f"B/{n}" for n in (*range(10), "z")}
    assert all(each["verdict"] == "missing" and each["effects"] == [HOSTILE] for each in again["verdicts"])
    said = render(again)
    assert f"  B/0: missing: {HOSTILE}\n" in said and said.count(HOSTILE) == 11  # ten, and one that is damaged
    assert "in 1 more" in said and "found in single flights" not in render({**again, "verdicts": []})
    page = (out / "fleet.html").read_text()
    assert "Cm_de" in page and "A/6" in page and HOSTILE not in page and "&lt;script&gt;alert(1)" in page
    json.dumps(fleet.json)


def test_a_fleet_of_which_no_flight_is_usable_leaves_what_was_known(place, flown, monkeypatch, capsys):
    """A wrong aircraft file took tables, page and the prior that a controller was given."""
    out = fly(place)[1]
    names = ("fleet.html", "prior.json", *(f"{name}.parquet" for name in COLUMNS))
    before = {name: (out / name).read_bytes() for name in names}
    (place / "aircraft.yaml").write_text("name: wrong")
    monkeypatch.setitem(globals(), "answer", lambda recording: {"ok": False, "reason": "the mass is negative"})
    asked = ["fleet", str(place / "flights"), "--aircraft", str(place / "aircraft.yaml"), "--out", str(out)]
    assert main(asked) == 1
    said = capsys.readouterr()
    assert "none of 20 flights could be used, such as A/0: the mass is negative" in said.err
    assert f"{out} is left as it was" in said.out + said.err
    assert {name: (out / name).read_bytes() for name in names} == before


def test_reasons_of_flights_that_were_never_usable_are_the_newest(place, flown, monkeypatch):
    """A folder that no flight was ever usable of was left with the reasons of the first attempt."""
    for reason in ("the mass is negative", "the span is missing"):
        (place / "aircraft.yaml").write_text(f"name: {reason}")
        unusable = {"ok": False, "reason": reason}
        monkeypatch.setitem(globals(), "answer", lambda recording, unusable=unusable: unusable)
        fleet, out = fly(place)
        assert set(pd.read_parquet(out / "flights.parquet").reason) == {reason}
        assert reason in (out / "fleet.html").read_text() and not any("as it was" in n for n in fleet.json["notes"])


@pytest.mark.parametrize("begin", [BEGIN, 0])
def test_flights_with_one_start_or_none_are_in_the_order_of_the_numbers_in_their_names(
    place, flown, monkeypatch, begin
):
    """f10 came before f2, the drift was lost, and nothing was said."""
    for k in range(13):
        (place / "flights" / "A" / f"f{k}.mcap").write_text(f"{k} A {-1.0 + 0.01 * k}")
    for k in range(10):
        (place / "flights" / "A" / f"{k}.mcap").unlink()
    dated = module_answer(begin)
    monkeypatch.setitem(globals(), "answer", dated)
    fleet, _ = fly(place)
    (change,) = fleet.json["changes"]
    assert (change["airframe"], change["kind"]) == ("A", "drift")
    assert change["size"] == pytest.approx(0.01, abs=3.0 * change["std"]) and change["std"] < 0.002
    said = [note for note in fleet.json["notes"] if "of A" in note]
    words = "13 flights of A begin at the same time" if begin else "13 flights of A have no date"
    assert len(said) == 1 and said[0].startswith(words) and "`start` in a list" in said[0]


def module_answer(begin):
    """``answer``, with one start for all."""
    made = answer
    return lambda recording: {**made(recording), "start": begin}


def test_what_flights_have_not_given_and_errors_of_their_check_are_notes(place, flown, monkeypatch):
    for k in (2, 3):
        (place / "flights" / "B" / f"{k}.mcap").write_text(f"{k} B ~-1.0")
    wrong = {"signal": "true_airspeed", "kind": "scale", "severity": "error", "sentence": "it is half of what it was"}
    made = answer
    faulty = lambda recording: {**made(recording), "findings": [wrong] if recording.stem == "2" else []}  # noqa: E731
    monkeypatch.setitem(globals(), "answer", faulty)
    fleet, _ = fly(place)
    assert "2 of 20 flights gave no parameter to USE: B/2, B/3" in fleet.json["notes"]
    assert "B/2: true_airspeed: it is half of what it was" in fleet.json["notes"]
    assert not any(" begin at the same time" in note or "no date" in note for note in fleet.json["notes"])


def test_a_scale_that_creeps_from_flight_to_flight_is_found_and_no_parameter_of_the_next_flight(place, flown):
    rate = 0.003
    for path in (place / "flights" / "B").iterdir():
        number = int(path.stem)
        path.write_text(f"{number} B -1.0 {1.0 + rate * number}")
    fleet, out = fly(place)
    creeps = next(c for c in fleet.between.changes if c["airframe"] == "B")
    assert (creeps["parameter"], creeps["kind"]) == ("airspeed.scale", "drift")
    assert abs(creeps["size"] - rate) < 2.5 * creeps["std"] < rate
    assert len(pd.read_parquet(out / "sensors.parquet")) == 10
    assert "airspeed.scale" in (out / "fleet.html").read_text()
    assert "airspeed" not in (out / "prior.json").read_text()


def test_without_a_terminal_how_far_it_is_is_said_in_lines(monkeypatch, capsys, tmp_path):
    def fly(asked, tell, say):
        tell("fly", 3, 400)
        raise InputError("enough")

    monkeypatch.setattr("aircraft_sysid_ros.commands.progress.TOLD_EVERY", 0.0)
    monkeypatch.setattr(command, "fly_fleet", fly)
    assert main(["fleet", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "fly: 3 of 400\n" in capsys.readouterr().err


def test_too_few_flights_are_no_sign_that_nothing_changes(place, flown, capsys):
    assert fly(place)[0].json["too_few"] == ""
    for path in (place / "flights").glob("*/*.mcap"):
        if int(path.stem) >= 5:
            path.unlink()
    fleet, out = fly(place)
    assert fleet.json["too_few"].endswith("here there are 5 at most") and not fleet.between.changes
    assert "from 6 flights of an airframe on" in (out / "fleet.html").read_text()


def test_the_page_says_what_is_drawn_and_of_which_flights_nothing_is(place, flown):
    for path in (place / "flights" / "B").iterdir():
        path.unlink()
    for number in (3, 4):
        (place / "flights" / "A" / f"{number}.mcap").write_text(f"{number} A ~-1.0")
    page = (fly(place)[1] / "fleet.html").read_text()
    assert "10 of 10 flights, 1 airframe, " in page and "1 airframes" not in page
    assert page.count("<circle") == 8 and "no point for 2 flights, of which it is not to be used" in page
    assert "Bars are two standard errors" in page


def test_an_airframe_of_which_nothing_is_known_takes_no_curve_from_others(place, flown):
    (place / "flights" / "AA").mkdir()
    (place / "flights" / "AA" / "0.mcap").write_text("Failed('damaged')")
    _, out = fly(place)
    legend = (out / "fleet.html").read_text().split('class="legend"')[1].split("</div>")[0]
    assert ">A<" in legend and ">B<" in legend and "AA" not in legend


def test_begun_again_nothing_is_flown_twice(place, flown):
    _, out = fly(place)
    assert len(flown) == 20
    before = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    fleet, _ = fly(place)
    assert len(flown) == 20 and fleet.new == 0
    assert before == {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    (place / "flights" / "A" / "new.mcap").write_text("10 A -0.9")
    (place / "flights" / "B" / "0.mcap").rename(place / "flights" / "B" / "00.mcap")  # the same under another name
    assert fly(place)[0].new == 1 and flown[20:] == ["new"]
    (place / "aircraft.yaml").write_text("name: y")
    assert fly(place)[0].new == 21


def test_a_damaged_answer_is_flown_again(place, flown):
    _, out = fly(place)
    for number, path in enumerate(sorted((out / "results").glob("*/*.json"))[:4]):
        path.write_bytes((b"", b"{", b"[]", b'{"ok": "x"}')[number])
    assert fly(place)[0].new == 4


def test_what_the_machine_refused_is_tried_again(place, flown):
    flights = place / "flights" / "A"
    (flights / "damaged.mcap").write_text("Failed('damaged')")
    (flights / "full.mcap").write_text("Failed('no space', lasting=False)")
    (flights / "slow.mcap").write_text("Failed('too slow', took_all_time=True)")
    fly(place)
    del flown[:]
    assert fly(place)[0].new == 1 and flown == ["full"]
    del flown[:]
    fly(place, time_limit=61.0)
    assert sorted(flown) == ["full", "slow"]


def test_a_recording_that_is_there_twice_counts_once(place, flown):
    (place / "flights" / "A" / "copy.mcap").write_text("0 A -1.0")
    fleet, _ = fly(place)
    (bad,) = [each for each in fleet.flown if not each.answer["ok"]]
    assert "it holds the same as A/0" in bad.answer["reason"] and bad.flight.name == "A/copy"


def test_names_of_all_kinds_come_into_tables_and_page(place, flown):
    """A name that is no text at all must not cost the tables of the others."""
    folder = os.fsencode(place / "flights" / "C 1 ü\udcff")
    os.mkdir(folder)
    for number, name in enumerate(["名 '前\".mcap", "no\udcfftext.mcap", "two\nlines.mcap"]):
        with open(folder + b"/" + os.fsencode(name), "w", encoding="utf8") as file:
            file.write(f"{number} C -1.0" if number else r"Failed('no \udcff')")
    _, out = fly(place)
    flights = pd.read_parquet(out / "flights.parquet").query("airframe == 'C 1 ü�'")
    assert sorted(flights.flight) == [f"C 1 ü�/{name}" for name in ("no�text", "two�lines", "名 '前\"")]
    assert flights.ok.sum() == 2 and flights.query("not ok").reason.tolist() == ["no "]
    assert "名 &#39;前&#34;" in (out / "fleet.html").read_text()


def test_a_file_that_cannot_be_read_costs_the_flights_of_its_airframe_alone(place, flown):
    """Also for root, who may open all: it refused the whole fleet, and named no file."""
    (place / "A.yaml").symlink_to("/proc/self/mem")
    (place / "B.yaml").write_text("name: x")
    (place / "flights" / "B" / "copy.mcap").write_text("0 A -1.0")
    asked = Asked([str(place / "flights")], Files(str(place / "{airframe}.yaml")), place / "out", 2, 60.0)
    failures = fly_fleet(asked, lambda *said: None, print).json["failures"]
    assert [each["flight"] for each in failures] == [f"A/{number}" for number in range(10)]
    assert {each["reason"] for each in failures} == {f"cannot read {place / 'A.yaml'}: Input/output error"}


def test_a_pipe_is_not_waited_for(place, flown, monkeypatch):
    """What hangs when it is opened is left to the process of its flight, which has a limit."""
    os.mkfifo(place / "flights" / "A" / "pipe.mcap")
    monkeypatch.setattr(module, "fly_all", lambda client, jobs, work, limits, done: [
        done(job, Failed("too slow") if job.recording.stem == "pipe" else answer(job.recording)) for job in jobs
    ])  # fmt: skip
    assert fly(place)[0].json["failures"] == [{"flight": "A/pipe", "reason": "too slow"}]


def test_folders_that_cannot_be_used(place, flown, tmp_path):
    (tmp_path / "file").touch()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").touch()
    for out, said in (("file", "is a file"), ("other", "is left alone"), ("file/below", "cannot write")):
        with pytest.raises(InputError, match=said):
            Results(tmp_path / out)
    results = Results(place / "out")
    with results.held(), pytest.raises(InputError, match="another fleet works on"):
        fly(place)


def test_a_fleet_that_never_began_leaves_nothing(place, flown, monkeypatch):
    def refuse(*_):
        raise InputError("no scheduler answers")

    with monkeypatch.context() as patched, pytest.raises(InputError, match="no scheduler"):
        patched.setattr(module, "cluster", refuse)
        fly(place)
    assert not (place / "out").exists()
    fly(place)
    (place / "flights" / "A" / "9.mcap").write_text("11 A -1.0")
    with monkeypatch.context() as patched, pytest.raises(InputError, match="no scheduler"):
        patched.setattr(module, "cluster", refuse)
        fly(place)
    assert (place / "out" / "fleet.html").exists() and len([*(place / "out" / "results").glob("*/*.json")]) == 20


def test_a_run_that_is_kept_is_that_of_its_answer(tmp_path):
    """With --runs, runs/NAME was left where another flight had had the name, or the same one by another aircraft file:
    tables and run were then of two flights.
    """
    from aircraft_sysid_ros.fleet import flight_task

    def job(key, name):
        return flight_task.Job(key, tmp_path / "1.mcap", False, tmp_path, Options(0), "", tmp_path / "runs" / name)

    def keep(job):
        run = tmp_path / "work"
        run.mkdir()
        (run / "of").write_text(job.key)
        flight_task.keep_run(run, job)

    results = Results(tmp_path / "out")
    for key in ("one", "two"):
        results.keep(key, {"ok": True})
    keep(job("one", "a"))
    assert results.known(job("one", "a"), 60.0) and results.known(job("two", "a"), 60.0) is None
    assert results.known(job("one", "b"), 60.0) is None, "it has another name now"
    keep(job("two", "a"))
    assert (tmp_path / "runs" / "a" / "of").read_text() == "two"
    assert results.known(job("two", "a"), 60.0) and results.known(job("one", "a"), 60.0) is None


def test_a_flight_of_which_nothing_is_to_use_says_why():
    from aircraft_sysid_ros.fleet.flight_task import _why_unused

    held = [
        {"status": "HOLD", "reason": reason} for reason in ("too short", "static pressure contradicts", "too short")
    ]
    assert _why_unused(dict(enumerate(held))) == "no parameter is to USE, most since: too short"
    assert _why_unused(dict(enumerate([*held, {"status": "USE", "reason": ""}]))) == "" == _why_unused({})


def test_a_program_that_changes_under_a_fleet_is_no_worker_with_another_version(tmp_path):
    """Of workers on this machine it had been said that they have another version, and to install the same one."""
    from aircraft_sysid_ros.fleet import flight_task

    here, elsewhere = flight_task.program_place(), "far:/opt/aircraft_sysid_ros"
    said = {}
    for place in (here, elsewhere):
        job = flight_task.Job("key", tmp_path / "1.bin", True, tmp_path, Options(2), "older", place=place)
        with pytest.raises(Failed) as error:
            flight_task.answer_of(job, tmp_path)
        said[place] = error.value.sentence
        assert not error.value.lasting
    assert "has changed since the fleet began" in said[here] and said[here].endswith("start the same command again")
    assert said[elsewhere] == "its worker has another version of the program: install the same one everywhere"


def test_what_is_said_of_a_flight_does_not_name_the_folder_that_it_was_flown_in(tmp_path, monkeypatch):
    """Otherwise no two tables of one fleet are the same, and they name folders that are gone."""
    from aircraft_sysid_ros.fleet import flight_task

    recording = tmp_path / "flight.bin"
    recording.touch()

    def judge(place):
        raise InputError(f"{place} is too short")

    monkeypatch.setattr(flight_task, "import_log", lambda *args, **more: None)
    monkeypatch.setattr(flight_task, "check_recording", lambda place, aircraft: judge(place))
    job = flight_task.Job("key", recording, True, recording, Options(2), flight_task.program_key())
    with pytest.raises(InputError, match=r"^the flight is too short$"):
        flight_task.answer_of(job, tmp_path / "work")
    monkeypatch.setattr(
        flight_task,
        "_answer_of",
        lambda job, folder: {"reason": flight_task._tried(lambda: judge(folder / "run"), "no", 0)[1]},
    )
    assert flight_task.answer_of(job, tmp_path / "wörk") == {"reason": "no: the flight is too short"}


@pytest.mark.parametrize(("low", "high"), [(-0.87, -0.83), (0.0708, 0.0738), (-7.7, -5.6), (11.0, 4300.0), (-2.0, 1.0)])
def test_the_axis_of_a_curve_has_a_few_round_numbers(low, high) -> None:
    ticks = _Scale(6, low, high).ticks
    values = [float(tick["text"].replace("−", "-")) for tick in ticks]
    assert 3 <= len(values) <= 8 and all(low <= value <= high for value in values)
    assert all(len(tick["text"].strip("−0.").rstrip("0")) <= 3 for tick in ticks)
    assert np.diff(values) == pytest.approx(values[1] - values[0])


def test_values_that_scatter_beyond_their_errors_are_told_from_those_that_do_not() -> None:
    values, std = np.random.default_rng(1).normal(-0.8, 0.01, 40), np.full(40, 0.01)
    assert 0.7 < _scatter(Series(np.arange(40), values, std, std)) < 1.3
    assert _scatter(Series(np.arange(40), values, 0.1 * std, std)) > 7.0
    assert _scatter(Series(np.arange(2), np.array([0.0, 9.0]), np.ones(2), np.ones(2))) == 0.0


@pytest.mark.parametrize(
    ("flights", "said"),
    [
        ([6, 9], "no change, no difference"),
        ([9], "no change"),
        ([9, 1], "no change"),
        ([3, 4], "too few flights to tell a change, no difference"),
        ([2], "too few flights to tell a change"),
    ],
)
def test_a_curve_says_only_what_its_flights_could_have_shown(flights, said) -> None:
    """Above three flights of one airframe stood "no change, no difference"."""
    there = [Series(np.arange(n), np.ones(n), np.ones(n), np.ones(n)) for n in flights]
    assert _nothing_said(there) == said


@pytest.mark.parametrize(
    ("size", "share"), [(0.5, "+50 %"), (-1.234, "−120 %"), (0.9961, "+100 %"), (0.0123, "+1.2 %")]
)
def test_a_change_beyond_its_value_is_a_number_of_percent(size, share) -> None:
    """It was "+1.2e+02 %"."""
    row = {"airframe": "a", "parameter": "Cm_q", "size": size, "when": None}
    assert _change(row, [{"airframe": "a", "parameter": "Cm_q", "value": 1.0}])["share"] == share
