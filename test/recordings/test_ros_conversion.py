"""ROS to inside and back: facts that anyone can check with a hand-held aeroplane, and laws."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion, rotation_matrix
from aircraft_sysid_ros.ros_messages import conversion as ros
from aircraft_sysid_ros.samples import WIDTH, Kind, Samples

STAMP = np.array([5_000_000_007])
finite = st.floats(-1e6, 1e6)
unit_quaternions = (
    st.tuples(*[st.floats(-1, 1)] * 4)
    .map(np.array)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)


def imu(**changes):
    fields = {
        "orientation": np.array([[0.0, 0.0, 0.0, 1.0]]),
        "orientation_covariance": np.zeros((1, 9)),
        "angular_velocity": np.zeros((1, 3)),
        "angular_velocity_covariance": np.zeros((1, 9)),
        "linear_acceleration": np.zeros((1, 3)),
        "linear_acceleration_covariance": np.zeros((1, 9)),
    }
    return fields | {name: np.asarray(value, float)[None] for name, value in changes.items()}


def fix(**changes):
    fields = {
        "status.status": np.array([0]), "latitude": np.array([45.0]), "longitude": np.array([-93.0]),
        "altitude": np.array([300.0]), "position_covariance": np.zeros((1, 9)),
        "position_covariance_type": np.array([0]),
    }  # fmt: skip
    return fields | changes


def one(topic, fields) -> Samples:
    (samples,) = ros.to_samples(topic, STAMP, fields)
    return samples


def test_imu_at_rest_pushes_up():
    samples = one("imu/data", imu(linear_acceleration=[0.0, 0.0, 9.8]))
    assert samples.kind[0] == Kind.IMU
    assert samples.stamp[0] == STAMP[0]
    np.testing.assert_array_equal(samples.values[0, :3], [0.0, 0.0, -9.8])


def test_nose_up_and_right_turn_are_positive_inside():
    # FLU: nose up is a negative turn about left, a right turn is a negative turn about up
    samples = one("imu/data", imu(angular_velocity=[0.1, -0.2, -0.3]))
    np.testing.assert_array_equal(samples.values[0, 3:6], [0.1, 0.2, 0.3])


def test_imu_variance_is_the_mean_of_the_diagonal_where_it_is_known():
    diagonal = np.diag([1.0, 2.0, 6.0]).ravel()
    samples = one("imu/data", imu(linear_acceleration_covariance=diagonal))
    assert samples.values[0, 6] == 3.0
    assert np.isnan(samples.values[0, 7])
    unknown = one("imu/data", imu(linear_acceleration_covariance=-diagonal))
    assert np.isnan(unknown.values[0, 6])


@pytest.mark.parametrize("first", [-1.0, 0.0])
def test_orientation_without_covariance_is_not_used(first):
    assert [s.kind[0] for s in ros.to_samples("imu/data", STAMP, imu(orientation_covariance=[first] * 9))] == [Kind.IMU]


@pytest.mark.parametrize("orientation", [[0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.2], [np.nan, 0.0, 0.0, 1.0]])
def test_orientation_that_is_no_turn_is_not_used(orientation):
    batches = ros.to_samples("imu/data", STAMP, imu(orientation=orientation, orientation_covariance=np.eye(3).ravel()))
    assert [len(batch) for batch in batches[1:]] in ([], [0])


def attitude(orientation):
    fields = imu(orientation=orientation, orientation_covariance=0.01 * np.eye(3).ravel())
    samples = ros.to_samples("imu/data", STAMP, fields)[1]
    assert samples.kind[0] == Kind.ATTITUDE
    np.testing.assert_allclose(samples.values[0, 4:7], 0.01)
    return samples.values[0, :4]


def test_level_heading_east_is_yaw_90():
    # ROS: east is the x axis of the world, so that the turn from FLU to ENU is none at all
    np.testing.assert_allclose(euler_from_quaternion(attitude([0, 0, 0, 1])), [0, 0, np.pi / 2], atol=1e-12)


def test_level_heading_north_is_yaw_0():
    half = np.sqrt(0.5)  # nose from east to north: +90 deg about up
    np.testing.assert_allclose(euler_from_quaternion(attitude([0, 0, half, half])), [0, 0, 0], atol=1e-12)


def test_nose_up_heading_east_is_positive_pitch():
    pitch = 0.2  # nose up is a negative turn about left
    q = attitude([0, -np.sin(pitch / 2), 0, np.cos(pitch / 2)])
    np.testing.assert_allclose(euler_from_quaternion(q), [0, pitch, np.pi / 2], atol=1e-12)


def test_right_wing_down_is_positive_roll():
    roll = 0.3
    q = attitude([np.sin(roll / 2), 0, 0, np.cos(roll / 2)])
    np.testing.assert_allclose(euler_from_quaternion(q), [roll, 0, np.pi / 2], atol=1e-12)


def test_attitude_is_normalised():
    assert np.linalg.norm(attitude([0, 0, 0, 0.95])) == pytest.approx(1.0, abs=1e-15)


@given(unit_quaternions, st.tuples(finite, finite, finite))
def test_quaternion_agrees_with_vectors(q, v):
    """Turning a vector in FRD to NED is the same as turning it in FLU to ENU."""
    x, y, z, w = q
    enu = rotation_matrix(np.array([w, x, y, z])) @ np.array(v)
    ned = rotation_matrix(ros.quaternion_ned_frd(q)) @ ros.frd_from_flu(v)
    np.testing.assert_allclose(ned, ros.ned_from_enu(enu), atol=1e-9 * (1 + np.abs(v).max()))


@given(unit_quaternions)
def test_quaternion_round_trip(q):
    np.testing.assert_allclose(ros.quaternion_enu_flu(ros.quaternion_ned_frd(q)), q, atol=1e-15)


@given(st.tuples(finite, finite, finite))
def test_vector_round_trips(v):
    np.testing.assert_array_equal(ros.flu_from_frd(ros.frd_from_flu(v)), v)
    np.testing.assert_array_equal(ros.enu_from_ned(ros.ned_from_enu(v)), v)


def test_flying_east_and_climbing():
    samples = one("gps/vel", {"twist.linear": np.array([[20.0, 0.0, 3.0]])})
    assert samples.kind[0] == Kind.GPS_VELOCITY
    np.testing.assert_array_equal(samples.values[0, :3], [0.0, 20.0, -3.0])


def test_fix_is_in_radians_and_its_variance_is_north_east_down():
    covariance = np.diag([1.0, 4.0, 9.0]).reshape(1, 9)  # east, north, up
    samples = one("gps/fix", fix(position_covariance=covariance, position_covariance_type=np.array([2])))
    np.testing.assert_allclose(samples.values[0, :3], [np.pi / 4, -93 * np.pi / 180, 300.0], rtol=1e-15)
    np.testing.assert_array_equal(samples.values[0, 3:6], [4.0, 1.0, 9.0])


@pytest.mark.parametrize(("kind", "variance"), [(0, 1.0), (2, 0.0), (2, -1.0), (2, np.inf), (2, np.nan)])
def test_unknown_fix_variance_is_nan(kind, variance):
    covariance = np.diag([variance] * 3).reshape(1, 9)
    samples = one("gps/fix", fix(position_covariance=covariance, position_covariance_type=np.array([kind])))
    assert np.isnan(samples.values[0, 3:6]).all()
    assert np.isfinite(samples.values[0, :3]).all()


@pytest.mark.parametrize(
    "change", [{"status.status": np.array([-1])}, {"latitude": np.zeros(1), "longitude": np.zeros(1)}]
)
def test_no_fix_is_counted_but_useless(change):
    samples = one("gps/fix", fix(**change))
    assert len(samples) == 1
    assert np.isnan(samples.values[0, :3]).all()


@pytest.mark.parametrize("status", [-2, 0, 1, 2])
def test_a_place_counts_whose_status_is_a_fix_or_unknown(status):
    assert np.isfinite(one("gps/fix", fix(**{"status.status": np.array([status])})).values[0, :3]).all()


def test_a_driver_that_leaves_the_status_as_ros_made_it_has_a_fix():
    """STATUS_UNKNOWN in Jazzy, STATUS_FIX before."""
    messages = pytest.importorskip("sensor_msgs.msg")
    message = messages.NavSatFix(latitude=45.0, longitude=-93.0, altitude=300.0)
    (samples,) = ros.to_samples("gps/fix", *ros.message_fields("gps/fix", message))
    assert np.isfinite(samples.values[0, :3]).all()


def test_a_fix_on_the_equator_or_at_greenwich_is_a_fix():
    assert np.isfinite(one("gps/fix", fix(latitude=np.zeros(1))).values[0, :3]).all()
    assert np.isfinite(one("gps/fix", fix(longitude=np.zeros(1))).values[0, :3]).all()


def air(n, **values):
    names = ros.USED_FIELDS["air_data"]
    return {name: np.asarray(values.get(name, np.full(n, np.nan)), float) for name in names}


def test_air_data_gives_a_sample_for_each_measured_part():
    samples = ros.to_samples("air_data", STAMP, air(1, true_airspeed=[15.0], angle_of_attack=[0.1], air_density=[1.2]))
    assert [Kind(s.kind[0]) for s in samples] == [Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.AIR]
    assert [s.values[0, 0] for s in samples] == [15.0, 0.1, 1.2]
    assert np.isnan(samples[2].values[0, 1])


def test_air_data_not_measured_gives_nothing():
    assert ros.to_samples("air_data", STAMP, air(1)) == []


def test_rows_name_the_message_of_each_sample():
    ((samples, rows),) = ros.samples_and_rows("air_data", np.arange(3), air(3, sideslip=[0.1, np.nan, 0.3]))
    np.testing.assert_array_equal(rows, [0, 2])
    np.testing.assert_array_equal(samples.stamp, [0, 2])


@pytest.mark.parametrize(
    ("distance", "expected"),
    [(3.0, 3.0), (0.05, np.nan), (60.0, np.nan), (np.inf, np.nan), (-np.inf, np.nan)],
)
def test_range_outside_its_limits_is_no_height(distance, expected):
    limits = {"min_range": np.array([0.2], np.float32), "max_range": np.array([50.0], np.float32)}
    samples = one("height_above_ground", {"range": np.array([distance], np.float32), **limits})
    np.testing.assert_equal(samples.values[0, 0], expected)


def test_plain_topics_keep_order_and_sign():
    surfaces = {name: np.array([float(i)]) for i, name in enumerate(ros.USED_FIELDS["control_surfaces"])}
    np.testing.assert_array_equal(one("control_surfaces", surfaces).values[0, :7], np.arange(7))
    mass = {
        "mass": [2.0],
        "ixx": [3.0],
        "iyy": [4.0],
        "izz": [5.0],
        "ixz": [6.0],
        "center_of_gravity": [[7, 8, 9]],
    }
    mass = {name: np.array(value, float) for name, value in mass.items()}
    np.testing.assert_array_equal(one("mass_properties", mass).values[0, :8], np.arange(2, 10))
    field = one("imu/mag", {"magnetic_field": np.array([[1.0, 2.0, 3.0]])})
    np.testing.assert_array_equal(field.values[0, :3], [1.0, -2.0, -3.0])


def test_mass_and_inertia_of_zero_were_not_filled_in():
    """A driver that knows the mass alone: the message was ignored, and a note said that its mass was used."""
    names = ("ixx", "iyy", "izz", "ixz")
    fields = {"mass": np.array([2.5, 0.0, 2.5, 2.5]), "center_of_gravity": np.zeros((4, 3))}
    fields |= {name: np.array([0.0, 0.0, 0.1, np.nan]) for name in names}
    fields["ixz"][2] = 0.0
    values = ros.to_samples("mass_properties", np.arange(4), fields)[0].values
    np.testing.assert_array_equal(values[:, 0], [2.5, np.nan, 2.5, 2.5])
    np.testing.assert_array_equal(values[:, 1:5], [[np.nan] * 4, [np.nan] * 4, [0.1, 0.1, 0.1, 0.0], [np.nan] * 4])
    np.testing.assert_array_equal(values[:, 5:8], 0.0)


def random_fields(topic, n, rng):
    sizes = {"orientation": 4, "position_covariance": 9}
    fields = {}
    for name, components in ros.USED_FIELDS[topic].items():
        size = 9 if name.endswith("covariance") else sizes.get(name, len(components.split()))
        fields[name] = rng.normal(size=(n, size) if size else n)
    if topic == "imu/data":
        fields["orientation"] /= np.linalg.norm(fields["orientation"], axis=1)[:, None]
    for name in ("status.status", "position_covariance_type"):
        if name in fields:
            fields[name] = rng.integers(-1, 3, n)
    return fields


@pytest.mark.parametrize("topic", ros.TOPICS)
def test_one_by_one_gives_the_same_bits_as_all_at_once(topic):
    n = 67
    fields = random_fields(topic, n, np.random.default_rng(3))
    stamp = np.arange(n)
    for place, (batch, rows) in enumerate(ros.samples_and_rows(topic, stamp, fields)):
        singles = {}
        for i in range(n):
            for one_batch, _ in ros.samples_and_rows(
                topic, stamp[i : i + 1], {k: v[i : i + 1] for k, v in fields.items()}
            ):
                if len(one_batch) and one_batch.kind[0] == batch.kind[0]:
                    singles[i] = one_batch.values[0]
        assert list(singles) == list(rows), place
        assert np.array(list(singles.values())).tobytes() == batch.values.tobytes()


def test_conversion_to_ros_is_the_inverse():
    rng = np.random.default_rng(1)
    force, rate = rng.normal(size=(2, 5, 3))
    q = rng.normal(size=(5, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    stamp = np.arange(5)
    samples, attitudes = ros.to_samples(
        "imu/data", stamp, ros.imu_fields(force, rate, attitude=q, variances=(0.1, 0.2, 0.3))
    )
    np.testing.assert_array_equal(samples.values[:, :6], np.hstack([force, rate]))
    np.testing.assert_allclose(samples.values[:, 6:8], np.tile([0.1, 0.2], (5, 1)))
    np.testing.assert_allclose(attitudes.values[:, :4], q, atol=1e-15)
    (without,) = ros.to_samples("imu/data", stamp, ros.imu_fields(force, rate))
    assert (without.kind == Kind.IMU).all()
    velocity = rng.normal(size=(5, 3))
    (v,) = ros.to_samples("gps/vel", stamp, ros.gps_velocity_fields(velocity))
    np.testing.assert_array_equal(v.values[:, :3], velocity)


def test_live_messages_give_the_fields_of_their_type():
    vector = SimpleNamespace(x=1.0, y=2.0, z=3.0)
    header = SimpleNamespace(stamp=SimpleNamespace(sec=3, nanosec=5), frame_id="")
    twist = SimpleNamespace(header=header, twist=SimpleNamespace(linear=vector, angular=vector))
    stamp, fields = ros.message_fields("gps/vel", twist)
    assert stamp.tolist() == [3_000_000_005]
    np.testing.assert_array_equal(fields["twist.linear"], [[1.0, 2.0, 3.0]])
    (samples,) = ros.to_samples("gps/vel", stamp, fields)
    assert samples.values.shape == (1, WIDTH)
