"""The aircraft with the mass properties that its coefficients were learnt with, where a recording has some."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.identification.coefficients.body import body_of, body_with
from aircraft_sysid_ros.samples import Kind, Samples, is_absurd

Array = npt.NDArray[np.float64]


def recorded_mass_properties(samples: Samples) -> Array:
    """Messages (n, 8) of mass [kg], inertia xx, yy, zz and xz [kg m^2] and centre of gravity [m]; NaN: not known."""
    known = np.where(is_absurd(samples), np.nan, samples.values)[samples.kind == Kind.MASS, :8]
    known[~(known[:, 0] > 0.0), 0] = np.nan
    return known


def as_loaded(aircraft: Aircraft, samples: Samples | None) -> Aircraft:
    """The aircraft with mass [kg], inertia (3, 3) [kg m^2], and places (3,) [m, FRD] of IMU and aerodynamic reference
    from the centre of gravity as they were recorded, in the middle of what was; what was not is as in the file.
    """
    if samples is None or not (samples.kind == Kind.MASS).any():
        return aircraft
    known = (column[np.isfinite(column)] for column in recorded_mass_properties(samples).T)
    middle = np.array([np.median(column) if len(column) else np.nan for column in known])
    body = body_with(aircraft, body_of(aircraft), middle)
    return replace(
        aircraft, mass=body.mass, inertia=body.inertia, imu_position=body.imu, aerodynamic_reference=body.reference
    )
