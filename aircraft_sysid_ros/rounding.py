"""Values as their standard errors let them be read."""

from __future__ import annotations

import math

#: Places before or after the point beyond which a number is written with an exponent.
_MOST_PLACES = 7
_UNKNOWN = "–"


def rounded_to_error(value: float, std: float) -> tuple[str, str]:
    """A value and its standard error to the last place that the standard error says something of: its second digit.

    0.036123 with 0.01392 is 0.036 and 0.014; where nothing is known of the error, four digits, and a dash for it.
    """
    if not math.isfinite(std) or std <= 0.0:
        return _without_minus_zero(f"{value:.4g}"), _UNKNOWN
    place = math.floor(math.log10(std))
    places = 1 - place
    if round(std, places) >= 10.0 ** (place + 1):  # 0.0996 is 0.10
        places -= 1
    value = round(value, places)
    if abs(places) > _MOST_PLACES:
        digits = max(math.floor(math.log10(abs(value) or std)) + places, 0) if math.isfinite(value) else 0
        return _without_minus_zero(f"{value:.{digits}e}"), f"{std:.1e}"
    shown = max(places, 0)
    return _without_minus_zero(f"{value:.{shown}f}"), f"{round(std, places):.{shown}f}"


def with_error(value: float, std: float, sign: str = "±") -> str:
    """Both of ``rounded_to_error`` with a sign between them; the value alone where nothing is known of its error."""
    shown, error = rounded_to_error(value, std)
    return shown if error == _UNKNOWN else f"{shown} {sign} {error}"


def fixed(value: float, places: int) -> str:
    """A number with some decimals, of which 0 has no sign."""
    return _without_minus_zero(f"{value:.{places}f}")


def _without_minus_zero(text: str) -> str:
    return text.lstrip("-") if float(text) == 0.0 else text
