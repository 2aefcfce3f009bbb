"""Every equation that is cited stands in docs/references.md, and every name in docs/symbols.md exists in the code."""

import ast
import importlib
import inspect
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

PACKAGE = "aircraft_sysid_ros"
ROOT = Path(__file__).resolve().parents[1]
PAGES = ROOT / "docs"
FOLDERS = (PACKAGE, "benchmarks", "docs", "examples", "test")
CODE = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))
#: Tables that docs/build.py writes come from strings of the code, which are read there.
GENERATED = re.compile(r"<!-- table \w+ -->.*?<!-- end -->", re.DOTALL)

#: (4.12): an equation of the summary. (37), (A2), (B5): one of the two-stage paper.
OF_SUMMARY = re.compile(r"(?<!\w)\(([1-6]\.\d{1,2})\)")
OF_PAPER = re.compile(r"(?<![\w\])])\((\d{1,2}|[AB]\d{1,2})\)")
BETWEEN = re.compile(r"\(([1-6]\.|[AB]?)(\d{1,2})\)(?:-| to )\(\1(\d{1,2})\)")
THE_PAPER = "two-stage paper"
COMMENT_THAT_CITES = re.compile(rf"#.*(?:\((?:[1-6]\.)?[AB]?\d{{1,2}}\)|{THE_PAPER})")


def strings_of(source: str) -> Iterator[str]:
    """Docstrings, other strings and comments of a Python file."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
    if not COMMENT_THAT_CITES.search(source):  # most files: to take one apart costs much
        return
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.string


@cache
def written() -> dict[str, str]:
    """What the code and the pages say, by file."""
    texts = {str(path.relative_to(ROOT)): "\n".join(strings_of(path.read_text(encoding="utf8"))) for path in CODE}
    for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(PAGES.glob("*.md"))]:
        texts[str(path.relative_to(ROOT))] = GENERATED.sub("", path.read_text(encoding="utf8"))
    del texts["docs/references.md"], texts["test/test_references.py"]
    return texts


def cited(text: str, pattern: re.Pattern[str]) -> set[str]:
    """Numbers of the equations that a text cites; (4.12)-(4.14) and (7) to (13) are all in between as well."""
    ranges = [f"({match[1]}{i})" for match in BETWEEN.finditer(text) for i in range(int(match[2]), int(match[3]) + 1)]
    return {number for part in [text, *ranges] for number in pattern.findall(part)}


@cache
def listed() -> set[str]:
    """Numbers that docs/references.md has a row for."""
    rows = [line.split("|")[1] for line in (PAGES / "references.md").read_text(encoding="utf8").splitlines()
            if line.startswith("| (")]  # fmt: skip
    return {number for first in rows for number in re.findall(r"\(([\w.]+)\)", first)}


def test_citations_are_read_as_they_are_written():
    text = "(4.12)-(4.14), (3.9) and alpha(1.5); (B4)-(B6), (7) to (9), x[k](2), shape (3,)"
    assert cited(text, OF_SUMMARY) == {"4.12", "4.13", "4.14", "3.9"}
    assert cited(text, OF_PAPER) == {"B4", "B5", "B6", "7", "8", "9"}


def without_empty(found: dict[str, set[str]]) -> dict[str, set[str]]:
    return {name: numbers for name, numbers in found.items() if numbers}


@pytest.mark.long
def test_every_cited_equation_of_the_summary_is_listed():
    known = listed()
    assert without_empty({name: cited(text, OF_SUMMARY) - known for name, text in written().items()}) == {}


@pytest.mark.long
def test_every_cited_equation_of_the_paper_is_listed():
    known = listed()
    texts = {name: text for name, text in written().items() if THE_PAPER in text}
    assert len(texts) > 20
    assert without_empty({name: cited(text, OF_PAPER) - known for name, text in texts.items()}) == {}


def test_a_file_that_cites_the_paper_names_it():
    """Elsewhere a lone number of one digit is a shape or a count; nothing else may stand so."""
    texts = {name: text for name, text in written().items() if THE_PAPER not in text}
    found = {name: {number for number in cited(text, OF_PAPER) if len(number) > 1} for name, text in texts.items()}
    assert without_empty(found) == {}, f"say in the file that these are equations of the {THE_PAPER}"


# -- symbols -----------------------------------------------------------------------------------------------------


def symbol_rows() -> list[list[str]]:
    """Rows of the tables of docs/symbols.md, the last cell holding names of the code."""
    lines = (PAGES / "symbols.md").read_text(encoding="utf8").splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines if line.startswith("| ")]
    return [row for row in rows if row[0] != "symbol"]


def names_of(row: list[str]) -> list[str]:
    return re.findall(r"`([^`]+)`", row[-1])


def has(owner: Any, name: str) -> bool:
    """An attribute, or a field of a dataclass, a named tuple or a record."""
    return hasattr(owner, name) or name in getattr(owner, "__annotations__", ())


def resolve(name: str) -> str | None:
    """What is wrong with a name such as `samples.Kind.IMU`, `module.function(argument)` or `module.NAMES["key"]`."""
    if "/" in name:
        return None if (ROOT / name).is_file() else f"no file {name}"
    path, argument, key = re.fullmatch(r'([\w.]+)(?:\((\w+)\))?(?:\["([^"]+)"\])?', name).groups()
    parts = path.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join([PACKAGE, *parts[:count]]))
            break
        except ModuleNotFoundError:
            continue
    else:
        return f"no module for {name}"
    for i, part in enumerate(parts[count:], count + 1):
        if not has(found, part):
            return f"{'.'.join(parts[:i])} does not exist"
        found = getattr(found, part, None)
    if argument and argument not in inspect.signature(getattr(found, "py_func", found)).parameters:
        return f"{path} has no argument {argument}"
    return f"{path} has no {key}" if key and key not in found else None


@pytest.mark.parametrize(
    "name",
    [
        "samples.Nothing", "no_such_module.x", "samples.concatenate(nothing)",
        'aircraft.expression.SIGNAL_INDEX["nothing"]', "benchmarks/nothing.py",
    ],
)  # fmt: skip
def test_a_name_that_does_not_exist_is_noticed(name):
    assert resolve(name)


def test_every_symbol_has_a_name_in_the_code_that_exists():
    rows = symbol_rows()
    assert len(rows) > 50 and all(len(row) == 5 and names_of(row) for row in rows)
    wrong = {name: resolve(name) for row in rows for name in names_of(row)}
    assert {name: reason for name, reason in wrong.items() if reason} == {}
