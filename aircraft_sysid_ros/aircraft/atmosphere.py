"""International standard atmosphere up to 20 km (ISO 2533); altitudes are geopotential."""

from __future__ import annotations

import numpy as np
from numba import njit

GAS_CONSTANT = 287.05287  # [J/(kg K)] dry air
HEAT_RATIO = 1.4
SEA_LEVEL_PRESSURE = 101325.0  # [Pa]
SEA_LEVEL_TEMPERATURE = 288.15  # [K]
LAPSE_RATE = 0.0065  # [K/m] up to the tropopause
TROPOPAUSE = 11000.0  # [m]
STANDARD_GRAVITY = 9.80665  # [m/s^2]


@njit(cache=True)
def temperature(altitude: float) -> float:
    """Standard temperature [K] at altitude [m]."""
    return SEA_LEVEL_TEMPERATURE - LAPSE_RATE * min(altitude, TROPOPAUSE)


@njit(cache=True)
def pressure(altitude: float) -> float:
    """Standard static pressure [Pa] at altitude [m]."""
    below = min(altitude, TROPOPAUSE)
    exponent = STANDARD_GRAVITY / (GAS_CONSTANT * LAPSE_RATE)
    p = SEA_LEVEL_PRESSURE * (1.0 - LAPSE_RATE * below / SEA_LEVEL_TEMPERATURE) ** exponent
    if altitude > TROPOPAUSE:
        p *= np.exp(-STANDARD_GRAVITY * (altitude - TROPOPAUSE) / (GAS_CONSTANT * temperature(altitude)))
    return p


@njit(cache=True)
def air_density(altitude: float) -> float:
    """Standard density [kg/m^3] at altitude [m]."""
    return pressure(altitude) / (GAS_CONSTANT * temperature(altitude))


@njit(cache=True)
def speed_of_sound(altitude: float) -> float:
    """Standard speed of sound [m/s] at altitude [m]."""
    return np.sqrt(HEAT_RATIO * GAS_CONSTANT * temperature(altitude))
