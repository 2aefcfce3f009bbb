"""The unit of a time whose name does not say it."""

import numpy as np
import pytest
import strange_layouts as layouts

from aircraft_sysid_ros.errors import InputError
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


def test_times_since_1970_tell_their_unit(tmp_path):
    time = guessed(tmp_path, "time", 1_717_164_300_000 + np.arange(6000), q=np.zeros(6000))
    assert (time.unit, time.is_unix, time.sure) == ("ms", True, True)


@pytest.mark.parametrize(("name", "unit"), [("time_boot_ms", "ms"), ("millis", "ms"), ("micros", "us")])
def test_names_that_say_their_unit(name, unit):
    assert guess_name(name).unit == unit
