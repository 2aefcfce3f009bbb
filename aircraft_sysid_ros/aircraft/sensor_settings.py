"""What an aircraft file says of the sensors, and of what walks at random beside them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from aircraft_sysid_ros.aircraft.file_values import (
    LEAST_NOISE,
    between,
    check_keys,
    number_of,
    positive,
    reject,
    said_or_found,
)
from aircraft_sysid_ros.errors import InputError


@dataclass(frozen=True)
class Sensor:
    """One sensor: noise is one sigma per sample and axis, in the sensor's unit; rate [Hz]; delay [s].

    What it shows is scale times the true value, and the noise; only SCALED_SENSORS have another scale than 1.
    """

    noise: tuple[float, ...]
    rate: float
    delay: float = 0.0
    noise_is_given: bool = False  # by the aircraft file: then it goes before the covariance of the messages
    scale: float = 1.0
    drift: float = 0.0  # [1/s] of the scale of an airspeed, [rad/s] of an angle, from when the filter starts
    offset: float = 0.0  # [rad] of an angle of flow
    lag: float = 0.0  # [s] time constant with which servos follow what is recorded of the control surfaces
    late_std: float = 0.0  # [s] one sigma of a delay or a lag of those that was found

    @property
    def noise_of_true(self) -> tuple[float, ...]:
        """One sigma of what is left of a sample when the scale is taken off it."""
        return tuple(one / self.scale for one in self.noise)


#: A small UAV. Units of the noise: m/s^2, rad/s, rad, rad (of heading), m (N, E, D), m/s (N, E, D), m/s, rad,
#: rad, Pa, Pa, rad, m.
DEFAULT_SENSORS: dict[str, Sensor] = {
    "accelerometer": Sensor((0.1,), 100.0),
    "gyro": Sensor((0.005,), 100.0),
    "attitude": Sensor((0.03,), 50.0),
    "magnetometer": Sensor((0.1,), 10.0),
    "gps_position": Sensor((1.5, 1.5, 3.0), 5.0),
    "gps_velocity": Sensor((0.2, 0.2, 0.4), 5.0),
    "airspeed": Sensor((0.3,), 50.0),
    "angle_of_attack": Sensor((0.005,), 50.0),
    "sideslip": Sensor((0.005,), 50.0),
    "static_pressure": Sensor((20.0,), 50.0),
    "five_hole_probe": Sensor((5.0,), 50.0),
    "control_surfaces": Sensor((0.002,), 50.0),
    "height_above_ground": Sensor((0.2,), 10.0),
}
#: Sensors that share a message may be set together; the noise is then one number for each member.
SENSOR_GROUPS: dict[str, tuple[str, ...]] = {
    "imu": ("accelerometer", "gyro"),
    "gps": ("gps_position", "gps_velocity"),
    "air_data": ("airspeed", "angle_of_attack", "sideslip"),
}
SCALED_SENSORS = SENSOR_GROUPS["air_data"]
#: What servos move, named inputs besides.
CONTROLS = "control_surfaces"
#: Drifts [1/s or rad/s] beyond this are no slow fault.
FASTEST_DRIFT = 0.01
#: A vane that is further [rad] from where it should be is not rigged.
LARGEST_OFFSET = 0.35
#: A servo that follows more slowly [s] flies no aeroplane.
LONGEST_LAG = 0.5
SENSOR_ALIASES = {
    "gyroscope": "gyro", "alpha": "angle_of_attack", "beta": "sideslip", "true_airspeed": "airspeed",
    "orientation": "attitude", "controls": "control_surfaces",
}  # fmt: skip
#: Unit of the noise of each sensor, and more of it than leaves anything to be measured.
_NOISE: dict[str, tuple[str, float]] = {
    "accelerometer": ("m/s²", 1e3), "gyro": ("rad/s", 100.0), "attitude": ("rad", 10.0), "magnetometer": ("rad", 10.0),
    "gps_position": ("m", 1e5), "gps_velocity": ("m/s", 1e3), "airspeed": ("m/s", 1e3),
    "angle_of_attack": ("rad", 10.0), "sideslip": ("rad", 10.0), "static_pressure": ("Pa", 1e5),
    "five_hole_probe": ("Pa", 1e5), "control_surfaces": ("rad", 10.0), "height_above_ground": ("m", 1e4),
}  # fmt: skip
_RATES = (0.01, 1e5)  # [Hz]
_LATE = ("delay", "lag")
#: Random walks [unit of the state per square root of a second].
DEFAULT_PROCESS_NOISE = {"accelerometer_bias": 5e-4, "gyro_bias": 2e-5, "wind": 0.2}
_LARGEST_PROCESS_NOISE = {"accelerometer_bias": ("m/s²", 10.0), "gyro_bias": ("rad/s", 1.0), "wind": ("m/s", 100.0)}


def _noise(value: Any, name: str, sizes: tuple[int, ...], members: tuple[str, ...]) -> tuple[float, ...]:
    values = value if isinstance(value, (list, tuple)) else [value]
    if len(values) not in sizes:
        raise InputError(f"the noise of sensor {name} must have {' or '.join(map(str, sizes))} numbers")
    noise = tuple(number_of(v, f"the noise of sensor {name}") for v in values)
    if min(noise) <= 0.0:
        raise InputError(f"the noise of sensor {name} must be positive (one sigma)")
    for member, value in zip(members * (len(noise) if len(members) == 1 else 1), noise, strict=True):
        unit, largest = _NOISE[member]
        between(value, f"the noise of sensor {name}", (LEAST_NOISE, largest), unit)
    return noise


def by_name(data: Mapping[str, Any] | None) -> dict[str, dict[str, Any]]:
    """What a file says of its sensors, each by its own name and not by an alias: a copy."""
    return {SENSOR_ALIASES.get(name, name): dict(said or {}) for name, said in (data or {}).items()}


def sensors_of(data: Mapping[str, Any]) -> dict[str, Sensor]:
    """All sensors, as the file has them or by default. Raises InputError."""
    check_keys(data, (*DEFAULT_SENSORS, *SENSOR_GROUPS, *SENSOR_ALIASES), "sensor")
    for alias, name in SENSOR_ALIASES.items():
        if alias in data and name in data:
            raise InputError(f"sensors {alias} and {name} are the same: put what is known of it under {name}")
    sensors = dict(DEFAULT_SENSORS)
    for name in sorted(data, key=lambda key: key not in SENSOR_GROUPS):  # a sensor goes before its group
        value = {} if data[name] is None else data[name]
        if not isinstance(value, Mapping):
            reject(f"sensor {name}", "a mapping with noise, rate, delay and its other keys", value)
        check_keys(value, ("noise", "rate", "delay", "lag", "scale", "drift", "offset"), f"key of sensor {name}:")
        members = SENSOR_GROUPS.get(name, (SENSOR_ALIASES.get(name, name),))
        for i, member in enumerate(members):
            sensors[member] = _sensor(sensors[member], value, name, i, members)
    return sensors | _imu_of_one_delay(sensors, by_name(data))


def _imu_of_one_delay(sensors: Mapping[str, Sensor], said: Mapping[str, Mapping[str, Any]]) -> dict[str, Sensor]:
    """The sensors of the IMU, which come in one sample: a delay that is said of one is that of both."""
    members = SENSOR_GROUPS["imu"]
    of_both = said.get("imu", {}).get("delay") is not None
    stated = {name for name in members if of_both or said.get(name, {}).get("delay") is not None}
    delays = {sensors[name].delay for name in stated}
    if len(delays) > 1:
        raise InputError(
            "the gyro and accelerometer of an IMU come in one message and have one delay: give it as "
            f"imu: {{delay: {sensors['gyro'].delay:g}}}"
        )
    return {name: replace(sensors[name], delay=delay) for name in members for delay in delays}


def _sensor(base: Sensor, value: Mapping[str, Any], name: str, i: int, members: tuple[str, ...]) -> Sensor:
    member = members[i]
    noise, given = base.noise, base.noise_is_given
    of_gps = member in ("gps_position", "gps_velocity")
    if value.get("noise") is not None:
        given = True
        if len(members) > 1:
            noise = (_noise(value["noise"], name, (len(members),), members)[i],)
        else:
            noise = _noise(value["noise"], name, (1, 3) if of_gps else (1,), members)
        if of_gps and len(noise) == 1:
            noise = noise * 3
    delay, lag = (_late(value.get(key), getattr(base, key), f"the {key} of sensor {name}", member) for key in _LATE)
    late_std = max(delay[1], lag[1]) or base.late_std
    least = -0.5 if member == CONTROLS else 0.0  # recorded commands run ahead of the surfaces
    if not least <= delay[0] <= 2.0:
        raise InputError(f"the delay of sensor {name} must be between {least:g} and 2 s, not {delay[0]:g}")
    if lag[0] and member != CONTROLS:
        raise InputError(f"sensor {name} has no lag: only {CONTROLS} has one; a sensor that is late has a delay")
    if not 0.0 <= lag[0] <= LONGEST_LAG:
        raise InputError(f"the lag of sensor {name} must be between 0 and {LONGEST_LAG:g} s, not {lag[0]:g}")
    rate = base.rate if value.get("rate") is None else positive(value["rate"], f"the rate of sensor {name}")
    between(rate, f"the rate of sensor {name}", _RATES, "Hz")
    scale = _of_air_data(base.scale, value, "scale", name, member, (0.2, 5.0))
    drift = _of_air_data(base.drift, value, "drift", name, member, (-FASTEST_DRIFT, FASTEST_DRIFT))
    offset = _of_air_data(base.offset, value, "offset", name, member, (-LARGEST_OFFSET, LARGEST_OFFSET))
    if offset and member == "airspeed":
        raise InputError("sensors that may have an offset: angle_of_attack, sideslip, not airspeed")
    return Sensor(noise, rate, delay[0], given, scale, drift, offset, lag[0], late_std)


def _late(value: Any, base: float, what: str, member: str) -> tuple[float, float]:
    """By how much something is late [s], and one sigma of what was found of the surfaces; 0: it is said."""
    if value is None:
        return base, 0.0
    return said_or_found(value, what, "0.060 ± 0.003") if member == CONTROLS else (number_of(value, what), 0.0)


def described(data: Mapping[str, Any] | None) -> set[str]:
    """Names of sensors and groups of which a file says more than the noise: what is null is not said, and a delay or a
    lag with ± was found.
    """
    return {
        name
        for name, value in by_name(data).items()
        if any(key != "noise" and said is not None and "±" not in str(said) for key, said in value.items())
    }


def late_words(late: Mapping[str, tuple[float, float]]) -> str:
    """How late surfaces are: from delay and lag [s] as the file has them, each with one sigma (0: none)."""
    words = []
    for key, (value, std) in late.items():
        size = f"{abs(value):.3f}{f' ± {2.0 * std:.3f}' if std else ''} s"
        words.append(f"with a lag of {size}" if key == "lag" else f"{size} {'later' if value < 0.0 else 'earlier'}")
    return f"surfaces follow their records {' and '.join(words)}"


def _of_air_data(
    base: float, value: Mapping[str, Any], key: str, name: str, member: str, limits: tuple[float, float]
) -> float:
    """A number that only sensors of the air data have."""
    if value.get(key) is None:
        return base
    if member not in SCALED_SENSORS:
        raise InputError(f"sensor {name} has no {key}: only {', '.join(SCALED_SENSORS)} have one")
    number = number_of(value[key], f"the {key} of sensor {name}")
    if not limits[0] <= number <= limits[1]:
        raise InputError(f"the {key} of sensor {name} must be between {limits[0]:g} and {limits[1]:g}, not {number:g}")
    return number


def process_noise_of(data: Mapping[str, Any]) -> dict[str, float]:
    """Random walks, as the file has them or by default. Raises InputError."""
    check_keys(data, tuple(DEFAULT_PROCESS_NOISE), "key of process_noise:")
    result = dict(DEFAULT_PROCESS_NOISE)
    for key, value in data.items():
        result[key] = number_of(value, f"process_noise {key}")
        if result[key] < 0.0:
            raise InputError(f"process_noise {key} must not be negative")
        unit, largest = _LARGEST_PROCESS_NOISE[key]
        between(result[key], f"process_noise {key}", (0.0, largest), f"{unit} per √s")
    return result
