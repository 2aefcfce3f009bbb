"""Laws of airspeed, pressure, density and temperature."""

from __future__ import annotations

import numpy as np

from aircraft_sysid_ros.aircraft.atmosphere import GAS_CONSTANT, density_at, temperature, temperature_at
from aircraft_sysid_ros.recordings.tabular.guess.flight_columns import (
    SLOW_SECONDS,
    Flight,
    G,
    climb_of,
)
from aircraft_sysid_ros.recordings.tabular.guess.laws_of_one import CANDIDATES
from aircraft_sysid_ros.recordings.tabular.guess.series import Fit, fit
from aircraft_sysid_ros.recordings.tabular.units import conversion


def wind_triangle(f: Flight, signal: str) -> tuple[float, float] | None:
    """Slope [m/s per unit] of an airspeed whose vector and a steady wind give the velocity over ground; correlation."""
    if not f.known("velocity.north", "velocity.east", "attitude.yaw"):
        return None
    raw, yaw = f.raw(signal), f.si("attitude.yaw")
    if f.known("sideslip"):
        yaw = yaw + f.si("sideslip")
    climb = climb_of(f)
    level = np.ones(len(raw))
    if climb is not None:
        speed = np.hypot(f.si("velocity.north"), f.si("velocity.east"))
        with np.errstate(all="ignore"):
            level = np.cos(np.arctan(climb[1] / speed))
    flying = f.flying()
    north = np.where(flying, f.smooth(f.si("velocity.north"), SLOW_SECONDS), np.nan)
    east = np.where(flying, f.smooth(f.si("velocity.east"), SLOW_SECONDS), np.nan)
    along = [f.smooth(raw * level * trigonometric(yaw), SLOW_SECONDS) for trigonometric in (np.cos, np.sin)]
    ones, zeros = np.ones(len(raw)), np.zeros(len(raw))
    matrix = np.stack([np.concatenate(along), np.concatenate([ones, zeros]), np.concatenate([zeros, ones])], axis=1)
    target = np.concatenate([north, east])
    known = np.isfinite(target) & np.isfinite(matrix).all(axis=1)
    if known.sum() < 100 or np.std(np.cos(yaw[np.isfinite(yaw)])) + np.std(np.sin(yaw[np.isfinite(yaw)])) < 0.5:
        return None
    solution, *_ = np.linalg.lstsq(matrix[known], target[known], rcond=None)
    residual = target[known] - matrix[known] @ solution
    return float(solution[0]), float(np.sqrt(max(0.0, 1.0 - np.var(residual) / np.var(target[known]))))


def acceleration_along(f: Flight, signal: str) -> Fit | None:
    """dV/dt = f_x cos(alpha) + f_z sin(alpha) - g sin(theta - alpha) against the rate of an airspeed."""
    if not f.known("specific_force.x", "specific_force.z", "attitude.pitch"):
        return None
    alpha = f.si("angle_of_attack") if f.known("angle_of_attack") else np.zeros(len(f.grid.time))
    theta = f.si("attitude.pitch")
    reference = (
        f.si("specific_force.x") * np.cos(alpha) + f.si("specific_force.z") * np.sin(alpha) - G * np.sin(theta - alpha)
    )
    return fit(f.smooth(reference, 0.5), f.raw_rate(signal, 0.5), f.block())


def speed_of_pressure(f: Flight, signal: str) -> Fit | None:
    """sqrt(2 q / rho) against an airspeed's own numbers."""
    if not f.known("dynamic_pressure"):
        return None
    density = f.si("air_density") if f.known("air_density") else standard_density(f)
    if density is None:
        return None
    reference = np.sqrt(2.0 * np.maximum(f.si("dynamic_pressure"), 0.0) / density)
    return f.fit(f.smooth(reference, 0.5), f.smooth(f.raw(signal), 0.5))


def speed_and_pressure(f: Flight, speed: str) -> tuple[str, str] | None:
    """Units of an airspeed and of a dynamic pressure, neither of which is known, from q = rho V^2 / 2."""
    density = float(np.nanmedian(f.si("air_density"))) if f.known("air_density") else standard_density(f)
    if density is None or not f.has("dynamic_pressure"):
        return None
    flying = np.nan_to_num(f.raw(speed)) > 0.35 * np.nanpercentile(f.raw(speed), 90)
    with np.errstate(all="ignore"):
        ratio = float(np.nanmedian((f.raw("dynamic_pressure") / f.raw(speed) ** 2)[flying]))
    if not ratio > 0.0:
        return None
    rough, fast = f.columns[speed].rough, float(np.nanpercentile(f.raw(speed), 90))
    found = []
    for unit in CANDIDATES["m/s"][:4]:
        factor = conversion(unit, "m/s").factor
        if not 5.0 < fast * factor < 340.0 or (np.isfinite(rough) and abs(np.log(factor / rough)) > 1.0):
            continue
        for of_pressure in CANDIDATES["Pa"]:
            expected = 0.5 * density * factor**2 / conversion(of_pressure, "Pa").factor
            if abs(np.log(ratio / expected)) < 0.12:
                found.append((abs(float(np.log(ratio / expected))), unit, of_pressure))
    return (found[0][1], found[0][2]) if len(found) == 1 and found[0][0] < 0.06 else None


def turn_speed(f: Flight, signal: str) -> float | None:
    """Slope [m/s per unit] of an airspeed from V = g tan(phi) / (dpsi/dt) in turns."""
    if not f.known("attitude.roll", "attitude.yaw"):
        return None
    rate = f.rate("attitude.yaw", 2.0)
    roll = f.smooth(f.si("attitude.roll"), 2.0)
    turning = (np.abs(rate) > 0.08) & (np.abs(roll) > 0.15) & (np.abs(roll) < 1.1) & np.isfinite(f.raw(signal))
    turning &= np.nan_to_num(np.abs(f.grid.rate(f.si("attitude.roll"), 2.0)), nan=9.0) < 0.1
    if turning.sum() < 100:
        return None
    return float(np.median(G * np.tan(roll[turning]) / rate[turning] / f.raw(signal)[turning]))


def temperature_of_density(f: Flight) -> float | None:
    """Temperature [K] of the gas law."""
    if not f.known("static_pressure", "air_density"):
        return None
    return float(np.nanmedian(f.si("static_pressure")) / (GAS_CONSTANT * np.nanmedian(f.si("air_density"))))


def standard_temperature(f: Flight) -> float | None:
    """Standard temperature [K] at the height of the flight."""
    if f.known("static_pressure"):
        return float(temperature_at(np.nanmedian(f.si("static_pressure"))))
    for signal in ("pressure_altitude", "altitude"):
        if f.known(signal):
            return float(temperature(float(np.nanmedian(f.si(signal)))))
    return None


def standard_density(f: Flight) -> float | None:
    """Density [kg/m^3] of the pressure, if it is known."""
    if f.known("static_pressure"):
        pressure = float(np.nanmedian(f.si("static_pressure")))
        return float(density_at(pressure))
    return None
