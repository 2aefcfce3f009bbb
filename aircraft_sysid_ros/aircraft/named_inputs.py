"""Further inputs of an aeroplane, by the names that its aircraft file gives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.expression import is_name, is_reserved
from aircraft_sysid_ros.aircraft.file_values import LEAST_NOISE, between, check_keys, positive, reject, rising
from aircraft_sysid_ros.aircraft.signals import MOST_INPUTS, SIGNALS
from aircraft_sysid_ros.errors import InputError, echo


@dataclass(frozen=True)
class NamedInput:
    """A further input of the aeroplane, as signal of model terms: one sigma of its noise, and what it can be, SI."""

    name: str
    factor: float = 1.0  # from the unit of the recording to SI
    noise: float = 0.002
    limits: tuple[float, float] = (-1.6, 1.6)  # what is outside is a fault of transmission


#: Units of named inputs: factor to SI, and by default one sigma of the noise and the largest magnitude, SI.
INPUT_UNITS: dict[str, tuple[float, float, float]] = {
    "rad": (1.0, 0.002, 1.6),
    "deg": (float(np.pi / 180.0), 0.002, 1.6),
    "1": (1.0, 0.01, 10.0),
    "N": (1.0, 1.0, 1e7),
    "rad/s": (1.0, 1.0, 1e5),
    "W": (1.0, 1.0, 1e9),
}


def inputs_of(data: Mapping[str, Any]) -> tuple[NamedInput, ...]:
    """The inputs in the order of the file. Raises InputError."""
    if len(data) > MOST_INPUTS:
        raise InputError(f"inputs are {len(data)}: at most {MOST_INPUTS} can be named, leave out what no term reads")
    return tuple(_input(str(name), value) for name, value in data.items())


def _input(name: str, value: Any) -> NamedInput:
    if is_reserved(name):
        raise InputError(f"the input '{echo(name)}' has a name that expressions already use: give it another one")
    if not is_name(name):
        raise InputError(f"the input '{echo(name)}' cannot be used in a term: name it with letters, digits and _")
    if name in SIGNALS:
        raise InputError(
            f"the input '{echo(name)}' has the name of a signal that there is already: give it another one"
        )
    value = {} if value is None else value
    if not isinstance(value, Mapping):
        reject(f"input {name}", "a mapping such as {unit: deg}", value)
    check_keys(value, ("unit", "noise", "limits"), f"key of input {name}:")
    unit = str(value.get("unit", "rad"))
    if unit not in INPUT_UNITS:
        raise InputError(f"input {name} has the unit '{echo(unit)}': use one of {', '.join(INPUT_UNITS)}")
    factor, noise, largest = INPUT_UNITS[unit]
    if value.get("noise") is not None:
        noise = factor * positive(value["noise"], f"the noise of input {name}")
        between(noise, f"the noise of input {name}", (LEAST_NOISE, 1e9), "in SI")
    limits = value.get("limits")
    if limits is None:
        return NamedInput(name, factor, noise, (-largest, largest))
    low, high = rising(limits, f"the limits of input {name}")
    return NamedInput(name, factor, noise, (factor * low, factor * high))
