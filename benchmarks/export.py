"""Exported aeroplanes flown by JSBSim against flights that they were not learnt from; what other targets lose; gains.

    python benchmarks/export.py [--duration 120] [--out benchmarks/results/export.json]

Three aeroplanes: the textbook one, and two of JSBSim, whose aerodynamics are not those of the 32 terms. Each is learnt
from one flight. Its exported file is then loaded into JSBSim, which
- is held at the true states of another flight: its forces and moments against ours, and against the true ones;
- flies pieces of that flight freely, from the true state at their start and with the true surfaces and thrust. So does
  our own simulator with the same parameters: where both are equally far from the flight the file loses nothing.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aircraft_sysid_ros.aircraft import earth, rigid_body
from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.frames import euler_angles, rotation_matrix
from aircraft_sysid_ros.diagnosis.model_versions.versions import open_run
from aircraft_sysid_ros.errors import InputError
from aircraft_sysid_ros.export import gazebo
from aircraft_sysid_ros.export.ardupilot_sitl import export_ardupilot_sitl
from aircraft_sysid_ros.export.from_run import learnt_model
from aircraft_sysid_ros.export.gazebo import export_gazebo
from aircraft_sysid_ros.export.jsbsim import FOOT, POUND, SURFACES, THRUST, export_jsbsim, property_of
from aircraft_sysid_ros.export.learnt_model import LearntModel, thrust_part
from aircraft_sysid_ros.export.level_flight import LevelFlight, airspeeds_of, level_flight
from aircraft_sysid_ros.export.rate_loops import PITCH, ROLL, Actuator, RateLoop, design
from aircraft_sysid_ros.export.targets import reached
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.run_writer import RunWriter
from aircraft_sysid_ros.sensors.sensor_models import SensorOptions
from aircraft_sysid_ros.sensors.truth import THRUST as THRUST_COLUMN
from aircraft_sysid_ros.sensors.truth import Truth
from aircraft_sysid_ros.simulation.dynamics import (
    ATTITUDE,
    CONTROLS,
    POSITION,
    RATES,
    STATE_SIZE,
    VELOCITY,
    Airframe,
    Place,
    airframe_of,
    motion,
    runge_kutta_step,
)
from aircraft_sysid_ros.simulation.jsbsim_flight import signals_of
from aircraft_sysid_ros.simulation.simulated_flight import (
    SimulatedFlight,
    default_aircraft,
    simulate_jsbsim_samples,
    simulate_samples,
)

Array = npt.NDArray[np.float64]

AEROPLANES = ("textbook", "c172p", "J3Cub")
LEARNT_SEED, HELD_OUT_SEED = 5, 1005
STEP = 1.0 / 200.0  # [s] of both simulators
PIECE, EVERY = 2.0, 4.0  # [s] of free flight, and from start to start
OUTPUTS = ("u", "v", "w", "p", "q", "r")
LEAST_TIME = 3.0  # [s] of a flight before its first piece
_CALM = np.zeros(3)
#: Flights that tell little: seconds, noise of the sensors over the usual one, turbulence.
POOR = tuple((d, n, t) for d in (25.0, 45.0) for n in (1.0, 1.5, 2.5) for t in ("none", "moderate"))
#: Draws of the covariance on which gains are judged, other ones than those of the design.
GAIN_DRAWS, GAIN_SEED = 100, 7


def fly(name: str, seed: int, duration: float) -> SimulatedFlight:
    """A flight of an aeroplane in still air."""
    calm: dict[str, Any] = {"wind": (0.0, 0.0, 0.0), "wind_walk": 0.0}
    if name == "textbook":
        return simulate_samples(default_aircraft(), seed, duration, **calm)
    return simulate_jsbsim_samples(name, seed, duration, **calm)


def learn(flight: SimulatedFlight, folder: Path) -> LearntModel:
    """The model of a run of the flight."""
    pipeline, path = Pipeline(flight.aircraft), folder / "run"
    with RunWriter(path, flight.aircraft) as writer:
        for rows, points in (pipeline.push(flight.samples), pipeline.flush()):
            writer.add_rows(rows)
            writer.add_points(points)
        writer.add_samples(flight.samples)
        writer.finish(pipeline.state, pipeline.parameters, pipeline.state.flight_time, time.perf_counter())
    run = open_run(path)
    return learnt_model(run, run.current)


class ExportedAeroplane:
    """The exported file in JSBSim."""

    def __init__(self, learnt: LearntModel, content: str) -> None:
        import jsbsim

        self.learnt, self.executive = learnt, jsbsim.FGFDMExec(None)
        self.executive.set_debug_level(0)
        self.executive.set_dt(STEP)  # before it is loaded: filters are made for a step
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / "exported"
            place.mkdir()
            (place / "exported.xml").write_text(content, encoding="utf8")
            self.executive.set_aircraft_path(folder)
            assert self.executive.load_model("exported")
        for quantity in ("rate", "position"):
            self.executive[f"simulation/integrator/{quantity}/rotational"] = 3  # Adams-Bashforth of second order

    def put(self, truth: Truth, i: int) -> None:
        """Into the air at a true state, in still air."""
        e = self.executive
        e["ic/lat-geod-rad"], e["ic/long-gc-rad"] = truth.origin[0], truth.origin[1]
        e["ic/terrain-elevation-ft"] = 0.0
        e["ic/h-sl-ft"] = (truth.origin[2] - truth.position[i, 2]) / FOOT
        for name, angle in zip(("phi", "theta", "psi-true"), euler_angles(truth.quaternion[i : i + 1])[0], strict=True):
            e[f"ic/{name}-rad"] = angle
        for axis, speed in zip("uvw", truth.air_velocity[i], strict=True):
            e[f"ic/{axis}-fps"] = speed / FOOT
        for axis, rate in zip("pqr", truth.rates[i], strict=True):
            e[f"ic/{axis}-rad_sec"] = rate
        self.command(truth, i)
        e.set_dt(STEP)  # while it was suspended it had none
        for _ in range(2):  # the first one moves the surfaces
            e.run_ic()

    def command(self, truth: Truth, i: int) -> None:
        """True surfaces and thrust."""
        for (_, _, _, in_rad), value in zip(SURFACES, truth.controls[i], strict=False):
            self.executive[in_rad] = value
        self.executive[THRUST] = truth.controls[i, THRUST_COLUMN]

    def coefficients(self, truth: Truth, i: int) -> tuple[Array, Array]:
        """JSBSim's C_X … C_n (6,) at a true state, and ours at the signals that JSBSim has there."""
        e, aircraft = self.executive, self.learnt.aircraft
        self.put(truth, i)
        e.suspend_integration()
        e.run()
        e.run()
        force = POUND * np.array([e[f"forces/fb{axis}-aero-lbs"] for axis in "xyz"])
        moment = POUND * FOOT * np.array([e[f"moments/{axis}-aero-lbsft"] for axis in "lmn"])
        theirs = rigid_body.coefficients_of(
            force, rigid_body.moment_at_reference(moment, force, aircraft.aerodynamic_reference),
            e["aero/qbar-psf"] * POUND / FOOT**2, aircraft.wing_area, aircraft.span, aircraft.chord,
        )  # fmt: skip
        names = self.learnt.model.signal_names
        row = np.full(self.learnt.signals.shape[1], np.nan)
        for name in (*self.learnt.ranges, *self.learnt.model.signals_used):
            row[names.index(name)] = e[property_of(name)]
        ours = self.learnt.coefficients_of(self.learnt.terms_on(row[None]))[0]
        return theirs, ours

    def respond(self, truth: Truth) -> Array:
        """OUTPUTS (n, 6) of a free flight from the first instant, with the surfaces and the thrust of the others."""
        e, out = self.executive, np.empty((len(truth), 6))
        self.put(truth, 0)
        for i in range(len(truth)):
            out[i, :3] = [FOOT * e[f"velocities/{axis}-fps"] for axis in "uvw"]
            out[i, 3:] = [e[f"velocities/{axis}-rad_sec"] for axis in "pqr"]
            self.command(truth, min(i + 1, len(truth) - 1))  # it moves on first, and then looks at the surfaces
            e.run()
        return out


class OwnAeroplane:
    """The same parameters in the simulator of this package, surfaces where they are commanded."""

    def __init__(self, learnt: LearntModel, values: Array | None = None) -> None:
        values = learnt.values if values is None else values
        names = learnt.model.parameter_names
        aircraft = replace(learnt.aircraft, coefficients=dict(zip(names, values.tolist(), strict=True)))
        self.airframe: Airframe = airframe_of(aircraft)._replace(actuator_rates=np.zeros(4))

    def controls(self, truth: Truth, i: int) -> Array:
        """Surfaces, and the throttle that makes the true thrust."""
        most = self.airframe.static_thrust * (1.0 - truth.airspeed[i] / self.airframe.pitch_speed)
        return np.array([*truth.controls[i, :3], truth.controls[i, THRUST_COLUMN] / most])

    def respond(self, truth: Truth) -> Array:
        """As that of ExportedAeroplane."""
        place = Place(float(earth.gravity(truth.origin[0], truth.origin[2])), float(truth.origin[2]), 0.0)
        state, out = np.zeros(STATE_SIZE), np.empty((len(truth), 6))
        state[POSITION : POSITION + 3] = truth.position[0]
        state[ATTITUDE : ATTITUDE + 4] = truth.quaternion[0]
        state[VELOCITY : VELOCITY + 3] = rotation_matrix(truth.quaternion[0]) @ truth.air_velocity[0]
        state[RATES : RATES + 3] = truth.rates[0]
        for i in range(len(truth)):
            out[i, :3] = rotation_matrix(state[ATTITUDE : ATTITUDE + 4]).T @ state[VELOCITY : VELOCITY + 3]
            out[i, 3:] = state[RATES : RATES + 3]
            state[CONTROLS:] = 0.5 * (self.controls(truth, i) + self.controls(truth, min(i + 1, len(truth) - 1)))
            command = state[CONTROLS:].copy()
            state = runge_kutta_step(self.airframe, place, state, command, _CALM, _CALM, 0.0, STEP)
        return out


def held_out_states(exported: ExportedAeroplane, truth: Truth, count: int = 300) -> dict[str, Any]:
    """JSBSim held at true states: how far its coefficients are from ours, and both from the true ones, by axis."""
    chosen = np.linspace(0, len(truth) - 1, count).astype(int)
    pairs = [exported.coefficients(truth, i) for i in chosen]
    theirs, ours = (np.array([pair[k] for pair in pairs]) for k in (0, 1))
    true, model = truth.coefficients[chosen], _on_truth(exported.learnt, truth)[chosen]
    spread = np.std(truth.coefficients, axis=0)
    return {
        "largest_difference": float(np.max(np.abs(theirs - ours))),
        "nrmse_jsbsim": dict(zip(AXES, (_rms(theirs - true) / spread).tolist(), strict=True)),
        "nrmse_model": dict(zip(AXES, (_rms(model - true) / spread).tolist(), strict=True)),
    }


def _on_truth(learnt: LearntModel, truth: Truth) -> Array:
    """C_X … C_n (n, 6) of the identified model along a flight, without JSBSim."""
    return learnt.model.coefficients(
        dict(zip(learnt.model.parameter_names, learnt.values.tolist(), strict=True)), signals_of(learnt.aircraft, truth)
    )


def _rms(error: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(error**2, axis=0)))


def held_out_pieces(exported: ExportedAeroplane, truth: Truth) -> dict[str, Any]:
    """Free flight of pieces of the flight, by JSBSim and by our simulator: errors of OUTPUTS over their spread."""
    own, errors, flown = OwnAeroplane(exported.learnt), {"jsbsim": [], "own": []}, []
    for start in np.arange(LEAST_TIME, truth.time[-1] - PIECE, EVERY):
        piece = truth.at(start + np.arange(round(PIECE / STEP)) * STEP)
        true = np.hstack([piece.air_velocity, piece.rates])
        flown.append(true)
        errors["jsbsim"].append(exported.respond(piece) - true)
        errors["own"].append(own.respond(piece) - true)
    spread = np.std(np.concatenate(flown), axis=0)
    found = {who: (_rms(np.concatenate(of)) / spread).tolist() for who, of in errors.items()}
    apart = _rms(np.concatenate(errors["jsbsim"]) - np.concatenate(errors["own"])) / spread
    nrmse = {f"nrmse_{who}": dict(zip(OUTPUTS, values, strict=True)) for who, values in found.items()}
    return {**nrmse, "apart": dict(zip(OUTPUTS, apart.tolist(), strict=True)), "pieces": len(flown)}


def stable_loops(learnt: LearntModel, loop: RateLoop, actuator: Actuator, drawn: Array) -> int:
    """How many aeroplanes with other parameters (n, k) a loop holds, each at every airspeed of the flight.

    Independent of the design: the motion is differentiated from our simulator's accelerations, all five states of the
    fast modes together; the delay is a chain of samples and the rest is stepped exactly.
    """
    levels = [level_flight(learnt, speed) for speed in airspeeds_of(learnt)]  # where the pilot trims it
    surface, rate = (0, 3) if loop.axis == PITCH else (1, 2)

    def holds(own: OwnAeroplane, level: LevelFlight) -> bool:
        a, b = fast_modes(own, level)
        scale = (levels[0].airspeed / level.airspeed) ** 2 * loop.sign
        return _decays(a, b[:, surface], rate, scale * loop.p, scale * loop.i, actuator)

    return sum(all(holds(OwnAeroplane(learnt, values), level) for level in levels) for values in drawn)


def fast_modes(own: OwnAeroplane, level: LevelFlight) -> tuple[Array, Array]:
    """A (5, 5) and B (5, 2) of v, w, p, q, r and elevator, aileron, by differences of the simulator's accelerations."""
    place, speed, alpha = Place(9.80665, _altitude_of(level.density), 0.0), level.airspeed, level.alpha

    def rates_of_change(x: Array, delta: Array) -> Array:
        state = np.zeros(STATE_SIZE)
        half = 0.5 * alpha
        state[ATTITUDE : ATTITUDE + 4] = [np.cos(half), 0.0, np.sin(half), 0.0]
        velocity = np.array([speed * np.cos(alpha), x[0], speed * np.sin(alpha) + x[1]])
        state[VELOCITY : VELOCITY + 3] = rotation_matrix(state[ATTITUDE : ATTITUDE + 4]) @ velocity
        state[RATES : RATES + 3] = x[2:]
        state[CONTROLS : CONTROLS + 3] = level.surfaces + [delta[0], delta[1], 0.0]
        acting = motion(own.airframe, place, state, _CALM, 0.0)
        change = acting.specific_force - np.cross(x[2:], velocity)  # gravity turns slowly: no fast mode
        return np.array([change[1], change[2], *acting.angular_acceleration])

    steps = np.array([1e-3, 1e-3, 1e-4, 1e-4, 1e-4])
    none = np.zeros(5)
    a = np.array(
        [
            (rates_of_change(none + h * e, np.zeros(2)) - rates_of_change(none - h * e, np.zeros(2))) / (2.0 * h)
            for h, e in zip(steps, np.eye(5), strict=True)
        ]
    ).T
    b = np.array([(rates_of_change(none, 1e-4 * e) - rates_of_change(none, -1e-4 * e)) / 2e-4 for e in np.eye(2)]).T
    return a, b


def _altitude_of(density: float) -> float:
    from aircraft_sysid_ros.aircraft.atmosphere import air_density

    low, high = -500.0, 11000.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if air_density(middle) > density else (low, middle)
    return low


def _decays(a: Array, b: Array, rate: int, p: float, i: float, actuator: Actuator) -> bool:
    """Whether the sampled loop, 200 Hz with the delay as a chain of samples, has all its roots inside of the circle."""
    from scipy.linalg import expm

    n, chain = len(a), max(1, round(actuator.delay / STEP))
    continuous = np.zeros((n + 2, n + 2))
    continuous[:n, :n], continuous[:n, n] = a, b
    continuous[n, n], continuous[n, n + 1] = -1.0 / actuator.lag, 1.0 / actuator.lag  # surface, what arrives
    discrete = expm(continuous * STEP)
    size = n + 2 + chain  # states, surface, integral, commands under way
    step = np.zeros((size, size))
    step[: n + 1, : n + 1] = discrete[: n + 1, : n + 1]
    step[: n + 1, size - 1] = discrete[: n + 1, n + 1]  # the oldest command arrives
    step[n + 1, n + 1], step[n + 1, rate] = 1.0, -STEP
    step[n + 2, rate], step[n + 2, n + 1] = -p, i
    for k in range(1, chain):
        step[n + 2 + k, n + 1 + k] = 1.0
    return bool(np.abs(np.linalg.eigvals(step)).max() < 1.0)


def judge_gains(learnt: LearntModel, actuator: Actuator | None = None) -> dict[str, Any]:
    """Gains of both loops, and in how many of GAIN_DRAWS aeroplanes they are stable."""
    actuator, found = actuator or Actuator(), {}
    drawn = learnt.draws(GAIN_DRAWS, GAIN_SEED)
    for axis in (ROLL, PITCH):
        try:
            loop = design(learnt, axis, actuator)
        except InputError as error:
            found[axis] = {"refused": str(error)}
            continue
        stable = stable_loops(learnt, loop, actuator, drawn)
        found[axis] = {
            "p": loop.p, "i": loop.i, "ff": loop.ff, "stable": stable, "draws": GAIN_DRAWS,
            "gain_margin_db": float(20.0 * np.log10(loop.gain_margin)),
            "phase_margin_deg": float(np.degrees(loop.phase_margin)),
        }  # fmt: skip
    return found


def _beside_constants(learnt: LearntModel) -> dict[str, float]:
    """What Gazebo loses besides the constants that it has no place for."""
    flown = learnt.flown
    missed = gazebo.body_coefficients(gazebo.coefficients(flown), flown, flown.signals) + thrust_part(flown)
    missed -= flown.coefficients
    return dict(zip(AXES, (np.std(missed, axis=0) / np.std(flown.coefficients, axis=0)).tolist(), strict=True))


def judge(name: str, duration: float) -> dict[str, Any]:
    """One aeroplane."""
    with tempfile.TemporaryDirectory() as folder:
        learnt = learn(fly(name, LEARNT_SEED, duration), Path(folder))
    truth = fly(name, HELD_OUT_SEED, duration).truth
    exported = ExportedAeroplane(learnt, str(export_jsbsim(learnt).content))
    return {
        "states": held_out_states(exported, truth),
        "pieces": held_out_pieces(exported, truth),
        "lost": {
            "ardupilot-sitl": dict(export_ardupilot_sitl(learnt, reached(learnt)).lost),
            "gazebo": dict(export_gazebo(learnt).lost),
            "gazebo, constants apart": _beside_constants(learnt),
        },
        "gains": judge_gains(learnt),
    }


def poor_flights() -> list[dict[str, Any]]:
    """Gains from short, noisy and gusty flights of the textbook aeroplane, judged on draws and on the truth."""
    results = []
    truth = default_aircraft()
    for k, (duration, noise, turbulence) in enumerate(POOR):
        sensors = SensorOptions(noise_scale=noise)
        flight = simulate_samples(truth, 300 + k, duration, turbulence=turbulence, sensors=sensors)
        with tempfile.TemporaryDirectory() as folder:
            try:
                learnt = learn(flight, Path(folder))
            except InputError as error:
                results += [{"flight": k, "axis": axis, "refused": str(error)} for axis in (ROLL, PITCH)]
                continue
        found = judge_gains(learnt)
        true_values = np.array([truth.coefficients[name] for name in learnt.model.parameter_names])
        for axis, loop in found.items():
            of_flight = {
                "flight": k,
                "duration": duration,
                "noise": noise,
                "turbulence": turbulence,
                "axis": axis,
                **loop,
            }
            if "refused" not in loop:
                of_flight["holds_the_true_one"] = bool(
                    stable_loops(learnt, design(learnt, axis, Actuator()), Actuator(), true_values[None])
                )
            results.append(of_flight)
    return results


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    os.environ["JSBSIM_DEBUG"] = "0"
    parser.add_argument("--duration", type=float, default=120.0)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "export.json")
    arguments = parser.parse_args()
    started = time.process_time()
    result = {"duration": arguments.duration, "aeroplanes": {n: judge(n, arguments.duration) for n in AEROPLANES}}
    result["poor_flights"] = poor_flights()
    result["cpu_seconds"] = time.process_time() - started
    print(json.dumps(result, indent=1))
    arguments.out.write_text(json.dumps(result, indent=1) + "\n", encoding="utf8")


if __name__ == "__main__":
    main()
