"""Write docs/licences.md: the licence of every package that ours brings, as the metadata of each states it.

    .venv/bin/python tools/licences.py

The packages are those that setup.py asks for, with what they ask for themselves, as far as they are installed.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "licences.md"
PROJECT = "aircraft_sysid_ros"
#: Not for using the program.
_OWN = ("docs", "test", "bench", "all")
_HEAD = """# Licences

aircraft_sysid_ros is under the [Apache License 2.0](../LICENSE). These packages come with it, as `tools/licences.py`
reads them from what is installed; the licence is what the metadata of each states, in its words, and nobody has checked
it against the sources. The wheels of ROS 2 state none: look into the repositories of ROS. "needed by" is empty for what
every command needs, else it names the extras of `setup.py`.

| package | version | licence | needed by |
|---|---|---|---|
"""


def licence_of(found: metadata.PathDistribution | metadata.Distribution) -> str:
    """The expression of the licence, or what the classifiers or the text say."""
    about = found.metadata
    if expression := about.get("License-Expression"):
        return str(expression)
    classifiers = [c.rsplit(" :: ", 1)[-1] for c in about.get_all("Classifier") or () if c.startswith("License ::")]
    text = (about.get("License") or "").strip().splitlines()
    said = [c for c in classifiers if c != "OSI Approved"] or [line.strip() for line in text[:1] if len(line) < 60]
    return ", ".join(said) or "not stated"


def required(name: str, extras: frozenset[str]) -> Iterator[Requirement]:
    """What a package asks for with its extras, on this machine."""
    for text in metadata.requires(name) or ():
        requirement = Requirement(text)
        marker = requirement.marker
        if marker is None or any(marker.evaluate({"extra": extra}) for extra in extras or {""}) or (
            extras and marker.evaluate({"extra": ""})
        ):  # fmt: skip
            yield requirement


def closure(extra: str) -> set[str]:
    """Names of all packages that an extra brings; "" is the package alone."""
    found: set[str] = set()
    left = [(PROJECT, frozenset({extra} if extra else ()))]
    seen = set(left)
    while left:
        name, extras = left.pop()
        try:
            for requirement in required(name, extras):
                other = re.sub(r"[-_.]+", "-", requirement.name).lower()
                metadata.version(other)
                found.add(other)
                if (pair := (other, frozenset(requirement.extras))) not in seen:
                    seen.add(pair)
                    left.append(pair)
        except metadata.PackageNotFoundError:  # not installed here, such as of another machine
            continue
    return found


def main() -> int:
    """Write the page."""
    extras = [e for e in metadata.metadata(PROJECT).get_all("Provides-Extra") or () if e not in ("all",)]
    everywhere = closure("")
    needed: dict[str, list[str]] = {name: [] for name in everywhere}
    for extra in sorted(extras, key=lambda each: (each in _OWN, each)):
        for name in closure(extra) - everywhere:
            needed.setdefault(name, []).append(extra)
    rows = []
    for name, by in sorted(needed.items()):
        found = metadata.distribution(name)
        licence = licence_of(found).replace("|", "\\|")
        rows.append(f"| {found.metadata['Name']} | {found.version} | {licence} | {', '.join(by)} |")
    PAGE.write_text(_HEAD + "\n".join(rows) + "\n", encoding="utf8")
    unsaid = sum("| not stated |" in row for row in rows)
    print(f"{PAGE.name}: {len(rows)} packages, {unsaid} of which state no licence")
    return 0


if __name__ == "__main__":
    sys.exit(main())
