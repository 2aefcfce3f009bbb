"""A DataFlash file with two boots, one whose IMU is in ACC and GYR, and one with a damaged format."""

import numpy as np
import pytest
from autopilot_log_files import dataflash
from test_autopilot_import import COUNT, FORMATS, UNIX, check_motion, dataflash_rows, of_kind, run_import

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.recordings.dataflash_import import import_dataflash
from aircraft_sysid_ros.samples import Kind


@pytest.mark.parametrize("first", [True, False])
def test_of_two_boots_the_longest_is_read_and_not_both_mixed(tmp_path, first):
    """They had been sorted by time: two flights in one, of which the check said that stamps are too coarse."""
    rows = dataflash_rows()
    part = rows[: 2 * len(rows) // 3]
    log = tmp_path / "flight.bin"
    log.write_bytes(dataflash(FORMATS, [*rows, *part] if first else [*part, *rows]))
    report, recording = run_import(log, tmp_path / "bag")
    check_motion(recording, UNIX, height=1e-2)
    assert any("holds 2 boots: the longest" in note for note in report["notes"])


def test_a_damaged_time_is_no_boot(tmp_path):
    rows = dataflash_rows()
    at = next(i for i in range(len(rows) // 2, len(rows)) if rows[i][0] == "IMU")
    rows[at] = ("IMU", (rows[at][1][0] + 50_000_000, *rows[at][1][1:]))
    log = tmp_path / "flight.bin"
    log.write_bytes(dataflash(FORMATS, rows))
    report, recording = run_import(log, tmp_path / "bag")
    assert not any("boots" in note for note in report["notes"])
    assert len(of_kind(recording, Kind.IMU)) == COUNT
    assert np.all(np.isfinite(of_kind(recording, Kind.IMU).values[:, :6]))


def test_what_imu_raw_writes_is_named(tmp_path):
    formats = {name: form for name, form in FORMATS.items() if name != "IMU"}
    formats |= {
        "ACC": ("QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"),
        "GYR": ("QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"),
    }
    rows = [row for row in dataflash_rows() if row[0] != "IMU"]
    rows += [(name, (1000 * k, 0, 1000 * k, 0.0, 0.0, -9.8)) for k in range(200) for name in ("ACC", "GYR")]
    log = tmp_path / "flight.bin"
    log.write_bytes(dataflash(formats, rows))
    imported = import_dataflash(log)
    assert "set IMU, which writes both" in " ".join(imported.notes)
    with pytest.raises(InputError, match="A3 95"):
        import_dataflash(tmp_path / __file__)


@pytest.mark.parametrize("at", [0, 2])
def test_a_format_that_is_damaged_takes_its_own_messages_and_no_others(tmp_path, at):
    """pymavlink reads nothing of a log with one of them."""
    content = bytearray(dataflash(FORMATS, dataflash_rows()))
    letters = content.index(b"BARO") + len("BARO")
    content[letters + at] = ord("v")
    log = tmp_path / "flight.bin"
    log.write_bytes(content)
    report, recording = run_import(log, tmp_path / "bag")
    check_motion(recording, UNIX, height=1e-2)
    assert "the layout of BARO is damaged: none of those could be read" in " ".join(report["notes"])
