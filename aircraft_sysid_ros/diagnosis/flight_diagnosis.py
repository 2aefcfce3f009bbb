"""The diagnosis of one flight from its samples: measurement first, then forces and moments.

samples → settings that the first step's likelihood prefers → reconstruction → replicas → diagnose → findings, which
``words`` puts into words
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc, chdtri

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, MOMENTS
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS
from aircraft_sysid_ros.diagnosis.cannot_show import out_of_reach
from aircraft_sysid_ros.diagnosis.diagnose import Diagnosis, diagnose
from aircraft_sysid_ros.diagnosis.finding import Finding
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData, check_flight
from aircraft_sysid_ros.diagnosis.flight.reconstruction import Reconstruction, reconstruct_as_flown, settled_flight
from aircraft_sysid_ros.diagnosis.measurement.faults import jobs_of, measurement_faults, sharpened, try_setting
from aircraft_sysid_ros.diagnosis.measurement.imu_place import setting_of_forces
from aircraft_sysid_ros.diagnosis.measurement.late_controls import IMU_LAG, imu_explains
from aircraft_sysid_ros.diagnosis.measurement.other_judge import is_found_by_states
from aircraft_sysid_ros.diagnosis.measurement.setting import Setting, in_file, is_a_fault, is_small, setting_of
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator, new_terms
from aircraft_sysid_ros.diagnosis.search.fit import held_out_error
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import COUNT, Replica, replicas_of
from aircraft_sysid_ros.diagnosis.significance.setting_replicas import chance_of
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.diagnosis.trim.trim_finding import trim_finding
from aircraft_sysid_ros.diagnosis.words import OF_PLACE, OF_SHORT_WAY, FlightDiagnosis, MeasurementFinding
from aircraft_sysid_ros.effects import LIBRARY, OF_SERVOS
from aircraft_sysid_ros.effects.effect import MEASUREMENT, Effect, with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.samples import Kind, Samples, first_and_last

#: Times that an error of a sensor, as the coefficients show it, is corrected by what they show then.
_CORRECTIONS = 2
#: Effects that are not told from what the lag of a servo does beyond a delay.
OF_LATE_SURFACES = OF_SERVOS | {"alpha_dot"}


def diagnose_flight(
    aircraft: Aircraft,
    samples: Samples,
    library: Sequence[Effect] = LIBRARY,
    replicas: int = COUNT,
    progress: Callable[[str, float], None] = lambda what, share: None,
    names: Sequence[str] = (),
    runs: Sequence[str] = (),
) -> FlightDiagnosis:
    """Diagnose a flight under the model of an aircraft file. Raises InputError when the flight is too short.

    ``progress`` hears what is being done and its share from 0 to 1; ``names`` are those of manoeuvres that were joined,
    ``runs`` of runs.
    """
    progress("reconstruct the flight", 0.0)
    flight, calm = reconstruct_as_flown(aircraft, samples, with_covariance=False)
    data = settled_flight(flight)
    check_flight("the flight", data, samples)
    measuring = [effect for effect in library if effect.kind == MEASUREMENT]
    others = [effect for effect in library if effect.kind != MEASUREMENT]
    if not np.any(samples.kind == Kind.SEAM):  # a drift starts over with each manoeuvre
        others += [effect.as_terms for effect in measuring if effect.as_terms is not None]
    given = aircraft
    aircraft, flight, calm, settings = measurement_first(aircraft, flight, calm, measuring, replicas, progress)
    data = settled_flight(flight)
    not_beside = OF_LATE_SURFACES if data.has_late_surfaces else OF_SERVOS if has_found_lag(settings) else ()
    others = [effect for effect in others if effect.identifier not in not_beside]
    if not calm and ("imu_position", "y") in given.unsaid:  # in calm air the likelihood tells it
        placed = with_place_of_imu(aircraft, flight, measuring)
        if placed is not None and placed[-1].setting.label not in {each.setting.label for each in settings}:
            aircraft, flight, calm, place = placed
            data = settled_flight(flight)
            settings.append(place)
    trim = trim_finding(data)
    model = None if trim is None else trim.flight.with_terms(new_terms(trim.flight, trim.trial)).model
    while True:
        if model is not None:  # what hides what the moment does otherwise, here and in replicas
            flight = replace(flight, aircraft=replace(flight.aircraft, model=model))
            data = settled_flight(flight)
        bench = CandidateEvaluator(data)
        repeated = replicas_of(flight, others, replicas, lambda share: progress("fly replicas", share))
        result, others, corrected = _searched(bench, repeated, others, measuring, aircraft, flight, progress)
        if corrected is None:
            break
        aircraft, flight, finding = corrected
        data = settled_flight(flight)
        settings.append(finding)
    if trim is not None:
        result, data = result.after(trim), trim.flight
    data = replace(data, names=tuple(names), runs=tuple(runs))
    listed = {finding.trial.candidate.family for finding in result.candidates}
    listed |= {finding.setting.effect.identifier for finding in settings}
    unseen = out_of_reach(bench, library, samples, calm, listed)
    zero = flight.epoch + int(1e9 * (flight.points[0, CoefficientSample.TIME] - data.begin))
    first, _ = first_and_last(samples.stamp[samples.kind != Kind.SEAM])
    return FlightDiagnosis(data, tuple(settings), result, repeated, calm, tuple(unseen), zero, first)


def has_found_lag(settings: Sequence[MeasurementFinding]) -> bool:
    """Whether the lag of the servos is of this flight: what is left of it is as quick as their other faults are."""
    return any(each.setting.variant.setting[1:] == (CONTROLS, "lag") for each in settings)


def _searched(
    bench: CandidateEvaluator,
    repeated: Sequence[Replica],
    others: Sequence[Effect],
    measuring: Sequence[Effect],
    aircraft: Aircraft,
    flight: Reconstruction,
    progress: Callable[[str, float], None],
) -> tuple[Diagnosis, list[Effect], tuple[Aircraft, Reconstruction, MeasurementFinding] | None]:
    """The answer of the library, what of it is to be tried from now on, and the flight with the error of a sensor that
    the answer names, if it names one that holds; one that does not is left out, and the rest is tried again.
    """
    left = list(others)
    while True:
        result = diagnose(bench, repeated, left, lambda share: progress("try the library", share))
        shown = next((f for f in result.found if _is_of_sensor(f)), None)
        if shown is None:
            return result, left, None
        left = [effect for effect in left if effect.identifier != shown.trial.candidate.family]
        corrected = with_setting_of(shown, measuring, aircraft, flight)
        if corrected is not None:
            return result, left, corrected


def measurement_first(
    given: Aircraft,
    flight: Reconstruction,
    calm: bool,
    measuring: Sequence[Effect],
    replicas: int,
    progress: Callable[[str, float], None],
) -> tuple[Aircraft, Reconstruction, bool, list[MeasurementFinding]]:
    """The aircraft and the flight with all settings that the sensors prefer, and what they are."""
    aircraft, settings = given, list[MeasurementFinding]()
    while len(settings) < THRESHOLDS.most_settings:
        faults = measurement_faults(flight, measuring, calm, lambda share: progress("check the measurement", share))
        done = {_name(s.setting) for s in settings}  # out of a process an effect is another object
        faults = _left_out_first([f for f in faults if _name(f) not in done], given, flight.samples)
        sure = [
            fault
            for fault in faults
            if _p_value(fault, len(measuring)) < THRESHOLDS.verdict or not is_a_fault(fault, given, flight.samples)
        ]
        corrected = _beyond_chance(sure, given, aircraft, flight, calm, measuring, replicas, progress)
        if corrected is None:
            break
        aircraft, flight, calm, finding = corrected
        moved = [_moved(each, finding.setting.beside) for each in settings]
        settings = [*(each for each in moved if each.setting.value != each.setting.nominal), finding]
        aircraft, flight, calm, settings = _sharpened(settings, aircraft, flight, calm)
    return aircraft, flight, calm, settings


def _beyond_chance(
    faults: Sequence[Setting],
    given: Aircraft,
    aircraft: Aircraft,
    flight: Reconstruction,
    calm: bool,
    measuring: Sequence[Effect],
    replicas: int,
    progress: Callable[[str, float], None],
) -> tuple[Aircraft, Reconstruction, bool, MeasurementFinding] | None:
    """``with_best_setting`` without faults that replicas of the flight, whose sensors are right, feign as much, that
    places of the sensors explain which the file leaves out, or that the filter with these errors as states denies.
    """
    tried = len(measuring)
    while (corrected := with_best_setting(faults, aircraft, flight, calm, tried)) is not None:
        finding, chance = corrected[-1], 0.0
        accused = finding.matters and _accuses(finding, given, flight.samples)
        if accused and not (
            is_found_by_states(finding.setting, flight)
            and _needed_beside_places(finding.setting, given, aircraft, flight, calm, measuring)
        ):
            chance = 1.0
        elif accused:
            progress("check the measurement in replicas", 0.0)
            chance = chance_of(finding.setting, finding.errors, corrected[1], calm, tried, replicas)
        p_value = max(finding.p_value, chance)
        if chance < THRESHOLDS.verdict and (not accused or p_value < level_of(finding, calm)):
            why = "" if accused else _why_no_fault(finding, given, flight.samples)
            return *corrected[:3], replace(finding, matters=accused, p_value=p_value, why_no_fault=why)
        faults = [fault for fault in faults if _name(fault) != _name(finding.setting)]
    return None


def level_of(finding: MeasurementFinding, calm: bool) -> float:
    """The p-value below which a setting is a fault, in air that was calm before it was corrected or not.

    Gusts move the aeroplane, which turns into them, and in no replica are they of one piece with its motion: a vane
    for the angle of attack then looks as if it showed too little. What lowers no error beside that must be surer.
    """
    return THRESHOLDS.verdict if calm or _has_size(finding) else THRESHOLDS.further


def _needed_beside_places(
    fault: Setting,
    given: Aircraft,
    aircraft: Aircraft,
    flight: Reconstruction,
    calm: bool,
    measuring: Sequence[Effect],
) -> bool:
    """Whether a scale, an offset or a drift is significant once the sensors sit where the flight has them, too.

    No place that the file leaves out need be likelier than such a fault by itself: in turns a probe ahead of the centre
    of gravity shows at once what a vane for the angle of attack with another scale and one for sideslip would.
    """
    if not fault.feigns_wind:
        return True
    places = [
        replace(effect, variants=variants)
        for effect in measuring
        if (variants := tuple(v for v in effect.variants if v.setting in given.unsaid))
    ]
    done = set[str]()
    for _ in range(THRESHOLDS.most_settings):
        likelier = [place for place in measurement_faults(flight, places, calm) if place.label not in done]
        corrected = with_best_setting(likelier, aircraft, flight, calm, len(measuring))
        if corrected is None:
            break
        aircraft, flight, calm, found = corrected
        done.add(found.setting.label)
    alone = replace(fault.effect, variants=(fault.variant,))
    return not done or any(try_setting(job).evidence > 1.0 for job in jobs_of(flight, [alone], calm))


def _accuses(finding: MeasurementFinding, given: Aircraft, samples: Samples) -> bool:
    """Whether a setting is a fault. A delay is one where it lowers the error of an axis by ``Thresholds.size``, in calm
    air too: a scale or an offset makes derivatives wrong that fit as well, a delay is seen by what quick motion leaves,
    of an axis that the model then explains.
    """
    setting = finding.setting
    seen = setting.of_motion or not setting.is_late or _has_size(finding, THRESHOLDS.left_most)
    return seen and is_a_fault(setting, given, samples)


def _why_no_fault(finding: MeasurementFinding, given: Aircraft, samples: Samples) -> str:
    """Why a setting is counted with and is no fault, in words."""
    setting = finding.setting
    if setting.is_place and not is_a_fault(setting, given, samples):
        return OF_PLACE if setting.variant.setting in given.unsaid else OF_SHORT_WAY
    if not is_a_fault(setting, given, samples):
        return (
            "it is allowed for: a sensor that averages from sample to sample, or a value that is held until the next "
            "one, is as late"
        )
    if CONTROLS in setting.variant.setting and IMU_LAG in finding.confounded_with:
        return "it is allowed for, and a late IMU explains as much"
    return f"it is allowed for, and lowers no error of an axis that the model explains by {THRESHOLDS.size:.0%}"


def _moved(finding: MeasurementFinding, beside: Sequence[tuple[tuple[str, ...], float]]) -> MeasurementFinding:
    """A setting that was corrected, where another one has moved it."""
    values = [value for key, value in beside if key == finding.setting.variant.setting]
    return replace(finding, setting=replace(finding.setting, value=values[0])) if values else finding


def _sharpened(
    settings: Sequence[MeasurementFinding], aircraft: Aircraft, flight: Reconstruction, calm: bool
) -> tuple[Aircraft, Reconstruction, bool, list[MeasurementFinding]]:
    """All settings that were corrected, each worked out again beside the others and in the wind that is left."""
    found = []
    for finding in settings:
        better = sharpened(finding.setting, flight)
        moved = better.value - (finding.setting.value if better.is_place else 0.0)  # a place is moved on
        if better.value != finding.setting.value:
            changed = with_setting(aircraft, better.variant.setting, moved)
            again, calm_then = reconstruct_as_flown(changed, flight.samples, with_covariance=False)
            if not _is_worse(_judged([better], settled_flight(flight), settled_flight(again), 1)):
                aircraft, flight, calm, finding = changed, again, calm_then, replace(finding, setting=better)
        found.append(finding)
    return aircraft, flight, calm, found


def with_best_setting(
    faults: Sequence[Setting], aircraft: Aircraft, flight: Reconstruction, calm: bool, tried: int
) -> tuple[Aircraft, Reconstruction, bool, MeasurementFinding] | None:
    """The aircraft and the flight with the best of some settings, whether it is calm then, and what that says; None
    where there is none.

    None may make the model fit worse: what is right of the sensors serves the coefficients, too. In gusts a setting may
    make likelier what is only a gust: there it must lower the error of an axis by ``Thresholds.size``, too. Without
    that a place, or what is of the motion over ground, which gusts do not touch, is counted with, and is no fault.
    """
    for number, fault in enumerate(faults):
        better = in_file(fault, aircraft)
        corrected, calm_then = reconstruct_as_flown(better, flight.samples, with_covariance=False)
        if fault.feigns_wind and not calm_then:  # gusts do what it explains
            continue
        finding = _judged(faults[number:], settled_flight(flight), settled_flight(corrected), tried)
        if _is_worse(finding):
            continue
        if CONTROLS in fault.variant.setting and flight.data.inferred and not _explains_moments(finding):
            continue
        if CONTROLS in fault.variant.setting and imu_explains(fault, flight):
            company = dict.fromkeys((*finding.confounded_with, IMU_LAG))
            return better, corrected, calm, replace(finding, matters=False, confounded_with=tuple(company))
        matters = calm or fault.feigns_wind or _has_size(finding)
        if matters or fault.of_motion or fault.is_place:
            return better, corrected, calm or calm_then or fault.feigns_wind, replace(finding, matters=matters)
    return None


def with_place_of_imu(
    aircraft: Aircraft, flight: Reconstruction, measuring: Sequence[Effect]
) -> tuple[Aircraft, Reconstruction, bool, MeasurementFinding] | None:
    """The aircraft and the flight with the IMU where the forces have it, sideways, which gusts hide from the likelihood
    of the first step. No file states it, so that it is no fault. None where the forces do not tell.
    """
    effect = next((each for each in measuring if each.identifier == "imu_offset"), None)
    setting = None if effect is None else setting_of_forces(settled_flight(flight), effect)
    if setting is None:
        return None
    better = in_file(setting, aircraft)
    corrected, calm = reconstruct_as_flown(better, flight.samples, with_covariance=False)
    found = _judged([setting], settled_flight(flight), settled_flight(corrected), 1)
    if _is_worse(found) or not _has_size(found):
        return None
    return better, corrected, calm, replace(found, matters=False, why_no_fault=OF_PLACE)


def _is_of_sensor(finding: Finding) -> bool:
    effect = finding.trial.candidate.effect
    return effect is not None and effect.kind == MEASUREMENT


def with_setting_of(
    finding: Finding, measuring: Sequence[Effect], aircraft: Aircraft, flight: Reconstruction
) -> tuple[Aircraft, Reconstruction, MeasurementFinding] | None:
    """The aircraft and the flight with an error of a sensor that forces and moments show, which gusts hide from the
    likelihood of the first step; None where the flight that is reconstructed with it does not keep what it promises.
    """
    setting, terms = setting_of(finding.trial, measuring, aircraft, finding.evidence), finding.trial.candidate.effect
    if is_small(setting.variant.setting, setting.value, flight):
        return None
    for left in range(_CORRECTIONS, -1, -1):
        try:
            better = with_setting(aircraft, setting.variant.setting, setting.value)
        except InputError:  # no file may hold so much
            return None
        corrected, _ = reconstruct_as_flown(better, flight.samples, with_covariance=False)
        more = CandidateEvaluator(settled_flight(corrected)).best_of(terms) if terms is not None and left else None
        if more is None or not more.pays:
            break
        setting = replace(setting, value=setting_of(more, measuring, better, 0.0).value)
    found = _judged([setting], settled_flight(flight), settled_flight(corrected), 1)
    if _is_worse(found) or not _has_size(found):
        return None
    return better, corrected, replace(found, p_value=finding.p_value, confounded_with=finding.confounded_with)


def _has_size(finding: MeasurementFinding, most: float = np.inf) -> bool:
    """Whether a setting lowers the error of an axis by ``Thresholds.size``, and to ``most``."""
    return any(after <= min((1.0 - THRESHOLDS.size) * before, most) for before, after in finding.errors.values())


def _name(setting: Setting) -> str:
    """What is tried once: a place has three numbers, and surfaces that are late have a delay and a lag."""
    return setting.label if setting.is_place or CONTROLS in setting.variant.setting else setting.effect.identifier


def _p_value(setting: Setting, tried: int) -> float:
    """Of one of so many settings: at evidence 1 it is just significant."""
    level = chdtri(1, THRESHOLDS.false_alarm / tried)
    return float(min(1.0, tried * chdtrc(1, level * setting.evidence)))


def _left_out_first(faults: Sequence[Setting], given: Aircraft, samples: Samples) -> list[Setting]:
    """Settings, best first, before them those that are nearly as good and only say what the file leaves out."""

    def accuses(setting: Setting) -> bool:
        near = setting.evidence >= THRESHOLDS.left_out * faults[0].evidence
        near = near or setting.gain >= faults[0].gain  # in gusts a place needs more to be believed
        return is_a_fault(setting, given, samples) or not near

    return sorted(faults, key=accuses)


def _is_worse(finding: MeasurementFinding) -> bool:
    """Whether the model fits the flight worse with what the sensors prefer: then they are not corrected by it."""
    ratios = [np.log(after / before) for before, after in finding.errors.values() if min(before, after) > 0.0]
    return bool(ratios) and float(np.mean(ratios)) > THRESHOLDS.worse


def _explains_moments(finding: MeasurementFinding) -> bool:
    """Whether little is left of the moments: of angles that are inferred a delay of the controls explains some, too."""
    return all(finding.errors[axis][1] <= THRESHOLDS.inferred_error for axis in MOMENTS if axis in finding.errors)


def _judged(faults: Sequence[Setting], before: FlightData, after: FlightData, tried: int) -> MeasurementFinding:
    """The best of some settings, with those that are as good, and the errors without and with it."""
    best = faults[0]
    near = [f.effect.identifier for f in faults[1:] if f.evidence >= THRESHOLDS.setting_as_good * best.evidence]
    company = tuple(dict.fromkeys(name for name in near if name != best.effect.identifier))
    errors = {}
    for axis in AXES:
        try:
            errors[axis] = (held_out_error(before, axis), held_out_error(after, axis))
        except InputError:
            continue
    return MeasurementFinding(best, _p_value(best, tried), company, errors or {"CZ": (np.nan, np.nan)})
