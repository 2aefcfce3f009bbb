"""Constant errors of airspeed and vanes, from a filter that has them as states (``reconstruction.air_data_errors``).

Turns tell the scale of the airspeed from the wind. An angle that is off by a constant would need a wind that turns and
banks with the aeroplane. Neither needs a model of the forces. In gusts a filter takes their share for a scale: with
light turbulence it is sure of 20 to 40 % too little in the angle of attack, while it is never sure of a constant.
So a scale counts only where the diagnosis, which knows whether the air was calm, has named it; here is how large it is.
A constant that the second half of the flight tells otherwise than the first is none: there a vane moved.
A vane that sits ahead of where the filter has it turns more than the air does, of which the filter makes a constant
too. Where the aircraft file does not say where it is, an angle must be off wherever it may be.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS
from aircraft_sysid_ros.diagnosis.flight.constant_errors import Offset, air_data_errors, offset_of
from aircraft_sysid_ros.diagnosis.measurement.setting import feigns_wind
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.rounding import with_error
from aircraft_sysid_ros.samples import Kind, Samples, first_and_last

_DEGREES = 180.0 / np.pi
#: How far ahead vanes may be, over the span, where nobody says it: nose booms of jets.
LONGEST_BOOM = 0.6
#: An angle's scale that no vane has: where the filter finds that much, it is gusts that it has found, and a constant
#: beside it is theirs.
MOST_SCALE = 0.5
#: An error is said where it is so many standard deviations from none (the filter takes gusts for noise), so many of
#: what the attitude may be off in its mean, which no gust makes smaller than it is ...
SIGMA, OF_ATTITUDE = 8.0, 3.0
#: ... and this large: scales [1], angles [rad].
LEAST_SCALE, LEAST_ANGLE = 0.04, 0.012
#: Sensors by the name of their errors: scale and constant.
_SENSORS = {
    "V": ("true_airspeed", "the airspeed", Kind.AIRSPEED, "airspeed"),
    "alpha": ("angle_of_attack", "the angle of attack", Kind.ANGLE_OF_ATTACK, "alpha"),
    "beta": ("sideslip", "the sideslip", Kind.SIDESLIP, "beta"),
}


@dataclass(frozen=True)
class InstrumentError:
    """What a sensor shows too much, in % or degrees."""

    signal: str
    kind: str  # scale, offset or offset that moves
    value: float
    std: float
    words: str

    @property
    def json(self) -> dict[str, Any]:
        """For ``explain --json``."""
        return {"signal": self.signal, "kind": self.kind, "value": self.value, "std": self.std, "sentence": self.words}


def as_diagnosed(aircraft: Aircraft, candidates: Sequence[Mapping[str, Any]]) -> Aircraft:
    """The aircraft with places and lateness of its sensors as a diagnosis counts with them, of its JSON.

    A vane that is 20 ms late shows a constant of 0.8 deg in turns, where the aeroplane pitches all the time.
    """
    for candidate in candidates:
        for name, value in candidate.get("settings", {}).items():
            key = tuple(name.split("."))
            if not feigns_wind(key) and CONTROLS not in key and key[0] != "process_noise":
                aircraft = with_setting(aircraft, key, value)
                unsaid = {place: std for place, std in aircraft.unsaid.items() if place != key}
                aircraft = replace(aircraft, unsaid=unsaid)
    return aircraft


def instrument_errors(aircraft: Aircraft, samples: Samples, named: Collection[str] = ()) -> list[InstrumentError]:
    """Errors that are sure and large, the surest first; none where the flight is in pieces or has no airspeed.

    ``named``: effects that a diagnosis has found, such as airspeed_scale.
    """
    known = air_data_errors(aircraft, samples)
    if not known:
        return []
    ahead = air_data_errors(_ahead(aircraft), samples) if _is_unplaced(aircraft) else known
    halves, found = _halves(aircraft, samples), list[tuple[float, InstrumentError]]()
    for name, (signal, words, kind, effect) in _SENSORS.items():
        if not np.any(samples.kind == kind):
            continue
        scale = known[f"lambda_{name}"]
        sureness = abs(scale["value"]) / scale["std"]
        if f"{effect}_scale" in named and sureness > SIGMA and abs(scale["value"]) > LEAST_SCALE:
            found.append((sureness, _scale(signal, words, scale["value"], scale["std"])))
        if name == "V" or f"{effect}_scale" in named:
            continue
        if max(abs(errors[f"lambda_{name}"]["value"]) for errors in (known, ahead)) > MOST_SCALE:
            continue
        here, there = (offset_of(errors or known, samples, kind) for errors in (known, ahead))
        offset = _wherever(here, there)
        before, after = (offset_of(errors or known, half, kind) for half, errors in halves)
        moved = abs(after.value - before.value)
        if moved > max(_sure_from(before, after), LEAST_ANGLE):
            found.append((moved / offset.std, _moved(signal, words, before, after)))
        elif abs(offset.value) > max(_sure_from(offset), LEAST_ANGLE):
            doubt = float(np.hypot(offset.std, 0.5 * (here.value - there.value)))
            found.append((abs(offset.value) / offset.std, _offset(signal, words, offset.value, doubt)))
    return [error for _, error in sorted(found, key=lambda pair: -pair[0])]


def _is_unplaced(aircraft: Aircraft) -> bool:
    return ("air_data_position", "x") in aircraft.unsaid


def _ahead(aircraft: Aircraft) -> Aircraft:
    """The aircraft with its vanes on a long boom."""
    return with_setting(aircraft, ("air_data_position", "x"), LONGEST_BOOM)


def _wherever(here: Offset, ahead: Offset) -> Offset:
    """What is off wherever the vanes are: the less of both, 0 where it depends on it which way."""
    if not here.value * ahead.value > 0.0:
        return here._replace(value=0.0)
    return min(here, ahead, key=lambda offset: abs(offset.value))


def _sure_from(*offsets: Offset) -> float:
    """From where a constant, or the change from one to another, is sure [rad]."""
    parts = ((SIGMA**2 * (std**2 - tilt**2) + (OF_ATTITUDE * tilt) ** 2) for _, std, tilt in offsets)
    return float(np.sqrt(sum(parts)))


def _halves(aircraft: Aircraft, samples: Samples) -> list[tuple[Samples, dict[str, dict[str, float]]]]:
    """Each half of a flight, and the errors as it tells them by itself; none where it has no airspeed."""
    second = samples.stamp > sum(first_and_last(samples.stamp)) // 2
    return [(half, air_data_errors(aircraft, half)) for half in (samples[~second], samples[second])]


def _scale(signal: str, words: str, value: float, std: float) -> InstrumentError:
    """y_true = (1 + value) y: what it shows is 1 / (1 + value) of the truth."""
    shown, spread = 100.0 * (1.0 / (1.0 + value) - 1.0), 100.0 * std / (1.0 + value) ** 2
    way = "too high" if shown > 0.0 else "too low"
    remedy = f"calibrate it, or divide it by {1 + shown / 100:.3f}"
    text = f"{words} reads {with_error(abs(shown), spread)} % {way}: {remedy}"
    return InstrumentError(signal, "scale", shown, spread, text)


def _offset(signal: str, words: str, value: float, std: float) -> InstrumentError:
    """y_true = y + value."""
    shown, spread = -_DEGREES * value, _DEGREES * std
    way = "too high" if shown > 0.0 else "too low"
    remedy = f"take {shown:.1f}° off" if shown > 0.0 else f"add {-shown:.1f}°"
    text = f"{words} reads {with_error(abs(shown), spread)}° {way}: set its zero, or {remedy}"
    return InstrumentError(signal, "offset", shown, spread, text)


def _moved(signal: str, words: str, before: Offset, after: Offset) -> InstrumentError:
    """A constant that is another one in the second half of the flight; its number is the change."""
    first, second = (
        "+" * (value < 0.0) + with_error(-_DEGREES * value, _DEGREES * std) + "°" for value, std, _ in (before, after)
    )
    text = (
        f"{words} is wrong by {first} in the first half of the flight and by {second} in the second: it moves, so no "
        "zero is right for it; fasten it, and do not use it in this flight"
    )
    change, spread = _DEGREES * (before.value - after.value), _DEGREES * float(np.hypot(before.std, after.std))
    return InstrumentError(signal, "offset that moves", change, spread, text)
