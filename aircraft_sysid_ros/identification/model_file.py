"""A learnt model in a file: parameters for people, and the sums with which the recursion goes on.

Whoever can call the services of a node names such files: they lie in one folder, ``in_folder`` lets no name leave it,
and nothing is ever overwritten.
"""

from __future__ import annotations

import json
import os
import re
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, model_from_terms
from aircraft_sysid_ros.errors import InputError, echo
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.option import shown
from aircraft_sysid_ros.text_file import write_new

_FORMAT = "aircraft_sysid_ros model 1"
#: Of a model, in the folder of a node.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
#: [bytes] A hundred terms have less than one.
_LARGEST = 10_000_000
#: Of what is said of an axis.
_LONGEST_WORDS = 200
_LEARNT = ("theta", "p", "sums", "noise_square", "updates")
#: What older files do not have.
_LEARNT_LATER = ("vane_covariance", "sampling", "bias_variance", "prior", "prior_variance")


def in_folder(folder: str | Path, name: str) -> Path:
    """Where a model of that name is in the folder of a node. Raises InputError for what is more than a name."""
    if not _NAME.fullmatch(name):
        raise InputError(
            f"a model is given by name and not by path, not {shown(name)}: letters, digits, . _ and -, such as "
            f"cruise.json; it is in {folder}"
        )
    return Path(folder).expanduser() / name


def save_model(estimator: Identifier, path: str | Path) -> None:
    """Write terms, parameters and the state of the recursion into a new file; InputError where it cannot write."""
    learnt = estimator.learning.believed()
    content = {
        "format": _FORMAT,
        "model": estimator.model.identifier,
        "terms": estimator.model.terms,
        "parameters": parameters_json(estimator)["parameters"],
        "learnt": {name: getattr(learnt, name).tolist() for name in (*_LEARNT, *_LEARNT_LATER)},
        "sensors": {name: sums.tolist() for name, sums in estimator.learning.undescribed.sums.items()},
        "lack_of_fit": estimator.learning.integrity.doubts.lack_of_fit,
    }
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_new(path, json.dumps(content, allow_nan=False))
    except FileExistsError:
        raise InputError(f"{path} is already there and is not overwritten: give another name") from None
    except OSError as error:
        raise InputError(f"cannot write the model to {path}: {error.strerror}") from None
    except ValueError:
        raise InputError("the model has numbers that are not finite and is not saved: reset it") from None


def _read(path: Path) -> Any:
    """JSON of a file that is one itself, and no link, device or pipe. Raises OSError, ValueError or RecursionError."""
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode) or status.st_size > _LARGEST:
            raise ValueError("not a model file")
        return json.loads(file.read(_LARGEST))


def load_model(estimator: Identifier, path: str | Path) -> str:
    """Go on from a saved model; returns its id. Raises InputError when it is damaged or has other terms."""
    try:
        content = _read(Path(path))
    except (OSError, ValueError, RecursionError):
        raise InputError(f"cannot read a model from {path}: give a file written by save_model") from None
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise InputError(f"{path} is not a model of this program: give a file written by save_model")
    try:
        terms = model_from_terms(content["terms"], estimator.model.inputs).terms
        nothing = estimator.learning.least_squares.new_state(estimator.model)
        saved = {name: getattr(nothing, name) for name in _LEARNT_LATER} | content["learnt"]
        learnt = {name: np.array(saved[name], dtype=np.float64) for name in (*_LEARNT, *_LEARNT_LATER)}
        sensors = {name: np.array(sums, dtype=np.float64) for name, sums in content.get("sensors", {}).items()}
        said = {axis: echo(str(words), _LONGEST_WORDS) for axis, words in content.get("lack_of_fit", {}).items()}
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InputError(f"the model file {path} is damaged: save it again") from None
    if terms != estimator.model.terms:
        raise InputError(
            f"the model in {path} has other terms than the one that flies: {_difference(terms, estimator)}"
        )
    _check_shapes(estimator, learnt, sensors, path)
    estimator.reset()
    estimator.learning.take(learnt, sensors, {axis: said[axis] for axis in AXES if axis in said})
    return estimator.model.identifier


def _difference(terms: Mapping[str, tuple[str, ...]], estimator: Identifier) -> str:
    """What a saved model has and lacks beside that of an estimator, and what to do, in words."""
    own = estimator.model.terms
    more = [f"{axis}: {text}" for axis, texts in terms.items() for text in texts if text not in own[axis]]
    less = [f"{axis}: {text}" for axis, texts in own.items() for text in texts if text not in terms[axis]]
    parts = [f"{verb} {shown('; '.join(listed))}" for verb, listed in (("adds", more), ("lacks", less)) if listed]
    return f"it {' and '.join(parts) or 'has them in another order'}: change the model first, or use its aircraft file"


def _check_shapes(estimator: Identifier, learnt: dict[str, Any], sensors: dict[str, Any], path: str | Path) -> None:
    own = estimator.learning.undescribed.sums
    for name, array in sensors.items():
        if name not in own or array.shape != own[name].shape or not np.all(np.isfinite(array)):
            raise InputError(f"the model file {path} is damaged or was saved with another aircraft file: save it again")
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
        **_beside_earlier_flights(estimator),
        **_late_surfaces(estimator),
        **_of_sensors(estimator),
        "lack_of_fit": estimator.learning.integrity.doubts.lack_of_fit,
        "changes": [
            {"axis": axis, "time": t, "count": count} for axis, t, count in estimator.learning.changes.alarms()
        ],
    }


def _beside_earlier_flights(estimator: Identifier) -> dict[str, Any]:
    """What came of the prior of a fleet, and what is wrong with the aeroplane beside it; nothing without one."""
    learning = estimator.learning
    return {"prior": learning.fleet.json, "health": learning.health.json} if learning.fleet.is_there else {}


def _late_surfaces(estimator: Identifier) -> dict[str, Any]:
    """What the flight has shown of late surfaces [s], and one sigma; nothing where it has not."""
    found = estimator.learning.late_surfaces
    late = {key: {"value": value, "std": std} for key, (value, std) in found.items()}
    return {"late_surfaces": late} if late else {}


def _of_sensors(estimator: Identifier) -> dict[str, Any]:
    """What sensors that nobody described leave in doubt of each parameter; nothing where all are described."""
    std = estimator.std_of_sensors()
    of_each = {name: float(s) for name, s in zip(estimator.model.parameter_names, std, strict=True) if s > 0.0}
    return {"std_of_sensors": {name: s for name, s in of_each.items() if np.isfinite(s)}} if of_each else {}


def _number(value: float) -> float | None:
    """JSON has no NaN: null says that it is not known."""
    return float(value) if np.isfinite(value) else None
