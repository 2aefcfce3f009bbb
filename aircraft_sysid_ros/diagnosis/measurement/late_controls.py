"""How much later than they are recorded surfaces move, or motion is recorded.

A delay of the recorded controls does not touch the first step; it is judged by the held-out error of the second, in
the moments. It is one against the IMU: where an IMU that is late explains as much, and neither attitude nor GPS speaks
against that, the surfaces are not said to be late. And a surface that an autopilot moves by the gyros is a rate, and
shifted, either way, its derivative, which is the moment itself: what a delay gains beyond one the other way counts.
Surfaces that follow with the lag of a servo are rivals of those that follow as a whole: the better one is named.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import MOMENTS
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS
from aircraft_sysid_ros.diagnosis.flight.reconstruction import (
    AIR_DATA,
    OF_FILTER,
    Reconstruction,
    flight_data_of,
    likelihood_as_learnt,
    log_likelihood,
    reconstruct,
)
from aircraft_sysid_ros.diagnosis.flight.wheels import off_wheels
from aircraft_sysid_ros.diagnosis.measurement.maximum import maximum
from aircraft_sysid_ros.diagnosis.measurement.setting import Errors, Job, Setting, nominal, stretch_of
from aircraft_sysid_ros.diagnosis.search.fit import fit_axis
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import ShapeParameter, with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.stream import coefficient_samples

#: By how much surfaces come later than they are recorded.
_CONTROL_DELAY = ("sensors", CONTROLS, "delay")
#: The delay that stands for a lag, over it: until half of a step is done. How far [s] from there it is looked for.
_DELAY_OF_LAG, _NEAR = float(np.log(2.0)), 0.05
#: Steps [s] in which a delay of the controls is looked for beyond the best one near that which is there.
_FAR = 0.05
#: How far [s] from one that is found it is looked for more closely: steps of the first look are as wide.
_CLOSE = 0.03
#: Its rival, and the shares of a delay of the controls that the IMU is tried to be late by.
IMU_LAG, _IMU_DELAY, _SHARES = "imu_lag", ("sensors", "imu", "delay"), (0.4, 0.6, 0.8, 1.0)


def try_controls(job: Job) -> Setting:
    """The best delay of the recorded controls, or lag of the servos: that beside the delay that is there already, which
    it takes over from.
    """
    flight, _, effect, variant, inner, _, controls, _ = job
    aircraft, needed = flight.aircraft, THRESHOLDS.control_gain
    start, as_late = nominal(aircraft, variant.setting), nominal(aircraft, _CONTROL_DELAY)
    beside: tuple[tuple[tuple[str, ...], float], ...] = ()

    @cache
    def gain(value: float, delay: float = as_late) -> float:
        try:
            changed = with_setting(_with_delay(aircraft, delay), variant.setting, value)
        except InputError:
            return -np.inf
        return 0.0 if (value, delay) == (start, as_late) else control_gain(controls, control_errors(flight, changed))

    if variant.setting[-1] == "lag" and as_late < 0.0:
        value, best, curvature, delay = _lag_for_delay(gain, start, as_late, effect.inner[0].low, inner)
        beside = ((_CONTROL_DELAY, float(f"{delay:.4g}")),)
    else:
        value, best, curvature = _over_the_range(gain, start, inner)
    std = float(1.0 / np.sqrt(curvature)) if curvature > 0.0 else np.nan
    if best > needed:  # as much the other way
        moved = value - start if variant.setting[-1] == "lag" else start - value
        best -= max(control_gain(controls, control_errors(flight, _with_delay(aircraft, as_late + moved))), 0.0)
        late = with_setting(_with_delay(aircraft, dict(beside).get(_CONTROL_DELAY, as_late)), variant.setting, value)
        best = min(best, control_gain(controls, _explained(control_errors(flight, late))))
    return Setting(effect, variant, start, float(f"{value:.4g}"), best, best / needed, std, beside=beside)


def _over_the_range(gain: Callable[[float], float], start: float, inner: ShapeParameter) -> tuple[float, float, float]:
    """The best value near the present one, or that of another place of the range where it is clearly better, refined.

    What is longer than a doublet lies past a valley of what a delay gains, where no search from zero comes.
    """
    needed = THRESHOLDS.control_gain
    value, best, curvature = maximum(gain, start, inner.low, inner.high, 0.5 * needed)
    far = np.arange(inner.low, inner.high + 0.5 * _FAR, _FAR)
    tried = {place: gain(place) for place in far[np.abs(far - start) > _FAR].tolist()}
    again = max(tried, key=lambda place: tried[place], default=start)
    if tried.get(again, 0.0) > max(best, 0.0) + 0.5 * needed:
        value, best, curvature = maximum(gain, again, inner.low, inner.high, 0.5 * needed)
    if best <= needed:
        return value, best, curvature
    low, high = max(value - _CLOSE, inner.low), min(value + _CLOSE, inner.high)
    value, best, closer = maximum(gain, value, low, high, 0.5 * needed)
    return value, best, closer or curvature


def _lag_for_delay(
    gain: Callable[[float, float], float], start: float, as_late: float, lowest: float, inner: ShapeParameter
) -> tuple[float, float, float, float]:
    """The best lag in place of a delay that the aircraft file has, and the delay, not below `lowest`, left beside it.

    What it gains counts over the best delay alone: a better delay is not a lag.
    """
    needed, delays = THRESHOLDS.control_gain, dict[float, float]()

    @cache
    def taking_over(value: float) -> float:
        usual = float(np.clip(as_late + _DELAY_OF_LAG * (value - start), as_late, 0.0))
        low, high = max(usual - _NEAR, lowest), min(usual + _NEAR, 0.0)
        delays[value], gained, _ = maximum(lambda delay: gain(value, delay), usual, low, high, 0.2 * needed)
        return gained

    value, best, curvature = maximum(taking_over, start, inner.low, inner.high, 0.5 * needed)
    return value, best - max(taking_over(start), 0.0), curvature, delays[value]


def _with_delay(aircraft: Aircraft, delay: float) -> Aircraft:
    return with_setting(aircraft, _CONTROL_DELAY, delay)


def control_errors(flight: Reconstruction, aircraft: Aircraft) -> Errors:
    """Errors of the moments in the second step with another delay of the controls.

    A surface turns the aeroplane at once, which the gyros show. What it does to the forces is small beside the angles
    of flow, and where those are inferred a delay of the controls stands for their errors: C_Z of flights without vanes
    gained by it what C_l lost.
    """
    points = coefficient_samples(aircraft, OF_FILTER, flight.samples, flight.rows, flight.epoch)
    data, errors = flight_data_of(aircraft, points), {}
    aloft = off_wheels(data)
    data = replace(data, time=data.time[aloft], measured=data.measured[aloft], signals=data.signals[aloft])
    for axis in MOMENTS:
        try:
            fit = fit_axis(data, axis)
        except InputError:
            continue
        errors[axis] = fit.nrmse_held_out, fit.nrmse_fit
    return errors


def _explained(errors: Errors) -> Errors:
    """Those of moments that the model explains: where most is left of one, what a delay gains may be of what is not in
    the model, as thrust that nobody recorded, which an autopilot answers all the time.
    """
    return {axis: error for axis, error in errors.items() if error[0] <= THRESHOLDS.left_most}


def control_gain(before: Errors, after: Errors) -> float:
    """Sum over the moments of ln(error variance before / after), held out, but no more than of the fit to all points.

    Where an autopilot moves the surfaces with the motion, a fit hardly knows the one from the other, and is held out
    as badly as chance will have it: a delay that only steadies it has explained nothing.
    """
    axes = before.keys() & after.keys()
    return sum(2.0 * min(float(np.log(b / a)) for b, a in zip(before[x], after[x], strict=True)) for x in axes)


def imu_explains(late: Setting, flight: Reconstruction) -> bool:
    """Whether an IMU that is late explains of the moments what a delay of the controls does.

    Attitude and GPS must not speak against it; the air data may, since gusts reach a probe before the wing.
    """
    samples = stretch_of(flight)
    sensors, controls = likelihood_as_learnt(flight.aircraft, samples), control_errors(flight, flight.aircraft)
    start, delay = nominal(flight.aircraft, _IMU_DELAY), abs(late.value - late.nominal)
    for share in _SHARES:
        try:
            moved = with_setting(flight.aircraft, _IMU_DELAY, start + share * delay)
        except InputError:  # no file may hold so much
            break
        if (
            log_likelihood(moved, samples, sensors.noise).over(sensors, tuple(AIR_DATA.values()))
            <= -THRESHOLDS.half_against
        ):
            continue
        again = reconstruct(moved, flight.samples, with_covariance=False)
        if control_gain(controls, control_errors(again, moved)) >= THRESHOLDS.setting_as_good * late.gain:
            return True
    return False
