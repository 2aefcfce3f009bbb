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
from aircraft_sysid_ros.diagnosis.cannot_show import out_of_reach
from aircraft_sysid_ros.diagnosis.diagnose import diagnose
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData, check_flight
from aircraft_sysid_ros.diagnosis.flight.reconstruction import Reconstruction, reconstruct_as_flown, settled_flight
from aircraft_sysid_ros.diagnosis.measurement import CONTROLS, Setting, is_a_fault, measurement_faults
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.search.fit import held_out_error
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import COUNT, replicas_of
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.diagnosis.words import FlightDiagnosis, MeasurementFinding
from aircraft_sysid_ros.effects import LIBRARY
from aircraft_sysid_ros.effects.effect import MEASUREMENT, Effect, with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.samples import Samples


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
    settings: list[MeasurementFinding] = []
    given = aircraft
    for _ in range(THRESHOLDS.most_settings):
        faults = measurement_faults(flight, measuring, calm, lambda share: progress("look at the measurement", share))
        done = {s.setting.effect.identifier for s in settings}  # out of a process an effect is another object
        faults = _left_out_first([f for f in faults if f.effect.identifier not in done], given, samples)
        mended = with_best_setting(faults, aircraft, flight, calm, len(measuring))
        if mended is None:
            break
        aircraft, flight, calm, finding = mended
        data = settled_flight(flight)
        settings.append(replace(finding, matters=finding.matters and is_a_fault(finding.setting, given, samples)))
    bench = CandidateEvaluator(data)
    repeated = replicas_of(flight, others, replicas, lambda share: progress("fly replicas", share))
    result = diagnose(bench, repeated, others, lambda share: progress("try the library", share))
    data = replace(data, names=tuple(names), runs=tuple(runs))
    unseen = out_of_reach(bench, library, samples, calm)
    return FlightDiagnosis(data, tuple(settings), result, repeated, calm, tuple(unseen))


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
        better = with_setting(aircraft, fault.variant.setting, fault.value)
        mended, calm_then = reconstruct_as_flown(better, flight.samples, with_covariance=False)
        if fault.feigns_wind and not calm_then:  # gusts do what it explains
            continue
        finding = _judged(faults[number:], settled_flight(flight), settled_flight(mended), tried)
        if _is_worse(finding):
            continue
        if CONTROLS in fault.variant.setting and flight.data.inferred and not _explains_moments(finding):
            continue
        sized = any(after <= (1.0 - THRESHOLDS.size) * before for before, after in finding.errors.values())
        matters = calm or fault.feigns_wind or sized
        if matters or fault.of_motion or fault.is_place:
            return better, mended, calm or fault.feigns_wind, replace(finding, matters=matters)
    return None


def _left_out_first(faults: Sequence[Setting], given: Aircraft, samples: Samples) -> list[Setting]:
    """Settings, best first, before them those that are nearly as good and only say what the file leaves out."""

    def accuses(setting: Setting) -> bool:
        near = setting.evidence >= THRESHOLDS.left_out * faults[0].evidence
        return is_a_fault(setting, given, samples) or not near

    return sorted(faults, key=accuses)


def _is_worse(finding: MeasurementFinding) -> bool:
    """Whether the model fits the flight worse with what the sensors prefer: then they are not mended by it."""
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
    level = chdtri(1, THRESHOLDS.false_alarm / tried)  # at evidence 1 the setting is just significant
    p_value = float(min(1.0, tried * chdtrc(1, level * best.evidence)))
    errors = {}
    for axis in AXES:
        try:
            errors[axis] = (held_out_error(before, axis), held_out_error(after, axis))
        except InputError:
            continue
    return MeasurementFinding(best, p_value, company, errors or {"CZ": (np.nan, np.nan)})
