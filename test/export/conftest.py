"""A run, its model, and a flight that it was not learnt from."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import export as benchmark


@pytest.fixture(scope="session")
def exported_run(tmp_path_factory):
    """The folder of the run; tests that change it copy it."""
    folder = tmp_path_factory.mktemp("export")
    benchmark.learn(benchmark.fly("textbook", 5, 40.0), folder)
    return folder / "run"


@pytest.fixture(scope="session")
def learnt(exported_run):
    """Its model."""
    from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
    from aircraft_sysid_ros.export.from_run import learnt_model

    run = open_run(exported_run)
    return learnt_model(run, run.current)


@pytest.fixture(scope="session")
def held_out():
    """Truth of another flight."""
    return benchmark.fly("textbook", 1005, 24.0).truth
