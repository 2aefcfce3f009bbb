"""Add to a model, or take away: what the user names becomes a change, and the change a new version with its errors."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel, model_from_terms, term_label
from aircraft_sysid_ros.aircraft.expression import SIGNALS, one_line, parse_expression
from aircraft_sysid_ros.diagnosis.compare import compare_axis
from aircraft_sysid_ros.diagnosis.effect import Effect, Variant, with_setting
from aircraft_sysid_ros.diagnosis.effects import BY_ID
from aircraft_sysid_ros.diagnosis.fit import AxisFit, fit_axis
from aircraft_sysid_ros.diagnosis.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.search import Bench
from aircraft_sysid_ros.diagnosis.versions import Change, Run, Version, changing, open_run, version_with, write_version
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.modelling.trust import Evidence, TrustRules, judge

Array = npt.NDArray[np.float64]
Progress = Callable[[float], None]

#: Fall of a held-out error, as a share of it, below which nothing was gained.
LEAST_FALL = 0.01
#: Values of an inner number of a measurement effect that are tried first, and steps of the golden section after.
_COARSE, _STEPS = 5, 6
#: Flight [s] on which the values are tried.
_SEARCHED = 120.0
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


@dataclass(frozen=True)
class Outcome:
    """A new version, and what became of the held-out errors of the axes that changed."""

    version: Version
    label: str
    change: Change
    axes: Mapping[str, Mapping[str, float]]  # error_before, error_after, noise_floor
    parameters: list[dict[str, Any]]  # the new terms
    improved: bool
    verdict: str


def add(path: str | Path, text: str, progress: Progress = lambda share: None) -> Outcome:
    """Add an effect of the library by its id, or terms such as ``CZ: alpha**3``, to the current version of a run.

    Raises InputError with a sentence, and changes nothing, where that cannot be.
    """
    with changing(path):
        run = open_run(path)
        parsed = parse_request(text)
        flight = run.flight()
        progress(0.2)
        if isinstance(parsed, Effect):
            label, change = parsed.identifier, _of_effect(run, flight, parsed, progress)
            if change.settings and label in run.current.changes:
                raise InputError(f"'{label}' is in the model already: remove it first")
        else:
            change, label = _of_terms(flight, parsed), label_of(parsed)
        changes = {**run.current.changes, label: _merged(run.current.changes.get(label), change)}
        if not isinstance(parsed, Effect):
            changes = _without_removal(changes, label, parsed)
        return _finish(run, flight, changes, label, change, removed=False)


def remove(path: str | Path, text: str) -> Outcome:
    """Take away what was added under this name, or any term such as ``CZ: de``."""
    with changing(path):
        run = open_run(path)
        parsed = parse_request(text)
        label = parsed.identifier if isinstance(parsed, Effect) else label_of(parsed)
        changes = dict(run.current.changes)
        if label in changes and (changes[label].terms or changes[label].settings):
            change = changes.pop(label)
        elif isinstance(parsed, Effect):
            raise InputError(f"'{label}' is not in the model: it has {_added(run.current)}")
        else:
            change = _removal(run.current, parsed)
            changes = _with_removal(changes, label, change, run.root.model)
        return _finish(run, run.flight(), changes, label, change, removed=True)


# -- what the user names -------------------------------------------------------------------------------------


def parse_request(text: str) -> Effect | dict[str, tuple[str, ...]]:
    """An effect by its id, or canonical terms by axis from ``CZ: alpha**3`` (more axes after a semicolon)."""
    text = one_line(text).strip()
    if text in BY_ID:
        return BY_ID[text]
    if ":" not in text:
        close = difflib.get_close_matches(text.lower(), BY_ID, 3, 0.5)
        hint = f"did you mean {' or '.join(close)}?" if close else f"effects are {' '.join(sorted(BY_ID))}"
        raise InputError(f"'{text[:60]}' is no effect, {hint}; a term is written with its axis, such as CZ: alpha**3")
    terms: dict[str, tuple[str, ...]] = {}
    for part in filter(None, map(str.strip, text.split(";"))):
        axis, _, expression = part.partition(":")
        axis = {a.lower(): a for a in AXES}.get(axis.strip().replace("_", "").lower(), axis.strip())
        if axis not in AXES:
            raise InputError(f"'{axis[:30]}' is no axis: the axes are {' '.join(AXES)}")
        terms[axis] = (*terms.get(axis, ()), parse_expression(expression).text)
    model_from_terms(terms)  # twice the same
    return terms


def label_of(terms: Mapping[str, tuple[str, ...]]) -> str:
    """Terms as the user writes them."""
    return "; ".join(f"{axis}: {text}" for axis, texts in terms.items() for text in texts)


def _added(version: Version) -> str:
    return ", ".join(version.changes) or "nothing that was added"


def _of_terms(flight: FlightData, terms: Mapping[str, tuple[str, ...]]) -> Change:
    for axis, texts in terms.items():
        labels = {term_label(text) for text in flight.model.terms[axis]}
        for text in texts:
            if term_label(text) in labels:
                raise InputError(f"the model has the term '{text}' in {axis} already")
            missing = missing_signals(flight, text)
            if missing:
                raise InputError(f"'{axis}: {text}' needs {' and '.join(missing)}, which this flight does not have")
    for axis, texts in terms.items():
        unknown = undetermined(flight, axis, texts)
        if unknown:
            raise InputError(
                f"this flight does not determine '{axis}: {unknown[0]}': it does not vary, or other terms explain it"
            )
    return Change(terms=dict(terms))


def missing_signals(flight: FlightData, *texts: str) -> list[str]:
    """Signals that terms read and that have no value in the flight."""
    model = model_from_terms({"CX": list(dict.fromkeys(texts))})
    return [name for name in SIGNALS if name in model.signals_used and not np.isfinite(flight.signal(name)).any()]


def undetermined(flight: FlightData, axis: str, texts: tuple[str, ...]) -> list[str]:
    """Terms whose parameters the flight does not determine beside those of the model."""
    columns = flight.columns([parse_expression(text) for text in texts])
    result = fit_axis(flight, axis).extended(columns, texts).fit
    return [text for text in texts if text in result.not_determined]


def _of_effect(run: Run, flight: FlightData, effect: Effect, progress: Progress) -> Change:
    settings = [variant for variant in effect.variants if variant.setting]
    if settings:
        return _of_setting(run, effect, settings, progress)
    missing = [name for name in SIGNALS if name in effect.signals and not np.isfinite(flight.signal(name)).any()]
    trial = None if missing else Bench(flight).best_of(effect)
    if trial is None:
        raise InputError(
            f"'{effect.identifier}' needs {' and '.join(missing) or 'signals'}, which this flight does not have"
        )
    new: dict[str, tuple[str, ...]] = {}
    for axis in trial.gains:
        texts = tuple(parse_expression(text).text for text in trial.candidate.terms[axis])
        texts = tuple(text for text in texts if text not in flight.model.terms[axis])
        unknown = undetermined(flight, axis, texts) if texts else []
        if len(unknown) < len(texts):
            new[axis] = tuple(text for text in texts if text not in unknown)
    if not new:
        raise InputError(f"this flight does not determine '{effect.identifier}', or the model has it already")
    return Change(terms=new)


def _of_setting(run: Run, effect: Effect, variants: list[Variant], progress: Progress) -> Change:
    """The setting with the least held-out error: coarse values of every variant, then a golden section."""
    if run.samples is None:
        raise InputError(f"{run.path} holds no samples to reconstruct from: replay the recording again")
    end = run.samples.stamp.min() + int(_SEARCHED * 1e9)
    part = replace(run, samples=run.samples[run.samples.stamp <= end])
    number, tried = effect.inner[0], 0
    total = _COARSE * len(variants) + _STEPS + 2

    def error(variant: Variant, value: float) -> float:
        nonlocal tried
        tried += 1
        progress(0.2 + 0.7 * tried / total)
        try:
            return _log_error(part.flight(with_setting(run.current.aircraft, variant.setting, value)))
        except InputError:
            return np.inf

    grid = np.linspace(number.low, number.high, _COARSE)
    table = np.array([[error(variant, value) for value in grid] for variant in variants])
    if not np.isfinite(table).any():
        raise InputError(f"'{effect.identifier}' cannot be tried on this flight")
    row, column = np.unravel_index(int(np.argmin(table)), table.shape)
    variant, width = variants[int(row)], float(grid[1] - grid[0])
    low, high = max(grid[column] - width, number.low), min(grid[column] + width, number.high)
    value = golden_section(lambda v: error(variant, v), low, high, _STEPS)
    return Change(settings=((variant.setting, float(f"{value:.4g}")),))


def golden_section(function: Callable[[float], float], low: float, high: float, steps: int) -> float:
    """Where a function with one minimum between two limits is least, to 0.62^steps of their distance."""
    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_a, at_b = function(a), function(b)
    for _ in range(steps):
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - _GOLDEN * (high - low)
            at_a = function(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + _GOLDEN * (high - low)
            at_b = function(b)
    return a if at_a < at_b else b


def _log_error(flight: FlightData) -> float:
    """Sum over the axes with data of ln(held-out NRMSE)."""
    fits = fits_of(flight)
    if not fits:
        raise InputError("no axis can be fitted")
    return float(sum(np.log(fit.nrmse_held_out) for fit in fits.values()))


# -- bookkeeping of changes ----------------------------------------------------------------------------------


def _merged(before: Change | None, change: Change) -> Change:
    """The same effect once more: its new terms beside the old ones."""
    if before is None:
        return change
    axes = {**before.terms, **change.terms}
    terms = {axis: tuple(dict.fromkeys((*before.terms.get(axis, ()), *change.terms.get(axis, ())))) for axis in axes}
    return Change(terms, before.without, change.settings or before.settings)


def _removal(version: Version, terms: Mapping[str, tuple[str, ...]]) -> Change:
    model = version.aircraft.model
    for axis, texts in terms.items():
        for text in texts:
            if text not in model.terms[axis]:
                raise InputError(f"the model has no term '{text}' in {axis}: it has {' '.join(model.terms[axis])}")
        if not set(model.terms[axis]) - set(texts):
            raise InputError(f"'{texts[0]}' is the last term of {axis}: add another one first")
    return Change(without=dict(terms))


def _with_removal(changes: dict[str, Change], label: str, removal: Change, root: AerodynamicModel) -> dict[str, Change]:
    """Terms that were added go from their change, terms of the root are noted as gone."""
    found = {}
    for name, change in changes.items():
        terms = {a: tuple(t for t in ts if t not in removal.without.get(a, ())) for a, ts in change.terms.items()}
        terms = {axis: texts for axis, texts in terms.items() if texts}
        if terms or change.without or change.settings:
            found[name] = replace(change, terms=terms)
    gone = {axis: tuple(t for t in ts if t in root.terms[axis]) for axis, ts in removal.without.items()}
    gone = {axis: texts for axis, texts in gone.items() if texts}
    if gone:
        found[label] = Change(without=gone)
    return found


def _without_removal(changes: dict[str, Change], label: str, terms: Mapping[str, tuple[str, ...]]) -> dict[str, Change]:
    """A term of the root that was removed and is added again is where it was."""
    found, back = {}, dict(terms)
    for name, change in changes.items():
        without = {}
        for axis, texts in change.without.items():
            again = set(texts) & set(terms.get(axis, ()))
            back[axis] = tuple(t for t in back.get(axis, ()) if t not in again)
            without[axis] = tuple(t for t in texts if t not in again)
        found[name] = replace(change, without={a: ts for a, ts in without.items() if ts})
    found[label] = replace(found[label], terms={a: ts for a, ts in back.items() if ts})
    return {name: c for name, c in found.items() if c.terms or c.without or c.settings}


# -- errors before and after ---------------------------------------------------------------------------------


def fits_of(flight: FlightData) -> dict[str, AxisFit]:
    """The fit of every axis that has data."""
    fits = {}
    for axis in AXES:
        try:
            fits[axis] = fit_axis(flight, axis)
        except InputError:
            continue
    return fits


def _finish(
    run: Run, flight: FlightData, changes: Mapping[str, Change], label: str, change: Change, *, removed: bool
) -> Outcome:
    before_version = run.current
    version = version_with(run, changes, (before_version.identifier,))
    other = run.flight(version.aircraft) if change.settings else replace(flight, aircraft=version.aircraft)
    before, after = fits_of(flight), fits_of(other)
    touched = list(AXES) if change.settings else [*change.terms, *change.without]
    axes = {axis: _errors(before[axis], after[axis], other) for axis in AXES if axis in touched and axis in after}
    if not axes:
        raise InputError(f"no axis that '{label}' enters can be fitted on this flight")
    names = [] if removed else [f"{axis}_{term_label(t)}" for axis, texts in change.terms.items() for t in texts]
    parameters = parameters_of(other, after)
    write_version(run, version, parameters, axes)
    new = [p for p in parameters if p["name"] in names]
    falls = [1.0 - e["error_after"] / e["error_before"] for e in axes.values()]
    logs = [np.log(e["error_after"] / e["error_before"]) for e in axes.values()]
    improved = bool(max(falls) > LEAST_FALL and sum(logs) < 0.0)
    return Outcome(version, label, change, axes, new, improved, _verdict(label, axes, improved, removed))


def _errors(before: AxisFit, after: AxisFit, flight: FlightData) -> dict[str, float]:
    """Held-out errors over the points that both have, and the floor under the new model."""
    if len(before.rows) == len(after.rows) and not np.array_equal(before.rows, after.rows):
        before, after = before.on(after.rows), after.on(before.rows)
    return {
        "error_before": before.nrmse_held_out,
        "error_after": after.nrmse_held_out,
        "noise_floor": compare_axis(flight, after).floor.nrmse,
    }


def _verdict(label: str, axes: Mapping[str, Mapping[str, float]], improved: bool, removed: bool) -> str:
    axis = max(axes, key=lambda a: abs(np.log(axes[a]["error_before"] / axes[a]["error_after"])))
    errors = axes[axis]
    numbers = f"{100 * errors['error_before']:.1f} % to {100 * errors['error_after']:.1f} % in {axis}"
    if improved:
        return f"the held-out error falls from {numbers}"
    if removed:
        return f"without '{label}' the held-out error goes from {numbers}"
    return f"'{label}' does not lower the held-out error ({numbers}): this flight gives no reason to keep it"


def parameters_of(flight: FlightData, fits: Mapping[str, AxisFit]) -> list[dict[str, Any]]:
    """Parameters of a model from all of the flight, each with its verdict, as in parameters.json."""
    listed = []
    for axis in AXES:
        names = flight.model.parameter_names[flight.model.axis_slice(axis)]
        fit = fits.get(axis)
        for j, name in enumerate(names):
            if fit is None:
                reason = f"{axis} cannot be fitted on this flight"
                listed.append({"name": name, "value": np.nan, "std": np.nan, "status": "HOLD", "reason": reason})
                continue
            value, std = float(fit.fit.parameters[j]), float(fit.fit.std[j])
            share = std * float(np.std(fit.columns[fit.rows, j])) / fit.spread
            verdict = judge(Evidence(name, value, std, np.inf, share, len(fit.y), ()), TrustRules())
            reason = "not determined by this flight" if np.isnan(value) else verdict.reason
            listed.append({"name": name, "value": value, "std": std, "status": verdict.status.name, "reason": reason})
    return listed
