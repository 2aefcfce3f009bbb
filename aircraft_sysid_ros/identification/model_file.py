"""A learnt model in a file: parameters for people, and the sums with which the recursion goes on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import model_from_terms
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.text_file import write_whole

_FORMAT = "aircraft_sysid_ros model 1"
_LEARNT = ("theta", "p", "sums", "noise_square", "updates", "vane_covariance")


def save_model(estimator: Identifier, path: str | Path) -> None:
    """Write terms, parameters and the state of the recursion; raises InputError where it cannot write."""
    content = {
        "format": _FORMAT,
        "model": estimator.model.identifier,
        "terms": estimator.model.terms,
        "parameters": parameters_json(estimator)["parameters"],
        "learnt": {name: getattr(estimator.learning.least_squares.state, name).tolist() for name in _LEARNT},
    }
    if not str(path):
        raise InputError("the path is empty: give that of the file to write")
    path = Path(path)
    try:
        write_whole(path, json.dumps(content, allow_nan=False))
    except OSError as error:
        raise InputError(f"cannot write the model to {path}: {error.strerror}") from None
    except ValueError:
        raise InputError("the model has numbers that are not finite and is not saved: reset it") from None


def load_model(estimator: Identifier, path: str | Path) -> str:
    """Go on from a saved model; returns its id. Raises InputError when it is damaged or has other terms."""
    try:
        content = json.loads(Path(path).read_text(encoding="utf8"))
    except (OSError, ValueError):
        raise InputError(f"cannot read a model from {path}: give a file written by save_model") from None
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise InputError(f"{path} is not a model of this program: give a file written by save_model")
    try:
        terms = model_from_terms(content["terms"], estimator.model.inputs).terms
        nothing = {"vane_covariance": estimator.learning.least_squares.new_state(estimator.model).vane_covariance}
        saved = nothing | content["learnt"]  # an older file does not have it
        learnt = {name: np.array(saved[name], dtype=np.float64) for name in _LEARNT}
    except (KeyError, TypeError, ValueError):
        raise InputError(f"the model file {path} is damaged: save it again") from None
    if terms != estimator.model.terms:
        raise InputError(
            f"the model in {path} has other terms than the aircraft file: load it with its own aircraft file"
        )
    _check_shapes(estimator, learnt, path)
    estimator.reset()
    for name, array in learnt.items():
        getattr(estimator.learning.least_squares.state, name)[:] = array
    return estimator.model.identifier


def _check_shapes(estimator: Identifier, learnt: dict[str, Any], path: str | Path) -> None:
    for name, array in learnt.items():
        if array.shape != getattr(estimator.learning.least_squares.state, name).shape or not np.all(np.isfinite(array)):
            raise InputError(f"the model file {path} is damaged or was saved with other options: save it again")


def parameters_json(estimator: Identifier) -> dict[str, Any]:
    """The content of parameters.json."""
    estimates = estimator.snapshot()
    return {
        "model": estimates.model,
        "estimator": estimator.learning.published,
        "parameters": [
            {
                "name": p.name,
                "value": _number(p.value),
                "std": _number(p.std),
                "status": p.status.name,
                "reason": p.reason,
                "age": _number(p.age),
                "excitation": _number(p.excitation),
            }
            for p in estimates.parameters
        ],
        "changes": [
            {"axis": axis, "time": t, "count": count} for axis, t, count in estimator.learning.changes.alarms()
        ],
    }


def _number(value: float) -> float | None:
    """JSON has no NaN: null says that it is not known."""
    return float(value) if np.isfinite(value) else None
