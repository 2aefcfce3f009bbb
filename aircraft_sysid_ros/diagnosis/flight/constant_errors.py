"""Constant errors of airspeed and vanes, as a filter finds them that has them as states.

It is another judge than the likelihood of a scale or an offset (``measurement.faults``): it has all of them at once,
and they compete with the wind and with each other. Where a vane shows another scale both find it, within a fifth; what
turns and gusts feign, one of them does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.reconstruction.air_data_errors import UNKNOWN_STD_OF
from aircraft_sysid_ros.reconstruction.options import StateOptions
from aircraft_sysid_ros.reconstruction.state_estimator import StateEstimator
from aircraft_sysid_ros.samples import Kind, Samples

#: How the filter calls what a kind of sample shows.
NAMES = {Kind.AIRSPEED: "V", Kind.ANGLE_OF_ATTACK: "alpha", Kind.SIDESLIP: "beta"}


class Offset(NamedTuple):
    """Constant error of a vane [rad], its standard deviation, and what of that is the doubt in the attitude."""

    value: float
    std: float
    of_attitude: float = 0.0


def air_data_errors(aircraft: Aircraft, samples: Samples) -> dict[str, dict[str, float]]:
    """Value and standard deviation by the names of the filter; nothing of a flight in pieces or without airspeed."""
    if np.any(samples.kind == Kind.SEAM) or not np.any(samples.kind == Kind.AIRSPEED):
        return {}
    estimator = StateEstimator(aircraft, StateOptions(air_data_errors=True))
    estimator.push(samples)
    estimator.flush()
    return estimator.air_data_errors


def is_told(known: Mapping[str, Mapping[str, float]], name: str, share: float) -> bool:
    """Whether a flight has left less than a share of the standard deviation that an error had before it."""
    return known[name]["std"] < share * UNKNOWN_STD_OF[name]


def offset_of(known: Mapping[str, Mapping[str, float]], samples: Samples, kind: Kind) -> Offset:
    """Constant error of a vane, of ``air_data_errors``.

    At the median angle: what gusts feign as a scale they take off the constant.
    """
    shown = samples.values[samples.kind == kind, 0]
    usual = float(np.nanmedian(shown)) if np.isfinite(shown).any() else 0.0
    constant = known[f"b_{NAMES[kind]}"]
    value = constant["value"] + known[f"lambda_{NAMES[kind]}"]["value"] * usual
    return Offset(value, constant["std"], constant.get("of_attitude", 0.0))


def scale_of(known: Mapping[str, Mapping[str, float]], samples: Samples, kind: Kind) -> float:
    """What a sensor shows over what is true, of ``air_data_errors``: an airspeed at its median, with its constant."""
    gain, constant = 1.0 + known[f"lambda_{NAMES[kind]}"]["value"], known[f"b_{NAMES[kind]}"]["value"]
    if kind == Kind.AIRSPEED:
        gain += constant / float(np.nanmedian(samples.values[samples.kind == kind, 0]))
    return 1.0 / gain
