"""Inputs that the aircraft file names, in a check: which move, how they come, where they end, what they can show."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.flight_check.check import check
from aircraft_sysid_ros.flight_check.laws.values import saturated
from aircraft_sysid_ros.flight_check.signals import flight_of
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight

LIMITS = (-0.3, 0.3)  # [rad]


@pytest.fixture(scope="module")
def plane(aircraft):
    """A trim tab and a spoiler as inputs, and terms that read them."""
    terms = {"CZ": [1, "alpha", "q", "de", "spoiler"], "Cm": [1, "alpha", "q", "de", "trim_tab"]}
    inputs = {"trim_tab": {"limits": list(LIMITS)}, "spoiler": None}
    values = {**aircraft.coefficients, "Cm_trim_tab": -0.3, "CZ_spoiler": 0.5}
    return aircraft_from_dict({**aircraft.source, "model": terms, "inputs": inputs, "coefficients": values})


@pytest.fixture(scope="module")
def flown(plane):
    return simulate_samples(plane, seed=81, duration=80.0)


def changed(samples: Samples, change) -> Samples:
    """The samples with the inputs (n, 2) made others by a function of them and of the time [s] (n,)."""
    rows, values = samples.kind == Kind.INPUTS, samples.values.copy()
    values[rows, :2] = change(values[rows, :2].copy(), (samples.stamp[rows] - samples.stamp.min()) * 1e-9)
    return Samples(samples.stamp, samples.kind, values)


def found_in(plane, samples):
    checked = check(flight_of(samples, samples.stamp, plane.inputs, surface_noise=0.0005), plane.model)
    said = {(s, f.kind): f.sentence for f in checked.findings for s in f.signals if s.startswith("inputs.")}
    return said, {p.name: p for p in checked.parameters}, checked


@pytest.mark.long
def test_inputs_that_move_have_rates_and_show_what_replay_then_uses(plane, flown):
    said, parameters, checked = found_in(plane, flown.samples)
    assert said == {}
    assert checked.rates["inputs.trim_tab"] == pytest.approx(50.0, rel=0.01)
    pipeline = Pipeline(plane)
    pipeline.push(flown.samples)
    pipeline.flush()
    used = {p.name: p.status.name == "USE" for p in pipeline.parameters.snapshot().parameters}
    for name in ("Cm_trim_tab", "CZ_spoiler"):
        assert parameters[name].is_shown and used[name], parameters[name]


@pytest.mark.long
def test_one_that_stands_still_shows_nothing_and_hides_nothing_else(plane, flown):
    def standing(values, time):
        values[:, 1] = 0.1
        return values

    said, parameters, _ = found_in(plane, changed(flown.samples, standing))
    assert said.keys() == {("inputs.spoiler", "held")} and "stays at 0.1" in said["inputs.spoiler", "held"]
    assert not parameters["CZ_spoiler"].is_shown and parameters["CZ_alpha"].is_shown
    assert parameters["Cm_trim_tab"].is_shown


def slow(values, time):
    """Two a second."""
    values[np.arange(len(values)) % 25 != 0, 0] = np.nan
    return values


def stepped(values, time):
    """Five new values a second, each repeated."""
    values[:, 0] = values[np.arange(len(values)) // 10 * 10, 0]
    return values


def clipped(values, time):
    values[:, 0] = np.clip(20.0 * values[:, 0], *LIMITS)
    return values


def degrees(values, time):
    values[:, 0] = np.degrees(10.0 * values[:, 0])
    return values


def faulty(values, time):
    values[100, 0] = 1e9
    return values


def multistep(values, time):
    """A command of a 3-2-1-1 again and again: three values at regular times."""
    values[:, 0] = np.take([0.1, 0.1, 0.1, -0.1, -0.1, 0.1, -0.1, 0.0], (time // 0.5).astype(int) % 8)
    return values


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        (slow, "rate", "it moves and comes at 2 Hz"),
        (stepped, "held", "repeated 10.0 times"),
        (clipped, "saturated", "at its limits, -0.3 and 0.3"),
        (degrees, "unit", "outside its limits, -0.3 to 0.3 in SI"),
        (faulty, "noise", "1 of 4000 values, up to 1e+09"),
        (multistep, None, ""),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_what_is_wrong_with_one_is_said_of_that_one(plane, flown, change, kind, words):
    said, _, _ = found_in(plane, changed(flown.samples, change))
    assert {name for name, _ in said} <= {"inputs.trim_tab"}
    assert {k for _, k in said} - {"gap"} == ({kind} if kind else set())
    if kind:
        assert words in said["inputs.trim_tab", kind]


@pytest.mark.long
def test_values_outside_the_limits_count_as_little_as_in_replay(plane, flown):
    """In degrees nearly all are left out: the term has too few values, and its axis says nothing."""
    _, parameters, _ = found_in(plane, changed(flown.samples, degrees))
    assert not parameters["Cm_trim_tab"].is_shown and parameters["CZ_spoiler"].is_shown


@pytest.mark.long
def test_an_aeroplane_of_elevons_alone_lacks_no_elevator(aircraft, flown):
    """The columns of the flight under other names: what the terms read is there."""
    terms = {"CY": [1, "beta"], "CZ": [1, "alpha"], "CX": [1, "alpha"]}
    terms |= {"Cl": [1, "p", "left-right"], "Cm": [1, "q", "left+right"], "Cn": [1, "r"]}
    inputs = {"left": None, "right": None}
    wing = aircraft_from_dict({**aircraft.source, "model": terms, "inputs": inputs})
    samples = flown.samples[flown.samples.kind != Kind.CONTROLS]
    _, _, checked = found_in(wing, samples)
    assert not [f for f in checked.findings if f.kind == "missing" and {"elevator", "rudder"} & {*f.signals}]
    _, _, checked = found_in(wing, samples[samples.kind != Kind.INPUTS])
    (finding,) = [f for f in checked.findings if "inputs.left" in f.signals]
    assert (finding.kind, finding.severity) == ("missing", "warning") and "no derivatives" in finding.sentence


def test_an_input_that_no_term_reads_is_no_control_and_may_be_off(aircraft, flown):
    """The power of a motor, and no surfaces: explain had called such a flight one with too little motion."""

    def power(values, time):
        values[:, 0] = np.where(time % 8.0 < 3.0, 0.0, 90.0 + np.random.default_rng(1).normal(size=len(time)))
        return values

    plane = aircraft_from_dict({**aircraft.source, "inputs": {"power": {"unit": "W"}}})
    samples = changed(flown.samples[flown.samples.kind != Kind.CONTROLS], power)
    said, _, checked = found_in(plane, samples)
    assert ("inputs.power", "saturated") not in said
    (finding,) = [f for f in checked.findings if "elevator" in f.signals]
    assert (finding.kind, finding.severity) == ("missing", "warning") and "no derivatives" in finding.sentence
    assert "inputs.power" not in finding.signals


@pytest.mark.long
def test_the_command_looks_at_them_with_an_aircraft_file_and_names_them_without(plane, flown, tmp_path, capsys):
    write_flight(flown, tmp_path / "bag")
    assert main(["check", str(tmp_path / "bag")]) == 0
    out = capsys.readouterr().out
    assert "trim_tab and spoiler" in out and "--aircraft" in out and "inputs.trim_tab" not in out
    (tmp_path / "plane.yaml").write_text(yaml.safe_dump(plane.source, sort_keys=False))
    assert main(["check", str(tmp_path / "bag"), "--aircraft", str(tmp_path / "plane.yaml")]) == 0
    out = capsys.readouterr().out
    assert "inputs.{trim_tab,spoiler}" in out and "Cm_trim_tab" in out.split("not shown")[0]


def test_a_noisy_input_at_its_stop_is_no_sensor_whose_range_ends():
    """The command of a stuck elevon ran into its limit: `explain` had asked for a sensor of a larger range."""
    time = np.arange(0.0, 40.0, 0.02)
    values = np.clip(0.3 * np.sin(time) + 0.01 * np.random.default_rng(1).normal(size=len(time)), -0.2, 0.2)
    for name, severity, words in (("inputs.elevon", "info", "a control at its stop"), ("q", "warning", "larger range")):
        found = saturated(name, values, time)
        assert {finding.severity for finding in found} == {severity}
        assert len(found) == 2 and all(words in finding.sentence for finding in found)
