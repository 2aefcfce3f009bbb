"""The page of a fleet: one HTML file without scripts of others, flights as rows and airframes as curves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet.between import Between, all_series
from aircraft_sysid_ros.fleet.changes import FEWEST, FEWEST_OF_A_MEAN, Series
from aircraft_sysid_ros.fleet.priors import SeriesOf
from aircraft_sysid_ros.fleet.tables import Flown, tables_of
from aircraft_sysid_ros.installation import MissingExtra
from aircraft_sysid_ros.text_file import write_whole

#: What the page shows at most; tables have all.
_MOST_ROWS, _MOST_PLOTS, _MOST_AIRFRAMES, _MOST_FAILURES = 1000, 12, 8, 100
#: Parameters that are drawn first where nothing changes: stability, damping and control power.
_MAIN = ("Cm_de", "Cm_alpha", "CZ_alpha", "Cl_da", "Cn_beta", "Cm_q", "Cl_p", "Cn_dr")
#: Verdicts that a reader would not understand as they are called.
_VERDICTS = {"none": "nothing is missing", "missing": "an effect is missing"}
#: From so many standard errors of scatter on, a curve says so.
_SCATTERS = 3.0
_WIDTH, _HEIGHT, _LEFT, _TOP, _BOTTOM = 640, 240, 64, 10, 24
_SECOND = 1_000_000_000


def require_jinja2() -> None:
    """Raises MissingExtra where the page cannot be made, before the work."""
    try:
        import jinja2  # noqa: F401
    except ImportError:
        raise MissingExtra("fleets", "jinja2", "fleet") from None


def write_page(path: Path, flown: Sequence[Flown], between: Between) -> None:
    """Write the file. Raises InputError."""
    try:
        write_whole(path, page_html(flown, between))
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}; the tables are there") from None


def page_html(flown: Sequence[Flown], between: Between) -> str:
    """The whole file; ``flown`` in the order of ``tables.in_order``."""
    from markupsafe import Markup

    from aircraft_sysid_ros.workbench.markup import page
    from aircraft_sysid_ros.workbench.report import STYLE

    anchors = {each.flight.name: f"flight-{k}" for k, each in enumerate(flown)}
    failed = [{"name": f.flight.name, "reason": f.answer["reason"]} for f in flown if not f.answer["ok"]]
    airframes = sorted({each.flight.airframe for each in flown})
    fleet = {
        "airframes": airframes,
        "ok": sum(each.answer["ok"] for each in flown),
        "hours": sum(each.answer.get("duration") or 0.0 for each in flown) / 3600.0,
        "rate": between.rate,
        "too_few": between.too_few,
        "changes": [_change(row, between.airframes) for row in between.changes],
        "differences": between.differences,
        "effects": between.effects,
        "failures": failed[:_MOST_FAILURES],
        "more_failures": max(len(failed) - _MOST_FAILURES, 0),
        "flights": sorted((_row(f, anchors[f.flight.name]) for f in flown), key=lambda row: -row["badness"]),
        "most_rows": _MOST_ROWS,
        **_airframes(flown, between, airframes, anchors),
    }
    return page("fleet.html", fleet=fleet, style=Markup(STYLE.read_text(encoding="utf8")))


def _date(start: int | None) -> str:
    if start is None:
        return ""
    return datetime.fromtimestamp(start / _SECOND, timezone.utc).strftime("%Y-%m-%d %H:%M")


def _change(row: Mapping[str, Any], airframes: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    of = (row["airframe"], row["parameter"])
    mean = next((a["value"] for a in airframes if (a["airframe"], a["parameter"]) == of), 0.0)
    share = f"{_two_digits(100.0 * row['size'] / mean)} %".replace("-", "−") if mean else "–"
    return {**row, "date": _date(row["when"]), "share": share}


def _two_digits(value: float) -> str:
    """Two significant digits with a sign, without an exponent from 100 on."""
    return f"{value:+.2g}" if abs(value) < 99.5 else f"{float(f'{value:.2g}'):+.0f}"


def _row(flown: Flown, anchor: str) -> dict[str, Any]:
    """A flight as a row, with how bad it is: failures, then verdicts, then errors beyond the noise."""
    answer = flown.answer
    verdict = (answer.get("diagnosis") or {}).get("verdict") or ("not diagnosed" if answer["ok"] else "not used")
    known = [
        (axis["nrmse_held_out"], axis["nrmse_held_out"] / axis["noise_floor"])
        for axis in answer.get("axes", {}).values()
        if axis["nrmse_held_out"] is not None and axis["noise_floor"]
    ]
    times = max((t for _, t in known), default=0.0)
    found = [c["label"] for c in (answer.get("diagnosis") or {}).get("candidates", ())]
    step = {"none": 0.0, "not diagnosed": 1e6, "not used": 3e6}.get(verdict, 2e6)
    return {
        "name": flown.flight.name, "airframe": flown.flight.airframe, "date": _date(flown.start), "anchor": anchor,
        "verdict": _VERDICTS.get(verdict, verdict), "bad": verdict not in ("none", "not diagnosed"),
        "badness": step + times,
        "error": f"{100.0 * max(e for e, _ in known):.1f} %" if known else "–",
        "times": f"{times:.1f}" if known else "–",
        "used": sum(p["status"] == "USE" for p in answer.get("parameters", ())),
        "reason": "; ".join(filter(None, [", ".join(found), answer["reason"]])),
    }  # fmt: skip


# -- curves --------------------------------------------------------------------------------------------------


def _airframes(
    flown: Sequence[Flown], between: Between, airframes: Sequence[str], anchors: Mapping[str, str]
) -> dict[str, Any]:
    parameters, sensors = all_series(tables_of(flown), flown)
    series = {**parameters, **sensors}
    marked = [row["airframe"] for row in (*between.changes, *between.differences)]
    known = {airframe for airframe, _ in series}
    airframes = [airframe for airframe in dict.fromkeys([*marked, *airframes]) if airframe in known]
    shown = airframes[:_MOST_AIRFRAMES]
    changed = [row["parameter"] for row in between.changes]
    differing = [row["parameter"] for row in between.differences]
    there = {parameter for airframe, parameter in series if airframe in shown}
    drawn = [p for p in dict.fromkeys([*changed, *differing, *_MAIN]) if p in there][:_MOST_PLOTS]
    flights: dict[str, list[Flown]] = {airframe: [] for airframe in shown}
    for each in flown:
        if each.answer["ok"] and each.flight.airframe in flights:
            flights[each.flight.airframe].append(each)
    return {
        "legend": list(enumerate(shown)),
        "not_shown": len(airframes) - len(shown),
        "plots": [_plot(parameter, shown, series, flights, between, anchors) for parameter in drawn],
    }


@dataclass(frozen=True)
class _Scale:
    """Places in a plot of flight numbers up to ``last`` and of values from ``low`` to ``high``."""

    last: int
    low: float
    high: float

    def x(self, number: float) -> float:
        share = number / max(self.last, 1)
        return round(_LEFT + 8 + share * (_WIDTH - _LEFT - 24), 1)

    def y(self, value: float) -> float:
        share = (min(max(value, self.low), self.high) - self.low) / (self.high - self.low)
        return round(_HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM), 1)

    @property
    def ticks(self) -> list[dict[str, Any]]:
        """At round numbers, three to six of them."""
        decade = 10.0 ** np.floor(np.log10((self.high - self.low) / 3.0))
        step = max(step for step in (decade, 2.0 * decade, 5.0 * decade) if 3.0 * step <= self.high - self.low)
        digits = max(int(-np.floor(np.log10(1.001 * step))), 0)
        values = step * np.arange(np.ceil(self.low / step), np.floor(self.high / step) + 1.0)
        return [{"at": self.y(v), "text": f"{v + 0.0:.{digits}f}".replace("-", "−")} for v in values]


def _plot(
    parameter: str,
    shown: Sequence[str],
    series: SeriesOf,
    flights: Mapping[str, Sequence[Flown]],
    between: Between,
    anchors: Mapping[str, str],
) -> dict[str, Any]:
    there = {airframe: series[airframe, parameter] for airframe in shown if (airframe, parameter) in series}
    ends = np.concatenate([one.value + sign * 2.0 * one.std for one in there.values() for sign in (-1.0, 1.0)])
    low, high = float(np.min(ends)), float(np.max(ends))
    margin = 0.06 * (high - low)
    scale = _Scale(max(len(each) for each in flights.values()) - 1, low - margin, high + margin)
    said = {row["airframe"]: _said(row) for row in between.changes if row["parameter"] == parameter}
    said |= {
        row["airframe"]: "not as the others" for row in between.differences
        if row["parameter"] == parameter and row["airframe"] not in said
    }  # fmt: skip
    curves = [
        {
            "colour": shown.index(airframe),
            "quiet": bool(said) and airframe not in said,
            "points": _points(one, scale, flights[airframe], anchors),
        }
        for airframe, one in there.items()
    ]
    words = "; ".join(f"{airframe}: {text}" for airframe, text in said.items()) or _nothing_said(list(there.values()))
    for airframe, one in there.items():
        if (times := _scatter(one)) > _SCATTERS and airframe not in said:
            words += f"; {airframe}: scatters {times:.0f} times as much as its standard errors say"
    missing = sum(len(flights[airframe]) - len(one.number) for airframe, one in there.items())
    if missing:
        words += f"; no point for {missing} flight{'s' if missing > 1 else ''}, of which it is not to be used"
    return {
        "parameter": parameter, "words": words, "curves": curves, "ticks": scale.ticks, "width": _WIDTH,
        "height": _HEIGHT, "left": _LEFT, "right": _WIDTH - 8, "last": scale.last + 1,
    }  # fmt: skip


def _nothing_said(there: Sequence[Series]) -> str:
    """Of the series of one parameter, one for each airframe, that nothing is named, as far as they can be judged."""
    longest, compared = max(map(len, there)), sum(len(one) >= FEWEST_OF_A_MEAN for one in there)
    change = "no change" if longest >= FEWEST else "too few flights to tell a change"
    return f"{change}, no difference" if compared > 1 else change


def _scatter(series: Series) -> float:
    """How much more the values of an airframe scatter about their mean than their standard errors say."""
    if len(series.value) < 3:
        return 0.0
    mean = np.average(series.value, weights=series.std**-2.0)
    return float(np.sqrt(np.sum(((series.value - mean) / series.std) ** 2) / (len(series.value) - 1)))


def _said(change: Mapping[str, Any]) -> str:
    size = _two_digits(change["size"]).replace("-", "−")
    return f"drifts by {size} per flight" if change["kind"] == "drift" else f"jumps by {size} from {change['flight']}"


def _points(series: Series, scale: _Scale, flown: Sequence[Flown], anchors: Mapping[str, str]) -> list[dict[str, Any]]:
    from aircraft_sysid_ros.workbench.views.words import rounded

    points = []
    for number, value, std in zip(series.number, series.value, series.std, strict=True):
        each = flown[int(number)]
        words = (each.flight.name, _date(each.start), " ± ".join(rounded(value, 2.0 * std)))
        points.append({
            "x": scale.x(int(number)), "y": scale.y(value), "low": scale.y(value - 2.0 * std),
            "high": scale.y(value + 2.0 * std), "anchor": anchors[each.flight.name], "title": ", ".join(words),
        })  # fmt: skip
    return points
