"""Pressures of a five-hole probe of known calibration: (36) of the two-stage paper (docs/references.md) backwards."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ProbeCalibration:
    """(36): V = (1 + scale) sqrt(2 q_c / rho) + offset; alpha = (1 + scale) D_a / (K_a q_c) + offset; beta.

    D_a and D_b are the differences of opposite holes, q_c total minus static pressure.
    """

    alpha_sensitivity: float = 3.9  # [1/rad] K_a
    beta_sensitivity: float = 3.9  # [1/rad] K_b
    airspeed_scale: float = 0.0
    airspeed_offset: float = 0.0  # [m/s]
    alpha_scale: float = 0.0
    alpha_offset: float = 0.0  # [rad]
    beta_scale: float = 0.0
    beta_offset: float = 0.0  # [rad]
    mount_roll: float = 0.0  # [rad] eps_phi: v_body = C(eps_phi) v_probe, (37), (38)
    alpha_cubic: float = 0.0  # [1/rad^2] not in (36): D / (K q_c) is r where r + cubic r^3 is what (36) has there
    beta_cubic: float = 0.0

    def pressures(self, airspeed: Array, alpha: Array, beta: Array, density: Array) -> Array:
        """Dynamic, alpha and beta pressure [Pa] (n, 3) at true airspeed [m/s] and angles [rad] in body axes, (n,)."""
        if self.mount_roll != 0.0:
            alpha, beta = self._in_probe_axes(alpha, beta)
        indicated = (airspeed - self.airspeed_offset) / (1.0 + self.airspeed_scale)
        impact = 0.5 * density * indicated**2
        alpha_ratio = bent((alpha - self.alpha_offset) / (1.0 + self.alpha_scale), self.alpha_cubic)
        beta_ratio = bent((beta - self.beta_offset) / (1.0 + self.beta_scale), self.beta_cubic)
        alpha_pressure = alpha_ratio * self.alpha_sensitivity * impact
        beta_pressure = beta_ratio * self.beta_sensitivity * impact
        return np.stack([impact, alpha_pressure, beta_pressure], axis=1)

    def _in_probe_axes(self, alpha: Array, beta: Array) -> tuple[Array, Array]:
        """Angles of the flow in axes of the probe, from those in body axes."""
        u, v, w = np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)
        c, s = np.cos(self.mount_roll), np.sin(self.mount_roll)
        across, down = c * v - s * w, s * v + c * w
        return np.arctan2(down, u), np.arcsin(across)


def bent(straight: Array, cubic: float) -> Array:
    """r with r + cubic r^3 = straight, for cubic >= 0: Cardano's root in hyperbolic form."""
    if cubic == 0.0:
        return straight
    size = 2.0 / np.sqrt(3.0 * cubic)
    return np.asarray(size * np.sinh(np.arcsinh(3.0 * straight / size) / 3.0))
