"""The tutorials: their Python, and each of them typed from top to bottom, as a newcomer does."""

import signal
from contextlib import ExitStack

import pytest
from documented_commands import ROOT, python_blocks, told_on
from user import User

TUTORIALS = ROOT / "docs" / "tutorials"
#: Commands that go on until Ctrl-C, and what they say when they are ready.
UNTIL_STOPPED = {"bridge": "listening", "live": "listening", "workbench": "http://"}
#: What makes a flight shorter than the page does.
SHORTER = {
    "mavlink_simulator": ("--duration", "45"),
    "examples/adaptive_controller/fly.py": ("--seconds", "12", "--rate", "0"),
}
#: Tutorials that need what is not here.
NOT_TYPED = {"beside-px4.md": "there is no PX4 here, nor a whole flight of one; its commands are those of other ways"}


def test_all_tutorials_of_the_navigation_are_there():
    named = {line.split("tutorials/")[1].strip() for line in (ROOT / "mkdocs.yml").open() if "tutorials/" in line}
    assert named == {file.name for file in TUTORIALS.glob("*.md")} and named > NOT_TYPED.keys()


def test_python_of_the_controller_says_what_the_page_says(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    (block,) = python_blocks("docs/tutorials/feed-a-controller.md")
    names = {}
    exec(block, names)
    assert capsys.readouterr().out.split() == [str(names["aircraft"].coefficients["Cm_de"]), "PRIOR"]


@pytest.mark.long
@pytest.mark.parametrize("name", sorted({file.name for file in TUTORIALS.glob("*.md")} - NOT_TYPED.keys()))
def test_typed_from_top_to_bottom(name, tmp_path):
    user = User(tmp_path, {})
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    with ExitStack() as terminals:
        open_ones = []
        for number, one in enumerate(told for told in told_on(TUTORIALS / name) if told.is_block):
            program, *rest = one.words
            if program == "make":
                continue  # the tests run in what it makes
            if program == "aircraft-sysid" and rest[0] not in UNTIL_STOPPED:
                while open_ones:  # Ctrl-C, the last one first
                    open_ones.pop().interrupt()
            more = [words for part, words in SHORTER.items() if part in one.text]
            running = terminals.enter_context(
                user.open_terminal(f"{number}", [*one.words, *(word for words in more for word in words)])
            )
            if program == "aircraft-sysid" and rest[0] in UNTIL_STOPPED:
                running.wait_for(UNTIL_STOPPED[rest[0]])
                open_ones.append(running)
            else:
                running.end()
        for running in reversed(open_ones):
            running.process.send_signal(signal.SIGINT)
            running.end()
