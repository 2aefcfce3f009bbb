"""matplotlib as every figure uses it: into files, without a screen."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from aircraft_sysid_ros.installation import MissingExtra

#: A legend over the right end of a plot, where it hides no curve.
ABOVE: dict[str, Any] = {
    "loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.2, "ncols": 2, "frameon": False,
}  # fmt: skip


def pyplot() -> ModuleType:
    """The module ``matplotlib.pyplot``. Raises MissingExtra where it is not installed."""
    try:
        import matplotlib
    except ImportError:
        raise MissingExtra("pictures", "matplotlib", "report") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot
