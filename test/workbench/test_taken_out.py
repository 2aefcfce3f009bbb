"""What was taken out comes back by Undo."""

from __future__ import annotations

import shutil

import pytest
from page_marks import marked, wait_for_text

from aircraft_sysid_ros.diagnosis.model_versions.additions import add
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run


@pytest.fixture
def run(hidden_effect, tmp_path):
    shutil.copytree(hidden_effect, tmp_path / "run")
    add(tmp_path / "run", "dihedral_alpha")
    add(tmp_path / "run", "CX: beta**2")
    return tmp_path / "run"


@pytest.mark.long
def test_undo_brings_back_what_was_taken_out(run, served, open_page) -> None:
    """It took out the other one as well, and both were lost."""
    before = open_run(run).current
    both = set(before.changes)
    with served(run) as address:
        page = open_page(address)
        page.click(marked("side-add"))
        page.locator(marked("added") + " button", has_text="Take out").click()
        wait_for_text(page, "notice", "Without 'dihedral_alpha' the held-out error goes")
        assert set(open_run(run).current.changes) == both - {"dihedral_alpha"}
        wait_for_text(page, "added", "taken out")
        page.click(marked("undo"))
        wait_for_text(page, "notice", "With 'dihedral_alpha' the held-out error falls")
        assert open_run(run).current.identifier == before.identifier
        page.close()  # before its server


@pytest.mark.long
def test_a_version_of_the_history_is_made_the_current_one(run, served, open_page) -> None:
    """After Undo no way led back to a version that was there."""
    before, root = open_run(run).current, open_run(run).root.model.identifier
    with served(run) as address:
        page = open_page(address)
        page.click(marked("tab-versions"))
        page.click(marked("naming") + " .q-item")
        page.wait_for_selector(marked("keep-name"))
        assert not page.locator(marked("make-current")).is_visible()  # it is the current one
        for version in (root, before.identifier):
            page.locator(marked("naming") + " .q-select").click()
            page.locator(".q-menu .q-item", has_text=version).first.click()
            page.click(marked("make-current"))
            wait_for_text(page, "notice", f"Version {version} is the current one")
            assert open_run(run).current.identifier == version
        page.close()  # before its server
    assert set(open_run(run).current.changes) == set(before.changes)
    assert open_run(run).current.parents == before.parents
