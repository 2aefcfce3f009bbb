"""The same test flight in a simulator that this package did not write: JSBSim, with an aeroplane of its own.

Its aerodynamics are tables, slipstream and propeller effects, its earth is round and turns: nothing in it
follows the textbook model, and its coefficients are known only through the forces and moments that it
reports.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft import earth, rigid_body
from aircraft_sysid_ros.aircraft.aerodynamic_model import AerodynamicModel, textbook_model
from aircraft_sysid_ros.aircraft.configuration import Aircraft, aircraft_from_dict
from aircraft_sysid_ros.aircraft.frames import continuous, quaternion_from_euler, rotation_matrix
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.installation import MissingExtra
from aircraft_sysid_ros.sensors.truth import PROPELLER_SPEED, THROTTLE, THRUST, Truth
from aircraft_sysid_ros.simulation.autopilot import (
    Autopilot,
    autopilot_controls,
    autopilot_for,
    excitation_for,
)
from aircraft_sysid_ros.simulation.dynamics import ATTITUDE, POSITION, STATE_SIZE, VELOCITY
from aircraft_sysid_ros.simulation.flight import LATITUDE, LONGITUDE
from aircraft_sysid_ros.simulation.manoeuvres import Excitation, Plan, flight_plan, level_plan, orthogonal_multisines
from aircraft_sysid_ros.simulation.trim import Derivatives, Trim, level_state

Array = npt.NDArray[np.float64]

RATE = 200.0  # [Hz]
DEFAULT_MODEL = "c172p"
#: Aeroplanes of the JSBSim package that trim and fly well: calibrated airspeed [kt] of the flight.
MODELS = {"c172p": 95.0, "c182": 110.0, "J3Cub": 60.0}
FOOT, INCH, POUND, SLUG = 0.3048, 0.0254, 4.4482216152605, 14.593902937
GROUND, ALTITUDE = 290.0, 900.0  # [m]
_NED = ("north", "east", "down")
_PROPELLER = "propulsion/engine/propeller-rpm"
#: What is logged: group, property, factor to SI.
_LOG: tuple[tuple[str, str, float], ...] = (
    ("place", "position/lat-geod-rad", 1.0),
    ("place", "position/long-gc-rad", 1.0),
    ("place", "position/geod-alt-ft", FOOT),
    *(("velocity", f"velocities/v-{axis}-fps", FOOT) for axis in _NED),
    *(("euler", f"attitude/{angle}-rad", 1.0) for angle in ("phi", "theta", "psi")),
    *(("rates", f"velocities/{axis}i-rad_sec", 1.0) for axis in "pqr"),
    *(("angular_acceleration", f"accelerations/{axis}dot-rad_sec2", 1.0) for axis in "pqr"),
    *(("force", f"forces/fb{axis}-total-lbs", POUND) for axis in "xyz"),
    *(("moment", f"moments/{axis}-total-lbsft", POUND * FOOT) for axis in "lmn"),
    *(("air_velocity", f"velocities/{axis}-aero-fps", FOOT) for axis in "uvw"),
    *(("wind", f"atmosphere/total-wind-{axis}-fps", FOOT) for axis in _NED),
    ("density", "atmosphere/rho-slugs_ft3", SLUG / FOOT**3),
    ("static_pressure", "atmosphere/P-psf", POUND / FOOT**2),
    ("height", "position/h-agl-ft", FOOT),
    ("mass", "inertia/mass-slugs", SLUG),
    ("controls", "fcs/elevator-pos-rad", 1.0),
    ("controls", "fcs/left-aileron-pos-rad", 1.0),
    ("controls", "fcs/rudder-pos-rad", 1.0),
    ("controls", "fcs/flap-pos-rad", 1.0),
    ("controls", "fcs/throttle-pos-norm", 1.0),
    ("controls", "propulsion/engine/thrust-lbs", POUND),
    ("controls", _PROPELLER, 2.0 * np.pi / 60.0),
)
#: Columns of the log by group.
_AT = {group: np.flatnonzero([g == group for g, _, _ in _LOG]) for group, _, _ in _LOG}
COMMANDS = ("fcs/elevator-cmd-norm", "fcs/aileron-cmd-norm", "fcs/rudder-cmd-norm", "fcs/throttle-cmd-norm")
#: Of the controls above, those that the commands move.
_MOVED = [0, 1, 2, THROTTLE]
# The probe: seconds, and peaks of the commands.
_PROBE_TIME, _PROBE_SIZE = 16.0, np.array([0.04, 0.05, 0.05, 0.10])

#: JSBSim's derivatives of the flow angles, and those of ours that aeroplanes read instead.
ALPHA_DOT, BETA_DOT = "flow/alphadot-rad_sec", "flow/betadot-rad_sec"
FLOW_RATES = {"aero/alphadot-rad_sec": ALPHA_DOT, "aero/betadot-rad_sec": BETA_DOT}

SETTLING = 20.0  # [s]
_WHEELS = 1.5  # [m] height of the centre of gravity at which they touch the ground
_ADAMS_BASHFORTH_2 = 3  # number of the method in JSBSim; its default for turning is Euler's
#: Commands (4,) of step i from its row of the log.
Command = Callable[[int, Array], Array]


class OutOfControlError(InputError):
    """A flight that did not stay in the air, and from when [s] on."""

    def __init__(self, name: str, time: float) -> None:
        super().__init__(f"the JSBSim aircraft '{name}' goes out of control after {time:.1f} s")
        self.time = time


@dataclass(frozen=True)
class JsbsimSetup:
    """A JSBSim aeroplane that was probed: its file, how commands move its controls, trim and autopilot."""

    name: str
    aircraft: Aircraft
    trim: Trim
    trim_commands: Array  # (4,)
    control_per_command: Array  # (4,) rad or throttle per whole command
    slopes: Derivatives
    qbar: float  # [Pa]
    autopilot: Autopilot
    speed: float  # calibrated [kt]


def prepare_jsbsim(name: str = DEFAULT_MODEL, speed: float | None = None) -> JsbsimSetup:
    """Trim a JSBSim aeroplane, move its controls a little for some seconds, and fit gains to what happens.

    ``speed``: calibrated airspeed [kt]; an aeroplane that is none of MODELS needs one.
    """
    aircraft = aircraft_from_dict(jsbsim_aircraft_file(name, speed))
    executive = trimmed(name, speed=speed)
    trim_commands = np.array([executive[command] for command in COMMANDS])
    time = np.arange(int(_PROBE_TIME * RATE)) / RATE
    commands = trim_commands + _PROBE_SIZE * orthogonal_multisines(time, _PROBE_TIME, 1.0)
    truth = truth_of_log(aircraft, time, _run(executive, lambda i, _: commands[i], np.zeros((len(time), 3))))
    moved = np.ascontiguousarray(truth.controls[:, _MOVED])
    gains = [_slope(commands[:, i], moved[:, i]) for i in range(4)]
    start = truth[:1]
    trim = Trim(
        float(start.airspeed[0]), float(start.alpha[0]), float(start.beta[0]), moved[0],
        level_state(float(start.airspeed[0]), float(start.alpha[0]), float(start.beta[0]), moved[0]),
    )  # fmt: skip
    slopes = fitted_derivatives(aircraft, truth)
    qbar = float(0.5 * start.density[0] * start.airspeed[0] ** 2)
    autopilot = autopilot_for(aircraft, trim, slopes)
    known = MODELS[name] if speed is None else speed
    return JsbsimSetup(name, aircraft, trim, trim_commands, np.array(gains), slopes, qbar, autopilot, known)


def fly_jsbsim(
    setup: JsbsimSetup,
    wind: Array,
    plan: Plan | None = None,
    *,
    folder: Path | None = None,
    ground: float = GROUND,
    adjust: Callable[[Any, int, Array], Array] | None = None,
) -> Truth:
    """A test flight in a wind NED (n, 3) [m/s] at RATE; InputError when it does not stay in the air.

    ``folder`` holds the aeroplane's files instead of JSBSim's own; ``ground`` [m] is its altitude. ``adjust`` is given
    the executive, the step and the commands (4,) before every step, and returns the commands that are set.
    """
    time = np.arange(len(wind)) / RATE
    if plan is None:
        plan = flight_plan(time, excitation_of(setup))
    executive = trimmed(setup.name, folder, ground, setup.speed)
    _settle(executive, setup, wind[0])
    pilot = _pilot(setup, plan)

    def command(i: int, row: Array) -> Array:
        wanted = pilot(i, row)
        return wanted if adjust is None else adjust(executive, i, wanted)

    truth = truth_of_log(setup.aircraft, time, _run(executive, command, wind))
    lost = ~np.isfinite(truth.airspeed) | (truth.height < _WHEELS) | (np.abs(truth.alpha) > 0.6)
    if lost.any():
        raise OutOfControlError(setup.name, float(time[np.argmax(lost)]))
    return truth


def excitation_of(setup: JsbsimSetup) -> Excitation:
    """Sizes of manoeuvres that suit the aeroplane."""
    return excitation_for(setup.aircraft, setup.qbar, setup.trim, setup.slopes)


def jsbsim_aircraft_file(name: str = DEFAULT_MODEL, speed: float | None = None) -> dict[str, Any]:
    """Content of an aircraft file for a JSBSim aeroplane; without coefficients, which nobody knows."""
    executive = trimmed(name, speed=speed)

    def inertia(axes: str) -> float:
        return float(executive[f"inertia/i{axes}-slugs_ft2"] * SLUG * FOOT**2)

    arm = [executive[f"inertia/cg-{axis}-in"] - executive[f"metrics/aero-rp-{axis}-in"] for axis in "xyz"]
    return {
        "name": f"JSBSim {name}",
        "mass": float(executive["inertia/mass-slugs"] * SLUG),
        "wing_area": float(executive["metrics/Sw-sqft"] * FOOT**2),
        "span": float(executive["metrics/bw-ft"] * FOOT),
        "chord": float(executive["metrics/cbarw-ft"] * FOOT),
        # JSBSim reports the element of the matrix, which is the negative of the product in (6.19).
        "inertia": {"xx": inertia("xx"), "yy": inertia("yy"), "zz": inertia("zz"), "xz": -inertia("xz")},
        # Structural axes point aft, right and up.
        "aerodynamic_reference": [arm[0] * INCH, -arm[1] * INCH, arm[2] * INCH],
        "imu_position": [0.3, 0.1, 0.1],
        "air_data_position": [0.2, 4.0, 0.1],
        "gps_position": [-0.5, 0.0, -1.0],
        "ground_altitude": GROUND,
        "magnetic_declination": 0.0,
        "trim_airspeed": float(executive["velocities/vt-fps"] * FOOT),
    }


def signals_of(aircraft: Aircraft, truth: Truth) -> dict[str, Array]:
    """Signals (n,) that the terms of a model read, from the truth; without flaps, mach, height and beta_dot."""
    speed = truth.airspeed
    qbar = 0.5 * truth.density * speed**2
    half_span = aircraft.span / (2.0 * speed)
    signals = {
        "alpha": truth.alpha, "beta": truth.beta, "de": truth.controls[:, 0], "da": truth.controls[:, 1],
        "dr": truth.controls[:, 2], "Tc": truth.controls[:, THRUST] / (qbar * aircraft.wing_area),
        "p": truth.rates[:, 0] * half_span, "q": truth.rates[:, 1] * aircraft.chord / speed,
        "r": truth.rates[:, 2] * half_span, "V": speed, "qbar": qbar, "throttle": truth.controls[:, THROTTLE],
        "propeller_speed": truth.controls[:, PROPELLER_SPEED],
        "alpha_dot": kinematic_alpha_dot(truth) * aircraft.chord / speed,
    }  # fmt: skip
    return signals


def kinematic_alpha_dot(truth: Truth) -> Array:
    """d alpha / dt (n,) [rad/s] of (6.16)-(6.18) in a steady wind, which is what the aeroplanes read (FLOW_RATES).

    The wander of the wind moves alpha from step to step too: its derivative would be noise.
    """
    weight = earth.gravity(float(truth.origin[0]), float(truth.origin[2]))
    gravity = np.array([rotation_matrix(q)[2] * weight for q in truth.quaternion])
    change = truth.specific_force + gravity - np.cross(truth.rates, truth.air_velocity)
    u, w = truth.air_velocity[:, 0], truth.air_velocity[:, 2]
    return (u * change[:, 2] - w * change[:, 0]) / (u * u + w * w)


def projection(model: AerodynamicModel, signals: dict[str, Array], coefficients: Array) -> dict[str, float]:
    """Parameters of a model whose coefficients are nearest to true ones (n, 6) in the least-squares sense."""
    fitted = [
        np.linalg.lstsq(model.regressors(axis, signals), coefficients[:, i], rcond=None)[0]
        for i, axis in enumerate(model.terms)
    ]
    return dict(zip(model.parameter_names, np.concatenate(fitted).tolist(), strict=True))


def fitted_derivatives(aircraft: Aircraft, truth: Truth) -> Derivatives:
    """Derivatives by a least-squares fit of the terms of (6.8)-(6.13) to the coefficients of a flight."""
    found = projection(textbook_model(), signals_of(aircraft, truth), truth.coefficients)
    scale = 0.5 * truth.density * truth.airspeed**2 * aircraft.wing_area
    speed, force_rate = float(truth.airspeed[0]), float(scale[0]) / aircraft.mass
    thrust_per_throttle = float(truth.controls[0, THRUST] / truth.controls[0, THROTTLE])
    return Derivatives(
        lift_rate=-found["CZ_alpha"] * force_rate / speed,
        thrust_rate=thrust_per_throttle / aircraft.mass,
        pitch_stiffness=found["Cm_alpha"],
        pitch_damping=found["Cm_q"],
        pitch_control=found["Cm_de"],
        roll_damping=found["Cl_p"],
        roll_control=found["Cl_da"],
        yaw_stiffness=found["Cn_beta"],
        yaw_control=found["Cn_dr"],
    )


def _slope(x: Array, y: Array) -> float:
    return float(np.polyfit(x - x.mean(), y - y.mean(), 1)[0])


def trimmed(name: str, folder: Path | None = None, ground: float = GROUND, speed: float | None = None) -> Any:
    """JSBSim executive in straight level trim; InputError when it is not installed or does not trim.

    The files of the aeroplane are those of JSBSim, or in ``folder``/name; ``ground`` [m] is the terrain's altitude, and
    ``speed`` [kt] the calibrated airspeed, by default that of MODELS.
    """
    try:
        import jsbsim
    except ImportError:
        raise MissingExtra("aeroplanes of JSBSim", "jsbsim", "simulation") from None
    speed = MODELS.get(name) if speed is None else speed
    if speed is None:
        raise InputError(f"unknown JSBSim aircraft '{name}': use one of {' '.join(MODELS)}")
    os.environ.setdefault("JSBSIM_DEBUG", "0")  # or it prints a banner on standard output
    executive = jsbsim.FGFDMExec(None)
    executive.set_debug_level(0)
    with tempfile.TemporaryDirectory() as made:
        source = folder or Path(executive.get_root_dir()) / "aircraft"
        mended_flow_rates(source / name, Path(made) / name)
        executive.set_aircraft_path(made)
        executive.load_model(name)
    executive.disable_output()  # some models write a CSV file into the working directory
    executive.set_dt(1.0 / RATE)
    for quantity in ("rate", "position"):  # or rates would lag half a step behind the moments that are logged
        executive[f"simulation/integrator/{quantity}/rotational"] = _ADAMS_BASHFORTH_2
    for key, value in {
        "ic/lat-geod-rad": LATITUDE, "ic/long-gc-rad": LONGITUDE, "ic/terrain-elevation-ft": ground / FOOT,
        "ic/h-sl-ft": ALTITUDE / FOOT, "ic/psi-true-deg": 0.0, "ic/gamma-deg": 0.0,
        "ic/vc-kts": speed,
        "gear/gear-cmd-norm": 0.0, "fcs/mixture-cmd-norm": 0.87, "fcs/throttle-cmd-norm": 0.6,
    }.items():  # fmt: skip
        executive[key] = value
    executive.run_ic()
    executive["propulsion/set-running"] = -1
    executive["propulsion/fuel_freeze"] = 1
    try:
        executive.do_trim(1)
    except jsbsim.TrimFailureError:
        raise InputError(f"the JSBSim aircraft '{name}' does not trim at {speed:g} kt") from None
    return executive


def mended_flow_rates(source: Path, target: Path) -> None:
    """A copy of an aeroplane's folder that reads the derivatives of the flow angles from FLOW_RATES.

    JSBSim 1.2 works them out from the inertial velocity: in a steady wind W a roll or a pitch then seems to change
    alpha by (p W_y - q W_x) / V, which the air does not know.
    """
    shutil.copytree(source, target)
    path = target / f"{target.name}.xml"
    text = path.read_text(encoding="utf8", errors="replace")
    for old, new in FLOW_RATES.items():
        text = text.replace(old, new)
    declared = "".join(f'<property value="0">{name}</property>' for name in FLOW_RATES.values())
    text = text.replace("</fdm_config>", f'<system name="flow rates">{declared}</system></fdm_config>')
    path.write_text(text, encoding="utf8")


def set_flow_rates(executive: Any, row: Array) -> None:
    """Set FLOW_RATES for the next step, in a steady wind, from a row of the log: (6.16)-(6.18)."""
    wind = rotation_matrix(quaternion_from_euler(*row[_AT["euler"]])).T @ row[_AT["wind"]]
    inertial = FOOT * np.array([executive[f"accelerations/{axis}dot-ft_sec2"] for axis in "uvw"])
    du, dv, dw = inertial + rigid_body.cross(row[_AT["rates"]], wind)
    u, v, w = row[_AT["air_velocity"]]
    along = u * u + w * w
    alpha_dot = (u * dw - w * du) / along
    beta_dot = (dv * along - v * (u * du + w * dw)) / ((along + v * v) * np.sqrt(along))
    executive[ALPHA_DOT], executive[BETA_DOT] = alpha_dot, beta_dot


def _settle(executive: Any, setup: JsbsimSetup, wind: Array) -> None:
    """Let the wind NED (3,) [m/s] rise from nothing while the autopilot flies, before the flight begins."""
    time = np.arange(int(SETTLING * RATE)) / RATE
    rise = np.clip(time / (0.5 * SETTLING), 0.0, 1.0)[:, None] * wind
    still = level_plan(time, setup.trim.airspeed)
    _run(executive, _pilot(setup, still), rise)


def _pilot(setup: JsbsimSetup, plan: Plan) -> Command:
    """Commands of the autopilot and a plan, from a row of the log."""

    def command(i: int, row: Array) -> Array:
        state = np.zeros(STATE_SIZE)
        state[POSITION + 2] = ALTITUDE - row[_AT["place"]][2] + plan.height[i]
        state[VELOCITY : VELOCITY + 3] = row[_AT["velocity"]]
        state[ATTITUDE : ATTITUDE + 4] = quaternion_from_euler(*row[_AT["euler"]])
        airspeed = float(np.linalg.norm(row[_AT["air_velocity"]]))
        wanted = autopilot_controls(setup.autopilot, state, airspeed, plan.bank[i], plan.airspeed[i])
        change = (wanted + plan.controls[i] - setup.trim.controls) / setup.control_per_command
        return np.clip(setup.trim_commands + change, [-1.0, -1.0, -1.0, 0.0], 1.0)

    return command


def _run(executive: Any, command: Command, wind: Array) -> Array:
    """Fly len(wind) steps and log them in SI, shape (n, columns of _LOG)."""
    rows = np.empty((len(wind), len(_LOG)))
    for i in range(len(wind)):
        rows[i] = log_row(executive)
        set_flow_rates(executive, rows[i])
        for name, value in zip(COMMANDS, command(i, rows[i]), strict=True):
            executive[name] = value
        following = wind[min(i + 1, len(wind) - 1)] / FOOT
        for axis, value in zip(_NED, following, strict=True):
            executive[f"atmosphere/wind-{axis}-fps"] = value
        executive.run()
    return rows


def log_row(executive: Any) -> Array:
    """What JSBSim reports now, in SI, shape (columns of _LOG,); a jet has no propeller."""
    return np.array([_value(executive, name) * factor for _, name, factor in _LOG])


def _value(executive: Any, name: str) -> float:
    try:
        return float(executive[name])
    except KeyError:
        if name != _PROPELLER:
            raise
        return 0.0


def truth_of_log(aircraft: Aircraft, time: Array, log: Array) -> Truth:
    """Truth of a log, its positions along the way from where it begins."""
    part = {group: np.ascontiguousarray(log[:, columns]) for group, columns in _AT.items()}  # as kernels were compiled
    origin = part["place"][0].copy()
    u, v, w = part["air_velocity"].T
    speed, density = np.sqrt(u * u + v * v + w * w), part["density"][:, 0]
    qbar = 0.5 * density * speed**2
    coefficients = [
        rigid_body.coefficients_of(
            force, rigid_body.moment_at_reference(moment, force, aircraft.aerodynamic_reference), pressure,
            aircraft.wing_area, aircraft.span, aircraft.chord,
        )
        for force, moment, pressure in zip(part["force"], part["moment"], qbar, strict=True)
    ]  # fmt: skip
    return Truth(
        time=time,
        position=earth.ned_along(part["place"], origin),
        velocity=part["velocity"],
        quaternion=continuous(np.array([quaternion_from_euler(a[0], a[1], a[2]) for a in part["euler"]])),
        rates=part["rates"],
        angular_acceleration=part["angular_acceleration"],
        specific_force=part["force"] / part["mass"],
        air_velocity=part["air_velocity"],
        airspeed=speed,
        alpha=np.arctan2(w, u),
        beta=np.arctan2(v, np.hypot(u, w)),
        density=density,
        static_pressure=part["static_pressure"][:, 0],
        height=part["height"][:, 0],
        controls=part["controls"],
        inputs=np.empty((len(time), 0)),
        wind=part["wind"],
        coefficients=np.array(coefficients),
        origin=origin,
    )
