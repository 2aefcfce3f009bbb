"""The view of a calibration: the numbers of result.json, in units for people, and what cannot be shown."""

from __future__ import annotations

import base64
import json
import os
import shutil

import numpy as np
import pytest
from page_marks import marked

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.workbench import markup
from aircraft_sysid_ros.workbench.calibration_view import (
    CalibrationFolder,
    calibration_folder,
    is_calibration,
    load_calibration_view,
)
from aircraft_sysid_ros.workbench.report import calibration_html
from aircraft_sysid_ros.workbench.views import calibration as views
from aircraft_sysid_ros.workbench.views.figure import LIGHT


@pytest.fixture(scope="module")
def result(calibration):
    """The content of result.json."""
    return json.loads((calibration / "result.json").read_text())


@pytest.mark.long
def test_a_parameter_is_named_for_those_who_do_not_know_its_symbol(calibration) -> None:
    view = load_calibration_view(calibration)
    words = {p.name: p.words for p in view.parameters}
    assert (
        words["lambda_V"] == "scale error of the airspeed" and words["W_D"] == "wind downwards" and all(words.values())
    )
    assert [markup.figures(x) for x in (0.075, 0.07577, -1.8, 4.0817, 120.4, None)] == [
        "0.0750", "0.0758", "−1.80", "4.08", "120", "–",
    ]  # fmt: skip


@pytest.fixture
def folder(calibration, tmp_path):
    """A copy that a test may change."""
    shutil.copytree(calibration, tmp_path / "probe")
    return tmp_path / "probe"


def rewritten(folder, change) -> None:
    """result.json with a change, and a time of change that differs."""
    file = folder / "result.json"
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))
    os.utime(file, ns=(1, file.stat().st_mtime_ns + 1_000_000_000))


def nothing_known(content) -> None:
    """No number but those that say when."""
    content["parameters"] = [p | {"value": None, "std": None} for p in content["parameters"]]
    content["residuals"] = {name: {"before": None, "after": None} for name in content["residuals"]}
    count, stage = len(content["series"]["time"]), content["stage_1"]
    for series in (content["series"]["before"], content["series"]["after"]):
        series.update({name: [None] * count for name in series})
    stage |= {"unique": False, "minima": [], "trace": [None] * len(stage["trace"])}


def numbers(coded: dict) -> np.ndarray:
    return np.frombuffer(base64.b64decode(coded["bdata"]), "<f4")


@pytest.mark.long
def test_the_view_has_the_numbers_of_the_result(calibration, result) -> None:
    view = load_calibration_view(calibration)
    assert view.what == "five-hole" and view.decision == result["decision"] and view.unique
    assert [p.name for p in view.sampled] == ["lambda_alpha", "b_alpha", "lambda_beta", "b_beta", "eps_phi"]
    for shown, told in zip(view.parameters, result["parameters"], strict=True):
        factor = 180.0 / np.pi if told["unit"] == "rad" else 1.0
        assert shown.value == pytest.approx(told["value"] * factor)
        assert shown.std == pytest.approx(told["std"] * factor)
        assert shown.unit == ("deg" if factor > 1.0 else told["unit"])
    for output in view.outputs:
        rms = [float(np.sqrt(np.mean(values**2))) for values in (output.before, output.after)]
        assert rms == pytest.approx([output.rms_before, output.rms_after], rel=0.1)  # every n-th of all
        assert output.rms_after < output.rms_before
    assert [(m.words, m.is_used) for m in view.models] == [(m["model"], m["used"]) for m in result["models"]]
    assert sum(m.is_used for m in view.models) == 1 and view.models[0].words in markup.models_table(view)
    best = np.argmin(view.trace)
    assert view.minima[0][1] < view.trace[best]  # followed down from the samples
    half = 0.5 * np.ptp(view.xi2, axis=0)
    assert np.all(np.abs(view.minima[0][0] - view.estimate) < 0.3 * half)


@pytest.mark.long
def test_figures_draw_every_sample_and_mark_the_estimate(calibration) -> None:
    view = load_calibration_view(calibration)
    for column, parameter in enumerate(view.sampled):
        made = views.trace_figure(view, column, LIGHT)
        assert numbers(made["data"][0]["x"]) == pytest.approx(view.xi2[:, column], rel=1e-6)
        low, high = made["layout"]["yaxis"]["range"]
        drawn = np.log10(np.concatenate([view.trace, [trace for _, trace in view.minima]]))
        assert np.all((drawn > low) & (drawn < high))  # nothing is cut off
        band, upright = made["layout"]["shapes"]
        assert upright["x0"] == parameter.value and band["x0"] < parameter.value < band["x1"]
    distance = views.distance_figure(view, LIGHT)["data"][0]
    far, trace = numbers(distance["x"]), numbers(distance["y"])
    near = far < np.quantile(far, 0.2)
    assert np.median(trace[near]) < np.median(trace[~near])  # it rises away from the estimate
    plane = views.plane_figure(view, 0, 1, LIGHT)
    assert len(numbers(plane["data"][0]["x"])) == len(view.trace)
    assert plane["data"][0]["marker"]["cmin"] == pytest.approx(np.log10(view.trace.min()), rel=1e-6)


def test_what_the_flight_does_not_tell_is_said(folder) -> None:
    def change(content) -> None:
        content["parameters"][0] |= {"determined": False, "std": None, "reason": "not excited, taken as 0: fly <b>"}
        content["parameters"][1] |= {"reason": "at its bound: the standard error means nothing"}
        content["decision"], content["stage_1"]["unique"] = "flat: half the range of the samples", False

    rewritten(folder, change)
    view = load_calibration_view(folder)
    assert [p.state for p in view.parameters[:3]] == ["not excited", "at its bound", ""]
    table = markup.calibration_table(view)
    assert "fly &lt;b&gt;" in table and "<b>" not in table and 'status hold">not excited' in table
    assert 'status reject">at its bound' in table
    assert views.verdict(view) == "No unique minimum" and "Flat: half the range" in views.sentences(view)[0]


def test_what_is_taken_instead_of_an_answer_is_not_drawn_as_the_estimate(folder) -> None:
    """A parameter at its bound has its nominal value: at that stood the line of the estimate."""

    def change(content) -> None:
        (refused,) = [p for p in content["parameters"] if p["name"] == content["stage_1"]["names"][0]]
        refused |= {"determined": False, "value": 0.0, "std": None, "reason": "at its bound (1 ± 2): taken as 0"}

    rewritten(folder, change)
    view = load_calibration_view(folder)
    shapes = [views.trace_figure(view, column, LIGHT)["layout"]["shapes"] for column in (0, 1)]
    assert [len(found) for found in shapes] == [0, 2]
    assert views.distance_figure(view, LIGHT) is None
    assert views.plane_figure(view, 0, 1, LIGHT)["data"][1]["x"] == [None]


def test_numbers_that_are_none_are_left_out(folder) -> None:
    """NaN and null anywhere: the rest is drawn, and no figure holds them where plotly or JSON would fail."""

    def change(content) -> None:
        content["parameters"][5] |= {"value": float("nan"), "std": None}
        content["stage_1"]["trace"][:3] = [None, float("nan"), 0.0]
        content["stage_1"]["xi2"][4][0] = None
        content["series"]["before"]["V_N"] = [None] * len(content["series"]["time"])
        content["residuals"]["V_N"]["before"] = None
        content["residuals"]["V_E"] = {"before": 0.0, "after": float("inf")}
        content["stage_1"]["minima"][0]["trace"] = None

    rewritten(folder, change)
    view = load_calibration_view(folder)
    assert view.parameters[5].state == "not a number" and np.isnan(view.trace[:3]).all()
    assert views.distance_figure(view, LIGHT) is None
    for column in range(len(view.sampled)):
        layout = views.trace_figure(view, column, LIGHT)["layout"]
        assert np.isfinite([*layout["xaxis"]["range"], *layout["yaxis"]["range"]]).all()
    assert "nan" not in markup.calibration_table(view).lower() and "inf" not in markup.residuals_table(view)
    text = calibration_html(view)
    begin = text.index('id="figures">') + len('id="figures">')
    json.loads(text[begin : text.index("</script>", begin)], parse_constant=pytest.fail)


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c.pop("series"),
        lambda c: c["stage_1"].pop("names"),
        lambda c: c["stage_1"]["trace"].pop(),
        lambda c: c["stage_1"]["names"].append("nobody"),
        lambda c: c["series"]["after"].pop("V_E"),
        lambda c: c["series"]["time"].pop(),
        lambda c: c.update(parameters=None),
        lambda c: c.pop("models"),
        lambda c: c["segments"].append({"manoeuvre": "loop", "from": None, "to": 1.0}),
    ],
)
def test_a_result_that_lacks_something_is_one_sentence(folder, change) -> None:
    rewritten(folder, change)
    with pytest.raises(InputError, match=r"result\.json is damaged or of another version") as error:
        load_calibration_view(folder)
    assert f"calibrate again with --out {folder} --overwrite" in str(error.value)


def test_names_from_outside_are_no_markup(folder) -> None:
    hostile = "<img src=x onerror=alert(1)>"

    def change(content) -> None:
        content |= {"aircraft": hostile, "recording": hostile, "residual_unit": hostile, "notes": [hostile]}
        content["parameters"][0]["name"] = hostile
        content["parameters"][5]["name"] = content["stage_1"]["names"][0] = hostile
        content["residuals"][hostile] = content["residuals"].pop("V_N")
        for series in (content["series"]["before"], content["series"]["after"]):
            series[hostile] = series.pop("V_N")

    rewritten(folder, change)
    assert "<img src=x" not in calibration_html(load_calibration_view(folder))


def test_folders_are_told_apart_and_followed(folder, hidden_effect, tmp_path, capsys) -> None:
    assert is_calibration(folder) and is_calibration(folder / "calibration.yaml")
    assert not is_calibration(hidden_effect) and not is_calibration(tmp_path / "nothing")
    assert calibration_folder(folder / "calibration.yaml") == folder
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "result.json").write_text("[" * 100_000)
    with pytest.raises(InputError, match="is damaged"):
        load_calibration_view(tmp_path / "deep")
    with pytest.raises(InputError, match="holds no calibration"):
        calibration_folder(tmp_path)
    opened = CalibrationFolder(folder)
    rewritten(folder, lambda c: c.update(aircraft="another"))
    opened.look()
    assert (opened.view.aircraft, opened.damage, opened.revision) == ("another", "", 1)
    (folder / "result.json").write_text("{")
    opened.look()
    assert opened.view.aircraft == "another" and "is damaged" in opened.damage and opened.revision == 2
    opened.look()
    assert opened.revision == 2
    for arguments in ([folder, "--truth", "bag"], [hidden_effect, "--calibration", tmp_path], [folder]):
        assert main(["workbench", *map(str, arguments), "--no-browser", "--port", "0"]) == 2
        assert "Traceback" not in capsys.readouterr().err


@pytest.mark.long
def test_the_page_of_a_calibration(folder, served, open_page) -> None:
    with served(folder) as address:
        page = open_page(address, plots=20, width=820, height=1180, color_scheme="dark")
        page.wait_for_selector("body.body--dark")
        assert page.inner_text(marked("calibration-verdict")) == "One clear minimum"
        table = page.inner_text(marked("calibration"))
        view = load_calibration_view(folder)
        assert all(p.name in table for p in view.parameters) and f"\t{view.parameters[0].std:.2g}\t" in table
        assert page.evaluate("document.documentElement.scrollWidth") <= 820
        dots = page.evaluate("document.querySelector('[data-testid=trace-0]').calcdata[0].length")
        assert dots == len(view.trace)
        page.click(".pickers .q-select >> nth=0")
        page.click(".q-menu .q-item >> nth=4")
        page.wait_for_function(
            "document.querySelector('[data-testid=trace-plane]')._fullLayout.xaxis.title.text.includes('eps_phi')"
        )
        rewritten(folder, nothing_known)  # and the browser makes no error of it
        page.wait_for_function(
            "document.querySelector('[data-testid=calibration-verdict]').innerText === 'No unique minimum'"
        )
        (folder / "result.json").unlink()
        page.wait_for_selector(marked("notice") + ":has-text('is not there')")
        page.context.close()


@pytest.mark.long
def test_the_file_of_a_calibration(calibration, hidden_effect, tmp_path, open_page, capsys) -> None:
    out = tmp_path / "probe.html"
    assert main(["report", str(calibration), "--out", str(out)]) == 0
    page = open_page(out.as_uri(), plots=16)
    assert "One clear minimum" in page.inner_text("main")
    both = tmp_path / "both.html"
    assert main(["report", str(hidden_effect), "--calibration", str(calibration), "--out", str(both)]) == 0
    text = both.read_text()
    assert "One clear minimum" in text and "Where it fails" in text and len(text) < 10e6
