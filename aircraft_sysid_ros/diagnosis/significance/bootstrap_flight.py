"""Replicas of a flight in which nothing is missing: the same motion, fresh sensor noise, the model as the truth.

What looks like an effect may be the errors of the reconstruction: in turbulence angles of attack, sideslip and
rates are not known exactly, their errors stand on both sides of the regression, and no reshuffling of the data
shows how large that is. A replica does. The reconstructed motion is taken as true, sensors are simulated along it,
and the whole chain runs on them as it ran on the flight. What the coefficients of that motion have beyond the model
is known exactly and is taken off again: what a search still finds in a replica is there by chance.

The reconstructed wind is smoother than the true one; gusts as fast as the reconstruction cannot follow are added.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft import atmosphere
from aircraft_sysid_ros.aircraft.configuration import SURFACES, Aircraft
from aircraft_sysid_ros.aircraft.frames import air_data_from_velocities, rotation_matrices
from aircraft_sysid_ros.aircraft.signals import MOST_INPUTS
from aircraft_sysid_ros.diagnosis.flight.motion_coefficients import coefficients_of_motion
from aircraft_sysid_ros.diagnosis.flight.reconstruction import AIR_DATA, Reconstruction
from aircraft_sysid_ros.diagnosis.flight.sensor_rates import with_recorded_rates
from aircraft_sysid_ros.estimation.window_average import window_averages
from aircraft_sysid_ros.identification.coefficients.as_loaded import as_loaded
from aircraft_sysid_ros.identification.coefficients.body import body_of
from aircraft_sysid_ros.identification.coefficients.ground import altitudes, ground_of
from aircraft_sysid_ros.identification.coefficients.signals import signals_of
from aircraft_sysid_ros.reconstruction.filter_setup import sensor_delays
from aircraft_sysid_ros.reconstruction.servo_lag import servo_lag
from aircraft_sysid_ros.reconstruction.state import StateField, in_moving_air
from aircraft_sysid_ros.samples import Kind, Samples, concatenate, manoeuvre_at, run_of_manoeuvres, samples_of
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions, arrived, generator, measure, stamps_of
from aircraft_sysid_ros.sensors.truth import Truth
from aircraft_sysid_ros.stamps import nanoseconds

Array = npt.NDArray[np.float64]

#: Above this [Hz] reconstructed rates and accelerations are the noise of their sensors, not motion; above this share of
#: the rate of the states they are not known at all (half of it is the Nyquist frequency).
MOTION_BAND, KNOWN_SHARE = 8.0, 0.4
RATE = 100.0  # [Hz] of the world
#: Kinds of samples that come in one message, with the sensor of each; messages come at the rate of the first sensor.
_IN_ONE_MESSAGE = (
    {
        Kind.AIRSPEED: "airspeed", Kind.ANGLE_OF_ATTACK: "angle_of_attack", Kind.SIDESLIP: "sideslip",
        Kind.AIR: "static_pressure",
    },
    {Kind.IMU: "accelerometer", Kind.ATTITUDE: "attitude"},
)  # fmt: skip


@dataclass(frozen=True)
class FlightConditions:
    """The motion of a flight as the truth of another, and what its coefficients have beyond the model."""

    aircraft: Aircraft
    sensing: Aircraft  # with sensors as fast as those of the flight are
    truth: Truth
    excess: Array  # (n, 6) C of the motion minus C of the model, at truth.time
    kinds: tuple[int, ...]  # of samples that the flight has
    #: [s] of the world in which it is flown, from and to; how long after the one before; and of which run.
    spans: tuple[tuple[float, float, float, int], ...]

    def samples(self, seed: int) -> Samples:
        """What the sensors of the flight would have sent, with the noise of one seed."""
        present = set(self.kinds)
        options = SensorOptions(
            accelerometer_bias=0.05,
            gyro_bias=0.003,
            attitude=int(Kind.ATTITUDE) in present,
            magnetometer=int(Kind.MAGNETIC_FIELD) in present,
            height_above_ground=int(Kind.HEIGHT) in present,
        )
        streams, _ = measure(self._with_fast_messages(), self.truth, seed, options)
        samples = arrived(streams, self.sensing.inputs)
        samples = self._at_their_rates(samples[np.isin(samples.kind, self.kinds)])
        return samples if len(self.spans) == 1 else self._in_manoeuvres(samples)

    def _with_fast_messages(self) -> Aircraft:
        """The sensing aircraft with messages of air data as often as the fastest of them comes."""
        names = [name for kind, name in _IN_ONE_MESSAGE[0].items() if int(kind) in self.kinds]
        sensors = dict(self.sensing.sensors)
        rate = max((sensors[name].rate for name in names), default=sensors["airspeed"].rate)
        return replace(self.sensing, sensors={**sensors, "airspeed": replace(sensors["airspeed"], rate=rate)})

    def _at_their_rates(self, samples: Samples) -> Samples:
        """Samples without those that slower sensors do not send with each message."""
        keep, message = np.ones(len(samples), np.bool_), self._with_fast_messages()
        for together in _IN_ONE_MESSAGE:
            fastest = message.sensors[next(iter(together.values()))].rate
            for kind, name in together.items():
                at, share = np.flatnonzero(samples.kind == kind), self.sensing.sensors[name].rate / fastest
                number = np.floor(min(share, 1.0) * np.arange(len(at)) + 1e-6)  # of the sample that is the newest then
                keep[at] = np.diff(number, prepend=-1.0) > 0.0
        return samples[keep]

    def _in_manoeuvres(self, samples: Samples) -> Samples:
        """Samples of the manoeuvres, without what sensors with a delay show of the pauses; a seam before each."""
        delay, parts = max(sensor.delay for sensor in self.sensing.sensors.values()), []
        for begin, end, since, run in self.spans:
            first, last = stamps_of([begin + delay, end])
            inside = samples[(samples.stamp >= first) & (samples.stamp <= last)]
            parts += [samples_of(Kind.SEAM, [first - 1], [since], [run]), inside]
        return concatenate(parts[1:])

    def excess_at(self, times: Array, half_width: float, seen: Array | None = None) -> Array:
        """The excess (m, 6) at times [s] of the world, averaged as measured coefficients are.

        ``seen``: the times [s] of the states where those are sparse; a measured coefficient knows no others.
        """
        grid, excess, sparse = self.truth.time, self.excess, seen is not None
        if seen is not None:
            grid, excess = seen, np.stack([np.interp(seen, grid, column) for column in excess.T], axis=1)
        return window_averages(grid, excess, times, half_width, sparse)


def world_of(flight: Reconstruction, stretches: list[Array], parameters: Array, seed: int) -> FlightConditions:
    """The world of a flight.

    stretches, each (n, StateField.WIDTH): its smoothed states in flight without a gap, of a manoeuvre each; parameters
    (p,) of its model. The seed draws the gusts that the reconstruction could not follow.
    """
    samples, epoch, gusts = flight.samples, flight.epoch, flight.gusts
    aircraft = as_loaded(flight.aircraft, samples)  # a replica has no message of mass properties
    stretches = [in_moving_air(stretch) for stretch in stretches]
    rows = np.vstack(stretches)
    motion_band = min(MOTION_BAND, KNOWN_SHARE / float(np.median(np.diff(rows[:, StateField.TIME]))))
    moved = [_motion(stretch, motion_band) for stretch in stretches]
    time, on_grid, rates, turning, force = (np.concatenate(parts) for parts in zip(*moved, strict=True))
    quaternion = on_grid[:, StateField.ATTITUDE]
    arm = aircraft.imu_position
    force = force - np.cross(turning, arm) - np.cross(rates, np.cross(rates, arm))
    sensing = with_recorded_rates(aircraft, samples)
    band = gust_band(sensing, float(np.mean(rows[:, StateField.AIRSPEED])), gusts)
    wind = on_grid[:, StateField.WIND] + _fast_gusts(len(time), gusts, band, seed)
    velocity = on_grid[:, StateField.VELOCITY]
    to_body = np.ascontiguousarray(rotation_matrices(quaternion).transpose(0, 2, 1))
    air_velocity = np.einsum("nij,nj->ni", to_body, velocity - wind)
    flow = air_data_from_velocities(air_velocity)
    world_rows = on_grid.copy()
    world_rows[:, StateField.ANGULAR_VELOCITY] = rates
    world_rows[:, StateField.SPECIFIC_FORCE], world_rows[:, StateField.AIR_VELOCITY] = force, air_velocity
    world_rows[:, StateField.AIRSPEED : StateField.SIDESLIP + 1] = flow
    origins = on_grid[:, StateField.ORIGIN.stop - 1]
    position = on_grid[:, StateField.POSITION].copy()
    position[:, 2] += origins[0] - origins  # each manoeuvre has its own
    altitude = altitudes(on_grid)
    controls, inputs, height = _recorded(aircraft, samples, time, epoch, on_grid)
    pressure = 0.5 * on_grid[:, StateField.AIR_DENSITY] * flow[:, 0] ** 2
    coefficients = coefficients_of_motion(aircraft, force, rates, turning, pressure)
    truth = Truth(
        time=time - time[0],
        position=position,
        velocity=velocity,
        quaternion=quaternion,
        rates=rates,
        angular_acceleration=turning,
        specific_force=force,
        air_velocity=air_velocity,
        airspeed=flow[:, 0],
        alpha=flow[:, 1],
        beta=flow[:, 2],
        density=on_grid[:, StateField.AIR_DENSITY],
        static_pressure=atmosphere.pressures(altitude),
        height=height,
        controls=controls,
        inputs=inputs[:, : len(aircraft.inputs)],
        wind=wind,
        coefficients=coefficients,
        origin=on_grid[0, StateField.ORIGIN],
    )
    model = _model_coefficients(aircraft, world_rows, np.hstack([controls, inputs]), height, parameters)
    kinds = tuple(int(kind) for kind in np.unique(samples.kind))
    spans = _spans([part[0] for part in moved], samples, epoch)
    return FlightConditions(aircraft, sensing, truth, coefficients - model, kinds, spans)


def _motion(rows: Array, band: float) -> tuple[Array, Array, Array, Array, Array]:
    """One stretch on the grid of the world: time (n,), rows (n, StateField.WIDTH), angular velocity and acceleration
    (n, 3), and specific force (n, 3) at the place of the IMU, without what is faster than ``band`` [Hz].
    """
    time = np.arange(rows[0, StateField.TIME], rows[-1, StateField.TIME], 1.0 / RATE)
    on_grid = _resampled(rows, time)
    quaternion = on_grid[:, StateField.ATTITUDE]
    on_grid[:, StateField.ATTITUDE] = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    rates = low_passed(on_grid[:, StateField.ANGULAR_VELOCITY], band)
    turning = np.gradient(rates, 1.0 / RATE, axis=0)
    return time, on_grid, rates, turning, low_passed(on_grid[:, StateField.SPECIFIC_FORCE], band)


def _recorded(aircraft: Aircraft, samples: Samples, time: Array, epoch: int, rows: Array) -> tuple[Array, Array, Array]:
    """Controls (n, 7) with the signs of the aircraft file, named inputs (n, MOST_INPUTS) and height above ground (n,).

    Controls are those at that time: a delay and a lag that the aircraft file says are taken off. The height, where it
    was not recorded, is that of the altitude of states (n, …) over the ground; where nothing says that, over the lowest
    point, which no axis that is judged reads.
    """
    samples, late = servo_lag(aircraft).follow(samples), time + sensor_delays(aircraft)[Kind.CONTROLS]
    controls = _series(samples, Kind.CONTROLS, 7, late, epoch)
    controls[:, :4] *= [aircraft.surface_signs[name] for name in SURFACES]
    inputs = _series(samples, Kind.INPUTS, MOST_INPUTS, late, epoch)
    height = _series(samples, Kind.HEIGHT, 1, time, epoch)[:, 0]
    altitude, ground = altitudes(rows), ground_of(aircraft, rows)
    ground = ground if np.isfinite(ground) else float(np.min(altitude))
    return controls, inputs, np.where(np.isfinite(height), height, altitude - ground)


def _spans(times: list[Array], samples: Samples, epoch: int) -> tuple[tuple[float, float, float, int], ...]:
    """Of each stretch: from and to [s] of the world, how long [s] after the one before it (or NaN), and its run."""
    seams = np.concatenate([[np.nan], samples.values[samples.kind == Kind.SEAM, 0]])
    runs = run_of_manoeuvres(samples)
    numbers = manoeuvre_at(samples, nanoseconds(np.array([time[0] for time in times]), epoch))
    return tuple(
        (float(time[0] - times[0][0]), float(time[-1] - times[0][0]), float(seams[number]), int(runs[number]))
        for time, number in zip(times, numbers, strict=True)
    )


def low_passed(series: Array, band: float) -> Array:
    """Columns (n, k) at RATE without what is faster than ``band`` [Hz], without delay."""
    from scipy.signal import butter, filtfilt  # here: 0.6 s that compare, add and the nodes do not need

    b, a = butter(2, band / (0.5 * RATE))
    return np.asarray(filtfilt(b, a, series, axis=0))


def gust_band(aircraft: Aircraft, speed: float, walk: float) -> float:
    """Band [rad/s] below which a smoother has a random walk of the wind [m/s per sqrt(s)] in its result.

    With white noise of spectral density R it passes 1 / (1 + (w/b)^2), b = walk / sqrt(R); what is left of a gust has
    the variance of a random walk without what is slower than 2 b. R is the mean over the three air data.
    """
    noise = [aircraft.sensors[name].noise[0] * (1.0 if name == "airspeed" else speed) for name in AIR_DATA]
    rates = [aircraft.sensors[name].rate for name in AIR_DATA]
    density = float(np.mean(np.square(noise) / rates))
    return 2.0 * walk / np.sqrt(max(density, 1e-12))


def _fast_gusts(count: int, walk: float, band: float, seed: int) -> Array:
    """Gusts (n, 3) [m/s] of a random walk, without what is slower than ``band`` [rad/s]."""
    from scipy.signal import lfilter

    steps = walk / np.sqrt(RATE) * generator(seed, "gusts").standard_normal((count, 3))
    return np.asarray(lfilter([1.0], [1.0, -np.exp(-band / RATE)], steps, axis=0))


def _resampled(rows: Array, time: Array) -> Array:
    """Rows at other times, linear; quaternions on the nearer side."""
    rows = rows.copy()
    flips = np.sign(np.sum(rows[1:, StateField.ATTITUDE] * rows[:-1, StateField.ATTITUDE], axis=1))
    rows[1:, StateField.ATTITUDE] *= np.cumprod(np.where(flips == 0.0, 1.0, flips))[:, None]
    return np.stack([np.interp(time, rows[:, StateField.TIME], column) for column in rows.T], axis=1)


def _series(samples: Samples, kind: Kind, width: int, time: Array, epoch: int) -> Array:
    """Values (n, width) of one kind of samples at times [s] after the epoch; NaN where there are none."""
    chosen = samples.kind == kind
    at = (samples.stamp[chosen] - epoch) * 1e-9
    values = samples.values[chosen]
    out = np.full((len(time), width), np.nan)
    for k in range(width):
        known = np.isfinite(values[:, k]) if len(values) else np.zeros(0, bool)
        if known.any():
            order = np.argsort(at[known], kind="stable")
            out[:, k] = np.interp(time, at[known][order], values[known, k][order])
    return out


def _model_coefficients(aircraft: Aircraft, rows: Array, controls: Array, height: Array, parameters: Array) -> Array:
    """What the model says of a motion, (n, 6)."""
    body = body_of(aircraft)
    signals = signals_of(rows, controls, height, body.geometry, body.gravity)
    terms = aircraft.model.terms_along(rows[:, StateField.TIME], signals, 1.5 / RATE)
    edges = aircraft.model.offsets
    columns = [terms[:, a:b] @ parameters[a:b] for a, b in itertools.pairwise(edges)]
    return np.stack(columns, axis=1)
