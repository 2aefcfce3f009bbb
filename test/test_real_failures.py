"""Real flights in which something fails, the whole way by processes; the references are never an input.

Simulated ones are in diagnosis/test_failures.py.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import real_failures

#: Servo pulses of the right elevon stand still between these times [s from the start of the log].
HELD = (74.3, 77.9)
#: failure_status-engines of the data set, from the first sample of the IMU [s].
CUT = 1531943927.13 - 1531943810.9


@pytest.mark.long
def test_an_elevon_that_software_held_is_named_with_both_times(shared_data, tmp_path) -> None:
    said = real_failures.said_of("commands", shared_data, tmp_path)
    (found,) = said["candidates"]
    assert (found["effect"], found["input"]) == ("stuck_control", "elevon_right")
    times = real_failures.times_in(real_failures.balance_of("commands", tmp_path, 4.0), found)
    assert abs(times["t0"] - HELD[0]) < 2.0 and abs(times["t1"] - HELD[1]) < 2.0
    assert any("taken as calm" in note for note in said["notes"]) and any("wind of" in note for note in said["notes"])
    parameters = (tmp_path / "commands_run" / "parameters.json").read_text()
    assert '"USE"' not in parameters, "the air was taken as calm, and was not"
    _added_and_taken_back(tmp_path / "commands_run", found)


@pytest.mark.long
def test_nothing_is_named_where_the_servos_own_pulses_are_read(shared_data, tmp_path) -> None:
    said = real_failures.said_of("actuators", shared_data, tmp_path)
    assert said["verdict"] == "none" and said["candidates"] == []


@pytest.mark.long
def test_an_engine_that_was_cut_is_dated_and_nothing_else_named(shared_data, tmp_path) -> None:
    said = real_failures.said_of("alfa", shared_data, tmp_path)
    (found,) = said["candidates"]
    times = real_failures.times_in(real_failures.balance_of("alfa", tmp_path, 1.0), found)
    assert found["effect"] == "loss_of_thrust" and abs(times["t0"] - CUT) < 5.0
    parameters = (tmp_path / "alfa_run" / "parameters.json").read_text()
    assert '"USE"' not in parameters, "10 Hz and pulses at 3 Hz tell no derivative"
    _added_and_taken_back(tmp_path / "alfa_run", found)


def _added_and_taken_back(run, found) -> None:
    """What was named is added, with the errors that were shown; then nothing is missing; taken back, it is again."""
    added = real_failures.command("add", run, found["effect"])
    errors = added["axes"][found["main_axis"]]
    assert (errors["error_before"], errors["error_after"]) == (found["error_before"], found["error_after"])
    assert added["improved"]
    assert real_failures.command("diagnose", run)["verdict"] == "none"
    removed = real_failures.command("remove", run, found["effect"])
    assert removed["axes"][found["main_axis"]]["error_after"] == found["error_before"] and not removed["improved"]
    assert removed["model"] == added["parents"][0]
