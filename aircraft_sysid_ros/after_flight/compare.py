"""The model of a run against its measurements, and two runs side by side."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.after_flight.progress import Tell, nobody, part_of
from aircraft_sysid_ros.aircraft.sensor_settings import late_words
from aircraft_sysid_ros.diagnosis.compare import Comparison, compare
from aircraft_sysid_ros.diagnosis.frequency_responses import RateResponse, rate_responses
from aircraft_sysid_ros.diagnosis.model_versions.versions import Run, open_run, version_named
from aircraft_sysid_ros.diagnosis.two_runs import SideBySide, side_by_side
from aircraft_sysid_ros.errors import InputError


@dataclass(frozen=True)
class ComparedRun:
    """A run, and how good its current model is."""

    run: Run
    comparison: Comparison

    @cached_property
    def responses(self) -> list[RateResponse]:
        """Frequency responses of the rates, which need no model."""
        return rate_responses(self.comparison.flight)

    @property
    def notes(self) -> list[str]:
        """What a user should know of the numbers."""
        notes = [*self.run.notes, *self.comparison.notes]
        if self.run.samples is None:
            unsmoothed = "errors are those of the filter, start-up included"
            notes.append(f"the run holds no samples: {unsmoothed}; replay the recording again")
        if late := self.run.late_surfaces(self.run.current.aircraft):
            notes.append(
                f"{late_words(late)}, as the flight shows, but are used here as recorded: part of the error above the "
                "noise is that; diagnose says how late they are, and add corrects it"
            )
        return notes

    @property
    def json(self) -> dict[str, Any]:
        """What ``compare --json`` prints, with the model."""
        responses = [response.json for response in self.responses]
        told = {**self.comparison.json, "frequency_responses": responses, "notes": self.notes}
        return {"model": self.run.current.identifier, **told}


def compare_run(path: str | Path, tell: Tell = nobody) -> ComparedRun:
    """How good the current model of a run is on flight that it was not fitted to. Raises InputError."""
    return _compared(open_run(path), tell)


def compare_runs(path: str | Path, other: str | Path, tell: Tell = nobody) -> tuple[ComparedRun, SideBySide]:
    """The first run by itself, and beside ``other``: a run, or the id of another version of the first one.

    Raises InputError.
    """
    run = open_run(path)
    beside = _run_beside(run, other)
    first, second = (_compared(each, part_of(tell, at, at + 0.5)) for each, at in ((run, 0.0), (beside, 0.5)))
    return first, side_by_side((first.run, second.run), (first.comparison, second.comparison))


def _run_beside(run: Run, other: str | Path) -> Run:
    """Another run by its path, or this one with another version. Raises InputError."""
    if Path(other).exists() or Path(other).name != str(other):
        return open_run(other)
    try:
        return replace(run, current=version_named(run, str(other)))
    except InputError as error:
        raise InputError(f"there is no run {other}, and {error}") from None


def _compared(run: Run, tell: Tell) -> ComparedRun:
    tell("reconstruct the flight", 0.0)
    flight = run.flight()
    tell("compare", 0.6)
    return ComparedRun(run, compare(flight))
