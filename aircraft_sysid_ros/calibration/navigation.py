"""The navigation solution that a calibration compares a sensor with: velocity, attitude and rates without the sensor.

The two-stage paper takes it from the autopilot. Here it is the smoothed first step over IMU and GPS alone: nothing of
the air data, whose errors are looked for, nor of the magnetometer, nor of an attitude whose own errors nobody knows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.aircraft.frames import rotation_matrices
from aircraft_sysid_ros.aircraft.sensor_settings import by_name
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.reconstruction.found_noise import FLIGHT, found_noise, stated_and_shown
from aircraft_sysid_ros.reconstruction.smoother_history import SmootherHistory
from aircraft_sysid_ros.reconstruction.state import D_ATTITUDE, StateField
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import REQUIRED_VALUES, Kind, Samples, first_and_last, is_absurd
from aircraft_sysid_ros.stamps import NANOSECONDS, seconds

Array = npt.NDArray[np.float64]

#: Kinds that the navigation rests on.
USED = (Kind.IMU, Kind.GPS_POSITION, Kind.GPS_VELOCITY)
#: What samples of a kind are called, and the topic that holds them.
TOPIC_OF_KIND = {
    Kind.IMU: ("IMU samples", "imu/data"),
    Kind.ATTITUDE: ("attitudes", "imu/data, with an orientation"),
    Kind.MAGNETIC_FIELD: ("magnetic field", "imu/mag"),
    Kind.GPS_POSITION: ("GPS positions", "gps/fix"),
    Kind.GPS_VELOCITY: ("GPS velocities", "gps/vel"),
    Kind.AIRSPEED: ("airspeeds", "air_data"),
    Kind.ANGLE_OF_ATTACK: ("angles of attack", "air_data"),
    Kind.SIDESLIP: ("sideslip angles", "air_data"),
    Kind.FIVE_HOLE: ("probe pressures", "five_hole_probe"),
}
#: Step of the grid on which calibrations work [s]. Over a longer one attitude and flow change together within a bin,
#: and the mean of a product is not the product of means.
STEP = 0.04
#: Their sensors in the aircraft file, whose stated noise is too small where the flight shows so many times as much.
_SENSORS, _UNDERSTATED = ("accelerometer", "gyro", "gps_position", "gps_velocity"), 1.5
#: A piece of the grid ends where a sensor is silent for longer [s], and for more than a bin that jitter leaves empty.
_LONGEST_SILENCE, _MOST_STEPS = 0.5, 2.5


@dataclass(frozen=True)
class Navigation:
    """n instants of a flight at the centre of gravity, FRD and NED; biases of the gyros are removed."""

    epoch: int  # [ns] from which the time counts
    time: Array  # (n,) [s]
    velocity: Array  # (n, 3) over ground [m/s]
    rotation: Array  # (n, 3, 3) body to NED
    rates: Array  # (n, 3) [rad/s]
    height: Array  # (n,) above the beginning [m]
    attitude_std: Array  # (n, 3) of a rotation in body axes [rad]
    origin: Array  # (3,) latitude, longitude [rad], altitude [m]
    notes: tuple[str, ...] = ()  # on the noise of the sensors

    def __getitem__(self, keep: npt.NDArray[np.bool_]) -> Navigation:
        return self._with([column[keep] for column in self._columns])

    @property
    def _columns(self) -> list[Array]:
        return [self.time, self.velocity, self.rotation, self.rates, self.height, self.attitude_std]

    def _with(self, columns: list[Array]) -> Navigation:
        time, velocity, rotation, rates, height, attitude_std = columns
        return Navigation(self.epoch, time, velocity, rotation, rates, height, attitude_std, self.origin, self.notes)

    def at(self, grid: Grid, time: Array) -> Navigation:
        """Means over the bins of a grid of what the navigation was at times (k,) of a sensor; rotations stay such."""
        columns = [self._means(grid, time, column) for column in self._columns]
        u, _, vt = np.linalg.svd(columns[2])
        columns[2] = u @ vt
        return self._with([grid.time, *columns[1:]])

    def _means(self, grid: Grid, time: Array, column: Array) -> Array:
        flat = column.reshape(len(column), -1)
        then = np.stack([np.interp(time, self.time, values) for values in flat.T], axis=1)
        return np.asarray(grid.means(time, then).reshape(-1, *column.shape[1:]))


@dataclass(frozen=True)
class Grid:
    """Bins in which all that a calibration needs was measured: index from the epoch (n,), and their width [s]."""

    index: npt.NDArray[np.int64]
    step: float

    @property
    def time(self) -> Array:
        """Centres of the bins (n,) [s]."""
        return np.asarray((self.index + 0.5) * self.step)

    @property
    def piece(self) -> npt.NDArray[np.int64]:
        """Number (n,) of the piece without a gap that a bin belongs to."""
        silence = max(_LONGEST_SILENCE, _MOST_STEPS * self.step)
        gaps = np.diff(self.index, prepend=self.index[:1]) * self.step > silence
        return np.asarray(np.cumsum(gaps), dtype=np.int64)

    def means(self, time: Array, values: Array) -> Array:
        """Mean of values (k, m) at times (k,) in each bin, (n, m)."""
        at, inside = self.place(time)
        total, count = np.zeros((len(self.index), values.shape[1])), np.zeros(len(self.index))
        np.add.at(total, at[inside], values[inside])
        np.add.at(count, at[inside], 1.0)
        return np.asarray(total / count[:, None])

    def place(self, time: Array) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
        """Row of the bin of each time (k,), and whether there is one."""
        bins = np.floor(time / self.step).astype(np.int64)
        at = np.minimum(np.searchsorted(self.index, bins), len(self.index) - 1)
        return at, np.asarray(self.index[at] == bins)

    def __getitem__(self, keep: npt.NDArray[np.bool_]) -> Grid:
        return Grid(self.index[keep], self.step)


def slowest(*times: Array) -> float:
    """Time [s] between samples of the slowest of several series, with times (k,) [s] each."""
    return max((float(np.median(np.diff(time))) for time in times if len(time) > 1), default=0.0)


def common_grid(*times: Array, least: float = STEP) -> Grid:
    """The bins in which every one of several series, with times (k,) [s] each, has a sample.

    They are ``least`` [s] wide, or as wide as the samples of the slowest series are apart.
    """
    step = max(least, slowest(*times))
    index = [np.unique(np.floor(time / step).astype(np.int64)) for time in times]
    common = index[0]
    for bins in index[1:]:
        common = np.intersect1d(common, bins)
    return Grid(common, step)


def require(samples: Samples, kinds: tuple[Kind, ...]) -> None:
    """Raises InputError that names the first kind of which there are no usable samples, and its topic."""
    for kind in kinds:
        if not len(usable(samples, kind)):
            what, topic = TOPIC_OF_KIND[kind]
            raise InputError(f"the recording has no usable {what}: this calibration needs /{topic}")


def usable(samples: Samples, kind: Kind) -> Samples:
    """Samples of a kind whose needed values are numbers that an aircraft can have."""
    of_kind = samples[samples.kind == kind]
    needed = of_kind.values[:, : REQUIRED_VALUES[kind]]
    bad = is_absurd(of_kind)[:, : REQUIRED_VALUES[kind]] | ~np.isfinite(needed)
    return of_kind[~np.any(bad, axis=1)]


def series(samples: Samples, kind: Kind, epoch: int, width: int, delay: float = 0.0) -> tuple[Array, Array]:
    """Times of validity [s] (k,) and the first ``width`` values (k, width) of the usable samples, in order of time."""
    of_kind = usable(samples, kind)
    order = np.argsort(of_kind.stamp, kind="stable")
    time = seconds(of_kind.stamp[order], epoch) - delay
    return time, of_kind.values[order, :width]


def navigate(samples: Samples, aircraft: Aircraft) -> Navigation:
    """Smoothed navigation from IMU and GPS; InputError where the filter cannot start on them.

    With a noise that the aircraft file states too small it follows the wrong sensor, and is surer than it is: what the
    flight shows counts then.
    """
    require(samples, (Kind.IMU, Kind.GPS_POSITION, Kind.GPS_VELOCITY))
    used = samples[np.isin(samples.kind, USED)]
    understated = _understated(used, aircraft)
    with SmootherHistory() as tape:
        estimator = StateEstimator(_with_noise(aircraft, understated), tape=tape)
        estimator.push(used)
        estimator.flush()
        if estimator.epoch is None or not estimator.has_been_aligned:
            raise InputError(
                "the navigation never starts: it needs a second of IMU and GPS together, and motion "
                f"of more than {0.8 * aircraft.minimum_airspeed:.1f} m/s (from minimum_airspeed of the aircraft file)"
            )
        rows = estimator.smooth()
        epoch = estimator.epoch
    down = rows[:, StateField.POSITION.start + 2]
    places = rows[:, StateField.ORIGIN]
    known = places[np.isfinite(places).all(axis=1)]  # not where GPS positions were lost, and the filter then
    return Navigation(
        epoch,
        rows[:, StateField.TIME].copy(),
        rows[:, StateField.VELOCITY].copy(),
        rotation_matrices(rows[:, StateField.ATTITUDE]),
        rows[:, StateField.ANGULAR_VELOCITY].copy(),
        down[0] - down,
        rows[:, StateField.STANDARD_DEVIATIONS][:, D_ATTITUDE : D_ATTITUDE + 3].copy(),
        (known if len(known) else places)[-1].copy(),
        tuple(f"{stated_and_shown(name, *both)}: the calibration uses that" for name, both in understated.items()),
    )


def _understated(samples: Samples, aircraft: Aircraft) -> dict[str, tuple[Array, Array]]:
    """By sensor the noise that the aircraft file states and that of the flight, where this is clearly more."""
    sensors = by_name(aircraft.source.get("sensors"))
    stated = {name: aircraft.sensors[name].noise for name in _SENSORS if "noise" in sensors.get(name, {})}
    if not stated:
        return {}
    for name in stated:
        del sensors[name]["noise"]
    estimator = StateEstimator(aircraft_from_dict({**aircraft.source, "sensors": sensors}))
    estimator.push(samples)
    estimator.flush()
    shown = {each.name: each.in_use for each in found_noise(estimator) if each.source == FLIGHT}
    found = {name: (np.array(stated[name]), shown[name]) for name in stated if name in shown}
    return {name: both for name, both in found.items() if np.max(both[1] / both[0]) > _UNDERSTATED}


def _with_noise(aircraft: Aircraft, understated: Mapping[str, tuple[Array, Array]]) -> Aircraft:
    """The aircraft with the larger of what is stated and what the flight shows."""
    if not understated:
        return aircraft
    sensors = by_name(aircraft.source.get("sensors"))
    for name, both in understated.items():
        sensors[name]["noise"] = np.maximum(*both).tolist()
    return aircraft_from_dict({**aircraft.source, "sensors": sensors})


def in_span(samples: Samples, navigation: Navigation, span: tuple[float, float] | None) -> npt.NDArray[np.bool_]:
    """Which instants (n,) lie between two times [s] from the first sample of the recording; all without a span."""
    if span is None:
        return np.ones(len(navigation.time), dtype=bool)
    start = (first_and_last(samples.stamp)[0] - navigation.epoch) / NANOSECONDS
    return np.asarray((navigation.time >= start + span[0]) & (navigation.time <= start + span[1]))
