"""What the sensors of an aeroplane send during a flight whose truth is known.

Each sensor samples at its own rate and phase. A sample stamped t shows the truth of t minus the delay of the
aircraft file, where the sensor sits, with bias and white noise; its message arrives a little later than it is
stamped. Messages are made as flat ROS fields by the conversions that recordings use, so that memory and bag
hold the same.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft import earth
from aircraft_sysid_ros.aircraft.configuration import SURFACES, Aircraft
from aircraft_sysid_ros.aircraft.frames import quaternion_exp, quaternion_product, rotation_matrix
from aircraft_sysid_ros.aircraft.named_inputs import NamedInput
from aircraft_sysid_ros.ros_messages import conversion as ros_conversion
from aircraft_sysid_ros.ros_messages.conversion import samples_and_rows
from aircraft_sysid_ros.samples import Samples, concatenate
from aircraft_sysid_ros.sensors.five_hole_probe import ProbeCalibration
from aircraft_sysid_ros.sensors.instrument_errors import AIR_DATA, MagneticErrors, OutputErrors
from aircraft_sysid_ros.sensors.truth import FLAPS, Truth
from aircraft_sysid_ros.stamps import NANOSECONDS

Array = npt.NDArray[np.float64]
Stamps = npt.NDArray[np.int64]

#: Stamp [ns] of time 0 of every simulated flight.
EPOCH = 1_760_000_000 * NANOSECONDS
#: Sensors do not sample at the same instants: offsets [s] of the first sample.
_PHASES = {
    "imu/data": 0.0, "imu/mag": 0.0043, "gps/fix": 0.0131, "gps/vel": 0.0131, "air_data": 0.0037,
    "five_hole_probe": 0.0051, "control_surfaces": 0.0062, "height_above_ground": 0.0079, "inputs": 0.0062,
}  # fmt: skip
#: Mean times [s] from stamp to arrival.
_TRANSPORT = {
    "imu/data": 0.002, "imu/mag": 0.003, "gps/fix": 0.06, "gps/vel": 0.06, "air_data": 0.005,
    "five_hole_probe": 0.005, "control_surfaces": 0.004, "height_above_ground": 0.01, "inputs": 0.004,
}  # fmt: skip
#: Horizontal and downward strength of the earth's magnetic field [T] in the middle of North America.
_FIELD_NORTH, _FIELD_DOWN = 1.7e-5, 5.1e-5


@dataclass(frozen=True)
class SensorOptions:
    """Which sensors fly and how well they work."""

    noise_scale: float = 1.0  # on the white noise of the aircraft file
    accelerometer_bias: float = 0.15  # [m/s^2] one sigma of the constant part
    gyro_bias: float = 0.01  # [rad/s]
    transport_scale: float = 1.0  # on the time from stamp to arrival; 0 makes messages arrive as they are stamped
    attitude: bool = False
    magnetometer: bool = False
    five_hole_probe: bool = False
    height_above_ground: bool = False
    air_data_lag: float = 0.0  # [s] time constant of tubes and vanes, which the aircraft file does not know
    command_lag: float = 0.0  # [s] commands are recorded, and what they move follows with this time constant
    command_dead_time: float = 0.0  # [s] and so much later
    probe: ProbeCalibration = field(default_factory=ProbeCalibration)
    magnetic: MagneticErrors = field(default_factory=MagneticErrors)
    outputs: OutputErrors = field(default_factory=OutputErrors)


@dataclass(frozen=True)
class Stream:
    """n messages of one topic: stamps and arrivals [ns] (n,), flat fields as in recordings.ros_conversion."""

    topic: str
    stamp: Stamps
    arrival: Stamps
    fields: dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class Biases:
    """True IMU biases at n times of the IMU: accelerometer [m/s^2] and gyro [rad/s], each (n, 3), FRD."""

    stamp: Stamps  # (n,) [ns]
    accelerometer: Array
    gyro: Array


def generator(seed: int, name: str) -> np.random.Generator:
    """Random numbers of one part of a flight: what another part draws does not change them."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def stamps_of(time: npt.ArrayLike) -> Stamps:
    """Stamps [ns] of times [s] of a flight."""
    return EPOCH + np.rint(np.asarray(time, dtype=np.float64) * NANOSECONDS).astype(np.int64)


def measure(aircraft: Aircraft, truth: Truth, seed: int, options: SensorOptions) -> tuple[list[Stream], Biases]:
    """Messages of all topics, and the true biases of the IMU."""
    suite = _Suite(aircraft, truth, seed, options)
    biases = suite.draw_biases()
    streams = [
        suite.imu(biases),
        suite.gps_fix(),
        suite.gps_velocity(),
        suite.air_data(),
        suite.control_surfaces(),
    ]
    optional: list[tuple[bool, Callable[[], Stream]]] = [
        (options.magnetometer, suite.magnetic_field),
        (options.five_hole_probe, suite.pressures),
        (options.height_above_ground, suite.height),
        (truth.inputs.shape[1] > 0, suite.inputs),
    ]
    return streams + [make() for wanted, make in optional if wanted], biases


class _Suite:
    """The sensors of one flight."""

    def __init__(self, aircraft: Aircraft, truth: Truth, seed: int, options: SensorOptions) -> None:
        self.aircraft, self.truth, self.seed, self.options = aircraft, truth, seed, options
        self.begin = float(truth.time[0]) + max(sensor.delay for sensor in aircraft.sensors.values())

    def times(self, topic: str, sensor: str) -> Array:
        """Times of the stamps [s] of a topic: none before the longest delay, when its truth has not begun."""
        rate = self.aircraft.sensors[sensor].rate
        first = self.begin + _PHASES[topic]
        count = int(np.floor((self.truth.time[-1] - first) * rate + 1e-9)) + 1
        return first + np.arange(count) / rate

    def seen(self, sensor: str, time: Array) -> Truth:
        """Truth that a sensor shows at stamps [s]."""
        return self.truth.at(time - self.aircraft.sensors[sensor].delay)

    def noise(self, sensor: str, shape: tuple[int, ...]) -> Array:
        """White noise of a sensor, shape (n,) or (n, 3)."""
        sigma = self.options.noise_scale * np.array(self.aircraft.sensors[sensor].noise)
        return sigma * generator(self.seed, sensor).standard_normal(shape)

    def variance(self, sensor: str) -> tuple[float, ...]:
        """Variances that the messages of a sensor state."""
        return tuple((self.options.noise_scale * sigma) ** 2 for sigma in self.aircraft.sensors[sensor].noise)

    def stream(self, topic: str, time: Array, fields: dict[str, npt.NDArray[Any]]) -> Stream:
        stamp = stamps_of(time)
        late = generator(self.seed, "transport of " + topic).uniform(0.5, 1.5, len(time))
        late *= self.options.transport_scale * _TRANSPORT[topic]
        return Stream(topic, stamp, stamp + np.rint(late * NANOSECONDS).astype(np.int64), fields)

    def draw_biases(self) -> Biases:
        time = self.times("imu/data", "accelerometer")
        return Biases(
            stamps_of(time),
            self._bias(time, "accelerometer_bias", self.options.accelerometer_bias),
            self._bias(time, "gyro_bias", self.options.gyro_bias),
        )

    def _bias(self, time: Array, name: str, sigma: float) -> Array:
        """Constant part plus random walk (n, 3)."""
        rng = generator(self.seed, name)
        constant = sigma * rng.standard_normal(3)
        steps = self.aircraft.process_noise[name] * np.sqrt(np.diff(time, prepend=time[0]))
        return constant + np.cumsum(steps[:, None] * rng.standard_normal((len(time), 3)), axis=0)

    def imu(self, biases: Biases) -> Stream:
        time = self.times("imu/data", "accelerometer")
        force = specific_force_at(self.seen("accelerometer", time), self.aircraft.imu_position)
        rates = self.seen("gyro", time).rates
        force = force + biases.accelerometer + self.noise("accelerometer", force.shape)
        rates = rates + biases.gyro + self.noise("gyro", rates.shape)
        fields = ros_conversion.imu_fields(
            force,
            rates,
            attitude=self._attitude(time) if self.options.attitude else None,
            variances=(
                self.variance("accelerometer")[0],
                self.variance("gyro")[0],
                self.variance("attitude")[0],
            ),
        )
        return self.stream("imu/data", time, dict(fields))

    def _attitude(self, time: Array) -> Array:
        """Quaternions (n, 4) turned by the noise, a rotation vector in body axes."""
        errors = self.noise("attitude", (len(time), 3))
        true = self.options.outputs.attitude(self.seen("attitude", time).quaternion)
        return np.array([quaternion_product(q, quaternion_exp(e)) for q, e in zip(true, errors, strict=True)])

    def gps_fix(self) -> Stream:
        time = self.times("gps/fix", "gps_position")
        seen = self.seen("gps_position", time)
        position = seen.position + turned(seen.quaternion, self.aircraft.gps_position)
        position += self.noise("gps_position", position.shape)
        geodetic = earth.geodetic_along(position, seen.origin)
        north, east, down = self.variance("gps_position")
        fields = ros_conversion.gps_fix_fields(*geodetic.T, variance_ned=(north, east, down))
        return self.stream("gps/fix", time, fields)

    def gps_velocity(self) -> Stream:
        time = self.times("gps/vel", "gps_velocity")
        seen = self.seen("gps_velocity", time)
        velocity = seen.velocity + turned(seen.quaternion, np.cross(seen.rates, self.aircraft.gps_position))
        fields = ros_conversion.gps_velocity_fields(velocity + self.noise("gps_velocity", velocity.shape))
        return self.stream("gps/vel", time, dict(fields))

    def air_data(self) -> Stream:
        time = self.times("air_data", "airspeed")
        n = len(time)
        place = self.aircraft.air_data_position
        pressure, density = self._air(time)
        fields = {"air_density": density, "static_pressure": pressure}
        names = {"airspeed": "true_airspeed", "angle_of_attack": "angle_of_attack", "sideslip": "sideslip"}
        for column, (sensor, field_name) in enumerate(names.items()):
            shown = self.options.outputs.shown(AIR_DATA[column], self._flow(sensor, time, place)[:, column])
            grown = self.aircraft.sensors[sensor].drift * (time - self.begin)
            shown = (
                shown * (1.0 + grown) if sensor == "airspeed" else shown + grown + self.aircraft.sensors[sensor].offset
            )
            fields[field_name] = self.aircraft.sensors[sensor].scale * shown + self.noise(sensor, (n,))
        return self.stream("air_data", time, fields)

    def _flow(self, sensor: str, time: Array, place: Array) -> Array:
        """V, alpha, beta (n, 3) that a sensor shows at stamps [s], late where there is a lag."""
        if self.options.air_data_lag <= 0.0:
            return air_data_at(self.seen(sensor, time), place)
        at = time - self.aircraft.sensors[sensor].delay
        late = first_order_lag(self.truth.time, air_data_at(self.truth, place), self.options.air_data_lag)
        return np.stack([np.interp(at, self.truth.time, column) for column in late.T], axis=1)

    def _air(self, time: Array) -> tuple[Array, Array]:
        """Static pressure [Pa] as measured, and the density [kg/m^3] from it and the true temperature."""
        seen = self.seen("static_pressure", time)
        measured = seen.static_pressure + self.noise("static_pressure", (len(time),))
        return measured, measured * seen.density / seen.static_pressure

    def pressures(self) -> Stream:
        time = self.times("five_hole_probe", "five_hole_probe")
        seen = self.seen("five_hole_probe", time)
        flow = air_data_at(seen, self.aircraft.air_data_position)
        true = self.options.probe.pressures(flow[:, 0], flow[:, 1], flow[:, 2], seen.density)
        noisy = np.column_stack([seen.static_pressure, true]) + self.noise("five_hole_probe", (len(time), 4))
        names = ("static_pressure", "dynamic_pressure", "alpha_pressure", "beta_pressure")
        return self.stream("five_hole_probe", time, dict(zip(names, noisy.T, strict=True)))

    def control_surfaces(self) -> Stream:
        """Deflections with the signs of the recording; throttle, thrust and propeller speed without noise."""
        time = self.times("control_surfaces", "control_surfaces")
        at = time + self.options.command_dead_time
        lag = self.options.command_lag + self.aircraft.sensors["control_surfaces"].lag
        values = self.seen("control_surfaces", at).controls + lag * self._moving(self.truth.controls, at, lag)
        values[:, : FLAPS + 1] += self.noise("control_surfaces", (len(time), FLAPS + 1))
        values[:, : FLAPS + 1] *= [self.aircraft.surface_signs[name] for name in SURFACES]
        names = (*SURFACES, "throttle", "thrust", "propeller_speed")
        return self.stream("control_surfaces", time, dict(zip(names, values.T, strict=True)))

    def _moving(self, series: Array, time: Array, lag: float) -> Array:
        """Rates (n, k) of what servos move, at stamps [s]: position + lag × rate is the command that they follow."""
        if lag <= 0.0:
            return np.zeros((len(time), series.shape[1]))
        at = time - self.aircraft.sensors["control_surfaces"].delay
        rates = np.gradient(series, self.truth.time, axis=0)
        return np.stack([np.interp(at, self.truth.time, column) for column in rates.T], axis=1)

    def inputs(self) -> Stream:
        """The inputs that the aircraft file names, in the units of the recording."""
        time, named = self.times("inputs", "control_surfaces"), self.aircraft.inputs
        draws = generator(self.seed, "inputs").standard_normal((len(time), len(named)))
        noise = self.options.noise_scale * np.array([item.noise for item in named]) * draws
        lag = self.aircraft.sensors["control_surfaces"].lag
        moved = self.seen("control_surfaces", time).inputs + lag * self._moving(self.truth.inputs, time, lag)
        shown = (moved + noise) / [item.factor for item in named]
        return self.stream("inputs", time, ros_conversion.input_fields([item.name for item in named], shown))

    def magnetic_field(self) -> Stream:
        """Field in body axes; the file states its noise as that of the heading in level flight."""
        time = self.times("imu/mag", "magnetometer")
        declination = self.aircraft.magnetic_declination or 0.0
        north, east = _FIELD_NORTH * np.cos(declination), _FIELD_NORTH * np.sin(declination)
        quaternions = self.seen("magnetometer", time).quaternion
        field_b = np.array([rotation_matrix(q).T @ np.array([north, east, _FIELD_DOWN]) for q in quaternions])
        field_b = self.options.magnetic.shown(field_b) + _FIELD_NORTH * self.noise("magnetometer", field_b.shape)
        return self.stream("imu/mag", time, {"magnetic_field": ros_conversion.flu_from_frd(field_b)})

    def height(self) -> Stream:
        time = self.times("height_above_ground", "height_above_ground")
        distance = self.seen("height_above_ground", time).height + self.noise("height_above_ground", (len(time),))
        limits = {"min_range": np.zeros(len(time)), "max_range": np.full(len(time), np.inf)}
        return self.stream("height_above_ground", time, {"range": distance, **limits})


def first_order_lag(time: Array, series: Array, lag: float) -> Array:
    """Columns (n, k) at equal steps of time [s] after lag y' = x - y, exactly for an x held over each step."""
    from scipy.signal import lfilter  # here: 0.6 s that sensors without a lag do not need

    keep = float(np.exp(-(time[1] - time[0]) / lag))
    start = keep * series[:1]
    filtered, _ = lfilter([1.0 - keep], [1.0, -keep], series, axis=0, zi=start)
    return np.asarray(filtered)


def specific_force_at(truth: Truth, position: Array) -> Array:
    """Specific force [m/s^2] (n, 3) at a position [m] FRD from the centre of gravity."""
    turning = np.cross(truth.angular_acceleration, position)
    centripetal = np.cross(truth.rates, np.cross(truth.rates, position))
    return truth.specific_force + turning + centripetal


def air_data_at(truth: Truth, position: Array) -> Array:
    """Airspeed [m/s], angle of attack and sideslip [rad], (n, 3), of the air at a position [m] FRD."""
    u, v, w = (truth.air_velocity + np.cross(truth.rates, position)).T
    return np.stack([np.sqrt(u * u + v * v + w * w), np.arctan2(w, u), np.arctan2(v, np.hypot(u, w))], axis=1)


def turned(quaternions: Array, vectors_b: Array) -> Array:
    """Body vectors (3,) or (n, 3) in NED (n, 3) at attitudes (n, 4)."""
    vectors = np.broadcast_to(vectors_b, (len(quaternions), 3))
    return np.array([rotation_matrix(q) @ v for q, v in zip(quaternions, vectors, strict=True)])


def arrived(streams: Sequence[Stream], inputs: Sequence[NamedInput] = ()) -> Samples:
    """Samples of all streams in order of arrival; those of one message stay together.

    ``inputs`` are those that the aircraft file names.
    """
    batches: list[Samples] = []
    keys: list[npt.NDArray[np.int64]] = []
    for number, stream in enumerate(streams):
        for part, (samples, rows) in enumerate(samples_and_rows(stream.topic, stream.stamp, stream.fields, inputs)):
            batches.append(samples)
            same = np.ones(len(rows), dtype=np.int64)
            keys.append(np.stack([part * same, rows, number * same, stream.arrival[rows]]))
    return concatenate(batches)[np.lexsort(np.concatenate(keys, axis=1))]
