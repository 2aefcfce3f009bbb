"""What the sensors of the MAVLink simulator show, a second at a time, for a flight that is watched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.earth import geodetic_along
from aircraft_sysid_ros.recordings.writer import RecordingWriter
from aircraft_sysid_ros.ros_messages.conversion import TOPICS, flu_from_frd, frame_of, samples_and_rows
from aircraft_sysid_ros.samples import Samples, concatenate
from aircraft_sysid_ros.sensors.sensor_models import EPOCH, SensorOptions, generator, measure
from aircraft_sysid_ros.sensors.truth import Truth
from aircraft_sysid_ros.stamps import NANOSECONDS

Array = npt.NDArray[np.float64]

#: What the autopilot's own filter tells, to be encoded: attitude with rates, velocity with place, and wind.
ATTITUDE, VELOCITY, WIND = "autopilot/attitude", "autopilot/velocity", "autopilot/wind"
_FILTER_RATES = {ATTITUDE: 50.0, VELOCITY: 50.0, WIND: 1.0}  # [Hz]
_VELOCITY_NOISE = 0.05  # [m/s]
_ACCELEROMETER_BIAS, _GYRO_BIAS = 0.15, 0.01  # one sigma
_PHASE = 0.0017  # [s] of the filter's samples


@dataclass(frozen=True)
class Event:
    """One sample of a topic: time of flight [s] at which it is taken, and its flat fields, each (1,) or (1, k)."""

    time: float
    topic: str
    fields: dict[str, npt.NDArray[Any]]


class FlightSensors:
    """Sensors of one flight, without delay; biases are constant. ``events`` takes consecutive pieces of the truth."""

    def __init__(self, aircraft: Aircraft, seed: int, *, vanes: bool = True, noise_scale: float = 1.0) -> None:
        sensors = {name: replace(sensor, delay=0.0) for name, sensor in aircraft.sensors.items()}
        self.aircraft = replace(aircraft, sensors=sensors, process_noise=dict.fromkeys(aircraft.process_noise, 0.0))
        self._seed, self._vanes, self._piece = seed, vanes, 0
        rng = generator(seed, "biases of the stand-in")  # names of seeds: others would be other numbers
        self.accelerometer_bias = _ACCELEROMETER_BIAS * rng.standard_normal(3)
        self.gyro_bias = _GYRO_BIAS * rng.standard_normal(3)
        self._options = SensorOptions(
            noise_scale=noise_scale, accelerometer_bias=0.0, gyro_bias=0.0, transport_scale=0.0, magnetometer=True
        )

    def events(self, truth: Truth) -> list[Event]:
        """Samples of a piece of flight in order of time, those of its last instant left to the next piece."""
        end = float(truth.time[-1])
        seed = 1000 * self._seed + self._piece  # other noise in every piece
        streams, _ = measure(self.aircraft, truth, seed, self._options)
        found: list[Event] = []
        for stream in streams:
            fields = self._biased(stream.topic, stream.fields)
            times = (stream.stamp - EPOCH) / NANOSECONDS
            found += [Event(float(t), stream.topic, _row(fields, i)) for i, t in enumerate(times) if t < end - 1e-9]
        found += self._of_the_filter(truth, generator(seed, "filter of the stand-in"))
        self._piece += 1
        return sorted(found, key=lambda event: event.time)

    def _biased(self, topic: str, fields: dict[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
        if topic == "imu/data":
            return {
                **fields,
                "linear_acceleration": fields["linear_acceleration"] + flu_from_frd(self.accelerometer_bias),
                "angular_velocity": fields["angular_velocity"] + flu_from_frd(self.gyro_bias),
            }
        if topic == "air_data" and not self._vanes:
            nothing = np.full(len(fields["sideslip"]), np.nan)
            return {**fields, "angle_of_attack": nothing, "sideslip": nothing}
        return fields

    def _of_the_filter(self, truth: Truth, rng: np.random.Generator) -> list[Event]:
        found = []
        for topic, rate in _FILTER_RATES.items():
            count = int(np.ceil((truth.time[-1] - truth.time[0] - _PHASE) * rate - 1e-9))
            seen = truth.at(truth.time[0] + _PHASE + np.arange(count) / rate)
            fields = _filtered(topic, seen, self._options.noise_scale * rng.standard_normal((count, 3)))
            found += [Event(float(t), topic, _row(fields, i)) for i, t in enumerate(seen.time)]
        return found


def _filtered(topic: str, seen: Truth, noise: Array) -> dict[str, npt.NDArray[Any]]:
    """What the autopilot's filter tells at n times, with unit noise (n, 3) for its velocity."""
    if topic == ATTITUDE:
        return {"attitude": seen.quaternion, "rates": seen.rates}
    if topic == WIND:
        return {"wind": seen.wind}
    place = geodetic_along(seen.position, seen.origin)
    return {"velocity": seen.velocity + _VELOCITY_NOISE * noise, "place": place, "above_home": -seen.position[:, 2]}


def _row(fields: dict[str, npt.NDArray[Any]], i: int) -> dict[str, npt.NDArray[Any]]:
    return {name: np.asarray(column)[i : i + 1] for name, column in fields.items()}


def pieces(truth: Truth, length: float = 1.0) -> list[Truth]:
    """A flight cut into pieces of ``length`` [s] that share their ends."""
    step = float(truth.time[1] - truth.time[0])
    each = round(length / step)
    return [truth[begin : begin + each + 1] for begin in range(0, len(truth) - each, each)]


def direct_samples(events: Sequence[Event], start: int) -> Samples:
    """The samples (in order of time) as our topics would bring them; time 0 is stamped ``start`` [ns]."""
    batches, keys = [], []
    for topic, stamp, fields, order in _columns(events, start):
        for samples, rows in samples_and_rows(topic, stamp, fields):
            batches.append(samples)
            keys.append(order[rows])
    return concatenate(batches)[np.argsort(np.concatenate(keys), kind="stable")]


def write_direct(events: Sequence[Event], start: int, writer: RecordingWriter) -> None:
    """The same into a recording."""
    for topic, stamp, fields, _ in _columns(events, start):
        writer.write(topic, TOPICS[topic], stamp, fields, frame_id=frame_of(topic))


def _columns(events: Sequence[Event], start: int) -> list[tuple[str, Any, dict[str, Any], Any]]:
    """By topic: stamps [ns] (n,), flat fields, and places in the sequence (n,)."""
    found = []
    for topic in TOPICS:
        order = np.array([i for i, event in enumerate(events) if event.topic == topic], dtype=np.int64)
        if len(order):
            times = np.array([events[i].time for i in order])
            names = events[order[0]].fields
            fields = {name: np.concatenate([events[i].fields[name] for i in order]) for name in names}
            found.append((topic, start + np.rint(times * NANOSECONDS).astype(np.int64), fields, order))
    return found
