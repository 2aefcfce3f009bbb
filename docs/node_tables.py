"""Tables of docs/nodes.md and docs/aircraft-file.md: what can be set, from where it is declared in the code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from results import Rows

from aircraft_sysid_ros.aircraft.configuration import KEYS
from aircraft_sysid_ros.nodes import (
    estimator_node,
    mavlink_bridge,
    overview,
    parameter_estimator,
    px4_bridge,
    state_estimator,
)
from aircraft_sysid_ros.nodes.options import NodeOption, When

WORDS = {
    When.AT_ONCE: "at once",
    When.ACTIVATED: "activated",
    When.CONFIGURED: "configured",
    When.STARTED: "process starts",
}


def written(value: Any) -> str:
    """A value as it is typed, and nothing for an empty one."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return ", ".join(value)
    return f"{value:g}" if isinstance(value, float | int) else value


def allowed(option: NodeOption) -> str:
    """Range or choices."""
    if option.choices:
        return ", ".join(option.choices)
    return "" if option.low is None else f"{option.low:g} to {option.high:g}"


def parameters(options: Mapping[str, NodeOption]) -> Rows:
    """One row for each parameter."""
    header = ["parameter", "default", "allowed", "takes effect", "meaning"]
    rows = [
        [
            f"`{name}`",
            f"{written(option.default)} {option.unit}".strip(),
            allowed(option),
            WORDS[option.when],
            option.sentence,
        ]
        for name, option in options.items()
    ]
    return header, rows


def aircraft_keys() -> Rows:
    """The keys of the aircraft file."""
    between = {name: "{:.4g} to {:.4g}".format(*key.limits) if key.limits else "" for name, key in KEYS.items()}
    rows = [[f"`{name}`", key.meaning, key.unit, key.default, between[name]] for name, key in KEYS.items()]
    return ["key", "meaning", "unit", "default", "between"], rows


TABLES: dict[str, Callable[[], Rows]] = {
    "common": lambda: parameters(estimator_node.COMMON),
    "state": lambda: parameters(state_estimator.OPTIONS),
    "parameters": lambda: parameters(parameter_estimator.OPTIONS),
    "bridge": lambda: parameters(mavlink_bridge.OPTIONS),
    "px4": lambda: parameters(px4_bridge.OPTIONS),
    "overview": lambda: parameters(overview.OPTIONS),
}
