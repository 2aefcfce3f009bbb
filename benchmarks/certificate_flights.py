"""One simulated flight through one estimator: what the certificate keeps of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from accuracy import MAIN_DERIVATIVES

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import Aircraft, load_aircraft
from aircraft_sysid_ros.aircraft.frames import quaternion_from_euler, rotation_matrix
from aircraft_sysid_ros.aircraft.rigid_body import body_velocity_derivative
from aircraft_sysid_ros.config_files import config_path
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.estimation.lagged_moments import coloured_covariance
from aircraft_sysid_ros.identification.coefficients.layout import CoefficientSample
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.model_file import parameters_json
from aircraft_sysid_ros.identification.options import ParameterOptions
from aircraft_sysid_ros.identification.parameter_set import ParameterSet
from aircraft_sysid_ros.identification.trust import Trust
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.refinement.refine import RefineOptions, refine
from aircraft_sysid_ros.refinement.run_data import RunData
from aircraft_sysid_ros.simulation.dynamics import ATTITUDE, RATES, VELOCITY, Effect, motion
from aircraft_sysid_ros.simulation.flight import Setup, prepare
from aircraft_sysid_ros.simulation.manoeuvres import AILERON, ELEVATOR, RUDDER, THROTTLE, flight_plan
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, simulate_samples
from aircraft_sysid_ros.stamps import nanoseconds

Array = npt.NDArray[np.float64]
Record = dict[str, Any]

AIRS = ("none", "light")  # turbulence
DURATION = 60.0  # [s]
LOSS_DURATION = 120.0  # [s] of flights that lose, or keep, their elevator
LOSS_BETWEEN = (40.0, 80.0)  # [s] a random time in these
REMAINING = 0.5  # share of C_m,de and C_Z,de after the loss
STEP, LOSS_STEP = 0.2, 0.25  # [s] between looks at a live estimator
CLOSE, WRONG = 0.10, 0.25  # relative errors that count as near the truth, and as wrong
PATH_NAMES, PATH_STEP, PATH_SEEDS = ("Cm_alpha", "Cm_de", "Cl_p", "Cn_beta"), 1.0, 20
ALARM = 3.0  # standard errors before the loss: "+reset" resets beyond it


@cache
def the_aircraft() -> Aircraft:
    return load_aircraft(config_path("ultra_stick_25e.yaml"))


def fly(seed: int, air: str, duration: float = DURATION, effects: tuple[Effect, ...] = ()) -> SimulatedFlight:
    """The flight of one seed: wind of up to 6 m/s from any side, as in benchmarks/accuracy.py."""
    random = np.random.default_rng(1000 + seed)
    speed, direction = random.uniform(0.0, 6.0), random.uniform(-np.pi, np.pi)
    wind = (speed * np.cos(direction), speed * np.sin(direction), 0.0)
    return simulate_samples(the_aircraft(), seed, duration, wind=wind, turbulence=air, effects=effects)


# -- the aeroplane and its manoeuvres --------------------------------------------------------------------------------


def mode_periods(setup: Setup) -> dict[str, float]:
    """Periods [s] of the short period and the Dutch roll in trim: eigenvalues of the linearised motion.

    2 pi over the imaginary part; where a mode does not oscillate, over the magnitude.
    """
    level = np.concatenate([setup.trim.state[VELOCITY : VELOCITY + 3], np.zeros(3), [0.0, setup.trim.alpha]])
    level[:3] = rotation_matrix(setup.trim.state[ATTITUDE : ATTITUDE + 4]).T @ level[:3]
    step = 1e-5
    jacobian = np.empty((8, 8))
    for k in range(8):
        shift = step * np.eye(8)[k]
        jacobian[:, k] = (_rates_of(setup, level + shift) - _rates_of(setup, level - shift)) / (2.0 * step)
    found = {}
    for name, states in (("short_period", [0, 2, 4, 7]), ("dutch_roll", [1, 3, 5, 6])):
        values = np.linalg.eigvals(jacobian[np.ix_(states, states)])
        fastest = values[np.argmax(np.abs(values.imag) + 1e-6 * np.abs(values))]
        found[name] = float(2.0 * np.pi / (abs(fastest.imag) if abs(fastest.imag) > 1e-3 else abs(fastest)))
    return found


def _rates_of(setup: Setup, x: Array) -> Array:
    """d/dt of u v w [m/s], p q r [rad/s], roll and pitch [rad], in calm air with the controls of trim."""
    state = setup.trim.state.copy()
    attitude = quaternion_from_euler(x[6], x[7], 0.0)
    to_world = rotation_matrix(attitude)
    state[ATTITUDE : ATTITUDE + 4], state[VELOCITY : VELOCITY + 3] = attitude, to_world @ x[:3]
    state[RATES : RATES + 3] = x[3:6]
    acting = motion(setup.airframe, setup.place, state, np.zeros(3), 0.0)
    fall = to_world.T @ np.array([0.0, 0.0, setup.place.gravity])
    _, q, r = x[3:6]
    roll = x[3] + np.tan(x[7]) * (q * np.sin(x[6]) + r * np.cos(x[6]))
    pitch = q * np.cos(x[6]) - r * np.sin(x[6])
    velocity = body_velocity_derivative(acting.specific_force, x[3:6].copy(), x[:3].copy(), fall)
    return np.concatenate([velocity, acting.angular_acceleration, [roll, pitch]])


@cache
def first_moves() -> dict[str, float]:
    """When [s] the plan of a flight first excites each main derivative: elevator, aileron or rudder, throttle."""
    grid = np.arange(0.0, DURATION, 0.01)
    moved = flight_plan(grid, prepare(the_aircraft()).excitation).controls != 0.0
    first = grid[np.argmax(moved, axis=0)]
    lateral = min(first[AILERON], first[RUDDER])
    begin = {"CX": first[ELEVATOR], "CZ": first[ELEVATOR], "Cm": first[ELEVATOR]}
    result = {name: float(begin.get(name[:2], lateral)) for name in MAIN_DERIVATIVES}
    return {**result, "CX_Tc": float(first[THROTTLE])}


def elevator_moves_after(at: float) -> float:
    """Time [s] from ``at`` on at which the plan of a long flight moves the elevator."""
    grid = np.arange(0.0, LOSS_DURATION, 0.01)
    moved = flight_plan(grid, prepare(the_aircraft()).excitation).controls[:, ELEVATOR] != 0.0
    return float(grid[np.argmax(moved & (grid >= at))])


# -- live estimators -------------------------------------------------------------------------------------------------


class LiveRun:
    """A flight pushed through a live estimator in steps [s]: what it published at each.

    Where ``alarm`` says so of the time [s] and what is published, the estimator forgets all that it has learnt.
    """

    def __init__(
        self,
        flight: SimulatedFlight,
        options: ParameterOptions,
        step: float = STEP,
        alarm: Callable[[float, ParameterSet], bool] | None = None,
    ) -> None:
        self.pipeline = Pipeline(flight.aircraft, None, options)
        samples, begin = flight.samples, int(flight.biases.stamp[0])
        seconds = (samples.stamp[-1] - begin) * 1e-9
        self.step, self.time = step, np.arange(step, seconds, step)
        edges = np.searchsorted(samples.stamp, begin + (self.time * 1e9).astype(np.int64))
        self.cpu, self.points = 0.0, []
        published, alarms = [], []
        for now, low, high in zip(self.time, [0, *edges[:-1]], edges, strict=True):
            self._push(samples[low:high])
            estimates = self.pipeline.parameters.snapshot()
            alarms.append(int(self.pipeline.parameters.learning.changes.counts.sum()))
            published.append([[p.value, p.std, p.status] for p in estimates.parameters])
            if alarm is not None and alarm(now, estimates):
                self.pipeline.parameters.reset()
        self._push(samples[edges[-1] :])
        started = time.process_time()
        self.points.append(self.pipeline.flush()[1])
        self.cpu += time.process_time() - started
        self.value, self.std, status = np.moveaxis(np.array(published), 2, 0)  # (steps, parameters) each
        self.use, self.alarms = status == Trust.USE, np.array(alarms)
        self.final: ParameterSet = self.pipeline.parameters.snapshot()

    def _push(self, samples: Any) -> None:
        started = time.process_time()
        self.points.append(self.pipeline.push(samples)[1])
        self.cpu += time.process_time() - started


def options_of(method: str) -> ParameterOptions:
    """Options of "rls"; "rls+keep" and "rls+reset" do not relearn by themselves."""
    estimator, _, other = method.partition("+")
    return ParameterOptions(estimator=estimator, relearn=not other)


def stays_close(time: Array, value: Array, truth: float) -> float | None:
    """First of the times [s] (n,) from which on value (n,) stays within CLOSE of the truth; None: not at the end."""
    far = ~(np.abs(value / truth - 1.0) <= CLOSE)  # NaN is far
    if far[-1]:
        return None
    return float(time[np.flatnonzero(far)[-1] + 1]) if far.any() else float(time[0])


def live_record(flight: SimulatedFlight, air: str, method: str) -> tuple[Record, LiveRun]:
    """Final parameters of a live estimator, and when each main derivative was near the truth for good."""
    run = LiveRun(flight, options_of(method))
    record = record_of(run, flight, air, method)
    names, truth = list(flight.aircraft.model.parameter_names), flight.aircraft.coefficients
    record["close"] = {
        name: stays_close(run.time, run.value[:, names.index(name)], truth[name]) for name in MAIN_DERIVATIVES
    }
    if flight.seed < PATH_SEEDS:
        record["path"] = path_of(run, names)
    return record, run


def record_of(run: LiveRun, flight: SimulatedFlight, air: str, method: str) -> Record:
    """Final parameters."""
    final = run.final.parameters
    record = {
        "seed": flight.seed, "air": air, "method": method, "cpu": run.cpu,
        "value": [p.value for p in final], "std": [p.std for p in final],
        "excitation": [p.excitation for p in final], "use": [int(p.status == Trust.USE) for p in final],
    }  # fmt: skip
    if method == "rls":
        record["white"], record["coloured"] = uncorrected(run.pipeline.parameters)
    return record


def path_of(run: LiveRun, names: list[str]) -> dict[str, list[float]]:
    """Values of some parameters every PATH_STEP [s]."""
    every = round(PATH_STEP / run.step)
    return {name: run.value[every - 1 :: every, names.index(name)].tolist() for name in PATH_NAMES}


def uncorrected(parameters: Identifier) -> tuple[list[float], list[float]]:
    """Standard errors of least squares as for white residuals (4.7), and as corrected for coloured ones alone."""
    white, coloured = [], []
    for axis, name in enumerate(AXES):
        part = parameters.model.axis_slice(name)
        n = part.stop - part.start
        sums = np.ascontiguousarray(parameters.learning.least_squares.state.sums[axis, :, : n + 2, : n + 2])
        both = coloured_covariance(sums, parameters.learning.least_squares.state.theta[axis, :n].copy())
        coloured += np.sqrt(np.diag(both[0])).tolist()
        white += np.sqrt(np.diag(both[1])).tolist()
    return white, coloured


# -- after the flight ------------------------------------------------------------------------------------------------


def run_data(flight: SimulatedFlight) -> tuple[RunData, Record]:
    """The run folder of a flight, in memory, and its record of recursive least squares."""
    record, live = live_record(flight, "", "rls")
    points, state = np.vstack(live.points), live.pipeline.state.summary()
    epoch = live.pipeline.state.epoch
    assert epoch is not None
    parameters = {p["name"]: p for p in parameters_json(live.pipeline.parameters)["parameters"]}
    biases = np.array([*state["accelerometer_bias"], *state["gyro_bias"]])
    stamp = nanoseconds(points[:, CoefficientSample.TIME], epoch)
    terms = points[:, CoefficientSample.TERMS :]
    noise = live.pipeline.parameters.learning.noise_of(points)
    measured = points[:, CoefficientSample.MEASURED]
    return RunData(flight.aircraft, flight.samples, parameters, biases, stamp, measured, terms, noise=noise), record


def refined_record(run: RunData, live: Record, air: str, method: str) -> Record:
    """Parameters refined after the flight with the options of the command."""
    started = time.process_time()
    record = {"seed": live["seed"], "air": air, "method": method}
    try:
        content = refine(run, method, RefineOptions()).content
    except InputError as error:
        return {**record, "failed": str(error)}
    found = content["parameters"]
    return {
        **record, "cpu": time.process_time() - started,
        "value": [p["value"] for p in found],
        "std": [np.nan if p["std"] is None else p["std"] for p in found],
        "excitation": live["excitation"], "use": [int(p["status"] == "USE") for p in found],
        "converged": content["converged"], "seconds": content["seconds_fitted"],
    }  # fmt: skip


# -- a lost elevator -------------------------------------------------------------------------------------------------


def loss_time(seed: int) -> float:
    return float(np.random.default_rng([seed, 0x1055]).uniform(*LOSS_BETWEEN))


def loss_effects(at: float) -> tuple[Effect, ...]:
    """The elevator loses half of what it does at a time [s] of the flight."""
    gone, truth = REMAINING - 1.0, the_aircraft().coefficients
    text = f"max(sign(time-{at:.3f}),0)*de"
    return tuple(Effect(axis, text, gone * truth[f"{axis}_de"]) for axis in ("Cm", "CZ"))


class ElevatorAlarm:
    """True once: when C_m,de leaves the interval of ALARM standard errors that it had at a time [s]."""

    def __init__(self, index: int, at: float) -> None:
        self._index, self._at, self._last, self._done = index, at, (np.nan, np.nan), False

    def __call__(self, now: float, estimates: ParameterSet) -> bool:
        newest = estimates.parameters[self._index]
        if now <= self._at:
            self._last = (newest.value, newest.std)
            return False
        before, std = self._last
        rings = not self._done and abs(newest.value - before) > ALARM * std
        self._done |= rings
        return rings


def loss_record(flight: SimulatedFlight, air: str, method: str, at: float, lost: bool) -> Record:
    """How a live estimator answers to the loss at a time [s]; or, without one, whether it cries wolf."""
    names = list(flight.aircraft.model.parameter_names)
    alarm = ElevatorAlarm(names.index("Cm_de"), at) if method.endswith("+reset") else None
    run = LiveRun(flight, options_of(method), LOSS_STEP, alarm)
    truth, k = flight.aircraft.coefficients["Cm_de"], names.index("Cm_de")
    after = run.time > at
    value, std = run.value[:, k], run.std[:, k]
    now = REMAINING * truth if lost else truth
    close = stays_close(run.time[after], value[after], now)
    use = run.use[:, k] & after
    alarms = np.diff(run.alarms, prepend=0)
    record = {
        "seed": flight.seed, "air": air, "method": method, "lost": lost, "at": at,
        "moves": elevator_moves_after(at) - at,
        "alarm": _delay(run.time, after & (alarms > 0), at), "alarms": int(run.alarms[-1]),
        "false_alarms": int(alarms[~after].sum() if lost else run.alarms[-1]),
        "wrong_use": float(LOSS_STEP * np.sum(use & ~(np.abs(value / now - 1.0) <= WRONG))),
        "wrong_sign": bool(np.any(use & (value / now < 0.0))),
        "in_use": _delay(run.time, use & (run.time > at + 2.0) & ~(np.abs(value / now - 1.0) > CLOSE), at),
        "close": None if close is None else close - at,
        "end": value[-1] / now, "end_z": (value[-1] - now) / std[-1],
    }  # fmt: skip
    if lost and flight.seed < PATH_SEEDS:
        record["path"] = path_of(run, names)["Cm_de"]
    return record


def _delay(time: Array, alarm: npt.NDArray[np.bool_], since: float) -> float | None:
    return float(time[np.argmax(alarm)] - since) if alarm.any() else None
