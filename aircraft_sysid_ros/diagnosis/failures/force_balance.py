"""Coefficients of a flight from its sensors alone, without a filter and without flow angles.

What the sensors of any flight show together, however slow some of them are: all series are put on one grid with one
zero-phase low pass, as wide as the slowest of IMU and inputs allows, so that a linear relation between them stays true.

Where no vane measures the angle of attack, lift stands for it, and side force for sideslip: with
``C_Z = C_Z0 + C_Z,alpha alpha + C_Z,q q + C_Z,de de`` the linear model of C_m in alpha, q and de is as well one in C_Z,
q and de, with other numbers. In the same way drag is a parabola of lift, and C_l and C_n follow from C_Y. C_Z and C_Y
cannot be judged then, since they are read.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft import atmosphere
from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import SURFACES, Aircraft
from aircraft_sysid_ros.aircraft.expression import parse_expression
from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT, SIGNAL_INDEX, SIGNALS
from aircraft_sysid_ros.aircraft.term_values import evaluate_signals
from aircraft_sysid_ros.diagnosis.flight.motion_coefficients import coefficients_of_motion
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.reconstruction.ground_speed_wind import GroundSpeedWind, wind_of_ground_speed
from aircraft_sysid_ros.reconstruction.servo_lag import servo_lag
from aircraft_sysid_ros.samples import CONTROL_COLUMNS, Kind, Samples, are_sound, first_and_last, is_absurd
from aircraft_sysid_ros.sensors.sensor_models import first_order_lag
from aircraft_sysid_ros.stretches import longest_stretch

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Widest band [Hz] that is looked at: it holds the motion of small aeroplanes.
WIDEST = 4.0
#: Share of the rate of a sensor up to which it is believed, and points of the grid in a period of the band.
SHARE, POINTS = 0.4, 2.5
#: Rate [Hz] of the grid on which series are filtered.
_FINE = 50.0
#: Silence of a series, in its usual steps and in any case [s], that is a gap.
_GAP, _SHORT_GAP = 4.0, 1.0
#: Slopes that make an angle of usual size of a coefficient of force; their value does not matter.
LIFT_SLOPE, SIDE_SLOPE = -5.0, -0.5
#: Thrust of full throttle over weight that stands in T_c where no thrust is measured; its value does not matter.
_THRUST_TO_WEIGHT = 0.5
#: Shortest flight [s] of which anything is said.
SHORTEST = 20.0
_THROTTLE = CONTROL_COLUMNS.index("throttle")
_VANES = (("alpha", Kind.ANGLE_OF_ATTACK, "CZ", LIFT_SLOPE), ("beta", Kind.SIDESLIP, "CY", SIDE_SLOPE))


@dataclass(frozen=True)
class ForceBalance:
    """n points of a flight in the air, at one step."""

    aircraft: Aircraft
    time: Array  # (n,) [s] from ``begin``, and the signal ``time``
    begin: int  # stamp [ns] of time 0: the first sample of the IMU, unless another one is asked for
    recorded_from: int  # stamp [ns] of the first sample
    step: float  # [s]
    band: float  # [Hz]
    measured: Array  # (n, 6) C_X … C_n about the aerodynamic reference
    signals: Array  # (n, SIGNAL_COUNT); angles that no vane measures are scaled forces
    weight: Array  # (n,) dynamic pressure over its mean: forces are equally certain, coefficients are not
    angles: frozenset[str]  # of alpha and beta, those that vanes measure
    wind: GroundSpeedWind | None  # of a flight without airspeed
    has_airspeed: bool
    #: T_c (n,) of full throttle where it stands for a thrust that is not measured, else NaN.
    full_thrust: Array

    def signal(self, name: str) -> Array:
        """One signal (n,)."""
        return np.asarray(self.signals[:, self.aircraft.model.signal_names.index(name)])

    def columns(self, texts: list[str], signals: Array | None = None) -> Array:
        """Terms (n, len(texts)), on other signals where some are given."""
        programs = [parse_expression(text, self.aircraft.model.inputs) for text in texts]
        return evaluate_signals(programs, self.time, self.signals if signals is None else signals, 1.5 * self.step)


class _Series:
    """The series of a flight, on a fine grid [s from the first sample of the IMU]."""

    def __init__(self, aircraft: Aircraft, samples: Samples) -> None:
        sound: Mask = np.asarray(~is_absurd(samples).any(axis=1) & are_sound(samples.stamp))
        self._samples = servo_lag(aircraft).follow(samples[sound])
        self._delay = {Kind.CONTROLS: aircraft.sensors["control_surfaces"].delay}
        self._delay[Kind.INPUTS] = self._delay[Kind.CONTROLS]
        of_imu = np.sort(self._samples.stamp[self._samples.kind == Kind.IMU])
        if len(of_imu) < 2:
            raise InputError("the flight has no IMU: nothing can be said about its forces")
        self.begin = int(of_imu[0])
        self.grid = np.arange(0.0, (of_imu[-1] - of_imu[0]) * 1e-9, 1.0 / _FINE)
        self.sound = np.ones(len(self.grid), np.bool_)

    def rate(self, kind: Kind) -> float:
        """Samples per second, the median; infinite where there are none."""
        stamps = np.unique(self._samples.stamp[self._samples.kind == kind])
        return float(1e9 / np.median(np.diff(stamps))) if len(stamps) > 2 else np.inf

    def has(self, kind: Kind) -> bool:
        """Whether a kind of sample has values."""
        return bool(np.isfinite(self._samples.values[self._samples.kind == kind]).any())

    def of(self, kind: Kind, width: int, needed: bool = False, lead: float = 0.0) -> Array:
        """Values (m, width) on the grid, linear between samples; NaN for a column without any.

        ``needed``: where its samples have a gap, the grid is not ``sound``. ``lead`` [s]: it acts so much later.
        """
        chosen = self._samples.kind == kind
        time = (self._samples.stamp[chosen] - self.begin) * 1e-9 - self._delay.get(kind, 0.0) + lead
        values, out = self._samples.values[chosen], np.full((len(self.grid), width), np.nan)
        order = np.argsort(time, kind="stable")
        for k in range(width):
            known = order[np.isfinite(values[order, k])] if len(values) else order
            if len(known) > 1:
                out[:, k] = np.interp(self.grid, time[known], values[known, k])
                if needed:
                    self._mark(time[known])
        return out

    def _mark(self, time: Array) -> None:
        longest = max(_GAP * float(np.median(np.diff(time))), _SHORT_GAP)
        after = np.clip(np.searchsorted(time, self.grid), 1, len(time) - 1)
        self.sound &= (time[after] - time[after - 1] <= longest) & (self.grid >= time[0]) & (self.grid <= time[-1])

    def speed(self) -> tuple[Array, GroundSpeedWind | None, bool]:
        """Airspeed (m,) [m/s], the wind that was taken off the speed over ground for it, and whether it is measured."""
        if self.has(Kind.AIRSPEED):
            return self.of(Kind.AIRSPEED, 1, needed=True)[:, 0], None, True
        velocity = self.of(Kind.GPS_VELOCITY, 3, needed=True)
        if not np.isfinite(velocity).any():
            raise InputError("the flight has neither airspeed nor GPS velocity: nothing can be said about its forces")
        flying = np.linalg.norm(velocity, axis=1) > 0.3 * np.nanmax(np.linalg.norm(velocity, axis=1))
        wind = wind_of_ground_speed(velocity[flying, :2], 1.0 / _FINE)
        if wind is not None and wind.is_known and wind.is_there:
            velocity = velocity - np.array([*wind.wind, 0.0])
        return np.linalg.norm(velocity, axis=1), wind, False

    def density(self) -> Array:
        """Density of the air (m,) [kg/m^3]: as measured, or the standard one at the height of the GPS."""
        air = self.of(Kind.AIR, 2)
        height = self.of(Kind.GPS_POSITION, 3)[:, 2]
        of_pressure = np.where(np.isfinite(air[:, 1]), atmosphere.altitude_at(air[:, 1]), height)
        height = np.where(np.isfinite(of_pressure), of_pressure, 0.0)
        standard = np.array([atmosphere.air_density(h) for h in height])
        return np.where(np.isfinite(air[:, 0]), air[:, 0], standard)


def force_balance(
    aircraft: Aircraft,
    samples: Samples,
    widest: float = WIDEST,
    lead: float = 0.0,
    spool: float = 0.0,
    zero: int | None = None,
) -> ForceBalance:
    """The longest stretch of a flight in the air. Raises InputError where it is too short or lacks a sensor.

    ``widest`` [Hz] band that is looked at. ``lead`` [s]: how much earlier inputs are recorded than they act, beyond the
    delay of the aircraft file. ``spool`` [s]: time constant with which the engine follows the throttle. ``zero``: stamp
    [ns] from which times count; None: from the first sample of the IMU.
    """
    from scipy.signal import butter, sosfiltfilt

    series = _Series(aircraft, samples)
    rates = [series.rate(kind) for kind in (Kind.IMU, Kind.CONTROLS, Kind.INPUTS)]
    band = min(widest, SHARE * min(rates))
    low_pass = butter(2, band / (0.5 * _FINE), output="sos")

    def smooth(values: Array) -> Array:
        known = np.isfinite(values).all(axis=0)
        out = np.full_like(values, np.nan)
        out[:, known] = sosfiltfilt(low_pass, values[:, known], axis=0)
        return out

    imu = smooth(series.of(Kind.IMU, 6, needed=True))
    speed, wind, has_airspeed = series.speed()
    speed = np.maximum(smooth(speed[:, None])[:, 0], 0.1)
    pressure = 0.5 * series.density() * speed**2
    controls = series.of(Kind.CONTROLS, len(CONTROL_COLUMNS), lead=lead)
    if spool > 0.0:
        controls[:, [_THROTTLE]] = first_order_lag(series.grid, controls[:, [_THROTTLE]], spool)
    controls = smooth(controls)
    controls[:, :4] *= [aircraft.surface_signs[name] for name in SURFACES]
    inputs = smooth(series.of(Kind.INPUTS, len(aircraft.inputs), lead=lead))
    measured = _coefficients(aircraft, imu, pressure)
    signals = np.full((len(series.grid), SIGNAL_COUNT), np.nan)
    angles = _put_angles(signals, series, smooth, measured)
    for name, column, length in (("p", 3, aircraft.span), ("q", 4, 2.0 * aircraft.chord), ("r", 5, aircraft.span)):
        signals[:, SIGNAL_INDEX[name]] = imu[:, column] * length / (2.0 * speed)
    signals[:, [SIGNAL_INDEX[name] for name in CONTROL_COLUMNS]] = controls
    signals[:, SIGNAL_INDEX["Tc"]], full_thrust = _thrust(aircraft, controls, pressure)
    begin = series.begin if zero is None else zero
    time = series.grid + (series.begin - begin) * 1e-9
    for name, values in (("V", speed), ("qbar", pressure), ("time", time)):
        signals[:, SIGNAL_INDEX[name]] = values
    signals[:, len(SIGNALS) : len(SIGNALS) + inputs.shape[1]] = inputs
    every = max(int(_FINE / (POINTS * band)), 1)
    flying = series.sound & (speed > aircraft.minimum_airspeed) & np.isfinite(measured).all(axis=1)
    keep = longest_stretch(flying[::every])
    step = every / _FINE
    lasting = (keep.stop - keep.start) * step
    if lasting < SHORTEST:
        seconds = f"{lasting:.0f} s in the air with IMU and speed: {SHORTEST:g} s are needed"
        raise InputError(f"the flight has {seconds}")
    at = np.arange(0, len(series.grid), every)[keep]
    return ForceBalance(
        aircraft, time[at], begin, first_and_last(samples.stamp)[0], step, band, measured[at], signals[at],
        pressure[at] / float(np.mean(pressure[at])), angles, wind, has_airspeed, full_thrust[at],
    )  # fmt: skip


def _put_angles(signals: Array, series: _Series, smooth: Callable[[Array], Array], measured: Array) -> frozenset[str]:
    """Write the angles of flow into signals (m, SIGNAL_COUNT), scaled forces (m, 6) for those that no vane measures.

    Returns those that vanes measure.
    """
    angles = set()
    for name, kind, axis, slope in _VANES:
        if series.has(kind):
            signals[:, SIGNAL_INDEX[name]] = smooth(series.of(kind, 1, needed=True))[:, 0]
            angles.add(name)
        else:
            signals[:, SIGNAL_INDEX[name]] = measured[:, AXES.index(axis)] / slope
    return frozenset(angles)


def _thrust(aircraft: Aircraft, controls: Array, pressure: Array) -> tuple[Array, Array]:
    """T_c (m,) as measured, or as the throttle has it, and that of full throttle where it does, else NaN."""
    thrust = controls[:, CONTROL_COLUMNS.index("Tc")] / (pressure * aircraft.wing_area)
    if np.isfinite(thrust).any():
        return thrust, np.full(len(thrust), np.nan)
    weight = aircraft.mass * atmosphere.STANDARD_GRAVITY
    full_thrust = _THRUST_TO_WEIGHT * weight / (pressure * aircraft.wing_area)
    return full_thrust * controls[:, _THROTTLE], full_thrust


def _coefficients(aircraft: Aircraft, imu: Array, pressure: Array) -> Array:
    """C_X … C_n (n, 6) of specific forces where the IMU is, and rates (n, 6)."""
    rates = imu[:, 3:]
    turning = np.gradient(rates, 1.0 / _FINE, axis=0)
    arm = aircraft.imu_position
    force = imu[:, :3] - np.cross(turning, arm) - np.cross(rates, np.cross(rates, arm))
    return coefficients_of_motion(aircraft, force, rates, turning, pressure)
