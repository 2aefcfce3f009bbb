"""Compile the numerical kernels before they are needed: ``python -m aircraft_sysid_ros.compile_kernels``.

Numba keeps what it compiles beside the sources and does not notice that a function which a kernel calls has changed
in another file: ``make env`` therefore deletes the caches and runs this whenever a compiled source has changed.
Parts are compiled side by side. Of two processes that come to the same kernel one compiles it, and the other waits and
loads it: kernels do not call themselves, so that none waits for one that waits for it.
"""

from __future__ import annotations

import fcntl
import gc
import multiprocessing
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numba.core.caching import FunctionCache
from numba.core.dispatcher import Dispatcher

from aircraft_sysid_ros.aircraft.aerodynamic_model import AXES
from aircraft_sysid_ros.aircraft.configuration import aircraft_from_dict, load_aircraft
from aircraft_sysid_ros.aircraft.signals import SIGNAL_COUNT
from aircraft_sysid_ros.calibration.calibration_file import Calibration
from aircraft_sysid_ros.calibration.correction import Correction
from aircraft_sysid_ros.calibration.kinematics import integrated_outputs
from aircraft_sysid_ros.config_files import DEFAULT_AIRCRAFT, config_path
from aircraft_sysid_ros.diagnosis.failures.axis_relation import whitened
from aircraft_sysid_ros.diagnosis.failures.coloured_fit import coloured_fit
from aircraft_sysid_ros.diagnosis.failures.interval_search import FROZEN, Whitened, sums_of_squares
from aircraft_sysid_ros.diagnosis.flight.flight_data import FlightData
from aircraft_sysid_ros.diagnosis.search import intervals
from aircraft_sysid_ros.diagnosis.search.fit import fits_of, tied_gains
from aircraft_sysid_ros.estimation.kalman_filter import LinearSystem, filter_series
from aircraft_sysid_ros.estimation.smoothing import smooth_series
from aircraft_sysid_ros.flight_check import in_flight
from aircraft_sysid_ros.flight_model.bank import filter_bank, simulation_bank
from aircraft_sysid_ros.flight_model.layout import make_theta
from aircraft_sysid_ros.identification import model_change
from aircraft_sysid_ros.identification.identifier import Identifier
from aircraft_sysid_ros.identification.monitoring.range_agreement import RangeAgreement
from aircraft_sysid_ros.identification.options import EstimatorName, ParameterOptions
from aircraft_sysid_ros.pipeline import Pipeline
from aircraft_sysid_ros.reconstruction.state_estimator import warm_up
from aircraft_sysid_ros.recordings.reader import read_recording
from aircraft_sysid_ros.refinement.record import record_of
from aircraft_sysid_ros.ros_messages.output_messages import state_fields
from aircraft_sysid_ros.simulation.closed_loop import SteppedAeroplane
from aircraft_sysid_ros.simulation.simulated_flight import SimulatedFlight, simulate_samples
from aircraft_sysid_ros.simulation.truth_files import write_flight

#: Of an aircraft file that says nothing of its sensors, which are then estimated as well.
_SHAPE = ("name", "mass", "wing_area", "span", "chord", "inertia")


def filters() -> None:
    """The state's filter and smoother, and those of linear systems."""
    warm_up(load_aircraft(config_path(DEFAULT_AIRCRAFT)), smoother=True)
    system = LinearSystem(np.eye(1), np.eye(1), np.eye(1), np.eye(1))
    smooth_series(system, filter_series(system, np.zeros(1), np.eye(1), np.zeros((2, 1))))


def maximum_likelihood() -> None:
    """Recursive maximum likelihood, which holds a bank of filters of its own."""
    _identifier("rml").warm_up()


def least_squares() -> None:
    """Least squares in time and in frequency, a change of its model, and the correction of sensors."""
    _identifier("rls").warm_up()
    model_change.warm_up(load_aircraft(config_path(DEFAULT_AIRCRAFT)), ParameterOptions())
    _identifier("fourier").warm_up()
    Correction(Calibration()).warm_up()


def search() -> None:
    """The fits on which a diagnosis tries its candidates."""
    aircraft, draws, count = load_aircraft(config_path(DEFAULT_AIRCRAFT)), np.random.default_rng(0), 1000
    signals = draws.uniform(0.1, 0.2, (count, SIGNAL_COUNT))
    time = np.linspace(0.0, 100.0, count)
    fits, _ = fits_of(FlightData(aircraft, time, draws.standard_normal((count, len(AXES))), signals, 0.1))
    fits["CZ"].gain(signals[:, :2])
    _ = fits["CZ"].fit
    tied_gains(fits, {"CZ": signals[:, :1]}, {"CZ": np.ones((1, 1))})
    intervals.warm_up()


def failures() -> None:
    """The fits on which an input is sought that stopped acting."""
    columns, white = np.random.default_rng(0).standard_normal((50, 2)), np.ones(1)
    coloured_fit(columns, np.ones(50), white, 3, 0.1, 1)
    series = Whitened(columns, columns, columns, columns[:, 0], whitened(columns[:, 1], white))
    sums_of_squares(series, FROZEN, np.array([10]), np.array([40]))


def simulation() -> None:
    """An aeroplane that flies, and one of which every step is asked for."""
    _flown(20.0)
    SteppedAeroplane(load_aircraft(config_path(DEFAULT_AIRCRAFT)), seed=1, duration=1.0).look()


def checks() -> None:
    """What looks at a flight as it is, and at two parts of one that disagree."""
    RangeAgreement(load_aircraft(config_path(DEFAULT_AIRCRAFT)).model).warm_up()
    in_flight.warm_up()


def whole_way() -> None:
    """Record, read and replay for some seconds, also with sensors that no file describes."""
    aircraft = load_aircraft(config_path(DEFAULT_AIRCRAFT))
    with tempfile.TemporaryDirectory() as folder:
        write_flight(_flown(30.0), Path(folder) / "flight", overwrite=False)
        samples = read_recording(Path(folder) / "flight").samples
    pipeline, half = Pipeline(aircraft), len(samples) // 2
    rows, _ = pipeline.push(samples)
    state_fields(rows)
    pipeline.flush()
    pipeline.parameters.snapshot()
    sensors_unknown = Pipeline(aircraft_from_dict({key: aircraft.source[key] for key in _SHAPE}))
    sensors_unknown.push(samples[:half])
    sensors_unknown.flush()


def refinement() -> None:
    """The banks of flights and filters of `refine`."""
    aircraft = load_aircraft(config_path(DEFAULT_AIRCRAFT))
    record = record_of(aircraft, _flown(30.0).samples, 50.0)
    theta = make_theta(record.model, np.zeros(len(aircraft.model.parameter_names)))[None]
    flown = record.time[:2], record.inputs[:2]
    filter_bank(record.states[0], np.eye(15), *flown, record.outputs[:2], theta, record.model)
    simulation_bank(record.states[:1], *flown, theta, record.model)


def calibration() -> None:
    """The outputs that `calibrate` integrates."""
    times, north, still, zeros = np.zeros(1), np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)), np.zeros(1, dtype=np.int64)
    level, outputs, ones = np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((2, 6)), np.ones((1, 6))
    integrated_outputs(
        times, still, still, zeros, zeros, ones, 2, north, level, np.zeros(6), np.zeros(3), 9.8, outputs, True
    )


#: Longest first, so that all processes end at about the same time.
PARTS: tuple[Callable[[], None], ...] = (
    maximum_likelihood,
    filters,
    simulation,
    least_squares,
    search,
    failures,
    checks,
    calibration,
    refinement,
    whole_way,
)


def main() -> None:
    """Call every kernel."""
    with tempfile.TemporaryDirectory() as turns:
        processes = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(mp_context=processes, initializer=_in_turns, initargs=(turns,)) as pool:
            for compiled in [pool.submit(part) for part in PARTS]:
                compiled.result()


def _identifier(estimator: EstimatorName) -> Identifier:
    aircraft = load_aircraft(config_path(DEFAULT_AIRCRAFT))
    return Identifier(aircraft, ParameterOptions(estimator=estimator))


def _flown(duration: float) -> SimulatedFlight:
    return simulate_samples(load_aircraft(config_path(DEFAULT_AIRCRAFT)), duration=duration)


def _in_turns(folder: str) -> None:
    """For a process of several: who compiles or loads a kernel has the lock of its function, a file in this folder."""
    gc.disable()  # what compiles makes millions of objects, and hardly any that is to be collected
    compiled: Callable[..., Any] = Dispatcher.compile
    held: set[str] = set()

    def compiled_in_turn(kernel: Any, signature: Any) -> Any:
        name = f"{kernel.py_func.__module__}.{kernel.py_func.__name__}"
        if name in held or not isinstance(kernel._cache, FunctionCache):
            return compiled(kernel, signature)
        with open(Path(folder) / name, "w") as turn:
            fcntl.flock(turn, fcntl.LOCK_EX)
            held.add(name)
            try:
                return compiled(kernel, signature)
            finally:
                held.remove(name)

    Dispatcher.compile = compiled_in_turn  # type: ignore[method-assign, assignment]


if __name__ == "__main__":
    main()
