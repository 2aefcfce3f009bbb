"""The Monte Carlo certificate in short: a few seeded flights, and the statistics on numbers whose answer is known."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import certificate
import certificate_cells as cells
import certificate_flights as flights
import certificate_summary as summary
from accuracy import MAIN_DERIVATIVES

from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.simulation.flight import prepare
from aircraft_sysid_ros.simulation.trim import derivatives_at

SEEDS = (0, 1)
RARELY = 10.0  # [s] between looks: only the end counts here


def synthetic(count, *, error=1.0, offset=0.0, method="rls", air="none"):
    """Records whose estimates are normal around the truth plus an offset, with their standard error times 1/error."""
    rng = np.random.default_rng(5)
    names, truth = summary.truth()
    std = 0.01 * np.abs(truth)
    value = truth * (1.0 + offset) + error * std * rng.standard_normal((count, len(names)))
    ones = [1] * len(names)
    return [
        {"seed": k, "air": air, "method": method, "cpu": 1.0, "value": v.tolist(), "std": std.tolist(),
         "excitation": (10.0 * np.array(ones)).tolist(), "use": ones}
        for k, v in enumerate(value)
    ]  # fmt: skip


@pytest.mark.parametrize(("error", "share"), [(1.0, 0.95), (2.0, 0.6729)])
def test_coverage_and_rms_of_z_are_those_of_a_normal_distribution(error, share):
    found = summary.of_method(synthetic(200, error=error), "rls", "none")["excited"]
    assert found["pairs"] == 200 * 32
    assert found["share"] == pytest.approx(share, abs=4.0 * found["error"])
    assert found["error"] == pytest.approx(np.sqrt(share * (1.0 - share) / (200 * 32)), rel=0.25)
    assert found["rms_z"] == pytest.approx(error, rel=0.05)


def test_bias_is_found_within_its_monte_carlo_error():
    found = summary.of_method(synthetic(100, offset=0.01), "rls", "none")["bias"]
    for name in MAIN_DERIVATIVES:
        assert found[name]["error"] == pytest.approx(0.001, rel=0.35)
        assert found[name]["mean"] == pytest.approx(0.01, abs=4.0 * found[name]["error"])


def test_methods_are_compared_on_the_flights_that_all_have():
    records = synthetic(40) + synthetic(10, error=2.0, method="rml")
    found = summary.same_flights(records, "none")
    assert found["flights"] == 10
    assert found["methods"]["rml"]["over_rls"] == pytest.approx(2.0, rel=0.01)  # the same numbers, twice as far off
    assert found["methods"]["rls"]["better_than"] == {"rml": len(MAIN_DERIVATIVES)}


def test_parameters_that_are_not_known_or_not_excited_do_not_count():
    records = synthetic(10)
    for record in records:
        record["value"][0] = record["std"][0] = None
        record["excitation"][1] = 1.0
    found = summary.of_method(records, "rls", "none")
    assert found["excited"]["pairs"] == 10 * 30
    assert found["unknown"] == pytest.approx(1.0 / 32.0)


def test_time_to_close_is_when_the_value_comes_to_stay():
    time = np.arange(1.0, 7.0)
    assert flights.stays_close(time, np.array([np.nan, 1.05, 1.2, 0.95, 1.0, 1.0]), 1.0) == 4.0
    assert flights.stays_close(time, np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.2]), 1.0) is None
    assert flights.stays_close(time, np.full(6, -1.05), -1.0) == 1.0


def test_delays_count_those_that_never_come():
    found = summary._delays([1.0, 2.0, 3.0, None])
    assert found == {"share": 0.75, "median": 2.5, "p90": None}
    assert summary._delays([1.0, None, None])["median"] is None


def test_modes_agree_with_the_formulas_for_two_degrees_of_freedom():
    """Short period: w^2 = Mq Za/V - Ma, damping as the sum; the phugoid that they leave out is far slower."""
    aircraft = flights.the_aircraft()
    setup = prepare(aircraft)
    slopes = derivatives_at(setup.airframe, setup.place, setup.trim)
    speed = setup.trim.airspeed
    qbar = 0.5 * 1.19 * speed**2  # density at 290 m + 120 m within 1 %
    moment = qbar * aircraft.wing_area * aircraft.chord / aircraft.inertia[1, 1]
    stiffness, damping = moment * slopes.pitch_stiffness, moment * slopes.pitch_damping * aircraft.chord / speed
    square = -damping * slopes.lift_rate - stiffness
    real = 0.5 * (damping - slopes.lift_rate)
    imaginary = np.sqrt(square - real**2)
    periods = flights.mode_periods(setup)
    assert periods["short_period"] == pytest.approx(2.0 * np.pi / imaginary, rel=0.1)
    yaw = qbar * aircraft.wing_area * aircraft.span / aircraft.inertia[2, 2] * slopes.yaw_stiffness
    assert periods["dutch_roll"] == pytest.approx(2.0 * np.pi / np.sqrt(yaw), rel=0.15)


@pytest.mark.long
def test_the_elevator_loses_half_of_what_it_does():
    at, c = 30.0, flights.the_aircraft().coefficients
    flight = flights.fly(0, "none", 60.0, flights.loss_effects(at))
    truth, chord = flight.truth, flight.aircraft.chord
    rate = truth.rates[:, 1] * chord / truth.airspeed
    rest = truth.coefficients[:, 4] - c["Cm_0"] - c["Cm_alpha"] * truth.alpha - c["Cm_q"] * rate
    for when, share in ((truth.time < at, 1.0), (truth.time > at, 0.5)):
        slope = rest[when] @ truth.controls[when, 0] / np.sum(truth.controls[when, 0] ** 2)
        assert slope == pytest.approx(share * c["Cm_de"], rel=1e-6)


def test_a_killed_run_goes_on_where_it_stopped(tmp_path, monkeypatch):
    monkeypatch.setattr(certificate, "RESULTS", tmp_path)
    record = {"seed": 0, "air": "none", "method": "rls", "value": [1.0, float("nan")]}
    certificate.append("flights", [record, {**record, "air": "light"}])
    path = certificate.file_of("flights")
    path.write_text(path.read_text() + '{"seed":1,"air":"no', encoding="utf8")  # killed while it wrote
    certificate.append("flights", [{**record, "seed": 2}])
    assert [r["seed"] for r in certificate.records_of("flights")] == [0, 0, 2]
    assert json.loads(path.read_text().splitlines()[0])["value"] == [1.0, None]
    left = certificate.jobs_of(["flights"], ["rls", "fourier"], 2)
    assert left == [("flights", 0, ("fourier",)), ("flights", 1, ("rls", "fourier"))]
    certificate.forget(["flights"], ["rls"])
    assert certificate.records_of("flights") == []


@pytest.fixture(scope="module")
def short():
    """Final parameters of a few flights, by the live estimators and by output error."""
    records = []
    for air in flights.AIRS:
        for seed in SEEDS if air == "none" else SEEDS[:1]:
            flight = flights.fly(seed, air)
            for method in ("rls", "fourier") + (("rml",) if (seed, air) == (0, "light") else ()):
                run = flights.LiveRun(flight, ParameterOptions(estimator=method), RARELY)
                records.append(flights.record_of(run, flight, air, method))
    return records


@pytest.mark.long
def test_live_estimators_keep_their_promise_in_calm_air(short):
    """95 % intervals; of 32 correlated parameters on two flights some more may miss."""
    for method, least in (("rls", 0.88), ("fourier", 0.85)):
        found = summary.of_method(short, method, "none")
        assert found["excited"]["share"] > least
        assert found["median_relative_error"] < 0.01


@pytest.mark.long
def test_maximum_likelihood_keeps_it_as_well():
    flight = flights.fly(0, "none")
    run = flights.LiveRun(flight, ParameterOptions(estimator="rml"), RARELY)
    found = summary.of_method([flights.record_of(run, flight, "none", "rml")], "rml", "none")
    assert found["excited"]["share"] > 0.8
    assert found["median_relative_error"] < 0.01


@pytest.mark.long
def test_live_estimators_in_light_turbulence(short):
    """Errors stay small, and least squares on the vanes is not behind maximum likelihood, as it was on the states."""
    for method in ("rls", "fourier", "rml"):
        found = summary.of_method(short, method, "light")
        assert found["excited"]["share"] > 0.65
        assert found["median_relative_error"] < 0.02
    error = {m: summary.same_flights(short, "light")["methods"][m]["over_rls"] for m in ("rls", "rml")}
    assert error["rls"] < 1.2 * error["rml"]


@pytest.mark.long
def test_uncorrected_standard_errors_of_least_squares_are_far_too_small(short):
    found = summary.corrections(short, "none")
    assert found["white"]["share"] < 0.85
    assert found["white"]["rms_z"] > 2.0 * found["std"]["rms_z"]


def test_cells_take_turns_and_a_cell_can_be_flown_alone():
    wanted = cells.jobs(2, 7, "")
    assert len(wanted) == 2 * len(cells.CELLS) and len({job["seed"] for job in wanted}) == len(wanted)
    first = [(job["air"], job["vane"], job["imu"], job["file"]) for job in wanted[: len(cells.CELLS)]]
    assert first == list(cells.CELLS)
    alone = cells.jobs(1, 7, "light,0.3,100,bare")
    assert [job for job in wanted if job in alone] == alone and len(alone) == 1


def test_with_mass_and_shape_only_intervals_hold_the_truth_in_gusts():
    """The probe is out on the wing, and nobody says so: the flight does, to some centimetres."""
    record = cells.fly(*cells.jobs(1, 40, "light,0.3,100,bare"))
    assert record["right"] == pytest.approx(0.4, abs=0.1)
    found = cells.summaries([record])["cells"]["light,0.3,100,bare"]
    assert found["uses"] >= 16 and found["sure_wrong"] == 0
    assert found["use"]["share"] >= 0.9
