"""What is flown: steps of bank and pitch, and the small excitation that the estimators learn from."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dynamic_inversion import Reference

from aircraft_sysid_ros.simulation.manoeuvres import multisine

Array = npt.NDArray[np.float64]

#: Steps [rad] of the references, and how long [s] each lasts.
BANKS, PITCHES = np.radians([-30.0, 0.0, 30.0]), np.radians([-6.0, 0.0, 6.0])
SHORTEST, LONGEST = 3.0, 6.0
#: Excitation of elevator, aileron and rudder: peaks [rad], and harmonics of 1 / PERIOD [1/s], no two share one, above
#: what the control loops take out and what the attitude follows.
EXCITATION = np.radians([3.0, 1.5, 1.5])
PERIOD, HARMONICS = 10.0, ((9, 12, 15, 18, 21, 24), (10, 13, 16, 19, 22, 25), (8, 11, 14, 17, 20, 23))


class Task:
    """References of one flight, drawn from its seed."""

    def __init__(self, seed: int, duration: float, airspeed: float) -> None:
        """``airspeed`` [m/s] is held."""
        rng = np.random.default_rng([seed, 3])
        self._airspeed = airspeed
        self._bank, self._pitch = (_steps(rng, duration, sizes) for sizes in (BANKS, PITCHES))

    def reference(self, time: float) -> Reference:
        """What is wanted at a time of flight [s]."""
        bank, pitch = (float(values[np.searchsorted(edges, time)]) for edges, values in (self._bank, self._pitch))
        return Reference(bank, pitch, self._airspeed)


def _steps(rng: np.random.Generator, duration: float, sizes: Array) -> tuple[Array, Array]:
    """Ends [s] of steps, and their values, none twice in a row."""
    edges, values = [2.0], [0.0]
    while edges[-1] < duration:
        edges.append(edges[-1] + float(rng.uniform(SHORTEST, LONGEST)))
        values.append(float(rng.choice(sizes[sizes != values[-1]])))
    return np.array(edges), np.array([*values, 0.0])


class Multisine:
    """Orthogonal multisines on elevator, aileron and rudder, so that no surface moves as another does."""

    def __init__(self, step: float, scale: float = 1.0) -> None:
        """``step`` [s] between samples; ``scale`` of EXCITATION."""
        time = np.arange(round(PERIOD / step)) * step
        waves = [multisine(time, PERIOD, np.array(harmonics)) for harmonics in HARMONICS]
        self._table = scale * EXCITATION * np.stack(waves, axis=1)

    def at(self, number: int) -> Array:
        """Elevator, aileron and rudder (3,) [rad] of sample ``number``."""
        return np.asarray(self._table[number % len(self._table)])
