"""The aeroplane at a glance: from what the nodes publish, one tree of statuses, worst first in words.

Levels are those of diagnostic_msgs/DiagnosticStatus. A branch is as bad as its worst leaf, but for parameters: some
are held in every flight, and one that is rejected does not ground the aeroplane.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from aircraft_sysid_ros.rounding import fixed, with_error

OK, WARN, ERROR, STALE = 0, 1, 2, 3
#: Of `status` of a parameter: words and level.
TRUST = {0: ("USE", OK), 1: ("HOLD", WARN), 2: ("REJECT", ERROR)}
#: What AircraftState.status says where nothing is wrong, and where the aeroplane flies with less than it could.
_WAITING, _FINE = 0, (1,)
_DEGREES = 180.0 / math.pi
_IMU = "imu"
#: Of each kind of sample in the diagnostics of the first step: [Hz], [s].
_OF_RATES = ("rate", "largest_gap")


@dataclass(frozen=True)
class Leaf:
    """One status; ``path`` is relative to the aeroplane, parts apart by /, empty for the aeroplane itself."""

    path: str
    level: int
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


def state_leaf(state: Any) -> Leaf:
    """Of an AircraftState."""
    contradicted, status = divmod(state.status, 16)
    level = ERROR if contradicted else OK if status in _FINE else WARN
    roll, pitch, yaw = (angle * _DEGREES for angle in state.euler)
    numbers = {
        "true_airspeed [m/s]": f"{state.true_airspeed:.2f}",
        "angle_of_attack [deg]": fixed(state.angle_of_attack * _DEGREES, 2),
        "sideslip [deg]": fixed(state.sideslip * _DEGREES, 2),
        "roll, pitch, yaw [deg]": f"{fixed(roll, 1)} {fixed(pitch, 1)} {yaw % 360.0:.1f}",
        "height [m]": fixed(-state.position_ned[2], 1),
        "wind NED [m/s]": " ".join(fixed(value, 2) for value in state.wind_ned),
        "innovation_consistency": f"{state.innovation_consistency:.2f}",
        "fused, rejected, late": f"{state.fused} {state.rejected} {state.late}",
    }
    known = {name: value for name, value in numbers.items() if "nan" not in value}
    return Leaf("state", level, state.status_text or "ok", known)


def sensor_leaves(values: Mapping[str, str], before: Mapping[str, str]) -> list[Leaf]:
    """Of two diagnostics of `state_estimator`, newer and older: which sensors come, and what becomes of samples."""
    kinds = sorted(name.removesuffix(".received") for name in values if name.endswith(".received"))
    found = []
    if _IMU not in kinds:
        found.append(Leaf(f"sensors/{_IMU}", STALE, "nothing has come, and without it there is no state"))
    for kind in kinds:
        counts = {
            name: _whole(values, f"{kind}.{name}")
            for name in ("received", "fused", "rejected", "late", "invalid", "wrong_stamp")
        }
        news = {name: count - _whole(before, f"{kind}.{name}") for name, count in counts.items()}
        level, message = OK, "ok"
        if news["received"] <= 0 and before:
            level, message = STALE, "nothing comes"
        else:
            wrong = {name: news[name] for name in ("rejected", "late", "invalid", "wrong_stamp") if news[name] > 0}
            if wrong and 2 * sum(wrong.values()) > news["received"]:
                told = ", ".join(f"{count} {name}" for name, count in wrong.items())
                level, message = WARN, f"of {news['received']} samples: {told}"
        shown = {name: str(count) for name, count in counts.items() if count}
        shown |= {name: values[key] for name in _OF_RATES if (key := f"{kind}.{name}") in values}
        found.append(Leaf(f"sensors/{kind}", level, message, shown))
    return found


def parameter_leaves(parameters: Any) -> list[Leaf]:
    """Of a message Parameters: a branch in words, and each parameter."""
    leaves = []
    for p in parameters.parameters:
        word, level = TRUST.get(p.status, ("unknown", ERROR))
        shown = with_error(p.value, p.standard_deviation) if math.isfinite(p.value) else "never learnt"
        reason = f": {p.reason}" if p.reason else ""
        leaves.append(Leaf(f"parameters/{p.name}", level, f"{word} {shown}{reason}"))
    counts = {word: sum(leaf.message.startswith(word) for leaf in leaves) for word, _ in TRUST.values()}
    message = ", ".join(f"{count} {word}" for word, count in counts.items() if count) or "none"
    branch = Leaf("parameters", OK if counts["USE"] else WARN, message, {"model": parameters.model})
    return [branch, *leaves]


def model_leaves(errors: Any) -> list[Leaf]:
    """Of a message ModelError: how well each axis is predicted."""
    return [
        Leaf(
            f"model/{axis.axis}",
            OK,
            "no prediction yet" if not math.isfinite(axis.nrmse) else f"NRMSE {axis.nrmse:.3f}",
            {"white": str(axis.white).lower(), "window [s]": f"{errors.window:g}"},
        )
        for axis in errors.axes
    ]


def missing_leaf(missing: Any) -> Leaf:
    """Of a message MissingEffects."""
    values = {
        candidate.effect or candidate.expression: f"error {candidate.error_before:.3f} -> {candidate.error_after:.3f}"
        for candidate in missing.candidates
    }
    level = OK if missing.verdict in ("", "none") else WARN
    words = {
        "": "not looked for yet",
        "none": "nothing seems to be missing",
        "unexplained": "something is missing that no effect explains",
    }
    first = next(iter(values), "")
    return Leaf("missing effects", level, words.get(missing.verdict, f"missing: {first}"), values)


def node_leaf(name: str, level: int, message: str, values: Mapping[str, str]) -> Leaf:
    """Of the diagnostics of a node."""
    return Leaf(f"nodes/{name}", level, message, values)


def absent_leaf(name: str) -> Leaf:
    """Of a node that has not been heard at all."""
    return Leaf(f"nodes/{name}", STALE, "it is not heard: is it started, and in this namespace?")


def tree(leaves: Iterable[Leaf], aeroplane: str) -> list[Leaf]:
    """All leaves, and above them each branch and the aeroplane, with paths from the root: /aeroplane/sensors/imu."""
    there = {leaf.path: leaf for leaf in leaves}
    for branch in sorted({path.rsplit("/", 1)[0] for path in there if "/" in path} - there.keys()):
        there[branch] = _worst(branch, [leaf for path, leaf in there.items() if path.startswith(f"{branch}/")])
    top = _worst("", [leaf for path, leaf in there.items() if "/" not in path])
    return [
        Leaf("/" + "/".join(filter(None, (aeroplane, leaf.path))), leaf.level, leaf.message, leaf.values)
        for leaf in (top, *(there[path] for path in sorted(there)))
    ]


def _worst(path: str, leaves: list[Leaf]) -> Leaf:
    """A branch with the level and the words of the worst of its leaves; what is stale goes before what is wrong."""
    rank = (OK, WARN, ERROR, STALE)
    if not leaves:
        return Leaf(path, STALE, "nothing comes")
    worst = max(leaves, key=lambda leaf: rank.index(leaf.level))
    if worst.level == OK:
        return Leaf(path, OK, "ok")
    return Leaf(path, worst.level, f"{worst.path.rsplit('/', 1)[-1]}: {worst.message}")


def _whole(values: Mapping[str, str], name: str) -> int:
    text = values.get(name, "0")
    return int(text) if text.isdecimal() else 0
