"""Both methods on short simulated flights with known truth."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.flight_model.layout import TAIL, make_theta
from aircraft_sysid_ros.refinement.parameters import judged, scales_of
from aircraft_sysid_ros.refinement.record import record_of
from aircraft_sysid_ros.refinement.refine import RefineOptions, refine, with_doubts, with_options
from aircraft_sysid_ros.refinement.refined_file import FILTER_ERROR, OUTPUT_ERROR
from aircraft_sysid_ros.refinement.run_data import RunData
from aircraft_sysid_ros.samples import Kind

MAIN = ("CZ_alpha", "Cm_alpha", "Cm_q", "Cm_de", "Cl_p", "Cl_da", "Cl_beta", "Cn_beta", "Cn_r", "Cn_dr", "CY_beta")
OPTIONS = RefineOptions(segment=8.0, held_out=2.0)


def scores(result, aircraft):
    """Error over standard error, by name, of what was estimated."""
    found = {p["name"]: p for p in result.content["parameters"]}
    return {n: (p["value"] - aircraft.coefficients[n]) / p["std"] for n, p in found.items() if p["std"]}


@pytest.fixture(scope="module")
def still(still_run):
    return refine(still_run, OUTPUT_ERROR, OPTIONS)


@pytest.fixture(scope="module")
def gusty(gusty_run):
    return refine(gusty_run, FILTER_ERROR, OPTIONS)


@pytest.mark.long
def test_output_error_in_still_air(still, still_flight):
    """Main derivatives within 3.5 standard errors (11 of them), 85 % of all within 2; residuals are the noise."""
    z = scores(still, still_flight.aircraft)
    assert still.content["converged"]
    assert max(abs(z[name]) for name in MAIN) < 3.5
    assert np.mean(np.abs(list(z.values())) < 2.0) > 0.85
    noise = still_flight.aircraft.sensors
    assert still.content["residuals"]["alpha"] == pytest.approx(noise["angle_of_attack"].noise[0], rel=0.15)
    assert still.content["residuals"]["V"] == pytest.approx(noise["airspeed"].noise[0], rel=0.15)
    biases = np.array([b["value"] for b in still.content["biases"]])
    std = np.array([b["std"] for b in still.content["biases"]])
    true = np.concatenate([still_flight.biases.accelerometer[0], still_flight.biases.gyro[0]])
    assert np.all(np.abs(biases - true) < 4.0 * std)


@pytest.mark.long
def test_filter_error_in_turbulence_finds_gusts_and_noise(gusty, gusty_flight):
    z = scores(gusty, gusty_flight.aircraft)
    assert gusty.content["converged"]
    assert max(abs(z[name]) for name in MAIN) < 4.0
    levels = {level["name"]: level for level in gusty.content["process_noise"]}
    wind = gusty_flight.truth.wind[::8]  # 50 Hz
    for name, axes in (("gusts_horizontal", [0, 1]), ("gusts_vertical", [2])):
        walk = np.sqrt(np.mean(np.diff(wind[:, axes], axis=0) ** 2) * 50.0)
        assert levels[name]["value"] == pytest.approx(walk, rel=0.4)
    factors = {f["name"]: f["value"] for f in gusty.content["output_noise_factors"] if f["std"] is not None}
    assert "attitude" not in factors
    assert all(0.7 < factors[name] < 1.4 for name in ("specific_force", "airspeed", "position", "velocity"))


@pytest.mark.long
def test_filter_error_beats_output_error_in_turbulence(gusty, gusty_run, gusty_flight):
    aircraft = gusty_flight.aircraft
    plain = refine(gusty_run, OUTPUT_ERROR, replace(OPTIONS, maximum_iterations=6))

    def error(result):
        values = {p["name"]: p["value"] for p in result.content["parameters"]}
        return np.median([abs(values[n] / aircraft.coefficients[n] - 1.0) for n in MAIN])

    assert error(gusty) < 0.5 * error(plain)


@pytest.mark.long
def test_the_content_says_what_it_holds(still, still_flight):
    content = still.content
    assert [p["name"] for p in content["parameters"]] == list(still_flight.aircraft.model.parameter_names)
    assert {p["status"] for p in content["parameters"]} <= {"USE", "HOLD", "REJECT"}
    assert set(content["not_fitted"]) == {"CX", "CY", "CZ", "Cl", "Cm", "Cn"}
    assert all(0.0 < e["nrmse"] < 0.5 for e in content["not_fitted"].values())
    assert all(0.1 < e["over_noise"] < 2.0 for e in content["not_fitted"].values())
    assert still.measured.shape == still.modelled.shape == (len(still.time), 18)
    held = np.isnan(still.modelled[:, 0])
    assert 0.1 < held.mean() < 0.4  # pieces that were not fitted have no model output


def without(run, kind, columns=None):
    """The run as if a sensor, or some of its values, had not been there."""
    chosen = run.samples.kind == kind
    if columns is None:
        return replace(run, samples=run.samples[~chosen])
    values = run.samples.values.copy()
    values[np.ix_(chosen, columns)] = np.nan
    return replace(run, samples=replace(run.samples, values=values))


def test_what_the_run_did_not_explain_is_not_to_be_used(still_run):
    """Equation error of the same flight says that the model of C_X lacks something."""
    words = "the error of CX is 3.6 times its noise or more in a tenth of the motion"
    lacks = refine(replace(still_run, lack_of_fit={"CX": words}), OUTPUT_ERROR, OPTIONS).content
    assert lacks["converged"]
    of_x, others = ([p for p in lacks["parameters"] if p["name"].startswith("CX") is is_x] for is_x in (True, False))
    assert all(p["status"] == "HOLD" and p["reason"].endswith(f"says: {words}") for p in of_x)
    assert [p["status"] for p in others].count("USE") > 15


@pytest.mark.long
def test_a_parameter_whose_signal_is_not_measured_is_held(still_run):
    run = without(still_run, Kind.CONTROLS, [5])
    content = refine(run, OUTPUT_ERROR, replace(OPTIONS, maximum_iterations=0)).content
    found = {p["name"]: p for p in content["parameters"]}
    assert found["CX_Tc"]["status"] == "HOLD" and found["CX_Tc"]["std"] is None and found["CX_Tc"]["value"] == 0.0
    assert "Tc, which is not measured" in found["CX_Tc"]["reason"]
    assert found["CX_alpha"]["status"] == "HOLD"  # its axis cannot be trusted either
    assert not content["converged"]
    assert not any(p["status"] == "USE" for p in content["parameters"])
    assert any(p["reason"].startswith("it did not converge") for p in content["parameters"])


@pytest.mark.long
def test_what_the_flight_does_not_tell_is_not_moved(still_run):
    """Rudder recorded as it is at rest: nothing depends on it."""
    values = still_run.samples.values.copy()
    values[still_run.samples.kind == Kind.CONTROLS, 2] = 0.0
    run = replace(still_run, samples=replace(still_run.samples, values=values))
    content = refine(run, OUTPUT_ERROR, replace(OPTIONS, maximum_iterations=0)).content
    found = {p["name"]: p for p in content["parameters"]}
    for name in ("Cn_dr", "CY_dr", "Cl_dr"):
        assert found[name]["status"] == "HOLD" and "left at its start value" in found[name]["reason"]


def test_bad_runs_are_refused(still_run):
    with pytest.raises(InputError, match="no control surfaces"):
        refine(without(still_run, Kind.CONTROLS), OUTPUT_ERROR, OPTIONS)
    short = replace(still_run, samples=still_run.samples[: len(still_run.samples) // 6])
    with pytest.raises(InputError, match="in flight with all inputs"):
        refine(short, OUTPUT_ERROR, OPTIONS)
    with pytest.raises(InputError, match="between 4 and 600"):
        with_options(OPTIONS, 1.0)
    samples = still_run.samples
    values = np.full((1, samples.values.shape[1]), np.nan)
    values[0, 0] = 3.0
    heavier = replace(
        samples,
        stamp=np.append(samples.stamp, samples.stamp[-1]),
        kind=np.append(samples.kind, int(Kind.MASS)),
        values=np.vstack([samples.values, values]),
    )
    with pytest.raises(InputError, match="mass properties"):
        refine(replace(still_run, samples=heavier), OUTPUT_ERROR, OPTIONS)


def test_sensors_that_nobody_described_are_in_the_standard_errors(still_flight):
    """Vanes out on a wing of which the file says nothing gave values to USE that were a hundred of their errors off."""
    aircraft, nothing = still_flight.aircraft, np.empty((0, 0))
    names = aircraft.model.parameter_names
    plain = RunData(aircraft, still_flight.samples, {}, np.zeros(6), np.empty(0, np.int64), nothing, nothing)
    count, at = len(names), names.index("Cl_r")
    theta, std = np.ones(count + TAIL), np.full(count + TAIL, 0.03)
    std[names.index("CX_q")] = 0.0  # it was left where it is
    wide = with_doubts(replace(plain, std_of_sensors={"Cl_r": 0.04, "CX_q": 0.04}), theta, std)
    assert wide[at] == pytest.approx(0.05)
    for found in (np.delete(wide, at), np.delete(with_doubts(plain, theta, std), at)):
        np.testing.assert_array_equal(found, np.delete(std, at))


def test_bounds_of_the_aircraft_file_count_as_in_replay(still_flight, still_run):
    """A refined value that they do not have was to USE."""
    aircraft = still_flight.aircraft
    model, record = aircraft.model, record_of(aircraft, still_run.samples, OPTIONS.rate)
    theta = make_theta(record.model, [aircraft.coefficients[name] for name in model.parameter_names])
    true, std = aircraft.coefficients["Cl_p"], np.full(len(theta), 1e-4)
    for bounds, status in (((2.0 * true, 1.5 * true), "REJECT"), ((2.0 * true, 0.5 * true), "USE")):
        of_file = {"Cl_p": bounds}
        found = judged(model, record, theta, std, std > 0.0, scales_of(model, record, theta), {}, {}, of_file)
        assert next(p["status"] for p in found if p["name"] == "Cl_p") == status


@pytest.mark.long
def test_what_equation_error_of_the_same_flight_contradicts_is_not_to_be_used(still_run, still):
    model = still_run.aircraft.model
    record = record_of(still_run.aircraft, still_run.samples, OPTIONS.rate)
    found = {p["name"]: p for p in still.content["parameters"]}
    theta = make_theta(
        record.model, [found[name]["value"] for name in model.parameter_names], np.zeros(6), (0.0, 0.0, 0.0)
    )
    std = np.array([found[name]["std"] or 0.0 for name in model.parameter_names])
    known = {name: dict(still_run.parameters[name]) for name in model.parameter_names}
    assert found["Cm_de"]["status"] == known["Cm_de"]["status"] == "USE"

    def status(value):
        run = known | {"Cm_de": known["Cm_de"] | {"value": value}}
        judgement = judged(model, record, theta, std, std > 0.0, scales_of(model, record, theta), run, {}, {})
        return next((p["status"], p["reason"]) for p in judgement if p["name"] == "Cm_de")

    right = known["Cm_de"]["value"]
    assert status(right)[0] == "USE" == status(1.1 * right)[0]
    assert status(1.6 * right) == ("HOLD", f"equation error of the same flight says {1.6 * right:.3g}")
