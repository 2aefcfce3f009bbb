"""Two runs side by side: which parameters differ by more than chance, and how well each model does on each flight.

Of a parameter that both models have, d = b - a has the variance of both estimates together, since two flights share no
noise. The constant of a force takes up the bias of the accelerometer, which each flight has anew: its variance counts,
too. All parameters are asked at once: by Holm's method (1979) the chance that any that is the same in both is said
to differ is at most ``Thresholds.false_alarm``. Two versions of one flight share all of its noise: their differences
are told, and no chance of them. That holds of models that describe their flights: of a parameter that is not to USE in
one of the runs the difference is told with the reason, and not taken for a proof.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.model_versions.constants_of_forces import with_bias
from aircraft_sysid_ros.diagnosis.model_versions.versions import Run, released_parameters, settings_of
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.run_reader import UNREADABLE
from aircraft_sysid_ros.samples import same_imu

Array = npt.NDArray[np.float64]

#: Keys that say which aeroplane it is.
_AIRFRAME = ("mass", "wing_area", "span", "chord", "inertia")
#: Signals whose ranges say where a flight was flown: name and factor to what people read, with the unit.
_CONDITIONS = {"V": (1.0, "m/s"), "alpha": (180.0 / np.pi, "deg")}
#: Parameters that a sentence names at most.
_MOST_NAMED = 6
#: Value and standard error by the name of a parameter.
Fitted = Mapping[str, tuple[float, float]]
#: Parameters of a run by name, as in parameters.json.
Learnt = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Difference:
    """One parameter in both runs."""

    name: str
    values: tuple[float, float]
    std: tuple[float, float]
    p_value: float  # by Holm's method, of all parameters; NaN where both are of one flight
    held: tuple[str, str] = ("", "")  # why it is not to USE in a run; empty: it is

    @property
    def differs(self) -> bool:
        """Beyond doubt."""
        return self._is_significant and not self.is_held

    @property
    def is_held(self) -> bool:
        """It is not to USE in one of the runs."""
        return any(self.held)

    @property
    def is_doubtful(self) -> bool:
        """It differs by its standard errors, and is not to USE in one of the runs."""
        return self._is_significant and self.is_held

    @property
    def _is_significant(self) -> bool:
        return bool(self.p_value < THRESHOLDS.false_alarm)

    @property
    def difference(self) -> float:
        """The second less the first."""
        return self.values[1] - self.values[0]

    @property
    def std_difference(self) -> float:
        """Standard error of the difference; NaN where both are of one flight."""
        return float(np.hypot(*self.std)) if np.isfinite(self.p_value) else np.nan

    @property
    def json(self) -> dict[str, Any]:
        """For ``compare --json``."""
        return {
            "name": self.name,
            "value": list(self.values),
            "std": list(self.std),
            "difference": self.difference,
            "std_difference": self.std_difference,
            "p_value": self.p_value,
            "differs": self.differs,
            "held": list(self.held),
        }


@dataclass(frozen=True)
class SideBySide:
    """Two runs; ``errors[axis][i, j]``: held-out NRMSE of the model of run i on the flight of run j."""

    runs: tuple[str, str]
    models: tuple[str, str]
    same_flight: bool
    parameters: tuple[Difference, ...]
    only_in: tuple[Fitted, Fitted]  # parameters that the other does not have or determine
    errors: Mapping[str, Array]
    notes: tuple[str, ...]

    @property
    def titles(self) -> tuple[str, ...]:
        """Each run with its model, where the name does not say it."""
        pairs = zip(self.runs, self.models, strict=True)
        return tuple(name if model in name else f"{name} {model}" for name, model in pairs)

    @property
    def differing(self) -> tuple[Difference, ...]:
        """Parameters that differ by more than chance, the surest first."""
        return tuple(sorted((d for d in self.parameters if d.differs), key=lambda d: d.p_value))

    @property
    def tried(self) -> int:
        """Parameters that were asked whether they differ."""
        return int(sum(np.isfinite(d.p_value) for d in self.parameters))

    @property
    def told(self) -> list[str]:
        """How many parameters differ and how sure that is, in sentences; nothing of two versions of one flight."""
        if self.same_flight:
            return []
        sentences = [
            f"{len(self.differing)} of {self.tried} parameters differ by more than chance; for two flights with the "
            f"same ones, any is said to differ in at most {THRESHOLDS.false_alarm:.0%}, if the models lack nothing"
        ]
        doubtful = sorted((d for d in self.parameters if d.is_doubtful), key=lambda d: d.p_value)
        if doubtful:
            first = doubtful[0]
            names = " ".join([*(d.name for d in doubtful[:_MOST_NAMED]), *["…"] * (len(doubtful) > _MOST_NAMED)])
            run, reason = next((run, why) for run, why in zip(self.runs, first.held, strict=True) if why)
            sentences.append(
                f"{len(doubtful)} more differ by their standard errors but do not have USE in one of the runs, so no "
                f"difference is proven: {names}; {first.name} in {run} is {reason}"
            )
        return sentences

    @property
    def json(self) -> dict[str, Any]:
        """For ``compare --json``."""
        return {
            "runs": list(self.runs),
            "models": list(self.models),
            "same_flight": self.same_flight,
            "parameters": [d.json for d in self.parameters],
            "differing": [d.name for d in self.differing],
            "doubtful": [d.name for d in self.parameters if d.is_doubtful],
            "only_in": [list(names) for names in self.only_in],
            "only_values": [{name: list(number) for name, number in only.items()} for only in self.only_in],
            "errors": {axis: errors.tolist() for axis, errors in self.errors.items()},
            "false_alarm_rate": THRESHOLDS.false_alarm,
            "tried": self.tried,
            "told": self.told,
            "notes": list(self.notes),
        }


def side_by_side(runs: tuple[Run, Run], comparisons: tuple[Comparison, Comparison]) -> SideBySide:
    """Compare the current versions of two runs on their flights. Raises InputError where they share no parameter."""
    first, second = runs
    same_version = first.current.identifier == second.current.identifier
    if same_version and first.path.resolve() == second.path.resolve():
        raise InputError(f"{second.path} is given twice: name another run, or the id of another version of it")
    one_flight = first.samples is not None and second.samples is not None and same_imu(first.samples, second.samples)
    learnt = [_learnt(run) for run in runs]
    known = [_fitted(*each) for each in zip(comparisons, runs, learnt, strict=True)]
    shared = [name for name in known[0] if name in known[1]]
    if not shared:
        raise InputError(f"{first.path} and {second.path} share no parameter that both flights determine")
    only = [{name: fitted for name, fitted in a.items() if name not in b} for a, b in (known, known[::-1])]
    return SideBySide(
        runs=_names(first, second),
        models=(first.current.identifier, second.current.identifier),
        same_flight=one_flight,
        parameters=tuple(_differences(shared, (known[0], known[1]), (_held(learnt[0]), _held(learnt[1])), one_flight)),
        only_in=(only[0], only[1]),
        errors=_errors(comparisons),
        notes=tuple(_notes(runs, comparisons, one_flight, same_version)),
    )


def _names(first: Run, second: Run) -> tuple[str, str]:
    """Names that tell them apart: of folders, of versions, or whole paths."""
    a, b = first.path.resolve(), second.path.resolve()
    if a == b:
        return f"{a.name} {first.current.identifier}", f"{b.name} {second.current.identifier}"
    return (a.name, b.name) if a.name != b.name else (str(first.path), str(second.path))


def _learnt(run: Run) -> Learnt:
    """Parameters as they are released, by name; nothing where the run does not say."""
    try:
        return released_parameters(run, run.current)
    except UNREADABLE:  # said of that file
        return {}


def _held(learnt: Learnt) -> dict[str, str]:
    """Why parameters are not to USE, by name."""
    return {name: f"{p['status']}: {p['reason']}" for name, p in learnt.items() if p["status"] != Trust.USE.name}


def _fitted(comparison: Comparison, run: Run, learnt: Learnt) -> Fitted:
    """Of what a flight determines: least squares, with the standard error of what was learnt where that is wider.

    That one knows of surfaces that are late, which move both alike or not.
    """
    whole, found = with_bias(run, comparison.flight), {}
    for axis, compared in comparison.axes.items():
        fit = compared.fit
        for name, value, std in zip(fit.names, fit.parameters, fit.std, strict=True):
            if np.isfinite(value) and std > 0.0:
                wide = learnt.get(name, {}).get("std") or 0.0
                found[name] = (float(value), max(whole(axis, name, float(std)), wide if np.isfinite(wide) else 0.0))
    return found


def _differences(
    names: Sequence[str],
    known: tuple[Fitted, Fitted],
    held: tuple[Mapping[str, str], Mapping[str, str]],
    one_flight: bool,
) -> list[Difference]:
    """The parameters of both, with p-values by Holm's method."""
    a, b = known
    z = np.array([abs(b[name][0] - a[name][0]) / np.hypot(a[name][1], b[name][1]) for name in names])
    p_values = np.full(len(names), np.nan) if one_flight else holm(2.0 * ndtr(-z))
    return [
        Difference(
            name, (a[name][0], b[name][0]), (a[name][1], b[name][1]), float(p),
            (held[0].get(name, ""), held[1].get(name, "")),
        )
        for name, p in zip(names, p_values, strict=True)
    ]  # fmt: skip


def holm(p_values: Array) -> Array:
    """P-values (n,) that allow for all n being asked at once: S. Holm, Scand. J. Statistics 6, 1979."""
    order, count = np.argsort(p_values), len(p_values)
    raised = np.maximum.accumulate(p_values[order] * (count - np.arange(count)))
    out = np.empty(count)
    out[order] = np.minimum(raised, 1.0)
    return out


def _errors(comparisons: tuple[Comparison, Comparison]) -> dict[str, Array]:
    """(2, 2) by axis: models down, flights across; NaN where a flight lacks what a model reads."""
    errors = {axis: np.full((2, 2), np.nan) for axis in AXES if any(axis in c.axes for c in comparisons)}
    for axis, table in errors.items():
        for i, model in enumerate(comparisons):
            for j, flown in enumerate(comparisons):
                if axis in model.axes:
                    own = i == j
                    table[i, j] = model.axes[axis].fit.nrmse_held_out if own else _predicted(model, flown.flight, axis)
    return errors


def _predicted(model: Comparison, flight: FlightData, axis: str) -> float:
    """NRMSE of the parameters of one run on the flight of another, which they have not seen."""
    fit = model.axes[axis].fit
    known = np.isfinite(fit.parameters)
    measured = flight.coefficient(axis)
    try:
        programs = flight.parsed(model.flight.model.terms[axis])  # there its inputs may stand in other places
        predicted = flight.columns(programs)[:, known] @ fit.parameters[known]
    except InputError:  # it reads an input that the other flight does not have
        return np.nan
    judged = np.isfinite(measured) & np.isfinite(predicted) & ~flight.guarded
    spread = float(np.std(measured[judged])) if judged.any() else 0.0
    return float(np.sqrt(np.mean((measured - predicted)[judged] ** 2)) / spread) if spread > 0.0 else np.nan


_ONE_FLIGHT = "both runs are of one flight"


def _notes(
    runs: tuple[Run, Run], comparisons: tuple[Comparison, Comparison], one_flight: bool, same_version: bool
) -> list[str]:
    notes = []
    if one_flight and same_version:
        notes.append(f"{_ONE_FLIGHT} and one model: replay them with other options to see a difference")
    elif one_flight:
        notes.append(f"{_ONE_FLIGHT}: their differences are those of the models, and no p-value is given for them")
    files = [settings_of(run.current.aircraft) for run in runs]
    unlike = [key for key in _AIRFRAME if files[0].get(key) != files[1].get(key)]
    if unlike:
        notes.append(f"the aircraft files differ in {', '.join(unlike)}: coefficients are worked out with them")
    for name, (factor, unit) in _CONDITIONS.items():
        (a_low, a_high), (b_low, b_high) = (_range(c.flight.signal(name)) for c in comparisons)
        if not (a_low <= b_high and b_low <= a_high):
            notes.append(
                f"the flights share no {name}: {factor * a_low:.3g} to {factor * a_high:.3g} and {factor * b_low:.3g} "
                f"to {factor * b_high:.3g} {unit}; a difference may come from the conditions"
            )
    return notes


def _range(values: Array) -> tuple[float, float]:
    """5th and 95th percentile of what is known; NaN of nothing."""
    known = values[np.isfinite(values)]
    low, high = np.percentile(known, (5.0, 95.0)) if len(known) else (-np.inf, np.inf)
    return float(low), float(high)
