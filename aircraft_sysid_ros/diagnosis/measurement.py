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

The delay of the recorded controls does not touch the first step; it is judged by the held-out error of the second, in
the moments. It is one against the IMU: where an IMU that is late explains as much, and neither attitude nor GPS speaks
against that, the surfaces are not said to be late. And a surface that an autopilot moves by the gyros is a rate, and
shifted, either way, its derivative, which is the moment itself: what a delay gains beyond one the other way counts.
Surfaces that follow with the lag of a servo are rivals of those that follow as a whole: the better one is named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import MOMENTS
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS, SENSOR_ALIASES, SENSOR_GROUPS
from aircraft_sysid_ros.diagnosis.flight.reconstruction import (
    AIR_DATA,
    OF_FILTER,
    Likelihood,
    Reconstruction,
    flight_data_of,
    likelihood_as_learnt,
    log_likelihood,
    reconstruct,
)
from aircraft_sysid_ros.diagnosis.flight.wheels import off_wheels
from aircraft_sysid_ros.diagnosis.search.evaluator import Score
from aircraft_sysid_ros.diagnosis.search.fit import fit_axis
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import Effect, ShapeParameter, Variant, with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.pace import interval_of
from aircraft_sysid_ros.identification.coefficients.stream import coefficient_samples
from aircraft_sysid_ros.processes import in_parallel
from aircraft_sysid_ros.reconstruction.state import LearntNoise
from aircraft_sysid_ros.samples import Kind, Samples, fewer_manoeuvres

Array = npt.NDArray[np.float64]

#: Longest stretch [s] of a flight that is run again for each setting.
LONGEST = 120.0
#: Steps towards the best value after the first look to both sides.
_STEPS = 4
#: A wind that walks this much less is tried with what feigns one, again and again down to that [m/s per sqrt(s)].
_CALMER, _CALMEST = 0.5, 0.004
#: Sensors of the motion over ground, the attitude besides.
_OF_MOTION = {"imu": Kind.IMU, "gps": Kind.GPS_VELOCITY}
#: Errors of the air data that feign a wind.
_OF_WIND = ("scale", "offset", "drift")
#: What makes a sensor, or what servos move, late.
_LATE = ("delay", "lag")
#: By how much surfaces come later than they are recorded.
_CONTROL_DELAY = ("sensors", CONTROLS, "delay")
#: The delay that stands for a lag, over it: until half of a step is done. How far [s] from there it is looked for.
_DELAY_OF_LAG, _NEAR = float(np.log(2.0)), 0.05
#: Steps [s] in which a delay of the controls is looked for where none is better than none near it.
_FAR = 0.05
#: Its rival, and the shares of a delay of the controls that the IMU is tried to be late by.
IMU_LAG, _IMU_DELAY, _SHARES = "imu_lag", ("sensors", "imu", "delay"), (0.4, 0.6, 0.8, 1.0)
#: A probe ahead is early where a late one is not: of the two one alone stands for both, so that the place is looked for
#: along the valley of both once there is a lag. Its longest value [s].
_AHEAD, AIR_DATA_LAG, _LONGEST_LAG = ("air_data_position", "x"), ("sensors", "air_data", "delay"), 0.3


def feigns_wind(setting: tuple[str, ...]) -> bool:
    """Whether a setting is a scale, an offset or a drift of the air data."""
    return setting[-1] in _OF_WIND and setting[1] in AIR_DATA


@dataclass(frozen=True)
class Setting:
    """A number of the aircraft file that explains the measurements better than the one it has."""

    effect: Effect
    variant: Variant
    nominal: float
    value: float
    gain: float  # of the log-likelihood
    evidence: float  # the gain over what is needed: above 1 it is significant
    std: float  # of the value, from the curvature of the likelihood
    of_coefficients: bool = False  # forces and moments tell it, and not the likelihood of the sensors
    beside: tuple[tuple[tuple[str, ...], float], ...] = ()  # other settings that it moves, and where to

    @property
    def judges(self) -> str:
        """What it fits better, in words."""
        return "forces and moments" if self.of_coefficients or CONTROLS in self.variant.setting else "the sensors"

    @property
    def feigns_wind(self) -> bool:
        """It feigns a wind that walks: the air must be calm once it is taken off."""
        return feigns_wind(self.variant.setting)

    @property
    def is_late(self) -> bool:
        """It is by how much something is late."""
        return self.variant.setting[-1] in _LATE

    @property
    def is_place(self) -> bool:
        """It is where a sensor sits."""
        return self.variant.setting[0].endswith("_position")

    @property
    def of_motion(self) -> bool:
        """It is one of IMU or GPS, which others of their kind tell without the air data."""
        return self.variant.setting[1] in _OF_MOTION

    @property
    def label(self) -> str:
        """Id and variant."""
        return self.effect.identifier + (f" ({self.variant.name})" if self.variant.name else "")


def measurement_faults(
    flight: Reconstruction,
    library: Sequence[Effect],
    calm: bool,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Setting]:
    """Significant settings, best first, each by itself."""
    jobs = list(jobs_of(flight, library, calm))
    if not jobs:
        return []
    found: list[Setting] = []
    for number, setting in enumerate(in_parallel(try_setting, jobs), 1):
        progress(number / len(jobs))
        if setting.evidence > 1.0:
            found.append(setting)
    return sorted(found, key=lambda s: -s.evidence)


def setting_of(trial: Score, library: Sequence[Effect], aircraft: Aircraft, evidence: float) -> Setting:
    """The setting that an error of a sensor is which a trial of its terms has shown in the coefficients."""
    axis, candidate = trial.main_axis, trial.candidate
    number = float(trial.gains[axis].parameters[0]) / candidate.ties[axis][0].factor
    effect = next(each for each in library if each.identifier == candidate.family)
    start = nominal(aircraft, effect.variants[0].setting)
    value = float(f"{start + number:.4g}")
    return Setting(effect, effect.variants[0], start, value, trial.score, evidence, np.nan, of_coefficients=True)


def in_file(setting: Setting, aircraft: Aircraft) -> Aircraft:
    """The aircraft file with a setting. Raises InputError where no file may hold it."""
    for key, value in ((setting.variant.setting, setting.value), *setting.beside):
        aircraft = with_setting(aircraft, key, value)
    return aircraft


def is_a_fault(setting: Setting, file: Aircraft, samples: Samples) -> bool:
    """Whether a setting contradicts what is known, and does not only say what the aircraft file leaves out.

    A place that the file does not state, and a delay of about half the time from sample to sample, as averaging makes
    it, are taken into account and are no fault. Nor is a place of the air data that such a delay stands for: a probe
    that is d further ahead in the airspeed V is d/V early wherever the aeroplane turns.
    """
    key, size = setting.variant.setting, abs(setting.value - setting.nominal)
    if setting.is_place:
        stated = key not in file.unsaid
        if not stated or key[0] != _AHEAD[0]:
            return stated
        airspeed = samples.values[samples.kind == Kind.AIRSPEED, 0]
        typical = float(np.nanmedian(airspeed)) if np.any(np.isfinite(airspeed)) else 0.0
        return size * file.span >= typical * _delay_of_averaging(samples, Kind.IMU, Kind.AIRSPEED)
    if key[-1] in _LATE:
        kinds = {**_OF_MOTION, CONTROLS: Kind.CONTROLS, **AIR_DATA}
        return size >= _delay_of_averaging(samples, kinds.get(key[1], Kind.AIRSPEED))
    return True


def _delay_of_averaging(samples: Samples, *kinds: Kind) -> float:
    """The delay [s] that is no fault of the slowest of some sensors."""
    slowest = max((interval_of(samples, kind) for kind in kinds), key=np.nan_to_num)
    return max(THRESHOLDS.least_delay, THRESHOLDS.least_delay_share * slowest)


def nominal(aircraft: Aircraft, setting: tuple[str, ...]) -> float:
    """What the aircraft file says now; 0 for a shift of a position."""
    if setting[0].endswith("_position"):
        return 0.0
    if setting[0] == "process_noise":
        return aircraft.process_noise[setting[1]]
    name = SENSOR_GROUPS.get(setting[1], (SENSOR_ALIASES.get(setting[1], setting[1]),))[0]
    return float(getattr(aircraft.sensors[name], setting[2]))


#: By moment the held-out error and that of the fit to all points.
Errors = dict[str, tuple[float, float]]
#: A flight and the stretch of it that is run again, a setting and its range, the likelihood of the sensors and the
#: errors of the moments without it, and whether it is calm.
Job = tuple[Reconstruction, Samples, Effect, Variant, ShapeParameter, Likelihood, Errors, bool]


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
            kind = {**AIR_DATA, **_OF_MOTION}.get(variant.setting[1])
            if kind is None or int(kind) in kinds:
                yield flight, samples, effect, variant, effect.setting_number(variant), sensors, controls, calm


def stretch_of(flight: Reconstruction) -> Samples:
    """Samples from shortly before the first point on, LONGEST at most; of manoeuvres so many, evenly chosen."""
    if np.any(flight.samples.kind == Kind.SEAM):
        return fewer_manoeuvres(flight.samples, LONGEST)
    begin = flight.epoch + int((flight.points[0, 0] - 10.0) * 1e9) if len(flight.points) else 0
    stamp = flight.samples.stamp
    return flight.samples[(stamp >= begin) & (stamp <= begin + int((LONGEST + 10.0) * 1e9))]


def try_setting(job: Job) -> Setting:
    """The best value of one setting, in a process of its own."""
    if CONTROLS in job[3].setting:
        return _try_controls(job)
    flight, samples, effect, variant, inner, sensors, _, calm = job
    start = nominal(flight.aircraft, variant.setting)
    air = sum(int(np.sum(samples.kind == kind)) for kind in AIR_DATA.values())
    of_imu = variant.setting[1] in _OF_MOTION  # gusts do not touch it: others of them tell it, without the air data too
    feigns = feigns_wind(variant.setting)
    total = calm or of_imu or feigns
    lag, lags = nominal(flight.aircraft, AIR_DATA_LAG), dict[float, float]()
    beside_lag = variant.setting == _AHEAD and lag >= THRESHOLDS.gust_lag
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
    elif best > needed and variant.setting[-1] != "drift":  # which begins anew with each half
        without = with_setting(flight.aircraft, ("process_noise", "wind"), walk)
        best = best if _in_both_halves(in_file(found_so, without), without, samples, sensors.noise) else 0.0
    return replace(found_so, gain=best, evidence=best / needed)


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
    middle = (samples.stamp[0] + samples.stamp[-1]) // 2
    halves = (samples[samples.stamp < middle], samples[samples.stamp >= middle])
    gains = [log_likelihood(better, half, noise).over(log_likelihood(file, half, noise)) for half in halves]
    return all(gained > -THRESHOLDS.half_against or not np.isfinite(gained) for gained in gains)


def is_small(setting: tuple[str, ...], value: float, flight: Reconstruction) -> bool:
    """Whether a scale, an offset or a drift is less than what matters to any coefficient."""
    quantity, of_airspeed = setting[-1], setting[1] == "airspeed"
    seconds = float(np.ptp(flight.points[:, 0])) if len(flight.points) else 0.0
    if quantity == "drift":
        value *= seconds
    if quantity == "scale" and not of_airspeed:
        return abs(value - 1.0) < THRESHOLDS.least_angle_scale
    deviation = abs(value - 1.0) if quantity == "scale" else abs(value)
    return deviation < (THRESHOLDS.least_scale if of_airspeed else THRESHOLDS.least_offset)


def maximum(
    gain: Callable[[float], float], start: float, low: float, high: float, least: float
) -> tuple[float, float, float]:
    """Place and value of the largest of a smooth function between limits, looked for from ``start``, and its curvature.

    Parabolas through the three best points, as long as they promise more than ``least``. A start beyond a limit is one.
    """
    low, high = min(low, start), max(high, start)
    width = (high - low) / 8.0
    places = sorted({float(np.clip(p, low, high)) for p in (start - width, start, start + width)})
    if len(places) < 3:  # the start is at a limit
        places = sorted({*places, float(np.clip(start + (2 * width if start <= low else -2 * width), low, high))})
    known = {place: gain(place) for place in places}
    curvature = 0.0
    for _ in range(_STEPS):
        top = max(known, key=lambda p: known[p])
        near = _around(sorted(known), top)
        vertex, height, curvature = _parabola(near, [known[p] for p in near])
        if not np.isfinite(vertex):
            vertex, height = (2.0 * top - start if top != start else start), np.inf
        vertex = float(np.clip(vertex, max(low, top - 2 * width), min(high, top + 2 * width)))
        if max(height, known[top]) < least or any(abs(vertex - place) < 0.02 * width for place in known):
            break
        known[vertex] = gain(vertex)
    top = max(known, key=lambda p: known[p])
    return top, known[top], curvature


def _around(places: list[float], top: float) -> list[float]:
    """Three of the places: the top with its neighbours."""
    middle = min(max(places.index(top), 1), len(places) - 2)
    return places[middle - 1 : middle + 2]


def _parabola(x: Sequence[float], y: Sequence[float]) -> tuple[float, float, float]:
    """Vertex, value there and negative second derivative of the parabola through three points; NaN without a top."""
    if not np.all(np.isfinite(y)):
        return np.nan, np.nan, 0.0
    a, b, c = np.polyfit(np.asarray(x) - x[1], y, 2)
    if not a < 0.0:
        return np.nan, np.nan, 0.0
    return float(x[1] - 0.5 * b / a), float(c - 0.25 * b * b / a), float(-2.0 * a)


def _with_delay(aircraft: Aircraft, delay: float) -> Aircraft:
    return with_setting(aircraft, _CONTROL_DELAY, delay)


def _try_controls(job: Job) -> Setting:
    """The best delay of the recorded controls, or lag of the servos: that beside the delay that is there already, which
    it takes over from.
    """
    flight, _, effect, variant, inner, _, controls, _ = job
    aircraft, needed = flight.aircraft, THRESHOLDS.control_gain
    start, as_late = nominal(aircraft, variant.setting), nominal(aircraft, _CONTROL_DELAY)
    beside: tuple[tuple[tuple[str, ...], float], ...] = ()

    def gain(value: float, delay: float = as_late) -> float:
        try:
            changed = with_setting(_with_delay(aircraft, delay), variant.setting, value)
        except InputError:
            return -np.inf
        return 0.0 if (value, delay) == (start, as_late) else control_gain(controls, control_errors(flight, changed))

    if variant.setting[-1] == "lag" and as_late < 0.0:
        delays = dict[float, float]()

        def taking_over(value: float) -> float:
            usual = float(np.clip(as_late + _DELAY_OF_LAG * (value - start), as_late, 0.0))
            low, high = max(usual - _NEAR, effect.inner[0].low), min(usual + _NEAR, 0.0)
            delays[value], gained, _ = maximum(lambda delay: gain(value, delay), usual, low, high, 0.2 * needed)
            return gained

        value, best, curvature = maximum(taking_over, start, inner.low, inner.high, 0.5 * needed)
        beside = ((_CONTROL_DELAY, float(f"{delays[value]:.4g}")),)
    else:
        value, best, curvature = maximum(gain, start, inner.low, inner.high, 0.5 * needed)
        if best <= 0.0:  # a delay that is longer than a doublet takes is past a valley
            far = np.arange(inner.low, inner.high + 0.5 * _FAR, _FAR)
            tried = {place: gain(place) for place in far[np.abs(far - start) > _FAR].tolist()}
            again = max(tried, key=lambda place: tried[place], default=start)
            if tried.get(again, 0.0) > 0.5 * needed:
                value, best, curvature = maximum(gain, again, inner.low, inner.high, 0.5 * needed)
    std = float(1.0 / np.sqrt(curvature)) if curvature > 0.0 else np.nan
    if best > needed:  # as much the other way
        moved = value - start if variant.setting[-1] == "lag" else start - value
        best -= max(control_gain(controls, control_errors(flight, _with_delay(aircraft, as_late + moved))), 0.0)
        late = with_setting(_with_delay(aircraft, dict(beside).get(_CONTROL_DELAY, as_late)), variant.setting, value)
        best = min(best, control_gain(controls, _explained(control_errors(flight, late))))
    return Setting(effect, variant, start, float(f"{value:.4g}"), best, best / needed, std, beside=beside)


def with_the_other(best: Setting, flight: Reconstruction, calm: bool) -> Setting:
    """A delay of the controls with the lag of the servos beside it, or the other way round, where that gains, too."""
    mended = replace(flight, aircraft=in_file(best, flight.aircraft))  # the first step does not use them
    others = replace(best.effect, variants=tuple(v for v in best.effect.variants if v.setting != best.variant.setting))
    second = max(map(try_setting, jobs_of(mended, [others], calm)), key=lambda other: other.evidence)
    if not second.evidence > 1.0:
        return best
    value = dict(second.beside).get(best.variant.setting, best.value)
    return replace(best, value=value, beside=((second.variant.setting, second.value),))


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
