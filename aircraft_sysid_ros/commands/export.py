"""``export``: the model of a run as a file of another program, with standard errors and the range it was learnt in.

What the other program cannot hold is said, with how much of each coefficient is lost by it: docs/export.md.
"""

from __future__ import annotations

import argparse
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS, late_words
from aircraft_sysid_ros.commands.notes import note_lines
from aircraft_sysid_ros.commands.options import parameter_table
from aircraft_sysid_ros.diagnosis.model_versions.versions import Run, open_run, settings_of, version_named
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.export.exported import loss_line
from aircraft_sysid_ros.export.from_run import learnt_model
from aircraft_sysid_ros.export.learnt_model import LearntModel, range_words
from aircraft_sysid_ros.export.targets import LEAST, TARGETS, Target, flown_deflections, version_of
from aircraft_sysid_ros.identification.coefficients.as_loaded import recorded_mass_properties
from aircraft_sysid_ros.identification.conditions import listed
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.text_file import write_new, write_whole

_FULL = "degrees of elevator, aileron and rudder at full command, such as 25,20,30"
_LARGEST_DEFLECTION = 90.0  # [deg]
_SURFACES = ("elevator", "aileron", "rudder")

#: A surface goes no further than at full command, times this.
_OVER = 1.25
#: Mass and inertia that differ by less than this share are the same, and so are places within so many metres.
_SAME_MASS, _SAME_PLACE = 0.005, 0.001


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "export", help="the model of a run as a file of another program", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", help="folder written by replay or live")
    parser.add_argument("--to", required=True, choices=tuple(TARGETS), help="the program")
    endings = ", ".join(f"{target.suffix} for {name}" for name, target in TARGETS.items())
    parser.add_argument("--out", required=True, metavar="PATH", help=f"file to write: {endings}")
    versions = "; ".join(f"{name}: {', '.join(target.versions)}" for name, target in TARGETS.items())
    parser.add_argument("--target-version", metavar="VERSION", help=f"version of its format ({versions})")
    add_model_options(parser)
    return parser


def add_model_options(parser: argparse.ArgumentParser) -> None:
    """What ``export`` and ``gains`` share."""
    parser.add_argument("--model", metavar="ID", help="id of the model version (default: the current one)")
    parser.add_argument("--full-deflection", metavar="E,A,R", help=_FULL)
    parser.add_argument("--overwrite", action="store_true", help="replace a file that is there")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Write the file; returns what it holds and what not. Raises InputError."""
    target, version = TARGETS[args.to], version_of(args.to, args.target_version)
    out, full = checked_out(args.out, target.suffix, args.overwrite), full_deflection(args.full_deflection)
    opened = open_run(args.run)
    learnt = chosen_model(opened, args.model)
    check_travel(learnt, full)
    exported = target.write(learnt, full, version)
    write(out, exported.content, args.overwrite)
    return {
        **about(learnt),
        "target": args.to,
        "target_version": version,
        "file": str(out),
        "lost": dict(exported.lost),
        "not_held": list(exported.not_held),
        "notes": [
            *notes_on(opened, learnt),
            *_late_notes(opened, learnt),
            *travel_notes(learnt, full, target),
            *exported.notes,
        ],
    }


def _late_notes(opened: Run, learnt: LearntModel) -> list[str]:
    """That surfaces follow what moves them later than the other program has it."""
    if not (late := late_of(opened, learnt)):
        return []
    return [
        f"{late}: the coefficients are for the true surface positions, and the file does not hold this delay; "
        "give the servos of the other program the same"
    ]


def travel_notes(learnt: LearntModel, full: npt.NDArray[np.float64] | None, target: Target) -> list[str]:
    """That a flight has had to say how far the surfaces go."""
    if full is not None or not target.is_commanded:
        return []
    flown = dict(zip(_SURFACES, flown_deflections(learnt), strict=True))
    moved = [f"{name} {np.degrees(most):.1f}" for name, most in flown.items() if most >= LEAST]
    still = [name for name, most in flown.items() if most < LEAST]
    parts = [f"the largest deflection that was flown, {', '.join(moved)} deg"] if moved else []
    parts += [f"{np.degrees(LEAST):.0f} deg for the {listed(still)}, which went less far"] if still else []
    return [f"no --full-deflection: full command is {', and '.join(parts)}; give what is there"]


def chosen_model(opened: Run, identifier: str | None) -> LearntModel:
    """The model of a run by its id, or the current one. Raises InputError."""
    return learnt_model(opened, opened.current if identifier is None else version_named(opened, identifier))


def about(learnt: LearntModel) -> dict[str, Any]:
    """The model as every answer has it."""
    return {
        "model": learnt.identifier,
        "parameters": [
            {"name": p.name, "value": p.value, "std": p.std, "status": p.status, "reason": p.reason}
            for p in learnt.parameters
        ],
        "ranges": {name: list(limits) for name, limits in learnt.ranges.items()},
        "range_words": range_words(learnt),
    }


def notes_on(opened: Run, learnt: LearntModel) -> list[str]:
    """What the user should know of a run and of the parameters that are exported."""
    notes = list(opened.notes)
    doubtful = [p.name for p in learnt.parameters if p.status != Trust.USE.name and p.value]
    unknown = [p.name for p in learnt.parameters if not np.isfinite(p.value)]
    if doubtful := [name for name in doubtful if name not in unknown]:
        by = "by the judgement of the run or of refine"
        notes.append(f"not to be used {by}, and exported all the same: {' '.join(doubtful)}")
    if unknown:
        notes.append(f"not known, so without their terms: {' '.join(unknown)}")
    notes += _mass_notes(opened, learnt)
    if settings_of(learnt.aircraft) != settings_of(opened.root):
        notes.append("ranges are those of the run as it was replayed, before the settings of this version")
    return notes


def _mass_notes(opened: Run, learnt: LearntModel) -> list[str]:
    """That a recording has had other mass properties than the aircraft file says."""
    mine, filed, of_mass = learnt.aircraft, opened.root, ""
    masses = np.array([]) if opened.samples is None else recorded_mass_properties(opened.samples)[:, 0]
    known = masses[np.isfinite(masses)]
    if len(known) and known.max() > (1.0 + _SAME_MASS) * known.min():
        of_mass = f", the middle of {known.min():.4g} to {known.max():.4g} kg"
    places = (mine.aerodynamic_reference, filed.aerodynamic_reference)
    other = {
        f"mass ({mine.mass:.4g} kg{of_mass}; the file says {filed.mass:.4g} kg)":
            bool(of_mass) or not np.isclose(mine.mass, filed.mass, rtol=_SAME_MASS),
        "inertia": not np.allclose(mine.inertia, filed.inertia, rtol=_SAME_MASS),
        "centre of gravity": not np.allclose(*places, rtol=0.0, atol=_SAME_PLACE),
    }  # fmt: skip
    words = [what for what, differs in other.items() if differs]
    return [f"as in the recording, and not as in the aircraft file: {listed(words)}"] if words else []


def late_of(opened: Run, learnt: LearntModel) -> str:
    """How late surfaces are, as the flight has shown or as the aircraft file says, in words; empty: they are not.

    Positions that are recorded late say nothing of the servos.
    """
    surfaces = learnt.aircraft.sensors[CONTROLS]
    said = {key: (value, 0.0) for key in ("delay", "lag") if (value := getattr(surfaces, key))}
    shown = opened.late_surfaces(learnt.aircraft) or said
    late = {key: number for key, number in shown.items() if key == "lag" or number[0] < 0.0}
    return late_words(late) if late else ""


def checked_out(path: str, suffix: str, overwrite: bool) -> Path:
    """The file to write. Raises InputError where it cannot be, or is there already."""
    out = Path(path)
    if out.suffix.lower() != suffix:
        raise InputError(f"--out {path}: give it a name that ends in {suffix}")
    if not out.parent.is_dir():
        what = "is not a folder" if out.parent.exists() else "is not there: make the folder first"
        raise InputError(f"--out {path}: {out.parent} {what}")
    if out.is_dir() or (os.path.lexists(out) and not overwrite):
        what = (
            "is a folder: give another name" if out.is_dir() else "is already there: give another name or --overwrite"
        )
        raise InputError(f"--out {path} {what}")
    return out


def full_deflection(text: str | None) -> npt.NDArray[np.float64] | None:
    """(3,) [rad] of --full-deflection. Raises InputError."""
    if text is None:
        return None
    try:
        degrees = [float(part) for part in text.split(",")]
    except ValueError:
        degrees = []
    if len(degrees) != 3 or not all(math.isfinite(d) and 0.0 < d <= _LARGEST_DEFLECTION for d in degrees):
        within = f"above 0 and at most {_LARGEST_DEFLECTION:g}"
        raise InputError(f"--full-deflection {text[:40]}: give three {_FULL}, {within}")
    return np.radians(degrees)


def check_travel(learnt: LearntModel, full: npt.NDArray[np.float64] | None) -> None:
    """Raises InputError where surfaces went further in the flight than at full command: those are no degrees."""
    if full is None:
        return
    for name, flown, most in zip(_SURFACES, *np.degrees([flown_deflections(learnt), full]), strict=True):
        if flown > _OVER * most:
            raise InputError(
                f"--full-deflection says {most:.3g} deg of {name} at full command, but it reached {flown:.3g} deg in "
                "this flight: give degrees, and the full travel"
            )


def write(out: Path, content: str | bytes, overwrite: bool) -> None:
    """All of it or nothing; nothing over a file that has come meanwhile. Raises InputError."""
    try:
        (write_whole if overwrite else write_new)(out, content)
    except OSError as error:
        raise InputError(f"cannot write {out}: {error.strerror or error}") from None


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    lines = [f"model {result['model']}", "", parameter_table(result["parameters"]), ""]
    lines += ["learnt in this range; OUTSIDE OF IT THE MODEL IS NOT KNOWN TO HOLD:"]
    lines += [f"  {line}" for line in result["range_words"]]
    if result["lost"]:
        lines.append(loss_line(result["lost"]))
    lines += [f"not held: {sentence}" for sentence in result["not_held"]]
    lines += note_lines(result["notes"])
    return "\n".join([*lines, f"{result['target']} {result['target_version']}: {result['file']}"])
