"""Model versions of a run: each is an aircraft file, with its parents, its parameters and its errors.

    RUN/aircraft.yaml                the root version
    RUN/models/ID/aircraft.yaml      another version: loads like any aircraft file, for replay and live
    RUN/models/ID/parameters.json    its parameters, as replay learns them with its aircraft file
    RUN/models/ID/version.json       id, parents, what was added to the root, errors on held-out flight
    RUN/model.json                   which version is the current one

A version is written beside its place and moved there, and becomes the current one by replacing one file, so that a
program that is killed leaves the run as it was. Two programs that change a run wait for each other.
"""

from __future__ import annotations

import contextlib
import copy
import hashlib
import json
import os
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS
from aircraft_sysid_ros.diagnosis.flight.flight_data import AIRCRAFT, FlightData, check_flight, load_flight_data
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct_as_flown, settled_flight
from aircraft_sysid_ros.diagnosis.flight.white_noise import white_noise_of
from aircraft_sysid_ros.diagnosis.model_versions.labels import named, newest, read_labels
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.model_file import parameters_json
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.json_text import json_text
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.absences import assumed_calm
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.ordering import flown_twice
from aircraft_sysid_ros.refinement.refined_file import with_contradictions
from aircraft_sysid_ros.refinement.run_data import RunData, load_run, load_run_aircraft
from aircraft_sysid_ros.run_reader import (
    PARAMETERS,
    SAMPLES,
    UNREADABLE,
    calm_air_of,
    estimator_of,
    lack_of_fit_of,
    late_surfaces_of,
    not_a_run,
    read_parameters,
    read_points,
    read_state,
    std_of_sensors_of,
)
from aircraft_sysid_ros.samples import Samples
from aircraft_sysid_ros.stamps import nanoseconds
from aircraft_sysid_ros.text_file import locked, write_whole

Array = npt.NDArray[np.float64]

MODELS, CURRENT, VERSION = "models", "model.json", "version.json"
#: Of a version: it names a folder of the run and nothing beyond.
_IDENTIFIER = re.compile(r"[0-9A-Za-z]{1,64}")
#: Keys of an aircraft file that are the model; a version that differs in another one has its own id.
_MODEL_KEYS = ("model", "coefficients")
#: One sigma [s] of a delay or a lag of the surfaces that explains a flight: it stands for servos with both and a
#: greatest rate, and for a lag of 0.05 s 0.031 s were found. What is learnt with it looks for the rest, and counts it.
_DOUBT_OF_LATENESS = 0.02


@dataclass(frozen=True)
class Change:
    """What one addition did: terms that came, terms of the root that went, numbers of the file that changed."""

    terms: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    without: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    settings: tuple[tuple[tuple[str, ...], float], ...] = ()

    @property
    def json(self) -> dict[str, Any]:
        """For version.json."""
        settings = [{"key": list(key), "value": value} for key, value in self.settings]
        return {"terms": dict(self.terms), "without": dict(self.without), "settings": settings}


def change_from_json(content: Mapping[str, Any]) -> Change:
    """The inverse of Change.json; KeyError, TypeError or ValueError where it is none."""
    terms, without = (
        {axis: tuple(map(str, texts)) for axis, texts in content[key].items()} for key in ("terms", "without")
    )
    settings = tuple((tuple(map(str, s["key"])), float(s["value"])) for s in content["settings"])
    return Change(terms, without, settings)


@dataclass(frozen=True)
class Version:
    """One version: the root with changes, by what the user called them, in order."""

    identifier: str
    aircraft: Aircraft
    changes: Mapping[str, Change] = field(default_factory=dict)
    parents: tuple[str, ...] = ()


@dataclass(frozen=True)
class Run:
    """A run folder with its current version. ``samples`` is None where the run has kept none."""

    path: Path
    root: Aircraft
    current: Version
    samples: Samples | None

    @property
    def manoeuvres(self) -> tuple[str, ...]:
        """Names of the manoeuvres that were joined; none where it is one flight."""
        try:
            return tuple(str(each["name"]) for each in read_state(self.path).get("manoeuvres", ()))
        except UNREADABLE:  # said of that file
            return ()

    @property
    def calm_air(self) -> bool:
        """The air was taken as calm when the flight was replayed."""
        return calm_air_of(self.path)

    @cached_property
    def zero(self) -> int | None:
        """Stamp [ns] from which the signal ``time`` counts, where the filter started; None where it did not."""
        try:
            points = read_points(self.path)
            time = points["signals"][:, points["signal_names"].tolist().index("time")]
        except UNREADABLE:  # said of that file
            return None
        known = np.flatnonzero(np.isfinite(time))
        return int(points["stamp"][known[0]]) - int(1e9 * time[known[0]]) if len(known) else None

    @property
    def notes(self) -> list[str]:
        """What every answer about the run says."""
        if self.samples is None:
            return []
        notes = assumed_calm(self.samples, self.calm_air)
        if (twice := flown_twice(self.samples)) > 1.0:
            notes.append(
                f"the clock went back, so that {twice:.0f} s of flight share their times with other parts: they are "
                "mixed here, which makes errors larger; record the parts separately, and replay both"
            )
        return notes

    def late_surfaces(self, aircraft: Aircraft) -> dict[str, tuple[float, float]]:
        """Delay or lag [s] of the surfaces that the flight has shown, each with one sigma, and that an aircraft file of
        this run does not have.
        """
        mine, first = aircraft.sensors[CONTROLS], self.root.sensors[CONTROLS]
        return late_surfaces_of(self.path) if (mine.delay, mine.lag) == (first.delay, first.lag) else {}

    def flight(self, aircraft: Aircraft | None = None) -> FlightData:
        """The flight as the sensor settings of an aircraft file see it, by default those of the current version.

        Reconstructed from all samples, smoothed, with the noise and the gusts that it had; without samples, as the
        filter saw it with the root's settings.
        """
        return self.flight_from(aircraft)[0]

    def flight_from(self, aircraft: Aircraft | None = None) -> tuple[FlightData, int]:
        """``flight``, and the stamp [ns] from which the signal ``time`` counts."""
        aircraft = self.current.aircraft if aircraft is None else aircraft
        if self.samples is None:
            if settings_of(aircraft) != settings_of(self.root):
                raise InputError(f"{self.path} holds no samples to reconstruct from: replay the recording again")
            flight, first = load_flight_data(self.path), int(read_points(self.path)["stamp"][0])
        else:
            made, _ = reconstruct_as_flown(aircraft, self.samples, calm_air=self.calm_air)
            check_flight(str(self.path), made.data, self.samples)
            flight = replace(settled_flight(made), white_noise=white_noise_of(made.aircraft, made.samples))
            first = made.epoch + int(1e9 * made.points[0, CoefficientSample.TIME])
        return replace(flight.under(aircraft), names=self.manoeuvres), first - int(1e9 * flight.begin)


def open_run(path: str | Path) -> Run:
    """Read a run folder and its current version. Raises InputError where it is no run, or damaged."""
    folder = Path(path)
    if not (folder / AIRCRAFT).is_file():
        raise not_a_run(path)
    root = load_run_aircraft(folder / AIRCRAFT)
    if not (folder / SAMPLES).is_file():
        load_flight_data(folder)  # says what is wrong before anything is changed
        return Run(folder, root, _current(folder, root), None)
    return Run(folder, root, _current(folder, root), load_run(folder).samples)


def settings_of(aircraft: Aircraft) -> dict[str, Any]:
    """All of an aircraft file but the model."""
    return {key: value for key, value in aircraft.source.items() if key not in _MODEL_KEYS}


def version_identifier(aircraft: Aircraft, root: Aircraft) -> str:
    """Id of a version: that of its terms, and another one where it differs from the root in more than those."""
    settings = settings_of(aircraft)
    if settings == settings_of(root):
        return aircraft.model.identifier
    text = aircraft.model.identifier + json.dumps(settings, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def version_with(run: Run, changes: Mapping[str, Change], parents: Sequence[str]) -> Version:
    """The root with these changes. Raises InputError where the aircraft file may not hold them."""
    source = copy.deepcopy(run.root.source)
    terms = {axis: list(texts) for axis, texts in run.root.model.terms.items()}
    for change in changes.values():
        for axis, texts in change.without.items():
            terms[axis] = [text for text in terms[axis] if text not in texts]
    for change in changes.values():
        for axis, texts in change.terms.items():
            terms[axis] += [text for text in texts if text not in terms[axis]]
    source["model"] = {axis: [int(t) if t == "1" else t for t in terms[axis]] for axis in AXES}
    aircraft = aircraft_from_dict(source)
    for change in changes.values():
        for key, value in change.settings:
            aircraft = with_setting(aircraft, key, value, _DOUBT_OF_LATENESS if CONTROLS in key else 0.0)
    identifier = version_identifier(aircraft, run.root)
    of_root = identifier == run.root.model.identifier  # back where it began: the root has no parents
    return Version(identifier, aircraft, dict(changes), () if of_root else tuple(parents))


def _current(folder: Path, root: Aircraft) -> Version:
    if not os.path.lexists(folder / CURRENT):
        return Version(root.model.identifier, root)
    try:
        identifier = str(json.loads((folder / CURRENT).read_text(encoding="utf8"))["model"])
        place = _place(folder, identifier)
        content = json.loads((place / VERSION).read_text(encoding="utf8"))
        changes = {str(label): change_from_json(change) for label, change in content["changes"].items()}
        parents = tuple(map(str, content["parents"]))
        aircraft = load_run_aircraft(place / AIRCRAFT)
    except UNREADABLE:
        message = f"the model versions of {folder} are damaged: remove {CURRENT} to go back to the model of the run"
        raise InputError(message) from None
    return Version(identifier, aircraft, changes, parents)


def _place(folder: Path, identifier: str) -> Path:
    """Folder of a version. Raises ValueError where that is anywhere but in the run."""
    place = folder / MODELS / identifier
    if not _IDENTIFIER.fullmatch(identifier) or folder.resolve() not in place.resolve().parents:
        raise ValueError("outside of the run")
    return place


def versions_of(run: Run) -> tuple[list[Version], list[str]]:
    """All versions in the order in which they were made, the root first; what cannot be read is left out and noted."""
    root = Version(run.root.model.identifier, run.root)
    found, notes = {root.identifier: root}, []
    folders = (run.path / MODELS).glob("*") if (run.path / MODELS).is_dir() else ()
    for folder in sorted(folders, key=lambda f: changed_at(f / VERSION)):
        try:
            content = json.loads((_place(run.path, folder.name) / VERSION).read_text(encoding="utf8"))
            changes = {label: change_from_json(change) for label, change in content["changes"].items()}
            version = Version(folder.name, load_aircraft(folder / AIRCRAFT), changes, tuple(content["parents"]))
        except UNREADABLE:
            notes.append(
                f"the model version {folder.name} is left out, {VERSION} or {AIRCRAFT} in {folder} is damaged: "
                "remove that folder and add the effect again"
            )
            continue
        found.setdefault(folder.name, version)
    found[run.current.identifier] = run.current
    return list(found.values()), notes


def changed_at(path: Path) -> int:
    """When a file was changed [ns]; 0 where it is not there."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def version_named(run: Run, identifier: str) -> Version:
    """A version by its id or its name. Raises InputError, which lists them, where the run has none of that."""
    versions = {version.identifier: version for version in versions_of(run)[0]}
    if identifier in versions:
        return versions[identifier]
    labels = read_labels(run.path)
    found = named(labels, identifier)
    if found not in versions:
        known = newest(labels)
        listed = (f"{v} ('{known[v].name}')" if v in known and known[v].name else v for v in versions)
        raise InputError(f"the run {run.path} has no model '{echo(identifier)}': it has {' '.join(listed)}")
    return versions[found]


def folder_of(run: Run, version: Version) -> Path:
    """Where the aircraft file and the parameters of a version are."""
    is_root = version.identifier == run.root.model.identifier
    return run.path if is_root else run.path / MODELS / version.identifier


def folder_to_write(run: Run, version: Version) -> Path:
    """The same where something is to be kept beside them; raises InputError where nothing can be."""
    folder = folder_of(run, version)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"cannot write to {folder}: change its permissions")
    return folder


def released_parameters(run: Run, version: Version) -> dict[str, dict[str, Any]]:
    """Parameters of a version by name, as in its parameters.json, and with HOLD where a refinement contradicts them.

    Raises UNREADABLE.
    """
    folder = folder_of(run, version)
    return with_contradictions(folder, read_parameters(folder))


def run_data(run: Run, version: Version) -> RunData:
    """A run as if one of its versions had flown: its parameters, and its points and biases by the live chain.

    Of the root they stand in the run. Raises InputError where the version is damaged or the run holds no samples.
    """
    if version.identifier == run.root.model.identifier:
        return load_run(run.path)
    if run.samples is None:
        raise InputError(f"{run.path} holds no samples to fly {version.identifier} on: replay the recording again")
    try:
        folder = folder_of(run, version)
        parameters, lacks, of_sensors = read_parameters(folder), lack_of_fit_of(folder), std_of_sensors_of(folder)
    except UNREADABLE:
        raise InputError(
            f"{PARAMETERS} of the model version {version.identifier} in {run.path} is damaged: remove that version "
            "and add the effect again"
        ) from None
    pipeline, points = _flown(run, version.aircraft)
    if pipeline.state.epoch is None:
        raise InputError(f"the filter does not start on the samples of {run.path}: replay says why")
    state = pipeline.state.summary()
    return RunData(
        aircraft=version.aircraft,
        samples=run.samples,
        parameters=parameters,
        biases=np.array([b or 0.0 for b in (*state["accelerometer_bias"], *state["gyro_bias"])]),
        point_stamp=nanoseconds(points[:, CoefficientSample.TIME], pipeline.state.epoch),
        measured=points[:, CoefficientSample.MEASURED],
        terms=points[:, CoefficientSample.TERMS :],
        calm_air=run.calm_air,
        noise=pipeline.parameters.learning.noise_of(points),
        lack_of_fit=lacks,
        std_of_sensors=of_sensors,
    )


def learnt(run: Run, aircraft: Aircraft) -> dict[str, Any]:
    """The content of parameters.json with another model: what ``replay`` learns from the run's samples with it."""
    if run.samples is None:
        why = "the run holds no samples to learn it from: replay the recording again"
        unknown = {"value": np.nan, "std": np.nan, "status": Trust.HOLD.name, "reason": why}
        return {"parameters": [{"name": name, **unknown} for name in aircraft.model.parameter_names]}
    return parameters_json(_flown(run, aircraft)[0].parameters)


def _flown(run: Run, aircraft: Aircraft) -> tuple[Pipeline, Array]:
    """The live chain after all samples of a run, and its points."""
    assert run.samples is not None
    options = ParameterOptions(estimator=estimator_of(run.path))
    pipeline = Pipeline(aircraft, StateOptions(calm_air=run.calm_air), options)
    return pipeline, np.vstack([pipeline.push(run.samples)[1], pipeline.flush()[1]])


def _comes_back(place: Path, content: Mapping[str, Any]) -> bool:
    """Whether the folder of a version holds it already, made by the same changes, which their order is no part of."""
    try:
        return bool(
            json.loads((place / VERSION).read_text(encoding="utf8"))["changes"]
            == json.loads(json_text(content["changes"]))
        )
    except UNREADABLE:
        return False


@contextlib.contextmanager
def changing(path: str | Path) -> Iterator[None]:
    """While a run is changed: others wait."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # no folder: open_run says so
            stack.enter_context(locked(Path(path)))
        yield


def make_current(path: str | Path, which: str) -> Version:
    """Make a version that there is, by its id or its name, the current one, as after an undo that was one too many.

    Nothing is fitted anew. Raises InputError, and changes nothing, where the run has none of that.
    """
    with changing(path):
        run = open_run(path)
        version = version_named(run, which)
        if version.identifier == run.current.identifier:
            return version
        try:
            if (run.path / MODELS / version.identifier).is_dir():
                write_whole(run.path / CURRENT, json_text({"model": version.identifier}) + "\n")
            else:  # the model of the run was never left and come back to
                (run.path / CURRENT).unlink()
        except OSError as error:
            raise InputError(f"cannot write to the run {run.path}: {error.strerror or error}") from None
        return version


def write_version(run: Run, version: Version, parameters: Mapping[str, Any], errors: Mapping[str, Any]) -> None:
    """Store a version with its ``learnt`` parameters, and make it the current one. InputError where that cannot be.

    One that comes back, as by an undo, keeps what it was made from, and its place in the history: a version that was
    made from its own descendant would send whoever follows the history round in a circle.
    """
    source = dict(version.aircraft.source)
    found = {p["name"]: p["value"] for p in parameters["parameters"]}
    fitted = {name: float(value) for name, value in found.items() if value is not None and np.isfinite(value)}
    source["coefficients"] = {**version.aircraft.coefficients, **fitted}
    content = {
        "model": version.identifier,
        "parents": list(version.parents),
        "changes": {label: change.json for label, change in version.changes.items()},
        "axes": errors,
    }
    models = run.path / MODELS
    try:
        models.mkdir(exist_ok=True)
        with tempfile.TemporaryDirectory(dir=run.path, prefix=".version.") as folder:
            new = Path(folder) / "new"
            new.mkdir()
            text = yaml.safe_dump(source, sort_keys=False, explicit_end=True)
            (new / AIRCRAFT).write_text(text, encoding="utf8")
            listed = {**parameters, "model": version.identifier}
            (new / PARAMETERS).write_text(json_text(listed) + "\n", encoding="utf8")
            (new / VERSION).write_text(json_text(content) + "\n", encoding="utf8")
            load_aircraft(new / AIRCRAFT)
            place = models / version.identifier
            if place.exists():  # it may be the current one: never a moment without it
                for name in (AIRCRAFT, PARAMETERS, *([] if _comes_back(place, content) else [VERSION])):
                    os.replace(new / name, place / name)
            else:
                new.rename(place)
            pointer = Path(folder) / CURRENT
            pointer.write_text(json_text({"model": version.identifier}) + "\n", encoding="utf8")
            os.replace(pointer, run.path / CURRENT)
    except OSError as error:
        raise InputError(f"cannot write to the run {run.path}: {error.strerror or error}") from None
