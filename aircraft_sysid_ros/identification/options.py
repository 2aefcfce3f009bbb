"""Options of the second step."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.option import OptionError, option, options, options_of
from aircraft_sysid_ros.reconstruction.options import LONGEST_WAIT

EstimatorName = Literal["auto", "rls", "fourier", "rml"]
_WINDOW = "the windows that were learnt from are made with it"
_FORM = "what was learnt is in its form"


@options
class ParameterOptions:
    """Options of the second step; the live node offers them as parameters."""

    half_width: float = option(
        0.08, "Half-width of the differentiating window, which is its delay.", "s", 0.01, 1.0, _WINDOW
    )
    step: float = option(0.04, "Time between evaluations.", "s", 0.005, 0.1, _WINDOW)
    forgetting_time: float = option(120.0, "Time constant of forgetting, in seconds of motion.", "s", 1.0, 1e6)
    excitation: float = option(
        2.0, "Ratio of a term's motion to its noise above which its axis learns.", "sigma", 0.0, 100.0
    )
    settle: float = option(0.2, "How much later than its state a control sample may arrive.", "s", 0.02, LONGEST_WAIT)
    largest_gap: float = option(
        0.06,
        "Longest time between states inside a window; the estimators fourier and rml go on over 0.1 s in any case.",
        "s",
        0.001,
        1.0,
    )
    measured_angles: bool = option(
        True,
        "Where gusts make the filter lag, regress on the angles that the vanes measure. Not for vanes whose errors "
        "the first step estimates.",
    )
    lag_time: float = option(2.0, "Longest time over which residuals may be correlated.", "s", 0.1, 10.0, _WINDOW)
    error_window: float = option(10.0, "Length of the sliding window of the model error.", "s", 1.0, 600.0)
    estimator: EstimatorName = option(
        "auto",
        "Estimator whose parameters are published: auto, rls or rml, whichever suits the flight; rls, recursive "
        "least squares in the time domain; fourier, equation error in the frequency domain; rml, recursive maximum "
        "likelihood.",
        fixed=_FORM,
    )
    lowest_frequency: float = option(0.1, "Lowest frequency that the estimator fourier uses.", "Hz", 0.01, 20.0, _FORM)
    highest_frequency: float = option(
        2.0, "Highest frequency that the estimator fourier uses.", "Hz", 0.01, 20.0, _FORM
    )
    relearn: bool = option(True, "Relearn an axis after a sudden change of the aircraft.")
    rml_rate: float = option(
        100.0, "Rate at which the estimator rml uses the IMU; faster samples are averaged.", "Hz", 10.0, 400.0, _FORM
    )

    @model_validator(mode="after")
    def _rising(self) -> ParameterOptions:
        low, high = self.lowest_frequency, self.highest_frequency
        if not low < high:
            raise OptionError(
                "lowest_frequency",
                "must be below highest_frequency, or there is no band between them, "
                f"not {low:g} and {high:g} Hz: set both together",
            )
        return self


#: Options that an estimator is made of: they cannot change while it learns.
STRUCTURE = tuple(name for name, declared in options_of(ParameterOptions).items() if declared.fixed)


def check_change(before: ParameterOptions, after: ParameterOptions) -> None:
    """Raises InputError where an estimator that is learning cannot go on with other options."""
    weighted = ("forgetting_time",) if before.estimator == "fourier" else ()  # the transforms are
    for name in (*STRUCTURE, *weighted):
        if getattr(before, name) != getattr(after, name):
            raise InputError(f"{name} cannot change while the estimator {before.estimator} learns: it is built with it")
