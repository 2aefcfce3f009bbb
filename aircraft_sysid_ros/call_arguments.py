"""What the calls of ``api`` are given, checked: a path, an aeroplane, options; InputError says what is meant."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.option import OptionError, options_of
from aircraft_sysid_ros.reconstruction.options import StateOptions

Place = str | Path


def place_of(given: Place, words: str = "a path") -> Path:
    if not isinstance(given, str | Path):
        raise InputError(f"give {words}, and not {echo(repr(given))}")
    if not str(given).strip():
        raise InputError(f"give {words}, and not an empty text")
    return Path(given)


def aircraft_of(given: Place | Mapping[str, Any] | Aircraft) -> Aircraft:
    if isinstance(given, Aircraft):
        return given
    if isinstance(given, Mapping):
        return aircraft_from_dict(given)
    return load_aircraft(place_of(given, "an aircraft file, or its content"))


def text_path(given: Place | None) -> str | None:
    """The path of a file that may be left out."""
    return None if given is None else str(place_of(given))


def text_of(given: str) -> str:
    if not isinstance(given, str):
        raise InputError(f'give an effect by its id, or terms such as "CZ: alpha**3", and not {echo(repr(given))}')
    return given


def options_by_name(given: Mapping[str, Any]) -> tuple[StateOptions, ParameterOptions]:
    """Options of both steps by name. Raises InputError for one that is none, or makes no sense."""
    of_state, of_parameters = options_of(StateOptions), options_of(ParameterOptions)
    unknown = [name for name in given if name not in of_state and name not in of_parameters]
    if unknown:
        raise InputError(f"'{unknown[0]}' is not an option of replay: it has {', '.join([*of_state, *of_parameters])}")
    known = {"measured_angles": not given.get("air_data_errors", False), **given}
    try:
        state = StateOptions(**{name: value for name, value in known.items() if name in of_state})
        return state, ParameterOptions(**{name: value for name, value in known.items() if name in of_parameters})
    except OptionError as error:
        raise InputError(f"{error.name} {error.what}") from None
