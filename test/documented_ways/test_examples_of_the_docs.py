"""What the pages show to be copied into a file or a notebook is taken as it stands there."""

import re

import pytest
import yaml
from documented_commands import ROOT, python_blocks

import aircraft_sysid_ros as sysid
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.mavlink.servo_mapping import servo_mapping_from_dict
from aircraft_sysid_ros.recordings.tabular.column_map import load_column_map
from aircraft_sysid_ros.simulation.simulated_flight import SHORTEST, simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight

#: How a signal of a MAP stands in a whole one.
_ONE_TABLE = "tables:\n  - file: x.csv\n    time: {column: t, unit: s}\n    signals:\n      "


def yaml_blocks(page):
    text = (ROOT / "docs" / page).read_text(encoding="utf8")
    return re.findall(r"^```yaml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", ["README.md", "docs/aircraft-file.md"])
def test_a_model_is_one_of_an_aircraft_file(page):
    shape = yaml.safe_load(config_path("ultra_stick_25e.yaml").read_text(encoding="utf8"))
    shape.pop("coefficients")
    blocks = re.findall(r"^```yaml\n(.*?)^```", (ROOT / page).read_text(encoding="utf8"), re.MULTILINE | re.DOTALL)
    content = yaml.safe_load(blocks[0])
    aircraft = aircraft_from_dict({**shape, **content})
    for axis, terms in content["model"].items():
        assert len([name for name in aircraft.model.parameter_names if name.startswith(f"{axis}_")]) == len(terms)


@pytest.mark.parametrize(("page", "count"), [("mavlink.md", 2), ("tutorials/beside-px4.md", 1)])
def test_a_file_of_servos_is_one(page, count):
    contents = [content for block in yaml_blocks(page) if "outputs" in (content := yaml.safe_load(block))]
    assert len(contents) == count
    for content in contents:
        assert servo_mapping_from_dict(content).outputs.keys() == content["outputs"].keys()


@pytest.mark.parametrize(("page", "before", "signals"), [("import.md", "", 4), ("polar.md", _ONE_TABLE, 1)])
def test_a_map_is_one(page, before, signals, tmp_path):
    (block,) = yaml_blocks(page)
    file = tmp_path / "map.yaml"
    file.write_text(before + block, encoding="utf8")
    (table,) = load_column_map(file).tables
    assert len(table.signals) == signals


@pytest.mark.long
def test_tables_of_pandas_are_changed_and_recorded_again(aircraft, tmp_path, monkeypatch):
    """What the page changes is changed, and no sensor is lost on the way."""
    pytest.importorskip("pandas")
    monkeypatch.chdir(tmp_path)
    write_flight(simulate_samples(aircraft, seed=1, duration=SHORTEST), "flight")
    _, block = python_blocks("docs/python.md")
    exec(block, {"sysid": sysid})
    before, after = sysid.load("flight").tables(), sysid.load("corrected").tables()
    assert after.keys() == before.keys() >= {"controls", "angle_of_attack"}
    for kind, column, factor in (("airspeed", "true_airspeed", 0.95), ("controls", "elevator", 1.0)):
        expected = factor * before[kind][column].to_numpy()
        assert after[kind][column].to_numpy() == pytest.approx(expected, abs=1e-6)
