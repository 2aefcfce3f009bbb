"""The picture of a check: when each sensor speaks, which parameters the flight shows and why, and what is wrong."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from aircraft_sysid_ros.flight_check.check import Checked, nothing_wrong
from aircraft_sysid_ros.flight_check.finding import ERROR, INFO, WARNING, short_names
from aircraft_sysid_ros.flight_check.identifiable import EXCITATION, Identifiability
from aircraft_sysid_ros.flight_check.signals import Flight, Stream, signal_names
from aircraft_sysid_ros.report.pyplot import pyplot
from aircraft_sysid_ros.stretches import stretches

# Okabe and Ito: told apart by the colour-blind.
_SHOWN, _NOT_SHOWN, _SENSOR, _AIR = "#009E73", "#E69F00", "#0072B2", "#56B4E9"
_SEVERITY = {ERROR: "#D55E00", WARNING: "#8A6100", INFO: "#666666"}
#: Range of the bars: the motion of a term over its noise.
_LEAST, _MOST = 0.1, 1000.0
#: Findings that are written, and letters to a line.
_FINDINGS, _LETTERS = 11, 112


def check_figure(checked: Checked, path: str | Path | BinaryIO, title: str) -> None:
    """Write the picture as PNG to a file or an open one. Raises MissingExtra without matplotlib."""
    plt = pyplot()

    figure = plt.figure(figsize=(16, 10.5), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.05), height_ratios=(1, 0.9))
    _sensors(figure.add_subplot(grid[0, 0]), checked)
    _findings(figure.add_subplot(grid[1, 0]), checked)
    _parameters(figure.add_subplot(grid[:, 1]), checked.parameters)
    figure.suptitle(title)
    figure.savefig(path, dpi=110, format="png")
    plt.close(figure)


def _sensors(plot: Any, checked: Checked) -> None:
    """A row for each sensor with its rate: filled where it speaks, open in its gaps."""
    flight, motion = checked.motion.flight, checked.motion
    for begin, end in stretches(motion.in_air):
        plot.axvspan(begin * motion.grid.step, end * motion.grid.step, color=_AIR, alpha=0.18, lw=0)
    labels = []
    for row, (label, stream) in enumerate(_rows(flight)):
        plot.broken_barh(_spans(stream), (row - 0.36, 0.72), color=_SENSOR)
        labels.append(label)
    plot.set_yticks(range(len(labels)), labels, fontsize=8)
    plot.invert_yaxis()
    plot.set_xlim(0.0, max(flight.duration, 1e-3))
    plot.set_xlabel("time of the recording [s]")
    plot.set_title("when each sensor speaks; shaded: in the air", loc="left", fontsize=10)


def _rows(flight: Flight) -> list[tuple[str, Stream]]:
    rows = []
    for stream in flight.every_stream:
        names = tuple(name for name, _ in signal_names(stream))
        if names and len(stream.time) > 1:
            text = textwrap.shorten(short_names(names), 44, placeholder=" …")
            rows.append((f"{text}  {stream.rate:.3g} Hz", stream))
    return rows


def _spans(stream: Stream) -> list[tuple[float, float]]:
    """Stretches (begin, length) [s] without a gap."""
    breaks = np.flatnonzero(np.diff(stream.time) > 2.5 * stream.interval)
    begins = stream.time[np.concatenate([[0], breaks + 1])]
    ends = stream.time[np.concatenate([breaks, [len(stream.time) - 1]])]
    return [(float(a), max(float(b - a), stream.interval)) for a, b in zip(begins, ends, strict=True)]


def _findings(plot: Any, checked: Checked) -> None:
    plot.axis("off")
    plot.set_title("what was found, the worst first", loc="left", fontsize=10)
    y, written = 0.99, 0
    if all(finding.severity == INFO for finding in checked.findings):
        plot.text(0.0, y, nothing_wrong(checked.motion.flight.duration), va="top", transform=plot.transAxes)
        y -= 0.08
    for finding in checked.findings[:_FINDINGS]:
        text = f"{finding.severity}, {finding.kind}: {short_names(finding.signals)}: {finding.sentence}"
        lines = textwrap.wrap(text, _LETTERS)
        plot.text(
            0.0, y, "\n".join(lines), va="top", fontsize=7.5, color=_SEVERITY[finding.severity],
            transform=plot.transAxes,
        )  # fmt: skip
        y -= 0.036 * len(lines) + 0.022
        written += 1
        if y < 0.05:
            break
    if len(checked.findings) > written:
        more = f"and {len(checked.findings) - written} more, see the answer of the command"
        plot.text(0.0, max(y, 0.0), more, va="top", fontsize=7.5, transform=plot.transAxes)


def _parameters(plot: Any, parameters: tuple[Identifiability, ...]) -> None:
    """A bar for each parameter: how far its term alone moves over its noise; the colour says whether it is shown."""
    for row, parameter in enumerate(parameters):
        size = float(np.clip(np.nan_to_num(parameter.excitation), _LEAST, _MOST))
        plot.barh(row, size - _LEAST, left=_LEAST, color=_SHOWN if parameter.is_shown else _NOT_SHOWN, height=0.7)
        plot.text(_MOST * 1.15, row, parameter.reason, va="center", fontsize=7.5)
    plot.axvline(EXCITATION, color="#000000", lw=1.0, ls="--")
    plot.set_xscale("log")
    plot.set_xlim(_LEAST, _MOST * 6000.0)
    plot.set_xticks([0.1, 1.0, 10.0, 100.0, 1000.0])
    plot.set_yticks(range(len(parameters)), [p.name for p in parameters], fontsize=8)
    plot.set_ylim(len(parameters) - 0.4, -0.6)
    plot.set_xlabel("motion of the term alone over its noise; dashed: needed")
    shown = sum(p.is_shown for p in parameters)
    plot.set_title(
        f"parameters that this flight shows: {shown} of {len(parameters)} (green); orange: not, and why", loc="left",
        fontsize=10,
    )  # fmt: skip
