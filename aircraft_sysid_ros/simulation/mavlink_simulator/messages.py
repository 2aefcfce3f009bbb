"""Samples as ArduPlane's MAVLink messages: units of the definitions, whole numbers cut off where ArduPlane cuts them.

What the definitions leave open or ArduPlane does otherwise: eph and epv are dilutions of precision times 100,
HIGHRES_IMU.diff_pressure is that of the barometer against the ground, and the time of AOA_SSA has 32 bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aircraft_sysid_ros.aircraft.atmosphere import GAS_CONSTANT, HEAT_RATIO, STANDARD_GRAVITY, altitude_at, pressure
from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion
from aircraft_sysid_ros.mavlink.airspeed import SEA_LEVEL_DENSITY
from aircraft_sysid_ros.mavlink.servo_mapping import MIXING, ServoMapping
from aircraft_sysid_ros.ros_messages.conversion import frd_from_flu, ned_from_enu
from aircraft_sysid_ros.simulation.mavlink_simulator.sensors import ATTITUDE, VELOCITY, WIND, Event

Array = npt.NDArray[np.float64]

#: Messages that a sample of each topic gives. GPS_RAW_INT comes as often as it is asked for, with the last fix.
MESSAGES_OF = {
    "imu/data": ("HIGHRES_IMU", "SCALED_IMU", "RAW_IMU"),
    "air_data": ("SCALED_PRESSURE", "VFR_HUD", "AIRSPEED", "AOA_SSA"),
    "control_surfaces": ("SERVO_OUTPUT_RAW", "RPM", "NAMED_VALUE_FLOAT"),
    ATTITUDE: ("ATTITUDE", "ATTITUDE_QUATERNION"),
    VELOCITY: ("GLOBAL_POSITION_INT", "GPS_RAW_INT"),
    WIND: ("WIND",),
}
THRUST_NAME = "THRUST"
FIX, VELOCITY_OF_FIX, FIELD, AIR, CONTROLS = "gps/fix", "gps/vel", "imu/mag", "air_data", "control_surfaces"
_IMU_TEMPERATURE = 4500  # [cdegC] of its heater
_HDOP, _VDOP, _SATELLITES, _SPEED_ACCURACY = 80, 120, 14, 100  # hundredths, hundredths, -, [mm/s]
_SERVOS = 16
_LARGEST_16 = 32767
_KELVIN = 273.15
_GAUSS = 1e-4  # [T]
_WRAP = 2**32
_ALL_UPDATED = 2 * dialect.HIGHRES_IMU_UPDATED_TEMPERATURE - 1  # the last of the flags
_NO_YAW, _NO_HEADING_ACCURACY, _MAIN_OUTPUTS = 0, 0, 0


class Encoder:
    """Makes messages of samples; keeps the newest of each topic, since most messages need several."""

    def __init__(self, mapping: ServoMapping) -> None:
        self._calibration = mapping
        self._newest: dict[str, Event] = {}

    def take(self, event: Event) -> None:
        """The newest sample of its topic."""
        self._newest[event.topic] = event

    def sampled(self, name: str, event: Event) -> float:
        """Time of flight [s] that a message of an event tells: of GPS_RAW_INT that of the fix."""
        return self._newest[FIX].time if name == "GPS_RAW_INT" and FIX in self._newest else event.time

    def message(self, name: str, event: Event, boot: int) -> Any | None:
        """The message of a sample taken at ``boot`` [ns] since start; None until all that it tells is known."""
        try:
            return getattr(self, f"_{name.lower()}")(event, boot)
        except KeyError:  # a topic that has not come
            return None

    def _value(self, topic: str, field: str) -> Any:
        """Newest value of a field: a number, or an array (k,). Raises KeyError before the first."""
        return self._newest[topic].fields[field][0]

    # -- IMU ---------------------------------------------------------------------------------------------------

    def _highres_imu(self, event: Event, boot: int) -> Any:
        static = float(self._value(AIR, "static_pressure"))
        altitude = float(altitude_at(static))
        ground = float(pressure(self._home_altitude()))
        return dialect.MAVLink_highres_imu_message(
            boot // 1000, *_force(event), *_rates(event), *(self._field() / _GAUSS), static / 100.0,
            (static - ground) / 100.0, altitude, self._air_temperature(), _ALL_UPDATED,
        )  # fmt: skip

    def _scaled_imu(self, event: Event, boot: int) -> Any:
        return dialect.MAVLink_scaled_imu_message(boot // 1_000_000, *self._whole_imu(event), _IMU_TEMPERATURE)

    def _raw_imu(self, event: Event, boot: int) -> Any:
        first = 0
        return dialect.MAVLink_raw_imu_message(boot // 1000, *self._whole_imu(event), first, _IMU_TEMPERATURE)

    def _whole_imu(self, event: Event) -> list[int]:
        """Milli-g, mrad/s and milligauss."""
        numbers = (*(_force(event) * (1e3 / STANDARD_GRAVITY)), *(_rates(event) * 1e3), *(self._field() / _GAUSS * 1e3))
        return [int(np.clip(v, -_LARGEST_16, _LARGEST_16)) for v in numbers]

    def _field(self) -> Array:
        return frd_from_flu(self._value(FIELD, "magnetic_field"))

    # -- position and velocity -----------------------------------------------------------------------------------

    def _gps_raw_int(self, event: Event, boot: int) -> Any:
        north, east, _ = ned_from_enu(self._value(VELOCITY_OF_FIX, "twist.linear"))
        place = [round(float(self._value(FIX, name)) * 1e7) for name in ("latitude", "longitude")]
        altitude = int(100.0 * float(self._value(FIX, "altitude"))) * 10  # kept in cm
        across, up = np.sqrt(self._value(FIX, "position_covariance")[[0, 8]])
        accuracy = [int(1e3 * value) for value in (np.sqrt(2.0) * across, up)]
        return dialect.MAVLink_gps_raw_int_message(
            boot // 1_000_000 * 1000, dialect.GPS_FIX_TYPE_3D_FIX, *place, altitude, _HDOP, _VDOP,
            _hundredths(float(np.hypot(north, east))), _compass(np.arctan2(east, north)), _SATELLITES, altitude,
            *accuracy, _SPEED_ACCURACY, _NO_HEADING_ACCURACY, _NO_YAW,
        )  # fmt: skip

    def _global_position_int(self, event: Event, boot: int) -> Any:
        latitude, longitude, altitude = event.fields["place"][0]
        place = [round(float(np.degrees(angle)) * 1e7) for angle in (latitude, longitude)]
        heights = [int(1e3 * float(height)) for height in (altitude, event.fields["above_home"][0])]
        speeds = [_hundredths(speed) for speed in event.fields["velocity"][0]]
        return dialect.MAVLink_global_position_int_message(
            boot // 1_000_000, *place, *heights, *speeds, self._heading()
        )

    def _home_altitude(self) -> float:
        return float(self._value(VELOCITY, "place")[2] - self._value(VELOCITY, "above_home"))

    def _heading(self) -> int:
        return _compass(euler_from_quaternion(self._value(ATTITUDE, "attitude"))[2])

    # -- air -----------------------------------------------------------------------------------------------------

    def _scaled_pressure(self, event: Event, boot: int) -> Any:
        static, temperature = float(event.fields["static_pressure"][0]), _hundredths(self._air_temperature())
        return dialect.MAVLink_scaled_pressure_message(
            boot // 1_000_000, static / 100.0, self._impact_pressure() / 100.0, temperature, temperature
        )

    def _airspeed(self, event: Event, boot: int) -> Any:
        first, temperature = 0, _hundredths(self._air_temperature())
        impact, flags = self._impact_pressure() / 100.0, dialect.AIRSPEED_SENSOR_USING
        return dialect.MAVLink_airspeed_message(first, self._indicated(), temperature, impact, flags)

    def _vfr_hud(self, event: Event, boot: int) -> Any:
        north, east, down = self._value(VELOCITY, "velocity")
        throttle = int(100.0 * float(np.clip(self._value(CONTROLS, "throttle"), 0.0, 1.0)))
        return dialect.MAVLink_vfr_hud_message(
            self._indicated(), float(np.hypot(north, east)), self._heading() // 100, throttle,
            float(self._value(VELOCITY, "place")[2]), -float(down),
        )  # fmt: skip

    def _aoa_ssa(self, event: Event, boot: int) -> Any | None:
        angles = [float(np.degrees(event.fields[name][0])) for name in ("angle_of_attack", "sideslip")]
        known = np.all(np.isfinite(angles))
        return dialect.MAVLink_aoa_ssa_message(boot // 1000 % _WRAP, *angles) if known else None

    def _wind(self, event: Event, boot: int) -> Any:
        north, east, down = event.fields["wind"][0]
        came_from = np.degrees(np.arctan2(-east, -north))
        return dialect.MAVLink_wind_message(float(came_from), float(np.hypot(north, east)), float(down))

    def _air_temperature(self) -> float:
        """[deg C]"""
        return float(self._value(AIR, "static_pressure") / (GAS_CONSTANT * self._value(AIR, "air_density"))) - _KELVIN

    def _indicated(self) -> float:
        """Equivalent airspeed [m/s], as the autopilot's ratio makes it of the pressure."""
        return float(self._value(AIR, "true_airspeed") * np.sqrt(self._value(AIR, "air_density") / SEA_LEVEL_DENSITY))

    def _impact_pressure(self) -> float:
        """P_t - P_s [Pa] of the true airspeed, isentropic."""
        static, density = (float(self._value(AIR, name)) for name in ("static_pressure", "air_density"))
        mach2 = float(self._value(AIR, "true_airspeed")) ** 2 * density / (HEAT_RATIO * static)
        ratio = (1.0 + 0.5 * (HEAT_RATIO - 1.0) * mach2) ** (HEAT_RATIO / (HEAT_RATIO - 1.0))
        return float(static * (ratio - 1.0))

    # -- controls and attitude -----------------------------------------------------------------------------------

    def _servo_output_raw(self, event: Event, boot: int) -> Any:
        pulses = [0] * _SERVOS
        for number, pulse in self._pulses(event).items():
            pulses[number - 1] = pulse
        return dialect.MAVLink_servo_output_raw_message(boot // 1000 % _WRAP, _MAIN_OUTPUTS, *pulses)

    def _pulses(self, event: Event) -> dict[int, int]:
        """Pulses that give the deflections: the mixing of the calibration turned round."""
        outputs = self._calibration.outputs
        controls = sorted({control for output in outputs.values() for control in MIXING.get(output.surface, {})})
        mixing = np.array(
            [[MIXING.get(o.surface, {}).get(control, 0.0) for o in outputs.values()] for control in controls]
        )
        wanted = np.array([float(event.fields[control][0]) for control in controls])
        values = np.linalg.lstsq(mixing, np.nan_to_num(wanted), rcond=None)[0]
        return {n: round(float(o.pulse(v))) for (n, o), v in zip(outputs.items(), values, strict=True)}

    def _rpm(self, event: Event, boot: int) -> Any:
        speed, none = float(event.fields["propeller_speed"][0]) * 60.0 / (2.0 * np.pi), -1.0
        return dialect.MAVLink_rpm_message(speed if np.isfinite(speed) else none, none)

    def _named_value_float(self, event: Event, boot: int) -> Any:
        thrust = float(event.fields["thrust"][0])
        return dialect.MAVLink_named_value_float_message(boot // 1_000_000, THRUST_NAME.encode(), thrust)

    def _attitude_quaternion(self, event: Event, boot: int) -> Any:
        turning = (*event.fields["attitude"][0], *event.fields["rates"][0])
        return dialect.MAVLink_attitude_quaternion_message(boot // 1_000_000, *turning)

    def _attitude(self, event: Event, boot: int) -> Any:
        turning = (*euler_from_quaternion(event.fields["attitude"][0]), *event.fields["rates"][0])
        return dialect.MAVLink_attitude_message(boot // 1_000_000, *turning)


def _force(event: Event) -> Array:
    return frd_from_flu(event.fields["linear_acceleration"][0])


def _rates(event: Event) -> Array:
    return frd_from_flu(event.fields["angular_velocity"][0])


def _compass(angle: float) -> int:
    """Hundredths of a degree from 0 to 35999 of an angle [rad] from north."""
    return int(100.0 * float(np.degrees(angle)) % 36000.0) % 36000


def _hundredths(value: float) -> int:
    """The whole number of hundredths, cut off."""
    return int(100.0 * float(value))
