"""Tables of the records of what decides, in docs/diagnosis.md and docs/trust.md."""

from __future__ import annotations

from typing import Any

from results import Rows

from aircraft_sysid_ros.diagnosis import thresholds as diagnosis
from aircraft_sysid_ros.identification import thresholds as identification
from aircraft_sysid_ros.threshold import thresholds_of

#: By the name of its table.
RECORDS: dict[str, Any] = {
    "diagnosis_thresholds": diagnosis.THRESHOLDS,
    "identification_thresholds": identification.THRESHOLDS,
}


def thresholds(record: Any) -> Rows:
    """Each with its value and the reason of it."""
    return ["threshold", "value", "why"], [
        [f"`{name}`", shown(value), why] for name, value, why in thresholds_of(record)
    ]


def shown(value: Any) -> str:
    """A number, or several of them; of a pair of a name and what it has, both."""
    if isinstance(value, tuple):
        apart = "; " if isinstance(value[0], tuple) else " " if isinstance(value[0], str) else ", "
        return apart.join(map(shown, value))
    return value if isinstance(value, str) else f"{value:g}"
