"""Layouts of the reconstructed state, (6.24) of docs/references.md.

(6.24) has u, v, w, position, attitude, six biases and the wind W; the velocity over ground is C (u, v, w) +
W. The filter carries u, v, w and the velocity over ground and forms the wind as their difference: the same
state in other coordinates. In them air data and GPS are nearly linear, each sees its own three numbers, while
with the wind as a coordinate an unknown heading bends what is known into a circle, and a filter that
linearises it becomes sure of a wrong wind (5 standard errors after 10 s of straight flight). A wandering wind
enters u, v, w as process noise, which (6.16)-(6.18) leave out. Attitude is a quaternion with a
rotation-vector error: regular in any attitude. The state belongs to the place of the IMU, which needs no
angular acceleration; outputs belong to the centre of gravity.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.iterated_ekf import working_size
from aircraft_sysid_ros.reconstruction.sensor_noise import SCALE, new_channels, new_imu_noise
from aircraft_sysid_ros.records import Record, record

# Nominal state, 19 numbers: velocity over ground and position NED, quaternion, biases, air-relative velocity.
VELOCITY = slice(0, 3)
POSITION = slice(3, 6)
ATTITUDE = slice(6, 10)
ACCELEROMETER_BIAS = slice(10, 13)
GYRO_BIAS = slice(13, 16)
AIR_VELOCITY = slice(16, 19)
STATE_SIZE = 19

# Its error, 18 numbers; first index of each block.
D_VELOCITY, D_POSITION, D_ATTITUDE, D_ACCELEROMETER_BIAS, D_GYRO_BIAS, D_AIR_VELOCITY = 0, 3, 6, 9, 12, 15
ERROR_SIZE = 18


class StateField:
    """Columns of a row of reconstructed states, one row per IMU sample."""

    TIME = 0
    AIR_VELOCITY = slice(1, 4)
    POSITION = slice(4, 7)
    VELOCITY = slice(7, 10)
    ATTITUDE = slice(10, 14)
    ACCELEROMETER_BIAS = slice(14, 17)
    GYRO_BIAS = slice(17, 20)
    WIND = slice(20, 23)
    STANDARD_DEVIATIONS = slice(23, 41)  # velocity, position, attitude, the biases, wind
    ACCELEROMETER_BIAS_STD = slice(32, 35)  # of these
    WIND_STD = slice(38, 41)  # of these
    SPECIFIC_FORCE = slice(41, 44)
    ANGULAR_VELOCITY = slice(44, 47)
    AIRSPEED = 47
    ANGLE_OF_ATTACK = 48
    SIDESLIP = 49
    AIR_DENSITY = 50
    AIR_VELOCITY_STD = 51
    CONSISTENCY = 52
    STATUS = 53
    FUSED = 54
    REJECTED = 55
    LATE = 56
    ORIGIN = slice(57, 60)  # latitude, longitude [rad], altitude [m] of POSITION
    CONTRADICTION = 60  # number in CONTRADICTED or SUSPECTED of the sensor that goes against others; 0: none does
    WIDTH = 61


class Status:
    """Values of StateField.STATUS: what the state rests on."""

    WAITING = 0
    OK = 1
    NO_GPS = 2
    NO_AIR_DATA = 3
    INERTIAL_ONLY = 4
    # as OK, but without vanes: an angle is inferred from wind and attitude
    INFERRED_ALPHA = 5
    INFERRED_BETA = 6
    INFERRED_ANGLES = 7
    # in a flight without GPS; with the angles that are inferred
    WITHOUT_GPS = 8
    WITHOUT_GPS_ALPHA = 9
    WITHOUT_GPS_BETA = 10
    WITHOUT_GPS_ANGLES = 11
    # the airspeed is that over ground, in air that is taken as calm
    CALM_AIR = 12
    CALM_AIR_ALPHA = 13
    CALM_AIR_BETA = 14
    CALM_AIR_ANGLES = 15


WITHOUT_GPS = range(Status.WITHOUT_GPS, Status.WITHOUT_GPS_ANGLES + 1)
#: Angles that no vane measures, by the status of a state that rests on air data, or on calm air in their place.
INFERRED: dict[int, tuple[str, ...]] = {
    status: angles
    for statuses in (
        (Status.OK, Status.INFERRED_ALPHA, Status.INFERRED_BETA, Status.INFERRED_ANGLES),
        WITHOUT_GPS,
        range(Status.CALM_AIR, Status.CALM_AIR_ANGLES + 1),
    )
    for status, angles in zip(statuses, ((), ("alpha",), ("beta",), ("alpha", "beta")), strict=True)
}
STATUS_TEXT = {
    Status.WAITING: "waiting for IMU, GPS or air data, and motion",
    Status.OK: "",
    Status.NO_GPS: "no GPS: dead reckoning on air data",
    Status.NO_AIR_DATA: "no airspeed now: wind is held",
    Status.INERTIAL_ONLY: "neither GPS nor air data: inertial only",
    Status.INFERRED_ALPHA: "no vane: angle of attack from wind and attitude",
    Status.INFERRED_BETA: "no vane: sideslip from wind and attitude",
    Status.INFERRED_ANGLES: "no vanes: angle of attack and sideslip from wind and attitude",
}
_NO_VANE = (
    "",
    "; no vane: angle of attack inferred",
    "; no vane: sideslip inferred",
    "; no vanes: both angles inferred",
)
for _first, _words in (
    (Status.WITHOUT_GPS, "no GPS: motion is relative to the air, wind is not estimated"),
    (Status.CALM_AIR, "no airspeed: the air is taken as calm"),
):
    STATUS_TEXT.update({_first + _number: _words + _more for _number, _more in enumerate(_NO_VANE)})


#: Sensors that the motion may contradict, by their numbers in a row: wired, mounted or scaled in another way.
CONTRADICTED = dict(
    enumerate(
        (
            "accelerometers", "gyros", "attitude", "GPS position", "GPS velocity", "airspeed", "angle of attack",
            "sideslip", "static pressure",
        ),
        start=1,
    )
)  # fmt: skip


_IMU = ("accelerometers", "gyros")

#: Sensors whose innovations alone are too large just now, by their numbers in a row. The IMU predicts all: where
#: several have such, it is the IMU, or more than one of them.
SUSPECTED = dict(
    enumerate(("GPS", "airspeed", "angle of attack", "sideslip", "attitude", "IMU or several sensors"), start=10)
)


def contradiction_text(code: int) -> str:
    """Words for a value of ``StateField.CONTRADICTION``; empty for 0."""
    if code in SUSPECTED:
        return f"innovations of the {SUSPECTED[code]} are too large"
    of_sensor = {"airspeed": "sign, unit or scale"} | dict.fromkeys(_IMU, "sign, unit, axes, place or time")
    kinds = of_sensor.get(CONTRADICTED.get(code, ""), "sign, unit, axes or place")
    return f"{kinds} of the {CONTRADICTED[code]} contradict the other sensors" if code else ""


#: What is said where the IMU, with which all motion is compared, contradicts the other sensors.
OF_THE_IMU = tuple(contradiction_text(code) for code, sensor in CONTRADICTED.items() if sensor in _IMU)


@cache
def status_text(status: int, contradiction: int = 0) -> str:
    """Words for values of ``StateField.STATUS`` and ``CONTRADICTION``; empty where nothing is to be said."""
    return "; ".join(filter(None, (contradiction_text(contradiction), STATUS_TEXT[status])))


#: One sigma [m/s] NED of the wind about the mean of the air in a flight without GPS, from which velocities are counted.
GUST_STD = np.array([3.0, 3.0, 1.5])


class Setup(Record):
    """What the jitted loop needs to know of aircraft and options."""

    gravity: float  # [m/s^2]
    origin: npt.NDArray[np.float64]  # (3,) latitude, longitude [rad], altitude [m]
    imu_position: npt.NDArray[np.float64]  # (3,) FRD from the centre of gravity [m]
    gps_from_imu: npt.NDArray[np.float64]  # (3,)
    probe_from_imu: npt.NDArray[np.float64]  # (3,)
    probe_doubt: npt.NDArray[np.float64]  # (kinds, 3) one sigma of where it is, by the aircraft file [m], for air data
    declination: float  # [rad], NaN: the magnetometer is not fused
    minimum_airspeed: float  # [m/s]
    variance: npt.NDArray[np.float64]  # (kinds, 3) of the measurement, from the aircraft file or its defaults
    given: npt.NDArray[np.int64]  # (kinds,) 1: the aircraft file says it, which goes before the message's covariance
    accelerometer_variance: float
    gyro_variance: float
    imu_given: npt.NDArray[np.int64]  # (2,) as ``given``, of accelerometer and gyro
    learns: bool  # what the flight shows of its noise; False: it is as another run has learnt it
    learns_wind: bool  # the aircraft file says neither the random walk of the wind nor the noise of air data
    accelerometer_walk: float  # [m/s^2 per sqrt(s)]
    gyro_walk: float
    wind_walk: float  # at least; gusts raise it
    gate: npt.NDArray[np.float64]  # (4,) largest normalised innovation squared for 1, 2, 3 outputs, by index
    maximum_iterations: int
    tolerance: float
    maximum_gap: float  # [s] longest step between IMU samples that is still integrated
    divergence_time: float  # [s] of rejected GPS after which the state is given up
    guide: int  # kind of sample that shows the motion over ground: GPS_VELOCITY, else GPS_POSITION, else NO_GUIDE
    wind_std: npt.NDArray[np.float64]  # (3,) NED [m/s] of a wind that is held about zero, NaN: it is free
    is_calm: bool  # and so in place of a measured airspeed


def without_wind(rows: npt.NDArray[np.float64]) -> None:
    """Take the wind out of rows (n, StateField.WIDTH) in which it is not estimated, in place."""
    rows[:, StateField.WIND] = rows[:, StateField.WIND_STD] = np.nan


def in_moving_air(rows: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Rows (n, StateField.WIDTH) in which a wind that is not estimated is 0: velocities count from the mean of the air.

    Its standard deviation is that of gusts.
    """
    unknown = np.isnan(rows[:, StateField.WIND.start])
    if not unknown.any():
        return rows
    rows = rows.copy()
    rows[unknown, StateField.WIND] = 0.0
    rows[unknown, StateField.WIND_STD] = GUST_STD
    return rows


#: ``Setup.guide`` of a flight without GPS.
NO_GUIDE = -1


class Memory(Record):
    """What the jitted loop changes besides state and covariance."""

    imu: npt.NDArray[np.float64]  # (7,) time, specific force, angular rate as measured
    imu_before: npt.NDArray[np.float64]  # (7,) the sample before it
    imu_first: npt.NDArray[np.float64]  # (7,) and the one before that
    line: npt.NDArray[np.float64]  # (6,) random walk of what samples are of [square per s], see ``sparse_imu``
    motion: npt.NDArray[np.float64]  # (2, 6) mean and variance of what the IMU has measured lately, see ``sparse_imu``
    shown_since: npt.NDArray[np.float64]  # (1,) time [s] since which it shows its newest sample
    sparse: npt.NDArray[np.int64]  # (1,) votes for an IMU that is slow, see ``sparse_imu``
    air: npt.NDArray[np.float64]  # (3,) newest density [kg/m^3], over that of the standard atmosphere, and when [s]
    fused: npt.NDArray[np.int64]  # (kinds,)
    rejected: npt.NDArray[np.int64]  # (kinds,)
    skipped: npt.NDArray[np.int64]  # (kinds,) not usable now, such as air data on the ground
    last_fused: npt.NDArray[np.float64]  # (kinds,) time [s]
    last_rejected: npt.NDArray[np.float64]  # (kinds,)
    nis_sum: npt.NDArray[np.float64]  # (kinds,) of fused samples
    degrees: npt.NDArray[np.int64]  # (kinds,) degrees of freedom in nis_sum
    #: (kinds, 8) sums over innovations: outputs, normalised squares (capped), ln det S, squares of normalised ones, and
    #: of their means, as large where they are white; then those means
    likelihood: npt.NDArray[np.float64]
    recent_nis: npt.NDArray[np.float64]  # (1,) running mean per output, rejected samples too, without the magnetometer
    own_nis: npt.NDArray[np.float64]  # (kinds,) the same of each sensor, over half a second
    air_nis: npt.NDArray[np.float64]  # (1,) the same of air data alone, faster
    wind_walk: npt.NDArray[np.float64]  # (1,) [m/s per sqrt(s)] as the air data ask for just now
    innovation: npt.NDArray[np.float64]  # (kinds, 3) the newest
    assumed: npt.NDArray[np.float64]  # (kinds,) time [s] of the newest pseudo-measurement in place of a sensor
    calm_walk: npt.NDArray[np.float64]  # (1,) least random walk of the wind: as the flight has it, or the setup
    noise: npt.NDArray[np.float64]  # (kinds, 3, CHANNEL_WIDTH) what was learnt of each sensor, see ``sensor_noise``
    imu_noise: npt.NDArray[np.float64]  # (7, 6) the same of the IMU
    attitude_doubt: npt.NDArray[np.float64]  # (3,) what an attitude may be off in the mean of a flight [rad]
    moved: npt.NDArray[np.float64]  # (kinds + 1, 24) sums of all corrections, at the newest sample of a kind; last: now
    eta: npt.NDArray[np.float64]  # (25,) working memory of an update: the state, its residual (3,), and the rest
    residual: npt.NDArray[np.float64]
    working: npt.NDArray[np.float64]


class LearntNoise(NamedTuple):
    """What a filter has learnt of noise and gusts in a flight, for another run over it."""

    scales: npt.NDArray[np.float64]  # (kinds, 3) factors on the variances of sensors
    imu: npt.NDArray[np.float64]  # (7, 6) as ``Memory.imu_noise``
    calm_walk: npt.NDArray[np.float64]  # (1,) as ``Memory.calm_walk``


def learnt_noise(memory: Memory) -> LearntNoise:
    """What has been learnt."""
    return LearntNoise(memory.noise[:, :, SCALE].copy(), memory.imu_noise.copy(), memory.calm_walk.copy())


def take_noise(memory: Memory, noise: LearntNoise, learns_wind: bool) -> None:
    """Begin with what another run has learnt; of the gusts where the aircraft file does not say how they are."""
    memory.noise[:, :, SCALE], memory.imu_noise[:] = noise.scales, noise.imu
    if learns_wind:
        memory.calm_walk[:] = noise.calm_walk


#: Random walk of the wind [m/s per sqrt(s)] at the start: that of moderate turbulence.
GUSTY_START = 1.0


def new_memory(kinds: int, wind_walk: float) -> Memory:
    """Memory at the start of a flight, with the random walk of the wind [m/s per sqrt(s)] of the aircraft file.

    The wind is allowed to be gusty until the air data say that it is not: gusts that are taken for a steady wind
    would be explained by tilt and accelerometer bias, and a bias that is known too well is never found again.
    """
    return record(
        Memory,
        imu=np.zeros(7),
        imu_before=np.full(7, -np.inf),
        imu_first=np.full(7, -np.inf),
        line=np.zeros(6),
        motion=np.zeros((2, 6)),
        shown_since=np.full(1, np.inf),
        sparse=np.zeros(1, np.int64),
        air=np.full(3, np.nan),
        fused=np.zeros(kinds, np.int64),
        rejected=np.zeros(kinds, np.int64),
        skipped=np.zeros(kinds, np.int64),
        last_fused=np.full(kinds, -np.inf),
        last_rejected=np.full(kinds, -np.inf),
        nis_sum=np.zeros(kinds),
        degrees=np.zeros(kinds, np.int64),
        likelihood=np.zeros((kinds, 8)),
        recent_nis=np.ones(1),
        own_nis=np.ones(kinds),
        air_nis=np.ones(1),
        wind_walk=np.array([max(wind_walk, GUSTY_START)]),
        innovation=np.full((kinds, 3), np.nan),
        assumed=np.full(kinds, -np.inf),
        calm_walk=np.array([wind_walk]),
        noise=new_channels(kinds),
        imu_noise=new_imu_noise(),
        attitude_doubt=np.zeros(3),
        moved=np.zeros((kinds + 1, 24)),
        eta=np.zeros(25),
        residual=np.zeros(3),
        working=np.zeros(working_size(3, 24)),
    )
