"""Model against measurement, axis by axis: error on flight that was not fitted, its floor, what is left, and where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, MOMENTS
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.quick_motion import QuickMotion, quick_motion
from aircraft_sysid_ros.diagnosis.search.fit import AxisFit, Fit, fits_of, why_none
from aircraft_sysid_ros.diagnosis.significance.error_regions import Place, failing_places
from aircraft_sysid_ros.diagnosis.significance.noise_floor import HALF_WIDTH, NoiseFloor, noise_floor, noise_seen
from aircraft_sysid_ros.diagnosis.significance.whiteness import ORDER, Whiteness, on_grid, whiteness_of
from aircraft_sysid_ros.diagnosis.thresholds import THRESHOLDS
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.identification.conditions import listed

Array = npt.NDArray[np.float64]

#: Places that are listed.
MOST_PLACES = 10
#: What is left of an axis, in words.
FAILS, MORE, NOISE, SHORT = "fails", "more than noise", "only noise", "too short to tell"


def left_in_words(fails: bool | None, white: bool | None) -> str:
    """What is left of an axis, by whether it fails somewhere and whether its residual is white; None: not known."""
    if fails:
        return FAILS
    return SHORT if fails is None or white is None else NOISE if white else MORE


@dataclass(frozen=True)
class AxisComparison:
    """One axis of the flight under the flight's own model."""

    axis: str
    fit: Fit
    spread: float  # standard deviation of the measured coefficient
    floor: NoiseFloor
    whiteness: Whiteness
    noise_seen: float  # fast part of the residual over what the noise of the sensors makes of it
    predicted: Array  # (n,) by the fit to all points
    places: tuple[Place, ...]
    quick: QuickMotion | None = None  # of a moment whose trim the model does not know
    seconds: float = np.inf  # of flight that the errors are of

    @property
    def is_short(self) -> bool:
        """Whether it is too little flight to say that the model fails in it."""
        return self.seconds < THRESHOLDS.shortest

    @property
    def fails(self) -> bool | None:
        """Whether it is worse than noise somewhere; None where that cannot be said."""
        return None if self.is_short else bool(self.places)


@dataclass(frozen=True)
class Comparison:
    """All axes; an axis without data is in ``reasons`` with a sentence."""

    flight: FlightData
    axes: Mapping[str, AxisComparison]
    reasons: Mapping[str, str]

    @property
    def worst(self) -> list[Place]:
        """The worst places of all axes, worst first."""
        places = [place for axis in self.axes.values() for place in axis.places]
        return sorted(places, key=lambda place: -place.nrmse)[:MOST_PLACES]

    @property
    def notes(self) -> list[str]:
        """What the user should know about the noise of the sensors, a slow IMU, and missing sensors."""
        inferred = [name for name in self.flight.inferred if not self.flight.lacks([name])]
        said = [
            *self.flight.notes,
            *self._too_short,
            *(axis.quick.words for axis in self.axes.values() if axis.quick is not None),
        ]
        if inferred:  # how well they are known no noise of a sensor says
            return [*said, *self._between_samples, self._about_inferred(inferred)]
        return [*said, *self._between_samples, *self._odd_noise, *self._not_known]

    @property
    def seconds(self) -> float:
        """Flight [s] that the errors are of, of the axis that has most."""
        return max(axis.seconds for axis in self.axes.values())

    @property
    def _too_short(self) -> list[str]:
        short = {name: axis.seconds for name, axis in self.axes.items() if axis.is_short}
        if not short:
            return []
        least, most = (f"{end(short.values()):.0f}" for end in (min, max))
        seconds = least if least == most else f"{least} to {most}"
        return [
            f"{listed(list(short))}: {seconds} s of this flight show what the model leaves, too few to judge it: "
            f"{THRESHOLDS.shortest:g} s are needed"
        ]

    @staticmethod
    def _about_inferred(names: Sequence[str]) -> str:
        are = "are" if len(names) > 1 else "is"
        return (
            f"{listed(names)} {are} not measured but inferred from wind and attitude: the floor is how well the filter "
            "claims to know that, and errors above it need not be the model's"
        )

    @property
    def _between_samples(self) -> list[str]:
        if not self.flight.sparse_interval > 0.0:
            return []
        rate = f"the IMU comes at {1.0 / self.flight.sparse_interval:.2g} Hz"
        beyond = "what happens between two samples, mostly in quick manoeuvres, is in the errors above it"
        return [f"{rate}: the floor is the noise of the sensors alone, and {beyond}"]

    @property
    def _odd_noise(self) -> list[str]:
        most = (
            np.inf if self.flight.sparse_interval > 0.0 else THRESHOLDS.odd_noise
        )  # there it is motion, see _between_samples
        odd = {
            name: a.noise_seen for name, a in self.axes.items() if not 1 / THRESHOLDS.odd_noise < a.noise_seen < most
        }
        return [
            f"the fast part of the residual of {name} is {seen:.1f} times what the noise of the sensors explains: "
            "its noise floor is wrong by as much, check their noise in the aircraft file"
            for name, seen in odd.items()
            if np.isfinite(seen)
        ]

    @property
    def _not_known(self) -> list[str]:
        """Axes in which only noise is left, and yet the held-out error is far above the floor."""
        notes = []
        for name, axis in self.axes.items():
            fit, floor = axis.fit, axis.floor.nrmse
            times = fit.nrmse_held_out / floor
            if not axis.whiteness.white or not times > THRESHOLDS.far_above:
                continue
            said = f"{name}: the fit leaves only noise, but the held-out error is {times:.1f} times the floor: "
            if fit.nrmse_held_out > THRESHOLDS.far_above * fit.nrmse_fit:
                said += f"a few blocks of this flight determine its parameters, so excite {name} in more manoeuvres"
            elif axis.places:  # it is more than noise there
                continue
            else:
                said += "the sensor noise is larger than the aircraft file says"
            notes.append(said)
        return notes

    @property
    def json(self) -> dict[str, Any]:
        """The content of ``compare --json``."""
        axes = {name: self._axis_json(name) for name in AXES}
        worst = [
            {
                "axis": place.axis,
                "t_start": place.t_start,
                "t_end": place.t_end,
                "conditions": place.conditions,
                "nrmse": place.nrmse,
                "times_noise": place.excess,
                "p_value": place.p_value,
                "text": place.text,
            }
            for place in self.worst
        ]
        return {"axes": axes, "worst": worst, "notes": self.notes}

    def _axis_json(self, name: str) -> dict[str, Any]:
        if name in self.reasons:
            empty = dict.fromkeys(("nrmse_fit", "nrmse_held_out", "noise_floor", "white"))
            return {**empty, "reason": self.reasons[name]}
        axis = self.axes[name]
        return {
            "nrmse_fit": axis.fit.nrmse_fit,
            "nrmse_held_out": axis.fit.nrmse_held_out,
            "noise_floor": axis.floor.nrmse,
            "white": axis.whiteness.white,
            "white_p_value": axis.whiteness.p_value,
            "noise_seen": axis.noise_seen,
            "seconds": axis.seconds,
            "fails": axis.fails,
            "not_determined": list(axis.fit.not_determined),
        }


def compare(flight: FlightData) -> Comparison:
    """Compare a flight with the model of its aircraft file. Raises InputError where no axis has data."""
    fits, reasons = fits_of(flight)
    if not fits:
        raise InputError(f"no axis can be compared: {why_none(flight)}")
    return Comparison(flight, {axis: compare_axis(flight, fit) for axis, fit in fits.items()}, reasons)


def compare_axis(flight: FlightData, fit: AxisFit) -> AxisComparison:
    """Compare one axis under a fit of the flight's own terms."""
    result = fit.fit
    floor = noise_floor(flight, fit.axis, result)
    predicted = fit.columns @ np.nan_to_num(fit.parameters)
    residual = fit.measured - predicted
    every = int(np.ceil(2.0 * HALF_WIDTH / flight.step))  # windows that do not overlap
    whiteness = whiteness_of(
        on_grid(flight.time, floor.without_bias(residual), flight.step, every),
        on_grid(flight.time, floor.noise_std, flight.step, every),
        floor.correlation(ORDER, every),
    )
    seconds = flight.step * float(np.isfinite(result.held_out).sum())
    places: tuple[Place, ...] = ()
    if seconds >= THRESHOLDS.shortest:
        places = tuple(failing_places(flight, fit.axis, result.held_out, floor.std, fit.spread))
    seen = noise_seen(floor, flight.time, residual)
    quick = quick_motion(fit) if fit.axis in MOMENTS else None
    return AxisComparison(fit.axis, result, fit.spread, floor, whiteness, seen, predicted, places, quick, seconds)
