"""Samples as ArduPlane's MAVLink messages, with their units and their rounding."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pymavlink.dialects.v20 import ardupilotmega as dialect

from aircraft_sysid_ros.aircraft.atmosphere import GAS_CONSTANT, HEAT_RATIO, STANDARD_GRAVITY
from aircraft_sysid_ros.mavlink.airspeed import SEA_LEVEL_DENSITY
from aircraft_sysid_ros.mavlink.calibration import MIXING, Calibration
from aircraft_sysid_ros.recordings.ros_conversion import frd_from_flu, ned_from_enu
from aircraft_sysid_ros.simulation.stand_in.sensors import ATTITUDE, VELOCITY, WIND, Event

Array = npt.NDArray[np.float64]

#: Messages that a sample of each topic gives.
MESSAGES_OF = {
    "imu/data": ("HIGHRES_IMU", "RAW_IMU"),
    "gps/vel": ("GPS_RAW_INT",),  # with the position of the same time, which comes just before
    "air_data": ("SCALED_PRESSURE", "VFR_HUD", "AIRSPEED", "AOA_SSA"),
    "control_surfaces": ("SERVO_OUTPUT_RAW", "RPM", "NAMED_VALUE_FLOAT"),
    ATTITUDE: ("ATTITUDE", "ATTITUDE_QUATERNION"),
    VELOCITY: ("GLOBAL_POSITION_INT",),
    WIND: ("WIND",),
}
THRUST_NAME = "THRUST"
_SERVOS = 16
_LARGEST_16 = 32767
_KELVIN = 273.15


class Encoder:
    """Makes messages of samples; keeps the newest of each topic, since some messages need several."""

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        self._newest: dict[str, Event] = {}

    def take(self, event: Event) -> None:
        """The newest sample of its topic."""
        self._newest[event.topic] = event

    def message(self, name: str, event: Event, boot: int) -> Any | None:
        """The message of a sample taken at ``boot`` [ns] since start; None where it cannot be made."""
        return getattr(self, f"_{name.lower()}")(event, boot)

    def _value(self, topic: str, field: str) -> Array | None:
        event = self._newest.get(topic)
        return None if event is None else np.asarray(event.fields[field][0], dtype=np.float64)

    def _highres_imu(self, event: Event, boot: int) -> Any:
        force = frd_from_flu(event.fields["linear_acceleration"][0])
        rate = frd_from_flu(event.fields["angular_velocity"][0])
        nothing = (0.0,) * 7
        return dialect.MAVLink_highres_imu_message(boot // 1000, *force, *rate, *nothing, 0x3F)

    def _raw_imu(self, event: Event, boot: int) -> Any:
        force = frd_from_flu(event.fields["linear_acceleration"][0]) * (1e3 / STANDARD_GRAVITY)
        rate = frd_from_flu(event.fields["angular_velocity"][0]) * 1e3
        numbers = [int(np.clip(round(v), -_LARGEST_16, _LARGEST_16)) for v in (*force, *rate)]
        return dialect.MAVLink_raw_imu_message(boot // 1000, *numbers, 0, 0, 0)

    def _gps_raw_int(self, event: Event, boot: int) -> Any | None:
        fix = self._newest.get("gps/fix")
        if fix is None:
            return None
        north, east, _ = ned_from_enu(event.fields["twist.linear"][0])
        course = np.degrees(np.arctan2(east, north)) % 360.0
        place = [round(float(fix.fields[name][0]) * 1e7) for name in ("latitude", "longitude")]
        altitude = round(float(fix.fields["altitude"][0]) * 1e3)
        across, up = np.sqrt(fix.fields["position_covariance"][0][[0, 8]])
        accuracy = [round(1e3 * np.sqrt(2.0) * across), round(1e3 * up)]
        speed = round(100.0 * float(np.hypot(north, east)))
        return dialect.MAVLink_gps_raw_int_message(
            boot // 1000, 3, *place, altitude, 80, 120, speed, round(100.0 * course) % 36000, 14, 0, *accuracy
        )

    def _global_position_int(self, event: Event, boot: int) -> Any | None:
        fix = self._newest.get("gps/fix")
        if fix is None:
            return None
        place = [round(float(fix.fields[name][0]) * 1e7) for name in ("latitude", "longitude")]
        altitude = round(float(fix.fields["altitude"][0]) * 1e3)
        speeds = [round(100.0 * float(v)) for v in event.fields["value"][0]]
        return dialect.MAVLink_global_position_int_message(boot // 1_000_000, *place, altitude, 0, *speeds, 65535)

    def _scaled_pressure(self, event: Event, boot: int) -> Any:
        pressure, density = (float(event.fields[name][0]) for name in ("static_pressure", "air_density"))
        temperature = pressure / (GAS_CONSTANT * density) - _KELVIN
        impact = _impact_pressure(float(event.fields["true_airspeed"][0]), pressure, density)
        return dialect.MAVLink_scaled_pressure_message(
            boot // 1_000_000, pressure / 100.0, impact / 100.0, round(100.0 * temperature)
        )

    def _indicated(self, event: Event) -> float:
        """Equivalent airspeed, as the autopilot's ratio makes it of the pressure."""
        return float(event.fields["true_airspeed"][0] * np.sqrt(event.fields["air_density"][0] / SEA_LEVEL_DENSITY))

    def _vfr_hud(self, event: Event, boot: int) -> Any:
        velocity = self._value(VELOCITY, "value")
        climb = 0.0 if velocity is None else -float(velocity[2])
        ground = 0.0 if velocity is None else float(np.hypot(velocity[0], velocity[1]))
        return dialect.MAVLink_vfr_hud_message(self._indicated(event), ground, 0, 0, 0.0, climb)

    def _airspeed(self, event: Event, boot: int) -> Any:
        return dialect.MAVLink_airspeed_message(0, self._indicated(event), 0, 0.0, 0)

    def _aoa_ssa(self, event: Event, boot: int) -> Any | None:
        angles = [float(np.degrees(event.fields[name][0])) for name in ("angle_of_attack", "sideslip")]
        return dialect.MAVLink_aoa_ssa_message(boot // 1000, *angles) if np.all(np.isfinite(angles)) else None

    def _servo_output_raw(self, event: Event, boot: int) -> Any:
        pulses = [0] * _SERVOS
        for number, pulse in self._pulses(event).items():
            pulses[number - 1] = pulse
        return dialect.MAVLink_servo_output_raw_message(boot // 1000 % 2**32, 0, *pulses)

    def _pulses(self, event: Event) -> dict[int, int]:
        """Pulses that give the deflections: the mixing of the calibration turned round."""
        outputs = self._calibration.outputs
        controls = sorted({control for output in outputs.values() for control in MIXING[output.surface]})
        mixing = np.array([[MIXING[o.surface].get(control, 0.0) for o in outputs.values()] for control in controls])
        wanted = np.array([float(event.fields[control][0]) for control in controls])
        values = np.linalg.lstsq(mixing, np.nan_to_num(wanted), rcond=None)[0]
        return {n: round(float(o.pulse(v))) for (n, o), v in zip(outputs.items(), values, strict=True)}

    def _rpm(self, event: Event, boot: int) -> Any:
        speed = float(event.fields["propeller_speed"][0]) * 60.0 / (2.0 * np.pi)
        return dialect.MAVLink_rpm_message(speed if np.isfinite(speed) else -1.0, -1.0)

    def _named_value_float(self, event: Event, boot: int) -> Any:
        thrust = float(event.fields["thrust"][0])
        return dialect.MAVLink_named_value_float_message(boot // 1_000_000, THRUST_NAME.encode(), thrust)

    def _attitude_quaternion(self, event: Event, boot: int) -> Any:
        return dialect.MAVLink_attitude_quaternion_message(boot // 1_000_000, *event.fields["value"][0], 0.0, 0.0, 0.0)

    def _attitude(self, event: Event, boot: int) -> Any:
        from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion

        angles = euler_from_quaternion(event.fields["value"][0])
        return dialect.MAVLink_attitude_message(boot // 1_000_000, *angles, 0.0, 0.0, 0.0)

    def _wind(self, event: Event, boot: int) -> Any:
        north, east, down = event.fields["value"][0]
        came_from = np.degrees(np.arctan2(-east, -north))
        return dialect.MAVLink_wind_message(float(came_from), float(np.hypot(north, east)), float(down))


def _impact_pressure(speed: float, pressure: float, density: float) -> float:
    """P_t - P_s [Pa] of a true airspeed [m/s], isentropic."""
    mach2 = speed**2 * density / (HEAT_RATIO * pressure)
    ratio = (1.0 + 0.5 * (HEAT_RATIO - 1.0) * mach2) ** (HEAT_RATIO / (HEAT_RATIO - 1.0))
    return float(pressure * (ratio - 1.0))
