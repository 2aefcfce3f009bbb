"""From a log to what it means, in one go: import, check, replay, compare, diagnose, and what that says together."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.after_flight.check import CheckedRecording, check_recording
from aircraft_sysid_ros.after_flight.compare import ComparedRun, compare_run
from aircraft_sysid_ros.after_flight.diagnose import check_replicas, diagnose
from aircraft_sysid_ros.after_flight.explanation.aeroplane import (
    Fact,
    KnownMode,
    Learnt,
    apparent_mass,
    facts_of,
    known_modes,
)
from aircraft_sysid_ros.after_flight.explanation.first_sentence import Evidence, Said, what_matters
from aircraft_sysid_ros.after_flight.explanation.instruments import InstrumentError, as_diagnosed, instrument_errors
from aircraft_sysid_ros.after_flight.explanation.next_flight import next_flights
from aircraft_sysid_ros.after_flight.log_import import BAGS, import_log
from aircraft_sysid_ros.after_flight.progress import Tell, nobody, part_of
from aircraft_sysid_ros.after_flight.replay import ReplayOptions, replay
from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import SENSOR_GROUPS, by_name
from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import COUNT
from aircraft_sysid_ros.effects.effect import MEASUREMENT, with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_check.finding import ABSENT, ERROR, INFO, OF_SAMPLING, Finding, joined, short_names
from aircraft_sysid_ros.flight_check.signals import COMMANDED, GEODETIC, VELOCITY
from aircraft_sysid_ros.processes import beside
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.recordings.autopilot_bag_import import is_autopilot_bag
from aircraft_sysid_ros.recordings.autopilot_log import NO_SURFACES
from aircraft_sysid_ros.recordings.losses import NOT_FINISHED
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.run_reader import AIRCRAFT, PARAMETERS, late_surfaces_of, read_parameters
from aircraft_sysid_ros.text_file import put_in_place

#: Delays [s] of a GPS that are taken off where the check has found them: longer ones are a clock that is wrong.
_SHORTEST_DELAY, _LONGEST_DELAY = 0.03, 0.5
#: An effect without which the error of its axis is larger by this factor spoils what else is said of its axes.
_LARGE = 1.5
RUN, RECORDING, PAGE = "run", "flight", "explain.html"


@dataclass(frozen=True)
class Explanation:
    """What a log means. What comes after the check is None or empty where the log allows no replay: ``why_not``."""

    log: str
    out: Path
    aircraft: Aircraft
    check: CheckedRecording
    said: tuple[Said, ...]  # the most important first
    next: tuple[str, ...]
    replayed: Mapping[str, Any] | None = None
    compared: ComparedRun | None = None
    diagnosis: Mapping[str, Any] | None = None
    instruments: tuple[InstrumentError, ...] = ()
    facts: tuple[Fact, ...] = ()
    modes: tuple[KnownMode, ...] = ()
    why_not: str = ""
    notes: tuple[str, ...] = ()

    @property
    def first(self) -> str:
        """The most important thing, in a sentence."""
        return self.said[0].sentence

    @property
    def used(self) -> tuple[int, int]:
        """Parameters to USE, of so many."""
        return _used(self.replayed) if self.replayed is not None else (0, len(self.aircraft.model.parameter_names))

    @property
    def json(self) -> dict[str, Any]:
        """What ``explain --json`` prints, with what is said first."""
        return {
            "log": self.log,
            "run": None if self.replayed is None else str(self.out / RUN),
            "page": str(self.out / PAGE),
            "first": self.first,
            "said": [{"kind": said.kind, "sentence": said.sentence} for said in self.said],
            "check": self.check.json,
            "compare": None if self.compared is None else self.compared.json,
            "diagnose": None if self.diagnosis is None else dict(self.diagnosis),
            "sensors": [error.json for error in self.instruments],
            "aeroplane": [fact.json for fact in self.facts],
            "modes": [mode.json for mode in self.modes],
            "next": list(self.next),
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class ExplainOptions:
    """What an explanation may want different from the defaults."""

    overwrite: bool = False
    calibration: str | None = None  # what the servo outputs of an autopilot mean
    replicas: int = COUNT
    calm_air: bool = False  # the speed over ground stands for an airspeed that is not measured
    columns: str | None = None  # MAP of a stranger's tables


def explain(
    log: str | Path,
    aircraft: str | Path | Aircraft,
    out: str | Path,
    options: ExplainOptions | None = None,
    tell: Tell = nobody,
    page: Callable[[Explanation], str] | None = None,
) -> Explanation:
    """Explain a log; the folder ``out`` gets the run, and the recording where it had to be imported.

    ``log``: a recording, or what ``import`` takes by itself; ``page`` makes the content of explain.html. Nothing is
    written where it raises InputError.
    """
    options = options or ExplainOptions()
    check_replicas(options.replicas)
    known = aircraft if isinstance(aircraft, Aircraft) else load_aircraft(aircraft)
    path = Path(out)
    _check_target(path, options.overwrite)
    with _beside(path) as folder:
        new = Path(folder) / "new"
        new.mkdir()
        found = _explained(Path(log), known, new, path, options, tell)
        try:
            (new / PAGE).write_text("" if page is None else page(found), encoding="utf8")
            put_in_place(new, path, Path(folder) / "replaced", lambda: _check_target(path, options.overwrite))
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    return found


def _explained(
    log: Path, aircraft: Aircraft, place: Path, out: Path, options: ExplainOptions, tell: Tell
) -> Explanation:
    tell("read the log", 0.0)
    recording, notes = _recording(log, place / RECORDING, options)
    checked = check_recording(recording, aircraft, part_of(tell, 0.02, 0.15))
    if recording != log:
        checked = replace(checked, path=str(out / RECORDING))  # where it will be
    if any(NO_SURFACES in note for note in notes):
        checked = _with_outputs(checked)
    notes += checked.notes
    aircraft, checked, done = with_gps_in_time(aircraft, checked)
    notes += done
    try:
        chosen = ReplayOptions(state=StateOptions(calm_air=options.calm_air))
        replayed = replay([str(recording)], aircraft, place / RUN, chosen, part_of(tell, 0.15, 0.25))
    except InputError as error:
        why_not = str(error).replace(str(place), str(out))
        if not any(finding.severity == ERROR for finding in checked.checked.findings):
            raise InputError(why_not) from None
        unused = (0, len(aircraft.model.parameter_names))
        said = tuple(what_matters(Evidence(_of_motion(checked), unused, calm_air=options.calm_air)))
        further = tuple(next_flights(checked.json, None, (), None))
        return Explanation(str(log), out, aircraft, checked, said, further, why_not=why_not, notes=tuple(notes))
    notes += _without_what_is_checked(replayed["notes"], checked.checked.findings)
    compared, diagnosis, why_not = _judged(place / RUN, options, tell)
    why_not = why_not.replace(str(place / RUN), "the flight")  # a reader has never seen that folder
    tell("put it into words", 0.97)
    learnt = None
    if compared is not None:
        learnt = Learnt(compared.comparison, *_learnt_in_flight(place / RUN), _lacking(diagnosis))
    instruments = _instruments(compared, diagnosis)
    facts = [] if learnt is None else facts_of(learnt, _stall_onset(diagnosis))
    modes = [] if learnt is None else known_modes(learnt)
    weighed = None if learnt is None else apparent_mass(learnt)
    mass = None if learnt is None or weighed is None else (float(learnt.aircraft.mass), *weighed)
    checks = _with_flight(_of_motion(checked), replayed, instruments)
    broken = NOT_FINISHED if NOT_FINISHED in checked.notes else ""
    late = late_surfaces_of(place / RUN)
    states = "the aircraft file" if mass is None or mass[0] == aircraft.mass else "the recording"
    evidence = Evidence(
        checks, _used(replayed), instruments, diagnosis, facts, options.calm_air, mass, broken, late, states,
        replayed["parameters"]["estimator"]["published"],
    )  # fmt: skip
    notes += [] if compared is None else compared.notes
    notes += [] if diagnosis is None else diagnosis["notes"]
    return Explanation(
        log=str(log),
        out=out,
        aircraft=aircraft,
        check=checked,
        said=tuple(what_matters(evidence)),
        next=tuple(next_flights(checked.json, learnt, modes, diagnosis, replayed.get("airspeed_reads"))),
        replayed={**replayed, "run": str(out / RUN)},
        compared=None if compared is None else replace(compared, run=replace(compared.run, path=out / RUN)),
        diagnosis=None if diagnosis is None else {**diagnosis, "file": str(out / RUN / "diagnosis.json")},
        instruments=tuple(instruments),
        facts=tuple(facts),
        modes=tuple(modes),
        why_not=why_not,
        notes=tuple(dict.fromkeys(notes)),
    )


def with_gps_in_time(aircraft: Aircraft, checked: CheckedRecording) -> tuple[Aircraft, CheckedRecording, list[str]]:
    """The aircraft with the delay of the GPS that the check has found, where its file says nothing of one, the check
    without a warning of that, and a note that says so.

    Receivers need 0.1 to 0.25 s, of which a filter makes a wind, a bias, and a zero of a vane in turns.
    """
    said = by_name(aircraft.source.get("sensors"))
    stated = any("delay" in said.get(name, {}) for name in ("gps", *SENSOR_GROUPS["gps"]))
    late = next((f.late for f in checked.checked.findings if f.kind == "offset" and f.signals == VELOCITY), 0.0)
    if stated or not _SHORTEST_DELAY < late < _LONGEST_DELAY:
        return aircraft, checked, []
    findings = tuple(
        replace(finding, severity=INFO)
        if finding.kind == "offset" and finding.late and {*finding.signals} <= {*VELOCITY, *GEODETIC}
        else finding
        for finding in checked.checked.findings
    )
    note = (
        f"the GPS comes {late:.2f} s late, as the check shows, and this is corrected here: other commands do so with "
        f"`gps: {{delay: {late:.2f}}}` under `sensors` of the aircraft file"
    )
    better = with_setting(aircraft, ("sensors", "gps", "delay"), round(late, 3))
    return better, replace(checked, checked=replace(checked.checked, findings=findings)), [note]


def _with_outputs(checked: CheckedRecording) -> CheckedRecording:
    """Surfaces that are missing for want of a calibration file are in the log, and not to be recorded."""
    findings = [
        replace(finding, sentence=f"{ABSENT}: {NO_SURFACES}")
        if finding.kind == "missing" and set(finding.signals) <= {*COMMANDED}
        else finding
        for finding in checked.checked.findings
    ]
    return replace(checked, checked=replace(checked.checked, findings=tuple(findings)))


def _with_flight(
    check: Mapping[str, Any], replayed: Mapping[str, Any], instruments: Iterable[InstrumentError]
) -> dict[str, Any]:
    """What the check of the log says, and what the flight showed of signals of which nothing else says anything.

    A pitot that leaks from one moment on is found in flight; over the whole log it is neither right nor wrong. One that
    is wrong by the same in all of it is an instrument with an error, which is told better with all of it. Samples
    that are lost say nothing of the others.
    """
    said = {f["signal"] for f in check["findings"] if f["severity"] != INFO and f["kind"] not in OF_SAMPLING}
    said |= {error.signal for error in instruments}
    more = [finding for finding in replayed["findings"] if finding["signal"] not in said]
    return {**check, "findings": [*check["findings"], *more]}


def _of_motion(checked: CheckedRecording) -> dict[str, Any]:
    """The JSON of a check with what its motion shows: a signal that is not recorded is no want of motion."""
    shown = {p.name: p.is_shown or p.is_held for p in checked.checked.parameters}
    return {**checked.json, "identifiable": shown}


def _judged(run: Path, options: ExplainOptions, tell: Tell) -> tuple[ComparedRun | None, Mapping[str, Any] | None, str]:
    """Comparison and diagnosis of a run, and why there is none of either.

    Where no model can be compared, a diagnosis may still tell inputs that failed.
    """

    def comparison() -> tuple[Comparison | None, str]:
        try:
            return compare_run(run).comparison, ""
        except InputError as error:
            return None, str(error)

    diagnosis, why_not = None, ""
    with beside(comparison) as compared:
        try:
            diagnosis = diagnose([run], options.replicas, part_of(tell, 0.25, 0.97))
        except InputError as error:
            why_not = str(error)
        found, why = compared()
    return None if found is None else ComparedRun(open_run(run), found), diagnosis, why or why_not


def _instruments(compared: ComparedRun | None, diagnosis: Mapping[str, Any] | None) -> list[InstrumentError]:
    if compared is None or compared.run.samples is None:
        return []
    candidates = diagnosis["candidates"] if diagnosis else []
    named = [str(c["effect"]) for c in candidates if c["found"]]
    return instrument_errors(as_diagnosed(compared.run.root, candidates), compared.run.samples, named)


def _learnt_in_flight(run: Path) -> tuple[dict[str, tuple[str, str]], dict[str, tuple[float, float]]]:
    """The verdict on each parameter, and value and standard error, of those that have one."""
    parameters = read_parameters(run)
    known = {name: p for name, p in parameters.items() if p["std"] is not None and p["value"] is not None}
    estimates = {name: (float(p["value"]), float(p["std"])) for name, p in known.items()}
    return {name: (p["status"], p["reason"]) for name, p in parameters.items()}, estimates


def _lacking(diagnosis: Mapping[str, Any] | None) -> dict[str, str]:
    """What the model lacks by axis, in words, of effects that explain a large part of the error that there is."""
    found = [c for c in diagnosis["candidates"] if c["found"] and c["kind"] != MEASUREMENT] if diagnosis else []
    large = [c for c in found if c["main_axis"] and c["error_before"] > _LARGE * c["error_after"]]
    named = {axis: str(c["name"] or c["label"]).lower() for c in reversed(large) for axis in c["axes"]}
    return {axis: named[axis] for axis in AXES if axis in named}


def _used(replayed: Mapping[str, Any]) -> tuple[int, int]:
    parameters = replayed["parameters"]["parameters"]
    return sum(p["status"] == "USE" for p in parameters), len(parameters)


def _stall_onset(diagnosis: Mapping[str, Any] | None) -> float | None:
    """Angle of attack [rad] at which a stall that was found begins."""
    for candidate in diagnosis["candidates"] if diagnosis else ():
        if candidate["found"] and "stall" in str(candidate["effect"]) and "onset" in candidate["inner"]:
            return float(candidate["inner"]["onset"])
    return None


def _without_what_is_checked(notes: Sequence[str], findings: Sequence[Finding]) -> list[str]:
    """Notes of the replay without what it says, by less of the flight, of signals that the check accuses."""
    accused = {short_names(finding.signals) for finding in joined(findings) if finding.severity != INFO}
    return [note for note in notes if note.partition(": ")[0] not in accused]


def _recording(log: Path, target: Path, options: ExplainOptions) -> tuple[Path, list[str]]:
    """The recording of a log: itself, or what ``import`` makes of it, with notes. Raises InputError."""
    if not log.exists():
        raise InputError(f"there is no log {log}")
    if (log / PARAMETERS).is_file() and (log / AIRCRAFT).is_file():
        raise InputError(f"{log} is a run: give the recording or the log that it was made from, to be explained again")
    is_bag = log.suffix.lower() in BAGS or (log.is_dir() and (log / "metadata.yaml").exists())
    refused = None
    if is_bag and not options.columns and not is_autopilot_bag(log):
        try:
            read_recording(log)
        except InputError as error:
            refused = error
        if refused is None:
            if options.calibration:
                raise InputError(f"--servos is for logs of autopilots: the recording {log} needs none")
            return log, []
    try:
        report = import_log(log, target, columns=options.columns, calibration=options.calibration)
    except InputError as error:
        raise (refused or error) from None
    notes = [f"{name}: {why}" for name, why in report["missing"].items()]
    return target, [*notes, *report["notes"]]


def _check_target(path: Path, overwrite: bool) -> None:
    """Before the work, whether the folder can be written."""
    if path.exists() and not path.is_dir():
        raise InputError(f"{path} is a file: give the name of a folder")
    if path.is_dir() and any(path.iterdir()):
        if not (path / PAGE).exists():
            raise InputError(f"{path} holds something else and is not overwritten: give another name")
        if not overwrite:
            raise InputError(f"{path} is already there: give another name or --overwrite")


def _beside(path: Path) -> tempfile.TemporaryDirectory[str]:
    """A folder on the disk that takes the result."""
    parent = path.absolute().parent
    in_the_way = next((folder for folder in (*parent.parents, parent) if folder.is_file()), None)
    if in_the_way is not None:
        raise InputError(f"cannot write {path}: {in_the_way} is a file and cannot hold a folder, give another name")
    try:
        parent.mkdir(parents=True, exist_ok=True)
        if not os.access(parent, os.W_OK | os.X_OK):
            raise PermissionError(13, "Permission denied")
        return tempfile.TemporaryDirectory(dir=parent, prefix=f".{path.name}.")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
