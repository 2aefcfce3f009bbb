"""Flights in layouts of others give the samples that they were made from."""

from __future__ import annotations

import numpy as np
import pytest
import strange_layouts as layouts

from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.tables import read_table
from aircraft_sysid_ros.recordings.tabular.column_map import parse_column_map
from aircraft_sysid_ros.recordings.tabular.table_import import import_tables
from aircraft_sysid_ros.samples import Kind


@pytest.fixture(scope="module")
def flown(flight):
    return layouts.Flown(flight)


def expected(flown):
    """Stamps and values by kind, as the flight's own recording has them."""
    place = np.concatenate([np.radians(flown.place[:, :2]), flown.place[:, 2:]], axis=1)
    controls = np.stack(list(flown.controls.values()), axis=1)
    air = np.stack([flown.air["air_density"], flown.air["static_pressure"]], axis=1)
    return {
        Kind.IMU: (flown.stamp["imu/data"], np.concatenate([flown.force, flown.rate], axis=1)),
        Kind.GPS_POSITION: (flown.stamp["gps/fix"], place),
        Kind.GPS_VELOCITY: (flown.stamp["gps/vel"], flown.velocity),
        Kind.AIRSPEED: (flown.stamp["air_data"], flown.air["true_airspeed"][:, None]),
        Kind.ANGLE_OF_ATTACK: (flown.stamp["air_data"], flown.air["angle_of_attack"][:, None]),
        Kind.SIDESLIP: (flown.stamp["air_data"], flown.air["sideslip"][:, None]),
        Kind.AIR: (flown.stamp["air_data"], air),
        Kind.CONTROLS: (flown.stamp["control_surfaces"], controls),
    }


def imported(source, text, tmp_path):
    report = import_tables(source, parse_column_map(text), tmp_path / "bag")
    recording = read_recording(tmp_path / "bag")
    return report, recording.samples, recording


BY_GPS = (Kind.IMU, Kind.GPS_POSITION, Kind.GPS_VELOCITY)
#: Layout, kinds that it has, and to what [ns] a stamp is rounded in it.
LAYOUTS = [
    (
        layouts.flight_test_csv,
        (*BY_GPS, Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP, Kind.AIR, Kind.CONTROLS),
        2000,
    ),
    (layouts.ulog2csv_folder, (*BY_GPS, Kind.AIRSPEED), 1000),
    (layouts.rostopic_folder, (*BY_GPS, Kind.AIRSPEED), 0),
    (layouts.mat_7_3, (*BY_GPS, Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK), 2000),
    (layouts.excel_book, (*BY_GPS, Kind.AIRSPEED), 2000),
    (layouts.ascii_columns, BY_GPS, 2000),
]


@pytest.mark.parametrize(("layout", "kinds", "rounding"), LAYOUTS, ids=[each[0].__name__ for each in LAYOUTS])
def test_a_layout_of_others_gives_the_samples_of_the_flight(flown, tmp_path, layout, kinds, rounding):
    report, samples, _ = imported(*layout(flown, tmp_path), tmp_path)
    for kind in kinds:
        stamp, values = expected(flown)[kind]
        found = samples[samples.kind == kind]
        assert len(found) == len(stamp), f"{kind.name}: {report['notes']}"
        assert np.abs(found.stamp - stamp).max() <= rounding, kind.name
        np.testing.assert_allclose(
            found.values[:, : values.shape[1]], values, rtol=1e-8, atol=6e-4 if kind is Kind.GPS_POSITION else 1e-9
        )
        if kind is Kind.GPS_POSITION:
            np.testing.assert_allclose(found.values[:, :2], values[:, :2], rtol=0.0, atol=2e-9)
    assert set(samples.kind) - {Kind.CONTROLS} <= {*kinds}


def test_a_table_of_every_second_sample_has_those(flown, tmp_path):
    _, samples, _ = imported(*layouts.parquet_table(flown, tmp_path), tmp_path)
    np.testing.assert_array_equal(samples.stamp, flown.stamp["imu/data"][::2])
    np.testing.assert_allclose(
        samples.values[:, :6], np.concatenate([flown.force, flown.rate], axis=1)[::2], rtol=1e-15
    )


def test_what_has_no_topic_of_its_own_is_carried_by_name(flown, tmp_path):
    report, _, _ = imported(*layouts.excel_book(flown, tmp_path), tmp_path)
    tab = read_table(tmp_path / "bag", "inputs").fields
    assert [list(names) for names in tab["name"][:1]] == [["trim_tab"]]
    found = np.array([values[0] for values in tab["position"]])
    np.testing.assert_allclose(found, 2.0 * flown.controls["elevator"], rtol=1e-9)
    assert report["topics"]["inputs"]["messages"] == len(found)
