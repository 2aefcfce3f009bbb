"""The session: one job at a time, in another process, and what becomes of jobs that fail or are stopped."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.processes import ONE_THREAD
from aircraft_sysid_ros.workbench import server
from aircraft_sysid_ros.workbench.run_view import load_run_view
from aircraft_sysid_ros.workbench.session import Session
from aircraft_sysid_ros.workbench.undo import written
from aircraft_sysid_ros.workbench.worker import ADD, CALIBRATE, DIAGNOSE, LOAD, NAME, REFINE, REMOVE, UNDO, UNNAME, Job


@contextmanager
def opened(run):
    """An open session on a run, which has told what it does."""
    session, told = Session(run), []
    try:
        session.wait(120.0, lambda what, share: told.append(what))
        assert told[0] == f"reading {run}" and any(what.startswith("comparing version") for what in told)
        yield session
    finally:
        session.close()


@pytest.fixture
def session(run):
    """One on a copy of the run."""
    with opened(run) as session:
        yield session


def until(true, seconds: float = 90.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.long
def test_jobs_one_at_a_time_and_the_folder_is_watched(session, run) -> None:
    first = session.view.current
    assert session.start(Job(ADD, "Cl: alpha*beta"))
    assert not session.start(Job(REMOVE, "Cl: alpha*beta"))  # one is under way
    session.wait(120.0)
    assert session.view.current == open_run(run).current.identifier != first
    assert session.sentence.startswith("with 'Cl: alpha*beta' the held-out error falls") and not session.is_bad
    session.start(Job(ADD, "Cl: alpha*beta"))
    session.wait(120.0)
    assert session.is_bad and "already" in session.sentence
    session.start(Job(DIAGNOSE))
    until(lambda: session.told.what and session.elapsed > 0.5)
    session.stop()
    until(lambda: session.sentence == "stopped: the run is as it was")
    session.wait(120.0)
    assert session.view.current == open_run(run).current.identifier and not (run / "diagnosis.json").exists()
    assert main(["remove", str(run), "Cl: alpha*beta"]) == 0  # another program changes the run
    until(lambda: session.view.current == first)
    (run / "parameters.json").rename(run / "elsewhere")  # it is put back as it was, with its old time
    until(lambda: "parameters.json is not there" in session.damage)
    (run / "elsewhere").rename(run / "parameters.json")
    until(lambda: not session.damage, 20.0)


@pytest.mark.long
def test_the_page_refines_and_calibrates_as_the_commands_do(tmp_path, aircraft_file, monkeypatch) -> None:
    """The same numbers in the same files; what is stopped leaves nothing, nor does what is undone."""
    for name, value in ONE_THREAD.items():  # as every command sets it: else sums differ in their last digits
        monkeypatch.setenv(name, value)
    run, other = tmp_path / "run", tmp_path / "other"
    assert main(["simulate", "--out", str(tmp_path / "bag"), "--duration", "100", "--seed", "1"]) == 0
    assert main(["replay", str(tmp_path / "bag"), "--aircraft", str(aircraft_file), "--out", str(run)]) == 0
    shutil.copytree(run, other)
    with opened(run) as session:
        refine_and_calibrate(session, run, other, tmp_path)


def command(*words: str) -> None:
    """A command in a process of its own."""
    subprocess.run([sys.executable, "-m", "aircraft_sysid_ros.commands.main", *words], check=True, timeout=300)


def refine_and_calibrate(session, run, other, tmp_path) -> None:
    before = sorted(path.name for path in run.rglob("*"))
    assert session.start(Job(REFINE, "output-error"))
    until(lambda: session.told.share > 0.0)
    session.stop()
    until(lambda: session.sentence == "stopped: the run is as it was")
    session.wait(120.0)
    assert sorted(path.name for path in run.rglob("*")) == before
    assert session.start(Job(REFINE, "output-error"))
    session.wait(300.0)
    assert session.sentence.startswith("converged after") and not session.is_bad
    command("refine", str(other), "--method", "output-error")
    content = json.loads((other / "refined-output-error.json").read_text())
    assert session.view.refined["output-error"]["parameters"] == content["parameters"]
    assert session.start(Job(CALIBRATE, "compatibility"))
    session.wait(300.0)
    assert not session.is_bad and session.calibration.view.what == "compatibility"
    command("calibrate", "compatibility", str(other), "--out", str(tmp_path / "out"))
    made = [json.loads((f / "result.json").read_text()) for f in (run / "calibration-compatibility", tmp_path / "out")]
    assert made[0]["parameters"] == made[1]["parameters"]
    assert session.view.undoable == {"refine output-error", "calibrate compatibility"}
    for undone in ("refine output-error", "calibrate compatibility"):
        assert session.start(Job(UNDO, undone))
        session.wait(120.0)
        assert session.sentence == f"{undone}: taken back" and not session.is_bad
    assert sorted(path.name for path in run.rglob("*")) == before and session.view.refined == {}
    assert session.calibration is None and session.view.undoable == frozenset()


def files_of(folder):
    """Content and time of change of every file that a user sees."""
    found = [file for file in folder.rglob("*") if file.is_file() and not file.name.startswith(".")]
    return {file: (file.read_bytes(), file.stat().st_mtime_ns) for file in found}


@pytest.mark.long
def test_what_the_page_wrote_over_comes_back_to_the_last_byte(run) -> None:
    """Of a refinement and of a calibration that were there, and of those that were not."""
    calibration = run / "calibration-magnetometer"
    calibration.mkdir()
    (calibration / "result.json").write_text("{}")
    (run / "refined-filter-error.json").write_text('{"value": 1}')
    known, before = written(open_run(run)), files_of(run)
    changes = {
        "calibrate magnetometer": {calibration / "result.json": "[]", calibration / "trace.png": "picture"},
        "refine filter-error": {run / "refined-filter-error.json": '{"value": 2}'},
        "refine output-error": {run / "refined-output-error.json": "{}", run / "refined-output-error.png": "picture"},
        "calibrate five-hole": {run / "calibration-five-hole" / "result.json": "{}"},
    }
    for name, files in changes.items():
        kept = known[name].read()
        assert not known[name].can_be_undone
        for file, content in files.items():
            file.parent.mkdir(exist_ok=True)
            file.write_text(content)
        known[name].keep(kept)
    assert load_run_view(run).undoable == set(changes)
    for name in changes:
        assert known[name].put_back() is (name in ("calibrate magnetometer", "refine filter-error"))
        with pytest.raises(InputError, match="nothing to undo"):
            known[name].put_back()
    assert files_of(run) == before and not list(run.glob(".before*")) and not (run / "calibration-five-hole").exists()


def test_undo_leaves_alone_what_another_program_has_written_since(run) -> None:
    target, file = written(open_run(run))["refine output-error"], run / "refined-output-error.json"
    file.write_text("of the page")
    target.keep({})
    later = time.time_ns() + 10**9
    file.write_text("of a terminal")
    os.utime(file, ns=(later, later))
    with pytest.raises(InputError, match="another program has written since"):
        target.put_back()
    assert file.read_text() == "of a terminal"
    os.utime(file, ns=(0, 0))
    target.archive.write_bytes(b"PK damaged")
    with pytest.raises(InputError, match="cannot be read: what was there before is lost"):
        target.put_back()
    assert file.read_text() == "of a terminal"


@pytest.mark.long
def test_bad_work_is_one_sentence_and_writes_nothing(session, run) -> None:
    """Another program's copy of the page may send anything."""
    before = {path: path.stat().st_mtime_ns for path in run.rglob("*")}
    for job, said in (
        (Job(CALIBRATE, "five-hole"), "holds no samples of /five_hole_probe"),
        (Job(CALIBRATE, "../../x"), "is not a calibration"),
        (Job(REFINE, "../magic"), "is not a method of refine"),
        (Job(NAME, "nobody", ("name", "note")), "has no model 'nobody'"),
        (Job(UNNAME, session.view.current), "nothing to undo"),
        (Job(UNDO, "refine output-error"), "nothing to undo"),
        (Job(UNDO, "calibrate ../../x"), "nothing to undo"),
        (Job(NAME, session.view.current, ("n", "x" * 1_000_000)), "at most 2000 are allowed"),
    ):
        assert session.start(job)
        session.wait(60.0)
        assert session.is_bad and said in session.sentence and len(session.sentence) < 1300
    assert {path: path.stat().st_mtime_ns for path in run.rglob("*")} == before


@pytest.mark.long
def test_what_is_asked_for_while_the_folder_is_read_is_done_then(run) -> None:
    """A press of a button is never lost, however slow the machine."""
    session = Session(run)
    try:
        assert session.job.kind == LOAD and session.start(Job(ADD, "Cl: alpha*beta")) and session.busy
        assert not session.start(Job(DIAGNOSE))  # one waits
        session.wait(120.0)
        until(lambda: session.record is not None)
        assert session.sentence.startswith("with 'Cl: alpha*beta' the held-out error falls") and not session.is_bad
    finally:
        session.close()


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("samples.npz", b"not a zip", "samples.npz is damaged"),
        ("points.npz", b"", "points.npz is empty"),
        ("parameters.json", b"{", "parameters.json is damaged"),
        ("parameters.json", None, "parameters.json is not there"),
        ("parameters.json", b"[]", "parameters.json is damaged"),
        ("state.json", None, "state.json is not there"),
        ("state.json", b"{}", "state.json is damaged"),
        ("aircraft.yaml", None, "aircraft.yaml is not there"),
    ],
)
def test_a_file_that_is_damaged_is_named_with_what_to_do(run, name, content, said) -> None:
    (run / name).unlink() if content is None else (run / name).write_bytes(content)
    with pytest.raises(InputError, match=said) as error:
        load_run_view(run)
    assert f"replay the recording again with --out {run} --overwrite" in str(error.value)


@pytest.mark.parametrize(
    ("host", "is_ours", "first", "count"),
    [
        ("127.0.0.1", True, "http://127.0.0.1:1/", 1),
        ("localhost", True, "http://localhost:1/", 1),
        ("::1", True, "http://[::1]:1/", 1),
        ("0.0.0.0", False, "http://127.0.0.1:1/", 2),
        ("::", False, "http://127.0.0.1:1/", 2),
        ("192.0.2.7", False, "http://192.0.2.7:1/", 1),
        ("robot.example", False, "http://robot.example:1/", 1),
    ],
)
def test_addresses_can_be_typed_and_who_can_reach_them_is_known(monkeypatch, host, is_ours, first, count) -> None:
    monkeypatch.setattr(server, "_outward", lambda: "192.0.2.8")
    urls = server.addresses(host, 1)
    assert urls[0] == first and len(urls) == count and not any("0.0.0.0" in url or "[::]" in url for url in urls)
    assert server.is_private(host) is is_ours


@pytest.mark.long
def test_a_folder_that_is_no_run_is_one_sentence(tmp_path) -> None:
    session = Session(tmp_path)
    try:
        with pytest.raises(InputError, match="is not a run"):
            session.wait(120.0)
    finally:
        session.close()
