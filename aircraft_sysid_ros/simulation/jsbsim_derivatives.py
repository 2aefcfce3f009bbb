"""Aerodynamic derivatives of a JSBSim aeroplane from JSBSim's own forces and moments, without any estimator.

(a) *Local*: the aeroplane is held still in a flow of one's choice, as in a wind tunnel, one variable is moved at
a time, and the change of force and moment is divided by the change of the variable: the slope of its aerodynamics
and of its propeller at trim. (b) *Projection*: the least-squares fit of the model to the forces and moments along
a flight, at its true states and without noise: the best that the model can do there, and what an estimator should
find. Where the two differ the aerodynamics is not what the terms of the model can say.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES, AerodynamicModel, textbook_model
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.sensors.truth import Truth
from aircraft_sysid_ros.simulation.jsbsim_flight import (
    ALPHA_DOT,
    COMMANDS,
    FOOT,
    jsbsim_aircraft_file,
    log_row,
    projection,
    set_flow_rates,
    signals_of,
    trimmed,
    truth_of_log,
)

Array = npt.NDArray[np.float64]

#: What the coefficients are differentiated by; V relative to the airspeed of the condition.
VARIABLES = ("alpha", "beta", "p", "q", "r", "de", "da", "dr", "Tc", "alpha_dot", "V")
_RATES, _CONTROLS = ("p", "q", "r"), ("de", "da", "dr", "Tc")
_PROBE = 0.05  # of a whole command, to learn what a command moves
_BANK = 1.0  # [rad] gravity then turns the path, which is the way to an alpha_dot without another rate
_SPEED_STEP = 0.05
_EVERY = 4  # instants of a flight at 200 Hz that are enough for a projection


@dataclass(frozen=True)
class Flow:
    """What the wind tunnel is set to."""

    airspeed: float  # [m/s]
    alpha: float  # [rad]
    beta: float
    rates: Array  # (3,) [rad/s]
    commands: Array  # (4,) elevator, aileron, rudder, throttle
    bank: float = 0.0  # [rad]


@dataclass(frozen=True)
class Slopes:
    """Coefficients C_X … C_n at a condition and their derivatives there."""

    variables: Array  # (11,) of VARIABLES at the condition
    coefficients: Array  # (6,)
    jacobian: Array  # (11, 6) per unit of VARIABLES
    curvature: Array  # (6,) half the second derivative by alpha

    def slope(self, axis: str, variable: str) -> float:
        """d C_axis / d variable, for instance slope("Cm", "alpha_dot")."""
        return float(self.jacobian[VARIABLES.index(variable), AXES.index(axis)])

    def textbook(self) -> dict[str, float]:
        """The 32 parameters of (6.25) whose model has these slopes, and these coefficients, at the condition.

        C_X has a quadratic in alpha: dC_X/d alpha = CX_alpha + 2 CX_alpha2 alpha.
        """
        alpha, model = self.variables[0], textbook_model()
        values: dict[str, float] = {}
        for i, (axis, terms) in enumerate(model.terms.items()):
            for term in terms:
                if term in VARIABLES:
                    values[f"{axis}_{term}"] = self.slope(axis, term)
            if axis == "CX":
                values["CX_alpha2"] = float(self.curvature[i])
                values["CX_alpha"] -= 2.0 * float(self.curvature[i]) * float(alpha)
            values[f"{axis}_0"] = 0.0
        signals = dict(zip(VARIABLES, self.variables[:, None], strict=True))
        del signals["V"]
        rest = self.coefficients - model.coefficients(values, signals)[0]
        values |= {f"{axis}_0": float(value) for axis, value in zip(AXES, rest, strict=True)}
        return {name: values[name] for name in model.parameter_names}


class WindTunnel:
    """A JSBSim aeroplane that does not move on: it is put into a flow, and its forces are read."""

    def __init__(self, name: str) -> None:
        self.executive: Any = trimmed(name)
        self.aircraft: Aircraft = aircraft_from_dict(jsbsim_aircraft_file(name))
        self.executive.suspend_integration()
        e = self.executive
        self.trim = Flow(
            float(e["velocities/vt-fps"] * FOOT), float(e["aero/alpha-rad"]), float(e["aero/beta-rad"]),
            np.zeros(3), np.array([e[command] for command in COMMANDS]),
        )  # fmt: skip

    def measure(self, flow: Flow) -> tuple[Array, Array]:
        """VARIABLES (11,), V in m/s, and coefficients (6,) in a flow, the propeller turning steadily."""
        e = self.executive
        e["ic/phi-rad"] = flow.bank  # first: it turns the flow
        e["ic/vt-fps"], e["ic/alpha-rad"], e["ic/beta-rad"] = flow.airspeed / FOOT, flow.alpha, flow.beta
        for axis, rate in zip("pqr", flow.rates, strict=True):
            e[f"ic/{axis}-rad_sec"] = rate
        for command, value in zip(COMMANDS, flow.commands, strict=True):
            e[command] = value
        e.run_ic()
        e.get_propulsion().get_steady_state()
        e.suspend_integration()  # which run_ic resumes
        e.run()
        set_flow_rates(e, log_row(e))
        e.run()
        truth = truth_of_log(self.aircraft, np.zeros(1), log_row(e)[None])
        signals = signals_of(self.aircraft, truth)
        signals["alpha_dot"] = e[ALPHA_DOT] * self.aircraft.chord / truth.airspeed
        return np.array([signals[name][0] for name in VARIABLES]), truth.coefficients[0]

    def slopes(self, steps: dict[str, float], flow: Flow | None = None) -> Slopes:
        """Central differences at a flow (default: trim) with ``steps`` in alpha, beta, p, q, r, de, da, dr, Tc.

        Moving one variable moves others a little (thrust with alpha, alpha_dot with all), so that the change of
        the coefficients is dC = J' dx with all changes dx of all experiments, which is solved for J.
        """
        flow = flow or self.trim
        speed = flow.airspeed
        x0, c0 = self.measure(flow)
        pairs = [(self.measure(high), self.measure(low)) for high, low in self._experiments(steps, flow)]
        scale = np.where(np.array(VARIABLES) == "V", 1.0 / speed, 1.0)
        dx = np.array([(high[0] - low[0]) * scale for high, low in pairs])
        dc = np.array([high[1] - low[1] for high, low in pairs])
        jacobian = np.linalg.solve(dx, dc)
        (x_high, c_high), (x_low, c_low) = pairs[0]
        bend, step = (x_high + x_low - 2.0 * x0) * scale, 0.5 * dx[0, 0]
        curvature = (c_high + c_low - 2.0 * c0 - jacobian.T @ bend) / (2.0 * step**2)
        return Slopes(x0, c0, jacobian, curvature)

    def _experiments(self, steps: dict[str, float], flow: Flow) -> list[tuple[Flow, Flow]]:
        """Two flows for each of VARIABLES, which differ in it."""
        pairs = []
        for name in ("alpha", "beta"):
            value = getattr(flow, name)
            pairs.append((replace(flow, **{name: value + steps[name]}), replace(flow, **{name: value - steps[name]})))
        lengths = (self.aircraft.span / 2.0, self.aircraft.chord, self.aircraft.span / 2.0)
        for i, (name, length) in enumerate(zip(_RATES, lengths, strict=True)):
            change = np.eye(3)[i] * steps[name] * flow.airspeed / length
            pairs.append((replace(flow, rates=flow.rates + change), replace(flow, rates=flow.rates - change)))
        for i, name in enumerate(_CONTROLS):
            change = np.eye(4)[i] * steps[name] / self._per_command(flow, i)
            pairs.append(
                (replace(flow, commands=flow.commands + change), replace(flow, commands=flow.commands - change))
            )
        pairs.append((replace(flow, bank=_BANK), flow))
        faster, slower = (flow.airspeed * (1.0 + sign * _SPEED_STEP) for sign in (1.0, -1.0))
        return [*pairs, (replace(flow, airspeed=faster), replace(flow, airspeed=slower))]

    def _per_command(self, flow: Flow, i: int) -> float:
        """How far a whole command i moves its surface [rad], or T_c."""
        change = _PROBE * np.eye(4)[i]
        k = VARIABLES.index(_CONTROLS[i])
        high, low = (self.measure(replace(flow, commands=flow.commands + s * change))[0][k] for s in (1.0, -1.0))
        return float((high - low) / (2.0 * _PROBE))


def flown_steps(aircraft: Aircraft, truth: Truth) -> dict[str, float]:
    """Standard deviation of every signal of a flight: how far a derivative has to hold."""
    signals = signals_of(aircraft, truth)
    return {name: float(np.std(signals[name])) for name in VARIABLES[:9]}


def local_derivatives(name: str, aircraft: Aircraft, truth: Truth) -> tuple[dict[str, float], dict[str, list[float]]]:
    """The 32 parameters (a) at trim, and the lowest and highest of each over the flown range.

    Steps are one standard deviation of the flight; the range is that of trim and of the 5th and the 95th
    percentile of angle of attack and of airspeed.
    """
    tunnel = WindTunnel(name)
    steps, trim = flown_steps(aircraft, truth), tunnel.trim
    flows = [trim]
    flows += [replace(trim, alpha=float(a)) for a in np.percentile(truth.alpha, (5, 95))]
    flows += [replace(trim, airspeed=float(v)) for v in np.percentile(truth.airspeed, (5, 95))]
    found = [tunnel.slopes(steps, flow).textbook() for flow in flows]
    ranges = {key: [min(f[key] for f in found), max(f[key] for f in found)] for key in found[0]}
    return found[0], ranges


def flight_projection(
    model: AerodynamicModel, aircraft: Aircraft, truth: Truth
) -> tuple[dict[str, float], dict[str, float]]:
    """Parameters (b) of a model on a flight, and the NRMSE that remains, by axis: what the terms cannot say."""
    truth = truth[::_EVERY]
    signals = signals_of(aircraft, truth)
    values = projection(model, signals, truth.coefficients)
    return values, model_nrmse(model, values, signals, truth.coefficients)


def model_nrmse(
    model: AerodynamicModel, values: dict[str, float], signals: dict[str, Array], coefficients: Array
) -> dict[str, float]:
    """Rms error of a model over the standard deviation of the true coefficients (n, 6), by axis."""
    error = model.coefficients(values, signals) - coefficients
    scores = np.sqrt(np.mean(error**2, axis=0)) / np.std(coefficients, axis=0)
    return dict(zip(AXES, scores.tolist(), strict=True))


def derived_truth(name: str, aircraft: Aircraft, truth: Truth) -> dict[str, Any]:
    """(a) and (b) of a flight as the truth file holds them."""
    local, ranges = local_derivatives(name, aircraft, truth)
    projected, nrmse = flight_projection(aircraft.model, aircraft, truth)
    return {"local": local, "local_range": ranges, "projection": projected, "projection_nrmse": nrmse}
