"""``refine``: maximum likelihood on a run, by output error or filter error, from the parameters that a run has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.maximum_likelihood import covariance_of, sandwich_covariance
from aircraft_sysid_ros.flight_model.layout import (
    GROUP_OF_OUTPUT,
    OUTPUT_GROUPS,
    OUTPUT_NAMES,
    bias_slice,
    make_theta,
    output_slice,
    process_slice,
)
from aircraft_sysid_ros.identification.coefficients.body import body_of, body_with
from aircraft_sysid_ros.identification.coefficients.pace import (
    interval_of,
    sampling_error,
    why_controls_too_slow,
    why_too_slow,
)
from aircraft_sysid_ros.identification.trust import lack_of_fit
from aircraft_sysid_ros.reconstruction.absences import options_after_flight
from aircraft_sysid_ros.reconstruction.sparse_imu import LONG
from aircraft_sysid_ros.refinement.filter_error import FilterModel, filter_error_fit
from aircraft_sysid_ros.refinement.output_error import SegmentModel, output_error_fit
from aircraft_sysid_ros.refinement.parameters import (
    biases_json,
    difference_steps,
    estimable,
    judged,
    levels_json,
    scales_of,
    without_information,
)
from aircraft_sysid_ros.refinement.record import FlightRecord, record_of
from aircraft_sysid_ros.refinement.refined_file import FILTER_ERROR, OTHERWISE
from aircraft_sysid_ros.refinement.run_data import RunData
from aircraft_sysid_ros.refinement.segments import Segment, segments_of
from aircraft_sysid_ros.samples import Kind

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Progress = Callable[[int, float], None]

#: Where the estimation of the noise levels begins: gusts [m/s per sqrt(s)], rates [rad/s per sqrt(s)].
_START_LEVELS = (0.3, 0.3, 0.05)
#: Correlation of innovations that the standard errors allow for [s].
_CORRELATION = 1.0
#: Error where nothing was fitted over that of the first parameters, from which the refined are not to be used.
WORSE = 1.5
#: Coefficients of the forces across which a bias of the accelerometer looks like tilt.
_NEAR_TILT = ("CX", "CY")
#: Least time [s] to fit on.
SHORTEST = 10.0


@dataclass(frozen=True)
class RefineOptions:
    """How a flight is cut up, and when to stop."""

    rate: float = 50.0  # [Hz] of the grid
    segment: float = 16.0  # [s] simulated, or filtered, in one piece
    held_out: float = 4.0  # [s] after each segment that is not fitted
    maximum_iterations: int = 25


@dataclass(frozen=True)
class Refinement:
    """Content of the file, and what a figure of it shows."""

    content: dict[str, Any]
    time: Array  # (N,) [s] of the record
    measured: Array  # (N, 18)
    modelled: Array  # (N, 18), NaN where nothing was fitted


@dataclass
class _Fitted:
    """What both methods hand over."""

    theta: Array
    std: Array  # (parameters,), 0 where not active
    cost: float
    iterations: int
    converged: bool
    reason: str
    residuals: list[Array]  # (N, 18) of each segment, NaN: not measured
    fit: dict[str, Any] = field(default_factory=dict)


def refine(run: RunData, method: str, options: RefineOptions, progress: Progress | None = None) -> Refinement:
    """Refine the parameters of a run; InputError where its flight does not allow it."""
    _check_mass(run)
    state_options = options_after_flight(run.samples, run.calm_air)
    if slow := why_too_slow(run.samples):
        raise InputError(f"the run cannot be refined: {slow}")
    record = record_of(run.aircraft, run.samples, options.rate, state_options)
    segments = segments_of(record, options.segment, options.held_out)
    fitted = [segment for segment in segments if not segment.held_out]
    total = sum(s.part.stop - s.part.start for s in fitted) * record.step
    _check(record, total, why_controls_too_slow(run.samples), run.aircraft.model.inputs)
    levels = _START_LEVELS if method == FILTER_ERROR else (0.0, 0.0, 0.0)
    theta = make_theta(record.model, run.start, run.biases, levels)
    scales = scales_of(run.aircraft.model, record, theta)
    steps = difference_steps(record, scales)
    theta, active = _hold_what_is_not_told(run, record, fitted, theta, steps)
    work = _filter_error if method == FILTER_ERROR else _output_error
    found = work(record, fitted, theta, active, steps, options.maximum_iterations, progress)
    modelled = np.full(record.outputs.shape, np.nan)
    for segment, residual in zip(fitted, found.residuals, strict=True):
        modelled[segment.part] = record.outputs[segment.part] - residual
    std = with_doubts(run, found.theta, found.std)
    errors = errors_not_fitted(run, record, segments, found.theta)
    doubts, bounds = _doubts(found, errors, run.lack_of_fit), run.aircraft.parameter_bounds
    content = {
        "method": method,
        "parameters": judged(
            run.aircraft.model, record, found.theta, std, active, scales, run.parameters, doubts, bounds
        ),
        "biases": biases_json(record, found.theta, found.std, active),
        "cost": found.cost,
        "iterations": found.iterations,
        "converged": found.converged,
        "reason": found.reason,
        **found.fit,
        "segments": len(fitted),
        "seconds_fitted": total,
        "not_fitted": errors,
        "worse": worse_axes(errors),
    }
    return Refinement(content, record.time - record.time[0], record.outputs, modelled)


def with_doubts(run: RunData, theta: Array, std: Array) -> Array:
    """Standard errors (parameters,), those of coefficients with what slow controls may have taken of them.

    And with what sensors leave in doubt that the aircraft file does not describe: the fit takes them as they are.
    """
    names = run.aircraft.model.parameter_names
    interval, count = interval_of(run.samples, Kind.CONTROLS), len(names)
    of_sensors = np.array([run.std_of_sensors.get(name, 0.0) for name in names])
    lost = sampling_error(interval) * np.abs(theta[:count]) if interval > LONG else 0.0
    wider = np.sqrt(std[:count] ** 2 + of_sensors**2 + lost**2)
    return np.concatenate([np.where(std[:count] > 0.0, wider, 0.0), std[count:]])


def _check(record: FlightRecord, total: float, slow: str, inputs: tuple[str, ...]) -> None:
    """InputError where the model of a whole aircraft has too little flight with inputs and flow, ``total`` [s].

    ``slow`` says it of controls that are too slow; else empty. ``inputs``: those that the aircraft file names.
    """
    if slow and total < SHORTEST:
        raise InputError(f"the run cannot be refined: {slow}")
    if {"de", "da", "dr", *inputs} <= record.missing:
        raise InputError("the run has no control surfaces: the flight cannot be simulated without its controls")
    if not record.in_flight.any():
        raise InputError("the run is never in flight with air data and controls: nothing can be refined")
    if total < SHORTEST:
        raise InputError(f"the run has {total:.0f} s in flight with all inputs: {SHORTEST:g} s are needed")


def _check_mass(run: RunData) -> None:
    """InputError where mass properties were measured that are not those of the aircraft file."""
    filed = body_of(run.aircraft)
    for values in np.unique(run.samples.values[run.samples.kind == Kind.MASS], axis=0):
        body = body_with(run.aircraft, filed, values)
        same = np.allclose(body.inertia, filed.inertia, rtol=0.02, atol=0.02 * float(np.trace(filed.inertia)))
        if abs(body.mass / filed.mass - 1.0) > 0.01 or not same or np.any(np.abs(body.imu - filed.imu) > 0.01):
            raise InputError(
                "the run has mass properties other than those of its aircraft file: refine takes them as constant, "
                "so replay a recording without them, with the right ones in the file"
            )


def _hold_what_is_not_told(
    run: RunData, record: FlightRecord, segments: list[Segment], theta: Array, steps: Array
) -> tuple[Array, Mask]:
    """Start and active numbers: coefficients without information, found one by one, stay where they are."""
    active = estimable(run.aircraft.model, record)
    count = len(run.aircraft.model.parameter_names)
    theta[:count][~active[:count]] = 0.0  # what reads a signal that is not measured has no part in the model
    scales = scales_of(run.aircraft.model, record, theta)
    fit = output_error_fit(SegmentModel(record, segments, theta, active, steps), 0)
    covariance = fit.covariance
    while True:
        worst = without_information(covariance, active, scales)
        if worst is None:
            return theta, active
        keep = np.flatnonzero(active) != worst
        # known: the information of the rest, with this one held, is the inverse of what its row leaves
        covariance = _conditional(covariance, ~keep)[np.ix_(keep, keep)]
        active[worst] = False


def _conditional(covariance: Array, held: Mask) -> Array:
    """Covariance of all numbers when one of them, where ``held`` is true, is known."""
    i = int(np.argmax(held))
    if not np.isfinite(covariance[i, i]):
        return covariance
    return covariance - np.outer(covariance[:, i], covariance[i]) / covariance[i, i]


def _output_error(
    record: FlightRecord, segments: list[Segment], theta: Array, active: Mask, steps: Array, most: int,
    progress: Progress | None,
) -> _Fitted:  # fmt: skip
    model = SegmentModel(record, segments, theta, active, steps)
    fit = output_error_fit(model, most, progress)
    std = np.zeros(len(theta))
    std[active] = np.sqrt(np.fmax(np.diag(fit.covariance), np.diag(fit.coloured_covariance)))
    noise = [
        {"output": name, "std": float(np.sqrt(v)), "std_error": float(0.5 * e / np.sqrt(v))}
        for name, v, e in zip(OUTPUT_NAMES, fit.variance, fit.variance_std, strict=True)
        if np.isfinite(v)
    ]
    content = {"residuals": _output_errors(record, fit.residuals), "output_noise": noise}
    return _Fitted(
        model.whole(fit.theta), std, fit.cost, fit.iterations, fit.converged, fit.reason, fit.residuals, content
    )


def _filter_error(
    record: FlightRecord, segments: list[Segment], theta: Array, active: Mask, steps: Array, most: int,
    progress: Progress | None,
) -> _Fitted:  # fmt: skip
    active = active.copy()
    active[process_slice(record.model)] = True
    measured = [bool(np.any(record.measured[np.equal(GROUP_OF_OUTPUT, g)])) for g in range(len(OUTPUT_GROUPS))]
    active[output_slice(record.model)] = measured
    levels = np.zeros(len(active), np.bool_)
    levels[bias_slice(record.model).stop :] = True
    model = FilterModel(record, segments, theta, active, levels, steps)
    fit, scores = filter_error_fit(model, most, progress)
    information = fit.expansion.matrix
    coloured = sandwich_covariance(information, scores, round(_CORRELATION / record.step))
    std = np.zeros(len(theta))
    std[active] = np.sqrt(np.fmax(np.diag(covariance_of(information)), np.diag(coloured)))
    found = model.whole(fit.theta)
    pairs = [model.innovations(segment, found[None]) for segment in segments]
    residuals = [e[0] for e, _ in pairs]
    content = {
        "innovations": _output_errors(record, residuals),
        "consistency": _consistency(pairs),
        **levels_json(record, found, std, active),
    }
    return _Fitted(found, std, fit.expansion.cost, fit.iterations, fit.converged, fit.reason, residuals, content)


def _output_errors(record: FlightRecord, residuals: list[Array]) -> dict[str, float]:
    """Rms of the residuals of each measured output, in its unit."""
    joined = np.concatenate(residuals)
    there = np.any(np.isfinite(joined), axis=0)
    return {name: float(np.sqrt(np.nanmean(joined[:, i] ** 2))) for i, name in enumerate(OUTPUT_NAMES) if there[i]}


def _consistency(pairs: list[tuple[Array, Array]]) -> dict[str, float]:
    """Mean squared innovation over its variance, by output: 1 when the noise is as estimated."""
    ratio = np.concatenate([e[0] ** 2 / s[0] for e, s in pairs])
    there = np.any(np.isfinite(ratio), axis=0)
    return {name: float(np.nanmean(ratio[:, i])) for i, name in enumerate(OUTPUT_NAMES) if there[i]}


def errors_not_fitted(
    run: RunData, record: FlightRecord, segments: list[Segment], theta: Array
) -> dict[str, dict[str, float]]:
    """NRMSE of each coefficient on the pieces that were not fitted, by these parameters and by those before.

    And of these parameters the error over what noise makes of it, where the run says that.

    Those before have learnt from these pieces as well; the constant that biases leave in a coefficient is taken out, in
    each piece from C_X and C_Y, in which a bias is not told from tilt before the first turn.
    This is not the held-out error of ``compare``, which asks how good a model can be and not these parameters of it.
    """
    piece = np.full(len(run.point_stamp), -1)
    for number, segment in enumerate(segments):
        if segment.held_out:
            low, high = record.stamp[segment.part.start], record.stamp[segment.part.stop - 1]
            piece[(run.point_stamp >= low) & (run.point_stamp <= high)] = number
    inside = piece >= 0
    model, result = run.aircraft.model, {}
    for i, axis in enumerate(AXES):
        part = model.axis_slice(axis)
        terms, measured = run.terms[inside, part], run.measured[inside, i]
        there = np.isfinite(measured) & np.all(np.isfinite(terms), axis=1)
        if there.sum() < 10:
            continue
        spread = float(np.std(measured[there]))
        apart = piece[inside][there] if axis in _NEAR_TILT else np.zeros(int(there.sum()), np.int64)
        errors = (measured[there] - terms[there] @ p[part] for p in (theta, run.start))
        after, before = (_rms_about_means(error, apart) for error in errors)
        result[axis] = {"nrmse": after / spread, "nrmse_before": before / spread}
        if run.noise is not None:
            response, of_terms = run.noise
            noise = float(response[inside, i][there].mean() + of_terms[part] @ theta[part] ** 2)
            result[axis]["over_noise"] = after / float(np.sqrt(noise))
    return result


def _rms_about_means(values: Array, part: npt.NDArray[np.int64]) -> float:
    """Rms of values (n,) about their means in the parts (n,) that they belong to."""
    _, at, counts = np.unique(part, return_inverse=True, return_counts=True)
    means = np.bincount(at, weights=values) / counts
    return float(np.sqrt(np.mean((values - means[at]) ** 2)))


def _doubts(found: _Fitted, errors: dict[str, dict[str, float]], of_run: Mapping[str, str]) -> dict[str, str]:
    """Axes of which nothing is to be used, with the reason; ``of_run``: what the recursion says of this flight.

    It has seen all of the flight, of which little is not fitted, and that may lack what shows the misfit.
    """
    if not found.converged:
        return dict.fromkeys(AXES, f"it did not converge: {found.reason}")
    doubts = {
        axis: lack_of_fit(axis, error["nrmse"] ** 2, error.get("over_noise", np.nan)) for axis, error in errors.items()
    }
    for axis in worse_axes(errors):
        doubts[axis] = doubts[axis] or f"where it was not fitted it predicts {axis} worse than the run did"
    for axis, words in of_run.items():
        doubts[axis] = doubts.get(axis, "") or f"{OTHERWISE}: {words}"
    return {axis: words for axis, words in doubts.items() if words}


def worse_axes(errors: dict[str, dict[str, float]]) -> list[str]:
    """Axes that the refined parameters predict clearly worse than those before: the model lacks something."""
    return [axis for axis, error in errors.items() if error["nrmse"] > WORSE * error["nrmse_before"]]


def with_options(options: RefineOptions, segment: float | None) -> RefineOptions:
    """Options with another length of segment [s], where one is given; InputError when it makes no sense."""
    if segment is None:
        return options
    if not 4.0 <= segment <= 600.0:
        raise InputError(f"--segment must be between 4 and 600 s, not {segment:g}")
    return replace(options, segment=segment)
