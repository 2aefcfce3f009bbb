"""What a user meets at the edges of the page: menus, narrow screens, empty fields, addresses that are none."""

from __future__ import annotations

import shutil

import pytest
from page_marks import marked


@pytest.fixture(scope="module")
def server(hidden_effect, tmp_path_factory, served):
    """One server for all tests: none changes the run."""
    run = tmp_path_factory.mktemp("details") / "run"
    shutil.copytree(hidden_effect, run)
    with served(run) as address:
        yield address


@pytest.mark.parametrize("label", ["axis", "across"])
def test_a_menu_is_as_wide_as_its_field_or_what_it_holds(server, open_page, label) -> None:
    page = open_page(server)
    field = page.locator(".side .q-field", has_text=label).first
    field.click()
    page.wait_for_selector(".q-menu .q-item")
    page.wait_for_timeout(500)  # it grows
    menu = page.locator(".q-menu").bounding_box()
    assert field.bounding_box()["width"] - 3.0 <= menu["width"] < 400.0
    assert page.evaluate("(m => m.scrollWidth <= m.clientWidth)(document.querySelector('.q-menu'))")
    assert page.locator(marked("map")).is_visible()
