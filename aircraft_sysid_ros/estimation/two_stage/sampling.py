"""Prior samples of xi2 within its bounds: step 2 of section II.C of the two-stage paper (docs/references.md)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError

Array = npt.NDArray[np.float64]
Kind = Literal["sobol", "uniform", "grid", "normal"]


@dataclass(frozen=True)
class Prior:
    """Distribution of the samples.

    ``sobol``, ``uniform`` and ``grid`` fill the bounds; ``normal`` has ``mean`` and ``std`` (n2,), independent and cut
    off at the bounds (the paper takes 500 normal samples for the five-hole probe). Sobol samples of this seed are
    scrambled: even as a grid, but no two share a coordinate.
    """

    kind: Kind = "sobol"
    mean: Array | None = None
    std: Array | None = None

    def samples(self, bounds: Array, count: int, seed: int) -> Array:
        """Samples (S, n2), the same for the same seed; S = count, for a grid the largest p^n2 that is not more.

        Raises InputError where bounds are infinite, mean or std do not fit, or the kind is unknown.
        """
        if count < 1:
            raise InputError(f"{count} samples were asked for: at least one is needed")
        if self.kind == "normal":
            return self._normal(bounds, count, seed)
        if not np.all(np.isfinite(bounds)):
            raise InputError(f"{self.kind} samples need finite bounds: give them, or use normal samples")
        if self.kind == "grid":
            return _grid(bounds, count)
        if self.kind == "uniform":
            return np.random.default_rng(seed).uniform(bounds[:, 0], bounds[:, 1], size=(count, len(bounds)))
        if self.kind == "sobol":
            return _sobol(bounds, count, seed)
        raise InputError(f"there are no {self.kind} samples: sobol, uniform, grid and normal are known")

    def _normal(self, bounds: Array, count: int, seed: int) -> Array:
        from scipy.stats import truncnorm  # here: 0.5 s that replay does not need

        n = len(bounds)
        mean = np.zeros(n) if self.mean is None else np.asarray(self.mean, dtype=np.float64)
        std = None if self.std is None else np.asarray(self.std, dtype=np.float64)
        if std is None or std.shape != (n,) or mean.shape != (n,) or not np.all(std > 0.0):
            raise InputError(f"normal samples need {n} means and {n} positive standard deviations")
        low, high = (bounds[:, 0] - mean) / std, (bounds[:, 1] - mean) / std
        unit = truncnorm.rvs(low, high, size=(count, n), random_state=np.random.default_rng(seed))
        return np.clip(mean + std * unit, bounds[:, 0], bounds[:, 1])


def _sobol(bounds: Array, count: int, seed: int) -> Array:
    from scipy.stats import qmc  # here: 0.5 s that replay does not need

    power = int(np.ceil(np.log2(count)))  # Sobol sequences are balanced at powers of two
    unit = qmc.Sobol(len(bounds), seed=np.random.default_rng(seed)).random_base2(power)[:count]
    return np.asarray(qmc.scale(unit, bounds[:, 0], bounds[:, 1]), dtype=np.float64)


def _grid(bounds: Array, count: int) -> Array:
    n = len(bounds)
    points = int(np.floor(count ** (1.0 / n) + 1e-9))
    if points < 2:
        raise InputError(f"a grid in {n} unknowns has at least {2**n} points: ask for so many, or use sobol samples")
    axes = [np.linspace(low, high, points) for low, high in bounds]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, n)
