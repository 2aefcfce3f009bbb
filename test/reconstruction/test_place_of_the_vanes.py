"""Vanes whose place no aircraft file has: what an innovation may be for that, and that it is of the expected size."""

from __future__ import annotations

import numpy as np
import pytest
from aircraft_files import of_shape
from filter_setups import setup_of

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.aircraft.frames import quaternion_from_euler
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.measurements import residual_and_jacobian, variance_of_place
from aircraft_sysid_ros.reconstruction.state import AIR_VELOCITY, ATTITUDE, ERROR_SIZE, STATE_SIZE
from aircraft_sysid_ros.records import replaced
from aircraft_sysid_ros.samples import WIDTH, Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

RATE = np.array([0.8, -0.5, 0.6])


def state() -> np.ndarray:
    x = np.zeros(STATE_SIZE)
    x[ATTITUDE] = quaternion_from_euler(0.4, 0.2, -1.0)
    x[AIR_VELOCITY] = [18.0, 2.0, 1.5]
    x[10:16] = 0.01
    return x


@pytest.mark.parametrize("kind", [Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP])
def test_the_variance_is_that_of_vanes_elsewhere(aircraft: Aircraft, kind: Kind) -> None:
    setup, values = setup_of(of_shape(aircraft, places=False)), np.full(WIDTH, np.nan)
    values[0] = 0.1

    def innovation(place: np.ndarray) -> float:
        residual, h = np.empty(1), np.empty((1, ERROR_SIZE))
        moved = replaced(setup, probe_from_imu=place)
        residual_and_jacobian(int(kind), values, state(), RATE, moved, residual, h)
        return float(residual[0])

    here, step = np.array(setup.probe_from_imu), 1e-4
    slopes = [(innovation(here + step * e) - innovation(here - step * e)) / (2.0 * step) for e in np.eye(3)]
    expected = float(np.sum(np.square(slopes) * np.square(setup.probe_doubt[kind])))
    assert expected > 0.0
    assert variance_of_place(int(kind), state(), RATE, setup) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("scaled", ["airspeed", "angle_of_attack", "sideslip"])
def test_no_scale_is_likelier_for_the_doubt_alone(aircraft: Aircraft, scaled: str) -> None:
    """What a sensor shows is as doubtful whatever the scale: the search for one had called air 3 % too fast."""
    silent, scale, names = of_shape(aircraft, places=False), 0.9, ("airspeed", "angle_of_attack", "sideslip")
    other, faster = with_setting(silent, ("sensors", scaled, "scale"), scale), state()
    faster[AIR_VELOCITY] /= scale if scaled == "airspeed" else 1.0  # the same airspeed is shown
    for kind, name in zip((Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP), names, strict=True):
        shown = (scale if name == scaled else 1.0) ** 2 * variance_of_place(int(kind), faster, RATE, setup_of(other))
        assert shown == pytest.approx(variance_of_place(int(kind), state(), RATE, setup_of(silent)), rel=0.02), name


def test_what_is_said_leaves_no_doubt_and_other_sensors_have_none(aircraft: Aircraft) -> None:
    said, silent = setup_of(aircraft), setup_of(of_shape(aircraft, places=False))
    for kind in Kind:
        is_of_vanes = kind in (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
        assert variance_of_place(int(kind), state(), RATE, said) == 0.0
        assert (variance_of_place(int(kind), state(), RATE, silent) > 0.0) == is_of_vanes


@pytest.mark.long
@pytest.mark.parametrize("places", [True, False])
def test_on_a_boom_that_no_file_mentions_innovations_are_as_large_as_they_may_be(
    aircraft: Aircraft, places: bool
) -> None:
    """Their squares had been 1.36 of what the filter expected, and in the quick turns of a flight by others so large
    that all was held, again and again."""
    boom = aircraft_from_dict({**aircraft.source, "air_data_position": [0.35 * aircraft.span, 0.0, 0.0]})
    pipeline = Pipeline(of_shape(boom, places=places))
    pipeline.push(simulate_samples(boom, 401, 40.0).samples)
    pipeline.flush()
    consistency = pipeline.state.innovation_consistency()
    assert 0.5 < consistency["sideslip"] < 1.1
    assert 0.5 < consistency["angle_of_attack"] < 1.1
