"""The notebook of docs runs, and what stands in it is what its cells show."""

from __future__ import annotations

import copy
import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "docs"))

from notebook import NOTEBOOK, code_of, executed, run


@pytest.fixture(scope="module")
def content():
    return json.loads(NOTEBOOK.read_text(encoding="utf8"))


def shown(content) -> list[str]:
    """The value of each code cell, as text."""
    cells = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
    return ["".join("".join(o["data"]["text/plain"]) for o in cell["outputs"] if "data" in o) for cell in cells]


def test_it_is_kept_with_its_outputs(content):
    assert (content["nbformat"], content["nbformat_minor"]) == (4, 4)
    cells = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert sum(map(bool, shown(content))) >= len(cells) - 1


@pytest.mark.long
def test_its_first_cells_show_what_stands_in_it(content, tmp_path):
    """As far as the comparison, which shows that C_Z lacks something."""
    made = executed(copy.deepcopy(content), str(tmp_path), until=lambda code: "sysid.diagnose" in code)
    until = next(i for i, cell in enumerate(made["cells"]) if "sysid.diagnose" in code_of(cell))
    count = sum(cell["cell_type"] == "code" for cell in made["cells"][:until])
    new, old = shown(made)[:count], shown(content)[:count]
    assert [len(text.splitlines()) for text in new] == [len(text.splitlines()) for text in old]
    assert "nrmse_held_out" in new[-1] and new[-1].split()[:4] == old[-1].split()[:4]


@pytest.mark.long
def test_the_whole_of_it_runs(content, tmp_path):
    made = executed(copy.deepcopy(content), str(tmp_path))
    assert "CZ_alpha3" in "".join(shown(made)) and len(shown(made)) == len(shown(content))


def test_a_cell_shows_what_it_prints_and_its_last_value():
    cell = {"source": ["x = 3\n", "print(x)\n", "x * 2"], "execution_count": 1}
    printed, value = run(cell, {})
    assert (printed["text"], value["data"]["text/plain"]) == (["3\n"], ["6"])
    assert run({"source": ["y = 1"], "execution_count": 2}, {}) == []
    with pytest.raises(ZeroDivisionError):
        run({"source": ["1 / 0"], "execution_count": 3}, {})
