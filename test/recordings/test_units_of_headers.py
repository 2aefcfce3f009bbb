"""Units as headers write them."""

import numpy as np
import pytest
import strange_layouts as layouts

from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.recordings.tabular.guess.first_map import guess_map
from aircraft_sysid_ros.recordings.tabular.units import conversion, is_unit


@pytest.mark.parametrize(
    ("capitals", "unit", "si_unit"),
    [
        ("M/S", "m/s", "m/s"), ("M", "m", "m"), ("FT", "ft", "m"), ("DEG/S", "deg/s", "rad/s"), ("KT", "kt", "m/s"),
        ("DEG", "deg", "rad"), ("KM/H", "km/h", "m/s"), ("M/S^2", "m/s^2", "m/s^2"), ("KG/M^3", "kg/m^3", "kg/m^3"),
        ("1E-7 DEG", "1e-7 deg", "rad"), ("MS", "ms", "s"), ("N", "N", "N"), ("K", "K", "K"), ("MMHG", "mmHg", "Pa"),
        ("FT/MIN", "ft/min", "m/s"), ("G", "g", "m/s^2"),
    ],
)  # fmt: skip
def test_a_unit_in_capitals_is_that_unit(capitals, unit, si_unit):
    """M was molar and S siemens, and the unit of the header was dropped without a word."""
    assert is_unit(capitals)
    assert conversion(capitals, si_unit) == conversion(unit, si_unit)


def test_newton_metres_in_capitals_are_no_nanometres():
    assert not is_unit("NM")


def test_a_header_in_capitals_says_the_units(tmp_path):
    names = ["TIME (SEC)", "HP (M)", "P (DEG/S)", "TAS (KT)"]
    layouts.write_rows(
        tmp_path / "log.csv", names, [[0.02 * i for i in range(60)], *([20.0 + i % 3 for i in range(60)],) * 3]
    )
    (part,) = guess_map(tmp_path / "log.csv").parts
    assert {line.signal: line.unit for line in part.lines} == {
        "pressure_altitude": "M", "angular_velocity.x": "DEG/S", "true_airspeed": "KT",
    }  # fmt: skip


@pytest.mark.parametrize("unit", ["deg", "DEG", "°"])
def test_a_heading_from_the_east_is_turned_in_its_unit_however_it_is_written(flight, tmp_path, unit):
    """By a quarter of a turn in radians, where the unit was not written as deg."""
    truth = flight.truth
    rows = np.arange(0, len(truth.time), max(1, round(0.04 / np.median(np.diff(truth.time)))))
    heading = np.unwrap([euler_from_quaternion(q)[2] for q in truth.quaternion[rows]])
    columns = {
        "time (s)": truth.time[rows], "r (rad/s)": truth.rates[rows, 2], "vn (m/s)": truth.velocity[rows, 0],
        "ve (m/s)": truth.velocity[rows, 1], f"psi ({unit})": 90.0 - np.degrees(heading),
    }  # fmt: skip
    layouts.write_rows(tmp_path / "log.csv", list(columns), list(columns.values()))
    (part,) = guess_map(tmp_path / "log.csv").parts
    (line,) = (line for line in part.lines if line.signal == "attitude.yaw")
    assert (line.unit, line.sign, line.active) == (unit, -1.0, True)
    assert line.offset == pytest.approx(-90.0)
