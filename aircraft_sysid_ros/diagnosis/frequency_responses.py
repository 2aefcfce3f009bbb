"""Frequency responses of a flight: angular rates to deflections, axis by axis, and where they are coherent.

The response of each axis is to all deflections that move it, each with the others held (``estimation``). It needs no
model. In closed loop noise of the rates comes back through the controller: what is coherent is of the aeroplane where
the injected motion is well above the noise, as in a sweep.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.estimation.frequency_response import FrequencyResponse, frequency_response
from aircraft_sysid_ros.stretches import longest_stretch

Array = npt.NDArray[np.float64]

#: Rate by axis, and the deflections that move it.
AXES = {"p": ("da", "dr"), "q": ("de",), "r": ("da", "dr")}
LENGTH = 10.0  # [s] of a window
HIGHEST = 5.0  # [Hz]: points are means over windows, 25 a second
#: Where a response counts: Tischler and Remple, chapter 7, for a coherence that is not oscillating.
COHERENT = 0.6
#: A deflection that moves less [rad rms] moves nothing.
_LEAST = 2e-3
_GAP = 1.5  # steps: a longer pause ends a piece


@dataclass(frozen=True)
class RateResponse:
    """One rate to one deflection."""

    rate: str
    control: str
    frequency: Array  # (m,) [Hz]
    response: npt.NDArray[np.complex128]  # (m,) [rad/s per rad]
    coherence: Array  # (m,)
    std: Array  # (m,) over the magnitude
    windows: int

    @property
    def band(self) -> tuple[float, float] | None:
        """The widest band [Hz] without a frequency whose coherence is below COHERENT; None: there is none."""
        inside = self.frequency[longest_stretch(np.nan_to_num(self.coherence) >= COHERENT)]
        return (float(inside[0]), float(inside[-1])) if len(inside) else None

    @property
    def json(self) -> dict[str, Any]:
        """As in ``compare --json``."""
        return {
            "output": self.rate,
            "input": self.control,
            "frequency": self.frequency.tolist(),
            "magnitude": np.abs(self.response).tolist(),
            "phase": np.degrees(np.angle(self.response)).tolist(),
            "coherence": self.coherence.tolist(),
            "std": self.std.tolist(),
            "windows": self.windows,
            "band": self.band,
        }


def rate_responses(flight: FlightData) -> list[RateResponse]:
    """Responses of all rates to the deflections that are measured and move; none where the flight is too short."""
    pieces = _pieces(flight)
    made = []
    for rate, controls in AXES.items():
        moving = [name for name in controls if _moves(flight.signal(name))]
        if not moving:
            continue
        inputs = np.column_stack([flight.signal(name) for name in moving])
        output = _rate(flight, rate)
        found = frequency_response(
            [inputs[piece] for piece in pieces], [output[piece] for piece in pieces], flight.step, LENGTH
        )
        if found is not None:
            made += [_response(rate, name, found, k) for k, name in enumerate(moving)]
    return made


def _response(rate: str, control: str, found: FrequencyResponse, k: int) -> RateResponse:
    low = found.frequency <= HIGHEST
    response, coherence, std = found.response[low, k], found.coherence[low, k], found.std[low, k]
    return RateResponse(rate, control, found.frequency[low], response, coherence, std, found.windows)


def _rate(flight: FlightData, name: str) -> Array:
    """[rad/s] of a signal that is a rate times half a length over the airspeed."""
    length = flight.aircraft.chord if name == "q" else flight.aircraft.span
    factor = 1.0 if name == "q" else 2.0
    return np.asarray(flight.signal(name) * factor * flight.signal("V") / length)


def _moves(deflection: Array) -> bool:
    known = deflection[np.isfinite(deflection)]
    return bool(len(known) and np.std(known) > _LEAST)


def _pieces(flight: FlightData) -> list[slice]:
    """Stretches of points one step apart, of one manoeuvre."""
    ends = np.diff(flight.time) > _GAP * flight.step
    if flight.manoeuvre is not None:
        ends |= np.diff(flight.manoeuvre) != 0
    borders = [0, *(np.flatnonzero(ends) + 1).tolist(), len(flight.time)]
    return [slice(begin, end) for begin, end in pairwise(borders)]
