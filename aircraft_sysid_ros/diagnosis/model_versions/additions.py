"""Add to a model, or take away: what the user names becomes a change, and the change a new version with its errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel, term_label
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS
from aircraft_sysid_ros.diagnosis.compare import compare_axis
from aircraft_sysid_ros.diagnosis.failures.failures import has_vanes
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.flight.reconstruction import (
    as_flown,
    fit_sensor_noise,
    likelihood_as_learnt,
    reconstruct,
)
from aircraft_sysid_ros.diagnosis.measurement.faults import jobs_of, try_setting, with_the_other
from aircraft_sysid_ros.diagnosis.measurement.imu_place import setting_of_forces
from aircraft_sysid_ros.diagnosis.measurement.setting import Job, Setting, in_file, setting_of, stretch_of
from aircraft_sysid_ros.diagnosis.model_versions.failed_input import BY_FORCES, FailedInput, failed_input
from aircraft_sysid_ros.diagnosis.model_versions.requests import label_of, parse_request
from aircraft_sysid_ros.diagnosis.model_versions.versions import (
    Change,
    Run,
    Version,
    changing,
    learnt,
    open_run,
    version_with,
    write_version,
)
from aircraft_sysid_ros.diagnosis.search.evaluator import (
    CandidateEvaluator,
    Score,
    new_terms,
    undetermined,
    why_no_terms,
)
from aircraft_sysid_ros.diagnosis.search.fit import AxisFit, fits_of
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.diagnosis.trim.trim_finding import trim_finding
from aircraft_sysid_ros.effects.effect import MEASUREMENT, Effect
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.processes import in_parallel
from aircraft_sysid_ros.reconstruction.absences import options_after_flight
from aircraft_sysid_ros.samples import Samples

Array = npt.NDArray[np.float64]
Progress = Callable[[float], None]

_NO_REASON = "this flight gives no reason to keep it"


@dataclass(frozen=True)
class Outcome:
    """A new version, and what became of the held-out errors of the axes that changed."""

    version: Version
    label: str
    change: Change
    axes: Mapping[str, Mapping[str, float]]  # error_before, error_after, noise_floor
    parameters: list[dict[str, Any]]  # the new terms
    improved: bool  # the held-out error fell; for a setting of the aircraft file: the sensors fit significantly better
    verdict: str


def add(path: str | Path, text: str, progress: Progress = lambda share: None) -> Outcome:
    """Add an effect of the library by its id, or terms such as ``CZ: alpha**3``, to the current version of a run.

    Raises InputError with a sentence, and changes nothing, where that cannot be.
    """
    with changing(path):
        run = open_run(path)
        parsed, setting = parse_request(text, run.root.model.inputs), None
        if isinstance(parsed, Effect):
            failed = failed_input(run.current.aircraft, run.samples, parsed.identifier, run.zero)
            if failed is not None:
                return _finish_by_forces(run, parsed.identifier, failed)
            if parsed.identifier in BY_FORCES and parsed.identifier in run.current.changes and not _has_vanes(run):
                raise InputError(f"'{parsed.identifier}' is in the model already, and nothing of it is left to add")
        flight, pays = run.flight(), True
        progress(0.2)
        if isinstance(parsed, Effect):
            label = parsed.identifier
            if parsed.kind == MEASUREMENT and label in run.current.changes:
                raise InputError(f"'{label}' is in the model already: remove it first")
            if parsed.kind == MEASUREMENT:
                change, setting = _of_setting(run, flight, parsed, progress)
            else:
                change, pays = _of_effect(flight, parsed)
        else:
            change, label = _of_terms(flight, parsed), label_of(parsed)
        changes = {**run.current.changes, label: _merged(run.current.changes.get(label), change)}
        if not isinstance(parsed, Effect):
            changes = _without_removal(changes, label, parsed)
        return _finish(run, flight, changes, label, change, setting=setting, pays=pays)


def remove(path: str | Path, text: str) -> Outcome:
    """Take away what was added under this name, or any term such as ``CZ: de``."""
    with changing(path):
        run = open_run(path)
        parsed = parse_request(text, run.root.model.inputs)
        label = parsed.identifier if isinstance(parsed, Effect) else label_of(parsed)
        changes = dict(run.current.changes)
        if label in changes and (changes[label].terms or changes[label].settings):
            change = changes.pop(label)
        elif isinstance(parsed, Effect):
            raise InputError(f"'{label}' is not in the model: it has {_added(run.current)}")
        else:
            change = _removal(run.current, parsed)
            changes = _with_removal(changes, label, change, run.root.model)
        without = version_with(run, changes, ())
        failed = failed_input(without.aircraft, run.samples, label, run.zero)
        if failed is not None:
            return _finish_by_forces(run, label, failed, removed=change)
        return _finish(run, run.flight(), changes, label, change, removed=True)


def _has_vanes(run: Run) -> bool:
    return run.samples is None or has_vanes(run.samples)


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
            if not np.isfinite(flight.columns(flight.parsed([text]))).any():
                raise InputError(f"'{axis}: {text}' is not finite at any point of this flight: correct the expression")
    for axis, texts in terms.items():
        unknown = undetermined(flight, axis, texts)
        if unknown:
            raise InputError(
                f"this flight does not determine '{axis}: {unknown[0]}': it does not vary, or other terms explain it"
            )
    return Change(terms=dict(terms))


def missing_signals(flight: FlightData, *texts: str) -> list[str]:
    """Signals that terms read and that have no value in the flight."""
    return flight.lacks(frozenset().union(*(program.signals for program in flight.parsed(texts))))


def _of_effect(flight: FlightData, effect: Effect) -> tuple[Change, bool]:
    """The terms that an effect has on a flight, and whether they explain more than their numbers and times cost."""
    missing = flight.lacks(effect.signals)
    if missing:
        raise InputError(f"'{effect.identifier}' needs {' and '.join(missing)}, which this flight does not have")
    trial = _best_of(effect, flight)
    if trial is None:
        raise InputError(f"nothing of '{effect.identifier}' can be fitted on this flight")
    new = new_terms(flight, trial)
    if not new:
        raise InputError(why_no_terms(flight, trial, effect.identifier))
    return Change(terms=new), trial.pays


def _best_of(effect: Effect, flight: FlightData) -> Score | None:
    """An effect as ``diagnose`` finds it: by the trim of the flight, or else by all of it."""
    trim = trim_finding(flight)
    if trim is not None and trim.trial.candidate.family == effect.identifier:
        return trim.trial
    return CandidateEvaluator(flight).best_of(effect)


def _of_setting(run: Run, flight: FlightData, effect: Effect, progress: Progress) -> tuple[Change, Setting]:
    """The setting that the first step's likelihood prefers, as ``diagnose`` finds it.

    Held-out errors of the second step are no judge of the measurement: a lag or a scale that smooths the regressors
    lowers them on flights whose sensors are as the file says. In gusts, which hide a drift of the air data from the
    likelihood, and the place of an IMU, it is that which forces and moments show.
    """
    if run.samples is None:
        raise InputError(f"{run.path} holds no samples to reconstruct from: replay the recording again")
    samples = run.samples
    flown, calm = as_flown(run.current.aircraft, samples)
    if not calm and all(variant.setting[-1] == "scale" for variant in effect.variants):
        raise _only_gusts(effect)
    if not calm and effect.as_terms is not None:
        trial = CandidateEvaluator(flight).best_of(effect.as_terms)
        if trial is None or not trial.pays:
            raise _only_gusts(effect)
        shown = setting_of(trial, [effect], run.current.aircraft, trial.score / trial.price)
        return Change(settings=((shown.variant.setting, shown.value),)), shown
    if not calm and effect.identifier == "imu_offset" and ("imu_position", "y") in run.current.aircraft.unsaid:
        place = setting_of_forces(flight, effect)
        if place is not None:
            return Change(settings=((place.variant.setting, place.value),)), place
    jobs = list(_gust_jobs(run.current.aircraft, samples, effect))
    first = None if jobs else reconstruct(flown, samples, with_covariance=False)
    jobs = jobs if first is None else list(jobs_of(first, [effect], calm))
    tried: list[Setting] = []
    for setting in in_parallel(try_setting, jobs):
        tried.append(setting)
        progress(0.2 + 0.7 * len(tried) / len(jobs))
    best = max(tried, key=lambda setting: setting.evidence, default=None)
    if best is None:
        raise InputError(f"'{effect.identifier}' cannot be tried on this flight: it has no samples of that sensor")
    if best.value == best.nominal or not best.gain > 0.0:
        raise InputError(
            f"'{effect.identifier}' is not missing: the sensors of this flight fit best with the aircraft file as it is"
        )
    if best.feigns_wind and not as_flown(in_file(best, run.current.aircraft), samples)[1]:
        raise _only_gusts(effect)
    if first is not None and CONTROLS in best.variant.setting and len(effect.variants) > 1:
        best = with_the_other(best, first, calm)
    return Change(settings=((best.variant.setting, best.value), *best.beside)), best


def _only_gusts(effect: Effect) -> InputError:
    return InputError(
        f"in this turbulence '{effect.identifier}' cannot be told from gusts: fly in calm air, or set "
        f"{'.'.join(effect.variants[0].setting)} in the aircraft file"
    )


def _gust_jobs(aircraft: Aircraft, samples: Samples, effect: Effect) -> Iterator[Job]:
    """The random walk of the wind, which ``diagnose`` leaves to the filter; a user may ask for it."""
    for variant in effect.variants:
        if variant.setting[0] == "process_noise":
            flight = reconstruct(fit_sensor_noise(aircraft, samples), samples, with_covariance=False)
            stretch = stretch_of(flight)
            without = likelihood_as_learnt(flight.aircraft, stretch)
            yield flight, stretch, effect, variant, effect.setting_number(variant), without, {}, True


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


def _finish(
    run: Run, flight: FlightData, changes: Mapping[str, Change], label: str, change: Change, *,
    setting: Setting | None = None, removed: bool = False, pays: bool = True,
) -> Outcome:  # fmt: skip
    """``pays``: whether what was added explains more than its numbers cost."""
    before_version = run.current
    version = version_with(run, changes, (before_version.identifier,))
    other = run.flight(version.aircraft) if change.settings else flight.under(version.aircraft)
    (before, _), (after, _) = fits_of(flight), fits_of(other)
    touched = list(AXES) if change.settings else [*change.terms, *change.without]
    fitted = [axis for axis in AXES if axis in touched and axis in after]
    axes = {a: _errors(before.get(a), after[a]) for a in fitted}
    axes = {a: {**errors, "noise_floor": compare_axis(other, after[a]).floor.nrmse} for a, errors in axes.items()}
    if not axes:
        raise InputError(f"no axis that '{label}' enters can be fitted on this flight")
    names = [] if removed else [f"{axis}_{term_label(t)}" for axis, texts in change.terms.items() for t in texts]
    parameters = learnt(run, version.aircraft)
    write_version(run, version, parameters, axes)
    new = [p for p in parameters["parameters"] if p["name"] in names]
    pairs = {axis: (before[axis], after[axis]) for axis in fitted if axis in before}
    shared = {axis: _errors(*_on_shared_points(*pair)) for axis, pair in pairs.items()}
    improved = _falls(shared)
    partly = any(shared[axis] != _errors(*pair) for axis, pair in pairs.items())
    where = " where both models have values" if partly else ""
    if shared:
        verdict = _verdict(label, shared, improved, removed, where)
        verdict += f", but by less than the parameters of '{label}' cost: {_NO_REASON}" if improved and not pays else ""
        improved = improved and pays
    else:  # a term that reads what the flight lacks has gone
        verdict = f"without '{label}' this flight fits {' and '.join(fitted)}, which it did not before"
    if setting is not None:
        improved = setting.evidence > 1.0
        verdict = _verdict_of(setting, {axis: errors for axis, errors in axes.items() if axis in before})
    return Outcome(version, label, change, axes, new, improved, verdict)


def _finish_by_forces(run: Run, label: str, failed: FailedInput, *, removed: Change | None = None) -> Outcome:
    """The version with what forces alone have found, or ``removed`` from it, judged by the balances that found it.

    Raises InputError where ``diagnose`` would say nothing, since neither airspeed nor calm air is there.
    """
    assert run.samples is not None
    options_after_flight(run.samples, run.calm_air)
    changes = dict(run.current.changes)
    if removed is None:
        change = Change(terms=failed.terms)
        changes[label] = _merged(changes.get(label), change)
    else:
        change = changes.pop(label)
    version = version_with(run, changes, (run.current.identifier,))
    axes = {}
    for axis in (axis for axis in AXES if axis in failed.errors):
        before, after = failed.errors[axis] if removed is None else reversed(failed.errors[axis])
        axes[axis] = {"error_before": before, "error_after": after, "noise_floor": np.nan}
    write_version(run, version, learnt(run, version.aircraft), axes)
    improved = _falls(axes)
    verdict = _verdict(label, axes, improved, removed is not None, ", by the balance of forces and moments")
    return Outcome(version, label, change, axes, [], improved, verdict)


def _falls(axes: Mapping[str, Mapping[str, float]]) -> bool:
    """Whether the error falls in some axis, and in all together."""
    logs = [np.log(errors["error_after"] / errors["error_before"]) for errors in axes.values()]
    return bool(min(logs, default=0.0) < np.log(1.0 - THRESHOLDS.least_fall) and sum(logs) < 0.0)


def _errors(before: AxisFit | None, after: AxisFit) -> dict[str, float]:
    """NaN before, where the flight could not fit the axis."""
    return {"error_before": np.nan if before is None else before.nrmse_held_out, "error_after": after.nrmse_held_out}


def _on_shared_points(before: AxisFit, after: AxisFit) -> tuple[AxisFit, AxisFit]:
    """Two fits of one flight over the points that both have: else a term without values at some would gain by that."""
    if len(before.rows) != len(after.rows) or np.array_equal(before.rows, after.rows):
        return before, after
    return before.on(after.rows), after.on(before.rows)


def _verdict_of(setting: Setting, axes: Mapping[str, Mapping[str, float]]) -> str:
    """In words, for a setting of the aircraft file: the sensors decide, not the errors of the coefficients."""
    better = f"{setting.value:.4g} fits {setting.judges} better than {setting.nominal:.4g}"
    errors = f"the held-out error goes from {_largest_change(axes)}"
    if setting.evidence > 1.0:
        return f"{better}: {errors}"
    return f"{better}, but by no more than chance would ({setting.evidence:.0%} of what is needed): {errors}"


def _most_changed(axes: Mapping[str, Mapping[str, float]]) -> str:
    return max(axes, key=lambda a: abs(np.log(axes[a]["error_before"] / axes[a]["error_after"])))


def _largest_change(axes: Mapping[str, Mapping[str, float]]) -> str:
    axis = _most_changed(axes)
    before, after = (100.0 * axes[axis][name] for name in ("error_before", "error_after"))
    digits = next((d for d in (1, 2, 3) if f"{before:.{d}f}" != f"{after:.{d}f}"), 1)
    return f"{before:.{digits}f} % to {after:.{digits}f} % in {axis}"


def _verdict(label: str, axes: Mapping[str, Mapping[str, float]], improved: bool, removed: bool, where: str) -> str:
    numbers = _largest_change(axes) + where
    if improved:
        return f"{'without' if removed else 'with'} '{label}' the held-out error falls from {numbers}"
    if removed:
        return f"without '{label}' the held-out error goes from {numbers}"
    errors = axes[_most_changed(axes)]
    lowers = "hardly lowers" if errors["error_after"] < errors["error_before"] else "does not lower"
    return f"'{label}' {lowers} the held-out error ({numbers}): {_NO_REASON}"
