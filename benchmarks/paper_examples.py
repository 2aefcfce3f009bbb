"""The two tutorial examples of the two-stage paper: (21), (22), (28) and (33), (34).

The scan loses the first term of b: it is cos(eta + b) in (22), and cos(eta (1 + b) + c) in (34), printed without the
"1 +" in its last line.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.estimation.two_stage.problem import Problem
from aircraft_sysid_ros.estimation.two_stage.sampling import Prior

Array = npt.NDArray[np.float64]

ETA = np.linspace(1.0, 10.0, 100)  # [rad]
SIGMA = 0.3
CLOSE = 0.1  # an estimate is correct within this distance of the truth
ANY = (-np.inf, np.inf)


@dataclass(frozen=True)
class Example:
    """z = (1 + a) cos(phase(xi2)) + offset + v; the amplitude a and the offset are xi1."""

    names1: tuple[str, ...]
    names2: tuple[str, ...]
    truth: Array  # xi1, xi2
    bounds2: Array
    phase: Callable[[Array], tuple[Array, Array]]  # xi2 to phase (100,) and its derivatives (100, n2)
    samples: int
    prior: Prior
    published: dict[str, Any]

    def problem(self, measured: Array) -> Problem:
        """The problem of 100 measurements."""

        def model(xi2: Array) -> tuple[Array, Array]:
            cosine = np.cos(self.phase(xi2)[0])
            return np.stack([cosine, np.ones(len(ETA))], axis=1)[:, None, :], cosine[:, None]

        def gradient(xi2: Array) -> tuple[Array, Array]:
            phase, slope = self.phase(xi2)
            by_xi2 = -np.sin(phase)[:, None] * slope
            return np.stack([by_xi2, np.zeros_like(by_xi2)], axis=1)[:, None], by_xi2[:, None]

        bounds1 = np.array([ANY, ANY])
        return Problem(measured[:, None], model, self.names1, self.names2, bounds1, self.bounds2, gradient)

    def outputs(self, xi: Array) -> Array:
        """Measurements (100,) without noise."""
        return (1.0 + xi[0]) * np.cos(self.phase(xi[2:])[0]) + xi[1]

    def noise(self, seed: int) -> Array:
        """v of one record (100,)."""
        return np.random.default_rng((1, seed)).normal(0.0, SIGMA, len(ETA))

    def start(self, seed: int) -> Array:
        """Random start of the benchmarks: xi1 of N(0, 1), xi2 of N(0, 0.1^2)."""
        unit = np.random.default_rng((2, seed)).normal(size=len(self.truth))
        return unit * np.where(np.arange(len(unit)) < 2, 1.0, 0.1)


EXAMPLE_1 = Example(
    ("a", "c"), ("b",), np.array([1.0, 1.0, 0.1]), np.array([[0.0, 0.2]]),
    lambda xi2: (ETA + xi2[0], np.ones((len(ETA), 1))), 21, Prior("grid"),
    {"correct": {"nonlinear programming": 1.0, "Haupt-Kasdin": 0.972, "two-stage": 1.0}, "noise": 0.1237,
     "estimate": {"a": (0.9512, 0.0507), "b": (0.0812, 0.0182), "c": (0.9415, 0.0360), "R": (0.1199, None)}},
)  # fmt: skip
EXAMPLE_2 = Example(
    ("a", "d"), ("b", "c"), np.array([1.0, 1.0, 0.05, 0.1]), np.array([[0.0, 0.5], [0.0, 1.0]]),
    lambda xi2: (ETA * (1.0 + xi2[0]) + xi2[1], np.stack([ETA, np.ones(len(ETA))], axis=1)), 256, Prior("sobol"),
    {"correct": {"nonlinear programming": 0.978, "Haupt-Kasdin": None, "two-stage": 1.0}, "noise": 0.1016,
     "estimate": {"a": (0.9980, 0.0474), "b": (0.0546, 0.0059), "c": (0.0895, 0.0351), "d": (0.9897, 0.0333),
                  "R": (0.1008, None)}},
)  # fmt: skip
EXAMPLES = {"example_1": EXAMPLE_1, "example_2": EXAMPLE_2}

#: H of (28) for example 1, and the change of variables; xi in the order a, c, b.
HAUPT_KASDIN_ROWS = np.stack([np.cos(ETA), -np.sin(ETA), np.ones(len(ETA)), np.cos(ETA), -np.sin(ETA)], axis=1)


def haupt_kasdin_states(xi: Array) -> Array:
    """y = f(xi) of (28): a cos b, a sin b, c, cos b, sin b."""
    a, c, b = xi
    return np.array([a * np.cos(b), a * np.sin(b), c, np.cos(b), np.sin(b)])
