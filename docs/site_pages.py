"""Hook of MkDocs: the pages that stand outside of docs/, what the program itself says, and the links between all.

README.md becomes the first page. A link of a page to a file of the repository leads to a copy of that file, so that
every link works in the site as it does in the repository. The comments of docs/commands.md and docs/messages.md are
replaced by what the parsers and the message definitions say.
"""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Iterator
from html import escape
from pathlib import Path, PurePosixPath
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from aircraft_sysid_ros.commands.main import COMMANDS, build_parser

ROOT = Path(__file__).resolve().parents[1]
#: Pages outside of docs/, and their names in the site.
OUTSIDE = {
    "README.md": "index.md",
    **{name: name for name in ("CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "QUALITY_DECLARATION.md")},
    **{
        (path := example.relative_to(ROOT).as_posix()): f"repository/{path}"
        for example in sorted((ROOT / "examples").glob("*/README.md"))
    },
}
_SOURCES = {site: source for source, site in OUTSIDE.items()}
_LINK = re.compile(r"(?<=\]\()([^)\s#]+)(#[^)\s]*)?(?=\))")
_FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
_SCHEME = re.compile(r"[a-z]+:")


def source_of(uri: str) -> PurePosixPath:
    """Where a page of the site stands in the repository."""
    return PurePosixPath(_SOURCES.get(uri, f"docs/{uri}"))


def site_path(path: PurePosixPath) -> str:
    """Where a file of the repository stands in the site."""
    if path.parts[:1] == ("docs",):
        return path.relative_to("docs").as_posix()
    return OUTSIDE.get(path.as_posix(), f"repository/{path}")


def _target(uri: str, link: str) -> PurePosixPath:
    """The file of the repository that a link of a page means."""
    return PurePosixPath(os.path.normpath(source_of(uri).parent / link))


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages outside of docs/, and every file of the repository that a page links to."""
    for source, site in OUTSIDE.items():
        files.append(File.generated(config, site, abs_src_path=str(ROOT / source)))
    for page in [file for file in files if file.src_uri.endswith(".md")]:
        text = _FENCE.sub("", page.content_string)
        for link in {found[1] for found in _LINK.finditer(text) if not _SCHEME.match(found[1])}:
            path = _target(page.src_uri, link)
            if (ROOT / path).is_file() and files.get_file_from_path(site_path(path)) is None:
                files.append(File.generated(config, site_path(path), abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links as they are in the site, and what the program says of itself."""
    uri = page.file.src_uri

    def led(found: re.Match[str]) -> str:
        if _SCHEME.match(found[1]):
            return found[0]
        there = site_path(_target(uri, found[1]))
        return os.path.relpath(there, PurePosixPath(uri).parent).replace(os.sep, "/") + (found[2] or "")

    markdown = _LINK.sub(led, markdown)
    for name, made in (("options of every command", all_commands), ("definitions", definitions)):
        if (marker := f"<!-- {name} -->") in markdown:
            markdown = markdown.replace(marker, "\n\n".join(made()))
    return markdown


# -- what the program says ---------------------------------------------------------------------------------------


def all_commands() -> Iterator[str]:
    """A section for each command: what it does, how it is called, and its options."""
    for name, (_, purpose) in COMMANDS.items():
        (subparsers,) = (a for a in build_parser(name)._actions if isinstance(a, argparse._SubParsersAction))
        parser = subparsers.choices[name]
        parser.prog = f"aircraft-sysid {name}"
        usage = parser.format_usage().removeprefix("usage: ").strip()
        yield f"## {name}\n\n{escape((parser.description or purpose).strip())}\n\n```text\n{usage}\n```"
        rows = [
            f"| {_called(action)} | {_told(parser, action)} |" for action in parser._actions if action.dest != "help"
        ]
        yield "\n".join(["| argument | meaning |", "|---|---|", *rows])


def _called(action: argparse.Action) -> str:
    """An option as it is typed, or a positional argument."""
    if not action.option_strings:
        return f"`{action.metavar or action.dest}`"
    value = "" if action.nargs == 0 else f" {action.metavar or action.dest.upper()}"
    return ", ".join(f"`{option}{value}`" for option in action.option_strings)


def _told(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    """What --help says of an argument."""
    help_text = parser._get_formatter()._expand_help(action) if action.help else ""
    choices = f" ({', '.join(map(str, action.choices))})" if action.choices and not action.metavar else ""
    return escape(f"{help_text}{choices}".replace("\n", " ")).replace("|", "\\|").replace("[", "\\[")


def definitions() -> Iterator[str]:
    """A section for each message and each service, with its definition."""
    for kind, title in (("msg", "Messages"), ("srv", "Services")):
        yield f"## {title}"
        for file in sorted((ROOT / "msg_defs" / kind).glob(f"*.{kind}")):
            yield f"### {file.stem}\n\n```text\n{file.read_text(encoding='utf8').strip()}\n```"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Where mkdocstrings finds the package."""
    handlers: dict[str, Any] = config.plugins["mkdocstrings"].config["handlers"]
    handlers["python"]["paths"] = [str(ROOT)]
    return config
