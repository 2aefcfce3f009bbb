"""Which effect is missing, asked in flight: on what is kept of it, at a cost that a flight computer can bear.

After a flight the null comes from replicas of it (``replicas``), which need every sample and a smoother. In flight
three things stand in for them:

- points count from when the reconstruction has settled, and windows that overlap are thinned;
- a candidate must lower the held-out error of an axis by ``Thresholds.live_size``, twice what is asked after the
  flight, and its parameters must be larger than chance makes them: a Wald test at ``live_level`` over all candidates,
  whose covariance allows for coloured residuals and for the accelerometer bias, which is still being found. A bias that
  is estimated with variance s^2(t) has errors that walk backwards in time with steps of variance s^2(t) - s^2(t + dt):
  exact for a constant that is estimated from ever more data. Without this every step and slow growth in the forces is
  called an effect. Errors of the reconstructed angles are not in the covariance: that level is small for their sake,
  and no rate of false alarms;
- nothing is judged before ``live_least`` seconds of settled flight: manoeuvres must have been repeated;
- alpha_dot and beta_dot are not judged. They contain the measured forces, which answer to gusts before the
  reconstructed angles do, and so explain something in every turbulent flight. ``diagnose`` after the flight can.

The rate of false verdicts is measured: docs/live-diagnosis.md has their share over clean flights. Two windows are
looked at: what is kept of the whole flight, and its newest SLIDING seconds, in which what has just begun is not yet
diluted.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import chdtrc

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, model_from_terms
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.aircraft.term_values import values_on, with_lags
from aircraft_sysid_ros.diagnosis.diagnose import MISSING, NONE, UNEXPLAINED
from aircraft_sysid_ros.diagnosis.finding import explained
from aircraft_sysid_ros.diagnosis.flight.flight_data import BLOCK, FlightData
from aircraft_sysid_ros.diagnosis.model_versions.requests import parse_request
from aircraft_sysid_ros.diagnosis.search.candidates import Candidate, can_act
from aircraft_sysid_ros.diagnosis.search.evaluator import (
    CandidateEvaluator,
    Score,
    errors_of,
    expressions,
    new_terms,
    why_no_terms,
)
from aircraft_sysid_ros.diagnosis.search.fit import AxisFit
from aircraft_sysid_ros.diagnosis.significance.error_regions import unusual
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects import BY_ID, LIBRARY
from aircraft_sysid_ros.effects.effect import MEASUREMENT, Effect
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.flight_memory import RememberedSamples, SampleMemory

Array = npt.NDArray[np.float64]
Terms = Mapping[str, tuple[str, ...]]

#: Newest stretch [s] that is looked at by itself.
SLIDING = 120.0
#: Beginning [s] of a flight that is left out at least.
SETTLING = 20.0
#: Time [s] between points: windows of the measured coefficients do not overlap.
SPACING = 0.16
#: Points of a flight from which a term is judged.
_LEAST_POINTS = 100
#: A term that varies by no more than this share of itself does not.
_CONSTANT = 1e-9
#: Signals that contain the measured forces.
FORCES = frozenset({"alpha_dot", "beta_dot"})


@dataclass(frozen=True)
class LiveFlight:
    """Points of one window, and the accuracy of the accelerometer bias (n, 3) [m/s^2] at their time."""

    data: FlightData
    bias_std: Array
    window: str  # in words


@dataclass(frozen=True)
class LiveFinding:
    """A significant candidate in one window."""

    trial: Score
    axis: str  # where it explains most of those in which it passes
    score: float  # over the axes in which it passes
    p_value: float
    size: float
    window: str
    where: str
    errors: tuple[float, float]  # held out, without it and with it
    confounded_with: tuple[str, ...] = ()


@dataclass(frozen=True)
class LiveDiagnosis:
    """The verdict on what is kept of a flight, best first."""

    model: str
    verdict: str
    findings: tuple[LiveFinding, ...]
    advice: str

    @property
    def content(self) -> dict[str, Any]:
        """Fields of the message MissingEffects, without the header."""
        return {
            "model": self.model,
            "verdict": self.verdict,
            "candidates": [_candidate_content(finding) for finding in self.findings],
            "advice": self.advice,
        }


# -- what is kept, as the fits read it ----------------------------------------------------------------------------


def windows(aircraft: Aircraft, memory: SampleMemory, step: float) -> list[LiveFlight]:
    """The windows that are long enough: the flight, and its newest part where that is less than the flight."""
    kept, newest = memory.flight(), memory.newest(SLIDING)
    made = [live_flight(aircraft, kept, step, "the flight")]
    if len(newest.time) and newest.time[0] > kept.time[0] + SETTLING + 0.25 * SLIDING:
        made.append(live_flight(aircraft, newest, step, f"the newest {SLIDING:.0f} s"))
    return [flight for flight in made if flight is not None and np.ptp(flight.data.time) >= THRESHOLDS.live_least]


def live_flight(aircraft: Aircraft, kept: RememberedSamples, step: float, window: str) -> LiveFlight | None:
    """Points from when the reconstruction has settled, thinned; None where they are too short to be judged."""
    since_start = kept.signals[:, SIGNAL_INDEX["time"]]
    usual = np.nanmedian(kept.air_velocity_std) if len(since_start) else np.nan
    settled = (since_start >= SETTLING) & (kept.air_velocity_std <= THRESHOLDS.settled * usual)
    every = max(round(SPACING / step), 1)
    slot = np.rint(kept.time / step).astype(np.int64)
    use = settled & (slot % every == 0)
    if use.sum() * every * step < THRESHOLDS.shortest:
        return None
    data = FlightData(
        aircraft,
        since_start[use],
        kept.measured[use],
        kept.signals[use],
        every * step,
        air_velocity_std=float(usual),
    )
    return LiveFlight(data, kept.bias_std[use], window)


# -- the test -----------------------------------------------------------------------------------------------------


def bias_drift(flight: LiveFlight, axis: str) -> Array:
    """Root (n, k) of the covariance that errors of the accelerometer bias give the coefficient of an axis.

    Columns are steps backwards in time, one per second in which the bias became better known; none for moments. The
    error that is left at the end is a constant over q̄: one more column.
    """
    data, i = flight.data, AXES.index(axis)
    if i >= 3:
        return np.zeros((len(data.time), 0))
    variance = np.minimum.accumulate(flight.bias_std[:, i] ** 2)
    second = np.floor(data.time).astype(np.int64)
    last = np.flatnonzero(np.diff(second, append=second[-1] + 1))
    steps = -np.diff(variance[last])
    before = data.time[:, None] <= data.time[last[:-1]][None, :]
    walk = np.column_stack([before * np.sqrt(np.maximum(steps, 0.0)), np.full(len(data.time), np.sqrt(variance[-1]))])
    return np.asarray(data.per_acceleration[:, None] * walk[:, np.append(steps > 0.0, True)])


def wald(flight: LiveFlight, fit: AxisFit, columns: Array) -> tuple[float, int]:
    """theta' cov^-1 theta of columns (n, m) added to a fit, and the number of parameters that it has.

    The covariance allows for the colour of the residuals and for the bias of the accelerometer.
    """
    names = [f"new {j}" for j in range(columns.shape[1])]
    more = fit.extended(columns, names)
    new = np.arange(len(fit.names), len(more.names))
    new = new[more.determined[new]]
    if not len(new):
        return 0.0, 1
    drift = bias_drift(flight, fit.axis)[more.rows]
    moved = (more._transform @ (more.basis.T @ drift))[new] if drift.shape[1] else np.zeros((len(new), 0))
    covariance = more.fit.covariance[np.ix_(new, new)] + moved @ moved.T
    theta = more.parameters[new]
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    along = vectors.T @ (theta / scale)
    kept = values > 1e-9
    return float(np.sum(along[kept] ** 2 / values[kept])), int(kept.sum())


def _finding(flight: LiveFlight, bench: CandidateEvaluator, trial: Score, tried: int) -> LiveFinding | None:
    """The finding where a candidate has size and significance in an axis."""
    passed: dict[str, float] = {}
    for axis, gain in trial.gains.items():
        if 1.0 - gain.nrmse_after / gain.nrmse_before < THRESHOLDS.live_size:
            continue
        columns = flight.data.columns(flight.data.parsed(trial.candidate.terms[axis]))
        statistic, freedom = wald(flight, bench.fits[axis], columns)
        p_value = tried * float(chdtrc(freedom, statistic))
        if p_value < THRESHOLDS.live_level:
            passed[axis] = p_value
    if not passed:
        return None
    ratios = trial.log_ratios
    axis = max(passed, key=lambda name: ratios[name])
    gain = trial.gains[axis]
    size = 1.0 - gain.nrmse_after / gain.nrmse_before
    score = sum(ratios[name] for name in passed)
    where, errors = _where(flight.data, trial, axis, flight.window), errors_of(flight.data, trial, axis)
    return LiveFinding(trial, axis, score, passed[axis], size, flight.window, where, errors)


# -- the search ---------------------------------------------------------------------------------------------------


def diagnose_live(flights: Sequence[LiveFlight], library: Sequence[Effect] = LIBRARY) -> LiveDiagnosis:
    """The verdict on one or more windows of a flight; the first with a verdict other than none decides."""
    if not flights:
        raise InputError(f"less than {THRESHOLDS.live_least:g} s of the flight are settled")
    model = flights[0].data.model.identifier
    for flight in flights:
        findings = search(flight, library)
        if findings:
            known = findings[0].trial.candidate.effect is not None
            return LiveDiagnosis(model, MISSING if known else UNEXPLAINED, tuple(findings), _advice(findings))
    return LiveDiagnosis(model, NONE, (), "Nothing is missing that this flight has shown so far.")


def search(flight: LiveFlight, library: Sequence[Effect]) -> list[LiveFinding]:
    """Significant candidates of a window, best first."""
    try:
        bench = CandidateEvaluator(flight.data)
    except InputError:
        return []
    effects = [effect for effect in library if effect.kind != MEASUREMENT and can_act(effect, flight.data)]
    trials = [trial for effect in effects if (trial := bench.best_of(effect)) is not None]
    named = flight.data.model.inputs
    trials = [trial for trial in trials if not reads(trial.candidate, FORCES, named)]
    tried = sum(len(trial.gains) for trial in trials)
    tested = [_finding(flight, bench, trial, tried) for trial in trials]
    findings = sorted([f for f in tested if f is not None], key=lambda f: -f.score)
    outside = [c for c in expressions(flight.data) if not reads(c, FORCES, named)]
    best = max((t for t in map(bench.trial, outside) if t is not None), key=lambda t: t.score, default=None)
    if best is not None:
        found = _finding(flight, bench, best, len(outside))
        if found is not None and not (findings and _is_enough(findings[0], found)):
            findings.insert(0, found)
    return [replace(f, confounded_with=_company(bench, f, findings)) for f in findings]


def _is_enough(inside: LiveFinding, outside: LiveFinding) -> bool:
    """Whether an effect explains about what an expression explains, in one axis."""
    axis = outside.axis
    mine = explained(inside.trial.gains[axis]) if axis in inside.trial.gains else 0.0
    return (
        mine >= THRESHOLDS.enough * explained(outside.trial.gains[axis])
        or outside.score <= inside.score + THRESHOLDS.preference
    )


def reads(candidate: Candidate, signals: Collection[str], inputs: tuple[str, ...] = ()) -> bool:
    """Whether a term of a candidate, which may read the named ``inputs``, reads any of some signals."""
    return bool(model_from_terms(candidate.terms, inputs).signals_used & set(signals))


def _company(bench: CandidateEvaluator, finding: LiveFinding, others: Sequence[LiveFinding]) -> tuple[str, ...]:
    """Candidates that this window cannot tell from a finding."""
    own, names = bench.contribution(finding.trial, finding.axis), []
    for other in others:
        if (
            other is finding
            or finding.axis not in other.trial.gains
            or other.score < THRESHOLDS.as_good * finding.score
        ):
            continue
        theirs = bench.contribution(other.trial, finding.axis)
        if abs(own @ theirs) >= THRESHOLDS.alike * np.sqrt((own @ own) * (theirs @ theirs)):
            names.append(other.trial.candidate.family)
    return tuple(names)


# -- in words -----------------------------------------------------------------------------------------------------


def _where(data: FlightData, trial: Score, axis: str, window: str) -> str:
    """Where in time most of the evidence lies, and what sets those stretches apart."""
    gain = trial.gains[axis]
    falls = np.maximum(gain.before - gain.after, 0.0)
    order = np.argsort(-falls)
    most = order[: int(np.searchsorted(np.cumsum(falls[order]), 0.6 * falls.sum())) + 1]
    inside = np.isin(data.block, gain.fit.blocks[most])
    words = unusual(data, inside, np.isfinite(data.measured[:, AXES.index(axis)]))
    at = ", ".join(f"{number * BLOCK:.0f} s" for number in sorted(gain.fit.blocks[most[:3]]))
    return f"{axis[0]}_{axis[1]} in {window}, most about {at}" + (f", {words}" if words else "")


def _advice(findings: Sequence[LiveFinding]) -> str:
    first = findings[0]
    candidate = first.trial.candidate
    if candidate.effect is None:
        return (
            f"Unexplained: {first.axis[0]}_{first.axis[1]} depends on {candidate.label.partition(': ')[2]}, which no "
            f"effect of the library does; ~/add_effect takes the expression."
        )
    text = f"{candidate.effect.name} is missing: ~/add_effect {candidate.effect.identifier}."
    names = [BY_ID[name].name for name in first.confounded_with if name in BY_ID]
    if names:
        text += f" This flight cannot tell it from {' or '.join(names)}; to separate them: {candidate.effect.manoeuvre}"
    return text


def _candidate_content(finding: LiveFinding) -> dict[str, Any]:
    trial, candidate = finding.trial, finding.trial.candidate
    axes = sorted(trial.gains, key=lambda axis: (axis != finding.axis, -trial.log_ratios[axis]))
    return {
        "effect": candidate.effect.identifier if candidate.effect is not None else "",
        "expression": "; ".join(f"{axis}: {term}" for axis in axes for term in candidate.terms[axis]),
        "axes": axes,
        "evidence": finding.score,
        "p_value": finding.p_value,
        "error_before": finding.errors[0],
        "error_after": finding.errors[1],
        "confounded_with": list(finding.confounded_with),
        "where": finding.where,
    }


# -- what the user asks for ---------------------------------------------------------------------------------------


def requested(text: str, inputs: tuple[str, ...] = ()) -> Effect | Terms:
    """An effect of the library, or the terms by axis of ``CZ: alpha**3``, which may read the named ``inputs``.

    Raises InputError for anything else.
    """
    parsed = parse_request(text, inputs)
    if isinstance(parsed, Effect) and parsed.kind == MEASUREMENT:
        raise InputError(
            f"'{parsed.identifier}' concerns the sensors, which the model cannot correct in flight: after it, "
            f"aircraft-sysid add RUN {parsed.identifier} gives an aircraft file with which both nodes can be started"
        )
    return parsed


def check_signals(terms: Terms, kept: RememberedSamples, inputs: tuple[str, ...] = ()) -> None:
    """Raises InputError where a term reads a signal that the flight does not have: its axis would stop to learn.

    ``inputs``: names that the aircraft file gives to further signals.
    """
    model = model_from_terms(terms, inputs)
    used, names = model.signals_used, model.signal_names
    missing = [name for i, name in enumerate(names) if name in used and not np.isfinite(kept.signals[:, i]).any()]
    if missing and len(kept.time):
        text = "; ".join(f"{axis}: {term}" for axis, listed in terms.items() for term in listed)
        raise InputError(f"'{text}' needs {' and '.join(missing)}, which this flight does not have")


def check_values(terms: Terms, kept: RememberedSamples, pause: float, inputs: tuple[str, ...] = ()) -> None:
    """Raises InputError where a term is no number at most points of the flight, or is constant while its signals move.

    ``pause`` [s]: points further apart have one missing.
    """
    for axis, texts in terms.items():
        for text in texts:
            model = model_from_terms({axis: (text,)}, inputs)
            signals = with_lags(model.lags, kept.time, kept.signals, pause)
            read = signals[:, [k for k, name in enumerate(model.signal_names) if name in model.signals_used]]
            there = np.isfinite(read).all(axis=1)
            if there.sum() >= _LEAST_POINTS:
                values = values_on(model.programs[AXES.index(axis)], np.ascontiguousarray(signals[there]))[:, 0]
                _check_value(f"{axis}: {text}", values, read[there])


def _check_value(name: str, values: Array, read: Array) -> None:
    """``check_values`` of one term, (n,), which reads some signals (n, k)."""
    undefined = ~np.isfinite(values)
    if 2 * undefined.sum() > len(values):
        share = f"{undefined.sum()} of the {len(values)} newest points"
        raise InputError(f"'{name}' is not a number at {share} of this flight: correct the expression")
    values = values[~undefined]
    says_nothing = np.ptp(read, axis=0).any() if read.shape[1] else not values.any()  # a constant reads no signal
    if says_nothing and np.ptp(values) <= _CONSTANT * np.abs(values).max():
        raise InputError(
            f"'{name}' has been {values[0]:.3g} throughout this flight, so that it shows nothing: correct the "
            "expression, or add it once it varies"
        )


def terms_of_effect(effect: Effect, flight: LiveFlight | None) -> tuple[Terms, bool]:
    """Terms of an effect with the variant and the inner numbers that fit best what is kept of the flight.

    And whether they explain more than their numbers cost. Terms that the model has are left out.

    Raises InputError where the flight lacks a signal or is too short to fit inner numbers.
    """
    if flight is None:
        raise InputError(
            f"'{effect.identifier}' is fitted to the flight: less than {THRESHOLDS.shortest:g} s of it are settled"
        )
    data = flight.data
    missing = data.lacks(effect.signals)
    trial = None if missing else CandidateEvaluator(data).best_of(effect)
    if trial is None:
        needed = " and ".join(missing) or "signals"
        raise InputError(f"'{effect.identifier}' needs {needed}, which this flight does not have")
    terms = new_terms(data, trial)
    if not terms:
        raise InputError(why_no_terms(data, trial, effect.identifier))
    return terms, trial.pays
