"""The track and the height coloured by the residual: where the model failed is where the aeroplane was then."""

import base64
from types import SimpleNamespace

import numpy as np
import pytest

from aircraft_sysid_ros.workbench.views.figure import LIGHT
from aircraft_sysid_ros.workbench.views.states import StateHistory
from aircraft_sysid_ros.workbench.views.track import flown_error, height_figure, track_figure

BEGIN = 7.0  # [s] by which the times of the flight are behind those that are shown


def numbers(coded):
    return np.frombuffer(base64.b64decode(coded["bdata"]), "<f4")


@pytest.fixture
def comparison():
    """Half a minute at 20 Hz: C_m fails by ten times its noise from 20 to 22 s; C_Z is noise."""
    time = np.arange(0.0, 30.0, 0.05)
    of = lambda held_out, std: SimpleNamespace(fit=SimpleNamespace(held_out=held_out), floor=SimpleNamespace(std=std))  # noqa: E731
    fails = (time + BEGIN >= 20.0) & (time + BEGIN < 22.0)
    lift = np.full(len(time), 0.02)
    lift[(time > 3.0) & (time < 6.0)] = np.nan  # nothing was measured
    pitch = np.where(fails, -0.1, np.where(np.isfinite(lift), 0.005, np.nan))
    return SimpleNamespace(
        flight=SimpleNamespace(time=time, begin=BEGIN), axes={"CZ": of(lift, 0.02), "Cm": of(pitch, 0.01)}
    )


@pytest.fixture
def state():
    """Northwards at 10 m/s and up at 1 m/s from time 0 on, 5 m to the west."""
    time = np.arange(0.0, 40.0, 0.01)
    position = np.column_stack([10.0 * time, np.full(len(time), -5.0), -time])
    three = np.zeros((len(time), 3))
    return StateHistory(time, three, three, three, three, three, three, position, three, time, {}, {})


def test_each_piece_has_the_rms_of_its_axis_or_of_the_worst(comparison):
    worst, pitch = flown_error(comparison), flown_error(comparison, "Cm")
    fails = (worst.time > 20.0) & (worst.time < 22.0)
    np.testing.assert_allclose(worst.times_noise[fails], 10.0)
    np.testing.assert_allclose(worst.times_noise[~fails], 1.0)
    assert {axis for axis, it in zip(worst.axis, fails, strict=True) if it} == {"Cm"}
    assert {axis for axis, it in zip(worst.axis, fails, strict=True) if not it} == {"CZ"}
    np.testing.assert_allclose(pitch.times_noise[(pitch.time < 20.0) | (pitch.time > 22.0)], 0.5)
    assert not ((worst.time > BEGIN + 4.0) & (worst.time < BEGIN + 6.0)).any()
    assert worst.time[0] > BEGIN


def test_it_is_drawn_where_the_aeroplane_was(comparison, state):
    error = flown_error(comparison)
    marks = track_figure(state, error, LIGHT)["data"][1]
    np.testing.assert_allclose(numbers(marks["y"]), 10.0 * error.time, rtol=1e-4)
    np.testing.assert_allclose(numbers(marks["x"]), -5.0, rtol=1e-6)
    np.testing.assert_allclose(numbers(marks["marker"]["color"]), error.times_noise, rtol=1e-6)
    height = height_figure(state, error, LIGHT)["data"][1]
    np.testing.assert_allclose(numbers(height["y"]), error.time, rtol=1e-4)
    (worst, *_) = np.flatnonzero(error.times_noise > 5.0)
    assert marks["text"][worst].endswith("10.0 times the noise")
