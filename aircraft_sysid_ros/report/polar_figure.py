"""The picture of a drag polar: drag over lift, and the power of level flight, each with its standard error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aircraft_sysid_ros.report.figures import MEASURED_COLOUR, PREDICTED_COLOUR
from aircraft_sysid_ros.report.picture import whole_picture
from aircraft_sysid_ros.report.pyplot import pyplot


def draw_polar(path: Path, found: dict[str, Any]) -> tuple[str | None, list[str]]:
    """Write the picture whole or not at all; the file and no note, or None and why there is none."""
    return whole_picture(path, lambda part: _draw(part, found))


def _draw(path: Path, found: dict[str, Any]) -> None:
    plt = pyplot()
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    polar, level, points = found["polar"], found["level"], np.array(found["points"])
    drag, std = np.array(polar["drag"]), np.array(polar["std"])
    left.plot(points[:, 1], points[:, 0], ".", color=MEASURED_COLOUR, ms=3, alpha=0.35, label="windows of 10 s")
    left.plot(drag, polar["lift"], color=PREDICTED_COLOUR, label="polar, with one standard error")
    left.fill_betweenx(polar["lift"], drag - std, drag + std, color=PREDICTED_COLOUR, alpha=0.25, lw=0)
    left.set_xlim(0.0, float(np.percentile(points[:, 1], 97.0)) * 1.15)
    left.set_xlabel("$C_D$ [-]")
    left.set_ylabel("$C_L$ [-]")
    power, std = np.array(level["power"]), np.array(level["std"])
    right.plot(level["airspeed"], power, color=PREDICTED_COLOUR, label="level flight, with one standard error")
    right.fill_between(level["airspeed"], power - std, power + std, color=PREDICTED_COLOUR, alpha=0.25, lw=0)
    right.set_ylim(bottom=0.0)
    right.set_xlabel("airspeed [m/s]")
    right.set_ylabel("power [W]" if found["method"] == "power" else "power of thrust [W]")
    for plot in (left, right):
        plot.grid(alpha=0.3)
        plot.legend(fontsize=9)
    figure.suptitle(f"{found['aircraft']}, model {found['model']}", fontsize=11)
    try:
        figure.savefig(path, dpi=110)
    finally:
        plt.close(figure)
