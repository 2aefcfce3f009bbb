"""A number of the aircraft file that explains the measurements better than the one it has, and whether it matters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS, SENSOR_ALIASES, SENSOR_GROUPS
from aircraft_sysid_ros.diagnosis.flight.reconstruction import (
    AIR_DATA,
    Likelihood,
    Reconstruction,
)
from aircraft_sysid_ros.diagnosis.search.evaluator import Score
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import Effect, ShapeParameter, Variant, with_setting
from aircraft_sysid_ros.identification.coefficients.pace import interval_of
from aircraft_sysid_ros.samples import Kind, Samples, fewer_manoeuvres

#: Longest stretch [s] of a flight that is run again for each setting.
LONGEST = 120.0
#: Sensors of the motion over ground, the attitude besides.
OF_MOTION = {"imu": Kind.IMU, "gps": Kind.GPS_VELOCITY}
#: Errors of the air data that feign a wind.
_OF_WIND = ("scale", "offset", "drift")
#: What makes a sensor, or what servos move, late.
_LATE = ("delay", "lag")
#: Where a probe ahead is, and how late air data are.
AHEAD, AIR_DATA_LAG = ("air_data_position", "x"), ("sensors", "air_data", "delay")

#: New values that show how long a record is held, which share of the intervals between them may be shorter, and the
#: longest [s], which is the longest delay that is looked for.
_FEWEST_NEW, _SHORTEST_SHARE, _LONGEST_HELD = 10, 0.1, 0.25


def feigns_wind(setting: tuple[str, ...]) -> bool:
    """Whether a setting is a scale, an offset or a drift of the air data."""
    return setting[-1] in _OF_WIND and setting[1] in AIR_DATA


@dataclass(frozen=True)
class Setting:
    """A number of the aircraft file that explains the measurements better than the one it has."""

    effect: Effect
    variant: Variant
    nominal: float
    value: float
    gain: float  # of the log-likelihood
    evidence: float  # the gain over what is needed: above 1 it is significant
    std: float  # of the value, from the curvature of the likelihood
    of_coefficients: bool = False  # forces and moments tell it, and not the likelihood of the sensors
    beside: tuple[tuple[tuple[str, ...], float], ...] = ()  # other settings that it moves, and where to

    @property
    def values(self) -> tuple[tuple[tuple[str, ...], float], ...]:
        """It and what it moves: each key of the aircraft file with its value, as ``with_setting`` takes them."""
        return (self.variant.setting, self.value), *self.beside

    @property
    def judges(self) -> str:
        """What it fits better, in words."""
        return "forces and moments" if self.of_coefficients or CONTROLS in self.variant.setting else "the sensors"

    @property
    def feigns_wind(self) -> bool:
        """It feigns a wind that walks: the air must be calm once it is taken off."""
        return feigns_wind(self.variant.setting)

    @property
    def is_late(self) -> bool:
        """It is by how much something is late."""
        return self.variant.setting[-1] in _LATE

    @property
    def is_place(self) -> bool:
        """It is where a sensor sits."""
        return self.variant.setting[0].endswith("_position")

    @property
    def is_of_probe_in_time(self) -> bool:
        """It makes the flow angles of a turning aeroplane early or late: a probe ahead, or air data that are late."""
        key = self.variant.setting
        return key == AHEAD or (key[-1] == "delay" and key[1] in ("air_data", *AIR_DATA))

    @property
    def of_motion(self) -> bool:
        """It is one of IMU or GPS, which others of their kind tell without the air data."""
        return self.variant.setting[1] in OF_MOTION

    @property
    def label(self) -> str:
        """Id and variant."""
        return self.effect.identifier + (f" ({self.variant.name})" if self.variant.name else "")


def setting_of(trial: Score, library: Sequence[Effect], aircraft: Aircraft, evidence: float) -> Setting:
    """The setting that an error of a sensor is which a trial of its terms has shown in the coefficients."""
    axis, candidate = trial.main_axis, trial.candidate
    number = float(trial.gains[axis].parameters[0]) / candidate.ties[axis][0].factor
    effect = next(each for each in library if each.identifier == candidate.family)
    start = nominal(aircraft, effect.variants[0].setting)
    value = float(f"{start + number:.4g}")
    return Setting(effect, effect.variants[0], start, value, trial.score, evidence, np.nan, of_coefficients=True)


def in_file(setting: Setting, aircraft: Aircraft) -> Aircraft:
    """The aircraft file with a setting. Raises InputError where no file may hold it."""
    for key, value in setting.values:
        aircraft = with_setting(aircraft, key, value)
    return aircraft


def is_a_fault(setting: Setting, file: Aircraft, samples: Samples) -> bool:
    """Whether a setting contradicts what is known, and does not only say what the aircraft file leaves out.

    A place that the file does not state, and a delay of about half the time from sample to sample, as averaging makes
    it, are taken into account and are no fault. Nor is a place of the air data that such a delay stands for: a probe
    that is d further ahead in the airspeed V is d/V early wherever the aeroplane turns.
    """
    key, size = setting.variant.setting, abs(setting.value - setting.nominal)
    if setting.is_place:
        stated = key not in file.unsaid
        if not stated or key[0] != AHEAD[0]:
            return stated
        airspeed = samples.values[samples.kind == Kind.AIRSPEED, 0]
        typical = float(np.nanmedian(airspeed)) if np.any(np.isfinite(airspeed)) else 0.0
        return size * file.span >= typical * _delay_of_averaging(samples, Kind.IMU, Kind.AIRSPEED)
    if key[-1] in _LATE:
        of_one = {**OF_MOTION, CONTROLS: Kind.CONTROLS, **AIR_DATA}
        kinds = [of_one[key[1]]] if key[1] in of_one else AIR_DATA.values()
        allowed = _delay_of_averaging(samples, *kinds)
        if setting.value > setting.nominal:  # recorded late, as what is held is
            held = max(_held_interval(samples, kind) for kind in kinds)
            allowed = max(allowed, THRESHOLDS.least_delay_share * held)
        return size >= allowed
    return True


def _delay_of_averaging(samples: Samples, *kinds: Kind) -> float:
    """The delay [s] that is no fault of the slowest of some sensors."""
    slowest = max((interval_of(samples, kind) for kind in kinds), key=np.nan_to_num)
    return max(THRESHOLDS.least_delay, THRESHOLDS.least_delay_share * slowest)


def _held_interval(samples: Samples, kind: Kind) -> float:
    """Time [s] between new values of a sensor where rows of a faster record only repeat them; else 0. Of controls those
    of elevator, aileron and rudder count: thrust may be new in every row.

    Nearly all intervals between new values are that long, or longer where surfaces stand still. Commands in steps are
    further apart, and not held.
    """
    at = samples.kind == kind
    values, stamp = samples.values[at, : 3 if kind == Kind.CONTROLS else None], samples.stamp[at]
    new = np.flatnonzero(np.any(np.diff(np.nan_to_num(values), axis=0) != 0.0, axis=1)) + 1
    if len(new) < _FEWEST_NEW:
        return 0.0
    interval = 1e-9 * float(np.quantile(np.diff(stamp[new]), _SHORTEST_SHARE))
    return interval if interval <= _LONGEST_HELD else 0.0


def nominal(aircraft: Aircraft, setting: tuple[str, ...]) -> float:
    """What the aircraft file says now; 0 for a shift of a position."""
    if setting[0].endswith("_position"):
        return 0.0
    if setting[0] == "process_noise":
        return aircraft.process_noise[setting[1]]
    name = SENSOR_GROUPS.get(setting[1], (SENSOR_ALIASES.get(setting[1], setting[1]),))[0]
    return float(getattr(aircraft.sensors[name], setting[2]))


def is_small(setting: tuple[str, ...], value: float, flight: Reconstruction) -> bool:
    """Whether a scale, an offset or a drift is less than what matters to any coefficient."""
    quantity, of_airspeed = setting[-1], setting[1] == "airspeed"
    seconds = float(np.ptp(flight.points[:, 0])) if len(flight.points) else 0.0
    if quantity == "drift":
        value *= seconds
    if quantity == "scale" and not of_airspeed:
        return abs(value - 1.0) < THRESHOLDS.least_angle_scale
    deviation = abs(value - 1.0) if quantity == "scale" else abs(value)
    return deviation < (THRESHOLDS.least_scale if of_airspeed else THRESHOLDS.least_offset)


#: By moment the held-out error and that of the fit to all points.
Errors = dict[str, tuple[float, float]]
#: A flight and the stretch of it that is run again, a setting and its range, the likelihood of the sensors and the
#: errors of the moments without it, and whether it is calm.
Job = tuple[Reconstruction, Samples, Effect, Variant, ShapeParameter, Likelihood, Errors, bool]


def stretch_of(flight: Reconstruction) -> Samples:
    """Samples from shortly before the first point on, LONGEST at most; of manoeuvres so many, evenly chosen."""
    if np.any(flight.samples.kind == Kind.SEAM):
        return fewer_manoeuvres(flight.samples, LONGEST)
    begin = flight.epoch + int((flight.points[0, 0] - 10.0) * 1e9) if len(flight.points) else 0
    stamp = flight.samples.stamp
    return flight.samples[(stamp >= begin) & (stamp <= begin + int((LONGEST + 10.0) * 1e9))]
