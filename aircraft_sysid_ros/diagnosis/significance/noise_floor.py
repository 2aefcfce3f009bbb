"""How well any model could do: the noise of the measured coefficient, and of what the model is evaluated at.

Two parts, added in squares, point by point:

- the response: white noise of accelerometer and gyro through the window of estimation.window_average, which takes
  means of the one and slopes of the other, and through m A / (qbar S) and (6.19);
- the condition: what is not known of airspeed, alpha and beta, times how the residual answers to it, and the noise
  of surfaces and rates. The reconstruction says how well it knows alpha and beta. The wind walks at random with
  variance Q per sample and the vane measures with R; in steady state the error of the filter has P^2 = Q R for small
  P/R and keeps 1 - K = 1 - P/R of itself per sample, (2.20) for one state, and that of the smoother keeps
  (1 - P/R) / (1 + P/R): its spectrum is Q R / (Q + 2 R (1 - cos w)). This says how much a window takes out.
  Airspeed shares the walk, so that its variance is greater by the root of the ratio of the measurement variances.

Where states are sparse (``identification.coefficients.pace``), a point sees its sensors at their times only, and by
straight lines between them. What noise a window lets through then depends on where it lies between the states: the
variance is the mean over PHASES places.

The bias of an accelerometer is known as well as the filter says, which without an attitude is badly, and it walks: what
the terms of the axis do not explain of it is part of the floor too. What else is slow they explain. The noise of the
air data is that of the flight, as far as third differences show it, that of IMU and surfaces what its quietest quarter
shows where the window looks (``flight.white_noise``); ``noise_seen`` asks the residuals.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, FORCES
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.expression import Program
from aircraft_sysid_ros.aircraft.signals import SIGNAL_INDEX
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.search.fit import Fit
from aircraft_sysid_ros.estimation.window_average import window_average
from aircraft_sysid_ros.identification.coefficients.body import body_of
from aircraft_sysid_ros.identification.coefficients.evaluation import imu_response
from aircraft_sysid_ros.identification.options import ParameterOptions

Array = npt.NDArray[np.float64]

HALF_WIDTH = ParameterOptions().half_width
#: Signals that scale with a power of airspeed at a given motion, and that power.
_WITH_AIRSPEED = {
    "V": 1, "qbar": 2, "mach": 1, "Tc": -2, "p": -1, "q": -1, "r": -1, "alpha_dot": -1, "beta_dot": -1,
}  # fmt: skip
_SURFACES = ("de", "da", "dr", "flaps")
#: Fourth differences see noise and not the slow part of a residual.
_STENCIL = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
#: Cosines of which the walk of a bias is made; those that are left out are noise beside it.
COSINES = 8
#: Places of a window between states that are sparse.
PHASES = 8
#: A normal variable is within this many sigma half of the time.
_MEDIAN = 0.6745


@dataclass(frozen=True)
class Source:
    """One cause of error: samples at ``interval`` [s], each of a ``variance`` (n,) in the unit of the coefficient.

    A sample keeps ``correlation`` of the one before; a point is the mean over its window, or the ``slope`` in it.
    """

    variance: Array
    interval: float
    slope: bool = False
    correlation: float = 0.0
    sparse: bool = False  # far apart beside the window

    def of_points(self, stencil: Array, step: float) -> float:
        """Variance, over that of a sample, of a sum of points ``step`` [s] apart with the weights ``stencil``."""
        if self.sparse:
            places = [
                _sparse_weights(self.interval, place, tuple(stencil), step, self.slope) for place in range(PHASES)
            ]
        else:
            spaced = np.zeros((len(stencil) - 1) * max(round(step / self.interval), 1) + 1)
            spaced[:: max(round(step / self.interval), 1)] = stencil
            places = [np.convolve(spaced, window_weights(self.interval)[int(self.slope)])]
        lag = np.arange(len(places[0]))
        kept = np.power(self.correlation, np.abs(lag[:, None] - lag))
        return float(np.mean([weights @ kept @ weights for weights in places]))


@dataclass(frozen=True)
class NoiseFloor:
    """One axis: what is not known, source by source, and the whole as NRMSE."""

    response: tuple[Source, ...]
    condition: tuple[Source, ...]
    bias: Array  # (n, k) what one sigma of each number of the bias of the accelerometer does to the residual
    nrmse: float
    step: float

    @property
    def std(self) -> Array:
        """One sigma of the residual of a perfect model (n,)."""
        return np.asarray(np.hypot(self.noise_std, np.sqrt(np.sum(self.bias**2, axis=1))))

    @property
    def noise_std(self) -> Array:
        """The same without the bias (n,)."""
        return np.asarray(np.sqrt(variance_of((*self.response, *self.condition))))

    def without_bias(self, residual: Array) -> Array:
        """A residual (n,) without the bias that is likeliest by it and by how well the filter knows it."""
        shapes, scaled = self.bias / self.noise_std[:, None], residual / self.noise_std
        known = np.isfinite(scaled) & np.isfinite(shapes).all(axis=1)
        normal = shapes[known].T @ shapes[known] + np.eye(shapes.shape[1])
        return np.asarray(residual - self.bias @ np.linalg.solve(normal, shapes[known].T @ scaled[known]))

    def correlation(self, lags: int, every: int = 1) -> Array:
        """Correlation (lags + 1,) of the noise of the residual, without bias, at multiples of ``every`` points."""
        total = np.zeros(lags + 1)
        for source in (*self.response, *self.condition):
            single, size = source.of_points(np.ones(1), self.step), float(np.nanmean(source.variance))
            for k in range(lags + 1):
                pair = np.zeros(k * every + 1)
                pair[0] += 1.0
                pair[-1] += 1.0
                total[k] += size * (0.5 * source.of_points(pair, self.step) - single if k else single)
        return total / total[0] if total[0] > 0.0 else np.eye(1, lags + 1)[0]


def window_weights(interval: float, half_width: float = HALF_WIDTH) -> tuple[Array, Array]:
    """Weights (m,) of samples ``interval`` [s] apart in the mean and in the slope [1/s] of a window."""
    count = int(np.ceil(half_width / interval)) + 1
    times: Array = interval * np.arange(-count, count + 1, dtype=np.float64)
    means, slopes = np.empty(len(times)), np.empty(len(times))
    window_average(times, np.eye(len(times)), 0, len(times) - 1, 0.0, half_width, means, slopes, False)
    return means, slopes


@cache
def _sparse_weights(interval: float, place: int, stencil: tuple[float, ...], step: float, slope: bool) -> Array:
    """Weights (m,) of sparse samples ``interval`` [s] apart in a sum of points, the first of them at a ``place``."""
    count = int(np.ceil(HALF_WIDTH / interval)) + 1
    times = interval * np.arange(
        -count, count + 2 + int(np.ceil((len(stencil) - 1) * step / interval)), dtype=np.float64
    )
    means, slopes, total = np.empty(len(times)), np.empty(len(times)), np.zeros(len(times))
    for number, factor in enumerate(stencil):
        center = interval * place / PHASES + number * step
        first = int(np.searchsorted(times, center - HALF_WIDTH, side="right")) - 1
        last = int(np.searchsorted(times, center + HALF_WIDTH))
        window_average(times, np.eye(len(times)), first, last, center, HALF_WIDTH, means, slopes, True)
        total += factor * (slopes if slope else means)
    return total


def variance_of(sources: tuple[Source, ...], stencil: Array | None = None, step: float = 1.0) -> Array:
    """Variance (n,) of a point, or of a weighted sum of neighbouring points ``step`` [s] apart."""
    weights = np.ones(1) if stencil is None else stencil
    parts = [source.variance * source.of_points(weights, step) for source in sources]
    return np.asarray(np.sum(parts, axis=0))


def _source(variance: Array, rate: float, sparse: float, correlation: float = 0.0, slope: bool = False) -> Source:
    """The source of a sensor at a rate [Hz], seen at the times of states that are ``sparse`` [s] apart; 0: at all."""
    if sparse > 0.0:
        return Source(variance, sparse, slope, correlation ** (sparse * rate), True)
    return Source(variance, 1.0 / rate, slope, correlation)


def _white_noise(flight: FlightData, name: str) -> float:
    """One sigma per sample of IMU or surfaces: what the recording shows, or what is taken for it."""
    return float(flight.white_noise.get(name, flight.aircraft.sensors[name].noise[0]))


def response_sources(
    aircraft: Aircraft, noise: tuple[float, float], qbar: Array, index: int, sparse: float = 0.0
) -> tuple[Source, ...]:
    """White ``noise`` of accelerometer and gyro, one sigma each, in the measured coefficient number ``index``.

    ``sparse``: time [s] between states where they are sparse, else 0.
    """
    of_force, of_slope = imu_response(body_of(aircraft))[index]
    force, sensors = aircraft.mass * noise[0] / qbar, aircraft.sensors
    return (
        _source(of_force * force**2, sensors["accelerometer"].rate, sparse),
        _source(of_slope * (noise[1] / qbar) ** 2, sensors["gyro"].rate, sparse, slope=True),
    )


def noise_floor(flight: FlightData, axis: str, fit: Fit) -> NoiseFloor:
    """The floor of one axis under the fit of the flight's own model."""
    index = AXES.index(axis)
    noise = (_white_noise(flight, "accelerometer"), _white_noise(flight, "gyro"))
    response = response_sources(flight.aircraft, noise, flight.signal("qbar"), index, flight.sparse_interval)
    condition = tuple(_condition_sources(flight, flight.model.programs[index], index, fit))
    bias = _of_bias(flight, axis, fit)
    used = np.isfinite(fit.residual)
    mean_square = float(np.mean((variance_of((*response, *condition)) + np.sum(bias**2, axis=1))[used]))
    spread = float(np.std(flight.coefficient(axis)[used]))
    nrmse = np.sqrt(mean_square) / spread if spread > 0.0 else np.nan
    return NoiseFloor(response, condition, bias, float(nrmse), flight.step)


def _of_bias(flight: FlightData, axis: str, fit: Fit) -> Array:
    """What one sigma of each number of the accelerometer's bias does to the residual (n, k), beyond what terms explain.

    At one speed the constant explains a bias that stands still. At several that is a force that falls with dynamic
    pressure; and it walks at random: cosines over the flight, as those of Karhunen and Loeve of a random walk.
    """
    if axis not in FORCES or flight.bias_std is None:
        return np.zeros((len(flight.time), 0))
    flown, number = flight.time[-1], np.arange(1, COSINES + 1)
    walk = flight.aircraft.process_noise["accelerometer_bias"] * np.sqrt(2.0 * flown) / (np.pi * number)
    walked = walk * np.cos(np.pi * number * flight.time[:, None] / flown)
    stands = np.full((len(flight.time), 1), flight.bias_std[FORCES.index(axis)])
    force = flight.within(np.hstack([stands, walked]) * flight.per_acceleration[:, None])
    columns, used = flight.columns(flight.model.programs[AXES.index(axis)]), np.isfinite(fit.residual)
    return np.asarray(force - columns @ np.linalg.lstsq(columns[used], force[used], rcond=None)[0])


def _condition_sources(flight: FlightData, programs: tuple[Program, ...], index: int, fit: Fit) -> Iterator[Source]:
    """Errors in the signals that the residual answers to, to first order by central differences."""
    theta = np.nan_to_num(fit.parameters)
    used, names = flight.model.signals_used, flight.model.signal_names

    def residual(factor: float, name: str = "", change: Array | float = 0.0) -> Array:
        signals = flight.signals.copy()
        for scaled, power in _WITH_AIRSPEED.items():
            signals[:, SIGNAL_INDEX[scaled]] *= factor**power
        if name:
            signals[:, names.index(name)] += change
        predicted = flight.with_signals(signals).columns(programs) @ theta
        return flight.within(flight.measured[:, index] / factor**2) - predicted

    vane, airspeed = flight.aircraft.sensors["angle_of_attack"], flight.aircraft.sensors["airspeed"]
    flow, flow_kept, speed, speed_kept = _air_errors(flight)
    moved = 0.5 * (residual(1.0 + speed) - residual(1.0 - speed))
    yield _source(moved**2, airspeed.rate, flight.sparse_interval, speed_kept)
    noisy: dict[str, tuple[Array | float, float, float]] = {
        "alpha": (flow, vane.rate, flow_kept),
        "beta": (flow, vane.rate, flow_kept),
    }
    noisy |= {name: (sigma, rate, 0.0) for name, (sigma, rate) in _white_signals(flight).items()}
    for name, (sigma, rate, kept) in noisy.items():
        if name in used:
            moved = 0.5 * (residual(1.0, name, sigma) - residual(1.0, name, -sigma))
            yield _source(moved**2, rate, flight.sparse_interval, kept)


def _air_errors(flight: FlightData) -> tuple[Array, float, float, float]:
    """One sigma of alpha and beta [rad] (n,) and what they keep, of airspeed over airspeed and what it keeps."""
    sensors, speed = flight.aircraft.sensors, flight.signal("V")
    vane, airspeed = sensors["angle_of_attack"], sensors["airspeed"]
    typical = float(np.nanmedian(speed))
    across = flight.air_velocity_std
    if not np.isfinite(across):
        across = np.sqrt(typical * vane.noise[0] * flight.aircraft.process_noise["wind"]) / vane.rate**0.25
    along = across * np.sqrt(airspeed.noise[0] / (typical * vane.noise[0])) * (vane.rate / airspeed.rate) ** 0.25
    flow_kept = _kept(across / (typical * vane.noise[0]), flight.smoothed)
    return across / speed, flow_kept, along / typical, _kept(along / airspeed.noise[0], flight.smoothed)


def _kept(ratio: float, smoothed: bool) -> float:
    """Correlation from sample to sample of an error that is ``ratio`` of the sensor's noise."""
    gain = min(ratio**2, 1.0)
    return (1.0 - gain) / (1.0 + gain) if smoothed else 1.0 - gain


def _white_signals(flight: FlightData) -> dict[str, tuple[Array | float, float]]:
    """One sigma and rate [Hz] of signals with white noise: surfaces, named inputs and rates."""
    surface, gyro = flight.aircraft.sensors["control_surfaces"], flight.aircraft.sensors["gyro"]
    per_speed = _white_noise(flight, "gyro") / flight.signal("V")
    half_span, chord = 0.5 * flight.aircraft.span, flight.aircraft.chord
    rates = {"p": half_span * per_speed, "q": chord * per_speed, "r": half_span * per_speed}
    surfaces = {name: (_white_noise(flight, "control_surfaces"), surface.rate) for name in _SURFACES}
    surfaces |= {item.name: (item.noise, surface.rate) for item in flight.aircraft.inputs}
    return {**surfaces, **{name: (sigma, gyro.rate) for name, sigma in rates.items()}}


def noise_seen(floor: NoiseFloor, time: Array, residual: Array) -> float:
    """Fast part of a residual (n,) over what the noise of the sensors would give: 1 where that is right.

    Fourth differences of neighbouring points pass the noise and little else. Median, so that a burst does not
    count; NaN without data.
    """
    expected = np.sqrt(variance_of((*floor.response, *floor.condition), _STENCIL, floor.step))
    fast = np.convolve(residual, _STENCIL, mode="valid")
    reach = len(_STENCIL) - 1
    whole = time[reach:] - time[:-reach] < (reach + 0.5) * floor.step
    ratio = np.abs(fast[whole]) / expected[reach // 2 : -(reach // 2)][whole]
    ratio = ratio[np.isfinite(ratio)]
    return float(np.median(ratio) / _MEDIAN) if len(ratio) else np.nan
