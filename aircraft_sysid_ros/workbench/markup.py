"""Tables and words of the views as HTML, for the page and for the file: templates that escape what is put in."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AXIS_WORDS
from aircraft_sysid_ros.aircraft.expression import FUNCTION_NAMES
from aircraft_sysid_ros.diagnosis.significance.error_regions import Place
from aircraft_sysid_ros.diagnosis.two_runs import SideBySide
from aircraft_sysid_ros.workbench.calibration_view import CalibrationView
from aircraft_sysid_ros.workbench.shelf import ListedRun
from aircraft_sysid_ros.workbench.views.candidates import Card
from aircraft_sysid_ros.workbench.views.coefficients import AxisRow
from aircraft_sysid_ros.workbench.views.history import VersionRow
from aircraft_sysid_ros.workbench.views.parameters import INTERVAL, ParameterRow
from aircraft_sysid_ros.workbench.views.residuals import ResidualRow
from aircraft_sysid_ros.workbench.views.states import Consistency
from aircraft_sysid_ros.workbench.views.words import chance, percent, readable, rounded, symbol, typeset

#: What figures do by themselves in a browser, on the page and in the file.
SCRIPT = "\n".join(
    Path(__file__).with_name(name).read_text(encoding="utf8") for name in ("crosshair.js", "touch.js", "save_figure.js")
)
#: Parts of the content of one AircraftState: title, field, and where its standard deviations begin.
_OF_STATE = (
    ("wind [m/s]", "wind_ned", 15),
    ("accelerometer bias [m/s²]", "accelerometer_bias", 9),
    ("gyro bias [rad/s]", "gyro_bias", 12),
)


def number(value: float | None, digits: int = 4) -> str:
    """Significant digits, with a true minus; a dash where it is not known."""
    return "–" if value is None else f"{value + 0.0:.{digits}g}".replace("-", "−")


def figures(value: float | None, digits: int = 3) -> str:
    """As many significant digits in every row of a table: 0.0750 beneath 0.0756."""
    return "–" if value is None else f"{value + 0.0:#.{digits}g}".rstrip(".").replace("-", "−")


def thousands(count: int) -> str:
    """A count with spaces between its thousands."""
    return f"{count:,}".replace(",", " ")


def _environment() -> Environment:
    made = Environment(
        loader=FileSystemLoader(Path(__file__).with_name("templates")),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= {
        "number": number,
        "figures": figures,
        "rounded": rounded,
        "percent": percent,
        "typeset": typeset,
        "thousands": thousands,
        "symbol": symbol,
    }
    made.globals |= {"axes": AXES, "interval": INTERVAL}
    return made


_TEMPLATES = _environment()


def page(template: str, **values: Any) -> str:
    """A whole file."""
    return readable(_TEMPLATES.get_template(template).render(values))


def _part(name: str, *values: Any) -> Markup:
    """One macro of the tables."""
    made: Markup = getattr(_TEMPLATES.get_template("tables.html").module, name)(*values)
    return made


LEGEND, LIVE_LEGEND = _part("legend"), _part("live_legend")
DISTRIBUTION_LEGEND = _part("distribution_legend")
TRACE_LEGEND, RESIDUAL_LEGEND = _part("trace_legend"), _part("residual_legend")


def further_keys(version: str | None, has_changes: bool) -> Markup:
    """The keys of a version that is drawn as well, and of the moments of changes."""
    keys = [_part("version_key", version)] if version is not None else []
    return Markup("").join([*keys, *([_part("change_key")] if has_changes else [])])


# -- the model -----------------------------------------------------------------------------------------------


def axis_head(row: AxisRow) -> Markup:
    """Symbol, words and errors of an axis above its figure."""
    return _part("axis_head", row)


def axis_title(name: str) -> Markup:
    """Symbol and words of an axis."""
    return _part("axis_title", name, AXIS_WORDS[name])


def residual_numbers(rows: Sequence[ResidualRow]) -> Markup:
    """Residuals of all axes in numbers."""
    return _part("residual_numbers", rows)


def errors_scale(errors: Iterable[float | None]) -> float:
    """The error that fills a bar: 0.1, 0.2, 0.5, 1, ... of the spread, the least that none of these errors exceeds."""
    top = max((e for e in errors if e is not None and math.isfinite(e)), default=0.0)
    scale, steps = 0.1, itertools.cycle((2.0, 2.5, 2.0))
    while scale < top:
        scale *= next(steps)
    return scale


def scale_head(top: float) -> Markup:
    """Both ends of the bars, as the head of their column."""
    return _part("scale_head", top)


def state_words(row: AxisRow) -> Markup:
    """The residual of an axis, in words."""
    return _part("state_words", row)


def place_words(place: Place) -> Markup:
    """A place where the model fails."""
    return _part("place_words", place)


def place_excess(place: Place) -> Markup:
    """How much it fails there."""
    return _part("place_excess", place)


def card_facts(card: Card, noise: float | None) -> Markup:
    """What is known of a candidate."""
    return _part("card_facts", card, noise)


def term_help(signals: Sequence[str]) -> Markup:
    """What a term of one's own may hold."""
    return _part("term_help", signals, FUNCTION_NAMES)


def help_list(items: Mapping[str, str]) -> Markup:
    """What can be done on a page, and how."""
    return _part("help_list", items)


def model_facts(begin: Sequence[str], model: str, name: str, changes: Sequence[str]) -> Markup:
    """What a page shows, under the name of its aircraft; ``name`` is that of the model, ``changes`` what it is with."""
    return _part("model_facts", begin, model, name, changes)


def lengths(text: str, why: str) -> Markup:
    """How much of the flight is compared, with the reason."""
    return _part("lengths", text, why)


# -- versions, parameters, state -----------------------------------------------------------------------------


def history_table(rows: Sequence[VersionRow]) -> Markup:
    """All versions with their held-out errors in %."""
    return _part("history_table", rows)


def errors_beside(one: VersionRow, other: VersionRow) -> Markup:
    """Errors of two versions side by side."""
    right = {row.axis: row for row in other.axes}
    return _part("errors_beside", (one.identifier, other.identifier), [(row, right.get(row.axis)) for row in one.axes])


def errors_of_flights(both: SideBySide) -> Markup:
    """Errors of the models of two flights on either flight."""
    rows = [(axis, AXIS_WORDS[axis], [_finite(share) for share in both.errors[axis].ravel()]) for axis in both.errors]
    return _part("errors_of_flights", both, rows)


def differences(both: SideBySide) -> Markup:
    """Parameters of two runs or versions with their differences, and how sure those are."""
    rows = [(d, "" if d.p_value != d.p_value else chance(d.p_value)) for d in both.parameters]
    return _part("differences", both, rows)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def refined_errors(errors: Mapping[str, Mapping[str, float]]) -> Markup:
    """Errors of a refined model on the pieces that were not fitted, before and after."""
    rows = [(axis, AXIS_WORDS[axis], _finite(e["nrmse_before"]), _finite(e["nrmse"])) for axis, e in errors.items()]
    return _part("refined_errors", rows)


def runs_table(rows: Sequence[ListedRun]) -> Markup:
    """Runs that can be opened, or why not."""
    return _part("runs_table", rows)


def parameters_beside(
    one: Sequence[Mapping[str, Any]], other: Sequence[Mapping[str, Any]], names: tuple[str, str]
) -> Markup:
    """Parameters of two versions side by side."""
    left, right = ({p["name"]: p for p in listed} for listed in (one, other))
    rows = [(name, left.get(name), right.get(name)) for name in dict.fromkeys((*left, *right))]
    return _part("parameters_beside", names, rows)


def parameter_table(rows: Sequence[ParameterRow], chosen: str = "", linked: bool = True) -> Markup:
    """Estimates with interval, status and reason, and the truth where it is known; names are buttons if linked."""
    return _part("parameter_table", rows, chosen, linked)


def consistency_table(rows: Sequence[Consistency]) -> Markup:
    """Consistency of every sensor with what the filter expected."""
    return _part("consistency_table", rows)


def state_table(state: Mapping[str, Any]) -> Markup:
    """Wind and biases of the content of one AircraftState with their standard errors."""
    std = state["standard_deviations"]
    rows = [(title, [(value, std[at + k]) for k, value in enumerate(state[name])]) for title, name, at in _OF_STATE]
    return _part("state_table", state["status_text"], rows)


# -- calibration ---------------------------------------------------------------------------------------------


def calibration_facts(view: CalibrationView) -> Markup:
    """What was calibrated from what, for a header."""
    return _part("calibration_facts", view)


def calibration_words(view: CalibrationView) -> Markup:
    """What was calibrated, and what its numbers mean."""
    return _part("calibration_words", view)


def calibration_table(view: CalibrationView) -> Markup:
    """Estimates with standard errors, and what is wrong with those that should not be used."""
    return _part("calibration_table", view)


def residuals_table(view: CalibrationView) -> Markup:
    """Rms of the residuals of every output, before and after."""
    return _part("residuals_table", view)


def models_table(view: CalibrationView) -> Markup:
    """Models that were tried, with their residuals in parts of the flight that were left out."""
    return _part("models_table", view)
