"""Streams of mapped signals as messages of our topics, in windows of time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft import earth
from aircraft_sysid_ros.aircraft.atmosphere import density_of, temperature_at
from aircraft_sysid_ros.aircraft.sensor_settings import DEFAULT_SENSORS
from aircraft_sysid_ros.mavlink.airspeed import standard_pressure, true_airspeed, true_of_impact_pressure
from aircraft_sysid_ros.recordings.tabular.clock import Stamps
from aircraft_sysid_ros.recordings.tabular.joining import Window, attitude_at, slow_value_at, value_at
from aircraft_sysid_ros.recordings.tabular.signals import INPUTS, VECTORS
from aircraft_sysid_ros.recordings.tabular.streams import ROWS, Stream
from aircraft_sysid_ros.ros_messages.conversion import (
    INPUTS_TOPIC,
    INPUTS_TYPE,
    TOPICS,
    gps_fix_fields,
    gps_velocity_fields,
    imu_fields,
    quaternion_enu_flu,
)

Array = npt.NDArray[np.float64]
#: Where the first of positions in metres is put on the earth: latitude, longitude [rad], altitude [m].
REFERENCE = np.array([np.radians(45.0), np.radians(10.0), 0.0])
_CONTROLS = VECTORS["controls"]
_SPEEDS = ("true_airspeed", "calibrated_airspeed", "indicated_airspeed", "dynamic_pressure")
_ATTITUDE_VARIANCE = DEFAULT_SENSORS["attitude"].noise[0] ** 2


@dataclass(frozen=True)
class Messages:
    """n messages of a topic: stamps [ns] (n,) and flat fields."""

    topic: str
    stamp: Stamps
    fields: Mapping[str, Any]


@dataclass
class Plan:
    """What becomes of the mapped signals: found once, then carried out window by window."""

    streams: list[Stream]
    notes: list[str] = field(default_factory=list)
    #: Signal or topic that the recording does not get: why.
    missing: dict[str, str] = field(default_factory=dict)
    #: What every topic is made of.
    sources: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._where = {signal: (stream, i) for stream in self.streams for i, signal in enumerate(stream.signals)}
        self._imu = self._base([*VECTORS["specific_force"], *VECTORS["angular_velocity"]]) or self._base(
            VECTORS["attitude"]
        )
        self._controls = self._base(_CONTROLS)
        self.inputs = tuple(signal for signal in self._where if signal.startswith(INPUTS))
        self._inputs = self._base(self.inputs)
        self._speed = self._speed_signal()
        self._geodetic = self._geodetic_signals()
        self._plan_imu()
        self._plan_place()
        self._plan_air()
        self._plan_rest()

    def messages(self, window: Window) -> Iterator[Messages]:
        """All messages that are stamped in a window; each topic in order of stamps."""
        for messages in (
            self._imu_messages(window),
            *self._place_messages(window),
            self._velocity_messages(window),
            self._air_messages(window),
            self._control_messages(window),
            self._single(window, "height_above_ground", "height_above_ground", "range"),
            self._single(window, "mass_properties", "mass", "mass"),
            self._input_messages(window),
        ):
            if messages is not None and len(messages.stamp):
                yield messages

    # Planning: what is there, what is joined with what, what is left out.

    def _has(self, *signals: str) -> bool:
        return all(signal in self._where for signal in signals)

    def _base(self, signals: Sequence[str]) -> Stream | None:
        """The densest of the streams that hold any of the signals."""
        streams = [self._where[signal][0] for signal in signals if signal in self._where]
        return min(streams, key=lambda stream: (stream.step, -stream.count), default=None)

    def _source(self, topic: str, signals: Sequence[str]) -> None:
        used = dict.fromkeys(self._where[signal][0].source for signal in signals if signal in self._where)
        self.sources[topic] = " ".join(used)

    def _note_joined(self, base: Stream | None, signals: Sequence[str]) -> None:
        """That a stream is interpolated, where its clock is not that of the base."""
        if base is None:
            return
        for stream in dict.fromkeys(self._where[signal][0] for signal in signals if signal in self._where):
            if not stream.is_on_the_stamps_of(base):
                self.notes.append(f"{_few(stream.signals)} interpolated to the stamps of {_few(base.signals, of=True)}")

    def _plan_imu(self) -> None:
        force, rate, attitude = (VECTORS[name] for name in ("specific_force", "angular_velocity", "attitude"))
        if len({id(self._where[signal][0]) for signal in attitude if self._has(signal)}) > 1:
            self._not_carried(attitude, "roll, pitch and yaw must come from one table")
            self._where = {signal: place for signal, place in self._where.items() if signal not in attitude}
        if not self._has(*attitude):
            self._not_carried(attitude, "an attitude needs roll, pitch and yaw")
            self._where = {signal: place for signal, place in self._where.items() if signal not in attitude}
            if self._imu is not None and self._imu.name == "attitude":
                self._imu = None
        if self._imu is None:
            self.missing["imu/data"] = "no signal of an IMU is mapped"
            return
        self._source("imu/data", [*force, *rate, *attitude])
        self._note_joined(self._imu, [*force, *rate])
        lacking = [signal for signal in (*force, *rate) if not self._has(signal)]
        if lacking:
            self.missing["imu/data"] = f"without {', '.join(lacking)} it is incomplete: NaN, and replay cannot use it"
        if self._has(*attitude):
            self.notes.append(
                f"the attitude is given the standard deviation {DEFAULT_SENSORS['attitude'].noise[0]:g} rad: "
                "the aircraft file can say better"
            )

    def _plan_place(self) -> None:
        geodetic, position, velocity = (VECTORS[name] for name in ("geodetic", "position", "velocity"))
        if self._geodetic:
            self._source("gps/fix", self._geodetic)
            self._note_joined(self._where["latitude"][0], self._geodetic)
            self._not_carried(position, "latitude, longitude and altitude are there")
            if "altitude" not in self._geodetic:
                self.notes.append("no altitude is mapped: the positions have the pressure_altitude in its place")
        elif self._has(*position):
            self._source("gps/fix", position)
            self._note_joined(self._where["position.north"][0], position)
            self._not_carried(geodetic, "the position is whole")
            self.notes.append("the first position is put at 45° north, 10° east: distances and altitudes are right")
        else:
            self._not_carried(
                [s for s in geodetic if s != self._height()], "a position needs latitude, longitude and altitude"
            )
            self._not_carried(position, "a position needs north, east and down")
            self.missing.setdefault("gps/fix", "no whole position is mapped")
        if self._has(*velocity):
            self._source("gps/vel", velocity)
            self._note_joined(self._where["velocity.north"][0], velocity)
        else:
            self._not_carried(velocity, "a velocity needs north, east and down")
            self.missing["gps/vel"] = "no whole velocity is mapped"

    def _geodetic_signals(self) -> tuple[str, ...]:
        """What positions on the earth are made of; nothing without latitude, longitude and a height."""
        height = next((signal for signal in ("altitude", "pressure_altitude") if self._has(signal)), "")
        return ("latitude", "longitude", height) if height and self._has("latitude", "longitude") else ()

    def _not_carried(self, signals: Sequence[str], why: str) -> None:
        for signal in signals:
            if self._has(signal):
                self.missing[signal] = f"not carried over: {why}"

    def _speed_signal(self) -> str | None:
        """What the true airspeed is made of."""
        for signal in _SPEEDS:
            if self._has(signal) and (signal == "true_airspeed" or self._pressure_signal() is not None):
                return signal
        return None

    def _height(self) -> str | None:
        """The height whose standard pressure stands for a static pressure that is not measured."""
        if self._has("static_pressure") or self._has(*VECTORS["geodetic"]):
            return "pressure_altitude" if self._has("pressure_altitude") else None
        return next((s for s in ("pressure_altitude", "altitude") if self._has(s)), None)

    def _pressure_signal(self) -> str | None:
        return next((s for s in ("static_pressure", "pressure_altitude", "altitude") if self._has(s)), None)

    def _plan_air(self) -> None:
        pressure = self._pressure_signal()
        for signal in _SPEEDS:
            if self._has(signal) and signal != self._speed:
                why = f"{self._speed} is there" if self._speed else "it needs static_pressure or pressure_altitude"
                self.missing[signal] = f"not carried over: {why}"
        if self._speed is None:
            self.missing["true_airspeed"] = "no airspeed is mapped"
        elif self._speed != "true_airspeed":
            self._note_speed(str(pressure))
        if self._has("static_pressure", "pressure_altitude"):
            self.missing["pressure_altitude"] = "not carried over: static_pressure is there"
        elif height := self._height():
            self.notes.append(f"static_pressure is that of the standard atmosphere at {height}")
        needs_temperature = self._speed not in (None, "true_airspeed") or self._makes_density()
        if self._has("air_temperature") and not needs_temperature:
            self.missing["air_temperature"] = "not carried over: nothing uses it"
        if self._makes_density():
            self.notes.append("air_density is worked out from static pressure and air_temperature")
        used = [s for s in (self._speed, *_AIR, self._height()) if s and self._has(s) and s not in self.missing]
        if used:
            self._source("air_data", used)
        else:
            self.missing["air_data"] = "nothing of it is mapped"

    def _note_speed(self, pressure: str) -> None:
        air = "air_temperature" if self._has("air_temperature") else "the standard temperature"
        self.notes.append(f"true_airspeed is worked out from {self._speed}, {pressure} and {air}")
        if self._speed == "indicated_airspeed":
            self.notes.append("indicated_airspeed is taken as calibrated: errors of the probe are not corrected")

    def _makes_density(self) -> bool:
        has_pressure = self._has("static_pressure") or self._height() is not None
        return has_pressure and self._has("air_temperature") and not self._has("air_density")

    def _plan_rest(self) -> None:
        if self._controls is not None:
            self._source("control_surfaces", _CONTROLS)
            self._note_joined(self._controls, _CONTROLS)
        else:
            self.missing["control_surfaces"] = "no surface, throttle or thrust is mapped"
        if self._inputs is not None:
            self._source(INPUTS_TOPIC, self.inputs)
            self._note_joined(self._inputs, self.inputs)
        for topic, signal in (("height_above_ground", "height_above_ground"), ("mass_properties", "mass")):
            if self._has(signal):
                self._source(topic, [signal])

    # Carrying out.

    def _at(self, signal: str, stamp: Stamps) -> Array:
        if signal not in self._where:
            return np.full(len(stamp), np.nan)
        return value_at(*self._where[signal], stamp)

    def _air_temperature(self, stamp: Stamps) -> Array:
        if not self._has("air_temperature"):
            return np.full(len(stamp), np.nan)
        return slow_value_at(*self._where["air_temperature"], stamp)

    def _first(self, signal: str) -> float:
        """The first value of a signal: grids of a country count from far away."""
        stream, i = self._where[signal]
        values = stream.values[: 10 * ROWS, i]
        known = np.flatnonzero(np.isfinite(values))
        return float(values[known[0]]) if len(known) else 0.0

    def _vector_at(self, signals: Sequence[str], stamp: Stamps) -> Array:
        return np.stack([self._at(signal, stamp) for signal in signals], axis=1)

    def _imu_messages(self, window: Window) -> Messages | None:
        if self._imu is None:
            return None
        rows = window.rows(self._imu.stamp)
        stamp = np.array(self._imu.stamp[rows])
        force, rate = (self._vector_at(VECTORS[name], stamp) for name in ("specific_force", "angular_velocity"))
        fields: dict[str, Any] = imu_fields(force, rate)
        there = np.zeros(len(stamp), dtype=bool)
        if self._has(*VECTORS["attitude"]) and len(stamp):
            before = int(self._imu.stamp[rows.start - 1]) if rows.start else np.iinfo(np.int64).min
            quaternion, there = attitude_at(self._where["attitude.roll"][0], stamp, before)
            fields["orientation"][there] = quaternion_enu_flu(quaternion[there])
            fields["orientation_covariance"][there] = np.diag([_ATTITUDE_VARIANCE] * 3).ravel()
        measured = np.isfinite(force).any(axis=1) | np.isfinite(rate).any(axis=1) | there
        both = self._has("specific_force.x", "angular_velocity.x")
        if both:  # before the first and after the last of the slower sensor, and in its gaps
            measured = (np.isfinite(force).any(axis=1) & np.isfinite(rate).any(axis=1)) | there
        return Messages("imu/data", stamp[measured], {name: value[measured] for name, value in fields.items()})

    def _place_messages(self, window: Window) -> Iterator[Messages]:
        if "gps/fix" not in self.sources:
            return
        names = self._geodetic or VECTORS["position"]
        stamp, place = self._whole(window, names)
        if names == VECTORS["position"]:
            away = place - np.array([self._first("position.north"), self._first("position.east"), 0.0])
            place = earth.geodetic_along(away, REFERENCE)
        yield Messages("gps/fix", stamp, gps_fix_fields(place[:, 0], place[:, 1], place[:, 2]))

    def _velocity_messages(self, window: Window) -> Messages | None:
        if "gps/vel" not in self.sources:
            return None
        stamp, velocity = self._whole(window, VECTORS["velocity"])
        return Messages("gps/vel", stamp, gps_velocity_fields(velocity))

    def _whole(self, window: Window, signals: Sequence[str]) -> tuple[Stamps, Array]:
        """Rows in which all of the signals are known, at the stamps of the first."""
        stamps = self._where[signals[0]][0].stamp
        stamp = np.array(stamps[window.rows(stamps)])
        values = self._vector_at(signals, stamp)
        whole = np.isfinite(values).all(axis=1)
        return stamp[whole], values[whole]

    def _air_messages(self, window: Window) -> Messages | None:
        """Each quantity at its own stamps; those that share a stamp share the message."""
        parts: dict[str, tuple[Stamps, Array]] = {}
        if self._speed is not None:
            parts["true_airspeed"] = self._true_airspeed(window)
        for name in ("angle_of_attack", "sideslip", "air_density", "static_pressure"):
            if self._has(name):
                parts[name] = self._measured(window, name)
        if (signal := self._height()) and not self._has("static_pressure"):
            stamp, height = self._measured(window, signal)
            parts["static_pressure"] = stamp, standard_pressure(height)
        if self._makes_density():
            stamp, pressure = parts["static_pressure"]
            parts["air_density"] = stamp, density_of(pressure, self._air_temperature(stamp))
        if not parts:
            return None
        stamps = np.unique(np.concatenate([stamp for stamp, _ in parts.values()]))
        fields = {name: np.full(len(stamps), np.nan) for name in _AIR_FIELDS}
        for name, (stamp, value) in parts.items():
            fields[name][np.searchsorted(stamps, stamp)] = value
        return Messages("air_data", stamps, fields)

    def _measured(self, window: Window, signal: str) -> tuple[Stamps, Array]:
        """Stamps and values of a signal where it was measured."""
        stream, i = self._where[signal]
        rows = window.rows(stream.stamp)
        stamp, value = np.array(stream.stamp[rows]), np.array(stream.values[rows, i])
        known = np.isfinite(value)
        return stamp[known], value[known]

    def _true_airspeed(self, window: Window) -> tuple[Stamps, Array]:
        stamp, speed = self._measured(window, str(self._speed))
        if self._speed == "true_airspeed":
            return stamp, speed
        pressure = self._at(str(self._pressure_signal()), stamp)
        if self._pressure_signal() != "static_pressure":
            pressure = standard_pressure(pressure)
        temperature = self._air_temperature(stamp)
        temperature = np.where(np.isfinite(temperature), temperature, temperature_at(pressure))
        if self._speed == "dynamic_pressure":
            found = true_of_impact_pressure(speed, pressure, temperature)
        else:
            found = np.sign(speed) * true_airspeed(np.abs(speed), "calibrated", pressure, temperature)
        known = np.isfinite(found)
        return stamp[known], found[known]

    def _control_messages(self, window: Window) -> Messages | None:
        if self._controls is None:
            return None
        stamp = np.array(self._controls.stamp[window.rows(self._controls.stamp)])
        return Messages("control_surfaces", stamp, {name: self._at(name, stamp) for name in _CONTROLS})

    def _single(self, window: Window, topic: str, signal: str, name: str) -> Messages | None:
        if not self._has(signal):
            return None
        stamp, value = self._measured(window, signal)
        return Messages(topic, stamp, {name: value})

    def _input_messages(self, window: Window) -> Messages | None:
        if self._inputs is None:
            return None
        stamp = np.array(self._inputs.stamp[window.rows(self._inputs.stamp)])
        return Messages(INPUTS_TOPIC, stamp, {"position": self._vector_at(self.inputs, stamp)})


def _few(signals: Sequence[str], *, of: bool = False) -> str:
    """Signals of a stream, for a note."""
    if of or len(signals) == 1:
        return signals[0] if of else f"{signals[0]} is"
    return f"{signals[0]} to {signals[-1]} are"


_AIR_FIELDS = ("true_airspeed", "angle_of_attack", "sideslip", "air_density", "static_pressure")
_AIR = ("angle_of_attack", "sideslip", "air_density", "static_pressure", "pressure_altitude", "air_temperature")


def type_of(topic: str) -> str:
    """Type of a topic's messages."""
    return INPUTS_TYPE if topic == INPUTS_TOPIC else TOPICS[topic]
