"""Surfaces where servos have taken them: the lag of the aircraft file, exact, whatever the blocks."""

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.servo_lag import ServoLag
from aircraft_sysid_ros.samples import Kind, Samples, concatenate, samples_of
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import default_aircraft, simulate_samples

LAG = 0.06


def commands(time: np.ndarray, elevator: np.ndarray) -> Samples:
    values = np.zeros((len(time), 7))
    values[:, 0], values[:, 4] = elevator, elevator  # the throttle is no servo
    return samples_of(Kind.CONTROLS, np.rint(time * 1e9).astype(np.int64), values)


def surfaces(samples: Samples) -> np.ndarray:
    return samples.values[samples.kind == Kind.CONTROLS, 0]


def test_a_servo_follows_a_line_and_a_step_as_the_equation_says() -> None:
    time = np.arange(0.0, 1.0, 0.02)
    line = surfaces(ServoLag(LAG).follow(commands(time, 0.2 * time)))
    assert line == pytest.approx(0.2 * (time - LAG * (1.0 - np.exp(-time / LAG))), abs=1e-12)
    step = surfaces(ServoLag(LAG).follow(commands(time, np.where(time > 0.09, 0.1, 0.0))))
    settled = time >= 0.1 - 1e-9
    begun = 0.1 * (1.0 - LAG / 0.02 * (1.0 - np.exp(-0.02 / LAG)))  # from 0.08 to 0.10 s the command is a line
    expected = 0.1 - (0.1 - begun) * np.exp(-(time[settled] - 0.1) / LAG)
    assert step[settled] == pytest.approx(expected, abs=1e-12)


def test_blocks_gaps_late_and_absurd_values_and_a_new_clock() -> None:
    rng = np.random.default_rng(3)
    time = np.sort(rng.uniform(0.0, 3.0, 200))
    elevator = rng.normal(0.0, 0.1, 200)
    elevator[[20, 21]] = np.nan
    elevator[90] = 9.0  # no surface
    samples = commands(time, elevator)
    whole = ServoLag(LAG).follow(samples)
    servos = ServoLag(LAG)
    parts = concatenate([servos.follow(samples[begin : begin + 7]) for begin in range(0, 200, 7)])
    assert np.array_equal(whole.values, parts.values, equal_nan=True)
    found = surfaces(whole)
    assert np.isnan(found[[20, 21]]).all()
    assert found[90] == 9.0
    assert np.nanmax(np.abs(np.delete(found, 90))) < 0.4
    assert np.array_equal(whole.values[:, 4], samples.values[:, 4], equal_nan=True)
    late = servos.follow(commands(np.array([time[-1] - 0.01]), np.array([0.05])))
    assert np.isfinite(surfaces(late)).all()
    again = servos.follow(commands(np.array([time[-1] - 2.0]), np.array([0.05])))
    assert surfaces(again)[0] == 0.05
    assert ServoLag(0.0).follow(samples) is samples


def of(aircraft: Aircraft, **controls: float) -> Aircraft:
    return aircraft_from_dict({**aircraft.source, "sensors": {"control_surfaces": controls}})


@pytest.mark.long
def test_the_file_of_commands_says_the_lag_and_the_parameters_are_right() -> None:
    sensors = SensorOptions(command_lag=0.05, attitude=True)
    flight = simulate_samples(default_aircraft(), 81, 60.0, sensors=sensors)
    off = {}
    for name, controls in (("delay", {"delay": -0.038}), ("lag", {"lag": 0.05})):
        pipeline = Pipeline(of(flight.aircraft, **controls))
        pipeline.push(flight.samples)
        pipeline.flush()
        known = {p.name: p.value for p in pipeline.parameters.snapshot().parameters}
        off[name] = [abs(known[key] / flight.coefficients[key] - 1.0) for key in ("Cl_p", "Cl_da", "Cm_de", "Cm_q")]
    assert max(off["lag"]) < 0.05
    assert min(off["delay"]) > 0.1  # a delay is no servo


def test_who_simulates_a_file_with_a_lag_records_commands() -> None:
    aircraft = of(default_aircraft(), lag=0.1)
    flight = simulate_samples(aircraft, 7, 30.0)
    of_file = ServoLag(0.1).follow(flight.samples)
    chosen = of_file.kind == Kind.CONTROLS
    time = (of_file.stamp[chosen] - of_file.stamp.min()) * 1e-9
    truth = np.interp(time, flight.truth.time, flight.truth.controls[:, 0])
    recorded = flight.samples.values[chosen, 0]
    assert np.std(of_file.values[chosen, 0] - truth) < 0.5 * np.std(recorded - truth)


@pytest.mark.parametrize(
    ("sensors", "words"),
    [
        (
            {"control_surfaces": {"lag": -0.1}},
            "the lag of sensor control_surfaces must be between 0 and 0.5 s, not -0.1",
        ),
        ({"control_surfaces": {"lag": 5}}, "must be between 0 and 0.5 s"),
        ({"air_data": {"lag": 0.1}}, "sensor air_data has no lag: only control_surfaces has one"),
        ({"control_surfaces": {"lag": "slow"}}, "the lag of sensor control_surfaces"),
        ({"control_surfaces": {"lag": "0.06 ± some"}}, "or an estimated one, as 0.060 ± 0.003"),
        ({"controls": {"lag": 0.1}, "control_surfaces": {"noise": 0.01}}, "controls and control_surfaces are the same"),
    ],
)
def test_a_lag_that_none_has_is_refused(sensors: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        aircraft_from_dict({**default_aircraft().source, "sensors": sensors})
