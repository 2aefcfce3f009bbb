"""What the jitted loop needs to know of aircraft and options."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.earth import gravity
from aircraft_sysid_ros.aircraft.sensor_settings import SENSOR_GROUPS
from aircraft_sysid_ros.aircraft.unsaid_places import doubt_of_vanes
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.sensor_noise import believed_variance
from aircraft_sysid_ros.reconstruction.state import GUST_STD, NO_GUIDE, Setup
from aircraft_sysid_ros.records import record, replaced
from aircraft_sysid_ros.samples import Kind, Samples
from aircraft_sysid_ros.stamps import NANOSECONDS, seconds

Array = npt.NDArray[np.float64]

#: One sigma [m/s] NED of the wind in air that is taken as calm.
CALM_STD = np.array([0.2, 0.2, 0.2])

#: Innovations that are less probable by chance are not rejected at all: numbers end there, at 37 sigma.
_NEVER = 1e-300

#: Which sensor of the aircraft file a kind of sample comes from.
SENSOR_OF_KIND = {
    Kind.IMU: "accelerometer",
    Kind.ATTITUDE: "attitude",
    Kind.MAGNETIC_FIELD: "magnetometer",
    Kind.GPS_POSITION: "gps_position",
    Kind.GPS_VELOCITY: "gps_velocity",
    Kind.AIRSPEED: "airspeed",
    Kind.ANGLE_OF_ATTACK: "angle_of_attack",
    Kind.SIDESLIP: "sideslip",
    Kind.AIR: "static_pressure",
    Kind.CONTROLS: "control_surfaces",
    Kind.HEIGHT: "height_above_ground",
    Kind.FIVE_HOLE: "five_hole_probe",
    Kind.INPUTS: "control_surfaces",
}


def sensor_scales(aircraft: Aircraft) -> Array:
    """Scale of the first value by kind, shape (kinds,)."""
    scales = np.ones(len(Kind))
    for kind, sensor in SENSOR_OF_KIND.items():
        scales[kind] = aircraft.sensors[sensor].scale
    return scales


def sensor_delays(aircraft: Aircraft) -> Array:
    """Delay [s] by kind, shape (kinds,)."""
    delays = np.zeros(len(Kind))
    for kind, sensor in SENSOR_OF_KIND.items():
        delays[kind] = aircraft.sensors[sensor].delay
    return delays


def stamp_delays(aircraft: Aircraft) -> npt.NDArray[np.int64]:
    """The same in whole nanoseconds, as they are taken off stamps."""
    return np.asarray(np.rint(sensor_delays(aircraft) * NANOSECONDS).astype(np.int64))


def measured_at(samples: Samples, delays: npt.NDArray[np.int64], epoch: int) -> Array:
    """Times (n,) [s] after an epoch [ns] at which samples were measured: stamps without the ``stamp_delays``."""
    return seconds(samples.stamp - delays[samples.kind], epoch)


def gate_thresholds(sigma: float) -> Array:
    """Largest normalised innovation squared (4,) for 0 to 3 outputs, as probable as ``sigma`` in one output."""
    outside = math.erfc(sigma / math.sqrt(2.0))
    if outside < _NEVER:
        return np.array([0.0, math.inf, math.inf, math.inf])
    return np.array([0.0, sigma**2, -2.0 * math.log(outside), _beyond_of_three(sigma, outside) ** 2])


def _beyond_of_three(sigma: float, outside: float) -> float:
    """Length that three normal numbers exceed with a probability, beyond that of ``sigma``: Newton's, for its log.

    It is sqrt(2 / pi) r exp(-r^2 / 2) + erfc(r / sqrt(2)). SciPy's inverse of it ends at 8 sigma.
    """
    r = math.sqrt(sigma**2 + 2.0)
    for _ in range(10):
        density = math.sqrt(2.0 / math.pi) * math.exp(-0.5 * r * r)
        chance = r * density + math.erfc(r / math.sqrt(2.0))
        r += math.log(chance / outside) * chance / (r * r * density)
    return r


def with_options(setup: Setup, options: StateOptions, gate: Array) -> Setup:
    """The setup with other options, of which ``gate`` is that of ``gate_thresholds``."""
    return replaced(
        setup,
        gate=gate,
        maximum_iterations=int(options.maximum_iterations),
        tolerance=float(options.tolerance),
        maximum_gap=float(options.maximum_gap),
        divergence_time=float(options.divergence_time),
    )


def _doubt_of_probe(aircraft: Aircraft) -> Array:
    """``Setup.probe_doubt``: as large in what a sensor shows, whatever its scale or that of the airspeed.

    Else a scale would be likelier for the doubt alone, which is a guess: faster air makes a lever arm a smaller angle.
    """
    doubt, fast = np.zeros((len(Kind), 3)), aircraft.sensors["airspeed"].scale
    for kind in (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP):
        own = 1.0 if kind == Kind.AIRSPEED else aircraft.sensors[SENSOR_OF_KIND[kind]].scale
        doubt[kind] = doubt_of_vanes(aircraft) / (own * fast)
    return doubt


def guide_of(gps: frozenset[int]) -> int:
    """``Setup.guide`` where these kinds of GPS samples are there."""
    return int(next((kind for kind in (Kind.GPS_VELOCITY, Kind.GPS_POSITION) if kind in gps), NO_GUIDE))


def held_wind(options: StateOptions, guide: int) -> Array:
    """One sigma NED (3,) [m/s] of a wind that is held about zero; NaN where GPS and air data tell it."""
    if guide == NO_GUIDE:
        return GUST_STD
    return CALM_STD if options.calm_air else np.full(3, np.nan)


def new_setup(
    aircraft: Aircraft,
    options: StateOptions,
    gate: Array,
    origin: Array,
    imu: Array,
    guide: int = Kind.GPS_VELOCITY,
    learns: bool = True,
) -> Setup:
    """Setup of a flight with the origin (3,) of its positions; the first IMU sample may carry variances.

    A latitude of NaN: no GPS shows the position, and the height is that of the static pressure.
    """
    variance, given = np.ones((len(Kind), 3)), np.zeros(len(Kind), np.int64)
    for kind, name in SENSOR_OF_KIND.items():
        variance[kind] = np.square(aircraft.sensors[name].noise_of_true)
        given[kind] = aircraft.sensors[name].noise_is_given
    declination = aircraft.magnetic_declination
    of_imu = [aircraft.sensors[name].noise_is_given for name in ("accelerometer", "gyro")]
    return record(
        Setup,
        gravity=float(gravity(origin[0], origin[2])),
        origin=origin,
        imu_position=aircraft.imu_position,
        gps_from_imu=aircraft.gps_position - aircraft.imu_position,
        probe_from_imu=aircraft.air_data_position - aircraft.imu_position,
        probe_doubt=_doubt_of_probe(aircraft),
        declination=np.nan if declination is None else float(declination),
        minimum_airspeed=float(aircraft.minimum_airspeed),
        variance=variance,
        given=given,
        accelerometer_variance=_imu_variance(aircraft, "accelerometer", float(imu[6])),
        gyro_variance=_imu_variance(aircraft, "gyro", float(imu[7])),
        imu_given=np.array(of_imu, np.int64),
        learns=learns,
        learns_wind=learns_wind(aircraft) and guide != NO_GUIDE and not options.calm_air,
        accelerometer_walk=float(aircraft.process_noise["accelerometer_bias"]),
        gyro_walk=float(aircraft.process_noise["gyro_bias"]),
        wind_walk=float(aircraft.process_noise["wind"]),
        gate=gate,
        maximum_iterations=int(options.maximum_iterations),
        tolerance=float(options.tolerance),
        maximum_gap=float(options.maximum_gap),
        divergence_time=float(options.divergence_time),
        guide=int(guide),
        wind_std=held_wind(options, guide),
        is_calm=bool(options.calm_air and guide != NO_GUIDE),
    )


def learns_wind(aircraft: Aircraft) -> bool:
    """Whether the random walk of the wind is found in flight: the file says neither it nor the noise of air data."""
    if aircraft.process_noise["wind"] <= 0.0 or (aircraft.source.get("process_noise") or {}).get("wind") is not None:
        return False
    return not any(aircraft.sensors[name].noise_is_given for name in SENSOR_GROUPS["air_data"])


def _imu_variance(aircraft: Aircraft, sensor: str, carried: float) -> float:
    """From the aircraft file if it says so, else from the message, else the default."""
    configured = aircraft.sensors[sensor]
    if carried > 0.0 and not configured.noise_is_given:
        return believed_variance(carried, configured.noise[0] ** 2)
    return float(configured.noise[0] ** 2)
