"""What an estimator of aerodynamic parameters is, besides recursive least squares, and the options of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.modelling.pace import Pace
from aircraft_sysid_ros.modelling.regression import Body
from aircraft_sysid_ros.samples import Samples

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ParameterOptions:
    """Options of the second step; the live node offers them as parameters."""

    half_width: float = 0.08  # [s] delay of the differentiator
    step: float = 0.04  # [s] between evaluations
    forgetting_time: float = 120.0  # [s] of motion that the estimates rest on
    excitation: float = 2.0  # how many sigma of its noise a term must move before its axis learns
    settle: float = 0.2  # [s] how much later than the state a control sample may come
    largest_gap: float = 0.1  # [s] between states inside a window
    lag_time: float = 2.0  # [s] over which residuals may be correlated
    error_window: float = 10.0  # [s] of the sliding model error
    estimator: str = "rls"  # which estimator's parameters are published: a name of LEARNERS
    lowest_frequency: float = 0.1  # [Hz] band of the estimator "fourier"
    highest_frequency: float = 2.0  # [Hz]
    relearn: bool = True  # after a sudden change of the aeroplane learn the changed axis anew
    rml_rate: float = 100.0  # [Hz] at which the estimator "rml" takes the IMU; faster samples are averaged


#: Options that an estimator is made of: they cannot change while it learns.
STRUCTURE = ("half_width", "step", "lag_time", "estimator", "lowest_frequency", "highest_frequency", "rml_rate")


def check_change(before: ParameterOptions, after: ParameterOptions) -> None:
    """Raises InputError where an estimator that is learning cannot go on with other options."""
    weighted = ("forgetting_time",) if before.estimator == "fourier" else ()  # the transforms are
    for name in (*STRUCTURE, *weighted):
        if getattr(before, name) != getattr(after, name):
            raise InputError(f"{name} cannot change while the estimator {before.estimator} learns: it is made of it")


def force_noise(aircraft: Aircraft, options: ParameterOptions) -> float:
    """One sigma [N] of the accelerometer's white noise, averaged over a window, times mass."""
    accelerometer = aircraft.sensors["accelerometer"]
    window = max(options.half_width * accelerometer.rate, 1.0)
    return float(aircraft.mass * accelerometer.noise[0] / np.sqrt(window))


class AxisEstimate(NamedTuple):
    """What a learner knows of the n parameters of one axis now."""

    theta: Array  # (n,); NaN where not determined yet
    covariance: Array  # (n, n), corrected for coloured residuals; NaN where not determined yet
    samples: int  # evaluations that it rests on, comparable with those of recursive least squares (25 Hz)
    last_learnt: Array  # (n,) time [s] when each term last moved and was learnt from; NaN: never
    excitation: Array | None = None  # (n,) as in ParameterEstimate; None: as recursive least squares sees it


class Opening(NamedTuple):
    """An axis that has changed: what was known of it is a prior now, see ``relearning``."""

    axis: int
    since: float  # [s] when it changed
    spread: Array  # (n,) value of each parameter that would spread the coefficient as the flight did


class Learner(Protocol):
    """A second estimator of the same model, made with (aircraft, options) and fed with the same states.

    What it finds must not depend on how samples and rows are cut into batches: live nodes push one at a time,
    replay a thousand.
    """

    def keep_pace(self, pace: Pace) -> None:
        """States come at another rate from now on."""

    def push_samples(self, samples: Samples, epoch: int) -> None:
        """All samples of the flight, of every kind, as they arrive: stamps as sent, sensor delays not removed.

        Live, only kinds that the node hears come (INPUTS of the node).
        """

    def push(self, rows: Array, history: Array, body: Body) -> tuple[Array, Array]:
        """New reconstructed states in order of time, and what became known from them.

        rows (n, Column.WIDTH), history (n, TERM + terms) of ``fill_history`` and the body that holds for them.
        Returns times [s] (k,), ascending, and all parameters (k, parameters) as they were known at those
        times from the rows up to then, 0 where nothing is known: predictions from then on are made with them.
        """

    def change_options(self, options: ParameterOptions) -> None:
        """Go on with other options, which have passed ``check_change``."""

    def axis(self, axis: int) -> AxisEstimate:
        """Parameters of one axis now, in the order of the model's terms."""

    def relearn(self, openings: Sequence[Opening]) -> Array:
        """Make what was known of axes a prior, open to change, and learn them again from what was since.

        Returns all parameters (parameters,) as they are then, 0 where nothing is known.
        """

    def waits(self, axis: int) -> bool:
        """Whether it has nothing of its own on an axis that changed until it is given what least squares learnt."""

    def take_over(self, axis: int, known: AxisEstimate) -> Array:
        """Begin an axis that waits anew with what recursive least squares knows; returns all parameters then."""

    def remember(self) -> Any:
        """All that has been learnt, for ``recall``: a copy."""

    def recall(self, memory: Any) -> Array:
        """Know what ``remember`` gave and nothing of what came since; returns all parameters, 0 where not known."""

    def reset(self) -> None:
        """Forget all that was learnt."""

    def restart_time(self) -> None:
        """The clock began anew: drop what refers to old times, keep what was learnt."""

    def warm_up(self) -> None:
        """Compile, or load from the cache, every kernel that two seconds of level flight do not reach."""
