"""Two airframes, and two fleets, side by side: what was put in comes out, and what is the same is not named."""

from __future__ import annotations

import json

import numpy as np
import pytest

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet.side_by_side import airframes_side_by_side, fleets_side_by_side
from aircraft_sysid_ros.fleet.tables import COLUMNS, read_table, write_tables

NAMES = [f"P{k}" for k in range(20)]
SPREAD, NOISE = 0.02, 0.01


def write(folder, seed, changed=(), flights=12, own=0.0):
    """A fleet of N1 and N2 with twenty parameters near 1; ``own``: what another program makes of each flight.

    The flights are the same with one seed; N2 has P0 5 % larger; ``changed`` by 1 % of the value in all flights.
    """
    rng, other = np.random.default_rng(seed), np.random.default_rng(99)
    folder.mkdir()
    rows = []
    for airframe in ("N1", "N2"):
        for flight in range(flights):
            for name in NAMES:
                value = 1.0 + 0.05 * (airframe == "N2" and name == "P0") + SPREAD * rng.normal() + NOISE * rng.normal()
                value += 0.01 * (name in changed) + own * other.normal()
                head = {"flight": f"{airframe}/{flight}", "airframe": airframe, "start": flight * 10**15 + 1}
                rows.append({**head, "parameter": name, "value": value, "std": NOISE, "status": "USE"})
    rows.append({**rows[-1], "parameter": "P1", "value": 50.0, "status": "HOLD"})
    write_tables(folder, {"flights": [], "sensors": [], "parameters": rows})
    assert "flights" in COLUMNS
    return folder


def test_two_airframes(tmp_path):
    found = airframes_side_by_side(write(tmp_path / "a", 1), "N1", "N2")["parameters"]
    one, *others = sorted(found, key=lambda row: row["p_value"])
    assert one["parameter"] == "P0" and one["differs"] and len(others) == 19
    assert all(abs(row["difference"]) < 4.0 * row["std_difference"] for row in others)
    assert abs(one["difference"] - 0.05) < 2.5 * one["std_difference"]
    expected = np.sqrt(2.0 * (SPREAD**2 + NOISE**2) / 12)
    assert one["std_difference"] == pytest.approx(expected, rel=0.4) and one["flights"] == [12, 12]


def test_what_changes_between_flights_is_said_beside_the_means(tmp_path):
    """The mean of an elevator that fades hides by how much it has faded."""
    fleet = write(tmp_path / "a", 1)
    assert airframes_side_by_side(fleet, "N1", "N2")["notes"] == []
    change = {"airframe": "N1", "parameter": "P2", "kind": "drift", "when": 10**15 + 1, "size": 0.01, "std": 0.001,
              "p_value": 1e-6, "flight": "N1/0", "flights": 12, "per_hour": None}  # fmt: skip
    write_tables(fleet, {"changes": [change, {**change, "airframe": "N3"}]})
    (note,) = airframes_side_by_side(fleet, "N1", "N2")["notes"]
    assert note.startswith("N1: P2 drifts between its flights")
    (one, _) = read_table(fleet / "changes.parquet")
    assert one["when"] == 10**15 + 1, "as a time it had needed pandas, which the extra for fleets has not"


def test_of_the_same_flights_a_difference_is_seen_that_is_smaller_than_their_spread(tmp_path):
    a = write(tmp_path / "a", 1)
    found = fleets_side_by_side(a, write(tmp_path / "b", 1, changed=["P3"], own=0.002))["parameters"]
    assert {row["parameter"] for row in found if row["differs"]} == {"P3"} and all(row["paired"] for row in found)
    assert all(abs(row["difference"] - 0.01) < 0.003 for row in found if row["differs"])
    same = fleets_side_by_side(a, a)["parameters"]
    assert not any(row["differs"] for row in same) and all(row["difference"] == 0.0 for row in same)


def test_fleets_of_other_flights_are_compared_by_their_means(tmp_path):
    a, b = write(tmp_path / "a", 1), write(tmp_path / "b", 2, flights=2)
    assert not any(row["paired"] for row in fleets_side_by_side(a, b)["parameters"])


def test_the_command(tmp_path, capsys):
    a, b = str(write(tmp_path / "a", 1)), str(write(tmp_path / "b", 1, changed=["P3"], own=0.002))
    assert main(["compare", a, "--airframes", "N1", "N2"]) == 0
    assert "of 20 parameters differ" in capsys.readouterr().out
    for words in ([a, "--with", b], [a, b]):
        assert main(["compare", *words, "--json"]) == 0
        assert sum(row["differs"] for row in json.loads(capsys.readouterr().out)["parameters"]) == 2
    for words, said in (
        ([a], "is a fleet: compare it with"),
        ([a, "--with", "nowhere"], "not the folder of a fleet"),
        ([a, "--airframes", "N1", "N3"], "no airframe of"),
        (["nowhere", "--airframes", "N1", "N2"], "and nowhere is not one"),
    ):
        assert main(["compare", *words]) == 2
        assert said in capsys.readouterr().err


def test_a_damaged_table_is_one_sentence(tmp_path):
    (write(tmp_path / "a", 1) / "parameters.parquet").write_bytes(b"PAR1 no")
    with pytest.raises(InputError, match="cannot read"):
        airframes_side_by_side(tmp_path / "a", "N1", "N2")
