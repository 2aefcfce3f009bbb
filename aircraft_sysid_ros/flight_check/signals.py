"""The signals of a flight by the names of the MAP of an import: times, values, and when each sample arrived.

FRD and NED, SI and radians, as the samples are. Sensors that share a message share their stamps: they are one stream.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.aircraft.sensor_settings import DEFAULT_SENSORS
from aircraft_sysid_ros.aircraft.unsaid_places import doubt_of_imu, doubt_of_vanes
from aircraft_sysid_ros.samples import Kind, Samples, middle_stamp, repeats
from aircraft_sysid_ros.stamps import NANOSECONDS

Array = npt.NDArray[np.float64]

FORCE = ("specific_force.x", "specific_force.y", "specific_force.z")
GYRO = ("angular_velocity.x", "angular_velocity.y", "angular_velocity.z")
ATTITUDE = ("attitude.roll", "attitude.pitch", "attitude.yaw")
GEODETIC = ("latitude", "longitude", "altitude")
_LONGITUDE = GEODETIC.index("longitude")
#: Beyond these [rad] a latitude and a longitude, which may go on over 180 degrees, are no angles.
LARGEST_ANGLES = np.array([0.5 * np.pi, 3.0 * np.pi])
VELOCITY = ("velocity.north", "velocity.east", "velocity.down")
SURFACES = ("elevator", "aileron", "rudder", "flaps")
#: Signals by kind of sample, in the order of its values; the attitude is stored as a quaternion.
NAMES: dict[Kind, tuple[str, ...]] = {
    Kind.IMU: (*FORCE, *GYRO),
    Kind.ATTITUDE: ATTITUDE,
    Kind.MAGNETIC_FIELD: ("magnetic_field.x", "magnetic_field.y", "magnetic_field.z"),
    Kind.GPS_POSITION: GEODETIC,
    Kind.GPS_VELOCITY: VELOCITY,
    Kind.AIRSPEED: ("true_airspeed",),
    Kind.ANGLE_OF_ATTACK: ("angle_of_attack",),
    Kind.SIDESLIP: ("sideslip",),
    Kind.AIR: ("air_density", "static_pressure"),
    Kind.CONTROLS: (*SURFACES, "throttle", "thrust", "propeller_speed"),
    Kind.HEIGHT: ("height_above_ground",),
    Kind.MASS: ("mass", "inertia.xx", "inertia.yy", "inertia.zz", "inertia.xz")
    + ("centre_of_gravity.x", "centre_of_gravity.y", "centre_of_gravity.z"),
    Kind.FIVE_HOLE: ("static_pressure", "dynamic_pressure", "alpha_pressure", "beta_pressure"),
}
KIND_OF = {name: kind for kind, names in reversed(NAMES.items()) for name in names}
#: Angles and their like, signals that may stand still for as long as the pilot likes, and slow ones.
COMMANDED = (*SURFACES, "throttle", "thrust", "propeller_speed")
SLOW = ("mass", "air_density", "magnetic_field")
#: Before the name of an input that the aircraft file names.
INPUTS = "inputs."


@dataclass(frozen=True)
class Stream:
    """The samples of one kind that can be used, by rising stamp: times [s], values (n, k), and how many could not."""

    kind: Kind
    time: Array  # (n,) [s] from the start of the recording, not falling
    delay: Array  # (n,) [s] from stamp to arrival
    values: Array  # (n, k) as in NAMES; the attitude as a quaternion, (n, 4); longitude without its leap at 180 degrees
    unusable: int = 0  # samples whose values are no numbers, between those that have some
    disordered: int = 0  # samples stamped before the one that arrived before them
    away: int = 0  # samples stamped half a day from the others
    repeated: int = 0  # samples that are there once more, with the same stamp and values, and are left out
    name: str = ""  # of a named input, which is a stream of its own

    @property
    def names(self) -> tuple[str, ...]:
        """Signals of its columns."""
        return (self.name,) if self.name else NAMES[self.kind]

    @cached_property
    def interval(self) -> float:
        """Median time [s] between neighbours; NaN for fewer than two."""
        steps = np.diff(self.time)
        return float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else float("nan")

    @property
    def rate(self) -> float:
        """Samples per second while they come; NaN for fewer than two."""
        return 1.0 / self.interval

    def fresh(self, columns: slice) -> npt.NDArray[np.bool_]:
        """Which samples (n,) are new: another value than the sample before, in any of some columns."""
        values = self.values[:, columns]
        same = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
        return np.concatenate([[True], ~np.all(same, axis=1)])[: len(self.time)]

    def hold(self, columns: slice) -> float:
        """How many samples repeat one value of some columns in a regular way: 1 for those that are all new."""
        return held_length(self.fresh(columns))


class VaneArm(NamedTuple):
    """Where an aircraft file has the vanes, seen from the IMU, FRD [m], and one sigma of what it leaves out: (3,)."""

    place: Array
    sigma: Array


def vane_arm(aircraft: Aircraft) -> VaneArm:
    """That of an aircraft file."""
    sigma = np.hypot(doubt_of_vanes(aircraft), doubt_of_imu(aircraft))
    return VaneArm(aircraft.air_data_position - aircraft.imu_position, sigma)


@dataclass(frozen=True)
class Flight:
    """All streams of a recording by kind, with what is known of the aeroplane and of what could not be read."""

    streams: Mapping[Kind, Stream]
    duration: float  # [s]
    inputs: tuple[NamedInput, ...] = ()  # that the aircraft file names
    input_streams: Mapping[str, Stream] = field(default_factory=dict)  # by signal: those that have values
    delays: Mapping[Kind, float] = field(default_factory=dict)  # [s] that the aircraft file states
    surface_signs: Mapping[str, float] = field(default_factory=dict)
    surface_noise: float = DEFAULT_SENSORS["control_surfaces"].noise[0]  # [rad] resolution and play of the surfaces
    skipped: Mapping[str, int] = field(default_factory=dict)  # messages by topic that could not be decoded
    arm: VaneArm | None = None  # None: no aircraft file has them anywhere

    @property
    def every_stream(self) -> tuple[Stream, ...]:
        """Those of the sensors, and of each named input."""
        return (*self.streams.values(), *self.input_streams.values())

    def has(self, *kinds: Kind) -> bool:
        """Whether there are samples of all these kinds."""
        return all(kind in self.streams for kind in kinds)

    def column(self, name: str) -> tuple[Stream, int] | None:
        """Stream and column of a signal that is measured at all; None otherwise. Not for the attitude."""
        for stream in self.every_stream:
            if name in stream.names:
                column = stream.names.index(name)
                if np.any(np.isfinite(stream.values[:, column])):
                    return stream, column
        return None


#: Runs of equal values that are held have nearly one length: spread over mean; fewer runs do not tell.
_REGULAR, _LEAST_RUNS, _LEAST_HOLD = 0.45, 10, 1.4


def held_length(fresh: npt.NDArray[np.bool_]) -> float:
    """Samples (n,) per new one where new ones come at regular steps, as in a slower signal that is held; else 1.

    Values that are equal by their resolution come in runs of all lengths, for which this is 1; so does a command that
    stands still for most of a flight and moves by steps of a manoeuvre.
    """
    every = np.diff(np.flatnonzero(fresh))
    if len(every) < _LEAST_RUNS:
        return 1.0
    runs = every[every <= 4.0 * np.median(every)]
    if 2 * np.sum(runs) < np.sum(every):
        return 1.0
    mean = float(np.mean(runs))
    return mean if mean >= _LEAST_HOLD and np.std(runs) < _REGULAR * mean else 1.0


#: Straight: a bend below this share of the usual large one; in an interpolated signal at least this share is straight.
_STRAIGHT, _LEAST_STRAIGHT, _ROUNDING = 0.05, 0.3, 1e-4
#: Longest time [s] between measured ones: legs between regular turns are as straight, where positions have no noise.
_SLOWEST = 5.0


def interpolated_length(time: Array, values: Array) -> float:
    """Samples (n,) per measured one where those between lie on a straight line, at regular steps; else 1."""
    known = np.isfinite(values) & np.concatenate([[True], np.diff(time) > 0.0])[: len(time)]
    slope = np.diff(values[known]) / np.diff(time[known])
    if len(slope) < 4 * _LEAST_RUNS or not np.any(slope):
        return 1.0
    bend = np.abs(np.diff(slope))
    large = float(np.percentile(bend, 95))
    straight = (bend < _STRAIGHT * large) & (slope[1:] != 0.0)
    if large < _ROUNDING * float(np.median(np.abs(slope))) or np.mean(straight) < _LEAST_STRAIGHT:
        return 1.0
    length = held_length(~straight & np.concatenate([[True], straight[:-1]]))  # a bend may lie between two samples
    return length if length * float(np.median(np.diff(time[known]))) <= _SLOWEST else 1.0


def groups(stream: Stream) -> list[tuple[tuple[str, ...], slice]]:
    """The parts of a stream that change together, with their columns: vectors, and single numbers."""
    if stream.kind == Kind.ATTITUDE:
        return [(ATTITUDE, slice(0, 4))]
    found: dict[str, list[int]] = {}
    for i, name in enumerate(stream.names):
        found.setdefault("geodetic" if name in GEODETIC else name.partition(".")[0], []).append(i)
    return [(tuple(stream.names[i] for i in columns), slice(columns[0], columns[-1] + 1)) for columns in found.values()]


def signal_names(stream: Stream) -> list[tuple[str, int]]:
    """Signals of a stream that are measured at all, with their columns; all three of an attitude, at column 0."""
    if stream.kind == Kind.ATTITUDE:
        return [(name, 0) for name in ATTITUDE]
    measured = np.any(np.isfinite(stream.values), axis=0)
    return [(name, i) for i, name in enumerate(stream.names) if measured[i]]


def inside_limits(values: Array, item: NamedInput) -> npt.NDArray[np.bool_]:
    """Which values (n,) [SI] of a named input are none that `replay` leaves out."""
    return np.asarray((values >= item.limits[0]) & (values <= item.limits[1]))


#: Stamps further than this [s] from the middle of the recording are no times of it.
_LONGEST = 43_200.0


#: Beyond it a number is no value of any signal, in whatever unit; it is taken as not measured.
WILD = 1e12


def flight_of(
    samples: Samples, arrival: npt.NDArray[np.int64], inputs: Sequence[NamedInput] = (), **known: Any
) -> Flight:
    """The flight of samples (n,) as they arrived, with their arrivals [ns] (n,), the named ``inputs`` in the order of
    their values, and what else is ``known`` of it.
    """
    away = np.abs(samples.stamp - middle_stamp(samples.stamp)) / NANOSECONDS > _LONGEST
    kept = samples[~away]
    start, end = int(kept.stamp.min()), int(kept.stamp.max())

    def stream(kind: Kind, rows: npt.NDArray[np.int64], columns: slice, name: str = "") -> Stream:
        part = samples.stamp[rows], arrival[rows], samples.values[rows, columns], away[rows]
        return _stream(kind, *part, start, name)

    streams, of_inputs = {}, {}
    for kind, names in NAMES.items():
        rows = np.flatnonzero(samples.kind == kind)
        if len(rows):
            streams[kind] = stream(kind, rows, slice(0, 4 if kind == Kind.ATTITUDE else len(names)))
    for k, item in enumerate(inputs):
        rows = np.flatnonzero((samples.kind == Kind.INPUTS) & ~np.isnan(samples.values[:, k]))
        if len(rows):
            of_inputs[INPUTS + item.name] = stream(Kind.INPUTS, rows, slice(k, k + 1), INPUTS + item.name)
    return Flight(streams, (end - start) / NANOSECONDS, tuple(inputs), of_inputs, **known)


def _stream(
    kind: Kind,
    stamp: npt.NDArray[np.int64],
    arrival: npt.NDArray[np.int64],
    values: Array,
    away: npt.NDArray[np.bool_],
    start: int,
    name: str,
) -> Stream:
    disordered = int(np.sum(np.diff(stamp[~away]) < 0))
    usable = np.any(np.abs(values) <= WILD, axis=1)
    values = np.where(np.abs(values) <= WILD, values, np.nan)
    order = np.flatnonzero(usable & ~away)
    order = order[np.argsort(stamp[order], kind="stable")]
    repeated = repeats(stamp[order], values[order])
    order = order[~repeated]
    values = values[order]
    if kind == Kind.GPS_POSITION and not np.any(np.abs(values[:, :2]) > LARGEST_ANGLES):
        values[:, _LONGITUDE] = unwrapped(values[:, _LONGITUDE])
    return Stream(
        kind, (stamp[order] - start) / NANOSECONDS, (arrival[order] - stamp[order]) / NANOSECONDS, values,
        _between(usable), disordered, int(np.sum(away)), int(np.sum(repeated)), name,
    )  # fmt: skip


def unwrapped(angle: Array) -> Array:
    """An angle (n,) without its leaps of a turn, NaN where it is NaN."""
    out, known = angle.copy(), np.isfinite(angle)
    out[known] = np.unwrap(angle[known])
    return out


def _between(usable: npt.NDArray[np.bool_]) -> int:
    """Samples (n,) without a number between the first and the last with one; all where none has one."""
    at = np.flatnonzero(usable)
    return int(np.sum(~usable[at[0] : at[-1]])) if len(at) else len(usable)
