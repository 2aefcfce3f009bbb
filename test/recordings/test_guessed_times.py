"""The unit of a time whose name does not say it."""

import numpy as np
import pytest
import strange_layouts as layouts

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.tabular.guess.first_map import guess_map
from aircraft_sysid_ros.recordings.tabular.guess.names import guess_name


def guessed(folder, name, ticks, **columns):
    layouts.write_rows(folder / "log.csv", [name, *columns], [ticks, *columns.values()])
    return guess_map(folder / "log.csv").parts[0].time


def rolling(seconds):
    """A roll angle [deg], its rate and something that is of no help."""
    return {
        "roll": 10.0 * np.sin(seconds), "p": 10.0 * np.cos(seconds), "q": 5.0 * np.cos(3.0 * seconds),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "step", "unit"),
    [("time", 1, "ms"), ("time", 1000, "us"), ("time", 1_000_000, "ns"), ("t", 0.001, "s"), ("t", 0.0005, "s")],
)
def test_the_unit_of_a_log_at_1_kHz_is_told_by_what_the_gyro_adds_up_to(tmp_path, name, step, unit):
    """It had been one in a thousand too slow, and sure: ms as s."""
    count = np.arange(8000)
    seconds = count * step * {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[unit]
    time = guessed(tmp_path, name, count * step, **rolling(seconds))
    assert (time.unit, time.sure) == (unit, True)


def test_a_log_at_1_Hz_is_in_seconds(tmp_path):
    count = np.arange(6000)
    time = guessed(tmp_path, "time", count, **rolling(0.1 * count) | {"p": np.cos(0.1 * count)})
    assert (time.unit, time.sure) == ("s", True)
    time = guessed(tmp_path, "time", np.arange(600), **{"tas": np.full(600, 20.0)})  # 0.6 s would be no flight
    assert time.unit == "s"


def test_a_unit_that_nothing_tells_is_left_to_the_user(tmp_path):
    with pytest.raises(InputError, match="'time' rises by 1 from row to row, which may be s or ms: write its unit"):
        guessed(tmp_path, "time", np.arange(6000), q=np.zeros(6000))


@pytest.mark.parametrize("step", [2.001, 4.0, 5.0])
def test_a_recorder_that_writes_every_few_seconds_is_in_seconds(tmp_path, step):
    """It had been ms, and sure: a take-off that took a minute was over in 0.06 s."""
    time = guessed(tmp_path, "t", 34.1 + step * np.arange(90), EAS=np.linspace(30.0, 160.0, 90))
    assert (time.unit, time.sure) == ("s", True)
    time = guessed(tmp_path, "t", 1_597_764_857.0 + step * np.arange(3000), EAS=np.linspace(30.0, 160.0, 3000))
    assert (time.unit, time.is_unix) == ("s", True)
    with pytest.raises(InputError, match=r"'t' rises by .* from row to row, which may be s or ms: write its unit"):
        guessed(tmp_path, "t", 34.1 + step * np.arange(3000), EAS=np.linspace(30.0, 160.0, 3000))


@pytest.mark.parametrize("step", [2, 4, 5])
def test_a_log_of_several_hundred_rows_a_second_is_in_milliseconds(tmp_path, step):
    count = np.arange(300_000 // step)  # as seconds they would be three days and more
    assert guessed(tmp_path, "t", step * count, q=np.zeros(len(count))).unit == "ms"
    count = np.arange(8000)
    assert guessed(tmp_path, "t", step * count, **rolling(1e-3 * step * count)).unit == "ms"


def test_times_since_1970_tell_their_unit(tmp_path):
    time = guessed(tmp_path, "time", 1_717_164_300_000 + np.arange(6000), q=np.zeros(6000))
    assert (time.unit, time.is_unix, time.sure) == ("ms", True, True)


def hhmmss(seconds):
    """The time of day as receivers of GPS write it."""
    return 10_000 * (seconds // 3600 % 24) + 100 * (seconds // 60 % 60) + seconds % 60


@pytest.mark.parametrize("start", [50_730.0, 86_370.0])  # 14:05:30, and past midnight
def test_hours_minutes_and_seconds_in_one_number_are_a_time_of_day(tmp_path, capsys, start):
    """They had been seconds, and sure: a flight of 60 s took 99.9 s."""
    seconds = np.round(start + 0.1 * np.arange(600), 1)
    columns = {"p [rad/s]": np.sin(seconds), "q [rad/s]": np.cos(seconds), "r [rad/s]": np.cos(seconds)}
    time = guessed(tmp_path, "utc", np.round(hhmmss(seconds), 1), **columns)
    assert (time.unit, time.sure) == ("hhmmss", True)
    where = [str(tmp_path / name) for name in ("log.csv", "map.yaml", "bag")]
    assert main(["import", where[0], "--guess", where[1]]) == 0
    assert main(["import", where[0], "--map", where[1], "--out", where[2]]) == 0
    stamp = np.unique(read_recording(where[2]).samples.stamp)
    np.testing.assert_allclose(np.diff(stamp), 1e8, atol=1e3)
    assert stamp[0] / 1e9 % 86_400.0 == pytest.approx(start)


def test_seconds_with_a_gap_of_40_s_are_no_time_of_day(tmp_path):
    time = np.concatenate([np.arange(0.0, 40.0, 0.1), np.arange(110.0, 150.0, 0.1)])
    assert guessed(tmp_path, "utc", time, p=np.sin(time)).unit == "s"


@pytest.mark.parametrize(("name", "unit"), [("time_boot_ms", "ms"), ("millis", "ms"), ("micros", "us")])
def test_names_that_say_their_unit(name, unit):
    assert guess_name(name).unit == unit


@pytest.mark.parametrize("zone", [" GMT", " UTC", "UTC"])
def test_times_as_text_may_name_universal_time(tmp_path, zone):
    """A recorder of X-Plane's network data wrote GMT behind them, and its table was left out."""
    texts = [f"2020-08-18T15:34:{0.1 * row:06.3f}{zone}" for row in range(200)]
    time = guessed(tmp_path, "Timestamp", texts, p=np.sin(np.arange(200.0)))
    assert (time.unit, time.seconds[0] % 86_400.0) == ("iso", pytest.approx(56_040.0))
    assert guessed(tmp_path, "time", [text[11:] for text in texts], p=np.sin(np.arange(200.0))).unit == "iso"


def test_a_text_that_is_no_time_is_shown(tmp_path):
    with pytest.raises(InputError, match="its time 'Timestamp' holds '3 past noon', which is not a time such as"):
        guessed(tmp_path, "Timestamp", ["3 past noon", "4 past noon", "5 past noon"], p=np.arange(3.0))
    with pytest.raises(InputError, match="its column 'Datetime' goes back at data row 2"):
        guessed(tmp_path, "Datetime", ["2024-10-11", "2024-01-20", "2024-12-26"], p=np.arange(3.0))


def test_an_epoch_time_is_a_time(tmp_path):
    ticks = 1_597_764_857_386.0 + 100.0 * np.arange(200)
    time = guessed(tmp_path, "Epoch time", ticks, p=np.sin(np.arange(200.0)))
    assert (time.unit, time.is_unix) == ("ms", True)


def test_the_time_that_tells_rows_apart_is_taken(tmp_path):
    """A recorder at 16 Hz wrote the date to the second before its own time: of 16 rows one was left."""
    time = np.arange(400) / 16.0
    dates = [f"2024-05-31 14:05:{int(t):02d}" for t in time]
    columns = {"Session Time": 1812.3 + time, "Pitch (deg)": np.sin(time), "Roll (deg)": np.cos(time)}
    found = guessed(tmp_path, "GPS Date & Time", dates, **columns)
    assert (found.column, found.unit, found.others) == ("Session Time", "s", ("GPS Date & Time",))
