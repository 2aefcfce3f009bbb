"""Names and notes that people give to the versions of a run, in ``names.json`` of its folder, with those before.

    {"labels": {"3f2a91c4": [{"name": "with stall", "note": "second flight of the day"}, ...]}}

The newest stands last. A name tells one version of a run and is taken wherever its id is.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from aircraft_sysid_ros.errors import InputError, echo, one_line, without_control
from aircraft_sysid_ros.json_text import json_text
from aircraft_sysid_ros.run_reader import UNREADABLE
from aircraft_sysid_ros.text_file import write_whole

NAMES = "names.json"
#: Characters of a name and of a note, labels of one version that are kept, and bytes of a file that is read.
LONGEST_NAME, LONGEST_NOTE, _KEPT, _LARGEST = 60, 2000, 20, 4_000_000


@dataclass(frozen=True)
class Label:
    """What a version is called, and what is to be known of it; both may be empty."""

    name: str = ""
    note: str = ""


Labels = Mapping[str, tuple[Label, ...]]


def label_from(name: str, note: str) -> Label:
    """A label as a user gives it. Raises InputError where it is too long, or holds what does not print."""
    name, note = name.strip(), note.replace("\r\n", "\n").strip()
    if one_line(name) != name or without_control(note) != note:
        raise InputError("a name is one line, and neither it nor a note holds characters that do not print")
    for what, text, longest in (("name", name, LONGEST_NAME), ("note", note, LONGEST_NOTE)):
        if len(text) > longest:
            raise InputError(f"the {what} has {len(text)} characters: at most {longest} are allowed")
    return Label(name, note)


def read_labels(folder: Path) -> dict[str, tuple[Label, ...]]:
    """All labels of all versions by id, the newest last. Raises InputError where the file cannot be read."""
    path = folder / NAMES
    try:
        if not path.exists():
            return {}
        if path.stat().st_size > _LARGEST:
            raise ValueError("too large")
        content = json.loads(path.read_text(encoding="utf8"))["labels"]
        return {
            str(version): tuple(label_from(str(each["name"]), str(each["note"])) for each in listed)
            for version, listed in content.items()
        }
    except UNREADABLE:
        raise InputError(f"{path} is damaged: remove it, and name the versions again") from None


def newest(labels: Labels) -> dict[str, Label]:
    """The label of each version that has one."""
    return {version: listed[-1] for version, listed in labels.items() if listed and listed[-1] != Label()}


def named(labels: Labels, name: str) -> str | None:
    """The id of the version that is called so."""
    return next((version for version, label in newest(labels).items() if label.name and label.name == name), None)


def write_labels(folder: Path, labels: Labels) -> None:
    """Replace the file. Raises InputError where it cannot be written."""
    content = {version: [asdict(each) for each in listed[-_KEPT:]] for version, listed in labels.items() if listed}
    try:
        write_whole(folder / NAMES, json_text({"labels": content}) + "\n")
    except OSError as error:
        raise InputError(f"cannot write to the run {folder}: {error.strerror or error}") from None


def check_free(labels: Labels, identifiers: list[str], version: str, name: str) -> None:
    """Raises InputError where another version has that name, or has it as its id."""
    other = named(labels, name) if name else None
    if other not in (None, version) or (name in identifiers and name != version):
        raise InputError(f"'{echo(name)}' is another version of this run already: choose another name")
