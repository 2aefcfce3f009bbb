"""What rests on an angle that no vane measures: its constants, and what is small beside it."""

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.conditions import LearntConditions
from aircraft_sysid_ros.identification.doubtful_constants import DoubtfulConstants
from aircraft_sysid_ros.identification.parameter_set import ParameterEstimate, ParameterSet
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state import INFERRED, StateField
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

ANGLE = 0.005  # [rad] one sigma of the sideslip


def learnt(aircraft, excited: float):
    """All parameters as they are true, with USE; the sideslip moves ``excited`` times its noise, all else 10 times."""
    names = aircraft.model.parameter_names
    parameters = tuple(
        ParameterEstimate(
            name, aircraft.coefficients[name], 1e-4, Trust.USE, "", 0.0, excited if name.endswith("beta") else 10.0
        )
        for name in names
    )
    noise = np.array([ANGLE if name.endswith("beta") else 0.0 if name.endswith("_0") else 0.002 for name in names])
    nothing = (np.nan, np.nan)
    return ParameterSet(0.0, "", parameters, np.eye(len(names)), nothing, nothing, nothing), noise


@pytest.mark.parametrize("inferred", [True, False])
def test_what_an_inferred_sideslip_does_as_much_as_is_held_and_what_it_does_not_is_used(aircraft, inferred):
    doubt, rows = DoubtfulConstants(), np.zeros((1, StateField.WIDTH))
    status = next(code for code, angles in INFERRED.items() if angles == (("beta",) if inferred else ()))
    rows[0, StateField.STATUS], rows[0, StateField.AIRSPEED], rows[0, StateField.AIR_VELOCITY_STD] = status, 17.0, 0.085
    doubt.note(rows)
    found, noise = learnt(aircraft, 5.0)
    point = np.zeros(CoefficientSample.TERMS)
    held = {p.name for p in doubt.doubted(found, aircraft.model, point, noise).parameters if p.status == Trust.HOLD}
    error = {
        axis: abs(aircraft.coefficients[f"{axis}_beta"]) / (1.0 - 1.0 / 25.0) * ANGLE for axis in ("CY", "Cl", "Cn")
    }
    for p in found.parameters:
        axis, _, label = p.name.partition("_")
        if axis in error and label in ("p", "r", "da", "dr"):
            assert (p.name in held) == (inferred and error[axis] > 1.5 * abs(p.value) * 0.02), p.name
    assert not {name for name in held if name.startswith(("CX", "CZ", "Cm"))}
    assert not inferred or ("CY_da" in held and "Cl_da" not in held)


@pytest.mark.parametrize(("flown", "status"), [(0.06, Trust.HOLD), (0.001, Trust.USE)])
def test_a_constant_that_an_unknown_derivative_carries_to_an_angle_of_0_is_not_used(aircraft, flown, status):
    doubt, rows = DoubtfulConstants(), np.zeros((50, StateField.WIDTH))
    rows[:, StateField.STATUS] = next(code for code, angles in INFERRED.items() if angles == ("alpha", "beta"))
    rows[:, StateField.AIRSPEED], rows[:, StateField.AIR_VELOCITY_STD] = 17.0, 0.085
    rows[:, StateField.ANGLE_OF_ATTACK] = flown
    doubt.note(rows)
    found, noise = learnt(aircraft, 5.0)
    unknown = [replace(p, status=Trust.HOLD) if p.name == "CZ_alpha" else p for p in found.parameters]
    constant = replace(
        next(p for p in unknown if p.name == "CZ_0"), value=-1.0
    )  # no standard error is too large for it
    unknown = tuple(constant if p.name == "CZ_0" else p for p in unknown)
    point = np.zeros(CoefficientSample.TERMS)
    doubted = doubt.doubted(replace(found, parameters=unknown), aircraft.model, point, noise).parameters
    (judged,) = (p for p in doubted if p.name == "CZ_0")
    assert judged.status is status
    assert (status is Trust.USE) or "with CZ_alpha, which is not known" in judged.reason


def test_nor_is_it_where_a_monitor_takes_the_derivative_away_later(aircraft):
    """What is published has passed monitors that know nothing of constants."""
    doubt, rows = DoubtfulConstants(), np.zeros((50, StateField.WIDTH))
    rows[:, StateField.STATUS] = next(code for code, angles in INFERRED.items() if angles == ("alpha", "beta"))
    rows[:, StateField.AIRSPEED], rows[:, StateField.AIR_VELOCITY_STD] = 17.0, 0.085
    rows[:, StateField.ANGLE_OF_ATTACK] = 0.06
    doubt.note(rows)
    found, _ = learnt(aircraft, 5.0)
    assert doubt.carried(found) == found
    later = replace(found, parameters=tuple(
        replace(p, status=Trust.REJECT) if p.name == "Cm_alpha" else p for p in found.parameters
    ))  # fmt: skip
    changed = {p.name for p, q in zip(doubt.carried(later).parameters, later.parameters, strict=True) if p != q}
    assert changed == {"Cm_0"}


def test_seconds_in_which_wind_and_attitude_tell_an_angle_are_too_few_to_use_what_rests_on_it(aircraft):
    """Of a stranger, in whose flights they did so for five to seven, four of five values were a quarter off or more."""
    flown = simulate_samples(aircraft, 5, 75.0, sensors=SensorOptions(attitude=True)).samples
    samples = flown[~np.isin(flown.kind, [Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP])]
    pipeline, seconds, reasons, used = Pipeline(aircraft), [], [], []
    for until in (35, 75):
        due = (samples.stamp - flown.stamp[0]) * 1e-9 < until
        pipeline.push(samples[due])
        samples = samples[~due]
        found = pipeline.parameters.snapshot().parameters
        seconds.append(pipeline.parameters.learning.conditions.seconds.max())
        asked = f"of the {THRESHOLDS.inferred_seconds:.0f} s that are needed"
        reasons.append([p.reason for p in found if asked in p.reason])
        used.append(sum(p.status == Trust.USE for p in found))
    assert 5.0 < seconds[0] < THRESHOLDS.inferred_seconds < seconds[1]
    assert len(reasons[0]) == len(aircraft.model.parameter_names) and used[0] == 0
    assert not reasons[1] and used[1] > 3


def test_an_axis_that_changed_has_been_shown_an_angle_since_then_alone():
    conditions = LearntConditions()
    samples = np.zeros((600, CoefficientSample.TERMS))
    samples[:, CoefficientSample.TIME], samples[:, CoefficientSample.LEARNT] = np.arange(600) * 0.1, 1.0
    conditions.add(samples)
    since = samples[-31:].copy()
    since[-10:, CoefficientSample.LEARNT] = 0.0  # of what it did not learn from it knows nothing
    conditions.learn_anew(2, since)
    assert conditions.seconds == pytest.approx([59.9, 59.9, 2.0, 59.9, 59.9, 59.9])
