"""Does the first step contradict its sensors? Signs of trouble, from the rows of reconstructed states alone.

The first step is kinematics: no change of the aeroplane makes it contradict itself, only a sensor does. Looked at are
what the state rests on (GPS, air data, vanes), innovations (their running mean square, how many fail the gate), biases
that leap and reconstruction that begins anew. With P the variance of a bias as the filter states it and Q what
it allows the bias to wander, an estimate that is right moves from t_1 to t_2 by

    E (b_2 - b_1)^2 = P_1 - P_2 + Q (t_2 - t_1),

so that a multiple of that is a leap.
"""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.modelling.regression import LARGEST_ACCELEROMETER_BIAS, LARGEST_GYRO_BIAS
from aircraft_sysid_ros.reconstruction.state import D_ACCELEROMETER_BIAS, Column, Status

Array = npt.NDArray[np.float64]

#: Mean normalised innovation squared that working sensors do not have at so many looks in a row: gusts that set in do
#: at one or two.
LARGEST_CONSISTENCY, LOOKS = 1.8, 3
#: The same over its median of a minute: what stands still is without noise, and too well predicted. Looked at over
#: QUIET_TIME [s]. Noise has other reasons to fall: it counts only after another sign.
LEAST_CONSISTENCY, QUIET_TIME = 0.8, 2.0
#: So many measurements fail the gate within GATE_TIME [s].
MOST_REJECTED, GATE_TIME = 7.0, 2.0
#: A leap of a bias: standard deviations of its movement over LEAP_TIME [s], and least size [m/s^2], [rad/s].
LEAP, LEAP_TIME, LEAST_LEAP = 8.0, 3.0, (0.05, 0.005)
#: Rows this far apart [s]: the first step had to begin anew.
LONGEST_GAP = 0.5
#: Wind that moves within a second by this many times what it did in the last minute, and by so much [m/s], follows a
#: sensor rather than the air. Gusts do so too: it counts only beside a model error.
AGITATION, LEAST_AGITATION = 4.0, 0.4
_MEMORY, _LATELY = 60.0, 3.0  # [s] of wind and consistency; those of lately are no measure
_BIASES = slice(Column.ACCELEROMETER_BIAS.start, Column.GYRO_BIAS.stop)
_BIAS_STD = slice(
    Column.STANDARD_DEVIATIONS.start + D_ACCELEROMETER_BIAS, Column.STANDARD_DEVIATIONS.start + D_ACCELEROMETER_BIAS + 6
)
_NO_GPS = (Status.NO_GPS, Status.INERTIAL_ONLY)
_NO_AIRSPEED = (Status.NO_AIR_DATA, Status.INERTIAL_ONLY)


class SensorSigns:
    """Takes rows of Column and looks at them now and then."""

    def __init__(self, aircraft: Aircraft) -> None:
        noise = aircraft.process_noise
        self._walk = np.repeat([noise["accelerometer_bias"] ** 2, noise["gyro_bias"] ** 2], 3)
        self._least = np.repeat(LEAST_LEAP, 3)
        self._largest = np.repeat([LARGEST_ACCELEROMETER_BIAS, LARGEST_GYRO_BIAS], 3)
        self._minimum_airspeed = aircraft.minimum_airspeed
        self.restart()

    def restart(self) -> None:
        """The clock began anew."""
        self._waiting: list[Array] = []
        self._looked: deque[Array] = deque()  # newest row of each look of the last LEAP_TIME
        self._past = np.empty((0, 3))  # time [s], movement of the wind [m/s], consistency
        self._vanes = np.zeros(2, np.bool_)  # alpha, beta: have been measured
        self.agitated = False  # the wind leaps

    def take(self, rows: Array) -> None:
        """Rows (n, Column.WIDTH) in order of time."""
        self._waiting.append(rows)

    def look(self) -> list[str]:
        """What is wrong since the last look, in words; nothing on the ground."""
        if not self._waiting:
            return []
        rows, self._waiting = np.vstack(self._waiting), []
        newest = rows[-1]
        before = self._looked[-1][Column.TIME] if self._looked else rows[0, Column.TIME]
        gap = float(np.diff(rows[:, Column.TIME], prepend=before).max())
        self._looked.append(newest.copy())
        while self._looked[0][Column.TIME] < newest[Column.TIME] - LEAP_TIME - 0.1:
            self._looked.popleft()
        if gap > LONGEST_GAP:
            self._looked.clear()
            self._looked.append(newest.copy())
            return ["state reconstruction had to begin anew"]
        self._follow(newest)
        if not newest[Column.AIRSPEED] >= self._minimum_airspeed:
            return []
        return [*self._lost(newest), *self._at_odds(newest), *self._leaps(newest)]

    def _lost(self, row: Array) -> list[str]:
        """Sensors that the state does without."""
        status, words = int(row[Column.STATUS]), []
        if status in _NO_GPS:
            words.append("no GPS")
        if status in _NO_AIRSPEED:
            words.append("no airspeed")
        angles = np.isfinite(row[[Column.ANGLE_OF_ATTACK, Column.SIDESLIP]])
        if status == Status.OK:
            names = np.array(["no angle of attack", "no sideslip"])[self._vanes & ~angles]
            words.extend(names.tolist())
            self._vanes |= angles
        return words

    def _at_odds(self, row: Array) -> list[str]:
        """Innovations that are too large."""
        words, lately = [], [look[Column.CONSISTENCY] for look in self._looked][-LOOKS:]
        if len(lately) == LOOKS and min(lately) > LARGEST_CONSISTENCY:
            words.append("sensors contradict each other")
        if row[Column.REJECTED] - self._ago(GATE_TIME)[Column.REJECTED] > MOST_REJECTED:
            words.append("measurements are rejected")
        return words

    def _leaps(self, row: Array) -> list[str]:
        """Biases that move as no bias does, or are where none is."""
        past = self._ago(LEAP_TIME)
        elapsed = max(float(row[Column.TIME] - past[Column.TIME]), 0.0)  # a clock may go back
        variance = np.maximum(past[_BIAS_STD] ** 2 - row[_BIAS_STD] ** 2, 0.0) + self._walk * elapsed
        moved = np.abs(row[_BIASES] - past[_BIASES])
        leapt = moved > np.maximum(LEAP * np.sqrt(variance), self._least)
        if leapt.any() or np.any(np.abs(row[_BIASES]) > self._largest):
            return ["an IMU bias leaps"]
        return []

    def _ago(self, time: float) -> Array:
        """Newest row of a look that is not younger than ``time`` [s], or the oldest that there is."""
        now = self._looked[-1][Column.TIME]
        old = [row for row in self._looked if row[Column.TIME] <= now - time + 0.05]
        return old[-1] if old else self._looked[0]

    def _follow(self, row: Array) -> None:
        """Is the wind more restless than it was?"""
        now, consistency = float(row[Column.TIME]), float(row[Column.CONSISTENCY])
        moved = float(np.linalg.norm(row[Column.WIND] - self._ago(1.0)[Column.WIND]))
        self._past = np.vstack([self._past[self._past[:, 0] >= now - _MEMORY], [[now, moved, consistency]]])
        usual = self._past[self._past[:, 0] < now - _LATELY, 1]
        self.agitated = bool(
            len(usual) and moved > max(AGITATION * float(np.sqrt(np.mean(usual**2))), LEAST_AGITATION)
        )

    def are_too_quiet(self) -> bool:
        """Whether innovations are smaller than they were."""
        if not len(self._past):
            return False
        now, consistency = self._past[-1, 0], self._past[:, 2]
        usual, lately = consistency[self._past[:, 0] < now - _LATELY], consistency[self._past[:, 0] > now - QUIET_TIME]
        return bool(len(usual) and lately.max() < LEAST_CONSISTENCY * np.median(usual))
