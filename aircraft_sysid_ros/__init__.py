"""Aerodynamic model identification of fixed-wing aircraft in flight, on ROS 2.

    import aircraft_sysid_ros as sysid

    run = sysid.replay("flight", "aircraft.yaml", out="runs/flight")
    print(sysid.compare(run).errors)

The calls are those of ``aircraft_sysid_ros.api``, which is imported when the first of them is asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.2.0"

#: Calls and classes of ``api``.
_OF_API = (
    "Addition", "Check", "Comparison", "Diagnosis", "Explanation", "InputError", "Recording", "Run", "TwoRuns",
    "add", "check", "compare", "diagnose", "explain", "import_log", "load", "record", "remove", "replay",
)  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _OF_API:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.api"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_OF_API])
