"""A problem of the two-stage paper (docs/references.md): (1), (4),

    z_k = A_k(xi2) xi1 + b_k(xi2) + v_k,   v ~ N(0, R),  R diagonal and unknown,

linear in xi1 (n1,) for a fixed xi2 (n2,). States and inputs x_k, u_k are known and live inside the functions.
The scan loses the second argument of A and b in (1); (4) has it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.errors import InputError

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Integers = npt.NDArray[np.int64]

#: Central differences: the cube root of the rounding error, where truncation and rounding balance.
_STEP = 6e-6


@dataclass(frozen=True)
class Problem:
    """Measurements and the model of them; N samples of m outputs.

    ``model`` and ``gradient`` are pure functions of xi2: they are called from several threads at once. ``gradient``
    gives dA/dxi2 and db/dxi2; without it they are central differences. Rows that are not ``usable`` may hold
    anything, in the measurements as in what the functions return; all others must be finite. Bounds may be infinite
    where no prior needs them. Raises InputError when something does not fit.
    """

    measured: Array  # (N, m)
    model: Callable[[Array], tuple[Array, Array]]  # xi2 (n2,) to A (N, m, n1), b (N, m)
    names1: tuple[str, ...]
    names2: tuple[str, ...]
    bounds1: Array  # (n1, 2)
    bounds2: Array  # (n2, 2)
    gradient: Callable[[Array], tuple[Array, Array]] | None = None  # to (N, m, n1, n2), (N, m, n2)
    usable: Mask | None = None  # (N,), None: all

    def __post_init__(self) -> None:
        object.__setattr__(self, "measured", np.asarray(self.measured, dtype=np.float64))
        if self.measured.ndim != 2:
            raise InputError(f"the measurements must be an array (N, m), not of shape {self.measured.shape}")
        if self.usable is not None and np.shape(self.usable) != (len(self.measured),):
            raise InputError(f"usable must have one entry for each of the {len(self.measured)} measurements")
        for key, names in (("bounds1", self.names1), ("bounds2", self.names2)):
            object.__setattr__(self, key, _checked_bounds(getattr(self, key), names))
        bad = np.flatnonzero(~np.all(np.isfinite(self.kept), axis=1))
        if len(bad):
            raise InputError(f"{len(bad)} measurements are not finite (the first is number {bad[0]} of the usable "
                             "ones): mark them as not usable or repair them")  # fmt: skip
        unknowns = self.n1 + self.n2
        if self.kept.size <= unknowns:
            raise InputError(f"{self.kept.size} numbers were measured, which is not enough for {unknowns} unknowns "
                             "and the noise: record longer")  # fmt: skip

    @property
    def n1(self) -> int:
        """Number of linear unknowns."""
        return len(self.names1)

    @property
    def n2(self) -> int:
        """Number of nonlinear unknowns."""
        return len(self.names2)

    @property
    def names(self) -> tuple[str, ...]:
        """All unknowns, xi1 first."""
        return self.names1 + self.names2

    @property
    def bounds(self) -> Array:
        """(n1 + n2, 2)."""
        return np.concatenate([self.bounds1, self.bounds2])

    @cached_property
    def kept(self) -> Array:
        """The usable measurements (K, m)."""
        return self.measured if self.usable is None else self.measured[self.usable]

    @cached_property
    def scale2(self) -> Array:
        """(n2,) half the distance of the bounds, 1 where that is infinite: the unit in which xi2 are compared."""
        half = 0.5 * (self.bounds2[:, 1] - self.bounds2[:, 0])
        return np.where(np.isfinite(half) & (half > 0.0), half, 1.0)

    def evaluate(self, xi2: Array) -> tuple[Array, Array]:
        """A (K, m, n1) and b (K, m) of the usable rows. Raises InputError for other shapes."""
        a, b = self._rows(self.model(xi2))
        if a.shape != (*self.kept.shape, self.n1) or b.shape != self.kept.shape:
            raise InputError(f"the model gives A {a.shape} and b {b.shape}; {(*self.kept.shape, self.n1)} and "
                             f"{self.kept.shape} are needed")  # fmt: skip
        return a, b

    def derivatives(self, xi2: Array) -> tuple[Array, Array]:
        """dA/dxi2 (K, m, n1, n2) and db/dxi2 (K, m, n2) of the usable rows."""
        if self.gradient is not None:
            return self._rows(self.gradient(xi2))
        pairs = [self._difference(xi2, j) for j in range(self.n2)]
        return np.stack([p[0] for p in pairs], axis=-1), np.stack([p[1] for p in pairs], axis=-1)

    def slopes(self, xi1: Array, xi2: Array) -> Array:
        """d(A xi1 + b)/dxi2, (K, m, n2)."""
        if self.gradient is not None:
            da, db = self.derivatives(xi2)
            return np.asarray(np.einsum("kmij,i->kmj", da, xi1) + db)
        columns = []
        for j in range(self.n2):
            da, db = self._difference(xi2, j)
            columns.append(da @ xi1 + db)
        return np.stack(columns, axis=-1)

    def check_gradient(self, xi2: Array) -> None:
        """Raise InputError where ``gradient`` disagrees with central differences at xi2."""
        if self.gradient is None:
            return
        da, db = self.derivatives(xi2)
        shapes = (*self.kept.shape, self.n1, self.n2), (*self.kept.shape, self.n2)
        if (da.shape, db.shape) != shapes:
            raise InputError(f"the gradient gives {da.shape} and {db.shape}; {shapes[0]} and {shapes[1]} are needed")
        for j, name in enumerate(self.names2):
            pairs = zip((da[..., j], db[..., j]), self._difference(xi2, j), self.evaluate(xi2), strict=True)
            for found, expected, value in pairs:
                rounding = 1e-8 * float(np.max(np.abs(value))) / self.scale2[j]
                allowed = 1e-4 * max(float(np.max(np.abs(expected))), float(np.max(np.abs(found)))) + rounding
                if not float(np.max(np.abs(found - expected))) <= allowed:
                    raise InputError(f"the gradient with respect to {name} disagrees with finite differences: correct "
                                     "it or leave it out")  # fmt: skip

    def _difference(self, xi2: Array, j: int) -> tuple[Array, Array]:
        """dA/dxi2_j and db/dxi2_j: central, at a bound to its inner side, of second order too."""
        step = _STEP * max(abs(xi2[j]), self.scale2[j])
        low, high = self.bounds2[j]
        if xi2[j] + step > high:
            step = -step

        def moved(by: float) -> tuple[Array, Array]:
            return self.evaluate(_moved(xi2, j, by))

        if low <= xi2[j] - step <= high:
            (a1, b1), (a0, b0) = moved(step), moved(-step)
            return (a1 - a0) / (2.0 * step), (b1 - b0) / (2.0 * step)
        (a0, b0), (a1, b1), (a2, b2) = self.evaluate(xi2), moved(step), moved(2.0 * step)
        return (-3.0 * a0 + 4.0 * a1 - a2) / (2.0 * step), (-3.0 * b0 + 4.0 * b1 - b2) / (2.0 * step)

    def _rows(self, pair: tuple[Array, Array]) -> tuple[Array, Array]:
        a, b = (np.asarray(part, dtype=np.float64) for part in pair)
        return (a, b) if self.usable is None else (a[self.usable], b[self.usable])


def _moved(xi2: Array, j: int, by: float) -> Array:
    out = np.array(xi2, dtype=np.float64)
    out[j] += by
    return out


def _checked_bounds(bounds: Array, names: tuple[str, ...]) -> Array:
    if not names:
        raise InputError("both sets of unknowns must have at least one: give their names")
    out = np.asarray(bounds, dtype=np.float64)
    if out.shape != (len(names), 2):
        raise InputError(f"bounds of {', '.join(names)} must be of shape ({len(names)}, 2), not {out.shape}")
    for name, (low, high) in zip(names, out, strict=True):
        if not low < high:
            raise InputError(f"the bounds of {name} are [{low:g}, {high:g}]: the lower one must be the smaller")
    return out
