"""Named inputs live: heard where the aircraft file names some, and the numbers are those of replay to the last bit."""

import json

import numpy as np
import pytest
import yaml
from processes import live, play
from waiting import finish

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight

HORIZON, RATE = 5.0, 8  # a busy machine may be 0.6 s late


@pytest.mark.long
def test_live_is_replay_to_the_last_bit(domain, aircraft, tmp_path):
    model = {"Cm": [*aircraft.model.terms["Cm"], "trim_tab"]}
    source = {**aircraft.source, "inputs": {"trim_tab": {"unit": "deg"}}}
    flight = simulate_samples(aircraft_from_dict(source), 3, 30.0, effects=[Effect("Cm", "trim_tab", -0.3)])
    write_flight(flight, tmp_path / "flight")
    file = tmp_path / "aircraft.yaml"
    file.write_text(yaml.safe_dump({**source, "model": model}))
    options = ["--aircraft", file, "--out", tmp_path / "replayed", "--horizon", HORIZON]
    assert main([*map(str, ["replay", tmp_path / "flight", *options])]) == 0
    for attempt in range(3):  # until no sample came late
        run = tmp_path / str(attempt) / "run"
        run.parent.mkdir()
        with live(run, file, "--reliable", "--until-idle", 1.5, "--horizon", HORIZON) as process:
            sent = play(tmp_path / "flight", RATE)
            output, errors = finish(process)
        assert process.returncode == 0, errors
        if not (result := json.loads(output))["late"]:
            break
    assert not result["late"]
    assert result["received"]["inputs"] == sent["messages"]["/inputs"] > 1000
    replayed = json.loads((tmp_path / "replayed" / "parameters.json").read_text())
    assert json.loads((run / "parameters.json").read_text()) == replayed
    (of_tab,) = [p for p in replayed["parameters"] if p["name"] == "Cm_trim_tab"]
    assert of_tab["status"] == "USE" and abs(of_tab["value"] + 0.3) < 3.0 * of_tab["std"]
    kept = [np.load(folder / "samples.npz") for folder in (run, tmp_path / "replayed")]
    assert len({np.sort(one["values"][one["kind"] == Kind.INPUTS, 0]).tobytes() for one in kept}) == 1
