"""What an estimator of aerodynamic parameters is: ``rls``, ``fourier`` and ``rml`` are three of them."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.identification.coefficients.layout import CoefficientBatch
from aircraft_sysid_ros.identification.coefficients.pace import Pace
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.samples import Samples

Array = npt.NDArray[np.float64]


class AxisEstimate(NamedTuple):
    """What an estimator knows of the n parameters of one axis now."""

    theta: Array  # (n,); NaN where not determined yet
    covariance: Array  # (n, n), corrected for coloured residuals; NaN where not determined yet
    samples: int  # evaluations that it rests on, comparable with those of recursive least squares (25 Hz)
    last_learnt: Array  # (n,) time [s] when each term last moved and was learnt from; NaN: never
    excitation: Array | None = None  # (n,) as in ParameterEstimate; None: as recursive least squares sees it


class AxisReset(NamedTuple):
    """Command: an axis has changed, and what was known of it is a prior now, see ``monitoring.covariance_reset``."""

    axis: int
    since: float  # [s] when it changed
    spread: Array  # (n,) value of each parameter that would spread the coefficient as the flight did
    theta: Array  # (n,) what least squares knew before the change
    covariance: Array  # (n, n) of it, over the noise variance, opened to any change
    information: Array  # (n, n) the inverse
    variance: float  # of the noise before the change
    samples: Array  # (m, CoefficientSample) since the change
    weights: Array  # (m, WEIGHT_COLUMNS) of them
    begin: float = -np.inf  # [s] from when on samples are of the axis as it is now
    is_again: bool = False  # the change had gone on after the command before
    is_beside: bool = False  # not this axis has changed, but one in which the same surfaces act
    is_news: bool = False  # nothing of the axis was to be used before: no change, but what it did not know


class KnownParameters(NamedTuple):
    """All parameters as they were known at times, 0 where nothing was."""

    time: Array  # (k,) [s] ascending
    theta: Array  # (k, parameters)


class Estimator(Protocol):
    """Estimates the parameters of a model, made with (aircraft, options) and fed with states and coefficient samples.

    What it finds must not depend on how samples and states are cut into batches: live nodes push one at a time, replay
    a thousand.
    """

    #: It goes back to a checkpoint as a whole, not axis by axis.
    joint: bool

    def change_options(self, options: ParameterOptions) -> None:
        """Go on with other options, which have passed ``check_change``."""

    def keep_pace(self, pace: Pace) -> None:
        """States come at another rate from now on."""

    def push_samples(self, samples: Samples, epoch: int) -> None:
        """All samples of the flight, of every kind, as they arrive: stamps as sent, sensor delays not removed.

        Live, only kinds that the node hears come (INPUTS of the node).
        """

    def step(self, batch: CoefficientBatch) -> KnownParameters:
        """Learn from new states and samples in order of time, and say what became known from them.

        Predictions from those times on are made with it.
        """

    def estimate(self, axis: int) -> AxisEstimate:
        """Parameters of one axis now, in the order of the model's terms."""

    def known(self) -> Array:
        """All parameters (parameters,) as they are now, 0 where nothing is known."""

    def reset_axis(self, *resets: AxisReset) -> None:
        """Make what was known of axes a prior, open to change, and learn them again from what was since."""

    def needs_reseed(self, axis: int) -> bool:
        """Whether it has nothing of its own on an axis that changed until it is given what least squares learnt."""

    def reseed(self, axis: int, known: AxisEstimate) -> None:
        """Begin an axis that waits anew with what recursive least squares knows."""

    def checkpoint(self) -> Any:
        """All that has been learnt, for ``restore``: a copy that nobody changes."""

    def restore(self, checkpoint: Any, *axes: int) -> None:
        """Know of some axes what the checkpoint knew and nothing of what came since; where ``joint``, of all."""

    def reset(self) -> None:
        """Forget all that was learnt."""

    def restart_clock(self) -> None:
        """The clock started over: drop what refers to old times, keep what was learnt."""

    def move_times(self, by: float) -> None:
        """The clock that has started over shows ``by`` [s] more: what was learnt is as old as it was."""

    def warm_up(self) -> None:
        """Compile, or load from the cache, every kernel that two seconds of level flight do not reach."""


def nothing_known(parameters: int) -> KnownParameters:
    """No new times."""
    return KnownParameters(np.empty(0), np.empty((0, parameters)))
