"""A table of the parameters as CSV (RFC 4180), comments before it."""

from __future__ import annotations

import csv
import io

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.export.exported import Exported, header_lines
from aircraft_sysid_ros.export.learnt_model import LearntModel

_RANGES = (
    "The last rows, axis 'range', hold the least value of each signal that was learnt from, and the largest as "
    "standard_error. OUTSIDE OF IT THE MODEL IS NOT KNOWN TO HOLD."
)
COLUMNS = ("parameter", "axis", "term", "value", "standard_error", "status", "reason")


def export_table(learnt: LearntModel) -> Exported:
    """One row for each parameter, then one for each signal with the range in which it was learnt."""
    out = io.StringIO()
    out.write(f"# {header_lines(learnt, 'csv', {}, ())[0]}\n")
    out.write(f"# {_RANGES}\n")
    write = csv.writer(out, lineterminator="\n")
    write.writerow(COLUMNS)
    for axis in AXES:
        part = learnt.model.axis_slice(axis)
        for p, term in zip(learnt.parameters[part], learnt.model.terms[axis], strict=True):
            write.writerow([p.name, axis, term, repr(p.value), repr(p.std), p.status, p.reason])
    for name, (low, high) in learnt.ranges.items():
        write.writerow([name, "range", "", repr(low), repr(high), "", ""])
    return Exported(out.getvalue())
