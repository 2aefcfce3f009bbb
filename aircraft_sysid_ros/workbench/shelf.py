"""Several runs that one server shows: which there are, and the sessions of those that are looked at."""

from __future__ import annotations

import json
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aircraft_sysid_ros.aircraft.configuration import load_aircraft
from aircraft_sysid_ros.diagnosis.model_versions.versions import MODELS, VERSION, changed_at
from aircraft_sysid_ros.errors import InputError, echo, one_line
from aircraft_sysid_ros.flight_journal import FLIGHT
from aircraft_sysid_ros.run_reader import AIRCRAFT, PARAMETERS, POINTS, SAMPLES, STATE, UNREADABLE, read_parameters
from aircraft_sysid_ros.workbench.session import Session
from aircraft_sysid_ros.workbench.views.words import readable

#: Runs that are open at once: each has a process of its own.
MOST_OPEN = 4
#: Runs that are listed, the newest first.
MOST_LISTED = 200


@dataclass(frozen=True)
class ListedRun:
    """One run in the list; ``problem`` says why it cannot be opened, None where nothing is known."""

    name: str
    aircraft: str = ""
    seconds: float | None = None  # of the recording
    made: float = 0.0  # [s] since 1970
    versions: int = 1
    problem: str = ""

    @property
    def made_at(self) -> str:
        """When, as people write it."""
        return time.strftime("%Y-%m-%d %H:%M", time.localtime(self.made)) if self.made else "–"


class Shelf:
    """Runs by name, from folders that were named, or from one that holds them; new ones appear by themselves."""

    def __init__(self, paths: Sequence[str | Path]) -> None:
        self.paths = [Path(path) for path in paths]
        self._open: dict[str, Session] = {}
        self._viewers: dict[str, int] = {}
        self._looked: dict[str, float] = {}
        self._known: dict[Path, tuple[tuple[int, ...], ListedRun]] = {}

    @property
    def title(self) -> str:
        """Name of the folder, or how many runs there are."""
        return readable(self.paths[0].resolve().name) if len(self.paths) == 1 else f"{len(self.paths)} runs"

    def wait(self, timeout: float, tell: Callable[[str, float], None] = lambda what, share: None) -> None:
        """Nothing is read before somebody looks at it."""

    def folders(self) -> dict[str, Path]:
        """Folders of runs by the name that the page gives them."""
        if len(self.paths) > 1:
            names = [path.resolve().name for path in self.paths]
            return {
                readable(name if names.count(name) == 1 else str(path)): path
                for name, path in zip(names, self.paths, strict=True)
            }
        try:
            found = [each for each in self.paths[0].iterdir() if not each.name.startswith(".") and each.is_dir()]
        except OSError:
            return {}
        runs = [each for each in found if (each / AIRCRAFT).is_file()]
        newest = sorted(runs, key=lambda each: -changed_at(each / PARAMETERS))[:MOST_LISTED]
        return {readable(each.name): each for each in sorted(newest, key=lambda each: each.name)}

    def listed(self) -> list[ListedRun]:
        """What is known of every run without opening it."""
        return [self._listed(name, folder) for name, folder in self.folders().items()]

    @property
    def names(self) -> list[str]:
        """Runs that can be opened, as far as their small files show."""
        return [run.name for run in self.listed() if not run.problem]

    def _listed(self, name: str, folder: Path) -> ListedRun:
        signature = tuple(changed_at(folder / file) for file in (AIRCRAFT, PARAMETERS, STATE, POINTS, SAMPLES, MODELS))
        before = self._known.get(folder)
        if before is None or before[0] != signature:
            self._known[folder] = before = (signature, look_at(name, folder))
        return before[1]

    def session(self, name: str) -> Session:
        """The open session of a run. Raises InputError where there is no such run, or too many are open."""
        if name not in self._open:
            folder = self.folders().get(name)
            if folder is None:
                raise InputError(f"there is no run {echo(name)} here any more: choose one of the list")
            if len(self._open) >= MOST_OPEN:
                self._close_one()
            self._open[name] = Session(folder)
        self._looked[name] = time.monotonic()
        return self._open[name]

    def hold(self, name: str) -> Callable[[], None]:
        """A browser looks at a run; what is returned says that it no longer does."""
        self._viewers[name] = self._viewers.get(name, 0) + 1

        def release() -> None:
            self._viewers[name] -= 1

        return release

    def _close_one(self) -> None:
        """Close the run that nobody has looked at for longest. Raises InputError where somebody looks at all."""
        idle = [name for name, session in self._open.items() if not (self._viewers.get(name) or session.is_working)]
        if not idle:
            raise InputError(f"{MOST_OPEN} runs are open, which is the maximum: close the page of one of them first")
        self._open.pop(min(idle, key=lambda name: self._looked[name])).close()

    def close(self) -> None:
        """End all sessions."""
        for session in self._open.values():
            session.close()


def look_at(name: str, folder: Path) -> ListedRun:
    """One run as its small files show it; a sentence where they cannot be read."""
    if (folder / FLIGHT).exists():  # a journal
        run = readable(folder.name.removesuffix(".flying"))
        return ListedRun(
            name, problem=f"is flown now, or was cut off: then aircraft-sysid recover {run} makes it a run"
        )
    file = STATE
    try:
        aircraft = load_aircraft(folder / AIRCRAFT)
        state: Mapping[str, Any] = json.loads((folder / STATE).read_text(encoding="utf8"))
        seconds = float(state["duration"])
        file = PARAMETERS
        read_parameters(folder)
        written = {path.parent.name for path in (folder / MODELS).glob(f"*/{VERSION}")}
        versions = len(written | {aircraft.model.identifier})  # to undo all may write the first one, too
    except InputError as error:
        return ListedRun(name, problem=str(error))
    except UNREADABLE as error:
        kind = "is not there" if isinstance(error, FileNotFoundError) else "cannot be read"
        return ListedRun(name, problem=f"{file} {kind}: replay the recording again")
    for file in (POINTS, SAMPLES):
        if (folder / file).exists() and not zipfile.is_zipfile(folder / file):
            return ListedRun(name, problem=f"{file} is cut off or damaged: replay the recording again")
    return ListedRun(name, one_line(aircraft.name), seconds, changed_at(folder / PARAMETERS) * 1e-9, versions)
