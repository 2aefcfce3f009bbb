"""The three calibrations from samples to what is told of them: parameters, residuals before and after, notes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.configuration import Aircraft
from aircraft_sysid_ros.calibration import compatibility, five_hole_probe, magnetometer
from aircraft_sysid_ros.calibration.navigation import Navigation
from aircraft_sysid_ros.calibration.procedure import Answer, residuals, solve
from aircraft_sysid_ros.calibration.segments import Segments, turned_through
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.samples import Samples

Array = npt.NDArray[np.float64]
Span = tuple[float, float] | None

#: Less change of heading [rad] than this, and wind and airspeed error are one number.
LEAST_TURN = np.radians(90.0)


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
            "stage_1": {"xi2": self.answer.samples.xi2.tolist(), "trace": self.answer.samples.trace.tolist()},
            "segments": [
                {"manoeuvre": s.name, "from": round(s.begin - begin, 1), "to": round(s.end - begin, 1)}
                for s in self.segments.found
            ],
            "seconds_used": len(self.after) * self.step,
            "notes": self.notes,
        }


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def calibrate_probe(
    recording: Samples, aircraft: Aircraft, span: Span = None,
    sensitivity: tuple[float, float] = (five_hole_probe.SENSITIVITY,) * 2, **options: Any,
) -> Report:  # fmt: skip
    """Five-hole probe, (35)-(42). Raises InputError where the flight cannot tell wind from airspeed."""
    flight = five_hole_probe.probe_flight(recording, aircraft, span, sensitivity)
    every = np.ones(len(flight.navigation.time), dtype=bool)
    if turned_through(flight.navigation, every) < LEAST_TURN:
        raise InputError(
            "the flight is straight: wind and airspeed error cannot be told apart, nor wind across and sideslip error. "
            "Fly two full circles at different airspeeds"
        )
    answer, steady = flight.solve(**options)
    values, determined = answer.values, dict(zip(answer.problem.names, answer.determined, strict=True))
    if not (determined["lambda_V"] or determined["b_V"]):
        raise InputError(
            "wind and airspeed error cannot be told apart in this flight: fly two full circles at different airspeeds"
        )
    parameters = answer.parameters(answer.problem.names, five_hole_probe.UNITS, five_hole_probe.EXCITED_BY)
    names = (*five_hole_probe.NAMES1[:2], *five_hole_probe.NAMES2)
    section = {
        "alpha_sensitivity": float(sensitivity[0]), "beta_sensitivity": float(sensitivity[1]),
        "pressure_zeros": [float(zero) for zero in flight.zeros],
        **{name: values[name] for name in names}, "std": _stds(parameters, names),
    }  # fmt: skip
    whole = flight.data.problem()
    wind_only = answer.xi * np.array([name.startswith("W_") for name in answer.problem.names])
    notes = []
    if not np.any(flight.zeros):
        notes.append("the aircraft never stands in the recording: zeros of the pressures are taken as 0")
    if not steady:
        notes.append(
            f"the wind was not steady, residuals of {np.sqrt(np.mean(answer.noise)):.2g} m/s where the noise of the "
            f"probe makes {flight.probe_noise:.2g}: estimated from averages over {five_hole_probe.AVERAGE:g} s, and "
            "the scales of the angles are rather too small than too large"
        )
    if not any(segment.name == "wind circle" for segment in flight.segments.found):
        notes.append("no wind circle was found: stage 1 took the whole flight")
    return _report(
        "five-hole probe", answer, parameters, section, ("V_N", "V_E", "V_D"), "m/s", residuals(whole, wind_only),
        residuals(whole, answer.xi), flight.segments, flight.navigation, flight.grid.step, notes,
    )  # fmt: skip


def calibrate_magnetometer(
    recording: Samples, aircraft: Aircraft, span: Span = None, strength: float | None = None, **options: Any
) -> Report:
    """Magnetometer, (B1)-(B3). Residuals are those of the field strength."""
    flight = magnetometer.magnetic_flight(recording, aircraft, span, strength)
    answer = solve(flight.task(), **options)
    values = answer.values
    parameters = answer.parameters(answer.problem.names, magnetometer.UNITS, magnetometer.EXCITED_BY)
    if not any(p["determined"] for p in parameters if p["name"].startswith("n_")):
        raise InputError("this flight does not tell the hard iron: fly " + magnetometer.EXCITED_BY["n_x"])
    names = (*magnetometer.NAMES1, *magnetometer.NAMES2)
    section = {**{name: values[name] for name in names}, "std": _stds(parameters, names)}
    matrix = magnetometer.sensor_matrix(answer.xi[:3], answer.xi[6:])
    field = np.linalg.solve(matrix, (flight.data.measured - answer.xi[3:6]).T).T
    strengths = [np.linalg.norm(h, axis=1, keepdims=True) for h in (flight.data.measured, field)]
    before, after = (h - h.mean() for h in strengths)
    notes = [f"scales are relative to a field of {flight.data.field.strength:.4g}"]
    if strength is None:
        notes.append("that of the earth's dipole here, right to a quarter: --field-strength gives a better one")
    return _report(
        "magnetometer", answer, parameters, section, ("strength",), "unit of the sensor", before, after,
        flight.segments, flight.navigation, flight.grid.step, notes,
    )  # fmt: skip


def calibrate_compatibility(
    recording: Samples, aircraft: Aircraft, span: Span = None, **options: Any
) -> Report:
    """Data compatibility, (B4)-(B8). Residuals are in units of the outputs' noise."""
    flight = compatibility.compatibility_flight(recording, aircraft, span)
    answer, _ = flight.solve(**options)
    parameters = answer.parameters(answer.problem.names, compatibility.UNITS, compatibility.EXCITED_BY)
    names = (*compatibility.NAMES1, *compatibility.NAMES2)
    section = {**{name: answer.values[name] for name in names}, "std": _stds(parameters, names)}
    nothing = flight.data.refined(None)
    zero = np.zeros(len(names))
    before = nothing.problem().kept - nothing.model(zero[len(compatibility.NAMES1) :])[1]
    notes = [] if flight.attitude_is_measured else [
        "the recording has no attitude: that of the navigation from IMU and GPS takes its place"
    ]  # fmt: skip
    left = np.sqrt(answer.noise[:3])
    if np.any(left > compatibility.STEADY):
        notes.append(
            f"the wind was not steady: residuals of V, alpha, beta are {', '.join(f'{x:.1f}' for x in left)} times the "
            f"noise of the aircraft file over pieces of {compatibility.PIECE:g} s: do not use what is said of air data"
        )
    return _report(
        "data compatibility", answer, parameters, section, compatibility.OUTPUT_NAMES, "sigma of the aircraft file",
        before, answer.residuals(), flight.segments, flight.navigation, flight.grid.step, notes,
    )  # fmt: skip


def _stds(parameters: list[dict[str, Any]], names: tuple[str, ...]) -> dict[str, float | None]:
    return {p["name"]: p["std"] if p["determined"] else None for p in parameters if p["name"] in names}


def _report(
    title: str, answer: Answer, parameters: list[dict[str, Any]], section: dict[str, Any], outputs: tuple[str, ...],
    unit: str, before: Array, after: Array, segments: Segments, navigation: Navigation, step: float, notes: list[str],
) -> Report:  # fmt: skip
    time = navigation.time - navigation.time[0]
    return Report(
        title, answer, parameters, section, time, outputs, unit, before, after, segments, navigation, step, notes
    )

