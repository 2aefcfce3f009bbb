"""The chain once more over the samples of a flight, with the smoother: diagnosis has all of the flight before it.

A smoothed reconstruction has two virtues here. Biases are known from the first moment on, so that their settling does
not look like a slow change of a coefficient; and errors of the angles of attack and sideslip, which stand on both
sides of the regression in turbulence, are smaller and no longer late. For the same reason sensors are as noisy as they
were in the flight, and the wind walks as much as it did (``as_flown``); all else is as the aircraft file says.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import SURFACES, Aircraft
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.flight.sensor_rates import with_sparse_rates
from aircraft_sysid_ros.diagnosis.flight.slower_imu import with_slower_imu
from aircraft_sysid_ros.diagnosis.flight.wheels import off_wheels
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.as_loaded import as_loaded
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.coefficients.pace import interval_of, sparse_interval
from aircraft_sysid_ros.identification.coefficients.stream import coefficient_samples
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS as OF_IDENTIFICATION
from aircraft_sysid_ros.processes import in_parallel
from aircraft_sysid_ros.reconstruction.absences import has_airspeed, options_after_flight
from aircraft_sysid_ros.reconstruction.filter_setup import sensor_delays
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.smoother_history import SmootherHistory
from aircraft_sysid_ros.reconstruction.sparse_imu import LONG
from aircraft_sysid_ros.reconstruction.state import LearntNoise, StateField, learnt_noise
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import (
    SHORTEST,
    Kind,
    Samples,
    flights,
    is_absurd,
    manoeuvre_at,
    manoeuvres,
    run_of_manoeuvres,
)
from aircraft_sysid_ros.stamps import nanoseconds
from aircraft_sysid_ros.stretches import longest_stretch

Array = npt.NDArray[np.float64]

#: The angles of the smoother are not late, and its errors are those that the noise floor and the replicas have.
OF_FILTER = ParameterOptions(measured_angles=False)
#: Median of the square of a standard normal variable.
_MEDIAN_SQUARE = 0.4549
_LEAST_FOR_NOISE = 200
#: A state is given up where so many measurements [1] were rejected within some time [s] before a gap.
_MOST_REJECTED, _REJECTING = 20.0, 5.0
#: Factor between the random walks of the wind that are tried, and the largest [m/s per sqrt(s)].
WALK_STEP, LARGEST_WALK = 1.25, 8.0
#: The same below that of the aircraft file, where a walk matters less, and the smallest.
CALMER_STEP, SMALLEST_WALK = 0.5, 0.002
AIR_DATA = {"airspeed": Kind.AIRSPEED, "angle_of_attack": Kind.ANGLE_OF_ATTACK, "sideslip": Kind.SIDESLIP}
_AIR_SIGNALS = {"V": Kind.AIRSPEED, "alpha": Kind.ANGLE_OF_ATTACK, "beta": Kind.SIDESLIP}
_MEASURED_NOISE = {
    Kind.IMU: ("accelerometer", "gyro"),
    Kind.AIRSPEED: ("airspeed",),
    Kind.ANGLE_OF_ATTACK: ("angle_of_attack",),
    Kind.SIDESLIP: ("sideslip",),
}


@dataclass(frozen=True)
class Reconstruction:
    """Smoothed states of a flight (n, StateField.WIDTH) and what is made of them: (m, …) of ``CoefficientSample``."""

    aircraft: Aircraft
    samples: Samples
    rows: Array
    epoch: int  # [ns] from which times of rows and points count
    points: Array
    gusts: float  # random walk of the wind [m/s per sqrt(s)] at the end
    filter_std: Array  # (n,) [m/s] of the air velocity across the flow, as the filter knew it before it was smoothed

    @property
    def data(self) -> FlightData:
        """What the fits read; its aircraft has the recorded mass properties, as the points have."""
        aircraft = as_loaded(with_sparse_rates(self.aircraft, self.samples), self.samples)
        data = flight_data_of(aircraft, self.points)
        several = np.any(self.samples.kind == Kind.SEAM)
        number = self.manoeuvre_at(self.points[:, CoefficientSample.TIME]) if several else None
        of_runs, run = run_of_manoeuvres(self.samples), None
        of_flights = [len(manoeuvres(each)) for each in flights(self.samples)]
        flown = None if len(of_flights) < 2 else np.repeat(np.arange(len(of_flights)), of_flights)[number]
        if of_runs[-1] > 0:
            run, whole = of_runs[number], len(of_runs) == of_runs[-1] + 1
            flown = None if whole else flown  # a whole flight has learnt its biases, as one by itself has
        measured = set(self.samples.kind[np.isfinite(self.samples.values[:, 0])].tolist())
        inferred = tuple(name for name, kind in _AIR_SIGNALS.items() if kind not in measured)
        interval = sparse_interval(self.samples)
        return replace(
            data, sparse_interval=interval, manoeuvre=number, flown=flown, run=run, inferred=inferred,
            surfaces=None if several or not len(self.points) else self._surfaces(data.begin),
        )  # fmt: skip

    def _surfaces(self, begin: float) -> tuple[Array, Array]:
        """``FlightData.surfaces`` of a flight whose first point has this time."""
        controls = self.samples[self.samples.kind == Kind.CONTROLS]
        since = self.points[0, CoefficientSample.TIME] - begin + sensor_delays(self.aircraft)[Kind.CONTROLS]
        times, order = np.unique((controls.stamp - self.epoch) * 1e-9 - since, return_index=True)
        signs = [self.aircraft.surface_signs[name] for name in SURFACES]
        return times, controls.values[order, : len(SURFACES)] * signs

    def manoeuvre_at(self, time: Array) -> npt.NDArray[np.int64]:
        """Number (n,) from 0 of the manoeuvre at times [s]."""
        return manoeuvre_at(self.samples, nanoseconds(time, self.epoch))

    @property
    def rows_of_manoeuvres(self) -> Iterator[tuple[int, npt.NDArray[np.int64]]]:
        """Number of each manoeuvre that has states, and which rows are of it."""
        numbers = self.manoeuvre_at(self.rows[:, StateField.TIME])
        for number in np.unique(numbers).tolist():
            yield number, np.flatnonzero(numbers == number)


def reconstruct(
    aircraft: Aircraft, samples: Samples, with_covariance: bool = True, options: StateOptions | None = None
) -> Reconstruction:
    """States and measured coefficients of all samples; InputError when the filter does not start on them.

    Without the covariance of the smoother it is faster, and standard deviations are those of the filter.
    """
    state = StateEstimator(aircraft, options)
    with SmootherHistory() as tape:
        filtered = [rows[:, StateField.AIR_VELOCITY_STD].copy() for rows in _filtered_rows(state, samples, tape)]
        if state.epoch is None or not state.has_been_aligned:
            raise InputError("the filter does not start on the samples of this flight: replay says why")
        rows = np.array(state.smooth(with_covariance))
    points = coefficient_samples(aircraft, OF_FILTER, samples, rows, state.epoch)
    gusts = float(state.memory.wind_walk[0])
    return Reconstruction(aircraft, samples, rows, state.epoch, points, gusts, np.concatenate(filtered))


def _filtered_rows(state: StateEstimator, samples: Samples, tape: SmootherHistory) -> Iterator[Array]:
    """What the filter makes of all samples, with a ``tape`` of it.

    A flight of several manoeuvres is filtered twice, the second time from the biases that its end knows: a manoeuvre
    of some seconds says little of them, and each would have its own.
    """
    for number, flight in enumerate(flights(samples)):
        if number:
            yield state.begin_anew(np.nan)
        parts = manoeuvres(flight)
        if len(parts) > 1:
            state.tape = None
            state.push(flight)
            state.begin_anew(0.0)
        state.tape, known = tape, state.slow_states
        for place, part in enumerate(parts):
            if place:
                yield state.begin_anew(0.0)
                state.take_slow_states(known)
            yield state.push(part)
    yield state.flush()


def fit_sensor_noise(aircraft: Aircraft, samples: Samples) -> Aircraft:
    """The aircraft with the noise that IMU and air data really have in a recording, within limits of its file.

    From third differences, (1, -3, 3, -1) with the sum of squares 20: what changes from sample to sample is noise and
    not motion. Medians, so that faults do not count. A filter that is told another noise takes it for gusts.
    Where samples are sparse, what changes between them is motion: beside a sparse IMU they have the noise of the file.
    """
    longest = LONG if sparse_interval(samples) > 0.0 else np.inf
    sound = np.isfinite(samples.values[:, 0]) & ~is_absurd(samples).any(axis=1)
    for kind, names in _MEASURED_NOISE.items():
        values = samples.values[(samples.kind == kind) & sound]
        if len(values) < _LEAST_FOR_NOISE or interval_of(samples, kind) > longest:
            continue
        for number, name in enumerate(names):
            columns = values[:, 3 * number : 3 * number + 3] if kind == Kind.IMU else values[:, :1]
            squares = np.nanmedian(np.diff(columns, 3, axis=0) ** 2, axis=0)
            found, given = np.sqrt(np.median(squares) / (20.0 * _MEDIAN_SQUARE)), aircraft.sensors[name].noise[0]
            if np.isfinite(found) and given > 0.0:
                noise = given * float(np.clip(found / given, THRESHOLDS.least_noise, THRESHOLDS.most_noise))
                aircraft = with_setting(aircraft, ("sensors", name, "noise"), noise)
    return aircraft


@dataclass(frozen=True)
class Likelihood:
    """Log-likelihoods (5.7) of the innovations of the first step, by sensor, each as noisy as it is.

    The covariance of each sensor's innovations is scaled to what they are, or a scale that makes the numbers of a
    noisy sensor smaller would always win.
    """

    parts: Array  # (kinds,) -inf when the filter does not start
    #: (kinds,) share of the innovations that count for themselves: 1 where they are white. Of an attitude that has an
    #: error of its own, or is told a noise that stands for one, a few in thousands are independent.
    independent: Array
    walk: float  # random walk of the wind [m/s per sqrt(s)] at the end
    noise: LearntNoise  # as the run had it at the end

    def over(self, other: Likelihood, without: Sequence[Kind] = ()) -> float:
        """Logarithm by which this is likelier than another: a sensor counts as white as the whiter of both has it.

        As of a composite likelihood, which counts correlated terms as often as they are independent (Varin, Reid and
        Firth 2011). ``without``: sensors that do not count.
        """
        if not np.all(np.isfinite(self.parts)) or not np.all(np.isfinite(other.parts)):
            return -np.inf
        terms = np.maximum(self.independent, other.independent) * (self.parts - other.parts)
        terms[list(without)] = 0.0
        return float(np.sum(terms))


def log_likelihood(aircraft: Aircraft, samples: Samples, noise: LearntNoise | None = None) -> Likelihood:
    """Of all innovations of the first step, which learns the noise of sensors as it goes, unless it has ``noise``.

    Of a fast IMU neighbouring samples are averaged (``with_slower_imu``).

    What is compared has one noise: a filter that starts a sample later learns another one, of an attitude that errs
    slowly by a few per cent, and its likelihood then changes by tens for a delay of a sensor that it hardly uses.
    """
    aircraft, samples = with_slower_imu(aircraft, samples)
    state = StateEstimator(aircraft, noise=noise)
    state.push(samples)
    state.flush()
    sums, walk = state.memory.likelihood, float(state.memory.wind_walk[0])
    parts, independent = np.zeros(len(sums)), np.zeros(len(sums))
    learnt = learnt_noise(state.memory)
    if not state.has_been_aligned:
        return Likelihood(np.full(len(sums), -np.inf), independent, walk, learnt)
    heard = sums[:, 1] > 0.0
    outputs, squares, determinants, normalised, means = sums[heard, :5].T
    parts[heard] = -0.5 * (outputs * np.log(squares / outputs) + determinants)
    independent[heard] = np.minimum(normalised / np.maximum(means, 1e-300), 1.0)
    for name, kind in AIR_DATA.items():
        parts[kind] -= sums[kind, 0] * np.log(aircraft.sensors[name].scale)
    parts[Kind.AIRSPEED] -= sums[Kind.AIRSPEED, 0] * state.drift.mean_logarithm
    return Likelihood(parts, independent, walk, learnt)


def likelihood_as_learnt(aircraft: Aircraft, samples: Samples) -> Likelihood:
    """That of an aircraft with the noise that a run over the samples learns: others are compared with it at that."""
    return log_likelihood(aircraft, samples, log_likelihood(aircraft, samples).noise)


def as_flown(aircraft: Aircraft, samples: Samples) -> tuple[Aircraft, bool]:
    """The aircraft with the noise and the gusts of a recording, and whether it is calm; gusts only air data tell."""
    noisy = fit_sensor_noise(aircraft, samples)
    return fit_wind_noise(noisy, samples) if has_airspeed(samples) else (noisy, False)


def reconstruct_as_flown(
    aircraft: Aircraft, samples: Samples, with_covariance: bool = True, calm_air: bool = False
) -> tuple[Reconstruction, bool]:
    """The flight with the noise and the gusts that it had, on which all errors count, and whether it is calm.

    ``calm_air``: its wind was assumed to be none; no innovation of air data can say otherwise.
    """
    flown, calm = as_flown(aircraft, samples)
    return reconstruct(flown, samples, with_covariance, options_after_flight(samples, calm_air)), calm


def fit_wind_noise(aircraft: Aircraft, samples: Samples) -> tuple[Aircraft, bool]:
    """The aircraft with the random walk of the wind under which innovations are likeliest, and whether it is calm.

    Calm: no gusts beyond ``Thresholds.calm`` and beyond what the aircraft file says of the wind. The filter in flight
    follows gusts cautiously and from one side; what it takes for noise then stands as an error in the flow angles,
    larger than any replica would show. In a calm flight a smaller walk than that of the file is taken where it is
    clearly likelier: one that the wind does not have lets it explain errors of the air data, and it weighs with the
    airspeed, so that a scale of the airspeed would stand for a calmer atmosphere.
    """
    given = aircraft.process_noise["wind"]
    of_file = likelihood_as_learnt(aircraft, samples)

    def climbed(walks: Iterable[float], best: Likelihood | None, least: float) -> Aircraft:
        """The aircraft with the last of some walks up to which each is likelier than the one before it."""
        likeliest = aircraft
        for walk in walks:
            other = aircraft if walk == given else with_setting(aircraft, ("process_noise", "wind"), walk)
            likelihood = of_file if walk == given else log_likelihood(other, samples, of_file.noise)
            if best is not None and likelihood.over(best) <= least:
                break
            best, likeliest, least = likelihood, other, 0.0
        return likeliest

    def gustier() -> Aircraft:
        walks = _in_steps(min(max(of_file.walk, given), LARGEST_WALK), WALK_STEP)
        return climbed(itertools.takewhile(lambda walk: walk <= LARGEST_WALK, walks), None, 0.0)

    def calmer() -> Aircraft:
        walks = _in_steps(CALMER_STEP * min(given, of_file.walk), CALMER_STEP)  # the filter has looked below its file
        return climbed(
            itertools.takewhile(lambda walk: walk >= SMALLEST_WALK, walks), of_file, THRESHOLDS.setting_total
        )

    found = in_parallel(lambda side: side(), (gustier, calmer))  # where one core does it, one after another
    likeliest = next(found)
    is_calm = likeliest.process_noise["wind"] <= max(THRESHOLDS.calm, 1.01 * given)
    return (next(found) if is_calm else likeliest), is_calm


def _in_steps(first: float, factor: float) -> Iterator[float]:
    """A number, and each the factor times the one before it."""
    return itertools.accumulate(itertools.repeat(factor), operator.mul, initial=first)


def flight_data_of(aircraft: Aircraft, points: Array) -> FlightData:
    """FlightData of points (m, …) of ``CoefficientSample``."""
    time = points[:, CoefficientSample.TIME]
    step = float(np.median(np.diff(time))) if len(time) > 1 else np.nan
    begin = time[0] if len(time) else 0.0
    return FlightData(
        aircraft, time - begin, points[:, CoefficientSample.MEASURED], points[:, CoefficientSample.SIGNALS], step
    )


def settled_flight(made: Reconstruction) -> FlightData:
    """The flight, or each of its manoeuvres, from when the filter has settled, with what is said of its air data.

    It starts by allowing for gusts, and knows the flow angles worse until the air data have said how gusty it is. What
    wheels may have pushed is left out.
    """
    data, times = made.data, made.points[:, CoefficientSample.TIME]
    number = np.zeros(len(times), np.int64) if data.manoeuvre is None else data.manoeuvre
    limit = THRESHOLDS.settled * float(np.nanmedian(made.filter_std))
    keep = np.zeros(len(times), np.bool_)
    for each, at in made.rows_of_manoeuvres:
        known = made.filter_std[at] < limit
        if not known.any() and data.manoeuvre is not None:
            continue
        inside = (number == each) & (times >= made.rows[at[np.argmax(known)], StateField.TIME])
        for begin, end in given_up(made.rows[at]):
            inside &= (times < begin) | (times > end)
        keep |= inside
    aloft = off_wheels(data)
    rolled = float((keep & ~aloft).sum()) * data.step
    keep &= aloft
    return replace(
        data,
        time=data.time[keep],
        measured=data.measured[keep],
        signals=data.signals[keep],
        air_velocity_std=float(np.nanmedian(made.rows[:, StateField.AIR_VELOCITY_STD])),
        bias_std=np.nanmedian(made.rows[:, StateField.ACCELEROMETER_BIAS_STD], axis=0),
        smoothed=True,
        manoeuvre=None if data.manoeuvre is None else data.manoeuvre[keep],
        flown=None if data.flown is None else data.flown[keep],
        run=None if data.run is None else data.run[keep],
        rolled=rolled,
    )


def given_up(rows: Array) -> list[tuple[float, float]]:
    """Times [s], from and to, that end where the filter rejected its GPS until it started over: its state was wrong."""
    time, stretches = rows[:, StateField.TIME], []
    for last in np.flatnonzero(np.diff(time) > OF_IDENTIFICATION.longest_gap).tolist():
        lately = np.flatnonzero(time[: last + 1] > time[last] - _REJECTING)
        if np.ptp(rows[lately, StateField.REJECTED]) > _MOST_REJECTED:
            stretches.append((float(time[last] - THRESHOLDS.wrong_for), float(time[last])))
    return stretches


def repeated_rows(made: Reconstruction, longest: float) -> list[Array]:
    """Rows that stand for the flight, ``longest`` [s] at most: its longest stretch without a gap.

    Of several manoeuvres, that of each, or of every second, third, … of them; of several runs a share of each.
    """
    parts = [flying(made.rows[at], made.aircraft.minimum_airspeed) for _, at in made.rows_of_manoeuvres]
    parts = [rows for rows in parts if len(rows) > 1 and np.ptp(rows[:, StateField.TIME]) > SHORTEST]
    total = sum(float(np.ptp(rows[:, StateField.TIME])) for rows in parts)
    if total > longest and len(np.unique(run_of_manoeuvres(made.samples))) == len(parts):
        longest = max(longest / len(parts), THRESHOLDS.shortest)
    else:
        parts = parts[:: max(int(np.ceil(total / longest)), 1)]
    return [rows[rows[:, StateField.TIME] <= rows[0, StateField.TIME] + longest] for rows in parts]


def flying(rows: Array, minimum_airspeed: float) -> Array:
    """The longest stretch of rows in flight without a gap, (n, StateField.WIDTH)."""
    good = (rows[:, StateField.AIRSPEED] > minimum_airspeed) & (rows[:, StateField.STATUS] > 0.0)
    broken = np.diff(rows[:, StateField.TIME], prepend=rows[0, StateField.TIME]) > OF_IDENTIFICATION.longest_gap
    return rows[longest_stretch(good & ~broken)]
