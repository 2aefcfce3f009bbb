"""Does the first step contradict its sensors? Signs of trouble, from reconstructed states alone.

The first step is kinematics: no change of the aeroplane makes it contradict itself, only a sensor does. What counts is
what the state rests on (GPS, air data, vanes), innovations (their running mean square, how many fail the gate), biases
that leap, and a reconstruction that starts again. With P the variance of a bias as the filter states it and Q what it
allows the bias to wander, an estimate that is right moves from t_1 to t_2 by

    E (b_2 - b_1)^2 = P_1 - P_2 + Q (t_2 - t_1),

so that a multiple of that is a leap. Where an attitude is believed less than before, P is what has grown, and the bias
may leave its old value as far.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.state import (
    CONTRADICTED,
    D_ACCELEROMETER_BIAS,
    INFERRED,
    SUSPECTED,
    StateField,
    Status,
    contradiction_text,
)

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_INCONSISTENT, _LOOKS = THRESHOLDS.inconsistent, THRESHOLDS.inconsistent_looks
_MOST_REJECTED, _REJECTED_TIME = THRESHOLDS.most_rejected, THRESHOLDS.rejected_time
_LEAP, _LEAP_TIME, _LONGEST_GAP = THRESHOLDS.leap, THRESHOLDS.leap_time, THRESHOLDS.longest_gap
_AGITATION, _LEAST_AGITATION = THRESHOLDS.agitation, THRESHOLDS.least_agitation
_WIND_TIME = 1.0
_MEMORY, _LATELY = 60.0, 3.0  # [s] of wind and consistency; those of lately are no measure
_SLACK = 0.05  # [s] by which evaluations may come early or late

_TIME, _STATUS, _CONSISTENCY = StateField.TIME, StateField.STATUS, StateField.CONSISTENCY
_AIRSPEED, _REJECTED = StateField.AIRSPEED, StateField.REJECTED
_CONTRADICTED = StateField.CONTRADICTION
_ALPHA, _BETA, _WIND = StateField.ANGLE_OF_ATTACK, StateField.SIDESLIP, StateField.WIND.start
_BIASES = StateField.ACCELEROMETER_BIAS.start  # of the accelerometer, then of the gyro
_BIAS_STD = StateField.STANDARD_DEVIATIONS.start + D_ACCELEROMETER_BIAS
_BIAS_COUNT = 6
_NO_GPS, _NO_AIR_DATA, _INERTIAL_ONLY = Status.NO_GPS, Status.NO_AIR_DATA, Status.INERTIAL_ONLY
#: Statuses in which a vane measures each angle.
_OF_ALPHA_VANE = tuple(int(status) for status, inferred in INFERRED.items() if "alpha" not in inferred)
_OF_BETA_VANE = tuple(int(status) for status, inferred in INFERRED.items() if "beta" not in inferred)

#: What is wrong, in words; the number of each is a bit of what ``evaluate`` returns.
#: Those about one sensor, which say most, are the last of them.
CAUSES = tuple(contradiction_text(code) for code in CONTRADICTED)
LOST = ("no GPS", "no airspeed", "no angle of attack", "no sideslip")
WORDS = (
    "state reconstruction had to start over", *LOST,
    "sensors contradict each other", "measurements are rejected", "an IMU bias leaps", *CAUSES,
)  # fmt: skip
(
    _RESTARTED, _LOST_GPS, _LOST_AIRSPEED, _LOST_ALPHA, _LOST_BETA, _CONTRADICTION, _GATED, _LEAPT, _MISWIRED, *_,
) = (1 << i for i in range(len(WORDS)))  # fmt: skip

#: Evaluations that fit into the memories: at most one per tenth of a second.
_LOOKED_SIZE, _PAST_SIZE = 64, 1024
#: Columns of ``Memory.past``.
_PAST_TIME, _PAST_MOVED, _PAST_CONSISTENCY = 0, 1, 2
#: Elements of ``Memory.counts``.
_LOOKED, _PAST = 0, 1


class Sign(NamedTuple):
    """One thing that is wrong."""

    what: str  # one of WORDS, or other words
    suspect: int = 0  # number in SUSPECTED of whose innovations are too large; 0: nobody knows

    @property
    def words(self) -> str:
        """What is wrong, for people."""
        return f"{self.what}: {contradiction_text(self.suspect)}" if self.suspect else self.what

    @property
    def tells_sensor(self) -> bool:
        """Whether it says which sensor: one that is lost, or that contradicts all others by itself."""
        return self.what in LOST or 0 < self.suspect < max(SUSPECTED)


class Limits(NamedTuple):
    """What is usual of biases (6,) and of flight."""

    walk: Array  # variance per second that the filter allows
    least_leap: Array
    largest: Array
    minimum_airspeed: float


class Memory(NamedTuple):
    """What was seen before; the oldest first."""

    looked: Array  # (_LOOKED_SIZE, StateField.WIDTH) newest state of each evaluation of the last ``leap_time``
    past: Array  # (_PAST_SIZE, 3) time [s], movement of the wind [m/s], consistency
    counts: Integers  # (2,) how many of each there are
    vanes: npt.NDArray[np.bool_]  # (2,) alpha, beta: have been measured
    agitated: npt.NDArray[np.bool_]  # (1,) the wind leaps


@njit(cache=True)
def _ago(time: float, memory: Memory) -> int:
    """Newest evaluation that is not younger than ``time`` [s], or the oldest that there is."""
    count = memory.counts[_LOOKED]
    limit = memory.looked[count - 1, _TIME] - time + _SLACK
    for i in range(count - 1, -1, -1):
        if memory.looked[i, _TIME] <= limit:
            return i
    return 0


@njit(cache=True)
def _drop(array: Array, first: int, count: int) -> int:
    """Move rows ``first`` to ``count`` to the front; returns how many there are."""
    for i in range(first, count):
        array[i - first] = array[i]
    return count - first


@njit(cache=True)
def _follow_wind(row: Array, memory: Memory) -> None:
    """Is the wind more restless than it was?"""
    now, past, counts = row[_TIME], memory.past, memory.counts
    before = memory.looked[_ago(_WIND_TIME, memory)]
    moved = 0.0
    for k in range(3):
        moved += (row[_WIND + k] - before[_WIND + k]) ** 2
    moved = np.sqrt(moved)
    first = 0
    while first < counts[_PAST] and not past[first, _PAST_TIME] >= now - _MEMORY:
        first += 1
    first = max(first, counts[_PAST] + 1 - _PAST_SIZE)
    if first > 0:
        counts[_PAST] = _drop(past, first, counts[_PAST])
    past[counts[_PAST], _PAST_TIME], past[counts[_PAST], _PAST_MOVED] = now, moved
    past[counts[_PAST], _PAST_CONSISTENCY] = row[_CONSISTENCY]
    counts[_PAST] += 1
    square, number = 0.0, 0
    for i in range(counts[_PAST]):
        if past[i, _PAST_TIME] < now - _LATELY:
            square += past[i, _PAST_MOVED] ** 2
            number += 1
    memory.agitated[0] = number > 0 and moved > max(_AGITATION * np.sqrt(square / max(number, 1)), _LEAST_AGITATION)


@njit(cache=True)
def _lost(row: Array, memory: Memory) -> int:
    """Sensors that the state does without."""
    status, signs = int(row[_STATUS]), 0
    if status == _NO_GPS or status == _INERTIAL_ONLY:
        signs |= _LOST_GPS
    if status == _NO_AIR_DATA or status == _INERTIAL_ONLY:
        signs |= _LOST_AIRSPEED
    if status in _OF_ALPHA_VANE:
        alpha = np.isfinite(row[_ALPHA])
        if memory.vanes[0] and not alpha:
            signs |= _LOST_ALPHA
        memory.vanes[0] |= alpha
    if status in _OF_BETA_VANE:
        beta = np.isfinite(row[_BETA])
        if memory.vanes[1] and not beta:
            signs |= _LOST_BETA
        memory.vanes[1] |= beta
    return signs


@njit(cache=True)
def _at_odds(row: Array, memory: Memory) -> int:
    """Innovations that are too large."""
    signs, count = 0, memory.counts[_LOOKED]
    if count >= _LOOKS:
        least = np.inf
        for i in range(count - _LOOKS, count):
            least = min(least, memory.looked[i, _CONSISTENCY])
        if least > _INCONSISTENT:
            signs |= _CONTRADICTION
    if row[_REJECTED] - memory.looked[_ago(_REJECTED_TIME, memory), _REJECTED] > _MOST_REJECTED:
        signs |= _GATED
    return signs


@njit(cache=True)
def _leaps(row: Array, memory: Memory, limits: Limits) -> int:
    """Biases that move as no bias does, or are where none is."""
    past = memory.looked[_ago(_LEAP_TIME, memory)]
    elapsed = max(row[_TIME] - past[_TIME], 0.0)  # a clock may go back
    for k in range(_BIAS_COUNT):
        variance = abs(past[_BIAS_STD + k] ** 2 - row[_BIAS_STD + k] ** 2) + limits.walk[k] * elapsed
        moved = abs(row[_BIASES + k] - past[_BIASES + k])
        if moved > max(_LEAP * np.sqrt(variance), limits.least_leap[k]) or abs(row[_BIASES + k]) > limits.largest[k]:
            return _LEAPT
    return 0


@njit(cache=True)
def _evaluate(newest: Array, gap: float, memory: Memory, limits: Limits) -> int:
    """Signs in the newest state (StateField.WIDTH,) after states that were at most ``gap`` [s] apart, as bits."""
    looked, counts = memory.looked, memory.counts
    if counts[_LOOKED] == _LOOKED_SIZE:
        counts[_LOOKED] = _drop(looked, 1, counts[_LOOKED])
    looked[counts[_LOOKED]] = newest
    counts[_LOOKED] += 1
    first = 0
    while looked[first, _TIME] < newest[_TIME] - _LEAP_TIME - 2.0 * _SLACK:
        first += 1
    if gap > _LONGEST_GAP:
        first = counts[_LOOKED] - 1
    if first > 0:
        counts[_LOOKED] = _drop(looked, first, counts[_LOOKED])
    if gap > _LONGEST_GAP:
        return _RESTARTED
    _follow_wind(newest, memory)
    if not newest[_AIRSPEED] >= limits.minimum_airspeed:
        return 0
    code = int(newest[_CONTRADICTED]) if newest[_CONTRADICTED] > 0.0 else 0
    signs = _lost(newest, memory) | _at_odds(newest, memory) | _leaps(newest, memory, limits)
    return signs | _MISWIRED << (code - 1) if 0 < code <= len(CAUSES) else signs


@njit(cache=True)
def _widest_gap(times: Array, before: float, widest: float) -> float:
    """Longest step from ``before`` through the times (n,) [s], at least ``widest``."""
    for time in times:
        widest = max(widest, time - before)
        before = time
    return widest


class SensorFaultDetector:
    """Takes states and evaluates them now and then."""

    def __init__(self, aircraft: Aircraft) -> None:
        noise = aircraft.process_noise
        self._limits = Limits(
            walk=np.repeat([noise["accelerometer_bias"] ** 2, noise["gyro_bias"] ** 2], 3),
            least_leap=np.repeat(THRESHOLDS.least_leap, 3),
            largest=np.repeat([THRESHOLDS.largest_accelerometer_bias, THRESHOLDS.largest_gyro_bias], 3),
            minimum_airspeed=float(aircraft.minimum_airspeed),
        )
        self.restart()

    def restart(self) -> None:
        """The clock started over."""
        self._newest: Array | None = None
        self._suspect = 0  # number in SUSPECTED of whose innovations are too large
        self._gap = 0.0
        self._memory = Memory(
            looked=np.zeros((_LOOKED_SIZE, StateField.WIDTH)),
            past=np.zeros((_PAST_SIZE, 3)),
            counts=np.zeros(2, np.int64),
            vanes=np.zeros(2, np.bool_),
            agitated=np.zeros(1, np.bool_),
        )

    @property
    def agitated(self) -> bool:
        """Whether the wind leaps."""
        return bool(self._memory.agitated[0])

    def add(self, rows: Array) -> None:
        """States (n, StateField.WIDTH) in order of time."""
        times = rows[:, _TIME]
        if self._newest is not None:
            before = self._newest[_TIME]
        else:
            count = self._memory.counts[_LOOKED]
            before = self._memory.looked[count - 1, _TIME] if count else times[0]
        self._gap = _widest_gap(times, before, self._gap)
        self._newest = rows[-1]

    def evaluate(self) -> list[Sign]:
        """What is wrong since the last evaluation; nothing on the ground."""
        if self._newest is None:
            return []
        signs = _evaluate(self._newest, self._gap, self._memory, self._limits)
        contradicted = float(self._newest[_CONTRADICTED])
        code = int(contradicted) if contradicted > 0.0 else 0
        self._suspect = code if code in SUSPECTED else self._suspect if signs else 0
        self._newest, self._gap = None, 0.0
        return [self._sign(i) for i in range(len(WORDS)) if signs >> i & 1] if signs else []

    def _sign(self, i: int) -> Sign:
        """Where innovations are too large, with the sensor."""
        return Sign(WORDS[i], self._suspect if 1 << i in (_CONTRADICTION, _GATED) else 0)

    def are_too_quiet(self) -> bool:
        """Whether innovations are smaller than they were."""
        past = self._memory.past[: self._memory.counts[_PAST]]
        if not len(past):
            return False
        now, consistency = past[-1, _PAST_TIME], past[:, _PAST_CONSISTENCY]
        usual = consistency[past[:, _PAST_TIME] < now - _LATELY]
        lately = consistency[past[:, _PAST_TIME] > now - THRESHOLDS.quiet_time]
        return bool(len(usual) and lately.max() < THRESHOLDS.too_quiet * np.median(usual))
