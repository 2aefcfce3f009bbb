"""matplotlib as every figure uses it: into files, without a screen."""

from __future__ import annotations

from types import ModuleType

from aircraft_sysid_ros.installation import MissingExtra


def pyplot() -> ModuleType:
    """The module ``matplotlib.pyplot``. Raises MissingExtra where it is not installed."""
    try:
        import matplotlib
    except ImportError:
        raise MissingExtra("pictures", "matplotlib", "report") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot
