"""Signals that the terms of a model read, and their places in a signal row."""

from __future__ import annotations

#: Signals that a term may read, in the order of a signal row. Rates are normalised: p b/2V, q c/V, r b/2V.
SIGNALS: tuple[str, ...] = (
    "alpha", "beta", "p", "q", "r", "de", "da", "dr", "flaps", "Tc", "throttle", "propeller_speed",
    "V", "qbar", "mach", "height", "alpha_dot", "beta_dot", "time",
)  # fmt: skip
SIGNAL_INDEX = {name: i for i, name in enumerate(SIGNALS)}
#: What a pilot moves, in words.
CONTROL_WORDS = {
    "de": "elevator", "da": "aileron", "dr": "rudder", "flaps": "flaps", "Tc": "thrust", "throttle": "throttle",
    "propeller_speed": "propeller speed",
}  # fmt: skip
SURFACE_WORDS = {name: CONTROL_WORDS[name] for name in ("de", "da", "dr", "flaps")}
#: Signals that an aircraft file may name besides (``inputs:``); they follow SIGNALS in a signal row, in its order.
MOST_INPUTS = 10
#: And so many different ``lag(…)`` and ``limited(…)`` that the terms of a model read; they follow the inputs.
MOST_LAGS = 4
FIRST_LAG = len(SIGNALS) + MOST_INPUTS
SIGNAL_COUNT = FIRST_LAG + MOST_LAGS
