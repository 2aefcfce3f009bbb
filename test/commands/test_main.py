"""What ``aircraft-sysid`` itself says: its version, and one sentence for what a library raises and for a fault."""

import subprocess
import sys
from importlib import metadata

import numpy as np
import pytest

from aircraft_sysid_ros.commands import compare
from aircraft_sysid_ros.commands.main import TRACEBACK, main


def test_the_version_is_that_of_the_package():
    words = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", "--version"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout == f"aircraft-sysid {metadata.version('aircraft_sysid_ros')}\n" and done.stderr == ""


@pytest.fixture
def raises(monkeypatch, capfd):
    """Status and what is said where a command raises an error, or does what it is given instead."""

    def said(what):
        def run(_):
            if isinstance(what, BaseException):
                raise what
            what()

        monkeypatch.setattr(compare, "run", run)
        status = main(["compare", "RUN"])
        out, err = capfd.readouterr()
        assert out == "" and err.count("\n") == 1 and err.startswith("aircraft-sysid compare: ")
        return status, err

    return said


def deeper():
    return deeper()


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (deeper, "nested too deeply"),
        (lambda: np.empty((1 << 40, 1 << 10)), "needs more memory than there is"),
        (MemoryError(), "needs more memory than there is"),
        (lambda: np.linalg.inv(np.zeros((2, 2))), "equations without a solution"),
    ],
)
def test_what_is_too_much_for_a_library_is_bad_input(raises, what, words):
    status, said = raises(what)
    assert status == 2 and words in said


def test_a_fault_of_the_program_is_one_line_that_says_how_to_see_more(raises, monkeypatch):
    status, said = raises(ValueError("first line\nsecond \x1b[2Jline"))
    assert status == 1 and "ValueError: first line" in said and f"{TRACEBACK}=1" in said and "\x1b" not in said
    assert len(raises(ValueError("x" * 10_000))[1]) < 600
    monkeypatch.setenv(TRACEBACK, "1")
    with pytest.raises(ValueError, match="whole"):
        main_with(monkeypatch, ValueError("the whole of it"))


def main_with(monkeypatch, error):
    def run(_):
        raise error

    monkeypatch.setattr(compare, "run", run)
    main(["compare", "RUN"])


def test_ctrl_c_within_a_compiled_kernel_is_no_fault(raises):
    def stopped():
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise SystemError("a result with an exception set") from error

    assert raises(stopped) == (130, "aircraft-sysid compare: stopped\n")
