"""Excitation of all controls and the plan of a test flight that makes every parameter of (6.25) identifiable.

Signals follow practice in flight-test identification (E. A. Morelli, V. Klein, Aircraft System
Identification, chapter 9): doublets, 3-2-1-1, frequency sweeps, and multisines whose harmonics no two
controls share, which makes them orthogonal over a period, with phases that keep the peaks low.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

ELEVATOR, AILERON, RUDDER, THROTTLE = range(4)
#: A plan of this length has every manoeuvre once; other lengths stretch or repeat it.
NOMINAL_DURATION = 120.0  # [s]


@dataclass(frozen=True)
class Excitation:
    """Sizes that suit one aeroplane."""

    elevator: float  # [rad] that changes the angle of attack by some degrees
    aileron: float  # [rad] for a brisk roll rate
    rudder: float  # [rad] for some degrees of sideslip
    throttle: float  # 0..1
    pitch_pulse: float  # [s] unit of the 3-2-1-1, near the short period
    roll_pulse: float  # [s]
    yaw_pulse: float  # [s] half a Dutch roll
    airspeed: float  # [m/s] at trim


@dataclass(frozen=True)
class Plan:
    """What is flown at n times: additions to the controls (n, 4) and references of the autopilot."""

    time: Array  # (n,) [s]
    controls: Array  # (n, 4) elevator, aileron, rudder [rad], throttle
    bank: Array  # (n,) [rad]
    airspeed: Array  # (n,) [m/s]
    height: Array  # (n,) [m] above that of the beginning
    flaps: Array  # (n,) [rad]


def level_plan(time: Array, airspeed: float) -> Plan:
    """Straight level flight at n times [s] (n,), nothing moved."""
    n = len(time)
    return Plan(time, np.zeros((n, 4)), np.zeros(n), np.full(n, airspeed), np.zeros(n), np.zeros(n))


def pulses(time: Array, widths: tuple[float, ...]) -> Array:
    """Pulses of +1, -1, +1, … of the given widths [s] from time 0, then 0; same shape as time [s]."""
    edges = np.cumsum([0.0, *widths])
    index = np.searchsorted(edges, time, side="right") - 1
    signs = np.where(index % 2 == 0, 1.0, -1.0)
    return np.where((index >= 0) & (index < len(widths)), signs, 0.0)


def doublet(time: Array, pulse: float) -> Array:
    """One pulse [s] up and one down."""
    return pulses(time, (pulse, pulse))


def three_two_one_one(time: Array, unit: float) -> Array:
    """Pulses of 3, 2, 1 and 1 units [s] of alternating sign."""
    return pulses(time, (3.0 * unit, 2.0 * unit, unit, unit))


def sweep(time: Array, duration: float, low: float, high: float) -> Array:
    """Sine from ``low`` to ``high`` [Hz], frequency growing exponentially, over ``duration`` [s], then 0."""
    ratio = np.log(high / low)
    inside = np.clip(time, 0.0, duration)
    phase = 2.0 * np.pi * low * duration / ratio * (np.exp(ratio * inside / duration) - 1.0)
    return np.where((time >= 0.0) & (time < duration), np.sin(phase), 0.0)


def multisine(time: Array, period: float, harmonics: npt.NDArray[np.int64]) -> Array:
    """Sum of sines at ``harmonics / period`` [Hz] of equal power and low peaks, scaled to a peak near 1."""
    phases = low_peak_phases(harmonics)
    angles = 2.0 * np.pi * np.outer(time / period, harmonics) + phases
    amplitude = 1.0 / _peak(harmonics, phases)
    return amplitude * np.sum(np.cos(angles), axis=1)


def low_peak_phases(harmonics: npt.NDArray[np.int64]) -> Array:
    """Phases [rad] (k,) of cosines with a low peak: Schroeder's, improved by clipping and keeping the phases.

    Turned in time to begin at a zero crossing, so that the controls do not jump.
    """
    return _phases(tuple(harmonics.tolist()))


@cache
def _phases(chosen: tuple[int, ...], rounds: int = 200) -> Array:
    harmonics = np.array(chosen, dtype=np.int64)
    k = np.arange(1, len(harmonics) + 1)
    phases = -np.pi * k * (k - 1) / len(harmonics)
    best, lowest = phases, _peak(harmonics, phases)
    for _ in range(rounds):
        wave = _wave(harmonics, phases)
        limit = 0.9 * np.max(np.abs(wave))
        phases = np.angle(np.fft.rfft(np.clip(wave, -limit, limit))[harmonics])
        peak = _peak(harmonics, phases)
        if peak < lowest:
            best, lowest = phases, peak
    wave = _wave(harmonics, best)
    crossing = int(np.argmin(np.abs(wave) + np.where(np.roll(wave, -1) > wave, 0.0, np.inf)))
    shift = 2.0 * np.pi * crossing / len(wave)
    return best + shift * harmonics


def _wave(harmonics: npt.NDArray[np.int64], phases: Array) -> Array:
    spectrum = np.zeros(1025, dtype=complex)
    spectrum[harmonics] = np.exp(1j * phases)
    return np.fft.irfft(spectrum) * 1024.0


def _peak(harmonics: npt.NDArray[np.int64], phases: Array) -> float:
    return float(np.max(np.abs(_wave(harmonics, phases))))


def orthogonal_multisines(time: Array, period: float, top: float) -> Array:
    """Four multisines (n, 4) up to ``top`` [Hz], throttle to a quarter of it, without common harmonics."""
    count = max(12, round(top * period))
    harmonics = np.arange(2, count + 2, dtype=np.int64)
    columns = []
    for control in range(4):
        own = harmonics[harmonics % 4 == control]
        own = own[: max(3, len(own) // 4)] if control == THROTTLE else own
        columns.append(multisine(time, period, own))
    return np.stack(columns, axis=1)


class Planner:
    """Fills a plan segment by segment."""

    def __init__(self, time: Array, excitation: Excitation) -> None:
        self.size = excitation
        self.plan = level_plan(time, excitation.airspeed)

    def elevator_3211(self, window: slice, t: Array, length: float, sign: float) -> None:
        for start, way in ((0.0, sign), (0.5 * length, -sign)):
            wave = three_two_one_one(t - start, self.size.pitch_pulse)
            self.plan.controls[window, ELEVATOR] += way * self.size.elevator * wave

    def lateral_doublets(self, window: slice, t: Array, length: float, sign: float) -> None:
        aileron = doublet(t, self.size.roll_pulse) - doublet(t - 0.5 * length, self.size.roll_pulse)
        rudder = doublet(t - 0.25 * length, self.size.yaw_pulse)
        rudder -= doublet(t - 0.75 * length, self.size.yaw_pulse)
        self.plan.controls[window, AILERON] += sign * self.size.aileron * aileron
        self.plan.controls[window, RUDDER] += sign * self.size.rudder * rudder

    def throttle_steps(self, window: slice, t: Array, length: float, sign: float) -> None:
        wave = doublet(t, length / 3.0) * 1.5
        self.plan.controls[window, THROTTLE] += sign * self.size.throttle * wave

    def multisines(self, window: slice, t: Array, length: float, sign: float) -> None:
        sizes = np.array([self.size.elevator, self.size.aileron, self.size.rudder, self.size.throttle])
        top = np.clip(0.25 / self.size.pitch_pulse, 0.3, 2.0)
        self.plan.controls[window] += sign * sizes * orthogonal_multisines(t, length, top)

    def fast_multisines(self, window: slice, t: Array, length: float, sign: float) -> None:
        self.plan.airspeed[window] = 1.25 * self.size.airspeed
        self.multisines(window, t, length, -sign)

    def turns(self, window: slice, t: Array, length: float, sign: float) -> None:
        self.plan.bank[window] = sign * np.radians(35.0) * doublet(t, 0.4 * length)

    def pushover_pullup(self, window: slice, t: Array, length: float, sign: float) -> None:
        half = 0.25 * length
        wave = np.where(t < 2.0 * half, np.sin(np.pi * t / half), 0.0)
        self.plan.controls[window, ELEVATOR] -= 1.2 * self.size.elevator * wave

    def sweeps(self, window: slice, t: Array, length: float, sign: float) -> None:
        top = np.clip(0.4 / self.size.pitch_pulse, 0.5, 3.0)
        for column, size, begin in (
            (ELEVATOR, self.size.elevator, 0.0),
            (RUDDER, self.size.rudder, 0.5 * length),
        ):
            self.plan.controls[window, column] += 0.6 * size * sweep(t - begin, 0.45 * length, 0.25, top)

    def cruise(self, window: slice, t: Array, length: float, sign: float) -> None:
        """Nothing but the autopilot."""


def flight_plan(time: Array, excitation: Excitation) -> Plan:
    """The plan of a flight at n times [s] (n,) from 0: cruise, all manoeuvres, cruise.

    Flights of about two minutes and more repeat the nominal plan with alternating signs.
    """
    planner = Planner(time, excitation)
    segments: list[tuple[float, Callable[[slice, Array, float, float], None]]] = [
        (6.0, planner.cruise),
        (10.0, planner.elevator_3211),
        (16.0, planner.lateral_doublets),
        (10.0, planner.throttle_steps),
        (20.0, planner.multisines),
        (16.0, planner.turns),
        (8.0, planner.pushover_pullup),
        (16.0, planner.fast_multisines),
        (8.0, planner.sweeps),
        (10.0, planner.cruise),
    ]  # fmt: skip
    duration = float(time[-1])
    cycles = max(1, round(duration / NOMINAL_DURATION))
    stretch = duration / (cycles * NOMINAL_DURATION)
    begin = 0.0
    for cycle in range(cycles):
        for nominal, fly in segments:
            length = nominal * stretch
            window = slice(*np.searchsorted(time, (begin, begin + length)))
            fly(window, time[window] - begin, length, 1.0 if cycle % 2 == 0 else -1.0)
            begin += length
    return planner.plan
