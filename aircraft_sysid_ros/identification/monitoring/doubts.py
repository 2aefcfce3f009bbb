"""Parameters in doubt though their axis is not held: it goes on learning, and they have HOLD.

A model that explains less than three quarters of the variance of a coefficient, or whose error is ``beyond_noise``
times what noise makes of it (``coefficient_noise``), in all of the motion or in a tenth of it, lacks something, for
which its parameters then stand. So does one that is another at large angles of attack than at small ones
(``range_agreement``). Of that those are spared that hold in either range. C_X has the lift in it that is nearly all of
C_Z: where that is not what was known, or is not one model, nor is C_X, and none of its parameters is spared. Where C_l
is not explained, p is not what the wing rolls through: gusts that differ from tip to tip roll it as p does, and what
answers them, p and aileron, says wrong things in C_Y and C_n, too. Where a parameter is what no aeroplane has, it
stands for something else, and so may the others of its axis. A parameter of which the newest motion says something else
than what was before it (``agreement``) is not to be used either.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel
from aircraft_sysid_ros.identification.estimators.recursive_least_squares import least_squares
from aircraft_sysid_ros.identification.history import ParameterCheckpoint
from aircraft_sysid_ros.identification.monitoring.agreement import SplitHalfAgreement, solved
from aircraft_sysid_ros.identification.monitoring.hold import Hold, held
from aircraft_sysid_ros.identification.monitoring.range_agreement import RangeAgreement
from aircraft_sysid_ros.identification.monitoring.residuals import ResidualMonitor
from aircraft_sysid_ros.identification.parameter_set import ParameterEstimate
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.identification.trust import Trust, is_unphysical, lack_of_fit

#: How the words for C_X begin where it is in doubt for the lift.
OF_LIFT = "contains the lift that CZ has: "
_WHEN_SAVED = "when it was saved: "
#: How those begin for what p and aileron do beside C_l.
_OF_ROLL = "rests on the roll: "
_ROLL, _BESIDE_ROLL, _ROLLED = AXES.index("Cl"), ("CY", "Cn"), ("p", "da")


def when_saved(lacked: Mapping[str, str]) -> dict[str, str]:
    """What was said of axes when a model was saved, as it is said where it is loaded."""
    return {name: _WHEN_SAVED + words.removeprefix(_WHEN_SAVED) for name, words in lacked.items()}


class Doubts:
    """What is in doubt just now, in words."""

    def __init__(self, model: AerodynamicModel, monitor: ResidualMonitor, forgetting: float) -> None:
        """``forgetting`` per evaluation."""
        self._model, self._monitor = model, monitor
        self.agreement, self._ranges = SplitHalfAgreement(model, forgetting), RangeAgreement(model)
        self._remembered: dict[int, str] = {}  # axes that were not explained before
        self.restart()

    def remember(self, lacked: Mapping[str, str]) -> None:
        """What was said before of axes, by their names: so it is until motion has shown whether they are explained."""
        self._remembered = {AXES.index(name): words for name, words in lacked.items()}
        self.restart()
        self._doubt_beside_roll()

    def warm_up(self) -> None:
        """Compile, or load from the cache, what is needed late."""
        self._ranges.warm_up()
        solved(np.eye(4))

    def add(self, asked: npt.NDArray[np.bool_], samples: npt.NDArray[np.float64]) -> None:
        """New samples (m, …) for the axes (6,) that are asked."""
        self.agreement.add(asked, samples)
        self._ranges.add(asked, samples)

    def forget(self, axis: int, goes_back: bool) -> None:
        """Start an axis over; where it ``goes_back`` to what was known, all that was seen of that still counts."""
        self.agreement.forget(axis)
        if not goes_back:
            self._ranges.forget(axis)

    def restart(self) -> None:
        """The clock started over."""
        self._disagreeing: dict[int, str] = {}  # parameters
        self._misfits = dict(self._remembered)  # axes
        self._spared: dict[int, npt.NDArray[np.bool_]] = {}  # parameters (n,) of those of them that are two models

    def look(self, kept: ParameterCheckpoint, holds: Sequence[Hold | None], joint: bool) -> None:
        """What is in doubt of what is known now; ``joint`` estimates are not compared with those before."""
        self.restart()
        ranges = self._not_one_model(kept, holds)
        for axis, (name, fit) in enumerate(zip(AXES, self._monitor.fits().tolist(), strict=True)):
            hold = holds[axis]
            unexplained, over_noise, worst = fit
            # of what it learnt lately another estimator says too little: a tenth of the motion may be that
            part = self._model.axis_slice(name)
            words = lack_of_fit(name, unexplained, over_noise, np.nan if joint else worst)
            if not words and ranges[axis] and not ranges[axis].startswith(OF_LIFT):
                self._spared[axis] = self._ranges.spared(axis, kept.theta[part])
            if self._monitor.blocks(axis) >= THRESHOLDS.judged:
                self._remembered.pop(axis, None)
            if words := words or ranges[axis] or self._remembered.get(axis, ""):
                self._misfits[axis] = words
                if hold is not None and hold.contradicts:
                    hold.lacks = words
            else:
                self._misfits.pop(axis, None)
            if joint or hold is not None or not self.agreement.are_apart(axis):
                continue
            std = np.sqrt(np.diag(least_squares(self._model, axis, kept.least_squares)[0].covariance))
            found = self.agreement.disagreeing(axis, std, kept.least_squares.noise_square[part])
            for j, (now, before) in found.items():
                words = f"the newest motion says {now:.3g}, earlier motion {before:.3g}"
                self._disagreeing[part.start + j] = words
        self._doubt_beside_roll()

    def _doubt_beside_roll(self) -> None:
        """What p and the aileron do in C_Y and C_n, where C_l is not explained."""
        if words := self._misfits.get(_ROLL, ""):
            names = self._model.parameter_names
            for axis in _BESIDE_ROLL:
                for term in _ROLLED:
                    if (name := f"{axis}_{term}") in names:
                        self._disagreeing.setdefault(names.index(name), _OF_ROLL + words)

    def _not_one_model(self, kept: ParameterCheckpoint, holds: Sequence[Hold | None]) -> list[str]:
        """What to say of each axis whose model holds in a part of the angles of attack only; empty: nothing."""
        noise = [kept.least_squares.noise_square[self._model.axis_slice(name)] for name in AXES]
        found = [self._ranges.disagreement(axis, noise[axis]) for axis in range(len(AXES))]
        lift, drag = AXES.index("CZ"), AXES.index("CX")
        hold = holds[lift]
        of_lift = hold.what if hold is not None and hold.high and not hold.sure else found[lift]
        if of_lift:
            found[drag] = f"{OF_LIFT}{of_lift}"
        return found

    def of_other_terms(self, model: AerodynamicModel) -> dict[str, str]:
        """``lack_of_fit`` of the axes that have the same terms in another model, C_X of the lift where C_Z has."""
        same = {name for name in AXES if model.terms[name] == self._model.terms[name]}
        return {
            name: words
            for name, words in self.lack_of_fit.items()
            if name in same and ("CZ" in same or not words.startswith(OF_LIFT))
        }

    @property
    def lack_of_fit(self) -> dict[str, str]:
        """What to say of each axis, by its name, that the model does not explain."""
        return {AXES[axis]: words for axis, words in self._misfits.items()}

    def gated(self, parameters: Sequence[ParameterEstimate]) -> list[ParameterEstimate]:
        """All parameters, with HOLD where one is in doubt."""
        out = list(parameters)
        for i, words in self._disagreeing.items():
            out[i] = held(out[i], words)
        for axis, words in self._misfits.items():
            part = self._model.axis_slice(AXES[axis])
            spared = self._spared.get(axis, np.zeros(len(out[part]), np.bool_))
            out[part] = [p if is_spared else held(p, words) for p, is_spared in zip(out[part], spared, strict=True)]
        for name in AXES:
            part = self._model.axis_slice(name)
            absurd = [p.name for p in out[part] if p.status is Trust.REJECT and is_unphysical(p.name, p.value, p.std)]
            if absurd:
                out[part] = [held(p, f"{absurd[0]} is outside of what aeroplanes have") for p in out[part]]
        return out
