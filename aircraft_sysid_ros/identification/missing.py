"""Why an axis of the model is not learnt, or not to be used yet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AerodynamicModel
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.coefficients.pace import (
    LOWEST_RATE,
    SPARSEST_CONTROLS,
    Pace,
    stamped_behind,
    too_late,
    too_slow,
)
from aircraft_sysid_ros.identification.conditions import CONTROL_SIGNALS, LearntConditions, listed, needs
from aircraft_sysid_ros.identification.thresholds import THRESHOLDS
from aircraft_sysid_ros.reconstruction.options import LONGEST_WAIT


class Missing(NamedTuple):
    """What an axis needs, and has or has not."""

    model: AerodynamicModel
    newest: npt.NDArray[np.float64] | None  # sample
    conditions: LearntConditions
    inferred: Sequence[str]  # angles that no vane measures
    pace: Pace  # of states
    pace_of_controls: Pace

    def why(self, axis: int, updates: int) -> str:
        """What keeps an axis of so many ``updates`` from being learnt, in words; empty: nothing but motion does."""
        if updates >= THRESHOLDS.samples:
            return self._inferred_too_seldom(axis)
        if self.pace.is_too_slow:
            return too_slow(self.pace.rate)
        needed, unseen = self.conditions.signals_of(self.model, axis)
        controls = [name for name in needed if name in CONTROL_SIGNALS]
        nothing = self.newest is not None and not updates
        if controls and nothing and (behind := self.pace_of_controls.behind) > 0.0:
            late = stamped_behind(behind) if behind > LONGEST_WAIT else too_late(behind)
            return f"needs {listed(controls)}, {late}"
        never = self.pace.is_sparse or (nothing and {*unseen} & CONTROL_SIGNALS)
        if controls and never and (apart := self.pace_of_controls.shown) > SPARSEST_CONTROLS:
            if np.isinf(apart):
                return f"needs {listed(controls)}, of which too few samples have come yet"
            rate = f"{1.0 / apart:.2g} Hz"
            come = "come" if len(controls) > 1 else "comes"
            return f"needs {listed(controls)}, which {come} at {rate}: at least {LOWEST_RATE:g} Hz are needed"
        if nothing and unseen:
            return needs(unseen)
        return self._not_inferred(needed)

    def _inferred_too_seldom(self, axis: int) -> str:
        """That an axis rests on angles which wind and attitude have told for too short a time; empty: it does not.

        So few seconds are of one manoeuvre and one error of the wind: of five values that were to be used in such
        flights of a stranger four were more than a quarter off.
        """
        seconds, needed_seconds = self.conditions.seconds[axis], THRESHOLDS.inferred_seconds
        if seconds >= needed_seconds or not self.inferred:
            return ""
        needed, _ = self.conditions.signals_of(self.model, axis)
        angles = [name for name in self.inferred if name in needed]
        if not angles:
            return ""
        return (
            f"rests on {listed(angles)}, which no vane measures: wind and attitude have shown "
            f"{'them' if len(angles) > 1 else 'it'} for {int(seconds)} of the {needed_seconds:.0f} s that are needed"
        )

    def _not_inferred(self, needed: tuple[str, ...]) -> str:
        """That angles are neither measured nor known just now from wind and attitude; empty: they are."""
        if self.newest is None:
            return ""
        known = dict(zip(self.model.signal_names, self.newest[CoefficientSample.SIGNALS], strict=False))
        angles = [name for name in self.inferred if name in needed and np.isnan(known[name])]
        if not angles:
            return ""
        return f"needs {listed(angles)}, which no vane measures, and wind and attitude do not show well enough"
