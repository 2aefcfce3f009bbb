"""Names and units of signals and axes, for figures and for people."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape

from aircraft_sysid_ros.rounding import rounded_to_error

_DEGREES = 180.0 / np.pi


@dataclass(frozen=True)
class Quantity:
    """A signal for people: what it is called, its unit, and the factor from SI to it."""

    words: str
    unit: str
    factor: float = 1.0

    @property
    def title(self) -> str:
        """Name with unit."""
        return f"{self.words} [{self.unit}]"


SIGNAL_WORDS = {
    "alpha": Quantity("angle of attack α", "deg", _DEGREES),
    "beta": Quantity("sideslip β", "deg", _DEGREES),
    "p": Quantity("roll rate p b/2V", "-"),
    "q": Quantity("pitch rate q c/V", "-"),
    "r": Quantity("yaw rate r b/2V", "-"),
    "de": Quantity("elevator", "deg", _DEGREES),
    "da": Quantity("aileron", "deg", _DEGREES),
    "dr": Quantity("rudder", "deg", _DEGREES),
    "flaps": Quantity("flaps", "deg", _DEGREES),
    "Tc": Quantity("thrust coefficient", "-"),
    "throttle": Quantity("throttle", "-"),
    "propeller_speed": Quantity("propeller speed", "rad/s"),
    "V": Quantity("airspeed", "m/s"),
    "qbar": Quantity("dynamic pressure", "Pa"),
    "mach": Quantity("Mach number", "-"),
    "height": Quantity("height", "m"),
    "alpha_dot": Quantity("rate of α, α̇ c/V", "-"),
    "beta_dot": Quantity("rate of β, β̇ b/2V", "-"),
    "time": Quantity("time since the filter started", "s"),
}


def quantity_of(name: str) -> Quantity:
    """A signal, or an input that an aircraft file names, in words."""
    return SIGNAL_WORDS.get(name) or Quantity(name, "SI")


def symbol(axis: str) -> Markup:
    """C with its index, for HTML and plotly."""
    return Markup("C<sub>{}</sub>").format(axis[1])


#: What sentences hold that a page draws in another way: what is quoted as a command, names of parameters, symbols of
#: coefficients (C_m, C_m,q and Cm; but "CX: [1, alpha]" is for a file), T_c, powers of ten, and minus signs.
_DRAWN = re.compile(
    r"`(?P<command>[^`]+)`|(?<!\w)(?P<expression>'[^' ][^']*[*/+-][^']*')(?!\w)|\b(?P<parameter>C[XYZlmn]_\w+)"
    r"|\bC_?(?P<axis>[XYZlmn])(?P<by>,(?:alpha|beta|[pqr]|d[aer]))?\b(?!: \[)|\b(?P<thrust>T_c)\b"
    r"|10\^(?P<power>\d+)|(?P<minus>(?<![\w.,)/-])-(?=\d))|(?P<percent>(?<=\d)%)"
)
#: What stands for such bytes in Python, and halves of characters.
_HALVES = re.compile("[\ud800-\udfff]")
_POWERS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def typeset(text: str) -> Markup:
    """A sentence as a page shows it: C with its index for C_m, as beside it, and true minus signs."""
    parts, end = [], 0
    for found in _DRAWN.finditer(text):
        parts += [escape(text[end : found.start()]), _draw(found)]
        end = found.end()
    return Markup("").join([*parts, escape(text[end:])])


def _draw(found: re.Match[str]) -> Markup:
    if name := found["command"] or found["parameter"]:
        return Markup('<span class="mono">{}</span>').format(name)
    if found["expression"]:
        return escape(found["expression"])
    if found["axis"]:
        return Markup("C<sub>{}{}</sub>").format(found["axis"], found["by"] or "")
    if found["thrust"]:
        return Markup("T<sub>c</sub>")
    if found["power"]:
        return Markup("10") + found["power"].translate(_POWERS)
    return Markup("−" if found["minus"] else " %")


def rounded(value: float, std: float) -> tuple[str, str]:
    """A value and its standard error as ``rounded_to_error``, with a true minus."""
    shown, error = rounded_to_error(value, std)
    return shown.replace("-", "−"), error


def readable(text: str) -> str:
    """Text that a browser takes: the name of a folder from an older system may hold bytes that are no UTF-8."""
    return _HALVES.sub("\N{REPLACEMENT CHARACTER}", text)


def percent(share: float) -> str:
    """A share as a number of %, as the command line prints it."""
    return f"{100.0 * share:.1f}"


def sentence(text: str) -> str:
    """With a capital letter, the rest as it is: C_m stays C_m. What begins with a path or the name of a file stays."""
    first = text.partition(" ")[0].rstrip(".,:;").replace("-", "")
    return text[:1].upper() + text[1:] if first.isalpha() else text


def chance(p_value: float) -> str:
    """How likely the evidence is where nothing is missing, in words."""
    if p_value < 1e-6:
        return "less than 1 in 1 000 000"
    if p_value >= 0.5:
        return "more likely than not"
    least = 10.0 ** np.floor(-np.log10(p_value))
    count = np.floor(1.0 / p_value / least) * least
    return f"1 in {count:,.0f}".replace(",", " ")
