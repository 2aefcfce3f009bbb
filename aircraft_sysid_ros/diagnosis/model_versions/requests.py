"""What the user names: an effect of the library, or terms with their axes."""

from __future__ import annotations

from collections.abc import Mapping

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, model_from_terms
from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import Effect
from aircraft_sysid_ros.errors import InputError, one_line
from aircraft_sysid_ros.spelling import did_you_mean

#: Names of other coefficients that have nearly the letters of an axis, in small letters: CL is lift and cl that of a
#: section, where Cl is the rolling moment; CN and cn are normal forces, where Cn is the yawing moment.
_OTHER_COEFFICIENTS = {
    "cl": "for lift write CZ, which is down and so minus the lift, and for the rolling moment Cl",
    "cn": "for the normal force write CZ, which is minus it, and for the yawing moment Cn",
    "cd": "for drag write CX, which is forward and so minus the drag",
    "ca": "for the axial force write CX, which is minus it",
}


def parse_request(text: str, inputs: tuple[str, ...] = ()) -> Effect | dict[str, tuple[str, ...]]:
    """An effect by its id, or canonical terms by axis from ``CZ: alpha**3`` (more axes after a semicolon).

    ``inputs``: names that the aircraft file gives to further signals.
    """
    text = one_line(text).strip()
    if text in BY_ID:
        return BY_ID[text]
    if not text:
        raise InputError("nothing is named: give an effect such as stall, or a term with its axis such as CZ: alpha**3")
    if ":" not in text:
        hint = did_you_mean(text.partition(" (")[0], BY_ID, 3) or "`aircraft-sysid add --help` lists them"
        hint = "" if set("*/^+") & set(text) else f", {hint.rstrip('?')}"  # an expression is no effect that is misspelt
        raise InputError(f"'{text[:60]}' is not an effect{hint}; a term is written with its axis, such as CZ: alpha**3")
    terms: dict[str, tuple[str, ...]] = {}
    for part in filter(None, map(str.strip, text.split(";"))):
        axis, _, expression = part.partition(":")
        axis = _axis_named(axis.strip())
        terms[axis] = (*terms.get(axis, ()), parse_expression(expression, inputs).text)
    model_from_terms(terms, inputs)  # twice the same
    return terms


def _axis_named(written: str) -> str:
    """The axis that is meant; of other letters than its own only where these mean nothing else in aeronautics."""
    name = written.replace("_", "")
    if name in AXES:
        return name
    if name.lower() in _OTHER_COEFFICIENTS:
        raise InputError(f"'{written[:30]}' is not an axis of the model: {_OTHER_COEFFICIENTS[name.lower()]}")
    found = {axis.lower(): axis for axis in AXES}.get(name.lower())
    if found is None:
        raise InputError(f"'{written[:30]}' is not an axis: the axes are {' '.join(AXES)}")
    return found


def label_of(terms: Mapping[str, tuple[str, ...]]) -> str:
    """Terms as the user writes them."""
    return "; ".join(f"{axis}: {text}" for axis, texts in terms.items() for text in texts)
