"""Every message's units and frames, through real packets of pymavlink."""

from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from pymavlink.generator.mavcrc import x25crc

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.assembler import Assembler
from aircraft_sysid_ros.mavlink.dataflash_table import DATAFLASH
from aircraft_sysid_ros.mavlink.decoder import Decoder, batch_of, fields_of
from aircraft_sysid_ros.mavlink.esc_status import EscStatus
from aircraft_sysid_ros.mavlink.mavlink_table import MAVLINK
from aircraft_sysid_ros.mavlink.px4_listener import wanted_fields
from aircraft_sysid_ros.mavlink.px4_table import PX4
from aircraft_sysid_ros.mavlink.quantities import (
    FIX_STATUS,
    Batch,
    Quantity,
    Reading,
    first_of_most,
    readings_of,
    with_receiver,
)
from aircraft_sysid_ros.mavlink.servo_mapping import servo_mapping_from_dict
from aircraft_sysid_ros.recordings.autopilot_log import assembled, topics_of, what_is_missing
from aircraft_sysid_ros.ros_messages.conversion import to_samples

STAMP = 1_760_000_000_123_456_789
G = 9.80665


def readings(message):
    """What the table makes of a message that went through the wire."""
    (received,) = Decoder().decode(Decoder().encode(message))
    batch = batch_of(received.get_type(), STAMP, fields_of(received))
    return {reading.quantity: reading.values[0] for reading in readings_of(MAVLINK, batch)}


def outputs(assembler, message):
    (received,) = Decoder().decode(Decoder().encode(message))
    return assembler.take(readings_of(MAVLINK, batch_of(received.get_type(), STAMP, fields_of(received))))


def test_imu_messages_agree_on_the_same_motion():
    """1 g up, nose up at 0.5 rad/s, field north and down: milli-g, mrad/s, mgauss, gauss, SI."""
    motion = (0.1, 0.2, -G, 0.0, 0.5, 0.0)
    highres = readings(dialect.MAVLink_highres_imu_message(1, *motion, 0.2, 0.0, 0.45, 970, 2, 0, 25, 63))
    raw = readings(dialect.MAVLink_raw_imu_message(1, 10, 20, -1000, 0, 500, 0, 200, 0, 450))
    scaled = readings(dialect.MAVLink_scaled_imu_message(1, 10, 20, -1000, 0, 500, 0, 200, 0, 450))
    for found in (highres, raw, scaled):
        np.testing.assert_allclose(found[Quantity.IMU], [0.1, 0.2, -G, 0.0, 0.5, 0.0], atol=5e-3)
        np.testing.assert_allclose(found[Quantity.MAGNETIC_FIELD], [2e-5, 0.0, 4.5e-5], atol=1e-10)
    np.testing.assert_allclose(highres[Quantity.PRESSURE], [97_000.0, 298.15], rtol=1e-6)
    assert not readings(dialect.MAVLink_raw_imu_message(1, 0, 0, -1000, 0, 0, 0, 0, 0, 0, id=1)).get(Quantity.IMU)


def test_gps():
    message = dialect.MAVLink_gps_raw_int_message(
        1, 3, 445_000_000, -932_500_000, 310_500, 80, 120, 1500, 32313, 12, 0, 1000, 2000, 100
    )
    found = readings(message)
    np.testing.assert_allclose(found[Quantity.POSITION][:3], [np.radians(44.5), np.radians(-93.25), 310.5], rtol=1e-12)
    np.testing.assert_allclose(found[Quantity.POSITION][3:6], [0.5, 0.5, 4.0], rtol=1e-12)  # of a radius of 1 m
    north, east, down = found[Quantity.VELOCITY]
    np.testing.assert_allclose((north, east), (12.0, -9.0), atol=2e-3)  # course 323.13 deg
    assert np.isnan(down)
    nothing = readings(dialect.MAVLink_gps_raw_int_message(1, 1, 0, 0, 0, 65535, 65535, 65535, 65535, 0))
    assert np.isnan(nothing[Quantity.POSITION][:6]).all() and Quantity.VELOCITY not in nothing
    place = (445_000_000, -932_500_000, 310_500)
    own = readings(dialect.MAVLink_global_position_int_message(1, *place, 0, 1200, -900, 150, 0))
    np.testing.assert_allclose(own[Quantity.VELOCITY], [12.0, -9.0, 1.5], rtol=1e-12)
    np.testing.assert_allclose(own[Quantity.DESCENT], [1.5])


def test_the_field_of_ardupilot_up_to_4_6_is_brought_back_to_gauss():
    """It sends milligauss times 1000 as gauss (ardupilot pull request 32286)."""
    motion = (0.0, 0.0, -G, 0.0, 0.0, 0.0)
    found = readings(dialect.MAVLink_highres_imu_message(1, *motion, 2e5, -1e4, 4.5e5, 970, 0, 0, 25, 63))
    np.testing.assert_allclose(found[Quantity.MAGNETIC_FIELD], [2e-5, -1e-6, 4.5e-5], rtol=1e-6)


def test_what_a_slow_sensor_shows_is_told_once():
    """ArduPilot sends IMU messages at the rate asked for with the field and the airspeed that it last read."""
    assembler, motion, made = Assembler(MAVLINK), (0.0, 0.0, -G, 0.0, 0.0, 0.0), []
    outputs(assembler, pressure())
    for k in range(20):
        slow = k // 10
        imu = dialect.MAVLink_highres_imu_message(1, *motion, 0.2, 0.01 * slow, 0.45, 0, 0, 0, 25, 63)
        hud = dialect.MAVLink_vfr_hud_message(17.0 + slow, 15.0, 90, 50, 310.0, 2.5)
        made += [o.topic for message in (hud, imu) for o in outputs(assembler, message)]
    assert (made.count("imu/data"), made.count("imu/mag"), made.count("air_data")) == (20, 2, 2)


def test_climb_is_up_and_wind_is_where_it_goes():
    hud = readings(dialect.MAVLink_vfr_hud_message(17.0, 15.0, 90, 50, 310.0, 2.5))
    np.testing.assert_allclose(hud[Quantity.DESCENT], [-2.5])
    wind = readings(dialect.MAVLink_wind_message(270.0, 5.0, 0.5))[Quantity.WIND]  # from the west
    np.testing.assert_allclose(wind[:3], [0.0, 5.0, 0.5], atol=1e-6)
    cov = readings(dialect.MAVLink_wind_cov_message(1, 3.0, -2.0, 0.1, 9.0, 9.0, 300.0, 0.5, 0.25))[Quantity.WIND]
    np.testing.assert_allclose(cov, [3.0, -2.0, 0.1, 0.25, 0.25, 0.0625], rtol=1e-6)


def test_attitude_messages_agree():
    """Rolled right 10, nose up 5, heading 90 deg: the same turn as Euler angles and as a quaternion."""
    roll, pitch, yaw = np.radians([10.0, 5.0, 90.0])
    euler = readings(dialect.MAVLink_attitude_message(1, roll, pitch, yaw, 0, 0, 0))[Quantity.ATTITUDE]
    quaternion = readings(dialect.MAVLink_attitude_quaternion_message(1, *euler, 0, 0, 0))[Quantity.ATTITUDE]
    np.testing.assert_allclose(euler, quaternion, atol=1e-7)
    w, x, y, z = euler
    nose = [w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)]
    np.testing.assert_allclose(nose, [0.0, np.cos(pitch), -np.sin(pitch)], atol=1e-6)


def test_servos_engines_and_angles():
    pulses = [1100 + 10 * i for i in range(16)]
    pulses[4], pulses[5] = 0, 65535
    found = readings(dialect.MAVLink_servo_output_raw_message(1, 0, *pulses))[Quantity.PULSES]
    assert np.isnan(found[4]) and np.isnan(found[5]) and found[0] == 1100 and found[15] == 1250
    assert Quantity.PULSES not in readings(dialect.MAVLink_servo_output_raw_message(1, 1, *pulses))  # the second bank
    values = [1100.0, 1200.0, 1300.0] + [0.0] * 29
    actuators = readings(dialect.MAVLink_actuator_output_status_message(1, 0b101, values))
    np.testing.assert_array_equal(actuators[Quantity.PULSES][:3], [1100.0, np.nan, 1300.0])
    rpm = readings(dialect.MAVLink_rpm_message(6000.0, -1.0))[Quantity.PROPELLER]
    np.testing.assert_array_equal(rpm, [6000.0, np.nan])
    esc = readings(EscStatus(4, 1, [1, 2, 3, 4], [0.0] * 4, [0.0] * 4))[Quantity.PROPELLER]
    np.testing.assert_array_equal(esc[4:8], [1, 2, 3, 4])
    zeros = [0] * 4
    four = readings(dialect.MAVLink_esc_telemetry_1_to_4_message(zeros, zeros, zeros, zeros, [7, 8, 9, 10], zeros))
    np.testing.assert_array_equal(four[Quantity.PROPELLER], [7, 8, 9, 10])
    angles = readings(dialect.MAVLink_aoa_ssa_message(1, 4.0, -3.0))
    assert angles[Quantity.ANGLE_OF_ATTACK][0] == pytest.approx(np.radians(4.0))
    assert angles[Quantity.SIDESLIP][0] == pytest.approx(np.radians(-3.0))


def test_esc_status_is_as_the_common_dialect_defines_it():
    crc = x25crc()
    crc.accumulate_str("ESC_STATUS ")
    kinds = {"time_usec": "uint64_t", "rpm": "int32_t", "voltage": "float", "current": "float", "index": "uint8_t"}
    for name in EscStatus.ordered_fieldnames:
        crc.accumulate_str(f"{kinds[name]} {name} ")
        if name in ("rpm", "voltage", "current"):
            crc.accumulate([4])
    assert EscStatus.crc_extra == (crc.crc & 0xFF) ^ (crc.crc >> 8)
    assert EscStatus.instance_offset == 56 and EscStatus.unpacker.size == 57


# -- what is made of several messages -----------------------------------------------------------------------------


def pressure(hectopascal=970.0):
    return dialect.MAVLink_scaled_pressure_message(1, hectopascal, 1.8, 3500)


@pytest.mark.parametrize(
    ("settings", "message", "expected"),
    [
        ({"meaning": "true"}, dialect.MAVLink_vfr_hud_message(20.0, 0, 0, 0, 0, 0), 20.0),
        ({}, dialect.MAVLink_vfr_hud_message(20.0, 0, 0, 0, 0, 0), 20.0 * np.sqrt(1.225 / 1.1825)),
        ({"meaning": "equivalent"}, dialect.MAVLink_airspeed_message(0, 20.0, 0, 0, 0), 20.0 * np.sqrt(1.225 / 1.1825)),
        ({"scale": 1.1, "offset": -1.0, "meaning": "true"}, dialect.MAVLink_vfr_hud_message(20.0, 0, 0, 0, 0, 0), 21.0),
        ({"source": "SCALED_PRESSURE"}, pressure(), np.sqrt(2 * 180.0 / 1.1825)),
    ],
)
def test_airspeed_is_what_the_calibration_says_it_means(settings, message, expected):
    """Density at 970 hPa and its standard temperature is 1.1825 kg/m^3 (ISO 2533, 365 m)."""
    assembler = Assembler(MAVLINK, servo_mapping_from_dict({"airspeed": settings}))
    first = outputs(assembler, pressure())
    made = first if settings.get("source") == "SCALED_PRESSURE" else outputs(assembler, message)
    (air,) = [o for o in made if np.isfinite(o.fields["true_airspeed"][0])]
    assert air.fields["true_airspeed"][0] == pytest.approx(expected, rel=5e-4)  # compressibility is 3e-4
    assert air.fields["air_density"][0] == pytest.approx(1.1825, rel=3e-4)


def test_an_airspeed_that_is_an_estimate_is_not_passed_off_as_measured():
    """SYS_STATUS says whether there is a sensor."""
    assembler = Assembler(MAVLINK)
    outputs(assembler, pressure())
    outputs(assembler, dialect.MAVLink_sys_status_message(0x2F, 0x2F, 0x2F, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0))
    made = outputs(assembler, dialect.MAVLink_vfr_hud_message(20.0, 0, 0, 0, 0, 0))
    assert not [o for o in made if o.topic == "air_data"]


def test_an_airspeed_of_a_sensor_that_is_not_healthy_is_none():
    """ArduPilot shows an estimate in VFR_HUD then, and marks AIRSPEED."""
    assembler = Assembler(MAVLINK)
    outputs(assembler, pressure())
    for health, count in ((0x3F, 1), (0x2F, 0)):
        outputs(assembler, dialect.MAVLink_sys_status_message(0x3F, 0x3F, health, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0))
        made = outputs(assembler, dialect.MAVLink_vfr_hud_message(20.0 + count, 0, 0, 0, 0, 0))
        assert len([o for o in made if o.topic == "air_data"]) == count
    flags = dialect.AIRSPEED_SENSOR_UNHEALTHY | dialect.AIRSPEED_SENSOR_USING
    assert not readings(dialect.MAVLink_airspeed_message(0, 20.0, 0, 0, flags))
    healthy = dialect.MAVLink_airspeed_message(0, 23.0, 0, 0, dialect.AIRSPEED_SENSOR_USING)
    (made,) = outputs(assembler, healthy)  # SYS_STATUS is of all sensors, and another one has failed
    assert made.source.startswith("AIRSPEED") and len(made.stamp) == 1


@pytest.mark.parametrize(("topic", "angle"), [("airflow_aoa", "aoa_rad"), ("airflow_slip", "slip_rad")])
def test_a_vane_beyond_its_range_says_nothing(topic, angle):
    """PX4 says so beside the angle."""
    fields = {angle: np.array([0.1, 0.7, 0.2]), "valid": np.array([1, 0, 1], np.uint8)}
    (reading,) = readings_of(PX4, Batch(topic, np.arange(3), fields))
    assert reading.stamp.tolist() == [0, 2] and reading.values[:, 0].tolist() == [0.1, 0.2]
    (whole,) = readings_of(PX4, Batch(topic, np.arange(3), {angle: fields[angle]}))
    assert len(whole.stamp) == 3 and "valid" in wanted_fields(topic)


def test_an_angle_of_the_autopilot_is_used_only_where_a_vane_is_said_to_be_behind_it():
    message = dialect.MAVLink_aoa_ssa_message(1, 4.0, -3.0)
    assert not outputs(Assembler(MAVLINK), message)
    (both,) = outputs(Assembler(MAVLINK, servo_mapping_from_dict({"flow_angles": "measured"})), message)
    angles = [both.fields[name][0] for name in ("angle_of_attack", "sideslip")]
    np.testing.assert_allclose(angles, np.radians([4.0, -3.0]), rtol=1e-6)
    assert np.isnan(both.fields["true_airspeed"][0])


def test_a_receiver_without_a_vertical_speed_has_none():
    """As those of NMEA, of which autopilots write 0: a climb had a measured speed of 0."""
    kinds, place = np.array([1, 3, 3, 3]), {"Lat": np.full(4, 44.5), "Lng": np.full(4, 11.0), "Alt": np.full(4, 300.0)}
    dataflash = {"Status": kinds, **place, "Spd": np.full(4, 10.0), "GCrs": np.zeros(4), "VZ": np.zeros(4)}
    kinds = np.full(3, 3)
    px4 = {"fix_type": kinds, "vel_n_m_s": np.full(3, 10.0), "vel_e_m_s": np.zeros(3), "vel_d_m_s": np.zeros(3)}
    for table, name, fields in ((DATAFLASH, "GPS", dataflash), (PX4, "sensor_gps", px4)):
        batch = Batch(name, np.arange(len(next(iter(fields.values())))), fields)
        velocity = next(r for r in readings_of(table, batch) if r.quantity is Quantity.VELOCITY)
        np.testing.assert_array_equal(velocity.values, [[10.0, 0.0, np.nan]] * 3)
        made, _ = assembled([velocity], table, servo_mapping_from_dict({}))
        assert not sum(len(output.stamp) for output in made)
    px4 |= {"vel_d_m_s": np.array([1.0, 0.0, 2.0]), "vel_ned_valid": np.array([1, 1, 0], np.uint8)}
    (velocity,) = readings_of(PX4, Batch("sensor_gps", np.arange(3), px4))
    np.testing.assert_array_equal(velocity.values, [[10.0, 0.0, 1.0], [10.0, 0.0, 0.0]])


@pytest.mark.parametrize("is_live", [True, False])
@pytest.mark.parametrize(("age", "source"), [(0.1, "GPS_RAW_INT"), (0.9, "GLOBAL_POSITION_INT")])
def test_a_slow_link_has_velocities(age, source, is_live):
    """Both once in a second: of a vertical part that is too old there was no velocity at all."""
    messages = {
        "GPS_RAW_INT": dialect.MAVLink_gps_raw_int_message(1, 3, *PLACE, 80, 120, 1500, 32000, 12),
        "GLOBAL_POSITION_INT": dialect.MAVLink_global_position_int_message(1, *PLACE, 0, 1100, -900, -100, 0),
    }
    due = sorted((k + (age if name == "GPS_RAW_INT" else 0.0), name) for k in range(20) for name in messages)
    heard = []
    for t, name in due:
        (received,) = Decoder().decode(Decoder().encode(messages[name]))
        heard.append(readings_of(MAVLINK, batch_of(name, STAMP + round(t * 1e9), fields_of(received))))
    if is_live:
        assembler = Assembler(MAVLINK)
        made = [output for each in heard for output in assembler.take(each)]
    else:
        joined = {}
        for reading in (reading for each in heard for reading in each):
            joined.setdefault((reading.quantity, reading.source), []).append(reading)
        whole = [
            replace(r[0], stamp=np.concatenate([o.stamp for o in r]), values=np.concatenate([o.values for o in r]))
            for r in joined.values()
        ]
        made, _ = assembled(whole, MAVLINK, servo_mapping_from_dict({}))
    velocities = [output for output in made if output.topic == "gps/vel"]
    assert velocities[-1].source.startswith(source) and sum(len(output.stamp) for output in velocities) >= 19
    np.testing.assert_allclose(velocities[-1].fields["twist.linear"][-1, 2], 1.0)


PLACE = (445_000_000, -932_500_000, 310_500)


def fix_message(fix_type):
    return dialect.MAVLink_gps_raw_int_message(1, fix_type, *PLACE, 80, 120, 1500, 0, 12)


@pytest.mark.parametrize(
    ("fix_type", "status"),
    [
        (dialect.GPS_FIX_TYPE_NO_FIX, -1), (dialect.GPS_FIX_TYPE_2D_FIX, -1), (dialect.GPS_FIX_TYPE_3D_FIX, 0),
        (dialect.GPS_FIX_TYPE_DGPS, 1), (dialect.GPS_FIX_TYPE_RTK_FLOAT, 2), (dialect.GPS_FIX_TYPE_RTK_FIXED, 2),
        (dialect.GPS_FIX_TYPE_PPP, 0),
    ],
)  # fmt: skip
def test_the_type_of_fix_becomes_the_status_and_without_one_no_place_counts(fix_type, status):
    (made,) = [o for o in outputs(Assembler(MAVLINK), fix_message(fix_type)) if o.topic == "gps/fix"]
    assert made.fields["status.status"].tolist() == [status] and made.fields["status.status"].dtype == np.int8
    (samples,) = to_samples("gps/fix", made.stamp, made.fields)
    assert np.isfinite(samples.values[0, :3]).all() == (status >= 0)


def test_logs_count_fixes_as_mavlink_does():
    kinds, n = np.array([0, 1, 2, 3, 4, 5, 6]), 7
    place = {"Lat": np.full(n, 44.5), "Lng": np.full(n, -93.25), "Alt": np.full(n, 310.5)}
    dataflash = {"Status": kinds, **place}
    numbers = {"latitude_deg": place["Lat"], "longitude_deg": place["Lng"], "altitude_msl_m": place["Alt"]}
    px4 = {"fix_type": kinds, **numbers, "eph": np.ones(n), "epv": np.ones(n)}
    for table, name, fields in ((DATAFLASH, "GPS", dataflash), (PX4, "sensor_gps", px4)):
        (position,) = (with_receiver(r, set()) for r in readings_of(table, Batch(name, np.arange(n), fields)))
        assert position.stamp.tolist() == [1, 2, 3, 4, 5, 6]  # without a receiver there is nothing to say
        assert position.values[:, FIX_STATUS].tolist() == [-1, -1, 0, 1, 2, 2]
        assert np.isfinite(position.values[:, 0]).tolist() == [False, False, True, True, True, True]


def test_one_fix_more_does_not_decide_between_receivers():
    assert first_of_most([100, 101]) == first_of_most([100, 120]) == first_of_most([0, 0]) == 0
    assert first_of_most([100, 121]) == first_of_most([0, 1]) == 1


@pytest.mark.parametrize(("kinds", "best"), [((1, 6), 1), ((3, 6), 0), ((1, 1), 0)])
def test_of_two_receivers_that_with_fixes_counts(kinds, best):
    """The first was taken, also where it was dead."""
    instance, status = np.arange(8) % 2, np.tile(kinds, 4)
    place = {"Lat": np.full(8, 44.5) + instance, "Lng": np.full(8, 11.0), "Alt": np.full(8, 300.0)}
    speed = {"Spd": 10.0 + instance, "GCrs": np.zeros(8), "VZ": np.zeros(8)}
    found = readings_of(DATAFLASH, Batch("GPS", np.arange(8), {"I": instance, "Status": status, **place, **speed}))
    assert all(reading.stamp.tolist() == [best, best + 2, best + 4, best + 6] for reading in found)
    assert len(found) == (2 if max(kinds) >= 3 else 1)


def test_without_the_first_instance_the_next_counts():
    fields = {"I": np.array([1, 2, 1, 2]), "MagX": np.arange(4.0), "MagY": np.ones(4), "MagZ": np.ones(4)}
    (field,) = readings_of(DATAFLASH, Batch("MAG", np.arange(4), fields))
    assert field.stamp.tolist() == [0, 2]


def test_without_a_receiver_there_is_no_fix_to_speak_of():
    assert not outputs(Assembler(MAVLINK), fix_message(dialect.GPS_FIX_TYPE_NO_GPS))


def test_the_filters_own_position_does_not_say_what_fix_it_has_and_counts():
    (made,) = [
        o for o in outputs(Assembler(MAVLINK), dialect.MAVLink_global_position_int_message(1, *PLACE, 0, 0, 0, 0, 0))
        if o.topic == "gps/fix"
    ]  # fmt: skip
    assert made.fields["status.status"].tolist() == [-2]
    (samples,) = to_samples("gps/fix", made.stamp, made.fields)
    assert np.isfinite(samples.values[0, :3]).all()


def test_dead_reckoning_of_the_autopilot_is_no_gps():
    """GPS lost: its filter goes on by airspeed and wind, which must not come in as a measured velocity."""
    assembler = Assembler(MAVLINK, servo_mapping_from_dict({"gps_velocity": "filtered"}))
    own = dialect.MAVLink_global_position_int_message(1, *PLACE, 0, 1490, 0, -250, 0)
    outputs(assembler, fix_message(dialect.GPS_FIX_TYPE_3D_FIX))
    assert [o.topic for o in outputs(assembler, own)] == ["gps/vel"]
    outputs(assembler, fix_message(dialect.GPS_FIX_TYPE_NO_FIX))
    assert not outputs(assembler, own)


def test_a_receiver_that_is_lost_in_flight_has_no_fix():
    """ArduPilot says then that there is none, and goes on by dead reckoning for as long as it flies."""
    for mapping in ({}, {"gps_velocity": "filtered"}):
        assembler = Assembler(MAVLINK, servo_mapping_from_dict(mapping))
        own = dialect.MAVLink_global_position_int_message(1, *PLACE, 0, 1490, 0, -250, 0)
        outputs(assembler, fix_message(dialect.GPS_FIX_TYPE_3D_FIX))
        for second in range(10):
            made = []
            for message in (fix_message(dialect.GPS_FIX_TYPE_NO_GPS), own):
                (received,) = Decoder().decode(Decoder().encode(message))
                batch = batch_of(received.get_type(), STAMP + second * 10**9, fields_of(received))
                made += assembler.take(readings_of(MAVLINK, batch))
            assert [(o.topic, o.fields["status.status"].tolist()) for o in made] == [("gps/fix", [-1])]


def reading(quantity, source, rate, values, seconds=20.0):
    """Of a log: the same values at a rate [Hz]."""
    stamp = (np.arange(0.0, seconds, 1.0 / rate) * 1e9).astype(np.int64)
    return Reading(quantity, source, stamp, np.tile(np.asarray(values, dtype=np.float64), (len(stamp), 1)))


def test_of_sources_of_one_quality_a_log_gives_the_denser():
    """PX4 logs what its receivers say once in a second, and what it chose of that as often as it comes."""
    place = [0.8, -1.6, 300.0, 1.0, 1.0, 4.0, 0.0]
    readings = [
        reading(Quantity.POSITION, "sensor_gps", 1.0, place), reading(Quantity.AIRSPEED, "airspeed", 1.0, [20.0]),
        reading(Quantity.POSITION, "vehicle_gps_position", 5.0, place),
        reading(Quantity.AIRSPEED, "airspeed_validated", 5.0, [20.0]),
    ]  # fmt: skip
    mapping = servo_mapping_from_dict({})
    made, _ = assembled(readings, PX4, mapping)
    assert [(o.source, len(o.stamp)) for o in made] == [
        ("vehicle_gps_position", 100), ("airspeed_validated (calibrated)", 100)
    ]  # fmt: skip
    without_fix = reading(Quantity.POSITION, "sensor_gps", 10.0, [np.nan] * 6 + [-1.0])
    made, _ = assembled([without_fix, *readings[1:]], PX4, mapping)
    assert {o.source for o in made if o.topic == "gps/fix"} == {"vehicle_gps_position"}
    same = [replace(each, source=name) for each, name in zip(readings[2:], ("sensor_gps", "airspeed"), strict=True)]
    made, _ = assembled([*same, *readings[2:]], PX4, mapping)
    assert {o.source for o in made} == {"sensor_gps", "airspeed (indicated)"}


def test_a_source_that_was_there_for_a_moment_does_not_hide_that_of_the_whole_flight():
    """As where a ground station asks for a message once: of the IMU of 20 s half a second was left."""
    at_rest = [0.0, 0.0, -G, 0.0, 0.0, 0.0]
    short = reading(Quantity.IMU, "HIGHRES_IMU", 50.0, at_rest, seconds=0.5)
    whole = reading(Quantity.IMU, "RAW_IMU", 10.0, at_rest)
    for readings, source in (
        ([short, whole], "RAW_IMU"),
        ([replace(whole, source="HIGHRES_IMU"), whole], "HIGHRES_IMU"),
    ):
        (made,), _ = assembled(readings, MAVLINK, servo_mapping_from_dict({}))
        assert (made.source, len(made.stamp)) == (source, 200)


def test_a_vertical_speed_that_was_there_for_a_moment_does_not_hide_that_of_the_whole_flight():
    """The receiver's velocity seemed to lack it, and the moment was all that the flight had of a velocity."""
    readings = [
        reading(Quantity.VELOCITY, "GPS_RAW_INT", 5.0, [15.0, 0.0, np.nan]),
        reading(Quantity.VELOCITY, "GLOBAL_POSITION_INT", 5.0, [14.0, 0.0, 1.0], seconds=0.5),
        reading(Quantity.DESCENT, "GLOBAL_POSITION_INT", 5.0, [1.0], seconds=0.5),
        reading(Quantity.DESCENT, "VFR_HUD", 5.0, [1.1]),
    ]
    (made,), _ = assembled(readings, MAVLINK, servo_mapping_from_dict({}))
    assert (made.source, len(made.stamp)) == ("GPS_RAW_INT, vertical of VFR_HUD", 100)


def test_a_receiver_that_waits_long_for_its_fix_gives_the_velocity_of_the_flight():
    """Its autopilot's filter tells a velocity throughout: that of the time without a fix says nothing for it."""
    place, without, since = [0.8, -1.6, 300.0, 1.0, 1.0, 4.0, 0.0], [np.nan] * 6 + [-1.0], 60
    fix = reading(Quantity.POSITION, "GPS_RAW_INT", 5.0, place)
    fix.values[:since] = without
    velocity = reading(Quantity.VELOCITY, "GPS_RAW_INT", 5.0, [15.0, 0.0, np.nan])
    velocity = replace(velocity, stamp=velocity.stamp[since:], values=velocity.values[since:])
    own = [
        reading(quantity, "GLOBAL_POSITION_INT", 5.0, values)
        for quantity, values in ((Quantity.VELOCITY, [14.0, 0.0, 1.0]), (Quantity.DESCENT, [1.0]))
    ]
    made, _ = assembled([fix, velocity, *own], MAVLINK, servo_mapping_from_dict({}))
    (found,) = (output for output in made if output.topic == "gps/vel")
    assert (found.source, len(found.stamp)) == ("GPS_RAW_INT, vertical of GLOBAL_POSITION_INT", 100 - since)
    made, _ = assembled([velocity, *own], MAVLINK, servo_mapping_from_dict({}))  # of fixes nobody says anything
    (found,) = (output for output in made if output.topic == "gps/vel")
    assert (found.source, len(found.stamp)) == ("GLOBAL_POSITION_INT", 100)


def test_outputs_beyond_16_come_in_messages_of_their_own():
    """The calibration file took their numbers, and nothing read them."""
    surface = {"us": [1000, 2000], "rad": [-0.4, 0.4]}
    outputs_of = {1: {"surface": "elevator", **surface}, 18: {"surface": "rudder", **surface}}
    assembler = Assembler(MAVLINK, servo_mapping_from_dict({"outputs": outputs_of}))
    first, second = (dialect.MAVLink_servo_output_raw_message(1, port, *[1500, 1750, *[0] * 6]) for port in (0, 1))
    (alone,) = outputs(assembler, first)
    assert np.isnan(alone.fields["rudder"][0])
    assert not outputs(assembler, second)
    (both,) = outputs(assembler, first)
    assert (both.fields["elevator"][0], both.fields["rudder"][0]) == pytest.approx((0.0, 0.2))


@pytest.mark.parametrize("correction", [{"meaning": "indicated"}, {"scale": 1.1}, {"offset": -0.5}])
def test_a_correction_of_the_airspeed_is_for_the_one_that_counts_live(correction):
    """It was put on PX4's calibrated airspeed where a log has more of that."""
    rates = {"airspeed": 1.0, "airspeed_validated": 5.0}
    readings = [reading(Quantity.POSITION, "sensor_gps", 5.0, [0.8, -1.6, 300.0, 1.0, 1.0, 4.0, 0.0])]
    readings += [reading(Quantity.AIRSPEED, source, rate, [20.0]) for source, rate in rates.items()]
    for count in (20, 8):  # and on another one where the log has this for less than half as long
        readings[1] = replace(readings[1], stamp=readings[1].stamp[:count], values=readings[1].values[:count])
        made, _ = assembled(readings, PX4, servo_mapping_from_dict({"airspeed": correction}))
        assert [(o.source, len(o.stamp)) for o in made if o.topic == "air_data"] == [("airspeed (indicated)", count)]


def test_a_log_without_any_fix_has_no_dead_reckoning_in_its_place():
    nowhere = [np.nan] * 6
    readings = [
        reading(Quantity.POSITION, "GPS_RAW_INT", 5.0, [*nowhere, -1.0]),
        reading(Quantity.POSITION, "GLOBAL_POSITION_INT", 5.0, [0.8, -1.6, 300.0, np.nan, np.nan, np.nan, -2.0]),
        reading(Quantity.VELOCITY, "GLOBAL_POSITION_INT", 5.0, [15.0, 0.0, 0.0]),
    ]
    made, assembler = assembled(readings, MAVLINK, servo_mapping_from_dict({}))
    assert {(o.topic, o.source) for o in made} == {("gps/fix", "GPS_RAW_INT")}
    why = what_is_missing(topics_of(made), readings, assembler, servo_mapping_from_dict({}))["gps/vel"]
    assert "dead reckoning" in why and "horizontal" not in why


def test_each_engine_tells_its_own_speed():
    speeds = reading(Quantity.PROPELLER, "ESC", 20.0, [np.nan, np.nan])
    speeds.values[::2, 0], speeds.values[1::2, 1] = 6000.0, 5400.0
    servos = reading(Quantity.PULSES, "RCOU", 10.0, [1500.0] * 4)
    for engine, rpm in ((1, 6000.0), (2, 5400.0)):
        mapping = servo_mapping_from_dict(
            {
                "outputs": {1: {"surface": "elevator", "us": [1000, 2000], "rad": [-0.4, 0.4]}},
                "propeller": {"engine": engine},
            }
        )
        made, _ = assembled([speeds, servos], DATAFLASH, mapping)
        (surfaces,) = (o for o in made if o.topic == "control_surfaces")
        np.testing.assert_allclose(surfaces.fields["propeller_speed"][1:], rpm * 2.0 * np.pi / 60.0)


@pytest.mark.parametrize("frozen", [False, True])
def test_the_pressure_goes_on_where_the_airspeed_falls_silent(frozen):
    """A probe that fails takes along neither the density nor the height."""
    speeds = reading(Quantity.AIRSPEED, "VFR_HUD", 5.0, [20.0], seconds=20.0 if frozen else 8.0)
    speeds.values[:40, 0] += 0.01 * np.arange(40)  # up to 8 s
    pressures = reading(Quantity.PRESSURE, "SCALED_PRESSURE", 5.0, [95000.0, 288.0])
    made, _ = assembled([speeds, pressures], MAVLINK, servo_mapping_from_dict({}))
    alone = np.concatenate([o.stamp for o in made if not np.isfinite(o.fields["true_airspeed"]).any()]) / 1e9
    assert alone[0] == pytest.approx(10.0, abs=0.3) and alone[-1] > 19.5 and len(alone) > 45


def test_an_offset_is_refused_of_an_airspeed_that_is_a_pressure():
    settings = {"airspeed": {"source": "SCALED_PRESSURE", "offset": 1.5}}
    with pytest.raises(InputError, match="offset of airspeed in the calibration file is a speed, and SCALED_PRESSURE"):
        Assembler(MAVLINK, servo_mapping_from_dict(settings))


def test_gps_velocity_waits_for_its_vertical_part_and_uses_the_newest():
    assembler = Assembler(MAVLINK)
    fix = dialect.MAVLink_gps_raw_int_message(1, 3, 445_000_000, 1, 310_500, 80, 120, 1500, 0, 12)
    assert [o.topic for o in outputs(assembler, fix)] == ["gps/fix"]
    outputs(assembler, dialect.MAVLink_global_position_int_message(1, 445_000_000, 1, 1, 0, 1490, 0, -250, 0))
    (velocity,) = [o for o in outputs(assembler, fix) if o.topic == "gps/vel"]
    np.testing.assert_allclose(velocity.fields["twist.linear"][0], [0.0, 15.0, 2.5], atol=1e-9)  # ENU
    assert velocity.source == "GPS_RAW_INT, vertical of GLOBAL_POSITION_INT"


def test_the_better_imu_goes_before_the_other_until_it_is_silent():
    assembler = Assembler(MAVLINK)
    highres = dialect.MAVLink_highres_imu_message(1, 0, 0, -G, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 63)
    raw = dialect.MAVLink_raw_imu_message(1, 0, 0, -1000, 0, 0, 0, 0, 0, 0)
    assert [o.source for o in outputs(assembler, raw)] == ["RAW_IMU"]
    assert [o.source for o in outputs(assembler, highres)] == ["HIGHRES_IMU"]
    assert not outputs(assembler, raw)
    (received,) = Decoder().decode(Decoder().encode(raw))
    late = batch_of("RAW_IMU", STAMP + 3 * 10**9, fields_of(received))
    assert [o.source for o in assembler.take(readings_of(MAVLINK, late))] == ["RAW_IMU"]


def test_the_autopilots_attitude_helps_only_when_asked_and_once():
    attitude = dialect.MAVLink_attitude_quaternion_message(1, 1, 0, 0, 0, 0, 0, 0)  # level, nose north
    imu = dialect.MAVLink_highres_imu_message(1, 0, 0, -G, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 63)
    plain, helped = Assembler(MAVLINK), Assembler(MAVLINK, servo_mapping_from_dict({"attitude": {"std": 0.1}}))
    for assembler in (plain, helped):
        (reference,) = outputs(assembler, attitude)
        assert reference.topic == "autopilot/attitude"
    (without,) = outputs(plain, imu)
    assert without.fields["orientation_covariance"][0, 0] == -1.0
    (first,), (second,) = outputs(helped, imu), outputs(helped, imu)
    assert first.fields["orientation_covariance"][0, 0] == pytest.approx(0.01)
    np.testing.assert_allclose(np.abs(first.fields["orientation"][0]), [0, 0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-9)
    assert second.fields["orientation_covariance"][0, 0] == -1.0  # the same attitude is not used twice
