"""An IMU that is slow beside the motion: what a straight line between two of its samples misses.

Where samples are dense the input of the filter is a straight line between them. At 10 Hz that line takes x^2 / 3 of a
motion away, x = omega T / 2: 3 % at 1 Hz, 13 % at 2 Hz. Three samples say more. The parabola through them exceeds the
line by

    b (t - t0) (t - t1),    b = f[t_-1, t0, t1], the second divided difference,

whose mean over the interval T is c = - b T^2 / 6. It is put in, and as its own error: c^2 is added to the variance of
the sample, as the error of a Runge-Kutta step is taken from a pair of them. In smooth motion it is nothing, after a
sample that was lost it is much.

Dense and sparse is told by stamps alone: more than half of the newest intervals are longer than LONG.

Dense samples are integrated along the line, too, and what they are sampled of is not smooth: gusts shake an aeroplane
as white noise does that was integrated once, and each sample is of an instant. Between two samples such a force is a
Brownian bridge: of a random walk of the intensity w the line misses w T / 12 of the variance of the mean. What one
slope and the next differ by has the variance w (1 / T0 + 1 / T1), and of white noise of a sample of the variance s^2

    s^2 (1 / T0^2 + 1 / T1^2 + (1 / T0 + 1 / T1)^2).

So w is learnt, axis by axis, and what the line misses is added to the variance of a sample, a hole's by its length. In
moderate turbulence that is forty times the noise of a good accelerometer, where the vertical velocity and the bias had
errors of twice their standard deviations. Of sparse samples slopes differ by the motion itself, and w is what one b and
the next differ by more than white noise does: gusts have as much of that as before, motion much less.

A hole among dense samples, where a logger waited or a link lost packets, is integrated along the line, and that misses
up to x^2 / 3 of the motion. How large that is, the last second says, or the step across the hole where it is more; it
is added to the variance of the sample. Slopes beside the hole say less: in them the noise of dense samples is large.
An IMU that repeats one sample to the last bit, as a recorder does that has no new one, hides as much or more: over a
time T a value that stands misses x = omega T / 2 of the motion.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.state import Memory

Array = npt.NDArray[np.float64]

#: Interval [s] between IMU samples from which they are sparse.
LONG = 0.025
#: Votes for sparse go up to this, one per interval: a lost sample here and there does not make half of them.
_MOST_VOTES = 24
#: Motion in a hole is as quick as this [rad/s], and as large as it was in this time [s]. Judgements: short periods and
#: rolls of small aeroplanes have about 1 Hz, those of larger ones less.
_QUICK, _LATELY = 2.0 * np.pi, 1.0


@njit(cache=True)
def votes_are_for_sparse(memory: Memory) -> bool:
    """Whether samples are sparse, by the votes so far."""
    return bool(2 * memory.sparse[0] > _MOST_VOTES)


@njit(cache=True)
def is_sparse(interval: float, memory: Memory) -> bool:
    """Whether samples are sparse; ``interval`` [s] is the newest, and votes."""
    votes = memory.sparse[0] + (1 if interval > LONG else -1)
    memory.sparse[0] = min(max(votes, 0), _MOST_VOTES)
    return votes_are_for_sparse(memory)


@njit(cache=True)
def second_difference(time: float, values: Array, longest: float, memory: Memory, out: Array) -> None:
    """b of specific force and angular rate into ``out`` (6,), from a new sample and the two before it.

    Zero where the two before it are further apart than ``longest`` [s].
    """
    now, before = time - memory.imu[0], memory.imu[0] - memory.imu_before[0]
    for i in range(6):
        out[i] = 0.0
        if 0.0 < before <= longest and now > 0.0:
            old = (memory.imu[1 + i] - memory.imu_before[1 + i]) / before
            out[i] = ((values[i] - memory.imu[1 + i]) / now - old) / (now + before)


@njit(cache=True)
def mean_beyond_line(a: float, b: float, interval: float) -> float:
    """Mean of (t - t0) (t - t1) [s^2] from the share ``a`` to the share ``b`` of an interval [s]."""
    return interval * interval * ((a * a + a * b + b * b) / 3.0 - 0.5 * (a + b))


@njit(cache=True)
def note_motion(interval: float, values: Array, memory: Memory) -> None:
    """Mean and variance of what the IMU has measured lately, with one more sample ``interval`` [s] after the last."""
    gain = min(interval / _LATELY, 1.0)
    for i in range(6):
        away = values[i] - memory.motion[0, i]
        memory.motion[0, i] += gain * away
        memory.motion[1, i] = (1.0 - gain) * (memory.motion[1, i] + gain * away * away)


@njit(cache=True)
def missed_by_line(interval: float, values: Array, variance: tuple[float, float], memory: Memory, out: Array) -> None:
    """Variance (6,) of the mean input over an ``interval`` [s] before a sample for what the line between two samples
    misses where they are dense, into ``out``; ``variance`` of a sample of accelerometer and gyro is noise. Dense
    intervals tell how large it is.
    """
    before = memory.imu[0] - memory.imu_before[0]
    if 0.0 < interval <= LONG and 0.0 < before <= LONG:
        old, new, gain = 1.0 / before, 1.0 / interval, min(interval / _LATELY, 1.0)
        of_noise = (old * old + new * new) / (old + new) + old + new
        for i in range(6):
            slope = old * (memory.imu[1 + i] - memory.imu_before[1 + i])
            bend = new * (values[i] - memory.imu[1 + i]) - slope
            memory.line[i] += gain * (bend * bend / (old + new) - of_noise * variance[i // 3] - memory.line[i])
    for i in range(6):
        out[i] = max(memory.line[i], 0.0) * interval / 12.0


@njit(cache=True)
def missed_by_parabola(
    interval: float, longest: float, values: Array, variance: tuple[float, float], memory: Memory, out: Array
) -> None:
    """The same of sparse samples, where the parabola through three of them takes the place of the line. Intervals above
    ``longest`` [s] tell nothing.
    """
    before, first = memory.imu[0] - memory.imu_before[0], memory.imu_before[0] - memory.imu_first[0]
    if 0.0 < interval <= longest and 0.0 < before <= longest and 0.0 < first <= longest:
        new, old, gain = 1.0 / (before + interval), 1.0 / (first + before), min(interval / _LATELY, 1.0)
        of_walk = new * new / interval + (new + old) ** 2 / before + old * old / first
        of_noise = (
            (new / interval) ** 2
            + (new / interval + (new + old) / before) ** 2
            + ((new + old) / before + old / first) ** 2
            + (old / first) ** 2
        )
        for i in range(6):
            middle = (memory.imu[1 + i] - memory.imu_before[1 + i]) / before
            bend = new * ((values[i] - memory.imu[1 + i]) / interval - middle)
            bend -= old * (middle - (memory.imu_before[1 + i] - memory.imu_first[1 + i]) / first)
            memory.line[i] += gain * ((bend * bend - of_noise * variance[i // 3]) / of_walk - memory.line[i])
    for i in range(6):
        out[i] = max(memory.line[i], 0.0) * interval / 12.0


@njit(cache=True)
def hidden_motion(interval: float, values: Array, memory: Memory) -> tuple[float, float]:
    """Variance of the mean specific force [(m/s^2)^2] and angular rate [(rad/s)^2] over a hole of ``interval`` [s]
    before a sample, for what the line across it misses: that of the axis with most.
    """
    missed = min((0.5 * _QUICK * interval) ** 2 / 3.0, 1.0) ** 2
    force = rate = 0.0
    for i in range(6):
        step = 0.5 * (values[i] - memory.imu[1 + i])
        of_axis = missed * max(memory.motion[1, i], step * step)
        force, rate = (max(force, of_axis), rate) if i < 3 else (force, max(rate, of_axis))
    return force, rate


@njit(cache=True)
def held_motion(interval: float, time: float, values: Array, memory: Memory) -> tuple[float, float]:
    """The same over an ``interval`` [s] up to ``time`` [s] for an IMU that repeats what it has shown for longer than
    LONG, or repeats it no more: then the step shows what was missed. What it shows anew is noted.
    """
    is_new = False
    for i in range(6):
        is_new = is_new or values[i] != memory.imu[1 + i]
    before = time - interval - memory.shown_since[0]
    if is_new:
        memory.shown_since[0] = time
    if not before + (0.0 if is_new else interval) > LONG or not interval > 0.0:
        return 0.0, 0.0
    held, force, rate = _missed_while_held(before), 0.0, 0.0
    for i in range(6):
        motion = memory.motion[1, i]
        missed = 0.5 * min(before, _LATELY) * (values[i] - memory.imu[1 + i])
        whole = missed * missed if is_new else motion * _missed_while_held(before + interval)
        grown = max(whole - motion * held, 0.0) / interval**2
        force, rate = (max(force, grown), rate) if i < 3 else (force, max(rate, grown))
    return force, rate


@njit(cache=True)
def _missed_while_held(time: float) -> float:
    """Variance of the integral over a ``time`` [s] of motion of the variance 1, of which a value that stands is taken.

    After _LATELY what is missed is as if by chance.
    """
    square = time * time if time < _LATELY else _LATELY * (2.0 * time - _LATELY)
    return min((0.5 * _QUICK * time) ** 2, 1.0) * square
