"""Where the filter starts: coarse attitude, velocity and position, and how uncertain they are.

In the air two directions give the attitude (the TRIAD method, Black 1964): the specific force, which in NED
is the acceleration from GPS minus gravity, and the motion through the air, which in NED is the GPS velocity
minus the wind. On the ground the specific force gives roll and pitch and a magnetometer the heading; without
one the filter waits until the aircraft moves. An attitude in the recording goes before all that.

With less than GPS position and velocity it starts in flight. Positions show the velocity by their slope. Where the
airspeed is measured, gravity in body axes is what the air velocity u does and the accelerometer does not feel,

    C' g = du/dt + omega x u - f   (6.16)-(6.18),

in turns too. In a flight without GPS velocities are counted from the mean of the air, positions from the start, and
without attitude and magnetometer the heading, too.
"""

from __future__ import annotations

import itertools
from collections import deque

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import altitude_at
from aircraft_sysid_ros.aircraft.frames import (
    cross_matrix,
    quaternion_exp,
    quaternion_from_matrix,
    rotation_matrix,
    velocity_from_air_data,
)
from aircraft_sysid_ros.reconstruction.state import (
    ACCELEROMETER_BIAS,
    AIR_VELOCITY,
    ATTITUDE,
    D_ACCELEROMETER_BIAS,
    D_AIR_VELOCITY,
    D_ATTITUDE,
    D_GYRO_BIAS,
    D_POSITION,
    D_VELOCITY,
    ERROR_SIZE,
    GUST_STD,
    GYRO_BIAS,
    POSITION,
    STATE_SIZE,
    VELOCITY,
)
from aircraft_sysid_ros.samples import GPS_NED, Kind

Array = npt.NDArray[np.float64]

WINDOW = 1.0  # [s] of samples that the alignment rests on
LEAST_WINDOW = 0.9 * WINDOW
LARGEST_GAP = 0.25  # [s] between IMU samples in the window
SLOWEST_COURSE = 3.0  # [m/s] below it a GPS course is noise
LARGEST_GPS_AGE = 1.5  # [s]
POSITION_WINDOW = 2.0  # [s] of positions whose slope is a velocity
LEAST_LEVEL = 0.2  # share of a magnetic field that is horizontal, below it there is no heading in it
#: All kinds of GPS samples.
GPS = frozenset((int(Kind.GPS_POSITION), int(Kind.GPS_VELOCITY)))

# One sigma at the start.
POSITION_STD = 10.0  # [m]
VELOCITY_STD = 2.0  # [m/s]
SLOPE_STD = 4.0  # [m/s] of a velocity from positions, in a turn
TILT_STD = 0.15  # [rad]
HEADING_STD = 0.1  # [rad] besides the angle by which course and heading differ in the wind
LARGEST_HEADING_STD = 0.7  # [rad]
AIRSPEED_STD = 1.0  # [m/s]
AIR_ANGLE_STD = 0.05  # [rad] of measured alpha and beta
UNKNOWN_ANGLE_STD = 0.15  # [rad] where they are not measured
MAGNETIC_HEADING_STD = 0.35  # [rad]
ATTITUDE_STD = 0.1  # [rad] where the recording has an attitude
ACCELEROMETER_BIAS_STD = 0.3  # [m/s^2]
GYRO_BIAS_STD = 0.03  # [rad/s]
WIND_STD = (6.0, 6.0, 1.0)  # [m/s]


class Alignment:
    """Collects samples in time order until a start is possible."""

    def __init__(self, gravity: float, minimum_airspeed: float, declination: float | None, ground: float) -> None:
        self._gravity, self._ground = gravity, ground
        self._flying_speed = max(0.8 * minimum_airspeed, SLOWEST_COURSE)
        self._declination = declination or 0.0
        self._imu: deque[tuple[float, Array]] = deque()
        self._velocity: deque[tuple[float, Array]] = deque()
        self._position: deque[tuple[float, Array]] = deque()
        self._flow: deque[tuple[float, Array]] = deque()
        self._newest: dict[int, tuple[float, Array]] = {}
        #: Kinds of GPS samples that have come.
        self.seen: frozenset[int] = frozenset()
        #: Longest time [s] without a gap in the IMU: WINDOW is needed.
        self.longest = 0.0
        #: Latitude, longitude [rad], NaN without GPS position, altitude [m] of the positions (3,).
        self.origin: Array | None = None

    def forget(self) -> None:
        """Drop what was collected: there was a gap. The origin of the position stays."""
        self._imu.clear()
        self._velocity.clear()
        self._position.clear()
        self._flow.clear()
        self._newest.clear()

    def take(self, time: float, kind: int, values: Array) -> bool:
        """Take one sample; True if it is an IMU sample at which a start may be possible."""
        if kind == Kind.IMU:
            if self._imu and time - self._imu[-1][0] > LARGEST_GAP:
                self.forget()
            self._imu.append((time, values.copy()))
            _drop_before(self._imu, time - WINDOW)
            self.longest = max(self.longest, time - self._imu[0][0])
            return True
        if kind == Kind.GPS_VELOCITY:
            self._velocity.append((time, values[:3].copy()))
            _drop_before(self._velocity, time - 2.0 * WINDOW)
        if kind == Kind.GPS_POSITION:
            if self.origin is None or np.isnan(self.origin[0]):
                self.origin = values[:3].copy()
            self._position.append((time, values[GPS_NED].copy()))
            _drop_before(self._position, time - POSITION_WINDOW)
        self._newest[kind] = (time, values.copy())
        if kind in GPS:
            self.seen |= {kind}
        if kind == Kind.AIRSPEED and (flow := self.air_data(time)) is not None:
            self._flow.append((time, flow[0] * self._motion(time)))
            _drop_before(self._flow, time - WINDOW)
        return False

    def flies(self) -> bool:
        """Whether the newest samples show a speed to fly with."""
        now = self._imu[-1][0]
        over_ground = self._over_ground(now, self.seen)
        fast = over_ground is not None and np.linalg.norm(over_ground) > self._flying_speed
        return bool(fast or self.air_data(now) is not None)

    def start(self, wind: Array, wind_std: Array) -> tuple[Array, Array] | None:
        """State (19,) and covariance (18, 18) at the newest IMU sample, or None while that is not possible.

        ``wind`` (3,) NED [m/s] and its standard deviations (3,) are what is known of the wind.
        """
        now = self._imu[-1][0]
        if now - self._imu[0][0] < LEAST_WINDOW or self.origin is None or not self._imu_speaks():
            return None
        velocity = self._recent(Kind.GPS_VELOCITY, now, LARGEST_GPS_AGE)
        position = self._recent(Kind.GPS_POSITION, now, LARGEST_GPS_AGE)
        if velocity is None or position is None:
            return None
        acceleration = self._acceleration()
        attitude = self._attitude(now, velocity[:3], acceleration, wind, wind_std)
        if attitude is None:
            return None
        rotation, attitude_covariance = attitude
        x, p = np.zeros(STATE_SIZE), np.zeros((ERROR_SIZE, ERROR_SIZE))
        x[VELOCITY] = velocity[:3] + acceleration * (now - self._newest[Kind.GPS_VELOCITY][0])
        x[POSITION] = position[GPS_NED] + velocity[:3] * (now - self._newest[Kind.GPS_POSITION][0])
        x[ATTITUDE] = quaternion_from_matrix(rotation)
        _set_block(p, D_POSITION, np.eye(3) * POSITION_STD**2)
        _set_block(p, D_VELOCITY, np.eye(3) * VELOCITY_STD**2)
        _set_block(p, D_ATTITUDE, rotation.T @ attitude_covariance @ rotation)
        _set_block(p, D_ACCELEROMETER_BIAS, np.eye(3) * ACCELEROMETER_BIAS_STD**2)
        _set_block(p, D_GYRO_BIAS, np.eye(3) * GYRO_BIAS_STD**2)
        self._start_air_velocity(now, x, p, rotation, wind, wind_std)
        return x, p

    def start_with(self, gps: frozenset[int], wind: Array, wind_std: Array) -> tuple[Array, Array] | None:
        """As ``start`` where only these kinds of GPS samples are there, fewer than all."""
        now = self._imu[-1][0]
        velocity = self._over_ground(now, gps)
        if now - self._imu[0][0] < LEAST_WINDOW or (gps and velocity is None) or not self._imu_speaks():
            return None
        if not gps and self.air_data(now) is None:
            return None
        attitude = self._attitude_with(now, velocity, wind, wind_std)
        if attitude is None:
            return None
        rotation, attitude_covariance = attitude
        x, p = np.zeros(STATE_SIZE), np.zeros((ERROR_SIZE, ERROR_SIZE))
        x[POSITION] = self._place(now, gps)
        x[ATTITUDE] = quaternion_from_matrix(rotation)
        _set_block(p, D_POSITION, np.eye(3) * POSITION_STD**2)
        _set_block(p, D_ATTITUDE, rotation.T @ attitude_covariance @ rotation)
        _set_block(p, D_ACCELEROMETER_BIAS, np.eye(3) * ACCELEROMETER_BIAS_STD**2)
        _set_block(p, D_GYRO_BIAS, np.eye(3) * GYRO_BIAS_STD**2)
        if velocity is not None:
            x[VELOCITY] = velocity
            std = VELOCITY_STD if Kind.GPS_VELOCITY in gps else SLOPE_STD
            _set_block(p, D_VELOCITY, np.eye(3) * std**2)
        self._start_air_velocity(now, x, p, rotation, wind, wind_std)
        if velocity is None:
            _start_velocity_in_air(x, p, rotation)
        return x, p

    def _over_ground(self, now: float, gps: frozenset[int]) -> Array | None:
        """Velocity NED (3,) [m/s] over ground, by the GPS itself or from its positions."""
        if Kind.GPS_VELOCITY in gps:
            velocity = self._recent(Kind.GPS_VELOCITY, now, LARGEST_GPS_AGE)
            return None if velocity is None else velocity[:3]
        if Kind.GPS_POSITION not in gps or self._recent(Kind.GPS_POSITION, now, LARGEST_GPS_AGE) is None:
            return None
        times = np.array([time for time, _ in self._position])
        if times[-1] - times[0] < 0.9 * WINDOW or self.origin is None:
            return None
        places = np.array([place for _, place in self._position])
        away = times - times.mean()
        return np.asarray(away @ places / (away @ away))

    def _place(self, now: float, gps: frozenset[int]) -> Array:
        """Position NED (3,), of the origin that is set here if there is none."""
        position = self._recent(Kind.GPS_POSITION, now, LARGEST_GPS_AGE)
        if Kind.GPS_POSITION in gps and position is not None and self.origin is not None:
            return np.asarray(position[GPS_NED])
        air = self._recent(Kind.AIR, now, LARGEST_GPS_AGE)
        is_known = air is not None and air[1] > 0.0
        unknown = self._ground if self.origin is None else float(self.origin[2])
        altitude = float(altitude_at(air[1])) if air is not None and is_known else unknown
        if self.origin is None:
            self.origin = np.array([np.nan, np.nan, altitude])
        return np.array([0.0, 0.0, self.origin[2] - altitude])

    def _attitude_with(
        self, now: float, velocity: Array | None, wind: Array, wind_std: Array
    ) -> tuple[Array, Array] | None:
        """As ``_attitude``; velocity (3,) over ground or None."""
        given = self._recent(Kind.ATTITUDE, now, 0.5)
        if given is not None:
            return rotation_matrix(given[:4]), np.eye(3) * ATTITUDE_STD**2
        if self.air_data(now) is None:  # then there is a velocity
            return None if velocity is None else self._attitude(now, velocity, self._acceleration(), wind, wind_std)
        upright, up = np.array([0.0, 0.0, -1.0]), -self._gravity_in_body()
        field = self._field(now, up)
        if velocity is not None:
            unsure = float(np.max(wind_std[:2])) + SLOPE_STD
            heading = np.hypot(HEADING_STD, unsure / max(float(np.linalg.norm(velocity)), SLOWEST_COURSE))
            rotation = triad(up, self._motion(now), upright, velocity - wind)
        elif field is not None:
            heading = MAGNETIC_HEADING_STD
            rotation = triad(up, field, upright, self._north())
        else:
            heading = HEADING_STD
            rotation = triad(up, np.array([1.0, 0.0, 0.0]), upright, np.array([1.0, 0.0, 0.0]))
        return rotation, np.diag([TILT_STD**2, TILT_STD**2, min(heading, LARGEST_HEADING_STD) ** 2])

    def _start_air_velocity(self, now: float, x: Array, p: Array, rotation: Array, wind: Array, std: Array) -> None:
        """From air data where they are there, whatever the heading; else from velocity, attitude and wind."""
        flow = self.air_data(now)
        if flow is not None:
            x[AIR_VELOCITY] = flow[0] * self._motion(now)
            across = AIR_ANGLE_STD if self._has_angles(now) else UNKNOWN_ANGLE_STD
            _set_block(p, D_AIR_VELOCITY, np.diag([AIRSPEED_STD**2, *[(flow[0] * across) ** 2] * 2]))
            return
        x[AIR_VELOCITY] = rotation.T @ (x[VELOCITY] - wind)
        p[D_AIR_VELOCITY:, D_AIR_VELOCITY:] = 0.0
        to_air = np.zeros((3, ERROR_SIZE))
        to_air[:, D_VELOCITY : D_VELOCITY + 3] = rotation.T
        to_air[:, D_ATTITUDE : D_ATTITUDE + 3] = cross_matrix(x[AIR_VELOCITY])
        p[D_AIR_VELOCITY:] = to_air @ p
        p[:, D_AIR_VELOCITY:] = p @ to_air.T
        of_wind = rotation.T @ np.diag(std**2) @ rotation
        p[D_AIR_VELOCITY:, D_AIR_VELOCITY:] = to_air @ p[:, D_AIR_VELOCITY:] + of_wind

    def air_data(self, now: float) -> Array | None:
        """V, alpha, beta (3,) that the air velocity of a start comes from, NaN where an angle is not there; or None."""
        airspeed = self._recent(Kind.AIRSPEED, now, 0.5)
        if airspeed is None or not airspeed[0] > self._flying_speed:
            return None
        return np.array([airspeed[0], *self._angles(now)])

    def _recent(self, kind: Kind, now: float, age: float) -> Array | None:
        time, values = self._newest.get(kind, (-np.inf, None))
        return values if now - time <= age else None

    def _acceleration(self) -> Array:
        """Mean acceleration NED (3,) [m/s^2] from GPS velocity; zero from fewer than two of them."""
        if not self._velocity:
            return np.zeros(3)
        (first, before), (last, after) = self._velocity[0], self._velocity[-1]
        return (after - before) / (last - first) if last - first > 0.15 else np.zeros(3)

    def _imu_speaks(self) -> bool:
        """Whether the accelerometer gives anything but zeros, which a driver sends before its sensor is ready."""
        return any(value[:3].any() for _, value in self._imu)

    def _field(self, now: float, up: Array) -> Array | None:
        """Horizontal part (3,) of the magnetic field in body axes; None where it shows no heading: zeros, or steep."""
        newest = self._recent(Kind.MAGNETIC_FIELD, now, 1.0)
        if newest is None:
            return None
        field, down = newest[:3], -up / np.linalg.norm(up)
        level = field - down * (down @ field)
        return level if np.linalg.norm(level) > LEAST_LEVEL * np.linalg.norm(field) else None

    def _mean_force(self) -> Array:
        """Mean specific force (3,) in body axes of the newest sample: gyros turn earlier ones."""
        times = [time for time, _ in self._imu]
        values = [value for _, value in self._imu]
        turn, total = np.eye(3), values[-1][:3].copy()
        for i in range(len(values) - 2, -1, -1):
            rate = 0.5 * (values[i][3:6] + values[i + 1][3:6])
            turn = turn @ rotation_matrix(quaternion_exp(-rate * (times[i + 1] - times[i])))
            total += turn @ values[i][:3]
        return total / len(values)

    def _gravity_in_body(self) -> Array:
        """Gravity (3,) [m/s^2] in body axes of the newest IMU sample, from accelerometers and air velocity."""
        force = self._mean_force()
        (first, before), (last, after) = self._flow[0], self._flow[-1]
        if last - first < 0.5 * WINDOW:
            rate = np.mean([value[3:6] for _, value in self._imu], axis=0)
            return np.asarray(np.cross(rate, after) - force)
        turn = np.eye(3)
        samples = [sample for sample in self._imu if first <= sample[0] <= last]
        for (begin, value), (end, other) in itertools.pairwise(samples):
            turn = turn @ rotation_matrix(quaternion_exp(0.5 * (value[3:6] + other[3:6]) * (end - begin)))
        return np.asarray((after - turn.T @ before) / (last - first) - force)

    def _north(self) -> Array:
        """Direction of the horizontal magnetic field, NED."""
        return np.array([np.cos(self._declination), np.sin(self._declination), 0.0])

    def _attitude(
        self, now: float, velocity: Array, acceleration: Array, wind: Array, wind_std: Array
    ) -> tuple[Array, Array] | None:
        """Rotation body to NED (3, 3) and covariance of its error in NED axes (3, 3)."""
        given = self._recent(Kind.ATTITUDE, now, 0.5)
        if given is not None:
            return rotation_matrix(given[:4]), np.eye(3) * ATTITUDE_STD**2
        force = self._mean_force()
        through_air = velocity - wind
        ground_speed = float(np.linalg.norm(velocity))
        heading = np.hypot(HEADING_STD, np.max(wind_std[:2]) / max(ground_speed, SLOWEST_COURSE))
        level = np.diag([TILT_STD**2, TILT_STD**2, min(heading, LARGEST_HEADING_STD) ** 2])
        if ground_speed > self._flying_speed:
            upward = acceleration - np.array([0.0, 0.0, self._gravity])
            return triad(force, self._motion(now), upward, through_air), level
        field = self._field(now, force)
        if field is None:
            return None
        level[2, 2] = MAGNETIC_HEADING_STD**2
        upright = np.array([0.0, 0.0, -1.0])
        return triad(force, field, upright, self._north()), level

    def _has_angles(self, now: float) -> bool:
        return all(self._recent(kind, now, 0.5) is not None for kind in (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP))

    def _motion(self, now: float) -> Array:
        """Direction of motion through the air, body axes: from alpha and beta, else straight ahead."""
        alpha, beta = (0.0 if np.isnan(angle) else angle for angle in self._angles(now))
        return np.asarray(velocity_from_air_data(1.0, alpha, beta))

    def _angles(self, now: float) -> list[float]:
        """Alpha and beta [rad], NaN where they are not measured or are none."""
        angles = [self._recent(kind, now, 0.5) for kind in (Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)]
        return [np.nan if a is None or abs(a[0]) > 1.0 else float(a[0]) for a in angles]


def triad(first_b: Array, second_b: Array, first_n: Array, second_n: Array) -> Array:
    """Rotation body to NED (3, 3): first_b goes to first_n exactly, second_b to second_n as far as it can."""
    body, world = _triad_axes(first_b, second_b), _triad_axes(first_n, second_n)
    return world @ body.T


def _triad_axes(first: Array, second: Array) -> Array:
    one = first / np.linalg.norm(first)
    two = cross_matrix(one) @ second
    size = np.linalg.norm(two)
    if size <= 1e-6 * np.linalg.norm(second):  # parallel (vertical flight): any direction across will do
        two = cross_matrix(one) @ np.eye(3)[int(np.argmin(np.abs(one)))]
        size = np.linalg.norm(two)
    two = two / size
    return np.stack([one, two, cross_matrix(one) @ two], axis=1)


def _drop_before(queue: deque[tuple[float, Array]], time: float) -> None:
    while queue and queue[0][0] < time - 1e-9:
        queue.popleft()


def _start_velocity_in_air(x: Array, p: Array, rotation: Array) -> None:
    """Velocity C u of air that moves by GUST_STD about its mean, into x (19,) and p (18, 18)."""
    x[VELOCITY] = rotation @ x[AIR_VELOCITY]
    to_ground = np.zeros((3, ERROR_SIZE))
    to_ground[:, D_AIR_VELOCITY:] = rotation
    to_ground[:, D_ATTITUDE : D_ATTITUDE + 3] = -rotation @ cross_matrix(x[AIR_VELOCITY])
    p[:3] = to_ground @ p
    p[:, :3] = p @ to_ground.T
    p[:3, :3] += np.diag(GUST_STD**2)


def _set_block(p: Array, at: int, block: Array) -> None:
    p[at : at + 3, at : at + 3] = block


def keep_biases(x: Array, p: Array, x_before: Array, p_before: Array) -> None:
    """Keep the biases over a gap: they change slowly, while attitude and velocities start anew."""
    both = slice(ACCELEROMETER_BIAS.start, GYRO_BIAS.stop)
    x[both] = x_before[both]
    errors = slice(D_ACCELEROMETER_BIAS, D_GYRO_BIAS + 3)
    p[errors, errors] = p_before[errors, errors]
