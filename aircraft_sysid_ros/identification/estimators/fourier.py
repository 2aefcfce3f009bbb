"""Equation error in the frequency domain: aerodynamic parameters from recursive Fourier transforms.

Per axis, with the signals of ``fill_history`` and F the transform of ``estimation.recursive_fourier``:

    F{s} + F{dg/dt} = area length sum_j theta_j F{qbar term_j}

    forces:   s = m A_imu - m omega x (omega x r),           g = - m omega x r
    moments:  s = omega x I omega - reference x s_force,     g = I omega - reference x g_force

with r from the centre of gravity to the IMU and A_imu the specific force there: (6.8)-(6.15), (6.19). No signal is
divided by a qbar that varies, and none is differentiated: dg/dt is transformed by integration by parts. Only
frequencies of the band are compared. Noise at others, slow drift and vibration, does not count.

The constant term of an axis is no oscillation. It is determined by the zero frequency, the mean over the memory,
which axes with a constant use as one more, real, equation; the band determines all else. Its standard error takes
the spectrum of the residuals to go on flat from the lowest frequency to zero, and has the variance of the
accelerometer bias added.
"""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT
from aircraft_sysid_ros.estimation.recursive_fourier import (
    SpectralFit,
    Window,
    derivative_transform,
    spectral_covariance,
    spectral_least_squares,
)
from aircraft_sysid_ros.identification.coefficients.body import body_of, force_noise
from aircraft_sysid_ros.identification.coefficients.flow_angles import WINDOW_WIDTH
from aircraft_sysid_ros.identification.coefficients.layout import TERM, TIME, CoefficientBatch
from aircraft_sysid_ros.identification.coefficients.pace import BRIDGED_GAP, Pace
from aircraft_sysid_ros.identification.estimators.contract import AxisEstimate, AxisReset, KnownParameters
from aircraft_sysid_ros.identification.estimators.fourier_prior import (
    Before,
    Prior,
    covariance_with_prior,
    fit_with_prior,
    forget_old,
    information_scale,
    newest_before,
    prior_of,
)
from aircraft_sysid_ros.identification.estimators.fourier_transforms import (
    MOMENTUM,
    STATIC,
    TERMS,
    Bank,
    Setting,
    clear_axis,
    close_axis,
    follow,
    new_bank,
    transform_again,
    transform_rows,
    weigh,
)
from aircraft_sysid_ros.identification.estimators.reset_prior import FORGOTTEN, MEMORY, within_prior
from aircraft_sysid_ros.identification.estimators.vane_noise import compensation
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.samples import Samples

Array = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

#: Distance [Hz] between frequencies: about the resolution of a minute.
_SPACING = 0.02
_MOST_FREQUENCIES = 200
#: Time [s] between solutions with which the model is predicted.
_REFRESH = 1.0
#: Fits from this long [s] before a change are not touched by it, nor rows from this long after it.
_MARGIN = 0.1
_SURFACES = ("de", "da", "dr", "flaps")
#: Signals whose noise is white at the rate of a sensor; that of others is slow and lies in the band as a whole.
_WHITE = {"p": "gyro", "q": "gyro", "r": "gyro"} | dict.fromkeys(_SURFACES, "control_surfaces")


class FourierEstimator:
    """Estimator of all axes, see the module and ``Estimator``."""

    joint = True

    def __init__(self, aircraft: Aircraft, options: ParameterOptions) -> None:
        self._model, self._options = aircraft.model, options
        self._code, self._body = self._model.linked, body_of(aircraft)
        self._aircraft = aircraft
        self.keep_pace(Pace())
        self.reset()

    def change_options(self, options: ParameterOptions) -> None:
        """See ``Estimator``; band and memory are those of the transforms."""
        self._options = options
        self.keep_pace(self._pace)

    def keep_pace(self, pace: Pace) -> None:
        """See ``Estimator``."""
        self._pace, seen = pace, pace.seen_by(self._aircraft)
        setting = setting_of(seen, self._options)
        self._setting = setting._replace(largest_gap=pace.largest_gap(setting.largest_gap))
        self._kept = kept_by_interpolation(seen, setting.frequencies)

    def reset(self) -> None:
        """Forget all that was learnt."""
        self._fits: tuple[deque[Before], ...] = tuple(deque() for _ in AXES)
        self._rows: deque[Array] = deque()
        self._priors: list[Prior | None] = [None] * len(AXES)
        self._bank = new_bank(self._model.offsets, len(self._setting.frequencies))

    def restart_clock(self) -> None:
        """The clock started over: what was learnt stays, the stretches end."""
        self._close()
        self._rows.clear()
        for fits in self._fits:
            fits.clear()
        self._bank.clock[:2] = -np.inf
        self._bank.last_motion[:] = -np.inf

    def move_times(self, by: float) -> None:
        """The clock that has started over shows ``by`` [s] more: what was learnt is as old as it was."""
        self._bank.last_learnt[:] += by

    def warm_up(self) -> None:
        """Compile what a flight that does not move leaves out."""
        bank = new_bank(self._model.offsets, len(self._setting.frequencies))
        row = np.zeros(TERM + int(self._model.offsets[-1]))
        for _ in range(2):
            follow(0, np.zeros(TERMS + int(self._model.offsets[1])), row, 0.01, bank, self._setting)
        weigh(0, 1.0, 0.0, bank, self._setting)
        transform_again(0, row[None], self._body, bank, self._setting)
        compensation(np.eye(1), 1.0, np.eye(1))

    def push_samples(self, samples: Samples, epoch: int) -> None:
        """Raw samples are not needed: states and controls come with the history."""

    def step(self, batch: CoefficientBatch) -> KnownParameters:
        """Take history rows; returns the solutions at every second that they pass, as ``Estimator`` says."""
        if batch.body is not self._body:
            self._close()  # momentum leaps with the mass
            self._body = batch.body
        slots = np.floor(batch.history[:, TIME] / _REFRESH)
        times, solutions = [], []
        for part in np.split(batch.history, np.flatnonzero(np.diff(slots)) + 1):
            newest = float(self._bank.clock[0])
            if np.isfinite(newest) and np.floor(part[0, TIME] / _REFRESH) != np.floor(newest / _REFRESH):
                times.append(newest)
                solutions.append(self.known())
            transform_rows(part, self._body, *self._code, self._bank, self._setting)
            self._remember(part)
        theta = np.array(solutions).reshape(len(times), int(self._model.offsets[-1]))
        return KnownParameters(np.array(times), theta)

    def reset_axis(self, *resets: AxisReset) -> None:
        """See ``Estimator``."""
        for reset in resets:
            axis = reset.axis
            before = newest_before(self._fits[axis], reset.since - _MARGIN)
            self._priors[axis] = None if before is None else prior_of(before, reset.spread)
            clear_axis(axis, self._bank)
            rows = [row for row in self._rows if row[TIME] >= reset.since + _MARGIN]
            if rows:
                transform_again(axis, np.array(rows), self._body, self._bank, self._setting)
            self._fits[axis].clear()

    def needs_reseed(self, axis: int) -> bool:
        """See ``Estimator``: it learns at once."""
        return False

    def reseed(self, axis: int, known: AxisEstimate) -> None:
        """See ``Estimator``: never asked for."""

    def checkpoint(self) -> tuple[Bank, list[Prior | None]]:
        """See ``Estimator``."""
        copies = {name: array.copy() for name, array in self._bank._asdict().items()}
        return self._bank._replace(**copies), list(self._priors)

    def restore(self, checkpoint: tuple[Bank, list[Prior | None]], *axes: int) -> None:
        """See ``Estimator``."""
        for array, before in zip(self._bank, checkpoint[0], strict=True):
            array[:] = before
        self._priors = list(checkpoint[1])
        self.restart_clock()

    def _remember(self, history: Array) -> None:
        if self._options.relearn:
            self._rows.extend(history.copy())
            while self._rows[0][TIME] < self._rows[-1][TIME] - MEMORY:
                self._rows.popleft()

    def estimate(self, axis: int) -> AxisEstimate:
        """Parameters of one axis now, with standard errors and how much each term was excited in the band.

        Added to the covariance are, as with recursive least squares, the pull of noise in the terms towards zero
        and the accelerometer bias in the constant.
        """
        bank, part = self._bank, self._model.axis_slice(AXES[axis])
        n, samples = part.stop - part.start, int(bank.length[axis] / self._options.step)
        learnt, window = bank.last_learnt[part].copy(), self._window(axis)
        if not self._has_enough(axis):
            return AxisEstimate(np.full(n, np.nan), np.full((n, n), np.nan), samples, learnt, np.zeros(n))
        regressors, fit, prior = *self._fit(axis, window), self._prior(axis)
        theta = np.where(fit.solution.determined, fit.solution.estimate, np.nan)
        unit, of_vanes = self._unit(axis, fit), bank.vane_covariance[axis, :n, :n]
        put_right = compensation(fit.solution.inverse, unit, of_vanes)
        all_noise = bank.noise_square[part]
        noise = np.maximum(all_noise - np.diag(put_right.covariance), 0.0)
        pull = fit.solution.inverse @ (unit * noise * fit.solution.estimate)
        constant = self._model.constants[axis]
        of_bias = bank.bias_variance[axis] * np.outer(constant, constant)
        systematic = np.outer(pull, pull) + of_bias
        if prior is not None:
            covariance = covariance_with_prior(fit, regressors, window, prior) + systematic
            covariance = put_right.widened(within_prior(covariance, prior.information), theta)
            return AxisEstimate(put_right.freed(theta), covariance, samples, learnt)
        covariance = put_right.widened(spectral_covariance(fit, regressors, window) + systematic, theta)
        variance = np.where(fit.solution.determined, np.diag(fit.solution.inverse) * unit, np.inf)
        alone = 1.0 / np.sqrt(variance)  # rms of what no other term explains, in the band
        excitation = alone / np.where(all_noise > 0.0, np.sqrt(all_noise), THRESHOLDS.constant_noise)
        return AxisEstimate(put_right.freed(theta), covariance, samples, learnt, excitation)

    def _has_enough(self, axis: int) -> bool:
        n = int(np.diff(self._model.offsets)[axis])
        least = n + 1.0 if self._priors[axis] is None else 0.0
        return n > 0 and self._bank.length[axis] > 0.0 and self._window(axis).freedom > least

    def _prior(self, axis: int) -> Prior | None:
        """What an axis that has changed knew before, faded as data of that time are."""
        prior = self._priors[axis]
        if prior is None:
            return None
        fade = float(np.exp(-2.0 * self._bank.length[axis] / self._setting.memory))
        if fade < FORGOTTEN:
            return None
        return prior._replace(information=fade * prior.information)

    def _fit(self, axis: int, window: Window) -> tuple[ComplexArray, SpectralFit]:
        """Regressors (m, n) of one axis and its solution."""
        regressors, response = self._equations(axis)
        prior = self._prior(axis)
        if prior is not None:
            return regressors, fit_with_prior(regressors, response, window, prior)
        return regressors, spectral_least_squares(regressors, response, window)

    def known(self) -> Array:
        """All parameters (parameters,), 0 where nothing is known; the fits are remembered as those of now."""
        theta = np.zeros(int(self._model.offsets[-1]))
        for axis, name in enumerate(AXES):
            if self._has_enough(axis):
                window = self._window(axis)
                fit = self._fit(axis, window)[1]
                if self._options.relearn:
                    self._fits[axis].append(Before(float(self._bank.clock[0]), fit, information_scale(window)))
                    forget_old(self._fits[axis], self._fits[axis][-1].time)
                theta[self._model.axis_slice(name)] = fit.solution.estimate
        return theta

    def _window(self, axis: int) -> Window:
        frequencies = self._setting.frequencies
        if not self._model.constants[axis].any():
            frequencies = frequencies[1:]  # means would bring the biases of the sensors in
        return Window(frequencies, self._setting.memory, float(self._bank.length[axis]))

    def _equations(self, axis: int) -> tuple[ComplexArray, ComplexArray]:
        """Regressors (m, n) and response (m,) of one axis, at the frequencies of its window."""
        bank, setting = self._bank, self._setting
        n = int(np.diff(self._model.offsets)[axis])
        transforms = bank.transforms[axis, : TERMS + n]
        newest = float(bank.before[axis, MOMENTUM]) if bank.open[axis] else 0.0
        turning = derivative_transform(
            transforms[MOMENTUM], bank.boundary[axis], newest, setting.frequencies, setting.memory
        )
        regressors = transforms[TERMS:].T.copy()
        for j, program in enumerate(self._model.programs[axis]):
            if program.text in _SURFACES:
                regressors[:, j] /= self._kept
        first = 0 if self._model.constants[axis].any() else 1
        return regressors[first:], (transforms[STATIC] + turning)[first:]

    def _unit(self, axis: int, fit: SpectralFit) -> float:
        """What noise of variance 1 in a term adds to its element of the weighted sum of squares.

        By Parseval a signal of mean square 1 has 2 df sum_k |x_k|^2 = G(0) over the band, here evenly spread.
        """
        band = self._setting.frequencies[self._setting.frequencies > 0.0]
        width = (band[1] - band[0]) * len(band) / np.pi
        energy = self._window(axis).power
        weight = float(fit.weights[-len(band) :].sum())
        return weight * energy * float(self._bank.dynamic_pressure[axis]) / width

    def _close(self) -> None:
        for axis in range(len(AXES)):
            close_axis(axis, self._bank)


def kept_by_interpolation(aircraft: Aircraft, frequencies: Array) -> Array:
    """What the straight lines between samples of a surface keep of its motion at angular frequencies (m,).

    The triangle of linear interpolation at the rate of the IMU, [sin(M x) / (M sin x)]^2 with x = w / (2 rate of the
    IMU) and M how many of its samples there are per sample of the surface: 0.4 % are lost at 2 Hz where 50 Hz meet
    100 Hz. Rates are those of the aircraft file. Terms that are a surface alone are divided by it.
    """
    fast, slow = aircraft.sensors["accelerometer"].rate, aircraft.sensors["control_surfaces"].rate
    ratio, x = fast / slow, 0.5 * frequencies / fast
    if ratio <= 1.0:
        return np.ones(len(frequencies))
    x = np.where(x > 0.0, x, 1e-9)
    return np.asarray(np.maximum((np.sin(ratio * x) / (ratio * np.sin(x))) ** 2, 0.5))


def setting_of(aircraft: Aircraft, options: ParameterOptions) -> Setting:
    """Options as the loop needs them."""
    low, high = options.lowest_frequency, options.highest_frequency
    count = int(np.clip(np.ceil((high - low) / _SPACING), 2, _MOST_FREQUENCIES)) + 1
    in_band, white = np.ones(SIGNAL_COUNT), _WHITE | dict.fromkeys(aircraft.model.inputs, _WHITE["de"])
    for i, name in enumerate(aircraft.model.signal_names):
        if name in white:
            in_band[i] = np.sqrt(min(2.0 * (high - low) / aircraft.sensors[white[name]].rate, 1.0))
    return Setting(
        frequencies=2.0 * np.pi * np.concatenate([[0.0], np.linspace(low, high, count)]),
        memory=2.0 * options.forgetting_time,  # of the amplitude: squares fade twice as fast
        step=options.step,
        largest_gap=max(options.largest_gap, BRIDGED_GAP),
        excitation=options.excitation,
        force_noise=force_noise(aircraft, options.half_width),
        in_band=in_band,
        vane_in_band=np.sqrt(min(2.0 * (high - low) * options.half_width / WINDOW_WIDTH, 1.0)),
    )
