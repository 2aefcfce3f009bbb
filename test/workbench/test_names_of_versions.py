"""Names and notes of versions: kept in the run, taken for ids, refused where they cannot be, and undone."""

from __future__ import annotations

import json

import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.model_versions.labels import LONGEST_NAME, LONGEST_NOTE, NAMES
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run, version_named

HOSTILE = "<script>alert(1)</script> & \"it\" 'is' {{ text }}"


def asked(capsys, *arguments) -> dict:
    """What `name` prints."""
    capsys.readouterr()
    assert main(["name", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys, run, *arguments) -> str:
    """The one sentence of a refusal, which leaves the file as it was."""
    file = run / NAMES
    before = file.read_bytes() if file.exists() else None
    capsys.readouterr()
    assert main(["name", str(run), *map(str, arguments)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and (file.read_bytes() if file.exists() else None) == before
    return err


def test_a_name_is_kept_taken_for_the_id_and_undone(run, capsys) -> None:
    current = open_run(run).current.identifier
    assert asked(capsys, run)["versions"] == [{"model": current, "name": "", "note": "", "is_current": True}]
    (version,) = asked(capsys, run, HOSTILE, "--note", "first line\nsecond line")["versions"]
    assert (version["name"], version["note"]) == (HOSTILE, "first line\nsecond line")
    assert version_named(open_run(run), HOSTILE).identifier == current
    (version,) = asked(capsys, run, "base", "--model", HOSTILE)["versions"]
    assert (version["name"], version["note"]) == ("base", "first line\nsecond line")  # the note stays
    assert main(["compare", str(run), "--with", "bose"]) == 2
    assert f"has no model 'bose': it has {current} ('base')" in capsys.readouterr().err
    (version,) = asked(capsys, run, "--undo")["versions"]
    assert version["name"] == HOSTILE
    (version,) = asked(capsys, run, "--undo")["versions"]
    assert (version["name"], version["note"]) == ("", "")
    assert "nothing to undo" in refused(capsys, run, "--undo")
    assert not list(run.glob(".*"))


@pytest.mark.long
def test_bad_names_are_one_sentence_and_nothing_is_written(run, capsys) -> None:
    assert f"at most {LONGEST_NAME} are allowed" in refused(capsys, run, "n" * (LONGEST_NAME + 1))
    assert f"at most {LONGEST_NOTE} are allowed" in refused(capsys, run, "n", "--note", "x" * 100_000)
    assert "one line" in refused(capsys, run, "two\nlines")
    assert "do not print" in refused(capsys, run, "a\u202eb")
    assert "do not print" in refused(capsys, run, "n", "--note", "\x1b[2J")
    assert "has no model" in refused(capsys, run, "n", "--model", "../..")
    assert "--undo takes no name" in refused(capsys, run, "n", "--undo")
    assert "give NAME" in refused(capsys, run, "--note", "n")
    main(["add", str(run), "Cl: alpha*beta"])
    first, second = (version["model"] for version in asked(capsys, run)["versions"])
    assert "is another version of this run already" in refused(capsys, run, first, "--model", second)
    asked(capsys, run, "base", "--model", first)
    assert "is another version of this run already" in refused(capsys, run, "base", "--model", second)


@pytest.mark.parametrize("content", ["", "[]", '{"labels": 3}', '{"labels": {"a": [{"name": "\\u001b", "note": ""}]}}'])
def test_a_damaged_file_is_a_note_and_a_refusal(run, capsys, content) -> None:
    from aircraft_sysid_ros.workbench.run_view import _labels

    (run / NAMES).write_text(content)
    notes: list[str] = []
    assert _labels(run, notes) == {} and "is damaged: remove it" in notes[0]
    assert "is damaged: remove it" in refused(capsys, run, "n")
