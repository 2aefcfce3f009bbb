"""Model versions of a run: where each came from, what it has, and its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.diagnosis.model_versions.versions import Change, Version
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.workbench.views.coefficients import AxisRow, axis_rows


@dataclass(frozen=True)
class VersionRow:
    """One version in the history."""

    identifier: str
    words: str
    parents: tuple[str, ...]
    is_current: bool
    axes: tuple[AxisRow, ...]  # empty where the version cannot be compared


def history(versions: Sequence[Version], current: str, comparisons: Mapping[str, Comparison]) -> list[VersionRow]:
    """Versions in the order in which they were made."""
    return [
        VersionRow(
            version.identifier,
            version_words(version),
            version.parents,
            version.identifier == current,
            tuple(axis_rows(comparisons[version.identifier])) if version.identifier in comparisons else (),
        )
        for version in versions
    ]


def version_words(version: Version) -> str:
    """What a version is, against the first one."""
    parts = [change_words(label, change) for label, change in version.changes.items()]
    return ", ".join(parts) if parts else "as it was"


def change_words(label: str, change: Change) -> str:
    """One change in words."""
    if change.without and not (change.terms or change.settings):
        return f"without {label}"
    return f"with {label}"


def effect_name(label: str) -> str:
    """Name of an effect of the library, or the terms themselves."""
    return BY_ID[label].name if label in BY_ID else label
