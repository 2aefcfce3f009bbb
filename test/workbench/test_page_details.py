"""What a user meets at the edges of the page: menus, narrow screens, empty fields, addresses that are none."""

from __future__ import annotations

import json
import shutil

import pytest
from page_marks import marked, wait_for_text


@pytest.fixture(scope="module")
def server(hidden_effect, tmp_path_factory, served):
    """One server for all tests: none changes the run."""
    run = tmp_path_factory.mktemp("details") / "run"
    shutil.copytree(hidden_effect, run)
    with served(run) as address:
        yield address


@pytest.mark.long
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


@pytest.mark.long
def test_lines_of_residuals_are_named(server, open_page) -> None:
    page = open_page(server)
    page.click(marked("tab-residuals"))
    page.wait_for_selector(marked("distribution-Cn") + " .main-svg")
    named = page.inner_text(marked("distribution-legend"))
    drawn = page.evaluate("document.querySelector('[data-testid=distribution-Cn]').data.map((t) => t.line?.color)")
    assert "noise alone" in named and "white noise" in named and "residual" in named
    keys = page.evaluate(
        "[...document.querySelectorAll('[data-testid=distribution-legend] .key')].map((e) => getComputedStyle(e).color)"
    )
    assert len(keys) == len({*keys}) == 3 and drawn.count("#d55e00") == 1 and "rgb(213, 94, 0)" in keys


@pytest.mark.long
def test_a_button_without_anything_to_add_says_so(server, open_page) -> None:
    page = open_page(server)
    page.click(marked("side-add"))
    page.click(marked("add-term"))
    wait_for_text(page, "complaint", "Write a term with its axis, such as CZ: alpha**3")
    page.click(marked("add-effect"))
    wait_for_text(page, "no-effect", "Choose an effect first")
    is_silent = "(s) => document.querySelector(s).innerText === ''"
    page.fill(marked("term"), "CZ: alpha**3")
    page.wait_for_function(is_silent, arg=marked("complaint"))  # what stands below it moves up then
    page.locator(marked("effect")).click()
    page.click(".effect-menu .q-item >> nth=1")
    page.wait_for_function(is_silent, arg=marked("no-effect"))


@pytest.mark.long
def test_an_address_that_is_none_leads_back(server, chromium) -> None:
    page = chromium.new_page()
    answer = page.goto(server + "<b>nobody</b>/here?run=x")
    assert answer.status == 404 and "There is no page at this address" in page.inner_text("main")
    assert page.locator("b").count() == 0 and "NiceGUI" not in page.content()
    page.click("main a")
    page.wait_for_selector(marked("plot-Cn") + " .main-svg")
    page.close()


@pytest.mark.long
def test_a_figure_that_is_saved_says_what_it_is(server, open_page) -> None:
    page = open_page(server, color_scheme="dark")
    page.wait_for_selector("body.body--dark")
    plot = page.locator(marked("plot-Cl"))
    plot.hover()
    with page.expect_download() as download:
        plot.locator(".modebar-btn").first.click()
    assert download.value.suggested_filename == "run-Cl-measured-and-predicted-over-time-and-the-residual.svg"
    drawn = download.value.path().read_text(encoding="utf8")
    for words in ("run: Cl measured and predicted over time, and the residual", ">measured<", ">residual, held out<"):
        assert words in drawn, words
    assert drawn.count(">two sigma of noise<") == 1
    assert "fill: rgb(27, 33, 39)" in drawn  # light letters stand on the dark ground of the page
    assert page.locator(marked("plot-Cl") + " .legend").count() == 0  # and the page is as it was
    assert page.evaluate("document.querySelector('[data-testid=plot-Cl]').layout.title") is None


@pytest.mark.long
def test_a_figure_is_read_and_zoomed_by_a_finger_and_the_page_still_moves(server, open_page) -> None:
    page = open_page(server, width=390, height=844, has_touch=True, is_mobile=True)
    plot = page.locator(marked("plot-CX"))
    fingers = page.context.new_cdp_session(page)

    def stroke(right: float, down: float) -> None:
        box = plot.locator(".nsewdrag").first.bounding_box()
        x, y = box["x"] + 0.4 * box["width"], box["y"] + 0.5 * box["height"]
        at = [{"x": x + right * share, "y": y + down * share} for share in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)]
        for point, kind in zip(at, ["touchStart", *["touchMove"] * 5], strict=True):
            fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [point]})
        fingers.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    range_of = "document.querySelector('[data-testid=plot-CX]')._fullLayout.xaxis.range"
    plot.scroll_into_view_if_needed()
    everything, top = page.evaluate(range_of), page.evaluate("scrollY")
    stroke(0.0, 0.0)
    page.wait_for_function("document.querySelector('.crosshair span')?.innerText.includes('measured')")
    read = page.locator(".crosshair span").first.bounding_box()
    assert read["x"] >= 0.0 and read["x"] + read["width"] <= 390.0
    camera = plot.locator(".modebar-btn").first.bounding_box()
    assert camera["y"] > read["y"] + read["height"]  # neither covers the other
    stroke(0.0, -90.0)
    page.wait_for_function("(top) => scrollY > top + 30", arg=top)
    assert page.evaluate(range_of) == everything and page.locator(".crosshair span").count() == 0
    page.wait_for_timeout(500)  # until it stands still
    stroke(90.0, 0.0)
    page.wait_for_function(f"(all) => {range_of}[1] - {range_of}[0] < 0.6 * all", arg=everything[1] - everything[0])


#: Of each table that can be seen: whether a shadow says where it goes on, and whether its first column stays.
TABLES = """[...document.querySelectorAll('.of-table')].filter((e) => e.offsetParent && e.innerText).map((e) => [
  getComputedStyle(e).backgroundImage.includes('gradient'),
  getComputedStyle(e.querySelector('td')).position])"""
#: Right edges of what decides in a table.
RIGHT = "(s) => [...document.querySelectorAll(s)].map((e) => e.getBoundingClientRect().right)"


@pytest.mark.long
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


@pytest.mark.long
def test_on_a_phone_a_place_brings_the_plots_into_view_and_the_notice_is_at_the_foot(server, open_page) -> None:
    """What is pressed stands thousands of pixels below what it changes, and nothing had seemed to happen."""
    page = open_page(server, width=390, height=844)
    page.locator(".place").first.click()
    seen = "(s) => (r => r.top >= 0 && r.bottom <= innerHeight)(document.querySelector(s).getBoundingClientRect())"
    page.wait_for_function(seen, arg=marked("window"))
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    page.evaluate("(s) => document.querySelector(s).classList.remove('hidden')", marked("notice"))
    below = "(s) => innerHeight - document.querySelector(s).getBoundingClientRect().bottom"
    assert abs(page.evaluate(below, marked("notice"))) < 2.0


@pytest.mark.long
def test_what_is_said_of_a_refinement_stays_within_the_page(run, served, open_page) -> None:
    """That its values are not to be used went on in one line beyond the window."""
    known = {"name": "CX_0", "value": 0.1, "std": 0.01, "status": "HOLD", "reason": ""}
    found = {"parameters": [known], "not_fitted": {"CX": {"nrmse_before": 0.1, "nrmse": 0.2}}, "worse": ["CX"]}
    found |= {"converged": False, "reason": "the steps stay large", "iterations": 9, "seconds_fitted": 30, "elapsed": 9}
    (run / "refined-filter-error.json").write_text(json.dumps(found))
    with served(run) as address:
        page = open_page(address, width=390, height=844)
        page.click(marked("tab-parameters"))
        wait_for_text(page, "refined-words", "do not use the refined values")
        for sentence in page.locator(marked("refined-words") + " > *").all():
            assert sentence.evaluate("e => e.scrollWidth <= e.clientWidth")
            assert "C_" not in sentence.inner_text()
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        page.close()  # before its server
