"""What the page shows as tables of numbers (CSV), SI: for other programs."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence

import numpy as np

from aircraft_sysid_ros.diagnosis.compare import Comparison
from aircraft_sysid_ros.workbench.views.coefficients import predicted, time_of
from aircraft_sysid_ros.workbench.views.parameters import ParameterRow


def _csv(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()


def parameters_csv(rows: Sequence[ParameterRow]) -> str:
    """Parameters of a version; empty where nothing is known."""
    return _csv(
        ("parameter", "value", "standard_error", "status", "reason", "truth"),
        ((p.name, p.value, p.std, p.status, p.reason, p.truth) for p in rows),
    )


def coefficients_csv(comparison: Comparison) -> str:
    """Time [s] of the recording, and for each axis with data what is in the time plots: all points, none thinned."""
    header, columns = ["time"], [time_of(comparison.flight)]
    for name, found in comparison.axes.items():
        header += [f"{name}_{what}" for what in ("measured", "predicted", "held_out_residual", "noise_sigma")]
        columns += [
            comparison.flight.coefficient(name),
            predicted(comparison, name),
            found.fit.held_out,
            found.floor.std,
        ]
    table = np.column_stack(columns)
    return _csv(header, ([f"{value:.7g}" if math.isfinite(value) else "" for value in row.tolist()] for row in table))
