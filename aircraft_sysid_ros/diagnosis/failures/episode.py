"""What is there for a part of a flight: from when to when, and what speaks for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from aircraft_sysid_ros.diagnosis.failures.failure_search import FailureSearch, Judged


@dataclass(frozen=True, kw_only=True)
class Episode:
    """Something that begins in a flight, and that may end."""

    begin: float  # [s] from the first sample of the IMU
    end: float | None  # [s]; None: to the end of the flight
    begin_error: float  # [s] two standard errors
    end_error: float
    evidence: float  # ln of the likelihood over that of the model as it is, less what free numbers cost
    gains: dict[str, float]  # the same by axis
    main_axis: str
    size: float  # share of the error of the main axis that goes
    #: By axis without and with it, on flight that was held out, over the spread of its coefficient; without the slow
    #: part of noise: what the second before does not foretell.
    errors: Mapping[str, tuple[float, float]]

    @property
    def error_before(self) -> float:
        """Of the main axis without it."""
        return self.errors[self.main_axis][0]

    @property
    def error_after(self) -> float:
        """Of the main axis with it."""
        return self.errors[self.main_axis][1]


def times_of(search: FailureSearch, judged: Judged, first: float) -> tuple[float, float | None, float, float]:
    """Begin and end [s] with their errors; ``first`` [s]: time of the first point of the series."""
    hypothesis, (begin_error, end_error) = judged.hypothesis, search.time_errors(judged)
    begin = first + search.step * hypothesis.begin
    if hypothesis.lasts(search.count):
        return begin, None, begin_error, np.nan
    return begin, first + search.step * hypothesis.end, begin_error, end_error
