"""Terms that are no numbers where the flight is, although all that they read is known: the root of what is negative.

They count as zero there (``coefficients.evaluation``), so that their axis learns on without them. Their own parameters
are not to be used while that lasts, and for some time after it (``undefined`` of the thresholds).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AerodynamicModel
from aircraft_sysid_ros.aircraft.postfix import evaluate_rows
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.parameter_set import ParameterEstimate, ParameterSet
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust

Array = npt.NDArray[np.float64]


class UndefinedTerms:
    """When each term of a model was no number last."""

    def __init__(self, model: AerodynamicModel) -> None:
        self._model = model
        self.restart()

    def restart(self) -> None:
        """The clock started over."""
        self._last = np.full(len(self._model.parameter_names), -np.inf)  # [s]

    def add(self, samples: Array) -> None:
        """New samples (m, …) of CoefficientSample, in order of time. Only a term of zero may be none."""
        zero = samples[:, CoefficientSample.TERMS :] == 0.0
        if not zero.any():
            return
        signals = np.ascontiguousarray(samples[:, CoefficientSample.SIGNALS])
        values = np.empty(zero.shape)
        evaluate_rows(*self._model.linked, signals, values)
        for row, time in zip(zero & ~np.isfinite(values), samples[:, CoefficientSample.TIME], strict=True):
            self._last[row] = time

    def held(self, found: ParameterSet) -> ParameterSet:
        """The parameters, HOLD with the reason in place of those whose terms are no numbers just now."""
        undefined = found.time - self._last < THRESHOLDS.undefined
        if not undefined.any() or len(undefined) != len(found.parameters):
            return found
        pairs = zip(found.parameters, undefined.tolist(), strict=True)
        return replace(found, parameters=tuple(_held(p) if is_none else p for p, is_none in pairs))


def _held(parameter: ParameterEstimate) -> ParameterEstimate:
    why = "its term is not a number in this flight, and counts as zero: correct or remove it"
    return replace(parameter, status=Trust.HOLD, reason=why)
