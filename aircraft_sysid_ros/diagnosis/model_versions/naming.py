"""Call a version of a run something, with a note, and take that back."""

from __future__ import annotations

from pathlib import Path

from aircraft_sysid_ros.diagnosis.model_versions.labels import (
    Label,
    check_free,
    label_from,
    read_labels,
    write_labels,
)
from aircraft_sysid_ros.diagnosis.model_versions.versions import Run, changing, open_run, version_named, versions_of
from aircraft_sysid_ros.errors import InputError


def _asked(path: str | Path, which: str | None) -> tuple[Run, str, dict[str, tuple[Label, ...]]]:
    """A run, the id of the version that is meant, and all labels."""
    run = open_run(path)
    version = run.current.identifier if which is None else version_named(run, which).identifier
    return run, version, read_labels(run.path)


def name_version(path: str | Path, which: str | None, name: str, note: str | None = None) -> tuple[str, Label]:
    """Name a version, by its id or the name that it has, or the current one; None leaves the note as it is.

    Returns its id and the label. Raises InputError, and changes nothing, where that cannot be.
    """
    with changing(path):
        run, version, labels = _asked(path, which)
        before = labels.get(version, (Label(),))
        label = label_from(name, before[-1].note if note is None else note)
        check_free(labels, [each.identifier for each in versions_of(run)[0]], version, label.name)
        if label != before[-1]:
            write_labels(run.path, {**labels, version: (*before, label)})
        return version, label


def take_name_back(path: str | Path, which: str | None) -> tuple[str, Label]:
    """What the version was called before. Raises InputError where it was never called anything else."""
    with changing(path):
        run, version, labels = _asked(path, which)
        listed = labels.get(version, ())
        if len(listed) < 2:
            raise InputError(f"the version {version} was not named: there is nothing to undo")
        check_free(labels, [each.identifier for each in versions_of(run)[0]], version, listed[-2].name)
        write_labels(run.path, {**labels, version: listed[:-1]})
        return version, listed[-2]
