"""The noise of a recording where the window of the coefficients looks, against noise that is known."""

from __future__ import annotations

import numpy as np
import pytest
from slow_flights import file_of_users

from aircraft_sysid_ros.diagnosis.flight.white_noise import LEAST_SHARE, white_noise_of
from aircraft_sysid_ros.samples import Kind, Samples, samples_of

TIME = 300.0
#: Of the file: no less is the most that is believed.
MOST = {name: file_of_users().sensors[name].noise[0] for name in ("gyro", "accelerometer", "control_surfaces")}


def recorded(rate: float, values, kind: Kind = Kind.IMU) -> Samples:
    """A recording of angular rates, or of surfaces (n, 3) at a rate [Hz]."""
    stamp = (1e9 * np.arange(len(values)) / rate).astype(np.int64)
    if kind == Kind.IMU:
        return samples_of(kind, stamp, np.zeros_like(values), values)
    return samples_of(kind, stamp, values)


def noisy(rate: float, std: float, busy: float = 0.5):
    """Rates (n, 3): pulses of a second each for a part of the flight, and white noise."""
    time = np.arange(0.0, TIME, 1.0 / rate)
    motion = np.where(time < busy * TIME, 0.3 * np.sign(np.sin(2.0 * np.pi * time)), 0.0)
    return motion[:, None] + std * np.random.default_rng(1).standard_normal((len(time), 3))


@pytest.mark.parametrize("rate", [10.0, 25.0, 100.0])
def test_manoeuvres_are_no_noise(rate) -> None:
    """Where half of the flight is quiet, a quarter of the whole is half of that: up to a quarter too much."""
    std = 0.3 * MOST["gyro"]
    found = white_noise_of(file_of_users(), recorded(rate, noisy(rate, std)))["gyro"]
    assert 0.9 * std < found < 1.3 * std
    quiet = white_noise_of(file_of_users(), recorded(rate, noisy(rate, std, busy=0.05)))["gyro"]
    assert quiet == pytest.approx(std, rel=0.12)


def test_what_never_rests_has_the_noise_of_the_file_at_most() -> None:
    found = white_noise_of(file_of_users(), recorded(10.0, noisy(10.0, 1e-4, busy=1.0)))
    assert found["gyro"] == MOST["gyro"]


def test_samples_that_repeat_or_were_smoothed_have_the_noise_that_the_window_meets() -> None:
    """White noise of 100 Hz that was held for five samples has five times its density; smoothed it keeps its own."""
    std = 0.2 * MOST["gyro"]
    seen = noisy(100.0, std, busy=0.05)
    held = np.repeat(seen[::5], 5, axis=0)
    smoothed = np.array([np.convolve(each, np.full(5, 0.2), mode="same") for each in seen.T]).T
    for rates, expected in ((held, np.sqrt(5.0) * std), (smoothed, std)):
        assert white_noise_of(file_of_users(), recorded(100.0, rates))["gyro"] == pytest.approx(expected, rel=0.25)


def test_a_signal_that_stands_still_is_not_without_noise_and_a_short_one_says_nothing() -> None:
    still = white_noise_of(file_of_users(), recorded(50.0, np.zeros((9000, 3)), Kind.CONTROLS))
    assert still == {"control_surfaces": pytest.approx(LEAST_SHARE * MOST["control_surfaces"])}
    assert white_noise_of(file_of_users(), recorded(50.0, noisy(50.0, 1e-4)[:300])) == {}
