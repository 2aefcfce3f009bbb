"""What servo outputs in an autopilot's tables mean: deflections by its calibration file, and pulses without one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from aircraft_sysid_ros.mavlink.servo_mapping import MIXING, MOTORS, Output, ServoMapping
from aircraft_sysid_ros.recordings.tabular.column_expression import quoted
from aircraft_sysid_ros.recordings.tabular.guess.known_line import KnownLine

#: Column of output 1, 2 … of a table, by what its topic is, and whether these are commands from -1 to 1.
_PULSES = {"rc-out": "field.channels{}", "actuator_outputs": "output[{}]", "ACTUATORS": "{}"}
_COMMANDS = {"actuator_servos": "control[{}]", "actuator_motors": "control[{}]"}
_FIRST = {"ACTUATORS": 1}  # number of the column of the first output; 0 in the others
_MOST = 16


def uncalibrated(topic: str) -> list[KnownLine]:
    """The outputs of a topic as inputs of their own, in the log's own numbers."""
    if topic in _PULSES:
        name, why = "pulse", "a pulse [us], no angle: --servos says what it moves"
    else:
        name, why = topic.removeprefix("actuator_").rstrip("s"), "-1 to 1, no angle: --servos says what it moves"
    return [
        KnownLine(f"inputs.{name}_{i + 1}", _column(topic, i), "1", why=why, unless_zero=True) for i in range(_MOST)
    ]


def calibrated(
    mapping: ServoMapping, columns_of: Mapping[str, Sequence[str]]
) -> tuple[dict[str, list[KnownLine]], list[str]]:
    """Lines by topic of the outputs that a calibration file names, and what a table lacks for them.

    ``columns_of``: columns of the tables by topic. A control comes from one topic alone.
    """
    topics = _COMMANDS if mapping.normalised else _PULSES
    there = {topic: columns_of[topic] for topic in topics if topic in columns_of}
    parts: dict[tuple[str, str, str], list[str]] = {}
    lost = []
    for number, output in mapping.outputs.items():
        found = _place(number, there)
        if found is None:
            lost.append(f"output {number} ({output.surface or output.input}) has no column: what it moves is not known")
            continue
        topic, column = found
        deflection = _interpolated(column, output)
        if output.input:
            parts[topic, f"inputs.{output.input}", _unit(output)] = [deflection]
        for control, share in MIXING.get(output.surface, {}).items():
            term = deflection if share == 1.0 else f"{share:+g}*({deflection})"
            parts.setdefault((topic, control, _unit(output)), []).append(term)
    whole = _whole(mapping, there)
    lines: dict[str, list[KnownLine]] = {}
    for (topic, signal, unit), terms in parts.items():
        if signal.startswith("inputs.") or signal in whole:
            text = " ".join(terms).removeprefix("+")
            lines.setdefault(topic, []).append(KnownLine(signal, "", unit, expression=text, why="calibration file"))
    return lines, lost


def outputs_topic(table: str, pattern: str) -> str | None:
    """The topic of a table of outputs, by its name; None of others."""
    topics = (*_PULSES, *_COMMANDS)
    return next((topic for topic in topics if re.search(pattern.format(re.escape(topic)), table)), None)


def _column(topic: str, index: int) -> str:
    return {**_PULSES, **_COMMANDS}[topic].format(index + _FIRST.get(topic, 0))


def _place(number: int, there: Mapping[str, Sequence[str]]) -> tuple[str, str] | None:
    """Topic and column of an output."""
    motor = number in MOTORS
    for topic, columns in there.items():
        column = _column(topic, number - (MOTORS[0] if motor else 1))
        if (topic == "actuator_motors") == motor and column in columns:
            return topic, column
    return None


def _whole(mapping: ServoMapping, there: Mapping[str, Sequence[str]]) -> set[str]:
    """Controls of which no output is missing."""
    lacking = {
        control
        for number, output in mapping.outputs.items()
        if _place(number, there) is None
        for control in MIXING.get(output.surface, {})
    }
    return {control for mixed in MIXING.values() for control in mixed} - lacking


def _unit(output: Output) -> str:
    return "1" if output.surface == "throttle" else "rad"


def _interpolated(column: str, output: Output) -> str:
    """A table of points as an expression: linear between them, held beyond the ends."""
    name = quoted(column)
    slopes = np.diff(output.values) / np.diff(output.points)
    bends = [0, *(np.flatnonzero(np.abs(np.diff(slopes)) > 1e-9 * np.abs(slopes[1:])) + 1), len(slopes)]
    text = f"{output.values[0]:.9g}"
    for first, last in pairwise(bends):
        low, high = output.points[first], output.points[last]
        text += f" {slopes[first]:+.9g}*(max({low:g}, min({high:g}, {name})) - {low:g})"
    return text
