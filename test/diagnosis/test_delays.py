"""An IMU that is late is told by what measures the same motion; a delay of the controls by fit and held out alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct_as_flown
from aircraft_sysid_ros.diagnosis.measurement.faults import jobs_of, measurement_faults, try_setting, with_the_other
from aircraft_sysid_ros.diagnosis.measurement.late_controls import control_gain, imu_explains
from aircraft_sysid_ros.diagnosis.measurement.maximum import maximum
from aircraft_sysid_ros.diagnosis.measurement.setting import in_file
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples


@pytest.mark.long
@pytest.mark.long_after_the_first
@pytest.mark.parametrize("late", [0.0, 0.08])
def test_a_late_imu_is_told_in_gusts_too(aircraft, late):
    samples = simulate_samples(aircraft, 31, 45.0, turbulence="light", manoeuvres="standard").samples
    others = np.where(samples.kind == Kind.IMU, 0, round(late * 1e9))  # all else comes earlier than the IMU
    order = np.argsort(samples.stamp - others, kind="stable")
    shifted = replace(samples, stamp=samples.stamp - others)[order]
    flight, calm = reconstruct_as_flown(aircraft, shifted, with_covariance=False)
    found = measurement_faults(flight, [BY_ID["imu_lag"]], calm)
    assert [setting.value for setting in found] == ([pytest.approx(late, abs=0.01)] if late else [])
    if late:  # the controls are early beside it, and are not said to be
        delay, lag = map(try_setting, jobs_of(flight, [BY_ID["actuator_lag"]], calm))
        assert delay.value < -0.03 and imu_explains(delay, flight)
        assert lag.value > 0.03 and imu_explains(lag, flight)


@pytest.mark.long
def test_surfaces_that_are_late_are_not_laid_to_the_imu(aircraft):
    samples = simulate_samples(aircraft, 31, 45.0, turbulence="light", hidden=[("actuator_lag", 1.0)]).samples
    without = samples[samples.kind != Kind.ATTITUDE]
    for each in (samples, without):
        flight, calm = reconstruct_as_flown(aircraft, each, with_covariance=False)
        for controls in map(try_setting, jobs_of(flight, [BY_ID["actuator_lag"]], calm)):
            assert controls.evidence > 1.0 and not imu_explains(controls, flight)


#: Lag of the servos and dead time [s]: which of the two is likelier by itself.
SERVOS = [(0.06, 0.0, "lag"), pytest.param(0.0, 0.06, "delay", marks=pytest.mark.long), (0.03, 0.06, "delay")]


@pytest.mark.long
@pytest.mark.parametrize(("lag", "dead_time", "first"), SERVOS)
def test_of_a_delay_and_a_lag_the_likelier_is_told_and_then_what_is_beside_it(aircraft, lag, dead_time, first):
    sensors = SensorOptions(command_lag=lag, command_dead_time=dead_time, attitude=True)
    flown = simulate_samples(aircraft, 52, 80.0, turbulence="light", manoeuvres="varied", sensors=sensors)
    flight, calm = reconstruct_as_flown(aircraft, flown.samples, with_covariance=False)
    found = measurement_faults(flight, [BY_ID["actuator_lag"]], calm)
    assert found[0].variant.setting[-1] == first
    servos = in_file(with_the_other(found[0], flight, calm), aircraft).sensors["control_surfaces"]
    assert (servos.lag, servos.delay) == (pytest.approx(lag, abs=0.012), pytest.approx(-dead_time, abs=0.012))


def test_a_delay_of_the_controls_must_explain_what_it_was_fitted_to():
    """A held-out error beyond the spread is chance: that it falls says nothing if the fit stays as it was."""
    before = {"Cl": (1.1, 0.7), "Cm": (0.5, 0.5)}
    assert control_gain(before, {"Cl": (0.7, 0.69), "Cm": (0.5, 0.5)}) == pytest.approx(2.0 * np.log(0.7 / 0.69))
    assert control_gain(before, {"Cl": (0.55, 0.35), "Cm": (0.5, 0.5)}) == pytest.approx(2.0 * np.log(2.0))
    assert control_gain(before, {"Cl": (1.1, 0.7), "Cm": (0.5, 0.6)}) < 0.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("late_by", "stated", "name"),
    [(0.11, 0.0, "late_controls"), (0.11, 0.06, "late_controls"), (-0.12, 0.0, "actuator_lag")],
)
def test_a_long_delay_is_told_past_a_valley_and_beside_what_the_file_says(aircraft, late_by, stated, name):
    """A downwash with a lag had been named; and a file with the delay that replay advises ended diagnose."""
    samples = simulate_samples(aircraft, 33, 60.0, turbulence="light", manoeuvres="standard").samples
    late = np.where(samples.kind == Kind.CONTROLS, round(1e9 * late_by), 0)
    order = np.argsort(samples.stamp + late, kind="stable")
    file = with_setting(aircraft, ("sensors", "control_surfaces", "delay"), stated)
    flight, calm = reconstruct_as_flown(
        file, replace(samples, stamp=samples.stamp + late)[order], with_covariance=False
    )
    library = [BY_ID["actuator_lag"], BY_ID["late_controls"]]
    found = measurement_faults(flight, library, calm)[0]
    assert (found.effect.identifier, found.value) == (name, pytest.approx(late_by, abs=0.01))
    corrected = replace(flight, aircraft=in_file(found, file))
    assert corrected.aircraft.sensors["control_surfaces"].delay == found.value
    assert all(each.evidence < 1.0 for each in map(try_setting, jobs_of(corrected, library, calm)))


@pytest.mark.parametrize("start", [-0.3, 0.1])
def test_a_search_may_begin_beyond_its_limits(start):
    place, value, _ = maximum(lambda x: 1.0 - (x + 0.05) ** 2, start, -0.25, 0.0, 1e-9)
    assert place == pytest.approx(-0.05, abs=1e-3) and value == pytest.approx(1.0, abs=1e-5)
