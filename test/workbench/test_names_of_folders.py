"""Folders whose names are no text, or none at all, are shown and opened."""

from __future__ import annotations

import os
import shutil

import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.workbench.session import Session
from aircraft_sysid_ros.workbench.shelf import Shelf

#: "März" as an older system wrote it: no UTF-8.
OLD = os.fsdecode(b"M\xe4rz")


@pytest.fixture
def old(hidden_effect, tmp_path):
    shutil.copytree(hidden_effect, tmp_path / "runs" / OLD)
    return tmp_path / "runs" / OLD


def test_a_name_that_is_no_utf8_is_listed_as_text_and_opens_its_folder(old) -> None:
    """One such folder, and the list of all runs was "500 Server error"."""
    found = Shelf([old.parent])
    (name,) = found.names
    assert name.encode() and name.startswith("M") and name.endswith("rz")
    assert found.folders()[name] == old
    assert Shelf([old]).title.encode()


@pytest.mark.long
def test_a_file_of_such_a_run_is_written(old, tmp_path) -> None:
    assert main(["report", str(old), "--out", str(tmp_path / "file.html")]) == 0
    assert "rz" in (tmp_path / "file.html").read_text(encoding="utf8").partition("</title>")[0].rpartition(", ")[2]


@pytest.mark.long
def test_the_folder_in_which_one_stands_has_its_name(run, tmp_path, monkeypatch) -> None:
    """The page was called nothing, and its files began with "_parameters"."""
    monkeypatch.chdir(run)
    assert main(["report", ".", "--out", str(tmp_path / "file.html")]) == 0
    assert f"{run.name}</title>" in (tmp_path / "file.html").read_text(encoding="utf8")
    session = Session(".")
    try:
        assert session.name == run.name
    finally:
        session.close()
