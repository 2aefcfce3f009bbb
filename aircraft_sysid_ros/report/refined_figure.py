"""The picture of a refinement: measured outputs against those of the refined model."""

from __future__ import annotations

from pathlib import Path

from aircraft_sysid_ros.refinement.refine import Refinement
from aircraft_sysid_ros.report.figures import outputs_figure
from aircraft_sysid_ros.report.picture import whole_picture


def draw_refined(path: Path, result: Refinement, title: str) -> tuple[str | None, list[str]]:
    """Write the picture whole or not at all; the file and no note, or None and why there is none."""
    return whole_picture(path, lambda part: outputs_figure(result.time, result.measured, result.modelled, part, title))
