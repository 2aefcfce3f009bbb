"""Controls, heights, vanes and mass properties as they come, late or early, and what they are at times of states."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import SURFACES, Aircraft
from aircraft_sysid_ros.aircraft.signals import CONTROL_WORDS, MOST_INPUTS
from aircraft_sysid_ros.flight_model.layout import CONTROL_COUNT
from aircraft_sysid_ros.identification.coefficients.body import body_of, body_with
from aircraft_sysid_ros.identification.coefficients.flow_angles import VANES
from aircraft_sysid_ros.identification.coefficients.ground import Ground, altitudes
from aircraft_sysid_ros.identification.coefficients.layout import Body
from aircraft_sysid_ros.identification.coefficients.pace import SPARSEST_CONTROLS, Pace
from aircraft_sysid_ros.identification.coefficients.signals import (
    INPUT_HELD,
    STEPS_BEFORE,
    interpolate,
    interpolate_sparse,
    moved_unseen,
    named_inputs,
)
from aircraft_sysid_ros.reconstruction.filter_setup import measured_at, stamp_delays
from aircraft_sysid_ros.reconstruction.servo_lag import servo_lag
from aircraft_sysid_ros.reconstruction.sparse_imu import LONG
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.samples import CONTROL_COLUMNS, Kind, Samples, is_absurd, repeats
from aircraft_sysid_ros.stamps import seconds

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Late samples of a kind that are kept, in case the clock started over and the states have yet to say so.
_MOST_BEHIND = 1000
#: Longest time [s] to a sample that a straight line is drawn to, however long is waited for it.
_LONGEST_LINE = 0.2
#: Samples so far [s] ahead of the states are by a clock that was set.
_FAR_AHEAD = 60.0
#: So many values within so long [s] that no aircraft has are no faults of transmission: the unit is another one.
_MOST_ABSURD, _ABSURD_TIME = 10, 30.0
#: Kinds that the first step hears and counts, too.
_OF_FIRST_STEP = [kind for kind, _ in VANES]


def _after(series: tuple[Array, Array], time: float) -> tuple[Array, Array]:
    """The part of a series, times (n,) and values (n, k), that is later than ``time`` [s]."""
    return series[0][series[0] > time], series[1][series[0] > time]


class ControlHistory:
    """Series of controls, inputs, heights and vanes [s after the epoch], and the body that mass properties make."""

    def __init__(self, aircraft: Aircraft, settle: float) -> None:
        """``settle`` [s]: how much later than the state a sample may come."""
        self._aircraft, self.settle = aircraft, settle
        self._delays = stamp_delays(aircraft)
        self._servos = servo_lag(aircraft)
        self._signs = np.array([*(aircraft.surface_signs[s] for s in SURFACES), 1.0, 1.0, 1.0])
        self._noise = np.full(CONTROL_COUNT, np.inf)  # one sigma of the surfaces; what else moves is slow
        self._noise[: len(SURFACES)] = aircraft.sensors["control_surfaces"].noise[0]
        self._masses: list[tuple[float, float, Array]] = []  # from when on each counts [s], its own time [s], values
        self._mass_counts = False  # one that was said
        self.ground = Ground(aircraft)
        self.body = body_of(aircraft)
        self.late = 0
        self.late_vanes = 0
        self.pace = Pace()  # of the controls
        self._misread: dict[int, float] = {}  # columns of controls whose unit is another one, since when [s]
        self._behind: dict[Kind, deque[tuple[float, Array]]] = {}
        self._series: dict[Kind, tuple[Array, Array]] = {}
        self.used_until = -np.inf
        self.restart_clock()

    def restart_clock(self) -> None:
        """The clock started over. Samples by the new clock that were late or far ahead by the old one are taken now."""
        behind = self._behind
        known = self.used_until if np.isfinite(self.used_until) else np.inf  # before any was used nothing is far ahead
        ahead = {kind: _after(series, known + _FAR_AHEAD) for kind, series in self._series.items()}
        self._masses = [
            (time if time < since or time > known + _FAR_AHEAD else -np.inf, time, values)
            for since, time, values in self._masses
        ]
        self._masses.sort(key=lambda item: item[0])
        self._series = {
            Kind.CONTROLS: (np.empty(0), np.empty((0, CONTROL_COUNT))),
            Kind.INPUTS: (np.empty(0), np.empty((0, MOST_INPUTS))),
            Kind.HEIGHT: (np.empty(0), np.empty((0, 1))),
            **{kind: (np.empty(0), np.empty((0, 1))) for kind, _ in VANES},
        }
        self._behind = {kind: deque(maxlen=_MOST_BEHIND) for kind in self._series}
        self.used_until = -np.inf
        self.ground.restart_clock()
        self.pace.restart()
        self._absurd: list[list[float]] = [[] for _ in range(CONTROL_COUNT)]  # times [s] of values that none has
        self._misread = dict.fromkeys(self._misread, -np.inf)
        for kind, (times, values) in ahead.items():
            self._insert(kind, times, values)
        for kind, samples in behind.items():
            self._count_late(kind, -len(samples))
            for time, values in samples:
                self._insert(kind, np.array([time]), values[None])

    def add(self, samples: Samples, epoch: int, due: Integers | None = None) -> None:
        """Take controls, named inputs, heights, vanes and mass properties; other kinds are passed over.

        ``due`` (n,) [ns] is the newest time of states that could have come before each sample, where samples come in
        blocks: what was late by then is late, however large the blocks are.
        """
        samples = self._servos.follow(samples)
        times = measured_at(samples, self._delays, epoch)
        absurd = is_absurd(samples)
        values = np.where(absurd, np.nan, samples.values)
        if absurd.any():
            of_controls = samples.kind == Kind.CONTROLS
            self._note_absurd(times[of_controls], absurd[of_controls, :CONTROL_COUNT])
        for kind in self._series:
            chosen = samples.kind == kind
            if chosen.any():
                used = None if due is None else seconds(due[chosen], epoch) - self.settle
                self._insert(kind, times[chosen], values[chosen], used)
        for i in np.flatnonzero(samples.kind == Kind.MASS):  # one that comes late counts from then on
            before = -np.inf if due is None else float(seconds(due[i : i + 1], epoch)[0]) - self.settle
            self._masses.append((max(float(times[i]), before, self.used_until), float(times[i]), values[i]))
            self._masses.sort(key=lambda item: item[0])

    def _note_absurd(self, times: Array, absurd: npt.NDArray[np.bool_]) -> None:
        """Values (n, CONTROL_COUNT) that no aircraft has: too many are of another unit, such as degrees."""
        for column in np.flatnonzero(absurd.any(axis=0)).tolist():
            seen = self._absurd[column]
            seen.extend(times[absurd[:, column]].tolist())
            seen.sort()
            spans = np.array(seen[_MOST_ABSURD - 1 :]) - seen[: max(len(seen) - _MOST_ABSURD + 1, 0)]
            if (enough := np.flatnonzero(spans <= _ABSURD_TIME)).size and column not in self._misread:
                self._misread[column] = seen[int(enough[0]) + _MOST_ABSURD - 1]
            del seen[: -2 * _MOST_ABSURD]

    def misread(self, time: float) -> list[str]:
        """Controls that had values at ``time`` [s] which are of another unit, in words."""
        return [
            f"values of the {CONTROL_WORDS[CONTROL_COLUMNS[column]]} cannot be in {unit}"
            for column, since in sorted(self._misread.items())
            if time >= since and (unit := "rad" if column < len(SURFACES) else "SI units")
        ]

    @property
    def mass_in_words(self) -> str:
        """That no mass that was said counts, since its stamp is far ahead of the states; empty: not so."""
        ahead = self._masses[0][0] - self.used_until if self._masses else 0.0
        if self._mass_counts or not _FAR_AHEAD < ahead < np.inf:
            return ""
        return (
            f"the mass is that of the aircraft file: the one that was said is stamped {ahead:.3g} s ahead of the "
            "states, and counts from then on: stamp all by one clock"
        )

    @property
    def _between(self) -> float:
        """Longest time [s] to a sample that a straight line is drawn to."""
        return min(self.settle, _LONGEST_LINE)

    @property
    def _input_reach(self) -> float:
        """How far back [s] a value of a named input may be used."""
        return 2.0 * max(INPUT_HELD, self.settle, SPARSEST_CONTROLS)

    def _insert(self, kind: Kind, times: Array, values: Array, used: Array | None = None) -> None:
        """Keep a series sorted; what comes after its time was used, or could have been (n,) [s], is late."""
        due = np.full(len(times), self.used_until) if used is None else np.maximum(used, self.used_until)
        in_time = times > due
        self._count_late(kind, int((~in_time).sum()))
        if kind == Kind.CONTROLS:
            self.pace.note_late((due - times)[~in_time], bool(np.any(in_time & np.isfinite(due))))
        if in_time.any():
            self._behind[kind].clear()
        self._behind[kind].extend(zip(times[~in_time].tolist(), values[~in_time], strict=True))
        old_times, old_values = self._series[kind]
        all_times = np.concatenate([old_times, times[in_time]])
        all_values = np.vstack([old_values, values[in_time, : old_values.shape[1]]])
        order = np.argsort(all_times, kind="stable")
        all_times, all_values = all_times[order], all_values[order]
        kept = ~repeats(all_times, all_values)
        self._series[kind] = (all_times[kept], all_values[kept])

    def _count_late(self, kind: Kind, count: int) -> None:
        if kind in _OF_FIRST_STEP:
            self.late_vanes += count
        else:
            self.late += count

    def at(self, rows: Array, sparse: bool) -> tuple[Array, Array]:
        """Controls (n, 17), with the signs of the aircraft file, and heights above ground (n,) [m] of states (n, …).

        NaN where nothing says where the ground is.

        The seven of Kind.CONTROLS, and the named inputs.

        ``sparse``: the states are far apart beside the motion.
        """
        times = rows[:, StateField.TIME]
        series = self._series[Kind.CONTROLS]
        if sparse:
            controls = interpolate_sparse(*series, times, SPARSEST_CONTROLS, self._between)
        else:
            controls = interpolate(*series, times, self._between, 2.0 / self._aircraft.sensors["control_surfaces"].rate)
            controls[moved_unseen(*series, times, self._noise, 2.0 * LONG, self.settle)] = np.nan
        heights = interpolate(*self._series[Kind.HEIGHT], times, self._between, self._between)[:, 0]
        controls = np.hstack([controls * self._signs, self._inputs_at(times, sparse)])
        return controls, np.where(np.isfinite(heights), heights, altitudes(rows) - self.ground.below(rows))

    def _inputs_at(self, at: Array, sparse: bool) -> Array:
        """Named inputs (n, MOST_INPUTS)."""

        def between(times: Array, values: Array, at: Array) -> Array:
            if sparse:
                return interpolate_sparse(times, values, at, SPARSEST_CONTROLS, self._between)
            return interpolate(times, values, at, self._between)

        return named_inputs(len(self._aircraft.inputs), *self._series[Kind.INPUTS], at, between)

    def vanes(self) -> list[tuple[Array, Array]]:
        """Times [s] and values (k, 1) of each of VANES."""
        return [self._series[kind] for kind, _ in VANES]

    def forget_before(self, used_until: float) -> None:
        """States up to a time [s] have been used."""
        times = self._series[Kind.CONTROLS][0]
        self.pace.take(times[(times > self.used_until) & (times <= used_until)])
        self.used_until = used_until
        for kind, (times, values) in self._series.items():
            reach = used_until - (
                self._input_reach if kind == Kind.INPUTS else self.settle
            )  # as ``moved_unseen`` looks
            keep = max(int(np.searchsorted(times, reach)) - 2 - STEPS_BEFORE, 0)
            self._series[kind] = (times[keep:], values[keep:])

    def parts_of_one_mass(self, rows: Array) -> Iterator[tuple[Array, Body]]:
        """States split where mass properties change, each part with its body."""
        while self._masses and self._masses[0][0] <= rows[-1, StateField.TIME]:
            time, _, values = self._masses.pop(0)
            self._mass_counts = True
            at = int(np.searchsorted(rows[:, StateField.TIME], time))
            if at:
                yield rows[:at], self.body
            rows = rows[at:]
            self.body = body_with(self._aircraft, self.body, values)
        yield rows, self.body
