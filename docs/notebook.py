"""Run the cells of a notebook of docs/notebooks in an empty folder and keep what they show in it.

    python docs/notebook.py [docs/notebooks/first_flight.ipynb]

A notebook is JSON (nbformat 4): its cells are plain Python here, so that the standard library is enough to run them.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import io
import json
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

NOTEBOOK = Path(__file__).parent / "notebooks" / "first_flight.ipynb"


def code_of(cell: dict[str, Any]) -> str:
    """The text of a cell."""
    return "".join(cell["source"])


def run(cell: dict[str, Any], names: dict[str, Any]) -> list[dict[str, Any]]:
    """Run a code cell in a namespace; returns its outputs: what it prints, and the value of its last expression."""
    tree, said = ast.parse(code_of(cell)), io.StringIO()
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(said):
        exec(compile(tree, "cell", "exec"), names)
        value = eval(compile(ast.Expression(last.value), "cell", "eval"), names) if last else None
    outputs: list[dict[str, Any]] = []
    if said.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": _lines(said.getvalue())})
    if value is not None:
        shown = {"text/plain": _lines(repr(value))}
        if html := getattr(value, "_repr_html_", lambda: None)():
            shown["text/html"] = _lines(html)
        number = cell["execution_count"]
        outputs.append({"output_type": "execute_result", "execution_count": number, "metadata": {}, "data": shown})
    return outputs


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


@contextlib.contextmanager
def _inside(folder: str) -> Iterator[None]:
    before = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def executed(content: dict[str, Any], folder: str, until: Callable[[str], bool] = lambda code: False) -> dict[str, Any]:
    """The notebook with the outputs of its cells, run in a folder; cells from ``until`` on stay as they are."""
    names: dict[str, Any] = {"__name__": "__main__"}
    with _inside(folder):
        for number, cell in enumerate((c for c in content["cells"] if c["cell_type"] == "code"), 1):
            if until(code_of(cell)):
                break
            cell["execution_count"] = number
            cell["outputs"] = run(cell, names)
    return content


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("notebook", nargs="?", type=Path, default=NOTEBOOK)
    path = parser.parse_args().notebook
    content = json.loads(path.read_text(encoding="utf8"))
    with tempfile.TemporaryDirectory() as folder:
        content = executed(content, folder)
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
