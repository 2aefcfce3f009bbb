"""Files and folders that are there in full or not at all, whoever else writes there."""

import errno
import multiprocessing
import os
from pathlib import Path

import pytest

from aircraft_sysid_ros.errors import InputError, echo, one_line, without_control
from aircraft_sysid_ros.text_file import put_in_place, write_new, write_whole


def compete(folder, number, begin, answers):
    new, target = folder / f"new{number}", folder / "run"

    def is_free():
        if target.exists():
            raise InputError("it is taken")

    new.mkdir()
    (new / "of").write_text(str(number))
    begin.wait()
    try:
        put_in_place(new, target, folder / f"aside{number}", is_free)
        answers.put((number, ""))
    except FileExistsError as error:
        answers.put((number, error.strerror))


def test_one_of_many_processes_gets_a_name_and_the_others_are_told(tmp_path):
    fork = multiprocessing.get_context("fork")
    begin, answers = fork.Barrier(6), fork.Queue()
    processes = [fork.Process(target=compete, args=(tmp_path, n, begin, answers)) for n in range(6)]
    for process in processes:
        process.start()
    told = dict(answers.get(timeout=60) for _ in processes)
    for process in processes:
        process.join()
    winners = [number for number, sentence in told.items() if not sentence]
    assert len(winners) == 1 and (tmp_path / "run" / "of").read_text() == str(winners[0])
    assert {sentence for sentence in told.values() if sentence} == {
        "another process has written there meanwhile, which is kept; give another name"
    }
    assert sorted(f.name for f in tmp_path.iterdir()) == sorted(["run", *(f"new{n}" for n in told if n not in winners)])


def test_what_was_there_comes_back_when_the_new_one_cannot_take_its_name(tmp_path):
    (tmp_path / "old").mkdir()
    with pytest.raises(OSError):
        put_in_place(tmp_path / "nothing", tmp_path / "old", tmp_path / "aside", lambda: None)
    assert [f.name for f in tmp_path.iterdir()] == ["old"]


@pytest.mark.parametrize("links", [True, False])
def test_a_new_file_takes_no_name_that_is_taken(tmp_path, monkeypatch, links):
    """Also on a file system that has no links."""

    def refuse(source, target):
        raise PermissionError(errno.EPERM, "Operation not permitted")

    if not links:
        monkeypatch.setattr(os, "link", refuse)
    (tmp_path / "there").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for name in ("there", "link"):
        with pytest.raises(FileExistsError):
            write_new(tmp_path / name, "new")
    write_new(tmp_path / "free", "new")
    assert (tmp_path / "free").read_text() == "new" and (tmp_path / "there").read_text() == "old"
    assert sorted(os.listdir(tmp_path)) == ["free", "link", "there"]


def ended_while_it_writes(path):
    Path.write_bytes = lambda self, content: os._exit(1)
    write_new(path, "new")


def test_a_process_that_is_ended_leaves_no_empty_file(tmp_path):
    process = multiprocessing.get_context("fork").Process(target=ended_while_it_writes, args=(tmp_path / "new",))
    process.start()
    process.join()
    assert process.exitcode == 1 and not (tmp_path / "new").exists()


def test_nothing_half_written_stays(tmp_path):
    with pytest.raises(OSError):
        write_whole(tmp_path / "nowhere" / "file", "text")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError):
        write_whole(tmp_path / "folder", "text")
    assert [f.name for f in tmp_path.iterdir()] == ["folder"]


def test_what_cannot_be_written_has_its_own_name(tmp_path):
    """And not that of the part that would have been renamed."""
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    for name in ("nowhere/page.html", "file/page.html", "folder"):
        with pytest.raises(OSError, match=rf": '\S+/{name}'$"):
            write_whole(tmp_path / name, "text")


def test_sentences_print_and_have_an_end():
    """Escapes of a terminal, marks that turn the order of letters, and megabytes of input do not reach the user."""
    hostile = "name\x1b[2J\x1b]0;title\x07 \u202egnp.exe\x9b31m\r\nerase"
    assert one_line(hostile) == "name[2J]0;title gnp.exe31m erase"
    assert echo("x" * 1000) == "x" * 60 + "…"
    sentence = str(InputError("the file '" + hostile * 10_000 + "' is wrong: give another one"))
    assert sentence.isprintable() and len(sentence) < 1300 and sentence.endswith("is wrong: give another one")
    assert without_control("a\tb\nc\x1b[0m\ud800é\u00a0") == "ab\nc[0mé\u00a0"
