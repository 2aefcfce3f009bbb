"""An aeroplane that is flown by whoever commands it, step by step, with sensors that speak at once.

The physics is that of dynamics.py and wind.py. The sensors are those of sensors.py, sampled at the instants of the IMU
and without delay, because what they show decides what is commanded next; their biases are constant. The aeroplane may
be damaged and a sensor may fail at a time that nobody tells the controller.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft import atmosphere
from aircraft_sysid_ros.aircraft.configuration import SURFACES, Aircraft
from aircraft_sysid_ros.aircraft.earth import Odometer
from aircraft_sysid_ros.aircraft.frames import (
    air_data_from_velocity,
    quaternion_exp,
    quaternion_product,
    rotation_matrix,
)
from aircraft_sysid_ros.aircraft.rigid_body import cross
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.kernels import njit
from aircraft_sysid_ros.samples import Kind, Samples, concatenate, samples_of
from aircraft_sysid_ros.sensors.sensor_models import Stamps, generator, stamps_of
from aircraft_sysid_ros.simulation.closed_loop_faults import Fault
from aircraft_sysid_ros.simulation.dynamics import (
    ATTITUDE,
    CONTROLS,
    POSITION,
    RATES,
    VELOCITY,
    Airframe,
    Place,
    airframe_of,
    motion,
    runge_kutta_step,
)
from aircraft_sysid_ros.simulation.flight import HEIGHT, prepare
from aircraft_sysid_ros.simulation.wind import low_altitude_turbulence, wind_series

Array = npt.NDArray[np.float64]

#: Time [s] between samples of the IMU and between commands, and steps of the motion in between.
STEP, SUBSTEPS = 0.01, 2
#: One sigma of what does not change in a flight: accelerometers [m/s^2], gyros [rad/s], the autopilot's attitude [rad].
_ACCELEROMETER_BIAS, _GYRO_BIAS, _ATTITUDE_OFFSET = 0.15, 0.01, 0.005
_ATTITUDE_NOISE = 0.002  # [rad]
#: What damage does.
ELEVATOR_LEFT, AILERON_LEFT = 0.5, 0.5  # share of the effect
TRAILING = np.radians(4.0)  # [rad] at which the lost half of the aileron stays
AFT = 0.06  # [chords] by which the centre of gravity moves

DAMAGES = ("none", "elevator", "aileron", "cg_aft")
#: The autopilot's own attitude, as the MAVLink bridge publishes it; the other topics are inputs of the estimators.
ATTITUDE_TOPIC = "autopilot/attitude"


@dataclass(frozen=True)
class Damage:
    """An aeroplane after something happened to it."""

    coefficients: Mapping[str, float]  # about the aerodynamic reference
    aft: float = 0.0  # [m] the centre of gravity is behind where the file has it

    def apparent(self, aircraft: Aircraft) -> dict[str, float]:
        """Coefficients that describe its motion with the mass properties of the file.

        With the reference ``aft`` ahead of the centre of gravity, M_cg = M + (aft, 0, 0) x F, term by term
        C_m' = C_m - (aft / c) C_Z and C_n' = C_n + (aft / b) C_Y. Raises InputError where C_m or C_n has not the
        terms of C_Z or C_Y.
        """
        found = dict(self.coefficients)
        for axis, force, share in (("Cm", "CZ", -self.aft / aircraft.chord), ("Cn", "CY", self.aft / aircraft.span)):
            for name in aircraft.model.parameter_names[aircraft.model.axis_slice(force)] if self.aft else ():
                of_moment = axis + name[len(force) :]
                if of_moment not in found:
                    raise InputError(f"a centre of gravity that moves needs {of_moment} in the model")
                found[of_moment] += share * self.coefficients[name]
        return found


def damage_of(aircraft: Aircraft, name: str) -> Damage:
    """One of DAMAGES, with the coefficients of an aircraft file of the textbook terms; InputError for another name."""
    known = dict(aircraft.coefficients)
    if name == "none":
        return Damage(known)
    if name == "elevator":
        halved = {key: ELEVATOR_LEFT * known[key] for key in ("CX_de", "CZ_de", "Cm_de")}
        return Damage(known | halved)
    if name == "aileron":
        for axis in ("CY", "Cl", "Cn"):
            lost = (1.0 - AILERON_LEFT) * known[f"{axis}_da"]
            known[f"{axis}_da"] -= lost
            known[f"{axis}_0"] += lost * TRAILING
        return Damage(known)
    if name == "cg_aft":
        return Damage(known, AFT * aircraft.chord)
    raise InputError(f"unknown damage '{name}': use one of {' '.join(DAMAGES)}")


class Reading:
    """Columns of what noiseless sensors show, and of the truth for logs."""

    FORCE = slice(0, 3)  # [m/s^2] at the IMU
    RATES = slice(3, 6)  # [rad/s]
    AIR = slice(6, 11)  # airspeed [m/s], alpha, beta [rad] at the probe, density [kg/m^3], static pressure [Pa]
    POSITION = slice(11, 14)  # [m] NED, of the antenna
    VELOCITY = slice(14, 17)  # [m/s] NED, of the antenna
    QUATERNION = slice(17, 21)
    CONTROLS = slice(21, 28)  # as in samples.Kind.CONTROLS
    TRUE_AIR = slice(28, 31)  # airspeed, alpha, beta at the centre of gravity
    HEIGHT = 31  # [m]
    WIDTH = 32


@njit(cache=True)
def read(airframe: Airframe, place: Place, positions: Array, state: Array, wind: Array, time: float) -> Array:
    """Row of Reading of a state (17,): ``positions`` (3, 3) of IMU, probe and antenna from the centre of gravity."""
    out = np.empty(32)
    acting = motion(airframe, place, state, wind, time)
    rates, quaternion = state[RATES : RATES + 3], state[ATTITUDE : ATTITUDE + 4]
    to_world = rotation_matrix(quaternion)
    centripetal = cross(rates, cross(rates, positions[0]))
    out[0:3] = acting.specific_force + cross(acting.angular_acceleration, positions[0]) + centripetal
    out[3:6] = rates
    out[6:9] = np.array(air_data_from_velocity(acting.air_velocity + cross(rates, positions[1])))
    altitude = place.altitude - state[POSITION + 2]
    out[9], out[10] = atmosphere.air_density(altitude), atmosphere.pressure(altitude)
    out[11:14] = state[POSITION : POSITION + 3] + to_world @ positions[2]
    out[14:17] = state[VELOCITY : VELOCITY + 3] + to_world @ cross(rates, positions[2])
    out[17:21] = quaternion
    out[21:24], out[24], out[25] = state[CONTROLS : CONTROLS + 3], place.flaps, state[CONTROLS + 3]
    out[26], out[27] = acting.thrust, airframe.propeller_speed * np.sqrt(state[CONTROLS + 3])
    out[28:31] = np.array(air_data_from_velocity(acting.air_velocity))
    out[31] = altitude - place.ground
    return out


class Sensed(NamedTuple):
    """One sample of a topic: FRD, NED, SI. Latitude, longitude [rad] and altitude for gps/fix."""

    topic: str
    stamp: int  # [ns]
    values: Array


#: Values per sample by topic, and the rate [Hz] by the sensor of the aircraft file.
_TOPICS = {
    "imu/data": (6, "accelerometer"), ATTITUDE_TOPIC: (3, "accelerometer"), "air_data": (5, "airspeed"),
    "control_surfaces": (7, "control_surfaces"), "gps/fix": (3, "gps_position"), "gps/vel": (3, "gps_velocity"),
}  # fmt: skip


class Sensors:
    """Sensors of one flight: noise of the aircraft file, biases drawn from the seed, a fault if there is one."""

    def __init__(self, aircraft: Aircraft, origin: Array, seed: int, count: int, fault: Fault) -> None:
        """``count``: steps of the flight. Raises InputError for errors of sensors that these do not have."""
        for name, sensor in aircraft.sensors.items():
            has = {key: getattr(sensor, key) for key in ("delay", "lag", "drift", "offset") if getattr(sensor, key)}
            has |= {"scale": sensor.scale} if sensor.scale != 1.0 else {}
            for key, value in has.items():
                raise InputError(
                    f"the closed loop takes {name} as without error: remove the {key} of {value:g} from the aircraft "
                    f"file of '{aircraft.name}', or the estimators allow for what is not there"
                )
        self._odometer, self._fault = Odometer(origin), fault
        self._signs = np.array([aircraft.surface_signs[name] for name in SURFACES])
        self._every = {t: max(round(1.0 / (STEP * aircraft.sensors[s].rate)), 1) for t, (_, s) in _TOPICS.items()}
        rng = generator(seed, "biases in closed loop")
        sizes = np.repeat([_ACCELEROMETER_BIAS, _GYRO_BIAS, _ATTITUDE_OFFSET], 3)
        self.biases = sizes * rng.standard_normal(9)
        sigma = _noise(aircraft)
        self._noise = {
            topic: sigma[topic] * generator(seed, topic + " in closed loop").standard_normal((count + 1, width))
            for topic, (width, _) in _TOPICS.items()
        }

    def sense(self, step: int, reading: Array) -> list[Sensed]:
        """What is sampled at a step, from a row of Reading; those of one instant in the order of _TOPICS."""
        stamp = int(stamps_of(step * STEP))
        found = []
        for topic, every in self._every.items():
            if step % every == 0:
                values = self._shown(topic, reading) + self._noise[topic][step]
                if topic == "gps/fix":
                    values = self._odometer.place_at(values)
                elif topic == ATTITUDE_TOPIC:
                    values = quaternion_product(reading[Reading.QUATERNION], quaternion_exp(values))
                elif topic == "control_surfaces":
                    values[:4] *= self._signs
                shown = self._fault.shown(topic, step * STEP, values)
                if shown is not None:
                    found.append(Sensed(topic, stamp, shown))
        return found

    def _shown(self, topic: str, reading: Array) -> Array:
        if topic == "imu/data":
            return reading[:6] + self.biases[:6]
        if topic == ATTITUDE_TOPIC:  # a rotation vector, body axes
            return self.biases[6:]
        columns = {"air_data": Reading.AIR, "control_surfaces": Reading.CONTROLS, "gps/fix": Reading.POSITION}
        return np.asarray(reading[columns.get(topic, Reading.VELOCITY)])


def _noise(aircraft: Aircraft) -> dict[str, Array]:
    """One sigma by topic. Density is worked out from the measured pressure and has the same relative noise."""
    sigma = {name: np.array(sensor.noise) for name, sensor in aircraft.sensors.items()}
    pressure = float(sigma["static_pressure"][0])
    air = [float(sigma[name][0]) for name in ("airspeed", "angle_of_attack", "sideslip")]
    return {
        "imu/data": np.repeat([sigma["accelerometer"][0], sigma["gyro"][0]], 3),
        ATTITUDE_TOPIC: np.full(3, _ATTITUDE_NOISE),
        "air_data": np.array([*air, pressure / atmosphere.SEA_LEVEL_PRESSURE, pressure]),
        "control_surfaces": np.array([*([float(sigma["control_surfaces"][0])] * 4), 0.0, 0.0, 0.0]),
        "gps/fix": sigma["gps_position"],
        "gps/vel": sigma["gps_velocity"],
    }


class SteppedAeroplane:
    """The aeroplane of an aircraft file in the air, from trim on."""

    def __init__(
        self,
        aircraft: Aircraft,
        seed: int,
        duration: float,
        *,
        turbulence: float = 4.0,
        wind: npt.ArrayLike = (3.0, -2.0, 0.0),
        damage: Damage | None = None,
        fault: Fault | None = None,
        change_time: float = np.inf,
    ) -> None:
        """``turbulence`` [m/s]: wind at 20 ft of MIL-F-8785C, 0 for none. ``change_time`` [s]: when damage is done.

        Raises InputError when the aeroplane cannot be trimmed, and for errors of sensors that these do not have.
        """
        self.aircraft, self.setup = aircraft, prepare(aircraft)
        self.count, self.change_time = round(duration / STEP), change_time
        self._before, self._after = self.setup.airframe, self._damaged(damage)
        places = np.array([aircraft.imu_position, aircraft.air_data_position, aircraft.gps_position])
        self._places = [places, places + [0.0 if damage is None else damage.aft, 0.0, 0.0]]
        airspeed = self.setup.trim.airspeed
        gusts = low_altitude_turbulence(HEIGHT, turbulence) if turbulence > 0.0 else None
        rows, walk = self.count * SUBSTEPS + 1, aircraft.process_noise["wind"]
        self._wind = np.ascontiguousarray(
            wind_series(generator(seed, "wind"), rows, STEP / SUBSTEPS, wind, walk, airspeed, gusts)
        )
        self.state = self.setup.trim.state.copy()
        self.state[VELOCITY : VELOCITY + 3] += self._wind[0]
        self.step_number = 0
        self.sensors = Sensors(aircraft, self.setup.origin, seed, self.count, fault or Fault())

    def _damaged(self, damage: Damage | None) -> Airframe:
        if damage is None:
            return self.setup.airframe
        airframe = airframe_of(replace(self.aircraft, coefficients=dict(damage.coefficients)))
        return airframe._replace(reference=airframe.reference + np.array([damage.aft, 0.0, 0.0]))

    @property
    def time(self) -> float:
        """Time of flight [s]."""
        return self.step_number * STEP

    @property
    def is_changed(self) -> bool:
        """Whether what happens has happened."""
        return self.time >= self.change_time

    def look(self) -> tuple[Array, list[Sensed]]:
        """The row of Reading now, and what the sensors show; once per step."""
        airframe = self._after if self.is_changed else self._before
        wind = self._wind[self.step_number * SUBSTEPS]
        reading = read(airframe, self.setup.place, self._places[int(self.is_changed)], self.state, wind, self.time)
        return reading, self.sensors.sense(self.step_number, reading)

    def advance(self, command: Array) -> None:
        """Fly one STEP with commanded elevator, aileron, rudder [rad] and throttle, shape (4,), held."""
        airframe = self._after if self.is_changed else self._before
        step = STEP / SUBSTEPS
        for part in range(SUBSTEPS):
            k = self.step_number * SUBSTEPS + part
            wind, following = self._wind[k], self._wind[min(k + 1, len(self._wind) - 1)]
            self.state = runge_kutta_step(
                airframe, self.setup.place, self.state, command, wind, following, k * step, step
            )
        self.step_number += 1


def samples_of_sensed(sensed: Sequence[Sensed]) -> Samples:
    """Samples for the estimators, in order; the autopilot's own attitude is not for them."""
    batches: list[Samples] = []
    keys: list[npt.NDArray[np.int64]] = []
    for topic, convert in _SAMPLES.items():
        at = np.array([i for i, one in enumerate(sensed) if one.topic == topic], dtype=np.int64)
        if len(at):
            parts = convert(np.array([sensed[i].stamp for i in at]), np.array([sensed[i].values for i in at]))
            batches += parts
            keys += [at] * len(parts)
    return concatenate(batches)[np.argsort(np.concatenate(keys), kind="stable")] if batches else concatenate([])


def _of_air(stamp: Stamps, values: Array) -> list[Samples]:
    kinds = (Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP)
    parts = [samples_of(kind, stamp, values[:, column]) for column, kind in enumerate(kinds)]
    return [*parts, samples_of(Kind.AIR, stamp, values[:, 3:])]


def _whole(kind: Kind) -> Callable[[Stamps, Array], list[Samples]]:
    return lambda stamp, values: [samples_of(kind, stamp, values)]


_SAMPLES: dict[str, Callable[[Stamps, Array], list[Samples]]] = {
    "imu/data": _whole(Kind.IMU),
    "air_data": _of_air,
    "control_surfaces": _whole(Kind.CONTROLS),
    "gps/fix": _whole(Kind.GPS_POSITION),
    "gps/vel": _whole(Kind.GPS_VELOCITY),
}
