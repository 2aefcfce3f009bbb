"""An input that failed, or a moment that no input shows, as a change of the model.

``diagnose`` finds these by the forces alone (``failures``), most of them on flights without vanes, of which no filter
may know the angles of flow well enough to fit the coefficients. What is added is what it has found, judged by the same
balances: the errors are those that it showed.
"""

from __future__ import annotations

from dataclasses import dataclass

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.diagnosis.failures.failures import by_forces
from aircraft_sysid_ros.diagnosis.failures.words import CHANGE_OF_MOMENTS, DAMAGED, LOSS_OF_THRUST, STUCK, candidates_of
from aircraft_sysid_ros.samples import Samples

#: Effects that forces alone tell.
BY_FORCES = frozenset({LOSS_OF_THRUST, STUCK, DAMAGED, CHANGE_OF_MOMENTS})


@dataclass(frozen=True)
class FailedInput:
    """Terms by axis, and the held-out errors without and with them of the axes that tell."""

    terms: dict[str, tuple[str, ...]]
    errors: dict[str, tuple[float, float]]


def failed_input(
    aircraft: Aircraft, samples: Samples | None, identifier: str, zero: int | None = None
) -> FailedInput | None:
    """What ``diagnose`` says of an effect by forces alone; None where it does not judge the flight so, or says no such
    thing. ``zero``: stamp [ns] from which the signal ``time`` of terms counts.
    """
    report = None if identifier not in BY_FORCES or samples is None else by_forces(aircraft, samples, zero=zero)
    for candidate, episode in candidates_of(report) if report is not None else ():
        if candidate["effect"] == identifier:
            terms = {axis: tuple(texts) for axis, texts in candidate["terms"].items()}
            return FailedInput(terms, dict(episode.errors))
    return None
