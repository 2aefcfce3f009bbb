"""Quantities to our topics: what is combined, and conversion to ROS frames.

The same object serves the bridge, one message at a time, and imports, a whole log at once: it is elementwise, and what
one quantity needs of another (the pressure of an airspeed, the vertical part of a velocity) is the last value before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import density_of, temperature_at
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.mavlink.airspeed import (
    standard_pressure,
    true_airspeed,
    true_of_impact_pressure,
)
from aircraft_sysid_ros.mavlink.held_values import Held, wide
from aircraft_sysid_ros.mavlink.quantities import (
    FIX_STATUS,
    Array,
    Quantity,
    Reading,
    Stamps,
    Table,
    with_receiver,
)
from aircraft_sysid_ros.mavlink.servo_mapping import MOTORS, ServoMapping
from aircraft_sysid_ros.mavlink.sources import OWN_POSITION, SILENCE, Sources, with_vertical
from aircraft_sysid_ros.ros_messages.conversion import (
    INPUTS_TOPIC,
    INPUTS_TYPE,
    NO_FIX,
    TOPICS,
    UNKNOWN_VARIANCE,
    enu_from_ned,
    flu_from_frd,
    frame_of,
    gps_fix_fields,
    gps_velocity_fields,
    imu_fields,
    input_fields,
    quaternion_enu_flu,
)
from aircraft_sysid_ros.stamps import NANOSECONDS

ATTITUDE_TOPIC, WIND_TOPIC = "autopilot/attitude", "autopilot/wind"
#: Topics besides the inputs: what the autopilot thinks, to compare with.
REFERENCE_TOPICS = {
    ATTITUDE_TOPIC: "geometry_msgs/msg/QuaternionStamped",
    WIND_TOPIC: "geometry_msgs/msg/TwistWithCovarianceStamped",
}
#: Inputs that no autopilot sends, so that a bridge must not seem to publish them.
_OF_OTHERS = {"five_hole_probe", "height_above_ground", "mass_properties"}
ALL_TOPICS = {name: kind for name, kind in TOPICS.items() if name not in _OF_OTHERS} | REFERENCE_TOPICS
#: And that of the inputs, where a calibration file names some.
KNOWN_TOPICS = {**ALL_TOPICS, INPUTS_TOPIC: INPUTS_TYPE}


def only_known_topics(topics: Iterable[str], said: str) -> None:
    """Raises InputError, which begins with what is ``said``, for a topic that is none of KNOWN_TOPICS."""
    for topic in topics:
        if topic not in KNOWN_TOPICS:
            raise InputError(f"{said} {topic}: known are {', '.join(KNOWN_TOPICS)}")


#: What a source's airspeed means where the calibration does not say: what the autopilots' documentation says.
USUAL_MEANING = {
    "VFR_HUD": "indicated", "AIRSPEED": "calibrated", "ARSP": "indicated", "airspeed": "indicated",
    "airspeed_validated": "calibrated", "vfr_hud": "indicated",
}  # fmt: skip
#: Flow angles that ArduPilot works out from its own estimates, unless a vane is said to be behind them.
COMPUTED_ANGLES = ("AOA_SSA", "AOA")
_TOLD_AS_ASKED = ("HIGHRES_IMU", "SCALED_IMU", "RAW_IMU", "VFR_HUD", "AIRSPEED", "SCALED_PRESSURE")
# How old [s] a value may be that another quantity needs.
_PRESSURE_AGE, _PROPELLER_AGE, _NAMED_AGE, _ATTITUDE_AGE, _SENSOR_AGE = 5.0, 1.0, 1.0, 0.1, 30.0
_MOTOR_AGE = 1.0
_OF_SPEED = (Quantity.AIRSPEED, Quantity.IMPACT_PRESSURE)
_KEPT = 64  # values that a live mapping remembers per quantity
_MILLISECOND = 1_000_000


@dataclass(frozen=True)
class Output:
    """n messages of a topic: stamps [ns] (n,), flat fields as in ros_conversion, and the source for a report."""

    topic: str
    stamp: Stamps
    fields: dict[str, Any]
    source: str

    @property
    def type_name(self) -> str:
        """Type of its messages."""
        return KNOWN_TOPICS[self.topic]

    @property
    def frame_id(self) -> str:
        """Frame of its messages."""
        return "map" if self.topic in (WIND_TOPIC, ATTITUDE_TOPIC) else frame_of(self.topic)


class Assembler:
    """Makes messages of our topics from readings of one table's sources.

    Live: ``take`` per message. A log: ``choose`` the sources, ``note`` every reading, then ``assemble`` every reading.
    """

    def __init__(self, table: Table, mapping: ServoMapping | None = None) -> None:
        self.mapping = mapping or ServoMapping()
        self.sources = Sources(table, self.mapping)
        self._held = {quantity: Held() for quantity in Quantity}
        self._named: dict[str, Held] = {target: Held() for target in self.mapping.named_values.values()}
        self._told: dict[Quantity, Array] = {}  # the newest that went out, and that was held
        self._noted: dict[Quantity, Array] = {}
        self._received: set[str] = set()  # sources of a position that have had a receiver
        self._attitude_used = np.iinfo(np.int64).min
        self._keep: int | None = _KEPT
        self._outputs_of: dict[Quantity, str] = {}  # source of pulses and of commands, of those that came

    @property
    def outputs_condition(self) -> str:
        """Why outputs that come are no control surfaces, in words; empty: they are, none came, or none are wanted."""
        wanted, other = Quantity.PULSES, Quantity.COMMANDS
        names = "pulses", "us", "command"
        if self.mapping.normalised:
            wanted, other, names = other, wanted, ("commands", "command", "us")
        if not self.mapping.outputs or wanted in self._outputs_of or other not in self._outputs_of:
            return ""
        came = "commands from -1 to 1" if other is Quantity.COMMANDS else "pulses in us"
        return (
            f"no control surfaces: the calibration file of the servos has {names[0]} ({names[1]}), and "
            f"{self._outputs_of[other]} has {came}: give {names[2]} in place of {names[1]}"
        )

    # -- in and out ------------------------------------------------------------------------------------------

    def choose(self, readings: Sequence[Reading]) -> None:
        """A whole log is at hand: its sources are chosen, and all of its values are kept."""
        self._keep = None
        self.sources.choose(readings)

    def take(self, readings: Iterable[Reading]) -> list[Output]:
        """Note and assemble what one live message reported."""
        there = (with_receiver(reading, self._received) for reading in readings)
        whole = (reading for reading in there if reading is not None and self._is_whole(reading))
        counted = [reading for reading in whole if self.note(reading)]
        return merged([output for reading in counted for output in self.assemble(reading)])

    def _is_whole(self, reading: Reading) -> bool:
        """Not a velocity whose vertical part nobody knows: that is no sign of life of its source."""
        if reading.quantity is not Quantity.VELOCITY:
            return True
        return bool(np.isfinite(with_vertical(reading, self._held[Quantity.DESCENT])).all(axis=1).any())

    def note(self, reading: Reading) -> bool:
        """Remember a reading for others that need it; whether it counts."""
        if reading.quantity is Quantity.NAMED:
            target = self.mapping.named_values.get(reading.source)
            if target is None:
                return False
            self._named[target].add(reading.stamp, reading.values, self._keep)
            return target in ("angle_of_attack", "sideslip")
        if not self.sources.counts(reading):
            return False
        if reading.quantity in _OF_SPEED:  # what was told before is no sign of life
            rows = self._news(reading, self._noted)
            self._held[reading.quantity].add(reading.stamp[rows], reading.values[rows], self._keep)
        elif reading.quantity not in (Quantity.IMU, Quantity.PULSES, Quantity.COMMANDS, Quantity.MAGNETIC_FIELD):
            self._held[reading.quantity].add(reading.stamp, reading.values, self._keep)
        return True

    def assemble(self, reading: Reading) -> list[Output]:
        """Messages (none, or n of one topic; of outputs, of the inputs too) of a reading that counts."""
        makers: dict[Quantity, Callable[[Reading], Output | None]] = {
            Quantity.IMU: self._imu,
            Quantity.MAGNETIC_FIELD: self._magnetic_field,
            Quantity.POSITION: self._position,
            Quantity.VELOCITY: self._velocity,
            Quantity.AIRSPEED: self._airspeed,
            Quantity.IMPACT_PRESSURE: self._impact_pressure,
            Quantity.PRESSURE: self._pressure,
            Quantity.ANGLE_OF_ATTACK: self._angle,
            Quantity.SIDESLIP: self._angle,
            Quantity.PULSES: self._outputs,
            Quantity.COMMANDS: self._outputs,
            Quantity.ATTITUDE: self._attitude,
            Quantity.WIND: self._wind,
            Quantity.NAMED: self._named_angle,
        }
        make = makers.get(reading.quantity)
        made = [] if make is None else [make(reading)]
        if reading.quantity in (Quantity.PULSES, Quantity.COMMANDS):
            self._outputs_of[reading.quantity] = reading.source
            made.append(self._inputs(reading))
        return [output for output in made if output is not None and len(output.stamp)]

    # -- topics ----------------------------------------------------------------------------------------------

    def _imu(self, reading: Reading) -> Output | None:
        whole = np.all(np.isfinite(reading.values), axis=1)
        stamp, values = reading.stamp[whole], reading.values[whole]
        fields: dict[str, Any] = dict(imu_fields(values[:, :3], values[:, 3:6])) if len(stamp) else {}
        if self.mapping.attitude_std is not None and len(stamp):
            self._add_attitude(stamp, values[:, 3:6], fields)
        return Output("imu/data", stamp, fields, reading.source)

    def _add_attitude(self, stamp: Stamps, rates: Array, fields: dict[str, Any]) -> None:
        """The autopilot's attitude in the first IMU message after it, turned on by the rate in between."""
        held = self._held[Quantity.ATTITUDE]
        rows = np.searchsorted(held.stamp, stamp, side="right") - 1
        taken = held.stamp[np.maximum(rows, 0)] if len(held.stamp) else np.zeros(len(stamp), np.int64)
        if len(held.stamp) and held.stamp[-1] < self._attitude_used:  # the clock went back
            self._attitude_used = np.iinfo(np.int64).min
        previous = np.concatenate([[self._attitude_used], taken[:-1]])
        fresh = (rows >= 0) & (taken > previous) & (stamp - taken <= _ATTITUDE_AGE * NANOSECONDS)
        std = self.mapping.attitude_std or 0.0
        for i in np.flatnonzero(fresh):
            turn = rates[i] * (stamp[i] - taken[i]) / NANOSECONDS
            fields["orientation"][i] = quaternion_enu_flu(_turned(held.values[rows[i], :4], turn)[None])[0]
            fields["orientation_covariance"][i] = std**2 * np.eye(3).ravel()
        if len(stamp) and rows[-1] >= 0:
            self._attitude_used = int(taken[-1])

    def _magnetic_field(self, reading: Reading) -> Output:
        rows = self._news(reading, self._told)
        fields = {"magnetic_field": flu_from_frd(reading.values[rows])}
        return Output("imu/mag", reading.stamp[rows], fields, reading.source)

    def _news(self, reading: Reading, told: dict[Quantity, Array]) -> npt.NDArray[np.bool_]:
        """Values (n,) that are not the one before: MAVLink tells as often as it is asked what a sensor last showed.

        ``told``: the last one before these, by quantity; the last of these takes its place.
        """
        if reading.source not in _TOLD_AS_ASKED:
            return np.ones(len(reading.stamp), np.bool_)
        before = told.get(reading.quantity, np.full(reading.values.shape[1], np.nan))
        told[reading.quantity] = reading.values[-1]
        return np.any(reading.values != np.vstack([before, reading.values[:-1]]), axis=1)

    def _position(self, reading: Reading) -> Output:
        values, n = reading.values, len(reading.values)
        status = values[:, FIX_STATUS].astype(np.int8)
        fields = dict(gps_fix_fields(values[:, 0], values[:, 1], values[:, 2], status=status))
        known = np.all(np.isfinite(values[:, 3:6]), axis=1)
        covariance = np.zeros((n, 9))
        covariance[:, [4, 0, 8]] = np.where(known[:, None], values[:, 3:6], 0.0)
        fields["position_covariance"] = covariance
        fields["position_covariance_type"] = np.where(known, 1, 0).astype(np.uint8)  # approximated, unknown
        return Output("gps/fix", reading.stamp, fields, reading.source)

    def _velocity(self, reading: Reading) -> Output:
        velocity, source = with_vertical(reading, self._held[Quantity.DESCENT]), reading.source
        if np.isnan(reading.values[:, 2]).any():
            vertical = self.sources.source(Quantity.DESCENT)
            source += f", vertical of {vertical}" if vertical else ""
        rows = np.all(np.isfinite(velocity), axis=1)
        if reading.source == OWN_POSITION:  # without a fix the autopilot's filter is dead reckoning
            rows &= self._held[Quantity.POSITION].at(reading.stamp, SILENCE, FIX_STATUS) != NO_FIX
        return Output("gps/vel", reading.stamp[rows], dict(gps_velocity_fields(velocity[rows])), source)

    def _air(self, stamp: Stamps) -> tuple[Array, Array]:
        """Pressure [Pa] and temperature [K] (n,): as measured, else of the standard atmosphere at the GPS altitude."""
        pressure = self._held[Quantity.PRESSURE].at(stamp, _PRESSURE_AGE)
        altitude = self._held[Quantity.POSITION].at(stamp, _PRESSURE_AGE, 2)
        pressure = np.where(np.isfinite(pressure), pressure, standard_pressure(altitude))
        temperature = temperature_at(pressure)
        if self.mapping.sensor_temperature:
            measured = self._held[Quantity.PRESSURE].at(stamp, _PRESSURE_AGE, 1)
            temperature = np.where(np.isfinite(measured), measured, temperature)
        return pressure, temperature

    def _has_airspeed_sensor(self, stamp: Stamps) -> npt.NDArray[np.bool_]:
        """Where it says that it has none, or none that is healthy, what it calls airspeed is an estimate.

        But for AIRSPEED, which tells of each sensor how it is: SYS_STATUS tells that one of them is not healthy.
        """
        if self.sources.source(Quantity.AIRSPEED) == "AIRSPEED":
            return np.ones(len(stamp), np.bool_)
        there = self._held[Quantity.AIRSPEED_SENSOR].at(stamp, _SENSOR_AGE)
        return np.asarray(there != 0.0)

    def _airspeed(self, reading: Reading) -> Output | None:
        meaning = self.mapping.airspeed_meaning or USUAL_MEANING.get(reading.source, "indicated")
        pressure, temperature = self._air(reading.stamp)
        speed = self.mapping.airspeed_scale * reading.values[:, 0] + self.mapping.airspeed_offset
        speed = np.maximum(speed, 0.0)
        true = true_airspeed(speed, meaning, pressure, temperature)
        rows = np.isfinite(true) & self._has_airspeed_sensor(reading.stamp) & self._news(reading, self._told)
        return self._flow(reading.stamp, true, rows, pressure, temperature, f"{reading.source} ({meaning})")

    def _flow(
        self, stamp: Stamps, true: Array, rows: npt.NDArray[np.bool_], pressure: Array, temperature: Array, source: str
    ) -> Output:
        """Air data of an airspeed (n,) with the air that it was worked out with."""
        density = density_of(pressure, temperature)
        fields = {"true_airspeed": true, "static_pressure": pressure, "air_density": density}
        return Output("air_data", stamp[rows], _air_data(**{k: v[rows] for k, v in fields.items()}), source)

    def _impact_pressure(self, reading: Reading) -> Output | None:
        pressure, temperature = self._air(reading.stamp)
        impact = self.mapping.airspeed_scale**2 * reading.values[:, 0]
        true = true_of_impact_pressure(impact, pressure, temperature)
        rows = np.isfinite(true) & self._news(reading, self._told)
        return self._flow(reading.stamp, true, rows, pressure, temperature, f"{reading.source} pressure")

    def _pressure(self, reading: Reading) -> Output | None:
        """Pressure alone; with an airspeed that is not silent it goes along with that."""
        speeds = (self._held[quantity].at(reading.stamp, SILENCE) for quantity in _OF_SPEED)
        alone = np.all([np.isnan(speed) for speed in speeds], axis=0) | ~self._has_airspeed_sensor(reading.stamp)
        stamp, pressure = reading.stamp[alone], reading.values[alone, 0]
        _, temperature = self._air(stamp)
        fields = _air_data(static_pressure=pressure, air_density=density_of(pressure, temperature))
        return Output("air_data", stamp, fields, reading.source)

    def _angle(self, reading: Reading) -> Output | None:
        if reading.source in COMPUTED_ANGLES and not self.mapping.measured_angles:
            return None
        name = "angle_of_attack" if reading.quantity is Quantity.ANGLE_OF_ATTACK else "sideslip"
        return Output("air_data", reading.stamp, _air_data(**{name: reading.values[:, 0]}), reading.source)

    def _named_angle(self, reading: Reading) -> Output:
        name = self.mapping.named_values[reading.source]
        return Output("air_data", reading.stamp, _air_data(**{name: reading.values[:, 0]}), reading.source)

    def _outputs(self, reading: Reading) -> Output | None:
        mapping = self.mapping
        if not self._tells_outputs(reading) or all(not output.surface for output in mapping.outputs.values()):
            return None
        fields: dict[str, Any] = dict(mapping.controls(self._values_of_outputs(reading)))
        rpm = self._held[Quantity.PROPELLER].number_at(reading.stamp, _PROPELLER_AGE, mapping.engine - 1)
        fields["propeller_speed"] = rpm * (2.0 * np.pi / 60.0) / mapping.gear
        for target, held in self._named.items():
            if target in ("thrust", "propeller_speed"):
                fields[target] = held.at(reading.stamp, _NAMED_AGE)
        rows = np.any(np.isfinite(np.stack(list(fields.values()))), axis=0)
        fields = {name: value[rows] for name, value in fields.items()}
        return Output("control_surfaces", reading.stamp[rows], fields, reading.source)

    def _values_of_outputs(self, reading: Reading) -> Array:
        """Outputs (n, k) by their number, with motors and outputs told apart where the calibration file names one."""
        count, numbers = reading.values.shape[1], self.mapping.outputs
        upper = self._held[Quantity.UPPER_PULSES]
        if len(upper.stamp) and any(count < number < MOTORS[0] for number in numbers):
            told = [upper.at(reading.stamp, _MOTOR_AGE, column) for column in range(upper.values.shape[1])]
            return np.column_stack([reading.values, *told])
        if not any(number in MOTORS for number in numbers):
            return reading.values
        values = wide(reading.values, MOTORS[-1])
        held = self._held[Quantity.MOTORS]
        values[:, MOTORS[0] - 1 :] = np.stack(
            [held.at(reading.stamp, _MOTOR_AGE, column) for column in range(len(MOTORS))], axis=1
        )
        return values

    def _tells_outputs(self, reading: Reading) -> bool:
        """Whether a reading is in what the calibration file gives its points in."""
        return bool(self.mapping.outputs) and self.mapping.normalised == (reading.quantity is Quantity.COMMANDS)

    def _inputs(self, reading: Reading) -> Output | None:
        """Outputs that are inputs of their own, in rad or as fraction."""
        names = self.mapping.inputs
        if not names or not self._tells_outputs(reading):
            return None
        values = self.mapping.input_values(self._values_of_outputs(reading))
        rows = np.isfinite(values).any(axis=1)
        return Output(INPUTS_TOPIC, reading.stamp[rows], dict(input_fields(names, values[rows])), reading.source)

    def _attitude(self, reading: Reading) -> Output | None:
        norm = np.linalg.norm(reading.values[:, :4], axis=1)
        rows = np.abs(norm - 1.0) < 0.1
        quaternion = quaternion_enu_flu(reading.values[rows, :4] / norm[rows, None])
        return Output(ATTITUDE_TOPIC, reading.stamp[rows], {"quaternion": quaternion}, reading.source)

    def _wind(self, reading: Reading) -> Output:
        covariance = np.zeros((len(reading.values), 36))
        variance = reading.values[:, [4, 3, 5]]
        covariance[:, [0, 7, 14]] = np.where(variance > 0.0, variance, UNKNOWN_VARIANCE)
        covariance[:, [21, 28, 35]] = UNKNOWN_VARIANCE  # the rotation of the air is not estimated
        fields = {"twist.twist.linear": enu_from_ned(reading.values[:, :3]), "twist.covariance": covariance}
        return Output(WIND_TOPIC, reading.stamp, fields, reading.source)


def merged(outputs: Iterable[Output]) -> list[Output]:
    """Outputs, where neighbours that are air data of the same samples (both angles of a message) are one."""
    found: list[Output] = []
    for output in outputs:
        last = found[-1] if found else None
        same = last is not None and (last.topic, last.source) == (output.topic, output.source)
        if last is not None and same and output.topic == "air_data" and np.array_equal(last.stamp, output.stamp):
            fields = {name: np.where(np.isnan(v), output.fields[name], v) for name, v in last.fields.items()}
            found[-1] = Output(last.topic, last.stamp, fields, last.source)
        else:
            found.append(output)
    return found


def _air_data(**known: Array) -> dict[str, Any]:
    """Fields of AirData; what is not given is NaN."""
    n = len(next(iter(known.values())))
    names = ("true_airspeed", "angle_of_attack", "sideslip", "air_density", "static_pressure")
    return {name: known.get(name, np.full(n, np.nan)) for name in names}


def _turned(attitude: Array, turn: Array) -> Array:
    """Attitude (4,) turned on by a rotation vector in body axes (3,)."""
    from aircraft_sysid_ros.aircraft.frames import quaternion_exp, quaternion_product

    return np.asarray(quaternion_product(attitude, quaternion_exp(turn)))
