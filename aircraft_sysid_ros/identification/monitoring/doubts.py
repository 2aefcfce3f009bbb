"""Parameters in doubt though their axis is not held: it goes on learning, and they have HOLD.

A model that explains less than three quarters of the variance of a coefficient, or whose error is BEYOND_NOISE times
what noise makes of it (``coefficient_noise``), in all of the motion or in a tenth of it, lacks something, for which its
parameters then stand. A parameter of
which the newest motion says something else than what was before it (``agreement``) is not to be used either.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import least_squares
from aircraft_sysid_ros.identification.history import ParameterCheckpoint
from aircraft_sysid_ros.identification.monitoring.agreement import SplitHalfAgreement
from aircraft_sysid_ros.identification.monitoring.hold import Hold, held
from aircraft_sysid_ros.identification.monitoring.residuals import ResidualMonitor
from aircraft_sysid_ros.identification.parameter_set import ParameterEstimate
from aircraft_sysid_ros.identification.trust import lack_of_fit


class Doubts:
    """What is in doubt just now, in words."""

    def __init__(self, model: AerodynamicModel, monitor: ResidualMonitor, forgetting: float) -> None:
        """``forgetting`` per evaluation."""
        self._model, self._monitor = model, monitor
        self.agreement = SplitHalfAgreement(model, forgetting)
        self.restart()

    def restart(self) -> None:
        """The clock began anew."""
        self._disagreeing: dict[int, str] = {}  # parameters
        self._misfits: dict[int, str] = {}  # axes

    def look(self, kept: ParameterCheckpoint, holds: Sequence[Hold | None], joint: bool) -> None:
        """What is in doubt of what is known now; ``joint`` estimates are not compared with those before."""
        self.restart()
        for axis, (name, fit) in enumerate(zip(AXES, self._monitor.fits().tolist(), strict=True)):
            hold = holds[axis]
            unexplained, over_noise, worst = fit
            # of what it learnt lately another estimator says too little: a tenth of the motion may be that
            if words := lack_of_fit(name, unexplained, over_noise, np.nan if joint else worst):
                self._misfits[axis] = words
                if hold is not None and hold.contradicts:
                    hold.lacks = words
            if joint or hold is not None or not self.agreement.are_apart(axis):
                continue
            part = self._model.axis_slice(name)
            std = np.sqrt(np.diag(least_squares(self._model, axis, kept.least_squares)[0].covariance))
            found = self.agreement.disagreeing(axis, std, kept.least_squares.noise_square[part])
            for j, (now, before) in found.items():
                words = f"the newest motion says {now:.3g}, what was before it {before:.3g}"
                self._disagreeing[part.start + j] = words

    def gated(self, parameters: Sequence[ParameterEstimate]) -> list[ParameterEstimate]:
        """All parameters, with HOLD where one is in doubt."""
        out = list(parameters)
        for i, words in self._disagreeing.items():
            out[i] = held(out[i], words)
        for axis, words in self._misfits.items():
            part = self._model.axis_slice(AXES[axis])
            out[part] = [held(p, words) for p in out[part]]
        return out
