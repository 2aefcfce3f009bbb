"""What a refinement or a calibration of the page has written over, kept in the run until it is put back.

It is one archive beside what was written, made when the work is done: work that is stopped leaves nothing. It is not
offered any more where another program has written the same files since.
"""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from aircraft_sysid_ros.after_flight.calibrate import SECTIONS
from aircraft_sysid_ros.diagnosis.model_versions.versions import Run, folder_of
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.refinement.refined_file import METHODS, refined_name
from aircraft_sysid_ros.text_file import write_whole
from aircraft_sysid_ros.workbench.calibration_view import of_run

#: What reading an archive raises where it is none.
_DAMAGED = (OSError, ValueError, KeyError, zipfile.BadZipFile)


@dataclass(frozen=True)
class Written:
    """What one kind of work writes: the files of a pattern in a folder."""

    folder: Path
    pattern: str
    archive: Path

    @property
    def files(self) -> list[Path]:
        """Those that are there."""
        return sorted(file for file in self.folder.glob(self.pattern) if file.is_file())

    def read(self) -> dict[str, tuple[bytes, int]]:
        """Content and time of change [ns] of each, by name."""
        return {file.name: (file.read_bytes(), file.stat().st_mtime_ns) for file in self.files}

    def keep(self, before: Mapping[str, tuple[bytes, int]]) -> None:
        """Keep what ``read`` gave before the work. Raises OSError."""
        content = io.BytesIO()
        with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.comment = json.dumps({name: changed for name, (_, changed) in before.items()}).encode()
            for name, (data, _) in before.items():
                archive.writestr(name, data)
        write_whole(self.archive, content.getvalue())

    @property
    def can_be_undone(self) -> bool:
        """Whether something is kept, and nothing was written since."""
        try:
            kept = self.archive.stat().st_mtime_ns
        except OSError:
            return False
        return bool(self.files) and all(file.stat().st_mtime_ns <= kept for file in self.files)

    def put_back(self) -> bool:
        """Undo the work; returns whether there was anything before. Raises InputError."""
        if not self.can_be_undone:
            raise InputError("there is nothing to undo: nothing is kept, or another program has written since")
        try:
            with zipfile.ZipFile(self.archive) as archive:
                times = json.loads(archive.comment)
                before = {name: (archive.read(name), int(changed)) for name, changed in times.items()}
        except _DAMAGED:
            raise InputError(f"{self.archive} cannot be read: what was there before is lost") from None
        for name, (data, changed) in before.items():
            write_whole(self.folder / name, data)
            os.utime(self.folder / name, ns=(changed, changed))
        for file in self.files:
            if file.name not in before:
                file.unlink()
        self.archive.unlink()
        with suppress(OSError):  # it holds something else, or is the run itself
            self.folder.rmdir()
        return bool(before)


def written(run: Run) -> dict[str, Written]:
    """What refinements of the current version and calibrations write, by the kind of work and its method or sensor."""
    place = folder_of(run, run.current)
    found = {}
    for method in METHODS:
        name = Path(refined_name(method)).stem
        found[f"refine {method}"] = Written(place, f"{name}.*", place / f".before-{name}.zip")
    for what in SECTIONS:
        folder = of_run(run.path, what)
        found[f"calibrate {what}"] = Written(folder, "*", run.path / f".before-{folder.name}.zip")
    return found
