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


#: Of each table that can be seen: whether a shadow says where it goes on, and whether its first column stays.
TABLES = """[...document.querySelectorAll('.of-table')].filter((e) => e.offsetParent && e.innerText).map((e) => [
  getComputedStyle(e).backgroundImage.includes('gradient'),
  getComputedStyle(e.querySelector('td')).position])"""
#: Right edges of what decides in a table.
RIGHT = "(s) => [...document.querySelectorAll(s)].map((e) => e.getBoundingClientRect().right)"


def test_on_a_phone_a_table_shows_what_decides_or_that_it_goes_on(server, open_page) -> None:
    page = open_page(server, width=390, height=844)
    for view, decides in (
        ("parameters", "table.reasons td"),
        ("residuals", "[data-testid=residual-numbers] td"),
        ("versions", "[data-testid=history] table"),
    ):
        page.click(marked(f"tab-{view}"))
        page.wait_for_selector(decides)
        found = page.evaluate(TABLES)
        assert found and all(shadow and stays == "sticky" for shadow, stays in found), view
        assert max(page.evaluate(RIGHT, decides)) <= 390.0, view
