"""A run read for export: its model version, and the rows that the second step learnt from."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT
from aircraft_sysid_ros.diagnosis.model_versions.versions import Run, Version, released_parameters
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.export.learnt_model import LearntModel, Parameter
from aircraft_sysid_ros.identification.coefficients.as_loaded import as_loaded
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.run_reader import PARAMETERS, POINTS, UNREADABLE, not_a_run, read_points


def learnt_model(run: Run, version: Version) -> LearntModel:
    """Its aircraft has the mass properties of the recording, where that has some, as its coefficients have.

    Raises InputError where the run is damaged, holds nothing to use, or is of another model.
    """
    model = version.aircraft.model
    try:
        listed, points = released_parameters(run, version), read_points(run.path)
    except UNREADABLE:
        if version.identifier == run.root.model.identifier:
            raise not_a_run(run.path) from None
        raise InputError(
            f"{PARAMETERS} of the model version {version.identifier} in {run.path} is damaged: remove that version "
            "and add the effect again"
        ) from None
    parameters = tuple(_parameter(name, listed.get(name, {})) for name in model.parameter_names)
    if not any(p.status == Trust.USE.name for p in parameters):
        ((why, _),) = Counter(p.reason for p in parameters if p.reason).most_common(1) or [("", 0)]
        raise InputError(
            f"the model {version.identifier} of {run.path} has no parameter with USE{f' ({why})' if why else ''}: "
            "fly manoeuvres that determine some, and replay again"
        )
    if tuple(map(str, points["signal_names"])) != model.signal_names:
        raise InputError(f"{run.path} was written by another version of this program: replay the recording again")
    learnt = np.asarray(points.get("learnt", points["valid"]), dtype=np.bool_).any(axis=1)
    if learnt.sum() < 2:
        raise InputError(
            f"{POINTS} of {run.path} has no rows that the model was learnt from: replay the recording again"
        )
    rows = np.full((int(learnt.sum()), SIGNAL_COUNT), np.nan)
    rows[:, : len(model.signal_names)] = points["signals"][learnt]
    step = float(np.median(np.diff(points["stamp"]))) * 1e-9
    return LearntModel(as_loaded(version.aircraft, run.samples), version.identifier, parameters, rows, step)


def _parameter(name: str, content: dict[str, Any]) -> Parameter:
    value, std = (np.nan if content.get(key) is None else float(content[key]) for key in ("value", "std"))
    return Parameter(name, value, std, str(content.get("status", Trust.HOLD.name)), str(content.get("reason", "")))
