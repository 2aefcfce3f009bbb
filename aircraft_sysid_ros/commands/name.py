"""``name``: what a version of the model of a run is called, with a note; without NAME all versions with theirs.

A name is taken wherever the id of a version is. ``--undo`` gives the version the name and the note that it had before.
"""

from __future__ import annotations

import argparse
from typing import Any

from aircraft_sysid_ros.diagnosis.model_versions.labels import Label, newest, read_labels
from aircraft_sysid_ros.diagnosis.model_versions.naming import name_version, take_name_back
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run, versions_of
from aircraft_sysid_ros.errors import InputError


def add_parser(subparsers: Any) -> argparse.ArgumentParser:
    """Add the command; returns its parser."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "name", help="a name and a note for a version of the model", description=__doc__
    )
    parser.add_argument("run", metavar="RUN", help="folder written by replay or live")
    parser.add_argument("name", metavar="NAME", nargs="?", help="its name; an empty one removes the name")
    parser.add_argument("--model", metavar="ID", help="id or name of the version (default: the current one)")
    parser.add_argument("--note", metavar="TEXT", help="what to know about it (default: the note that it has)")
    parser.add_argument("--undo", action="store_true", help="name and note as they were before")
    return parser


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Name, or list; returns all versions with their names. Raises InputError."""
    if args.undo and (args.name is not None or args.note is not None):
        raise InputError("--undo takes no name and no note: it brings back those that were there before")
    if args.name is None and args.note is not None:
        raise InputError("a note needs its name: give NAME with --note")
    changed = None
    if args.undo:
        changed, _ = take_name_back(args.run, args.model)
    elif args.name is not None:
        changed, _ = name_version(args.run, args.model, args.name, args.note)
    opened = open_run(args.run)
    labels, (versions, notes) = newest(read_labels(opened.path)), versions_of(opened)
    listed = [
        {
            "model": version.identifier,
            "name": labels.get(version.identifier, Label()).name,
            "note": labels.get(version.identifier, Label()).note,
            "is_current": version.identifier == opened.current.identifier,
        }
        for version in versions
    ]
    return {"changed": changed, "versions": listed, "notes": notes}


def render(result: dict[str, Any]) -> str:
    """The result for people."""
    lines = []
    for version in result["versions"]:
        current = ", the current version" if version["is_current"] else ""
        lines.append(f"{version['model']}  {version['name'] or '(no name)'}{current}")
        lines += [f"          {line}" for line in version["note"].splitlines()]
    return "\n".join([*lines, *(f"note: {note}" for note in result["notes"])])
