"""Runs of one aeroplane as one body of evidence: their samples are joined, with a seam between one run and the next.

Whatever the aircraft file says must be the same in all, and the model is that of their current versions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.diagnosis.model_versions.versions import Run, open_run, settings_of
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.samples import Samples, joined, manoeuvres, same_imu, with_run_numbers

#: Keys in which the files of one aeroplane may differ: no number of a diagnosis rests on them.
_OF_NO_MATTER = ("name", "parameter_bounds", "prior", "trim_airspeed")


@dataclass(frozen=True)
class JoinedRuns:
    """Several runs, in the order given."""

    aircraft: Aircraft  # of the current versions
    model: str  # their id
    samples: Samples
    calm_air: bool
    names: tuple[str, ...]  # of the runs
    manoeuvres: tuple[str, ...]  # of what lies between two seams, in order


def join_runs(folders: Sequence[str | Path]) -> JoinedRuns:
    """Open runs and join them. Raises InputError where one is no run, or they are not of one aeroplane and model."""
    paths = [Path(folder) for folder in folders]
    for first, second in combinations(paths, 2):
        if first.resolve() == second.resolve():
            raise InputError(f"the run {second} is given twice: name it once")
    runs = [open_run(path) for path in paths]
    parts = [_samples_of(run) for run in runs]
    for run in runs[1:]:
        _check_same_aeroplane(runs[0], run)
    for (first, a), (second, b) in combinations(zip(paths, parts, strict=True), 2):
        if same_imu(a, b):
            raise InputError(f"the runs {first} and {second} hold the same IMU samples: give one of them")
    known = [path.resolve().name for path in paths]
    names = tuple(name if known.count(name) == 1 else str(path) for name, path in zip(known, paths, strict=True))
    body = with_run_numbers(joined(parts)[0], [len(part) for part in parts])
    current = runs[0].current
    between = tuple(
        text for run, name, part in zip(runs, names, parts, strict=True) for text in _named(run, name, part)
    )
    return JoinedRuns(current.aircraft, current.identifier, body, runs[0].calm_air, names, between)


def _samples_of(run: Run) -> Samples:
    if run.samples is None:
        raise InputError(f"{run.path} holds no samples to diagnose from: replay the recording again")
    return run.samples


def _named(run: Run, name: str, samples: Samples) -> Iterator[str]:
    """The run, or each of its manoeuvres."""
    count = len(manoeuvres(samples))
    for number in range(count):
        known = run.manoeuvres[number] if number < len(run.manoeuvres) else f"manoeuvre {number + 1}"
        yield name if count == 1 else f"{name}, {known}"


def _check_same_aeroplane(first: Run, other: Run) -> None:
    """Raises InputError, which names what differs."""
    difference = next(_differences(settings_of(first.current.aircraft), settings_of(other.current.aircraft)), None)
    if difference is not None:
        raise InputError(
            f"{first.path} and {other.path} are not runs of one aeroplane: {difference}; replay both with one aircraft "
            "file"
        )
    ours, theirs = first.current, other.current
    if ours.aircraft.model.terms != theirs.aircraft.model.terms:
        raise InputError(
            f"{other.path} has the model {theirs.identifier}, and {first.path} has {ours.identifier}: give them "
            "the same model with add and remove"
        )
    if first.calm_air != other.calm_air:
        raise InputError(f"one of {first.path} and {other.path} was replayed with --calm-air: replay both alike")


def _differences(a: Mapping[str, Any], b: Mapping[str, Any], within: str = "") -> Iterator[str]:
    """What two aircraft files say differently, by key."""
    for key in [*a, *(key for key in b if key not in a)]:
        one, other, name = a.get(key), b.get(key), f"{within}{key}"
        if one == other or name in _OF_NO_MATTER:
            continue
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            yield from _differences(one, other, f"{name}.")
        else:
            yield f"{name} is {_said(one)} in one and {_said(other)} in the other"


def _said(value: Any) -> str:
    return "not given" if value is None else str(value)[:60]
