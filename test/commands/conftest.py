"""A run as a user makes one: simulate with a hidden effect, then replay."""

from __future__ import annotations

import pytest

from aircraft_sysid_ros.commands.main import main


@pytest.fixture(scope="session")
def run_with_hidden_effect(tmp_path_factory, aircraft_file):
    """The folder; tests that change it copy it."""
    folder = tmp_path_factory.mktemp("hidden")
    bag, run = str(folder / "flight"), str(folder / "run")
    effect = ["--effect", "CZ: alpha**3 = 60", "--duration", "40", "--seed", "6"]
    assert main(["simulate", "--out", bag, "--aircraft", str(aircraft_file), *effect]) == 0
    assert main(["replay", bag, "--aircraft", str(aircraft_file), "--out", run]) == 0
    return folder / "run"
