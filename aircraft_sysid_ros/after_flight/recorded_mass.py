"""The mass that a recording has, where it has one."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.samples import Kind, Samples


def recorded_mass(samples: Samples) -> float | None:
    """Mass [kg] in the middle of what was recorded of it; None where nothing was."""
    mass = samples.values[samples.kind == Kind.MASS, 0]
    known = mass[np.isfinite(mass)]
    return float(np.median(known)) if len(known) else None
