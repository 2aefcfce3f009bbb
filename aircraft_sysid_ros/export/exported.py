"""What every target returns, and the words that every file begins with."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from aircraft_sysid_ros.export.learnt_model import LearntModel, percent, range_words
from aircraft_sysid_ros.rounding import with_error

#: Losses and standard errors below this share are rounding.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Exported:
    """A file, and what it does not hold."""

    content: str | bytes
    #: By axis: rms difference of the coefficient over the flight's own rows, of the standard deviation of ours.
    lost: Mapping[str, float] = field(default_factory=dict)
    not_held: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def induced_drag_notes(efficiency: float) -> list[str]:
    """That lift makes less drag in the file, which no wing does; nothing where it does not."""
    if efficiency > 0.0:
        return []
    return [
        f"lift lowers drag in this file (an efficiency of {efficiency:.2g}), which no wing does: what the flight "
        "shows of C_X is not enough; fly several speeds with thrust measured, or put an efficiency of your own in "
        "its place"
    ]


def parameter_lines(learnt: LearntModel) -> list[str]:
    """The learnt parameters: name, value, standard error and status."""
    return [
        f"{p.name} = {with_error(p.value, p.std, '+-')} {p.status} {p.reason}".rstrip()
        if np.isfinite(p.value)
        else f"{p.name} is not known, so that its term is left out: {p.status} {p.reason}".rstrip()
        for p in learnt.parameters
    ]


def number_lines(values: Mapping[str, Any], std: Mapping[str, float]) -> list[str]:
    """The target's own numbers with the standard errors that follow from those of the parameters."""
    lines = ["Standard errors of the numbers below:"]
    known = {name: error for name, error in std.items() if error > ROUNDING * abs(values[name])}
    return lines + [f"  {name} = {with_error(values[name], error, '+-')}" for name, error in known.items()]


def comment_of(lines: list[str]) -> str:
    """Lines as a comment of XML, in which no two hyphens may follow each other."""
    return "\n" + re.sub("-(?=-)", "- ", "\n".join(lines)) + "\n"


def loss_line(lost: Mapping[str, float]) -> str:
    """What of each coefficient the formulas of a target miss."""

    def words(share: float) -> str:
        return "not known" if np.isnan(share) else percent(share if share > ROUNDING else 0.0)

    parts = (f"{axis} {words(share)}" for axis, share in lost.items())
    return "lost over the flight's own rows, of the spread of each coefficient: " + ", ".join(parts)


def header_lines(learnt: LearntModel, target: str, lost: Mapping[str, float], not_held: tuple[str, ...]) -> list[str]:
    """What a comment at the beginning of a file says, line by line."""
    lines = [
        f"{learnt.aircraft.name}, model {learnt.identifier}, learnt in flight; for {target}, by aircraft-sysid",
        "Learnt in this range. OUTSIDE OF IT THE MODEL IS NOT KNOWN TO HOLD:",
        *(f"  {line}" for line in range_words(learnt)),
        "Learnt parameters, body axes FRD, per rad, rates as p b/2V, q c/V, r b/2V, +- one standard error:",
        *(f"  {line}" for line in parameter_lines(learnt)),
    ]
    if lost:
        lines.append(loss_line(lost))
    return [*lines, *(f"Not held: {sentence}" for sentence in not_held)]
