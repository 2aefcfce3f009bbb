"""Two aeroplanes in two namespaces on one machine, with real processes: neither hears the other."""

import contextlib
import json
import signal
import subprocess
import sys
import threading

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from processes import live, ours, play
from waiting import finish

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.nodes.overview import AGGREGATED
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight

pytestmark = pytest.mark.long
NAMES = {"uav1": 11, "uav2": 12}
HORIZON = "4.0"  # [s] the flights are played fast


@pytest.fixture
def flights(aircraft, aircraft_file, tmp_path):
    """A flight of each, and what replay makes of it."""
    for name, seed in NAMES.items():
        write_flight(simulate_samples(aircraft, seed=seed, duration=30.0), tmp_path / f"flight_{name}")
        words = ["replay", tmp_path / f"flight_{name}", "--out", tmp_path / f"alone_{name}", "--horizon", HORIZON]
        assert main([*map(str, words), "--aircraft", str(aircraft_file)]) == 0
    return tmp_path


def test_each_has_its_run_its_diagnostics_and_its_tree(flights, aircraft_file, bench):
    told, trees = bench.listen(DiagnosticArray, "/diagnostics"), bench.listen(DiagnosticArray, AGGREGATED)
    with contextlib.ExitStack() as stack:
        running, overviews = {}, []
        for name in NAMES:
            (flights / name).mkdir()
            options = ("--namespace", name, "--reliable", "--horizon", HORIZON)
            running[name] = stack.enter_context(live(flights / name / "run", aircraft_file, *options))
            overviews.append(subprocess.Popen([*ours("nodes.overview"), "--ros-args", "-r", f"__ns:=/{name}"]))
        stack.callback(lambda: [each.kill() for each in overviews])
        threads = [
            threading.Thread(target=play, args=(flights / f"flight_{name}", 4, "--topic-prefix", name))
            for name in NAMES
        ]
        for thread in threads:
            thread.start()
        bench.spin_until(lambda: not any(thread.is_alive() for thread in threads))
        bench.spin_until(lambda: {"/uav1/parameters", "/uav2/parameters"} <= names(trees[-20:]))
        for process in running.values():
            process.send_signal(signal.SIGINT)
        answers = {name: json.loads(finish(process)[0]) for name, process in running.items()}
    for name, answer in answers.items():
        assert not answer["late"] and not answer["lost"], answer["notes"]
        parts = [json.loads((flights / f / "parameters.json").read_text()) for f in (f"{name}/run", f"alone_{name}")]
        assert parts[0] == parts[1]  # to the last bit: nothing of the other aeroplane is in it
    both = [f"{name}/{node}" for name in NAMES for node in ("state_estimator", "parameter_estimator")]
    assert names(told) == set(both)
    for message in trees:
        assert len({status.name.split("/")[1] for status in message.status}) == 1


def names(messages):
    return {status.name for message in messages for status in message.status}


def test_two_in_one_namespace_are_said(aircraft_file, bench, tmp_path):
    told = bench.listen(DiagnosticArray, "/diagnostics")
    command = [*ours("nodes.state_estimator"), "--ros-args", "-p", f"aircraft_file:={aircraft_file}"]
    with contextlib.ExitStack() as stack:
        for _ in range(2):
            process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
            stack.callback(process.wait)
            stack.callback(process.kill)
        other = [*ours("nodes.parameter_estimator"), "--ros-args", "-p", f"aircraft_file:={aircraft_file}"]
        process = subprocess.Popen(other, stderr=subprocess.DEVNULL)
        stack.callback(process.wait)
        stack.callback(process.kill)
        text = "another program publishes /state_estimator/state, too"
        bench.spin_until(lambda: any(text in status.message for m in told for status in m.status))


@pytest.mark.parametrize("namespace", ["a b", "1st", "uav-1"])
def test_a_bad_namespace_is_one_sentence(aircraft_file, namespace, tmp_path):
    command = ours("commands.main", "live", "--aircraft", aircraft_file, "--namespace", namespace)
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "is not a namespace" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr and not list(tmp_path.iterdir())
    node = [sys.executable, "-m", "aircraft_sysid_ros.nodes.overview", "--ros-args", "-r", f"__ns:=/{namespace}"]
    done = subprocess.run(node, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr and "Traceback" not in done.stderr
