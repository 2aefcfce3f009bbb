"""In which conditions parameters were learnt, and which signals the flight has had."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AerodynamicModel
from aircraft_sysid_ros.aircraft.expression import SIGNAL_INDEX, SIGNALS, signals_read
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample

Array = npt.NDArray[np.float64]

_RANGED = [CoefficientSample.SIGNALS.start + SIGNAL_INDEX[name] for name in ("V", "alpha", "beta")]


#: Signals that stand in the samples of the controls.
CONTROL_SIGNALS = frozenset({"de", "da", "dr", "flaps", "Tc", "throttle", "propeller_speed"})


class LearntConditions:
    """Ranges of airspeed, angle of attack and sideslip that were learnt in; signals that were measured."""

    def __init__(self) -> None:
        self.ranges = np.full((len(_RANGED), 2), np.nan)  # lowest and highest
        self._seen = np.zeros(len(SIGNALS), np.bool_)

    def add(self, samples: Array) -> None:
        """New samples (m, …) of ``CoefficientSample``."""
        self._seen |= np.isfinite(samples[:, CoefficientSample.SIGNALS]).any(axis=0)
        learnt = samples[(samples[:, CoefficientSample.LEARNT] > 0.0).any(axis=1)]
        if len(learnt):
            columns = learnt[:, _RANGED]
            self.ranges[:, 0] = np.fmin(self.ranges[:, 0], columns.min(axis=0))
            self.ranges[:, 1] = np.fmax(self.ranges[:, 1], columns.max(axis=0))

    def signals_of(self, model: AerodynamicModel, axis: int) -> tuple[list[str], list[str]]:
        """Signals that an axis needs, and those of them that no sample of the flight had."""
        used = sorted(set().union(*(signals_read(program) for program in model.programs[axis])))
        return [SIGNALS[k] for k in used], [SIGNALS[k] for k in used if not self._seen[k]]
