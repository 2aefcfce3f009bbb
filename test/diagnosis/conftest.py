"""A run of a flight in which C_Z has a term that the model lacks."""

from __future__ import annotations

import time

import pytest

from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.run_writer import RunWriter
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples


@pytest.fixture(scope="session")
def hidden_run(aircraft, tmp_path_factory):
    """The folder; tests that change it copy it."""
    samples = simulate_samples(aircraft, 6, 60.0, effects=[Effect("CZ", "alpha**3", 60.0)]).samples
    pipeline, path = Pipeline(aircraft), tmp_path_factory.mktemp("runs") / "hidden"
    with RunWriter(path, aircraft) as writer:
        for rows, points in (pipeline.push(samples), pipeline.flush()):
            writer.add_rows(rows)
            writer.add_points(points)
        writer.add_samples(samples)
        writer.finish(pipeline.state, pipeline.parameters, pipeline.state.flight_time, time.perf_counter())
    return path
