"""Values out of a file that a user wrote: checked, and where one is wrong a sentence that says what to write."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np

from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.spelling import did_you_mean, nearest

#: Less noise than this has no sensor: the square of it must be a number beside others.
LEAST_NOISE = 1e-9
#: Known keys that a message lists; of more it shows the nearest.
_MOST_LISTED, _NEAREST = 25, 3


def check_keys(data: Mapping[str, Any], known: tuple[str, ...], kind: str) -> None:
    """Raises InputError for a key that is not ``known``; ``kind``: what it is a key of, in words."""
    for key in data:
        if key not in known:
            raise InputError(f"unknown {kind} '{echo(str(key))}': {_hint(str(key), known)}")


def _hint(key: str, known: tuple[str, ...]) -> str:
    """What may have been meant."""
    if hint := did_you_mean(key, known, quote="'"):
        return hint
    if len(known) <= _MOST_LISTED:
        return f"known are {', '.join(known)}"
    near = nearest(key, known, _NEAREST, 0.0)
    return f"the nearest are {', '.join(near)}; names are axis and term, as in the table that replay prints"


def reject(what: str, wanted: str, value: Any) -> NoReturn:
    """Raise InputError that shows the value if it is a short one: a list may hold itself."""
    if isinstance(value, (list, tuple, set)):
        shown = "a list"
    elif isinstance(value, Mapping):
        shown = "a mapping"
    elif value is None:
        shown = "nothing"
    elif isinstance(value, bool):
        shown = str(value).lower()  # YAML's yes and no, too
    else:
        shown = f"'{echo(str(value))}'"
    raise InputError(f"{what} must be {wanted}, not {shown}")


def mapping_of(data: Mapping[str, Any], key: str, example: str) -> Mapping[str, Any]:
    """An optional mapping; one that is not there is empty. Raises InputError with an example."""
    value = data.get(key)
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        reject(key, f"a mapping such as {example}", value)
    return value


def number_of(value: Any, what: str) -> float:
    """A finite number. Raises InputError; ``what`` it is, in words."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        reject(what, "a number", value)
    try:
        number = float(value)  # PyYAML reads 1e-3 as text
    except ValueError:
        reject(what, "a number", value)
    except OverflowError:
        number = np.inf
    if not np.isfinite(number):
        reject(what, "a finite number", number)
    return number


def said_or_found(value: Any, what: str, example: str, also: str = "") -> tuple[float, float]:
    """A number and one sigma: 0 where it is said, else that of one that was found, such as "0.40 ± 0.02".

    ``also``: what else there may be, in words. Raises InputError.
    """
    found, sign, sigma = value.partition("±") if isinstance(value, str) else (value, "", "0")
    try:
        parts = (float(found), float(sigma)) if sign else (number_of(found, what), 0.0)
    except ValueError:
        raise InputError(f"{what} must be a number, {also}or an estimated one, as {example}") from None
    if not np.isfinite(parts).all() or not parts[1] >= 0.0:
        raise InputError(f"{what} must be a finite number, and what follows ± must be 0 or more")
    return parts


def positive(value: Any, what: str) -> float:
    """A number above 0. Raises InputError."""
    found = number_of(value, what)
    if found <= 0.0:
        raise InputError(f"{what} must be positive, not {found:g}")
    return found


def between(number: float, what: str, limits: tuple[float, float] | None, unit: str) -> float:
    """A number inside limits in a unit. Raises InputError."""
    if limits is not None and not limits[0] <= number <= limits[1]:
        raise InputError(
            f"{what} must be between {limits[0]:g} and {limits[1]:g} {unit}".rstrip() + f", not {number:g}"
        )
    return number


def rising(value: Any, what: str) -> tuple[float, float]:
    """Two numbers, the second larger. Raises InputError."""
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        reject(what, "two numbers [lowest, highest]", value)
    low, high = (number_of(v, what) for v in value)
    if low >= high:
        raise InputError(f"{what} must rise, not go from {low:g} to {high:g}")
    return low, high
