"""Many manoeuvres as one body of data: segments of a recording, or recordings, through the commands."""

import contextlib
import io
import json
import random
import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.diagnosis.search.fit import fit_axis
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS
from aircraft_sysid_ros.run_reader import read_samples
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.simulated_flight import simulate_samples

SECOND = 10**9
#: Manoeuvres of 10 s, one every 11 s.
COUNT, LENGTH, EVERY = 14, 10.0, 11.0
#: What an aeroplane is first asked for: stability, damping and control power.
MAIN = (
    "CZ_alpha", "CY_beta", "Cl_beta", "Cl_p", "Cl_da", "Cm_alpha", "Cm_q", "Cm_de", "Cn_beta", "Cn_r", "Cn_dr",
)  # fmt: skip


def ask(*words) -> dict:
    """The JSON that a command answers."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        assert main([*map(str, words), "--json"]) == 0
    return json.loads(said.getvalue())


def refused(capsys, *words) -> str:
    """The sentence with which a command refuses, on standard error, with the status 2."""
    capsys.readouterr()  # what a slow fixture has said
    assert main([*map(str, words)]) == 2
    said = capsys.readouterr().err.strip()
    assert said.count("\n") == 0 and "Traceback" not in said
    return said


def write_segments(path, segments):
    path.write_text(yaml.safe_dump(segments), encoding="utf8")
    return path


def equal_segments(count=COUNT, length=LENGTH):
    return [{"start": 6.0 + EVERY * k, "stop": 6.0 + EVERY * k + length, "name": f"m{k}"} for k in range(count)]


def write_part(flight, path, start: float, stop: float, later: float = 0.0):
    """A recording of a part of a simulated flight [s], as if flown some time [s] later."""
    begin = min(int(stream.stamp.min()) for stream in flight.streams)
    shift = round(later * SECOND)
    with RecordingWriter(path) as writer:
        for s in flight.streams:
            inside = (s.stamp >= begin + start * SECOND) & (s.stamp < begin + stop * SECOND)
            fields = {name: values[inside] for name, values in s.fields.items()}
            writer.write(s.topic, TOPICS[s.topic], s.stamp[inside] + shift, fields, log_time=s.arrival[inside] + shift)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("manoeuvres")


@pytest.fixture(scope="module")
def clean(aircraft):
    """A flight that lacks nothing."""
    return simulate_samples(aircraft, 31, 170.0)


@pytest.fixture(scope="module")
def bag(clean, folder):
    """The whole of it as one recording."""
    return write_part(clean, folder / "whole.mcap", 0.0, 1000.0)


@pytest.fixture(scope="module")
def recordings(clean, folder):
    """The manoeuvres of it, a recording each."""
    return [write_part(clean, folder / f"m{k}.mcap", s["start"], s["stop"]) for k, s in enumerate(equal_segments())]


@pytest.fixture(scope="module")
def campaign(recordings, aircraft_file, folder):
    """The run of all recordings, and what replay said."""
    return folder / "campaign", ask("replay", *recordings, "--aircraft", aircraft_file, "--out", folder / "campaign")


@pytest.fixture(scope="module")
def flight_of_campaign(campaign):
    """As compare and add see it."""
    return open_run(campaign[0]).flight()


def parameters_of(flight) -> dict[str, tuple[float, float]]:
    fits = [fit_axis(flight, axis).fit for axis in AXES]
    return {n: (v, s) for f in fits for n, v, s in zip(f.names, f.parameters, f.std, strict=True)}


# -- the way of a campaign ---------------------------------------------------------------------------------------


@pytest.mark.long
def test_main_derivatives_are_within_5_percent_and_covered(campaign, flight_of_campaign, aircraft):
    _, said = campaign
    live = {p["name"]: (p["value"], p["std"]) for p in said["parameters"]["parameters"] if p["status"] == "USE"}
    for found in (live, parameters_of(flight_of_campaign)):
        assert found.keys() >= set(MAIN)
        far = []
        for name in MAIN:
            (value, std), truth = found[name], aircraft.coefficients[name]
            assert abs(value / truth - 1.0) < 0.05, name
            if abs(value - truth) > 3.0 * max(std, 0.003 * abs(truth)):
                far.append(name)
        assert len(far) <= 1, far
    assert not [name for name in live if name.endswith("_0")]  # a bias of a manoeuvre may stand in them


@pytest.mark.long
def test_the_run_says_where_each_manoeuvre_comes_from(campaign, recordings):
    run, said = campaign
    listed = json.loads((run / "state.json").read_text())["manoeuvres"]
    assert [m["name"] for m in listed] == [path.stem for path in recordings]
    assert [m["recording"] for m in listed] == list(map(str, recordings))
    samples = read_samples(run)
    for m, path in zip(listed, recordings, strict=True):
        stamps = read_recording(path).samples.stamp + round(m["offset"] * SECOND)
        assert np.isin(stamps, samples.stamp).all()
    assert not said["notes"]


@pytest.mark.long
def test_compare_is_at_its_floor(campaign):
    compared = ask("compare", campaign[0])
    for axis, error in compared["axes"].items():
        assert error["nrmse_held_out"] < 1.5 * error["noise_floor"], axis
    assert not [place for place in compared["worst"] if place["times_noise"] > 3.0]


@pytest.mark.long
def test_diagnose_finds_nothing(campaign):
    assert ask("diagnose", campaign[0], "--replicas", 2)["verdict"] == "none"


@pytest.mark.long
def test_what_is_held_out_are_whole_manoeuvres(flight_of_campaign):
    flight = flight_of_campaign
    assert flight.by_manoeuvre and flight.folds == COUNT
    for axis in AXES:
        fit = fit_axis(flight, axis)
        x, y, found = fit.columns, fit.measured, fit.fit.held_out
        for fold in range(flight.folds):
            out = fit.rows & (flight.fold == fold)
            seen = fit.rows & (flight.fold != fold)
            assert len(set(flight.manoeuvre[out])) == 1 and not set(flight.manoeuvre[out]) & set(flight.manoeuvre[seen])
            theta = np.linalg.lstsq(x[seen], y[seen], rcond=None)[0]  # of the others alone
            assert found[out] == pytest.approx(y[out] - x[out] @ theta, abs=1e-6 * np.std(y))


@pytest.mark.long
def test_segments_of_one_recording_are_the_same_body(campaign, flight_of_campaign, bag, aircraft_file, folder):
    file = write_segments(folder / "segments.yaml", equal_segments())
    said = ask("replay", bag, "--segments", file, "--aircraft", aircraft_file, "--out", folder / "cut")
    assert said["state"]["duration"] == pytest.approx(COUNT * LENGTH, abs=1.0)
    assert [m["name"] for m in said["state"]["manoeuvres"]] == [f"m{k}" for k in range(COUNT)]
    assert furthest(parameters_of(flight_of_campaign), parameters_of(open_run(folder / "cut").flight())) < 0.5


@pytest.mark.long
def test_the_order_of_recordings_does_not_matter(flight_of_campaign, recordings, aircraft_file, folder):
    """But for what the end of the body knows of the biases: half of a standard error."""
    mixed = random.Random(3).sample(recordings, len(recordings))
    ask("replay", *mixed, "--aircraft", aircraft_file, "--out", folder / "mixed")
    assert furthest(parameters_of(flight_of_campaign), parameters_of(open_run(folder / "mixed").flight())) < 0.5


def furthest(found, others) -> float:
    """Standard errors by which parameters differ at most; the constants, which a bias shifts, apart."""
    names = [name for name in found if not name.endswith("_0")]
    return max(abs(found[n][0] - others[n][0]) / max(found[n][1], others[n][1]) for n in names)


@pytest.fixture(scope="module")
def hidden_run(aircraft_file, folder):
    """Nine manoeuvres of an aeroplane with an effect that its file does not know."""
    ask("simulate", "--out", folder / "hidden", "--aircraft", aircraft_file, "--effect", "sideslip_drag",
        "--duration", 110, "--seed", 32)  # fmt: skip
    file, run = write_segments(folder / "hidden.yaml", equal_segments(9)), folder / "hidden_run"
    ask("replay", folder / "hidden", "--segments", file, "--aircraft", aircraft_file, "--out", run)
    return run


@pytest.mark.long
def test_a_hidden_effect_is_named(hidden_run):
    found = ask("diagnose", hidden_run, "--replicas", 2)
    assert (found["verdict"], found["candidates"][0]["effect"]) == ("missing", "sideslip_drag")


@pytest.mark.long
def test_a_hidden_effect_is_seen_and_added(hidden_run):
    before = ask("compare", hidden_run)
    assert before["worst"][0]["axis"] == "CX"
    assert any(f"({s['name']})" in place["text"] for place in before["worst"] for s in equal_segments())
    change = ask("add", hidden_run, "sideslip_drag")["axes"]["CX"]
    assert change["error_before"] == pytest.approx(before["axes"]["CX"]["nrmse_held_out"], rel=1e-6)
    assert change["error_after"] < 0.5 * change["error_before"]


@pytest.mark.long
def test_without_a_common_clock_each_begins_anew(clean, aircraft, aircraft_file, folder):
    """Recordings of other days, as of files that all begin at 0: a constant of each is not known, the rest is."""
    days = [
        write_part(clean, folder / f"day{k}.mcap", s["start"], s["stop"], 86_400.0 * k)
        for k, s in enumerate(equal_segments())
    ]
    said = ask("replay", *days, "--smooth", "--aircraft", aircraft_file, "--out", folder / "days")
    (note,) = said["notes"]
    assert note.startswith(f"{COUNT - 1} of {COUNT} manoeuvres begin without")
    flight = open_run(folder / "days").flight()
    assert len(np.unique(flight.flown)) == COUNT and np.array_equal(flight.flown, flight.manoeuvre)
    errors = ask("compare", folder / "days")["axes"]
    assert errors["CX"]["nrmse_held_out"] < 0.05 and errors["CY"]["nrmse_held_out"] < 0.06
    found = parameters_of(flight)
    for name in (*MAIN, "CX_alpha2", "CX_Tc"):
        assert abs(found[name][0] / aircraft.coefficients[name] - 1.0) < 0.05, name


@pytest.mark.long  # the same with segments and all main derivatives: test_replay_without_sensors.py
def test_twenty_manoeuvres_at_25_hz_without_gps(aircraft, aircraft_file, folder):
    flight, every = simulate_samples(aircraft, 61, 240.0), {"imu/data": 4, "air_data": 2, "control_surfaces": 2}
    streams = [
        replace(
            s,
            stamp=s.stamp[:: every[s.topic]],
            arrival=s.arrival[:: every[s.topic]],
            fields={name: values[:: every[s.topic]] for name, values in s.fields.items()},
        )
        for s in flight.streams
        if s.topic in every
    ]
    bag = write_part(replace(flight, streams=streams), folder / "no_gps.mcap", 0.0, 1000.0)
    file = write_segments(folder / "twenty.yaml", equal_segments(20))
    said = ask("replay", bag, "--segments", file, "--aircraft", aircraft_file, "--out", folder / "no_gps")
    assert any(note.startswith("no GPS") for note in said["notes"])
    found = parameters_of(open_run(folder / "no_gps").flight())
    for name in MAIN:
        (value, std), truth = found[name], aircraft.coefficients[name]
        assert abs(value - truth) < min(0.05 * abs(truth), 3.0 * max(std, 0.004 * abs(truth))), name


# -- how little is enough ------------------------------------------------------------------------------------------


@pytest.mark.long
def test_the_sum_of_short_manoeuvres_is_what_must_be_long_enough(bag, aircraft_file, folder, capsys):
    for count, enough in ((3, False), (6, True)):
        file = write_segments(folder / f"{count}.yaml", equal_segments(count, 6.0))
        said = ask("replay", bag, "--segments", file, "--aircraft", aircraft_file, "--out", folder / f"few{count}")
        told = [note for note in said["notes"] if "failed inputs) need 20 s in all" in note]
        assert len(told) == (not enough), said["notes"]
        if enough:
            assert ask("compare", folder / f"few{count}")["axes"]["CZ"]["nrmse_held_out"] < 0.2
        else:
            assert "20 s are needed" in refused(capsys, "compare", folder / "few3")


@pytest.mark.long
def test_what_is_too_short_is_named_and_the_rest_goes_on(bag, aircraft_file, folder):
    short = [{"start": 1.0, "stop": 2.0, "name": "blip"}, {"start": 160.0, "stop": 162.05, "name": "tail"}]
    file = write_segments(folder / "short.yaml", [short[0], *equal_segments(4), short[1]])
    said = ask("replay", bag, "--segments", file, "--aircraft", aircraft_file, "--out", folder / "short")
    assert [m["name"] for m in said["state"]["manoeuvres"]] == ["m0", "m1", "m2", "m3", "tail"]
    assert any("'blip' is left out: it has 1.0 s of IMU samples, and 2 s are needed" in n for n in said["notes"])


def test_a_manoeuvre_without_a_start_is_named(clean, recordings, aircraft_file, folder):
    """One recording has a GPS without a fix, and nothing else that shows a speed."""
    path = folder / "no_fix.mcap"
    begin = min(int(stream.stamp.min()) for stream in clean.streams)
    with RecordingWriter(path) as writer:
        for s in (stream for stream in clean.streams if stream.topic not in ("gps/vel", "air_data")):
            inside = (s.stamp >= begin + 160 * SECOND) & (s.stamp < begin + 168 * SECOND)
            fields = {name: values[inside] for name, values in s.fields.items()}
            if s.topic == "gps/fix":
                fields["status.status"] = np.full(int(inside.sum()), -1)
            writer.write(s.topic, TOPICS[s.topic], s.stamp[inside], fields)
    said = ask("replay", recordings[0], path, recordings[1], "--aircraft", aircraft_file, "--out", folder / "start")
    (note,) = (note for note in said["notes"] if "no_fix" in note and "contributes nothing" in note)
    why = "of 40 samples of the GPS position 40 have no fix"
    assert note.startswith(f"the manoeuvre 'no_fix' contributes nothing: {why}")


def write_without(clean, path, start, stop, topics=(), fields=()):
    """A part of the flight without topics, and without fields of its air data."""
    streams = [
        replace(s, fields={**s.fields, **{name: np.full(len(s.stamp), np.nan) for name in fields}})
        if s.topic == "air_data"
        else s
        for s in clean.streams
        if s.topic not in topics
    ]
    return write_part(replace(clean, streams=streams), path, start, stop)


@pytest.mark.long
def test_what_some_manoeuvres_lack_is_said_of_those(clean, recordings, aircraft_file, folder):
    """The last one flies without GPS, one without an airspeed, one without controls: the others have all."""
    calm = write_without(clean, folder / "no_speed.mcap", 72.0, 82.0, (), ("true_airspeed",))
    loose = write_without(clean, folder / "no_controls.mcap", 83.0, 93.0, ("control_surfaces",))
    last = write_without(clean, folder / "no_place.mcap", 94.0, 104.0, ("gps/fix", "gps/vel"))
    given = [*recordings[:3], calm, loose, last]
    said = ask("replay", *given, "--aircraft", aircraft_file, "--out", folder / "some")
    notes = said["notes"]
    assert [note for note in notes if note.startswith("in 1 of 6 manoeuvres (no_place): no GPS: ")]
    assert [note for note in notes if note.startswith("in 1 of 6 manoeuvres (no_speed): no airspeed: ")]
    assert "the manoeuvre 'no_controls' contributes nothing: it has no controls" in notes
    assert not [note for note in notes if note.startswith("no ") or "of the air data have no" in note]
    written = json.loads((folder / "some" / "state.json").read_text())["notes"]
    assert set(written) <= set(notes) and len([note for note in written if note.startswith("in 1 of 6 ")]) == 3


@pytest.mark.long
def test_a_gap_is_told_with_the_manoeuvre_that_it_is_in(clean, recordings, aircraft_file, folder):
    begin = min(int(stream.stamp.min()) for stream in clean.streams)
    streams = [
        replace(
            s,
            stamp=s.stamp[kept],
            arrival=s.arrival[kept],
            fields={name: values[kept] for name, values in s.fields.items()},
        )
        for s in clean.streams
        for kept in [(s.topic != "air_data") | (np.abs(s.stamp - begin - 77 * SECOND) > 1.5 * SECOND)]
    ]
    path = write_part(replace(clean, streams=streams), folder / "gap.mcap", 72.0, 82.0)
    said = ask("replay", *recordings[:3], path, "--aircraft", aircraft_file, "--out", folder / "with_gap")
    gaps = [note for note in said["notes"] if "the airspeed samples have" in note]
    assert gaps == ["in 1 of 4 manoeuvres (gap): the airspeed samples have a gap of 3.0 s"]


def test_all_too_short_is_refused(bag, aircraft_file, folder, capsys):
    file = write_segments(folder / "blips.yaml", equal_segments(3, 1.5))
    said = refused(capsys, "replay", bag, "--segments", file, "--aircraft", aircraft_file, "--out", folder / "no")
    assert "no manoeuvre is long enough: the longest has 1.5 s of IMU samples, and 2 s are needed" in said
    assert not (folder / "no").exists()


@pytest.mark.long
def test_one_whole_recording_is_as_it_always_was(bag, aircraft_file, folder):
    said = ask("replay", bag, "--aircraft", aircraft_file, "--out", folder / "one")
    assert "manoeuvres" not in said["state"]
    kept, given = read_samples(folder / "one"), read_recording(bag).samples
    assert np.array_equal(kept.stamp, given.stamp) and Kind.SEAM not in kept.kind
    flight = open_run(folder / "one").flight()
    assert flight.manoeuvre is None and not flight.by_manoeuvre


# -- bad input -------------------------------------------------------------------------------------------------------

A, B = {"start": 5.0, "stop": 15.0, "name": "a"}, {"start": 20.0, "stop": 30.0, "name": "b"}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("start: [", "is not valid YAML"),
        ("start: 1", "it must be a list of segments with recording, start, stop, name"),
        ("[]", "it must be a list of segments"),
        ([3], "entry 1 is not a segment"),
        ([A, {**B, "end": 3.0}], "entry 2 has the unknown key 'end': a segment has recording, start, stop, name"),
        ([{"stop": 3.0}], "entry 1 needs a start in seconds"),
        ([{**A, "start": -1.0}], "entry 1 needs a start in seconds"),
        ([{**A, "stop": "later"}], "entry 1 needs a stop in seconds"),
        ([{**A, "stop": 5.0}], "entry 1 stops at 5 s, which is not after its start at 5 s"),
        ([{**A, "name": ["x"]}], "entry 1 has a name that is not text"),
        ([{**A, "stop": 1e4}], "the segment 'a' goes from 5 to 10000 s, but the recording"),
        ([{**A, "start": 500.0, "stop": 510.0}], "the segment 'a' goes from 500 to 510 s, but the recording"),
        ([A, {**B, "name": "a"}], "two segments have the name 'a'"),
        ([A, {**B, "start": 14.0}], "'a' and 'b' overlap"),
        ([{**A, "recording": "other"}], "'other' is not among the recordings that are given"),
    ],
)
def test_a_bad_file_of_segments_is_refused(content, said, bag, aircraft_file, tmp_path, capsys):
    file = tmp_path / "segments.yaml"
    file.write_text(content if isinstance(content, str) else yaml.safe_dump(content), encoding="utf8")
    words = ("replay", bag, "--segments", file, "--aircraft", aircraft_file, "--out", tmp_path / "run")
    assert said in refused(capsys, *words)
    assert not (tmp_path / "run").exists()


def test_recordings_are_named_once_and_for_each_segment(recordings, aircraft_file, tmp_path, capsys):
    first, second = recordings[:2]
    rest = ("--aircraft", aircraft_file, "--out", tmp_path / "run")
    (tmp_path / "again.mcap").symlink_to(first)
    assert "is given twice" in refused(capsys, "replay", first, second, tmp_path / "again.mcap", *rest)
    copy = shutil.copyfile(first, tmp_path / "copy.mcap")
    assert "hold the same IMU samples" in refused(capsys, "replay", first, copy, *rest)
    none = write_segments(tmp_path / "none.yaml", [A])
    assert "entry 1 names no recording, and 2 are given" in refused(
        capsys, "replay", first, second, "--segments", none, *rest
    )
    assert "cannot read the segments file" in refused(
        capsys, "replay", first, "--segments", tmp_path / "missing.yaml", *rest
    )
    assert "--stage-1 is for one flight" in refused(
        capsys, "replay", first, second, "--air-data-errors", "--stage-1", 60, *rest
    )


@pytest.mark.long
def test_recordings_are_found_by_name_or_by_path_from_the_file(recordings, aircraft_file, folder, tmp_path):
    named = [
        {"recording": "m0", "start": 0.0, "stop": 9.0},
        {"recording": "m1.mcap", "start": 0.0, "stop": 9.0},
        {"recording": str(recordings[2]), "start": 1.0, "stop": 9.0, "name": 7},
        {"recording": f"{folder.name}/m3.mcap", "start": 0.0, "stop": 9.99},
    ]
    file = write_segments(folder.parent / f"{folder.name}.yaml", named)
    words = ("--segments", file, "--aircraft", aircraft_file, "--out", tmp_path / "run")
    said = ask("replay", *recordings[:5], *words)
    assert [m["name"] for m in said["state"]["manoeuvres"]] == ["m0 0 to 9 s", "m1 0 to 9 s", "7", "m3 0 to 9.99 s"]
    assert said["notes"] == [f"the recording {recordings[4]} has no segment and is not used"]
