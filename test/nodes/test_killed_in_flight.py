"""A process that is killed in flight loses seconds and not the flight: `recover` writes the run from the disk."""

import json
import os
import resource
import time
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from processes import live, play
from waiting import LONGEST, finish

from aircraft_sysid_ros import flight_journal
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_journal import RECORD, RECORDS, FlightJournal, OnDisk, RowsOnDisk, recovered
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.run_reader import journal_path, read_samples
from aircraft_sysid_ros.run_writer import RunWriter
from aircraft_sysid_ros.samples import Kind, samples_of

OPTIONS = ("--horizon", "4", "--reliable")


def said(capsys, *arguments):
    """Exit status, answer and complaint of a command."""
    status = main([str(a) for a in arguments])
    out, err = capsys.readouterr()
    return status, out, err


@pytest.fixture(scope="module")
def flight(aircraft, tmp_path_factory):
    """A simulated flight of 22 s as a bag."""
    from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
    from aircraft_sysid_ros.simulation.truth_files import write_flight

    path = tmp_path_factory.mktemp("short") / "flight"
    write_flight(simulate_samples(aircraft, seed=4, duration=22.0), path)
    return path


def test_a_killed_flight_is_recovered_as_a_replay_has_it(flight, aircraft_file, tmp_path, domain, capsys):
    run = tmp_path / "run"
    expected = read_recording(flight).samples
    with live(run, aircraft_file, *OPTIONS) as flying:
        play(flight, 4)  # a second of a busy machine is the horizon: what comes later is late, and no replay has it so
        deadline = time.monotonic() + LONGEST
        while len(_kept(run)) < len(expected):
            assert time.monotonic() < deadline, f"{len(_kept(run))} of {len(expected)} samples are on disk"
            time.sleep(0.1)
        status, _, err = said(capsys, "recover", run)
        assert status == 2 and "is being flown" in err
        flying.kill()
        finish(flying)
    assert not run.exists()
    status, _, err = said(capsys, "compare", run)
    assert status == 2 and f"aircraft-sysid recover {run}" in err
    status, out, err = said(capsys, "recover", run, "--json")
    assert status == 0, err
    result = json.loads(out)
    assert any("the flight was cut off" in note for note in result["notes"])
    assert not journal_path(run).exists() and len(read_samples(run)) == len(expected)
    counted = json.loads((run / "state.json").read_text())["samples"]
    assert {kind: counts["late"] for kind, counts in counted.items() if "late" in counts} == {}
    replayed = tmp_path / "replayed"
    status, out, _ = said(
        capsys, "replay", flight, "--aircraft", aircraft_file, "--horizon", "4", "--out", replayed, "--json"
    )
    assert status == 0
    assert result["parameters"] == json.loads(out)["parameters"]


def _kept(run):
    """Samples of a flight in progress that are on disk."""
    path = journal_path(run) / RECORDS
    return range(path.stat().st_size // RECORD.itemsize if path.exists() else 0)


# -- what is on disk ------------------------------------------------------------------------------------------


@pytest.fixture
def journal(aircraft, tmp_path):
    """A flight in progress."""
    journal = FlightJournal(tmp_path / "run", aircraft, {"state": {}, "parameters": {}})
    yield journal
    journal.clear()


@pytest.fixture(scope="module")
def samples(flight):
    return read_recording(flight).samples[:500]


def written(journal, samples):
    """The journal with samples, its process gone."""
    for k in range(0, len(samples), 7):
        journal.append(samples[k : k + 7])
    journal.close()
    return journal.path.with_name("run")


def test_what_is_read_is_what_came(journal, samples):
    _, _, found = recovered(written(journal, samples))
    for name in ("stamp", "kind", "values"):
        np.testing.assert_array_equal(getattr(found, name), getattr(samples, name))


@pytest.mark.parametrize("damage", ["cut", "zeros"])
def test_a_torn_end_is_passed_over(journal, samples, damage):
    run = written(journal, samples)
    path = journal_path(run) / RECORDS
    size = path.stat().st_size
    os.truncate(path, size - 100)  # into the record before the last
    if damage == "zeros":
        os.truncate(path, size + 4096)
    found = recovered(run)[2]
    assert len(found) == len(samples) - 2
    np.testing.assert_array_equal(found.values, samples.values[: len(samples) - 2])


def test_a_full_disk_does_not_end_the_flight(journal, samples, monkeypatch):
    write = os.write
    monkeypatch.setattr(os, "write", lambda file, content: write(file, content[:50]) if _left(file) else _full())

    def _left(file):
        return os.fstat(file).st_size < 20_000

    def _full():
        raise OSError(28, "No space left on device")

    for k in range(0, len(samples), 7):
        journal.append(samples[k : k + 7])
    kept = [*journal]
    np.testing.assert_array_equal(np.concatenate([part.stamp for part in kept]), samples.stamp)
    assert "No space left on device" in journal.note


def test_a_disk_that_takes_no_new_file_does_not_end_the_flight(tmp_path, monkeypatch):
    """A card that has gone read-only, as dying ones do: the first states, or another model, begin a file."""
    rows = np.arange(6.0).reshape(2, 3)

    def refuse(*arguments):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(flight_journal.os, "open", refuse)
    states = RowsOnDisk(tmp_path / "states")
    states.append(rows)
    states.append(rows[:, :2])
    assert [part.tolist() for part in states] == [rows.tolist(), rows[:, :2].tolist()]
    states.close()
    states.discard()


def test_nothing_is_written_after_half_a_record(tmp_path, monkeypatch):
    """A disk that is full may not even let a file be cut back."""
    write, cut = os.write, os.ftruncate
    kind = np.dtype([("values", "<f8", (3,))])
    records = OnDisk(tmp_path / "records.bin", kind)
    rows = np.zeros(4, kind)
    rows["values"] = np.arange(12.0).reshape(4, 3)

    def full(*_):
        raise OSError(28, "No space left on device")

    def half(file, content):
        monkeypatch.setattr(os, "write", full)
        return write(file, content[:20])

    records.append(rows[:1])
    monkeypatch.setattr(os, "write", half)
    monkeypatch.setattr(os, "ftruncate", full)
    records.append(rows[1:3])
    monkeypatch.setattr(os, "write", write)
    records.try_again()
    records.append(rows[3:])
    assert records.wrong and records.count == 1 and records.path.stat().st_size == kind.itemsize + 20
    monkeypatch.setattr(os, "ftruncate", cut)
    records.try_again()
    assert not records.wrong
    np.testing.assert_array_equal(np.fromfile(records.path, kind), rows)


@pytest.mark.parametrize("makes_room", [True, False])
def test_what_a_full_disk_did_not_take_is_kept_without_a_run_or_said_to_be_lost(
    aircraft, samples, tmp_path, monkeypatch, makes_room
):
    """It was in memory and gone with the process, and "its flight is kept" stood there all the same."""
    write, largest, said = os.write, 20_000, []

    def written_up_to(file, content):
        if os.fstat(file).st_size >= largest:
            raise OSError(28, "No space left on device")
        return write(file, content[:50])

    journal = FlightJournal(tmp_path / "run", aircraft, {}, said.append)
    journal.rows.append(np.ones((10, 3)))
    monkeypatch.setattr(os, "write", written_up_to)
    for k in range(0, len(samples), 7):
        journal.append(samples[k : k + 7])
    (warning,) = said
    assert "No space left on device" in warning and f"make room in {tmp_path}, or it is lost" in warning
    if makes_room:
        monkeypatch.setattr(os, "write", write)
    kept = journal.keep()
    found = recovered(tmp_path / "run")[2]
    np.testing.assert_array_equal(found.stamp, samples.stamp[: len(found)])
    assert not [*journal.path.glob("states*")] and not journal.rows
    lost = f"of its flight the first {len(found)} of {len(samples)} samples are kept"
    what = "its flight is kept" if makes_room else lost
    assert kept == f"{what}: aircraft-sysid recover {tmp_path / 'run'}"
    assert (len(found) == len(samples)) == makes_room and len(found) > 100


def test_a_flight_on_a_full_disk_ends_by_no_word_of_it_and_goes_there_once_there_is_room(
    aircraft, samples, tmp_path, monkeypatch
):
    """The log of a service may be on the same disk. What ends in an error keeps what fits, too."""
    write, said = os.write, []

    def full(file, content):
        raise OSError(28, "No space left on device")

    def deaf(text):
        said.append(text)
        raise OSError(28, "No space left on device")

    run = tmp_path / "run"
    with (
        pytest.raises(RuntimeError, match="a node died"),
        RunWriter(run, aircraft, in_progress={"state": {}, "parameters": {}}, say=deaf) as writer,
    ):
        monkeypatch.setattr(os, "write", full)
        writer.add_samples(samples[:100])
        monkeypatch.setattr(flight_journal, "_AGAIN", 0.0)
        writer._journal._due = 0.0
        writer.add_samples(samples[100:200])
        monkeypatch.setattr(os, "write", write)
        writer.add_samples(samples[200:300])
        assert not writer._journal.note
        monkeypatch.setattr(os, "write", full)
        writer.add_samples(samples[300:])
        raise RuntimeError("a node died")
    assert len(recovered(run)[2]) == 300
    assert len(said) == 3 and said[-1].startswith(f"of its flight the first 300 of {len(samples)} samples are kept")


def test_a_disk_that_is_full_when_the_run_is_written_keeps_the_flight(aircraft, samples, tmp_path):
    """Its estimates are the first and largest file: when they did not fit, the journal was deleted as well."""
    run, limits = tmp_path / "run", resource.getrlimit(resource.RLIMIT_FSIZE)
    pipeline = Pipeline(aircraft)
    with (
        pytest.raises(InputError, match=r"cannot write the run .*: File too large; its flight is kept: .* recover "),
        RunWriter(run, aircraft, in_progress={"state": {}, "parameters": {}}) as writer,
    ):
        writer.add_samples(samples)
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
        try:
            writer.finish(pipeline.state, pipeline.parameters, 5.0, time.perf_counter())
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert len(recovered(run)[2]) == len(samples) and not run.exists()


def test_a_flight_whose_run_is_written_leaves_nothing_else(aircraft, samples, tmp_path):
    pipeline, said = Pipeline(aircraft), []
    with RunWriter(tmp_path / "run", aircraft, in_progress={"state": {}, "parameters": {}}, say=said.append) as writer:
        writer.add_samples(samples)
        writer.finish(pipeline.state, pipeline.parameters, 5.0, time.perf_counter())
    assert [path.name for path in tmp_path.iterdir()] == ["run"] and not said


def test_a_flight_that_was_cut_off_is_not_flown_over_and_hinders_none(journal, samples, aircraft):
    """A service that starts again after a crash in flight flies on."""
    run = written(journal, samples)
    for number in (1, 2):
        again = FlightJournal(run, aircraft, {})
        assert f"recover {run}-{number} makes a run of it" in again.kept
        with pytest.raises(ValueError, match="being flown by another process"):
            FlightJournal(run, aircraft, {})
        again.append(samples)
        again.close()
    assert len(recovered(f"{run}-1")[2]) == len(recovered(run)[2]) == len(samples)


@pytest.mark.long
def test_memory_does_not_grow_with_the_flight(aircraft, samples, tmp_path):
    nothing = Identifier(aircraft)
    told = nothing.snapshot(), nothing.model_error()
    states, evaluated = np.ones((25, StateField.WIDTH)), np.ones((25, CoefficientSample.TERMS + 32))
    writer = RunWriter(tmp_path / "long", aircraft, in_progress={"state": {}, "parameters": {}})
    tracemalloc.start()
    with writer:
        for second in range(600):  # that is 0.1 MB per second in memory
            states[:, StateField.TIME] = second + (np.arange(25) + 0.5) / 25.0
            writer.add_rows(states)
            writer.add_points(evaluated)
            writer.add_samples(samples)
            writer.add_parameters(replace(told[0], time=float(second)), told[1])
            if second == 60:
                early = tracemalloc.get_traced_memory()[0]
        assert tracemalloc.get_traced_memory()[0] - early < 1e6
        assert len(writer.state_times) == 600 * 25
    tracemalloc.stop()


def test_a_flight_with_states_is_kept_whatever_goes_wrong_at_its_end(aircraft, samples, tmp_path):
    run = tmp_path / "run"
    with pytest.raises(InputError), RunWriter(run, aircraft, in_progress={"state": {}, "parameters": {}}) as writer:
        writer.add_samples(samples)
        writer.add_rows(np.ones((3, StateField.WIDTH)))
        raise InputError("nothing can be said of it")
    assert len(recovered(run)[2]) == len(samples)


def test_what_is_stopped_before_a_sample_came_leaves_nothing_in_the_way(aircraft, tmp_path):
    """Ctrl-C while the nodes start: the next flight of that name was refused, and there was nothing to recover."""
    for samples in (None, samples_of(Kind.AIRSPEED, [1], [20.0])):
        with pytest.raises(KeyboardInterrupt), RunWriter(tmp_path / "run", aircraft, in_progress={}) as writer:
            if samples is not None:
                writer.add_samples(samples)
            raise KeyboardInterrupt
        assert journal_path(tmp_path / "run").exists() == (samples is not None)
