"""The memory of an import does not grow with the table: peaks of two sizes, each in a process of its own."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

COLUMNS = ("p", "q", "r", "fx", "fy", "fz", "tas", "alpha", "beta", "de", "vn", "ve", "vd")
UNITS = ("rad/s",) * 3 + ("m/s^2",) * 3 + ("m/s", "rad", "rad", "rad", "m/s", "m/s", "m/s")
SIGNALS = (
    *(f"angular_velocity.{axis}" for axis in "xyz"), *(f"specific_force.{axis}" for axis in "xyz"),
    "true_airspeed", "angle_of_attack", "sideslip", "elevator",
    *(f"velocity.{axis}" for axis in ("north", "east", "down")),
)  # fmt: skip
#: Pieces are small beside the table here, as pieces of 50 000 rows are beside 5 GB.
IMPORT = """
import resource, sys
from pathlib import Path
from aircraft_sysid_ros.recordings.tabular import streams, table_import
from aircraft_sysid_ros.recordings.tabular.column_map import load_column_map
streams.ROWS = 5000
report = table_import.import_tables(Path(sys.argv[1]), load_column_map(sys.argv[2]), sys.argv[3])
assert report["topics"]["imu/data"]["messages"] == int(sys.argv[4]), report
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
"""


def write_table(path, rows):
    values = 0.1 * np.random.default_rng(1).normal(size=(2000, len(COLUMNS)))
    lines = [",".join(f"{x:.4f}" for x in row) for row in values]
    with path.open("w") as file:
        file.write(",".join(("t", *COLUMNS)) + "\n")
        file.writelines(f"{0.01 * k:.2f},{lines[k % len(lines)]}\n" for k in range(rows))


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss in kB")
def test_the_peak_does_not_grow_with_the_table(tmp_path):
    mapped = [f"      {s}: {{column: {c}, unit: {u}}}\n" for s, c, u in zip(SIGNALS, COLUMNS, UNITS, strict=True)]
    (tmp_path / "map.yaml").write_text("tables:\n  - time: {column: t, unit: s}\n    signals:\n" + "".join(mapped))
    peaks = []
    for rows in (30_000, 330_000):  # 300 000 rows are 34 MB of columns and 170 MB of messages
        write_table(tmp_path / "flight.csv", rows)
        words = [tmp_path / "flight.csv", tmp_path / "map.yaml", tmp_path / f"bag{rows}", rows]
        done = subprocess.run(
            [sys.executable, "-c", IMPORT, *map(str, words)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        peaks.append(float(done.stdout))
    assert peaks[1] - peaks[0] < 12.0, peaks
    print(peaks)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag30000", "bag330000", "flight.csv", "map.yaml"]
