"""Estimators and monitors: the ones learn from coefficient samples, the others command; commands are done here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientBatch, CoefficientSample
from aircraft_sysid_ros.identification.coefficients.pace import Pace
from aircraft_sysid_ros.identification.conditions import LearntConditions
from aircraft_sysid_ros.identification.description import Description
from aircraft_sysid_ros.identification.doubtful_constants import DoubtfulConstants
from aircraft_sysid_ros.identification.estimators.by_name import make_estimator
from aircraft_sysid_ros.identification.estimators.choice import EstimatorChoice
from aircraft_sysid_ros.identification.estimators.contract import AxisEstimate, AxisReset, Estimator
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import (
    RecursiveLeastSquares,
    RlsState,
    restore_axis,
)
from aircraft_sysid_ros.identification.health import HealthWatch
from aircraft_sysid_ros.identification.history import Carry, ParameterCheckpoint, SampleHistory
from aircraft_sysid_ros.identification.landing import Known, Landing
from aircraft_sysid_ros.identification.missing import Missing
from aircraft_sysid_ros.identification.monitoring.covariance_reset import ChangeDetector
from aircraft_sysid_ros.identification.monitoring.doubts import when_saved
from aircraft_sysid_ros.identification.monitoring.hold import Restore
from aircraft_sysid_ros.identification.monitoring.integrity import IntegrityMonitor
from aircraft_sysid_ros.identification.monitoring.undefined_terms import UndefinedTerms
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.parameter_set import (
    ParameterEstimate,
    ParameterSet,
    axis_estimates,
    motion_of_terms,
)
from aircraft_sysid_ros.identification.predictions import KnownHistory
from aircraft_sysid_ros.identification.prior import AxisPrior, FleetKnowledge
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.identification.undescribed.sensors import UndescribedSensors
from aircraft_sysid_ros.reconstruction.state import OF_THE_IMU, StateField
from aircraft_sysid_ros.samples import Samples

Array = npt.NDArray[np.float64]

#: Time [s] between two looks at the flight counts as so much at most.
LONGEST_LOOK = 1.0
#: Without a sample for so long [s] what is published has the time of the newest state.
STALE = 1.0


def newest_count(options: ParameterOptions) -> int:
    """How many samples the sliding model error is made of."""
    return max(round(options.error_window / options.step), 2)


class Learning:
    """Recursive least squares, the estimator that is published, and the monitors of both.

    Least squares always runs: it knows an axis first, says when the aeroplane has changed and how the terms moved, and
    lends an axis its start. Where it is the published one, ``estimator`` is ``least_squares``. With ``auto`` a
    ``choice`` may bring another one, which learns beside it and is published once it knows all axes.
    """

    def __init__(self, aircraft: Aircraft, options: ParameterOptions, pace: Pace, pace_of_controls: Pace) -> None:
        """``pace`` of the states and of the controls: how fast they come now."""
        self.aircraft, self._options = aircraft, options
        self._pace, self._pace_of_controls = pace, pace_of_controls
        self.least_squares = RecursiveLeastSquares(aircraft, options)
        self.estimator: Estimator = make_estimator(aircraft, options, self.least_squares)
        self.choice = EstimatorChoice(aircraft, options, pace) if options.estimator == "auto" else None
        self._considered = np.nan  # [s]
        self._moved = 0.0  # [s] by which clocks that started over show more than the first one
        self.constants = DoubtfulConstants()
        self.undescribed = UndescribedSensors(aircraft)
        self.imu_is_late = False  # as who looks at the sensors says
        self._begin_monitors()

    def _begin_monitors(self) -> None:
        options = self._options
        self.known = KnownHistory(options.half_width)
        self.history = SampleHistory(self.columns, newest_count(options))
        self.changes = ChangeDetector(options.step, options.half_width, self.history)
        forgetting = self.least_squares.tuning.forgetting
        joint = self.estimator.joint
        self.integrity = IntegrityMonitor(
            self.aircraft, options.step, options.half_width, forgetting, joint, self.history
        )
        self.conditions = LearntConditions()
        aircraft = self.aircraft
        self._undefined = UndefinedTerms(aircraft.model)
        self.landing = Landing(float(aircraft.minimum_airspeed))
        self.fleet = FleetKnowledge(aircraft.model, aircraft.prior)
        self.health = HealthWatch(aircraft.model, aircraft.prior, aircraft.chord / aircraft.span)
        self.newest: Array | None = None  # sample

    @property
    def columns(self) -> int:
        """Columns of a sample."""
        return CoefficientSample.TERMS + len(self.aircraft.model.parameter_names)

    @property
    def late_surfaces(self) -> dict[str, tuple[float, float]]:
        """As ``UndescribedSensors`` has them; nothing where the IMU, with which they are compared, is late or wrong."""
        wrong = self.imu_is_late or any(hold is not None and hold.words in OF_THE_IMU for hold in self.integrity.holds)
        return {} if wrong else self.undescribed.late_surfaces

    @property
    def lends(self) -> bool:
        """Whether another estimator than least squares is published."""
        return self.estimator is not self.least_squares

    @property
    def published(self) -> dict[str, str]:
        """Which estimator was asked for, which is published, and why, for people and files."""
        asked = self._options.estimator
        if self.choice is None:
            return {"asked": asked, "published": asked, "why": "asked for"}
        waits = "" if self.lends or self.choice.successor is None else "until rml knows all axes: "
        return {"asked": asked, "published": "rml" if self.lends else "rls", "why": waits + self.choice.why}

    # -- starting over ------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Forget all that was learnt."""
        self.least_squares.reset()
        if self.choice is not None:
            self.estimator = self.least_squares
            self.choice.begin_anew(self.aircraft)
        self.estimator.reset()
        self._begin_monitors()

    def change_options(self, options: ParameterOptions) -> None:
        """Go on with other options, which have passed ``check_change``."""
        if options.relearn and not self._options.relearn:
            self.changes.restart()  # its memory is from before it was switched off
        self._options = options
        self.least_squares.change_options(options)
        if self.choice is not None:
            self.choice.change_options(options)
        elif self.lends:
            self.estimator.change_options(options)
        self.integrity.forget_at(self.least_squares.tuning.forgetting)
        self.history.keep_newest(newest_count(options))

    def keep_pace(self) -> None:
        """States come at another rate from now on."""
        self.least_squares.keep_pace(self._pace)
        if self.choice is not None:
            self.choice.keep_pace()
        elif self.lends:
            self.estimator.keep_pace(self._pace)

    def adopt(self, aircraft: Aircraft, state: RlsState, estimator: Estimator, carry: Carry) -> None:
        """Go on with another model and what is known of it, see ``model_change``; ``carry`` what was known before."""
        self.least_squares.adopt(aircraft.model, state)
        if estimator is not self.estimator and estimator is not self.least_squares:
            self.known.begin(self.least_squares.known())  # until the new estimator knows better
        if self.choice is not None and aircraft.model.terms != self.aircraft.model.terms:
            self.choice.adopt(aircraft)
            self.integrity.joint = False
        before, self.aircraft, self.estimator = self.aircraft.model.terms, aircraft, estimator
        self.history.widen(self.columns)
        self._undefined = UndefinedTerms(aircraft.model)
        self.undescribed.adopt(aircraft.model)
        self.changes.restart()
        self.changes.forget([axis for axis, name in enumerate(AXES) if before[name] != aircraft.model.terms[name]])
        self.integrity.change_model(aircraft, None if self.lends else carry)
        self.landing.restart()
        self.fleet.adopt(aircraft.model)
        self.health.adopt(aircraft.model)

    def restart_clock(self) -> None:
        """The clock started over: what was learnt stays."""
        self.least_squares.restart_clock()
        if self.choice is not None:
            self.choice.restart_clock()
            self._considered = np.nan
        elif self.lends:
            self.estimator.restart_clock()
        self.known.restart_clock()
        self.undescribed.restart_clock()
        self.history.restart()
        self._undefined.restart()
        self.changes.restart_clock()
        self.integrity.restart()
        self.landing.restart()
        self.fleet.restart_clock()

    def move_times(self, by: float) -> None:
        """The clock that has started over shows ``by`` [s] more: what was learnt is as old as it was."""
        self._moved += by
        self.least_squares.move_times(by)
        if self.choice is not None:
            self.choice.move_times(by)
        elif self.lends:
            self.estimator.move_times(by)

    def begin_anew(self, same_flight: bool) -> None:
        """Another manoeuvre begins: what was learnt stays, or what was known before it was held."""
        self.constants.of_manoeuvres = True
        if not same_flight:
            holds = enumerate(self.integrity.holds)
            self._restore([Restore(axis, hold.good) for axis, hold in holds if hold is not None and hold.good])
        self.restart_clock()
        if not same_flight:
            self.changes.forget()
            count = self.integrity.count
            self.integrity.adopt(self.aircraft)
            self.integrity.count = count

    # -- samples in ---------------------------------------------------------------------------------------------------

    def push_samples(self, samples: Samples, epoch: int) -> None:
        """All samples of the flight, as ``Estimator`` has them."""
        self.estimator.push_samples(samples, epoch)
        if self.choice is not None and not self.lends:
            self.choice.push_samples(samples, epoch)

    def learn(self, batch: CoefficientBatch) -> None:
        """Learn from samples, each predicted with what was known before it."""
        self.changes.add_states(batch.rows)
        self.landing.add(batch.rows)
        self.integrity.sensors.add(batch.rows)
        self.integrity.noise.add(batch)
        if self.lends:
            self.known.add(self.estimator.step(batch))
        elif self.choice is not None:
            self.choice.step(batch)
        theta = self.least_squares.state.theta.copy() if self.undescribed.are_late else None
        self.least_squares.step(batch)
        self.undescribed.add(batch)
        samples = batch.samples
        if len(samples):
            if theta is not None:
                self.undescribed.predict(samples, self.aircraft.model, theta)
            by_least_squares = samples[:, CoefficientSample.PREDICTED].copy()
            if self.lends:
                self.known.predict(samples, self.aircraft.model, self.estimator)
            self.history.add(samples, batch.weights, by_least_squares)
            self.conditions.add(samples)
            self._undefined.add(samples)
            self.newest = samples[-1]

    def evaluate(self, time: float, start: float, used_until: float, misread: list[str]) -> None:
        """Do what the monitors command at ``time`` [s]; ``start`` [s] of the flight, states used until a time [s].

        ``misread``: what is wrong with controls, in words.
        """
        state = self.least_squares.state
        if self._options.relearn:
            was_known = partial(self.integrity.was_known, now=time)
            resets = self.changes.evaluate(self.aircraft.model, state, start, was_known, self.undescribed.lateness)
            self._reset_axes(resets, time)
            self.changes.remember(state)
        self.undescribed.look(time, self._pace.interval)
        if self.fleet.is_due(time):
            self._look_at_prior(time, start)
        self._restore(self.integrity.evaluate(time, state.updates >= THRESHOLDS.change_known, misread))
        if self.newest is not None and self.integrity.checkpoints.is_due(time):
            kept = self._checkpoint(time, used_until)
            self.integrity.keep(kept)
            self.landing.keep(Known(kept, self._as_published(kept, start)))
        if known := self.landing.touched_down(time):
            self._restore(self.integrity.land(time, known.kept))

    def _as_published(self, kept: ParameterCheckpoint, start: float) -> Callable[[], ParameterSet]:
        """What is published now of what is ``kept``, for whoever wants to know it later."""
        described = kept.describe._replace(priors=[*self.fleet.axes])
        gates, changed = self.integrity.gates(), self.changes.since.copy()
        return lambda: gates.gated(described(), changed, start)

    def choose(self, batch: CoefficientBatch) -> None:
        """Where the estimator chooses itself: look at the flight, and go over to a successor that knows all axes."""
        if self.choice is None or self.lends:
            return
        time, before = float(batch.rows[0, StateField.TIME]), self._considered
        self._considered = time
        trusted = not any(hold is not None and hold.sensor for hold in self.integrity.holds)
        self.choice.consider(batch, min(time - before, LONGEST_LOOK) if time > before else 0.0, trusted)
        if self.choice.is_ready():
            self._publish(self.choice.successor)

    def _publish(self, successor: Estimator | None) -> None:
        """Publish another estimator from now on, or least squares again, under which the same one learns anew."""
        if successor is None:
            self.estimator.reset()
        self.estimator = self.least_squares if successor is None else successor
        self.integrity.joint = self.estimator.joint
        self.known.begin(self.estimator.known())

    def _reset_axes(self, resets: list[AxisReset], time: float) -> None:
        for reset in resets:
            self.least_squares.reset_axis(reset)
            if not reset.is_beside:
                self.undescribed.learn_anew(reset.axis)
                self.conditions.learn_anew(reset.axis, reset.samples)
            if reset.is_again or reset.is_beside:
                continue
            self.integrity.note_change(reset.axis, time, reset.is_news)
            if reset.is_news:
                continue
            self.fleet.drop(reset.axis, f"dropped, since the axis changed at {self.changes.times[reset.axis]:.1f} s")
        if not self.lends:
            if resets and self.choice is not None:
                self.choice.forget()
            return
        changed = [reset for reset in resets if not reset.is_beside]
        if changed:
            self.estimator.reset_axis(*changed)
            self.known.begin(self.estimator.known())
        for axis in filter(self.estimator.needs_reseed, range(len(AXES))):
            found = self.changes.relearnt(axis, self.aircraft.model, self.least_squares.state)
            if found is not None:
                self.estimator.reseed(axis, found)
                self.known.begin(self.estimator.known())

    def _look_at_prior(self, now: float, start: float) -> None:
        """Watch the health of the aeroplane, and drop what earlier flights say of axes where least squares contradicts,
        or which a fault moves that all of them together show.

        An axis that is held says nothing.
        """
        model, state = self.aircraft.model, self.least_squares.state
        own = [ParameterEstimate(name, np.nan, np.nan, Trust.HOLD, "", np.nan, 0.0) for name in model.parameter_names]
        least_squares: list[AxisEstimate | None] = [None] * len(AXES)
        of_sensors = self._describe(state, now, [None] * len(AXES))._replace(own=least_squares).of_sensors()
        for axis, (name, missing) in enumerate(zip(AXES, self._missing(), strict=True)):
            if self.integrity.holds[axis] is None and not missing:
                bounds = self.aircraft.parameter_bounds
                found, _ = axis_estimates(model, axis, state, now, missing, bounds=bounds, sensors=of_sensors[axis])
                own[model.axis_slice(name)] = found
                self.fleet.look(axis, *_columns(found), now - start)
        self.health.look(*_columns(own), now - start)
        if self.health.now is not None:
            for name in self.health.axes:
                self.fleet.drop(AXES.index(name), f"dropped: {self.health.sentence(self.health.now)}")

    def _restore(self, restores: list[Restore]) -> None:
        for axis, good in restores:
            self.least_squares.restore(good.least_squares, axis)
            part = self.aircraft.model.axis_slice(AXES[axis])
            self.least_squares.state.last_learnt[part] += self._moved - good.moved
            self.changes.undo(axis, good.changed[:, axis])
            self.conditions.ranges[:] = good.ranges
        if restores and not self.lends and self.choice is not None:
            self.choice.forget()
        if restores and self.lends:
            oldest = min((good for _, good in restores), key=lambda good: good.time)
            if oldest.estimator is None:  # from before it was published
                self._publish(None)
                return
            self.estimator.restore(oldest.estimator, *(axis for axis, _ in restores))
            self.estimator.move_times(self._moved - oldest.moved)
            self.known.begin(self.estimator.known())

    def take(self, learnt: Mapping[str, Array], sensors: Mapping[str, Array], lacked: Mapping[str, str]) -> None:
        """Where nothing is learnt: arrays of an ``RlsState`` and of ``UndescribedSensors.sums`` of another time, and
        what was said then of axes that the model did not explain.
        """
        for name, array in learnt.items():
            getattr(self.least_squares.state, name)[:] = array
        self.undescribed.go_on(sensors)
        if not self.lends:
            self.integrity.know(self._checkpoint(np.nan, np.nan))
        self.integrity.doubts.remember(when_saved(lacked))

    def believed(self) -> RlsState:
        """What least squares know, of an axis that is held what they knew before."""
        state = self.least_squares.checkpoint()
        nothing = self.least_squares.new_state(self.aircraft.model)
        for axis, hold in enumerate(self.integrity.holds):
            if hold is not None:
                restore_axis(state, nothing if hold.good is None else hold.good.least_squares, axis)
        return state

    def _checkpoint(self, time: float, used_until: float) -> ParameterCheckpoint:
        state = self.least_squares.checkpoint()
        own = self.estimator.checkpoint() if self.lends else None
        changed = np.array([self.changes.since, self.changes.times])
        described = self._describe(state, self.time(used_until), [None] * len(AXES))
        ranges = self.conditions.ranges.copy()
        return ParameterCheckpoint(time, described, state, own, changed, ranges, moved=self._moved)

    # -- what was learnt ----------------------------------------------------------------------------------------------

    def time(self, used_until: float) -> float:
        """Time [s] of the newest sample, of the newest state that was used where no sample came for STALE.

        NaN before any sample.
        """
        if self.newest is None:
            return np.nan
        newest = float(self.newest[CoefficientSample.TIME])
        return used_until if used_until > newest + STALE else newest

    def estimates(self, used_until: float) -> ParameterSet:
        """The parameters now, with standard errors corrected for coloured residuals and a verdict on each."""
        return self._describe(self.least_squares.state, self.time(used_until), self.fleet.axes)()

    def std_of_sensors(self, used_until: float) -> Array:
        """As ``Description`` has it (parameters,), for who takes surfaces as ``late_surfaces`` says."""
        described = self._describe(self.least_squares.state, self.time(used_until), self.fleet.axes)
        return described.std_of_sensors(bool(self.late_surfaces))

    def published_now(self, used_until: float, start: float) -> ParameterSet:
        """``estimates`` that have passed the integrity monitor, what was known before; or in the air, if it is not."""
        of_air = self.landing.published(self.time(used_until), start)
        found = of_air or self.integrity.gated(self.estimates(used_until), self.changes.since, start)
        return self.credited(self.constants.carried(self._undefined.held(found)))

    def noise_of(self, points: Array) -> tuple[Array, Array]:
        """Variances of samples from the noise of the IMU (m, 6), and of the noise of terms (parameters,)."""
        return self.integrity.noise.response(points), self.least_squares.state.noise_square.copy()

    def _describe(self, state: RlsState, time: float, priors: Sequence[AxisPrior | None]) -> Description:
        """What is known now; ``state`` of least squares must not have changed by the time that it is made.

        ``priors`` of the axes: what is remembered has none, or what earlier flights say would be held against this one.
        """
        axes = range(len(AXES))
        return Description(
            self.aircraft.model, time, self.newest, state,
            own=[self._own(axis) for axis in axes],
            missing=self._missing(),
            changed=self.changes.times.tolist(),
            constants=copy(self.constants),
            ranges=[(float(low), float(high)) for low, high in self.conditions.ranges],
            bounds=self.aircraft.parameter_bounds,
            priors=[*priors],
            sensors=self.undescribed.doubt(),
        )  # fmt: skip

    def _missing(self) -> list[str]:
        """What keeps each axis from being learnt, in words; empty where nothing but motion does."""
        missing = Missing(
            self.aircraft.model, self.newest, self.conditions, self.constants.angles, self._pace, self._pace_of_controls
        )
        return [missing.why(axis, updates) for axis, updates in enumerate(self.least_squares.state.updates.tolist())]

    def _own(self, axis: int) -> AxisEstimate | None:
        """What the published estimator knows of an axis; None: what least squares knows is published.

        That is so of an axis that waits, and, where nobody asked for this estimator, of one that it has given up.
        """
        if not self.lends or self.estimator.needs_reseed(axis):
            return None
        found = self.estimator.estimate(axis)
        return None if self.choice is not None and not found.samples else found

    def credited(self, found: ParameterSet) -> ParameterSet:
        """The parameters, and where the estimator chose itself another than least squares, that and why in words."""
        if self.choice is None or not self.lends:
            return found
        words = f"by rml: {self.choice.why}"
        return replace(found, parameters=tuple(
            replace(p, reason="; ".join(filter(None, (p.reason, words)))) if p.status == Trust.USE else p
            for p in found.parameters
        ))  # fmt: skip

    def warm_up(self) -> None:
        """Compile, or load from the cache, what two seconds of level flight do not reach."""
        self.least_squares.warm_up()
        self.estimator.warm_up()
        for sums in (np.eye(3), np.eye(4)[:3, :3]):  # of the longest axis, and of another
            motion_of_terms(sums, np.zeros(1))
        self.integrity.doubts.warm_up()
        self.undescribed.warm_up()
        if self.choice is not None:
            self.choice.warm_up()


def _columns(found: Sequence[ParameterEstimate]) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Values, standard errors, and which are to USE (n,)."""
    value, std = np.array([(p.value, p.std) for p in found]).reshape(-1, 2).T
    return value, std, np.array([p.status == Trust.USE for p in found], dtype=np.bool_)
