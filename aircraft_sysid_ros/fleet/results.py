"""The answers of a fleet in its folder: one file per flight, written whole, under the key of what it rests on.

A fleet that is begun again takes from here what it has. Failures of the machine, such as a full disk or a package that
is not installed, are not kept; one by the time limit counts only up to that limit.
"""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet.flight_task import Answer, Job, is_kept
from aircraft_sysid_ros.json_text import json_text
from aircraft_sysid_ros.text_file import write_whole

FOLDER, RUNS = "results", "runs"
_LOCK, _README = ".lock", "README"
_DIGITS = 2  # of a key, that name a folder: few files lie in each


class Results:
    """The answers that are there. Raises InputError where the folder is not that of a fleet, or cannot be written."""

    def __init__(self, out: Path) -> None:
        self.out = out
        if out.exists() and not out.is_dir():
            raise InputError(f"--out {out} is a file: give the name of a folder")
        if out.is_dir() and any(out.iterdir()) and not (out / FOLDER).is_dir():
            raise InputError(f"--out {out} is not the folder of a fleet and is left alone: give another name")
        self._new = [folder for folder in (out / FOLDER, out, *out.parents) if not folder.exists()]
        try:
            (out / FOLDER).mkdir(parents=True, exist_ok=True)
            write_whole(out / FOLDER / _README, "Answers by flight, for a fleet that is begun again.\n")
        except OSError as error:
            raise InputError(f"cannot write to --out {out}: {error.strerror or error}") from None

    @contextmanager
    def held(self) -> Iterator[None]:
        """While a fleet works on it. Raises InputError where another one does.

        A fleet that is refused before any answer is kept leaves nothing behind.
        """
        with (self.out / FOLDER / _LOCK).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise InputError(f"another fleet works on {self.out}: wait for it, or give another --out") from None
            try:
                yield
            except InputError:
                self._leave_nothing()
                raise

    def _leave_nothing(self) -> None:
        """Remove the folders that were made for this fleet, where they hold nothing but their own files."""
        for folder in self._new:
            own = [folder / name for name in (_README, _LOCK)] if folder.name == FOLDER else []
            if any(place not in own for place in folder.iterdir()):
                return
            for file in own:
                file.unlink(missing_ok=True)
            folder.rmdir()

    def _path(self, key: str) -> Path:
        return self.out / FOLDER / key[:_DIGITS] / f"{key}.json"

    def known(self, job: Job, time_limit: float) -> Answer | None:
        """The answer to a job, None where it is still to fly: also where its run shall stay, and is not there or is
        that of another one.
        """
        try:
            answer: Answer = json.loads(self._path(job.key).read_text(encoding="utf8"))
            limit = answer.get("time_limit")
            has_answer = isinstance(answer["ok"], bool)
        except (OSError, ValueError, LookupError, AttributeError, TypeError):
            return None
        if not has_answer or (limit is not None and time_limit > limit):
            return None
        return None if answer["ok"] and not is_kept(job) else answer

    def keep(self, key: str, answer: dict[str, Any]) -> None:
        """Write one answer. Raises OSError."""
        path = self._path(key)
        path.parent.mkdir(exist_ok=True)
        write_whole(path, json_text(answer) + "\n")
