"""Which numbers of theta are estimated, in which steps they are moved, and what becomes of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.aircraft.postfix import evaluate_term_rows
from aircraft_sysid_ros.flight_model.layout import (
    BIAS_NAMES,
    FORCE,
    GYRO,
    OUTPUT_GROUPS,
    PROCESS_GROUPS,
    aerodynamic_slice,
    bias_slice,
    output_slice,
    parameter_count,
    process_slice,
)
from aircraft_sysid_ros.identification.conditions import needs
from aircraft_sysid_ros.identification.trust import Evidence, disagree, judge
from aircraft_sysid_ros.refinement.record import FlightRecord
from aircraft_sysid_ros.refinement.refined_file import says_otherwise

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

#: Steps of the finite differences, as share of the spread of a coefficient, and of the rest of theta.
_COEFFICIENT_STEP, _BIAS_STEPS, _LEVEL_STEP = 1e-3, (1e-3, 1e-5), 1e-3


@dataclass(frozen=True)
class Scales:
    """Sizes of the terms in flight."""

    rms: Array  # (coefficients,) of the term
    spread: Array  # (coefficients,) standard deviation of the measured coefficient of its axis

    def effect(self, std: Array) -> Array:
        """What one standard error (coefficients,) moves its coefficient by, over the coefficient's spread."""
        with np.errstate(invalid="ignore"):
            return np.where(np.isfinite(std), std * self.rms / self.spread, np.inf)


def scales_of(model: AerodynamicModel, record: FlightRecord, theta: Array) -> Scales:
    """Scales over the flight; theta gives the spread of the coefficients by the model's own terms."""
    signals = record.signals()[record.in_flight]
    terms = np.empty((len(signals), len(model.parameter_names)))
    evaluate_term_rows(*model.linked, signals, terms)
    spread = np.empty(terms.shape[1])
    for axis in AXES:
        part = model.axis_slice(axis)
        spread[part] = max(float(np.std(terms[:, part] @ theta[part])), 1e-6)
    return Scales(np.sqrt(np.mean(np.square(terms), axis=0)), spread)


def difference_steps(record: FlightRecord, scales: Scales) -> Array:
    """Step of every number of theta for finite differences."""
    model = record.model
    steps = np.full(parameter_count(model), _LEVEL_STEP)
    steps[aerodynamic_slice(model)] = _COEFFICIENT_STEP * scales.spread / np.maximum(scales.rms, 1e-9)
    steps[bias_slice(model)] = np.repeat(_BIAS_STEPS, 3)
    return steps


def estimable(model: AerodynamicModel, record: FlightRecord) -> Mask:
    """Which coefficients and biases of theta the outputs and signals that are there allow; levels: none."""
    active = np.zeros(parameter_count(record.model), np.bool_)
    terms = [program for programs in model.programs for program in programs]
    for i, program in enumerate(terms):
        active[i] = not program.signals & record.missing
    measured = record.measured
    active[bias_slice(record.model)] = np.concatenate([measured[FORCE : FORCE + 3], measured[GYRO : GYRO + 3]])
    return active


def without_information(covariance: Array, active: Mask, scales: Scales) -> int | None:
    """The coefficient of theta that is known worst, where one standard error would move its axis by more than all
    that it does in flight; None where there is none. ``covariance`` is that of the active numbers.
    """
    std = np.full(len(active), 0.0)
    variance = np.diag(covariance)
    std[active] = np.sqrt(np.where(np.isfinite(variance), variance, np.inf))
    effect = scales.effect(std[: len(scales.rms)])
    worst = int(np.argmax(effect))
    return worst if effect[worst] > 1.0 else None


def judged(
    model: AerodynamicModel,
    record: FlightRecord,
    theta: Array,
    std: Array,
    active: Mask,
    scales: Scales,
    run_parameters: dict[str, dict[str, Any]],
    doubts: Mapping[str, str],
    bounds: Mapping[str, tuple[float, float]],
) -> list[dict[str, Any]]:
    """Coefficients with status and reason by the rules of trust, as they stand in a file.

    ``doubts`` says of an axis why nothing in it is to be used; ``bounds`` are those of the aircraft file.
    """
    anywhere = (-np.inf, np.inf)
    effect, found = scales.effect(std[: len(scales.rms)]), []
    per_unit = scales.effect(np.ones(len(scales.rms)))
    samples = int(record.in_flight.sum())
    for i, name in enumerate(model.parameter_names):
        axis = model.programs[AXES.index(name[:2])]
        read = frozenset().union(*(program.signals for program in axis))
        lacking = sorted(read & record.missing)
        missing = needs(lacking) if lacking else doubts.get(name[:2], "")
        excitation = run_parameters.get(name, {}).get("excitation")
        excited = np.inf if excitation is None else float(excitation)
        status, reason = "HOLD", "this flight does not determine it: left at its start value"
        if active[i] or lacking:
            known = (name, float(theta[i]), float(std[i]), excited, float(effect[i]))
            evidence = Evidence(*known, samples, missing, bounds.get(name, anywhere))
            verdict = judge(evidence)
            status, reason = verdict.status.name, verdict.reason
            other = run_parameters.get(name, {})
            if status == "USE" and _contradicts(other, theta[i], std[i], per_unit[i]):
                status, reason = "HOLD", says_otherwise(other["value"])
        value = {"name": name, "value": float(theta[i]), "std": float(std[i]) if active[i] else None}
        found.append({**value, "status": status, "reason": reason})
    return found


def _contradicts(other: Mapping[str, Any], value: float, std: float, effect: float) -> bool:
    """Whether a value of parameters.json that was in USE does not agree; ``effect`` of one unit, as for disagree."""
    if other.get("status") != "USE" or other.get("std") is None:
        return False
    apart = disagree(*(np.array([x]) for x in (value, float(other["value"]), std, float(other["std"]), effect)))
    return bool(apart[0])


def named(names: tuple[str, ...], values: Array, std: Array, active: Mask) -> list[dict[str, Any]]:
    """Biases or levels as they stand in a file; what was not estimated has no standard error."""
    return [
        {"name": n, "value": float(v), "std": float(s) if a else None}
        for n, v, s, a in zip(names, values, std, active, strict=True)
    ]


def biases_json(record: FlightRecord, theta: Array, std: Array, active: Mask) -> list[dict[str, Any]]:
    """Biases of accelerometer [m/s^2] and gyro [rad/s]."""
    part = bias_slice(record.model)
    return named(BIAS_NAMES, theta[part], std[part], active[part])


def levels_json(record: FlightRecord, theta: Array, std: Array, active: Mask) -> dict[str, list[dict[str, Any]]]:
    """Levels of process noise, and factors on the output noise, from their logarithms."""
    result = {}
    for key, names, part in (
        ("process_noise", PROCESS_GROUPS, process_slice(record.model)),
        ("output_noise_factors", OUTPUT_GROUPS, output_slice(record.model)),
    ):
        value = np.exp(theta[part])
        result[key] = named(names, value, value * std[part], active[part])
    return result
