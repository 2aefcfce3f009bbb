"""What no aeroplane is beyond: bounds of the parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aircraft_sysid_ros.errors import InputError

#: No aeroplane is beyond these, by axis and term: (lowest, highest).
PHYSICAL_BOUNDS: dict[str, tuple[float, float]] = {
    "CZ_alpha": (-15.0, 0.0), "CZ_q": (-60.0, 5.0), "Cm_q": (-200.0, 0.0),
    "Cl_p": (-3.0, 0.0), "Cn_r": (-3.0, 0.0), "CY_beta": (-5.0, 0.0),
    "Cm_alpha": (-20.0, 20.0), "Cn_beta": (-1.0, 2.0), "Cl_beta": (-2.0, 1.0), "CX_Tc": (0.4, 1.6),
}  # fmt: skip
#: The same by term, for axes and terms that are not named above; C_X,Tc is near 1 since T_c is the thrust itself.
_BOUNDS_BY_TERM = {
    "0": 3.0, "alpha": 20.0, "beta": 10.0, "p": 50.0, "q": 300.0, "r": 50.0, "de": 5.0, "da": 5.0, "dr": 5.0,
}  # fmt: skip


def physical_bounds(name: str) -> tuple[float, float]:
    """Lowest and highest value that aeroplanes have; infinite for terms that nobody has bounds for."""
    limit = _BOUNDS_BY_TERM.get(name.partition("_")[2], np.inf)
    return PHYSICAL_BOUNDS.get(name, (-limit, limit))


def check_bounds(bounds: Mapping[str, tuple[float, float]]) -> None:
    """Raises InputError where bounds of the aircraft file leave nothing of what aeroplanes have."""
    for name, (low, high) in bounds.items():
        lowest, highest = physical_bounds(name)
        if low >= highest or high <= lowest:
            have, given = f"{lowest:g} to {highest:g}", f"{low:g} to {high:g}"
            raise InputError(f"parameter_bounds {name} must overlap what aeroplanes have, {have}: {given} does not")
