"""How much of the flight envelope was flown, and in how much of that the model holds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aircraft_sysid_ros.workbench.views.places import ResidualMap, top_of
from aircraft_sysid_ros.workbench.views.words import percent

#: Up to so many times the noise of the sensors a model holds in a cell: a residual that is noise has 1.
HOLDS = 1.5


def covered(found: ResidualMap) -> tuple[int, float]:
    """Cells that were flown, and the share of them in which the model holds; NaN where none was flown."""
    flown = found.times_noise[np.isfinite(found.times_noise)]
    return len(flown), float(np.mean(flown <= HOLDS)) if len(flown) else np.nan


def envelope_words(found: ResidualMap) -> str:
    """That in a sentence."""
    cells, share = covered(found)
    if not cells:
        return "no cell of this envelope was flown"
    return f"{cells} cells flown, in {percent(share)} % of them the residual is within {HOLDS:g} times the noise"


def shared_scale(maps: Sequence[ResidualMap]) -> float:
    """The end of one colour scale for several maps."""
    return max(top_of(found.times_noise) for found in maps)
