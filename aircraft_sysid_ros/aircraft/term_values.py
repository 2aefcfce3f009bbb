"""Values of expressions along a flight: programs linked to one table, and what those with a memory remember.

``lag(x, tau)`` and ``limited(x, rate)`` are signals that the model makes: ``Memory`` writes them into the signal row,
sample by sample, and the program of the term reads them there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.expression import Lag, Program
from aircraft_sysid_ros.aircraft.postfix import LAG, SIGNAL, evaluate_rows
from aircraft_sysid_ros.aircraft.signals import FIRST_LAG, MOST_LAGS, SIGNAL_COUNT, SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.kernels import njit


def lags_of(programs: Sequence[Program]) -> tuple[Lag, ...]:
    """The different lags that programs read, in the order of their signals. Raises InputError beyond MOST_LAGS."""
    found = {lag.text: lag for program in programs for lag in program.lags}
    if len(found) > MOST_LAGS:
        raise InputError(f"the model has {len(found)} different lags: at most {MOST_LAGS} can be followed, remove some")
    return tuple(found.values())


def link(
    programs: Sequence[Program], lags: Sequence[Lag] | None = None
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Join programs for evaluate_programs: code of shape (n, 2) and the offsets (len(programs) + 1,).

    ``lags``: those that the signal rows hold, where they are not those of these programs alone.
    """
    if len(programs) == 1 and not programs[0].lags:
        return programs[0].code, np.array([0, len(programs[0].code)])
    places = {lag.text: FIRST_LAG + k for k, lag in enumerate(lags_of(programs) if lags is None else lags)}
    offsets = np.cumsum([0, *(len(program.code) for program in programs)]).astype(np.int64)
    code = np.vstack([program.code for program in programs]) if programs else np.empty((0, 2))
    for program, first in zip(programs, offsets, strict=False):
        for k, lag in enumerate(program.lags):
            own = code[first : first + len(program.code)]
            own[(own[:, 0] == LAG) & (own[:, 1] == k)] = (SIGNAL, places[lag.text])
    return code, offsets


@njit(cache=True)
def _moved(place: float, wanted: float, most: float) -> float:
    """A place after it has moved towards the one that is wanted, by so much at most."""
    return wanted if np.isinf(most) or np.isnan(wanted) else min(max(wanted, place - most), place + most)


@njit(cache=True)
def rate_limited(values: npt.NDArray[np.float64], rate: float, step: float) -> npt.NDArray[np.float64]:
    """What follows values (n,) that are ``step`` [s] apart and moves by no more than ``rate`` in a second."""
    out = values.copy()
    for i in range(1, len(values)):
        out[i] = _moved(out[i - 1], values[i], rate * step)
    return out


@njit(cache=True)
def lagged(y: float, before: float, now: float, step: float, tau: float) -> float:
    """What y is after a step [s] in which x goes straight from ``before`` to ``now``: tau y' + y = x, exactly."""
    kept = np.exp(-step / tau)
    mean = (1.0 - kept) * tau / step  # of exp(-t / tau) over the step
    return kept * y + (mean - kept) * before + (1.0 - mean) * now


@njit(cache=True)
def follow_lags(
    code: npt.NDArray[np.float64],
    offsets: npt.NDArray[np.int64],
    taus: npt.NDArray[np.float64],
    rates: npt.NDArray[np.float64],
    times: npt.NDArray[np.float64],
    rows: npt.NDArray[np.float64],
    longest: float,
    memory: npt.NDArray[np.float64],
) -> None:
    """Write the lags into signal rows (n, SIGNAL_COUNT) at ``times`` (n,) [s], going on from ``memory`` (k, 3).

    The exact solution of tau y' + y = x for an x that is linear between rows, and no faster than the rates [1/s].
    ``memory`` holds time, x and y of each lag; what does not follow on within ``longest`` [s], or was NaN, begins in
    the steady state y = x.
    """
    followed = np.empty((len(rows), len(taus)))
    evaluate_rows(code, offsets, rows, followed)
    for i in range(len(rows)):
        for k in range(len(taus)):
            x, (past, x0, y) = followed[i, k], memory[k]
            step = times[i] - past
            follows_on, most = 0.0 < step <= longest and np.isfinite(y), rates[k] * step
            if not follows_on:
                y = x
            elif taus[k] <= 0.0:
                y = _moved(y, x, most)
            else:
                y = lagged(y, x0, x, step, taus[k])
            memory[k, 0], memory[k, 1], memory[k, 2] = times[i], x, y
            rows[i, FIRST_LAG + k] = y


class Memory:
    """What the lags of a model remember of one stretch of flight, row by row, in batches of any size."""

    def __init__(self, lags: Sequence[Lag]) -> None:
        self._code, self._offsets = link([lag.program for lag in lags])
        self._taus = np.array([lag.tau for lag in lags])
        self._rates = np.array([lag.rate for lag in lags])
        self.forget()

    def forget(self) -> None:
        """The next row begins in the steady state."""
        self._state = np.full((len(self._taus), 3), np.nan)

    def write(self, times: npt.NDArray[np.float64], rows: npt.NDArray[np.float64], longest: float) -> None:
        """Lags into signal rows, which follow those before: ``follow_lags``."""
        follow_lags(self._code, self._offsets, self._taus, self._rates, times, rows, longest, self._state)


def with_lags(
    lags: Sequence[Lag], times: npt.NDArray[np.float64], rows: npt.NDArray[np.float64], longest: float
) -> npt.NDArray[np.float64]:
    """Signal rows (n, SIGNAL_COUNT) of a flight in order of time [s] with lags; the rows themselves without any.

    A pause longer than ``longest`` [s] starts over.
    """
    if not lags:
        return rows
    out = np.array(rows)
    Memory(lags).write(np.ascontiguousarray(times), out, longest)
    return out


def evaluate_signals(
    programs: Sequence[Program], times: npt.NDArray[np.float64], rows: npt.NDArray[np.float64], longest: float
) -> npt.NDArray[np.float64]:
    """Values (n, len(programs)) on the signal rows of a flight in order of time, with lags as ``with_lags``."""
    return values_on(programs, with_lags(lags_of(programs), times, rows, longest))


def values_on(programs: Sequence[Program], rows: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Values (n, len(programs)) on signal rows that hold the lags of these programs."""
    out = np.empty((len(rows), len(programs)))
    evaluate_rows(*link(programs), rows, out)
    return out


def evaluate(
    programs: Sequence[Program], signals: Mapping[str, npt.ArrayLike], inputs: tuple[str, ...] = ()
) -> npt.NDArray[np.float64]:
    """Evaluate programs on arrays of signals: result of shape (n, len(programs)); a missing signal is NaN.

    ``inputs``: names of the aircraft's own, with which the programs were parsed. Lags follow the signal ``time``;
    without it every row is in the steady state.
    """
    size = max((np.size(value) for value in signals.values()), default=1)
    rows = np.full((size, SIGNAL_COUNT), np.nan)
    for name, value in signals.items():
        rows[:, (*SIGNALS, *inputs).index(name)] = value
    return evaluate_signals(programs, rows[:, SIGNAL_INDEX["time"]], rows, np.inf)
