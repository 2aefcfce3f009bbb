"""The whole way with real flights and processes: workers that are killed, a stop in the middle, the same tables."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys

import pandas as pd
import pytest
from fake_flights import below, until, words_of

from aircraft_sysid_ros.commands.main import main

PROGRAM = [sys.executable, "-m", "aircraft_sysid_ros.commands.main", "fleet"]
TABLES = ("flights", "parameters", "verdicts", "errors", "findings", "sensors", "changes", "airframes")


@pytest.fixture(scope="module")
def flights(tmp_path_factory, aircraft_file):
    """Two airframes with a flight each, one of them too short for `compare`, and a file that is damaged."""
    folder = tmp_path_factory.mktemp("fleet")
    for seed, (airframe, duration) in enumerate((("N1", "28"), ("N2", "20"))):
        (folder / "flights" / airframe).mkdir(parents=True)
        bag = str(folder / "flights" / airframe / "1.mcap")
        assert main(["simulate", "--out", bag, "--duration", duration, "--seed", str(seed)]) == 0
    (folder / "flights" / "N2" / "2.mcap").write_text("no recording")
    shutil.copy(aircraft_file, folder / "aircraft.yaml")
    return folder


def command(flights, out, *more):
    words = [str(flights / "flights"), "--aircraft", str(flights / "aircraft.yaml"), "--out", str(flights / out)]
    return [*PROGRAM, *words, "--replicas", "2", "--json", *more]


def answers(flights, out):
    return list((flights / out / "results").glob("*/*.json"))


def tables(flights, out):
    return {name: (flights / out / f"{name}.parquet").read_bytes() for name in TABLES}


@pytest.fixture(scope="module")
def undisturbed(flights):
    """The answer of a fleet that nothing happened to."""
    done = subprocess.run(command(flights, "out", "--runs"), stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout)


@pytest.mark.long
def test_a_fleet(flights, undisturbed, capsys):
    assert (undisturbed["flights"], undisturbed["ok"], undisturbed["new"]) == (3, 2, 3)
    (failure,) = undisturbed["failures"]
    assert failure["flight"] == "N2/2" and "is not an MCAP file" in failure["reason"]
    reasons = pd.read_parquet(flights / "out" / "flights.parquet").set_index("flight").reason
    assert reasons["N1/1"] == "" and reasons["N2/1"].startswith("not compared: ")
    listed = pd.read_parquet(flights / "out" / "parameters.parquet")
    assert listed.query("status == 'USE'")["std"].gt(0.0).all() and set(listed.airframe) == {"N1", "N2"}
    run = flights / "out" / "runs" / "N1" / "1"
    alone = {p["name"]: p for p in json.loads((run / "parameters.json").read_text())["parameters"]}
    for row in listed.query("flight == 'N1/1'").to_dict("records"):
        assert row["value"] == alone[row["parameter"]]["value"] or pd.isna(row["value"])
    assert main(["compare", str(run)]) == 0  # what was kept is a run
    capsys.readouterr()


@pytest.mark.long
def test_without_diagnosis_all_else_is_the_same(flights, undisturbed):
    subprocess.run(command(flights, "quick", "--no-diagnosis"), stdout=subprocess.DEVNULL, check=True)
    quick, whole = tables(flights, "quick"), tables(flights, "out")
    assert {name for name in TABLES if quick[name] != whole[name]} == {"flights", "verdicts"}
    assert pd.read_parquet(flights / "quick" / "verdicts.parquet").empty


@pytest.mark.long
def test_killed_and_stopped_it_has_the_same_tables(flights, undisturbed):
    """A worker is killed in its first flight; Ctrl-C in another one, as a terminal sends it to all; then it goes on."""
    begun = command(flights, "again", "--workers", "1")
    process = subprocess.Popen(begun, start_new_session=True, stderr=subprocess.PIPE, text=True)
    until(lambda: _flights_in_the_air(process.pid))
    os.kill(_workers(process.pid)[0], signal.SIGKILL)
    until(lambda: answers(flights, "again") and _flights_in_the_air(process.pid))
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate()[1]
    assert process.returncode == 130 and "the same command continues" in said and "Traceback" not in said
    kept = len(answers(flights, "again"))
    assert 0 < kept < 3
    done = subprocess.run(command(flights, "again"), stdout=subprocess.PIPE, text=True, check=True)
    assert json.loads(done.stdout)["new"] == 3 - kept
    assert tables(flights, "again") == tables(flights, "out")


def _workers(pid):
    return [child for child in below(pid) if "spawn_main" in words_of(child)]


def _flights_in_the_air(pid):
    """Processes of flights: forked from a forkserver, which is below a worker."""
    servers = [child for worker in _workers(pid) for child in below(worker) if "forkserver" in words_of(child)]
    return [flight for server in servers for flight in below(server)]
