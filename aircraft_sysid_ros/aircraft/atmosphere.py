"""International standard atmosphere up to 20 km (ISO 2533); altitudes are geopotential."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba.extending import register_jitable

from aircraft_sysid_ros.kernels import njit

Array = npt.NDArray[np.float64]

GAS_CONSTANT = 287.05287  # [J/(kg K)] dry air
HEAT_RATIO = 1.4
SEA_LEVEL_PRESSURE = 101325.0  # [Pa]
SEA_LEVEL_TEMPERATURE = 288.15  # [K]
LAPSE_RATE = 0.0065  # [K/m] up to the tropopause
TROPOPAUSE = 11000.0  # [m]
STANDARD_GRAVITY = 9.80665  # [m/s^2]
_LAPSE = GAS_CONSTANT * LAPSE_RATE / STANDARD_GRAVITY  # temperature ratio = pressure ratio ** _LAPSE
_COLDEST = SEA_LEVEL_TEMPERATURE - LAPSE_RATE * TROPOPAUSE  # [K] from the tropopause on
_PRESSURE_AT_TROPOPAUSE = SEA_LEVEL_PRESSURE * (_COLDEST / SEA_LEVEL_TEMPERATURE) ** (1.0 / _LAPSE)  # [Pa]


@njit(cache=True)
def temperature(altitude: float) -> float:
    """Standard temperature [K] at altitude [m]."""
    return SEA_LEVEL_TEMPERATURE - LAPSE_RATE * min(altitude, TROPOPAUSE)


@register_jitable
def pressure_at(altitude: Any) -> Any:
    """Standard static pressure [Pa] at altitude [m], scalar or array."""
    below, above = np.minimum(altitude, TROPOPAUSE), np.maximum(altitude, TROPOPAUSE) - TROPOPAUSE
    exponent = STANDARD_GRAVITY / (GAS_CONSTANT * LAPSE_RATE)
    p = SEA_LEVEL_PRESSURE * (1.0 - LAPSE_RATE * below / SEA_LEVEL_TEMPERATURE) ** exponent
    return p * np.exp(-STANDARD_GRAVITY * above / (GAS_CONSTANT * _COLDEST))


@njit(cache=True)
def pressure(altitude: float) -> float:
    """Standard static pressure [Pa] at altitude [m]."""
    return pressure_at(altitude)


@njit(cache=True)
def pressures(altitudes: Array) -> Array:
    """``pressure`` at each altitude (n,) [m]."""
    out = np.empty(len(altitudes))
    for i in range(len(altitudes)):
        out[i] = pressure(altitudes[i])
    return out


@register_jitable
def temperature_at(static_pressure: Any) -> Any:
    """Standard temperature [K] where the static pressure [Pa] is that, scalar or array."""
    return np.maximum(SEA_LEVEL_TEMPERATURE * (static_pressure / SEA_LEVEL_PRESSURE) ** _LAPSE, _COLDEST)


@register_jitable
def density_of(static_pressure: Any, temperature: Any) -> Any:
    """Density [kg/m^3] of dry air of that static pressure [Pa] and temperature [K], scalar or array."""
    return static_pressure / (GAS_CONSTANT * temperature)


@register_jitable
def density_at(static_pressure: Any) -> Any:
    """Standard density [kg/m^3] where the static pressure [Pa] is that, scalar or array."""
    return density_of(static_pressure, temperature_at(static_pressure))


@register_jitable
def altitude_at(static_pressure: Any) -> Any:
    """Altitude [m] where the static pressure [Pa] is that, scalar or array; less than 1 Pa counts as 1 Pa."""
    below = np.maximum(static_pressure, _PRESSURE_AT_TROPOPAUSE)
    above = GAS_CONSTANT * _COLDEST / STANDARD_GRAVITY * np.log(below / np.maximum(static_pressure, 1.0))
    return SEA_LEVEL_TEMPERATURE / LAPSE_RATE * (1.0 - (below / SEA_LEVEL_PRESSURE) ** _LAPSE) + above


@njit(cache=True)
def air_density(altitude: float) -> float:
    """Standard density [kg/m^3] at altitude [m]."""
    return density_of(pressure(altitude), temperature(altitude))


@njit(cache=True)
def speed_of_sound(altitude: float) -> float:
    """Standard speed of sound [m/s] at altitude [m]."""
    return np.sqrt(HEAT_RATIO * GAS_CONSTANT * temperature(altitude))
