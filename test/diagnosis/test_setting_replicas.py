"""A setting of a sensor is a fault where replicas of the flight, whose sensors are right, do not feign as much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict
from aircraft_sysid_ros.diagnosis import flight_diagnosis
from aircraft_sysid_ros.diagnosis.flight.reconstruction import reconstruct_as_flown
from aircraft_sysid_ros.diagnosis.flight_diagnosis import _beyond_chance, _needed_beside_places
from aircraft_sysid_ros.diagnosis.measurement.faults import measurement_faults
from aircraft_sysid_ros.diagnosis.measurement.setting import Setting, in_file
from aircraft_sysid_ros.diagnosis.significance import setting_replicas
from aircraft_sysid_ros.diagnosis.significance.setting_replicas import InReplica, chance_of, in_replicas
from aircraft_sysid_ros.diagnosis.words import MeasurementFinding
from aircraft_sysid_ros.effects import BY_ID
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

#: Sensors of which one is wrong, and one that may sit elsewhere.
_FEW = [BY_ID["alpha_offset"], replace(BY_ID["probe_offset"], variants=BY_ID["probe_offset"].variants[:1])]


@pytest.fixture(scope="module")
def offset(aircraft):
    """A calm flight whose vane is mounted 2 degrees wrong, the setting that says so, and the flight with it."""
    samples = simulate_samples(aircraft, 31, 45.0, hidden=[("alpha_offset", 2.0)]).samples
    flight, calm = reconstruct_as_flown(aircraft, samples, with_covariance=False)
    (found,) = measurement_faults(flight, [BY_ID["alpha_offset"]], calm)
    corrected, _ = reconstruct_as_flown(in_file(found, aircraft), samples, with_covariance=False)
    return flight, calm, found, corrected


def _most(flown):
    return max(each.gain for each in flown)


@pytest.mark.long
def test_replicas_have_sensors_that_are_right(offset):
    _, calm, found, corrected = offset
    assert _most(in_replicas(found, corrected, calm, range(3))) < 0.1 * found.gain
    assert chance_of(found, {}, corrected, calm, 20, 3) < 0.01


@pytest.mark.long
def test_surfaces_of_replicas_move_when_they_should(aircraft):
    """The motion of a flight whose controls are recorded 0.05 s before they act is not that of its records."""
    samples = simulate_samples(aircraft, 32, 45.0).samples
    early = replace(samples, stamp=samples.stamp - 50_000_000 * (samples.kind == Kind.CONTROLS))
    flight, calm = reconstruct_as_flown(aircraft, early, with_covariance=False)
    found = measurement_faults(flight, [BY_ID["actuator_lag"]], calm)[0]
    assert found.value == pytest.approx(-0.05, abs=0.01)
    corrected, _ = reconstruct_as_flown(in_file(found, aircraft), early, with_covariance=False)
    assert _most(in_replicas(found, corrected, calm, range(2))) < 0.1 * found.gain


@pytest.mark.long
def test_surfaces_of_replicas_move_as_servos_do(aircraft):
    samples = simulate_samples(aircraft, 32, 45.0, sensors=SensorOptions(command_lag=0.06)).samples
    flight, calm = reconstruct_as_flown(aircraft, samples, with_covariance=False)
    found = measurement_faults(flight, [BY_ID["actuator_lag"]], calm)[0]
    assert found.variant.setting[-1] == "lag" and found.value == pytest.approx(0.06, abs=0.012)
    corrected, _ = reconstruct_as_flown(in_file(found, aircraft), samples, with_covariance=False)
    assert _most(in_replicas(found, corrected, calm, range(2))) < 0.1 * found.gain


@pytest.mark.long
def test_what_replicas_feign_as_well_is_no_fault(aircraft, offset, monkeypatch):
    flight, calm, found, _ = offset
    said = []

    def told():
        return _beyond_chance([found], aircraft, aircraft, flight, calm, _FEW, 3, lambda what, _: said.append(what))

    aircraft_then, _, _, finding = told()
    assert finding.matters and finding.setting is found and aircraft_then.sensors["angle_of_attack"].offset
    feigned = [InReplica(share * found.gain) for share in (0.5, 0.9, 1.2)]
    monkeypatch.setattr(setting_replicas, "in_replicas", lambda *_: feigned)
    assert told() is None
    monkeypatch.setattr(setting_replicas, "in_replicas", lambda *_: [InReplica(np.nan)] * 3)
    assert told() is None
    assert set(said) == {"check the measurement in replicas"}


@pytest.mark.parametrize(("share", "flown"), [(0.001, 12), (0.1, 20), (2.0, 12), (np.nan, 12)])
def test_more_replicas_are_flown_where_the_first_leave_a_doubt(monkeypatch, share, flown):
    """Gains of 0.1 of that of the flight, in no order, are beyond chance only if twenty say so."""
    seen, effect = [], BY_ID["alpha_offset"]
    found = Setting(effect, effect.variants[0], 0.0, 0.035, gain=800.0, evidence=40.0, std=0.001)

    def in_replicas_of(fault, corrected, calm, seeds):
        seen.extend(seeds)
        return [InReplica(share * found.gain * (1.0 + np.sin(seed))) for seed in seeds]

    monkeypatch.setattr(setting_replicas, "in_replicas", in_replicas_of)
    chance = chance_of(found, {}, None, True, 20, 20)
    assert seen == list(range(flown))
    assert 0.0 < chance < 0.01 if share < 1.0 else chance == 1.0


@pytest.mark.long
@pytest.mark.parametrize(("stated", "left", "needed"), [(False, 0.9, False), (False, 5.0, True), (True, 0.9, True)])
def test_a_fault_that_a_place_explains_which_the_file_leaves_out_is_none(
    aircraft, offset, monkeypatch, stated, left, needed
):
    """What is left of a fault once the place is corrected decides, however likely either is by itself."""
    flight, calm, found, _ = offset
    without = {k: v for k, v in aircraft.source.items() if k != "air_data_position"}
    file = aircraft_from_dict({**without, "air_data_position": [0.5, 0.0, 0.0]} if stated else without)
    place = replace(found, effect=_FEW[1], variant=_FEW[1].variants[0], value=0.1)
    asked = []

    def likelier(_, effects, __):
        asked.extend(effects)
        return [place] if effects else []

    monkeypatch.setattr(flight_diagnosis, "measurement_faults", likelier)
    monkeypatch.setattr(flight_diagnosis, "jobs_of", lambda *_: ["again"])
    monkeypatch.setattr(flight_diagnosis, "try_setting", lambda _: replace(found, evidence=left))
    said = MeasurementFinding(place, 0.0, (), {"CZ": (1.0, 1.0)}, matters=False)
    monkeypatch.setattr(
        flight_diagnosis, "with_best_setting", lambda faults, *_: (file, flight, calm, said) if faults else None
    )
    assert _needed_beside_places(found, file, file, flight, calm, _FEW) is needed
    assert bool(asked) is not stated
