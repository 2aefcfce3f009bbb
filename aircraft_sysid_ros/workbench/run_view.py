"""Everything that the page shows of a run, gathered from its folder with the functions of the command line."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.diagnosis.compare import Comparison, compare
from aircraft_sysid_ros.diagnosis.flight.flight_data import AIRCRAFT, POINTS, FlightData
from aircraft_sysid_ros.diagnosis.model_versions.labels import NAMES, Labels, newest, read_labels
from aircraft_sysid_ros.diagnosis.model_versions.versions import (
    CURRENT,
    MODELS,
    Change,
    Run,
    Version,
    changed_at,
    folder_of,
    open_run,
    released_parameters,
    settings_of,
    versions_of,
)
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.recordings.tables import Table, read_table
from aircraft_sysid_ros.refinement.refined_file import METHODS, refined_name
from aircraft_sysid_ros.run_reader import DIAGNOSIS, ESTIMATES, PARAMETERS, SAMPLES, STATE, UNREADABLE, not_a_run
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.truth_files import true_values, truth_path
from aircraft_sysid_ros.stretches import gaps
from aircraft_sysid_ros.workbench.undo import written
from aircraft_sysid_ros.workbench.views.figure import broken, broken_time
from aircraft_sysid_ros.workbench.views.parameters import ParameterHistory
from aircraft_sysid_ros.workbench.views.states import StateHistory
from aircraft_sysid_ros.workbench.views.words import readable

Array = npt.NDArray[np.float64]
Progress = Callable[[str, float], None]

#: Files of a signature that are the flight itself, the others are what is said of it; place of the diagnosis among it.
_OF_FLIGHT, _AT_DIAGNOSIS = 5, 6
#: What a diagnosis and its candidates must have to be shown.
_OF_DIAGNOSIS = {"model", "verdict", "candidates", "advice"}
_OF_CANDIDATE = {
    "effect", "expression", "label", "name", "physics", "manoeuvre", "main_axis", "p_value", "error_before",
    "error_after", "confounded_with", "where", "inner", "parameters", "found",
}  # fmt: skip
#: What a refinement and its parameters must have to be shown.
_OF_REFINED = {"parameters", "not_fitted", "converged", "reason", "iterations", "seconds_fitted", "elapsed", "worse"}
_OF_PARAMETER = {"name", "value", "std", "status", "reason"}
_AIR = {"airspeed": Kind.AIRSPEED, "angle_of_attack": Kind.ANGLE_OF_ATTACK, "sideslip": Kind.SIDESLIP}
_BIASES = {"accelerometer_bias": slice(9, 12), "gyro_bias": slice(12, 15), "wind": slice(15, 18)}  # of 18 sigmas


@dataclass(frozen=True)
class RunView:
    """A run under its current version, with all of its versions."""

    name: str
    aircraft: str
    zero: int  # stamp [ns] from which times of the recording count
    current: str
    changes: Mapping[str, Change]  # of the first version, by what was added or taken away, in order
    versions: tuple[Version, ...]
    comparisons: Mapping[str, Comparison]  # by version
    diagnosis: Mapping[str, Any] | None
    parameters: Mapping[str, list[dict[str, Any]]]  # by version, as in parameters.json
    notes: tuple[str, ...]
    can_diagnose: bool
    signature: tuple[int, ...]
    run: Run  # as it was read
    labels: Labels = field(default_factory=dict)  # names and notes of versions, the newest last
    refined: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # of the current version, by method
    recorded: float | None = None  # [s] of the recording, of which only settled flight is compared
    unwritten: Mapping[str, Any] | None = None  # the diagnosis where the run could not take it
    undoable: frozenset[str] = frozenset()  # work of the page that can be taken back, as in undo.written

    @property
    def comparison(self) -> Comparison:
        """That of the current version."""
        return self.comparisons[self.current]

    @property
    def flight(self) -> FlightData:
        """The flight under the current version."""
        return self.comparison.flight

    def is_of_flight(self, signature: tuple[int, ...]) -> bool:
        """Whether the files of the flight are those of another signature: else the run was written anew."""
        return self.signature[:_OF_FLIGHT] == signature[:_OF_FLIGHT]

    @property
    def duration(self) -> float:
        """Flight [s] that is compared."""
        return float(self.flight.time[-1] - self.flight.time[0])

    def name_of(self, version: str) -> str:
        """What a version is called; empty where it has no name."""
        label = newest(self.labels).get(version)
        return "" if label is None else label.name

    @property
    def lengths(self) -> str:
        """How much flight is compared, and of what, in words."""
        of = "" if self.recorded is None else f" of {self.recorded:.0f} s recorded"
        return f"{self.comparison.seconds:.0f} s of flight compared{of}"


@dataclass(frozen=True)
class FlightRecord:
    """What was estimated in flight; it stays as it is while the model changes."""

    state: StateHistory
    parameters: ParameterHistory
    summary: Mapping[str, Any]  # content of state.json
    notes: tuple[str, ...] = ()  # what of it could not be read


@dataclass(frozen=True)
class TruthView:
    """What is true, of a simulated flight: parameters by name, and the content of truth.json."""

    parameters: Mapping[str, float]
    content: Mapping[str, Any]


NO_TRUTH = TruthView({}, {})


def signature_of(path: str | Path) -> tuple[int, ...]:
    """Changes when a file of the run changes that the page shows."""
    folder = Path(path)
    names = (AIRCRAFT, SAMPLES, POINTS, PARAMETERS, STATE, CURRENT, DIAGNOSIS, NAMES)  # first those of the flight
    refined = [*folder.glob("refined-*.json"), *folder.glob(f"{MODELS}/*/refined-*.json")]
    return (*(changed_at(folder / name) for name in names), max(map(changed_at, refined), default=0))


def load_run_view(
    path: str | Path, last: RunView | None = None, progress: Progress = lambda what, share: None
) -> RunView:
    """Read and compare a run. What ``last`` has of the same flight is not made again. Raises InputError."""
    signature = signature_of(path)
    run = open_run(path)
    versions, notes = versions_of(run)
    if last is not None and not last.is_of_flight(signature):
        last = None
    is_newest = last is not None and last.signature[_AT_DIAGNOSIS] == signature[_AT_DIAGNOSIS]
    unwritten = last.unwritten if last is not None and is_newest else None
    progress("reconstructing the flight", 0.1)
    flights = _Flights(run, last)
    comparisons: dict[str, Comparison] = {}
    for number, version in enumerate(versions):
        name = version.identifier
        progress(f"comparing version {name} ({number + 1} of {len(versions)})", 0.4 + 0.6 * number / len(versions))
        try:
            known = last is not None and name in last.comparisons
            comparisons[name] = last.comparisons[name] if last and known else compare(flights.under(version.aircraft))
        except InputError:
            if name == run.current.identifier:
                raise
    current = comparisons[run.current.identifier]
    recorded, unread = _recorded(run.path)
    if run.samples is None:
        notes.append("the run holds no samples: errors are those of the filter; replay the recording again")
    return RunView(
        name=_name(path),
        aircraft=run.root.name,
        zero=flights.zero,
        current=run.current.identifier,
        changes=run.current.changes,
        versions=tuple(versions),
        comparisons=comparisons,
        diagnosis=_diagnosis(run.path, notes) if unwritten is None else unwritten,
        parameters={v.identifier: _parameters(run, v) for v in versions},
        notes=(*unread, *current.notes, *notes),
        can_diagnose=run.samples is not None,
        signature=signature,
        run=run,
        labels=_labels(run.path, notes),
        refined=_refined(folder_of(run, run.current)),
        recorded=recorded,
        unwritten=unwritten,
        undoable=frozenset(name for name, target in written(run).items() if target.can_be_undone),
    )


def _name(path: str | Path) -> str:
    """The folder as it was given, or where it is if that is no name, such as "."."""
    place = Path(path)
    return readable(str(place if place.name.strip(".") else place.resolve()))


def _recorded(folder: Path) -> tuple[float | None, list[str]]:
    """Length [s] of the recording as replay says it, None where it is not known; what could not be read of it."""
    try:
        state = json.loads((folder / STATE).read_text(encoding="utf8"))
        return float(state["duration"]), [f"recording: {note}" for note in state.get("notes", ())]
    except UNREADABLE:
        return None, []


class _Flights:
    """The flight under versions: those with the same sensors share one reconstruction."""

    def __init__(self, run: Run, last: RunView | None) -> None:
        self._run = run
        known = list(last.comparisons.values()) if last else []
        self._made = [(settings_of(found.flight.aircraft), found.flight) for found in known]
        self.zero = last.zero if last else 0

    def under(self, aircraft: Aircraft) -> FlightData:
        settings = settings_of(aircraft)
        for others, flight in self._made:
            if others == settings:
                return flight.under(aircraft)
        flight, zero = self._run.flight_from(aircraft)
        self.zero = self.zero or zero
        self._made.append((settings, flight))
        return flight


def _diagnosis(folder: Path, notes: list[str]) -> Mapping[str, Any] | None:
    """The last diagnosis; None where there is none, or none that can be read, which a note then says."""
    if not (folder / DIAGNOSIS).exists():
        return None
    try:
        content = json.loads((folder / DIAGNOSIS).read_text(encoding="utf8"))
        whole = content.keys() >= _OF_DIAGNOSIS and all(c.keys() >= _OF_CANDIDATE for c in content["candidates"])
    except UNREADABLE:
        whole = False
    if not whole:
        notes.append(f"{DIAGNOSIS} of the run cannot be read: diagnose again")
    return content if whole else None


def _refined(folder: Path) -> Mapping[str, Mapping[str, Any]]:
    """What `refine` has written beside the aircraft file of a version, by method; what cannot be read is not there."""
    found = {}
    for method in METHODS:
        try:
            content = json.loads((folder / refined_name(method)).read_text(encoding="utf8"))
            if content.keys() >= _OF_REFINED and all(p.keys() >= _OF_PARAMETER for p in content["parameters"]):
                found[method] = content
        except UNREADABLE:
            continue
    return found


def _labels(folder: Path, notes: list[str]) -> Labels:
    """Names and notes of versions; none where they cannot be read, which a note then says."""
    try:
        return read_labels(folder)
    except InputError as error:
        notes.append(str(error))
        return {}


def _parameters(run: Run, version: Version) -> list[dict[str, Any]]:
    """Of a version, of the run itself for the root: as in parameters.json, and HOLD where a refinement contradicts."""
    try:
        return list(released_parameters(run, version).values())
    except UNREADABLE:
        return []


def load_truth_view(path: str | Path | None) -> TruthView:
    """The truth of a simulated recording, or of truth.json itself. Raises InputError where it cannot be read."""
    if path is None:
        return NO_TRUTH
    place = Path(path)
    place = place if place.suffix == ".json" else truth_path(place, ".json")
    try:
        content = json.loads(place.read_text(encoding="utf8"))
        listed = {**content, "coefficients": content["coefficients"] or {}}
        return TruthView(true_values(listed), content)
    except UNREADABLE:
        raise InputError(
            f"{place} holds no truth of a simulated flight: simulate writes it into the recording"
        ) from None


def load_flight_record(path: str | Path, zero: int) -> FlightRecord:
    """What was estimated in flight, times from ``zero`` [ns]. Raises InputError where it is missing or damaged."""
    folder = Path(path)
    run = open_run(path)
    try:
        summary = json.loads((folder / STATE).read_text(encoding="utf8"))
        states = read_table(folder / ESTIMATES, "state_estimator/state")
        parameters = read_table(folder / ESTIMATES, "parameter_estimator/parameters")
    except UNREADABLE as error:
        if isinstance(error, InputError):
            raise
        raise not_a_run(path) from None
    time = np.asarray((states.stamp - zero) * 1e-9, dtype=np.float64)
    at = gaps(time)  # between manoeuvres, or where nothing was recorded

    def column(name: str) -> Array:
        return broken(np.stack(list(states.fields[name])), at)

    sigma = column("standard_deviations")
    measured: dict[str, tuple[Array, Array]] = {}
    for name, kind in _AIR.items() if run.samples is not None else ():
        chosen = run.samples.kind == kind  # type: ignore[union-attr]
        stamps, values = run.samples.stamp[chosen], run.samples.values[chosen, 0]  # type: ignore[union-attr]
        if len(stamps):
            measured[name] = ((stamps - zero) * 1e-9 - run.root.sensors[name].delay, values)
    biases: dict[str, Any] = {name: column("wind_ned" if name == "wind" else name) for name in _BIASES}
    biases |= {f"{name}_std": sigma[:, part] for name, part in _BIASES.items()}
    state = StateHistory(
        time=broken_time(time, at),
        **biases,
        position=column("position_ned"),
        air=np.column_stack([column(name) for name in ("true_airspeed", "angle_of_attack", "sideslip")]),
        consistency=column("innovation_consistency"),
        measured_time={name: pair[0] for name, pair in measured.items()},
        measured={name: pair[1] for name, pair in measured.items()},
        is_joined=bool(run.manoeuvres),
    )
    notes = tuple(f"{ESTIMATES}: {note}" for note in states.notes)
    return FlightRecord(state, _parameter_history(parameters, zero), summary, notes)


def _parameter_history(table: Table, zero: int) -> ParameterHistory:
    """Estimates of the parameters of the last model; NaN and HOLD where an earlier model did not have one."""
    listed = [{p.name: p for p in parameters} for parameters in table.fields["parameters"]]
    names = tuple(listed[-1])
    shape = (len(listed), len(names))
    value, std, status = np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, int(Trust.HOLD))
    for i, at_time in enumerate(listed):
        for j, name in enumerate(names):
            if name in at_time:
                p = at_time[name]
                value[i, j], std[i, j], status[i, j] = p.value, p.standard_deviation, p.status
    time = np.asarray((table.stamp - zero) * 1e-9, dtype=np.float64)
    return ParameterHistory(time, names, value, std, status)
