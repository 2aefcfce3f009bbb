"""Names that are nearly those of our signals, and are not."""

import numpy as np
import pytest
import strange_layouts as layouts

from aircraft_sysid_ros.recordings.tabular.guess.first_map import guess_map
from aircraft_sysid_ros.recordings.tabular.guess.names import guess_name, is_of_another


@pytest.mark.parametrize(
    "name",
    [
        "imu_temp [degC]", "sensor_temp", "imu_temperature", "IMU1 Temp (C)", "temp_imu", "gyro_temp_c", "rate_limit",
        "gps_heading [deg]", "GPS Heading", "hdg_gps_deg", "V_gps [m/s]", "gps_vt", "gnss_airspeed",
    ],
)  # fmt: skip
def test_what_an_instrument_has_of_its_own_is_no_signal(name):
    """The warmth of an IMU was that of the air, the course of a GPS the heading, and its speed the airspeed: sure."""
    assert guess_name(name) is None


@pytest.mark.parametrize(
    ("name", "signal"),
    [
        ("oat", "air_temperature"), ("air_temp_c", "air_temperature"), ("adc_tas", "true_airspeed"),
        ("ins_heading", "attitude.yaw"), ("gps_yaw", "attitude.yaw"), ("gps_alt", "altitude"),
        ("imu_p", "angular_velocity.x"),
    ],
)  # fmt: skip
def test_what_an_instrument_measures_is_its_signal(name, signal):
    assert guess_name(name).signal == signal


@pytest.mark.parametrize(
    ("name", "signal"),
    [
        ("airspeed_ktas", "true_airspeed"), ("v_kias", "indicated_airspeed"), ("Vind_kias", "indicated_airspeed"),
        ("airspeed_kcas", "calibrated_airspeed"), ("tas_ktas", "true_airspeed"), ("ktas", "true_airspeed"),
    ],
)  # fmt: skip
def test_knots_that_say_of_which_airspeed_they_are_are_believed(name, signal):
    """Of airspeed_ktas the true airspeed was read as the indicated one, of v_kias the other way round."""
    guess = guess_name(name)
    assert (guess.signal, guess.unit) == (signal, "kt")


def test_a_stall_speed_is_no_climb():
    assert guess_name("vs_kias") is None and guess_name("vs_kt").signal == "velocity.down"


def test_words_that_stand_together_are_of_another():
    assert is_of_another("gyro_temp") and is_of_another("p_rate_limit") and not is_of_another("gyro_x")


@pytest.mark.parametrize(
    ("name", "values", "unit"),
    [
        ("dt", 0.02 + 1e-5 * np.sin(np.arange(400)), None),  # [s]
        ("dt", 20.0 + 0.1 * np.sin(np.arange(400)), None),  # [ms]
        ("dt", 0.5 + 0.3 * np.sin(0.1 * np.arange(400)), "1"),
        ("throttle", np.full(400, 0.1), "1"),
        ("flaps", np.where(np.arange(400) > 200, 2.0, 0.0), None),
        ("flaps (deg)", np.where(np.arange(400) > 200, 20.0, 0.0), "deg"),
    ],
)
def test_a_time_step_is_no_throttle_and_the_positions_of_a_lever_are_no_degrees(tmp_path, name, values, unit):
    time = 0.02 * np.arange(400)
    layouts.write_rows(tmp_path / "log.csv", ["time_s", "p", name], [time, np.sin(time), values])
    (part,) = guess_map(tmp_path / "log.csv").parts
    (line,) = (line for line in part.lines if line.column == name)
    assert (line.unit, line.active) == (unit or "?", unit is not None)
