"""What servo outputs mean, for whatever kind of log a fleet finds: as `import` and `explain` take it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from aircraft_sysid_ros.commands.main import main
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.fleet import flight_task
from aircraft_sysid_ros.fleet.flight_task import Job, Options
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.samples import Kind

SERVOS = "outputs:\n  1: {surface: aileron, us: [1100, 1500, 1900], deg: [20, 0, -20]}\n"
_COUNT = 400


def write_table(path: Path, columns: dict[str, np.ndarray]) -> None:
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n")


def ulog2csv(folder: Path) -> Path:
    folder.mkdir()
    stamp = 7_000_000 + np.arange(_COUNT) * 50_000
    vectors = {f"{name}[{i}]": np.full(_COUNT, -9.8 if (name[0], i) == ("a", 2) else 0.01 * i)
               for name in ("gyro_rad", "accelerometer_m_s2") for i in range(3)}  # fmt: skip
    write_table(folder / "x_sensor_combined_0.csv", {"timestamp": stamp, **vectors})
    pulses = {f"output[{i}]": np.full(_COUNT, 1300.0 + 400.0 * i) for i in range(2)}
    write_table(folder / "x_actuator_outputs_0.csv", {"timestamp": stamp, **pulses})
    return folder


def paparazzi(folder: Path) -> Path:
    folder.mkdir()
    lines = [
        f"{20 + 0.05 * i:.4f} 3 {words}"
        for i in range(_COUNT)
        for words in ("IMU_GYRO 0.0 0.01 0.02", "IMU_ACCEL 0.0 0.0 -9.8", "ACTUATORS 1300,1700")
    ]
    (folder / "x.data").write_text("\n".join(lines) + "\n")
    return folder / "x.data"


def looked_at(tmp_path: Path, log: Path, aircraft: Path, is_log: bool = True, columns: Path | None = None):
    """Recording of a flight of a fleet with servos, and what is said of them."""
    (tmp_path / "servos.yaml").write_text(SERVOS)
    options = Options(0, columns, tmp_path / "servos.yaml")
    job = Job("key", log, is_log, aircraft, options, flight_task.program_key())
    _, recording, unread = flight_task._checked(job, tmp_path / "imported")
    return recording, unread


@pytest.mark.long
@pytest.mark.parametrize("kind", [ulog2csv, paparazzi])
def test_servos_are_read_with_tables_that_say_what_they_are(kind, tmp_path, aircraft_file):
    """A folder has no ending that says whose log it is; its surfaces had been missing."""
    recording, unread = looked_at(tmp_path, kind(tmp_path / "log"), Path(aircraft_file))
    samples = read_recording(recording).samples
    aileron = samples.values[samples.kind == Kind.CONTROLS][:, 1]
    np.testing.assert_allclose(aileron, np.radians(10.0), atol=1e-6)
    assert unread == ""


def test_servos_that_say_nothing_of_a_flight_are_told(tmp_path, aircraft_file, monkeypatch):
    log = ulog2csv(tmp_path / "log") / "x_sensor_combined_0.csv"
    signals = {f"{vector}.{axis}": {"column": f"{name}[{i}]", "unit": unit}
               for vector, name, unit in (("angular_velocity", "gyro_rad", "rad/s"),
                                          ("specific_force", "accelerometer_m_s2", "m/s^2"))
               for i, axis in enumerate("xyz")}  # fmt: skip
    (tmp_path / "map.yaml").write_text(
        yaml.safe_dump({"tables": [{"time": {"column": "timestamp", "unit": "us"}, "signals": signals}]})
    )
    recording, unread = looked_at(tmp_path, log, Path(aircraft_file), columns=tmp_path / "map.yaml")
    assert recording == tmp_path / "imported"
    assert unread == "servos.yaml is not read: the map itself gives units and signs"
    _, unread = looked_at(tmp_path, recording, Path(aircraft_file), is_log=False)
    assert unread == "servos.yaml is not read: a recording itself holds its deflections"
    taken = []
    monkeypatch.setattr(flight_task, "import_log", lambda log, out, **options: taken.append(options))
    monkeypatch.setattr(flight_task, "check_recording", lambda place, aircraft: _Checked())
    _, unread = looked_at(tmp_path, tmp_path / "flight.mat", tmp_path)
    assert unread == "servos.yaml is not read: a .mat file needs none"
    assert taken == [{}]


@pytest.mark.long
def test_a_bag_of_an_autopilot_is_imported_and_another_is_refused_as_it_was(tmp_path, aircraft_file, monkeypatch):
    assert main(["simulate", "--out", str(tmp_path / "ours"), "--duration", "20"]) == 0
    bag, taken = tmp_path / "px4.mcap", []
    bag.write_text("no recording")
    with pytest.raises(InputError, match="is not an MCAP file"):
        looked_at(tmp_path, bag, Path(aircraft_file), is_log=False)

    def take(log, out, **options):
        taken.append((log, options))
        Path(out).symlink_to(tmp_path / "ours")

    monkeypatch.setattr(flight_task, "import_log", take)
    _, unread = looked_at(tmp_path, bag, Path(aircraft_file), is_log=False, columns=tmp_path / "map.yaml")
    assert taken == [(bag, {"calibration": str(tmp_path / "servos.yaml")})] and unread == ""


class _Checked:
    json: dict[str, object] = {}  # noqa: RUF012


def test_a_bag_of_mavros_is_a_log_and_a_map_is_not_for_it(monkeypatch, tmp_path):
    given = []
    monkeypatch.setattr(flight_task, "is_autopilot_bag", lambda recording: True)
    monkeypatch.setattr(flight_task, "import_log", lambda recording, out, **options: given.append(options))
    monkeypatch.setattr(flight_task, "check_recording", lambda recording, aircraft: recording)
    (tmp_path / "bag.mcap").touch()
    options = Options(0, map=tmp_path / "map.yaml", servos=tmp_path / "servos.yaml")
    job = Job("key", tmp_path / "bag.mcap", False, tmp_path / "plane.yaml", options, "program")
    checked, _, unread = flight_task._checked(job, tmp_path / "imported")
    assert checked == tmp_path / "imported" and not unread
    assert given == [{"calibration": str(tmp_path / "servos.yaml")}]
