"""Indicated, calibrated, equivalent and true airspeed told apart.

Indicated airspeed (IAS) is what instrument and place of the probe show; calibrated airspeed (CAS) is free of their
errors; equivalent airspeed (EAS) is CAS without compressibility, rho_0 V_E^2 = rho V^2; true airspeed (TAS) is what the
estimators use. Source: ISO 2533 atmosphere and the relations of a pitot tube, isentropic below the speed of sound and
behind a normal shock above it, W. Gracey, Measurement of Aircraft Speed and Altitude, NASA RP-1046, ch. II.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.atmosphere import (
    GAS_CONSTANT,
    HEAT_RATIO,
    SEA_LEVEL_PRESSURE,
    SEA_LEVEL_TEMPERATURE,
    pressure_at,
)

Array = npt.NDArray[np.float64]

MEANINGS = ("indicated", "calibrated", "equivalent", "true")
SEA_LEVEL_DENSITY = SEA_LEVEL_PRESSURE / (GAS_CONSTANT * SEA_LEVEL_TEMPERATURE)
_SPEED_OF_SOUND_0 = np.sqrt(HEAT_RATIO * GAS_CONSTANT * SEA_LEVEL_TEMPERATURE)
_KAPPA = (HEAT_RATIO - 1.0) / HEAT_RATIO
#: Rayleigh's formula of a pitot tube behind its shock, P_t / P_s = _SHOCK M² (1 - _BEHIND / M²)^-_POWER, and how often
#: it is solved for M², each time with half of the error at most.
_BEHIND, _POWER = (HEAT_RATIO - 1.0) / (2.0 * HEAT_RATIO), 1.0 / (HEAT_RATIO - 1.0)
_SHOCK = (0.5 * (HEAT_RATIO + 1.0)) ** (1.0 / _KAPPA) * ((HEAT_RATIO + 1.0) / (2.0 * HEAT_RATIO)) ** _POWER
_PASSES = 40


def standard_pressure(altitude: Array) -> Array:
    """Pressure [Pa] (n,) of the standard atmosphere at altitudes [m] (n,)."""
    return np.asarray(pressure_at(altitude))


def true_airspeed(speed: Array, meaning: str, pressure: Array, temperature: Array) -> Array:
    """True airspeed [m/s] of a speed [m/s] with a meaning of MEANINGS, in air of a pressure [Pa] and temperature [K].

    An indicated airspeed is taken as calibrated: its errors are the probe's, which the caller has corrected.
    """
    if meaning == "true":
        return speed
    if meaning == "equivalent":
        return np.asarray(speed * np.sqrt(SEA_LEVEL_DENSITY * GAS_CONSTANT * temperature / pressure))
    mach2 = (speed / _SPEED_OF_SOUND_0) ** 2
    ratio = (1.0 + 0.5 * (HEAT_RATIO - 1.0) * mach2) ** (1.0 / _KAPPA)
    ratio = np.where(mach2 > 1.0, _SHOCK * mach2 * (1.0 - _BEHIND / np.maximum(mach2, 1.0)) ** -_POWER, ratio)
    return true_of_impact_pressure(SEA_LEVEL_PRESSURE * (ratio - 1.0), pressure, temperature)


def true_of_impact_pressure(impact: Array, pressure: Array, temperature: Array) -> Array:
    """True airspeed [m/s] of impact pressure P_t - P_s [Pa]; a negative one is noise at rest and gives 0."""
    ratio = np.maximum(impact, 0.0) / pressure + 1.0
    mach2 = 2.0 / (HEAT_RATIO - 1.0) * (ratio**_KAPPA - 1.0)
    shock = np.maximum(mach2, 1.0)
    for _ in range(_PASSES if np.any(mach2 > 1.0) else 0):
        shock = np.maximum(ratio / _SHOCK * (1.0 - _BEHIND / shock) ** _POWER, 1.0)
    mach2 = np.where(mach2 > 1.0, shock, mach2)
    return np.asarray(np.sqrt(mach2 * HEAT_RATIO * GAS_CONSTANT * temperature))
