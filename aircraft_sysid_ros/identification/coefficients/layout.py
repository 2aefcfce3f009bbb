"""Columns of what the second step works on: the signals of a state, and a sample of the coefficients."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT

Array = npt.NDArray[np.float64]

# Columns of a history row, one per reconstructed state; terms follow, each times dynamic pressure.
TIME, FLYING, QBAR = 0, 1, 2
FORCE, RATE, CENTRIPETAL, GYROSCOPIC = 3, 6, 9, 12  # three columns each
BIAS_VARIANCE = 15  # of the measured force coefficients from the accelerometer bias, three columns
VANE_NOISE = 18  # one sigma [rad] of a vane's white noise in alpha and beta, averaged over a window; two columns
SIGNAL = 20
NOISE = SIGNAL + SIGNAL_COUNT
TERM = NOISE + SIGNAL_COUNT


class CoefficientSample:
    """Columns of a coefficient sample: what the second step measured at one time, and what the model said of it."""

    TIME = 0
    MEASURED = slice(1, 7)
    PREDICTED = slice(7, 13)  # by the parameters before this sample
    VALID = slice(13, 19)  # the axis could be evaluated
    LEARNT = slice(19, 25)  # and its parameters were updated
    SIGNALS = slice(25, 25 + SIGNAL_COUNT)
    TERMS = 25 + SIGNAL_COUNT  # and on


# The same for compiled loops: first column of each.
MEASURED, PREDICTED = CoefficientSample.MEASURED.start, CoefficientSample.PREDICTED.start
VALID, LEARNT = CoefficientSample.VALID.start, CoefficientSample.LEARNT.start
SIGNALS_OF_SAMPLE, TERMS_OF_SAMPLE = CoefficientSample.SIGNALS.start, CoefficientSample.TERMS

#: Columns of ``CoefficientBatch.weights``: variance [-] of the measured coefficients from the white noise of the
#: accelerometer, and of the three forces from its bias.
WHITE_VARIANCE, FORCE_BIAS_VARIANCE = 0, 1
WEIGHT_COLUMNS = 4


class Body(NamedTuple):
    """Mass properties and geometry."""

    mass: float
    inertia: Array  # (3, 3)
    imu: Array  # (3,) from the centre of gravity
    reference: Array  # (3,) aerodynamic reference point from the centre of gravity
    geometry: Array  # wing area, span, chord
    gravity: float
    minimum_airspeed: float


class CoefficientBatch(NamedTuple):
    """States that came together, and the coefficient samples whose windows they close."""

    rows: Array  # (n, StateField.WIDTH)
    history: Array  # (n, TERM + terms) of ``fill_history``
    body: Body  # that holds for them
    samples: Array  # (m, CoefficientSample.TERMS + terms)
    noise: Array  # (m, terms) one sigma of the noise in each term
    vane_noise: Array  # (m, 2, terms) by how much one sigma of the noise of each vane moves it
    weights: Array  # (m, WEIGHT_COLUMNS)
    drifts_since: float | None = None  # time [s] of the first state of the flight: air data drift from then on

    def parts(self, edges: list[int], half_width: float) -> Iterator[CoefficientBatch]:
        """The states between ``edges``, each part with the samples whose windows of ``half_width`` [s] it closes."""
        closed = self.samples[:, CoefficientSample.TIME] + half_width
        newest = self.history[np.array(edges[1:]) - 1, TIME]
        counts = [0, *np.searchsorted(closed, newest, side="right").tolist()]
        for (low, high), (first, last) in zip(pairwise(edges), pairwise(counts), strict=True):
            of_states, of_samples = slice(low, high), slice(first, last)
            yield CoefficientBatch(
                self.rows[of_states], self.history[of_states], self.body,
                self.samples[of_samples], self.noise[of_samples], self.vane_noise[of_samples], self.weights[of_samples],
                self.drifts_since,
            )  # fmt: skip
