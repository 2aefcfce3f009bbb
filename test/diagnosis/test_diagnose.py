"""The diagnosis of whole flights: it names what is hidden, and says none, or unexplained, when that is the truth."""

from __future__ import annotations

import json
import warnings
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from test_tied_fit import flight_of as random_flight

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.commands.diagnose import render
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.diagnose import diagnose
from aircraft_sysid_ros.diagnosis.finding import Finding, NestedValidation, is_simpler
from aircraft_sysid_ros.diagnosis.flight.reconstruction import (
    fit_sensor_noise,
    fit_wind_noise,
    flying,
    reconstruct,
    reconstruct_as_flown,
    settled_flight,
)
from aircraft_sysid_ros.diagnosis.flight_answer import answer
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight, with_best_setting
from aircraft_sysid_ros.diagnosis.measurement.faults import measurement_faults
from aircraft_sysid_ros.diagnosis.measurement.maximum import maximum
from aircraft_sysid_ros.diagnosis.measurement.setting import Setting
from aircraft_sysid_ros.diagnosis.search.candidates import Candidate
from aircraft_sysid_ros.diagnosis.search.evaluator import CandidateEvaluator
from aircraft_sysid_ros.diagnosis.significance.bootstrap_flight import world_of
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import (
    Replica,
    fitted_parameters,
    without_excess,
)
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.diagnosis.words import FlightDiagnosis
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import Variant, with_setting
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.run_writer import RunWriter
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.dynamics import Effect as Term
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, hidden_flight, simulate_samples

SOME = [
    BY_ID[name]
    for name in ("dihedral_alpha", "sideslip_drag", "alpha_dot", "adverse_yaw", "control_damage", "propeller_torque")
]
DIHEDRAL, DRAG = Term("Cl", "alpha*beta", -0.8), Term("CX", "beta**2", -1.0)


def flight_of(aircraft, *effects, seed=11, duration=90.0, **options):
    return simulate_samples(aircraft, seed=seed, duration=duration, effects=effects, **options)


@pytest.fixture(scope="module")
def two_effects(aircraft):
    """A flight in light turbulence with two effects that its file does not know, diagnosed."""
    flight = flight_of(aircraft, DIHEDRAL, DRAG, turbulence="light")
    return diagnose_flight(aircraft, flight.samples, SOME, replicas=4)


@pytest.mark.long
@pytest.mark.parametrize("turbulence", [pytest.param("none", marks=pytest.mark.long), "light"])
def test_nothing_is_missing_in_a_clean_flight(aircraft, turbulence):
    found = diagnose_flight(aircraft, flight_of(aircraft, turbulence=turbulence).samples, SOME, replicas=2)
    assert found.verdict == "none" and not found.diagnosis.found
    assert "Nothing is missing" in found.json["advice"]
    for axis, floor in found.diagnosis.floor.items():
        assert found.diagnosis.bench.fits[axis].nrmse_held_out < 1.3 * floor


@pytest.mark.long
def test_two_effects_are_found_one_after_another(two_effects):
    said = two_effects.json
    assert said["verdict"] == "missing"
    assert {c["effect"] for c in said["candidates"] if c["found"]} == {"dihedral_alpha", "sideslip_drag"}
    for candidate in said["candidates"][:2]:
        assert (
            candidate["p_value"] < THRESHOLDS.false_alarm and candidate["error_after"] < 0.6 * candidate["error_before"]
        )


@pytest.mark.long
def test_a_stall_with_a_memory_is_told_from_one_without(aircraft):
    """Of what bends lift it alone explains the loop: named first, and with its time the error falls to a fifth."""
    rivals = [BY_ID[n] for n in ("dynamic_stall", "stall", "lift_nonlinearity", "control_effectiveness_alpha")]
    flight = simulate_samples(aircraft, 41, 90.0, rate=200.0, hidden=[("dynamic_stall", 1.0)])
    found = diagnose_flight(aircraft, flight.samples, rivals, replicas=2)
    best = found.json["candidates"][0]
    assert found.verdict == "missing" and best["effect"] == "dynamic_stall"
    assert best["error_after"] < 0.2 * best["error_before"]
    inner = dict(found.diagnosis.found[0].trial.candidate.inner)
    assert inner["lag"] == pytest.approx(flight.hidden[0].inner["lag"], rel=0.5)


@pytest.mark.long
def test_another_shape_of_what_was_found_is_no_further_effect(aircraft):
    """Flaps whose lift and moment are not in proportion: one name, and what to add for the shape."""
    rivals = [BY_ID[name] for name in ("flaps", "landing_gear", "sideslip_drag", "mass_change")]
    curved = Term("CZ", "flaps**3", 8.0), Term("Cm", "flaps**3", 2.0)
    flight = simulate_samples(aircraft, 21, 90.0, rate=200.0, hidden=[("flaps", 1.0)], effects=curved)
    said = diagnose_flight(aircraft, flight.samples, rivals, replicas=2).json
    (found,) = [c for c in said["candidates"] if c["found"]]
    assert found["effect"] == "flaps" and found["shape"]["Cm"] == "flaps**3"
    assert 'add the expression "Cm: flaps**3", too' in said["advice"]


@pytest.mark.long
def test_what_hardly_moves_a_coefficient_does_not_matter(two_effects):
    finding = two_effects.diagnosis.found[0]
    axis = finding.trial.main_axis
    gain = finding.trial.gains[axis]
    fit = copy(gain.fit)
    fit.spread *= gain.nrmse_before / 0.019  # so much more does the coefficient move
    del fit.nrmse_held_out
    small = replace(gain, fit=fit, after=gain.before * (0.014 / 0.019) ** 2)
    assert (small.nrmse_before, small.nrmse_after) == (pytest.approx(0.019), pytest.approx(0.014))
    assert finding.matters
    assert not replace(finding, trial=replace(finding.trial, gains={**finding.trial.gains, axis: small})).matters


@pytest.mark.long
def test_a_further_effect_lowers_the_error_as_it_is_added(two_effects):
    finding = two_effects.diagnosis.found[1]
    idle = CandidateEvaluator(finding.flight).best_of(BY_ID["propeller_torque"])
    assert finding.lowers_the_error()
    assert idle is not None and not replace(finding, trial=idle).lowers_the_error()


@pytest.mark.long
def test_the_size_of_an_effect_is_that_of_the_simulation(two_effects):
    values = {p["term"]: p["value"] for c in two_effects.json["candidates"][:2] for p in c["parameters"]}
    assert values["alpha*beta"] == pytest.approx(-0.8, rel=0.05)


@pytest.mark.long
def test_with_what_was_found_the_error_is_that_of_the_truth(two_effects):
    for axis in ("Cl", "CX"):
        assert two_effects.diagnosis.bench.fits[axis].nrmse_held_out < 1.4 * two_effects.diagnosis.floor[axis]


@pytest.mark.long
def test_a_servo_that_follows_with_a_lag_is_late_and_has_no_limit_of_its_rate() -> None:
    """A delay is a simple picture of a lag: what that left had been a rate limit, and C_m by alpha_dot."""
    slow = SensorOptions(command_lag=0.06, attitude=True)
    flown = simulate_samples(default_aircraft(), 84, 100.0, manoeuvres="varied", sensors=slow)
    said = answer(default_aircraft(), flown.samples, replicas=5)
    assert [c["label"] for c in said["candidates"] if c["found"]] == ["actuator_lag (lag of the servos)"]
    assert said["candidates"][0]["inner"] == {"lag": pytest.approx(0.06, abs=0.01)}
    assert any("a lag that was found in this flight" in note for note in said["notes"])


@pytest.mark.long
def test_an_effect_outside_the_library_is_unexplained_and_not_given_another_name(two_effects):
    library = [effect for effect in SOME if effect.identifier != "dihedral_alpha"]
    without = diagnose(CandidateEvaluator(two_effects.flight), two_effects.replicas, library)
    best = max(without.found, key=lambda f: f.excess)
    assert without.verdict == "unexplained"
    assert best.trial.candidate.effect is None and best.trial.candidate.label == "Cl: alpha*beta"


@pytest.mark.long
def test_the_json_is_that_of_the_interface(two_effects):
    said = json.loads(json.dumps(two_effects.json))
    assert {"verdict", "candidates", "advice"} <= set(said)
    keys = {"effect", "expression", "axes", "evidence", "p_value", "error_before", "error_after"}
    keys |= {"confounded_with", "where"}
    for candidate in said["candidates"]:
        assert keys <= set(candidate)
        assert set(candidate["axes"]) <= set(AXES)
        assert bool(candidate["refused"]) != candidate["found"]


# -- replicas ------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_replica_of_a_flight_with_an_effect_is_as_noisy_as_a_flight_without(aircraft):
    """The effect is known in the world of the replica and taken off: what is left is the noise of the chain."""
    with_effect, clean = flight_of(aircraft, DIHEDRAL), flight_of(aircraft)
    made = reconstruct(aircraft, with_effect.samples)
    rows = flying(made.rows, aircraft.minimum_airspeed)
    parameters = fitted_parameters(settled_flight(made))
    world = world_of(made, [rows], parameters, seed=1)
    replica = CandidateEvaluator(without_excess(world, reconstruct(world.aircraft, world.samples(1))))
    honest = CandidateEvaluator(settled_flight(reconstruct(aircraft, clean.samples)))
    spoilt = CandidateEvaluator(settled_flight(made))
    assert spoilt.fits["Cl"].nrmse_held_out > 5.0 * honest.fits["Cl"].nrmse_held_out
    for axis in AXES:
        assert replica.fits[axis].nrmse_held_out == pytest.approx(honest.fits[axis].nrmse_held_out, rel=0.35)


def test_the_noise_of_replicas_that_repeat_a_part_of_the_flight_is_that_of_the_flight(aircraft):
    """Replicas of the livelier half of a flight had two thirds of its error, since the coefficients vary more there."""
    data = settled_flight(reconstruct(aircraft, flight_of(aircraft).samples, with_covariance=False))
    motion, place = np.abs(np.nan_to_num(data.signal("q"))), np.unique(data.block, return_inverse=True)[1]
    mean = np.bincount(place, motion) / np.bincount(place)
    lively = (mean > np.median(mean))[place]
    repeated = replace(data, measured=np.where(lively[:, None], data.measured, np.nan))
    bench = CandidateEvaluator(data)
    floor = diagnose(bench, [Replica(repeated, {}, {})] * 2, []).floor
    for axis in ("CY", "CZ", "Cl", "Cm", "Cn"):
        assert floor[axis] == pytest.approx(bench.fits[axis].nrmse_held_out, rel=0.15)


# -- measurement ---------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_wrong_scale_of_the_vane_is_found_before_aerodynamics_is_blamed(aircraft):
    """The file says 1, the vane shows 15 % more; the first step's likelihood alone knows."""
    truth = with_setting(aircraft, ("sensors", "angle_of_attack", "scale"), 1.15)
    samples = simulate_samples(truth, seed=4, duration=60.0).samples
    made = reconstruct(aircraft, samples, with_covariance=False)
    faults = measurement_faults(made, [BY_ID["alpha_scale"], BY_ID["beta_scale"]], fit_wind_noise(aircraft, samples)[1])
    assert [f.effect.identifier for f in faults][:1] == ["alpha_scale"]
    assert faults[0].value == pytest.approx(1.15, abs=0.03)
    assert not measurement_faults(reconstruct(truth, samples, with_covariance=False), [BY_ID["alpha_scale"]], True)


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "unit"), [("alpha_drift", "deg"), pytest.param("airspeed_drift", "%", marks=pytest.mark.long)]
)
def test_a_slow_drift_of_the_air_data_is_found_before_aerodynamics_is_blamed(aircraft, effect, unit):
    flight = simulate_samples(aircraft, 21, 90.0, hidden=[(effect, 1.0)])
    found = diagnose_flight(aircraft, flight.samples, [BY_ID["alpha_drift"], BY_ID["airspeed_drift"]], 2).json
    ((_, rate),) = flight.hidden[0].settings
    first = found["candidates"][0]
    assert (found["verdict"], first["effect"]) == ("missing", effect)
    assert first["inner"]["drift"] == pytest.approx(rate, rel=0.15)
    assert f" per minute {'more' if rate > 0.0 else 'less'} since the flight began" in first["where"]
    each = abs(first["inner"]["drift"]) * 60.0 * (100.0 if unit == "%" else np.degrees(1.0))
    assert f"it shows {each:.2g} {unit} per minute" in first["where"]


@pytest.mark.long
def test_gusts_are_no_drift(aircraft):
    """A drift counts where the air is calm once it is taken off: here it is not."""
    samples = simulate_samples(aircraft, 22, 60.0, turbulence="light").samples
    flight, calm = reconstruct_as_flown(aircraft, samples, with_covariance=False)
    assert not calm
    feigned = Setting(BY_ID["alpha_drift"], BY_ID["alpha_drift"].variants[0], 0.0, 1e-4, 100.0, 5.0, 1e-5)
    assert feigned.feigns_wind and with_best_setting([feigned], aircraft, flight, calm, 1) is None


def test_faults_of_transmission_do_not_count_as_noise(aircraft):
    """Values that no aircraft has, and a sensor that only sends them: no warning, and the same noise to 5 %."""
    samples = flight_of(aircraft, duration=30.0).samples
    values, random = samples.values.copy(), np.random.default_rng(0)
    values[random.choice(len(values), 200), 0] = random.choice([1e300, -1e300, np.inf, np.nan], 200)
    values[samples.kind == Kind.SIDESLIP, 0] = 1e300
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found, known = fit_sensor_noise(aircraft, replace(samples, values=values)), fit_sensor_noise(aircraft, samples)
    for name in ("accelerometer", "gyro", "airspeed"):
        assert found.sensors[name].noise[0] == pytest.approx(known.sensors[name].noise[0], rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize("scale", [pytest.param(0.5, marks=pytest.mark.long), 2.0])
def test_noise_that_the_file_does_not_know_is_no_fault_of_a_scale(aircraft, scale):
    """Sensors twice or half as noisy as the file says: the flight tells, and no setting is preferred for it."""
    flight = flight_of(aircraft, duration=60.0, sensors=SensorOptions(noise_scale=scale), turbulence="light")
    seen = fit_sensor_noise(aircraft, flight.samples)
    for name in ("accelerometer", "gyro", "airspeed", "angle_of_attack", "sideslip"):
        factor = seen.sensors[name].noise[0] / aircraft.sensors[name].noise[0]
        assert 0.9 * scale < factor < (1.0 if scale < 1.0 else 1.2 * scale)  # quiet sensors show fast motion too
    windy, calm = fit_wind_noise(seen, flight.samples)
    made = reconstruct(windy, flight.samples, with_covariance=False)
    scales = [BY_ID[name] for name in ("alpha_scale", "airspeed_scale")]
    assert not measurement_faults(made, scales, calm)


@pytest.mark.parametrize(("start", "top"), [(0.0, 0.31), (0.0, -0.4), (1.0, 1.07)])
def test_the_maximum_of_a_parabola_is_found(start, top):
    place, value, curvature = maximum(lambda x: 100.0 - 50.0 * (x - top) ** 2, start, start - 0.5, start + 0.5, 0.0)
    assert place == pytest.approx(top, abs=1e-6) and value == pytest.approx(100.0) and curvature == pytest.approx(100.0)


def test_the_maximum_at_a_limit_stays_inside():
    place, _, _ = maximum(lambda x: x, 0.0, 0.0, 0.3, 0.0)
    assert 0.1 < place <= 0.3


# -- the command ---------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def run_folder(aircraft, tmp_path_factory):
    flight = flight_of(aircraft, DIHEDRAL, duration=45.0)
    pipeline = Pipeline(aircraft)
    folder = tmp_path_factory.mktemp("diagnose") / "run"
    with RunWriter(folder, aircraft) as writer:
        writer.add_samples(flight.samples)
        for rows, points in (pipeline.push(flight.samples), pipeline.flush()):
            writer.add_rows(rows)
            writer.add_points(points)
        writer.finish(pipeline.state, pipeline.parameters, 45.0, 0.0)
    return folder


@pytest.mark.long
def test_the_command_prints_one_document_and_keeps_it(run_folder, capsys):
    assert main(["diagnose", str(run_folder), "--replicas", "2", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["verdict"], said["candidates"][0]["effect"]) == ("missing", "dihedral_alpha")
    assert json.loads((run_folder / "diagnosis.json").read_text()) == said


@pytest.mark.long
@pytest.mark.parametrize(
    ("arguments", "words"), [(["nowhere"], "is not a run"), (["RUN", "--replicas", "1"], "must be from 2 to 50")]
)
def test_bad_requests_get_one_sentence(run_folder, capsys, arguments, words):
    assert main(["diagnose", *(str(run_folder) if a == "RUN" else a for a in arguments)]) == 2
    error = capsys.readouterr().err.strip()
    assert words in error and "\n" not in error


def without_vanes(flight, late=0.0):
    """Samples without angles of flow, and with controls recorded so many seconds before the surfaces move."""
    samples = flight.samples[~np.isin(flight.samples.kind, (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP))]
    stamp = samples.stamp - np.where(samples.kind == Kind.CONTROLS, round(late * 1e9), 0)
    return replace(samples, stamp=stamp)


@pytest.mark.long
@pytest.mark.parametrize(("seed", "late"), [(41, 0.0), (44, 0.0), (46, 0.1)])
def test_a_delay_of_the_controls_does_not_stand_for_angles_that_are_inferred(aircraft, seed, late):
    """C_Z of the first two gains by a delay, and C_l loses by it: a surface that is late is late in every moment."""
    flight, calm = reconstruct_as_flown(aircraft, without_vanes(flight_of(aircraft, seed=seed, duration=60.0), late))
    found = measurement_faults(flight, [BY_ID["actuator_lag"]], calm)
    if late:
        assert found[0].variant.setting[-1] == "delay" and found[0].value == pytest.approx(-late, abs=0.03)
    else:
        assert found == []


@pytest.mark.long
@pytest.mark.parametrize("inferred", [(), ("beta",)])
def test_what_rests_on_inferred_angles_is_listed_and_not_named(aircraft, inferred):
    """A rolling moment that the model lacks: with a vane it has a name, without one it may be an error of sideslip."""

    def lacking(c, after, f):
        c[:, 3] -= 0.8 * f["alpha"] * f["beta"]
        return c

    library = [BY_ID["dihedral_alpha"], BY_ID["thrust_offset"]]
    flight = replace(random_flight(aircraft, lacking), inferred=inferred)
    benches = [CandidateEvaluator(random_flight(aircraft, seed=seed)) for seed in range(1, 5)]
    repeated = [Replica(b.data, {e.identifier: b.best_of(e).score for e in library}, {}) for b in benches]
    said = FlightDiagnosis(flight, (), diagnose(CandidateEvaluator(flight), repeated, library), repeated, True).json
    assert said["candidates"][0]["effect"] == "dihedral_alpha"
    text = render({**said, "model": "m", "notes": []})
    if not inferred:
        assert (said["verdict"], said["unknown"]) == ("missing", {})
        return
    assert (said["verdict"], [c["label"] for c in said["candidates"] if c["found"]]) == ("none", [])
    assert list(said["unknown"]) == ["Cl"] and said["unknown"]["Cl"] > THRESHOLDS.above_floor
    assert f"The error of C_l is {said['unknown']['Cl']:.1f} times" in said["advice"]
    assert "Nothing is missing" not in said["advice"]
    assert text.startswith("model m: nothing can be named, since the flow angles are not measured")


def test_the_rule_that_refuses_an_effect_of_size_is_said(aircraft):
    """Noise that the replicas have as well: what explains a part of it is no verdict, and the answer says why."""

    def lacking(c, after, f):
        c[:, 3] -= 0.27 * f["alpha"] * f["beta"]
        return c

    library = [BY_ID["dihedral_alpha"]]
    benches = [CandidateEvaluator(random_flight(aircraft, seed=seed)) for seed in range(1, 5)]
    repeated = [Replica(b.data, {e.identifier: b.best_of(e).score for e in library}, {}) for b in benches]
    flight = random_flight(aircraft, lacking)
    found = diagnose(CandidateEvaluator(flight), repeated, library)
    said = FlightDiagnosis(flight, (), found, repeated, True).json
    (candidate,) = found.candidates
    assert candidate.size > THRESHOLDS.size and candidate.above_floor < THRESHOLDS.above_floor
    assert said["verdict"] == "none" and "no effect explains" not in said["advice"]
    assert f"dihedral_alpha would explain {candidate.size:.0%} of the error of C_l" in said["advice"]
    assert said["advice"].startswith("Nothing is clearly missing: dihedral_alpha")  # and not that it could not be seen
    assert f"of C_l ({BY_ID['dihedral_alpha'].name}) but is not named, since" in said["advice"]
    assert "times its noise" in said["advice"]
    far = replace(candidate, above_floor=3.0)
    assert far.refusal(first=True) == "" and far.matters
    assert "p = 0.02" in replace(far, p_value=0.02).refusal(first=True)
    assert "less than 10%" in replace(far, size=0.05).refusal(first=True)
    rarely = replace(far, p_value=1e-6, nested=NestedValidation(("dihedral_alpha", "", "stall", "dihedral_alpha"), 0.2))
    assert "it comes in 2 of 4" in rarely.refusal(first=True) == rarely.refusal(first=False)
    between = replace(rarely, p_value=0.002)  # its own doubt makes later ones need more, and not itself
    assert "it comes in 2 of 4" in between.refusal(first=True) == between.refusal(first=False)
    assert replace(rarely, confounded_with=("stall",)).refusal(first=True) == ""
    unnamed = replace(rarely.trial, candidate=replace(rarely.trial.candidate, effect=None))
    names = ("Cl: p*q", "Cl: p*V", "from 9 s on Cl: 1", "CY: p*q")
    assert replace(rarely, trial=unnamed, nested=NestedValidation(names, 0.2)).times_again == 3


@pytest.mark.long
@pytest.mark.parametrize(("size", "named"), [(1.1, "dihedral_alpha"), (0.8, "sideslip_pitching")])
def test_of_a_surer_effect_and_one_that_explains_clearly_more_that_is_named(aircraft, size, named):
    """That something is missing the first one proves, what it is the other one tells."""

    def lacking(c, after, f):
        c[:, 3] -= size * f["alpha"] * f["beta"]
        c[:, 4] += f["beta"] ** 2
        return c

    library = [BY_ID["dihedral_alpha"], BY_ID["sideslip_pitching"]]
    benches = [CandidateEvaluator(random_flight(aircraft, seed=seed)) for seed in range(1, 7)]
    by_chance = 0.3 * np.random.default_rng(3).normal(size=6)  # as wide as dihedral_alpha is hardly beyond
    repeated = [
        Replica(bench.data, {"dihedral_alpha": score, "sideslip_pitching": 0.001 * score}, {})
        for bench, score in zip(benches, by_chance, strict=True)
    ]
    found = diagnose(CandidateEvaluator(random_flight(aircraft, lacking)), repeated, library)
    chances = {each.trial.candidate.family: each.p_value for each in found.candidates}
    assert chances["sideslip_pitching"] < THRESHOLDS.verdict < chances["dihedral_alpha"] < THRESHOLDS.false_alarm
    assert found.found[0].trial.candidate.family == named


def test_a_rival_with_fewer_numbers_goes_first_where_it_explains_more_of_the_axis(aircraft):
    """What stands for two effects in two axes by one name explains more in all, and less of the one that is there."""

    def lacking(c, after, f):
        c[:, 2] += 12.0 * f["beta"] ** 2
        c[:, 4] += 0.12 * np.abs(f["beta"])
        return c

    def finding(**terms):
        trial = bench.trial(Candidate(None, "", (), {axis: (text,) for axis, text in terms.items()}))
        return Finding(trial, bench.data, 0.0, 0.0, 0.0, 0.0, 0.0)

    bench = CandidateEvaluator(random_flight(aircraft, lacking))
    true, half = finding(CZ="beta**2"), finding(CZ="alpha*beta**2")
    both = finding(CZ="abs(beta)", Cm="abs(beta)")
    assert both.trial.score > true.trial.score and both.trial.main_axis == "CZ"
    assert is_simpler(true, both)
    assert not is_simpler(both, true) and not is_simpler(finding(CX="beta**2"), both)
    assert not is_simpler(half, both)
    assert not is_simpler(finding(CZ="beta**2", Cm="beta**2"), both)


@pytest.mark.long
@pytest.mark.parametrize(("must", "alike"), [((), ("twin",)), (("Cn",), ())])
def test_what_physics_rules_out_is_not_what_it_may_as_well_be(aircraft, must, alike):
    """The same rolling moment, of an effect that may have a yawing moment or must have one, which is not there."""

    def lacking(c, after, f):
        c[:, 3] -= 0.8 * f["alpha"] * f["beta"]
        return c

    terms = {**BY_ID["dihedral_alpha"].variants[0].terms, "Cn": ("alpha*de",)}
    twin = replace(BY_ID["dihedral_alpha"], identifier="twin", variants=(Variant(terms=terms),), shows_in=must)
    library = [BY_ID["dihedral_alpha"], twin]
    benches = [CandidateEvaluator(random_flight(aircraft, seed=seed)) for seed in range(1, 5)]
    repeated = [Replica(b.data, {e.identifier: b.best_of(e).score for e in library}, {}) for b in benches]
    found = diagnose(CandidateEvaluator(random_flight(aircraft, lacking)), repeated, library)
    assert [each.trial.candidate.family for each in found.found] == ["dihedral_alpha"]
    assert found.found[0].confounded_with == alike


@pytest.mark.long
@pytest.mark.parametrize(
    ("lost", "roll", "found", "refused"),
    [
        (0.4, 0.02, ["control_damage"], ""),
        (0.0, 0.02, [], "does not show in C_m and C_Z"),  # what rolls with the elevator, which does its work
        (-0.4, 0.0, [], "has an impossible sign"),  # no damage makes a surface stronger
    ],
)
def test_a_half_that_is_lost_is_missed_in_pitch(aircraft, lost, roll, found, refused):
    """Rolling moment with the elevator from one moment on: half of it is gone only where it does less, too."""

    def lacking(c, after, f):
        for column, name in ((4, "Cm_de"), (2, "CZ_de")):
            c[:, column] -= lost * aircraft.coefficients[name] * after * f["de"]
        c[:, 3] += roll * after * f["de"]
        return c

    library = [BY_ID["control_damage"]]
    benches = [CandidateEvaluator(random_flight(aircraft, seed=seed)) for seed in range(1, 5)]
    repeated = [Replica(b.data, {e.identifier: b.best_of(e).score for e in library}, {}) for b in benches]
    answer = diagnose(CandidateEvaluator(random_flight(aircraft, lacking)), repeated, library)
    named = [each.trial.candidate for each in answer.found if each.trial.candidate.effect is not None]
    assert [each.family for each in named] == found
    first = next(each for each in answer.candidates if each.trial.candidate.family == "control_damage")
    assert refused in first.refusal(first=True)
    if found:
        assert named[0].variant == "one half of the elevator" and first.refusal(first=True) == ""


@pytest.mark.long_after_the_first
@pytest.mark.parametrize("less", [0.3, 0.9])
def test_what_only_resembles_what_cannot_be_is_not_named(aircraft, less):
    """One explains clearly more but is ruled out: another one that explains little beside it is not the name either."""

    def lacking(c, after, f):
        c[:, 3] -= 0.8 * f["alpha"] * f["beta"]
        return c

    def with_terms(name, **terms):
        return replace(BY_ID["dihedral_alpha"], identifier=name, variants=(Variant(terms=terms),), shows_in=())

    noisy = f"alpha*beta+{0.002 if less < 0.5 else 0.0002}*cos(7*time)"
    ruled_out = replace(with_terms("ruled_out", Cl=("alpha*beta",), Cn=("alpha*de",)), shows_in=("Cn",))
    library = [ruled_out, with_terms("lesser", Cl=(noisy,))]
    benches = [CandidateEvaluator(random_flight(aircraft, seed=seed)) for seed in range(1, 5)]
    repeated = [Replica(b.data, {e.identifier: b.best_of(e).score for e in library}, {}) for b in benches]
    answer = diagnose(CandidateEvaluator(random_flight(aircraft, lacking)), repeated, library)
    lesser = next(each for each in answer.candidates if each.trial.candidate.family == "lesser")
    named = [each.trial.candidate.family for each in answer.found]
    assert "lesser" not in named if less < 0.5 else named == ["lesser"]
    assert ("ruled_out explains clearly more" in lesser.refusal(first=True)) == (less < 0.5)


@pytest.mark.parametrize(("size", "share"), [(0.0, ""), (0.05, "part"), (0.3, "most")])
def test_what_nothing_explains_is_said_though_it_has_no_name(aircraft, size, share):
    """A pitching moment that follows nothing that is recorded: the answer is not that nothing is missing."""

    def unrecorded(c, after, f):
        time = np.arange(len(c)) * 0.04
        c[:, 4] += size * np.sin(2.3 * time + 3.0 * np.sin(0.4 * time))
        return c

    library = [BY_ID["dihedral_alpha"], BY_ID["sideslip_pitching"]]
    flight = random_flight(aircraft, unrecorded)
    benches = [CandidateEvaluator(random_flight(aircraft, seed=seed)) for seed in range(1, 5)]
    repeated = [Replica(b.data, {e.identifier: b.best_of(e).score for e in library}, {}) for b in benches]
    said = FlightDiagnosis(flight, (), diagnose(CandidateEvaluator(flight), repeated, library), repeated, True).json
    text = render({**said, "model": "m", "notes": []})
    assert said["verdict"] == "none"
    if not size:
        assert said["left"] == {} and text.startswith("model m: nothing is missing")
        return
    assert list(said["left"]) == ["Cm"] and said["left"]["Cm"]["times_noise"] > THRESHOLDS.left_times
    assert text.startswith(f"model m: nothing is named, and {share} of C_m is not explained")
    assert "The model leaves" in said["advice"] and "Nothing is missing" not in said["advice"]


@pytest.mark.parametrize(("of_flight", "of_replicas"), [(1.0, 1.0), (0.0, 1.0), (0.0, 0.0)])
def test_an_axis_that_is_noise_is_said(aircraft, of_flight, of_replicas):
    """Where both the flight and its replicas are; replicas that are noisier than the flight say nothing of it."""

    def noisy(size):
        def with_noise(c, after, f):
            c[:, 4] += size * np.random.default_rng(5).normal(size=len(c))
            return c

        return with_noise

    library = [BY_ID["dihedral_alpha"]]
    flight = random_flight(aircraft, noisy(of_flight))
    benches = [CandidateEvaluator(random_flight(aircraft, noisy(of_replicas), seed=seed)) for seed in range(1, 4)]
    repeated = [Replica(b.data, {e.identifier: b.best_of(e).score for e in library}, {}) for b in benches]
    said = FlightDiagnosis(flight, (), diagnose(CandidateEvaluator(flight), repeated, library), repeated, True).json
    assert ("C_m is mostly noise" in said["advice"]) == (of_flight > 0.0)


@pytest.mark.long
@pytest.mark.parametrize("elsewhere", [0.0, 0.3])
def test_amid_axes_that_nothing_explains_an_effect_must_explain_most(aircraft, elsewhere):
    """What explains a third of C_l is named where the rest of the model holds, and not where it fails widely."""

    def lacking(c, after, f):
        time = np.arange(len(c)) * 0.04
        unrecorded = np.sin(2.3 * time + 3.0 * np.sin(0.4 * time))
        c[:, 3] -= 1.2 * f["alpha"] * f["beta"]
        c[:, 3] += 0.006 * np.sin(3.1 * time + 2.0 * np.sin(0.3 * time))
        c[:, 4] += elsewhere * unrecorded
        c[:, 5] += elsewhere * unrecorded
        return c

    library = [BY_ID["dihedral_alpha"]]
    flight = random_flight(aircraft, lacking)
    benches = [CandidateEvaluator(random_flight(aircraft, seed=seed)) for seed in range(1, 5)]
    repeated = [Replica(b.data, {e.identifier: b.best_of(e).score for e in library}, {}) for b in benches]
    found = diagnose(CandidateEvaluator(flight), repeated, library)
    if not elsewhere:
        assert [f.trial.candidate.family for f in found.found] == ["dihedral_alpha"]
        return
    (candidate,) = found.candidates
    assert found.verdict == "none" and candidate.amid == ("Cm", "Cn")
    assert "most of C_m and C_n is unexplained" in candidate.refusal(first=True)


@pytest.mark.long
def test_a_clean_flight_without_vanes_is_given_nothing():
    """Of JSBSim: what its inferred angles get wrong had been called propwash. What is listed has no name."""
    flight = hidden_flight("c172p", None, seed=9303, duration=60.0)
    said = diagnose_flight(flight.aircraft, without_vanes(flight), replicas=3).json
    assert said["verdict"] == "none" and [c["effect"] for c in said["candidates"] if c["effect"] or c["found"]] == []


@pytest.mark.long
def test_replicas_noisier_than_the_flight_hide_no_effect(aircraft):
    """An aircraft file that says nothing of the gyro may make replicas noisier than the flight is."""

    def lacking(c, after, f):
        c[:, 3] -= 0.8 * f["alpha"] * f["beta"]
        return c

    def noisy(seed):
        flight = random_flight(aircraft, seed=seed)
        spread = flight.measured.std(axis=0)
        noise = np.random.default_rng(seed).normal(size=flight.measured.shape)
        return replace(flight, measured=flight.measured + 0.5 * spread * noise)

    library = [BY_ID["dihedral_alpha"], BY_ID["thrust_offset"]]
    flight = random_flight(aircraft, lacking)
    benches = [CandidateEvaluator(noisy(seed)) for seed in range(1, 5)]
    repeated = [Replica(b.data, {e.identifier: b.best_of(e).score for e in library}, {}) for b in benches]
    found = diagnose(CandidateEvaluator(flight), repeated, library)
    assert found.floor["Cl"] > CandidateEvaluator(flight).fits["Cl"].nrmse_held_out
    assert [f.trial.candidate.effect.identifier for f in found.found] == ["dihedral_alpha"]
