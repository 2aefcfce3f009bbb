"""What the filter did in a flight, step by step, for a smoother that goes back over it.

An hour of flight has some hundred thousand steps of 1.6 kB. Those of some minutes stay in memory; more go to temporary
files (in the folder that TMPDIR names, about 1 GB per hour at 100 Hz), so that memory does not grow with the flight.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from types import TracebackType
from typing import IO

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.state import ERROR_SIZE, STATE_SIZE, Setup, StateField

Array = npt.NDArray[np.float64]

# Columns of one step of the integration, from a measurement or IMU sample to the next.
STATE = slice(0, STATE_SIZE)  # filtered, before the step
_COVARIANCE = STATE_SIZE  # of its error, the lower triangle row by row
_FORCE = _COVARIANCE + ERROR_SIZE * (ERROR_SIZE + 1) // 2
FORCE = slice(_FORCE, _FORCE + 3)  # as measured, mean over the step
RATE = slice(_FORCE + 3, _FORCE + 6)
DT = _FORCE + 6  # [s]
DENSITY = slice(DT + 1, DT + 7)  # of the white noise of accelerometer and gyro, see process.add_process_noise
WIND_WALK = DT + 7  # [m/s per sqrt(s)] that the filter used
HAS_ROW = DT + 8  # 1: a row of state.StateField belongs to the end of the step
STEP_WIDTH = DT + 9
#: Bytes of a table that stay in memory: ten minutes of steps at 100 Hz.
IN_MEMORY = 160_000_000


@njit(cache=True)
def record_step(
    step: Array, x: Array, p: Array, force: Array, rate: Array, dt: float, density: Array, wind_walk: float
) -> None:
    """Write one step: the arguments of ``process.propagate`` before it."""
    step[STATE] = x
    at = _COVARIANCE
    for i in range(ERROR_SIZE):
        step[at : at + i + 1] = p[i, : i + 1]
        at += i + 1
    step[FORCE] = force
    step[RATE] = rate
    step[DENSITY] = density
    step[DT], step[WIND_WALK] = dt, wind_walk
    step[HAS_ROW] = 0.0


@njit(cache=True)
def recorded_covariance(step: Array) -> Array:
    """The covariance (18, 18) before a recorded step."""
    p = np.empty((ERROR_SIZE, ERROR_SIZE))
    at = _COVARIANCE
    for i in range(ERROR_SIZE):
        for j in range(i + 1):
            p[i, j] = p[j, i] = step[at]
            at += 1
    return p


@dataclass
class Segment:
    """A part of the flight without a break: numbers of steps and rows, and state and covariance at its end."""

    setup: Setup
    steps: int
    rows: int
    x: Array
    p: Array
    attitude_doubt: Array = field(default_factory=lambda: np.zeros(3))  # (3,) see ``StateEstimator.attitude_doubt``


class _Table:
    """Rows of one width: in memory while they are few, else in a temporary file."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._parts: list[Array] = []
        self._size = 0  # [bytes]
        self._file: IO[bytes] | None = None

    def add(self, rows: Array) -> None:
        """Take rows (n, width) before any are read. Neither they nor what they are the first of is to be used any more.

        Raises OSError where there is no room for them.
        """
        if not len(rows):
            return
        self._size += rows.nbytes
        if self._file is None and self._size > IN_MEMORY:
            self._file = tempfile.TemporaryFile()  # noqa: SIM115
            for part in self._parts:
                self._file.write(np.ascontiguousarray(part).data)
            self._parts = []
        if self._file is None:
            self._parts.append(rows)
        else:
            self._file.write(np.ascontiguousarray(rows).data)

    @property
    def rows(self) -> Array:
        """All of them (n, width), where they are: what is written to them stays."""
        if self._file is None:
            if len(self._parts) != 1:
                self._parts = [_joined(self._parts) if self._parts else np.empty((0, self._width))]
            return self._parts[0]
        self._file.flush()
        return np.asarray(np.memmap(self._file, np.float64, "r+").reshape(-1, self._width))

    def close(self) -> None:
        """What is in use stays; all else is gone."""
        self._parts = []
        if self._file is not None:
            self._file.close()


def _joined(parts: list[Array]) -> Array:
    """Rows one after the other, (n, width): where the first lie, if they were made with room for the others.

    A whole flight comes at once, and a few steps at its end.
    """
    first, room, count = parts[0], parts[0].base, sum(map(len, parts))
    if room is None or room.shape[1:] != first.shape[1:] or len(room) < count or room.ctypes.data != first.ctypes.data:
        return np.concatenate(parts)
    at = len(first)
    for part in parts[1:]:
        room[at : at + len(part)] = part
        at += len(part)
    return room[:count]


class SmootherHistory:
    """Records what a ``StateEstimator`` does when it is given to it before the first sample.

    A context manager: what it recorded is gone afterwards, but for what is in use.
    """

    def __init__(self) -> None:
        self._steps, self._rows = _Table(STEP_WIDTH), _Table(StateField.WIDTH)
        self._segments: list[Segment] = []

    def __enter__(self) -> SmootherHistory:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._steps.close()
        self._rows.close()

    def begin(self, setup: Setup) -> None:
        """The filter was aligned: what follows has nothing to do with what was before."""
        self._segments.append(Segment(setup, 0, 0, np.empty(0), np.empty((0, 0))))

    def add(self, steps: Array, rows: Array, x: Array, p: Array, attitude_doubt: Array | None = None) -> None:
        """Steps (m, STEP_WIDTH) and rows (n, StateField.WIDTH), and the filtered state x (19,), p (18, 18) after them.

        Steps stay where they are: neither they nor the array that they are the first of is to be used any more.

        ``attitude_doubt`` (3,): what the attitude of the recording may be off by then [rad].

        Raises InputError when they cannot be written.
        """
        segment = self._segments[-1]
        try:
            self._steps.add(steps)
            self._rows.add(rows.copy())
        except OSError as error:
            raise InputError(
                f"the smoother needs about 1 GB per hour of flight in {tempfile.gettempdir()}: {error.strerror}; "
                "set the variable TMPDIR to a folder that has it"
            ) from None
        segment.steps += len(steps)
        segment.rows += len(rows)
        segment.x, segment.p = x.copy(), p.copy()
        if attitude_doubt is not None:
            segment.attitude_doubt = attitude_doubt.copy()

    @property
    def rows(self) -> Array:
        """All rows of the flight (n, StateField.WIDTH); what is written to them stays."""
        return self._rows.rows

    def segments(self) -> Iterator[tuple[Segment, Array, Array]]:
        """The segments in order, each with its steps (m, STEP_WIDTH) and its rows (n, StateField.WIDTH)."""
        steps, rows = self._steps.rows, self.rows
        step = row = 0
        for segment in self._segments:
            yield segment, steps[step : step + segment.steps], rows[row : row + segment.rows]
            step, row = step + segment.steps, row + segment.rows
