"""What no aircraft file says of the sensors, estimated in flight where it shows, and counted in the standard errors.

*Scale and lag of a vane.* What a regression has for an angle, a, follows the true one, s times too large and tau late.
Between two samples true angles change as kinematics say (``flow_angle_rates``, from the IMU), whose integral I is
without noise to speak of, but not what gusts add. In a band of motion, without what is slow,

    a = s I - s tau I' + gusts,

where both are those of the air at the IMU.

An aeroplane answers gusts, so that I goes together with them: least squares of this would find a scale that is too
small. What moves the surfaces is no gust, so that s and tau are those for which the rest does not go together with the
surfaces and what follows them (two-stage least squares; Soderstrom, Errors-in-variables methods, Automatica 43, 2007).
Before a flight says so, they are not known better than vanes are built in: SCALE and LAG.

The regression of y on terms x with a in place of the angle makes of true parameters theta

    theta - dC/d(angle) (sum x x')^-1 sum x (delta a),    delta a = (s - 1) a - tau a',

without a residual that shows it: late sideslip looks like a term in the yaw rate. dC/d(alpha) may itself depend on
alpha, as that of C_X does: it is a straight line, and delta a stands beside alpha delta a. What is published is freed
of that, and its standard errors are widened by what is left.

*Lateness of the motion.* A regression on surfaces as they are recorded makes of those as they were, delta_tau
(``late_motion``), what goes together with its terms, and that is not small: roll may die out in as long as servos need.
With x_tau the terms with delta_tau, the same sums give true parameters back, x the instruments:

    theta = (sum x x_tau')^-1 (sum x x') theta of the regression.

A delay and the lag of a servo count as they are probable; that they differ is in the covariance.

*Places.* An IMU at a distance e from where it is taken to be feels w' x e besides, w' the angular acceleration, which
goes into the three forces as delta a does above. Vanes see delta a = (w x e)/V across the flow.
``aircraft.unsaid_places`` says how far that may be.

A sensor that ``sensors`` of the aircraft file describes is as it says, and so are positions. A file that says how
noisy a sensor is and nothing else, as one that a flight completed does, does not describe it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import described
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.aircraft.unsaid_places import doubt_of_imu, doubt_of_vanes, roll_that_shows
from aircraft_sysid_ros.identification.coefficients.flow_angles import angle_at
from aircraft_sysid_ros.identification.coefficients.layout import (
    FLYING,
    LEARNT,
    PREDICTED,
    SIGNAL,
    SIGNALS_OF_SAMPLE,
    TERMS_OF_SAMPLE,
    TIME,
    Body,
    CoefficientBatch,
)
from aircraft_sysid_ros.identification.coefficients.signals import flow_angle_rates
from aircraft_sysid_ros.identification.late_motion import Late, LateMotion, Places
from aircraft_sysid_ros.identification.moved_surfaces import (
    COUNT,
    FORMS,
    MovedSurfaces,
    derivatives_of,
    look_ahead,
)
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.reconstruction.state import StateField

Array = npt.NDArray[np.float64]

ANGLES = ("alpha", "beta")
_SENSORS, _GROUP = ("angle_of_attack", "sideslip"), "air_data"
#: Who describes one of these says how late the motion is recorded after the surfaces.
_OF_MOTION = {"imu", "accelerometer", "gyro", "control_surfaces"}
#: One sigma of scale and lag [s] of a vane that nobody has described: upwash and position error, tubes and logging.
SCALE, LAG = 0.06, 0.04
#: One sigma over the span of how far out on the wing a vane may be that nobody has placed, until the roll has shown it
#: (``flight_check.laws.vane_place``): so many seconds from the first sample in flight on, and after so many times the
#: roll that shows it. ``InFlightCheck`` has looked by then, and what it finds holds all that uses the vane.
UNSEEN, LOOKED, ROLLED, _SIDEWAYS = 0.4, 30.0, 4.0, ("air_data_position", "y")
#: Slower than this [s] is not asked; time constants [s] of what follows the surfaces; time [s] that gusts last in the
#: band; memory [s]; time [s] between what is summed; a pause [s] that starts over.
_BAND, _FOLLOW, _GUST, _MEMORY, _STEP, _PAUSE = 3.0, (0.3, 1.0), 0.4, 120.0, 0.04, 0.3
#: Least time [s] that is summed.
_LEAST = 5.0
#: What may be wrong: each angle and its derivative, the force coefficients that a turning of 1 m beside makes, what 1 m
#: ahead and to the right make of alpha, 1 m ahead and below of beta, what is wrong of alpha, its derivative, and 1 m
#: ahead and to the right, times alpha; and the forms of each surface.
_TURNING, _OF_VANES, _BY_ALPHA, _FORMS = 4, 7, 11, 15
#: Coordinates of those, by angle.
_ACROSS = ([0, 1], [0, 2])
#: One sigma [s] of when a command moves between its samples.
_SAMPLED = 0.005
#: From so many standard errors and seconds on a flight contradicts what the aircraft file says of late surfaces.
_CONTRADICTED, _WORTH_A_WORD = 3.0, 0.015
#: What was learnt in another flight is not to be used for so long [s], until this one has shown its sensors; least
#: sigma of a constant and of a derivative meanwhile, or its size.
_NEW, _CONSTANT, _DERIVATIVE = 15.0, 0.02, 0.3
#: What those of before an axis was learnt anew count; nothing would leave the first seconds without any.
_ANEW = 0.02
#: So much of a derivative is taken away at most.
_MOST = 0.75
_OF_STATE = (StateField.ANGLE_OF_ATTACK, StateField.SIDESLIP)
_P, _V, _QBAR = SIGNAL_INDEX["p"], SIGNAL_INDEX["V"], SIGNAL_INDEX["qbar"]
_FIRST_CONTROL, _COUNT_OF_CONTROLS = SIGNAL_INDEX["de"], 3
#: Angle, I, I', and each control with what follows it.
_SERIES = 3 + _COUNT_OF_CONTROLS * (1 + len(_FOLLOW))
#: Surfaces that move each angle, as columns of the series.
_INSTRUMENTS = (np.array([3, 4, 5]), np.array([6, 7, 8, 9, 10, 11]))
#: What is left of a sum after another.
_KEEP = float(np.exp(-_STEP / _MEMORY))
#: A correlation matrix that may be singular gets this.
_NEARLY = 1e-6


class OfSensors(NamedTuple):
    """What vanes do to the parameters of an axis."""

    shift: Array  # (n,) that frees them of what was found
    covariance: Array  # (n, n) of what is left
    found: Array  # (n, n) mean square of what was found


class SensorDoubt(NamedTuple):
    """What is known of the sensors, and of what they do."""

    mean: Array  # (2, 2) of each angle (scale - 1, lag [s])
    covariance: Array  # (2, 2, 2)
    place: Array  # (3,) [m] one sigma of the place of the IMU
    vane_place: Array  # (3,) [m] the same of the vanes
    late: tuple[Late, ...]  # motion after the surfaces
    is_new: bool  # what is known was learnt in another flight, and this one has not shown its sensors yet
    regressions: Array  # (6, k, n): of each axis, of what may be wrong on its terms

    def of(self, model: AerodynamicModel, axis: int, theta: Array, slopes: Sequence[float], bend: float) -> OfSensors:
        """For an axis with the parameters ``theta``; ``slopes`` dC/d(alpha) at alpha = 0 and dC/d(beta), and by how
        much the first grows with alpha, ``bend``.
        """
        n = len(model.terms[AXES[axis]])
        shift, left, found = np.zeros(n), np.zeros((n, n)), np.zeros((n, n))
        all_rows = self.regressions[axis, :, :n]
        if self.is_new:
            least = np.array([_CONSTANT if text == "1" else _DERIVATIVE for text in model.terms[AXES[axis]]])
            return OfSensors(shift, np.diag(np.maximum(np.abs(np.nan_to_num(theta)), least) ** 2), found)
        if not np.isfinite(all_rows).all():
            return OfSensors(shift, left, found)
        bends = bend * all_rows[_BY_ALPHA:_FORMS]
        for angle, slope in enumerate(slopes):
            rows = slope * all_rows[2 * angle : 2 * angle + 2] + (bends[:2] if angle == 0 else 0.0)
            rows = rows * np.array([[1.0], [-1.0]])
            moved = self.mean[angle] @ rows
            shift += moved
            left += rows.T @ self.covariance[angle] @ rows
            found += np.outer(moved, moved)
            beside = slope * all_rows[_OF_VANES + 2 * angle : _OF_VANES + 2 * angle + 2]
            beside = beside + (bends[2:] if angle == 0 else 0.0)
            left += (beside.T * self.vane_place[_ACROSS[angle]] ** 2) @ beside
        if axis < 3:  # of e, the two axes across the force, each by the angular acceleration about the other
            about = [k for k in range(3) if k != axis]
            turning = all_rows[_TURNING:_OF_VANES][about]
            left += (turning.T * self.place[about[::-1]] ** 2) @ turning
        if self.late and np.isfinite(theta).all():
            self._late(all_rows[_FORMS:], derivatives_of(model, axis), theta, shift, left, found)
        return OfSensors(shift, left, found)

    def freeing(self, model: AerodynamicModel, axis: int, way: Late) -> Array:
        """What frees the parameters of an axis (n,) of surfaces that are late in one way, (n, n)."""
        n = len(model.terms[AXES[axis]])
        forms = self.regressions[axis, _FORMS:, :n]
        if not np.isfinite(forms).all():
            return np.eye(n)
        return _freeing(forms.reshape(COUNT, FORMS, n), derivatives_of(model, axis), [way])[0][0]

    def _late(
        self, rows: Array, derivatives: npt.NDArray[np.int64], theta: Array, shift: Array, left: Array, found: Array
    ) -> None:  # fmt: skip
        """Add what late motion does to ``theta``; of each surface rows (FORMS,) on the terms."""
        whole, change = _freeing(rows.reshape(COUNT, FORMS, -1), derivatives, self.late)
        probability, variance = np.array([(way.probability, way.variance) for way in self.late]).T
        freed = whole @ theta
        by_late = (whole @ (change @ freed[:, :, None]))[:, :, 0]
        mean = probability @ freed
        square = (freed.T * probability) @ freed + (by_late.T * (probability * variance)) @ by_late
        shift += mean - theta
        found += np.outer(mean - theta, mean - theta)
        left += square - np.outer(mean, mean)


def _freeing(forms: Array, derivatives: npt.NDArray[np.int64], ways: Sequence[Late]) -> tuple[Array, Array]:
    """What frees parameters of each way of being late, and what being late by a second more makes of those (w, n, n);
    what is more than _MOST of a combination of them is not believed.
    """
    n = forms.shape[-1]
    turn, change = np.zeros((len(ways), n, n)), np.zeros((len(ways), n, n))
    near, shares, slopes = (np.array(each) for each in zip(*(way.near for way in ways), strict=True))
    for form, column in zip(forms, derivatives, strict=True):
        if column >= 0:
            turn[:, :, column] = form[0] - (shares[:, None] @ form[near])[:, 0]
            change[:, :, column] = -(slopes[:, None] @ form[near])[:, 0]
    largest = np.max(np.abs(np.linalg.eigvals(turn)), axis=1, initial=0.0)
    believed = np.minimum(1.0, _MOST / np.maximum(largest, 1e-9))
    return np.asarray(np.linalg.inv(np.eye(n) - turn * believed[:, None, None])), change


class UndescribedSensors:
    """Follows the motion, and says what vanes that nobody described leave in doubt."""

    def __init__(self, aircraft: Aircraft) -> None:
        self._aircraft = aircraft
        said = described(aircraft.source.get("sensors"))
        self._asked = np.array([not {sensor, _GROUP} & said for sensor in _SENSORS])
        self._place = doubt_of_imu(aircraft)
        self._vane_place = doubt_of_vanes(aircraft)
        self._motion = LateMotion(aircraft.sensors["control_surfaces"].late_std)
        self._frees = not _OF_MOTION & said  # else what is said is believed, and watched
        self._surfaces = MovedSurfaces()
        self._any = bool(self._asked.any() or aircraft.unsaid or self._frees)
        self._model: AerodynamicModel | None = None
        self._squares, self._products = np.zeros((len(AXES), 0, 0)), np.zeros((len(AXES), 0, 0))
        self._out_on_wing = aircraft.span * UNSEEN if np.isnan(aircraft.unsaid.get(_SIDEWAYS, 0.0)) else 0.0
        self.adopt(aircraft.model)
        self._moments, self._counts = np.zeros((len(ANGLES), _SERIES, _SERIES)), np.zeros(len(ANGLES))
        self._flown, self._began, self._newest = 0.0, np.nan, np.nan
        self._rolled, self._enough = 0.0, ROLLED * roll_that_shows(aircraft.span)  # [rad^2/s]
        self._interval = 0.0  # [s] of states
        self._waits = 0.0  # [s] until what was learnt in another flight may be used
        self.restart_clock()

    def adopt(self, model: AerodynamicModel) -> None:
        """Another model: what its terms do is seen anew, of those that the one before did not have."""
        n, axes, before = int(np.diff(model.offsets).max()), range(len(AXES)), self._model
        squares, products = np.zeros((len(AXES), n, n)), np.zeros((len(AXES), self._doubtful, n))
        stays = None if before is None else [_that_stay(before.terms[axis], model.terms[axis]) for axis in AXES]
        for axis, (old, new) in enumerate(stays or ()):
            squares[axis][np.ix_(new, new)] = self._squares[axis][np.ix_(old, old)]
            products[axis][:, new] = self._products[axis][:, old]
        self._model, self._offsets, self._squares, self._products = model, model.offsets, squares, products
        self._motion.adopt(model.offsets, [derivatives_of(model, axis) for axis in axes], stays)
        self._freeing: list[Array] = []  # by axis, what frees parameters of late surfaces, where they are
        if before is not None:
            self._free()
        self._samples: Array | None = None  # the newest two, and their forms
        self._forms = np.zeros((0, COUNT, FORMS))

    def restart_clock(self) -> None:
        """The clock started over, or another manoeuvre."""
        self._flown += self._by_this_clock
        self._began = self._newest = np.nan  # [s] first and newest sample in flight by this clock
        self._filter = np.full((len(ANGLES), 4, _SERIES), np.nan)
        self._last = np.array([np.nan, -np.inf, np.nan])
        self._samples, self._forms = None, np.zeros((0, COUNT, FORMS))
        self._new_forms = np.zeros((0, COUNT, FORMS))  # of the newest batch
        self._surfaces.restart_clock()
        self._motion.restart_clock()

    def warm_up(self) -> None:
        """Compile, or load from the cache, what is needed late."""
        self._motion.warm_up()

    @property
    def _doubtful(self) -> int:
        """How many things may be wrong."""
        return _FORMS + COUNT * FORMS * self._frees

    @property
    def _by_this_clock(self) -> float:
        """Time [s] of flight since the clock began."""
        return self._newest - self._began if self._newest > self._began else 0.0

    def add(self, batch: CoefficientBatch) -> None:
        """States and samples that came together."""
        if self._any:
            _follow(batch.rows, batch.history, batch.body, self._filter, self._last, self._counts, self._moments)
        if len(batch.samples):
            before, self._newest = self._newest, float(batch.samples[-1, 0])
            if self._out_on_wing > 0.0:
                self._roll(batch.samples, before)
            self._waits -= min(max(self._newest - before, 0.0), 1.0) if before < self._newest else 0.0
            self._began = float(batch.samples[0, 0]) if np.isnan(self._began) else self._began
            samples = batch.samples if self._samples is None else np.vstack([self._samples, batch.samples])
            self._new_forms = self._surfaces.follow(batch.samples)
            forms = np.concatenate([self._forms, self._new_forms])
            look_ahead(samples, forms)
            self._motion.add(samples, forms)
            if self._any:
                counted = forms if self._frees else forms[:, :, :0]
                _regress(samples, counted, self._offsets, batch.body, self._squares, self._products)
            self._samples, self._forms = samples[-2:].copy(), forms[-2:].copy()

    def _roll(self, samples: Array, before: float) -> None:
        """Add up the square of the roll rate, of samples (n, …) after one ``before`` [s]."""
        steps = np.clip(np.diff(samples[:, TIME], prepend=before), 0.0, _PAUSE)
        rates = samples[:, SIGNALS_OF_SAMPLE + _P] * 2.0 * samples[:, SIGNALS_OF_SAMPLE + _V] / self._aircraft.span
        squares = np.nan_to_num(rates**2 * steps)
        self._rolled = float(np.cumsum(np.append(self._rolled, squares))[-1])  # one after the other: as in replay

    @property
    def are_late(self) -> bool:
        """Whether surfaces come later than they are recorded, so that what a regression predicts from them is wrong."""
        return bool(self._freeing)

    @property
    def lateness(self) -> float:
        """One sigma [s] of what is not known, or not yet counted with, of how late surfaces are; 0: it is described."""
        if not self._frees:
            return 0.0
        mean, variance = self._motion.whole
        return float(np.sqrt(variance + (0.0 if self.are_late else mean**2) + _SAMPLED**2))

    def predict(self, samples: Array, model: AerodynamicModel, theta: Array) -> None:
        """Predict the newest samples (n, …) anew, with surfaces where they are and what regressions (6, m) know, freed
        of late surfaces: as the flight has shown them before.
        """
        if not self._frees:
            return
        near = self._motion.best.near
        moved = self._new_forms[:, :, near.forms] @ near.shares - self._new_forms[:, :, 0]
        for axis, whole in enumerate(self._freeing):
            part = model.axis_slice(AXES[axis])
            freed = whole @ theta[axis, : part.stop - part.start]
            predicted = samples[:, TERMS_OF_SAMPLE + part.start : TERMS_OF_SAMPLE + part.stop] @ freed
            for of_surface, column in zip(moved.T, derivatives_of(model, axis), strict=True):
                if column >= 0:
                    predicted += freed[column] * of_surface
            known = np.isfinite(samples[:, PREDICTED + axis])
            samples[known, PREDICTED + axis] = predicted[known]

    def learn_anew(self, axis: int) -> None:
        """An axis is learnt anew, from samples that are still to come more than from those that came."""
        self._squares[axis] *= _ANEW
        self._products[axis] *= _ANEW

    def look(self, time: float, interval: float) -> None:
        """Estimate anew how late the motion is, where it is time [s]; ``interval`` [s] of states, 0: dense."""
        self._interval = interval
        if not self._frees or not self._motion.is_due(time):
            return
        self._motion.look(interval)
        self._free()

    @property
    def sums(self) -> dict[str, Array]:
        """What was summed: with it goes on who knows what these have learnt."""
        return {
            "squares": self._squares, "products": self._products, "moments": self._moments, "counts": self._counts,
            "late_moments": self._motion.moments, "late_counts": self._motion.counts,
        }  # fmt: skip

    def go_on(self, sums: Mapping[str, Array]) -> None:
        """What is known was learnt in another flight, with its ``sums`` or none; whether sensors are as they were there
        shows after a while.
        """
        for name, mine in self.sums.items():
            if name in sums:
                mine[:] = sums[name]
        self._motion.look(self._interval)
        self._free()
        self._waits = _NEW

    def _free(self) -> None:
        """Work out anew what frees parameters of late surfaces."""
        doubt, model = self.doubt() if self._frees and self._motion.is_found else None, self._model
        if doubt is None or model is None:
            self._freeing = []
        else:
            self._freeing = [doubt.freeing(model, axis, self._motion.best) for axis in range(len(AXES))]

    @property
    def late_motion(self) -> Late | None:
        """By how much motion is recorded late, in the more probable way; None: described."""
        return self._motion.best if self._frees else None

    @property
    def contradicted(self) -> tuple[float, float] | None:
        """By how much [s] surfaces are later than the aircraft file says, and one sigma, where it says so and the
        flight shows another; None: it says nothing, or what the flight shows.
        """
        if self._frees:
            return None
        self._motion.look(self._interval)
        mean, variance = self._motion.whole
        std = float(np.sqrt(variance + _SAMPLED**2))
        return (mean, std) if abs(mean) > max(_CONTRADICTED * std, _WORTH_A_WORD) else None

    @property
    def late_surfaces(self) -> dict[str, tuple[float, float]]:
        """What the aircraft file would have to say of control_surfaces that nothing is late, delay or lag [s] or both,
        each with one sigma; nothing where the flight shows neither, or where the file says it.
        """
        if not self._frees or not self._motion.is_found:
            return {}
        best, surfaces = self._motion.best, self._aircraft.sensors["control_surfaces"]
        std = float(np.sqrt(self._motion.whole[1]))
        late = {key: value + getattr(surfaces, key) for key, value in best.course.in_file(best.time).items()}
        return {key: (value, max(std, 0.001)) for key, value in late.items()}

    def errors(self) -> tuple[Array, Array]:
        """Mean (2, 2) of (scale - 1, lag [s]) of each angle, and covariance (2, 2, 2); none of what is described."""
        mean, covariance = np.zeros((2, 2)), np.zeros((2, 2, 2))
        for angle in np.flatnonzero(self._asked):
            mean[angle], covariance[angle] = _estimate(
                self._moments[angle], float(self._counts[angle]), _INSTRUMENTS[angle]
            )
        return mean, covariance

    def doubt(self) -> SensorDoubt | None:
        """What is in doubt now; None: nothing."""
        if not self._any:
            return None
        mean, covariance = self.errors()
        scale = np.sqrt(np.einsum("aii->ai", self._squares))
        scale[scale <= 0.0] = 1.0
        found = np.full(self._products.shape, np.nan)
        for axis in range(len(AXES)):
            n = int(self._offsets[axis + 1] - self._offsets[axis])
            if self._squares[axis].any():
                by = scale[axis, :n]
                correlation = self._squares[axis, :n, :n] / np.outer(by, by) + _NEARLY * np.eye(n)
                right = (self._products[axis, :, :n] / by).T
                found[axis, :, :n] = np.linalg.solve(correlation, right).T / by
        late = self._motion.ways if self._frees else ()
        vane_place = self._vane_place.copy()
        if self._flown + self._by_this_clock <= LOOKED or self._rolled < self._enough:
            vane_place[1] = max(vane_place[1], self._out_on_wing)
        return SensorDoubt(mean, covariance, self._place, vane_place, late, self._waits > 0.0, found)


def _that_stay(before: Sequence[str], after: Sequence[str]) -> Places:
    """Places of the terms of an axis that two models have, in the one and in the other."""
    old = [place for place, text in enumerate(before) if text in after]
    return np.array(old, np.int64), np.array([after.index(before[place]) for place in old], np.int64)


def _estimate(moments: Array, count: float, instruments: npt.NDArray[np.int64]) -> tuple[Array, Array]:
    """Mean (2,) and covariance (2, 2) of (scale - 1, lag) from sums of products of the series."""
    prior = np.diag([1.0 / SCALE**2, 1.0 / LAG**2])
    unknown = np.zeros(2), np.linalg.inv(prior)
    moving = instruments[np.diag(moments)[instruments] > 0.0]
    if count * _STEP < _LEAST or not np.all(np.diag(moments)[:3] > 0.0) or len(moving) < 3:
        return unknown
    scale, instruments = np.sqrt(np.diag(moments)), moving
    z = moments[np.ix_(instruments, instruments)] / np.outer(scale[instruments], scale[instruments])
    sign = np.array([1.0, -1.0])
    of_x = moments[np.ix_(instruments, np.array([1, 2]))] * sign / scale[instruments][:, None]
    of_a = moments[instruments, 0] / scale[instruments]
    weights = np.linalg.inv(z + _NEARLY * np.eye(len(z)))
    information = of_x.T @ weights @ of_x
    theta = np.linalg.solve(information + _NEARLY * np.diag(np.diag(information)), of_x.T @ weights @ of_a)
    x, with_a = moments[1:3, 1:3] * np.outer(sign, sign), moments[1:3, 0] * sign
    left = moments[0, 0] - 2.0 * theta @ with_a + theta @ x @ theta
    variance = max(left, 0.0) / count * (2.0 * _GUST / _STEP)
    of_data = information / max(variance, 1e-12)
    covariance = np.linalg.inv(of_data + prior)
    return covariance @ of_data @ (theta - np.array([1.0, 0.0])), covariance


@njit(cache=True)
def _high_pass(series: Array, controls: Array, step: float, begins: bool, filters: Array) -> None:
    """Fill I and what follows the controls into a series (_SERIES,), and take away what is slow, twice."""
    before, once, twice, follows = filters
    keep = 1.0 if begins else _BAND / (_BAND + step)
    series[1] = 0.0 if begins else before[1] + 0.5 * step * (series[2] + before[2])
    for j in range(_COUNT_OF_CONTROLS):
        first = 3 + j * (1 + len(_FOLLOW))
        series[first] = controls[j]
        for k in range(len(_FOLLOW)):
            at, share = first + 1 + k, 1.0 if begins else step / (step + _FOLLOW[k])
            follows[at] = controls[j] if begins else follows[at] + share * (controls[j] - follows[at])
            series[at] = follows[at]
    for j in range(_SERIES):
        now = 0.0 if begins else keep * (once[j] + series[j] - before[j])
        twice[j] = 0.0 if begins else keep * (twice[j] + now - once[j])
        once[j], before[j] = now, series[j]


@njit(cache=True)
def _follow(
    rows: Array, history: Array, body: Body, filters: Array, last: Array, counts: Array, moments: Array
) -> None:
    """Sums of products of the series of both angles, (2, _SERIES, _SERIES), and how many are in them, from states.

    ``filters`` (2, 4, _SERIES): newest series, after one high-pass, after two, and what follows the controls; ``last``:
    newest time [s], time of the newest sum and of the begin.
    """
    series = np.empty(_SERIES)
    for i in range(len(rows)):
        time, row = history[i, TIME], history[i]
        step = time - last[0]
        good = row[FLYING] > 0.0
        for j in range(_FIRST_CONTROL, _FIRST_CONTROL + _COUNT_OF_CONTROLS):
            good = good and np.isfinite(row[SIGNAL + j])
        if not good:
            last[0] = np.nan
            continue
        rates = flow_angle_rates(rows[i], body.gravity)
        begins = not (0.0 < step < _PAUSE)
        if begins:
            last[2] = time
        for angle in range(2):
            at_imu = angle_at(rows[i], body.imu, angle == 1) - rows[i, _OF_STATE[angle]]
            series[0], series[2] = row[SIGNAL + angle] + at_imu, rates[angle]
            _high_pass(series, row[SIGNAL + _FIRST_CONTROL :], step, begins, filters[angle])
        last[0] = time
        if time - last[2] < 2.0 * _BAND or time - last[1] < _STEP - 1e-6:
            continue
        last[1] = time
        for angle in range(2):
            twice = filters[angle, 2]
            if np.isfinite(twice[0]) and np.isfinite(twice[1]):
                counts[angle] = _KEEP * counts[angle] + 1.0
                for j in range(_SERIES):
                    for k in range(_SERIES):
                        moments[angle, j, k] = _KEEP * moments[angle, j, k] + twice[j] * twice[k]
            else:
                last[0] = np.nan


@njit(cache=True)
def _regress(
    samples: Array, forms: Array, offsets: npt.NDArray[np.int64], body: Body, squares: Array, products: Array
) -> None:  # fmt: skip
    """Sums x x' and x (a, a', …) of what each axis learnt from; of the first and the last sample no derivative."""
    wrong, area, span, chord = np.zeros(products.shape[1]), body.geometry[0], body.geometry[1], body.geometry[2]
    for i in range(1, len(samples) - 1):
        step = samples[i + 1, 0] - samples[i - 1, 0]
        if not 0.0 < step < _PAUSE:
            continue
        before, now = samples[i - 1, SIGNALS_OF_SAMPLE:], samples[i, SIGNALS_OF_SAMPLE:]
        after = samples[i + 1, SIGNALS_OF_SAMPLE:]
        for angle in range(2):
            slope = (after[angle] - before[angle]) / step
            good = np.isfinite(slope + now[angle])
            wrong[2 * angle], wrong[2 * angle + 1] = (now[angle], slope) if good else (0.0, 0.0)
        wrong[_FORMS:] = forms[i].ravel()
        for k in range(3):
            length = chord if k == 1 else 0.5 * span
            turning = (after[_P + k] - before[_P + k]) / step * now[_V] / length
            force = body.mass * turning / (now[_QBAR] * area)
            wrong[_TURNING + k] = force if np.isfinite(force) else 0.0
        p, q, r = now[_P] * 2.0 / span, now[_P + 1] / chord, now[_P + 2] * 2.0 / span  # over V
        wrong[_OF_VANES], wrong[_OF_VANES + 1], wrong[_OF_VANES + 2], wrong[_OF_VANES + 3] = -q, p, r, -p
        for k, of_alpha in enumerate((wrong[0], wrong[1], -q, p)):
            wrong[_BY_ALPHA + k] = now[0] * of_alpha if np.isfinite(now[0]) else 0.0
        for axis in range(len(squares)):
            if samples[i, LEARNT + axis] <= 0.0:
                continue
            first = offsets[axis]
            n = offsets[axis + 1] - first
            x = samples[i, TERMS_OF_SAMPLE + first : TERMS_OF_SAMPLE + first + n]
            for j in range(n):
                for k in range(len(wrong)):
                    products[axis, k, j] = _KEEP * products[axis, k, j] + x[j] * wrong[k]
                for k in range(n):
                    squares[axis, j, k] = _KEEP * squares[axis, j, k] + x[j] * x[k]
