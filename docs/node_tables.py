"""Tables of docs/nodes.md: the parameters of the nodes, from their descriptions in the code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.nodes import estimator_node, mavlink_bridge, parameter_estimator, state_estimator
from aircraft_sysid_ros.nodes.model_services import DIAGNOSIS_OPTIONS, DiagnosisOptions
from aircraft_sysid_ros.nodes.options import Option, When, described
from aircraft_sysid_ros.reconstruction.options import StateOptions

Table = tuple[list[str], list[list[str]]]

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


def allowed(option: Option) -> str:
    """Range or choices."""
    if option.choices:
        return ", ".join(option.choices)
    return "" if option.low is None else f"{option.low:g} to {option.high:g}"


def parameters(options: Mapping[str, tuple[Any, Option]]) -> Table:
    """One row for each parameter."""
    header = ["parameter", "default", "allowed", "takes effect", "meaning"]
    rows = [
        [f"`{name}`", written(default), allowed(option), WORDS[option.when], option.text]
        for name, (default, option) in options.items()
    ]
    return header, rows


STATE = described(StateOptions(), state_estimator.OPTIONS | state_estimator.SWITCHES)
PARAMETERS = described(ParameterOptions(), parameter_estimator.OPTIONS | parameter_estimator.SWITCHES)
TABLES: dict[str, Callable[[], Table]] = {
    "common": lambda: parameters(estimator_node.COMMON),
    "state": lambda: parameters(STATE),
    "parameters": lambda: parameters(PARAMETERS | described(DiagnosisOptions(), DIAGNOSIS_OPTIONS)),
    "bridge": lambda: parameters(mavlink_bridge.OPTIONS),
}
