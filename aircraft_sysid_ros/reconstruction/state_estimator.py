"""First step: samples in, reconstructed states out. The live node and the replay drive the same object."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.earth import Odometer
from aircraft_sysid_ros.aircraft.frames import rotation_matrix
from aircraft_sysid_ros.reconstruction.air_data_errors import (
    StartValues,
    error_table,
    extended,
    with_start,
    without_errors,
)
from aircraft_sysid_ros.reconstruction.alignment import LARGEST_GAP, LEAST_WINDOW, keep_biases
from aircraft_sysid_ros.reconstruction.drift import Drift
from aircraft_sysid_ros.reconstruction.filter_setup import (
    CALM_STD,
    gate_thresholds,
    guide_of,
    learns_wind,
    new_setup,
    sensor_delays,
    sensor_scales,
    with_options,
)
from aircraft_sysid_ros.reconstruction.gps_wait import Batch
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.ordering import Released, TimeOrder
from aircraft_sysid_ros.reconstruction.sample_loop import DIVERGED, ELSEWHERE, RUNNING, run
from aircraft_sysid_ros.reconstruction.sensor_noise import believed_variance, bounded, mean_attitude_errors
from aircraft_sysid_ros.reconstruction.smoother_history import STEP_WIDTH, SmootherHistory
from aircraft_sysid_ros.reconstruction.start_up import StartUp
from aircraft_sysid_ros.reconstruction.state import (
    ATTITUDE,
    D_ACCELEROMETER_BIAS,
    D_AIR_VELOCITY,
    D_GYRO_BIAS,
    D_POSITION,
    ERROR_SIZE,
    GUSTY_START,
    INFERRED,
    NO_GUIDE,
    STATE_SIZE,
    LearntNoise,
    Memory,
    Setup,
    StateField,
    Status,
    new_memory,
    take_noise,
    without_wind,
)
from aircraft_sysid_ros.reconstruction.state_row import doubt_attitudes, wind_jacobian, wind_of
from aircraft_sysid_ros.reconstruction.stuck_sensors import StuckSensors
from aircraft_sysid_ros.records import in_array
from aircraft_sysid_ros.samples import (
    GPS_NED,
    SAME_FLIGHT,
    Kind,
    Samples,
    concatenate,
    is_absurd,
    manoeuvres_in_turn,
    samples_of,
)
from aircraft_sysid_ros.stamps import NANOSECONDS, epoch_of, seconds

Array = npt.NDArray[np.float64]

#: Kinds that the first step uses. Any other would split the integration between two IMU samples, so that the
#: numbers depended on who else listens.
_USED = np.isin(np.arange(len(Kind)), (Kind.CONTROLS, Kind.HEIGHT, Kind.MASS, Kind.FIVE_HOLE, Kind.INPUTS), invert=True)
#: Of those, what a watch sees: what moves the surfaces, and by them rolls the aeroplane.
BESIDE = (Kind.CONTROLS, Kind.INPUTS)
#: Share of what a pitch may be off that the constant of a vane is: at most 0.42 of it in eight flights whose attitude
#: drifts by 0.7 deg and whose IMU has axes 0.2 deg out of line, 0.22 rms; turns tell the two apart for the rest.
_OF_TILT = 0.4
#: Time [s] with an IMU before which nothing is said of its rate.
_EARLY = 2.0
#: States that air data have a part in.
_AIRBORNE = (Status.NO_GPS, *INFERRED)


class Sensors(NamedTuple):
    """What a manoeuvre has had of its sensors."""

    gps: frozenset[int]  # kinds of GPS samples that it was taken to have at a start; all where it did not start
    usable: frozenset[int]  # kinds of which a sample was usable


class Watch(Protocol):
    """Looks at the samples beside the filter, and marks the rows that it gives."""

    def add(self, samples: Samples) -> None:
        """Samples, those of the next rows among them."""

    def mark(self, rows: Array, epoch: int) -> None:
        """Write into rows (n, StateField.WIDTH) by rising time, in seconds after ``epoch`` [ns]."""

    def restart(self) -> None:
        """The clock started over."""

    def begin_anew(self, since: float) -> None:
        """Another manoeuvre begins, ``since`` [s] after the one before; NaN: of another flight."""


class StateEstimator:
    """Iterated extended Kalman filter over (6.24), fed in any order within the horizon.

    ``push`` takes samples as they arrive and returns rows of ``state.StateField``, one per IMU sample, complete
    up to ``horizon`` plus the longest sensor delay before the newest IMU stamp. With a ``tape`` it records what
    ``smooth`` needs at the end of the flight; errors of the air data have no place on it. A ``watch`` sees the same
    samples, by the same stamps. With ``noise`` it learns none: sensors are as noisy as another run has found them.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        options: StateOptions | None = None,
        tape: SmootherHistory | None = None,
        watch: Watch | None = None,
        noise: LearntNoise | None = None,
    ) -> None:
        self.aircraft = aircraft
        self.tape, self.watch = tape, watch
        self.smoothed = False
        self.options = options or StateOptions()
        self.order = TimeOrder(self.options.horizon, sensor_delays(aircraft))
        self.epoch: int | None = None
        self.realignments = 0
        self._gate = gate_thresholds(self.options.gate)
        self._scales = sensor_scales(aircraft)
        self.drift = Drift(aircraft)
        self._still = StuckSensors(aircraft.minimum_airspeed)
        self._start_up = StartUp(aircraft)
        self._start = StartValues()
        self._guide = int(Kind.GPS_VELOCITY)  # of the newest start
        self._held: Batch | None = None
        self._one_setup: npt.NDArray[np.void] | None = None  # known once there is an origin
        self._odometer: Odometer | None = None  # from the origin on
        self._x = np.zeros(STATE_SIZE)
        self._p = np.zeros((ERROR_SIZE, ERROR_SIZE))
        self._aligned = False
        self._has_biases = False
        self._one_memory = in_array(new_memory(len(Kind), aircraft.process_noise["wind"]))
        self._learns = noise is None
        if noise is not None:
            take_noise(self.memory, noise, learns_wind(aircraft))
        self._begin_gusty()
        self._flown: list[Sensors] = []  # of the manoeuvres before this one
        self._usable_before = np.zeros(len(Kind), np.int64)
        self._counts_before = np.zeros((3, len(Kind)), np.int64)  # of other flights, or another estimator in this one
        self._begun = 0.0, 0  # time of flight [s] and samples of the IMU before the first one
        self.last_row: Array | None = None
        self._last_airborne: Array | None = None  # newest row with air data

    def follow(self, before: StateEstimator) -> None:
        """Before the first sample: go on with the flight of another one, which is given up, and know nothing from it.

        Time, what became of the samples and the samples that wait are those of the flight.
        """
        self.epoch, self.order, self.realignments = before.epoch, before.order, before.realignments
        self._flown, self._usable_before = before._flown, before._usable_before
        self._counts_before = before._became()
        self._begun = self.flight_time, int(self._usable()[Kind.IMU])

    def push(self, samples: Samples) -> Array:
        """Take n samples in the order of arrival; returns rows (m, StateField.WIDTH), m >= 0.

        Kinds that belong to the second step are passed over; a SEAM between manoeuvres is ``begin_anew``.
        """
        rows = []
        for since, part in manoeuvres_in_turn(samples):
            if since is not None:
                rows.append(self.begin_anew(since))
            used = self._unscaled(self._still.without(part[_USED[part.kind]]))
            if self.watch is not None:
                self._show_absurd(used)
                self._show_beside(part)
            rows.append(self._collect(self.order.push(used)))
        return np.vstack(rows) if len(rows) > 1 else rows[0]

    def _show_absurd(self, samples: Samples) -> None:
        """Let the watch see what the filter does not: angles in degrees are no angles. Not what comes too late."""
        angles = (samples.kind == Kind.ANGLE_OF_ATTACK) | (samples.kind == Kind.SIDESLIP)
        absurd = is_absurd(samples).any(axis=1) & angles & (np.abs(samples.values[:, 0]) <= 180.0)
        if absurd.any() and self.watch is not None:
            self.watch.add(samples[absurd & (samples.stamp >= self.order.newest_due(samples))])

    def _show_beside(self, samples: Samples) -> None:
        """Let the watch see what moves the surfaces, as it comes. Not what comes too late."""
        beside = np.isin(samples.kind, BESIDE)
        if beside.any() and self.watch is not None:
            self.watch.add(samples[beside & (samples.stamp >= self.order.newest_due(samples))])

    def _unscaled(self, samples: Samples) -> Samples:
        """Samples without the scales that the aircraft file gives to its air data sensors."""
        factor = self._scales[samples.kind]
        if np.all(factor == 1.0):
            return samples
        values = samples.values.copy()
        values[:, 0] /= factor
        return Samples(samples.stamp, samples.kind, values)

    def change_options(self, options: StateOptions) -> None:
        """Go on with other options: what is fused from now on is fused with them.

        Whether errors of the air data are states, and the air calm, cannot change.
        """
        if (options.air_data_errors, options.calm_air) != (self.options.air_data_errors, self.options.calm_air):
            raise ValueError("air_data_errors and calm_air decide on what the filter begins with")
        self.options = options
        self.order.change_horizon(options.horizon)
        self._gate = gate_thresholds(options.gate)
        if self.setup is not None:
            self._one_setup = in_array(with_options(self.setup, options, self._gate))

    def flush(self) -> Array:
        """Process what is still held, at the end of a recording."""
        rows = self._collect(self.order.flush())
        return np.vstack([rows, *self._end_of_wait()])

    def begin_anew(self, since: float) -> Array:
        """Another manoeuvre begins; returns the rows of what is still held.

        ``since`` [s]: the time since the one before. In the same flight biases and wind are known from there, as well
        as their random walks allow; after more than ``SAME_FLIGHT``, or NaN, nothing is, nor which sensors there are.
        Counts, innovations and the tape go on: they are of all manoeuvres.
        """
        rows = self.flush()
        self._flown = self.sensors
        self._usable_before = self._usable()
        self.order.begin_anew()
        self._still = StuckSensors(self.aircraft.minimum_airspeed)
        self._start_up.begin_anew(self.aircraft)
        self._one_setup, self._held = None, None
        self._odometer = None
        self._aligned = False
        if self.watch is not None:
            self.watch.begin_anew(since)
        if not since <= SAME_FLIGHT:
            self.drift.begin_flight()
            self.memory.air[:] = np.nan
            self._counts_before = self._became()
            self.memory.fused[:] = self.memory.rejected[:] = self.memory.skipped[:] = 0
            self._forget_slow_states()
        elif self._has_biases:
            self._p = self._p.copy()
            walks = [self.aircraft.process_noise[name] for name in ("accelerometer_bias", "gyro_bias", "wind")]
            for first, walk in zip((D_ACCELEROMETER_BIAS, D_GYRO_BIAS, D_AIR_VELOCITY), walks, strict=True):
                each = np.arange(first, first + 3)
                self._p[each, each] += walk**2 * since
        return rows

    def smooth(self, with_covariance: bool = True) -> Array:
        """Rows of the whole flight (n, StateField.WIDTH), smoothed; after ``flush``. The newest does not change.

        Without the covariance standard deviations stay those of the filter, and it is several times faster.
        """
        from aircraft_sysid_ros.reconstruction.smoother import smooth

        assert self.tape is not None
        rows = smooth(self.tape, with_covariance)
        if with_covariance:
            for segment, _, of_segment in self.tape.segments():
                doubt_attitudes(of_segment, segment.attitude_doubt, not segment.setup.wind_std[0] > 0.0)
        airborne = _newest_airborne(rows)
        if self._last_airborne is not None and airborne is not None:
            self._last_airborne = airborne.copy()
        self.smoothed = True
        return rows

    @property
    def status(self) -> int:
        """Value of ``state.Status``."""
        if not self._aligned or self.last_row is None:
            return Status.WAITING
        return int(self.last_row[StateField.STATUS])

    @property
    def flight_time(self) -> float:
        """Time [s] that the IMU has counted; leaps of its clock are left out."""
        return self.order.elapsed / NANOSECONDS

    @property
    def imu_in_words(self) -> str:
        """That the IMU has too many gaps for the filter to start; empty: it has not, or it is early yet."""
        elapsed, count = self._begun
        intervals, seconds = int(self._usable()[Kind.IMU]) - count - 1, self.flight_time - elapsed
        is_early = seconds < _EARLY + self.options.horizon
        if self.has_been_aligned or is_early or self._start_up.alignment.longest >= LEAST_WINDOW:
            return ""
        return (
            f"the IMU comes at {intervals / seconds:.2g} Hz: it needs samples that are at most {LARGEST_GAP:g} s apart"
        )

    @property
    def has_been_aligned(self) -> bool:
        """The filter started at some time of the flight."""
        return self.last_row is not None

    @property
    def state_vector(self) -> Array:
        """Copy of the newest nominal state (19,), at the place of the IMU."""
        return self._x[:STATE_SIZE].copy()

    @property
    def covariance(self) -> Array:
        """Copy of the covariance of its error (18, 18)."""
        return self._p[:ERROR_SIZE, :ERROR_SIZE].copy()

    @property
    def setup(self) -> Setup | None:
        """What the filter was told of the aircraft; None before it has started."""
        return None if self._one_setup is None else cast(Setup, self._one_setup[0])

    @property
    def memory(self) -> Memory:
        """What the filter changes besides state and covariance."""
        return cast(Memory, self._one_memory[0])

    @property
    def air_data_errors(self) -> dict[str, dict[str, float]]:
        """Newest value and standard deviation of the errors of the air data by name; empty if they are no states.

        That of the angle of attack holds what it is off where the pitch is, and ``of_attitude`` says how much.
        """
        if len(self._x) <= STATE_SIZE:
            return {}
        return error_table(self._x, self._p, _OF_TILT * float(self.attitude_doubt[1]))

    @property
    def attitude_doubt(self) -> Array:
        """What an attitude whose noise is not stated may be off about the body axes (3,) in the mean of a flight [rad]:
        roll, pitch and heading in level flight.
        """
        found = np.zeros(3)
        if self.setup is not None and not self.setup.given[Kind.ATTITUDE] and self.memory.fused[Kind.ATTITUDE]:
            mean_attitude_errors(self.memory.noise[Kind.ATTITUDE], found)
        return found

    @property
    def sensors(self) -> list[Sensors]:
        """Of each manoeuvre, the newest last."""
        usable = np.flatnonzero(self._usable() > self._usable_before)
        return [*self._flown, Sensors(self._start_up.gps_had, frozenset(usable.tolist()))]

    def _usable(self) -> npt.NDArray[np.int64]:
        """Samples (kinds,) that have come, once each, and were not invalid."""
        counts = self.order.counts
        return counts.received - counts.invalid - counts.repeated

    def take_start(self, start: StartValues) -> None:
        """From now on wind and errors of the air data are those of ``start``; what else is known stays.

        Before the first sample it is what the flight begins with. In flight it needs the errors as states.
        """
        self._start = start
        if self._aligned and self.options.air_data_errors:
            rotation = rotation_matrix(self._x[ATTITUDE])
            self._x, self._p = with_start(self._x, self._p, rotation, start)

    @property
    def slow_states(self) -> tuple[Array, Array]:
        """Newest state and covariance, of which biases and wind are known when another manoeuvre begins."""
        return self._x, self._p

    def take_slow_states(self, known: tuple[Array, Array]) -> None:
        """Another manoeuvre has begun, from what was known at another time in place of the newest."""
        self._x, self._p = known

    def summary(self) -> dict[str, Any]:
        """The content of state.json without the timing: newest biases and wind, their standard deviations."""
        known = self._aligned or self._has_biases
        sigma = np.sqrt(np.diag(self._p))
        wind, wind_std = self._wind_in_flight()
        of_bias = sigma[D_ACCELEROMETER_BIAS : D_ACCELEROMETER_BIAS + 3]
        of_bias[:2] = np.hypot(of_bias[:2], STANDARD_GRAVITY * self.attitude_doubt[1::-1])
        values = {
            "accelerometer_bias": (self._x[10:13], of_bias),
            "gyro_bias": (self._x[13:16], sigma[D_GYRO_BIAS : D_GYRO_BIAS + 3]),
            "wind_ned": (wind, wind_std),
        }
        result: dict[str, Any] = {"smoothed": self.smoothed}
        if self.options.air_data_errors:
            result["air_data_errors"] = self.air_data_errors
        for name, (value, std) in values.items():
            for key, numbers in ((name, value), (name + "_std", std)):
                result[key] = [float(v) if known and np.isfinite(v) else None for v in numbers]
        return result

    def innovation_consistency(self) -> dict[str, float]:
        """Mean normalised innovation squared per degree of freedom: near 1 when noise is as configured."""
        sums, degrees = self.memory.nis_sum, self.memory.degrees
        return {kind.name.lower(): float(sums[kind] / degrees[kind]) for kind in Kind if degrees[kind]}

    def _wind_in_flight(self) -> tuple[Array, Array]:
        """Wind NED (3,) and its standard deviations when air data last told them: not after a landing."""
        if self._last_airborne is None:
            return self._known_wind()
        row = self._last_airborne
        return row[StateField.WIND], row[StateField.STANDARD_DEVIATIONS][D_AIR_VELOCITY:]

    def _known_wind(self) -> tuple[Array, Array]:
        """Newest wind NED (3,) and its standard deviations (3,)."""
        if not self._has_biases or self._guide == NO_GUIDE:
            return self._start.wind, CALM_STD if self.options.calm_air else self._start.wind_std
        jacobian = wind_jacobian(self._x)
        return wind_of(self._x), np.sqrt(np.diag(jacobian @ self._p[:ERROR_SIZE, :ERROR_SIZE] @ jacobian.T))

    def counts(self) -> dict[str, dict[str, int]]:
        """What became of the samples, by kind."""
        order, (fused, rejected, skipped) = self.order.counts, self._became()
        return {
            kind.name.lower(): {
                "received": int(order.received[kind]),
                "fused": int(fused[kind]),
                "rejected": int(rejected[kind]),
                "skipped": int(skipped[kind]),
                "late": int(order.late[kind]),
                "invalid": int(order.invalid[kind]),
                "wrong_stamp": int(order.wrong_stamp[kind]),
                "repeated": int(order.repeated[kind]),
            }
            for kind in Kind
        }

    def _became(self) -> npt.NDArray[np.int64]:
        """Samples (3, kinds) that were fused, rejected and skipped."""
        return self._counts_before + np.array([self.memory.fused, self.memory.rejected, self.memory.skipped])

    def _fused_and_rejected_before(self) -> tuple[int, int]:
        """What a row counts so far, beside what the memory of this flight does; without the magnetometer's rejected."""
        fused, rejected, _ = self._counts_before
        return int(fused.sum()), int(rejected.sum() - rejected[Kind.MAGNETIC_FIELD])

    def _collect(self, released: Iterator[Released]) -> Array:
        blocks: list[Array] = []
        for part in released:
            if part.restarted:
                self._lose_alignment()
                if self.watch is not None:
                    self.watch.restart()
                if not self._has_biases:
                    self.epoch = None  # the first stamps were wrong
            if len(part.samples):
                if self.epoch is None:
                    self.epoch = epoch_of(int(part.samples.stamp[0]))
                if self.watch is not None:
                    self.watch.add(part.samples)
                times = seconds(part.samples.stamp, self.epoch)
                blocks.extend(self._process(Batch(times, part.samples.kind, self._with_positions(part.samples))))
        return np.vstack(blocks) if blocks else np.empty((0, StateField.WIDTH))

    def _with_positions(self, samples: Samples) -> Array:
        """Values (n, WIDTH) with the positions of GPS places."""
        values = samples.values
        at = np.flatnonzero(samples.kind == Kind.GPS_POSITION)
        if len(at):
            values = values.copy()
            if self._odometer is None:
                self._odometer = Odometer(values[at[0], :3])
            for i in at:
                values[i, GPS_NED] = self._odometer.position_at(values[i, :3])
        return values

    def _process(self, batch: Batch) -> Iterator[Array]:
        """Samples in time order; those after the last IMU sample wait for the next one."""
        if self._held is not None:
            batch = self._held.followed_by(batch)
            self._held = None
        at = 0
        while np.any(batch.kinds[at:] == Kind.IMU):
            if not self._aligned:
                batch, at = self._align(batch, at)
                continue
            assert self._one_setup is not None  # known from the first alignment on
            times, kinds, values = batch
            end = at + self._start_up.before_new_gps(kinds[at:])
            rows = np.full((int(np.sum(kinds[at:end] == Kind.IMU)), StateField.WIDTH), np.nan)
            tape = np.empty((0 if self.tape is None else end - at, STEP_WIDTH))
            begin, newest = at, -np.inf if self.last_row is None else float(self.last_row[StateField.TIME])
            self.drift.note_states(times[at:end][kinds[at:end] == Kind.IMU], newest)
            shown = self.drift.without(times[:end], kinds[:end], values[:end])
            at, count, steps, state = run(
                times[:end], kinds[:end], shown, at, self._x, self._p, self._one_setup, self._one_memory, rows, tape
            )
            self.drift.count(times[begin:at], kinds[begin:at])
            if count:
                rows[:count, StateField.LATE] = self.order.counts.late.sum()
                rows[:count, [StateField.FUSED, StateField.REJECTED]] += self._fused_and_rejected_before()
                if self.watch is not None:
                    assert self.epoch is not None  # known from the first samples on
                    self.watch.mark(rows[:count], self.epoch)
                if self._one_setup["guide"][0] == NO_GUIDE:
                    without_wind(rows[:count])
                self.last_row = rows[count - 1]
                airborne = _newest_airborne(rows[:count])
                if airborne is not None:
                    self._last_airborne = airborne
                yield rows[:count]
            if self.tape is not None:
                self.tape.add(tape[:steps], rows[:count], self._x, self._p, self.attitude_doubt)
            self._doubt(state)
            if state == RUNNING and end < len(times):
                self._lose_alignment()
                self._start_up.reconsider()
        self._held = Batch(batch.times[at:], batch.kinds[at:], batch.values[at:])

    def _align(self, batch: Batch, at: int) -> tuple[Batch, int]:
        """Start, if the samples from number ``at`` on allow it; returns what to go on with, and its next number."""
        batch, at, start = self._start_up.feed(batch, at, self._without_known_errors, self._known_wind())
        if start is None:
            return batch, at
        self._begin(float(batch.times[at]), batch.values[at], *start)
        return batch, at + 1

    def _without_known_errors(self, time: float, kind: int, values: Array) -> Array:
        """Values (WIDTH,) of one sample."""
        shown = self.drift.without(np.array([time]), np.array([kind]), values[None])[0]
        return without_errors(kind, shown, self._known_errors()[0]) if self.options.air_data_errors else shown

    def _end_of_wait(self) -> Iterator[Array]:
        """Rows of what was kept while GPS was waited for, at the end."""
        kept = None if self._aligned else self._start_up.rest()
        if kept is not None:
            held, self._held = self._held, None
            yield from self._process(kept if held is None else kept.followed_by(held))

    def _begin(self, time: float, imu: Array, x: Array, p: Array) -> None:
        if self._has_biases:
            keep_biases(x, p, self._x, self._p)
        if self.options.air_data_errors:
            x, p = extended(x, p, *self._known_errors(), self._start_up.alignment.air_data(time))
        self._x, self._p = x, p
        self._start_up.settle()
        guide = self._guide = guide_of(self._start_up.gps)
        setup, origin = self.setup, self._start_up.origin
        if setup is None or setup.guide != guide or not np.array_equal(setup.origin, origin, equal_nan=True):
            setup = new_setup(self.aircraft, self.options, self._gate, origin, imu, guide, self._learns)
            self._one_setup = in_array(setup)
        self.memory.imu[0], self.memory.imu[1:7] = time, imu[:6]
        self.memory.imu_before[:] = self.memory.imu_first[:] = -np.inf
        self.memory.line[:] = 0.0
        self.memory.shown_since[:] = time
        if not self.memory.motion.any():
            self.memory.motion[0] = imu[:6]  # its weight is no motion
        self.memory.last_fused[:] = time  # a sensor is lost only after it was given the time to speak
        self.memory.last_rejected[:] = self.memory.assumed[:] = -np.inf
        self._aligned = self._has_biases = True
        if self.tape is not None:
            self.tape.begin(setup)

    def _known_errors(self) -> tuple[Array, Array]:
        """Newest errors of the air data (6,) and their covariance (6, 6)."""
        if not self._has_biases:
            return self._start.errors, self._start.covariance[3:, 3:]
        return self._x[STATE_SIZE:], self._p[ERROR_SIZE:, ERROR_SIZE:]

    def _doubt(self, state: int) -> None:
        """What the loop ended with: what is known no more."""
        if state == ELSEWHERE:
            self._doubt_position()
        elif state != RUNNING:
            self._lose_alignment()
        if state == DIVERGED:
            self._forget_slow_states()

    def _doubt_position(self) -> None:
        """The position may be off by as much as the newest one of the GPS says. For a smoother the flight is split."""
        each = np.arange(D_POSITION, D_POSITION + 3)
        self._p[each, each] += self.memory.innovation[Kind.GPS_POSITION] ** 2
        self.memory.last_rejected[Kind.GPS_POSITION] = -np.inf
        if self.tape is not None and self.setup is not None:
            self.tape.begin(self.setup)

    def _lose_alignment(self) -> None:
        if self._aligned:
            self.realignments += 1
        self._aligned = False
        self._held = None
        self._start_up.forget()

    def _forget_slow_states(self) -> None:
        """After a divergence wind and biases are not to be trusted either: begin as at the first start."""
        self._has_biases = False
        self._last_airborne = None
        self.memory.recent_nis[:] = self.memory.air_nis[:] = 1.0
        self._begin_gusty()

    def _begin_gusty(self) -> None:
        """The random walk of the wind at a start: air that is taken as calm has no gusts."""
        least = self.aircraft.process_noise["wind"]
        self.memory.wind_walk[:] = least if self.options.calm_air else max(least, GUSTY_START)


def _newest_airborne(rows: Array) -> Array | None:
    """The last of some rows that air data have a part in."""
    return next((row for row in rows[::-1] if row[StateField.STATUS] in _AIRBORNE), None)


def warm_up(aircraft: Aircraft, *, smoother: bool = False) -> None:
    """Compile (or load from the cache) the jitted loop, and the smoother, before the first sample of a flight."""
    stamp = np.arange(0, 3 * NANOSECONDS, NANOSECONDS // 50)
    ones = np.ones(len(stamp))
    level = np.outer(ones, [0.0, 0.0, -STANDARD_GRAVITY, 0.0, 0.0, 0.0])
    speed = 2.0 * aircraft.minimum_airspeed
    batches = [
        samples_of(Kind.GPS_POSITION, stamp, 0.1 * ones, 0.1 * ones, 100.0 * ones),
        samples_of(Kind.GPS_VELOCITY, stamp, speed * ones, 0.0 * ones, 0.0 * ones),
        samples_of(Kind.AIRSPEED, stamp, speed * ones),
        samples_of(Kind.IMU, stamp, level),
    ]
    with SmootherHistory() as tape:
        estimator = StateEstimator(aircraft, tape=tape if smoother else None)
        estimator.push(concatenate(batches))
        estimator.flush()
        if smoother:
            estimator.smooth()
    wind_of(np.zeros(STATE_SIZE))  # and what is called from outside of the loop as well
    wind_jacobian(np.zeros(STATE_SIZE))
    bounded(1.0)
    believed_variance(1.0, 1.0)
