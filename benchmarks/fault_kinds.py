"""Faults of a sensor, a record or a surface, each from a time on, for benchmarks/faults.py."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.sensors.sensor_models import stamps_of
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.sensor_faults import FAULTS, stuck_surface

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
#: Values (n, k) of the samples of a kind and their times [s] since the fault began, (n,), and a generator: new values.
Change = Callable[[Array, Array, np.random.Generator], Array]

A, B, V = Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP, Kind.AIRSPEED


@dataclass(frozen=True)
class FaultKind:
    """What becomes of the samples, or of the aeroplane; ``names``: words of which one tells the cause."""

    names: tuple[str, ...]
    change: Callable[[Samples, float, float, np.random.Generator], Samples] | None = None
    surface: str = ""  # that of the aeroplane
    left: float = 0.0  # share of its effect that is left
    position: float = 0.0  # [rad] where it stands, if nothing is left


def _of(kind: Kind, change: Change) -> Callable[[Samples, float, float, np.random.Generator], Samples]:
    def fault(samples: Samples, begin: float, end: float, rng: np.random.Generator) -> Samples:
        first, last = stamps_of([begin, end])
        rows = np.flatnonzero((samples.kind == kind) & (samples.stamp >= first) & (samples.stamp < last))
        values = samples.values.copy()
        values[rows] = change(values[rows], (samples.stamp[rows] - first) * 1e-9, rng)
        return Samples(samples.stamp, samples.kind, values)

    return fault


def _scaled(kind: Kind, column: int, factor: float) -> Callable[..., Samples]:
    def change(values: Array, time: Array, rng: np.random.Generator) -> Array:
        values[:, column] *= factor
        return values

    return _of(kind, change)


def _shifted(kind: Kind, column: int, offset: float) -> Callable[..., Samples]:
    def change(values: Array, time: Array, rng: np.random.Generator) -> Array:
        values[:, column] += offset
        return values

    return _of(kind, change)


def _drifting(kind: Kind, column: int, offset: float = 0.0, factor: float = 0.0) -> Callable[..., Samples]:
    """By ``offset`` per second, and by a share ``factor`` per second."""

    def change(values: Array, time: Array, rng: np.random.Generator) -> Array:
        values[:, column] = values[:, column] * np.maximum(1.0 + factor * time, 0.05) + offset * time
        return values

    return _of(kind, change)


def _noisy(kind: Kind, columns: slice, std: float) -> Callable[..., Samples]:
    def change(values: Array, time: Array, rng: np.random.Generator) -> Array:
        values[:, columns] += std * rng.normal(size=values[:, columns].shape)
        return values

    return _of(kind, change)


def _spikes(kind: Kind, column: int, size: float, share: float) -> Callable[..., Samples]:
    def change(values: Array, time: Array, rng: np.random.Generator) -> Array:
        hit = rng.random(len(values)) < share
        values[hit, column] += size * rng.choice([-1.0, 1.0], hit.sum())
        return values

    return _of(kind, change)


def _swapped(kind: Kind, first: int, second: int) -> Callable[..., Samples]:
    def change(values: Array, time: Array, rng: np.random.Generator) -> Array:
        values[:, [first, second]] = values[:, [second, first]]
        return values

    return _of(kind, change)


def _late(seconds: float, *kinds: Kind) -> Callable[..., Samples]:
    """Stamped later than they were measured."""

    def fault(samples: Samples, begin: float, end: float, rng: np.random.Generator) -> Samples:
        first, last = stamps_of([begin, end])
        rows = np.isin(samples.kind, kinds) & (samples.stamp >= first) & (samples.stamp < last)
        return Samples(samples.stamp + rows * round(1e9 * seconds), samples.kind, samples.values)

    return fault


def _thinned(share: float, *kinds: Kind) -> Callable[..., Samples]:
    def fault(samples: Samples, begin: float, end: float, rng: np.random.Generator) -> Samples:
        first, last = stamps_of([begin, end])
        rows = np.isin(samples.kind, kinds) & (samples.stamp >= first) & (samples.stamp < last)
        return samples[~(rows & (rng.random(len(samples)) < share))]

    return fault


def _clock(step: float, rate: float, *kinds: Kind) -> Callable[..., Samples]:
    """Stamps of some kinds, or of all, that leap by ``step`` [s] and then run away by ``rate`` seconds per second."""

    def fault(samples: Samples, begin: float, end: float, rng: np.random.Generator) -> Samples:
        first, last = stamps_of([begin, end])
        rows = (samples.stamp >= first) & (samples.stamp < last)
        if kinds:
            rows &= np.isin(samples.kind, kinds)
        ahead = 1e9 * step + rate * (samples.stamp - first)
        return Samples(samples.stamp + np.where(rows, ahead, 0.0).astype(np.int64), samples.kind, samples.values)

    return fault


def _stands(kind: Kind, column: int, noise: float) -> Callable[..., Samples]:
    """A column stays as it was, but for noise."""

    def change(values: Array, time: Array, rng: np.random.Generator) -> Array:
        values[:, column] = values[:1, column] + noise * rng.normal(size=len(values))
        return values

    return _of(kind, change)


def _known(name: str) -> Callable[..., Samples]:
    def fault(samples: Samples, begin: float, end: float, rng: np.random.Generator) -> Samples:
        first, last = stamps_of([begin, end])
        return FAULTS[name](samples, (samples.stamp >= first) & (samples.stamp < last))

    return fault


def _both(one: Callable[..., Samples], other: Callable[..., Samples]) -> Callable[..., Samples]:
    def fault(samples: Samples, begin: float, end: float, rng: np.random.Generator) -> Samples:
        return other(one(samples, begin, end, rng), begin, end, rng)

    return fault


_AIRSPEED, _ALPHA, _BETA = ("airspeed",), ("angle of attack", "alpha", "vane"), ("sideslip", "beta", "vane")
_IMU, _GPS, _DENSITY = ("IMU", "accelerometer", "gyro"), ("GPS",), ("density", "pressure", "airspeed")
_E, _AIL, _R = ("elevator", "de"), ("aileron", "da"), ("rudder", "dr")
_CONTROLS = ("controls", "control", "delay")

#: At least forty, by name; what they do to a record or to the aeroplane.
KINDS: Mapping[str, FaultKind] = {
    "airspeed blocked": FaultKind(_AIRSPEED, _known("airspeed_blocked")),
    "airspeed blocked, noisy": FaultKind(_AIRSPEED, _known("airspeed_blocked_noisy")),
    "airspeed lost": FaultKind(_AIRSPEED, _known("airspeed_lost")),
    "airspeed x 0.8": FaultKind(_AIRSPEED, _scaled(V, 0, 0.8)),
    "airspeed x 1.2": FaultKind(_AIRSPEED, _scaled(V, 0, 1.2)),
    "pitot icing, 1 % per minute": FaultKind(_AIRSPEED, _drifting(V, 0, factor=-0.01 / 60)),
    "pitot icing, 20 % per minute": FaultKind(_AIRSPEED, _drifting(V, 0, factor=-0.2 / 60)),
    "airspeed, noise 2 m/s": FaultKind(_AIRSPEED, _noisy(V, slice(0, 1), 2.0)),
    "airspeed, spikes": FaultKind(_AIRSPEED, _spikes(V, 0, 10.0, 0.05)),
    "alpha stuck": FaultKind(_ALPHA, _known("alpha_stuck")),
    "alpha stuck, noisy": FaultKind(_ALPHA, _known("alpha_stuck_noisy")),
    "alpha x 0.7": FaultKind(_ALPHA, _scaled(A, 0, 0.7)),
    "alpha negated": FaultKind(_ALPHA, _scaled(A, 0, -1.0)),
    "alpha + 3 deg": FaultKind(_ALPHA, _shifted(A, 0, np.radians(3.0))),
    "alpha, 0.1 deg/s": FaultKind(_ALPHA, _drifting(A, 0, offset=np.radians(0.1))),
    "alpha, noise 2 deg": FaultKind(_ALPHA, _noisy(A, slice(0, 1), np.radians(2.0))),
    "alpha, spikes": FaultKind(_ALPHA, _spikes(A, 0, 0.5, 0.05)),
    "beta stuck": FaultKind(_BETA, _known("beta_stuck")),
    "beta stuck, noisy": FaultKind(_BETA, _known("beta_stuck_noisy")),
    "beta x 0.7": FaultKind(_BETA, _scaled(B, 0, 0.7)),
    "beta negated": FaultKind(_BETA, _scaled(B, 0, -1.0)),
    "beta, 0.1 deg/s": FaultKind(_BETA, _drifting(B, 0, offset=np.radians(0.1))),
    "air data 150 ms late": FaultKind(("air data", "airspeed", "angle of attack", "sideslip"), _late(0.15, V, A, B)),
    "IMU 60 ms late": FaultKind(_IMU, _late(0.06, Kind.IMU)),
    "controls 100 ms late": FaultKind(_CONTROLS, _late(0.1, Kind.CONTROLS)),
    "controls, 80 % lost": FaultKind(_CONTROLS, _thinned(0.8, Kind.CONTROLS)),
    "controls, noise 1 deg": FaultKind(_CONTROLS, _noisy(Kind.CONTROLS, slice(0, 3), np.radians(1.0))),
    "elevator record stuck": FaultKind(_E, _known("elevator_record")),
    "elevator record halved": FaultKind(_E, _scaled(Kind.CONTROLS, 0, 0.5)),
    "elevator record negated": FaultKind(_E, _scaled(Kind.CONTROLS, 0, -1.0)),
    "aileron record halved": FaultKind(_AIL, _scaled(Kind.CONTROLS, 1, 0.5)),
    "aileron and rudder swapped": FaultKind((*_AIL, *_R), _swapped(Kind.CONTROLS, 1, 2)),
    "accelerometer x 1.1": FaultKind(_IMU, _both(_scaled(Kind.IMU, 0, 1.1), _scaled(Kind.IMU, 2, 1.1))),
    "gyro q x 0.8": FaultKind(_IMU, _scaled(Kind.IMU, 4, 0.8)),
    "gyros p and q swapped": FaultKind(_IMU, _swapped(Kind.IMU, 3, 4)),
    "gyro r negated": FaultKind(_IMU, _scaled(Kind.IMU, 5, -1.0)),
    "IMU bias jumps": FaultKind(_IMU, _known("imu_bias_jump")),
    "IMU, half of it lost": FaultKind(_IMU, _thinned(0.5, Kind.IMU)),
    "GPS lost": FaultKind(_GPS, _known("gps_lost")),
    "GPS spoofed": FaultKind(_GPS, _known("gps_spoofed")),
    "GPS 0.5 s late": FaultKind(_GPS, _late(0.5, Kind.GPS_POSITION, Kind.GPS_VELOCITY)),
    "density x 0.75": FaultKind(_DENSITY, _both(_scaled(Kind.AIR, 0, 0.75), _scaled(Kind.AIR, 1, 0.75))),
    "elevator stuck": FaultKind(_E, surface="de"),
    "aileron stuck": FaultKind(_AIL, surface="da"),
    "rudder stuck": FaultKind(_R, surface="dr"),
    "half the elevator": FaultKind(_E, surface="de", left=0.5),
    "half the aileron": FaultKind(_AIL, surface="da", left=0.5),
    "alpha stuck and airspeed x 0.9": FaultKind(
        (*_ALPHA, *_AIRSPEED), _both(_known("alpha_stuck_noisy"), _scaled(V, 0, 0.9))
    ),
    "GPS lost and beta stuck": FaultKind((*_GPS, *_BETA), _both(_known("gps_lost"), _known("beta_stuck_noisy"))),
    "aileron record stuck, noisy": FaultKind(_AIL, _stands(Kind.CONTROLS, 1, 0.002)),
    "all clocks leap by 0.5 s": FaultKind(("clock", "gap"), _clock(0.5, 0.0)),
    "IMU clock leaps by 0.2 s": FaultKind(_IMU, _clock(0.2, 0.0, Kind.IMU)),
    "IMU clock, 2 ms/s": FaultKind(_IMU, _clock(0.0, 0.002, Kind.IMU)),
    "GPS clock, 5 ms/s": FaultKind(_GPS, _clock(0.0, 0.005, Kind.GPS_POSITION, Kind.GPS_VELOCITY)),
    "air data clock, 5 ms/s": FaultKind((*_AIRSPEED, *_ALPHA, *_BETA), _clock(0.0, 0.005, V, A, B)),
    "controls clock, 5 ms/s": FaultKind(_CONTROLS, _clock(0.0, 0.005, Kind.CONTROLS)),
    "engine dead": FaultKind(("thrust", "Tc"), surface="Tc"),
    # what ailerons can hold; an elevator or ailerons that run away do not stay in the air
    "rudder runs away": FaultKind(_R, surface="dr", position=0.06),
}
#: Seeds below draw from so many kinds, of which the flights in benchmarks/results are; the others from all.
FIRST_KINDS, ALL_KINDS_FROM = 49, 10_200_000


def effects_of(kind: FaultKind, truth: Mapping[str, float], begin: float, end: float) -> tuple[Effect, ...]:
    """What the aeroplane loses, for a fault of a surface; empty for one of a record."""
    if not kind.surface:
        return ()
    if kind.left == 0.0:
        return stuck_surface(truth, kind.surface, kind.position, begin, end)
    during = f"max(sign(time-{begin:g}),0)*max(sign({end:g}-time),0)*{kind.surface}"
    touched = [name for name in truth if name.endswith(f"_{kind.surface}")]
    return tuple(Effect(name[:2], during, (kind.left - 1.0) * truth[name]) for name in touched)
