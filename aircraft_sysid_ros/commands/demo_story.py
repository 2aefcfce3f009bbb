"""What ``demo`` tells of a run: where the live model fails, which effect is missing, and that the error falls with it.

The steps are those of ``compare``, ``diagnose``, ``add``, and ``replay`` with the new model, with the same functions.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.commands.compare import percent
from aircraft_sysid_ros.commands.options import parameter_table
from aircraft_sysid_ros.commands.progress import progress_bar
from aircraft_sysid_ros.diagnosis.compare import Comparison, compare
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight
from aircraft_sysid_ros.diagnosis.model_versions.additions import Outcome, add
from aircraft_sysid_ros.diagnosis.model_versions.versions import Run, open_run
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import COUNT
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.model_file import parameters_json
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.report.figures import load_points, nrmse
from aircraft_sysid_ros.samples import Samples
from aircraft_sysid_ros.simulation.truth_files import true_values

Array = npt.NDArray[np.float64]

STORY, FIGURE = "story.json", "story.png"
#: Places of failure that are told.
_PLACES = 4
#: Width of the text.
_WIDTH = 110


@dataclass(frozen=True)
class Story:
    """One run before and after what was found in it was added."""

    before: Comparison
    diagnosis: Mapping[str, Any]  # as of ``diagnose --json``
    additions: tuple[Outcome, ...]
    after: Comparison
    flown: Mapping[str, float]  # error of the live model by axis, see ``flown_errors``
    flown_again: Mapping[str, float]  # the same of the last model
    parameters: list[dict[str, Any]]  # of the last model, learnt in the same flight, as in parameters.json

    @property
    def failing_axis(self) -> str:
        """The axis that is furthest above its noise floor with the first model."""
        axes = self.before.axes
        return max(axes, key=lambda name: axes[name].fit.nrmse_held_out / axes[name].floor.nrmse)

    @property
    def errors(self) -> dict[str, dict[str, float]]:
        """error_before and error_after on held-out flight, noise_floor, flown_before and flown_after by axis."""
        both = [name for name in AXES if name in self.before.axes and name in self.after.axes]
        return {
            name: {
                "error_before": self.before.axes[name].fit.nrmse_held_out,
                "error_after": self.after.axes[name].fit.nrmse_held_out,
                "noise_floor": self.after.axes[name].floor.nrmse,
                "flown_before": self.flown[name],
                "flown_after": self.flown_again[name],
            }
            for name in both
        }


def tell(path: str | Path, say: Callable[[str], None], replicas: int = COUNT) -> Story:
    """Compare a run, diagnose it, add what is missing, fly it again; ``say`` hears each step in words.

    Raises InputError where the run cannot be compared or diagnosed.
    """
    run = open_run(path)
    if run.samples is None:
        raise InputError(f"{path} holds no samples to diagnose from")
    with progress_bar() as progress:
        bar = progress.add_task("compare", total=1.0)

        def show(what: str, share: float) -> None:
            progress.update(bar, description=what, completed=share)

        flown = _flown_live(path)
        before = compare(run.flight())
        _say_all(say, "compare: where does the live model fail?", _failure(before, flown))
        diagnosis = diagnose_flight(run.current.aircraft, run.samples, replicas=replicas, progress=show).json
        _say_all(say, "diagnose: which effect is missing?", _verdict(diagnosis))
        additions = tuple(_add(path, c, say, show) for c in diagnosis["candidates"] if c["found"])
        show("compare", 1.0)
        again, parameters = _learn(open_run(path), run.samples)
        return Story(before, diagnosis, additions, compare(open_run(path).flight()), flown, again, parameters)


def _add(
    path: str | Path, candidate: Mapping[str, Any], say: Callable[[str], None], show: Callable[[str, float], None]
) -> Outcome:
    what = candidate["effect"] or candidate["expression"]
    outcome = add(path, what, lambda share: show(f"add {what}", share))
    _say_all(say, f"add {what}", iter([outcome.verdict]))
    return outcome


def _learn(run: Run, samples: Samples) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """The flight once more through the live chain with the current model: its errors, and what it learns."""
    pipeline = Pipeline(run.current.aircraft)
    parts = [pipeline.push(samples)[1], pipeline.flush()[1]]
    points = np.vstack(parts)
    errors = flown_errors(
        points[:, CoefficientSample.TIME],
        points[:, CoefficientSample.MEASURED],
        points[:, CoefficientSample.PREDICTED],
        points[:, CoefficientSample.VALID] > 0.0,
    )
    return errors, parameters_json(pipeline.parameters)["parameters"]


def _flown_live(path: str | Path) -> dict[str, float]:
    points = load_points(path)
    return flown_errors(points["time"], points["measured"], points["predicted"], points["valid"])


def flown_errors(time: Array, measured: Array, predicted: Array, valid: npt.NDArray[np.bool_]) -> dict[str, float]:
    """NRMSE by axis of what was predicted before it was learnt from, in the second half of the flight.

    time (n,) [s]; measured, predicted and valid (n, 6).
    """
    late = time > 0.5 * (time[0] + time[-1]) if len(time) else time > 0.0
    errors = np.where(valid, predicted, np.nan)[late]
    return {axis: nrmse(measured[late, i], errors[:, i]) for i, axis in enumerate(AXES)}


def _say_all(say: Callable[[str], None], headline: str, lines: Iterator[str]) -> None:
    say(headline)
    for line in lines:
        for part in textwrap.wrap(line.replace(" %", "\u00a0%"), _WIDTH):
            say(f"  {part}")


def _failure(comparison: Comparison, flown: Mapping[str, float]) -> Iterator[str]:
    if not comparison.worst:
        yield "nowhere more than noise"
    for name in dict.fromkeys(place.axis for place in comparison.worst):
        axis, symbol = comparison.axes[name], _symbol(name)
        left, noise = percent(axis.fit.nrmse_held_out), percent(axis.floor.nrmse)
        yield (
            f"{symbol}: predicted live with an error of {percent(flown[name])} % of its spread; the best that this "
            f"model can do on held-out flight is {left} %, and noise is {noise} %"
        )
    for place in comparison.worst[:_PLACES]:
        yield f"{place.text}: {place.excess:.0f} times the noise"


def _verdict(diagnosis: Mapping[str, Any]) -> Iterator[str]:
    if diagnosis["verdict"] == "none":
        yield diagnosis["advice"]
    for candidate in diagnosis["candidates"]:
        if candidate["found"]:
            fall = f"{percent(candidate['error_before'])} to {percent(candidate['error_after'])} %"
            what = f"{candidate['name']}, {candidate['effect'] or 'not in the library'}"
            yield f"{what}: with it the held-out error of {_symbol(candidate['main_axis'])} falls from {fall}"
            if candidate["physics"]:
                yield candidate["physics"]
            yield f"evidence in {candidate['where']}"
            if candidate["confounded_with"]:
                yield f"this flight cannot tell it from {', '.join(candidate['confounded_with'])}"


def _symbol(axis: str) -> str:
    return f"C_{axis[1]}"


def story_json(story: Story, truth: Mapping[str, Any]) -> dict[str, Any]:
    """The story for programs, judged against the truth."""
    values = true_values(truth)
    found = [c for c in story.diagnosis["candidates"] if c["found"]]
    judged = [p for p in story.parameters if p["name"] in values and p["value"] is not None and p["std"]]
    within = sum(abs(p["value"] - values[p["name"]]) <= 3.0 * p["std"] for p in judged)
    return {
        "hidden": [effect["effect"] for effect in truth["hidden"]],
        "found": [c["effect"] or c["expression"] for c in found],
        "verdict": story.diagnosis["verdict"],
        "names": [c["name"] for c in found],
        "failing_axis": story.failing_axis,
        "where": [place.text for place in story.before.worst[:_PLACES]],
        "evidence": [{key: c[key] for key in ("evidence", "p_value", "confounded_with", "where")} for c in found],
        "axes": story.errors,
        "model": story.additions[-1].version.identifier if story.additions else None,
        "aircraft": story.after.flight.aircraft.name,
        "duration": truth["duration"],
        "parameters": [{**p, "truth": values.get(p["name"])} for p in story.parameters],
        "new_parameters": [p["name"] for outcome in story.additions for p in outcome.parameters],
        "within_3_standard_errors": within,
        "judged": len(judged),
    }


def story_text(told: Mapping[str, Any]) -> Iterator[str]:
    """Lines for people: hidden and found, errors, parameters."""
    yield f"hidden in this flight  {', '.join(told['hidden']) or 'nothing'}"
    yield f"found by the program   {', '.join(told['found']) or 'nothing'}"
    yield ""
    yield "error in % of the spread of each coefficient, before and after the addition"
    header = f"{'':<6}{'on held-out flight':>22}{'live':>18}{'noise':>8}"
    yield header
    yield f"{'axis':<6}{'before':>13}{'after':>9}{'before':>10}{'after':>8}"
    yield "-" * len(header)
    for name, e in told["axes"].items():
        yield (
            f"{_symbol(name):<6}{percent(e['error_before']):>13}{percent(e['error_after']):>9}"
            f"{percent(e['flown_before']):>10}{percent(e['flown_after']):>8}{percent(e['noise_floor']):>8}"
        )
    yield ""
    yield parameter_table(told["parameters"], {p["name"]: p["truth"] for p in told["parameters"]})
    yield ""
    within, judged = told["within_3_standard_errors"], told["judged"]
    yield f"{within} of {judged} parameters are within three standard errors of the truth."
