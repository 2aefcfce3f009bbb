"""A user with some terminals: types the commands of a way, in a folder of their own."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from documented_commands import ROOT, Told, command_of

from aircraft_sysid_ros.processes import CORES

#: Longest time [s] that anything may take on a busy machine.
PATIENCE = 600.0
#: The ROS wheels say by the one that they have set the other in this process: a new terminal has neither.
_BY_WHEELS, _LIBRARIES = "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "LD_LIBRARY_PATH"
#: Name of a step, and the page and the beginning of its command.
Way = Mapping[str, tuple[str, str]]


def wait_until(done: Callable[[], Any], what: str, *among: Running) -> None:
    """Return when ``done()``; fails when patience is at its end, or one of the commands that run meanwhile."""
    deadline = time.monotonic() + PATIENCE
    while not done():
        assert all(running.process.poll() is None for running in among), f"ended before {what}: {among[0].errors}"
        assert time.monotonic() < deadline, f"waited in vain until {what}"
        time.sleep(0.05)


class Running:
    """A command that runs in a terminal of its own."""

    def __init__(self, process: subprocess.Popen[bytes], output: Path, errors: Path) -> None:
        self.process, self._output, self._errors = process, output, errors

    @property
    def output(self) -> str:
        """Standard output so far."""
        return self._output.read_text(encoding="utf8")

    @property
    def errors(self) -> str:
        """Standard error so far."""
        return self._errors.read_text(encoding="utf8")

    def wait_for(self, text: str) -> None:
        """Until it has said a text; fails where it ends before."""

        wait_until(lambda: text in self.output + self.errors, f"it said '{text}'", self)

    def end(self) -> str:
        """Wait for its end, which must be a good one; returns its output."""
        status = self.process.wait(PATIENCE)
        assert status == 0, f"exit status {status}: {self.errors}"
        assert "Traceback" not in self.errors
        return self.output

    def interrupt(self) -> str:
        """Ctrl-C, and its end."""
        self.process.send_signal(signal.SIGINT)
        return self.end()


class User:
    """Types the commands of a way; more options may follow, and names of files and places may be others."""

    def __init__(self, folder: Path, way: Way) -> None:
        self.folder = folder
        self._way = {step: command_of(page, beginning) for step, (page, beginning) in way.items()}
        self._left = set(way)
        for name in ("config", "examples"):
            (folder / name).symlink_to(ROOT / name)
        (folder / ".venv").symlink_to(sys.prefix)
        self.environment = {**os.environ, "PATH": f"{folder}/.venv/bin:{os.environ['PATH']}"}
        self.environment.pop(CORES, None)  # a user has them all
        if self.environment.pop(_BY_WHEELS, None):
            self.environment.pop(_LIBRARIES, None)

    def source(self, script: Path) -> None:
        """Source a script in all terminals that are opened from now on."""
        command = ["bash", "-c", f". {shlex.quote(str(script))} >&2 && env -0"]
        done = subprocess.run(command, env=self.environment, capture_output=True, text=True, check=True)
        self.environment = dict(entry.split("=", 1) for entry in done.stdout.split("\0") if entry)

    def told(self, step: str) -> Told:
        """Where it stands; the step counts as made."""
        self._left.discard(step)
        return self._way[step]

    def run(self, step: str, *more: object, **instead: object) -> str:
        """Standard output of a step, which must end well."""
        with self.start(step, *more, **instead) as running:
            return running.end()

    def ask(self, step: str, *more: object, **instead: object) -> Any:
        """The JSON document that a step prints with --json."""
        return json.loads(self.run(step, *more, "--json", **instead), parse_constant=_refuse)

    @contextmanager
    def start(self, step: str, *more: object, **instead: object) -> Iterator[Running]:
        """A step in a terminal of its own, which is closed with the block."""
        words = [str(instead.get(word, word)) for word in self.told(step).words]
        with self.open_terminal(step, [*words, *map(str, more)]) as running:
            yield running

    @contextmanager
    def open_terminal(self, name: str, words: list[str]) -> Iterator[Running]:
        """Any command."""
        output, errors = self.folder / f"{name}.out", self.folder / f"{name}.err"
        with output.open("wb") as out, errors.open("wb") as err:
            program = shutil.which(words[0], path=self.environment["PATH"])
            process = subprocess.Popen(
                words, executable=program, cwd=self.folder, env=self.environment, stdout=out, stderr=err
            )
        try:
            yield Running(process, output, errors)
        finally:
            process.kill()
            process.wait()

    def check_done(self) -> None:
        """Every command of the way has been typed."""
        assert not self._left, f"not typed: {', '.join(sorted(self._left))}"


def _refuse(name: str) -> None:
    raise AssertionError(f"{name} in JSON")
