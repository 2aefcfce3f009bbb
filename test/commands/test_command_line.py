"""The command line as a user meets it: one clear line and status 2 for bad input, JSON on request."""

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import replace as replaced
from pathlib import Path

import numpy as np
import pytest
from waiting import LONGEST

from aircraft_sysid_ros.commands import progress
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.processes import ONE_THREAD
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS, nanoseconds_of
from aircraft_sysid_ros.run_reader import read_samples
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

SECOND = 1_000_000_000
NAMES = (
    "CX_0 CX_alpha CX_alpha2 CX_q CX_de CX_Tc", "CY_0 CY_beta CY_p CY_r CY_da CY_dr",
    "CZ_0 CZ_alpha CZ_q CZ_de",
    "Cl_0 Cl_beta Cl_p Cl_r Cl_da Cl_dr", "Cm_0 Cm_alpha Cm_q Cm_de", "Cn_0 Cn_beta Cn_p Cn_r Cn_da Cn_dr",
)  # fmt: skip
#: Those of the GPS go one way.
TOPICS_OF_A_FLIGHT = (
    "imu/data",
    "gps/fix",
    pytest.param("gps/vel", marks=pytest.mark.long),
    "air_data",
    "control_surfaces",
)
RUN_FILES = {"estimates.mcap", "parameters.json", "state.json", "points.npz", "aircraft.yaml", "samples.npz"}


@pytest.fixture
def cli(capfd):
    """Calls the command line in this process; returns exit status, standard output and standard error."""

    def call(*arguments):
        try:
            status = main([str(argument) for argument in arguments])
        except SystemExit as end:  # of argparse
            status = end.code
        captured = capfd.readouterr()
        return status, captured.out, captured.err

    return call


def without_nan(text):
    """The JSON document of a text; NaN and infinity, which JSON does not have, fail."""

    def refuse(name):
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.fixture(scope="module")
def short(aircraft):
    """A flight of 45 s in memory."""
    return simulate_samples(aircraft, seed=3, duration=45.0)


def write(path, streams, prefix=""):
    with RecordingWriter(path) as writer:
        for s in streams:
            writer.write(prefix + s.topic, TOPICS[s.topic], s.stamp, s.fields, log_time=s.arrival)
    return path


def chosen(stream, rows):
    fields = {name: np.asarray(value)[rows] for name, value in stream.fields.items()}
    return replaced(stream, stamp=stream.stamp[rows], arrival=stream.arrival[rows], fields=fields)


@pytest.fixture(scope="module")
def bag(short, tmp_path_factory):
    return write(tmp_path_factory.mktemp("bag") / "flight", short.streams)


@pytest.fixture(scope="module")
def run(bag, aircraft_file, tmp_path_factory):
    """A replayed run and what the command printed."""
    folder = tmp_path_factory.mktemp("run") / "run"
    command = ["replay", bag, "--aircraft", aircraft_file, "--out", folder, "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "aircraft_sysid_ros.commands.main", *map(str, command)],
        capture_output=True, text=True, timeout=300, check=True,
    )  # fmt: skip
    return folder, done.stdout


# -- bad input ----------------------------------------------------------------------------------------------


def check_refused(result, *texts):
    status, out, err = result
    assert status == 2
    assert out == ""
    assert len(err.strip().splitlines()) == 1, err
    assert err.startswith("aircraft-sysid") and "Traceback" not in err
    for text in texts:
        assert text in err


@pytest.mark.long
def test_recordings_that_cannot_be_replayed(cli, short, bag, aircraft_file, tmp_path):
    def replay(recording):
        out = tmp_path / "run"
        result = cli("replay", recording, "--aircraft", aircraft_file, "--out", out)
        assert not out.exists()
        return result

    check_refused(replay("nowhere"), "there is no recording nowhere")
    check_refused(replay(aircraft_file), "is not a recording")
    check_refused(replay(tmp_path), "is not a recording")
    streams = [s for s in short.streams if s.topic != "imu/data"]
    check_refused(replay(write(tmp_path / "no_imu", streams)), "lacks /imu/data", "it holds /", "/control_surfaces")
    streams = [s for s in short.streams if s.topic in ("imu/data", "control_surfaces")]
    check_refused(
        replay(write(tmp_path / "imu_alone", streams)), "neither GPS nor air data", "one of /gps/fix, /gps/vel"
    )
    damaged = tmp_path / "damaged"
    shutil.copytree(bag, damaged)
    (file,) = damaged.glob("*.mcap")
    file.write_bytes(b"\x00" * 5000)
    check_refused(replay(damaged), str(file.name))
    file.write_bytes(b"")
    check_refused(replay(damaged))
    (damaged / "metadata.yaml").write_text(": [")
    check_refused(replay(damaged), "metadata.yaml")


@pytest.mark.parametrize(
    ("line", "texts"),
    [
        ("mass: -1.0", ("mass must be positive", "-1")),
        ("wing_area: 0.3097\nwing_aera: 2", ("unknown key 'wing_aera'", "did you mean 'wing_area'")),
        ("mass: nan", ("mass must be a finite number",)),
        ("mass: heavy", ("mass must be a number", "'heavy'")),
    ],
)
def test_bad_aircraft_files(cli, bag, tmp_path, line, texts):
    base = ["name: x", "mass: 1.9", "wing_area: 0.3", "span: 1.2", "chord: 0.2"]
    key = line.split(":")[0]
    path = tmp_path / "plane.yaml"
    kept = [item for item in base if not item.startswith(key + ":")]
    path.write_text("\n".join([*kept, line, "inertia: {xx: 0.07, yy: 0.08, zz: 0.15}"]))
    check_refused(cli("replay", bag, "--aircraft", path, "--out", tmp_path / "run"), str(path), *texts)
    check_refused(cli("live", "--aircraft", path), *texts)


def test_an_aircraft_file_that_is_not_there(cli, bag, tmp_path):
    result = cli("replay", bag, "--aircraft", "nowhere.yaml", "--out", tmp_path / "run")
    check_refused(result, "nowhere.yaml", "No such file")


@pytest.mark.long
def test_targets_that_are_taken_or_cannot_be_written(cli, bag, run, aircraft_file, tmp_path):
    def replay(out, *options):
        return cli("replay", bag, "--aircraft", aircraft_file, "--out", out, *options)

    file = tmp_path / "file"
    file.write_text("precious")
    check_refused(replay(file, "--overwrite"), "is a file")
    check_refused(replay(file / "run"), "cannot write the run", str(file))
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.txt").write_text("precious")
    check_refused(replay(other, "--overwrite"), "is not a run and is not overwritten")
    check_refused(replay(run[0]), "already there", "--overwrite")
    check_refused(cli("live", "--aircraft", aircraft_file, "--out", run[0]), "already there")
    check_refused(replay("/proc/run"), "cannot write the run /proc/run")
    assert file.read_text() == (other / "thesis.txt").read_text() == "precious"
    assert {item.name for item in tmp_path.iterdir()} == {"file", "other"}


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission(cli, bag, aircraft_file, tmp_path):
    tmp_path.chmod(0o500)
    result = cli("replay", bag, "--aircraft", aircraft_file, "--out", tmp_path / "run")
    tmp_path.chmod(0o700)
    check_refused(result, "cannot write the run")


@pytest.mark.long_after_the_first
@pytest.mark.parametrize(
    ("arguments", "texts"),
    [
        ("", ("COMMAND", "--help")),
        ("fly", ("invalid choice: 'fly'", "simulate")),
        ("replya BAG", ("invalid choice: 'replya'", ": did you mean replay?; see aircraft-sysid --help")),
        ("recover RUN --out X", ("unrecognized arguments: --out X", "; see aircraft-sysid recover --help")),
        ("compare RUN --jsno", ("unrecognized arguments: --jsno: did you mean --json?",)),
        ("replay", ("required", "BAG")),
        ("replay BAG --aircrft FILE --out RUN", ("--aircraft: did you mean --aircraft in place of --aircrft?",)),
        ("replay BAG --aircraft FILE --ovt=RUN", ("--out: did you mean --out in place of --ovt?",)),
        ("replay BAG --aircraft FILE --out RUN --estimator rsl", ("did you mean rls?",)),
        ("diagnose RUN --replicas 1e1", ("--replicas: '1e1' is not a whole number",)),
        ("replay BAG --aircraft FILE --out RUN --horizon soon", ("--horizon", "'soon'")),
        ("replay BAG --aircraft FILE --out RUN --horizon -1", ("--horizon must be between 0 and 5",)),
        ("replay BAG --aircraft FILE --out RUN --horizon nan", ("--horizon must be between 0 and 5",)),
        ("replay BAG --aircraft FILE --out RUN --forgetting-time 0", ("--forgetting-time",)),
        ("replay BAG --aircraft FILE --out RUN --forgetting-time inf", ("--forgetting-time",)),
        ("replay BAG --aircraft FILE --out RUN --frequencies 0.1 1.5", ("--frequencies is for", "auto")),
        ("replay BAG --aircraft FILE --out RUN --estimator fourier --frequencies 2 1", ("must rise between 0.01",)),
        ("live --aircraft FILE --estimator rml --frequencies 0.1 1.5", ("--frequencies is for --estimator fourier",)),
        ("replay BAG --aircraft FILE --out RUN --wrong 1", ("unrecognized arguments: --wrong",)),
        ("live --aircraft FILE --until-idle 0", ("--until-idle must be a positive time",)),
        ("live --aircraft FILE --forgetting-time 1e7", ("--forgetting-time",)),
        ("live --aircraft FILE --namespace a:b", ("--namespace a:b is not a namespace",)),
        ("live --aircraft FILE --ready-file /nowhere/ready", ("cannot write /nowhere/ready",)),
        ("play nowhere", ("there is no recording nowhere",)),
        ("play BAG --rate -2", ("--rate must be 0 or more",)),
        ("import nowhere.mat --out BAG2", ("there is no log nowhere.mat",)),
        ("import FILE --out BAG2", ("cannot be imported", ".mat")),
        ("simulate --out BAG2 --duration 1", ("lasts 20 to 3600 s",)),
        ("simulate", ("required: --out",)),
    ],
)
def test_bad_options_and_commands(cli, bag, aircraft_file, tmp_path, monkeypatch, arguments, texts):
    monkeypatch.chdir(tmp_path)
    if arguments.startswith("live"):
        pytest.importorskip("rclpy")
    words = {"BAG": str(bag), "FILE": str(aircraft_file)}
    status, out, err = cli(*(words.get(word, word) for word in arguments.split()))
    lines = [line for line in err.splitlines() if "[INFO]" not in line and line != "listening"]
    check_refused((status, out, "\n".join(lines)), *texts)
    assert not list(tmp_path.iterdir())


# -- what comes out -----------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(("asked", "alone"), [(None, True), ("2", len(os.sched_getaffinity(0)) < 2)])
def test_a_command_has_one_thread_of_linear_algebra_unless_the_user_asks_for_more(asked, alone):
    """Its processes share the cores; threads that wait for each other spin."""
    probe = (
        "import os, sys; sys.argv = ['aircraft-sysid', 'compare', 'nowhere']\n"
        "from aircraft_sysid_ros.commands.main import main; main()\n"
        "import numpy; square = numpy.ones((500, 500)); square @ square\n"
        "print(len(os.listdir('/proc/self/task')))"
    )
    others = {name: value for name, value in os.environ.items() if name not in ONE_THREAD}
    environment = {**others, **({"OPENBLAS_NUM_THREADS": asked} if asked else {})}
    done = subprocess.run([sys.executable, "-c", probe], env=environment, capture_output=True, text=True, check=True)
    assert (int(done.stdout) == 1) == alone


@pytest.mark.long
def test_json_is_one_document(run, bag, cli, tmp_path, aircraft_file):
    folder, printed = run
    document = without_nan(printed)
    assert document["run"] == str(folder)
    assert document["parameters"] == without_nan((folder / "parameters.json").read_text())
    assert document["state"] == without_nan((folder / "state.json").read_text())
    status, out, _ = cli("simulate", "--out", tmp_path / "bag", "--duration", 20, "--json")
    assert status == 0
    assert without_nan(out)["messages"]["imu/data"] > 1900
    status, out, err = cli("replay", bag, "--aircraft", aircraft_file, "--out", tmp_path / "run")
    assert (status, err) == (0, "")
    assert "CZ_alpha" in out and "times real time" in out
    pytest.importorskip("rclpy")
    status, out, _ = cli("play", tmp_path / "bag", "--rate", 0, "--wait", 0.1, "--best-effort", "--json")
    assert status == 0
    assert without_nan(out)["messages"]["/gps/fix"] == 100


def test_import_prints_one_document(cli, tmp_path, monkeypatch):
    """The importers have their own tests: here a report with a number that JSON does not have."""
    from aircraft_sysid_ros.recordings import mat_import

    (tmp_path / "log.mat").write_bytes(b"")
    report = {"rate": float("nan"), "n": [1, 2.5]}
    monkeypatch.setattr(mat_import, "import_mat", lambda path, out, overwrite: report)
    status, out, _ = cli("import", tmp_path / "log.mat", "--out", tmp_path / "bag", "--json")
    assert status == 0
    assert without_nan(out) == {"rate": None, "n": [1, 2.5]}


@pytest.mark.long
def test_the_run_folder_is_as_promised(run, short):
    folder, _ = run
    assert {item.name for item in folder.iterdir()} == RUN_FILES
    parameters = without_nan((folder / "parameters.json").read_text())
    assert parameters["model"] == short.aircraft.model.identifier
    assert [p["name"] for p in parameters["parameters"]] == " ".join(NAMES).split()
    for p in parameters["parameters"]:
        assert {"name", "value", "std", "status", "reason"} <= p.keys()
        assert p["status"] in ("USE", "HOLD", "REJECT")
        assert p["reason"] == "" or p["status"] != "USE" or p["reason"].startswith("small")
        assert p["reason"] or p["status"] == "USE"
    state = without_nan((folder / "state.json").read_text())
    truth = {
        "accelerometer_bias": short.biases.accelerometer[-1],
        "gyro_bias": short.biases.gyro[-1],
        "wind_ned": short.truth.wind[-1],
    }
    for name, value in truth.items():
        std = np.array(state[name + "_std"])
        assert std.shape == (3,) and np.all(std > 0.0)
        assert np.all(np.abs(np.array(state[name]) - value) < 5.0 * std), name  # in FRD and NED
    assert state["duration"] == pytest.approx(45.0, abs=1.5)
    assert state["realtime_factor"] > 1.0


def test_estimates_are_an_ordinary_recording(run, short):
    """Readable by rosbags and by plain mcap, with the definitions inside; NED against the truth."""
    from mcap.reader import make_reader
    from rosbags.highlevel import AnyReader

    path = run[0] / "estimates.mcap"
    counts = {}
    with AnyReader([path]) as reader:
        types = {c.topic: c.msgtype for c in reader.connections}
        for connection, _, content in reader.messages():
            message = reader.deserialize(content, connection.msgtype)
            counts[connection.topic] = counts.get(connection.topic, 0) + 1
            if connection.topic.endswith("/parameters"):
                assert [p.name for p in message.parameters] == " ".join(NAMES).split()
                assert len(message.covariance) == 1024
            elif connection.topic.endswith("/model_error"):
                assert {axis.axis for axis in message.axes} <= {"CX", "CY", "CZ", "Cl", "Cm", "Cn"}
            elif connection.topic.endswith("/state"):
                last = message
            else:
                wind = message.twist.twist.linear
    assert types == {
        "/state_estimator/state": "aircraft_sysid_msgs/msg/AircraftState",
        "/state_estimator/wind": "geometry_msgs/msg/TwistWithCovarianceStamped",
        "/parameter_estimator/parameters": "aircraft_sysid_msgs/msg/Parameters",
        "/parameter_estimator/model_error": "aircraft_sysid_msgs/msg/ModelError",
    }
    assert counts["/state_estimator/state"] == counts["/state_estimator/wind"]
    assert counts["/state_estimator/state"] == pytest.approx(44 * 25, abs=40)
    assert counts["/parameter_estimator/parameters"] == counts["/parameter_estimator/model_error"] > 5
    assert [wind.y, wind.x, -wind.z] == list(last.wind_ned)
    assert np.array(last.wind_ned) == pytest.approx(short.truth.wind[-1], abs=0.7)
    with path.open("rb") as stream:
        reader = make_reader(stream)
        assert sum(1 for _ in reader.iter_messages()) == sum(counts.values())
        schemas = reader.get_summary().schemas.values()
        assert {schema.encoding for schema in schemas} == {"ros2msg"}
        assert all(schema.data for schema in schemas)


@pytest.mark.long
def test_replay_is_deterministic(cli, run, bag, aircraft_file, tmp_path):
    assert cli("replay", bag, "--aircraft", aircraft_file, "--out", tmp_path / "run")[0] == 0
    for name in ("parameters.json", "points.npz", "estimates.mcap"):
        assert (tmp_path / "run" / name).read_bytes() == (run[0] / name).read_bytes(), name


@pytest.mark.long
def test_the_numbers_do_not_depend_on_blocks(cli, run, bag, aircraft_file, tmp_path, monkeypatch):
    monkeypatch.setattr("aircraft_sysid_ros.after_flight.replay.BLOCK", 37)
    assert cli("replay", bag, "--aircraft", aircraft_file, "--out", tmp_path / "run")[0] == 0
    assert (tmp_path / "run" / "parameters.json").read_bytes() == (run[0] / "parameters.json").read_bytes()


@pytest.mark.long
def test_overwrite_replaces_a_run(cli, run, bag, aircraft_file, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run[0], folder)
    (folder / "parameters.json").write_text("{}")
    assert cli("replay", bag, "--aircraft", aircraft_file, "--out", folder, "--overwrite")[0] == 0
    assert (folder / "parameters.json").read_bytes() == (run[0] / "parameters.json").read_bytes()
    assert [item.name for item in tmp_path.iterdir()] == ["run"]


@pytest.mark.long
def test_a_run_that_another_replay_wrote_meanwhile_is_kept(cli, run, bag, aircraft_file, tmp_path, monkeypatch):
    """Two began when the name was free: the second says so in one sentence, and nothing vanishes."""
    import aircraft_sysid_ros.run_writer as run_writer

    gather = run_writer.state_json

    def other_is_faster(state):
        shutil.copytree(run[0], tmp_path / "run")
        return gather(state)

    monkeypatch.setattr(run_writer, "state_json", other_is_faster)
    result = cli("replay", bag, "--aircraft", aircraft_file, "--out", tmp_path / "run")
    check_refused(result, "another process has written there meanwhile, which is kept; give another name")
    assert [item.name for item in tmp_path.iterdir()] == ["run"]
    assert {f.name: f.read_bytes() for f in (tmp_path / "run").iterdir()} == {
        f.name: f.read_bytes() for f in run[0].iterdir()
    }


@pytest.mark.long
@pytest.mark.parametrize("place", ["push", "kernel", "finish"])
def test_an_interrupted_replay_leaves_nothing(cli, bag, aircraft_file, tmp_path, monkeypatch, place):
    def interrupt(*_):
        if place == "kernel":  # what Python makes of it when a compiled function returns
            raise SystemError("a compiled kernel returned a result with an exception set") from KeyboardInterrupt()
        raise KeyboardInterrupt

    target = {
        "push": "aircraft_sysid_ros.pipeline.Pipeline.flush",
        "kernel": "aircraft_sysid_ros.pipeline.Pipeline.flush",
        "finish": "aircraft_sysid_ros.run_writer.RunWriter._write_points",
    }[place]
    monkeypatch.setattr(target, interrupt)
    status, out, err = cli("replay", bag, "--aircraft", aircraft_file, "--out", tmp_path / "run", "--json")
    assert (status, out, err) == (130, "", "aircraft-sysid replay: stopped\n")
    assert not list(tmp_path.iterdir())


# -- recordings as they come --------------------------------------------------------------------------------


def replay(cli, recording, aircraft_file, out):
    status, printed, err = cli("replay", recording, "--aircraft", aircraft_file, "--out", out, "--json")
    assert (status, err) == (0, "")
    return without_nan(printed)


@pytest.mark.long
def test_a_namespace_changes_nothing(cli, run, short, aircraft_file, tmp_path):
    named = write(tmp_path / "bag", short.streams, "fleet/uav1/")
    result = replay(cli, named, aircraft_file, tmp_path / "run")
    assert result["parameters"] == json.loads((run[0] / "parameters.json").read_text())


@pytest.mark.long
def test_sqlite3_changes_nothing(cli, run, bag, aircraft_file, tmp_path):
    from rosbags.rosbag2 import Reader, StoragePlugin, Writer

    sqlite3 = Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3)
    with Reader(bag) as reader, sqlite3 as writer:
        connections = {
            c.id: writer.add_connection(c.topic, c.msgtype, msgdef=c.msgdef.data, rihs01=c.digest)
            for c in reader.connections
        }
        for connection, log_time, content in reader.messages():
            writer.write(connections[connection.id], log_time, content)
    assert list((tmp_path / "bag").glob("*.db3"))
    result = replay(cli, tmp_path / "bag", aircraft_file, tmp_path / "run")
    assert result["parameters"] == json.loads((run[0] / "parameters.json").read_text())


def check_good(result, short, note):
    assert np.array(result["state"]["wind_ned"]) == pytest.approx(short.truth.wind[-1], abs=1.0)
    values = {p["name"]: p for p in result["parameters"]["parameters"]}
    assert values["CZ_alpha"]["value"] == pytest.approx(-4.616, abs=0.5)
    assert values["Cm_de"]["value"] == pytest.approx(-0.8488, rel=0.2)
    assert any(note in text for text in result["notes"]), result["notes"]


@pytest.mark.long
@pytest.mark.parametrize("topic", TOPICS_OF_A_FLIGHT)
def test_ten_seconds_without_a_sensor(cli, short, aircraft_file, tmp_path, topic):
    streams = []
    for stream in short.streams:
        time = (stream.stamp - short.streams[0].stamp[0]) / SECOND
        streams.append(chosen(stream, (time < 15.0) | (time > 25.0)) if stream.topic == topic else stream)
    result = replay(cli, write(tmp_path / "bag", streams), aircraft_file, tmp_path / "run")
    check_good(result, short, "a gap of 10.")


def parameter_messages(folder, begin):
    """Times of flight [s] since a stamp and what was published then."""
    from rosbags.highlevel import AnyReader

    found = []
    with AnyReader([folder / "estimates.mcap"]) as reader:
        wanted = [c for c in reader.connections if c.topic == "/parameter_estimator/parameters"]
        for connection, _, content in reader.messages(wanted):
            message = reader.deserialize(content, connection.msgtype)
            found.append(((nanoseconds_of(message) - begin) / SECOND, message))
    return found


@pytest.fixture(scope="module")
def everything(aircraft):
    """The same flight with every sensor."""
    sensors = SensorOptions(attitude=True, magnetometer=True, five_hole_probe=True, height_above_ground=True)
    return simulate_samples(aircraft, seed=3, duration=45.0, sensors=sensors)


#: Topic and field of a sensor that shares its message, and what the note calls it.
ALONE = {
    "airspeed": ("air_data", "true_airspeed"),
    "angle_of_attack": ("air_data", "angle_of_attack"),
    "sideslip": ("air_data", "sideslip"),
    "attitude": ("imu/data", "orientation_covariance"),
    "magnetic_field": ("imu/mag", ""),
    "height": ("height_above_ground", ""),
    "five_hole": ("five_hole_probe", ""),
}

#: A number, a covariance and a topic of its own that say nothing.
OF_EACH_KIND = ("airspeed", "attitude", "magnetic_field")


def silenced(streams, sensor, begin, end):
    """Streams in which one sensor alone says nothing between two times of flight [s]."""
    topic, field = ALONE[sensor]
    start, found = streams[0].stamp[0], []
    for stream in streams:
        gone = (stream.stamp >= start + begin * SECOND) & (stream.stamp < start + end * SECOND)
        if stream.topic == topic and not field:
            stream = chosen(stream, ~gone)
        elif stream.topic == topic:
            values = np.array(stream.fields[field], dtype=float)
            values[gone] = -1.0 if field == "orientation_covariance" else np.nan
            stream = replaced(stream, fields={**stream.fields, field: values})
        found.append(stream)
    return found


@pytest.mark.long
@pytest.mark.parametrize("sensor", [s if s in OF_EACH_KIND else pytest.param(s, marks=pytest.mark.long) for s in ALONE])
def test_ten_seconds_without_one_sensor_alone(cli, everything, aircraft_file, tmp_path, sensor):
    recording = write(tmp_path / "bag", silenced(everything.streams, sensor, 15.0, 25.0))
    result = replay(cli, recording, aircraft_file, tmp_path / "run")
    check_good(result, everything, f"the {sensor} samples have a gap of 10.")
    gaps = [note for note in result["notes"] if " gap of " in note]
    assert len(gaps) == 1
    assert result["state"]["clock_restarts"] == 0
    assert not any("realigned" in note for note in result["notes"])


@pytest.mark.long
def test_ten_seconds_without_a_probe_that_gives_the_air_data(cli, everything, aircraft_file, tmp_path):
    """Its pressures alone tell the flow: there is no other airspeed in the recording."""
    (tmp_path / "probe.yaml").write_text("five_hole_probe: {alpha_sensitivity: 3.9, beta_sensitivity: 3.9}\n")
    streams = [s for s in silenced(everything.streams, "five_hole", 15.0, 25.0) if s.topic != "air_data"]
    arguments = ["--aircraft", aircraft_file, "--out", tmp_path / "run", "--calibration", tmp_path / "probe.yaml"]
    status, printed, err = cli("replay", write(tmp_path / "bag", streams), *arguments, "--json")
    assert (status, err) == (0, "")
    result = without_nan(printed)
    for kind in ("airspeed", "angle_of_attack", "sideslip"):
        check_good(result, everything, f"the {kind} samples have a gap of 10.")
    begin = everything.streams[0].stamp[0]
    inside = [m for time, m in parameter_messages(tmp_path / "run", begin) if 19.0 < time < 25.0]
    assert inside and not [p for m in inside for p in m.parameters if p.status == p.USE]


@pytest.mark.long
@pytest.mark.parametrize("topic", TOPICS_OF_A_FLIGHT)
def test_nan_among_the_samples(cli, short, aircraft_file, tmp_path, topic):
    streams = []
    for stream in short.streams:
        fields = dict(stream.fields)
        if stream.topic == topic:
            for name, value in fields.items():
                if np.asarray(value).dtype.kind == "f" and "covariance" not in name:
                    fields[name] = value.copy()
                    fields[name][7::20] = np.nan
        streams.append(replaced(stream, fields=fields))
    result = replay(cli, write(tmp_path / "bag", streams), aircraft_file, tmp_path / "run")
    notes = {"air_data": "air data have no airspeed", "control_surfaces": "control samples lack values"}
    check_good(result, short, "5 % of the " + notes.get(topic, ""))


@pytest.mark.long
def test_sensors_of_other_rates_in_the_same_topic_lack_nothing(cli, short, aircraft_file, tmp_path):
    """Vanes of 50 Hz and an airspeed of 25 Hz: every other message has no airspeed, and none of it was lost."""
    streams = []
    for stream in short.streams:
        fields = dict(stream.fields)
        if stream.topic == "air_data":
            fields["true_airspeed"] = fields["true_airspeed"].copy()
            fields["true_airspeed"][::2] = np.nan
        streams.append(replaced(stream, fields=fields))
    result = replay(cli, write(tmp_path / "bag", streams), aircraft_file, tmp_path / "run")
    assert not [note for note in result["notes"] if "of the air data" in note]


def test_a_flight_that_is_too_short_for_parameters_says_so(cli, short, run, aircraft_file, tmp_path):
    begin = short.streams[0].stamp[0]
    streams = [chosen(stream, stream.stamp < begin + 4 * SECOND) for stream in short.streams]
    result = replay(cli, write(tmp_path / "bag", streams), aircraft_file, tmp_path / "run")
    assert not [p for p in result["parameters"]["parameters"] if p["status"] == "USE"]
    (note,) = result["notes"]
    assert note.startswith("4 s are too short for parameters") and "at least 20 s" in note
    people = cli("replay", tmp_path / "bag", "--aircraft", aircraft_file, "--out", tmp_path / "again")
    assert people[0] == 0 and f"note: {note}" in people[1]
    assert without_nan(run[1])["notes"] == []


@pytest.mark.long
def test_a_flight_that_ends_without_gps_says_that_parameters_are_held(cli, aircraft, aircraft_file, tmp_path):
    flight = simulate_samples(aircraft, 3, 60.0)
    begin = flight.streams[0].stamp[0]
    streams = [
        chosen(stream, stream.stamp < begin + 45 * SECOND) if "gps" in stream.topic else stream
        for stream in flight.streams
    ]
    result = replay(cli, write(tmp_path / "bag", streams), aircraft_file, tmp_path / "run")
    assert [note for note in result["notes"] if "were held 6 times" in note and note.endswith("no GPS")]
    assert not [p for p in result["parameters"]["parameters"] if p["status"] == "USE"]


@pytest.mark.long
def test_a_minute_without_gps_holds_the_values_from_before_it(cli, aircraft, aircraft_file, tmp_path):
    flight = simulate_samples(aircraft, 3, 130.0)
    begin = flight.streams[0].stamp[0]
    lost = [(s.stamp >= begin + 50 * SECOND) & (s.stamp < begin + 110 * SECOND) for s in flight.streams]
    streams = [chosen(s, ~gone) if "gps" in s.topic else s for s, gone in zip(flight.streams, lost, strict=True)]
    result = replay(cli, write(tmp_path / "bag", streams), aircraft_file, tmp_path / "run")
    for kind in ("gps_position", "gps_velocity"):
        assert f"the {kind} samples have a gap of 60.2 s" in result["notes"]
    assert not any("realigned" in note for note in result["notes"])
    messages = parameter_messages(tmp_path / "run", begin)
    before = [m for time, m in messages if 40.0 < time < 50.0]
    inside = [m for time, m in messages if 56.0 < time < 115.0]  # said after 2 s, and absent for 5 s at the end
    after = [m for time, m in messages if time > 122.0]
    used = set.intersection(*({p.name for p in m.parameters if p.status == p.USE} for m in before))
    assert len(used) > 15 and len(inside) > 15 and after
    for p, old in zip(inside[0].parameters, before[-1].parameters, strict=True):
        if p.name in used:
            assert p.reason.startswith("no GPS since") and p.reason.endswith("the values are those from before it")
            assert p.value == pytest.approx(old.value, abs=2.0 * old.standard_deviation)
    for message in inside:
        assert {p.status for p in message.parameters} == {message.parameters[0].HOLD}
        assert [p.value for p in message.parameters] == [p.value for p in inside[0].parameters]
        assert np.array_equal(message.covariance, inside[0].covariance)
    ages = np.array([p.age for m in inside for p in m.parameters if p.name == "CZ_alpha"])
    assert np.all(np.diff(ages) > 2.0)
    for message in after:
        assert {p.status for p in message.parameters if p.name in used} == {message.parameters[0].USE}
    check_good(result, flight, "were held 6 times")


@pytest.mark.long
def test_without_control_surfaces_there_is_a_state_and_no_parameters(cli, short, aircraft_file, tmp_path):
    streams = [stream for stream in short.streams if stream.topic != "control_surfaces"]
    result = replay(cli, write(tmp_path / "bag", streams), aircraft_file, tmp_path / "run")
    assert result["notes"] == ["no /control_surfaces: state, biases and wind only, no parameters"]
    assert np.array(result["state"]["wind_ned"]) == pytest.approx(short.truth.wind[-1], abs=0.7)
    parameters = result["parameters"]["parameters"]
    assert {(p["value"], p["status"]) for p in parameters} == {(None, "HOLD")}
    people = cli("replay", tmp_path / "bag", "--aircraft", aircraft_file, "--out", tmp_path / "again")
    assert people[0] == 0 and f"note: {result['notes'][0]}\n" in people[1]


@pytest.mark.long
def test_bounds_that_no_aeroplane_is_in_and_bounds_that_leave_out_the_file(cli, bag, aircraft, aircraft_file, tmp_path):
    def replayed(low, high):
        path, bounds = tmp_path / "bounded.yaml", f"parameter_bounds: {{CZ_alpha: [{low}, {high}]}}"
        path.write_text(f"{Path(aircraft_file).read_text()}\n{bounds}\n")
        return cli("replay", bag, "--aircraft", path, "--out", tmp_path / "run", "--overwrite", "--json")

    why = f"aircraft file {tmp_path}/bounded.yaml: parameter_bounds CZ_alpha must overlap"
    for low in (0, 1):  # the lift of an aeroplane grows with its angle of attack
        check_refused(replayed(low, 5), why)
    (note,) = without_nan(replayed(-3, -2)[1])["notes"]
    given = f"{aircraft.coefficients['CZ_alpha']:g}"
    said = f"parameter_bounds CZ_alpha go from -3 to -2, and its value in the same aircraft file, {given}, is outside"
    assert note.startswith(said)
    assert without_nan(replayed(-6, -2)[1])["notes"] == []


@pytest.mark.long
def test_stamps_that_go_backwards(cli, short, aircraft_file, tmp_path):
    """The clock is set back by a minute in the middle of the flight; arrival goes on."""
    streams = []
    for stream in short.streams:
        late = stream.arrival > short.streams[0].arrival[0] + 15 * SECOND
        streams.append(replaced(stream, stamp=stream.stamp - np.where(late, 60 * SECOND, 0)))
    result = replay(cli, write(tmp_path / "bag", streams), aircraft_file, tmp_path / "run")
    assert result["state"]["clock_restarts"] == 1
    check_good(result, short, "the clock leapt once")


@pytest.mark.long
def test_stamps_that_leap_ahead_are_no_silence_of_the_sensors(cli, short, aircraft_file, tmp_path):
    streams = []
    for stream in short.streams:
        late = stream.arrival > short.streams[0].arrival[0] + 15 * SECOND
        streams.append(replaced(stream, stamp=stream.stamp + np.where(late, 870 * SECOND, 0)))
    result = replay(cli, write(tmp_path / "bag", streams), aircraft_file, tmp_path / "run")
    assert result["state"]["clock_restarts"] == 1
    check_good(result, short, "the clock leapt once")
    assert not [note for note in result["notes"] if " gap of " in note]


@pytest.mark.long
def test_single_samples_with_old_stamps(cli, short, aircraft_file, tmp_path):
    """Every fiftieth sample of each sensor is two seconds old: it is dropped, and said."""
    streams = []
    for stream in short.streams:
        old = np.arange(len(stream.stamp)) % 50 == 49
        streams.append(replaced(stream, stamp=stream.stamp - 2 * SECOND * old))
    result = replay(cli, write(tmp_path / "bag", streams), aircraft_file, tmp_path / "run")
    check_good(result, short, "samples were late")


@pytest.mark.long
def test_a_first_stamp_of_zero_is_not_in_the_run(cli, short, aircraft_file, tmp_path):
    """A driver whose first message is of 1970: what reads the run had counted its flight from there."""
    streams = []
    for stream in short.streams:
        first = np.arange(len(stream.stamp)) == 0
        streams.append(replaced(stream, stamp=np.where(first, 0, stream.stamp)))
    result = replay(cli, write(tmp_path / "bag", streams), aircraft_file, tmp_path / "run")
    check_good(result, short, "")
    stamps = read_samples(tmp_path / "run").stamp
    assert stamps.max() - stamps.min() < 100 * SECOND


def test_the_installed_command_is_this_one():
    command = Path(sys.executable).with_name("aircraft-sysid")
    if not command.exists():
        pytest.skip("the package is not installed in this environment")
    done = subprocess.run([command, "--help"], capture_output=True, text=True, check=True)
    assert all(name in done.stdout for name in ("simulate", "import", "replay", "play", "live", "demo"))


def test_what_a_library_says_is_not_part_of_the_answer(cli, monkeypatch):
    """The middleware of ROS writes its log to standard output, past Python."""

    def run(args):
        os.write(1, b"[RTPS_TRANSPORT_SHM Error] Failed init_port\n")
        return {"answer": 42}

    monkeypatch.setattr("aircraft_sysid_ros.commands.compare.run", run)
    status, out, err = cli("compare", "run", "--json")
    assert (status, json.loads(out)) == (0, {"answer": 42}) and "RTPS" in err


def test_a_step_that_lasts_is_said_again(monkeypatch, capsys):
    """In the log of a batch system a first start said nothing for minutes, while it compiled."""
    monkeypatch.setattr(progress, "TOLD_EVERY", 0.01)
    monkeypatch.setattr(progress, "_LOOK", 0.01)
    heard: list[str] = []

    end = time.monotonic() + LONGEST
    with progress.telling() as tell:
        tell("compile", 0.0)
        while len(heard) < 3 and time.monotonic() < end:
            heard.extend(capsys.readouterr().err.splitlines())
            time.sleep(0.01)
    assert len(heard) >= 3 and set(heard) == {"compile: 0 %"}
