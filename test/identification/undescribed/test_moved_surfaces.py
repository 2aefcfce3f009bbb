"""What surfaces did, of what was recorded of them, against the exact response to a sine: lag, delay, dead time."""

import numpy as np
import pytest

from aircraft_sysid_ros.identification.coefficients.layout import SIGNALS_OF_SAMPLE, CoefficientSample
from aircraft_sysid_ros.identification.undescribed.moved_surfaces import COUNT, COURSES, FIRST, MovedSurfaces

STEP = 0.04  # [s]


def followed(values, times):
    """Forms (n, FORMS) of the first surface."""
    samples = np.zeros((len(times), CoefficientSample.TERMS))
    samples[:, CoefficientSample.TIME] = times
    samples[:, SIGNALS_OF_SAMPLE + FIRST : SIGNALS_OF_SAMPLE + FIRST + COUNT] = values[:, None]
    surfaces = MovedSurfaces()
    halves = [surfaces.follow(part) for part in np.array_split(samples, 2)]  # whatever the size of the blocks
    return np.concatenate(halves)[:, 0]


@pytest.mark.parametrize("frequency", [0.5, 2.0, 3.0])
def test_each_way_of_being_late_is_that_of_a_sine(frequency):
    """To the third power of frequency times step; straight lines are wrong by the second, 5 and 7 % at 3 Hz."""
    omega, times = 2.0 * np.pi * frequency, np.arange(0.0, 6.0, STEP)
    forms = followed(np.sin(omega * times), times)
    settled = times > 2.0
    for course in COURSES:
        for time, form in zip(course.times.tolist(), course.forms.tolist(), strict=True):
            if time < 0.0:
                continue  # filled in when the next sample is there
            delay, lag = (course.dead_time, time) if course.is_lag else (time, 0.0)
            exact = np.imag(np.exp(1j * omega * (times - delay)) / (1.0 + 1j * omega * lag))
            assert np.abs(forms[settled, form] - exact[settled]).max() < 0.12 * (omega * STEP) ** 3, (course, time)


def test_where_a_sample_is_missing_a_lag_goes_on_straight_lines_and_settles():
    times = np.delete(np.arange(0.0, 4.0, STEP), [40, 41, 60])
    forms = followed(np.where(times > 1.0, 0.2, 0.0), times)
    assert np.isfinite(forms).all()
    np.testing.assert_allclose(forms[-1, :], 0.2, atol=1e-5)
    assert forms.min() > -0.03 and forms.max() < 0.23  # a parabola leaves a step by an eighth of it
