"""The motion of a flight on one grid of time: every measured quantity in the air, and what kinematics makes of it.

Nothing is estimated: attitude, velocities and flow angles are those that were measured, smoothed alike.
"""

from __future__ import annotations

from functools import cached_property, partial

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import STANDARD_GRAVITY
from aircraft_sysid_ros.aircraft.earth import SEMI_MAJOR_AXIS, ned_along
from aircraft_sysid_ros.flight_check.grid import Grid, spikes
from aircraft_sysid_ros.flight_check.signals import INPUTS, LARGEST_ANGLES, Flight, groups, inside_limits, unwrapped
from aircraft_sysid_ros.identification.coefficients.signals import interpolate, named_inputs
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

#: Steps of the grid [s]: 50 Hz, or as the IMU samples where that is slower, but not slower than 5 Hz.
_SHORTEST_STEP, _LONGEST_STEP = 0.02, 0.2
#: Steps of a grid, by which long recordings are looked at in longer ones: more than 50 minutes.
_MOST_STEPS = 150_000
#: In the air: faster than this share of the flight's own fast speed (90th percentile), without the ends [s].
_FLYING, _ENDS = 0.45, 3.0
#: It moves over ground: faster [m/s] than a GPS at rest. An airspeed that changes by less than this share is stuck.
_PARKED, _STUCK = 1.0, 0.05
#: Speeds [m/s] below which the whole recording counts, since nothing seems to fly.
_STANDING = 2.0


class Motion:
    """Quantities on the grid, (count,) or (count, 3); NaN where they are not measured or not in the air."""

    def __init__(self, flight: Flight) -> None:
        self.flight = flight
        imu = flight.streams.get(Kind.IMU)
        step = imu.interval if imu is not None and np.isfinite(imu.interval) else _SHORTEST_STEP
        step = float(np.clip(max(step, flight.duration / _MOST_STEPS), _SHORTEST_STEP, _LONGEST_STEP))
        self.grid = Grid(0.0, step, max(int(flight.duration / step), 1))

    def _put(self, kind: Kind) -> Array:
        """Values (count, k) of a stream; of samples that repeat the one before only the first counts."""
        stream = self.flight.streams.get(kind)
        if stream is None:
            return np.full((self.grid.count, 10), np.nan)
        delay = self.flight.delays.get(kind, 0.0)
        parts = []
        for _, columns in groups(stream):
            rows = stream.fresh(columns) if stream.hold(columns) > 1.0 else slice(None)
            values = stream.values[rows, columns].copy()
            for column in values.T:
                column[np.flatnonzero(np.isfinite(column))[spikes(column[np.isfinite(column)])[0]]] = np.nan
            parts.append(self.grid.put(stream.time[rows] - delay, values))
        return np.hstack(parts)

    @cached_property
    def in_air(self) -> Bools:
        """Where (count,) the aircraft flies, by GPS speed or airspeed; everywhere where neither tells.

        Against a wind of half of the airspeed it is slow over ground, and flies: it moves, and its airspeed is as ever.
        """
        ground, air = np.linalg.norm(self._put(Kind.GPS_VELOCITY)[:, :3], axis=1), self._put(Kind.AIRSPEED)[:, 0]
        by_gps = bool(np.any(np.isfinite(ground)))
        flying = self._is_fast(ground if by_gps else air)
        if flying is None:
            return np.ones(self.grid.count, dtype=bool)
        shown = air[np.isfinite(air)]
        if by_gps and len(shown) and np.ptp(shown) > _STUCK * np.max(shown):
            moves, fast = self.grid.smooth(np.nan_to_num(ground), 2.0) > _PARKED, self._is_fast(air)
            flying = flying if fast is None else flying | (moves & fast)
        ends = round(_ENDS / self.grid.step)
        flying = without_short(flying, ends)
        return eroded(~without_short(~flying, ends) & flying, ends, outside=True)

    def _is_fast(self, speed: Array) -> Bools | None:
        """Where (count,) a speed [m/s] is one of flight; None where nothing seems to fly."""
        known = speed[np.isfinite(speed)]
        if not len(known) or np.percentile(known, 90) < _STANDING:
            return None
        return np.asarray(~(self.grid.smooth(np.nan_to_num(speed), 2.0) < _FLYING * np.percentile(known, 90)))

    def _flown(self, values: Array) -> Array:
        out = values.copy()
        out[~self.in_air] = np.nan
        return out

    @cached_property
    def gyro(self) -> Array:
        """Body rates (count, 3) [rad/s]."""
        return self._flown(self._put(Kind.IMU)[:, 3:6])

    @cached_property
    def force(self) -> Array:
        """Specific force (count, 3) [m/s^2]."""
        return self._flown(self._put(Kind.IMU)[:, :3])

    @cached_property
    def quaternion(self) -> Array:
        """Attitude (count, 4), body to NED, continuous."""
        stream = self.flight.streams.get(Kind.ATTITUDE)
        if stream is None:
            return np.full((self.grid.count, 4), np.nan)
        q = stream.values.copy()
        turns = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0))
        q[1:] *= turns[:, None]
        rows = stream.fresh(slice(0, 4)) if stream.hold(slice(0, 4)) > 1.0 else slice(None)
        on_grid = self.grid.put(stream.time[rows] - self.flight.delays.get(Kind.ATTITUDE, 0.0), q[rows])
        return self._flown(on_grid / np.linalg.norm(on_grid, axis=1, keepdims=True))

    @cached_property
    def euler(self) -> Array:
        """Roll, pitch, yaw (count, 3) [rad] of (6.20)-(6.22); yaw is continuous."""
        w, x, y, z = self.quaternion.T
        roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = np.arcsin(np.clip(2.0 * (w * y - x * z), -1.0, 1.0))
        yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return np.column_stack([roll, pitch, unwrapped(yaw)])

    @cached_property
    def rotation(self) -> Array:
        """C(q) (count, 3, 3), body to NED, (6.23)."""
        w, x, y, z = self.quaternion.T
        rows = [
            [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
        return np.moveaxis(np.array(rows), 2, 0)

    @cached_property
    def attitude_rate(self) -> Array:
        """Body rates (count, 3) [rad/s] by central differences of the attitude: twice the vector part of q* dq/dt."""
        q = self.quaternion
        out = np.full((len(q), 3), np.nan)
        if len(q) < 3:
            return out
        a, b = q[:-2], q[2:]
        w = np.sum(a * b, axis=1)
        v = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] - np.cross(a[:, 1:], b[:, 1:])
        sine = np.linalg.norm(v, axis=1)
        angle = 2.0 * np.arctan2(sine, w)
        with np.errstate(invalid="ignore", divide="ignore"):
            out[1:-1] = v * np.where(sine > 1e-12, angle / sine, 2.0)[:, None] / (2.0 * self.grid.step)
        return out

    @cached_property
    def position(self) -> Array:
        """North, east, down (count, 3) [m] along the way, down from the middle one of the fixes.

        Latitudes and longitudes in another unit, which are no angles, are taken as on the plane that touches there.
        """
        stream = self.flight.streams.get(Kind.GPS_POSITION)
        if stream is None or not np.any(np.all(np.isfinite(stream.values[:, :3]), axis=1)):
            return np.full((self.grid.count, 3), np.nan)
        placed = self._put(Kind.GPS_POSITION)[:, :3]
        known = np.flatnonzero(np.all(np.isfinite(stream.values[:, :3]), axis=1))
        middle = stream.values[known[len(known) // 2], :3]
        if not np.any(np.abs(placed[:, :2]) > LARGEST_ANGLES):
            level = np.where(np.isnan(placed[:, 2]), middle[2], placed[:, 2])  # a fix without an altitude has a place
            along = ned_along(np.column_stack([placed[:, :2], level]), middle)
            return self._flown(np.column_stack([along[:, :2], middle[2] - placed[:, 2]]))
        radius = SEMI_MAJOR_AXIS + middle[2]
        return self._flown((placed - middle) * [radius, radius * np.cos(middle[0]), -1.0])

    @cached_property
    def velocity(self) -> Array:
        """Velocity over ground NED (count, 3) [m/s]."""
        return self._flown(self._put(Kind.GPS_VELOCITY)[:, :3])

    @cached_property
    def gps_width(self) -> float:
        """Width [s] of the average that GPS, once a second or faster, can show."""
        streams = (self.flight.streams.get(kind) for kind in (Kind.GPS_VELOCITY, Kind.GPS_POSITION))
        intervals = [s.interval * s.hold(slice(0, 3)) for s in streams if s is not None and np.isfinite(s.interval)]
        return max(1.0, 4.0 * max(intervals, default=0.25))

    @cached_property
    def acceleration(self) -> Array:
        """d/dt of the velocity over ground, NED (count, 3) [m/s^2]; not smoothed."""
        return np.column_stack([self.grid.slope(v) for v in self.velocity.T])

    @cached_property
    def airspeed(self) -> Array:
        """True airspeed (count,) [m/s]."""
        return self._flown(self._put(Kind.AIRSPEED)[:, 0])

    @cached_property
    def alpha(self) -> Array:
        """Angle of attack (count,) [rad]."""
        return self._flown(self._put(Kind.ANGLE_OF_ATTACK)[:, 0])

    @cached_property
    def beta(self) -> Array:
        """Sideslip (count,) [rad]."""
        return self._flown(self._put(Kind.SIDESLIP)[:, 0])

    @cached_property
    def angles_at_imu(self) -> tuple[Array, Array]:
        """Angle of attack and sideslip (count,) [rad] of the air at the IMU, as far as the place of the vanes is known.

        A vane at e, seen from there, shows (w x e)/V across the flow besides.
        """
        if self.flight.arm is None:
            return self.alpha, self.beta
        (ahead, right, below), (p, q, r) = self.flight.arm.place, self.gyro.T
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.alpha - (p * right - q * ahead) / self.speed, self.beta - (r * ahead - p * below) / self.speed

    @cached_property
    def arm_time(self) -> float:
        """Time [s] that vanes may seem early or late for where they are, twice one sigma of the place over the speed.

        That is the same as a delay in a turn or a pull-up: the aeroplane turns as its angles change.
        """
        if self.flight.arm is None:
            return 0.0
        speed = float(np.nanmedian(self.speed)) if np.isfinite(self.speed).any() else np.inf
        return 2.0 * float(self.flight.arm.sigma[0]) / max(speed, 1.0)

    @cached_property
    def air(self) -> Array:
        """Density [kg/m^3] and static pressure [Pa], (count, 2)."""
        return self._flown(self._put(Kind.AIR)[:, :2])

    @cached_property
    def controls(self) -> Array:
        """Controls (count, 7) as in Kind.CONTROLS, as they are recorded."""
        return self._flown(self._put(Kind.CONTROLS)[:, :7])

    @cached_property
    def inputs(self) -> Array:
        """The named inputs (count, k) [SI] in the order of the aircraft file, between samples as `replay` has them."""
        out = np.full((self.grid.count, len(self.flight.inputs)), np.nan)
        delay, reach = self.flight.delays.get(Kind.INPUTS, 0.0), ParameterOptions().settle
        for column, item in zip(out.T, self.flight.inputs, strict=True):
            stream = self.flight.input_streams.get(INPUTS + item.name)
            if stream is not None:
                inside = inside_limits(stream.values[:, 0], item)
                series = stream.time[inside] - delay, stream.values[inside]
                column[:] = named_inputs(1, *series, self.grid.time, partial(interpolate, longest=reach))[:, 0]
        return self._flown(out)

    @cached_property
    def speed(self) -> Array:
        """Speed (count,) [m/s] of what is measured of airspeed and velocity over ground, the first that is there."""
        if np.any(np.isfinite(self.airspeed)):
            return self.airspeed
        return np.asarray(np.linalg.norm(self.velocity, axis=1))

    @cached_property
    def turn_acceleration(self) -> Array:
        """Horizontal acceleration (count,) across the track, positive to the right [m/s^2]; V times the course rate."""
        north, east, _ = (self.grid.smooth(v, self.gps_width) for v in self.velocity.T)
        ground = np.hypot(north, east)
        turning = north * self.grid.slope(east) - east * self.grid.slope(north)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(ground > 1e-3, turning / ground, np.nan)

    @cached_property
    def course_rate(self) -> Array:
        """Rate of the course over ground (count,) [rad/s]."""
        speed = self.grid.smooth(np.hypot(self.velocity[:, 0], self.velocity[:, 1]), self.gps_width)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(speed > 1e-3, self.turn_acceleration / speed, np.nan)

    @cached_property
    def force_of_gps(self) -> Array:
        """Specific force (count, 3) that GPS velocity and attitude give: C(q)' (dv/dt - g)."""
        without_gravity = self.acceleration - [0.0, 0.0, STANDARD_GRAVITY]
        return np.asarray(np.einsum("nji,nj->ni", self.rotation, without_gravity))


def eroded(mask: Bools, reach: int, outside: bool) -> Bools:
    """Where (n,) the mask is true within ``reach`` steps to both sides; ``outside``: what it is beyond its ends."""
    end = np.full(reach, not outside)
    false = np.concatenate([[0], np.cumsum(np.concatenate([end, ~mask, end]))])
    width = 2 * reach + 1
    return np.asarray(false[width:] == false[:-width])


def without_short(mask: Bools, reach: int) -> Bools:
    """The mask (n,) where it is true for more than twice ``reach`` steps on end."""
    return ~eroded(~eroded(mask, reach, outside=False), reach, outside=True)
