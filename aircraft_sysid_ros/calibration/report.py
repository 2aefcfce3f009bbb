"""The three calibrations from samples to what is told of them: parameters, residuals before and after, notes.

Whole numbers and (B1) to (B8) are equations of the two-stage paper, docs/references.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.aircraft.unsaid_places import unsaid_keys
from aircraft_sysid_ros.calibration import compatibility, filter_start, five_hole_probe, magnetometer, probe_models
from aircraft_sysid_ros.calibration.calibration_file import AIR_DATA_ERRORS
from aircraft_sysid_ros.calibration.navigation import Navigation
from aircraft_sysid_ros.calibration.procedure import Answer, residuals, solve
from aircraft_sysid_ros.calibration.segments import LEAST_TURN, Segments, turned_through
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.two_stage.residual_sampling import NoMinimumError
from aircraft_sysid_ros.rounding import with_error
from aircraft_sysid_ros.samples import Samples, flight_at

Array = npt.NDArray[np.float64]
Span = tuple[float, float] | None

#: Points of the residuals over time that a result holds, every n-th: enough for a picture.
MOST_POINTS = 1500


#: Errors of one sensor: where one of them is at its bound, the others are no answer either.
_OF_ONE_SENSOR = (
    ("lambda_V", "b_V"),
    ("lambda_alpha", "b_alpha", "kappa_alpha"),
    ("lambda_beta", "b_beta", "kappa_beta"),
    ("eps_phi",),
)
#: One of each sensor whose errors look like the wind: with the wind at its bound they hold the rest of it.
_LEVEL = ("lambda_V", "lambda_alpha", "lambda_beta", "eps_phi")
_HIDDEN_BY_WIND = {"W_N": _LEVEL, "W_E": _LEVEL, "W_D": ("lambda_alpha",)}


@dataclass(frozen=True)
class Report:
    """What a calibration found."""

    title: str
    answer: Answer
    parameters: list[dict[str, Any]]
    section: dict[str, Any]  # of the calibration file
    time: Array  # (K,) [s] from the first sample used
    outputs: tuple[str, ...]
    unit: str
    before: Array  # (K, m) residuals of an uncalibrated sensor
    after: Array  # (K, m)
    segments: Segments
    navigation: Navigation
    step: float
    notes: list[str]
    models: list[dict[str, Any]] = field(default_factory=list)  # what was tried beside the paper's, and which is used

    def json(self) -> dict[str, Any]:
        """Numbers for a file."""
        begin = self.navigation.time[0]
        return {
            "parameters": self.parameters,
            "residual_unit": self.unit,
            "residuals": {
                name: {"before": _rms(self.before[:, i]), "after": _rms(self.after[:, i])}
                for i, name in enumerate(self.outputs)
            },
            "noise_std": np.sqrt(self.answer.noise).tolist(),
            "decision": self.answer.decision.reason,
            "stage_2": ("xi2 alone, " if self.answer.alone else "all unknowns, ") + self.answer.convergence,
            "converged": self.answer.converged,
            "stage_1": self._stage_1(),
            "series": self._series(),
            "segments": [
                {"manoeuvre": s.name, "from": round(s.begin - begin, 1), "to": round(s.end - begin, 1)}
                for s in self.segments.found
            ],
            "seconds_used": len(self.after) * self.step,
            "models": self.models,
            "notes": self.notes,
        }

    def _stage_1(self) -> dict[str, Any]:
        """Samples of the sampled parameters ``names`` with Tr R (19), and the minima that were reached from them."""
        answer = self.answer
        free = zip(answer.problem.names2, answer.determined[answer.problem.n1 :], strict=True)
        return {
            "names": [name for name, there in free if there or name in answer.refused],
            "unique": answer.decision.unique,
            "minima": [{"xi2": m.xi2.tolist(), "trace": m.trace} for m in answer.decision.minima],
            "xi2": answer.samples.xi2.tolist(),
            "trace": answer.samples.trace.tolist(),
        }

    def _series(self) -> dict[str, Any]:
        """Residuals over time, thinned."""
        chosen = slice(None, None, max(-(-len(self.time) // MOST_POINTS), 1))
        both = (("before", self.before), ("after", self.after))
        listed = {key: {name: _short(values[chosen, i]) for i, name in enumerate(self.outputs)} for key, values in both}
        return {"time": _short(self.time[chosen], 6), **listed}


def _short(values: Array, digits: int = 4) -> list[float]:
    """Significant digits that a picture needs."""
    return [float(f"{value:.{digits}g}") for value in values]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def calibrate_probe(
    recording: Samples, aircraft: Aircraft, span: Span = None,
    sensitivity: tuple[float, float] = (five_hole_probe.SENSITIVITY,) * 2, **options: Any,
) -> Report:  # fmt: skip
    """Five-hole probe, (35)-(42), or a richer model. Raises InputError where wind and airspeed cannot be told apart."""
    _check_scales(aircraft)
    flights = int(flight_at(recording).max(initial=0)) + 1
    if flights > 1:
        raise InputError(
            f"these are {flights} flights, each in a wind of its own, and a calibration of the probe has one wind: "
            "give the recording of one of them"
        )
    flight = five_hole_probe.probe_flight(recording, aircraft, span, sensitivity)
    every = np.ones(len(flight.navigation.time), dtype=bool)
    if turned_through(flight.navigation, every) < LEAST_TURN:
        raise InputError(
            "the flight is straight: wind and airspeed error cannot be told apart, nor wind across and sideslip error. "
            "Fly two full circles at different airspeeds"
        )
    try:
        found = probe_models.solve_probe(flight, **options)
    except NoMinimumError:
        raise InputError(
            "nothing tells the errors of the probe and the wind apart in this flight, as in circles at one airspeed "
            "alone: fly two full circles at different airspeeds, with pushovers or doublets between them"
        ) from None
    answer, model, whole = found.answer, found.model, found.model.problem()
    determined = dict(zip(answer.problem.names, answer.determined, strict=True))
    if not (determined["lambda_V"] or determined["b_V"]):
        raise InputError(
            "wind and airspeed error cannot be told apart in this flight: fly two full circles at different airspeeds"
        )
    answer = answer.without(_no_answers(answer))
    values = answer.values
    parameters = answer.parameters(answer.problem.names, model.units(), model.excited_by())
    names = (*five_hole_probe.NAMES1[:2], *model.names2)
    section = {
        "alpha_sensitivity": float(sensitivity[0]), "beta_sensitivity": float(sensitivity[1]),
        "pressure_zeros": [float(zero) for zero in flight.zeros],
        **{name: values[name] for name in names}, "std": _stds(parameters, names),
        "covariance": filter_start.covariance_of(answer).tolist(),
    }  # fmt: skip
    wind_only = answer.xi * np.array([name.startswith("W_") for name in answer.problem.names])
    return _report(
        "five-hole probe", answer, parameters, section, ("V_N", "V_E", "V_D"), "m/s", residuals(whole, wind_only),
        residuals(whole, answer.xi), flight.segments, flight.navigation, flight.grid.step,
        [*_probe_notes(flight, found), *_doubts(answer), *_place_note(aircraft)], found.told(),
    )  # fmt: skip


def _probe_notes(flight: five_hole_probe.ProbeFlight, found: probe_models.ProbeAnswer) -> list[str]:
    notes, paper = [], found.paper
    if found.answer is not paper:
        notes.append(f"this is the answer of a model with {found.model.words}: {_difference(found)}")
    if found.model.knots is not None:
        times = ", ".join(f"{knot - flight.navigation.time[0]:.0f}" for knot in found.model.knots)
        notes.append(f"W_N_0, W_N_1 and so on are the wind at {times} s of the flight that is used")
    if not np.any(flight.zeros):
        notes.append("the aircraft never stands still in the recording: zeros of the pressures are taken as 0")
    if not found.steady:
        notes.append(
            f"residuals are {np.sqrt(np.mean(found.answer.noise)):.2g} m/s where the noise of the probe gives "
            f"{flight.probe_noise:.2g}: the wind was not steady, or the calibration is wrong, which shows in "
            f"residuals no smaller than before. Estimated from averages over {five_hole_probe.AVERAGE:g} s; in gusts "
            "the scales of the angles tend to be too small"
        )
    if not any(segment.name == "wind circle" for segment in flight.segments.found):
        notes.append(
            "no wind circle was found: stage 1 took the whole flight, and the scale and the bias of the airspeed rest "
            "on turns that were not flown for them: check them by a flight with circles"
        )
    return notes


def _difference(found: probe_models.ProbeAnswer) -> str:
    """Where the paper's model is farthest off, in standard errors of the answer."""
    answer, paper = found.answer, found.paper
    apart = {
        name: (paper.values[name] - value) / std
        for name, value, std, there in zip(answer.problem.names, answer.xi, answer.std, answer.determined, strict=True)
        if there and name in paper.values and not name.startswith("W_")
    }
    name = max(apart, key=lambda key: abs(apart[key]))
    unit = found.model.units().get(name, "-").removesuffix("-")
    said, ours = (f"{value:.4g} {unit}".rstrip() for value in (paper.values[name], answer.values[name]))
    return (
        f"a linear curve in a steady wind says {name} = {said}, not {ours}: {abs(apart[name]):.1f} standard errors away"
    )


def calibrate_magnetometer(
    recording: Samples, aircraft: Aircraft, span: Span = None, strength: float | None = None, **options: Any
) -> Report:
    """Magnetometer, (B1)-(B3). Residuals are those of the field strength."""
    flight = magnetometer.magnetic_flight(recording, aircraft, span, strength)
    try:
        answer = solve(flight.task(), **options)
    except NoMinimumError:
        raise InputError(
            "nothing tells the errors of the magnetometer apart in this flight: fly " + magnetometer.EXCITED_BY["n_x"]
        ) from None
    _check_magnetic_bounds(answer, flight.data)
    answer = answer.without(_no_answers(answer))
    values = answer.values
    parameters = answer.parameters(answer.problem.names, magnetometer.UNITS, magnetometer.EXCITED_BY)
    if not any(p["determined"] for p in parameters if p["name"].startswith("n_")):
        raise InputError("this flight does not determine the hard iron: fly " + magnetometer.EXCITED_BY["n_x"])
    names = (*magnetometer.NAMES1, *magnetometer.NAMES2)
    section = {**{name: values[name] for name in names}, "std": _stds(parameters, names)}
    matrix = magnetometer.sensor_matrix(answer.xi[:3], answer.xi[6:])
    field = np.linalg.solve(matrix, (flight.data.measured - answer.xi[3:6]).T).T
    strengths = [np.linalg.norm(h, axis=1, keepdims=True) for h in (flight.data.measured, field)]
    before, after = (h - h.mean() for h in strengths)
    notes = [f"scales are relative to a field of {flight.data.field.strength:.4g}"]
    if strength is None:
        notes.append("that of a model of the earth's field here, to some per cent: --field-strength gives a better one")
    notes += _doubts(answer)
    return _report(
        "magnetometer", answer, parameters, section, ("strength",), "unit of the sensor", before, after,
        flight.segments, flight.navigation, flight.grid.step, notes,
    )  # fmt: skip


def _check_magnetic_bounds(answer: Answer, data: magnetometer.MagneticData) -> None:
    """All unknowns are of one sensor: with one of them at its bound none is an answer."""
    names = [name for name, there in zip(answer.problem.names, answer.at_bound, strict=True) if there]
    if names:
        raise InputError(
            f"the errors of the magnetometer are larger than is sought ({', '.join(names)} at the bound): it shows "
            f"{np.median(np.linalg.norm(data.measured, axis=1)):.3g} where the field is {data.field.strength:.3g}: "
            "give the strength in the unit of the recording by --field-strength, and look at declination and mounting"
        )


def calibrate_compatibility(recording: Samples, aircraft: Aircraft, span: Span = None, **options: Any) -> Report:
    """Data compatibility, (B4)-(B8). Residuals are in units of the outputs' noise."""
    _check_scales(aircraft)
    flight = compatibility.compatibility_flight(recording, aircraft, span)
    answer, _ = flight.solve(**options)
    left = np.sqrt(answer.noise[:3])
    is_steady = not np.any(left > compatibility.STEADY)
    gusts = {} if is_steady else dict.fromkeys(AIR_DATA_ERRORS, "in a wind that was not steady")
    answer = answer.without({**_no_answers(answer), **gusts})
    parameters = answer.parameters(answer.problem.names, compatibility.UNITS, compatibility.EXCITED_BY)
    names = (*compatibility.NAMES1, *compatibility.NAMES2)
    section = {**{name: answer.values[name] for name in names}, "std": _stds(parameters, names)}
    nothing = flight.data.refined(None)
    zero = np.zeros(len(names))
    before = nothing.problem().kept - nothing.model(zero[len(compatibility.NAMES1) :])[1]
    notes = [] if flight.attitude_is_measured else [
        "the recording has no attitude: that of the navigation from IMU and GPS takes its place"
    ]  # fmt: skip
    if not is_steady:
        notes.append(
            "the wind was not steady, or air data are wrong in another way: late, in another unit, or of a probe at "
            "an unknown position (`check` and `diagnose` look for that): residuals of V, alpha, beta are "
            f"{', '.join(f'{x:.2f}' for x in left)} times the noise of the aircraft file over pieces of "
            f"{compatibility.PIECE:g} s, and a steady wind leaves less than {compatibility.STEADY:g}: nothing is said "
            "about air data"
        )
    notes += [*_doubts(answer), *_place_note(aircraft)]
    return _report(
        "data compatibility", answer, parameters, section, compatibility.OUTPUT_NAMES, "sigma of the aircraft file",
        before, answer.residuals(), flight.segments, flight.navigation, flight.grid.step, notes,
    )  # fmt: skip


def _no_answers(answer: Answer) -> dict[str, str]:
    """Names of what the flight does not tell or is at its bound, but for the wind, and of what else is said of the same
    sensor, or what a wind that is at its bound hides; in words why.
    """
    bound = {name for name, there in zip(answer.problem.names, answer.at_bound, strict=True) if there}
    found = {name for name in bound if not name.startswith("W_")}
    hidden = found.union(*(_HIDDEN_BY_WIND[name[:3]] for name in bound - found))
    beside = {name for group in _OF_ONE_SENSOR if hidden & set(group) for name in group}
    beside &= set(answer.problem.names)
    at_bounds = {name: "at its bound" if name in found else "besides what is at its bound" for name in found | beside}
    return {**dict.fromkeys(answer.vague, "not excited"), **at_bounds}


def _doubts(answer: Answer) -> list[str]:
    """What the calibration file does not correct though a number was found, and what other standard errors rest on."""
    notes, names = [], answer.problem.names
    if answer.refused:
        listed = ", ".join(answer.refused)
        notes.append(f"no answer, and not in the calibration file: {listed}; nothing is corrected by them")
    usual = np.zeros(len(names)) if answer.task.usual is None else answer.task.usual
    out = [not there and name not in answer.refused for name, there in zip(names, answer.determined, strict=True)]
    each = list(zip(names, answer.xi, usual, out, strict=True))
    counted = [f"{name} = {with_error(value, std)}" for name, value, std, is_out in each if is_out and std > 0.0]
    taken = [f"{name} = {value:.4g}" for name, value, std, is_out in each if is_out and std == 0.0]
    if counted:
        notes.append(
            f"not excited, taken as usual, which is in the standard errors of the others: {', '.join(counted)}"
        )
    if taken:
        notes.append(
            f"answers and standard errors hold if what this flight does not excite is as assumed: {', '.join(taken)}; "
            "if it is not, they are wrong by that"
        )
    return notes


def _place_note(aircraft: Aircraft) -> list[str]:
    """The arm of the probe is taken as known, also where nobody knows it."""
    unsaid = unsaid_keys(aircraft)
    if not unsaid:
        return []
    return [
        f"the aircraft file does not give all of {' and '.join(unsaid)}: what it leaves out is taken as at the centre "
        "of gravity, and no standard error includes the errors of angles and airspeed from that: measure it before "
        "this calibration is used"
    ]


def _check_scales(aircraft: Aircraft) -> None:
    """An error of the aircraft file is taken off what a calibration has corrected: it must not be found twice."""
    for name in ("airspeed", "angle_of_attack", "sideslip"):
        sensor = aircraft.sensors[name]
        for words, value, none in (
            ("a scale", sensor.scale, 1.0),
            ("an offset", sensor.offset, 0.0),
            ("a drift", sensor.drift, 0.0),
        ):
            if value != none:
                raise InputError(
                    f"the aircraft file has {words} of {value:g} for {name}, which would come on top of this "
                    "calibration: take it out of the file"
                )


def _stds(parameters: list[dict[str, Any]], names: tuple[str, ...]) -> dict[str, float | None]:
    return {p["name"]: p["std"] if p["determined"] else None for p in parameters if p["name"] in names}


def _report(
    title: str, answer: Answer, parameters: list[dict[str, Any]], section: dict[str, Any], outputs: tuple[str, ...],
    unit: str, before: Array, after: Array, segments: Segments, navigation: Navigation, step: float, notes: list[str],
    models: list[dict[str, Any]] | None = None,
) -> Report:  # fmt: skip
    time = navigation.time - navigation.time[0]
    return Report(
        title, answer, parameters, section, time, outputs, unit, before, after, segments, navigation, step,
        [*notes, *navigation.notes], models or [],
    )  # fmt: skip
