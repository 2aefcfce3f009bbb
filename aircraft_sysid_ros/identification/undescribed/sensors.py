"""What no aircraft file says of the sensors, estimated in flight where it shows, and counted in the standard errors.

*Scale and lag of a vane*, s and tau, are estimated in ``vanes``. The regression of y on terms x with the angle a that
such a vane shows, in place of the true one, makes of true parameters theta

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

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import described
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.aircraft.unsaid_places import doubt_of_imu, doubt_of_vanes, roll_that_shows
from aircraft_sysid_ros.identification.coefficients.layout import (
    LEARNT,
    PREDICTED,
    SIGNALS_OF_SAMPLE,
    TERMS_OF_SAMPLE,
    TIME,
    Body,
    CoefficientBatch,
)
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.undescribed.doubt import BY_ALPHA, OF_FORMS, OF_VANES, TURNING, SensorDoubt
from aircraft_sysid_ros.identification.undescribed.late_motion import Late, LateMotion, Places
from aircraft_sysid_ros.identification.undescribed.moved_surfaces import (
    COUNT,
    FORMS,
    PAUSE,
    MovedSurfaces,
    derivatives_of,
    look_ahead,
)
from aircraft_sysid_ros.identification.undescribed.vanes import KEEP, NEARLY, VaneMotion
from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

_SENSORS, _GROUP = ("angle_of_attack", "sideslip"), "air_data"
#: Who describes one of these says how late the motion is recorded after the surfaces.
_OF_MOTION = {"imu", "accelerometer", "gyro", "control_surfaces"}
_SIDEWAYS = ("air_data_position", "y")
_P, _V, _QBAR = SIGNAL_INDEX["p"], SIGNAL_INDEX["V"], SIGNAL_INDEX["qbar"]


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
        is_unplaced = np.isnan(aircraft.unsaid.get(_SIDEWAYS, 0.0))
        self._out_on_wing = aircraft.span * THRESHOLDS.vane_aside if is_unplaced else 0.0
        self.adopt(aircraft.model)
        self._vanes = VaneMotion()
        self._flown, self._began, self._newest = 0.0, np.nan, np.nan
        self._rolled, self._enough = 0.0, THRESHOLDS.vane_aside_rolls * roll_that_shows(aircraft.span)  # [rad^2/s]
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
        self._vanes.restart_clock()
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
        return OF_FORMS + COUNT * FORMS * self._frees

    @property
    def _by_this_clock(self) -> float:
        """Time [s] of flight since the clock began."""
        return self._newest - self._began if self._newest > self._began else 0.0

    def add(self, batch: CoefficientBatch) -> None:
        """States and samples that came together."""
        if self._any:
            self._vanes.add(batch)
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
        steps = np.clip(np.diff(samples[:, TIME], prepend=before), 0.0, PAUSE)
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
        return float(np.sqrt(variance + (0.0 if self.are_late else mean**2) + THRESHOLDS.command_between**2))

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
        self._squares[axis] *= THRESHOLDS.anew
        self._products[axis] *= THRESHOLDS.anew

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
            "squares": self._squares,
            "products": self._products,
            "moments": self._vanes.moments,
            "counts": self._vanes.counts,
            "late_moments": self._motion.moments,
            "late_counts": self._motion.counts,
        }

    def go_on(self, sums: Mapping[str, Array]) -> None:
        """What is known was learnt in another flight, with its ``sums`` or none; whether sensors are as they were there
        shows after a while.
        """
        for name, mine in self.sums.items():
            if name in sums:
                mine[:] = sums[name]
        self._motion.look(self._interval)
        self._free()
        self._waits = THRESHOLDS.other_flight

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
        std = float(np.sqrt(variance + THRESHOLDS.command_between**2))
        return (mean, std) if abs(mean) > max(THRESHOLDS.file_wrong_surely * std, THRESHOLDS.file_wrong_least) else None

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
        for angle in np.flatnonzero(self._asked).tolist():
            mean[angle], covariance[angle] = self._vanes.error(angle)
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
                correlation = self._squares[axis, :n, :n] / np.outer(by, by) + NEARLY * np.eye(n)
                right = (self._products[axis, :, :n] / by).T
                found[axis, :, :n] = np.linalg.solve(correlation, right).T / by
        late = self._motion.ways if self._frees else ()
        vane_place = self._vane_place.copy()
        if self._flown + self._by_this_clock <= THRESHOLDS.vane_aside_time or self._rolled < self._enough:
            vane_place[1] = max(vane_place[1], self._out_on_wing)
        return SensorDoubt(mean, covariance, self._place, vane_place, late, self._waits > 0.0, found)


def _that_stay(before: Sequence[str], after: Sequence[str]) -> Places:
    """Places of the terms of an axis that two models have, in the one and in the other."""
    old = [place for place, text in enumerate(before) if text in after]
    return np.array(old, np.int64), np.array([after.index(before[place]) for place in old], np.int64)


@njit(cache=True)
def _regress(
    samples: Array, forms: Array, offsets: npt.NDArray[np.int64], body: Body, squares: Array, products: Array
) -> None:  # fmt: skip
    """Sums x x' and x (a, a', …) of what each axis learnt from; of the first and the last sample no derivative."""
    wrong, area, span, chord = np.zeros(products.shape[1]), body.geometry[0], body.geometry[1], body.geometry[2]
    for i in range(1, len(samples) - 1):
        step = samples[i + 1, 0] - samples[i - 1, 0]
        if not 0.0 < step < PAUSE:
            continue
        before, now = samples[i - 1, SIGNALS_OF_SAMPLE:], samples[i, SIGNALS_OF_SAMPLE:]
        after = samples[i + 1, SIGNALS_OF_SAMPLE:]
        for angle in range(2):
            slope = (after[angle] - before[angle]) / step
            good = np.isfinite(slope + now[angle])
            wrong[2 * angle], wrong[2 * angle + 1] = (now[angle], slope) if good else (0.0, 0.0)
        wrong[OF_FORMS:] = forms[i].ravel()
        for k in range(3):
            length = chord if k == 1 else 0.5 * span
            turning = (after[_P + k] - before[_P + k]) / step * now[_V] / length
            force = body.mass * turning / (now[_QBAR] * area)
            wrong[TURNING + k] = force if np.isfinite(force) else 0.0
        p, q, r = now[_P] * 2.0 / span, now[_P + 1] / chord, now[_P + 2] * 2.0 / span  # over V
        wrong[OF_VANES], wrong[OF_VANES + 1], wrong[OF_VANES + 2], wrong[OF_VANES + 3] = -q, p, r, -p
        for k, of_alpha in enumerate((wrong[0], wrong[1], -q, p)):
            wrong[BY_ALPHA + k] = now[0] * of_alpha if np.isfinite(now[0]) else 0.0
        for axis in range(len(squares)):
            if samples[i, LEARNT + axis] <= 0.0:
                continue
            first = offsets[axis]
            n = offsets[axis + 1] - first
            x = samples[i, TERMS_OF_SAMPLE + first : TERMS_OF_SAMPLE + first + n]
            for j in range(n):
                for k in range(len(wrong)):
                    products[axis, k, j] = KEEP * products[axis, k, j] + x[j] * wrong[k]
                for k in range(n):
                    squares[axis, j, k] = KEEP * squares[axis, j, k] + x[j] * x[k]
