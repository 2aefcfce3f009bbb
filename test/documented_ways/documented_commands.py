"""Commands that the pages tell a user to type, and what the programs themselves say of them.

A line of a ```sh block, or an indented line that begins with a program, is typed as it stands; in a block with prompts
(`$ ros2 …`) the other lines are answers. In a sentence a command is typed where it begins with its program
(`aircraft-sysid simulate --out flight`); `replay --smooth` and `--smooth` alone are mentions, whose options must exist.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import io
import re
import runpy
import shlex
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import takewhile
from pathlib import Path
from unittest.mock import patch

from launch_files import launch_arguments

from aircraft_sysid_ros.commands.main import COMMANDS, build_parser

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "examples").glob("*/README.md")),
]
PROGRAMS = ("aircraft-sysid", "colcon", "make", "python", "python3", "ros2", "rosdep")
_HERE = ".venv/bin/"
#: Programs that only the environment has, or has with the packages.
IN_THE_ENVIRONMENT = ("aircraft-sysid", "python")
_PROMPT = "$ "
_SPAN = re.compile(r"`([^`]+)`")
_ALTERNATIVE = re.compile(rf": ((?:{'|'.join(COMMANDS)}) .+)")


@dataclass(frozen=True)
class Told:
    """A command on a page; ``is_typed`` as it stands, on a line of its own where ``is_block``, or mentioned only."""

    page: str
    line: int
    text: str
    is_typed: bool
    is_block: bool = False

    @property
    def words(self) -> list[str]:
        """Program, and what follows it; brackets around what may be left out are not typed."""
        words = shlex.split(re.sub(r"[\[\]]", "", self.text), comments=True)
        program = words[0].removeprefix(_HERE)
        if program in COMMANDS:
            return ["aircraft-sysid", program, *words[1:]]
        if program.endswith(".py"):
            return ["python", program, *words[1:]]
        return [program, *words[1:]]

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: {self.text}"


def _is_command(text: str) -> bool:
    return text.split(maxsplit=1)[0].removeprefix(_HERE) in PROGRAMS


def _lines(text: str) -> Iterator[tuple[int, str, str | None]]:
    """Number, line and language of the block that it stands in; lines that go on are joined, answers left out."""
    language, started, has_prompts = None, None, False
    lines = text.splitlines()
    for number, line in enumerate(lines, 1):
        if line.startswith("```"):
            language = None if language is not None else line[3:].strip()
            has_prompts = language is not None and lines[number].startswith(_PROMPT)
            continue
        if has_prompts and not line.startswith(_PROMPT):
            continue
        line = line.removeprefix(_PROMPT)
        first, whole = started or (number, "")
        whole += line
        if language == "sh" and line.endswith("\\"):
            started = first, whole[:-1]
            continue
        if language is None and line and whole.count("`") % 2:
            started = first, whole + " "
            continue
        started = None
        yield first, whole, language


def told_on(page: Path) -> Iterator[Told]:
    """Commands and mentions of a page, in their order."""
    name = page.relative_to(ROOT).as_posix()
    for number, line, language in _lines(page.read_text(encoding="utf8")):
        is_indented = language is None and line.startswith("    ") and _is_command(line)
        if line.strip() and (language == "sh" or is_indented):
            yield Told(name, number, line.strip(), is_typed=True, is_block=True)
            if other := _ALTERNATIVE.search(line.partition(" #")[2]):
                yield Told(name, number, other[1], is_typed=False)
        elif language is None:
            for span in _SPAN.findall(line):
                words = span.split()
                is_script = words[0].endswith(".py") and "/" in words[0]
                if len(words) > 1 and (_is_command(span) or is_script):
                    yield Told(name, number, span, is_typed=True)
                elif (len(words) > 1 and words[0] in COMMANDS) or re.match(r"--[a-z]", span):
                    yield Told(name, number, span, is_typed=False)


@cache
def told() -> tuple[Told, ...]:
    """Everything on all pages."""
    return tuple(one for page in PAGES for one in told_on(page))


def command_of(page: str, beginning: str) -> Told:
    """The first command of a page that begins so, `.venv/bin/` apart; fails where the page has none any more."""
    for one in told():
        if one.page == page and one.text.removeprefix(_HERE).startswith(beginning):
            return one
    raise AssertionError(f"{page} tells nobody to type '{beginning} …' any more: let the way follow the page")


def answer_to(one: Told) -> str:
    """What a page says is answered to a command behind a prompt."""
    following = (ROOT / one.page).read_text(encoding="utf8").splitlines()[one.line :]
    return "\n".join(takewhile(lambda line: not line.startswith((_PROMPT, "```")), following))


def python_blocks(page: str) -> list[str]:
    """The ```python blocks of a page."""
    return re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(encoding="utf8"), re.MULTILINE | re.DOTALL)


# -- what the programs say ---------------------------------------------------------------------------------------


@cache
def parser_of(command: str) -> argparse.ArgumentParser:
    """Parser of a command of aircraft-sysid."""
    (commands,) = (a for a in build_parser(command)._actions if isinstance(a, argparse._SubParsersAction))
    return commands.choices[command]


class _MadeError(Exception):
    """A script has made its parser."""


@cache
def parser_of_script(name: str) -> argparse.ArgumentParser:
    """Parser of a script, or of a module after -m: run until it reads its arguments."""

    def parse_args(parser: argparse.ArgumentParser, *_: object) -> None:
        raise _MadeError(parser)

    # a module by its file, since it may be imported already
    spec = None if name.endswith(".py") else importlib.util.find_spec(name)
    path = ROOT / name if spec is None else Path(str(spec.origin))
    with (
        patch.object(argparse.ArgumentParser, "parse_args", parse_args),
        patch.object(sys, "path", [str(path.parent), *sys.path]),
    ):
        try:
            runpy.run_path(str(path), run_name="__main__")
        except _MadeError as made:
            return made.args[0]
    raise AssertionError(f"{name} takes no arguments")


def _options(parser: argparse.ArgumentParser, words: list[str]) -> Iterator[str]:
    """What is wrong with the options among the words, or with the choice after one."""
    for word, following in zip(words, [*words[1:], ""], strict=False):
        if not word.startswith("--"):
            continue
        action = parser._option_string_actions.get(word)
        if action is None:
            yield f"{parser.prog} has no option {word}"
        elif action.choices and following and not following.startswith("-"):
            yield from (f"{word} cannot be {one}" for one in following.split("|") if one not in action.choices)


def _refusal(parser: argparse.ArgumentParser, words: list[str]) -> Iterator[str]:
    """What the parser says of the words where it refuses them."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        try:
            parser.parse_args(words)
        except SystemExit:
            yield said.getvalue().strip().splitlines()[-1]


def _wrong_command(words: list[str], is_typed: bool) -> Iterator[str]:
    if words and words[0] not in COMMANDS:
        yield f"aircraft-sysid has no command {words[0]}"
    elif words:
        check = _refusal if is_typed and len(words) > 1 else _options
        yield from check(parser_of(words[0]), words[1:])


def _wrong_script(words: list[str], is_typed: bool) -> Iterator[str]:
    name, *arguments = words[1:] if words[0] == "-m" else words
    if words[0] != "-m" and not (ROOT / name).is_file():
        yield f"there is no {name}"
    elif arguments and "--ros-args" not in arguments:  # a node takes what rclpy takes
        check = _refusal if is_typed else _options
        yield from check(parser_of_script(name), arguments)


def _wrong_target(words: list[str], _: bool) -> Iterator[str]:
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf8"), re.MULTILINE)
    yield from (f"the Makefile makes no {word}" for word in words if "=" not in word and word not in targets)


_ROS_COMMANDS = {("bag", "record"), ("param", "load"), ("param", "set"), ("service", "call"), ("topic", "echo")}


def _wrong_ros(words: list[str], _: bool) -> Iterator[str]:
    match words:
        case ["launch", "aircraft_sysid_ros", file, *given]:
            arguments = launch_arguments(ROOT / "launch" / file)
            missing = {name for name, default in arguments.items() if default is None}
            names = {word.partition(":=")[0] for word in given}
            yield from (f"{file} has no argument {name}" for name in names - set(arguments))
            yield from (f"{file} cannot do without {name}" for name in missing - names if given)
        case ["run", "aircraft_sysid_ros", executable, *_rest]:
            if f'"{executable} = ' not in (ROOT / "setup.py").read_text(encoding="utf8"):
                yield f"there is no executable {executable}"
        case [verb, noun, *_rest] if (verb, noun) in _ROS_COMMANDS:
            pass  # of ROS 2 itself
        case ["launch" | "run"]:
            pass
        case _:
            yield f"ros2 {' '.join(words)} is not understood"


_CHECKS: dict[str, Callable[[list[str], bool], Iterator[str]]] = {
    "aircraft-sysid": _wrong_command,
    "make": _wrong_target,
    "python": _wrong_script,
    "ros2": _wrong_ros,
}


def wrong_with(one: Told) -> list[str]:
    """What the programs have against a command or a mention."""
    if one.is_block and one.text.split()[0] in IN_THE_ENVIRONMENT:
        return [f"without {_HERE} a new terminal does not find it"]
    if one.text.startswith("--"):
        options = [word for word in one.text.split() if word.startswith("--") and not _is_known(word, one.page)]
        return [f"no command, and no script of this page, has {option}" for option in options]
    program, *words = one.words
    return list(_CHECKS.get(program, lambda *_: iter(()))(words, one.is_typed))


@cache
def _is_known(option: str, page: str) -> bool:
    """Whether a command, or a script that the page names, has the option."""
    scripts = {_script(other) for other in told() if other.page == page} - {None}
    return any(option in parser_of(command)._option_string_actions for command in COMMANDS) or any(
        option in parser_of_script(script)._option_string_actions for script in scripts
    )


def _script(one: Told) -> str | None:
    """Script, or module after -m, that a command runs; nodes have no options."""
    words = [] if one.text.startswith("--") else one.words
    if words[:1] != ["python"] or "--ros-args" in words:
        return None
    return words[2] if words[1] == "-m" else words[1]


def shape(one: Told) -> frozenset[str]:
    """What makes a command another one: program, command, options, and choices; not the names of files."""
    program, *words = one.words
    if program == "aircraft-sysid" and words:
        parser = parser_of(words[0])
        chosen = {str(c) for a in parser._actions if a.choices for c in a.choices}
        return frozenset([program, words[0], *(w for w in words[1:] if w.startswith("-") or w in chosen)])
    if program == "ros2":
        return frozenset([program, *words[:3], *(w.partition(":=")[0] for w in words[3:] if ":=" in w)])
    return frozenset([program, *words[: 1 + (words[:1] == ["-m"])], *(w for w in words if w.startswith("--"))])
