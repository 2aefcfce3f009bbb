"""What ``refine`` has written beside the aircraft file of a version, and what of the run it contradicts."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.rounding import with_error
from aircraft_sysid_ros.run_reader import UNREADABLE

#: Filter error, which assumes less, comes last: it has the last word.
OUTPUT_ERROR, FILTER_ERROR = "output-error", "filter-error"
METHODS = (OUTPUT_ERROR, FILTER_ERROR)

#: Begin of the reason of a parameter that the run has with another value, and in USE.
OTHERWISE = "equation error of the same flight says"


def refined_name(method: str) -> str:
    """The file of a method, beside the aircraft file of its version."""
    return f"refined-{method}.json"


def says_otherwise(value: float) -> str:
    """The reason of a refined parameter that the run has in USE with a ``value`` beyond the errors of both."""
    return f"{OTHERWISE} {value:.3g}"


def with_contradictions(folder: Path, parameters: Mapping[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Parameters by name as in parameters.json of a version in its ``folder``; those that have USE there, with a value
    that a refinement contradicts, have HOLD and the reason. A file that cannot be read is no refinement.
    """
    doubted: dict[str, str] = {}
    for method in METHODS:
        for name, refined in _refined(folder / refined_name(method)).items():
            known = parameters.get(name, {})
            if refined["status"] == Trust.USE.name:
                doubted.pop(name, None)
            elif known.get("status") == Trust.USE.name and refined["reason"] == says_otherwise(known["value"]):
                value = with_error(refined["value"], refined["std"])
                doubted[name] = f"{method} of this flight says {value}, beyond the errors of both: use neither value"
    held = {name: {"status": Trust.HOLD.name, "reason": reason} for name, reason in doubted.items()}
    return {name: {**p, **held.get(name, {})} for name, p in parameters.items()}


def _refined(file: Path) -> dict[str, dict[str, Any]]:
    """Refined parameters by name; none where there is no such file, or a damaged one."""
    try:
        listed = json.loads(file.read_text(encoding="utf8"))["parameters"]
        whole = ("name", "value", "std", "status", "reason")
        return {str(p["name"]): {key: p[key] for key in whole} for p in listed}
    except UNREADABLE:
        return {}
