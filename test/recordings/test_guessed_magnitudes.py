"""Units that magnitudes alone tell, high up and near the meridian of Greenwich."""

import numpy as np
import pytest
import strange_layouts as layouts

from aircraft_sysid_ros.recordings.tabular.guess.first_map import guess_map

TIME = 0.05 * np.arange(400)


def lines(folder, **columns):
    layouts.write_rows(folder / "log.csv", ["time_s", "p", *columns], [TIME, np.sin(TIME), *columns.values()])
    (part,) = guess_map(folder / "log.csv").parts
    return {line.column: line for line in part.lines}


@pytest.mark.parametrize(
    ("pressure", "alt", "unit"),
    [
        (577.5, 4500.0, "hPa"), (577.5, 14_764.0, "hPa"),  # m, ft
        (577.5, 2250.0, "mmHg"), (577.5, None, "?"),
        (577.5, 120.0, "?"),  # over the place of the start, which may be anywhere
        (1000.0, None, "hPa"), (1000.0, 350.0, "hPa"), (29.9, None, "inHg"), (14.6, None, "psi"), (380.0, None, "?"),
        (57.75, None, "kPa"),
    ],
)  # fmt: skip
def test_a_pressure_has_the_unit_that_fits_to_the_altitude_or_fits_alone(tmp_path, pressure, alt, unit):
    """Millibars from 3.3 km upwards were millimetres of mercury, and sure."""
    columns = {} if alt is None else {"alt": alt + 5.0 * np.sin(0.3 * TIME)}
    assert lines(tmp_path, ps=pressure + 0.1 * np.sin(0.3 * TIME), **columns)["ps"].unit == unit


@pytest.mark.parametrize(("lat", "lon"), [(52.0, -1.5), (0.3, 32.0)])
def test_latitude_and_longitude_have_one_unit(tmp_path, lat, lon):
    """A longitude below 3.14 may be in radians; beside a latitude of 52 it is not."""
    found = lines(tmp_path, lat=lat + 1e-5 * TIME, lon=lon + 1e-5 * TIME)
    assert [(found[name].unit, found[name].active) for name in ("lat", "lon")] == [("deg", True)] * 2


def test_an_empty_latitude_is_said_to_be_empty(tmp_path):
    assert lines(tmp_path, lat=np.full(400, np.nan))["lat"].evidence == "it holds no numbers"
