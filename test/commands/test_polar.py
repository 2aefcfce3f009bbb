"""The drag polar of a flight: its law, a flight of another maker from table to polar, and what is refused."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aircraft_sysid_ros.after_flight import drag_polar as module
from aircraft_sysid_ros.after_flight.drag_polar import (
    GLIDING,
    POWER,
    THRUST,
    Windows,
    drag_polar,
    fit,
    polar_json,
    windows_of,
)
from aircraft_sysid_ros.aircraft.atmosphere import pressures
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.samples import Kind, Samples, concatenate
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks" / "makers"))

from point_mass import make

SECOND = 10**9
DRIFT = ("sensors", "airspeed", "drift")
TRUE = {"CD0": 0.035, "k": 0.045, "efficiency": 0.6}


def windows(seed: int, noise: float, driven: bool, lift_range: tuple[float, float] = (0.3, 1.3)) -> Windows:
    """Mean powers that obey the balance of energy, with an error of ``noise`` W that is correlated over windows."""
    random = np.random.default_rng(seed)
    count = 240
    lift = np.interp(np.arange(count), np.arange(0, count, 20), random.uniform(*lift_range, count // 20))
    speed = np.sqrt(2.0 * 5.0 * 9.8 / (1.2 * 0.8 * lift))
    area = 0.5 * 1.2 * speed**3 * 0.8
    brought = np.repeat(random.choice([0.0, 60.0, 150.0], count // 20), 20) if driven else np.zeros(count)
    error = np.convolve(random.normal(0.0, noise, count + 9), np.full(10, 10.0**-0.5), "valid")
    gained = TRUE["efficiency"] * brought - area * (TRUE["CD0"] + TRUE["k"] * lift**2) + error
    drag = np.column_stack([area, area * lift**2])
    return Windows(gained, brought, np.zeros(count), drag, np.zeros(count, np.int64), lift, speed, 1.2)


@pytest.mark.parametrize(("driven", "method"), [(True, POWER), (False, GLIDING)])
def test_without_errors_the_polar_is_exact(driven, method):
    found = fit(windows(0, 0.0, driven), method)
    assert found.values == pytest.approx([TRUE[name] for name in found.names])
    assert found.explained == pytest.approx(1.0)


def test_standard_errors_hold_what_is_correlated():
    """Over 200 flights 95 % intervals hold the truth in 90 to 99 %: of twelve stretches no more can be asked."""
    inside = np.zeros(3)
    for seed in range(200):
        found = fit(windows(seed, 4.0, True), POWER)
        inside += np.abs(found.values - [TRUE[name] for name in found.names]) < 1.96 * found.std
    assert np.all((inside >= 180) & (inside <= 198)), inside


@pytest.mark.parametrize(("borders", "explained"), [((), 0.0), ((14,), 1.0)])
def test_a_window_is_not_held_out_from_those_that_share_its_data(borders, explained):
    """Of 70 windows the first fold ends at the 14th: what happened there was in the fit of the next one, too."""
    columns, number = np.zeros((70, 2)), np.searchsorted(borders, np.arange(70), side="right")
    columns[:, 0], columns[[13, 14], 1] = 1.0, 1.0
    found = module._explained(columns, columns[:, 1], number)
    assert found == pytest.approx(explained, abs=0.05)


def test_best_glide_follows_from_the_polar():
    said = polar_json(fit(windows(1, 0.5, False), GLIDING), 5.0, 0.8, 0.0)
    ratio = 0.5 / np.sqrt(TRUE["CD0"] * TRUE["k"])
    assert said["best_glide"]["ratio"] == pytest.approx(ratio, abs=4.0 * said["best_glide"]["std"])
    level = said["level"]
    dynamic = 0.5 * 1.2 * np.array(level["airspeed"]) ** 2 * 0.8
    true = dynamic * level["airspeed"] * (TRUE["CD0"] + TRUE["k"] * (5.0 * 9.80665 / dynamic) ** 2)
    assert np.all(np.abs(level["power"] - true) < 4.0 * np.array(level["std"]))


def test_no_best_glide_of_a_polar_that_explains_too_little():
    """Beside 'too little is explained to give the power of level flight' stood a best glide without a word."""
    found = fit(windows(1, 0.5, False), GLIDING)
    known, doubtful = (polar_json(replace(found, explained=share), 5.0, 0.8, 0.0) for share in (0.6, 0.4))
    assert known["best_glide"] is not None and doubtful["best_glide"] is None


def test_power_that_follows_drag_is_refused():
    same = windows(2, 0.0, True)
    steady = Windows(np.zeros(240), same.drag @ [0.05, 0.07], *(getattr(same, n) for n in ("pushed", "drag", "number")),
                     same.lift, same.speed, 1.2)  # fmt: skip
    with pytest.raises(InputError, match="change together all the time"):
        fit(steady, POWER)


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A driven flight of a point mass as a run, and its truth."""
    place = tmp_path_factory.mktemp("polar")
    truth = make(1, place / "log")
    bag, run = str(place / "bag"), str(place / "run")
    assert main(["import", str(place / "log"), "--map", str(place / "log" / "map.yaml"), "--out", bag]) == 0
    assert main(["replay", bag, "--aircraft", str(place / "log" / "plane.yaml"), "--out", run]) == 0
    return run, truth


def test_stated_errors_of_the_airspeed_are_taken_off(aircraft):
    """A pitot that reads 6 % too much, and more from minute to minute: with a file that says so, the same polar."""
    samples = simulate_samples(aircraft, 1, 100.0, manoeuvres="speeds").samples
    zero = int(samples.stamp.min()) + 20 * SECOND
    shown, since = samples.values.copy(), np.maximum(samples.stamp - zero, 0) / SECOND
    pitot = samples.kind == Kind.AIRSPEED
    shown[pitot, 0] *= 1.06 * (1.0 + 2e-4 * since[pitot])
    said = with_setting(with_setting(aircraft, ("sensors", "airspeed", "scale"), 1.06), DRIFT, 2e-4)
    right = fit(windows_of(aircraft, samples, THRUST, None, 0.0), THRUST)
    found = fit(windows_of(said, Samples(samples.stamp, samples.kind, shown), THRUST, None, 0.0, zero), THRUST)
    np.testing.assert_allclose(found.values, right.values, rtol=1e-6)


@pytest.mark.long
def test_from_a_table_to_the_polar(flown, pictures, capsys):
    run, truth = flown
    capsys.readouterr()
    assert main(["polar", run, "--power", "electric_power", "--idle", str(truth["idle"]), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    for p in said["parameters"]:
        assert p["value"] == pytest.approx(truth[p["name"]], abs=4.0 * p["std"], rel=0.0)
        assert p["std"] < 0.2 * truth[p["name"]]
    assert said["explained"] > 0.9
    assert Path(said["figure"]).stat().st_size > 20_000 and json.loads(Path(said["file"]).read_text("utf8"))["lift"]
    assert main(["polar", run, "--power", "electric_power"]) == 0
    shown = capsys.readouterr().out
    assert "level flight at" in shown and "the power of the avionics counts as propulsion" in shown


@pytest.mark.long
def test_static_pressure_alone_tells_height_and_density(flown, monkeypatch):
    """Without GPS it had been 0 s of windows with all signals."""
    run, truth = flown
    whole = open_run(run)
    position = whole.samples[whole.samples.kind == Kind.GPS_POSITION]
    bare = whole.samples[~np.isin(whole.samples.kind, (Kind.GPS_POSITION, Kind.AIR))]
    values = np.full((len(position), bare.values.shape[1]), np.nan)
    values[:, 1] = pressures(position.values[:, 2])
    air = Samples(position.stamp, np.full(len(position), int(Kind.AIR), position.kind.dtype), values)
    together = concatenate([bare, air])
    samples = together[np.argsort(together.stamp, kind="stable")]
    aircraft = whole.current.aircraft
    found = fit(windows_of(aircraft, samples, POWER, "electric_power", truth["idle"]), POWER)
    for name, value, std in zip(found.names, found.values, found.std, strict=True):
        assert value == pytest.approx(truth[name], abs=4.0 * std, rel=0.0)
    monkeypatch.setattr(module, "open_run", lambda _: replace(whole, samples=bare))
    with pytest.raises(InputError, match="neither static pressure nor the GPS position was recorded"):
        drag_polar(run, lambda folder, content: ("", []), "electric_power")


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "neither thrust nor power is known: name the input that holds the power of propulsion"),
        (["--power", "watts"], "the aircraft file has no input watts (it has electric_power)"),
        (["--power", "electric_power", "--gliding"], "--power and --gliding contradict each other"),
        (
            ["--power", "electric_power", "--idle", "-3"],
            "the idle power (--idle) must be from 0 to 1e+06 W, not -3",
        ),
    ],
)
def test_what_is_refused_in_a_sentence(flown, capsys, words, sentence):
    capsys.readouterr()
    assert main(["polar", flown[0], *words]) == 2
    said = capsys.readouterr().err
    assert sentence in said and "Traceback" not in said


@pytest.mark.long
def test_where_only_the_drag_shows_diagnose_says_so(flown, capsys):
    assert main(["diagnose", flown[0], "--replicas", "2"]) == 0
    assert "nothing could be looked for" in capsys.readouterr().out


@pytest.mark.long
def test_a_real_flight_as_its_notes_have_it(shared_data, tmp_path, capsys):
    """Solar Surfer: the split between drag and efficiency is loose, the power of level flight at 10 m/s is not."""
    where = [str(tmp_path / name) for name in ("map.yaml", "bag", "run")]
    assert main(["import", str(shared_data / "mit_seaway"), "--guess", where[0]]) == 0
    assert main(["import", str(shared_data / "mit_seaway"), "--map", where[0], "--out", where[1]]) == 0
    plane = Path(__file__).parents[2] / "benchmarks" / "aircraft" / "solar_surfer.yaml"
    assert main(["replay", where[1], "--aircraft", str(plane), "--out", where[2]]) == 0
    capsys.readouterr()
    assert main(["polar", where[2], "--power", "electric_power", "--idle", "5", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    known = {p["name"]: (p["value"], p["std"]) for p in said["parameters"]}
    # a wing of aspect ratio 12 with an Oswald factor from 0.6 to 1 has k from 0.026 to 0.044; no propeller has all
    assert known["k"][0] + 2.0 * known["k"][1] > 0.026 and 0.2 < known["efficiency"][0] < 0.85
    level = said["level"]
    power = float(np.interp(10.0, level["airspeed"], level["power"]))
    assert 60.0 < power < 160.0 and float(np.interp(10.0, level["airspeed"], level["std"])) < 0.25 * power
    assert main(["diagnose", where[2]]) == 0
    assert "nothing could be looked for" in capsys.readouterr().out
