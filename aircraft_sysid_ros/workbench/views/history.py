"""Model versions of a run: where each came from, what it has, and its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.diagnosis.model_versions.labels import Label, Labels, newest
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
    label: Label = field(default_factory=Label)

    @property
    def title(self) -> str:
        """Its id with its name, or what it is."""
        return f"{self.identifier}, {self.label.name or self.words}"


def history(
    versions: Sequence[Version], current: str, comparisons: Mapping[str, Comparison], labels: Labels
) -> list[VersionRow]:
    """Versions in the order in which they were made, with the newest of their labels."""
    called = newest(labels)
    return [
        VersionRow(
            version.identifier,
            version_words(version),
            version.parents,
            version.identifier == current,
            tuple(axis_rows(comparisons[version.identifier])) if version.identifier in comparisons else (),
            called.get(version.identifier, Label()),
        )
        for version in versions
    ]


def version_words(version: Version) -> str:
    """What a version is, against the first one."""
    parts = [change_words(label, change) for label, change in version.changes.items()]
    return ", ".join(parts) if parts else "as it was"


def change_words(label: str, change: Change) -> str:
    """One change in words."""
    return f"without {label}" if is_removal(change) else f"with {label}"


def is_removal(change: Change) -> bool:
    """Whether it is terms of the first version that have gone, and nothing that was added."""
    return bool(change.without) and not (change.terms or change.settings)


def changed_from_first(changes: Mapping[str, Change]) -> list[str]:
    """What a version has that the first one has not, and what has gone from that, in words."""
    added = [effect_name(label) for label, change in changes.items() if not is_removal(change)]
    gone = [label for label, change in changes.items() if is_removal(change)]
    return [f"{word} {', '.join(names)}" for word, names in (("with", added), ("without", gone)) if names]


def effect_name(label: str) -> str:
    """Name of an effect of the library, or the terms themselves."""
    return BY_ID[label].name if label in BY_ID else label
