"""Maximum likelihood on a version of a run, kept beside its aircraft file."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.after_flight.progress import Tell, nobody
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS, late_words
from aircraft_sysid_ros.diagnosis.model_versions.versions import (
    Version,
    folder_to_write,
    open_run,
    run_data,
    version_named,
)
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.identification.conditions import listed
from aircraft_sysid_ros.refinement.refine import Refinement, RefineOptions, refine, with_options
from aircraft_sysid_ros.refinement.refined_file import FILTER_ERROR, METHODS, OTHERWISE, refined_name
from aircraft_sysid_ros.refinement.run_data import RunData
from aircraft_sysid_ros.run_writer import write_json

#: Draws a refinement into a file under a title; returns the file and no note, or None and why there is none.
Draw = Callable[[Path, Refinement, str], tuple[str | None, list[str]]]


def refine_run(
    path: str | Path, draw: Draw, method: str = FILTER_ERROR, model: str | None = None, segment: float | None = None,
    tell: Tell = nobody,
) -> dict[str, Any]:  # fmt: skip
    """Refine and write; returns the content of the file with its path.

    ``model``: id or name of a version, by default the current one; ``segment``: seconds in one piece. Raises
    InputError.
    """
    if method not in METHODS:
        raise InputError(f"{echo(method)} is not a method of refine: it has {' and '.join(METHODS)}")
    options = with_options(RefineOptions(), segment)
    opened = open_run(path)
    version = opened.current if model is None else version_named(opened, model)
    tell(method, 0.0)
    data, folder = run_data(opened, version), folder_to_write(opened, version)
    data, late = with_late_surfaces(data, opened.late_surfaces(version.aircraft))
    started = time.perf_counter()
    result = refine(
        data, method, options,
        lambda iteration, cost: tell(f"{method}, cost {cost:.1f}", iteration / options.maximum_iterations),
    )  # fmt: skip
    content = {**_about(version, opened.current), **result.content, "elapsed": time.perf_counter() - started}
    file = folder / refined_name(method)
    title = f"{method}: {data.aircraft.name}, model {version.identifier}"
    figure, notes = draw(file.with_suffix(".png"), result, title)
    write_json(file, content)
    stays = f"`export` and `gains` take the parameters of the run, and not those of {file.name}"
    return {**content, "file": str(file), "figure": figure, "notes": [*opened.notes, *late, *notes, stays]}


def with_late_surfaces(data: RunData, late: Mapping[str, tuple[float, float]]) -> tuple[RunData, list[str]]:
    """The run with the delay or the lag [s] of its surfaces that the flight has shown, and a note.

    ``replay`` has freed its parameters of it, and a fit of the recorded surfaces would lose that.
    """
    if not late:
        return data, []
    aircraft = data.aircraft
    for key, (value, _) in late.items():
        aircraft = with_setting(aircraft, ("sensors", CONTROLS, key), value)
    return replace(data, aircraft=aircraft), [f"{late_words(late)}, as the flight shows: state what is known"]


def _about(version: Version, current: Version) -> dict[str, Any]:
    """Which model is refined."""
    is_current = version.identifier == current.identifier
    return {"model": version.identifier, "changes": list(version.changes), "is_current": is_current}


def refined_sentences(result: dict[str, Any]) -> list[str]:
    """How the work ended, and whether its numbers are to be used."""
    ending = "converged" if result["converged"] else f"NOT CONVERGED: {result['reason']}"
    sentences = [
        f"{ending} after {result['iterations']} iterations, {result['seconds_fitted']:.0f} s of flight fitted in "
        f"{result['elapsed']:.0f} s"
    ]
    if result["worse"]:
        axes = " ".join(f"C_{axis[1]}" for axis in result["worse"])
        sentences.append(
            f"WORSE THAN BEFORE: where nothing was fitted, {axes} predicted worse than with the parameters that it "
            "began with. The model seems to lack something, see aircraft-sysid diagnose RUN: do not use the refined "
            "values"
        )
    other = [found["name"] for found in result["parameters"] if found["reason"].startswith(f"{OTHERWISE} ")]
    if other:
        sentences.append(
            f"{listed(other)} of the run do not agree with this fit beyond the errors of both: use neither value. "
            "`export` and `gains` take those of the run with HOLD"
        )
    return sentences
