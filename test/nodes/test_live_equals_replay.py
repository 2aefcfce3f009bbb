"""Replay and live nodes give the same numbers to the last bit, at any speed, in one process or in two.

Live, a sample may come late by the horizon, in seconds of flight: at 16 times real time the default is 31 ms,
which a busy machine exceeds. Fast playbacks here have a longer one, and replay the same. Where samples came late
all the same, `live` says so; such a playback cannot give the same numbers and is played again.
"""

import contextlib
import json
import signal
import subprocess
import time
from dataclasses import replace

import pytest
from processes import live, ours, play
from waiting import LONGEST, finish

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight

DEFAULT, LONG = 0.5, 4.0  # [s] horizons


def read_run(folder):
    """What must be the same: all of parameters.json, and of state.json what is not timing."""
    parameters = json.loads((folder / "parameters.json").read_text())
    state = json.loads((folder / "state.json").read_text())
    return parameters, {k: v for k, v in state.items() if k not in ("duration", "realtime_factor")}


def stamp(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


@pytest.fixture(scope="module")
def replayed(recording, aircraft_file, tmp_path_factory):
    """Runs of replay by horizon."""
    folders = {}
    for horizon in (DEFAULT, LONG):
        folders[horizon] = folder = tmp_path_factory.mktemp("replay") / "run"
        arguments = ["replay", recording, "--aircraft", aircraft_file, "--out", folder, "--horizon", horizon]
        assert main([*map(str, arguments)]) == 0
    return folders


class LateError(Exception):
    """The machine was too busy for this playback."""


def played_in_time(playback, tries=3):
    """``playback(attempt)`` until no sample came late; each plays at half the rate of the one before."""
    for attempt in range(tries):
        with contextlib.suppress(LateError):
            return playback(attempt)
    pytest.fail(f"samples came late in each of {tries} playbacks")


def check_same(process, folder, replayed, counts):
    output, errors = finish(process)
    assert process.returncode == 0, errors
    result = json.loads(output)
    if result["late"]:
        raise LateError
    received = {"/" + topic: count for topic, count in result["received"].items() if count}
    assert received == counts, "samples were lost on the way: the numbers cannot be compared"
    assert result["states"][0] == result["states"][1]
    (parameters, state), (expected_parameters, expected_state) = read_run(folder), read_run(replayed)
    assert sum(p["status"] == "USE" for p in expected_parameters["parameters"]) > 5  # no comparison of nulls
    assert parameters == expected_parameters
    assert state == expected_state
    assert result["parameters"] == expected_parameters
    return result


def test_live_is_replay_to_the_last_bit(domain, recording, aircraft_file, replayed, tmp_path):
    """At another speed than the playbacks below, which a signal ends; this one ends by itself."""

    def playback(attempt):
        run = tmp_path / str(attempt) / "run"
        run.parent.mkdir()
        with live(run, aircraft_file, "--reliable", "--until-idle", 1.5) as process:
            sent = play(recording, 4 / 2**attempt)
            check_same(process, run, replayed[DEFAULT], sent["messages"])

    played_in_time(playback)


@pytest.mark.long
def test_as_fast_as_it_goes_no_topic_runs_ahead_of_the_imu(domain, aircraft, aircraft_file, tmp_path, capsys):
    """Longer than the queues on the way: GPS and air data had come 50 s before the IMU, and were lost."""
    recording, expected, run = (tmp_path / name for name in ("flight", "replayed", "run"))
    write_flight(simulate_samples(aircraft, seed=4, duration=130.0), recording)
    assert main([*map(str, ["replay", recording, "--aircraft", aircraft_file, "--out", expected, "--json"])]) == 0
    with live(run, aircraft_file, "--reliable", "--until-idle", 5.0) as process:
        sent = play(recording, 0)
        check_same(process, run, expected, sent["messages"])


def prior_of(aircraft, folder, **wrong):
    """The file that a fleet leaves, of one airframe: the coefficients that fly, but for those that are given."""
    known = {**aircraft.coefficients, **wrong}
    prior = {"flights": "9 flights of one", "parameters": {n: [v, 0.05 * abs(v) + 1e-6] for n, v in known.items()}}
    (folder / "prior.json").write_text(json.dumps({"airframes": {"one": prior}, "all": None}))
    return folder


@pytest.mark.long
def test_a_flight_without_gps_starts_live_where_replay_starts(domain, aircraft, aircraft_file, tmp_path, capsys):
    """Neither knows beforehand that no GPS will come; both begin with the first sample that they kept.

    And both have the prior of a fleet, which is wrong in one axis.
    """
    flight = simulate_samples(aircraft, seed=3, duration=30.0)
    recording, expected = tmp_path / "flight", tmp_path / "replayed"
    write_flight(replace(flight, streams=[s for s in flight.streams if not s.topic.startswith("gps")]), recording)
    prior = ("--prior", prior_of(aircraft, tmp_path, Cl_p=-0.1))
    arguments = ["--aircraft", aircraft_file, "--out", expected, "--horizon", LONG, *prior, "--json"]
    assert main([*map(str, ["replay", recording, *arguments])]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert notes[0].startswith("no GPS: wind is not estimated")
    assert notes[-2].startswith("prior of 9 flights of one: counts in ") and notes[-1].startswith("the prior of Cl was")

    def playback(attempt):
        run = tmp_path / str(attempt) / "run"
        run.parent.mkdir()
        with live(run, aircraft_file, "--reliable", "--until-idle", 1.5, "--horizon", LONG, *prior) as process:
            sent = play(recording, 16 / 2**attempt)
            assert check_same(process, run, expected, sent["messages"])["notes"] == notes

    played_in_time(playback)


@pytest.fixture(scope="module")
def slow_recording(aircraft, tmp_path_factory):
    """60 s with an IMU of 10 Hz, which the aircraft file does not know."""
    path = tmp_path_factory.mktemp("slow") / "flight"
    sensors = {n: replace(s, rate=10.0) if n in ("accelerometer", "gyro") else s for n, s in aircraft.sensors.items()}
    write_flight(simulate_samples(replace(aircraft, sensors=sensors), seed=3, duration=60.0), path)
    return path


@pytest.mark.long  # in blocks of any size: test_slow_states.py; what is said of the rate: test_slow_flights.py
def test_an_imu_of_ten_hertz_is_learnt_from_live_as_in_replay_and_the_run_says_its_rate(
    domain, slow_recording, aircraft_file, tmp_path, capsys
):
    arguments = ["--aircraft", aircraft_file, "--out", tmp_path / "replayed", "--horizon", LONG, "--json"]
    assert main([*map(str, ["replay", slow_recording, *arguments])]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert [note[:26] for note in notes] == ["the IMU comes at 10 Hz: wh"]

    def playback(attempt):
        run = tmp_path / str(attempt) / "run"
        run.parent.mkdir()
        with live(run, aircraft_file, "--reliable", "--until-idle", 1.5, "--horizon", LONG) as process:
            sent = play(slow_recording, 16 / 2**attempt)
            assert check_same(process, run, tmp_path / "replayed", sent["messages"])["notes"] == notes
        return run

    run = played_in_time(playback)
    assert main(["compare", str(run), "--json"]) == 0
    compared = json.loads(capsys.readouterr().out)
    assert all(axis["nrmse_held_out"] < 0.2 for axis in compared["axes"].values())
    assert compared["notes"][0].startswith("the IMU comes at 10 Hz: the floor is the noise of the sensors alone")


@pytest.mark.parametrize(
    "number",
    [pytest.param(signal.SIGINT, id="ctrl-c"), pytest.param(signal.SIGTERM, id="termination", marks=pytest.mark.long)],
)
def test_stopped_by_a_signal_the_run_is_written_in_full(domain, recording, aircraft_file, replayed, tmp_path, number):
    def playback(attempt):
        run = tmp_path / str(attempt) / "run"
        run.parent.mkdir()
        with live(run, aircraft_file, "--reliable", "--horizon", LONG) as process:
            sent = play(recording, 16 / 2**attempt)
            process.send_signal(number)
            check_same(process, run, replayed[LONG], sent["messages"])

    played_in_time(playback)


@pytest.mark.long  # the launched executables: test_ros_developer.py; all files of a run: above
def test_two_processes_give_the_same(domain, recording, aircraft_file, replayed, tmp_path):
    """The executables, steered as a lifecycle manager does; the last message says what replay's files say."""
    rclpy = pytest.importorskip("rclpy")
    from aircraft_sysid_msgs.msg import AircraftState, Parameter, Parameters
    from diagnostic_msgs.msg import DiagnosticArray
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState
    from rcl_interfaces.srv import SetParameters
    from rclpy.qos import QoSProfile

    context = rclpy.Context()
    rclpy.init(context=context, domain_id=int(domain))
    node = rclpy.create_node("manager", context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def spin_until(done, timeout=LONGEST):
        deadline = time.monotonic() + timeout
        while not done() and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
        assert done(), f"nothing came in time: {len(states)} states here, diagnostics {values}"

    def change(name, transition):
        client = node.create_client(ChangeState, f"/{name}/change_state")
        spin_until(client.service_is_ready)
        future = client.call_async(ChangeState.Request(transition=Transition(id=transition)))
        spin_until(future.done)
        assert future.result().success

    states, sets, values = [], [], {}
    node.create_subscription(AircraftState, "/state_estimator/state", states.append, QoSProfile(depth=5000))
    node.create_subscription(Parameters, "/parameter_estimator/parameters", sets.append, 100)

    def on_diagnostics(message):
        for status in message.status:
            values[status.name] = {item.key: item.value for item in status.values}

    node.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, 100)
    options = {"aircraft_file": aircraft_file, "autostart": "false"}
    options |= {"input_reliability": "reliable", "input_depth": 5000}
    arguments = ["--ros-args", *(a for k, v in options.items() for a in ("-p", f"{k}:={v}"))]
    names = ("state_estimator", "parameter_estimator")
    processes = [subprocess.Popen(ours(f"nodes.{name}", *arguments)) for name in names]
    try:
        for name in names:
            if name == "state_estimator":
                client = node.create_client(SetParameters, f"/{name}/set_parameters")
                spin_until(client.service_is_ready)
                horizon = rclpy.parameter.Parameter("horizon", value=LONG).to_parameter_msg()
                future = client.call_async(SetParameters.Request(parameters=[horizon]))
                spin_until(future.done)
                assert future.result().results[0].successful
            change(name, Transition.TRANSITION_CONFIGURE)
            change(name, Transition.TRANSITION_ACTIVATE)
        # A busy machine may take seconds to bring the nodes and this test together.
        spin_until(lambda: values.get("state_estimator", {}).get("state_listeners") == "2")
        sent = play(recording, 8)
        count = sent["messages"]
        spin_until(lambda: values.get("state_estimator", {}).get("imu.received") == str(count["/imu/data"]))
        change("state_estimator", Transition.TRANSITION_DEACTIVATE)
        assert values["state_estimator"]["gps_position.received"] == str(count["/gps/fix"])
        assert values["state_estimator"]["gps_velocity.received"] == str(count["/gps/vel"])
        samples = read_recording(recording).samples
        last_imu = int(samples.stamp[samples.kind == Kind.IMU].max())
        spin_until(lambda: bool(states) and stamp(states[-1]) == last_imu)
        # Diagnostics come once a second: the last ones have everything.
        spin_until(lambda: values["parameter_estimator"]["states_received"] == str(len(states)))
        assert values["parameter_estimator"]["controls_received"] == str(count["/control_surfaces"])
        change("parameter_estimator", Transition.TRANSITION_DEACTIVATE)
        spin_until(lambda: bool(sets), 10.0)
        expected_parameters, expected = read_run(replayed[LONG])
        newest = {p.name: p for p in sets[-1].parameters}
        assert all(process.poll() is None for process in processes)
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
        codes = [process.wait(timeout=LONGEST) for process in processes]
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    assert codes == [0, 0]
    statuses = {Parameter.USE: "USE", Parameter.HOLD: "HOLD", Parameter.REJECT: "REJECT"}
    for p in expected_parameters["parameters"]:
        got = newest[p["name"]]
        assert (got.value, got.standard_deviation) == (p["value"], p["std"])
        assert (statuses[got.status], got.reason) == (p["status"], p["reason"])
    last = states[-1]
    assert list(last.accelerometer_bias) == expected["accelerometer_bias"]
    assert list(last.gyro_bias) == expected["gyro_bias"]
    assert list(last.wind_ned) == expected["wind_ned"]
    assert list(last.standard_deviations[9:12]) == expected["accelerometer_bias_std"]
    assert list(last.standard_deviations[12:15]) == expected["gyro_bias_std"]
    assert list(last.standard_deviations[15:18]) == expected["wind_ned_std"]
