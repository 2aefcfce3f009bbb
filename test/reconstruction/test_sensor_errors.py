"""Constant errors of sensors that one flight tells: what is put in comes out, and what is not told is held."""

from __future__ import annotations

from dataclasses import replace

import pytest

from aircraft_sysid_ros.after_flight.sensor_errors import sensor_errors
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

STATE = {
    "accelerometer_bias": [0.1, -0.2, None], "accelerometer_bias_std": [0.01, 0.2, None],
    "gyro_bias": [0.001, 0.0, 0.0], "gyro_bias_std": [0.0001] * 3,
}  # fmt: skip


@pytest.fixture(scope="module")
def found(aircraft, flight):
    """Rows by name of a flight as it is, of one whose sensors show more, and of one in gusts."""

    def of(samples):
        return {row["name"]: row for row in sensor_errors(aircraft, samples, STATE)}

    values = flight.samples.values.copy()
    kind = flight.samples.kind
    values[kind == Kind.AIRSPEED, 0] *= 1.04
    values[kind == Kind.ANGLE_OF_ATTACK, 0] += 0.02
    in_gusts = simulate_samples(aircraft, seed=5, duration=60.0, turbulence="light")
    return of(flight.samples), of(replace(flight.samples, values=values)), of(in_gusts.samples)


@pytest.mark.long
def test_what_a_sensor_shows_too_much_comes_out(found):
    true, wrong, _ = found
    assert true["airspeed.scale"]["value"] == pytest.approx(1.0, abs=3.0 * true["airspeed.scale"]["std"])
    assert true["airspeed.scale"]["std"] < 0.01
    by = wrong["airspeed.scale"]["value"] / true["airspeed.scale"]["value"]
    assert by == pytest.approx(1.04, abs=0.003)
    more = wrong["angle_of_attack.offset"]["value"] - true["angle_of_attack.offset"]["value"]
    assert more == pytest.approx(0.02, abs=0.002)


@pytest.mark.long
def test_what_gusts_or_the_flight_do_not_tell_is_held(found):
    true, _, gusty = found
    assert (true["airspeed.scale"]["status"], gusty["airspeed.scale"]["status"]) == ("USE", "HOLD")
    assert gusty["angle_of_attack.offset"]["status"] == "USE"
    assert (true["accelerometer_bias.x"]["status"], true["accelerometer_bias.y"]["status"]) == ("USE", "HOLD")
    assert "accelerometer_bias.z" not in true and true["gyro_bias.z"]["value"] == 0.0
