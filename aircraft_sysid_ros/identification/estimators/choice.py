"""Which estimator ``auto`` publishes: least squares, unless the flight itself shows that it is misled.

``rls`` is published from the beginning. It knows an axis first, and where vanes stand in its regressors, or the air is
calm, it is covered best or as well as any in all that was measured (benchmarks/results/gusts.json, certificate.json:
94 to 100 % of its 95 % intervals hold the truth, of ``fourier`` 87 to 97 %, of ``rml`` 92 to 95 %), at a tenth of the
work of ``rml``. In gusts without vanes in the regressors it takes the lateness of the filter for pitch damping, and
``rml``, which predicts the vanes at their own times, does not (benchmarks/results/choice.json). So ``rml`` takes over
where for ``gusts_last`` seconds of flight, more than not, all of these hold:

- the error of the filter's angles is far beyond what calm air leaves, for the noise and the rate of the vanes;
- vanes are heard, and yet none stands in the regressors: they are slow, or the IMU is;
- no sensor is under suspicion, and the errors of the air data are not estimated (``measured_angles``): ``rml`` would
  not know them.

Where there is no vane at all neither knows anything in gusts, and least squares stays. ``fourier`` is never picked: in
calm air it is a little nearer to the truth than ``rls`` and less sure to hold it, in gusts neither.

``rml`` learns unseen until it knows all axes; what least squares knows is published until then. It stays to the end of
the flight: in calm air it is as near to the truth. All of this goes by stamps, at the times of evaluation.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.flow_angles import share_in_window
from aircraft_sysid_ros.identification.coefficients.layout import FLYING, VANE_NOISE, CoefficientBatch
from aircraft_sysid_ros.identification.coefficients.pace import Pace
from aircraft_sysid_ros.identification.estimators.contract import AxisEstimate
from aircraft_sysid_ros.identification.estimators.maximum_likelihood import MaximumLikelihoodEstimator
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.reconstruction.filter_setup import measured_at, stamp_delays
from aircraft_sysid_ros.reconstruction.state import StateField, Status
from aircraft_sysid_ros.samples import Kind, Samples

Array = npt.NDArray[np.float64]

#: So many intervals say how fast vanes come, and so old [s] may the newest sample be.
_INTERVALS, _OLDEST = 5, 2.0
_KINDS = [int(kind) for kind in (
    Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP, Kind.GPS_POSITION, Kind.GPS_VELOCITY,
)]  # fmt: skip
_IS_USED = np.isin(np.arange(len(Kind)), _KINDS)

_LEAST_SQUARES = "nothing calls for another: calm air, or vanes in the regressors, or no vane at all"


class _Waiting(NamedTuple):
    """Samples that came together."""

    times: Array  # (n,) [s]
    samples: Samples
    newest: float  # [s]


class EstimatorChoice:
    """What the flight has shown so far, and ``successor``, which learns unseen until it can take over, and goes on."""

    def __init__(self, aircraft: Aircraft, options: ParameterOptions, pace: Pace) -> None:
        """``pace`` of the states, which goes on."""
        self._options, self._pace = options, pace
        self._of_vane = aircraft.sensors["angle_of_attack"].noise_of_true[0]
        self._delays = stamp_delays(aircraft)
        self.begin_anew(aircraft)

    def begin_anew(self, aircraft: Aircraft) -> None:
        """Nothing is known of the flight."""
        self._aircraft = aircraft
        self.successor: MaximumLikelihoodEstimator | None = None
        self.why, self._refused = _LEAST_SQUARES, False
        self._late = 0.0  # [s]
        self.restart_clock()

    def adopt(self, aircraft: Aircraft) -> None:
        """Another model: a successor starts over."""
        self._aircraft, self._refused, self.successor = aircraft, False, None

    def restart_clock(self) -> None:
        """The clock started over: what the flight has shown stays."""
        self._waiting: deque[_Waiting] = deque()
        self._epoch = 0
        self._vane = np.empty(0), np.empty(0)  # times [s] and values
        if self.successor is not None:
            self.successor.restart_clock()

    def move_times(self, by: float) -> None:
        """The clock that has started over shows ``by`` [s] more: what was learnt is as old as it was."""
        if self.successor is not None:
            self.successor.move_times(by)

    def change_options(self, options: ParameterOptions) -> None:
        """Go on with other options."""
        self._options = options
        if self.successor is not None:
            self.successor.change_options(options)

    def keep_pace(self) -> None:
        """States come at another rate from now on."""
        if self.successor is not None:
            self.successor.keep_pace(self._pace)

    def warm_up(self) -> None:
        """Compile, or load from the cache, what a successor needs."""
        try:
            MaximumLikelihoodEstimator(self._aircraft, self._options).warm_up()
        except InputError:  # its model has no place for a lag
            return

    def push_samples(self, samples: Samples, epoch: int) -> None:
        """Samples as they arrive: a successor is to have all from its beginning on, and no other."""
        samples = samples[_IS_USED[samples.kind]]
        if not len(samples):
            return
        times, self._epoch = measured_at(samples, self._delays, epoch), epoch
        of_vane = samples.kind == Kind.ANGLE_OF_ATTACK
        if of_vane.any():
            self._hear(times[of_vane], samples.values[of_vane, 0])
        if self.successor is not None:
            self.successor.push_samples(samples, epoch)
        else:
            self._waiting.append(_Waiting(times, samples, float(times.max())))

    def _hear(self, times: Array, values: Array) -> None:
        """Samples of the vane; what repeats the one before is none."""
        times, values = np.concatenate([self._vane[0], times]), np.concatenate([self._vane[1], values])
        order = np.argsort(times, kind="stable")
        new = order[np.diff(values[order], prepend=np.nan) != 0.0]
        self._vane = times[new], values[new]

    def step(self, batch: CoefficientBatch) -> None:
        """The successor learns."""
        if self.successor is not None:
            self.successor.step(batch)

    def forget(self) -> None:
        """What is known of the aeroplane has changed: a successor learns anew."""
        if self.successor is not None:
            self.successor.reset()

    def consider(self, batch: CoefficientBatch, elapsed: float, trusted: bool) -> None:
        """Look at the first state of a batch, ``elapsed`` [s] after the one before; ``trusted``: so are all sensors."""
        row, history = batch.rows[0], batch.history[0]
        time = float(row[StateField.TIME])
        interval = self._interval(time)
        if history[FLYING] > 0.0 and self._options.measured_angles:
            unused = not history[VANE_NOISE : VANE_NOISE + 2].any() and row[StateField.STATUS] == Status.OK
            late = trusted and unused and self._is_late(row, interval)
            self._late = min(max(self._late + (elapsed if late else -elapsed), 0.0), THRESHOLDS.gusts_last)
        if self._late >= THRESHOLDS.gusts_last and self.successor is None and not self._refused:
            self._begin(time, interval)
        while self._waiting and (self.successor is not None or self._waiting[0].newest < time):
            self._waiting.popleft()

    def _interval(self, time: float) -> float:
        """Mean time [s] between the newest samples of the vane up to ``time``; NaN where it is not heard."""
        times, values = self._vane
        now = int(np.searchsorted(times, time, side="right"))
        first = max(now - _INTERVALS - 1, 0)
        self._vane = times[first:], values[first:]
        newest = times[first:now]
        if len(newest) <= _INTERVALS or time - newest[-1] > _OLDEST:
            return np.nan
        return float(newest[-1] - newest[0]) / _INTERVALS

    def _is_late(self, row: Array, interval: float) -> bool:
        left = self._of_vane**2 * share_in_window(interval, self._options.half_width)
        return bool((row[StateField.AIR_VELOCITY_STD] / row[StateField.AIRSPEED]) ** 2 > THRESHOLDS.gust_share * left)

    def _begin(self, time: float, interval: float) -> None:
        late = "in gusts the angles of the filter are late, and "
        slow = f"with an IMU at {self._pace.rate:.2g} Hz" if self._pace.is_sparse else f"at {1.0 / interval:.2g} Hz"
        why = f"{late}vanes {slow} cannot replace them"
        try:
            self.successor = MaximumLikelihoodEstimator(self._aircraft, self._options)
        except InputError as error:
            self.why, self._refused = f"{why}; rml cannot be used: {error}", True
            return
        self.why = why
        self.successor.keep_pace(self._pace)
        for times, samples, _ in self._waiting:
            self.successor.push_samples(samples[times > time], self._epoch)

    def is_ready(self) -> bool:
        """Whether a successor knows every axis."""
        if self.successor is None:
            return False
        return all(_is_known(self.successor.estimate(axis)) for axis in range(len(AXES)))


def _is_known(found: AxisEstimate) -> bool:
    return found.samples >= THRESHOLDS.samples and bool(np.isfinite(found.covariance).all())
