"""What the search for one setting of a sensor gains in replicas of the flight, whose sensors are right.

A likelihood knows no gusts but a wind that walks at random, and no errors but white ones; what else is in a flight
makes some setting likelier than none. A replica flies the motion and the wind that the flight has with the setting
corrected, and with sensors that are as they should be, so that the same search finds in it what such a flight feigns.
The wind of the flight before it was corrected will not do: a vane that is mounted wrong is in it as a wind, and
replicas in that wind would show the same fault.

A delay of the controls must besides lower the error of a moment that is above what noise makes of it in the replicas,
as an effect of the library must: where an autopilot holds a course in calm air the surfaces say little of their own, of
which the records' noise is as large, and a delay tells apart what noise has made alike.

Not all replicas are flown where the first of them leave no doubt: a chance that is a tenth of the least that is asked
for ends it, and so does one that is even. With scores that are skewed or heavy-tailed that makes no more false alarms
than all replicas at once; with those that are large in one of ten replicas, and next to nothing in the others, the
first dozen says 1.5 times as often as all twenty do that it is beyond chance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import MOMENTS
from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.sensor_settings import CONTROLS
from aircraft_sysid_ros.diagnosis.flight.reconstruction import (
    Reconstruction,
    as_flown,
    reconstruct_as_flown,
    repeated_rows,
    settled_flight,
)
from aircraft_sysid_ros.diagnosis.measurement.faults import jobs_of, try_setting
from aircraft_sysid_ros.diagnosis.measurement.setting import Setting
from aircraft_sysid_ros.diagnosis.search.fit import fits_of
from aircraft_sysid_ros.diagnosis.significance.bootstrap_flight import world_of
from aircraft_sysid_ros.diagnosis.significance.maximum_statistic import Null
from aircraft_sysid_ros.diagnosis.significance.parametric_bootstrap import LONGEST, fitted_parameters
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.effects.effect import with_setting
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.processes import in_parallel
from aircraft_sysid_ros.reconstruction.servo_lag import ServoLag
from aircraft_sysid_ros.samples import Kind, Samples

Array = npt.NDArray[np.float64]

#: Replicas that are flown first, and the share of ``Thresholds.further`` below which, and the chance above which, the
#: others are not.
_FIRST, _CLEAR, _HOPELESS = 12, 0.1, 0.5


@dataclass(frozen=True)
class InReplica:
    """What a replica makes of a setting: its gain at its best value, NaN where the filter does not start on it.

    ``errors``: of a delay of the controls the held-out error of each moment, as the aircraft file has it.
    """

    gain: float
    errors: Mapping[str, float] = field(default_factory=dict)


def chance_of(
    fault: Setting,
    errors: Mapping[str, tuple[float, float]],
    corrected: Reconstruction,
    calm: bool,
    tried: int,
    count: int,
) -> float:
    """Probability that a flight like this one whose sensors are right prefers one of so many settings as much.

    ``errors``: of the axes without and with it; ``corrected``: the flight with the setting; ``calm``: whether it was,
    before. 1 where there are no replicas.
    """
    flown, chance = list[InReplica](), 1.0
    for seeds in filter(len, (range(min(_FIRST, count)), range(_FIRST, count))):
        flown += in_replicas(fault, corrected, calm, seeds)
        chance = _chance(fault, errors, flown, tried)
        if not _CLEAR * THRESHOLDS.further <= chance <= _HOPELESS:
            break
    return chance


def _chance(fault: Setting, errors: Mapping[str, tuple[float, float]], flown: Sequence[InReplica], tried: int) -> float:
    """``chance_of`` by the replicas that have been flown."""
    gains = np.array([replica.gain for replica in flown])
    if not np.isfinite(gains).any():
        return 1.0
    if CONTROLS in fault.variant.setting and not _is_above_noise(errors, _median_errors(flown)):
        return 1.0
    return float(min(1.0, tried * Null({fault.label: gains}).test(fault.label, fault.gain)[2]))


def _is_above_noise(errors: Mapping[str, tuple[float, float]], noise: Mapping[str, float]) -> bool:
    """Whether the error of a moment falls by ``Thresholds.size`` that was above what noise makes of it."""
    return any(
        errors[axis][1] <= (1.0 - THRESHOLDS.size) * errors[axis][0]
        and errors[axis][0] >= THRESHOLDS.above_floor * noise[axis]
        for axis in noise.keys() & errors.keys()
    )


def _median_errors(flown: Sequence[InReplica]) -> dict[str, float]:
    """Of the replicas that have a moment, by moment."""
    known = {axis: [each.errors[axis] for each in flown if axis in each.errors] for axis in MOMENTS}
    return {axis: float(np.median(errors)) for axis, errors in known.items() if errors}


def in_replicas(fault: Setting, corrected: Reconstruction, calm: bool, seeds: Sequence[int]) -> list[InReplica]:
    """The setting in replicas, one of each seed, of the flight that was corrected with it."""
    flight = replace(
        corrected, aircraft=_with_sensors_right(corrected.aircraft, fault), samples=_controls_on_time(corrected, fault)
    )  # fmt: skip
    data = settled_flight(flight)
    stretches, parameters = repeated_rows(flight, LONGEST), fitted_parameters(data)
    spreads = {axis: fit.spread for axis, fit in fits_of(data, MOMENTS)[0].items() if fit.spread > 0.0}
    return list(in_parallel(_in_one, [(fault, flight, stretches, parameters, spreads, calm, seed) for seed in seeds]))


def _with_sensors_right(aircraft: Aircraft, fault: Setting) -> Aircraft:
    """The aircraft that a flight was corrected with, whose sensors are as the file had them."""
    back = -fault.value if fault.is_place else fault.nominal  # a place is moved on
    return with_setting(aircraft, fault.variant.setting, back)


def _controls_on_time(corrected: Reconstruction, fault: Setting) -> Samples:
    """The samples, and where the controls are late those that are not: replicas move by what they do."""
    samples, key = corrected.samples, fault.variant.setting
    if CONTROLS not in key:
        return samples
    if key[-1] == "lag":
        return ServoLag(fault.value).follow(samples)
    late = round(1e9 * (fault.value - fault.nominal))
    return replace(samples, stamp=samples.stamp - late * np.isin(samples.kind, [Kind.CONTROLS, Kind.INPUTS]))


def _in_one(job: tuple[Setting, Reconstruction, list[Array], Array, Mapping[str, float], bool, int]) -> InReplica:
    """The setting in one replica; errors are over the spreads of the flight, of which it may repeat a part."""
    fault, flight, stretches, parameters, spreads, calm, seed = job
    world = world_of(flight, stretches, parameters, seed)
    samples, errors = world.samples(seed), dict[str, float]()
    try:
        if CONTROLS in fault.variant.setting:
            again = reconstruct_as_flown(world.aircraft, samples, with_covariance=False)[0]
            fits, _ = fits_of(settled_flight(again), MOMENTS)
            errors = {axis: fit.held_out_rms / spreads[axis] for axis, fit in fits.items() if axis in spreads}
        else:
            again = _unfiltered(flight, as_flown(world.aircraft, samples)[0], samples)
    except InputError:
        return InReplica(np.nan, errors)
    alone = replace(fault.effect, variants=(fault.variant,))
    gain = max((try_setting(each).gain for each in jobs_of(again, [alone], calm)), default=np.nan)
    return InReplica(gain if np.isfinite(gain) else np.nan, errors)


def _unfiltered(flight: Reconstruction, aircraft: Aircraft, samples: Samples) -> Reconstruction:
    """A replica whose states nobody asks for: a likelihood makes its own. Its times are those of the flight."""
    times = flight.points[[0, -1]].copy()
    times[:, CoefficientSample.TIME] -= times[0, CoefficientSample.TIME]
    return replace(flight, aircraft=aircraft, samples=samples, epoch=int(samples.stamp.min()), points=times)
