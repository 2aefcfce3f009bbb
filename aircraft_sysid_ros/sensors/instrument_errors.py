"""Systematic errors of the instruments of a simulated flight: what calibrations look for (docs/references.md)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.frames import euler_from_quaternion, quaternion_from_euler

Array = npt.NDArray[np.float64]

AIR_DATA = ("V", "alpha", "beta")
ANGLES = ("phi", "theta", "psi")


@dataclass(frozen=True)
class OutputErrors:
    """(B6) of the two-stage paper: shown = (1 + scale) true + offset, of V, alpha, beta, phi, theta, psi."""

    scale: dict[str, float] = field(default_factory=dict)
    offset: dict[str, float] = field(default_factory=dict)  # [m/s], [rad]

    def shown(self, name: str, true: Array) -> Array:
        """An output with its errors."""
        return (1.0 + self.scale.get(name, 0.0)) * true + self.offset.get(name, 0.0)

    def attitude(self, quaternions: Array) -> Array:
        """Attitudes (n, 4) with the errors of their Euler angles."""
        if not (set(ANGLES) & (self.scale.keys() | self.offset.keys())):
            return quaternions
        angles = np.array([euler_from_quaternion(q) for q in quaternions])
        wrong = [self.shown(name, column) for name, column in zip(ANGLES, angles.T, strict=True)]
        return np.array([quaternion_from_euler(*row) for row in np.stack(wrong, axis=1)])


@dataclass(frozen=True)
class MagneticErrors:
    """(B1): shown = matrix h + hard iron, body axes [T]."""

    matrix: Array = field(default_factory=lambda: np.eye(3))
    hard_iron: Array = field(default_factory=lambda: np.zeros(3))

    def shown(self, true: Array) -> Array:
        """The field (n, 3) with its errors."""
        return true @ self.matrix.T + self.hard_iron
