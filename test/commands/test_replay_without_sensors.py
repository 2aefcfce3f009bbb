"""`replay` of flights that lack a sensor: derivatives against the truth, what is said of them, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

GPS = ("gps/fix", "gps/vel")
VANES = ("angle_of_attack", "sideslip")
MAIN = ("CZ_alpha", "CY_beta", "Cl_p", "Cl_da", "Cm_alpha", "Cm_q", "Cm_de", "Cn_beta", "Cn_dr")


def at_rate(aircraft, rate):
    """The aircraft with an IMU of that rate [Hz]."""
    sensors = {n: replace(s, rate=rate) if n in ("accelerometer", "gyro") else s for n, s in aircraft.sensors.items()}
    return replace(aircraft, sensors=sensors)


def without(streams, topics=(), fields=()):
    """Streams without topics, and without fields of the air data."""
    found = []
    for stream in streams:
        if stream.topic in topics:
            continue
        if stream.topic == "air_data" and fields:
            gone = {name: np.full(len(stream.stamp), np.nan) for name in fields}
            stream = replace(stream, fields={**stream.fields, **gone})
        found.append(stream)
    return found


def write(path, streams):
    with RecordingWriter(path) as writer:
        for s in streams:
            writer.write(s.topic, TOPICS[s.topic], s.stamp, s.fields, log_time=s.arrival)
    return path


@pytest.fixture
def replayed(tmp_path, aircraft_file, capsys):
    """Replays streams; the result of ``replay`` by name of parameters, with its notes and status texts."""

    def replay(streams, *options, name="run"):
        recording = write(tmp_path / f"{name}_bag", streams)
        arguments = ["replay", recording, "--aircraft", aircraft_file, "--out", tmp_path / name, "--json", *options]
        assert main([str(argument) for argument in arguments]) == 0
        result = json.loads(capsys.readouterr().out)
        written = json.loads((tmp_path / name / "state.json").read_text())
        assert written["wind_ned"] == result["state"]["wind_ned"]
        assert set(written["notes"]) <= set(result["notes"])
        return result

    return replay


def check_derivatives(result, aircraft, names, share):
    """Within a share of the truth and three standard errors of it, and to be used."""
    found = {p["name"]: p for p in result["parameters"]["parameters"]}
    for name in names:
        p, true = found[name], aircraft.coefficients[name]
        assert p["status"] == "USE", p
        assert abs(p["value"] / true - 1.0) < share, p
        assert abs(p["value"] - true) < 3.0 * p["std"], p


@pytest.fixture(scope="module")
def run_without_airspeed(aircraft, aircraft_file, tmp_path_factory):
    """A run of a flight whose air data lack it."""
    folder = tmp_path_factory.mktemp("no airspeed")
    streams = without(simulate_samples(aircraft, seed=44, duration=40.0).streams, (), ("true_airspeed",))
    recording = write(folder / "bag", streams)
    assert main(["replay", str(recording), "--aircraft", str(aircraft_file), "--out", str(folder / "run")]) == 0
    return folder / "run"


@pytest.fixture(scope="module")
def flown(aircraft):
    return simulate_samples(aircraft, seed=41, duration=90.0, sensors=SensorOptions(attitude=True))


@pytest.mark.long
@pytest.mark.parametrize(
    ("topics", "note"),
    [
        (("gps/vel",), "no GPS velocity: "),
        pytest.param(("gps/fix",), "no GPS position: ", marks=pytest.mark.long),
        (GPS, "no GPS: wind is not estimated"),
    ],
)
def test_derivatives_without_part_or_all_of_the_gps(replayed, flown, aircraft, topics, note):
    result = replayed(without(flown.streams, topics))
    check_derivatives(result, aircraft, MAIN, 0.05)
    assert len([text for text in result["notes"] if text.startswith(note)]) == 1
    wind = result["state"]["wind_ned"]
    assert wind == [None] * 3 if topics == GPS else np.abs(np.array(wind) - flown.truth.wind[-1]).max() < 1.0


@pytest.mark.long
@pytest.mark.parametrize("rate", [pytest.param(25.0, marks=pytest.mark.long), 10.0])
def test_a_slow_imu_without_gps_and_attitude_shows_the_main_derivatives(replayed, aircraft, rate):
    slow = simulate_samples(at_rate(aircraft, rate), seed=42, duration=90.0)
    result = replayed(without(slow.streams, GPS))
    check_derivatives(result, aircraft, MAIN, 0.05)
    assert any("heading is counted from the start" in note for note in result["notes"])
    constants = [p for p in result["parameters"]["parameters"] if p["name"].endswith("_0")]
    assert not [p for p in constants if p["status"] == "USE"]  # they were off by up to 12 standard errors in gusts
    assert [p for p in constants if "without GPS it may contain an IMU bias" in p["reason"]]


@pytest.mark.long
def test_twenty_short_manoeuvres_at_25_hertz_without_gps(replayed, aircraft, tmp_path):
    """10 s each: shorter than the wait for GPS and a window of its own would leave of them if it lost samples."""
    slow = simulate_samples(at_rate(aircraft, 25.0), seed=64, duration=225.0)
    begin = [3.0 + 11.0 * number for number in range(20)]
    segments = [{"name": f"m{number}", "start": t, "stop": t + 10.0} for number, t in enumerate(begin)]
    (tmp_path / "segments.yaml").write_text(json.dumps(segments))
    result = replayed(without(slow.streams, GPS), "--segments", tmp_path / "segments.yaml")
    check_derivatives(result, aircraft, MAIN, 0.05)
    assert len(result["state"]["manoeuvres"]) == 20 and result["state"]["wind_ned"] == [None] * 3


@pytest.mark.long
def test_without_vanes_and_gps_what_is_used_is_right(replayed, flown, aircraft):
    result = replayed(without(flown.streams, GPS, VANES))
    used = [p for p in result["parameters"]["parameters"] if p["status"] == "USE"]
    assert len(used) >= 5
    small = [p for p in result["parameters"]["parameters"] if "which no vane measures" in p["reason"]]
    assert {p["name"] for p in small} & {"CY_p", "CY_r", "CY_da", "Cl_dr", "Cn_p", "Cn_da"}  # beside those of an angle
    for p in used:
        assert abs(p["value"] - aircraft.coefficients[p["name"]]) < 3.5 * p["std"], p
    (note,) = (text for text in result["notes"] if text.startswith("no angle of attack and no sideslip"))
    assert "inferred" in note
    assert not any("100 %" in text for text in result["notes"])


@pytest.mark.long
def test_without_airspeed_the_air_is_calm_only_on_request(replayed, aircraft):
    still = simulate_samples(aircraft, seed=43, duration=90.0, wind=(0.0, 0.0, 0.0), wind_walk=0.0)
    streams = without(still.streams, (), ("true_airspeed", *VANES))
    refused = replayed(streams)
    assert not [p for p in refused["parameters"]["parameters"] if p["status"] == "USE"]
    assert any("--calm-air" in note for note in refused["notes"])
    result = replayed(streams, "--calm-air", name="calm")
    check_derivatives(result, aircraft, ("Cl_p", "Cl_da", "Cn_dr"), 0.1)
    assert any("the air is taken as calm" in note for note in result["notes"])


@pytest.mark.parametrize("command", ["compare", "diagnose", "add", "refine"])
def test_what_comes_after_a_flight_refuses_one_without_airspeed(run_without_airspeed, capsys, command):
    """It would find probes out of place and parameters with USE that are seven standard errors off."""
    more = ["sideslip_drag"] if command == "add" else []
    assert main([command, str(run_without_airspeed), *more]) == 2
    assert "this flight has no airspeed" in capsys.readouterr().err


def refusal(capsys, *words):
    """The one sentence with which a command refuses."""
    assert main([str(word) for word in words]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line


def thinned(streams, topic, every):
    """Streams of which one has only every so many samples."""
    return [
        replace(
            s, stamp=s.stamp[::every], arrival=s.arrival[::every], fields={n: v[::every] for n, v in s.fields.items()}
        )
        if s.topic == topic
        else s
        for s in streams
    ]


@pytest.fixture(scope="module")
def plain(aircraft):
    """A flight without an attitude."""
    return simulate_samples(aircraft, seed=46, duration=40.0)


@pytest.mark.long
def test_angles_that_nothing_shows_are_named_by_every_command(replayed, plain, aircraft, tmp_path, capsys):
    result = replayed(without(plain.streams, GPS, VANES))
    for p in result["parameters"]["parameters"]:
        angle = "beta" if p["name"][:2] in ("CY", "Cl", "Cn") else "alpha"
        assert p["reason"].startswith(f"needs {angle}, which no vane measures"), p
    lacking = "CX cannot be fitted: it needs alpha, which is not measured: record it"
    assert lacking in refusal(capsys, "compare", tmp_path / "run")
    assert main(["diagnose", "--replicas", "2", str(tmp_path / "run")]) == 0
    said = capsys.readouterr().out
    assert "note: the library was not searched: " in said and lacking in said
    assert "no input has stopped acting" in said and "nothing is missing" not in said


@pytest.mark.long
def test_controls_that_are_not_there_are_named_by_every_command(replayed, plain, tmp_path, capsys):
    result = replayed(without(plain.streams, ("control_surfaces",)))
    reasons = {p["name"]: p["reason"] for p in result["parameters"]["parameters"]}
    lacking = "needs de and Tc, which are not measured: record them, or take their terms out of the model"
    assert reasons["CX_0"] == lacking and reasons["Cm_de"].startswith("needs de, which is not measured: record it")
    for command in (["compare"], ["diagnose", "--replicas", 2]):
        assert f"CX cannot be fitted: it {lacking}" in refusal(capsys, *command, tmp_path / "run")


@pytest.mark.long
def test_an_airspeed_that_comes_too_seldom_is_said_at_once_and_judged_by_nobody(replayed, plain, tmp_path, capsys):
    """Diagnosis named four effects in a flight that lacks none."""
    result = replayed(thinned(plain.streams, "air_data", 300))
    slow = "the airspeed comes at 0.17 Hz: at least 0.5 Hz is needed"
    assert slow in result["notes"]
    assert {p["reason"] for p in result["parameters"]["parameters"]} == {
        "no airspeed since 0.1 s, nothing was known before"  # when the first of them came
    }
    for command in (["compare"], ["diagnose", "--replicas", 2]):
        assert slow in refusal(capsys, *command, tmp_path / "run")


@pytest.mark.long
def test_compare_does_not_blame_sensors_that_are_not_there(replayed, plain, tmp_path, capsys):
    replayed(without(plain.streams, (), VANES))
    assert main(["compare", str(tmp_path / "run"), "--json"]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert [
        note for note in notes if "too few to judge" not in note and not note.startswith("alpha and beta are")
    ] == []
    assert any(note.startswith("alpha and beta are not measured but inferred from wind") for note in notes)


@pytest.mark.long
def test_all_gps_is_better_than_none(replayed, flown, aircraft):
    """And what is said goes when the sensor is there."""
    result = replayed(flown.streams)
    check_derivatives(result, aircraft, MAIN, 0.05)
    assert result["notes"] == [] and result["state"]["notes"] == []


@pytest.mark.long
def test_smoothed_and_after_the_flight(replayed, flown, aircraft, tmp_path, capsys):
    """The smoother and `compare` go over a flight without GPS as over any other."""
    result = replayed(without(flown.streams, GPS), "--smooth")
    check_derivatives(result, aircraft, MAIN, 0.05)
    assert result["state"]["wind_ned"] == [None] * 3
    assert main(["compare", str(tmp_path / "run"), "--json"]) == 0
    axes = json.loads(capsys.readouterr().out)["axes"]
    assert all(axis["nrmse_held_out"] < 0.1 for axis in axes.values())


@pytest.mark.long
def test_likelihood_learns_without_gps(replayed, flown, aircraft):
    result = replayed(without(flown.streams, GPS), "--estimator", "rml")
    check_derivatives(result, aircraft, ("CZ_alpha", "Cl_p", "Cm_alpha", "Cn_beta"), 0.1)


REAL = {
    "seaway": ("mit_seaway", "mass: 9.4, wing_area: 1.499, span: 4.27, chord: 0.351, inertia: {xx: 4, yy: 1.5, zz: 5}"),
    "wing": (
        "paparazzi_fault",
        "mass: 0.9, wing_area: 0.3, span: 1.2, chord: 0.25, inertia: {xx: .05, yy: .03, zz: .08}",
    ),
    "alfa": (
        "alfa_engine_failure",
        "mass: 2, wing_area: 0.5, span: 2, chord: 0.26, inertia: {xx: .15, yy: .2, zz: .3}",
    ),
}


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "said"),
    [
        pytest.param(  # what it says the others say as well; its import: test_import_guess.py
            "seaway",
            ["no angle of attack and no sideslip is measured", "no /control_surfaces"],
            marks=pytest.mark.long,
        ),
        ("wing", ["no airspeed: no parameter is learnt", "no /control_surfaces"]),
        ("alfa", ["no angle of attack and no sideslip is measured", "the controls come at 2.6 Hz"]),
    ],
)
def test_flights_of_strangers_run_and_say_what_cannot_be_known(shared_data, tmp_path, capsys, name, said):
    folder, numbers = REAL[name]
    source = shared_data / folder
    source = next(source.glob("*.data"), source)
    (tmp_path / "plane.yaml").write_text(f"{{name: {name}, {numbers}}}\n")
    assert main(["import", str(source), "--out", str(tmp_path / "bag")]) == 0
    capsys.readouterr()
    command = ["replay", tmp_path / "bag", "--aircraft", tmp_path / "plane.yaml", "--out", tmp_path / "run", "--json"]
    assert main([str(word) for word in command]) == 0
    result = json.loads(capsys.readouterr().out)
    for text in said:
        assert any(note.startswith(text) for note in result["notes"]), (text, result["notes"])
    assert not [p for p in result["parameters"]["parameters"] if p["status"] == "USE"]
    samples = result["state"]["samples"]
    assert samples["imu"]["received"] > 1000
    assert samples["gps_velocity"].get("rejected", 0) < 0.15 * samples["gps_velocity"]["received"]
