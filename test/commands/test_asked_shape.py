"""``explain`` without an aircraft file asks for mass and shape on a terminal, one number after the other."""

import io
from types import SimpleNamespace

import pytest

from aircraft_sysid_ros.commands import explain
from aircraft_sysid_ros.commands.main import build_parser
from aircraft_sysid_ros.errors import InputError


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def asked(monkeypatch):
    """The aeroplane of some words and of what is typed, and what stood on the terminal."""

    def ask(typed, *words):
        stderr = Terminal()
        monkeypatch.setattr(explain.sys, "stdin", Terminal(typed))
        monkeypatch.setattr(explain.sys, "stderr", stderr)
        args = build_parser("explain").parse_args(["explain", "flights/monday.bin", "--out", "page", *words])
        try:
            return explain._aircraft(args), stderr.getvalue()
        finally:
            monkeypatch.undo()

    return ask


def test_what_is_not_given_is_asked_for(asked):
    aircraft, shown = asked("0.31\n0.25\n0.072,0.086,0.154,0.014\n", "--mass", "1.96", "--span", "1.27")
    assert (aircraft.name, aircraft.mass, aircraft.wing_area, aircraft.span) == ("monday", 1.96, 0.31, 1.27)
    assert aircraft.chord == 0.25 and aircraft.inertia[0, 2] == pytest.approx(-0.014)
    assert [line.rpartition("[")[2] for line in shown.split("]: ")[:-1]] == ["m²", "m", "kg m²"]
    assert "mass" not in shown.partition("moments")[0]


def test_an_answer_that_is_none_is_asked_for_again_at_once(asked):
    typed = "two\n1.96\n0.31\n1.27\n0.25\n0.072,0.086\n0.072 0.086 0.154\n"
    aircraft, shown = asked(typed)
    assert aircraft.mass == 1.96 and aircraft.inertia[1, 1] == 0.086
    asked_for = shown.split("]: ")
    assert "must be a number in kg, not 'two'" in asked_for[1] and "must be" not in asked_for[2]
    assert shown.count("mass [kg]: ") == 2 and shown.count("wing area [m²]: ") == 1
    assert "must be Ixx,Iyy,Izz" in asked_for[6]


def test_where_nobody_answers_it_ends(asked):
    with pytest.raises(InputError, match="--wing-area"):
        asked("1.96\n")


def test_where_the_aircraft_file_is_of_which_notes_speak_is_said(monkeypatch, tmp_path):
    """A note told to write the places of sensors into the aircraft file of somebody who had given none."""
    found = SimpleNamespace(json={"run": "page/run", "notes": ["the aircraft file does not give imu_position"]})
    monkeypatch.setattr(explain.api, "explain", lambda *_, **__: found)
    log = tmp_path / "monday.bin"
    log.touch()
    shape = ["--mass", "1", "--wing-area", "1", "--span", "1", "--chord", "1", "--inertia", "1,1,1"]
    for words, count in ((shape, 2), (["--aircraft", "a.yaml"], 1)):
        args = build_parser("explain").parse_args(["explain", str(log), "--out", "page", *words])
        assert len(explain.run(args)["notes"]) == count
    args = build_parser("explain").parse_args(["explain", str(log), "--out", "page", *shape])
    assert "page/run/aircraft.yaml holds the numbers you gave" in explain.run(args)["notes"][-1]
