"""The closed loop in one process and faster than real time: the same objects as the nodes, on one virtual clock."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from autopilot import Instruments
from dynamic_inversion import AttitudeController
from task import Multisine, Task

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.consumer import Origin, ParameterSource, Values, priors_of
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.identification.physical_bounds import physical_bounds
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.ros_messages.output_messages import parameters_content
from aircraft_sysid_ros.sensors.sensor_models import stamps_of
from aircraft_sysid_ros.simulation.closed_loop import (
    ATTITUDE_TOPIC,
    STEP,
    Reading,
    Sensed,
    SteppedAeroplane,
    damage_of,
    samples_of_sensed,
)
from aircraft_sysid_ros.simulation.closed_loop_faults import fault_of
from aircraft_sysid_ros.stamps import nanoseconds

Array = npt.NDArray[np.float64]

CONTROLLERS = ("fixed", "live", "truth")
LARGEST_SEED = 2**32 - 1
#: Steps between pushes of samples, and between questions to the source.
PUSH, ASK = 10, 10
#: Time [s] between messages, as of the node.
MESSAGE_PERIOD = 1.0
#: A flight is lost beyond these: bank, pitch, angle of attack [rad], airspeed [m/s], height [m].
LARGEST_BANK, LARGEST_PITCH, LARGEST_ALPHA = np.radians([80.0, 45.0, 25.0])
SLOWEST, FASTEST, LOWEST = 9.0, 32.0, 20.0
_SPAN_OF_LOG = 5  # steps between rows of the log
#: Share of the truth within which a parameter counts as right.
RIGHT = 0.25


@dataclass(frozen=True)
class Case:
    """What happens in a flight."""

    name: str
    damage: str = "none"
    fault: str = "none"
    main: str = ""  # parameter that the damage changes most
    time: float = 30.0  # [s]
    duration: float = 90.0  # [s]


CASES = {
    case.name: case
    for case in (
        Case("none"), Case("elevator", "elevator", main="Cm_de"), Case("aileron", "aileron", main="Cl_da"),
        Case("cg_aft", "cg_aft", main="Cm_alpha"),
        Case("airspeed_blocked", fault="airspeed_blocked"), Case("alpha_vane_stuck", fault="alpha_vane_stuck"),
        Case("gps_lost", fault="gps_lost"), Case("imu_bias_jump", fault="imu_bias_jump"),
    )
}  # fmt: skip


class Pilot(Protocol):
    """Where the controller has its parameters from."""

    def take(self, sensed: list[Sensed], instruments: Instruments) -> None:
        """Samples of some steps."""

    def parameters(self, now: int, instruments: Instruments) -> Array:
        """Parameters (n,) in the order of the model, at a stamp [ns]."""


class Known:
    """Parameters that somebody knows: those of the file, or the truth, which changes."""

    def __init__(self, before: Array, after: Array, change: int) -> None:
        """``change``: stamp [ns] from which on ``after`` holds."""
        self._before, self._after, self._change = before, after, change

    def take(self, sensed: list[Sensed], instruments: Instruments) -> None:
        """Needs none."""

    def parameters(self, now: int, instruments: Instruments) -> Array:
        """Those of the time."""
        return self._after if now >= self._change else self._before


@dataclass
class Published:
    """What the estimator has published, against the truth."""

    messages: int = 0
    uses: int = 0  # parameters with USE, over all messages
    out_of_bounds: int = 0  # of these, outside of what aeroplanes have
    wrong: Counter[str] = field(default_factory=Counter)  # of these, 3 standard errors and RIGHT away from the truth
    after: int = 0  # messages since what happens has happened
    uses_after: int = 0
    relearnt: float = np.nan  # [s] after damage until what it changed most is USE and right
    series: dict[str, list[tuple[float, float, float, int]]] = field(default_factory=dict)


class Live:
    """The estimators, and the consumer library on what they publish."""

    def __init__(self, aircraft: Aircraft, case: Case, watched: tuple[str, ...] = ()) -> None:
        """``case`` is for the book-keeping alone; ``watched`` parameters are logged."""
        self.pipeline = Pipeline(aircraft)
        self.source = ParameterSource(priors_of(aircraft.coefficients))
        self.published = Published(series={name: [] for name in watched})
        self._truth, self._case, self._due = truth_of(aircraft, case), case, -np.inf
        self._start, self._bounds = int(stamps_of(0.0)), aircraft.parameter_bounds
        self.values: Values | None = None

    def take(self, sensed: list[Sensed], instruments: Instruments) -> None:
        """Samples into the estimators; every second a message comes out."""
        self.pipeline.push(samples_of_sensed(sensed))
        now, epoch = self.pipeline.parameters.time, self.pipeline.state.epoch
        if epoch is None or not now >= self._due:  # NaN before anything is learnt
            return
        self._due = now + MESSAGE_PERIOD
        found = self.pipeline.parameters.snapshot()
        stamp = int(nanoseconds(np.array(now), epoch))
        self.source.offer(stamp, parameters_content(found), instruments.condition(stamp))
        self._note(1e-9 * (stamp - self._start), found)

    def parameters(self, now: int, instruments: Instruments) -> Array:
        """What the source answers."""
        self.values = self.source.at(now, instruments.condition(now))
        return self.values.values

    def _note(self, time: float, found: ParameterSet) -> None:
        p, truth = self.published, self._truth(time)
        p.messages += 1
        p.after += time > self._case.time
        for one in found.parameters:
            if one.name in p.series:
                p.series[one.name].append((time, one.value, one.std, int(one.status)))
            if one.status != Trust.USE:
                continue
            low, high = self._bounds.get(one.name, physical_bounds(one.name))
            p.uses += 1
            p.uses_after += time > self._case.time
            p.out_of_bounds += not low <= one.value <= high
            error = abs(one.value - truth[one.name])
            p.wrong[one.name] += int(error > 3.0 * one.std and error > RIGHT * abs(truth[one.name]))
            if one.name == self._case.main and time > self._case.time and not np.isfinite(p.relearnt):
                p.relearnt = time - self._case.time if error < RIGHT * abs(truth[one.name]) else np.nan


@dataclass(frozen=True)
class Flight:
    """A flight, logged at 20 Hz: time, bank, pitch, their references, alpha, beta [rad], airspeed, height, commands."""

    case: Case
    log: Array  # (n, 13)
    lost_at: float  # [s]; NaN: it was not lost
    published: Published | None
    origins: Array  # (n, 3) share of parameters that are PRIOR, HELD and LIVE; NaN without a source

    def tracking_error(self, begin: float, end: float = np.inf) -> float:
        """Rms [rad] over both angles of what the aeroplane is away from the reference models between two times [s]."""
        chosen = self.log[(self.log[:, 0] >= begin) & (self.log[:, 0] < end)]
        return float(np.sqrt(np.mean((chosen[:, 1:3] - chosen[:, 3:5]) ** 2))) if len(chosen) else np.nan


def truth_of(aircraft: Aircraft, case: Case) -> Callable[[float], dict[str, float]]:
    """True coefficients at a time of flight [s], as the mass properties of the file see them."""
    before = dict(aircraft.coefficients)
    after = damage_of(aircraft, case.damage).apparent(aircraft)
    return lambda time: after if time >= case.time else before


def pilot_of(kind: str, aircraft: Aircraft, case: Case, watched: tuple[str, ...] = ()) -> Pilot:
    """One of CONTROLLERS."""
    truth, names = truth_of(aircraft, case), aircraft.model.parameter_names
    if kind == "live":
        return Live(aircraft, case, watched)
    before, after = (np.array([truth(time)[name] for name in names]) for time in (0.0, np.inf))
    return Known(before, before if kind == "fixed" else after, int(stamps_of(case.time)))


def fly(
    aircraft: Aircraft,
    case: Case,
    kind: str,
    seed: int,
    *,
    turbulence: float = 4.0,
    excitation: float = 1.0,
    watched: tuple[str, ...] = (),
) -> Flight:
    """One flight; the same seed is the same air, sensors and task whoever flies."""
    aeroplane = SteppedAeroplane(
        aircraft, seed, case.duration, turbulence=turbulence, damage=damage_of(aircraft, case.damage),
        fault=fault_of(case.fault, case.time, seed), change_time=case.time,
    )  # fmt: skip
    controller, instruments = AttitudeController(aircraft), Instruments(aircraft)
    pilot, task = pilot_of(kind, aircraft, case, watched), Task(seed, case.duration, controller.airspeed)
    multisine = Multisine(STEP, excitation)
    waiting: list[Sensed] = []
    rows, origins, lost_at = [], [], np.nan
    command, parameters = aeroplane.setup.trim.controls.copy(), np.empty(0)
    for number in range(aeroplane.count):
        reading, sensed = aeroplane.look()
        waiting += sensed
        show(sensed, instruments)
        if number % PUSH == 0:
            pilot.take(waiting, instruments)
            waiting = []
        if number % ASK == 0:
            parameters = pilot.parameters(int(stamps_of(aeroplane.time)), instruments)
        seen = instruments.seen
        assert seen is not None
        reference = task.reference(aeroplane.time)
        command = controller.step(seen, reference, parameters, multisine.at(number), STEP)
        if number % _SPAN_OF_LOG == 0:
            rows.append(_row(aeroplane.time, reading, controller, command))
            origins.append(_shares(pilot))
        if is_lost(reading):
            lost_at = aeroplane.time
            break
        aeroplane.advance(command)
    published = pilot.published if isinstance(pilot, Live) else None
    return Flight(case, np.array(rows), lost_at, published, np.array(origins))


def show(sensed: list[Sensed], instruments: Instruments) -> None:
    """Samples to the instruments of the autopilot."""
    for one in sensed:
        if one.topic == "imu/data":
            instruments.take_imu(one.values[3:])
        elif one.topic == ATTITUDE_TOPIC:
            instruments.take_attitude(one.values)
        elif one.topic == "air_data":
            instruments.take_air_data(one.values, one.stamp)


def is_lost(reading: Array) -> bool:
    """Beyond the envelope, or not finite."""
    bank, pitch, _ = euler_from_quaternion(reading[Reading.QUATERNION])
    airspeed, alpha, _ = reading[Reading.TRUE_AIR]
    inside = abs(bank) < LARGEST_BANK and abs(pitch) < LARGEST_PITCH and abs(alpha) < LARGEST_ALPHA
    return not (inside and SLOWEST < airspeed < FASTEST and reading[Reading.HEIGHT] > LOWEST)


def _row(time: float, reading: Array, controller: AttitudeController, command: Array) -> list[float]:
    bank, pitch, _ = euler_from_quaternion(reading[Reading.QUATERNION])
    airspeed, alpha, beta = reading[Reading.TRUE_AIR]
    wanted = (controller.bank.angle, controller.pitch.angle + controller.trim_pitch)
    return [time, bank, pitch, *wanted, alpha, beta, airspeed, reading[Reading.HEIGHT], *command]


def _shares(pilot: Any) -> Array:
    values = getattr(pilot, "values", None)
    if values is None:
        return np.full(3, np.nan)
    return np.array([np.mean(values.origin == origin) for origin in Origin])
