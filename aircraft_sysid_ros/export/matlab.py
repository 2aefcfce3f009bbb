"""The model as a .mat file (MATLAB 5, which Octave and scipy read too): one struct ``model``, see docs/export.md."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.io import savemat

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.export.exported import Exported
from aircraft_sysid_ros.export.learnt_model import LearntModel

#: Longest name of a variable in MATLAB, and of a field in this format.
_LONGEST = 31


def export_matlab(learnt: LearntModel) -> Exported:
    """Raises nothing: every model fits."""
    aircraft = learnt.aircraft
    content: dict[str, Any] = {
        "name": aircraft.name,
        "id": learnt.identifier,
        "warning": "outside of model.range the model is not known to hold",
        "geometry": {
            "mass": aircraft.mass, "wing_area": aircraft.wing_area, "span": aircraft.span, "chord": aircraft.chord,
            "inertia": aircraft.inertia, "aerodynamic_reference": aircraft.aerodynamic_reference,
        },
        "parameter": np.array([p.name for p in learnt.parameters], dtype=object),
        "value": np.array([p.value for p in learnt.parameters]),
        "standard_error": learnt.std,
        "status": np.array([p.status for p in learnt.parameters], dtype=object),
        "covariance": learnt.covariance,
        "terms": {axis: np.array(learnt.model.terms[axis], dtype=object) for axis in AXES},
        "coefficients": _fields({p.name: p.value for p in learnt.parameters}),
        "range": _fields({name: np.array(limits) for name, limits in learnt.ranges.items()}),
    }  # fmt: skip
    out = io.BytesIO()
    savemat(out, {"model": content}, oned_as="column")
    return Exported(out.getvalue())


def _fields(content: Mapping[str, Any]) -> dict[str, Any]:
    """Names that MATLAB takes: what it does not is written as an underscore; a number tells equal ones apart."""
    out: dict[str, Any] = {}
    for name, value in content.items():
        field = re.sub(r"\W", "_", name)[:_LONGEST]
        out[field if field not in out else f"{field[: _LONGEST - 4]}_{len(out)}"] = value
    return out
