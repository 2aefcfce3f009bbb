"""Speed and course over ground as a velocity, commands in an angle, and names in German and French."""

import numpy as np
import pytest
import strange_layouts as layouts

from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.recordings.tabular.column_expression import parse_column_expression
from aircraft_sysid_ros.recordings.tabular.guess.first_map import guess_map
from aircraft_sysid_ros.recordings.tabular.guess.names import guess_ground_track, guess_name, in_company
from aircraft_sysid_ros.simulation.calibration_flight import calibration_flight

KNOT = 1852.0 / 3600.0


def lines_of(flight, folder, further):
    truth = flight.truth
    rows = np.arange(100, len(truth.time) // 2, max(1, round(0.04 / np.median(np.diff(truth.time)))))
    euler = np.array([euler_from_quaternion(q) for q in truth.quaternion[rows]])
    columns = {
        **{f"a{axis}_mps2": truth.specific_force[rows, i] for i, axis in enumerate("xyz")},
        **{f"{axis}_rps": truth.rates[rows, i] for i, axis in enumerate("pqr")},
        **{f"{angle}_deg": np.degrees(euler[:, i]) for i, angle in enumerate(("roll", "pitch", "yaw"))},
        "tas_mps": truth.airspeed[rows],
        **further(truth, rows),
    }  # fmt: skip
    layouts.write_rows(folder / "flight.csv", ["time_s", *columns], [truth.time[rows], *columns.values()])
    (part,) = guess_map(folder / "flight.csv").parts
    return {line.signal: line for line in part.lines}, part, columns, truth.velocity[rows]


@pytest.mark.parametrize(
    "names",
    [
        ("gs_kt", "track_deg"),
        ("ground speed [kt]", "COG [deg]"),
        ("v_ground_kt", "Kurs_deg"),
        ("GS (kts)", "Course (°)"),
    ],
)
def test_speed_and_course_over_ground_are_the_velocity(flight, tmp_path, names):
    def further(truth, rows):
        north, east = truth.velocity[rows, 0], truth.velocity[rows, 1]
        return {names[0]: np.hypot(north, east) / KNOT, names[1]: np.degrees(np.arctan2(east, north)) % 360.0}

    lines, part, columns, velocity = lines_of(flight, tmp_path, further)
    assert not set(names) & set(part.unmapped)
    for i, way in enumerate(("north", "east")):
        line = lines[f"velocity.{way}"]
        assert line.active and line.unit in ("kt", "kts"), line
        value = line.sign * KNOT * parse_column_expression(line.expression).evaluate(columns)
        np.testing.assert_allclose(value, velocity[:, i], atol=0.02)


@pytest.mark.parametrize("declination", [0.0, 13.0, -8.0])
def test_a_course_from_magnetic_north_is_left_to_the_user(flight, tmp_path, declination):
    """A panel's track is magnetic: the velocity to the north was sure, and turned by the declination."""

    def further(truth, rows):
        north, east = truth.velocity[rows, 0], truth.velocity[rows, 1]
        latitude, longitude, _ = truth.origin
        return {
            "lat_deg": np.degrees(latitude + truth.position[rows, 0] / 6.371e6),
            "lon_deg": np.degrees(longitude + truth.position[rows, 1] / 6.371e6 / np.cos(latitude)),
            "gs_kt": np.hypot(north, east) / KNOT,
            "track_deg": (np.degrees(np.arctan2(east, north)) - declination) % 360.0,
        }

    lines, *_ = lines_of(flight, tmp_path, further)
    pair = [lines[f"velocity.{way}"] for way in ("north", "east")]
    assert [line.active for line in pair] == [not declination] * 2
    if declination:
        assert all(f"{abs(declination):.0f} deg" in line.evidence and "magnetic" in line.evidence for line in pair)


def test_velocities_that_have_names_go_before(flight, tmp_path):
    def further(truth, rows):
        north, east = truth.velocity[rows, 0], truth.velocity[rows, 1]
        return {"gs_mps": np.hypot(north, east), "track": np.arctan2(east, north), "vn_mps": north, "ve_mps": east}

    _, part, *_ = lines_of(flight, tmp_path, further)
    lines = [(line.column, line.active) for line in part.lines if line.signal == "velocity.north"]
    assert lines == [("vn_mps", True), ("gs_mps, track", False)]


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_a_heading_that_goes_on_through_north_is_an_angle(tmp_path, unit):
    """Circles both ways, counted on."""
    truth = calibration_flight().truth
    rows = np.arange(0, len(truth.time), max(1, round(0.04 / np.median(np.diff(truth.time)))))
    roll, pitch, yaw = np.unwrap([euler_from_quaternion(q) for q in truth.quaternion[rows]], axis=0).T
    assert np.ptp(yaw) > 2.0 * np.pi
    columns = {
        **{f"a{axis}": truth.specific_force[rows, i] for i, axis in enumerate("xyz")},
        **{axis: truth.rates[rows, i] for i, axis in enumerate("pqr")},
        **{f"v{way[0]}": truth.velocity[rows, i] for i, way in enumerate(("north", "east", "down"))},
        "roll": roll, "pitch": pitch, "yaw": np.degrees(yaw) if unit == "deg" else yaw,
    }  # fmt: skip
    layouts.write_rows(tmp_path / "flight.csv", ["time", *columns], [truth.time[rows], *columns.values()])
    (part,) = guess_map(tmp_path / "flight.csv").parts
    line = next(line for line in part.lines if line.signal == "attitude.yaw")
    assert (line.unit, line.active, line.sign) == (unit, True, 1.0), line


@pytest.mark.parametrize("alone", ["gs_kt", "track_deg"])
def test_one_of_the_two_is_nothing(flight, tmp_path, alone):
    lines, part, *_ = lines_of(flight, tmp_path, lambda truth, rows: {alone: truth.airspeed[rows]})
    assert alone in part.unmapped and not any(signal.startswith("velocity") for signal in lines)


def test_a_command_in_an_angle_is_a_surface_that_is_not_sure_and_a_measured_one_goes_before():
    assert guess_name("elevator_cmd_deg").signal == "elevator" and guess_name("da_command [rad]").signal == "aileron"
    assert guess_name("elevator_cmd") is None and guess_name("elevator_cmd_us") is None
    assert guess_name("elevator_pos_deg").distance < guess_name("elevator_cmd_deg").distance


@pytest.mark.parametrize(
    ("name", "signal", "unit"),
    [
        ("Höhenruder [°]", "elevator", "°"), ("Querruderausschlag_deg", "aileron", "deg"),
        ("Flughöhe [m]", "altitude", "m"), ("Nickwinkel", "attitude.pitch", ""),
        ("Gierrate [°/s]", "angular_velocity.z", "°/s"), ("Drehzahl", "propeller_speed", ""),
        ("Anstellwinkel_deg", "angle_of_attack", "deg"), ("Steiggeschwindigkeit [m/s]", "velocity.down", "m/s"),
        ("dérapage", "sideslip", ""), ("assiette [deg]", "attitude.pitch", "deg"),
        ("Staudruck [Pa]", "dynamic_pressure", "Pa"),
        ("Drehzahl [U/min]", "propeller_speed", "U/min"), ("gouverne de profondeur [°]", "elevator", "°"),
        ("taux_lacet_deg_s", "angular_velocity.z", "deg/s"), ("regime_tr_min", "propeller_speed", "rpm"),
    ],
)  # fmt: skip
def test_german_and_french(name, signal, unit):
    guess = guess_name(name)
    assert guess is not None and (guess.signal, guess.unit) == (signal, unit)
    assert guess.sign == (-1.0 if name.startswith("Steig") else 1.0)


def test_a_velocity_that_is_called_an_airspeed_is_none(flight, tmp_path):
    """Sure by its name alone had been a column that is below zero half of the time."""
    lines, *_ = lines_of(flight, tmp_path, lambda truth, rows: {"tas_mps": truth.velocity[rows, 1]})
    assert not lines["true_airspeed"].active and "below zero" in lines["true_airspeed"].evidence


@pytest.mark.parametrize("name", ["direction_deg", "laenge_m", "breite_m", "cap", "regime", "wind_direction"])
def test_words_that_mean_something_else_are_not_guessed(name):
    assert guess_name(name) is None


def test_est_is_the_east_beside_the_north_and_an_estimate_alone():
    assert guess_name(in_company("v_est_m_s", ["v_nord_m_s"])).signal == "velocity.east"
    assert guess_name(in_company("v_est_m_s", ["alpha_deg"])).signal == "true_airspeed"


@pytest.mark.parametrize("name", ["track_m", "course_m", "ground_track_km", "track_s"])
def test_a_distance_along_a_track_is_no_course(name):
    assert guess_ground_track(name) is None
