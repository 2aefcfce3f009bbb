"""The check between sensors while they come: a reversed vane, degrees for radians, exchanged axes, from stamps alone.

A filter explains a reversed vane by gusts, and knots by wind: its innovations are small, and every parameter that
follows is wrong. What tells is the motion: the laws of ``check``, over the flight so far, at fixed times of it.
Mounting and units do not change in flight, so that it is not asked again once every sensor that is there has agreed.
What the airspeed reads may change, and is asked to the end (``wind_triangle``).
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import air_density
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.earth import ned_along
from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.aircraft.unsaid_places import roll_that_shows
from aircraft_sysid_ros.flight_check.check import contradictions
from aircraft_sysid_ros.flight_check.explain import stream_of
from aircraft_sysid_ros.flight_check.finding import ERROR, WARNING, Finding, short_names
from aircraft_sysid_ros.flight_check.laws import vane_place
from aircraft_sysid_ros.flight_check.laws.vane_place import Vane
from aircraft_sysid_ros.flight_check.motion import Motion
from aircraft_sysid_ros.flight_check.relation import Relation
from aircraft_sysid_ros.flight_check.signals import NAMES, Flight, VaneArm, flight_of, vane_arm
from aircraft_sysid_ros.flight_check.wind_triangle import WindTriangle
from aircraft_sysid_ros.flight_check.wind_triangle import warm_up as warm_up_triangle
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.state import CONTRADICTED, StateField, Status
from aircraft_sysid_ros.reconstruction.state_estimator import BESIDE
from aircraft_sysid_ros.samples import Kind, Samples, concatenate
from aircraft_sysid_ros.stamps import NANOSECONDS

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

#: Time of flight [s] that tells the place of a vane.
SHORTEST = 10.0
#: Times of flight [s] of the first two looks; later ones each after twice the time, over so much flight [s] at most.
FIRST, SECOND, LONGEST = 30.0, 60.0, 240.0
#: Manoeuvres no further apart [s] are in one wind.
_SAME_WIND = 300.0
#: Rows further apart [s] are no flight in between.
_STEP = 1.0
#: A stream that is late by more [s] than this is worth a word: less is for ``check`` and the aircraft file.
LATE = 0.2
#: The density is not that of its height if it differs by this share from the ratio to the standard atmosphere's that it
#: had at the begin of the flight: weather changes the ratio by some per cent over thousands of metres.
DENSITY = 0.1
#: So near to the standard atmosphere's a density was taken from the height, since none has come yet.
_BY_HEIGHT = 1e-9
#: Vectors and sensors of which each must have agreed once.
_ASKED: dict[Kind, tuple[tuple[str, ...], ...]] = {
    Kind.IMU: (NAMES[Kind.IMU][:3], NAMES[Kind.IMU][3:]),
    **{kind: (NAMES[kind],) for kind in (Kind.GPS_VELOCITY, Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)},
}
#: Names of sensors by the first part of a signal's.
_SENSORS = {
    "specific_force": "accelerometers", "angular_velocity": "gyros", "attitude": "attitude", "latitude": "GPS position",
    "longitude": "GPS position", "altitude": "GPS position", "velocity": "GPS velocity", "true_airspeed": "airspeed",
    "angle_of_attack": "angle of attack", "sideslip": "sideslip", "static_pressure": "static pressure",
}  # fmt: skip

_STATIC_PRESSURE = next(code for code, sensor in CONTRADICTED.items() if sensor == "static pressure")
_AIRSPEED = next(code for code, sensor in CONTRADICTED.items() if sensor == "airspeed")
#: Statuses of a state whose height rests on GPS.
_ON_GPS = tuple(float(status) for status in (
    Status.OK, Status.NO_AIR_DATA, Status.INFERRED_ALPHA, Status.INFERRED_BETA, Status.INFERRED_ANGLES, Status.CALM_AIR,
    Status.CALM_AIR_ALPHA, Status.CALM_AIR_BETA, Status.CALM_AIR_ANGLES,
))  # fmt: skip
_KNOWN = tuple(float(code) for code in CONTRADICTED)
_ALTITUDE, _DOWN = StateField.ORIGIN.stop - 1, StateField.POSITION.stop - 1
_AIR_DENSITY, _STATUS, _CONTRADICTION = StateField.AIR_DENSITY, StateField.STATUS, StateField.CONTRADICTION


def watch_of(aircraft: Aircraft, options: StateOptions | None = None) -> InFlightCheck:
    """The check of a flight of an aircraft; where the filter estimates the errors of the air data, not of these."""
    is_estimated = options is not None and options.air_data_errors
    is_said = ("air_data_position", "y") not in aircraft.unsaid
    vane = Vane(float(aircraft.air_data_position[1]), aircraft.span, is_said)
    return InFlightCheck(aircraft.minimum_airspeed, vane, vane_arm(aircraft), not is_estimated, aircraft.inputs)


def warm_up() -> None:
    """Import what is imported where sensors contradict each other, and compile or load the kernels: no sample waits."""
    import scipy.optimize  # noqa: F401

    warm_up_triangle()
    ned_along(np.zeros((1, 3)), np.zeros(3))
    _mark_density(np.zeros((1, StateField.WIDTH)), np.zeros(1, np.bool_), np.nan)


class InFlightCheck:
    """Takes the samples of the first step, and marks its rows from when on a sensor is contradicted."""

    def __init__(
        self,
        minimum_airspeed: float,
        vane: Vane | None = None,
        arm: VaneArm | None = None,
        asks_airspeed: bool = True,
        inputs: Sequence[NamedInput] = (),
    ) -> None:
        """Time counts from ``minimum_airspeed`` [m/s] on: what is true of flight is not of taxiing.

        ``vane``, ``arm``: where the aircraft file has it. ``asks_airspeed``: whether GPS and wind are asked what it
        reads. ``inputs`` that the aircraft file names.
        """
        #: How far [m] to the right the vane is, and one sigma, where no file says it and it is not where that has it.
        self.vane_place: tuple[float, float] | None = None
        self._minimum_airspeed, self._vane, self._arm = minimum_airspeed, vane, arm
        self._inputs = tuple(inputs)
        self._triangle = WindTriangle(minimum_airspeed) if asks_airspeed else None
        self._surest: tuple[float, float] | None = None  # of all looks at the place of the vane
        self._rolled = 0.0  # [rad^2/s] integral of the square of the roll rate, in flight
        self._enough = np.inf if vane is None or vane.is_said else roll_that_shows(vane.span)
        self._found: tuple[Finding, ...] = ()  # errors that stand, and streams that are late
        self._code = 0
        self._density = np.nan  # over that of the standard atmosphere, at the begin of the flight
        self._restart()

    def _restart(self) -> None:
        self._waiting: list[Samples] = []
        self._flown = 0  # [ns] of flight
        self._due = FIRST  # [s] of flight of the next look
        self._begin = self._newest = np.nan  # [s] of the first row in flight, of the newest row
        self._kept_since = -np.inf  # [s]
        self._over = False

    def finish(self, epoch: int | None) -> None:
        """The flight is over: the place of the vane by all of it, where it is not known yet, and small errors."""
        if self._triangle is not None:
            self._triangle.finish()
        if epoch is None or self._over or self._flown < SHORTEST * NANOSECONDS:
            return
        if self._flown >= FIRST * NANOSECONDS:
            self._look(self._newest, epoch)
        else:  # too short for the other laws
            samples = self._keep(epoch, self._begin)
            with contextlib.suppress(ValueError, np.linalg.LinAlgError), np.errstate(all="ignore"):
                self._look_at_vane(samples, Motion(self._flight_of(samples)), [])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Errors that stand, streams that are late, and when the airspeed read something else."""
        return self._found if self._triangle is None else (*self._found, *self._triangle.findings)

    @property
    def airspeed_reads(self) -> tuple[float, float] | None:
        """Between which shares of the airspeed it reads as far as GPS and wind tell; None: nobody asked them."""
        return None if self._triangle is None else self._triangle.reads

    @property
    def has_late_imu(self) -> bool:
        """Whether the IMU was found to be later than all others."""
        return any(map(_is_late_imu, self._found))

    @property
    def words(self) -> list[str]:
        """What was found, one sentence each, the worst first."""
        return [f"{short_names(f.signals)}: {f.sentence}" for f in self.findings]

    def restart(self) -> None:
        """The clock started over: what was found stands, and is asked again."""
        self._restart()
        if self._triangle is not None:
            self._triangle.restart()

    def begin_anew(self, since: float) -> None:
        """Another manoeuvre begins, ``since`` [s] after the one before, in another wind if that is long."""
        if self._triangle is not None and not since <= _SAME_WIND:
            self._triangle.restart()

    def add(self, samples: Samples) -> None:
        """Samples, those of the next rows among them."""
        if not self._over:
            self._waiting.append(samples)
        if self._triangle is not None:
            self._triangle.add(samples[~np.isin(samples.kind, BESIDE)])

    def mark(self, rows: Array, epoch: int) -> None:
        """Write into rows (n, StateField.WIDTH) by rising time which sensor is contradicted, looking when it is due."""
        self._write_code(rows)
        times, flies = rows[:, StateField.TIME], rows[:, StateField.AIRSPEED] >= self._minimum_airspeed
        steps = np.rint(np.diff(times, prepend=self._newest) * NANOSECONDS)
        counts = flies & (steps > 0.0) & (steps < _STEP * NANOSECONDS)
        flown = self._flown + np.cumsum(np.where(counts, steps, 0.0).astype(np.int64))  # whole: blocks do not matter
        self._flown, self._newest = int(flown[-1]), float(times[-1])
        if np.isnan(self._begin) and flies.any():
            self._begin = float(times[np.argmax(flies)])
        while not self._over and self._flown >= self._due * NANOSECONDS:
            at = int(np.searchsorted(flown, self._due * NANOSECONDS))
            self._look(float(times[at]), epoch)
            self._write_code(rows[at:])
            self._due = max(2.0 * self._due, SECOND)
        self._look_once_it_rolled(rows, np.where(counts, steps, 0.0), epoch)
        self._mark_density(rows, flies)
        if self._triangle is not None:
            self._mark_airspeed(self._triangle, rows, epoch)
        if np.isnan(self._begin):
            self._keep(epoch, times[-1])
        elif not self._over and times[-1] > max(self._kept_since, self._begin) + 2.0 * LONGEST:
            self._keep(epoch, times[-1] - LONGEST)

    def _look_once_it_rolled(self, rows: Array, steps: Array, epoch: int) -> None:
        """Look for the vane each time that roll could have shown it that had not before; steps (n,) [ns] in flight."""
        if self._vane is None or self._vane.is_said or self._over:
            return
        squares = np.nan_to_num(rows[:, StateField.ANGULAR_VELOCITY][:, 0]) ** 2 * steps / NANOSECONDS
        rolled = np.cumsum(np.append(self._rolled, squares))[1:]  # one after the other: blocks do not matter
        self._rolled = float(rolled[-1])
        looked = np.nan
        while self._rolled >= self._enough:
            at = int(np.searchsorted(rolled, self._enough))
            self._enough *= 2.0
            now = float(rows[at, StateField.TIME])
            if now == looked or vane_place.is_known(self._surest, self._vane.span):
                continue
            looked = now
            past, found = self._past(now, epoch), self._but_the_vane()
            with contextlib.suppress(ValueError, np.linalg.LinAlgError), np.errstate(all="ignore"):
                self._look_at_vane(past, Motion(self._flight_of(past, arm=self._arm)), found)
                self._judge(found)
            self._write_code(rows[at:])

    def _judge(self, found: Sequence[Finding]) -> None:
        """What stands from now on."""
        self._found = tuple(found)
        self._code = next((code for f in self._found if f.severity == ERROR and (code := code_of(f))), 0)

    def _write_code(self, rows: Array) -> None:
        """What is known of a sensor goes before what its innovations make suspect."""
        if self._code:
            rows[:, StateField.CONTRADICTION] = self._code

    def _mark_airspeed(self, triangle: WindTriangle, rows: Array, epoch: int) -> None:
        """Mark rows from when on the airspeed reads something else, until it does not; what stands is left alone."""
        stamps = epoch + np.rint(rows[:, StateField.TIME] * NANOSECONDS).astype(np.int64)
        first, last = 0, int(stamps[-1])
        while first < len(rows):
            after = first + int(np.searchsorted(stamps[first:], triangle.due(int(stamps[first]))))
            part = rows[first:after]
            if triangle.is_wrong and len(part):
                part[~np.isin(part[:, _CONTRADICTION], _KNOWN), _CONTRADICTION] = _AIRSPEED
            first = after
            if last >= triangle.due(last):
                triangle.advance(int(stamps[after]))

    def _mark_density(self, rows: Array, flies: Bools) -> None:
        """Mark rows whose density left the height that GPS shows, as a blocked or leaking static port has it."""
        self._density = _mark_density(rows, flies, self._density)

    def _keep(self, epoch: int, since: float) -> Samples:
        """Forget samples from before a time [s]; returns the others."""
        samples = concatenate(self._waiting)
        samples = samples[samples.stamp >= epoch + round(since * NANOSECONDS)]
        self._waiting, self._kept_since = [samples], since
        return samples

    def _past(self, now: float, epoch: int) -> Samples:
        """The samples in flight until a time [s]; those of long before are forgotten."""
        samples = self._keep(epoch, max(now - LONGEST, self._begin))
        return samples[samples.stamp <= epoch + round(now * NANOSECONDS)]

    def _but_the_vane(self) -> list[Finding]:
        """What stands, without that the vane sits elsewhere."""
        return [f for f in self._found if (f.kind, f.severity, *f.signals) != vane_place.MARKS]

    def _flight_of(self, samples: Samples, arm: VaneArm | None = None) -> Flight:
        """The flight of samples by rising stamp; what moves the surfaces neither begins nor ends it."""
        moved = np.isin(samples.kind, BESIDE)
        rest = samples.stamp[~moved]
        samples = samples[~moved | ((samples.stamp >= rest.min()) & (samples.stamp <= rest.max()))]
        return flight_of(samples, samples.stamp, self._inputs, arm=arm)

    def _look(self, now: float, epoch: int) -> None:
        past = self._past(now, epoch)
        try:
            with np.errstate(all="ignore"):
                found, relations, motion = contradictions(self._flight_of(past, arm=self._arm))
                place_is_known = self._look_at_vane(past, motion, found)
        except (ValueError, np.linalg.LinAlgError):  # numbers that nothing can be made of: another look will tell
            return
        agreeing = _agreeing(relations)
        new = [f for f in found if _matters(f)]
        named = {signal for f in new for signal in f.signals}
        kept = [f for f in self._found if not named & {*f.signals} and not agreeing & {*f.signals}]
        self._judge((*new, *kept))
        there = {kind for kind in _ASKED if np.any(past.kind == kind)}
        asked = [set(signals) for kind in there for signals in _ASKED[kind]]
        if self._due >= SECOND and not self._code and place_is_known and all(signals & agreeing for signals in asked):
            self._over, self._waiting = True, []

    def _look_at_vane(self, past: Samples, motion: Motion, found: list[Finding]) -> bool:
        """Add to what was found that the vane sits elsewhere; returns whether its place is known, or of no use."""
        name = "angle_of_attack"
        if self._vane is None or not np.isfinite(motion.alpha).any() or any(name in f.signals for f in found):
            return True
        stamps = past.stamp[past.kind == Kind.ANGLE_OF_ATTACK]
        if np.median(np.diff(stamps)) > vane_place.LONGEST * NANOSECONDS:  # lines between samples are no motion of it
            return True
        place = vane_place.sideways(motion)
        if place is not None and (self._surest is None or place[1] <= self._surest[1]):
            self._surest = place  # a vane does not move: the surest look is the last word, and takes back another one
        if not self._vane.is_said:
            self.vane_place = vane_place.taken(self._surest, self._vane)
        self._found = tuple(self._but_the_vane())
        found += vane_place.findings(self._surest, self._vane)
        return vane_place.is_known(self._surest, self._vane.span)


@njit(cache=True)
def _mark_density(rows: Array, flies: Bools, usual: float) -> float:
    """``InFlightCheck._mark_density``; ``usual`` density over that of the standard atmosphere, NaN before any is known.

    Returns it. What is known of another sensor stands.
    """
    for i in range(len(rows)):
        altitude, density = rows[i, _ALTITUDE] - rows[i, _DOWN], rows[i, _AIR_DENSITY]
        if not (flies[i] and density > 0.0 and np.isfinite(altitude) and rows[i, _STATUS] in _ON_GPS):
            continue
        ratio = density / air_density(altitude)
        if abs(ratio - 1.0) < _BY_HEIGHT:
            continue
        usual = ratio if np.isnan(usual) else usual
        if abs(ratio / usual - 1.0) > DENSITY and rows[i, _CONTRADICTION] not in _KNOWN:
            rows[i, _CONTRADICTION] = _STATIC_PRESSURE
    return usual


def _matters(finding: Finding) -> bool:
    """Errors, and a stream that is late beyond what delays are; the IMU is compared with all others."""
    if finding.kind == "offset" and finding.severity == WARNING:
        return abs(finding.late) > LATE or _is_late_imu(finding)
    return finding.severity == ERROR


def _is_late_imu(finding: Finding) -> bool:
    """Whether it is the IMU that is late."""
    return finding.kind == "offset" and finding.late > 0.0 and stream_of(finding.signals[0]) == "imu"


def _agreeing(relations: list[Relation]) -> set[str]:
    """Signals that belong to a relation that surely holds; those of a fault are of a flight without it."""
    return {signal for r in relations if r.comparison.is_sure and r.sign > 0.0 for signal in r.signals}


def code_of(finding: Finding) -> int:
    """Number in ``CONTRADICTED`` of the sensor of a finding; 0 for one that the first step does not use."""
    sensors = {_SENSORS[signal.partition(".")[0]] for signal in finding.signals if signal.partition(".")[0] in _SENSORS}
    return min((code for code, sensor in CONTRADICTED.items() if sensor in sensors), default=0)
