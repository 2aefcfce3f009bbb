"""What the frame of a page does by itself: beside a notice, in a window that grows, when the system turns dark."""

from __future__ import annotations

import shutil

import pytest
from page_marks import marked, wait_for_text


@pytest.fixture(scope="module")
def server(hidden_effect, tmp_path_factory, served):
    """One server for all tests, of a run with a name that has no spaces."""
    run = tmp_path_factory.mktemp("frame") / ("a-run-with-a-name-" + 8 * "that-goes-on-")
    shutil.copytree(hidden_effect, run)
    with served(run.parent) as address:
        yield address, run.name


@pytest.fixture
def page(server, open_page):
    """The run, opened from the list."""
    address, name = server
    return open_page(f"{address}?run={name}")


@pytest.mark.long
def test_the_side_stands_below_the_header_and_its_notice(page) -> None:
    page.evaluate("""() => {
        const more = document.createElement('div');  // as high as a long notice, and the server does not take it away
        more.style.height = '90px';
        document.querySelector('header.top').append(more);
    }""")
    page.evaluate("scrollTo(0, 300)")
    page.wait_for_function("""() => {
        const header = document.querySelector('header.top').getBoundingClientRect();
        const side = document.querySelector('.side').getBoundingClientRect();
        const isBelow = side.top >= header.bottom + 10 && side.bottom <= innerHeight - 10;  // at the page's end, too
        return scrollY > 200 && header.height > 130 && isBelow;
    }""")


@pytest.mark.long
def test_arrow_keys_move_the_window_after_a_tab_was_clicked_and_a_plot_pressed(page) -> None:
    page.click(marked("tab-model"))
    box = page.locator(marked("plot-CX") + " .draglayer").first.bounding_box()
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 40)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 42, steps=6)
    page.mouse.up()
    begin = "document.querySelector('[data-testid=plot-Cn]').layout.xaxis.range?.[0]"
    page.wait_for_function(f"{begin} > 5")
    before = page.evaluate(begin)
    page.keyboard.press("ArrowRight")
    page.wait_for_function(f"(before) => {begin} > before + 1", arg=before)


@pytest.mark.long
@pytest.mark.parametrize("slower", [1, 20])
def test_legends_stay_above_their_plot_when_the_window_grows(server, open_page, slower) -> None:
    address, name = server
    page = open_page(f"{address}?run={name}", width=390, height=844)
    page.click(marked("tab-state"))
    page.wait_for_selector(".js-plotly-plot .legend")
    page.context.new_cdp_session(page).send("Emulation.setCPUThrottlingRate", {"rate": slower})
    page.set_viewport_size({"width": 1440, "height": 900})
    below = """() => [...document.querySelectorAll('.js-plotly-plot')]
        .filter((plot) => plot.offsetWidth && plot.querySelector('.legend'))
        .map((plot) => Math.abs(plot._fullLayout.width - plot.clientWidth) >= 2 ? null : plot.querySelector('.legend')
            .getBoundingClientRect().bottom - plot.getBoundingClientRect().top - plot._fullLayout._size.t)
    """
    page.wait_for_function(f"() => ({below})().every((far) => far !== null && far <= 2.0)")  # drawn, and corrected
    page.wait_for_timeout(700)  # and it stays so
    found = page.evaluate(below)
    assert len(found) > 3 and None not in found and max(found) <= 2.0


@pytest.mark.long
def test_a_page_follows_the_system_until_somebody_chooses(server, open_page) -> None:
    address, name = server
    page = open_page(f"{address}?run={name}", color_scheme="light")
    page.wait_for_selector("body.body--light")
    page.wait_for_function("document.cookie.includes('as-system')")
    page.emulate_media(color_scheme="dark")
    page.wait_for_selector("body.body--dark")
    page.click(marked("theme"))
    page.wait_for_selector("body.body--light")
    page.emulate_media(color_scheme="light")
    page.emulate_media(color_scheme="dark")
    page.wait_for_timeout(600)
    assert page.locator("body.body--light").count() == 1


@pytest.mark.long
def test_a_long_name_leaves_the_other_columns_in_sight(server, open_page) -> None:
    address, name = server
    page = open_page(address, plots=0)
    wait_for_text(page, "runs", name)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    for cell in page.locator("table td").all():
        box = cell.bounding_box()
        assert box["x"] + box["width"] <= page.viewport_size["width"]
