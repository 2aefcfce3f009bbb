"""What is there for a part of a flight: from when to when, and what speaks for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from aircraft_sysid_ros.diagnosis.failures.failure_search import FailureSearch, Judged


class Times(NamedTuple):
    """From when to when."""

    begin: float  # [s] of ForceBalance.time
    end: float | None  # [s]; None: to the end of the flight
    begin_error: float  # [s] two standard errors
    end_error: float


@dataclass(frozen=True, kw_only=True)
class Episode:
    """Something that begins in a flight, and that may end, and come again."""

    times: tuple[Times, ...]
    evidence: float  # ln of the likelihood over that of the model as it is, less what free numbers cost
    gains: dict[str, float]  # the same by axis
    main_axis: str
    size: float  # share of the error of the main axis that goes
    #: By axis without and with it, on flight that was held out, over the spread of its coefficient; without the slow
    #: part of noise: what the second before does not foretell.
    errors: Mapping[str, tuple[float, float]]

    @property
    def begin(self) -> float:
        """When it is there first [s]."""
        return self.times[0].begin

    @property
    def end(self) -> float | None:
        """When it is there no more [s] after that; None: to the end of the flight."""
        return self.times[0].end

    @property
    def begin_error(self) -> float:
        """Of ``begin``, two standard errors [s]."""
        return self.times[0].begin_error

    @property
    def end_error(self) -> float:
        """Of ``end``, two standard errors [s]."""
        return self.times[0].end_error

    @property
    def error_before(self) -> float:
        """Of the main axis without it."""
        return self.errors[self.main_axis][0]

    @property
    def error_after(self) -> float:
        """Of the main axis with it."""
        return self.errors[self.main_axis][1]


def times_of(search: FailureSearch, judged: Judged, first: float) -> tuple[Times, ...]:
    """All times with their errors; ``first`` [s]: time of the first point of the series."""
    found = []
    for (begin, end), errors in zip(judged.hypothesis.spans, search.time_errors(judged), strict=True):
        last = None if end >= search.count else first + search.step * end
        found.append(Times(first + search.step * begin, last, *errors))
    return tuple(found)
