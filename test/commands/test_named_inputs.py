"""Inputs that the aircraft file names: from a stranger's columns to terms of the model, against the truth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.ros_messages.conversion import ned_from_enu
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.dynamics import Effect
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight

TRUE = -0.3  # [1/rad] of C_m by the trim tab
KNOT = 1852.0 / 3600.0
MAP = """\
tables:
  - {file: imu.csv, time: {column: t, unit: s}, signals: {
      specific_force.x: {column: fx, unit: m/s^2}, specific_force.y: {column: fy, unit: m/s^2},
      specific_force.z: {column: fz, unit: m/s^2}, angular_velocity.x: {column: P, unit: deg/s},
      angular_velocity.y: {column: Q, unit: deg/s}, angular_velocity.z: {column: R, unit: deg/s}}}
  - {file: gps.csv, time: {column: t, unit: s}, signals: {
      latitude: {column: lat, unit: deg}, longitude: {column: lon, unit: deg}, altitude: {column: alt, unit: m},
      velocity.north: {column: vn, unit: m/s}, velocity.east: {column: ve, unit: m/s},
      velocity.down: {column: vd, unit: m/s}}}
  - {file: air.csv, time: {column: t, unit: s}, signals: {
      true_airspeed: {column: TAS, unit: kt}, angle_of_attack: {column: AOA, unit: deg},
      sideslip: {column: AOS, unit: deg}, static_pressure: {column: Ps, unit: Pa},
      air_density: {column: rho, unit: kg/m^3}}}
  - {file: controls.csv, time: {column: t, unit: s}, signals: {SURFACES thrust: {column: T, unit: N}}}
"""
SURFACES = "elevator: {column: de, unit: deg}, aileron: {column: da, unit: deg}, rudder: {column: dr, unit: deg},"
ELEVONS = """\
inputs.elevon_left: {expression: "de + da", unit: deg}, inputs.elevon_right: {expression: "de - da", unit: deg},
      inputs.fin: {column: dr, unit: deg},"""
#: A parameter, the same of the flying wing in the docs, and what that is multiplied by.
PAIRS = [
    ("Cm_de", "Cm_elevon_left+elevon_right", 2.0),
    ("Cl_da", "Cl_elevon_left-elevon_right", 2.0),
    ("Cn_dr", "Cn_fin", 1.0),
    ("CZ_alpha", "CZ_alpha", 1.0),
]
REPOSITORY = Path(__file__).resolve().parents[2]


def call(capsys, *arguments):
    capsys.readouterr()
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def refused(capsys, *arguments):
    capsys.readouterr()
    assert main([*map(str, arguments)]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line


def file_of(path, source, **changes):
    path.write_text(yaml.safe_dump({**source, **changes}, sort_keys=False))
    return path


def write_csv(path, columns):
    values = np.stack(list(columns.values()), axis=1)
    np.savetxt(path, values, fmt="%.12g", delimiter=",", header=",".join(columns), comments="")


def write_tables(flight, folder):
    """The flight as four CSV files, with units of flight tests."""
    of = {stream.topic: stream.fields for stream in flight.streams}
    t = {stream.topic: (stream.stamp - flight.streams[0].stamp[0]) * 1e-9 + 10.0 for stream in flight.streams}
    force, rate = (of["imu/data"][name] * [1, -1, -1] for name in ("linear_acceleration", "angular_velocity"))
    imu = dict(zip(("fx", "fy", "fz", "P", "Q", "R"), np.hstack([force, np.degrees(rate)]).T, strict=True))
    write_csv(folder / "imu.csv", {"t": t["imu/data"], **imu})
    place = [of["gps/fix"][name] for name in ("latitude", "longitude", "altitude")]
    velocity = ned_from_enu(of["gps/vel"]["twist.linear"]).T
    gps = dict(zip(("lat", "lon", "alt", "vn", "ve", "vd"), [*place, *velocity], strict=True))
    write_csv(folder / "gps.csv", {"t": t["gps/fix"], **gps})
    air, controls = of["air_data"], of["control_surfaces"]
    flow = {"AOA": np.degrees(air["angle_of_attack"]), "AOS": np.degrees(air["sideslip"])}
    air = {"TAS": air["true_airspeed"] / KNOT, **flow, "Ps": air["static_pressure"], "rho": air["air_density"]}
    write_csv(folder / "air.csv", {"t": t["air_data"], **air})
    angles = {short: np.degrees(controls[name]) for short, name in (("de", "elevator"), ("da", "aileron"))}
    angles |= {"dr": np.degrees(controls["rudder"]), "T": controls["thrust"]}
    tab = {"dte": of["inputs"]["position"][:, 0]} if "inputs" in of else {}
    write_csv(folder / "controls.csv", {"t": t["control_surfaces"], **angles, **tab})


@pytest.fixture(scope="module")
def flight(aircraft):
    """36 s with a trim tab that the model knows nothing of; its recording is in degrees."""
    with_tab = aircraft_from_dict({**aircraft.source, "inputs": {"trim_tab": {"unit": "deg"}}})
    return simulate_samples(with_tab, seed=3, duration=36.0, effects=[Effect("Cm", "trim_tab", TRUE)])


@pytest.fixture(scope="module")
def tables(flight, tmp_path_factory):
    folder = tmp_path_factory.mktemp("tables")
    write_tables(flight, folder)
    return folder


@pytest.mark.long
def test_from_columns_to_a_term_whose_derivative_is_the_true_one(flight, tables, tmp_path, capsys):
    text = MAP.replace("SURFACES", SURFACES + " inputs.trim_tab: {column: dte, unit: deg},")
    (tmp_path / "map.yaml").write_text(text)
    report = call(capsys, "import", tables, "--map", tmp_path / "map.yaml", "--out", tmp_path / "bag")
    assert report["topics"]["inputs"]["messages"] == report["topics"]["control_surfaces"]["messages"]
    aircraft = file_of(tmp_path / "aircraft.yaml", flight.aircraft.source, inputs={"trim_tab": None})  # SI
    assert call(capsys, "replay", tmp_path / "bag", "--aircraft", aircraft, "--out", tmp_path / "run")["notes"] == []
    found = call(capsys, "diagnose", tmp_path / "run", "--replicas", 2)
    assert found["candidates"][0]["expression"] == "Cm: trim_tab"
    assert "does not use the input trim_tab" in found["advice"]
    before = call(capsys, "compare", tmp_path / "run")["axes"]["Cm"]["nrmse_held_out"]
    added = call(capsys, "add", tmp_path / "run", "Cm: trim_tab")
    (parameter,) = added["parameters"]
    assert parameter["name"] == "Cm_trim_tab" and parameter["status"] == "USE"
    assert abs(parameter["value"] - TRUE) < 2.0 * parameter["std"] < 0.05 * abs(TRUE)
    after = call(capsys, "compare", tmp_path / "run")["axes"]["Cm"]
    assert after["nrmse_held_out"] < 0.15 * before
    assert after["nrmse_held_out"] < 1.3 * after["noise_floor"]
    again = call(capsys, "replay", tmp_path / "bag", "--aircraft", added["aircraft"], "--out", tmp_path / "again")
    (online,) = [p for p in again["parameters"]["parameters"] if p["name"] == "Cm_trim_tab"]
    assert online["status"] == "USE" and abs(online["value"] - TRUE) < 3.0 * online["std"] < 0.1 * abs(TRUE)
    options = ["--method", "output-error", "--segment", "6"]
    refined = call(capsys, "refine", tmp_path / "again", *options)["parameters"]
    (whole,) = [p for p in refined if p["name"] == "Cm_trim_tab"]
    assert whole["value"] == pytest.approx(TRUE, rel=0.05)


@pytest.mark.long
def test_elevons_alone_say_what_elevator_and_aileron_say(flight, tables, tmp_path, capsys):
    """A recording without elevator, aileron and rudder: the same numbers by other names."""
    example = (REPOSITORY / "docs" / "aircraft-file.md").read_text().split("```yaml")[1].split("```")[0]
    wing = file_of(tmp_path / "wing.yaml", flight.aircraft.source, **yaml.safe_load(example))
    plane = file_of(tmp_path / "plane.yaml", flight.aircraft.source, inputs={})
    runs = {}
    for name, columns, aircraft in (("wing", ELEVONS, wing), ("plane", SURFACES, plane)):
        (tmp_path / f"{name}.map").write_text(MAP.replace("SURFACES", columns))
        bag = tmp_path / f"{name}_bag"
        call(capsys, "import", tables, "--map", tmp_path / f"{name}.map", "--out", bag)
        run = call(capsys, "replay", bag, "--aircraft", aircraft, "--out", tmp_path / name)
        assert run["notes"] == []
        runs[name] = {p["name"]: p for p in run["parameters"]["parameters"]}
    samples = read_recording(tmp_path / "wing_bag").samples
    assert np.isnan(samples.values[samples.kind == Kind.CONTROLS, :4]).all()
    for short, other, factor in PAIRS:
        one, same = runs["plane"][short], runs["wing"][other]
        # without the trim tab the value of the elevator is less than half of the true one, and is held for that
        assert one["status"] == same["status"] == ("HOLD" if short == "Cm_de" else "USE")
        # what a term must exceed to be learnt differs a little
        assert abs(factor * same["value"] - one["value"]) < 0.1 * one["std"]
    errors = {name: call(capsys, "compare", tmp_path / name)["axes"] for name in runs}
    for axis, compared in errors["plane"].items():
        assert errors["wing"][axis]["nrmse_held_out"] == pytest.approx(compared["nrmse_held_out"], rel=1e-3)


@pytest.mark.long
def test_an_input_that_the_flight_lacks_is_named_and_its_term_can_go(aircraft, tmp_path, capsys):
    write_flight(simulate_samples(aircraft, seed=4, duration=30.0), tmp_path / "bag")
    terms = {"Cm": [1, "alpha", "q", "de", "trim_tab"]}
    source = {**aircraft.source, "inputs": {"trim_tab": None, "spoiler": None}, "model": terms}
    file = file_of(tmp_path / "aircraft.yaml", source)
    run = call(capsys, "replay", tmp_path / "bag", "--aircraft", file, "--out", tmp_path / "run")
    assert run["notes"] == [
        "/inputs holds no value of trim_tab, spoiler inside its limits: terms that read it are not learnt"
    ]
    (without,) = [p for p in run["parameters"]["parameters"] if p["name"] == "Cm_trim_tab"]
    assert without["status"] == "HOLD" and "trim_tab" in without["reason"]
    compared = call(capsys, "compare", tmp_path / "run")["axes"]["Cm"]
    assert compared["nrmse_held_out"] is None and "it needs trim_tab, which is not measured" in compared["reason"]
    line = refused(capsys, "add", tmp_path / "run", "CZ: spoiler*alpha")
    assert line.endswith("'CZ: spoiler*alpha' needs spoiler, which this flight does not have")
    assert "is not a signal: did you mean flaps?" in refused(capsys, "add", tmp_path / "run", "CZ: flaperon")
    removed = call(capsys, "remove", tmp_path / "run", "Cm: trim_tab")
    assert removed["axes"]["Cm"]["error_before"] is None and removed["axes"]["Cm"]["error_after"] < 0.2
    assert removed["verdict"] == "without 'Cm: trim_tab' this flight fits Cm, which it did not before"
    assert call(capsys, "compare", tmp_path / "run")["axes"]["Cm"]["nrmse_held_out"] < 0.2


def test_an_aircraft_that_names_none_is_told_the_same_as_without_the_topic(flight, aircraft, tmp_path, capsys):
    write_flight(flight, tmp_path / "bag")
    write_flight(replace(flight, streams=[s for s in flight.streams if s.topic != "inputs"]), tmp_path / "plain")
    file = file_of(tmp_path / "aircraft.yaml", aircraft.source)
    for name in ("bag", "plain"):
        call(capsys, "replay", tmp_path / name, "--aircraft", file, "--out", tmp_path / f"run_{name}")
    notes = call(capsys, "replay", tmp_path / "bag", "--aircraft", file, "--out", tmp_path / "again")["notes"]
    assert [note for note in notes if note.startswith("/inputs holds trim_tab, which the aircraft file does not name")]
    texts = [(tmp_path / f"run_{name}" / "parameters.json").read_text() for name in ("bag", "plain")]
    assert texts[0] == texts[1]
