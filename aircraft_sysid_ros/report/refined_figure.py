"""The picture of a refinement: measured outputs against those of the refined model."""

from __future__ import annotations

import os
from pathlib import Path

from aircraft_sysid_ros.refinement.refine import Refinement
from aircraft_sysid_ros.report.figures import outputs_figure
from aircraft_sysid_ros.report.picture import picture


def draw_refined(path: Path, result: Refinement, title: str) -> tuple[str | None, list[str]]:
    """Write the picture whole or not at all; the file and no note, or None and why there is none."""
    return picture(lambda: _draw(path, result, title))


def _draw(path: Path, result: Refinement, title: str) -> Path:
    part = path.with_name(f".{path.name}.part.png")
    try:
        outputs_figure(result.time, result.measured, result.modelled, part, title)
        os.replace(part, path)
    except OSError:
        part.unlink(missing_ok=True)
        raise
    return path
