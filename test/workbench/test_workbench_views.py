"""Views of a run: numbers of the command line, points that nothing hides, text that cannot be markup."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.after_flight import diagnose
from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.frequency_responses import RateResponse, rate_responses
from aircraft_sysid_ros.diagnosis.model_versions.versions import Change
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.guard import SameOrigin
from aircraft_sysid_ros.workbench.report import report_html
from aircraft_sysid_ros.workbench.run_view import load_flight_record, load_run_view, load_truth_view
from aircraft_sysid_ros.workbench.side_panels import complaint
from aircraft_sysid_ros.workbench.views import (
    candidates,
    coefficients,
    figure,
    parameters,
    places,
    residuals,
    responses,
    states,
    words,
)
from aircraft_sysid_ros.workbench.views import (
    numbers as tables_of_numbers,
)
from aircraft_sysid_ros.workbench.worker import DIAGNOSE, LOAD, Desk, Job


@pytest.fixture(scope="module")
def view(hidden_effect):
    """The run as the page holds it."""
    return load_run_view(hidden_effect)


def numbers(coded: dict) -> np.ndarray:
    return np.frombuffer(base64.b64decode(coded["bdata"]), "<f4")


def test_a_thinned_line_keeps_every_peak_and_every_gap() -> None:
    rng = np.random.default_rng(1)
    time = np.sort(rng.uniform(0.0, 600.0, 60_000))
    values = rng.normal(size=60_000)
    values[31_234], values[77] = 50.0, -50.0
    values[20_000:23_000] = np.nan
    at = figure.thinned(time, values, (100.0, 500.0))
    x, y = time[at], values[at]
    inside = (time >= 100.0) & (time <= 500.0)
    assert len(x) <= figure.MOST_POINTS + 4 and np.all(np.diff(x) >= 0.0)
    assert np.nanmax(y) == 50.0 and np.nanmin(y) == np.nanmin(values[inside])
    assert np.isnan(y[(x > time[20_100]) & (x < time[22_900])]).all()
    few = time[figure.thinned(time, values, (300.0, 302.0))]
    begin, end = np.flatnonzero((time >= 300.0) & (time <= 302.0))[[0, -1]]
    assert np.array_equal(few, time[begin - 1 : end + 2])
    lines = np.column_stack([values, np.roll(values, 5000), rng.normal(size=60_000)])
    together = lines[figure.thinned(time, lines)]  # each line keeps its peaks, at moments that all have
    assert len(together) <= figure.MOST_POINTS + 4
    assert np.array_equal(np.nanmax(together, axis=0), np.nanmax(lines, axis=0))
    assert np.array_equal(np.nanmin(together, axis=0), np.nanmin(lines, axis=0))


@pytest.mark.long
def test_rows_have_the_numbers_of_compare(view, hidden_effect, capsys) -> None:
    capsys.readouterr()
    assert main(["compare", str(hidden_effect), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    rows = coefficients.axis_rows(view.comparison)
    assert [row.axis for row in rows] == list(AXES) and [row.axis for row in rows if row.fails] == ["Cl"]
    for row in rows:
        found = said["axes"][row.axis]
        assert (row.held_out, row.floor, row.fit) == (found["nrmse_held_out"], found["noise_floor"], found["nrmse_fit"])


@pytest.mark.long
def test_an_axis_without_data_says_why(view) -> None:
    axes = {name: axis for name, axis in view.comparison.axes.items() if name != "CZ"}
    without = replace(view.comparison, axes=axes, reasons={"CZ": "it is not measured"})
    row = coefficients.axis_rows(without)[AXES.index("CZ")]
    assert (row.held_out, row.state, row.reason) == (None, coefficients.NO_DATA, "it is not measured")
    assert len(coefficients.coefficient_figure(without, "CZ", figure.LIGHT)["data"]) == 1


def test_a_cell_of_the_map_holds_the_points_that_it_is_made_of(view) -> None:
    found = places.residual_map(view.comparison, "Cl", "alpha", "beta")
    row, column = np.unravel_index(np.nanargmax(found.times_noise), found.times_noise.shape)
    at = [
        0.5 * (e[k] + e[k + 1]) * words.SIGNAL_WORDS[n].factor
        for e, k, n in zip(found.edges, (column, row), found.signals, strict=True)
    ]
    inside = places.mask_of_cell(view.flight, found, *at)
    axis = view.comparison.axes["Cl"]
    z = (axis.fit.held_out / axis.floor.std)[inside]
    assert found.times_noise[row, column] == pytest.approx(np.sqrt(np.nanmean(z**2)), rel=1e-9)
    assert found.times_noise[row, column] > 5.0


def test_spans_of_places_hold_the_places(view) -> None:
    time = coefficients.time_of(view.flight)
    for place in view.comparison.worst:
        spans = places.spans_of_place(view.comparison, place)
        assert spans and all(time[0] - 1.0 < b < e < time[-1] + 1.0 for b, e in spans)
        if place.is_cell:
            mask = places.mask_of_place(view.comparison, place)
            assert mask is not None and spans[0][0] < time[mask][0] + 0.5 * (time[mask][-1] - time[mask][0])


def test_the_curve_is_the_regression_of_what_is_left_over(view) -> None:
    """With e orthogonal to all terms, e + Z phi on Z phi has slope one: the printed curve fits its own dots."""
    found = candidates.evidence(view.flight, "Cl", ["alpha*beta"])
    slope = float(found.left @ found.curve / (found.curve @ found.curve))
    assert slope == pytest.approx(1.0, abs=1e-6)
    assert np.polyfit(found.x, found.curve, 1)[0] == pytest.approx(-0.7, rel=0.05)  # the hidden value
    assert np.std(found.left - found.curve) < 0.3 * np.std(found.left)
    one = candidates.evidence(view.flight, "CZ", ["max(alpha-0.05,0)", "max(alpha-0.05,0)**2"])
    assert one.quantity is words.SIGNAL_WORDS["alpha"] and np.all(np.diff(one.x) >= 0.0)


def test_residuals_of_noise_alone_look_like_noise_and_others_do_not(view) -> None:
    """White noise of the stated sigma in place of the residuals: as many within two sigma as of a normal law."""
    axis = view.comparison.axes["CZ"]
    noise = np.random.default_rng(3).normal(size=len(axis.floor.std)) * axis.floor.std
    shown = replace(view.comparison, axes={"CZ": replace(axis, fit=replace(axis.fit, held_out=noise))})
    (row,) = residuals.residual_rows(shown)
    assert row.rms == pytest.approx(1.0, abs=0.1)
    assert row.within_two == pytest.approx(0.954, abs=0.03) and row.beyond_three < 0.02
    bars, normal = residuals.residual_figure(shown, "CZ", figure.LIGHT)["data"][:2]
    assert np.sum(numbers(bars["y"])) * 0.25 == pytest.approx(1.0, abs=1e-5)  # a density
    expected = np.interp(numbers(bars["x"]), numbers(normal["x"]), numbers(normal["y"]))
    assert np.max(np.abs(numbers(bars["y"]) - expected)) < 0.12
    of_flight = {row.axis: row for row in residuals.residual_rows(view.comparison)}
    assert of_flight["Cl"].rms > 3.0 > 1.5 > of_flight["CZ"].rms  # what is hidden is in the roll axis


def test_a_response_is_drawn_bold_where_it_is_coherent_alone() -> None:
    """A lag of 0.2 s and gain 8: at 1 / (2 pi 0.2 s) it is 3 dB down and 45 degrees late."""
    frequency = np.linspace(0.2, 5.0, 49)
    lag = 8.0 / (1.0 + 2j * np.pi * 0.2 * frequency)
    coherence = np.where(frequency < 2.0, 0.9, 0.3)
    found = RateResponse("q", "de", frequency, lag, coherence, np.full(49, 0.05), 9)
    _, size, _, phase, shown, least = responses.response_figure(found, figure.LIGHT)["data"]
    bold = np.isfinite(numbers(size["y"]))
    np.testing.assert_array_equal(bold, coherence >= 0.6)
    np.testing.assert_array_equal(np.isfinite(numbers(phase["y"])), bold)
    corner = 1.0 / (2.0 * np.pi * 0.2)
    assert np.interp(corner, numbers(size["x"])[bold], numbers(size["y"])[bold]) == pytest.approx(8 / 2**0.5, rel=0.01)
    assert np.interp(corner, numbers(phase["x"])[bold], numbers(phase["y"])[bold]) == pytest.approx(-45.0, abs=0.5)
    np.testing.assert_allclose(numbers(size["error_y"]["array"]), 2.0 * 0.05 * np.abs(lag), rtol=1e-6)
    np.testing.assert_allclose(numbers(shown["y"]), coherence, rtol=1e-6)
    assert set(numbers(least["y"])) == {np.float32(0.6)}


def test_changes_that_are_named_stand_in_the_figures_and_their_key_in_the_legend(view) -> None:
    found = [
        {"found": True, "inner": {"t0": 20.0, "t1": 31.5}},
        {"found": True, "inner": {"onset": 0.2, "width": 0.02}},
        {"found": False, "inner": {"t0": 3.0}},
        {"found": True, "inner": {"t0": 12.0, "full": 20.0}},
        {"found": True, "inner": {"t0": 12.0, "t1": 20.0, "t2": 50.0, "t3": 52.0}},
    ]
    moments = candidates.moments_named({"candidates": found})
    assert moments == [12.0, 20.0, 31.5, 50.0, 52.0] and candidates.moments_named(None) == []
    window = (15.0, 40.0)
    shapes = coefficients.coefficient_figure(view.comparison, "CZ", figure.LIGHT, window, moments=moments)["layout"][
        "shapes"
    ]
    assert [shape["x0"] for shape in shapes if shape["type"] == "line"] == [20.0, 31.5]
    assert "a change that was named" in markup.further_keys(None, True)
    assert "a change" not in markup.further_keys("v2", False) and "v2" in markup.further_keys("v2", False)


def test_every_axis_of_a_figure_has_a_unit(view, hidden_effect) -> None:
    record = load_flight_record(hidden_effect, view.zero)
    made = [residuals.residual_figure(view.comparison, name, figure.LIGHT) for name in view.comparison.axes]
    made += [coefficients.coefficient_figure(view.comparison, name, figure.LIGHT) for name in AXES]
    made += [responses.response_figure(found, figure.LIGHT) for found in rate_responses(view.flight)]
    made += [found for _, found in states.all_figures(record.state, figure.LIGHT, {})]
    for found in made:
        for name, axis in found["layout"].items():
            if name[1:5] == "axis":
                assert re.search(r"\[.+\]$", axis["title"]["text"]), axis["title"]["text"]


def test_files_of_numbers_hold_what_the_page_shows(view) -> None:
    header, *rows = tables_of_numbers.coefficients_csv(view.comparison).splitlines()
    column = header.split(",").index("Cl_held_out_residual")
    held_out = view.comparison.axes["Cl"].fit.held_out
    read = np.array([float(row.split(",")[column] or "nan") for row in rows])
    assert read == pytest.approx(held_out, rel=1e-6, nan_ok=True)
    rows = parameters.parameter_rows(view.parameters[view.current], {"CZ_alpha": -4.6})
    listed = tables_of_numbers.parameters_csv(rows).splitlines()
    assert len(listed) == len(rows) + 1 and next(t for t in listed if t.startswith("CZ_alpha,")).endswith(",-4.6")


@pytest.mark.parametrize(
    ("p", "said"),
    [(0.0, "less than 1 in 1 000 000"), (0.003, "1 in 300"), (0.04, "1 in 20"), (1.0, "more likely than not")],
)
def test_chances_in_words(p, said) -> None:
    assert words.chance(p) == said


def test_history_and_truth_of_parameters(view, hidden_effect) -> None:
    record = load_flight_record(hidden_effect, view.zero)
    truth = load_truth_view(hidden_effect.parent / "flight")
    rows = parameters.parameter_rows(view.parameters[view.current], truth.parameters)
    by_name = {row.name: row for row in rows}
    row = by_name["CZ_alpha"]
    assert row.interval[0] < row.truth < row.interval[1]
    last = record.parameters.value[-1, record.parameters.names.index("CZ_alpha")]
    assert last == pytest.approx(row.value, rel=1e-6)
    made = parameters.history_figure(record.parameters, "CZ_alpha", figure.DARK, row.truth)
    low, high = made["layout"]["yaxis"]["range"]
    assert low < row.truth < high
    assert record.state.time[-1] == pytest.approx(coefficients.time_of(view.flight)[-1], abs=1.0)
    assert truth.parameters["Cl_alpha*beta"] == -0.7
    with pytest.raises(InputError, match="no truth"):
        load_truth_view(hidden_effect)


@pytest.mark.parametrize(
    ("errors", "top"),
    [([], 0.1), ([0.03, None], 0.1), ([0.11], 0.2), ([0.2, np.nan], 0.2), ([0.37], 0.5), ([0.7], 1.0), ([23.0], 50.0)],
)
def test_the_scale_of_the_bars_holds_every_error_and_is_said(errors, top) -> None:
    assert markup.errors_scale(errors) == pytest.approx(top)
    assert f">{100 * top:.0f} %<" in markup.scale_head(top)


def test_a_curve_that_leaves_its_plot_is_marked_where_it_does() -> None:
    time = np.linspace(0.0, 100.0, 1001)
    values = np.column_stack([np.where(time < 30.0, 5.0, 0.0), np.where(time > 90.0, -5.0, 0.0)])
    values[:200, 1] = np.nan
    down, up = figure.beyond(time, values, [-1.0, 1.0], figure.LIGHT)
    assert numbers(down["x"]).min() > 90.0 and -1.0 < numbers(down["y"]).max() < -0.9
    assert numbers(up["x"]).max() < 30.0 and 0.9 < numbers(up["y"]).min() < 1.0
    assert len(numbers(up["x"])) > 5 and down["showlegend"] and not up["showlegend"]
    assert figure.beyond(time, np.clip(np.nan_to_num(values), -1.0, 1.0), [-1.0, 1.0], figure.LIGHT) == []


def test_a_wind_that_is_not_estimated_leaves_every_figure_of_a_report(view, hidden_effect) -> None:
    """Without GPS the wind is unknown: the limits of its figure are none, and nothing in the file is NaN."""
    record = load_flight_record(hidden_effect, view.zero)
    lost = np.full_like(record.state.wind, np.nan)
    state = replace(record.state, wind=lost, wind_std=lost, consistency=np.full_like(record.state.consistency, np.nan))
    made = dict(states.all_figures(state, figure.LIGHT, {}))
    (wind,) = (found for title, found in made.items() if title.startswith("Wind"))
    assert wind["layout"]["yaxis"]["range"] is None
    json.dumps([*made.values()], allow_nan=False)
    text = report_html(view, replace(record, state=state), load_truth_view(hidden_effect.parent / "flight"))
    begin = text.index('id="figures">') + len('id="figures">')
    json.loads(text[begin : text.index("</script>", begin)], parse_constant=pytest.fail)


def test_no_curve_of_the_state_or_of_a_parameter_is_cut_off_silently(view, hidden_effect) -> None:
    record = load_flight_record(hidden_effect, view.zero)
    made = [found for _, found in states.all_figures(record.state, figure.LIGHT, {})]
    made += [parameters.history_figure(record.parameters, n, figure.LIGHT) for n in record.parameters.names]
    cut = 0
    for found in made:
        low, high = found["layout"]["yaxis"].get("range", (-np.inf, np.inf))
        curves = [numbers(t["y"]) for t in found["data"] if t.get("mode") == "lines"]
        leaves = any(np.nanmin(c) < low or np.nanmax(c) > high for c in curves if np.isfinite(c).any())
        marked = any(t.get("name") == figure.BEYOND for t in found["data"])
        assert marked == leaves
        cut += leaves
    assert cut > 3  # estimates begin far away


@pytest.mark.parametrize(
    ("value", "std", "said"),
    [
        (0.036123, 0.01392, ("0.036", "0.014")),
        (-0.70021, 0.00474, ("−0.7002", "0.0047")),
        (12.34, 0.0996, ("12.34", "0.10")),
        (1234.5, 37.2, ("1234", "37")),
        (98_765.0, 1234.0, ("98800", "1200")),
        (0.0, 0.5, ("0.00", "0.50")),
        (1.23456e-9, 4.2e-11, ("1.235e−09", "4.2e-11")),
        (0.5, 0.0, ("0.5", "–")),
        (2.0, np.nan, ("2", "–")),
    ],
)
def test_digits_end_where_the_standard_error_does(value, std, said) -> None:
    assert words.rounded(value, std) == said


def test_a_table_has_values_with_standard_errors_and_intervals_of_95_percent() -> None:
    listed = [{"name": "Cl_beta", "value": -0.1, "std": 0.01, "reason": ""}]
    beside = markup.parameters_beside(listed, listed, ("one", "other"))
    assert "−0.100 <" in beside and "± 0.010<" in beside and "standard error" in beside
    state = {
        "status_text": "fine", "wind_ned": [1.0, 2.0, 3.0], "accelerometer_bias": [0.0] * 3, "gyro_bias": [0.0] * 3,
        "standard_deviations": [0.5] * 18,
    }  # fmt: skip
    assert "± 0.50<" in markup.state_table(state) and "the standard error" in markup.state_table(state)
    assert ">± is the standard error" in markup.state_table({**state, "status_text": ""})  # nothing is wrong
    rows = parameters.parameter_rows([{**listed[0], "status": "USE"}], {})
    assert rows[0].interval == pytest.approx((-0.1196, -0.0804))
    assert "± 0.010<" in markup.parameter_table(rows) and "−0.120 to −0.080" in markup.parameter_table(rows)


@pytest.mark.parametrize(
    ("text", "first"),
    [
        ("alhpa**3", "Write a term with its axis, such as CZ: alpha**3"),
        ("CZ: alhpa**3", "'alhpa' in 'alhpa**3' is not a signal"),
        ("CQ: beta", "'CQ' is not an axis"),
        ("CZ: alpha**3", ""),
        ("stall", ""),
    ],
)
def test_what_is_wrong_with_a_term_begins_with_what_helps(text, first) -> None:
    said = complaint(text)
    assert said.startswith(first) and bool(said) == bool(first) and len(said) < 250


def test_a_file_needs_nothing_else(view, hidden_effect) -> None:
    record = load_flight_record(hidden_effect, view.zero)
    text = report_html(view, record, load_truth_view(hidden_effect.parent / "flight"))
    assert len(text.encode()) < 10e6
    own = text[: text.index("<script>")] + text[text.index('id="figures"') :]
    assert "http://" not in own and "https://" not in own and "src=" not in own
    contents = re.findall(r'<a href="#(\w+)">', own)
    assert contents == ["model", "residuals", "responses", "where", "versions", "parameters", "state"]
    assert all(f'id="{name}"' in own for name in contents)
    begin = text.index('id="figures">') + len('id="figures">')
    figures = json.loads(text[begin : text.index("</script>", begin)])
    drawn = figures["figure-0"]["data"][0]
    assert len(numbers(drawn["x"])) == len(numbers(drawn["y"])) > 500
    assert all("#" not in str(trace.get("line", {}).get("color", "")) for trace in figures["figure-0"]["data"])


class Elements(HTMLParser):
    """Names of the elements of a page, and its text outside of scripts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.names, self.text = [], ""
        self.feed(page)

    def handle_starttag(self, tag, attributes) -> None:
        self.names.append(tag)
        assert not any(name.startswith("on") for name, _ in attributes)

    def handle_data(self, data) -> None:
        self.text += data


CANDIDATE = {
    "effect": None, "expression": "alpha*beta", "name": "", "label": "lift", "physics": "", "found": True,
    "main_axis": "Cl", "error_before": 0.3, "error_after": 0.03, "p_value": 0.01, "where": "70 to 72 s",
    "confounded_with": ["other"], "manoeuvre": "push", "parameters": [], "inner": {"delay": 0.1}, "terms": {},
}  # fmt: skip


ADDED = Change(terms={"CX": ("beta**2",)})


def test_the_file_says_of_which_model_something_was_missing(view) -> None:
    """What was found before it was added is not missing of the model that is shown."""
    found = {"verdict": "missing", "advice": "add it", "model": view.current, "candidates": [CANDIDATE]}
    assert "Why: an effect is missing" in report_html(replace(view, diagnosis=found), None)
    text = report_html(replace(view, diagnosis=found | {"model": "before"}), None)
    assert "Why: of an earlier model" in text and "an effect is missing" not in text
    assert "found for model before" in text and "<p>add it" not in text


def test_names_from_outside_are_text(view, hidden_effect) -> None:
    """Of recording, aircraft, effect, parameter and version: the page has the elements that it has without them."""
    found = {"verdict": "missing", "advice": "add it", "model": view.current, "candidates": [CANDIDATE]}
    plain = replace(view, notes=("note",), diagnosis=found, changes={"effect": ADDED})

    def hostile(words: str) -> str:
        return f"<script>alert('{words}')</script><img src=x onerror=alert(1)>&amp;"

    worded = {key: hostile(key) for key in ("label", "physics", "where", "manoeuvre")}
    worded |= {"confounded_with": [hostile("other")], "inner": {hostile("delay"): 0.1}}
    first, *others = view.parameters[view.current]
    named = {**first, "name": hostile("parameter"), "reason": hostile("reason")}
    changed = replace(
        plain,
        aircraft=hostile("aircraft"),
        name=hostile("recording"),
        notes=(hostile("note"),),
        changes={hostile("effect"): ADDED},
        diagnosis=found | {"advice": hostile("advice"), "candidates": [CANDIDATE | worded]},
        parameters={view.current: [named, *others]},
    )
    was, now = (Elements(report_html(shown, None)) for shown in (plain, changed))
    assert now.names == was.names
    where = ("label", "physics", "where", "manoeuvre", "other", "delay", "parameter", "reason", "aircraft", "recording",
             "note", "effect", "advice")  # fmt: skip
    assert [words for words in where if hostile(words) not in now.text] == []


def test_names_in_figures_are_text() -> None:
    """Some markup plotly.js would draw: that of the symbols, and not that of names."""
    shown = figure.axis(figure.LIGHT, "<b>Cl</b>_<a href='https://example.org'>alpha</a>")["title"]["text"]
    assert "<" not in shown and unescape(shown) == "<b>Cl</b>_<a href='https://example.org'>alpha</a>"
    assert figure.axis(figure.LIGHT, words.symbol("Cl") + " < 1")["title"]["text"] == "C<sub>l</sub> &lt; 1"


@pytest.mark.long
def test_the_command_writes_a_file_or_says_why_not(hidden_effect, tmp_path, capsys) -> None:
    out = tmp_path / "a.html"
    assert main(["report", str(hidden_effect), "--out", str(out)]) == 0
    assert "MB" in capsys.readouterr().out and [path.name for path in tmp_path.iterdir()] == ["a.html"]
    for arguments in (["--out", str(tmp_path / "a.pdf")], ["--out", str(tmp_path / "no" / "a.html")]):
        assert main(["report", str(hidden_effect), *arguments]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert main(["report", str(tmp_path), "--out", str(tmp_path / "b.html")]) == 2


@pytest.mark.long
def test_the_file_opens_in_a_browser_and_moves_together(hidden_effect, tmp_path, open_page) -> None:
    assert main(["report", str(hidden_effect), "--out", str(tmp_path / "a.html")]) == 0
    page = open_page((tmp_path / "a.html").as_uri())
    offered = "[...document.querySelectorAll('.modebar-btn')].map((button) => button.dataset.title)"
    assert set(page.evaluate(offered)) == {"Download plot"}  # plotly.js would like to upload the flight, too
    page.evaluate("Plotly.relayout(document.querySelector('.linked'), {'xaxis.range[0]': 20, 'xaxis.range[1]': 25})")
    page.wait_for_function(
        "[...document.querySelectorAll('.linked')].every((p) => Math.abs(p._fullLayout.xaxis.range[0] - 20) < 1e-6)"
    )
    page.click("button.theme")
    page.wait_for_selector("body.body--dark")


@pytest.mark.parametrize(
    ("kind", "method", "host", "origin", "allowed"),
    [
        ("http", "GET", "127.0.0.1:8350", None, True),
        ("http", "GET", "[::1]:8350", None, True),
        ("http", "GET", "localhost", None, True),
        ("http", "GET", "rebound.example:8350", None, False),
        ("http", "POST", "127.0.0.1:8350", None, False),
        ("http", "POST", "127.0.0.1:8350", "null", False),
        ("http", "POST", "127.0.0.1:8350", "http://127.0.0.1:8351", False),
        ("http", "POST", "127.0.0.1:8350", "http://127.0.0.1:8350", True),
        ("websocket", "", "127.0.0.1:8350", None, False),
        ("websocket", "", "127.0.0.1:8350", "http://127.0.0.1:8350.evil.example", False),
        ("websocket", "", "127.0.0.1:8350", "http://127.0.0.1:8350", True),
    ],
)
def test_who_may_write(kind, method, host, origin, allowed) -> None:
    headers = [(b"host", host.encode()), *([(b"origin", origin.encode())] if origin is not None else [])]
    guard = SameOrigin(lambda *_: None, "127.0.0.1")
    assert guard.allows({"type": kind, "method": method, "headers": headers}) is allowed


@pytest.mark.parametrize(
    "content", ["", "[]", "{}", '{"model": "a", "verdict": "missing", "advice": "", "candidates": [{}]}']
)
def test_a_diagnosis_that_cannot_be_read_is_a_note(view, run, content) -> None:
    (run / "diagnosis.json").write_text(content, encoding="utf8")
    damaged = load_run_view(run, view)
    assert damaged.diagnosis is None and "diagnosis.json of the run cannot be read: diagnose again" in damaged.notes


def test_a_diagnosis_that_cannot_be_written_is_shown_all_the_same(view, run, monkeypatch) -> None:
    """The finished answer had been thrown away for its copy."""
    found = {"model": view.current, "verdict": "none", "advice": "None.", "candidates": [], "left": np.nan}

    def refuse(path, content):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(diagnose, "diagnose_run", lambda folder, replicas, tell: (dict(found), Path(folder)))
    monkeypatch.setattr(diagnose, "write_json", refuse)
    desk = Desk(str(run), lambda what, share: None)
    desk._view = view
    done = desk.do(Job(DIAGNOSE))
    assert done.view.diagnosis == {**found, "left": None, "file": None}
    assert done.sentence == "None. The run cannot be written to, so the page alone has this."
    assert desk.do(Job(LOAD)).view.diagnosis == done.view.diagnosis
    (run / "diagnosis.json").write_text(json.dumps({**found, "left": 0, "advice": "Another."}), encoding="utf8")
    assert desk.do(Job(LOAD)).view.diagnosis["advice"] == "Another."


@pytest.mark.long
def test_what_could_not_be_read_of_the_recording_is_a_note(view, run) -> None:
    state = json.loads((run / "state.json").read_text(encoding="utf8"))
    assert state["notes"] == [] and not any(note.startswith("recording: ") for note in view.notes)
    (run / "state.json").write_text(json.dumps({**state, "notes": ["a chunk is damaged"]}), encoding="utf8")
    assert load_run_view(run, view).notes[0] == "recording: a chunk is damaged"


def test_damaged_estimates_are_shown_as_far_as_they_go(view, run) -> None:
    whole = load_flight_record(run, view.zero)
    assert whole.notes == ()
    data = bytearray((run / "estimates.mcap").read_bytes())
    data[len(data) // 2] ^= 1
    (run / "estimates.mcap").write_bytes(data)
    damaged = load_flight_record(run, view.zero)
    assert damaged.notes[0].startswith("estimates.mcap: the chunk at byte ")
    assert 0 < len(damaged.state.time) < len(whole.state.time)


@pytest.mark.long
def test_a_version_that_cannot_be_read_is_left_out_with_a_note(run) -> None:
    assert main(["add", str(run), "Cl: alpha*beta"]) == 0
    assert main(["remove", str(run), "Cl: alpha*beta"]) == 0
    (other,) = (path for path in (run / "models").iterdir() if "alpha*beta" in (path / "version.json").read_text())
    both = load_run_view(run)
    assert [version.identifier for version in both.versions] == [both.current, other.name]
    assert both.comparisons[other.name].axes["Cl"].fit.nrmse_held_out < 0.1
    (other / "version.json").write_text("{", encoding="utf8")
    one = load_run_view(run, both)
    assert [version.identifier for version in one.versions] == [one.current]
    assert any("damaged" in note for note in one.notes)
