"""What no aeroplane is beyond: bounds of the parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS

_BOUNDS, _BOUNDS_OF_TERMS = dict(THRESHOLDS.bounds), dict(THRESHOLDS.bounds_of_terms)


def physical_bounds(name: str) -> tuple[float, float]:
    """Lowest and highest value that aeroplanes have; infinite for terms that nobody has bounds for."""
    limit = _BOUNDS_OF_TERMS.get(name.partition("_")[2], np.inf)
    return _BOUNDS.get(name, (-limit, limit))


def check_bounds(bounds: Mapping[str, tuple[float, float]]) -> None:
    """Raises InputError where bounds of the aircraft file leave nothing of what aeroplanes have."""
    for name, (low, high) in bounds.items():
        lowest, highest = physical_bounds(name)
        if low >= highest or high <= lowest:
            have, given = f"{lowest:g} to {highest:g}", f"{low:g} to {high:g}"
            raise InputError(f"parameter_bounds {name} must overlap what aeroplanes have, {have}: {given} does not")
