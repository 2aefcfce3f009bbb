"""Several replicas of a flight through the whole chain, each searched as the flight is, on all cores."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.flight.reconstruction import (
    Reconstruction,
    reconstruct,
    repeated_rows,
    settled_flight,
)
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator, best_by_axis, expressions
from aircraft_sysid_ros.diagnosis.search.fit import fit_axis
from aircraft_sysid_ros.diagnosis.significance.bootstrap_flight import FlightConditions, world_of
from aircraft_sysid_ros.diagnosis.significance.noise_floor import HALF_WIDTH
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import Effect
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.processes import in_parallel
from aircraft_sysid_ros.reconstruction.state import StateField
from aircraft_sysid_ros.sensors.sensor_models import EPOCH

Array = npt.NDArray[np.float64]

#: Replicas of a flight, and how much [s] of it they repeat.
COUNT, LONGEST = 20, 300.0


def fitted_parameters(data: FlightData) -> Array:
    """Parameters (p,) of the flight's model, 0 where the flight does not determine them."""
    parts = []
    for axis in AXES:
        try:
            parts.append(np.nan_to_num(fit_axis(data, axis).fit.parameters))
        except InputError:
            part = data.model.axis_slice(axis)
            parts.append(np.zeros(part.stop - part.start))
    return np.concatenate(parts)


@dataclass(frozen=True)
class Replica:
    """A flight in which nothing is missing, and what the search seems to explain in it."""

    data: FlightData
    scores: Mapping[str, float]  # by id of the effect
    outside: Mapping[str, float]  # by axis, of the best expression outside the library


def replicas_of(
    flight: Reconstruction,
    library: Sequence[Effect],
    count: int = COUNT,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Replica]:
    """``count`` replicas; fewer where the filter does not start on one. Their seeds are 0, 1, ….

    Raises InputError where there are not two, with what is in the way.
    """
    stretches, least = repeated_rows(flight, LONGEST), THRESHOLDS.least_time
    length = sum(float(np.ptp(rows[:, StateField.TIME])) for rows in stretches)
    if length < least:
        raise InputError(
            f"the flight cannot be diagnosed: without a gap in IMU or airspeed it has {length:.0f} s in the air, and "
            f"{least:g} s are needed"
        )
    results: list[Replica] = []
    failures: list[str] = []
    parameters = fitted_parameters(settled_flight(flight))
    arguments = [(flight, stretches, parameters, library, seed) for seed in range(count)]
    import scipy.signal  # noqa: F401, once and not in each of the processes

    for number, replica in enumerate(in_parallel(_replica, arguments), 1):
        progress(number / count)
        if isinstance(replica, Replica):
            results.append(replica)
        else:
            failures.append(replica)
    if len(results) < 2:
        raise InputError(f"the flight cannot be diagnosed: flown again by its own model, {failures[0]}")
    return results


def _replica(arguments: tuple[Reconstruction, list[Array], Array, Sequence[Effect], int]) -> Replica | str:
    """One replica, in a process of its own; or why there is none."""
    flight, stretches, parameters, library, seed = arguments
    world = world_of(flight, stretches, parameters, seed)
    try:
        again = reconstruct(world.aircraft, world.samples(seed), with_covariance=False)
        bench = CandidateEvaluator(without_excess(world, again))
    except InputError as error:
        return str(error)
    trials = {effect.identifier: bench.best_of(effect) for effect in library}
    scores = {name: trial.score for name, trial in trials.items() if trial is not None}
    outside = (trial for trial in map(bench.trial, expressions(bench.data)) if trial is not None)
    return Replica(bench.data, scores, {axis: best.score for axis, best in best_by_axis(outside).items()})


def without_excess(world: FlightConditions, again: Reconstruction) -> FlightData:
    """Data of a replica with what its motion has beyond the model taken off."""
    data = settled_flight(again)
    begin = (again.epoch - EPOCH) * 1e-9
    times = data.time + again.points[0, CoefficientSample.TIME] + begin
    seen = again.rows[:, StateField.TIME] + begin if data.sparse_interval > 0.0 else None
    return replace(data, measured=data.measured - world.excess_at(times, HALF_WIDTH, seen))
