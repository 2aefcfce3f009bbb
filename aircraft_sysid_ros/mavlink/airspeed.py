"""Indicated, calibrated, equivalent and true airspeed told apart.

Indicated airspeed (IAS) is what instrument and place of the probe show; calibrated airspeed (CAS) is free of their
errors; equivalent airspeed (EAS) is CAS without compressibility, rho_0 V_E^2 = rho V^2; true airspeed (TAS) is what the
estimators use. Source: ISO 2533 atmosphere and the isentropic relations of a pitot tube, W. Gracey, Measurement of
Aircraft Speed and Altitude, NASA RP-1046, ch. II.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import (
    GAS_CONSTANT,
    HEAT_RATIO,
    SEA_LEVEL_PRESSURE,
    SEA_LEVEL_TEMPERATURE,
    pressures,
)

Array = npt.NDArray[np.float64]

MEANINGS = ("indicated", "calibrated", "equivalent", "true")
SEA_LEVEL_DENSITY = SEA_LEVEL_PRESSURE / (GAS_CONSTANT * SEA_LEVEL_TEMPERATURE)
_SPEED_OF_SOUND_0 = np.sqrt(HEAT_RATIO * GAS_CONSTANT * SEA_LEVEL_TEMPERATURE)
_KAPPA = (HEAT_RATIO - 1.0) / HEAT_RATIO


def standard_pressure(altitude: Array) -> Array:
    """Pressure [Pa] (n,) of the standard atmosphere at altitudes [m] (n,)."""
    return np.asarray(pressures(np.ascontiguousarray(altitude, dtype=np.float64)))


def true_airspeed(speed: Array, meaning: str, pressure: Array, temperature: Array) -> Array:
    """True airspeed [m/s] of a speed [m/s] with a meaning of MEANINGS, in air of a pressure [Pa] and temperature [K].

    An indicated airspeed is taken as calibrated: its errors are the probe's, which the caller has corrected.
    """
    if meaning == "true":
        return speed
    if meaning == "equivalent":
        return np.asarray(speed * np.sqrt(SEA_LEVEL_DENSITY * GAS_CONSTANT * temperature / pressure))
    impact = SEA_LEVEL_PRESSURE * (
        (1.0 + 0.5 * (HEAT_RATIO - 1.0) * (speed / _SPEED_OF_SOUND_0) ** 2) ** (1.0 / _KAPPA) - 1.0
    )
    return true_of_impact_pressure(impact, pressure, temperature)


def true_of_impact_pressure(impact: Array, pressure: Array, temperature: Array) -> Array:
    """True airspeed [m/s] of impact pressure P_t - P_s [Pa]; a negative one is noise at rest and gives 0."""
    ratio = np.maximum(impact, 0.0) / pressure + 1.0
    mach2 = 2.0 / (HEAT_RATIO - 1.0) * (ratio**_KAPPA - 1.0)
    return np.asarray(np.sqrt(mach2 * HEAT_RATIO * GAS_CONSTANT * temperature))
