"""Which flights are meant, and what they are called."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet import flight_task
from aircraft_sysid_ros.fleet.fleet import Asked, fly_fleet
from aircraft_sysid_ros.fleet.flights import Files, check_run_folders, flights_of
from aircraft_sysid_ros.reconstruction.absences import NoAirspeedError


@pytest.fixture
def place(tmp_path):
    """Two airframes in folders, with what lies beside recordings; and aircraft files."""
    for name in ("fleet/N1/1.mcap", "fleet/N1/may/2.MCAP", "fleet/N2/3.ulg", "fleet/4.bin", "fleet/notes.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    bag = tmp_path / "fleet/N2/bag"
    bag.mkdir()
    for name in ("metadata.yaml", "bag_0.mcap"):
        (bag / name).touch()
    run = tmp_path / "fleet/N2/run"
    run.mkdir()
    for name in ("parameters.json", "estimates.mcap"):
        (run / name).touch()
    (tmp_path / "fleet/N1/1.truth.json").touch()
    for name in ("N1", "N2", "fleet", "one"):
        (tmp_path / f"{name}.yaml").touch()
    return tmp_path


def found(place, *sources, aircraft="one.yaml", **more):
    files = Files(aircraft and str(place / aircraft), **more)
    listed = flights_of([str(place / s) for s in sources], files, place / "out")
    return {flight.name: flight.airframe for flight in listed}


def test_a_folder(place):
    names = {"N1/1": "N1", "N1/may/2": "N1", "N2/3": "N2", "N2/bag": "N2", "4": "fleet"}
    assert found(place, "fleet") == names


def test_the_folder_of_results_is_no_source(place):
    out = place / "fleet" / "out"
    (out / "runs").mkdir(parents=True)
    (out / "runs" / "x.mcap").touch()
    assert len(flights_of([str(place / "fleet")], Files(str(place / "one.yaml")), out)) == 5


def test_the_source_itself_is_no_place_for_results(place):
    with pytest.raises(InputError, match="is the SOURCE itself, and what"):
        flights_of([str(place / "fleet")], Files(str(place / "one.yaml")), place / "N9" / ".." / "fleet")


def test_a_link_to_a_folder_above_is_not_followed(place):
    """One was 40 flights more, and two of them took for ever; a link to another folder is followed."""
    (place / "fleet/N1/up").symlink_to("..")
    (place / "fleet/N1/may/here").symlink_to(".")
    (place / "fleet/N3").symlink_to("N1/may")
    names = {"N1/1": "N1", "N1/may/2": "N1", "N3/2": "N3", "N2/3": "N2", "N2/bag": "N2", "4": "fleet"}
    assert found(place, "fleet") == names


def test_patterns_and_files(place):
    assert found(place, "fleet/*/*.mcap") == {"N1/1": "N1"}
    assert found(place, "fleet/N1/1.mcap", "fleet/N2/bag") == {"1": "N1", "bag": "N2"}


def test_what_is_named_twice_is_one_flight(place):
    (place / "list.yaml").write_text("- {recording: fleet/N1/1.mcap}\n" * 2)
    assert found(place, "list.yaml") == {"N1/1": "N1"}
    assert len(found(place, "fleet", "fleet")) == 5


@pytest.mark.parametrize("source", ["fleet", "fleet/N1/1.mcap", "fleet/*/*.mcap"])
def test_a_folder_that_may_not_be_read_is_one_sentence(place, source, monkeypatch):
    """Also for root, who may read all."""
    true = Path.stat

    def refused(path, **more):
        if path.parent.name == "N1":
            raise PermissionError(13, "Permission denied", str(path))
        return true(path, **more)

    monkeypatch.setattr(Path, "stat", refused)
    with pytest.raises(InputError, match=r"^cannot look for flights in .*N1/.*: Permission denied$"):
        found(place, source)


def test_tables_are_flights_with_a_map(place):
    assert "notes" in found(place, "fleet", map=str(place / "one.yaml"))


def test_an_aircraft_file_by_airframe(place):
    listed = flights_of([str(place / "fleet")], Files(str(place / "{airframe}.yaml")), place / "out")
    assert {f.airframe: f.aircraft.name for f in listed} == {"N1": "N1.yaml", "N2": "N2.yaml", "fleet": "fleet.yaml"}
    (place / "N2.yaml").unlink()
    with pytest.raises(InputError, match=r"N2\.yaml of the airframe N2 is not there"):
        flights_of([str(place / "fleet")], Files(str(place / "{airframe}.yaml")), place / "out")


@pytest.mark.parametrize("text", ["true", "'yes'", "1", "True"])
def test_calm_air_is_said_of_one_flight_or_of_all(place, text):
    def flights(said, **more):
        (place / "list.yaml").write_text(
            f"- {{recording: fleet/N1/1.mcap, calm_air: {said}}}\n- {{recording: fleet/4.bin}}"
        )
        listed = flights_of([str(place / "list.yaml")], Files(str(place / "one.yaml"), **more), place / "out")
        return [flight.calm_air for flight in sorted(listed, key=lambda flight: flight.recording.suffix)]

    assert flights(text) == [False, True]
    assert flights("false", calm_air=True) == [True, False]
    with pytest.raises(InputError, match="calm_air 'perhaps': write true or false"):
        flights("perhaps")


def test_maps_and_servos_by_airframe_and_in_a_list(place):
    for name in ("map-N1.yaml", "map-N2.yaml", "servos.yaml"):
        (place / name).touch()
    files = Files(str(place / "one.yaml"), str(place / "map-{airframe}.yaml"))
    text = "- {recording: fleet/N1/notes.csv}\n- {recording: fleet/N2/3.ulg, map: map-N1.yaml, servos: servos.yaml}\n"
    (place / "list.yaml").write_text(text)
    first, second = flights_of([str(place / "list.yaml")], files, place / "out")
    assert (first.map, first.servos) == (place / "map-N1.yaml", None)
    assert (second.map, second.servos) == (place / "map-N1.yaml", place / "servos.yaml")
    (place / "map-N1.yaml").unlink()
    with pytest.raises(InputError, match=r"the map .*map-N1\.yaml of the airframe N1 is not there"):
        flights_of([str(place / "list.yaml")], files, place / "out")


def test_a_folder_of_tables_that_say_what_they_are_is_one_flight(place):
    """`ulog2csv` writes a folder; other tables beside recordings are none of their own."""
    folder = place / "fleet" / "N1" / "log"
    folder.mkdir()
    header, row = "timestamp,xyz[0],xyz[1],xyz[2]", "{},0.1,0.2,{}"
    for topic, last in (("vehicle_acceleration", -9.8), ("vehicle_angular_velocity", 0.1)):
        rows = [row.format(20_000 * k, last) for k in range(50)]
        (folder / f"log_{topic}_0.csv").write_text("\n".join([header, *rows]) + "\n")
    (place / "fleet" / "N1" / "hours.csv").write_text("day,hours\n1,2\n")
    (log,) = [f for f in flights_of([str(place / "fleet")], Files(str(place / "one.yaml")), place / "out") if f.is_log
              and f.recording.is_dir()]  # fmt: skip
    assert (log.name, log.airframe) == ("N1/log", "N1")
    assert "N1/hours" not in found(place, "fleet")
    (alone,) = flights_of([str(folder)], Files(str(place / "one.yaml")), place / "out")
    assert (alone.name, alone.airframe) == ("log", "N1")  # and not "."


@pytest.mark.parametrize("with_map", [False, True])
@pytest.mark.parametrize("ending", ["yaml", "csv"])
def test_a_list(place, ending, with_map):
    if ending == "yaml":
        text = "- {recording: fleet/N1/1.mcap, name: first, airframe: A, start: 2026-05-31T14:30:00Z}\n"
        text += "- {recording: fleet/N2/3.ulg, aircraft: N2.yaml}\n"
    else:
        text = "recording,name,airframe,start,aircraft\n"
        text += "fleet/N1/1.mcap,first,A,2026-05-31 14:30:00,\nfleet/N2/3.ulg,,,,N2.yaml\n"
    (place / f"list.{ending}").write_text(text)
    files = Files(str(place / "one.yaml"), map=str(place / "one.yaml") if with_map else None)
    first, second = flights_of([str(place / f"list.{ending}")], files, place / "out")
    assert (first.name, first.airframe, first.start) == ("first", "A", 1_780_237_800_000_000_000)
    assert first.recording == place / "fleet/N1/1.mcap" and first.aircraft.name == "one.yaml"
    assert (second.name, second.airframe, second.start, second.aircraft.name) == ("N2/3", "N2", None, "N2.yaml")


@pytest.mark.parametrize("with_map", [False, True])
@pytest.mark.parametrize(
    "text",
    [
        "\ufeffrecording,airframe,name\r\nfleet/N1/1.mcap,N1,a\r\n",
        "\ufeffrecording;airframe;name\r\nfleet/N1/1.mcap;N1;a\r\n",
        "recording\tairframe\tname\nfleet/N1/1.mcap\tN1\ta\n",
        " Recording , Airframe , NAME \nfleet/N1/1.mcap , N1 , a \n,,\n",
    ],
)
def test_a_list_as_a_spreadsheet_writes_it(place, text, with_map):
    """Excel's byte-order mark was part of the first name, semicolons of all of them, and "N1 " was another airframe."""
    (place / "list.csv").write_text(text)
    one = str(place / "one.yaml")
    (flight,) = flights_of([str(place / "list.csv")], Files(one, map=one if with_map else None), place / "out")
    assert (flight.name, flight.airframe, flight.recording) == ("a", "N1", place / "fleet/N1/1.mcap")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"recording,recording\na,b\n", "names recording twice"),
        ("recording,airframe\na,Käfer\n".encode("cp1252"), "is not text in UTF-8"),
        (b"recording,airframe\na,b,c\n", "more values than names"),
        (b'recording,airframe\n"a,b\n', "line 2"),
    ],
)
def test_a_bad_table_of_flights_is_one_sentence(place, text, said):
    (place / "list.csv").write_bytes(text)
    with pytest.raises(InputError, match=said) as caught:
        found(place, "list.csv")
    assert "codec" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[]", "must be a list of flights"),
        ("- 3", "entry 1 is not a flight"),
        ("- {recordin: x}", "unknown key 'recordin'"),
        ("- {name: x}", "names no recording"),
        ("- {recording: a.mcap, start: noon}", "start that is not a time"),
        ("- {recording: a.mcap, name: ../x}", "name '../x'"),
        ("- {recording: a.mcap, airframe: /etc}", "airframe '/etc'"),
        ("- {recording: a.mcap, name: x}\n- {recording: b.mcap, name: x}", "two flights have the name x"),
    ],
)
def test_a_bad_list_is_one_sentence(place, text, said):
    (place / "list.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        found(place, "list.yaml")
    assert said in str(caught.value)


def test_the_run_of_one_flight_does_not_lie_in_that_of_another(place):
    """The run of N1 had deleted that of N1/1, or the other way round; without runs both are flights."""
    (place / "fleet/N1.mcap").touch()
    listed = flights_of([str(place / "fleet")], Files(str(place / "one.yaml")), place / "out")
    with pytest.raises(InputError, match="the run of N1/1 would lie in that of N1: give them other names in a list"):
        check_run_folders(listed)
    check_run_folders([flight for flight in listed if flight.name != "N1"])
    asked = Asked([str(place / "fleet")], Files(str(place / "one.yaml")), place / "out", 0, 60.0, runs=True)
    with pytest.raises(InputError, match="would lie in that of"):
        fly_fleet(asked, lambda *said: None, print)
    assert not (place / "out").exists()


@pytest.mark.parametrize("name", ["N1/1", "./N1/1", "N1//1/."])
def test_two_names_of_one_folder_are_found(place, name):
    flight = flights_of([str(place / "fleet/N1/1.mcap")], Files(str(place / "one.yaml")), place / "out")[0]
    with pytest.raises(InputError, match="would lie in that of"):
        check_run_folders([replace(flight, name="N1/1/x"), replace(flight, name="N1/10"), replace(flight, name=name)])


def test_of_two_flights_with_one_name_it_says_how_to_tell_them_apart(place):
    """A telemetry log beside the log of a flight, and ``fleet flights/*``, of which the shell makes many sources."""
    (place / "fleet/N2/1.mcap").touch()
    with pytest.raises(InputError, match=r"the name 1, .*: give the folder above both as SOURCE"):
        found(place, "fleet/N1", "fleet/N2")
    assert found(place, "fleet")["N2/1"] == "N2"
    (place / "fleet/N2/3.tlog").touch()
    with pytest.raises(InputError, match=r"the name N2/3, .*: take one kind .* such as '\*\*/\*\.ulg', or give them"):
        found(place, "fleet")
    assert found(place, "fleet/**/*.ulg") == {"N2/3": "N2"}


def test_what_is_not_there(place):
    (place / "empty").mkdir()
    for source, said in (("empty", "no flight is in"), ("nowhere", "there is no flight"), ("*.none", "no flight")):
        with pytest.raises(InputError, match=said):
            found(place, source)
    with pytest.raises(InputError, match="no aircraft file is named"):
        found(place, "fleet", aircraft=None)
    with pytest.raises(InputError, match="two flights have the name bag"):
        (place / "fleet" / "N1" / "bag.mcap").touch()
        found(place, "fleet/N2/bag", "fleet/N1/bag.mcap")


def test_a_flight_without_airspeed_says_how_a_fleet_takes_calm_air():
    """Not how a replay of one flight does."""

    def work():
        raise NoAirspeedError

    told = flight_task._tried(work, "not diagnosed", None)[1]
    assert told.startswith("not diagnosed: this flight has no airspeed")
    assert "fly the fleet with --calm-air" in told and "replay it" not in told
