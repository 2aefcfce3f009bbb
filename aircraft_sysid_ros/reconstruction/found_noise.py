"""What a flight has shown of its sensors, for people and for the aircraft file: their noise, the place of a vane."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.aircraft.sensor_settings import by_name
from aircraft_sysid_ros.reconstruction.filter_setup import SENSOR_OF_KIND
from aircraft_sysid_ros.reconstruction.sensor_noise import (
    BASE,
    COLOURED,
    SCALE,
    WHITE,
    has_learnt,
    imu_has_learnt,
    imu_scales,
    largest_scale,
    slow_part,
)
from aircraft_sysid_ros.reconstruction.sparse_imu import votes_are_for_sparse
from aircraft_sysid_ros.reconstruction.state import Setup
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]

#: Where a noise comes from.
FILE, MESSAGES, DEFAULT, FLIGHT = "file", "messages", "default", "flight"
_KINDS = (
    Kind.ATTITUDE, Kind.GPS_POSITION, Kind.GPS_VELOCITY, Kind.AIRSPEED, Kind.ANGLE_OF_ATTACK, Kind.SIDESLIP, Kind.AIR,
)  # fmt: skip
_AXES = {Kind.ATTITUDE: 3, Kind.GPS_POSITION: 3, Kind.GPS_VELOCITY: 3}
_IMU = ("accelerometer", "gyro")
#: A stated noise is contradicted where the flight has so many times as much.
_CONTRADICTED = 2.5
#: Slow error [rad] of an attitude that is worth a note.
_WORTH_A_NOTE = 0.01


@dataclass(frozen=True)
class SensorNoise:
    """Of one sensor, in its unit: one sigma per axis in use, where it comes from, and what the flight shows of it."""

    name: str
    in_use: Array
    source: str
    shown: Array | None  # None: too few samples
    slow: Array | None = None  # rms of the slow error of an attitude [rad] about x, y, z; None: it has none

    @property
    def json(self) -> dict[str, Any]:
        """For state.json."""
        result: dict[str, Any] = {"noise": _rounded(self.in_use), "source": self.source}
        if self.shown is not None:
            result["shown"] = _rounded(self.shown)
        if self.slow is not None:
            result["slow_error"] = _rounded(self.slow)
        return result


def found_noise(state: StateEstimator) -> list[SensorNoise]:
    """Of every sensor that was heard; empty before the filter has started."""
    setup = state.setup
    if setup is None:
        return []
    counts = state.counts()
    heard = [kind for kind in _KINDS if (of := counts[kind.name.lower()])["fused"] + of["rejected"]]
    return [*_of_imu(state, setup), *(_of_kind(state, setup, kind) for kind in heard)]


def _of_imu(state: StateEstimator, setup: Setup) -> list[SensorNoise]:
    learnt, found = imu_has_learnt(state.memory.imu_noise), []
    scales = imu_scales(state.memory.imu_noise, largest_scale(votes_are_for_sparse(state.memory)))
    variances = (setup.accelerometer_variance, setup.gyro_variance)
    for number, name in enumerate(_IMU):
        said = np.sqrt(variances[number : number + 1])
        shown = said * np.sqrt(scales[number])
        given, default = bool(setup.imu_given[number]), state.aircraft.sensors[name].noise[0] == said[0]
        in_use = said if given else shown
        found.append(SensorNoise(name, in_use, _source(given, learnt, default), shown if learnt else None))
    return found


def _of_kind(state: StateEstimator, setup: Setup, kind: Kind) -> SensorNoise:
    outputs = _AXES.get(kind, 1)
    channel = state.memory.noise[kind, :outputs]
    learnt, given = has_learnt(channel[0]), bool(setup.given[kind])
    name = SENSOR_OF_KIND[kind]
    of_samples = state.aircraft.sensors[name].scale ** 2  # the filter has its noise with the scale taken off
    said, known = setup.variance[kind, :outputs] * of_samples, channel[:, BASE] > 0.0
    base = np.where(known, channel[:, BASE] * of_samples, said)
    shown = np.sqrt(base * channel[:, SCALE])
    source = _source(given, learnt, bool(np.array_equal(base, said)))
    slow = None
    if kind == Kind.ATTITUDE and learnt and not given and channel[:, COLOURED].any():
        slow = np.sqrt(base * [slow_part(one) for one in channel])
        slow = slow if slow.max() > _WORTH_A_NOTE else None
    in_use = np.sqrt(base) if given else shown
    white = np.sqrt(base * channel[:, WHITE])
    return SensorNoise(name, in_use, source, (white if given else shown) if learnt else None, slow)


def _source(given: bool, learnt: bool, is_default: bool) -> str:
    if given:
        return FILE
    if learnt:
        return FLIGHT
    return DEFAULT if is_default else MESSAGES


def found_wind_walk(state: StateEstimator) -> tuple[float, str]:
    """Least random walk of the wind [m/s per sqrt(s)] in use, and where it comes from."""
    walk, said = float(state.memory.calm_walk[0]), state.aircraft.process_noise["wind"]
    if (state.aircraft.source.get("process_noise") or {}).get("wind") is not None:
        return walk, FILE
    return walk, DEFAULT if walk == said else FLIGHT


def noise_json(state: StateEstimator) -> dict[str, Any]:
    """The entry ``sensor_noise`` of state.json."""
    walk, source = found_wind_walk(state)
    wind = {"wind": {"random_walk": float(f"{walk:.3g}"), "source": source}}
    return {**{each.name: each.json for each in found_noise(state)}, **wind}


def noise_notes(state: StateEstimator) -> list[str]:
    """What a user should know: an attitude with a slow error, and a stated noise that the flight denies."""
    found = []
    for each in found_noise(state):
        if each.slow is not None:
            roll, pitch, heading = np.rad2deg(each.slow)
            found.append(
                f"the attitude of the recording has a slow error of its own, {roll:.1f}° in roll, {pitch:.1f}° in "
                f"pitch and {heading:.1f}° in heading (rms): it counts for less than its noise says"
            )
        fused = each.name not in _IMU  # rough motion in gusts looks like noise of the IMU
        if (
            fused
            and each.source == FILE
            and each.shown is not None
            and np.max(each.shown / each.in_use) > _CONTRADICTED
        ):
            said = stated_and_shown(each.name, each.in_use, each.shown)
            found.append(f"{said}: what is stated is used; leave it out to have it found")
    return found


def stated_and_shown(name: str, stated: Array, shown: Array) -> str:
    """The noise of a sensor that the aircraft file states, and that of the flight, in words."""
    return f"the aircraft file states {_text(stated)} as noise of the sensor {name}, the flight shows {_text(shown)}"


def completed_file(
    state: StateEstimator,
    late_surfaces: Mapping[str, tuple[float, float]] | None = None,
    vane_place: tuple[float, float] | None = None,
) -> dict[str, Any]:
    """The content of the aircraft file with what the flight has shown, where the file says nothing.

    ``late_surfaces``: delay or lag [s] that the second step has found of them, and one sigma. ``vane_place`` [m]: how
    far to the right of the centre of gravity the check in flight has found the vane, and one sigma.
    """
    source = copy.deepcopy(state.aircraft.source)
    sensors = by_name(source.get("sensors"))
    for each in found_noise(state):
        if each.source == FLIGHT:
            is_gps = each.name in ("gps_position", "gps_velocity")
            noise = each.in_use if is_gps else np.sqrt(np.mean(each.in_use**2, keepdims=True))
            sensors.setdefault(each.name, {})["noise"] = _rounded(noise) if is_gps else _rounded(noise)[0]
    if late_surfaces:
        late = {key: f"{value:.3f} ± {std:.3f}" for key, (value, std) in late_surfaces.items()}
        sensors.setdefault("control_surfaces", {}).update(late)
    if sensors:
        source["sensors"] = sensors
    if vane_place is not None:
        source["air_data_position"] = placed(vane_place, source)
    walk, where = found_wind_walk(state)
    if where == FLIGHT:
        source["process_noise"] = {**(source.get("process_noise") or {}), "wind": float(f"{walk:.3g}")}
    return source


def placed(vane_place: tuple[float, float], source: Mapping[str, Any]) -> list[Any]:
    """``air_data_position`` [m] of a vane that was found so far to the right, and what the file says besides."""
    x, _, z = source.get("air_data_position") or (None, None, None)
    return [x, f"{vane_place[0]:.2f} ± {max(vane_place[1], 0.01):.2f}", z]


def with_vane(aircraft: Aircraft, vane_place: tuple[float, float]) -> Aircraft:
    """The aircraft with the vane where it was found."""
    return aircraft_from_dict({**aircraft.source, "air_data_position": placed(vane_place, aircraft.source)})


def _rounded(values: Array) -> list[float]:
    return [float(f"{value:.3g}") for value in values]


def _text(values: Array) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
