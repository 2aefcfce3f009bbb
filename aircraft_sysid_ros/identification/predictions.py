"""What was known when: a sample is predicted with what an estimator knew before its window began."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.identification.coefficients.layout import PREDICTED, CoefficientSample
from aircraft_sysid_ros.identification.estimators.contract import Estimator, KnownParameters

Array = npt.NDArray[np.float64]


class KnownHistory:
    """All parameters of an estimator as they were known at times [s]."""

    def __init__(self, half_width: float) -> None:
        """``half_width`` [s] of the windows of samples."""
        self._half_width = half_width
        self._known: list[tuple[float, Array]] = []

    def begin(self, theta: Array) -> None:
        """From now on these parameters hold, whatever was known before."""
        self._known = [(-np.inf, theta)]

    def restart_clock(self) -> None:
        """The clock started over: what is known newest holds from its beginning."""
        self._known = [(-np.inf, theta) for _, theta in self._known[-1:]]

    def add(self, known: KnownParameters) -> None:
        """What became known, in order of time."""
        self._known.extend(zip(known.time.tolist(), known.theta, strict=True))

    def predict(self, samples: Array, model: AerodynamicModel, estimator: Estimator) -> None:
        """Predict samples (m, …) in place; of an axis that waits, the prediction of least squares stays."""
        for sample in samples:
            begin = sample[CoefficientSample.TIME] - self._half_width
            while len(self._known) > 1 and self._known[1][0] <= begin:
                self._known.pop(0)
            known = bool(self._known) and self._known[0][0] <= begin
            each = sample[CoefficientSample.TERMS :] * (self._known[0][1] if known else 0.0)
            for axis, name in enumerate(AXES):
                if not estimator.needs_reseed(axis):
                    sample[PREDICTED + axis] = each[model.axis_slice(name)].sum()
