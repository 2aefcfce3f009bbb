"""A telemetry log, written packet by packet as a ground station does, comes back as the samples that were flown."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.mavlink.decoder import Decoder
from aircraft_sysid_ros.recordings import tlog_import
from aircraft_sysid_ros.recordings.imported_log import write_log
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.recordings.tlog_import import import_tlog, read_tlog
from aircraft_sysid_ros.samples import Kind
from aircraft_sysid_ros.simulation.mavlink_simulator.autopilot import MavlinkSimulator
from aircraft_sysid_ros.simulation.mavlink_simulator.flight import START


def packed(arrival, packet):
    """As mavlink ground stations write: eight bytes of Unix time in us, big-endian, then the packet."""
    return round(arrival * 1e6 + START / 1000).to_bytes(8, "big") + packet


def log_of(events, mapping, *, reboot=None, until=8.0):
    """A log at full rates, and the time [s of flight] by which the ground station is late at least."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    simulator, station, rng = MavlinkSimulator(mapping), Decoder(), np.random.default_rng(2)
    station.system, station.component = 255, 190
    for name, rate in (("RAW_IMU", 100.0), ("GPS_RAW_INT", 10.0), ("GLOBAL_POSITION_INT", 50.0), ("VFR_HUD", 50.0),
                       ("SERVO_OUTPUT_RAW", 50.0)):  # fmt: skip
        simulator._rates[name].rate = rate
    data = bytearray()
    heartbeat = dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    for event in (e for e in events if e.time < until):
        if reboot is not None and simulator._began < 0.0 and event.time > reboot:
            simulator.reboot(event.time)
            for name in ("RAW_IMU", "GPS_RAW_INT", "GLOBAL_POSITION_INT"):
                simulator._rates[name].rate = 100.0
        simulator.tick(event.time)
        simulator.sense(event)
        for packet in simulator.packets():
            data += packed(event.time + 0.05 + rng.exponential(0.02), packet)
            if rng.random() < 0.01:
                data += packed(event.time, station.encode(heartbeat))
    return bytes(data)


def imported(tmp_path, data, mapping):
    log = tmp_path / "flight.tlog"
    log.write_bytes(data)
    report = write_log(import_tlog(log, mapping), log, tmp_path / "bag")
    return report, read_recording(tmp_path / "bag").samples


def imu_errors(samples, events, late=0.05):
    """Stamps less the least delay against the times at which the samples were taken [s], and the rows in the events."""
    taken = np.array([e.time for e in events if e.topic == "imu/data"])
    imu = samples[samples.kind == Kind.IMU]
    at = (imu.stamp - START) * 1e-9 - late
    rows = np.argmin(np.abs(taken[None] - at[:, None]), axis=1)
    return imu, at - taken[rows], rows


@pytest.mark.long
def test_a_telemetry_log_on_the_autopilots_own_time(tmp_path, events, mapping):
    report, samples = imported(tmp_path, log_of(events, mapping), mapping)
    imu, error, rows = imu_errors(samples, events)
    assert len(imu) > 780 and np.ptp(error) < 1e-6  # one offset for all …
    assert 0.0 <= error.mean() < 0.004  # … the least delay
    sent = [e for e in events if e.topic == "imu/data"]
    force = np.array([sent[i].fields["linear_acceleration"][0] for i in rows]) * [1.0, -1.0, -1.0]
    assert np.abs(imu.values[:, :3] - force).max() < 1.01e-3 * 9.81  # whole milli-g, cut off
    assert report["topics"]["imu/data"]["source"] == "RAW_IMU"
    assert report["found"]["HEARTBEAT"]["state"] == "unused"
    controls = samples.values[samples.kind == Kind.CONTROLS]
    assert len(controls) > 350 and np.isfinite(controls[20:, 5]).all()  # thrust comes as a named float


@pytest.mark.long
def test_outputs_with_a_name_of_their_own_are_inputs_that_terms_can_read(tmp_path, events, mapping):
    """The elevator of the simulator, by another name: the same deflections on two topics."""
    first = next(number for number, output in mapping.outputs.items() if output.surface == "elevator")
    outputs = {**mapping.outputs, first: replace(mapping.outputs[first], input="stabiliser")}
    report, samples = imported(tmp_path, log_of(events, mapping), replace(mapping, outputs=outputs))
    assert report["topics"]["inputs"]["source"] == "SERVO_OUTPUT_RAW"
    assert read_recording(tmp_path / "bag").unnamed == ("stabiliser",)
    samples = read_recording(tmp_path / "bag", [NamedInput("stabiliser")]).samples
    named, controls = (samples[samples.kind == kind] for kind in (Kind.INPUTS, Kind.CONTROLS))
    assert len(named) > 350 and np.array_equal(named.stamp, controls.stamp)
    assert np.array_equal(named.values[:, 0], controls.values[:, 0]) and np.ptp(named.values[:, 0]) > 0.01
    alone = replace(mapping, outputs={first: replace(mapping.outputs[first], surface="", input="stabiliser")})
    report = write_log(import_tlog(tmp_path / "flight.tlog", alone), tmp_path / "flight.tlog", tmp_path / "alone")
    assert "control_surfaces" not in report["topics"] and "on /inputs" in report["missing"]["control_surfaces"]


def test_a_restart_within_a_log(tmp_path, events, mapping):
    data = log_of(events, mapping, reboot=3.0, until=14.0)
    report, samples = imported(tmp_path, data, mapping)
    imu, error, _ = imu_errors(samples, events)
    assert any("restarted 1 times" in note for note in report["notes"])
    assert np.abs(error).max() < 0.01
    at = (imu.stamp - START) * 1e-9
    assert (at < 3.1).sum() > 290 and (at > 6.0).sum() > 650


def test_a_damaged_log_gives_the_rest(tmp_path, events, mapping):
    data = bytearray(log_of(events, mapping))
    middle = len(data) // 2
    data[middle : middle + 3000] = np.random.default_rng(0).integers(0, 256, 3000, np.uint8).tobytes()
    log = tmp_path / "damaged.tlog"
    log.write_bytes(data + b"\x00" * 5)
    content = read_tlog(log)
    assert any("bytes are not messages" in note for note in content.notes)
    assert content.found["RAW_IMU"] > 700


def test_a_long_log_does_not_need_forty_times_its_size(tmp_path, monkeypatch):
    """Every message was kept as an object, whoever sent it: a log of 100 MB took 4 GB."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    autopilot, data, log = Decoder(), bytearray(), tmp_path / "long.tlog"
    autopilot.system = autopilot.component = 1
    for k in range(20_000):
        imu = dialect.MAVLink_raw_imu_message(10_000 * (k + 1), k % 1000, 2, -1000, 1, 1, 1, 100, 100, 100)
        heartbeat = dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_FIXED_WING, 3, 0, 0, 4, 3)
        time = dialect.MAVLink_system_time_message(0, 10 * (k + 1))
        data += packed(0.01 * k, autopilot.encode((heartbeat, time, imu)[min(k, 2)]))
    log.write_bytes(data)
    tracemalloc.start()
    whole = read_tlog(log)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10.0 * len(data), peak / len(data)
    (imu,) = whole.batches
    assert np.array_equal(imu.fields["xacc"], np.arange(2, 20_000) % 1000) and np.all(np.diff(imu.stamp) == 10**7)
    monkeypatch.setattr(tlog_import, "_PIECE", 7)
    (other,) = read_tlog(log).batches
    assert all(np.array_equal(other.fields[name], column) for name, column in imu.fields.items())
    assert np.array_equal(other.stamp, imu.stamp)
