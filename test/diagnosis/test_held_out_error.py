"""One held-out error: ``diagnose``, ``add`` and ``compare`` say the same of the same model on the same run."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from aircraft_sysid_ros.diagnosis.compare import compare
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct_as_flown, settled_flight
from aircraft_sysid_ros.diagnosis.flight_diagnosis import diagnose_flight
from aircraft_sysid_ros.diagnosis.model_versions.additions import add
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.diagnosis.search.fit import held_out_error
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.run_writer import RunWriter
from aircraft_sysid_ros.simulation.dynamics import Effect as Term
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

#: Diagnosis does without the covariance of the smoother, which is summed in another order.
SAME = {"rel": 1e-6}


def run_of(aircraft, samples, folder: Path) -> Path:
    pipeline, path = Pipeline(aircraft), folder / "run"
    with RunWriter(path, aircraft) as writer:
        for rows, points in (pipeline.push(samples), pipeline.flush()):
            writer.add_rows(rows)
            writer.add_points(points)
        writer.add_samples(samples)
        writer.finish(pipeline.state, pipeline.parameters, pipeline.state.flight_time, time.perf_counter())
    return path


@pytest.mark.long
def test_one_addition_after_another_in_gusts(aircraft, tmp_path) -> None:
    """Two effects, one with an inner number and one in C_X, whose search knows the tilt of the lift as well."""
    hidden = (Term("Cl", "alpha*beta", -0.8), Term("CX", "sqrt(1+200*beta**2)", -0.03))
    samples = simulate_samples(aircraft, 11, 90.0, effects=hidden, turbulence="light").samples
    run = run_of(aircraft, samples, tmp_path)
    library = [BY_ID[name] for name in ("dihedral_alpha", "sideslip_drag", "adverse_yaw", "propeller_torque")]
    said = diagnose_flight(open_run(run).current.aircraft, samples, library, replicas=3).json["candidates"]
    found = [candidate for candidate in said if candidate["found"]]
    assert {candidate["effect"] for candidate in found} == {"dihedral_alpha", "sideslip_drag"}
    for candidate in found:
        axis, before = candidate["main_axis"], compare(open_run(run).flight())
        outcome = add(run, candidate["effect"])
        after = compare(open_run(run).flight())
        assert candidate["error_before"] == pytest.approx(before.axes[axis].fit.nrmse_held_out, **SAME)
        assert candidate["error_after"] == pytest.approx(after.axes[axis].fit.nrmse_held_out, **SAME)
        assert candidate["error_after"] < 0.6 * candidate["error_before"]
        assert outcome.axes[axis]["error_before"] == before.axes[axis].fit.nrmse_held_out
        assert outcome.axes[axis]["error_after"] == after.axes[axis].fit.nrmse_held_out
        for said_so, learnt in zip(candidate["parameters"], outcome.parameters, strict=True):  # as replay learns it
            assert abs(said_so["value"] - learnt["value"]) < 3.0 * learnt["std"]


@pytest.mark.long  # the same for terms: test_flight_test_engineer.py; settings: test_versions.py
def test_a_setting_of_the_sensors(aircraft, tmp_path) -> None:
    """What correcting the scale of a vane does to the errors: it is another flight with it, and the same for all."""
    truth = with_setting(aircraft, ("sensors", "angle_of_attack", "scale"), 1.15)
    samples = simulate_samples(truth, seed=4, duration=60.0).samples
    run = run_of(aircraft, samples, tmp_path)
    library = [BY_ID["alpha_scale"], BY_ID["dihedral_alpha"]]
    said = diagnose_flight(open_run(run).current.aircraft, samples, library, replicas=2).json["candidates"][0]
    assert said["effect"] == "alpha_scale"
    before, outcome = compare(open_run(run).flight()), add(run, "alpha_scale")
    after, axis = compare(open_run(run).flight()), said["main_axis"]
    assert said["error_before"] == pytest.approx(before.axes[axis].fit.nrmse_held_out, **SAME)
    assert said["error_after"] == pytest.approx(after.axes[axis].fit.nrmse_held_out, **SAME)
    assert said["error_after"] < said["error_before"]
    ((_, value),) = outcome.change.settings
    assert outcome.axes[axis]["error_after"] == after.axes[axis].fit.nrmse_held_out
    assert said["inner"] == {"scale": value}


@pytest.mark.parametrize("turbulence", ["none", "light"])
def test_the_covariance_of_the_smoother_moves_no_error(aircraft, turbulence) -> None:
    """It says how well a state is known: the points that count and what is measured there are the same without it."""
    samples = simulate_samples(aircraft, 3, 60.0, turbulence=turbulence).samples
    without, known = (
        settled_flight(reconstruct_as_flown(aircraft, samples, with_covariance)[0]) for with_covariance in (False, True)
    )
    assert (known.time == without.time).all() and known.air_velocity_std < without.air_velocity_std
    for axis in ("CX", "CZ", "Cm"):
        assert held_out_error(known, axis) == pytest.approx(held_out_error(without, axis), rel=1e-9)
