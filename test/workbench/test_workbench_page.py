"""The page as a user sees it, in a browser."""

from __future__ import annotations

import http.client
import json
import re
import shutil
import urllib.parse
from pathlib import Path

import numpy as np
import pytest
from page_marks import marked, wait_for_text

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.workbench.run_view import load_run_view
from aircraft_sysid_ros.workbench.views import places
from aircraft_sysid_ros.workbench.views.coefficients import predicted, time_of

#: Name of the aircraft and of the folder of its run: text on the page, whatever it looks like.
HOSTILE = "<script>alert(1)<img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def server(hidden_effect, calibration, tmp_path_factory, served):
    """One server for all tests that leave the run as it was: its folder and its address."""
    run = tmp_path_factory.mktemp("served") / HOSTILE
    shutil.copytree(hidden_effect, run)
    file = run / "aircraft.yaml"
    file.write_text(re.sub(r"(?m)^name: .*", f"name: {json.dumps(HOSTILE)}", file.read_text()))
    program = (Path(__file__).with_name("few_replicas.py"),)
    with served(run, "--calibration", calibration, program=program) as address:
        yield run, address


def compared(run, capsys) -> dict:
    capsys.readouterr()
    assert main(["compare", str(run), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def shown(errors: dict, axis: str) -> str:
    return f"{100 * errors['axes'][axis]['nrmse_held_out']:.1f} %"


def window_of(page) -> list[list[float]]:
    """The range of time of all six axes."""
    return page.evaluate(
        "[...document.querySelectorAll('[data-testid^=plot-]')].map((p) => [...p._fullLayout.xaxis.range])"
    )


@pytest.mark.long
def test_names_from_outside_are_text(server, open_page) -> None:
    page = open_page(server[1])
    assert page.inner_text(".who .name") == HOSTILE and HOSTILE in page.inner_text(marked("facts"))
    assert page.title().startswith(HOSTILE)
    assert not page.query_selector("[onerror]")
    page.click(marked("tab-versions"))
    wait_for_text(page, "one-version", HOSTILE)


def test_a_hidden_effect_is_seen_named_added_and_taken_back(server, open_page, capsys) -> None:
    run, address = server
    before = compared(run, capsys)
    page = open_page(address, reduced_motion="reduce")
    for axis in AXES:
        assert page.inner_text(marked(f"held-out-{axis}")) == shown(before, axis)
        assert page.inner_text(marked(f"error-{axis}")) == shown(before, axis)
        assert page.locator(marked(f"fails-{axis}")).count() == (axis == "Cl")
    bars_agree_with_their_numbers(page)
    assert "s of flight compared of 60 s recorded" in page.inner_text(marked("lengths"))
    one_version_says_how_to_make_another(page, run)
    page.click(marked("side-why"))
    page.click(marked("diagnose"))
    page.wait_for_selector(".notice .bar:visible")  # progress
    page.click(marked("plot-CX"))  # and the page answers meanwhile
    page.wait_for_selector(marked("card-0"))
    assert page.inner_text(marked("verdict")) == "An effect is missing"
    page.click(marked("card-0") + " .q-item")
    page.wait_for_selector(marked("card-0") + " .main-svg")
    card = page.inner_text(marked("card-0"))
    assert "Dihedral effect that depends on lift" in card and "By chance" in card and "Shown by" in card
    width = page.locator(marked("bar-Cl")).bounding_box()["width"]
    page.click(marked("add-0"))
    wait_for_text(page, "notice", "With 'dihedral_alpha' the held-out error falls from")
    after = compared(run, capsys)
    assert after["axes"]["Cl"]["nrmse_held_out"] < 0.5 * before["axes"]["Cl"]["nrmse_held_out"]
    wait_for_text(page, "held-out-Cl", shown(after, "Cl"))
    assert page.inner_text(marked("error-Cl")) == shown(after, "Cl")
    assert page.inner_text(marked("model")) == after["model"] != before["model"]
    page.wait_for_function(
        "(w) => document.querySelector('[data-testid=bar-Cl]').getBoundingClientRect().width < w", arg=0.6 * width
    )
    bars_agree_with_their_numbers(page)
    another_version_is_drawn_beside(page, before["model"])
    page.click(marked("side-add"))
    page.click(marked("undo"))
    wait_for_text(page, "held-out-Cl", shown(before, "Cl"))
    assert compared(run, capsys)["model"] == before["model"]


def bars_agree_with_their_numbers(page) -> None:
    """A bar is as long as its number, on the scale that stands above it."""
    full = float(re.search(r"(\d+) %", page.inner_text(marked("scale")))[1])
    for axis in AXES:
        share = page.locator(marked(f"bar-{axis}")).evaluate(
            "(e) => e.getBoundingClientRect().width / e.parentElement.getBoundingClientRect().width"
        )
        assert share * full == pytest.approx(float(page.inner_text(marked(f"held-out-{axis}")).split()[0]), abs=0.6)


def one_version_says_how_to_make_another(page, run) -> None:
    page.click(marked("tab-versions"))
    wait_for_text(page, "one-version", "There is one version only")
    assert f"aircraft-sysid add {run}" in page.inner_text(marked("one-version"))
    assert not page.locator(marked("beside")).is_visible()
    page.click(marked("tab-model"))


def another_version_is_drawn_beside(page, first: str) -> None:
    """The first version in the time plots, in another colour, and its name in the legend."""
    page.click(marked("tab-versions"))
    assert "dihedral_alpha" in page.inner_text(marked("history"))
    assert "Estimate ± standard error" in page.inner_text(".view.wide")
    assert not page.locator(marked("one-version")).is_visible()
    page.click("text=draw the first one")
    page.click(marked("tab-model"))
    lines = "document.querySelector('[data-testid=plot-Cl]')?.calcdata?.length"  # none while it is drawn anew
    page.wait_for_function(f"{lines} === 7")  # measured, noise twice, predicted and residual of both
    assert f"version {first}" in page.inner_text(".legend-row")
    left = page.evaluate(
        "document.querySelector('[data-testid=plot-Cl]').calcdata.filter((c) => c[0].trace.name.startsWith('residual'))"
        ".map((c) => Math.max(...c.map((p) => Math.abs(p.y)).filter(isFinite)))"
    )
    assert len(left) == 2 and max(left) > 2.0 * min(left)  # the first one lacks the effect
    page.click(marked("tab-versions"))
    page.click("text=draw the first one")
    page.click(marked("tab-model"))
    page.wait_for_function(f"{lines} === 5")


@pytest.mark.long
def test_a_zoom_moves_all_plots_and_shows_every_point(server, open_page) -> None:
    page = open_page(server[1])
    box = page.locator(marked("plot-CX") + " .nsewdrag").first.bounding_box()
    y = box["y"] + 0.4 * box["height"]
    page.mouse.move(box["x"] + 0.5 * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], y, steps=3)
    page.mouse.up()
    page.wait_for_function(
        "[...document.querySelectorAll('[data-testid^=plot-]')].every((p) => p._fullLayout.xaxis.range[1] < 45)"
    )
    ranges = window_of(page)
    assert len(ranges) == 6 and all(r == pytest.approx(ranges[0], abs=1e-6) for r in ranges)
    begin, end = ranges[0]
    assert 4.0 < end - begin < 7.0
    points = page.evaluate("document.querySelector('[data-testid=plot-CX]').calcdata[0].length")
    assert points >= 25 * (end - begin)  # all points of the flight, 25 per second
    page.keyboard.press("ArrowRight")
    page.wait_for_function(
        "(b) => [...document.querySelectorAll('[data-testid^=plot-]')].every((p) => p._fullLayout.xaxis.range[0] > b)",
        arg=begin + 0.5,
    )
    page.keyboard.press("0")
    page.wait_for_function(
        "[...document.querySelectorAll('[data-testid^=plot-]')].every((p) => p._fullLayout.xaxis.range[1] > 55)"
    )


#: What stands at the line through the plots, one text for each of them.
READ = "[...document.querySelectorAll('.crosshair span')].map((s) => s.innerText)"


@pytest.mark.long
def test_values_at_the_pointer_are_those_of_the_time_beside_them(server, open_page, hidden_effect) -> None:
    comparison = load_run_view(hidden_effect).comparison
    time, measured = time_of(comparison.flight), comparison.flight.coefficient("CX")
    found = comparison.axes["CX"]
    page = open_page(server[1])
    assert page.evaluate("document.querySelector('[data-testid=plot-CX]').calcdata[0].length") < len(time)
    box = page.locator(marked("plot-CX") + " .nsewdrag").first.bounding_box()
    for share in np.linspace(0.03, 0.97, 24):
        page.mouse.move(box["x"] + share * box["width"], box["y"] + 40)
        page.wait_for_timeout(100)
        read = page.evaluate(READ)
        assert not re.search(r"−0(\.0+)?$", "\n".join(read), re.M), "zero has no sign"
        text = read[0].replace("−", "-")
        said = dict(line.rsplit(" ", 1) for line in text.splitlines()[1:])
        k = int(np.argmin(np.abs(time - float(text.partition(" s")[0]))))
        lines = {
            "measured": measured,
            "predicted": predicted(comparison, "CX"),
            "residual, held out": found.fit.held_out,
        }
        assert said.keys() == {name for name, line in lines.items() if np.isfinite(line[k])}
        for name, value in said.items():
            places = len(value.partition(".")[2])
            assert float(value) == pytest.approx(lines[name][k], abs=0.51 * 10.0**-places), (text, time[k])
            assert places <= 5  # as many as the plot can show


#: Spans of time that are marked in the plot of C_l, as pairs.
MARKS = """(document.querySelector('[data-testid=plot-Cl]').layout.shapes.find((s) => s.fillcolor.includes('230,159'))
  ?.path.match(/[MH][0-9.]+/g) ?? []).map((p) => parseFloat(p.slice(1)))"""
#: Middle of the cell of the map with the largest residual: where it is on the screen and in the units of its axes.
WORST_CELL = """() => {
  const plot = document.querySelector('[data-testid=map]'), {xaxis, yaxis} = plot._fullLayout;
  const {x, y, z} = plot.calcdata[0][0], box = plot.querySelector('.nsewdrag').getBoundingClientRect();
  const middle = (edges, k) => 0.5 * (edges[k] + edges[k + 1]);
  let best = [-1, 0, 0];
  z.forEach((row, j) => row.forEach((value, i) => { if (value > best[0]) best = [value, i, j]; }));
  const [cx, cy] = [middle(x, best[1]), middle(y, best[2])];
  return {left: box.left + xaxis.l2p(cx), top: box.top + yaxis.l2p(cy), alpha: cx, beta: cy};
}"""


@pytest.mark.long
def test_places_and_cells_show_themselves_in_the_time_plots(server, open_page) -> None:
    """A cell of the map is marked where it was flown: alpha and beta there are within the cell."""
    run, address = server
    page = open_page(address)
    page.focus(".place >> nth=0")
    page.keyboard.press("Enter")  # without a mouse
    page.wait_for_function(f"{MARKS}.length > 0")
    place = page.evaluate(MARKS)
    page.locator(marked("map")).scroll_into_view_if_needed()
    cell = page.evaluate(WORST_CELL)
    page.mouse.click(cell["left"], cell["top"])
    page.wait_for_function(f"(place) => JSON.stringify({MARKS}) !== JSON.stringify(place)", arg=place)
    spans = np.array(page.evaluate(MARKS)).reshape(-1, 2)
    view = load_run_view(run)
    time, alpha, beta = time_of(view.flight), *(np.degrees(view.flight.signal(name)) for name in ("alpha", "beta"))
    inside = np.any([(time > begin) & (time < end) for begin, end in spans], axis=0)
    found = places.residual_map(view.comparison, "Cl", "alpha", "beta")
    half = [0.499 * np.degrees(edges[1] - edges[0]) for edges in found.edges]
    in_cell = (np.abs(alpha - cell["alpha"]) < half[0]) & (np.abs(beta - cell["beta"]) < half[1])
    assert in_cell.any() and np.all(inside[in_cell]) and inside.sum() < 0.2 * len(time)
    assert all(np.any(in_cell & (time > begin) & (time < end)) for begin, end in spans)
    begin, end = window_of(page)[0]
    assert begin < spans[0, 0] and end > spans[-1, 1]


@pytest.mark.long
def test_stop_ends_a_job_and_leaves_the_run(server, open_page) -> None:
    run, address = server
    page = open_page(address)
    before = {path: path.stat().st_mtime_ns for path in run.rglob("*") if path.name != "diagnosis.json"}
    page.click(marked("side-why"))
    page.click(marked("diagnose"))
    page.wait_for_selector(marked("stop") + ":visible")
    assert page.locator(marked("diagnose")).is_disabled()
    page.click(marked("stop"))
    wait_for_text(page, "notice", "Stopped: the run is as it was")
    page.wait_for_function("!document.querySelector('[data-testid=diagnose]').disabled")
    assert not page.locator(marked("stop")).is_visible()
    assert {path: path.stat().st_mtime_ns for path in before} == before


@pytest.mark.long
def test_a_term_that_does_not_parse_is_refused_in_words(server, open_page) -> None:
    run, address = server
    page = open_page(address)
    before = sorted(run.rglob("*"))
    page.click(marked("side-add"))
    for text, complaint in (
        ("CZ: __import__('os')", "is not allowed"),
        ("CQ: beta", "is not an axis"),
        ("CL: alpha**2", "for lift write CZ"),
        ("alhpa", "Write a term with its axis, such as CZ: alpha**3"),
        ("dihedral_alfa", "did you mean the effect dihedral_alpha?"),
    ):
        page.fill(marked("term"), text)
        wait_for_text(page, "complaint", complaint)
        page.click(marked("add-term"))
    page.fill(marked("term"), "CZ: alpha")  # parses, but the model has it
    page.wait_for_function("document.querySelector('[data-testid=complaint]').innerText === ''")
    page.click(marked("add-term"))
    wait_for_text(page, "notice", "has the term 'alpha' in CZ already")
    assert sorted(run.rglob("*")) == before


@pytest.mark.long
def test_two_browsers_see_the_same_run(server, open_page, capsys) -> None:
    run, address = server
    one, other = open_page(address), open_page(address)
    first = one.inner_text(marked("model"))
    one.click(marked("side-add"))
    other.click(marked("side-add"))
    one.fill(marked("term"), "Cl: alpha*beta")
    one.wait_for_timeout(300)  # typing is heard after a pause
    one.click(marked("add-term"))
    other.wait_for_selector(marked("stop") + ":visible")  # the other one sees the work too
    assert other.locator(marked("add-term")).is_disabled()
    for page in (one, other):
        page.wait_for_function("(m) => document.querySelector('[data-testid=model]').innerText !== m", arg=first)
    after = compared(run, capsys)
    for page in (one, other):
        wait_for_text(page, "held-out-Cl", shown(after, "Cl"))
        assert page.inner_text(marked("model")) == after["model"]
    other.click(marked("undo"))
    for page in (one, other):
        wait_for_text(page, "model", first)


#: Brightness of the page's ground, 0 to 255.
DARK = "Math.max(...getComputedStyle(document.body).backgroundColor.match(/[0-9.]+/g).slice(0, 3).map(Number))"


#: Whether a page was light at any time since it began to load.
SEES_LIGHT = """new MutationObserver(() => {
  if (document.body?.classList.contains('body--light')) window.sawLight = true;
}).observe(document, {subtree: true, childList: true, attributes: true})"""


@pytest.mark.long
def test_the_other_views_and_the_dark_page(server, open_page) -> None:
    page = open_page(server[1], color_scheme="dark")
    page.wait_for_selector("body.body--dark")
    page.click(marked("tab-parameters"))
    page.click("button[data-name=Cl_beta]")
    wait_for_text(page, "parameter-title", "Cl_beta")
    page.click(marked("tab-state"))
    wait_for_text(page, "consistency", "angle of attack")
    page.wait_for_function("document.querySelectorAll('.wide .main-svg').length >= 8")
    assert page.evaluate(DARK) < 60.0
    page.click(marked("tab-calibration"))
    wait_for_text(page, "calibration-verdict", "One clear minimum")
    page.wait_for_selector(marked("residual-2") + " .main-svg")
    page.click(marked("tab-residuals"))
    wait_for_text(page, "residual-numbers", "within 2 sigma")
    with page.expect_download() as download:
        page.click(marked("save-coefficients"))
    assert download.value.path().read_text(encoding="utf8").startswith("time,CX_measured,")
    page.keyboard.press("?")
    wait_for_text(page, "help-text", "the whole flight")
    page.click("text=Close")
    for width in (820, 390):
        page.set_viewport_size({"width": width, "height": 1180})
        for view in ("residuals", "model"):
            page.click(marked(f"tab-{view}"))
            page.wait_for_selector(f"{marked('plot-Cn' if view == 'model' else 'distribution-Cn')} .main-svg")
            page.wait_for_function(f"document.documentElement.scrollWidth <= {width}")
    page.click(marked("side-add"))
    page.locator(marked("effect")).click()
    page.wait_for_function("document.querySelectorAll('.effect-menu .effect-kind').length >= 1")
    widths = "(s) => document.querySelector(s).closest('.q-field, .effect-menu').getBoundingClientRect().width"
    assert page.evaluate(widths, ".effect-menu") <= page.evaluate(widths, marked("effect")) + 1.0
    page.add_init_script(SEES_LIGHT)
    page.goto(server[1])
    page.wait_for_selector(marked("plot-Cn") + " .main-svg")
    assert page.evaluate("document.body.classList.contains('body--dark') && !window.sawLight"), "no flash of light"


@pytest.mark.long
def test_a_run_that_is_damaged_under_the_page_is_one_sentence(run, served, open_page, capsys) -> None:
    with served(run) as address:
        page = open_page(address)
        (run / "samples.npz").write_bytes(b"not a zip")
        wait_for_text(page, "notice", "damaged")
        text = page.inner_text(marked("notice"))
        assert len(text.splitlines()) == 1 and "replay the recording again" in text and "Traceback" not in text
        assert "samples.npz is damaged" in text
        page.click(marked("side-why"))
        assert page.locator(marked("diagnose")).is_disabled()
        moved = run.rename(run.with_name("moved"))
        wait_for_text(page, "notice", f"The run {run} is gone: it was deleted or moved")
        run = moved.rename(run)
        wait_for_text(page, "notice", "samples.npz is damaged")
        page.context.close()
    assert main(["workbench", str(run), "--no-browser", "--port", "0"]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert said[0] == f"reading {run}" and "samples.npz is damaged" in said[-1] and "Traceback" not in str(said)


@pytest.mark.long
@pytest.mark.long_after_the_first
@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"Host": "evil.example"}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Upgrade": "websocket", "Origin": "http://evil.example"}, 403),
        ({"Upgrade": "websocket"}, 403),
        ({"Upgrade": "websocket", "Origin": "ours"}, 101),
    ],
)
def test_other_sites_are_refused(server, headers, status) -> None:
    place = urllib.parse.urlparse(server[1])
    headers = {name: value.replace("ours", f"http://{place.netloc}") for name, value in headers.items()}
    path = "/"
    if "Upgrade" in headers:
        path = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
        key = {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version": "13", "Connection": "Upgrade"}
        headers |= key
    connection = http.client.HTTPConnection(place.hostname, place.port, timeout=10)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    assert answer.status == status
    if "Upgrade" not in headers:  # nothing is loaded from elsewhere, and no page of others can frame it
        policy = answer.getheader("Content-Security-Policy")
        assert "default-src 'none'" in policy and "frame-ancestors 'none'" in policy and "http" not in policy
        assert answer.getheader("X-Frame-Options") == "DENY"
        assert answer.getheader("X-Content-Type-Options") == "nosniff"
    connection.close()
