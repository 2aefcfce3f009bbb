"""The calibration file: what was found, by sensor, checked once when it is loaded. YAML, SI units and radians.

    five_hole_probe:  alpha_sensitivity, beta_sensitivity [1/rad], pressure_zeros (3,) [Pa], the parameters of (36),
                      kappa_alpha, kappa_beta [1/rad^2] of a curve that bends; covariance (6, 6) of those of (36)
    magnetometer:     the parameters of (B1); hard iron in the unit of the sensor
    compatibility:    the parameters of (B8); IMU biases measured minus true
    source:           what it was made from; not used

A section has all of its parameters, where kappa may be left out, or none: then they are zero. It may hold ``std`` with
standard errors. The covariance is in the order of AIR_DATA_ERRORS; without it a filter that starts with the calibration
takes the squares of ``std``. (36), (B1), (B8) are equations of the two-stage paper, docs/references.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.calibration import compatibility, five_hole_probe, magnetometer
from aircraft_sysid_ros.calibration.probe_models import CURVE
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.spelling import did_you_mean
from aircraft_sysid_ros.yaml_file import read_yaml

Array = npt.NDArray[np.float64]

FIVE_HOLE, MAGNETOMETER, COMPATIBILITY = "five_hole_probe", "magnetometer", "compatibility"
#: Parameters that a sensor is corrected with, by section.
PARAMETERS = {
    FIVE_HOLE: (*five_hole_probe.NAMES1[:2], *five_hole_probe.NAMES2, *CURVE),
    MAGNETOMETER: (*magnetometer.NAMES1, *magnetometer.NAMES2),
    COMPATIBILITY: (*compatibility.NAMES1, *compatibility.NAMES2),
}
#: Parameters of a probe, or of compatibility, that a filter may have as states.
AIR_DATA_ERRORS = ("lambda_V", "b_V", "lambda_alpha", "b_alpha", "lambda_beta", "b_beta")
_SCALES = ("lambda_V", "lambda_alpha", "lambda_beta", "lambda_phi", "lambda_theta", "lambda_psi")
_ANGLES = ("b_alpha", "b_beta", "b_phi", "b_theta", "b_psi")
_SENSITIVITIES, _ZEROS, _COVARIANCE = ("alpha_sensitivity", "beta_sensitivity"), "pressure_zeros", "covariance"
#: 1 + lambda below the one or above the other is no scale of a sensor.
_LEAST_SCALE, _LARGEST_SCALE = 0.1, 10.0
#: [rad] An angle that is off by more is none that a sensor shows.
_LARGEST_OFFSET = 1.0


@dataclass(frozen=True)
class Calibration:
    """Parameters by section, and standard errors of those that have one; a section that is not there is empty."""

    five_hole_probe: dict[str, float] = field(default_factory=dict)
    magnetometer: dict[str, float] = field(default_factory=dict)
    compatibility: dict[str, float] = field(default_factory=dict)
    pressure_zeros: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std: dict[str, dict[str, float]] = field(default_factory=dict)
    probe_covariance: tuple[tuple[float, ...], ...] | None = None  # (6, 6)
    source: dict[str, Any] = field(default_factory=dict, compare=False)  # the file as read, to write copies


def load_calibration(path: str | Path) -> Calibration:
    """Read and check a calibration file, or that of a folder; InputError names file, key and what to correct."""
    if Path(path).is_dir():
        path = Path(path) / "calibration.yaml"
    content = read_yaml(path, "calibration file")
    try:
        return calibration_from_dict(content)
    except InputError as error:
        raise InputError(f"calibration file {path}: {error}") from None


def calibration_from_dict(content: Any) -> Calibration:
    """Check the content of a calibration file; raises InputError."""
    if isinstance(content, Mapping) and "outputs" in content:
        raise InputError("it says what the outputs of an autopilot mean: that is for --servos of import and bridge")
    if not isinstance(content, Mapping) or not set(content) & set(PARAMETERS):
        raise InputError(f"it must be a YAML mapping with one of {', '.join(PARAMETERS)}")
    _check_keys(content, (*PARAMETERS, "source"), "section")
    zeros, covariance = (0.0, 0.0, 0.0), None
    sections: dict[str, dict[str, float]] = {}
    std: dict[str, dict[str, float]] = {}
    for name, known in PARAMETERS.items():
        given = content.get(name)
        if given is None:
            continue
        if not isinstance(given, Mapping):
            raise InputError(f"the section {name} must be a mapping of parameters")
        more = (*_SENSITIVITIES, _ZEROS, _COVARIANCE) if name == FIVE_HOLE else ()
        _check_keys(given, (*known, "std", *more), f"parameter of {name}:")
        sections[name] = {key: _number(given.get(key, 0.0), key) for key in known}
        if name == FIVE_HOLE:
            sections[name].update({key: _positive(given, key) for key in _SENSITIVITIES})
            zeros = _zeros(given.get(_ZEROS, zeros))
            covariance = _covariance(given.get(_COVARIANCE))
        std[name] = _stds(given.get("std"), known)
        _check_scales(sections[name])
        _check_complete(given, name)
    if MAGNETOMETER in sections and abs(np.linalg.det(magnetic_matrix(sections[MAGNETOMETER]))) < _LEAST_SCALE**3:
        raise InputError("the parameters of the magnetometer map different fields to one: it cannot be corrected")
    return Calibration(**sections, pressure_zeros=zeros, std=std, probe_covariance=covariance, source=dict(content))


def magnetic_matrix(parameters: Mapping[str, float]) -> Any:
    """C_alpha C_eta C_lambda (3, 3) of (B1)."""
    xi2 = np.array([parameters[name] for name in magnetometer.NAMES2])
    return magnetometer.sensor_matrix(np.array([parameters[name] for name in magnetometer.NAMES1[:3]]), xi2)


def _check_keys(data: Mapping[str, Any], known: tuple[str, ...], kind: str) -> None:
    for key in data:
        if key not in known:
            hint = did_you_mean(str(key), known, quote="'") or f"known are {', '.join(known)}"
            raise InputError(f"unknown {kind} '{str(key)[:60]}': {hint}")


def _number(value: Any, what: str) -> float:
    try:
        number = np.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = np.nan
    if not np.isfinite(number):
        raise InputError(f"{what} must be a finite number")
    return number


def _positive(section: Mapping[str, Any], key: str) -> float:
    if key not in section:
        raise InputError(f"{FIVE_HOLE} needs {key} [1/rad]")
    number = _number(section[key], key)
    if number <= 0.0:
        raise InputError(f"{key} must be positive, not {number:g}")
    return number


def _zeros(value: Any) -> tuple[float, float, float]:
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        raise InputError(f"{_ZEROS} must be three numbers: dynamic, alpha and beta pressure in Pa")
    dynamic, alpha, beta = (_number(v, _ZEROS) for v in value)
    return dynamic, alpha, beta


def _stds(given: Any, known: tuple[str, ...]) -> dict[str, float]:
    """Standard errors that are there: null stands for a parameter that was not determined."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise InputError("std must be a mapping of parameters")
    _check_keys(given, known, "parameter of std:")
    found = {key: _number(value, f"std of {key}") for key, value in given.items() if value is not None}
    for key, value in found.items():
        if value < 0.0:
            raise InputError(f"std of {key} must not be negative, not {value:g}")
    return found


def _covariance(value: Any) -> tuple[tuple[float, ...], ...] | None:
    if value is None:
        return None
    n = len(AIR_DATA_ERRORS)
    if not (isinstance(value, list) and len(value) == n and all(isinstance(r, list) and len(r) == n for r in value)):
        raise InputError(f"{_COVARIANCE} must be {n} rows of {n} numbers, in the order {', '.join(AIR_DATA_ERRORS)}")
    matrix = np.array([[_number(number, _COVARIANCE) for number in row] for row in value])
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    scaled = matrix / np.outer(scale, scale)
    if not np.allclose(scaled, scaled.T, atol=1e-6) or np.linalg.eigvalsh(0.5 * (scaled + scaled.T))[0] < -1e-6:
        raise InputError(f"{_COVARIANCE} is not a covariance: it must be symmetric and positive")
    return tuple(tuple(float(number) for number in row) for row in matrix)


def _check_complete(given: Mapping[str, Any], section: str) -> None:
    """A section that lost a line would correct with a zero in its place."""
    curve = CURVE if set(given) & set(CURVE) else ()
    wanted = [key for key in PARAMETERS[section] if key not in CURVE or key in curve]
    missing = [key for key in wanted if key not in given]
    if missing and len(missing) < len(wanted):
        raise InputError(
            f"the section {section} lacks {' and '.join(missing)}: copy what calibrate has written, or give 0 for what "
            "is not to be corrected"
        )


def _check_scales(section: Mapping[str, float]) -> None:
    for key, value in section.items():
        if key.startswith("lambda_") and 1.0 + value < _LEAST_SCALE:
            raise InputError(f"{key} must be more than {_LEAST_SCALE - 1.0:g}, not {value:g}")
        if key in _SCALES and 1.0 + value > _LARGEST_SCALE:
            raise InputError(
                f"{key} must be at most {_LARGEST_SCALE - 1.0:g}, not {value:g}: it is a share, 0.1 for 10 %"
            )
        if key in _ANGLES and abs(value) > _LARGEST_OFFSET:
            raise InputError(f"{key} must be within {_LARGEST_OFFSET:g} rad, not {value:g}: angles are in rad")
