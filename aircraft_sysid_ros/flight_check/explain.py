"""Contradictions between signals as findings: which signal, what is wrong with it, the evidence, what to do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from aircraft_sysid_ros.flight_check.finding import ERROR, INFO, KEEPS_TIME, WARNING, Finding
from aircraft_sysid_ros.flight_check.relation import Fault, Relation, lag_faults, scale_faults, sign_faults
from aircraft_sysid_ros.flight_check.repair import with_delay, with_factor
from aircraft_sysid_ros.flight_check.signals import (
    ATTITUDE,
    COMMANDED,
    FORCE,
    GEODETIC,
    GYRO,
    KIND_OF,
    SURFACES,
    VELOCITY,
    Flight,
    signal_names,
)

#: Factors of units by the quantity of a signal: what a value in SI becomes in them.
_ANGLES = {57.29578: "degrees"}
_SPEEDS = {
    1.943844: "knots", 3.6: "km/h", 2.236936: "miles per hour", 3.280840: "ft/s", 100.0: "cm/s", 1000.0: "mm/s",
}  # fmt: skip
_UNITS: dict[str, dict[float, str]] = {
    "angular_velocity": {57.29578: "deg/s", 1000.0: "mrad/s"},
    "attitude": _ANGLES, "angle_of_attack": _ANGLES, "sideslip": _ANGLES, "latitude": {1.0 / 57.29578: "radians"},
    "longitude": {1.0 / 57.29578: "radians"},
    "specific_force": {1.0 / 9.80665: "g", 3.280840: "ft/s²", 1000.0 / 9.80665: "mg", 100.0: "cm/s²"},
    "velocity": _SPEEDS, "true_airspeed": _SPEEDS,
    "altitude": {3.280840: "feet", 0.001: "km", 100.0: "cm", 1000.0: "mm"},
    "static_pressure": {0.01: "hPa", 0.001: "kPa", 1.450377e-4: "psi", 2.952998e-4: "inHg"},
    "air_density": {1.940320e-3: "slug/ft³", 1000.0: "g/m³"},
}  # fmt: skip
#: What makes a density so many times what it should be, between these limits.
_KELVIN, _KELVIN_WORDS = (0.42, 0.56), "give the air temperature in °C, if it is in K: that makes such a density; else "
#: A ratio is that of a unit within this factor, a large one within a power of it; below the least it is a scale.
_NEAR, _FAR, _FURTHEST, _LEAST_UNIT = 1.3, 0.2, 2.0, 1.5
#: And within this one that of a value which was turned from a unit that it never had: 0.514 for knots.
_TAKEN = 1.08
#: Which signals are doubted last: of sign, scale and time.
_PRIOR = dict.fromkeys(ATTITUDE, 1.5) | dict.fromkeys(VELOCITY, 1.6) | dict.fromkeys(COMMANDED, 0.5)
_SCALE_PRIOR = dict.fromkeys((*ATTITUDE, *GEODETIC[:2]), 1.5)
_LAG_PRIOR = {"imu": 2.2, "velocity": 0.9}
#: And how much more, where they are early: what is measured is stamped then or later, not before. Controls are
#: commands.
_EARLY_PRIOR = {"velocity": 2.5, "position": 2.5}
#: An IMU that is surely later than all else by more [s] than this spoils what is learnt: it is in every coefficient,
#: and what is said of surfaces that are as late as usual servos does not cover it.
_IMU_LATE = 0.05
#: Streams of one device.
_RECEIVER = (("velocity", "position"),)


#: How the end of a sentence begins of a signal in another unit.
IS_IN = "it is in "


@dataclass(frozen=True)
class Explanation:
    """A finding, and what takes its fault out of a flight."""

    finding: Finding
    repair: Callable[[Flight], Flight]


#: What an IMU reverses that is turned by half a turn about x, y or z.
_HALF_TURNS = tuple(tuple(v[i] for v in (FORCE, GYRO) for i in range(3) if i != about) for about in range(3))


def signs(relations: Sequence[Relation]) -> list[Explanation]:
    """Signals that are reversed, each or by an IMU that is turned by half a turn."""
    return [
        Explanation(_half_turn(fault) if fault.also else _sign(fault), partial(_reversed, fault=fault))
        for fault in sign_faults(relations, _PRIOR, _HALF_TURNS)
    ]


def units(relations: Sequence[Relation]) -> list[Explanation]:
    """Signals in another unit, which has a name: too large or too small by that."""
    return [e for e in _ratios(relations) if IS_IN in e.finding.sentence]


def scales(relations: Sequence[Relation]) -> list[Explanation]:
    """Signals that are too large or too small by far, else by a little.

    What is compared at other times looks so, too: to be asked once times are right.
    """
    found = [e for e in _ratios(relations) if IS_IN not in e.finding.sentence]
    return [e for e in found if e.finding.severity == ERROR] or found


def _ratios(relations: Sequence[Relation]) -> list[Explanation]:
    found = []
    for fault in scale_faults(relations, _SCALE_PRIOR):
        finding, divisor = _ratio(fault)
        if finding.kind == "scale" and _is_open(fault):
            continue
        found.append(Explanation(finding, partial(_scaled, signal=fault.signal, factor=1.0 / divisor)))
    return found


def _is_open(fault: Fault) -> bool:
    """Whether the noise of both sides leaves a scale further open than it is from 1: vibration, which the attitude of a
    filter has in part, too, makes a gyro of it that turns too much.
    """
    comparison = fault.relations[0].comparison
    return bool(np.log(comparison.high / comparison.low) >= abs(fault.size))


def _scaled(flight: Flight, signal: str, factor: float) -> Flight:
    return with_factor(flight, signal, factor)


def _reversed(flight: Flight, fault: Fault) -> Flight:
    for signal in (fault.signal, *fault.also):
        flight = with_factor(flight, signal, -1.0)
    return flight


def delays(relations: Sequence[Relation], flight: Flight) -> list[Explanation]:
    """Streams that come too late or too early."""
    found = []
    for fault in lag_faults(relations, _LAG_PRIOR, stream_of, _RECEIVER, _EARLY_PRIOR):
        finding = _late(fault, flight)
        found.append(Explanation(finding, partial(with_delay, names=finding.signals, delay=fault.size)))
    return found


def stream_of(signal: str) -> str:
    """Which clock a signal has: a sensor's name."""
    if signal in (*FORCE, *GYRO):
        return "imu"
    if signal in GEODETIC:
        return "position"
    if signal in COMMANDED:
        return "controls"
    return signal.partition(".")[0]


def _compared(fault: Fault, relation: Relation) -> str:
    """What a signal was compared with, from its side."""
    return relation.evidence if fault.signal == relation.first else f"{relation.first}, by {relation.evidence}"


def _strongest(relations: Sequence[Relation]) -> Relation:
    return max(relations, key=lambda r: abs(r.comparison.correlation))


def _seconds(relation: Relation) -> str:
    seconds = relation.comparison.seconds
    return f" over {seconds:.0f} s" if seconds else ""


def _sign(fault: Fault) -> Finding:
    relation = _strongest(fault.relations)
    severity = ERROR
    remedy = "reverse it (sign: -1 in the map)"
    evidence = f"correlation {relation.comparison.correlation:.2f}{_seconds(relation)}"
    if fault.signal in SURFACES:
        severity = INFO if fault.signal == "aileron" else WARNING
        remedy = f"reverse it, or set surface_signs: {{{fault.signal}: -1}}, if it should follow the convention"
        text = f"a positive deflection turns the aircraft the positive way ({evidence}), by convention the negative one"
    else:
        text = f"it goes against {_compared(fault, relation)} ({evidence})"
    return Finding((fault.signal,), "sign", severity, f"{text}: {remedy}")


def _half_turn(fault: Fault) -> Finding:
    """One sentence of gyros and accelerometers."""
    signals = (fault.signal, *fault.also)
    about = _HALF_TURNS.index(signals)
    i, j = (axis for k, axis in enumerate("xyz") if k != about)
    frame = " (forward-left-up for forward-right-down axes, or the other way round)" if about == 0 else ""
    shown = []
    for signal in signals:
        if relations := [r for r in fault.relations if signal in r.signals]:
            strongest = _strongest(relations)
            physics = strongest.evidence.partition(",")[0]
            other = next((s for s in (strongest.first, strongest.second) if s and s not in signals), physics)
            shown.append(f"{signal} and {other} {strongest.comparison.correlation:.2f}")
    text = (
        f"the IMU is turned by 180 deg about its {'xyz'[about]} axis{frame}: of gyros and accelerometers {i} and {j} "
        f"go against the other sensors (correlation of {', '.join(shown)}): reverse {i} and {j} of both"
    )
    return Finding(signals, "sign", ERROR, text)


def _ratio(fault: Fault) -> tuple[Finding, float]:
    """The finding, and what the signal must be divided by."""
    relation = fault.relations[0]
    ratio = float(np.exp(fault.size))
    name = fault.signal
    units = _UNITS.get(name if name in _UNITS else name.partition(".")[0], {})
    c = relation.comparison
    low, high = (c.low, c.high) if name == relation.first else (1.0 / c.high, 1.0 / c.low)
    if not low <= ratio <= high:  # another signal of the relation is wrong, too
        low, high = (limit * ratio / float(np.sqrt(low * high)) for limit in (low, high))
    against = f"{_compared(fault, relation)}{_seconds(relation)}"
    nearest = min(units, key=lambda unit: abs(np.log(unit / ratio)), default=1.0)
    far = min(max(ratio, 1.0 / ratio) ** _FAR, _FURTHEST)
    room = max(_NEAR, far, float(np.sqrt(high / low)))
    if max(ratio, 1.0 / ratio) > _LEAST_UNIT and 1.0 / room < nearest / ratio < room:
        text = f"it is {ratio:.4g} times (between {low:.3g} and {high:.3g}) what it should be by {against}"
        text = f"{text}: {IS_IN}{units[nearest]}, divide it by {nearest:.6g}"
        return Finding((name,), "unit", ERROR, text), nearest
    text = f"it is {ratio:.3f} times (between {low:.3f} and {high:.3f}) what it should be by {against}"
    taken = min(units, key=lambda unit: abs(np.log(unit * ratio)), default=1.0)
    if units and max(ratio, 1.0 / ratio) > _LEAST_UNIT and 1.0 / _TAKEN < taken * ratio < _TAKEN:
        remedy = f"it seems to have been read as {units[taken]}, which it is not: correct its unit, or multiply it by"
        return Finding((name,), "unit", ERROR, f"{text}: {remedy} {taken:.6g}"), 1.0 / taken
    kind, severity = ("unit", ERROR) if max(ratio, 1.0 / ratio) > 2.0 else ("scale", WARNING)
    first = _KELVIN_WORDS if name == "air_density" and _KELVIN[0] < ratio < _KELVIN[1] else ""
    flattened = name in GYRO and ratio > 1.0 and kind == "scale" and {relation.first, relation.second} & {*ATTITUDE}
    last = ", unless the attitude filter smooths it" if flattened else ""
    return Finding((name,), kind, severity, f"{text}: {first}calibrate it, or divide it by {ratio:.3f}{last}"), ratio


def _late(fault: Fault, flight: Flight) -> Finding:
    relation = fault.relations[0]
    names = tuple(
        name
        for kind, stream in flight.streams.items()
        for name, _ in signal_names(stream)
        if stream_of(name) == fault.signal and KIND_OF[name] == kind
    )
    other = relation.second if stream_of(relation.first) == fault.signal else relation.first
    way, size = ("later", fault.size) if fault.size > 0.0 else ("earlier", -fault.size)
    remedy = f"take {fault.size:.2f} s off its stamps, or state that delay in the aircraft file"
    if fault.signal == "imu":
        remedy = (
            f"its stamps are {way}, or all the others are wrong: take {fault.size:.2f} s off, or state the others' "
            "delays"
        )
    low, high = relation.lag
    if low <= 0.0 <= high:
        text = f"{KEEPS_TIME}{other}, which comes {size:.2f} s {way} than it should: {remedy}"
        return Finding(names, "offset", WARNING, text, fault.size)
    error = max(3.0 * relation.comparison.lag_std, 0.005)
    spoils = fault.signal == "imu" and fault.size - error > _IMU_LATE
    return Finding(
        names, "offset", ERROR if spoils else WARNING,
        f"it comes {size:.2f} s (± {error:.2f}) {way} than {other or 'the motion'}, by {relation.evidence} "
        f"(correlation {relation.comparison.correlation:.2f}): {remedy}",
        fault.size,
    )  # fmt: skip
