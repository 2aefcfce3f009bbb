"""What is said of any flight: inputs that failed, then everything else that it allows.

Without vanes, and without airspeed more so, the angles of flow are inferred, and few effects can be told by them. What
can be told all the same is whether the inputs act (``failures``); where one does not, that is the answer, since it
would look like many other effects. With vanes that is asked of an engine whose thrust nobody measured; the library
judges the rest, or the forces where commands are too slow for it. Where the flight allows no search of the library, the
answer says why.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS
from aircraft_sysid_ros.diagnosis.failures.failure import FailureReport
from aircraft_sysid_ros.diagnosis.failures.failures import by_forces, failures_of, has_vanes
from aircraft_sysid_ros.diagnosis.failures.words import notes_of, report_json
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight, has_found_lag
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.diagnosis.several_runs import join_runs
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import COUNT
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.pace import (
    why_airspeed_too_slow,
    why_controls_too_slow,
    why_too_slow,
)
from aircraft_sysid_ros.reconstruction.absences import assumed_calm, has_airspeed, options_after_flight
from aircraft_sysid_ros.samples import Kind, Samples

#: Said where surfaces come at another time than they are recorded.
LATE_SURFACES = (
    "surfaces do not move when they are recorded: a delay fits that better than a servo lag does, but may stand for "
    "more than a delay, so that a rate limit, free play and rates of the flow angles are not looked for besides; "
    "record deflections, or state `lag` of control_surfaces, the time constant of the servos, in "
    "the aircraft file"
)
#: Said where the flight has shown the lag of the servos, and where it is another one than the aircraft file states.
FOUND_LAG = (
    "servos follow the records with a lag that was found in this flight: a rate limit and free play are not looked "
    "for besides; with `lag` of control_surfaces in the aircraft file they are"
)
OTHER_LAG = (
    "servos follow the records with another lag than the aircraft file states, which the steps of slow records can "
    "cause, too: a rate limit and free play are not looked for besides"
)


def diagnose_run(
    folder: str | Path, replicas: int = COUNT, progress: Callable[[str, float], None] = lambda what, share: None
) -> tuple[dict[str, Any], Path]:
    """The answer about the current version of a run, with its ``model``, and the run's folder. Raises InputError."""
    run = open_run(folder)
    if run.samples is None:
        raise InputError(f"{folder} holds no samples to diagnose from: replay the recording again")
    found = answer(
        run.current.aircraft, run.samples, run.calm_air, replicas, progress, run.manoeuvres, zero=run.zero
    )  # fmt: skip
    return {"model": run.current.identifier, **found}, run.path


def diagnose_runs(
    folders: Sequence[str | Path],
    replicas: int = COUNT,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> dict[str, Any]:
    """The answer about several runs of one aeroplane as one body, with what changed between them. Raises InputError."""
    body = join_runs(folders)
    found = answer(body.aircraft, body.samples, body.calm_air, replicas, progress, body.manoeuvres, body.names)
    return {"model": body.model, "runs": list(body.names), **found}


def answer(
    aircraft: Aircraft,
    samples: Samples,
    calm_air: bool = False,
    replicas: int = COUNT,
    progress: Callable[[str, float], None] = lambda what, share: None,
    names: Sequence[str] = (),
    runs: Sequence[str] = (),
    zero: int | None = None,
) -> dict[str, Any]:
    """What ``diagnose --json`` prints. Raises InputError where nothing can be said.

    ``calm_air``: as when the flight was replayed. ``names`` are those of manoeuvres that were joined, ``runs`` of runs.
    ``zero``: stamp [ns] from which times that forces alone tell count; None: from the first sample of the IMU.
    """
    options_after_flight(samples, calm_air)
    notes = assumed_calm(samples, calm_air)
    report = by_forces(aircraft, samples, lambda share: progress("check the inputs", share), zero)
    if report is not None and report.says_something:
        notes.append("the library was not searched: what failed or changed would look like other effects")
        return report_json(report, notes)
    if has_vanes(samples):
        report = None  # the library judges the rest
    if report is not None and not has_airspeed(samples):
        notes.append("the library was not searched: without airspeed its effects cannot be told from wind")
        return report_json(report, notes)
    try:
        found = diagnose_flight(aircraft, samples, replicas=replicas, progress=progress, names=names, runs=runs)
    except InputError as error:
        report = report or _of_all_inputs(aircraft, samples, zero)
        if report is None:
            raise
        return report_json(report, [*notes, f"the library was not searched: {error}"])
    said = [*notes, *found.flight.notes, *([] if report is None else notes_of(report))]
    said += [LATE_SURFACES] if found.flight.has_late_surfaces else []
    if has_found_lag(found.settings):
        said.append(OTHER_LAG if aircraft.sensors[CONTROLS].lag > 0.0 else FOUND_LAG)
    return {**found.json, "notes": said}


def _of_all_inputs(aircraft: Aircraft, samples: Samples, zero: int | None) -> FailureReport | None:
    """What forces say of a flight with vanes whose commands are too slow for the library; None where it is another."""
    too_slow = why_controls_too_slow(samples) and not (why_too_slow(samples) or why_airspeed_too_slow(samples))
    if np.any(samples.kind == Kind.SEAM) or not too_slow:
        return None
    try:
        return failures_of(aircraft, samples, zero=zero)
    except InputError:
        return None
