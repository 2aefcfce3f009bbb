"""Units of columns, by pint: a text such as ``deg/s`` or ``°C`` to the line that converts it to SI."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import MissingExtra
from aircraft_sysid_ros.recordings.tabular.signals import near

#: Spellings of the trade that pint does not have, or has for something else.
_SPELLINGS = {
    "kts": "knot", "ktas": "knot", "kias": "knot", "kcas": "knot", "keas": "knot",
    "fps": "ft/s", "fpm": "ft/min", "ft/s/s": "ft/s^2", "m/s/s": "m/s^2", "m/s2": "m/s^2", "ft/s2": "ft/s^2",
    "mps": "m/s", "kph": "km/hour", "kmh": "km/hour", "km/h": "km/hour", "meters": "m", "metres": "m",
    "dps": "deg/s", "degs": "deg", "degrees": "deg", "deg/sec": "deg/s", "rad/sec": "rad/s", "m/sec": "m/s",
    "ft/sec": "ft/s", "rads": "rad", "°": "deg", "°/s": "deg/s", "º": "deg", "º/s": "deg/s",
    "c": "degC", "°c": "degC", "degc": "degC", "deg c": "degC", "ºc": "degC", "celsius": "degC",
    "f": "degF", "°f": "degF", "degf": "degF", "deg f": "degF", "ºf": "degF", "k": "kelvin",
    "°k": "kelvin", "deg r": "degR", "degr": "degR", "°r": "degR",
    "pct": "percent", "%": "percent", "lbs": "lb", "lbf": "lbf", "psf": "lbf/ft^2",
    "inhg": "inHg", "in hg": "inHg", "in-hg": "inHg", "mb": "mbar", "hpa": "hPa", "kpa": "kPa", "pa": "Pa",
    "mmhg": "mmHg",
    "sec": "s", "secs": "s", "seconds": "s", "msec": "ms", "usec": "us", "nsec": "ns", "hr": "hour",
    "hrs": "hour", "slug/ft3": "slug/ft^3", "kg/m3": "kg/m^3", "rev/min": "rpm", "rev/s": "turn/s", "rps": "turn/s",
    "r/min": "rpm", "u/min": "rpm", "tr/min": "rpm", "1/min": "rpm",
    "-": "1", "": "1", "none": "1", "nd": "1", "n/a": "1", "[-]": "1", "1": "1", "frac": "1", "fraction": "1",
    "degree": "deg", "degrees/s": "deg/s", "deg/s^2": "deg/s^2", "us": "us", "μs": "us", "µs": "us",
}  # fmt: skip
_GRAVITIES = {"g": 1.0, "gs": 1.0, "g's": 1.0, "gee": 1.0, "g0": 1.0, "gn": 1.0, "mg": 1e-3}
_COMMON = (
    "deg", "rad", "deg/s", "rad/s", "rpm", "m/s^2", "g", "ft/s^2", "m", "ft", "km", "m/s", "knot", "kt", "ft/s",
    "ft/min", "km/h", "mph", "Pa", "hPa", "kPa", "mbar", "psi", "psf", "inHg", "mmHg", "K", "degC", "degF", "kg/m^3",
    "slug/ft^3", "kg",
    "lb", "N", "lbf", "%", "s", "ms", "us", "ns", "min", "hour",
)  # fmt: skip
#: Units that are meant where they are in capitals, and not molars, siemens or nothing at all.
_IN_CAPITALS = frozenset({
    "M", "KM", "CM", "MM", "FT", "S", "MS", "MIN", "H", "HR", "HOUR", "KT", "KNOT", "KNOTS", "MPH", "DEG", "RAD", "REV",
    "RPM", "G", "KG", "LB", "LBF", "KGF", "SLUG", "PSI", "BAR", "MBAR",
})  # fmt: skip
_ALLOWED = re.compile(r"[\w\s°º%µμ./*^()²³⁻¹·'+-]{0,40}")
_NUMBER_FIRST = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*\*?\s*(?=[A-Za-z°º%µμ])")
_SUPERSCRIPTS = str.maketrans({"²": "^2", "³": "^3", "·": "*"})


@dataclass(frozen=True)
class Conversion:
    """SI value = ``factor`` times the column's number + ``shift``."""

    factor: float
    shift: float = 0.0

    def __call__(self, values: Any) -> Any:
        """The same for arrays."""
        return values * self.factor + self.shift if self.shift else values * self.factor


@cache
def _registry() -> Any:
    try:
        import pint
    except ImportError:
        raise MissingExtra("tables of other programs", "pint", "tables") from None
    return pint.UnitRegistry()


@cache
def conversion(unit: str, si_unit: str | None) -> Conversion:
    """From ``unit`` to ``si_unit``; None is any dimension, in SI base units.

    Raises InputError for what is no unit, or one of another dimension: an angle is not a number, and rpm no Hz.
    """
    scale, parsed = _parsed(unit, si_unit)
    registry = _registry()
    target = registry.Unit(_plain(si_unit)) if si_unit else _base_of(registry, parsed)
    if not _same_dimension(unit, si_unit):
        raise InputError(f"the unit '{unit}' does not fit: {_what_fits(si_unit or '1')}")
    zero, one = (float(registry.Quantity(value, parsed).to(target).magnitude) for value in (0.0, 1.0))
    if zero:
        return Conversion(scale * round(one - zero, 12), zero)
    return Conversion(scale * one)


def is_unit(text: str) -> bool:
    """Whether a text of a header reads as a unit."""
    text = text.strip().strip("[]()").strip()
    if not text or len(text) > 14:
        return False
    if text.lower() in _SPELLINGS or text.lower() in _GRAVITIES:
        return True
    try:
        _parsed(text, None)
    except InputError:
        return False
    return True


def dimension_fits(unit: str, si_unit: str) -> bool:
    """Whether ``unit`` is a unit of that dimension."""
    try:
        return _same_dimension(unit, si_unit)
    except InputError:
        return False


def _same_dimension(unit: str, si_unit: str | None) -> bool:
    """By pint's root units, which tell an angle from a number; raises InputError for what is no unit."""
    _, parsed = _parsed(unit, si_unit)
    registry = _registry()
    return si_unit is None or bool(_root(registry, parsed) == _root(registry, registry.Unit(_plain(si_unit))))


def _plain(si_unit: str) -> str:
    return "dimensionless" if si_unit == "1" else si_unit


def _parsed(unit: str, si_unit: str | None) -> tuple[float, Any]:
    """Number before the unit, and pint's unit."""
    text = " ".join(unit.split()).strip("[]").strip()
    lower = text.lower()
    registry = _registry()
    if lower in _GRAVITIES and si_unit in (None, "m/s^2") and not (lower == "mg" and si_unit is None):
        return _GRAVITIES[lower], registry.Unit("standard_gravity")
    number = _NUMBER_FIRST.match(text)
    scale = float(number.group(1)) if number else 1.0
    rest = text[number.end() :] if number else text
    in_capitals = _IN_CAPITALS.issuperset(re.findall("[^\\W\\d_]+", rest))
    spelt = _SPELLINGS.get(rest.lower(), rest.lower() if in_capitals else rest).translate(_SUPERSCRIPTS)
    if spelt == "1":
        return scale, registry.Unit("dimensionless")
    if not _ALLOWED.fullmatch(rest) or re.search(r"\d\s*(\*\*|\^)|(\*\*|\^)\s*\(?\s*-?\d{2}", spelt):
        raise InputError(f"'{unit[:40]}' is not a unit: write it like deg/s, m/s^2 or kt")
    try:
        return scale, registry.Unit(spelt)
    except Exception:  # pint raises all kinds, tokenize's and its own
        raise InputError(f"'{unit}' is not a unit: {near(rest, _COMMON)}") from None


def _root(registry: Any, unit: Any) -> Any:
    return registry.get_root_units(unit)[1]


def _base_of(registry: Any, unit: Any) -> Any:
    return registry.get_base_units(unit)[1]


def _what_fits(si_unit: str) -> str:
    """Units of that dimension, for a message."""
    if si_unit == "1":
        return "this has no dimension, write 1 or %"
    names = [name for name in _COMMON if dimension_fits(name, si_unit)]
    return f"this is in {si_unit}, or {', '.join(name for name in names if name != si_unit)}"


def time_in_nanoseconds(values: np.ndarray, unit: str) -> np.ndarray:
    """Times (n,) in a unit as whole nanoseconds; whole numbers stay exact."""
    factor = conversion(unit, "s").factor * 1e9
    if values.dtype.kind in "iu" and factor >= 1.0 and abs(factor - round(factor)) < 1e-6:
        return np.asarray(values.astype(np.int64) * round(factor))
    return np.round(values.astype(np.float64) * factor).astype(np.int64)
