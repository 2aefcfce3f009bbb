"""What is done to one flight: import, check, replay, compare and diagnose, by the functions of the commands.

The answer is numbers and words alone, so that it can be sent, and kept beside those of other flights.
"""

from __future__ import annotations

import hashlib
import json
import resource
import shutil
import socket
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.after_flight.check import CheckedRecording, check_recording
from aircraft_sysid_ros.after_flight.compare import compare_run
from aircraft_sysid_ros.after_flight.diagnose import diagnose
from aircraft_sysid_ros.after_flight.log_import import import_log, why_no_calibration
from aircraft_sysid_ros.after_flight.replay import ReplayOptions, replay
from aircraft_sysid_ros.after_flight.sensor_errors import sensor_errors
from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet.apart import Failed
from aircraft_sysid_ros.fleet.flights import AUTOPILOTS
from aircraft_sysid_ros.reconstruction.absences import NoAirspeedError
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.recordings.autopilot_bag_import import is_autopilot_bag
from aircraft_sysid_ros.recordings.losses import losses
from aircraft_sysid_ros.run_reader import AIRCRAFT, read_parameters, read_points, read_samples, read_state
from aircraft_sysid_ros.samples import first_and_last

#: Signals of the condition in which a parameter was learnt.
_CONDITION = ("V", "alpha")
_BLOCK = 1 << 20
#: In the folder of a flight: its run, and what a log was imported to.
_RUN, _IMPORTED = "run", "recording"
#: In a run that is kept: the key of the answer that it belongs to.
_KEY = "fleet.key"
#: How calm air is asked for here.
_CALM_AIR = "fly the fleet with --calm-air, or say calm_air: true of it in a list"
#: Folders of the program that have no part in an answer.
_NO_PART = ("commands", "consumer", "fleet", "nodes", "report", "simulation", "workbench")
Answer = dict[str, Any]


@dataclass(frozen=True)
class Options:
    """What is asked for of every flight."""

    replicas: int  # of the diagnosis; 0: there is none
    map: Path | None = None  # columns of tables
    servos: Path | None = None  # what the outputs of an autopilot mean
    calm_air: bool = False  # the speed over ground stands for an airspeed that is not measured

    @property
    def files(self) -> tuple[Path, ...]:
        """Files beside the recording that an answer rests on."""
        return tuple(path for path in (self.map, self.servos) if path is not None)


@dataclass(frozen=True)
class Job:
    """A flight to fly, or to look up by ``key``: that of all its answer rests on."""

    key: str
    recording: Path
    is_log: bool
    aircraft: Path
    options: Options
    program: str
    keep: Path | None = None  # where its run shall stay
    place: str = ""  # where the program is that the fleet was begun with


def content_key(paths: tuple[Path, ...], *more: str) -> str:
    """One text for the content of files and folders, wherever they lie, and for ``more``. Raises OSError."""
    whole = hashlib.sha256("\0".join(more).encode())
    for path in paths:
        for file in sorted(path.rglob("*")) if path.is_dir() else (path,):
            if not file.is_file():
                continue
            found = hashlib.sha256()
            with file.open("rb") as opened:
                while block := opened.read(_BLOCK):
                    found.update(block)
            whole.update(f"{file.relative_to(path) if path.is_dir() else ''}".encode() + found.digest())
    return whole.hexdigest()[:40]


@cache
def program_key() -> str:
    """One text for the program: the sources that answers rest on, so that none of another program is taken for ours."""
    package = Path(__file__).resolve().parents[1]
    whole = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        place = source.relative_to(package)
        if place.parts[0] not in _NO_PART or source == Path(__file__).resolve():
            whole.update(str(place).encode() + source.read_bytes())
    return whole.hexdigest()[:16]


@cache
def program_place() -> str:
    """Where the program is: machine and folder."""
    return f"{socket.gethostname()}:{Path(__file__).resolve().parents[1]}"


def _why_another(job: Job) -> str:
    """Why a worker has not the program that the fleet was begun with."""
    if job.place == program_place():
        place = Path(__file__).resolve().parents[1]
        return (
            f"the program in {place} has changed since the fleet began (it was edited or reinstalled), and answers of "
            "two programs are not mixed: start the same command again"
        )
    return "its worker has another version of the program: install the same one everywhere"


def answer_of(job: Job, folder: Path) -> Answer:
    """The answer about one flight; ``folder`` may be written to. Raises InputError where the flight has none."""
    try:
        answer = json.dumps(_answer_of(job, folder), ensure_ascii=False)  # what cannot be kept fails here
    except InputError as error:
        error.args = (_without(folder, str(error)),)
        raise
    found: Answer = json.loads(_without(folder, answer))
    return found


def _without(folder: Path, text: str) -> str:
    """Sentences that speak of the flight, and not of its place in a folder that is gone and is never twice the same."""
    for place in (folder / _RUN, folder / _IMPORTED):
        text = text.replace(str(place), "the flight")
    return text


def _answer_of(job: Job, folder: Path) -> Answer:
    if job.program != program_key():
        raise Failed(_why_another(job), lasting=False)
    recording, run, began = job.recording, folder / _RUN, _cpu()
    if not recording.exists():
        raise Failed(f"the worker finds no {recording}: recordings must be where all workers see them", lasting=False)
    found, recording, unread = _checked(job, folder / _IMPORTED)
    checked = found.json
    replay([str(recording)], job.aircraft, run, ReplayOptions(state=StateOptions(calm_air=job.options.calm_air)))
    answer: Answer = {"ok": True, "reason": "", "duration": checked["duration"], "findings": checked["findings"]}
    answer["losses"] = losses(found.notes)
    answer["start"] = first_and_last(read_samples(run).stamp)[0]
    answer["parameters"] = _parameters(run)
    reasons = [*answer["losses"], unread]
    answer["axes"], told = _tried(lambda: compare_run(run).json["axes"], "not compared", {})
    reasons.append(told)
    answer["diagnosis"] = None
    if job.options.replicas:
        answer["diagnosis"], told = _tried(lambda: _diagnosis(run, job.options.replicas), "not diagnosed", None)
        reasons.append(told)
    answer["sensors"] = sensor_errors(load_aircraft(run / AIRCRAFT), read_samples(run), read_state(run))
    reasons.append(_why_unused(read_parameters(run)))
    answer["reason"] = "; ".join(filter(None, reasons))
    keep_run(run, job)
    answer["cpu"] = _cpu() - began  # what the flight costs; in no table, since it is never twice the same
    return answer


def _checked(job: Job, imported: Path) -> tuple[CheckedRecording, Path, str]:
    """The check, its recording, and why the file of servos was not read; ``imported``: where a log becomes one.

    A bag is a recording, or, as for ``explain``, the log of an autopilot.
    """
    if not job.is_log:
        as_log = replace(job, is_log=True, options=replace(job.options, map=None))  # a map is for tables
        if _is_autopilot_bag(job.recording):
            return _checked(as_log, imported)
        try:
            checked = check_recording(job.recording, job.aircraft)
        except InputError as refused:
            try:
                return _checked(as_log, imported)
            except InputError:
                raise refused from None
        return checked, job.recording, _unread(job, "a recording itself holds its deflections")
    options, unread = _import_options(job)
    import_log(job.recording, imported, **options)
    return check_recording(imported, job.aircraft), imported, unread


def _is_autopilot_bag(recording: Path) -> bool:
    """Whether a recording is a bag of an autopilot's topics; of what cannot be read it says nothing."""
    try:
        return is_autopilot_bag(recording)
    except InputError:
        return False


def _import_options(job: Job) -> tuple[dict[str, Any], str]:
    """What of the options is for a log of this kind, and why the servos are not."""
    options, log = job.options, job.recording
    columns = options.map if log.suffix.lower() not in AUTOPILOTS else None
    found: dict[str, Any] = {} if columns is None else {"columns": columns}
    if options.servos is not None:
        why = why_no_calibration(log, columns)
        if why:
            return found, _unread(job, why)
        found["calibration"] = str(options.servos)
    return found, ""


def _unread(job: Job, why: str) -> str:
    """That the file of servos that was named for a flight is not read, and why."""
    return f"{job.options.servos.name} is not read: {why}" if job.options.servos is not None else ""


def _cpu() -> float:
    """Time [s] of the processor that this process and those that it waited for have used."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def _tried(work: Callable[[], Any], what: str, nothing: Any) -> tuple[Any, str]:
    """What a step finds, or nothing and why."""
    try:
        return work(), ""
    except NoAirspeedError as error:
        return nothing, f"{what}: {error.why}: {_CALM_AIR}"
    except InputError as error:
        return nothing, f"{what}: {error}"


def _why_unused(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """Of a flight that gives no parameter to USE, the reason that most of them have."""
    why = Counter(str(p["reason"]) for p in parameters.values())
    if not why or any(p["status"] == "USE" for p in parameters.values()):
        return ""
    return f"no parameter is to USE, most since: {why.most_common(1)[0][0]}"


def _parameters(run: Path) -> list[dict[str, Any]]:
    """Parameters with the mean condition of the samples that their axis was learnt from."""
    points = read_points(run)
    names = points["signal_names"].tolist()
    learnt = points.get("learnt", points["valid"])
    conditions = {}
    for k, axis in enumerate(AXES):
        signals = points["signals"][learnt[:, k]]
        conditions[axis] = {
            name: float(np.nanmean(signals[:, names.index(name)]))
            if name in names and np.isfinite(signals[:, names.index(name)]).any() else None
            for name in _CONDITION
        }  # fmt: skip
    return [
        {"name": name, **{key: p[key] for key in ("value", "std", "status")}, **conditions.get(name.split("_")[0], {})}
        for name, p in read_parameters(run).items()
    ]


def _diagnosis(run: Path, replicas: int) -> dict[str, Any]:
    found = diagnose([run], replicas)
    kept = ("effect", "label", "axes", "main_axis", "p_value", "error_before", "error_after", "confounded_with")
    candidates = [{key: c.get(key) for key in kept} for c in found["candidates"] if c["found"]]
    shown = {key: found.get(key) for key in ("verdict", "advice", "false_alarm_rate")}
    return {**shown, "candidates": candidates}


def keep_run(run: Path, job: Job) -> None:
    """Move the run to where the job keeps it, with the key of its answer in it; one that is there goes."""
    if (place := job.keep) is None:
        return
    (run / _KEY).write_text(job.key, encoding="utf8")
    place.parent.mkdir(parents=True, exist_ok=True)
    beside = place.with_name(f".{place.name}.new")
    for old in (beside, place):
        if old.exists():
            shutil.rmtree(old)
        if old is beside:
            shutil.move(run, beside)
    beside.rename(place)


def is_kept(job: Job) -> bool:
    """Whether the run of the job is where it shall stay: not that of another flight, or by another aircraft file."""
    try:
        return job.keep is None or (job.keep / _KEY).read_text(encoding="utf8") == job.key
    except (OSError, UnicodeDecodeError):
        return False
