"""Effects in the measurement, tried before aerodynamics is blamed.

Scale, lag and place of the air data and of the IMU change what the first step makes of a flight. Its likelihood (5.7),
the product over all innovations, knows nothing of aerodynamics: it tells such a fault from a missing force. Each
setting of the aircraft file that an effect names is moved to where the likelihood is largest. A measurement that is
divided by a scale gives away ln(scale) per sample, the Jacobian of the density, or a larger scale would always win; so
does an airspeed whose scale drifts.

A scale, an offset or a drift of the air data feigns a wind that walks, and a wind that may walk hides it. Each value of
it is therefore judged under the walk that is likeliest with it, as the flight without it is, and it is believed only
where the air is calm once it is taken off: gusts stay gusts. And no half of the flight may speak against it: what is
wrong with a sensor is wrong always, and what happens once is another matter.

The delay of the recorded controls does not touch the first step, and is judged by the second (``late_controls.py``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS
from aircraft_sysid_ros.diagnosis.flight.reconstruction import (
    AIR_DATA,
    Reconstruction,
    likelihood_as_learnt,
    log_likelihood,
)
from aircraft_sysid_ros.diagnosis.measurement.late_controls import control_errors, try_controls
from aircraft_sysid_ros.diagnosis.measurement.maximum import maximum
from aircraft_sysid_ros.diagnosis.measurement.setting import (
    AHEAD,
    AIR_DATA_LAG,
    OF_MOTION,
    Job,
    Setting,
    feigns_wind,
    in_file,
    is_small,
    nominal,
    stretch_of,
)
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import Effect, ShapeParameter, with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.processes import in_parallel
from aircraft_sysid_ros.reconstruction.state import LearntNoise
from aircraft_sysid_ros.samples import Kind, Samples, first_and_last

#: A wind that walks this much less is tried with what feigns one, again and again down to that [m/s per sqrt(s)].
_CALMER, _CALMEST = 0.5, 0.004
#: A probe ahead is early where a late one is not: of the two one alone stands for both, so that the place is looked for
#: along the valley of both once there is a lag. Its longest value [s].
_LONGEST_LAG = 0.3


def measurement_faults(
    flight: Reconstruction,
    library: Sequence[Effect],
    calm: bool,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Setting]:
    """Significant settings, best first, each by itself."""
    jobs = sorted(jobs_of(flight, library, calm), key=_work_of, reverse=True)  # at the end all cores have little left
    if not jobs:
        return []
    found: list[Setting] = []
    for number, setting in enumerate(in_parallel(try_setting, jobs), 1):
        progress(number / len(jobs))
        if setting.evidence > 1.0:
            found.append(setting)
    return likelier_first(sorted(found, key=lambda s: -s.evidence))


def _work_of(job: Job) -> int:
    """How much a setting asks for, as a rank: those of the controls are judged by the whole second step."""
    return 2 if CONTROLS in job[3].setting else int(feigns_wind(job[3].setting))


def likelier_first(faults: Sequence[Setting]) -> list[Setting]:
    """The same, where a probe ahead and air data that are late change places so that the likelier goes first.

    They explain alike, and the one that is taken leaves little of the other. But a short delay, as gusts feign, needs
    a multiple of what a place needs, and a place that was taken for it makes a scale of a vane.
    """
    rivals = [number for number, each in enumerate(faults) if each.is_of_probe_in_time]
    by_gain = iter(sorted((faults[number] for number in rivals), key=lambda s: -s.gain))
    return [next(by_gain) if each.is_of_probe_in_time else each for each in faults]


def jobs_of(flight: Reconstruction, library: Sequence[Effect], calm: bool) -> Iterator[Job]:
    """One per setting that the flight has samples for; scales of the air data only in calm air."""
    samples = stretch_of(flight)
    kinds = set(np.unique(samples.kind).tolist())
    sensors = likelihood_as_learnt(flight.aircraft, samples)
    of_controls = any(CONTROLS in variant.setting for effect in library for variant in effect.variants)
    controls = control_errors(flight, flight.aircraft) if of_controls else {}
    for effect in library:
        for variant in effect.variants:
            if not variant.setting or variant.setting[0] == "process_noise":
                continue
            kind = {**AIR_DATA, **OF_MOTION}.get(variant.setting[1])
            if kind is None or int(kind) in kinds:
                yield flight, samples, effect, variant, effect.setting_number(variant), sensors, controls, calm


def try_setting(job: Job) -> Setting:
    """The best value of one setting, in a process of its own."""
    if CONTROLS in job[3].setting:
        return try_controls(job)
    flight, samples, effect, variant, inner, sensors, _, calm = job
    start = nominal(flight.aircraft, variant.setting)
    air = sum(int(np.sum(samples.kind == kind)) for kind in AIR_DATA.values())
    of_imu = variant.setting[1] in OF_MOTION  # gusts do not touch it: others of them tell it, without the air data too
    feigns = feigns_wind(variant.setting)
    total = calm or of_imu or feigns
    lag, lags = nominal(flight.aircraft, AIR_DATA_LAG), dict[float, float]()
    beside_lag = variant.setting == AHEAD and lag >= THRESHOLDS.gust_lag
    needed = THRESHOLDS.setting_total if total else max(THRESHOLDS.setting_total, THRESHOLDS.setting_gain * air)

    def gain(value: float, walk: float | None = None) -> float:
        if value == start and walk is None:
            return 0.0
        try:
            changed = with_setting(flight.aircraft, variant.setting, value)
            if walk is not None:
                changed = with_setting(changed, ("process_noise", "wind"), walk)
        except InputError:
            return -np.inf
        if beside_lag:

            def later(delay: float) -> float:
                again = with_setting(changed, AIR_DATA_LAG, delay)
                return log_likelihood(again, samples, sensors.noise).over(sensors)

            lags[value], gained, _ = maximum(later, lag, 0.0, _LONGEST_LAG, THRESHOLDS.half_against)
            return gained
        tried = log_likelihood(changed, samples, sensors.noise)
        gained = tried.over(sensors)
        return min(gained, tried.over(sensors, tuple(AIR_DATA.values()))) if of_imu else gained

    walk, found = flight.aircraft.process_noise["wind"], (start, 0.0, 0.0)
    if calm or not feigns:
        found = maximum(gain, start, inner.low, inner.high, 0.5 * needed)
    value, best, curvature, walk = _in_its_wind(gain, walk, found, start, inner, needed) if feigns else (*found, walk)
    std = float(1.0 / np.sqrt(curvature)) if curvature > 0.0 else np.nan
    if variant.setting[-1] == "delay" and not of_imu:
        needed *= THRESHOLDS.gust_lag / max(abs(value - start), 1e-3)
    beside = ((AIR_DATA_LAG, float(f"{lags[value]:.4g}")),) if value in lags else ()
    found_so = Setting(effect, variant, start, float(f"{value:.4g}"), best, 0.0, std, beside=beside)
    if feigns and (is_small(variant.setting, value, flight) or not (calm or walk <= THRESHOLDS.calm)):
        best = 0.0
    elif best > needed and variant.setting[-1] != "drift":  # which starts over with each half
        without = with_setting(flight.aircraft, ("process_noise", "wind"), walk)
        best = best if _in_both_halves(in_file(found_so, without), without, samples, sensors.noise) else 0.0
    return replace(found_so, gain=best, evidence=best / needed)


def with_the_other(best: Setting, flight: Reconstruction, calm: bool) -> Setting:
    """A delay of the controls with the lag of the servos beside it, or the other way round, where that gains, too."""
    corrected = replace(flight, aircraft=in_file(best, flight.aircraft))  # the first step does not use them
    others = replace(best.effect, variants=tuple(v for v in best.effect.variants if v.setting != best.variant.setting))
    second = max(map(try_setting, jobs_of(corrected, [others], calm)), key=lambda other: other.evidence)
    if not second.evidence > 1.0:
        return best
    value = dict(second.beside).get(best.variant.setting, best.value)
    return replace(best, value=value, beside=((second.variant.setting, second.value),))


def sharpened(setting: Setting, flight: Reconstruction) -> Setting:
    """A setting that the flight has been reconstructed with, at its likeliest value in the wind that is left then.

    It was found while all that was wrong stood for a wind that walks, and hid a part of it.
    """
    key, inner, now = (
        setting.variant.setting,
        setting.effect.setting_number(setting.variant),
        nominal(flight.aircraft, setting.variant.setting),
    )
    if CONTROLS in key or setting.of_coefficients:
        return setting
    samples = stretch_of(flight)
    as_it_is = likelihood_as_learnt(flight.aircraft, samples)

    def gain(value: float) -> float:
        if value == now:
            return 0.0
        try:
            return log_likelihood(with_setting(flight.aircraft, key, value), samples, as_it_is.noise).over(as_it_is)
        except InputError:
            return -np.inf

    # a place counts from where the aircraft has it, and so do its limits
    moved, width = setting.value - now, (inner.high - inner.low) / 16.0
    low, high = max(inner.low - moved, now - width), min(inner.high - moved, now + width)
    place, best, curvature = maximum(gain, now, low, high, THRESHOLDS.half_against)
    if not best > THRESHOLDS.half_against:
        return setting
    std = float(1.0 / np.sqrt(curvature)) if curvature > 0.0 else setting.std
    return replace(setting, value=float(f"{moved + place:.4g}"), std=std)


def _in_its_wind(
    gain: Callable[[float, float | None], float],
    given: float,
    found: tuple[float, float, float],
    start: float,
    inner: ShapeParameter,
    needed: float,
) -> tuple[float, float, float, float]:
    """Value, gain and curvature of a setting under the walk of the wind that is likeliest with it, and that walk.

    Over the flight without it under the better of its own walk and that one: a walk alone proves nothing.
    """
    walk = max(_CALMER**2 * given, _CALMEST)
    calmer = maximum(lambda value: gain(value, walk), start, inner.low, inner.high, 0.5 * needed)
    if calmer[1] <= max(found[1], needed):
        return *found, given
    best, at, first = calmer, walk, walk
    while (less := max(_CALMER * at, _CALMEST)) < at and (gained := gain(best[0], less)) > best[1]:
        best, at = (best[0], gained, best[2]), less
    if at != first:
        width = (inner.high - inner.low) / 8.0
        low, high = max(best[0] - width, inner.low), min(best[0] + width, inner.high)
        again = maximum(lambda value: gain(value, at), best[0], low, high, 0.5 * needed)
        best = max(best, again, key=lambda each: each[1])
    return best[0], best[1] - max(gain(start, first), gain(start, at), 0.0), best[2], at


def _in_both_halves(better: Aircraft, file: Aircraft, samples: Samples, noise: LearntNoise) -> bool:
    """Whether no half of the samples speaks against a setting, as far as a half can be flown by itself."""
    if np.any(samples.kind == Kind.SEAM):
        return True
    middle = sum(first_and_last(samples.stamp)) // 2
    halves = (samples[samples.stamp < middle], samples[samples.stamp >= middle])
    gains = [log_likelihood(better, half, noise).over(log_likelihood(file, half, noise)) for half in halves]
    return all(gained > -THRESHOLDS.half_against or not np.isfinite(gained) for gained in gains)
