"""Measured coefficients and signals of a flight, as diagnosis reads them from a run."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel, model_from_terms
from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.aircraft.expression import Lag, Program, parse_expression
from aircraft_sysid_ros.aircraft.signals import FIRST_LAG, SIGNAL_COUNT, SURFACE_WORDS
from aircraft_sysid_ros.aircraft.term_values import lags_of, rate_limited, values_on, with_lags
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.window_average import window_averages
from aircraft_sysid_ros.identification.coefficients.pace import (
    why_airspeed_too_slow,
    why_controls_too_slow,
    why_too_slow,
)
from aircraft_sysid_ros.identification.conditions import CONTROL_SIGNALS, listed, needs, throttle_instead
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.run_reader import UNREADABLE, not_a_run, read_points
from aircraft_sysid_ros.samples import Samples

Array = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

POINTS, AIRCRAFT = "points.npz", "aircraft.yaml"
#: Length [s] of the blocks that are held out together, and what is left out at the borders of each.
BLOCK, GUARD = 5.0, 0.4
FOLDS = 4
#: So many manoeuvres are held out one by one, in place of blocks.
LEAST_MANOEUVRES = 3
_KEPT = 256
#: Signals of surfaces, in the order of ``FlightData.surfaces``, and steps [s] in which one of them is followed.
SURFACE_SIGNALS = tuple(SURFACE_WORDS)
_QUICK = 0.01


@dataclass(frozen=True)
class FlightData:
    """n points of a flight at one step: what was measured and what the terms of a model can read."""

    aircraft: Aircraft
    time: Array  # (n,) [s] from the first point
    measured: Array  # (n, 6) C_X … C_n
    signals: Array  # (n, SIGNAL_COUNT)
    step: float  # [s]
    #: One sigma [m/s] of the air-relative velocity across the flow, the median over the flight; NaN: not stated.
    air_velocity_std: float = np.nan
    #: One sigma (3,) [m/s^2] of the bias of the accelerometer, the median over the flight; None: not stated.
    bias_std: Array | None = field(default=None, compare=False)
    smoothed: bool = False  # by later measurements too
    sparse_interval: float = 0.0  # [s] between states where they are sparse (identification.coefficients.pace), else 0
    manoeuvre: Integers | None = None  # (n,) number from 0 of the manoeuvre of each point; None: it is one flight
    names: tuple[str, ...] = ()  # of the manoeuvres
    #: (n,) number from 0 of the flight of each point, which has IMU biases of its own; None: it is one.
    flown: Integers | None = None
    #: (n,) number from 0 of the run of each point, of several that are diagnosed together; None: it is one.
    run: Integers | None = None
    runs: tuple[str, ...] = ()  # their names
    blocks_only: bool = False  # blocks are held out even where there are enough runs or manoeuvres
    inferred: tuple[str, ...] = ()  # signals of the air data that no sensor measures
    rolled: float = 0.0  # [s] that are left out, since wheels may have pushed it
    #: One sigma per sample of IMU and surfaces as the recording shows it (``white_noise``), by the name of the sensor.
    white_noise: Mapping[str, float] = field(default_factory=dict)
    #: Deflections as they were recorded, of one flight: times (k,) of the signal ``time`` and values (k, 4) [rad].
    surfaces: tuple[Array, Array] | None = field(default=None, repr=False, compare=False)
    #: Newest columns by text: a search tries the same in several axes.
    _made: dict[str, Array] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def model(self) -> AerodynamicModel:
        """The model of the aircraft file."""
        return self.aircraft.model

    @property
    def per_acceleration(self) -> Array:
        """What 1 m/s^2 along an axis of the body makes of the coefficient of its force (n,)."""
        return np.asarray(self.aircraft.mass / (self.signal("qbar") * self.aircraft.wing_area))

    @property
    def has_late_surfaces(self) -> bool:
        """Whether surfaces come at another time than they are recorded, and no lag of their servos is known.

        What a lag does beyond a delay is as quick as what a servo at its greatest rate does, and as the rate of a flow
        angle: of clean simulated flights with a lag of 0.05 s that was taken for a delay all three had been named.
        """
        servos = self.aircraft.sensors["control_surfaces"]
        return servos.delay != 0.0 and not servos.lag > 0.0

    @cached_property
    def begin(self) -> float:
        """The signal ``time`` at time 0: times that people read count from the start of the recording."""
        since_start = self.signal("time") - self.time
        known = since_start[np.isfinite(since_start)]
        return float(np.median(known)) if len(known) else 0.0

    @property
    def notes(self) -> list[str]:
        """What is left out of the flight."""
        if not self.rolled > 0.0:
            return []
        slow = THRESHOLDS.rolling_speed * self.aircraft.minimum_airspeed
        return [
            f"{self.rolled:.0f} s next to an airspeed below {slow:.2g} m/s are left out: the aeroplane may have been "
            "on its wheels there (minimum_airspeed of the aircraft file says how slowly it can fly)"
        ]

    @cached_property
    def block(self) -> Integers:
        """Number of the block (n,) that each point lies in."""
        return np.asarray(np.floor(self.time / BLOCK), dtype=np.int64)

    @cached_property
    def _whole(self) -> Integers | None:
        """Number (n,) of what is held out whole: the run or the manoeuvre, where there are enough; None: blocks are."""
        for numbers in () if self.blocks_only else (self.run, self.manoeuvre):
            if numbers is not None and len(np.unique(numbers)) >= LEAST_MANOEUVRES:
                return np.asarray(np.unique(numbers, return_inverse=True)[1])
        return None

    @property
    def by_manoeuvre(self) -> bool:
        """Runs or manoeuvres are held out one by one: there are enough of them."""
        return self._whole is not None

    @property
    def fold(self) -> Integers:
        """Number (n,) from 0 of what each point is held out with: its run, its manoeuvre, or every fourth block."""
        return self.block % FOLDS if self._whole is None else self._whole

    @cached_property
    def seams(self) -> tuple[float, ...]:
        """The signal ``time`` between one run and the next, of several."""
        last, time = np.flatnonzero(np.diff(self.run)) if self.run is not None else (), self.signal("time")
        return tuple(float(0.5 * (time[k] + time[k + 1])) for k in last)

    def runs_within(self, begin: float, end: float = np.inf) -> list[str]:
        """Names of the runs from one seam up to another one, or up to the end; none where either is no seam."""
        if self.run is None or begin not in self.seams or end not in (*self.seams, np.inf):
            return []
        numbers, first = np.unique(self.run, return_index=True)
        inside = (self.signal("time")[first] > begin) & (self.signal("time")[first] < end)
        return [self.runs[number] if number < len(self.runs) else f"run {number + 1}" for number in numbers[inside]]

    @property
    def folds(self) -> int:
        """How many parts take turns at being held out."""
        return FOLDS if self._whole is None else int(self._whole.max()) + 1

    def held_out_spans(self, fold: int) -> list[tuple[float, float]]:
        """Times [s], from and to, of the points that are held out together."""
        if self.by_manoeuvre:
            inside = self.time[self.fold == fold]
            return [(float(inside[0]), float(inside[-1]))]
        return [(float(t), float(t) + BLOCK) for t in np.arange(fold * BLOCK, self.time[-1], FOLDS * BLOCK)]

    def at_time(self, time: float) -> str:
        """Words that name the manoeuvre of a time [s], with a space before them; empty for one flight."""
        if self.manoeuvre is None or not len(self.time):
            return ""
        number = int(self.manoeuvre[min(int(np.searchsorted(self.time, time)), len(self.time) - 1)])
        return f" ({self.names[number] if number < len(self.names) else f'manoeuvre {number + 1}'})"

    @cached_property
    def guarded(self) -> Mask:
        """Points (n,) near a border of a block: neither fitted nor judged, since residuals are coloured.

        Between manoeuvres there is a pause, which is longer.
        """
        if self.by_manoeuvre:
            return np.zeros(len(self.time), np.bool_)
        phase = np.mod(self.time, BLOCK)
        return np.asarray((phase < 0.5 * GUARD) | (phase > BLOCK - 0.5 * GUARD))

    def coefficient(self, axis: str) -> Array:
        """One measured coefficient (n,), ``within`` flights."""
        return self.within(self.measured[:, AXES.index(axis)])

    def within(self, values: Array) -> Array:
        """Values (n,) or (n, k) with their mean in all flights in place of the mean in each flight.

        In some seconds nobody learns what the biases of an IMU are: they stand in the forces as a constant of each
        flight, which is taken off both sides of a regression (the fixed effects of panel data).
        """
        if self.flown is None:
            return values
        known = np.isfinite(values)
        filled, count = np.where(known, values, 0.0), max(int(self.flown.max()) + 1, 1)
        sums = np.zeros((count, *values.shape[1:]))
        numbers = np.zeros_like(sums)
        np.add.at(sums, self.flown, filled)
        np.add.at(numbers, self.flown, known)
        means = sums / np.maximum(numbers, 1.0)
        total = sums.sum(axis=0) / np.maximum(numbers.sum(axis=0), 1.0)
        return np.asarray(values - means[self.flown] + total)

    def with_signals(self, signals: Array) -> FlightData:
        """The same flight with other signals (n, SIGNAL_COUNT)."""
        return replace(self, signals=signals)

    def under(self, aircraft: Aircraft) -> FlightData:
        """The flight under an aircraft file that differs in its model, with the noise that the flight had."""
        flown = self.aircraft
        return replace(self, aircraft=replace(aircraft, sensors=flown.sensors, process_noise=flown.process_noise))

    def with_terms(self, terms: Mapping[str, Sequence[str]]) -> FlightData:
        """The same flight under a model with more terms by axis. Raises InputError for those that it has."""
        listed = {axis: [*known, *terms.get(axis, ())] for axis, known in self.model.terms.items()}
        model = model_from_terms(listed, self.model.inputs)
        return replace(self, aircraft=replace(self.aircraft, model=model))

    def signal(self, name: str) -> Array:
        """One signal (n,)."""
        return np.asarray(self.signals[:, self.model.signal_names.index(name)])

    def parsed(self, texts: Iterable[str]) -> list[Program]:
        """Terms of texts, which may read the named inputs of the aircraft. Raises InputError."""
        return [parse_expression(text, self.model.inputs) for text in texts]

    def lacks(self, names: Collection[str]) -> list[str]:
        """Those of some signals that have no value anywhere in the flight."""
        return [s for s in self.model.signal_names if s in names and not np.isfinite(self.signal(s)).any()]

    def why_unknown(self, axis: str, parameters: Collection[str]) -> str:
        """Why the terms of some parameters have no value anywhere in the flight."""
        part = self.model.axis_slice(axis)
        programs = zip(self.model.parameter_names[part], self.model.programs[AXES.index(axis)], strict=True)
        lacking = self.lacks({name for parameter, p in programs if parameter in parameters for name in p.signals})
        if not lacking:
            return f"{listed(sorted(parameters))} never have a value in this flight"
        return f"it {needs(lacking)}{self._instead(axis) if 'Tc' in lacking else ''}"

    def _instead(self, axis: str) -> str:
        """What may stand for a thrust that nothing measures, in words; empty where the throttle does not move."""
        instead = throttle_instead({axis: self.model.terms[axis]})
        if not instead or not (self.signal("throttle") > 0.0).any():
            return ""
        return f" (under 'model' of the aircraft file {instead} uses the throttle in place of the thrust)"

    @property
    def untold(self) -> list[str]:
        """Signals of the air data that nothing measures, and that wind and attitude tell too seldom in the flight."""
        least = THRESHOLDS.shortest / self.step
        return [name for name in self.inferred if not np.isfinite(self.signal(name)).sum() >= least]

    def columns(self, programs: list[Program] | tuple[Program, ...]) -> Array:
        """Terms (n, len(programs)) on the signals, ``within`` flights, points side by side; not to be written to."""
        made, new = self._made, [p for p in programs if p.source not in self._made]
        if new:
            out = self._values(new)
            made.update(zip((p.source for p in new), self.within(out).T.copy(), strict=True))
        if len(programs) == 1:
            rows = made[programs[0].source][None]
        else:
            rows = np.array([made[p.source] for p in programs]).reshape(len(programs), len(self.time))
        while len(made) > _KEPT:
            del made[next(iter(made))]
        return rows.T

    def _values(self, programs: Sequence[Program]) -> Array:
        """Values (n, len(programs)) of terms on the signals."""
        lags = lags_of(programs)
        rows = with_lags(lags, self.time, self.signals, 1.5 * self.step)
        for k, lag in enumerate(lags):
            if (quick := self._limited(lag)) is not None:
                rows[:, FIRST_LAG + k] = np.where(np.isfinite(quick), quick, rows[:, FIRST_LAG + k])
        return values_on(programs, rows)

    def _limited(self, lag: Lag) -> Array | None:
        """What moves at its greatest rate (n,), worked out as quickly as a surface was recorded, in the mean over the
        windows of the coefficients: the mean of what is limited is not what limits the mean. None of anything else.

        What it lacks of the command is what is averaged: of a rate that is never reached nothing, to the last bit.
        """
        name = lag.program.text
        if name not in SURFACE_SIGNALS or np.isinf(lag.rate) or self.surfaces is None or self.sparse_interval > 0.0:
            return None
        time, values = self.surfaces
        known = np.isfinite(column := values[:, SURFACE_SIGNALS.index(name)])
        if known.sum() < 2:
            return None
        grid = np.arange(time[known][0], time[known][-1], _QUICK)
        told = np.interp(grid, time[known], column[known])
        left = (rate_limited(told, lag.rate, _QUICK) - told)[:, None]
        mean = window_averages(grid, left, self.signal("time"), ParameterOptions().half_width, False)[:, 0]
        return self.signal(name) + mean


def load_flight_data(run: str | Path) -> FlightData:
    """The points of a run folder in flight; InputError when there is no run, or too little flight in it."""
    folder = Path(run)
    if not (folder / POINTS).is_file() or not (folder / AIRCRAFT).is_file():
        raise not_a_run(run)
    aircraft = load_aircraft(folder / AIRCRAFT)
    try:
        points = read_points(folder)
    except UNREADABLE:
        raise not_a_run(run) from None
    stamp, measured, signals = points["stamp"], points["measured"], points["signals"]
    names = tuple(str(name) for name in points["signal_names"])
    if names != aircraft.model.signal_names or measured.shape != (len(stamp), len(AXES)):
        raise InputError(f"{run} was written by another version of this program: replay the recording again")
    time = (stamp - stamp[0]) * 1e-9 if len(stamp) else np.empty(0)
    step = float(np.median(np.diff(time))) if len(time) > 1 else np.nan
    unnamed = np.full((len(stamp), SIGNAL_COUNT - len(names)), np.nan)
    flight = FlightData(aircraft, time, measured, np.hstack([signals, unnamed]), step)
    check_flight(str(run), flight)
    return flight


def check_flight(run: str, flight: FlightData, samples: Samples | None = None) -> None:
    """Raises InputError where a run has too little in flight, or samples too slow for it, which it names."""
    count, controls = len(flight.time), flight.model.signals_used & CONTROL_SIGNALS
    if not count * flight.step >= THRESHOLDS.shortest:
        seconds = 0.0 if count < 2 else count * flight.step
        slow = "" if samples is None else why_too_slow(samples) or why_airspeed_too_slow(samples)
        short = f"{run} has {seconds:.0f} s in flight with air data: {THRESHOLDS.shortest:g} s are needed"
        raise InputError(f"{run} cannot be judged: {slow}" if slow else short)
    known = max((int(np.isfinite(flight.signal(name)).sum()) for name in controls), default=count) * flight.step
    if samples is None:
        return
    of_controls = why_controls_too_slow(samples) if known < THRESHOLDS.shortest else ""
    if slow := why_airspeed_too_slow(samples) or of_controls:
        raise InputError(f"{run} cannot be judged: {slow}")
